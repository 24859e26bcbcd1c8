"""Simulated motion of a run as a PyTensor operation, and the density of pooled groups, with gradients."""

from __future__ import annotations

import warnings
from collections.abc import Sequence
from typing import Any

import numpy as np
import pytensor.tensor as pt
from numba import njit
from pytensor.gradient import DisconnectedType, disconnected_type, grad_not_implemented
from pytensor.graph.basic import Apply
from pytensor.graph.op import Op
from pytensor.link.numba.dispatch.basic import generate_fallback_impl, numba_funcify

from pymc_ship.inference.trajectory.runs import Run
from pymc_ship.physics.motion.sensitivities import sensitivities
from pymc_ship.physics.vessel.vessel import Vessel

_jit = njit(cache=True, nogil=True, error_model="numpy")


class SimulatedMotion(Op):
    """Block means (n_states, n_blocks) of the states of a run from coefficients and initial state, and derivatives.

    A diverged motion is NaN, its derivatives are 0.
    """

    default_output = 0

    def __init__(self, run: Run, vessel: Vessel):
        self.run, self.vessel = run, vessel

    def make_node(self, *inputs: Any) -> Apply:
        """Node with two outputs, motion and Jacobian."""
        return Apply(self, list(map(pt.as_tensor_variable, inputs)), [pt.dmatrix(), pt.dtensor3()])

    def perform(self, node: Apply, inputs: Sequence[np.ndarray], output_storage: list[list[Any]]) -> None:
        """Simulate with sensitivities."""
        coefficients, initial_state = inputs
        run = self.run
        motion, jacobian = sensitivities(
            self.vessel, run.inputs, initial_state, coefficients, block=run.block, **run.integration
        )
        if not np.isfinite(motion).all():
            jacobian[:] = 0.0
        output_storage[0][0], output_storage[1][0] = motion, jacobian

    def infer_shape(self, node: Apply, input_shapes: Sequence[Sequence[Any]]) -> list[Sequence[Any]]:
        """Shapes of motion and Jacobian."""
        (n_coefficients,), (n_states,) = input_shapes
        n_blocks = pt.constant(self.run.n_blocks)
        return [(n_states, n_blocks), (n_states, n_blocks, n_coefficients + n_states)]

    def pullback(self, inputs: Sequence[Any], outputs: Sequence[Any], cotangents: Sequence[Any]) -> list[Any]:
        """Product of the cotangent of the motion with the Jacobian."""
        of_motion, of_jacobian = cotangents
        if not isinstance(of_jacobian.type, DisconnectedType):
            return [grad_not_implemented(self, k, value) for k, value in enumerate(inputs)]
        if isinstance(of_motion.type, DisconnectedType):
            return [disconnected_type(), disconnected_type()]
        slope = pt.dot(of_motion.ravel(), outputs[1].reshape((-1, outputs[1].shape[2])))
        n_coefficients = inputs[0].shape[0]
        return [slope[:n_coefficients], slope[n_coefficients:]]


@numba_funcify.register(SimulatedMotion)
def _numba_simulated_motion(op: Op, node: Apply, **kwargs: Any) -> Any:
    """Numba object mode without its warning; the simulation itself is compiled."""
    with warnings.catch_warnings():
        warnings.filterwarnings("ignore", message="Numba will use object mode", category=UserWarning)
        return generate_fallback_impl(op, node, **kwargs)


@_jit
def _inverse_root(matrix: np.ndarray) -> tuple[np.ndarray, float]:
    """Inverse Cholesky factor W of a positive definite matrix, and half its log determinant."""
    p = matrix.shape[0]
    root, inverse, half = np.zeros((p, p)), np.zeros((p, p)), 0.0
    for i in range(p):
        for j in range(i + 1):
            total = matrix[i, j]
            for k in range(j):
                total -= root[i, k] * root[j, k]
            root[i, j] = np.sqrt(total) if i == j else total / root[j, j]
        half += np.log(root[i, i])
        inverse[i, i] = 1.0 / root[i, i]
        for j in range(i):
            total = 0.0
            for k in range(j, i):
                total -= root[i, k] * inverse[k, j]
            inverse[i, j] = total / root[i, i]
    return inverse, half


@_jit
def pooled_density(
    tau: np.ndarray,
    variance: np.ndarray,
    triangles: np.ndarray,
    projections: np.ndarray,
    residual_squares: np.ndarray,
    spare_rows: np.ndarray,
    precision: np.ndarray,
) -> tuple[float, np.ndarray, np.ndarray]:
    """Log density of the rows of all groups, coefficients integrated out, and its derivatives by tau and sigma2.

    tau (n_terms,), sigma2 (n_groups,), triangles (n_groups, n_terms, n_terms), projections (n_groups, n_terms),
    residual sums of squares (n_groups,), rows less n_terms (n_groups,), precisions of the means (n_terms,). NaN if out
    of numerical range.
    """
    n_groups, p = projections.shape
    eye = np.eye(p)
    density: Any = 0.0
    whiteners, whitened = np.empty((n_groups, p, p)), np.empty((n_groups, p, p))  # W and W R
    targets = np.empty((n_groups, p))
    total, shift = np.diag(precision), np.zeros(p)
    for g in range(n_groups):
        own = triangles[g] * tau
        whiteners[g], half = _inverse_root(variance[g] * eye + own @ own.T)
        whitened[g], targets[g] = whiteners[g] @ triangles[g], whiteners[g] @ projections[g]
        total += whitened[g].T @ whitened[g]
        shift += whitened[g].T @ targets[g]
        # a group of fewer rows than terms has rows of zeros; their density is taken off again here
        rest = spare_rows[g] * np.log(variance[g]) + residual_squares[g] / variance[g]
        density -= half + 0.5 * (targets[g] @ targets[g]) + 0.5 * rest
    inverse, half = _inverse_root(total)
    covariance, center = inverse.T @ inverse, inverse @ shift
    density += 0.5 * (center @ center) - half
    means, of_tau, of_variance = inverse.T @ center, np.zeros(p), np.empty(n_groups)
    # d density = tr((D e e' D - D + D R M R' D) dS) / 2, S = sigma2 I + R diag(tau^2) R', D = S^-1, M = covariance
    for g in range(n_groups):
        error = targets[g] - whitened[g] @ means
        square, slope = whitened[g].T @ whitened[g], whitened[g].T @ error
        of_tau += tau * (slope**2 - np.diag(square) + np.sum((square @ covariance) * square, axis=1))
        pulled, spread = whiteners[g].T @ error, whiteners[g].T @ whitened[g]
        trace = pulled @ pulled - np.sum(whiteners[g] ** 2) + np.sum((spread @ covariance) * spread)
        of_variance[g] = 0.5 * (trace - spare_rows[g] / variance[g] + residual_squares[g] / variance[g] ** 2)
    return density, of_tau, of_variance
