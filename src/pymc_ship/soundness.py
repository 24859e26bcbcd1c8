"""Whether a model of a ship runs away in the manoeuvres that every ship must be able to run."""

from __future__ import annotations

import numpy as np

from pymc_ship.manoeuvres import turning_circle, zigzag
from pymc_ship.simulate import simulate
from pymc_ship.vessel import Vessel

FASTEST = 1.15
"""A ship that exceeds so many times her approach speed in a zigzag or turn has run away."""

_TIGHTEST = 0.5  # L, radius of a turn
_REACH = 60.0  # L/U, of the manoeuvres
_STEP = 1.0 / 60.0  # L/U


def sound(vessel: Vessel, coefficients: np.ndarray) -> np.ndarray:
    """Whether ships stay what a ship can be in 10/10 and 20/20 zigzags and 35 deg turns to both sides, (n_draws,).

    They stay in the model's range, never exceed :data:`FASTEST` times the approach speed and never turn on a radius
    below half their length.

    Parameters
    ----------
    vessel : Vessel
    coefficients : ndarray, shape (n_draws, n_coefficients)

    Returns
    -------
    ndarray of bool, shape (n_draws,)
    """
    unit = vessel.particulars.L / vessel.particulars.nominal_speed
    good = np.ones(len(coefficients), dtype=bool)
    manoeuvres = [
        make(*angles, side=side)
        for make, angles in ((zigzag, (10, 10)), (zigzag, (20, 20)), (turning_circle, (35,)))
        for side in ("port", "starboard")
    ]
    for manoeuvre in manoeuvres:
        ships = simulate(
            vessel, manoeuvre, duration=_REACH * unit, step=_STEP * unit, method="rk4", coefficients=coefficients
        )
        speed = np.hypot(ships["u"].values, ships["v"].values)
        with np.errstate(invalid="ignore"):
            tight = np.abs(ships["r"].values) * vessel.particulars.L * _TIGHTEST > speed
            fast = speed > FASTEST * vessel.particulars.nominal_speed
        good &= ~(ships["diverged"].values | (fast | tight).any(axis=1))
    return good
