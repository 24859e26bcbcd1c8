"""Integration of the equations of motion: one ship, or one for each of many parameter vectors, in parallel."""

import math
from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
import xarray as xr
from numba import njit

from pymc_ship.machine.arguments import check_choice, number_or_nan, real_array, short_repr
from pymc_ship.machine.errors import SimulationError
from pymc_ship.machine.threads import map_in_threads
from pymc_ship.physics.forces.surroundings import Flow, flow_components
from pymc_ship.physics.manoeuvre.standard import Manoeuvre, one_manoeuvre
from pymc_ship.physics.motion.controlled import Start, course
from pymc_ship.physics.motion.equations import KERNEL, PART, Scheme, scheme, set_parts
from pymc_ship.physics.motion.inputs import steady_inputs
from pymc_ship.physics.motion.stepping import (
    LANES,
    METHODS,
    N_INPUTS,
    STATE_ROWS,
    Inputs,
    Integration,
    advance_along,
    integration,
    lanes_at_rest,
    mark_divergence,
    rudder_rate,
)
from pymc_ship.physics.vessel.reading import VesselLike, as_vessel
from pymc_ship.physics.vessel.vessel import Vessel, reference_coefficients
from pymc_ship.trial.channels import CHANNELS, SIMULATED

INTEGRATORS = (*METHODS, "dop853")  # methods of simulate: two with a fixed step, one with controlled error
_MOST_STEPS = 10**8  # of a simulation


class Steering(NamedTuple):
    """Steering of a simulation; a change of heading by ``heading`` multiplies the command by ``factor``."""

    command: np.ndarray  # (n_steps,) [rad]
    travel: float  # largest movement in a step [rad]
    course: float  # from which the heading counts [rad]
    heading: float  # [rad]
    factor: float
    delay: float  # steps from the change of heading to the new command
    within: float  # 1 if that may be within a step, else it is at the begin of the next
    step: float  # duration of a step [s]


class Rudder(NamedTuple):
    """State of the rudders, (n_lanes,)."""

    delta: np.ndarray  # angles at the begin of a step [rad]
    following: np.ndarray  # angles at its end [rad]
    bend: np.ndarray  # angle amid a step beside the chord [rad]: Simpson's rule has its impulse (equations.md, rk4)
    factor: np.ndarray  # on the command
    waiting: np.ndarray  # steps until the next switch
    psi: np.ndarray  # heading one step earlier [rad]


@njit(**PART)
def _follow(delta: float, command: float, fraction: float, travel: float) -> tuple[float, float]:
    """Rudder angle after a fraction of a step, and its integral over the fraction [rad steps].

    A fraction below 0 is one of the last step, in which the rudder stood still, and goes off the integral.
    """
    most = fraction * travel if fraction > 0.0 else 0.0
    moved = min(max(command - delta, -most), most)
    return delta + moved, fraction * (delta + moved) - 0.5 * moved * abs(moved) / travel


@njit(**PART)
def _steps_since(beyond: float, turned: float, slope: float) -> float:
    """Fraction of a step since a heading was passed, by the parabola of the heading change in the step and its end."""
    if beyond <= 0.0:
        return 0.0
    passed = beyond / max(turned, beyond)
    return beyond / max(turned + (slope - turned) * (1.0 - passed), beyond)


@njit(**PART)
def _steer(steering: Steering, state: np.ndarray, command: float, rudder: Rudder) -> None:
    """Rudder angle after one step: switch the command after the switching heading, follow it at the rudder rate."""
    psi, factor, waiting, travel = state[5], rudder.factor, rudder.waiting, steering.travel
    for lane in range(psi.size):
        side = -np.sign(factor[lane] * command)
        beyond = side * (psi[lane] - steering.course) - steering.heading
        if waiting[lane] == np.inf and beyond >= 0.0:
            turned = side * (psi[lane] - rudder.psi[lane])
            slope = side * steering.step * state[2, lane] * math.cos(state[4, lane])
            waiting[lane] = steering.delay - steering.within * _steps_since(beyond, turned, slope)
        rudder.psi[lane] = psi[lane]
        delta, fraction, mean = rudder.delta[lane], 1.0, 0.0
        if waiting[lane] < 1.0:
            delta, mean = _follow(delta, factor[lane] * command, waiting[lane], travel)
            fraction -= waiting[lane]
            factor[lane] *= steering.factor
            waiting[lane] = np.inf
        else:
            waiting[lane] -= 1.0
        delta, after = _follow(delta, factor[lane] * command, fraction, travel)
        rudder.following[lane] = delta
        if travel < np.inf:
            rudder.bend[lane] = 1.5 * (mean + after) - 0.75 * (rudder.delta[lane] + delta)


@njit(**KERNEL)
def _integrate(
    coefficients: np.ndarray,
    scheme: Scheme,
    start: Start,
    steering: Steering,
    steps: Integration,
    out: np.ndarray,
    first: int,
) -> np.ndarray:
    """Integrate the lanes; return the steps at which they diverged, -1 for those that did not.

    The samples before that are written to ``out`` (9, n_draws, n_saved); lane 0 is draw ``first``.
    """
    n_lanes, command = coefficients.shape[1], steering.command
    lanes = lanes_at_rest(n_lanes, steps.stages.shape[0], scheme)
    set_parts(coefficients, scheme, lanes.work)
    for row in range(start.state.size):
        lanes.state[row] = start.state[row]
    inputs = Inputs(np.zeros((N_INPUTS, n_lanes)), np.zeros((N_INPUTS, n_lanes)), np.zeros(n_lanes))
    inputs.before[0] = command[0] if steering.travel == np.inf else 0.0
    for row in range(start.others.size):
        inputs.before[1 + row], inputs.after[1 + row] = start.others[row], start.others[row]
    delta, waiting = inputs.before[0], np.full(n_lanes, np.inf)
    rudder = Rudder(delta, inputs.after[0], inputs.bend, np.ones(n_lanes), waiting, lanes.state[5].copy())
    diverged = np.full(n_lanes, -1)
    for k in range(command.size):
        if mark_divergence(lanes.state, scheme.hull, k, diverged) == 0:
            break
        if k % steps.substeps == 0:
            for lane in range(n_lanes):
                if diverged[lane] < 0:
                    for row in range(STATE_ROWS):
                        out[row, first + lane, k // steps.substeps] = lanes.state[row, lane]
                    out[STATE_ROWS, first + lane, k // steps.substeps] = delta[lane]
        ahead = command[min(k + 1, command.size - 1)] if steering.travel == np.inf else command[k]
        _steer(steering, lanes.state, ahead, rudder)
        advance_along(lanes, inputs, coefficients, scheme, steps)
        for lane in range(n_lanes):
            delta[lane] = rudder.following[lane]
    return diverged


def simulate(
    vessel: VesselLike,
    manoeuvre: Manoeuvre,
    *,
    duration: float,
    step: float = 0.02,
    method: str = "euler",
    record_interval: float | None = None,
    coefficients: np.ndarray | None = None,
    initial_state: Sequence[float] | None = None,
    n: float | None = None,
    wind: tuple[float, float] | None = None,
    current: tuple[float, float] | None = None,
    tolerance: float = 1e-9,
) -> xr.Dataset:
    """Simulate a manoeuvre.

    Parameters
    ----------
    vessel : Vessel, str or Path
    manoeuvre : Manoeuvre
    duration : float
        [s].
    step : float, optional
        Integration step [s]; of dop853 the interval of the samples.
    method : {"euler", "rk4", "dop853"}, optional
        Explicit Euler, as the paper, with rudder orders at the begin of a step; classical Runge-Kutta, with orders also
        within a step; or the eighth-order method of Dormand & Prince with controlled error.
    record_interval : float, optional
        Interval of the samples [s], a multiple of the step; every step by default.
    coefficients : array_like, shape (n_draws, n_coefficients), optional
        DOFs one after the other in the vessel's order; the vessel's reference values by default.
    initial_state : sequence of float, optional
        u, v [m/s], r, p [rad/s], phi, psi [rad], x, y [m] at time 0, in place of a straight course to the north. A
        switching heading counts from psi at time 0.
    n : float, optional
        Revolutions [1/s]; those that hold the approach speed by default. Terms without parts hold the nominal one.
    wind : (float, float), optional
        True wind: speed [m/s] and the direction from which it blows [deg].
    current : (float, float), optional
        Speed [m/s] and the direction to which it sets [deg]. u and v are through the water, x and y over ground.
    tolerance : float, optional
        Relative error of a step of dop853.

    Returns
    -------
    Dataset, dims (time,) or (draw, time)
        u, v [m/s], r, p [rad/s], phi, psi [rad], x, y [m], delta [rad]; ``diverged`` (bool) and ``diverged_at`` [s],
        NaN without divergence. A diverged run is NaN from that time on. Units and settings in attrs.

    Raises
    ------
    SimulationError
        For an unknown method, a step, duration or tolerance that is not positive, an interval that is no multiple of
        the step, wrong shapes, or revolutions or wind on a ship without such parts.

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
    2.49 m/s, -0.31 deg/s
    """
    vessel, manoeuvre = as_vessel(vessel), one_manoeuvre(manoeuvre)
    n_steps, stride = _grid(duration, step, record_interval, method)
    reference = reference_coefficients(vessel)
    draws = reference[None] if coefficients is None else real_array("Coefficients", coefficients, SimulationError)
    if draws.ndim != 2 or draws.shape[1] != reference.size or not draws.size:
        raise SimulationError(f"Coefficients have shape (draws, {reference.size}), found {draws.shape}; reorder them.")
    time = np.arange(0, n_steps, stride) * step
    speed = float(manoeuvre.approach_speed or vessel.particulars.nominal_speed)
    start = Start(_initial_state(initial_state, speed), steady_inputs(vessel, speed, n=n, wind=wind, current=current))
    if method == "dop853":
        out, diverged_at = _simulate_with_error_control(vessel, manoeuvre, draws, time, start, tolerance)
    else:
        steps = integration(method, step, stride)
        out, diverged_at = _simulate_in_steps(vessel, manoeuvre, draws, steps, n_steps, start)
    for row, drift in zip(out[-3:-1], flow_components(current), strict=True):
        if drift:
            row += drift * time
    attrs = {
        "vessel": vessel.name,
        **manoeuvre.attrs,
        "approach_speed": speed,
        "rudder_delay": vessel.particulars.rudder_delay,
        "dofs": " ".join(vessel.dofs),
        "step": step,
        "method": method,
        **({} if initial_state is None else {"base_course": float(start.state[5])}),
        **_surroundings(n, wind, current),
        **({"tolerance": tolerance} if method == "dop853" else {}),
    }
    return _dataset(out, time, diverged_at, attrs, coefficients is None)


def _simulate_in_steps(
    vessel: Vessel, manoeuvre: Manoeuvre, draws: np.ndarray, steps: Integration, n_steps: int, start: Start
) -> tuple[np.ndarray, np.ndarray]:
    """Samples (9, n_draws, n_saved) of ships side by side by steps of one length, and when each diverged [s]."""
    out = np.empty((len(SIMULATED), len(draws), -(-n_steps // steps.substeps)))
    equations, steering = scheme(vessel), _steering(vessel, manoeuvre, n_steps, steps, float(start.state[5]))
    blocks = [slice(start, start + LANES) for start in range(0, len(draws), LANES)]

    def run(lanes: slice) -> np.ndarray:
        coefficients = np.ascontiguousarray(draws[lanes].T)
        return _integrate(coefficients, equations, start, steering, steps, out=out, first=lanes.start)

    diverged = np.concatenate(map_in_threads(run, blocks))
    for draw in np.flatnonzero(diverged >= 0):
        out[:, draw, -(-diverged[draw] // steps.substeps) :] = np.nan
    return out, np.where(diverged >= 0, diverged * steps.step, np.nan)


def _simulate_with_error_control(
    vessel: Vessel, manoeuvre: Manoeuvre, draws: np.ndarray, time: np.ndarray, start: Start, tolerance: float
) -> tuple[np.ndarray, np.ndarray]:
    if not 1e-13 <= number_or_nan(tolerance) < 1.0:
        raise SimulationError(f"The tolerance is a number from 1e-13 to 1, found {short_repr(tolerance)}; correct it.")
    runs = [course(vessel, manoeuvre, draw, time, start, tolerance) for draw in draws]
    return np.stack([samples for samples, _ in runs], axis=1), np.array([diverged_at for _, diverged_at in runs])


def _grid(duration: float, step: float, record_interval: float | None, method: str) -> tuple[int, int]:
    check_choice("The method", method, INTEGRATORS, SimulationError)
    for name, value in (("duration", duration), ("step", step)):
        if not 0.0 < number_or_nan(value) < np.inf:
            raise SimulationError(f"The {name} must be a positive number, found {short_repr(value)} s; correct it.")
    if duration < step:
        raise SimulationError(f"The duration must be at least one step, found {duration} s at {step} s; lengthen it.")
    if duration > _MOST_STEPS * step:
        raise SimulationError(
            f"The duration has at most {_MOST_STEPS:g} steps, found {duration} s at {step} s; shorten it, "
            "or lengthen the step."
        )
    ratio = 1.0 if record_interval is None else number_or_nan(record_interval) / step
    stride = round(ratio) if 0.0 < ratio < np.inf else 0
    if stride < 1 or abs(ratio - stride) > 1e-9 * ratio:
        pair = f"{short_repr(record_interval)} s at {step} s"
        raise SimulationError(f"The record interval is a multiple of the step, found {pair}; adjust it.")
    return round(duration / step), stride


def _steering(vessel: Vessel, manoeuvre: Manoeuvre, n_steps: int, steps: Integration, course: float) -> Steering:
    """Steering of a vessel in a manoeuvre from a course [rad]; Euler switches the rudder between steps only."""
    heading, factor = manoeuvre.switch
    delay, within = vessel.particulars.rudder_delay / steps.step, len(steps.stages) > 1
    command, travel = manoeuvre.command(np.arange(n_steps) * steps.step), rudder_rate(vessel, manoeuvre) * steps.step
    delay = delay if within else float(round(delay))
    return Steering(
        command=command,
        travel=travel,
        course=course,
        heading=float(heading),
        factor=float(factor),
        delay=delay,
        within=float(within),
        step=steps.step,
    )


def _initial_state(given: Sequence[float] | None, speed: float) -> np.ndarray:
    """State at time 0, (8,)."""
    state = [speed, *[0.0] * (STATE_ROWS - 1)] if given is None else given
    initial = real_array("The initial state", state, SimulationError)
    if initial.shape != (STATE_ROWS,) or not np.isfinite(initial).all():
        names = "u, v, r, p, phi, psi, x and y"
        raise SimulationError(f"An initial state has 8 numbers, {names}, found {initial.tolist()}; correct it.")
    return initial


def _surroundings(n: float | None, wind: Flow, current: Flow) -> dict[str, Any]:
    settings = {} if n is None else {"n": float(n)}
    for name, given in (("wind", wind), ("current", current)):
        settings |= {} if given is None else {f"{name}_speed": float(given[0]), f"{name}_direction": float(given[1])}
    return settings


def _dataset(
    out: np.ndarray, time: np.ndarray, diverged_at: np.ndarray, attrs: dict[str, Any], single: bool
) -> xr.Dataset:
    variables: dict[str, tuple[Any, ...]] = {
        name: (("draw", "time"), out[row], {"units": CHANNELS[name].unit.name}) for row, name in enumerate(SIMULATED)
    }
    seconds = {"units": "s"}
    variables |= {"diverged": ("draw", np.isfinite(diverged_at)), "diverged_at": ("draw", diverged_at, seconds)}
    runs = xr.Dataset(variables, {"time": ("time", time, seconds)}, attrs)
    return runs.isel(draw=0) if single else runs.assign_coords(draw=np.arange(out.shape[1]))
