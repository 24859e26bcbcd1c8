"""The simulated motion of a run as a PyTensor operation, with the gradient that its sensitivities give."""

from __future__ import annotations

import warnings

import numpy as np
import pytensor.tensor as pt
from pytensor.gradient import DisconnectedType, disconnected_type, grad_not_implemented
from pytensor.graph.basic import Apply
from pytensor.graph.op import Op
from pytensor.link.numba.dispatch.basic import generate_fallback_impl, numba_funcify

from pymc_ship.motion.sensitivities import sensitivities
from pymc_ship.trajectory.runs import Run
from pymc_ship.vessel.vessel import Vessel


class SimulatedMotion(Op):
    """Block means of the states along the rudder of a run, shape (n_states, n_blocks), and their derivatives.

    Inputs are the coefficients (n_coefficients,) and the initial state (n_states,). Where the ship leaves the model's
    range, the motion is NaN throughout and its derivatives are 0.

    Parameters
    ----------
    run : Run
    vessel : Vessel
    """

    default_output = 0

    def __init__(self, run: Run, vessel: Vessel):
        self.run, self.vessel = run, vessel

    def make_node(self, coefficients, initial_state):
        """Apply the operation to two vectors; the second output is the Jacobian, which the gradient needs."""
        inputs = [pt.as_tensor_variable(coefficients), pt.as_tensor_variable(initial_state)]
        return Apply(self, inputs, [pt.dmatrix(), pt.dtensor3()])

    def perform(self, node, inputs, output_storage):
        """Simulate once, with sensitivities: one evaluation serves density and gradient."""
        coefficients, initial_state = inputs
        run = self.run
        motion, jacobian = sensitivities(
            self.vessel, run.inputs, initial_state, coefficients, block=run.block, **run.integration
        )
        if not np.isfinite(motion).all():
            jacobian[:] = 0.0
        output_storage[0][0], output_storage[1][0] = motion, jacobian

    def infer_shape(self, node, input_shapes):
        """States, blocks and unknowns of the run."""
        (n_coefficients,), (n_states,) = input_shapes
        n_blocks = pt.constant(self.run.n_blocks)
        return [(n_states, n_blocks), (n_states, n_blocks, n_coefficients + n_states)]

    def pullback(self, inputs, outputs, cotangents):
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
def _called_from_numba(op, node, **kwargs):
    """Python within compiled graphs, without the warning: the simulation itself is compiled and releases the GIL."""
    with warnings.catch_warnings():
        warnings.filterwarnings("ignore", message="Numba will use object mode", category=UserWarning)
        return generate_fallback_impl(op, node, **kwargs)
