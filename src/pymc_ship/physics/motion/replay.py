"""Open-loop simulation along measured inputs, of one ship or of many draws in parallel."""

import numpy as np
from numba import njit

from pymc_ship.machine.errors import SimulationError
from pymc_ship.machine.threads import map_in_threads
from pymc_ship.physics.motion.equations import KERNEL, Scheme, scheme, set_parts
from pymc_ship.physics.motion.inputs import completed_inputs
from pymc_ship.physics.motion.stepping import (
    LANES,
    METHODS,
    N_INPUTS,
    Inputs,
    Record,
    advance_along,
    copy,
    integration,
    lanes_at_rest,
    mark_divergence,
)
from pymc_ship.physics.vessel.vessel import Vessel


@njit(**KERNEL)
def _replay(
    coefficients: np.ndarray, scheme: Scheme, initial: np.ndarray, record: Record, out: np.ndarray, first: int
) -> None:
    """Integrate the lanes along a record of inputs; add block means to ``out`` (n_states, n_draws, n_blocks).

    Lane 0 is draw ``first``. A slice of the draws would be an array of another type, and the kernel compiled twice.
    """
    n_lanes, (n_states, _, n_blocks) = coefficients.shape[1], out.shape
    values, block, substeps, n_time = record.inputs, record.block, record.integration.substeps, record.inputs.shape[1]
    lanes = lanes_at_rest(n_lanes, record.integration.stages.shape[0], scheme)
    set_parts(coefficients, scheme, lanes.work)
    copy(lanes.state[:n_states], initial)
    inputs = Inputs(np.empty((values.shape[0], n_lanes)), np.empty((values.shape[0], n_lanes)), np.zeros(n_lanes))
    diverged = np.full(n_lanes, -1)
    for k in range(n_blocks * block):
        if mark_divergence(lanes.state, scheme.hull, k, diverged) == 0:
            break
        for row in range(n_states):
            for lane in range(n_lanes):
                out[row, first + lane, k // block] += lanes.state[row, lane] / block
        for part in range(substeps):
            for row in range(values.shape[0]):
                change = (values[row, min(k + 1, n_time - 1)] - values[row, k]) / substeps
                inputs.before[row] = values[row, k] + part * change
                inputs.after[row] = values[row, k] + (part + 1) * change
            advance_along(lanes, inputs, coefficients, scheme, record.integration)
    for lane in range(n_lanes):
        if diverged[lane] >= 0:
            out[:, first + lane] = np.nan


def replay(
    vessel: Vessel,
    inputs: np.ndarray,
    initial_state: np.ndarray,
    coefficients: np.ndarray,
    *,
    interval: float,
    method: str = "rk4",
    substeps: int = 1,
    block: int = 1,
) -> np.ndarray:
    """Open-loop simulation of many draws along the same inputs, each from its own initial state.

    Parameters
    ----------
    vessel : Vessel
    inputs : array_like, shape (n_time,) or (4, n_time)
        Rudder angle [rad], linear between samples; or all inputs, see :func:`.recorded_inputs`.
    initial_state : array_like, shape (n_draws, n_states)
        The first 5, 6 or 8 of u, v [m/s], r, p [rad/s], phi, psi [rad], x, y [m].
    coefficients : array_like, shape (n_draws, n_coefficients)
        DOFs one after the other in the vessel's order.
    interval : float
        Sampling interval of the inputs [s].
    method : {"euler", "rk4"}, optional
    substeps, block : int, optional
        Integration steps for each interval; samples averaged into one (those after the last full block are dropped).

    Returns
    -------
    ndarray, shape (n_states, n_draws, n_blocks)
        Block means, SI units and rad; NaN for a draw that diverged.

    Raises
    ------
    SimulationError
        For an unknown method, a wrong shape, counts below one or a record shorter than one block.
    """
    values, draws = completed_inputs(inputs), np.atleast_2d(np.asarray(coefficients, dtype=float))
    initial = np.atleast_2d(np.asarray(initial_state, dtype=float))
    check_replay(vessel, (draws[0], initial[0], values), interval, method, substeps, block)
    if len(initial) != len(draws):
        raise SimulationError(f"Each draw has its initial state, found {len(draws)} and {len(initial)}; match them.")
    record = Record(values, integration(method, interval * (1.0 / substeps), substeps), int(block))
    equations = scheme(vessel)
    out = np.zeros((initial.shape[1], len(draws), values.shape[1] // block))
    blocks = [slice(start, start + LANES) for start in range(0, len(draws), LANES)]

    def run(lanes: slice) -> None:
        coefficients, states = (np.ascontiguousarray(rows[lanes].T) for rows in (draws, initial))
        _replay(coefficients, equations, states, record, out, lanes.start)

    map_in_threads(run, blocks)
    return out


def check_replay(
    vessel: Vessel, arrays: tuple[np.ndarray, ...], interval: float, method: str, substeps: int, block: int
) -> None:
    """Raise SimulationError unless coefficients, initial state, inputs and settings suit an open-loop simulation."""
    n_coefficients = sum(map(len, vessel.forces.values())) + len(vessel.parameters)
    shapes = [array.shape for array in arrays]
    if shapes[0] != (n_coefficients,) or shapes[1] not in ((5,), (6,), (8,)) or shapes[2][0] != N_INPUTS:
        expected = f"{n_coefficients} coefficients, 5, 6 or 8 initial states and inputs of shape (time,) or (4, time)"
        raise SimulationError(f"A replay needs {expected}, found shapes {', '.join(map(str, shapes))}; reshape them.")
    if method not in METHODS or substeps < 1 or not 1 <= block <= shapes[2][1] or not 0.0 < interval < np.inf:
        raise SimulationError(
            f"A replay needs a method of {', '.join(METHODS)}, a positive interval, substeps from 1 and a block from 1 "
            f"to the record's length, found {method!r}, {interval}, {substeps} and {block}; correct them."
        )
