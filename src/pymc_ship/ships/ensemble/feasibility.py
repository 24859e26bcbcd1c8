"""Feasibility of a model: its simulation does not diverge in the standard manoeuvres."""

from dataclasses import dataclass

import numpy as np
import xarray as xr

from pymc_ship.physics.manoeuvre.standard import STANDARD, Manoeuvre
from pymc_ship.physics.motion.simulation import simulate
from pymc_ship.physics.vessel.term_sets import valid_at_any_speed
from pymc_ship.physics.vessel.vessel import Vessel

FASTEST = 1.15  # largest feasible speed in a zigzag or turn, over the approach speed
TIGHTEST = 0.5  # least feasible radius of a turn [L]
_REACH = 60.0  # L/U, of the manoeuvres
_STEP = 1.0 / 30.0  # L/U


def is_feasible(vessel: Vessel, coefficients: np.ndarray) -> np.ndarray:
    """Whether draws are feasible: no divergence, speed within :data:`FASTEST`, radius of turn within :data:`TIGHTEST`.

    In the standard manoeuvres, of ``coefficients`` (n_draws, n_coefficients); no radius for a model valid at any speed.
    """
    feasible = np.ones(len(coefficients), dtype=bool)
    for manoeuvre in STANDARD:
        feasible &= feasible_runs(vessel, manoeuvre, _simulate(vessel, coefficients, manoeuvre))
    return feasible


def feasible_runs(vessel: Vessel, manoeuvre: Manoeuvre, ships: xr.Dataset) -> np.ndarray:
    """Whether simulated draws, dims (draw, time), are feasible, as in :func:`is_feasible`."""
    fast, tight = _exceedances(vessel, manoeuvre, ships)
    return ~(ships["diverged"].values | (fast | tight).any(axis=1))


def _simulate(vessel: Vessel, coefficients: np.ndarray, manoeuvre: Manoeuvre) -> xr.Dataset:
    unit = vessel.particulars.ship_time
    duration, step = _REACH * unit, _STEP * unit
    return simulate(vessel, manoeuvre, duration=duration, step=step, method="rk4", coefficients=coefficients)


def _exceedances(vessel: Vessel, manoeuvre: Manoeuvre, ships: xr.Dataset) -> tuple[np.ndarray, np.ndarray]:
    """Whether speed and turning radius of each draw are outside the limits at each time, (n_draws, n_time)."""
    L, U = vessel.particulars.L, vessel.particulars.nominal_speed
    speed = np.hypot(ships["u"].values, ships["v"].values)
    with np.errstate(invalid="ignore"):
        tight = (np.abs(ships["r"].values) * L * TIGHTEST > speed) & (not valid_at_any_speed(vessel))
        fast = speed > FASTEST * max(manoeuvre.approach_speed or U, U)
    return fast, tight


@dataclass(frozen=True)
class Failure:
    """Manoeuvre, time [s], cause and motion of a simulation until it is no longer feasible."""

    manoeuvre: Manoeuvre
    time: float
    fault: str
    motion: xr.Dataset

    def __str__(self) -> str:
        return f"in the {self.manoeuvre.label} the ship {self.fault} after {self.time:.3g} s"


def first_failure(vessel: Vessel, coefficients: np.ndarray) -> Failure | None:
    """First standard manoeuvre in which one ship (n_coefficients,) is not feasible, or None."""
    for manoeuvre in STANDARD:
        ship = _simulate(vessel, coefficients[None], manoeuvre)
        (fast,), (tight,) = _exceedances(vessel, manoeuvre, ship)
        ship = ship.isel(draw=0)
        times = {
            "leaves the model's range": float(ship["diverged_at"]) if ship["diverged"] else np.inf,
            f"exceeds {FASTEST:g} times the approach speed": _first(ship, fast),
            f"turns on a radius below {TIGHTEST:g} L": _first(ship, tight),
        }
        fault = min(times, key=lambda name: times[name])
        if np.isfinite(times[fault]):
            return Failure(manoeuvre, times[fault], fault, ship.sel(time=slice(None, times[fault])))
    return None


def _first(ship: xr.Dataset, outside: np.ndarray) -> float:
    return float(ship["time"].values[np.argmax(outside)]) if outside.any() else np.inf
