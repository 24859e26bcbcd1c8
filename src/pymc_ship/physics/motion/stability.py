"""Stability of a straight course: how a small disturbance of sway, yaw and roll grows at zero rudder."""

import numpy as np

from pymc_ship.physics.forces.prime_system import rate_scale
from pymc_ship.physics.motion.equations import STATE, scheme, set_parts, state_derivative, workspace
from pymc_ship.physics.motion.inputs import completed_inputs
from pymc_ship.physics.vessel.vessel import Vessel

_DIFFERENCE = 1e-6  # half width of the central differences, prime values


def growth_rates(vessel: Vessel, coefficients: np.ndarray, speed: float) -> np.ndarray:
    """Largest real part of the eigenvalues of the linear motion about a straight course, for each draw, in U/L.

    At zero rudder and ``speed`` [m/s]; positive for an unstable course, infinite for an infinite acceleration. Without
    roll a ship is stable where Yv' (Nr' - m' x_G') - Nv' (Yr' - m') > 0 (Abkowitz 1964, report Hy-5).
    """
    rolls = "roll" in vessel.dofs
    disturbed = [STATE.index(name) for name in (("v", "r", "p", "phi") if rolls else ("v", "r"))]
    rate = rate_scale(speed, vessel.particulars.L)
    unit = np.array([rate if name in ("r", "p") else 1.0 if name == "phi" else speed for name in STATE])
    jacobian = np.empty((len(coefficients), len(disturbed), len(disturbed)))
    for column, row in enumerate(disturbed):
        ahead, back = (_rates(vessel, coefficients, speed, row, sign * _DIFFERENCE * unit[row]) for sign in (1.0, -1.0))
        change = (ahead - back)[disturbed] / (2.0 * _DIFFERENCE)
        jacobian[:, :, column] = (change / (unit[disturbed, None] * rate)).T
    growth = np.full(len(coefficients), np.inf)
    finite = np.isfinite(jacobian).all(axis=(1, 2))
    growth[finite] = np.linalg.eigvals(jacobian[finite]).real.max(axis=1)
    return growth


def _rates(vessel: Vessel, coefficients: np.ndarray, speed: float, row: int, change: float) -> np.ndarray:
    """Rates of the states (n_states, n_draws) on a straight course with one state changed."""
    n_draws, constants = len(coefficients), scheme(vessel)
    state, rate = np.zeros((len(STATE), n_draws)), np.empty((len(STATE), n_draws))
    state[STATE.index("u")] = speed
    state[row] = change
    columns, work = np.ascontiguousarray(coefficients.T), workspace(n_draws, constants)
    set_parts(columns, constants, work)
    state_derivative(state, completed_inputs(np.zeros(n_draws)), columns, constants, work, rate)
    return rate
