"""Whether a model of a ship runs away in the manoeuvres that every ship must be able to run."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from pymc_ship.manoeuvre.standard import Manoeuvre, turning_circle, zigzag
from pymc_ship.motion.simulation import simulate
from pymc_ship.vessel.vessel import Vessel

FASTEST = 1.15
"""A ship that exceeds so many times her approach speed in a zigzag or turn has run away."""

_TIGHTEST = 0.5  # L, radius of a turn
_REACH = 60.0  # L/U, of the manoeuvres
_STEP = 1.0 / 60.0  # L/U


STANDARD = tuple(
    make(*angles, side=side)
    for make, angles in ((zigzag, (10, 10)), (zigzag, (20, 20)), (turning_circle, (35,)))
    for side in ("port", "starboard")
)
"""Manoeuvres that every ship must be able to run."""


def sound(
    vessel: Vessel, coefficients: np.ndarray, manoeuvres: Sequence[Manoeuvre] = STANDARD, reach: float = _REACH
) -> np.ndarray:
    """Whether ships stay what a ship can be in manoeuvres.

    They stay in the model's range, never exceed :data:`FASTEST` times the approach speed (or the nominal one, which a
    slow ship gathers) and never turn on a radius below half their length.

    Parameters
    ----------
    vessel : Vessel
    coefficients : ndarray, shape (n_draws, n_coefficients)
    manoeuvres : sequence of Manoeuvre, optional
    reach : float, optional
        How long they last [L/U_nom].

    Returns
    -------
    ndarray of bool, shape (n_draws,)
    """
    L, U, unit = vessel.particulars.L, vessel.particulars.nominal_speed, vessel.particulars.ship_time
    settings = {"duration": reach * unit, "step": _STEP * unit, "method": "rk4", "coefficients": coefficients}
    good = np.ones(len(coefficients), dtype=bool)
    for manoeuvre in manoeuvres:
        ships = simulate(vessel, manoeuvre, **settings)
        speed = np.hypot(ships["u"].values, ships["v"].values)
        with np.errstate(invalid="ignore"):
            tight = np.abs(ships["r"].values) * L * _TIGHTEST > speed
            fast = speed > FASTEST * max(manoeuvre.approach_speed or U, U)
        good &= ~(ships["diverged"].values | (fast | tight).any(axis=1))
    return good
