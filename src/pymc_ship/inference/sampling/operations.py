"""Simulated motion of a run as a PyTensor operation, and the density of pooled groups, with gradients."""

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
def _quadratic_form(matrix: np.ndarray, columns: np.ndarray) -> tuple[np.ndarray, float]:
    """C' S^-1 C of columns C (p, n), and half the log determinant of S (p, p), given below its diagonal."""
    p, n = columns.shape
    root, whitened, half = np.zeros((p, p)), columns.copy(), 0.0
    for i in range(p):
        for j in range(i + 1):
            total = matrix[i, j]
            for k in range(j):
                total -= root[i, k] * root[j, k]
            root[i, j] = np.sqrt(total) if i == j else total / root[j, j]
        half += np.log(root[i, i])
        for k in range(i):
            for j in range(n):
                whitened[i, j] -= root[i, k] * whitened[k, j]
        for j in range(n):
            whitened[i, j] /= root[i, i]
    form = np.zeros((n, n))
    for k in range(p):
        for i in range(n):
            for j in range(i, n):
                form[i, j] += whitened[k, i] * whitened[k, j]
    for i in range(n):
        for j in range(i):
            form[i, j] = form[j, i]
    return form, half


@_jit
def _own_covariance(rows: np.ndarray, tau: np.ndarray, variance: float) -> np.ndarray:
    """S = sigma2 I + R diag(tau^2) R' of rows [R z], below its diagonal."""
    p = len(rows)
    covariance = np.zeros((p, p))
    for i in range(p):
        for j in range(i + 1):
            for k in range(p):
                covariance[i, j] += rows[i, k] * rows[j, k] * tau[k] ** 2
        covariance[i, i] += variance
    return covariance


@_jit
def _slopes(form: np.ndarray, moments: np.ndarray) -> np.ndarray:
    """Diagonal of D E D - D, then of R' D E D R - R' D R: E = [R z] moments [R z]', form = [I R z]' D [I R z]."""
    p = len(moments) - 1
    slopes, product = np.empty(2 * p), np.empty(p + 1)
    for i in range(2 * p):
        slopes[i], product[:] = -form[i, i], 0.0
        for j in range(p + 1):
            for k in range(p + 1):
                product[k] += form[i, p + j] * moments[j, k]
        for k in range(p + 1):
            slopes[i] += product[k] * form[i, p + k]
    return slopes


@_jit
def pooled_density(
    tau: np.ndarray,
    variance: np.ndarray,
    rows: np.ndarray,
    residual_squares: np.ndarray,
    spare_rows: np.ndarray,
    precision: np.ndarray,
) -> tuple[float, np.ndarray, np.ndarray]:
    """Log density of the rows of all groups, coefficients integrated out, and its derivatives by tau and sigma2.

    tau (n_terms,), sigma2 (n_groups,), rows [R z] (n_groups, n_terms, n_terms + 1), residual sums of squares
    (n_groups,), rows less n_terms (n_groups,), precisions of the means (n_terms,). NaN if out of numerical range.
    Loops over small matrices compile in half the time of calls of BLAS.
    """
    n_groups, p = rows.shape[:2]
    density, forms = 0.0, np.empty((n_groups, 2 * p + 1, 2 * p + 1))  # [I R z]' S^-1 [I R z]
    columns, total, shift = np.zeros((p, 2 * p + 1)), np.zeros((p, p)), np.zeros((p, p + 1))
    for i in range(p):
        columns[i, i], shift[i, i], total[i, i] = 1.0, 1.0, precision[i]
    for g in range(n_groups):
        columns[:, p:] = rows[g]
        forms[g], half = _quadratic_form(_own_covariance(rows[g], tau, variance[g]), columns)
        total += forms[g, p : 2 * p, p : 2 * p]
        shift[:, p] += forms[g, p : 2 * p, 2 * p]
        # a group of fewer rows than terms has rows of zeros; their density is taken off again here
        rest = spare_rows[g] * np.log(variance[g]) + residual_squares[g] / variance[g]
        density -= half + 0.5 * (forms[g, 2 * p, 2 * p] + rest)
    moments, half = _quadratic_form(total, shift)  # covariance M of the means, their mean m, and the square it explains
    density += 0.5 * moments[p, p] - half
    # d density = tr((D e e' D - D + D R M R' D) dS) / 2 with D = S^-1 and e = z - R m: by the second moments of (b, -1)
    for i in range(p):
        for j in range(p):
            moments[i, j] += moments[i, p] * moments[j, p]
    for i in range(p):
        moments[i, p] = moments[p, i] = -moments[i, p]
    moments[p, p] = 1.0
    of_tau, of_variance = np.zeros(p), np.empty(n_groups)
    for g in range(n_groups):
        slopes = _slopes(forms[g], moments)
        of_tau += tau * slopes[p:]
        of_variance[g] = 0.5 * (np.sum(slopes[:p]) + (residual_squares[g] / variance[g] - spare_rows[g]) / variance[g])
    return density, of_tau, of_variance
