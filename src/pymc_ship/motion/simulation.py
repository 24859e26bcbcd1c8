"""Integration of the equations of motion: one ship, or one for each of many parameter vectors, in parallel."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import xarray as xr
from numba import njit

from pymc_ship.machine.arguments import check_choice
from pymc_ship.machine.threads import thread_pool
from pymc_ship.manoeuvre.standard import Manoeuvre
from pymc_ship.motion.equations import KERNEL, STATE, scheme, state_derivative, work_rows
from pymc_ship.trial.channels import CHANNELS, SIMULATED
from pymc_ship.vessel.vessel import Vessel, reference_coefficients

METHODS = ("euler", "rk4")
"""Integrators: explicit Euler (as the paper) and the classical fourth-order Runge-Kutta."""

LANES = 16
"""Ships integrated side by side by one kernel call."""

_STATE_ROWS = len(STATE)
_RK4_STAGES = np.column_stack([[0.0, 0.5, 0.5, 1.0], np.array([1.0, 2.0, 2.0, 1.0]) / 6.0])


class SimulationError(ValueError):
    """Settings that no simulation can run with."""


class _Helm(NamedTuple):
    """How the kernels move the rudder.

    The command is multiplied by ``factor``, ``delay`` steps after the ship has turned by ``heading`` [rad] to the side
    of the command; an infinite heading is never reached. The rudder moves by up to ``travel`` [rad] in a step.
    """

    heading: float
    factor: float
    travel: float
    delay: int


@njit(**KERNEL)
def _steer(helm, psi, command, delta, factor, waiting, following):
    """Rudder angle after one step: switch the command after the switching heading, follow it at the rudder rate.

    ``factor`` (n_lanes,) is what the command is multiplied by so far. ``waiting`` (n_lanes,) counts the steps from a
    switching heading to the rudder's reversal; -1 between them.
    """
    for lane in range(psi.size):
        if waiting[lane] < 0 and -np.sign(factor[lane] * command) * psi[lane] >= helm.heading:
            waiting[lane] = helm.delay
        if waiting[lane] == 0:
            factor[lane] *= helm.factor
        waiting[lane] = max(waiting[lane] - 1, -1)
        target = factor[lane] * command
        following[lane] = delta[lane] + min(max(target - delta[lane], -helm.travel), helm.travel)


@njit(**KERNEL)
def _in_range(state, nominal_speed, lane):
    """Whether a lane is where the model means something: finite, upright, ahead at 1 to 500 % of the nominal speed."""
    speed2 = state[0, lane] ** 2 + state[1, lane] ** 2
    turning = abs(state[2, lane]) + abs(state[3, lane]) + abs(state[5, lane])
    ahead = (state[0, lane] > 0.01 * nominal_speed) & (speed2 < 25.0 * nominal_speed**2)
    return ahead & (turning < np.inf) & (abs(state[4, lane]) < 0.5 * np.pi)


@njit(**KERNEL)
def _mark_divergence(state, nominal_speed, step, diverged):
    """Note the step at which a lane leaves the model's range and park it there; count the lanes still running."""
    n_lanes = state.shape[1]
    in_range = 0
    for lane in range(n_lanes):
        in_range += _in_range(state, nominal_speed, lane)
    if in_range < n_lanes:
        for lane in range(n_lanes):
            if not _in_range(state, nominal_speed, lane):
                if diverged[lane] < 0:
                    diverged[lane] = step
                state[:, lane] = 0.0
                state[0, lane] = nominal_speed
    running = 0
    for lane in range(n_lanes):
        running += diverged[lane] < 0
    return running


@njit(**KERNEL)
def _add(target, base, factor, rate):
    """Write base + factor * rate into the target."""
    for row in range(target.shape[0]):
        for lane in range(target.shape[1]):
            target[row, lane] = base[row, lane] + factor * rate[row, lane]


@njit(**KERNEL)
def _advance(state, delta, following, coefficients, plan, hull, buffers, stages, step):
    """One Euler step (no stages) or one Runge-Kutta step of the states, in place."""
    rate, begin, inner, angle = buffers[3:]
    if stages.shape[0] == 0:
        state_derivative(state, delta, coefficients, plan, hull, buffers[:3], rate)
        _add(state, state, step, rate)
        return
    begin[:] = state
    inner[:] = state
    for stage in range(4):
        fraction = stages[stage, 0]
        for lane in range(delta.size):
            angle[lane] = delta[lane] + fraction * (following[lane] - delta[lane])
        if stage > 0:
            _add(inner, begin, fraction * step, rate)
        state_derivative(inner, angle, coefficients, plan, hull, buffers[:3], rate)
        _add(state, state, stages[stage, 1] * step, rate)


@njit(**KERNEL)
def _buffers(n_rows, n_lanes):
    """Workspace, speed, forces, then rate, begin and inner state of a step and the rudder angle of a stage."""
    shape = (_STATE_ROWS, n_lanes)
    motion = (np.empty((n_rows, n_lanes)), np.empty(n_lanes), np.empty((4, n_lanes)))
    return (*motion, np.empty(shape), np.empty(shape), np.empty(shape), np.empty(n_lanes))


@njit(**KERNEL)
def _integrate(coefficients, plan, hull, n_rows, initial, helm, command, stages, step, stride, start, out):
    """Integrate the lanes into rows of ``out`` (9, n_draws, n_saved); return the steps at which they diverged."""
    n_lanes = coefficients.shape[1]
    state = np.empty((initial.size, n_lanes))
    for row in range(initial.size):
        state[row] = initial[row]
    buffers = _buffers(n_rows, n_lanes)
    delta = np.full(n_lanes, command[0] if helm.travel == np.inf else 0.0)
    following = delta.copy()
    factor, waiting = np.ones(n_lanes), np.full(n_lanes, -1)
    diverged = np.full(n_lanes, -1)
    for k in range(command.size):
        if _mark_divergence(state, hull[1], k, diverged) == 0:
            break
        if k % stride == 0:
            for lane in range(n_lanes):
                if diverged[lane] < 0:
                    out[:-1, start + lane, k // stride] = state[:, lane]
                    out[-1, start + lane, k // stride] = delta[lane]
        ahead = command[min(k + 1, command.size - 1)] if helm.travel == np.inf else command[k]
        _steer(helm, state[5], ahead, delta, factor, waiting, following)
        _advance(state, delta, following, coefficients, plan, hull, buffers, stages, step)
        delta[:] = following
    return diverged


@njit(**KERNEL)
def _replay(coefficients, plan, hull, n_rows, initial, record, stages, step, substeps, start, out):
    """Integrate the lanes along a rudder record; write block means to ``out`` (n_states, n_draws, n_blocks)."""
    n_lanes = coefficients.shape[1]
    n_states, _, n_blocks = out.shape
    block = record.size // n_blocks
    state = np.zeros((_STATE_ROWS, n_lanes))
    state[:n_states] = initial
    buffers = _buffers(n_rows, n_lanes)
    delta, following = np.empty(n_lanes), np.empty(n_lanes)
    diverged = np.full(n_lanes, -1)
    for k in range(n_blocks * block):
        if _mark_divergence(state, hull[1], k, diverged) == 0:
            break
        for row in range(n_states):
            for lane in range(n_lanes):
                out[row, start + lane, k // block] += state[row, lane] / block
        change = (record[min(k + 1, record.size - 1)] - record[k]) / substeps
        for part in range(substeps):
            delta[:] = record[k] + part * change
            following[:] = record[k] + (part + 1) * change
            _advance(state, delta, following, coefficients, plan, hull, buffers, stages, step / substeps)
    for lane in range(n_lanes):
        if diverged[lane] >= 0:
            out[:, start + lane] = np.nan


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
    check_replay(vessel, record, initial[0], draws[0], interval, method, substeps, block)
    if len(initial) != len(draws):
        raise SimulationError(f"Each draw has its initial state, found {len(draws)} and {len(initial)}; match them.")
    out = np.zeros((initial.shape[1], len(draws), record.size // block))
    settings = scheme(vessel), vessel.hull, work_rows(vessel)
    integration = record, runge_kutta_stages(method), interval, substeps
    blocks = range(0, len(draws), LANES)

    def run(start: int) -> None:
        lanes = slice(start, start + LANES)
        columns = (np.ascontiguousarray(values[lanes].T) for values in (draws, initial))
        _replay(next(columns), *settings, next(columns), *integration, start, out)

    with thread_pool(len(blocks)) as pool:
        list(pool.map(run, blocks))
    return out


def check_replay(
    vessel: Vessel,
    delta: np.ndarray,
    initial_state: np.ndarray,
    coefficients: np.ndarray,
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


def simulate(
    vessel: Vessel,
    manoeuvre: Manoeuvre,
    *,
    duration: float,
    step: float = 0.02,
    method: str = "euler",
    record_interval: float | None = None,
    coefficients: np.ndarray | None = None,
) -> xr.Dataset:
    """Simulate a manoeuvre from a straight course at the approach speed.

    Parameters
    ----------
    vessel : Vessel
    manoeuvre : Manoeuvre
    duration : float
        [s].
    step : float, optional
        Integration step [s].
    method : {"euler", "rk4"}, optional
        Explicit Euler, as the paper, or classical Runge-Kutta.
    record_interval : float, optional
        Interval of the samples kept [s], a multiple of the step; every step by default.
    coefficients : array_like, shape (n_draws, n_coefficients), optional
        Parameter vectors, DOFs one after the other in the vessel's order; the vessel's reference values by default.

    Returns
    -------
    Dataset, dims (time,) or (draw, time)
        u, v [m/s], r, p [rad/s], phi, psi [rad], x, y [m], delta [rad]; ``diverged`` (bool) and ``diverged_at`` [s, NaN
        where the run held]. A diverged run is NaN from that time on. Units and settings in attrs.

    Raises
    ------
    SimulationError
        For an unknown method, a step or duration that is not positive, an interval that is no multiple of the step,
        coefficients of the wrong shape.

    References
    ----------
    Xue et al. (2020), Eq. 1 to 5, doi:10.1016/j.oceaneng.2019.106612.

    Examples
    --------
    >>> import numpy as np
    >>> import pymc_ship as ps
    >>> turn = ps.simulate(ps.load_vessel("kvlcc2"), ps.turning_circle(35), duration=600, step=0.5, method="rk4")
    >>> dict(turn.sizes)
    {'time': 1200}
    >>> print(f"{turn['u'][-1]:.2f} m/s, {np.rad2deg(turn['r'][-1]):.2f} deg/s")
    2.34 m/s, -0.30 deg/s
    """
    n_steps, stride = _grid(duration, step, record_interval, method)
    reference = reference_coefficients(vessel)
    draws = reference[None] if coefficients is None else np.asarray(coefficients, dtype=float)
    if draws.ndim != 2 or draws.shape[1] != reference.size or not draws.size:
        raise SimulationError(f"Coefficients have shape (draws, {reference.size}), found {draws.shape}; reorder them.")
    time = np.arange(0, n_steps, stride) * step
    out = np.full((len(SIMULATED), len(draws), len(time)), np.nan)
    settings = _settings(vessel, manoeuvre, n_steps, step, method)
    blocks = range(0, len(draws), LANES)

    def run(start: int) -> np.ndarray:
        lanes = np.ascontiguousarray(draws[start : start + LANES].T)
        return _integrate(lanes, *settings, step, stride, start, out)

    with thread_pool(len(blocks)) as pool:
        diverged = np.concatenate(list(pool.map(run, blocks)))
    attrs = _attrs(vessel, manoeuvre, step, method)
    return _dataset(out, time, np.where(diverged >= 0, diverged * step, np.nan), attrs, coefficients is None)


def _grid(duration: float, step: float, record_interval: float | None, method: str) -> tuple[int, int]:
    check_choice("The method", method, METHODS, SimulationError)
    for name, value in (("duration", duration), ("step", step)):
        if not 0.0 < value < np.inf:
            raise SimulationError(f"The {name} must be positive, found {value} s; raise it.")
    if duration < step:
        raise SimulationError(f"The duration must hold at least one step, found {duration} s at {step} s; lengthen it.")
    ratio = 1.0 if record_interval is None else record_interval / step
    stride = round(ratio) if 0.0 < ratio < np.inf else 0
    if stride < 1 or abs(ratio - stride) > 1e-9 * ratio:
        raise SimulationError(
            f"The record interval is a multiple of the step, found {record_interval} s at {step} s; adjust it."
        )
    return round(duration / step), stride


def _settings(vessel: Vessel, manoeuvre: Manoeuvre, n_steps: int, step: float, method: str) -> tuple:
    """Arguments of the kernel that all draws share."""
    initial = np.zeros(_STATE_ROWS)
    initial[0] = manoeuvre.approach_speed or vessel.particulars.nominal_speed
    travel = np.deg2rad(vessel.particulars.rudder_rate_deg) * step if manoeuvre.rate_limited else np.inf
    heading, factor = manoeuvre.switch
    helm = _Helm(heading, factor, travel, round(vessel.particulars.rudder_delay / step))
    command = manoeuvre.command(np.arange(n_steps) * step)
    return scheme(vessel), vessel.hull, work_rows(vessel), initial, helm, command, runge_kutta_stages(method)


def runge_kutta_stages(method: str) -> np.ndarray:
    """Fraction of the step and weight of each stage, shape (n_stages, 2); no stages stand for explicit Euler."""
    return _RK4_STAGES if method == "rk4" else np.empty((0, 2))


def _attrs(vessel: Vessel, manoeuvre: Manoeuvre, step: float, method: str) -> dict:
    return {
        "vessel": vessel.name,
        **manoeuvre.attrs,
        "approach_speed": float(manoeuvre.approach_speed or vessel.particulars.nominal_speed),
        "step": step,
        "method": method,
    }


def _dataset(out: np.ndarray, time: np.ndarray, diverged_at: np.ndarray, attrs: dict, single: bool) -> xr.Dataset:
    variables = {
        name: (("draw", "time"), out[row], {"units": CHANNELS[name].unit.name}) for row, name in enumerate(SIMULATED)
    }
    variables["diverged"] = ("draw", np.isfinite(diverged_at))
    variables["diverged_at"] = ("draw", diverged_at, {"units": "s"})
    coords = {"time": ("time", time, {"units": "s"})}
    if single:
        return xr.Dataset(variables, coords, attrs).isel(draw=0)
    return xr.Dataset(variables, coords | {"draw": np.arange(out.shape[1])}, attrs)
