"""Model error of manoeuvre indices (numbers such as an overshoot angle) beyond the draws, from held-out runs.

Half-Cauchy prior of its sd over ships (Gelman 2006, doi:10.1214/06-BA117A) with median :data:`TYPICAL`, in units of
:func:`index_scale`. Beyond the runs it grows with the distance from them; this growth is a half-Cauchy law, too.
``calibration.toml`` has the constants.
"""

from collections.abc import Mapping, Sequence
from functools import cache
from typing import Any

import numpy as np
import scipy
import xarray as xr

from pymc_ship.physics.manoeuvre.kinds import SCORED_QUANTITIES
from pymc_ship.physics.manoeuvre.registry import kind_named
from pymc_ship.physics.vessel.vessel import Vessel
from pymc_ship.ships.ensemble.calibration import constant_by_kind, constant_value
from pymc_ship.ships.ensemble.motion_error import (
    MOTION_EXTRAPOLATION_SD,
    SIZE_GRID,
    SIZES,
    equal_sizes,
    motion_size,
    normalised_law,
    size_law,
)

EXTRAPOLATION_SD = constant_value("index_extrapolation_sd")  # typical, per range [peak heading, L/U, L, roll]
TYPICAL = constant_by_kind("index_typical")  # median error beyond the draws, over ships [peak heading, L/U, L, roll]
LIKELIHOOD_WEIGHT = constant_value("index_likelihood_weight")  # power of each index: errors of one run are correlated
# Statements of 99 % on extrapolated forecasts of validation ships: correct ones, and all.
CALIBRATION_HITS, CALIBRATION_TRIALS = (int(constant_value(f"calibration_{name}")) for name in ("hits", "trials"))
_OF_MOTION = {"speed": "u", "rate": "r", "drift": "v"}
_SD_PER_RANGE = dict.fromkeys(SCORED_QUANTITIES, EXTRAPOLATION_SD) | {
    quantity: MOTION_EXTRAPOLATION_SD[name] for quantity, name in _OF_MOTION.items()
}
_SHARE_OF = {"angle": "peak heading", "time": "L/U", "distance": "L", "roll": "angle of roll"}
_COVERED = 0.95


def index_scale(quantity: str, value: Any, heading_deg: float, vessel: Vessel) -> Any:
    """Unit of the error of an index of a quantity, in the units of the index."""
    s = vessel.particulars
    units = {"time": s.ship_time, "speed": s.nominal_speed, "rate": np.rad2deg(1.0 / s.ship_time)}
    units |= dict.fromkeys(("distance", "diameter"), s.L)
    return {"angle": heading_deg + value, "drift": np.rad2deg(1.0), "roll": value, **units}[quantity]


def model_error(rows: Sequence[Mapping], motion: Mapping[str, np.ndarray] | None = None) -> dict[str, np.ndarray]:
    """Standard deviation of the indices of each kind beyond the spread of the draws, from rows of :func:`.index_rows`.

    Equally probable quantiles (SIZES,) of the sd, in units of :func:`index_scale`. The prior median is the typical
    error of ships times the size of the error of the ``motion`` of :func:`.motion_error`, without it the typical error.
    """
    error, known_variance = np.reshape([scaled_error(row) for row in rows], (-1, 2)).T
    typical = np.array([TYPICAL[row["kind"]] for row in rows])
    prior_median = motion_size(motion) if motion else 1.0
    sizes = equal_sizes(*size_law(error, known_variance, typical, LIKELIHOOD_WEIGHT, prior_median))
    return {kind: TYPICAL[kind] * sizes for kind in SCORED_QUANTITIES}


def extrapolation_growth(rows: Sequence[Mapping], errors: Mapping[str, np.ndarray]) -> np.ndarray:
    """Growth of the error beyond the runs over the typical growth, from forecasts of harder runs by the milder ones.

    Half-Cauchy prior over ships with median 1, times the likelihood of the rows of :func:`.index_rows` with
    ``beyond``, the distance from the milder runs; equally probable quantiles (SIZES,). ``errors`` is from
    :func:`model_error`.
    """
    log_likelihood = np.zeros((SIZES, SIZE_GRID.size))
    for row in rows:
        error, known_variance = scaled_error(row)
        typical = EXTRAPOLATION_SD * row["beyond"]
        # draws, sets and readings; model error within the runs; growth beyond them
        variance = known_variance + errors[row["kind"]][:, None] ** 2 + (typical * SIZE_GRID) ** 2
        log_likelihood -= 0.5 * LIKELIHOOD_WEIGHT * (np.log(variance) + error**2 / variance)
    return equal_sizes(SIZE_GRID, normalised_law(scipy.special.logsumexp(log_likelihood, axis=0)))


def growth_at(growth: np.ndarray, measured: float, beyond: float) -> np.ndarray:
    """Growths (SIZES,) at a distance beyond the runs, from those of :func:`extrapolation_growth`.

    Harder runs measure the growth up to their own distance ``measured``. Past it another growth, of the prior over
    ships, is added in quadrature: a rudder may stall there. Without harder runs ``measured`` is 0.
    """
    if not measured or beyond <= measured:
        return growth
    return np.hypot(growth, (1.0 - measured / beyond) * np.quantile(_growth_of_ships(), low_discrepancy(growth.size)))


def low_discrepancy(size: int) -> np.ndarray:
    """Probabilities (size,) that pair a law with another, spread evenly over each part of it."""
    return np.arange(size) * 0.5 * (np.sqrt(5.0) - 1.0) % 1.0


@cache
def _growth_of_ships() -> np.ndarray:
    return extrapolation_growth((), {})


def scaled_error(row: Mapping) -> tuple[float, float]:
    """Error of a row of ``index_rows`` and its variance by draws, term sets and readings, over its scale."""
    known_variance = row["parameter_sd"] ** 2 + row["model_sd"] ** 2 + row["measured_sd"] ** 2
    return (row["forecast"] - row["measured"]) / row["scale"], known_variance / row["scale"] ** 2


def measurement_sd(simulated_indices: xr.Dataset, rows: Sequence[Mapping], vessel: Vessel) -> dict[str, float]:
    """Sd of simulated indices by the noise of the readings in ``rows`` of :func:`.index_rows`; 0 without a row."""
    table = kind_named(simulated_indices.attrs["manoeuvre"]).indices
    heading_deg = simulated_indices.attrs.get("heading_deg", 0.0)
    noise = dict.fromkeys(map(str, simulated_indices), 0.0)
    for name in noise:
        of_kind = [row["measured_sd"] / row["scale"] for row in rows if row["kind"] == table[name].quantity]
        if of_kind:
            scale = index_scale(table[name].quantity, float(simulated_indices[name].median()), heading_deg, vessel)
            noise[name] = float(np.sqrt(np.mean(np.square(of_kind))) * scale)
    return noise


def error_rows(errors: Mapping[str, np.ndarray], vessel: Vessel) -> list[dict]:
    """Rows ``kind``, ``median``, ``upper`` (95 %) of the sd and ``unit``, for the kinds of the vessel."""
    rows = []
    for kind, sizes in errors.items():
        if kind != "roll" or "roll" in vessel.dofs:
            median, upper = np.quantile(sizes, (0.5, _COVERED)).tolist()
            rows.append({"kind": kind, "median": median, "upper": upper, "unit": _SHARE_OF[kind]})
    return rows


def steady_error(motion_error: Mapping[str, np.ndarray]) -> dict[str, np.ndarray]:
    """Quantiles (SIZES,) of the sd of steady speed, rate and drift (prime), from those of the motion."""
    return {quantity: motion_error[name] for quantity, name in _OF_MOTION.items() if name in motion_error}


def index_sd(row: Mapping, errors: Mapping[str, np.ndarray], growth: np.ndarray | float = 1.0) -> float:
    """Equivalent normal sd of the error of a row of ``index_rows``: draws, models, model error and readings.

    A row with ``beyond`` also has the error beyond the runs, with the growth of :func:`extrapolation_growth`.
    """
    _, known_variance = scaled_error(row)
    distance = EXTRAPOLATION_SD * row.get("beyond", 0.0) * np.atleast_1d(growth)
    variance = known_variance + np.add.outer(errors.get(row["kind"], np.zeros(1)) ** 2, distance**2)
    return row["scale"] * equivalent_sd(np.sqrt(variance).ravel())


def equivalent_sd(sd: np.ndarray) -> float:
    """Sd of the normal law with the 95 % interval of a mixture of equally probable N(0, sd^2), sd (n_laws,)."""
    quantile = scipy.special.ndtri(0.5 + 0.5 * _COVERED)
    if sd.min() == sd.max():
        return float(sd[0])

    def excess(half_width: float) -> float:
        return float(np.mean(2.0 * scipy.special.ndtr(half_width / sd) - 1.0)) - _COVERED

    return float(scipy.optimize.brentq(excess, quantile * sd.min(), quantile * sd.max())) / quantile


def reliability(beyond: float) -> dict[str, float | str]:
    """Attrs ``calibration_cap`` and ``reliability`` of a forecast beyond the motion of the runs; empty within."""
    if beyond <= 0.0:
        return {}
    cap = (CALIBRATION_HITS + 1.0) / (CALIBRATION_TRIALS + 2.0)  # Laplace's rule of succession
    sentence = (
        f"The forecast extrapolates beyond the motion of the runs: of {CALIBRATION_TRIALS} statements of 99 % made so "
        f"for other ships, {CALIBRATION_HITS} were correct. Probabilities are limited to {cap:.3f}."
    )
    return {"calibration_cap": cap, "reliability": sentence}


def error_sizes(
    simulated_indices: xr.Dataset,
    errors: Mapping[str, np.ndarray | float],
    vessel: Vessel,
    *,
    beyond: float,
    quantile: np.ndarray,
    growth: np.ndarray | float = 1.0,
    growth_quantile: np.ndarray | float = 0.0,
) -> dict[str, np.ndarray]:
    """Standard deviation of the error of each simulated index, each (n_draws,), as :func:`with_model_error`.

    ``quantile`` is the probability in [0, 1) of each draw's size in its law, ``growth_quantile`` that of its growth
    beyond the runs in ``growth`` (n_laws,). A steady turning diameter, 2 U / r, has
    the relative errors of the steady speed and yaw rate.
    """
    table = kind_named(simulated_indices.attrs["manoeuvre"]).indices
    heading_deg = simulated_indices.attrs.get("heading_deg", 0.0)
    sizes: dict[str, np.ndarray] = {}
    growths = np.atleast_1d(growth)
    distance = beyond * growths[(np.asarray(growth_quantile) * growths.size).astype(int)]
    for name in map(str, simulated_indices):
        quantity = table[name].quantity
        if quantity != "diameter":
            law = np.atleast_1d(errors.get(quantity, 0.0))
            error = np.hypot(law[(quantile * law.size).astype(int)], _SD_PER_RANGE[quantity] * distance)
            sizes[name] = error * np.asarray(index_scale(quantity, simulated_indices[name], heading_deg, vessel))
    relative = {table[name].quantity: sizes[name] / simulated_indices[name].values for name in sizes}
    for name in map(str, simulated_indices):
        if table[name].quantity == "diameter":
            sizes[name] = np.hypot(relative["speed"], relative["rate"]) * simulated_indices[name].values
    return sizes


def with_model_error(
    simulated_indices: xr.Dataset,
    errors: Mapping[str, np.ndarray | float],
    vessel: Vessel,
    rng: np.random.Generator,
    *,
    beyond: float = 0.0,
    growth: np.ndarray | float = 1.0,
) -> xr.Dataset:
    """Simulated indices with a normal model error, at least 0 where unsigned; that of a diameter is of its ratio.

    A relative error e > 0 makes a diameter 1 + e times as large, -e as many times smaller: the law of a large growth
    keeps a mean. ``errors`` are from :func:`model_error` and :func:`steady_error`; a draw has one size in all kinds.
    ``beyond`` is the extrapolation distance of the median ship, in ranges of the motion of the runs, ``growth``, shape
    (n_laws,), from :func:`extrapolation_growth`.
    """
    table = kind_named(simulated_indices.attrs["manoeuvre"]).indices
    quantile, growth_quantile = rng.random((2, simulated_indices.sizes["draw"]))
    laws = {"quantile": quantile, "growth": growth, "growth_quantile": growth_quantile}
    sizes = error_sizes(simulated_indices, errors, vessel, beyond=beyond, **laws)

    def with_error(variable: xr.DataArray) -> xr.DataArray:
        size, index = sizes[str(variable.name)], table[str(variable.name)]
        if not size.any():
            return variable
        error = size * rng.standard_normal(size.size)
        if index.quantity == "diameter":
            ratio = 1.0 + np.abs(error / variable.values)
            return variable * np.where(error > 0.0, ratio, 1.0 / ratio)
        return variable + error if index.signed else (variable + error).clip(min=0.0)

    return simulated_indices.map(with_error, keep_attrs=True)
