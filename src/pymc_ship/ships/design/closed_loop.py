"""Sensitivities of a whole manoeuvre: a zigzag's rudder is reversed when the ship turns, so it, too, depends on her.

Along a fixed rudder record the derivatives are those of :mod:`pymc_ship.physics.motion.sensitivities`. A zigzag
reverses its rudder at the times t_k at which the heading reaches a limit; other coefficients shift them by dt_k =
-dpsi(t_k) / psi_dot(t_k) and with them the travel of the rudder that follows.
"""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import xarray as xr

from pymc_ship.physics.manoeuvre.kinds import SIDES
from pymc_ship.physics.manoeuvre.standard import Manoeuvre
from pymc_ship.physics.motion.replay import replay
from pymc_ship.physics.motion.sensitivities import sensitivities
from pymc_ship.physics.motion.simulation import simulate
from pymc_ship.physics.vessel.vessel import Vessel
from pymc_ship.ships.design.candidates import NextRun

STEP = 0.1
"""Step of the simulation [s], Runge-Kutta."""

_SHIFT = 0.05  # s, of a rudder's travel, for central differences


def straight_course(vessel: Vessel, manoeuvre: NextRun, n_states: int) -> np.ndarray:
    """State at the begin of a manoeuvre, shape (n_states,): the approach speed, zero otherwise."""
    return np.append(manoeuvre.approach_speed or vessel.particulars.nominal_speed, np.zeros(n_states - 1))


def closed_loop_sensitivities(
    vessel: Vessel, manoeuvre: Manoeuvre, coefficients: np.ndarray, *, duration: float
) -> tuple[xr.Dataset, np.ndarray]:
    """Motion of a manoeuvre and its derivatives by the coefficients, those of the rudder's reversals included.

    Parameters
    ----------
    vessel : Vessel
    manoeuvre : Manoeuvre
    coefficients : array_like, shape (n_coefficients,)
        DOFs one after the other in the vessel's order.
    duration : float
        [s].

    Returns
    -------
    motion : Dataset, dims (time,)
        From :func:`pymc_ship.simulate`, every :data:`STEP`.
    jacobian : ndarray, shape (6, n_time, n_coefficients)
        Derivatives of u, v [m/s], r, p [rad/s], phi, psi [rad] by the prime values; NaN when the ship left the
        model's range, as ``diverged`` tells.

    Raises
    ------
    SimulationError
        For coefficients of another shape or a duration that is not positive.
    """
    theta = np.asarray(coefficients, dtype=float)
    ship = simulate(vessel, manoeuvre, duration=duration, step=STEP, method="rk4", coefficients=theta[None])
    ship = ship.isel(draw=0)
    if ship["diverged"]:
        return ship, np.full((6, ship.sizes["time"], theta.size), np.nan)
    delta, initial = ship["delta"].values, straight_course(vessel, manoeuvre, 6)
    settings = {"interval": STEP, "method": "rk4"}
    jacobian = sensitivities(vessel, delta, initial, theta, **settings)[1][:, :, : theta.size]
    psi_dot = ship["r"].values * np.cos(ship["phi"].values)
    wait = int(vessel.particulars.rudder_delay / STEP) - 1  # to the sample before the rudder moves
    for begin, end in pairwise([*_reversals(ship["psi"].values, manoeuvre), delta.size]):
        travel = np.zeros(delta.size)
        travel[begin + wait : end + wait] = np.gradient(delta, STEP)[begin + wait : end + wait]
        late, early = (replay(vessel, delta - s * travel, initial, theta, **settings) for s in (_SHIFT, -_SHIFT))
        shift = -jacobian[5, begin] / psi_dot[begin]
        jacobian += (late - early).transpose(0, 2, 1) / (2.0 * _SHIFT) * shift
    return ship, jacobian


def _reversals(psi: np.ndarray, manoeuvre: Manoeuvre) -> list[int]:
    """Samples at which the rudder is moved because of the heading."""
    found: list[int] = []
    heading, factor = manoeuvre.switch
    direction, begin = SIDES[manoeuvre.side], 0
    while (reached := direction * psi[begin:] >= heading).any():
        begin += int(np.argmax(reached))
        found.append(begin)
        direction *= factor
    return found
