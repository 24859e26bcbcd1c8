"""Steps of the integrators, one lane per draw, and the range of the model."""

from typing import Any, NamedTuple

import numpy as np
from numba import njit

from pymc_ship.machine.arguments import number_or_nan
from pymc_ship.physics.forces.part import INPUTS
from pymc_ship.physics.manoeuvre.standard import Manoeuvre
from pymc_ship.physics.motion.equations import (
    INLINED,
    KERNEL,
    LINKED,
    PART,
    STATE,
    Scheme,
    Work,
    state_derivative,
    workspace,
)
from pymc_ship.physics.vessel.vessel import Vessel

METHODS = ("euler", "rk4")  # integrators: explicit Euler (as the paper) and the classical fourth-order Runge-Kutta
STATE_ROWS, N_INPUTS = len(STATE), len(INPUTS)

STEPS = 60  # integration steps and samples per L/U of simulation_settings
LANES = 16  # draws integrated by one kernel call
_RK4 = np.column_stack([[0.0, 0.5, 0.5, 1.0], np.array([1.0, 2.0, 2.0, 1.0]) / 6.0])
_STAGES = {"euler": np.array([[0.0, 1.0]]), "rk4": _RK4}


class Integration(NamedTuple):
    """How a motion is integrated."""

    stages: np.ndarray  # (n_stages, 2); fraction of the step and weight of each stage of the method
    step: float  # [s]
    substeps: int  # from one sample to the next


class Record(NamedTuple):
    """Inputs (4, n_time) of a record, how it is integrated, and ``block``, the samples averaged into one."""

    inputs: np.ndarray
    integration: Integration
    block: int


class Inputs(NamedTuple):
    """Inputs (4, n_lanes) at begin and end of a step, between which they are linear."""

    before: np.ndarray
    after: np.ndarray
    bend: np.ndarray  # (n_lanes,); how far the rudder angle amid the step lies beside that line [rad]


class Lanes(NamedTuple):
    """States and workspace of the draws in one kernel call."""

    state: np.ndarray  # (8, n_lanes)
    inner: np.ndarray  # (n_stages, 8, n_lanes); states of the stages
    inputs: np.ndarray  # (n_stages, 4, n_lanes)
    rate: np.ndarray  # (8, n_lanes); by the equations of motion at a stage
    work: Work


def integration(method: str, step: float, substeps: int) -> Integration:
    """Integration by a method of :data:`METHODS`."""
    return Integration(_STAGES[method], float(step), int(substeps))


@njit(**KERNEL, forceinline=True)
def lanes_at_rest(n_lanes: int, n_stages: int, scheme: Scheme) -> Lanes:
    """Lanes with all states at zero and the workspace that a scheme needs."""
    return Lanes(
        np.zeros((STATE_ROWS, n_lanes)),
        np.empty((n_stages, STATE_ROWS, n_lanes)),
        np.empty((n_stages, N_INPUTS, n_lanes)),
        np.empty((STATE_ROWS, n_lanes)),
        workspace(n_lanes, scheme),
    )


@njit(**INLINED)
def advance(lanes: Lanes, coefficients: np.ndarray, scheme: Scheme, integration: Integration) -> None:
    """One step of the states, in place, with the inputs of its stages; ``inner`` keeps the states evaluated."""
    state, inner, rate = lanes.state, lanes.inner, lanes.rate
    stages, step = integration.stages, integration.step
    copy(inner[0], state)
    for stage in range(stages.shape[0]):
        if stage > 0:
            add(inner[stage], inner[0], stages[stage, 0] * step, rate)
        state_derivative(inner[stage], lanes.inputs[stage], coefficients, scheme, lanes.work, rate)
        increase(state, stages[stage, 1] * step, rate)


@njit(**PART)
def in_range(state: np.ndarray, hull: np.record, lane: int) -> bool:
    """Whether a lane is in the range: finite, heel below 90 deg, speed below 5 U_nom, surge above ``hull.slowest``."""
    nominal_speed = hull.nominal_speed
    speed2 = state[0, lane] ** 2 + state[1, lane] ** 2
    turning = abs(state[2, lane]) + abs(state[3, lane]) + abs(state[5, lane])
    ahead = (state[0, lane] > hull.slowest * nominal_speed) & (speed2 < 25.0 * nominal_speed**2)
    return ahead & (turning < np.inf) & (abs(state[4, lane]) < 0.5 * np.pi)


@njit(**PART)
def copy(target: np.ndarray, source: np.ndarray) -> None:
    """Write as much of the source as the target holds."""
    for row in range(target.shape[0]):
        for k in range(target.shape[1]):
            target[row, k] = source[row, k]


@njit(**PART)
def add(target: np.ndarray, base: np.ndarray, factor: float, rate: np.ndarray) -> None:
    """Write base + factor * rate into the target."""
    for row in range(target.shape[0]):
        for k in range(target.shape[1]):
            target[row, k] = base[row, k] + factor * rate[row, k]


@njit(**PART)
def increase(target: np.ndarray, factor: float, rate: np.ndarray) -> None:
    """Add factor * rate to the target; a base that is the target itself would not vectorise."""
    for row in range(target.shape[0]):
        for k in range(target.shape[1]):
            target[row, k] += factor * rate[row, k]


@njit(**PART)
def mark_divergence(state: np.ndarray, hull: np.record, step: int, diverged: np.ndarray) -> int:
    """Record the step at which a lane diverges and reset its state; return the number of lanes still running."""
    n_lanes, n_in_range = state.shape[1], 0
    for lane in range(n_lanes):
        n_in_range += in_range(state, hull, lane)
    if n_in_range < n_lanes:
        for lane in range(n_lanes):
            if not in_range(state, hull, lane):
                if diverged[lane] < 0:
                    diverged[lane] = step
                for row in range(state.shape[0]):
                    state[row, lane] = hull.nominal_speed if row == 0 else 0.0
    running = 0
    for lane in range(n_lanes):
        running += diverged[lane] < 0
    return running


@njit(**LINKED)
def advance_along(lanes: Lanes, inputs: Inputs, theta: np.ndarray, scheme: Scheme, steps: Integration) -> None:
    """One step while the inputs move from one value to another."""
    for stage in range(steps.stages.shape[0]):
        fraction = steps.stages[stage, 0]
        for row in range(inputs.before.shape[0]):
            for lane in range(inputs.before.shape[1]):
                change = inputs.after[row, lane] - inputs.before[row, lane]
                lanes.inputs[stage, row, lane] = inputs.before[row, lane] + fraction * change
        for lane in range(inputs.bend.size):
            lanes.inputs[stage, 0, lane] += 4.0 * fraction * (1.0 - fraction) * inputs.bend[lane]
    advance(lanes, theta, scheme, steps)


def simulation_settings(vessel: Vessel, **given: Any) -> dict[str, Any]:
    """Step, sampling interval and method for a vessel, from its L/U where they are not given, and all else given."""
    default = vessel.particulars.ship_time / STEPS
    step = given.get("step", default)
    stride = max(int(default / step), 1) if 0.0 < number_or_nan(step) < np.inf else None
    return {"step": step, "record_interval": stride and stride * step, "method": "rk4"} | given


def rudder_rate(vessel: Vessel, manoeuvre: Manoeuvre) -> float:
    """Rudder rate [rad/s], infinite for a manoeuvre without rate limit."""
    return float(np.deg2rad(vessel.particulars.rudder_rate_deg)) if manoeuvre.rate_limited else np.inf
