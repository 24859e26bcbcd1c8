"""Motion along a rudder record: one ship, or one for each of many parameter vectors, in parallel."""

from __future__ import annotations

import numpy as np
from numba import njit

from pymc_ship.machine.threads import thread_pool
from pymc_ship.motion.equations import KERNEL, scheme
from pymc_ship.motion.stepping import (
    LANES,
    METHODS,
    SimulationError,
    advance_along,
    integration,
    lanes_at_rest,
    mark_divergence,
)
from pymc_ship.vessel.vessel import Vessel


@njit(**KERNEL)
def _replay(coefficients, scheme, initial, record, integration, out):
    """Integrate the lanes along a rudder record; write block means to ``out`` (n_states, n_lanes, n_blocks)."""
    n_states, n_lanes, n_blocks = out.shape
    block, substeps = record.size // n_blocks, integration.substeps
    lanes = lanes_at_rest(n_lanes, integration.stages.shape[0], scheme.n_rows)
    lanes.state[:n_states] = initial
    delta, following = np.empty(n_lanes), np.empty(n_lanes)
    diverged = np.full(n_lanes, -1)
    for k in range(n_blocks * block):
        if mark_divergence(lanes.state, scheme.hull.nominal_speed, k, diverged) == 0:
            break
        for row in range(n_states):
            for lane in range(n_lanes):
                out[row, lane, k // block] += lanes.state[row, lane] / block
        change = (record[min(k + 1, record.size - 1)] - record[k]) / substeps
        for part in range(substeps):
            delta[:] = record[k] + part * change
            following[:] = record[k] + (part + 1) * change
            advance_along(lanes, delta, following, coefficients, scheme, integration)
    for lane in range(n_lanes):
        if diverged[lane] >= 0:
            out[:, lane] = np.nan


def replay(
    vessel: Vessel,
    delta: np.ndarray,
    initial_state: np.ndarray,
    coefficients: np.ndarray,
    *,
    interval: float,
    method: str = "rk4",
    substeps: int = 1,
    block: int = 1,
) -> np.ndarray:
    """Motion of many ships along one recorded rudder, each with its own coefficients and initial state.

    Parameters
    ----------
    vessel : Vessel
    delta : array_like, shape (n_time,)
        Rudder angle at the samples [rad], linear between them.
    initial_state : array_like, shape (n_draws, n_states)
        The first 5, 6 or 8 of u, v [m/s], r, p [rad/s], phi, psi [rad], x, y [m].
    coefficients : array_like, shape (n_draws, n_coefficients)
        DOFs one after the other in the vessel's order.
    interval : float
        Sampling interval of the rudder [s].
    method : {"euler", "rk4"}, optional
    substeps : int, optional
        Integration steps for each interval.
    block : int, optional
        Samples averaged into one; samples beyond the last whole block are left out.

    Returns
    -------
    ndarray, shape (n_states, n_draws, n_blocks)
        Block means, SI units and rad; a ship that left the model's range is NaN throughout.

    Raises
    ------
    SimulationError
        For an unknown method, arrays of the wrong shape, counts below one or a record shorter than a block.
    """
    record = np.ascontiguousarray(delta, dtype=float)
    draws = np.atleast_2d(np.asarray(coefficients, dtype=float))
    initial = np.atleast_2d(np.asarray(initial_state, dtype=float))
    check_replay(vessel, record, initial[0], draws[0], interval=interval, method=method, substeps=substeps, block=block)
    if len(initial) != len(draws):
        raise SimulationError(f"Each draw has its initial state, found {len(draws)} and {len(initial)}; match them.")
    out = np.zeros((initial.shape[1], len(draws), record.size // block))
    equations, steps = scheme(vessel), integration(method, interval * (1.0 / substeps), substeps)
    blocks = [slice(start, start + LANES) for start in range(0, len(draws), LANES)]

    def run(lanes: slice) -> None:
        coefficients, states = (np.ascontiguousarray(values[lanes].T) for values in (draws, initial))
        _replay(coefficients, equations, states, record, steps, out[:, lanes])

    with thread_pool(len(blocks)) as pool:
        list(pool.map(run, blocks))
    return out


def check_replay(
    vessel: Vessel,
    delta: np.ndarray,
    initial_state: np.ndarray,
    coefficients: np.ndarray,
    *,
    interval: float,
    method: str,
    substeps: int,
    block: int,
) -> None:
    """Raise SimulationError for settings that no rudder record can be replayed with; see :func:`replay`."""
    n_coefficients = sum(len(vessel.terms(dof)) for dof in vessel.dofs)
    shapes = coefficients.shape, initial_state.shape, delta.shape
    if shapes[0] != (n_coefficients,) or shapes[1] not in ((5,), (6,), (8,)) or delta.ndim != 1:
        raise SimulationError(
            f"A replay needs {n_coefficients} coefficients, 5, 6 or 8 initial states and a rudder record, found shapes "
            f"{', '.join(map(str, shapes))}; reshape them."
        )
    if method not in METHODS or substeps < 1 or not 1 <= block <= delta.size or not 0.0 < interval < np.inf:
        raise SimulationError(
            f"A replay needs a method of {', '.join(METHODS)}, a positive interval, substeps from 1 and a block from 1 "
            f"to the record's length, found {method!r}, {interval}, {substeps} and {block}; correct them."
        )
