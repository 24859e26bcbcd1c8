"""Error of manoeuvre indices beyond the spread of the draws, from held-out runs.

Overshoot angles err in units of the swing of heading, times of L/U, distances of L, angles of roll of the angle. The
size has a half-Cauchy law over ships (Gelman 2006, doi:10.1214/06-BA117A), whose median is :data:`TYPICAL`, times the
likelihood of the held-out indices. Steady speeds, rates and drift angles have the error of the motion. Beyond the
motion of the runs an error grows with the distance from it; ``calibration.toml`` has the constants.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import xarray as xr
from scipy.optimize import brentq
from scipy.special import ndtr, ndtri

from pymc_ship.physics.manoeuvre.kinds import SCORED_QUANTITIES
from pymc_ship.physics.manoeuvre.registry import kind_named
from pymc_ship.physics.vessel.vessel import Vessel
from pymc_ship.ships.ensemble.calibration import calibrated, calibrated_by
from pymc_ship.ships.ensemble.motion_error import MOTION_EXTRAPOLATION_SD, equal_sizes, size_law

EXTRAPOLATION_SD = calibrated("index_extrapolation_sd")
"""Standard deviation of an index for each range of the record by which the median ship leaves it [swing, L/U, L,
roll]."""

TYPICAL = calibrated_by("index_typical")
"""Error of an index beyond the draws that half the ships exceed [swing, L/U, L, roll]."""

LIKELIHOOD_WEIGHT = calibrated("index_likelihood_weight")
"""Weight of each held-out index in the law; the indices of one run err together."""

CALIBRATION_HITS, CALIBRATION_TRIALS = int(calibrated("calibration_hits")), int(calibrated("calibration_trials"))
"""Statements "at most" and "at least" that were made with 99 % on indices beyond the motion of the runs: how many held
and how many there were, on ships by which no other constant was chosen."""

_OF_MOTION = {"speed": "u", "rate": "r", "drift": "v"}
_SD_PER_RANGE = dict.fromkeys(SCORED_QUANTITIES, EXTRAPOLATION_SD) | {
    quantity: MOTION_EXTRAPOLATION_SD[name] for quantity, name in _OF_MOTION.items()
}
_SHARE_OF = {"angle": "swing of heading", "time": "L/U", "distance": "L", "roll": "angle of roll"}
_COVERED = 0.95


def index_scale(quantity: str, value: Any, heading_deg: float, vessel: Vessel) -> Any:
    """What an error of an index of a quantity is measured in: a drift angle in 1 rad, an angle of roll in itself."""
    s = vessel.particulars
    units = {"time": s.ship_time, "speed": s.nominal_speed, "rate": np.rad2deg(1.0 / s.ship_time)}
    units |= dict.fromkeys(("distance", "diameter"), s.L)
    return {"angle": heading_deg + value, "drift": np.rad2deg(1.0), "roll": value, **units}[quantity]


def model_error(rows: Sequence[Mapping]) -> dict[str, np.ndarray]:
    """Standard deviation of the indices of each kind that the spread of the draws leaves unexplained.

    Parameters
    ----------
    rows : sequence of mapping
        ``held_out_indices`` of a :class:`pymc_ship.Ship`, of any number of runs; without any,
        the law is that of foreign ships.

    Returns
    -------
    dict of str to ndarray, shape (SIZES,)
        Equally probable sizes, rising: of overshoot angles over the swing, of times in L/U, of distances in L, of
        angles of roll over the angle. A place is one size of the ship's errors in all kinds.
    """
    error, known = np.reshape([scaled(row) for row in rows], (-1, 2)).T
    typical = np.array([TYPICAL[row["kind"]] for row in rows])
    found = equal_sizes(*size_law(error, known, typical, LIKELIHOOD_WEIGHT))
    return {kind: TYPICAL[kind] * found for kind in SCORED_QUANTITIES}


def scaled(row: Mapping) -> tuple[float, float]:
    """Error of a row of ``index_rows``, and the variance that draws, term sets and readings explain, over its scale."""
    known = row["parameter_sd"] ** 2 + row["model_sd"] ** 2 + row["measured_sd"] ** 2
    return (row["forecast"] - row["measured"]) / row["scale"], known / row["scale"] ** 2


def readings_noise(found: xr.Dataset, rows: Sequence[Mapping], vessel: Vessel) -> dict[str, float]:
    """Standard deviation that the noise of the readings would leave the indices of a run, were it measured.

    Parameters
    ----------
    found : Dataset, dims (draw,)
        From :func:`pymc_ship.indices`.
    rows : sequence of mapping
        As for :func:`model_error`, with what it left of other runs: the root mean square of a kind, in the units of the
        model error.
    vessel : Vessel
        Gives L and U.

    Returns
    -------
    dict of str to float
        By name, in the units of the indices; 0 for those of a kind without a row.
    """
    table, heading_deg = kind_named(found.attrs["manoeuvre"]).indices, found.attrs.get("heading_deg", 0.0)
    noise = dict.fromkeys(map(str, found), 0.0)
    for name in noise:
        of_kind = [row["measured_sd"] / row["scale"] for row in rows if row["kind"] == table[name].quantity]
        if of_kind:
            scale = index_scale(table[name].quantity, float(found[name].median()), heading_deg, vessel)
            noise[name] = float(np.sqrt(np.mean(np.square(of_kind))) * scale)
    return noise


def error_rows(errors: Mapping[str, np.ndarray], vessel: Vessel) -> list[dict]:
    """Law of :func:`model_error` in rows, of the kinds that the vessel models.

    ``kind``, ``median`` and ``upper`` (with 95 %) of the sd, and what it is a share of, ``unit``.
    """
    rows = []
    for kind, sizes in errors.items():
        if kind != "roll" or "roll" in vessel.dofs:
            median, upper = np.quantile(sizes, (0.5, _COVERED)).tolist()
            rows.append({"kind": kind, "median": median, "upper": upper, "unit": _SHARE_OF[kind]})
    return rows


def steady_error(motion_error: Mapping[str, np.ndarray]) -> dict[str, np.ndarray]:
    """Sizes of the error of steady speeds, rates and drift angles by quantity: those of the motion once it has settled.

    Parameters
    ----------
    motion_error : mapping of str to ndarray
        From :func:`pymc_ship.ships.ensemble.motion_error.motion_error`.

    Returns
    -------
    dict of str to ndarray, shape (SIZES,)
        Prime.
    """
    return {quantity: motion_error[name] for quantity, name in _OF_MOTION.items() if name in motion_error}


def index_sd(row: Mapping, errors: Mapping[str, np.ndarray]) -> float:
    """Standard deviation of the normal law with the same interval of 95 % as the error of a row of ``index_rows``.

    It holds draws, models, model error and the noise of the readings together.
    """
    _, known = scaled(row)
    return row["scale"] * equivalent_sd(np.sqrt(known + errors.get(row["kind"], np.zeros(1)) ** 2))


def equivalent_sd(sd: np.ndarray) -> float:
    """Standard deviation of the normal law with the same interval of 95 % as a mixture of normal laws about one mean.

    Parameters
    ----------
    sd : ndarray, shape (n_laws,)
        Of equally probable laws.
    """
    quantile = ndtri(0.5 + 0.5 * _COVERED)
    if sd.min() == sd.max():
        return float(sd[0])

    def excess(half_width: float) -> float:
        return float(np.mean(2.0 * ndtr(half_width / sd) - 1.0)) - _COVERED

    return float(brentq(excess, quantile * sd.min(), quantile * sd.max())) / quantile


def reliability(beyond: float) -> dict[str, float | str]:
    """Attrs of a forecast beyond the motion of the runs; empty within it.

    ``calibration_cap``, the largest probability that is stated: Laplace's rule of succession for the calibration
    trials. ``reliability``, a sentence.
    """
    if beyond <= 0.0:
        return {}
    cap = (CALIBRATION_HITS + 1.0) / (CALIBRATION_TRIALS + 2.0)
    sentence = (
        f"The forecast goes beyond the motion of the runs: of {CALIBRATION_TRIALS} statements of 99 % that were made "
        f"so on foreign ships, {CALIBRATION_HITS} held. No probability is stated above {cap:.3f}."
    )
    return {"calibration_cap": cap, "reliability": sentence}


def error_sizes(
    found: xr.Dataset, errors: Mapping[str, np.ndarray | float], vessel: Vessel, *, beyond: float, place: np.ndarray
) -> dict[str, np.ndarray]:
    """Standard deviation of the error of each index of the simulated ships, by its name, each of shape (n_draws,).

    A steady turning diameter, 2 U / r, has the relative errors of the steady speed and yaw rate.

    Parameters
    ----------
    found, errors, vessel, beyond
        As :func:`with_model_error`.
    place : ndarray, shape (n_draws,)
        Place in [0, 1) of each draw's size among the equally probable ones.

    Returns
    -------
    dict of str to ndarray
        Units of the indices.
    """
    heading_deg, table = found.attrs.get("heading_deg", 0.0), kind_named(found.attrs["manoeuvre"]).indices
    sizes: dict[str, np.ndarray] = {}
    for name in map(str, found):
        quantity = table[name].quantity
        if quantity != "diameter":
            law = np.atleast_1d(errors.get(quantity, 0.0))
            error = np.hypot(law[(place * law.size).astype(int)], _SD_PER_RANGE[quantity] * beyond)
            sizes[name] = error * np.asarray(index_scale(quantity, found[name], heading_deg, vessel))
    relative = {table[name].quantity: sizes[name] / found[name].values for name in sizes}
    for name in map(str, found):
        if table[name].quantity == "diameter":
            sizes[name] = np.hypot(relative["speed"], relative["rate"]) * found[name].values
    return sizes


def with_model_error(
    found: xr.Dataset,
    errors: Mapping[str, np.ndarray | float],
    vessel: Vessel,
    rng: np.random.Generator,
    *,
    beyond: float = 0.0,
) -> xr.Dataset:
    """Add to each index of the simulated ships a normal error of its kind, as the indices of trials have.

    An index that cannot be negative is 0 where the sum is: an interval of quantiles is then the part of the interval of
    the sums that exists, and covers every value that exists as often as that one. The error of a steady turning
    diameter is one of its logarithm.

    Parameters
    ----------
    found : Dataset, dims (draw,)
        From :func:`pymc_ship.indices`.
    errors : mapping of str to ndarray or float
        From :func:`model_error`, of which a draw has one size in all kinds, and :func:`steady_error`; may be empty.
    vessel : Vessel
        Gives L and U.
    rng : numpy.random.Generator
    beyond : float, optional
        How far the median ship leaves the motion of the runs, in ranges of it.

    Returns
    -------
    Dataset, dims (draw,)
    """
    table = kind_named(found.attrs["manoeuvre"]).indices
    sizes = error_sizes(found, errors, vessel, beyond=beyond, place=rng.random(found.sizes["draw"]))

    def widened(variable: xr.DataArray) -> xr.DataArray:
        size, index = sizes[str(variable.name)], table[str(variable.name)]
        if not size.any():
            return variable
        error = size * rng.standard_normal(size.size)
        if index.quantity == "diameter":
            return variable * np.exp(error / variable)
        return variable + error if index.signed else (variable + error).clip(min=0.0)

    return found.map(widened, keep_attrs=True)
