"""The manoeuvres that every ship must be able to run: whether a model runs away in them, and which tells most next."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import xarray as xr

from pymc_ship.forecasting.draws import thinned_draws
from pymc_ship.forecasting.forecast import pooled_forecast
from pymc_ship.forecasting.index_error import index_scale
from pymc_ship.manoeuvre.standard import Manoeuvre, turning_circle, zigzag
from pymc_ship.motion.simulation import simulate
from pymc_ship.motion.stepping import simulation_settings
from pymc_ship.vessel.term_sets import holds_any_speed
from pymc_ship.vessel.vessel import Vessel

FASTEST = 1.15
"""A ship that exceeds so many times her approach speed in a zigzag or turn has run away."""

TIGHTEST = 0.5
"""Radius of a turn [L] below which the forces of a ship ahead mean nothing, so that she has run away."""

_REACH = 60.0  # L/U, of the manoeuvres
_STEP = 1.0 / 60.0  # L/U
_DRAWS = 200  # of a forecast, at most
_COMPARED = ("angle", "distance")  # in swings and lengths


STANDARD = tuple(
    make(*angles, side=side)
    for make, angles in ((zigzag, (10, 10)), (zigzag, (20, 20)), (turning_circle, (35,)))
    for side in ("port", "starboard")
)
"""Manoeuvres that every ship must be able to run."""


def sound(
    vessel: Vessel,
    coefficients: np.ndarray,
    manoeuvres: Sequence[Manoeuvre] = STANDARD,
    reach: float = _REACH,
    **around: object,
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
    vessel: Vessel, coefficients: np.ndarray, manoeuvre: Manoeuvre, reach: float, **around: object
) -> xr.Dataset:
    unit = vessel.particulars.ship_time
    settings = {"duration": reach * unit, "step": _STEP * unit, "method": "rk4", "coefficients": coefficients}
    return simulate(vessel, manoeuvre, **settings, **around)


def _faults(vessel: Vessel, manoeuvre: Manoeuvre, ships: xr.Dataset) -> tuple[np.ndarray, np.ndarray]:
    """Whether each ship is too fast and turns too tightly at each time, (n_draws, n_time)."""
    L, U = vessel.particulars.L, vessel.particulars.nominal_speed
    speed = np.hypot(ships["u"].values, ships["v"].values)
    with np.errstate(invalid="ignore"):
        tight = (np.abs(ships["r"].values) * L * TIGHTEST > speed) & (not holds_any_speed(vessel))
        fast = speed > FASTEST * max(manoeuvre.approach_speed or U, U)
    return fast, tight


def outlook(
    models: Sequence[tuple[Vessel, np.ndarray]],
    motion: xr.DataArray,
    errors: Mapping[str, float],
    rng: np.random.Generator,
) -> tuple[str, ...]:
    """Sentences on the turning circle of a ship, and on the standard manoeuvre of which least is known.

    Parameters
    ----------
    models : sequence of (Vessel, ndarray of shape (n_draws, n_coefficients))
    motion, errors
        Prime motion of her runs and model error of the indices, as :func:`pymc_ship.forecasting.forecast
        .pooled_forecast` takes them.
    rng : Generator

    Returns
    -------
    tuple of str
        Empty where no draw reaches an index.
    """
    vessel = models[0][0]
    drawn = thinned_draws(models, _DRAWS)
    settings = simulation_settings(vessel) | {"ci_prob": 0.95, "rng": rng, "motion": motion, "errors": errors}
    found = []
    for manoeuvre in STANDARD:
        duration = manoeuvre.traits.reach * vessel.particulars.ship_time
        bands = pooled_forecast(drawn, manoeuvre, duration=duration, **settings)["index_bands"]
        for name in manoeuvre.traits.scored:
            quantity = manoeuvre.traits.indices[name].quantity
            if quantity not in _COMPARED:
                continue
            lower, median, upper = bands[name].values.tolist()
            width = 0.5 * (upper - lower) / index_scale(quantity, median, manoeuvre.heading_deg, vessel)
            found.append(_Known(manoeuvre, name, (median, lower, upper), width))
    circles = [one for one in found if one.index == "tactical_diameter" and np.isfinite(one.values).all()]
    widest = max((one for one in found if np.isfinite(one.width)), key=lambda one: one.width, default=None)
    turns = ["{:.2f} L ({:.2f} to {:.2f}) to {}".format(*one.in_lengths(vessel), one.manoeuvre.side) for one in circles]
    said = [f"Tactical diameter of the turning circle of 35 deg: {', '.join(turns)}."] if turns else []
    if widest is not None:
        said.append(
            f"Of the standard manoeuvres least is known of the {widest.manoeuvre.label}, whose "
            f"{widest.index.replace('_', ' ')} has the widest interval, ± {100.0 * widest.width:.2g} % of the ship's "
            f"{'length' if widest.manoeuvre.traits.circles else 'swing'}: as the next run it would tell most."
        )
    return tuple(said)


class _Known(NamedTuple):
    """An index of a standard manoeuvre: median and ends of its interval, half its width in L or in the swing."""

    manoeuvre: Manoeuvre
    index: str
    values: tuple[float, float, float]
    width: float

    def in_lengths(self, vessel: Vessel) -> list[float]:
        """Median and ends of a distance [L]."""
        return [value / vessel.particulars.L for value in self.values]


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
    """The first standard manoeuvre in which one ship runs away; None where she is sound.

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
        fault = min(at, key=at.get)
        if np.isfinite(at[fault]):
            return Failure(manoeuvre, at[fault], fault, ship.sel(time=slice(None, at[fault])))
    return None


def _first(ship: xr.Dataset, wrong: np.ndarray) -> float:
    """Time of the first sample that is wrong [s]; infinite where none is."""
    return float(ship["time"].values[np.argmax(wrong)]) if wrong.any() else np.inf
