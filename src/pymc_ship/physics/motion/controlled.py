"""Motion of one ship with controlled error: the reference for the integrators with a fixed step.

The integration restarts at each kink of the rudder; a switching heading is located as an event.
"""

from typing import NamedTuple

import numpy as np
import scipy
from numba import njit

from pymc_ship.physics.manoeuvre.standard import Manoeuvre
from pymc_ship.physics.motion.equations import KERNEL, Scheme, scheme, set_parts, state_derivative
from pymc_ship.physics.motion.stepping import STATE_ROWS, Lanes, in_range, lanes_at_rest, rudder_rate
from pymc_ship.physics.vessel.vessel import Vessel


class Start(NamedTuple):
    """State at time 0, (8,), and the constant inputs without the rudder, (3,)."""

    state: np.ndarray
    others: np.ndarray


@njit(**KERNEL)
def _rate(state: np.ndarray, delta: float, coefficients: np.ndarray, scheme: Scheme, lanes: Lanes) -> np.ndarray:
    """Time derivative of the state of one ship, (8,)."""
    for row in range(state.size):
        lanes.inner[0, row, 0] = state[row]
    lanes.inputs[0, 0, 0] = delta
    state_derivative(lanes.inner[0], lanes.inputs[0], coefficients, scheme, lanes.work, lanes.rate)
    return lanes.rate[:, 0].copy()


def course(
    vessel: Vessel, manoeuvre: Manoeuvre, coefficients: np.ndarray, time: np.ndarray, start: Start, tolerance: float
) -> tuple[np.ndarray, float]:
    """Motion and rudder at the samples, (9, n_time), NaN after divergence, and the time of divergence [s] or NaN.

    Eighth-order method of Dormand & Prince; ``tolerance`` is the error of a step, relative to the state or to U, U/L,
    1 rad and L where the state is smaller (Hairer, Norsett & Wanner 1993, II.10, doi:10.1007/978-3-540-78862-1).
    """
    constants, rate = scheme(vessel), rudder_rate(vessel, manoeuvre)
    hull, lanes, column = constants.hull, lanes_at_rest(1, 1, constants), coefficients[:, None].copy()
    set_parts(column, constants, lanes.work)
    U, turn = hull.nominal_speed, hull.nominal_speed / hull.L
    smallest = tolerance * np.array([U, U, turn, turn, 1.0, 1.0, hull.L, hull.L])
    heading, switch_factor = manoeuvre.switch
    end, now, factor, switch_at = float(time[-1]), 0.0, 1.0, np.inf
    state, out = start.state.copy(), np.full((STATE_ROWS + 1, time.size), np.nan)
    lanes.inputs[0, 1:, 0] = start.others
    first_angle = 0.0 if rate < np.inf else float(manoeuvre.command(np.zeros(1))[0])
    rudder = _rudder_course(manoeuvre, rate, factor, (now, first_angle), end)

    def motion(t: float, state: np.ndarray) -> np.ndarray:
        return _rate(state, np.interp(t, *rudder), column, constants, lanes)

    def out_of_range(t: float, state: np.ndarray) -> float:
        return 1.0 if in_range(state[:, None], hull, 0) else -1.0

    def heading_reached(t: float, state: np.ndarray) -> float:
        ordered = factor * manoeuvre.command(np.array([t]))[0]
        return -np.sign(ordered) * (state[5] - start.state[5]) - heading

    out_of_range.terminal = heading_reached.terminal = True  # type: ignore[attr-defined]
    heading_reached.direction = 1.0  # type: ignore[attr-defined]
    while now < end:
        knots = rudder[0]
        stop = float(min(end, switch_at, knots[knots > now].min(initial=end)))
        events = [out_of_range, *([heading_reached] if np.isfinite(heading) and switch_at == np.inf else [])]
        settings = {"rtol": tolerance, "atol": smallest, "dense_output": True, "events": events}
        solution = scipy.integrate.solve_ivp(motion, (now, stop), state, "DOP853", **settings)
        reached, state = float(solution.t[-1]), solution.y[:, -1]
        inside = (time >= now) & (time < reached)
        if inside.any():
            out[:-1, inside], out[-1, inside] = solution.sol(time[inside]), np.interp(time[inside], *rudder)
        if solution.status < 0 or solution.t_events[0].size:
            return out, reached
        if solution.status == 1:
            switch_at = reached + vessel.particulars.rudder_delay
        now = reached
        if now >= switch_at:
            factor, switch_at = factor * switch_factor, np.inf
            rudder = _rudder_course(manoeuvre, rate, factor, (now, float(np.interp(now, *rudder))), end)
    out[:-1, -1], out[-1, -1] = state, np.interp(end, *rudder)
    return out, np.nan


def _rudder_course(
    manoeuvre: Manoeuvre, rate: float, factor: float, start: tuple[float, float], end: float
) -> tuple[np.ndarray, np.ndarray]:
    """Times [s] and rudder angles [rad], linear in between, from a start until the next switching heading."""
    begin, angle = start
    bends = np.array([begin, *(time for time in manoeuvre.time if begin < time < end), end])
    orders = factor * manoeuvre.command(bends)
    if rate == np.inf:
        return bends, orders
    times, angles = [begin], [angle]
    for before, after, order, next_order in zip(bends[:-1], bends[1:], orders[:-1], orders[1:], strict=True):
        slope = (next_order - order) / (after - before)
        side = np.sign(order - angle)
        closing = rate - side * slope
        met = before + abs(order - angle) / closing if closing > 0.0 else np.inf
        if met < after:
            if met > before:
                times.append(met)
                angles.append(order + slope * (met - before))
            angle = angles[-1] + np.clip(slope, -rate, rate) * (after - met)
        else:
            angle += side * rate * (after - before)
        times.append(float(after))
        angles.append(float(angle))
    return np.array(times), np.array(angles)
