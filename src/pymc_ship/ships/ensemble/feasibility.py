"""Whether a model is feasible: its simulation does not diverge in the manoeuvres that every ship can sail."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import xarray as xr

from pymc_ship.physics.manoeuvre.standard import STANDARD, Manoeuvre
from pymc_ship.physics.motion.simulation import simulate
from pymc_ship.physics.vessel.term_sets import valid_at_any_speed
from pymc_ship.physics.vessel.vessel import Vessel

FASTEST = 1.15
"""A ship that exceeds so many times her approach speed in a zigzag or turn has run away."""

TIGHTEST = 0.5
"""Radius of a turn [L] below which the forces of a ship ahead mean nothing, so that she has run away."""

_REACH = 60.0  # L/U, of the manoeuvres
_STEP = 1.0 / 60.0  # L/U


def is_feasible(
    vessel: Vessel,
    coefficients: np.ndarray,
    manoeuvres: Sequence[Manoeuvre] = STANDARD,
    reach: float = _REACH,
    **around: Any,
) -> np.ndarray:
    """Whether ships stay what a ship can be in manoeuvres.

    They stay in the model's range, never exceed :data:`FASTEST` times the approach speed (or the nominal one, which a
    slow ship gathers) and never turn on a radius below half their length. Forces that hold at any speed may turn a ship
    on the spot: the last rule is not for them.

    Parameters
    ----------
    vessel : Vessel
    coefficients : ndarray, shape (n_draws, n_coefficients)
    manoeuvres : sequence of Manoeuvre, optional
    reach : float, optional
        How long they last [L/U_nom].
    **around
        ``n``, ``wind`` and ``current`` of :func:`pymc_ship.simulate`.

    Returns
    -------
    ndarray of bool, shape (n_draws,)
    """
    good = np.ones(len(coefficients), dtype=bool)
    for manoeuvre in manoeuvres:
        ships = _simulated(vessel, coefficients, manoeuvre, reach, **around)
        fast, tight = _faults(vessel, manoeuvre, ships)
        good &= ~(ships["diverged"].values | (fast | tight).any(axis=1))
    return good


def _simulated(
    vessel: Vessel, coefficients: np.ndarray, manoeuvre: Manoeuvre, reach: float, **around: Any
) -> xr.Dataset:
    unit = vessel.particulars.ship_time
    duration, step = reach * unit, _STEP * unit
    return simulate(vessel, manoeuvre, duration=duration, step=step, method="rk4", coefficients=coefficients, **around)


def _faults(vessel: Vessel, manoeuvre: Manoeuvre, ships: xr.Dataset) -> tuple[np.ndarray, np.ndarray]:
    """Whether each ship is too fast and turns too tightly at each time, (n_draws, n_time)."""
    L, U = vessel.particulars.L, vessel.particulars.nominal_speed
    speed = np.hypot(ships["u"].values, ships["v"].values)
    with np.errstate(invalid="ignore"):
        tight = (np.abs(ships["r"].values) * L * TIGHTEST > speed) & (not valid_at_any_speed(vessel))
        fast = speed > FASTEST * max(manoeuvre.approach_speed or U, U)
    return fast, tight


@dataclass(frozen=True)
class Failure:
    """Where a ship runs away: the manoeuvre, the time [s], the fault in words, and the motion until then."""

    manoeuvre: Manoeuvre
    time: float
    fault: str
    motion: xr.Dataset

    def __str__(self) -> str:
        """End of a sentence."""
        return f"in the {self.manoeuvre.label} she {self.fault} after {self.time:.3g} s"


def first_failure(vessel: Vessel, coefficients: np.ndarray) -> Failure | None:
    """The first standard manoeuvre in which one ship runs away; None where it is feasible in all.

    Parameters
    ----------
    vessel : Vessel
    coefficients : ndarray, shape (n_coefficients,)

    Returns
    -------
    Failure or None
    """
    for manoeuvre in STANDARD:
        ship = _simulated(vessel, coefficients[None], manoeuvre, _REACH)
        (fast,), (tight,) = _faults(vessel, manoeuvre, ship)
        ship = ship.isel(draw=0)
        at = {
            "leaves the model's range": float(ship["diverged_at"]) if ship["diverged"] else np.inf,
            f"exceeds {FASTEST:g} times her approach speed": _first(ship, fast),
            f"turns on a radius below {TIGHTEST:g} L": _first(ship, tight),
        }
        fault = min(at, key=lambda name: at[name])
        if np.isfinite(at[fault]):
            return Failure(manoeuvre, at[fault], fault, ship.sel(time=slice(None, at[fault])))
    return None


def _first(ship: xr.Dataset, wrong: np.ndarray) -> float:
    """Time of the first sample that is wrong [s]; infinite where none is."""
    return float(ship["time"].values[np.argmax(wrong)]) if wrong.any() else np.inf
