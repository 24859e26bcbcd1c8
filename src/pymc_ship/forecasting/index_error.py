"""Model error of manoeuvre indices: what coefficients and term sets leave unexplained on runs that were held out.

Two zigzags of the same ship on the same day differ by some tenths of a degree, and no set of terms is the true force.
The error of a held-out index beyond the spread of the draws is measured in units of what the ship did: overshoot angles
in the swing of her heading, times in L/U and distances in L, as an error of short ones is as large as one of long ones.
It is pooled by kind, and a forecast of any manoeuvre is widened by as much. Steady speeds, rates of turn and drift
angles are widened by the error of the motion in the runs that were held out.

No held-out zigzag says how wrong a model is where no run has been. What foreign ships showed there grows with the
distance from the motion of the runs, in the same units: :data:`BEYOND`, of thirty ships that share no code with the
package and are none of those of ``studies/ships.toml`` (docs/explanation/foreign_ships.md).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
import xarray as xr

from pymc_ship.forecasting.motion_error import GROWTH
from pymc_ship.manoeuvre.kinds import ERRING
from pymc_ship.manoeuvre.registry import kind_named
from pymc_ship.vessel.vessel import Vessel

BEYOND = 0.011
"""Standard deviation of an index for each range of the record by which the median ship leaves it [swing, L/U, L, roll].
"""

GROWING = (*ERRING, "roll")
"""Quantities whose error grows by :data:`BEYOND`."""

HELD, MADE = 4601, 4710
"""Statements "at most" and "at least" that were made with 99 % on indices beyond the motion of the runs: how many held
and how many there were, on the seventy ships of ``reports/ships``, none of which :data:`BEYOND` was chosen on."""

_OF_MOTION = {"speed": "u", "rate": "r", "drift": "v"}
_GROWN = dict.fromkeys(GROWING, BEYOND) | {quantity: GROWTH[name] for quantity, name in _OF_MOTION.items()}
_HALVINGS = 60


def robust_sd(values: np.ndarray) -> float:
    """Half the width of the central 68 % of the draws that reach the event.

    A few draws that run away do not change it.
    """
    if not np.isfinite(values).any():
        return np.nan
    low, high = np.nanquantile(values, [0.16, 0.84])
    return float(0.5 * (high - low))


def index_scale(quantity: str, value, heading_deg: float, vessel: Vessel):
    """What an error of an index of a quantity is measured in: a drift angle in 1 rad, an angle of roll in itself."""
    s = vessel.particulars
    units = {"time": s.ship_time, "distance": s.L, "speed": s.nominal_speed, "rate": np.rad2deg(1.0 / s.ship_time)}
    return {"angle": heading_deg + value, "drift": np.rad2deg(1.0), "roll": value, **units}[quantity]


def model_error(rows: Sequence[Mapping]) -> dict[str, float]:
    """Standard deviation of the indices of each kind that the spread of the draws leaves unexplained.

    Parameters
    ----------
    rows : sequence of mapping
        From :func:`index_rows`, of any number of runs.

    Returns
    -------
    dict of str to float
        Of overshoot angles over the swing, of times in L/U, of distances in L; empty without rows, 0 where the draws
        explain the errors. Without a held-out index of a kind, the error of the previous kind in this order is used,
        or that of the next one for the first.
    """
    found: dict[str, float] = {}
    for kind in ERRING:
        mine = [row for row in rows if row["kind"] == kind]
        square = np.array([((row["measured"] - row["forecast"]) / row["scale"]) ** 2 for row in mine])
        known = np.array([(row["parameter_sd"] ** 2 + row["model_sd"] ** 2) / row["scale"] ** 2 for row in mine])
        if mine:
            found[kind] = _excess_sd(square, known)
    shown = list(found)
    for kind in ERRING if shown else ():
        before = [one for one in shown if ERRING.index(one) <= ERRING.index(kind)]
        found[kind] = found[before[-1] if before else shown[0]]
    return found


def steady_error(motion_error: xr.Dataset) -> dict[str, float]:
    """Standard deviation of steady speeds, rates and drift angles by quantity: of the motion at the longest lead.

    Parameters
    ----------
    motion_error : Dataset, dims (lead,)
        From :func:`pymc_ship.forecasting.motion_error.motion_error`.

    Returns
    -------
    dict of str to float
        Prime; empty without leads.
    """
    if not motion_error.sizes["lead"]:
        return {}
    return {quantity: float(motion_error[name][-1]) for quantity, name in _OF_MOTION.items()}


def _excess_sd(square: np.ndarray, known: np.ndarray) -> float:
    """Sd beyond the ``known`` variances at which squared errors are on average as large as their variance, or 0.

    Paule & Mandel (1982), doi:10.6028/jres.087.022: an error whose variance is known to be large counts for little.
    """
    low, high = 0.0, float(np.sqrt(square.max()))
    if np.mean(square / np.maximum(known, np.finfo(float).tiny)) <= 1.0:
        return 0.0
    for _ in range(_HALVINGS):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if np.mean(square / (known + middle**2)) > 1.0 else (low, middle)
    return 0.5 * (low + high)


def index_sd(row: Mapping, errors: Mapping[str, float]) -> float:
    """Standard deviation of the forecast of a row of :func:`index_rows`: draws, models and model error together."""
    return float(np.sqrt(row["parameter_sd"] ** 2 + row["model_sd"] ** 2 + (errors[row["kind"]] * row["scale"]) ** 2))


def reliability(beyond: float) -> dict[str, float | str]:
    """What is known of sure statements of a forecast that leaves the motion of its runs, as attrs of it.

    ``surest``, the largest probability that can be stood by (Laplace's rule of succession), and ``reliability``, a
    sentence; empty inside the motion of the runs.
    """
    if beyond <= 0.0:
        return {}
    surest = (HELD + 1.0) / (MADE + 2.0)
    sentence = (
        f"The forecast goes beyond the motion of the runs: of {MADE} statements of 99 % that were made so on foreign "
        f"ships, {HELD} held. No probability is stated above {surest:.3f}."
    )
    return {"surest": surest, "reliability": sentence}


def with_model_error(
    found: xr.Dataset, errors: Mapping[str, float], vessel: Vessel, rng: np.random.Generator, *, beyond: float = 0.0
) -> xr.Dataset:
    """Add to each index of the simulated ships a normal error of its kind, as the indices of trials have.

    An index that cannot be negative is 0 where the sum is: an interval of quantiles is then the part of the interval of
    the sums that exists, and covers every value that exists as often as that one.

    Parameters
    ----------
    found : Dataset, dims (draw,)
        From :func:`pymc_ship.indices`.
    errors : mapping of str to float
        From :func:`model_error` and :func:`steady_error`; may be empty.
    vessel : Vessel
        Gives L and U.
    rng : numpy.random.Generator
    beyond : float, optional
        How far the median ship leaves the motion of the runs, in ranges of it.

    Returns
    -------
    Dataset, dims (draw,)
        Angles of roll are widened beyond the motion of the runs alone.
    """
    heading_deg, table = found.attrs.get("heading_deg", 0.0), kind_named(found.attrs["manoeuvre"]).indices

    def widened(variable: xr.DataArray) -> xr.DataArray:
        index = table[variable.name]
        error = float(np.hypot(errors.get(index.quantity, 0.0), _GROWN[index.quantity] * beyond))
        if error == 0.0:
            return variable
        size = error * index_scale(index.quantity, variable, heading_deg, vessel)
        wide = variable + size * rng.standard_normal(variable.shape)
        return wide if index.signed else wide.clip(min=0.0)

    return found.map(widened, keep_attrs=True)
