"""Rows of the study's tables: coefficients with their references, error summaries, scores of forecasts."""

from collections.abc import Callable, Iterable, Mapping
from typing import Any

import numpy as np
import xarray as xr

from pymc_ship.inference.identifiability.bound import ERROR_LIMITS
from pymc_ship.inference.regression.priors import ExactPosterior
from pymc_ship.physics.vessel.vessel import Vessel
from pymc_ship.ships.ensemble.scores import BANDS
from pymc_ship.trial.channels import channel_names


def relative_error(estimate: np.ndarray, reference: np.ndarray) -> np.ndarray:
    """Absolute relative error [%] (Xue et al. 2020, Eq. 28); NaN where the reference is zero."""
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.where(reference == 0.0, np.nan, 100.0 * np.abs((estimate - reference) / reference))


def coefficient_rows(vessel: Vessel, dof: str, exact: Mapping[str, ExactPosterior]) -> list[dict]:
    """Tables 2 and 3: reference, published and own estimates of a DOF, all times 1e5, with their errors.

    Keys: coefficient, reference, sign_source, and for each family published_, published_error_, mean_, sd_, error_.
    """
    reference = vessel.coefficients(dof)
    columns = {
        "coefficient": reference["coefficient"].values,
        "reference": 1e5 * reference.values,
        "sign_source": reference["sign_source"].values,
    }
    for family, posterior in exact.items():
        published = vessel.published_estimates(dof, family)
        columns |= {
            f"published_{family}": 1e5 * published,
            f"published_error_{family}": relative_error(published, reference.values),
            f"mean_{family}": 1e5 * posterior.mean,
            f"sd_{family}": 1e5 * posterior.sd,
            f"error_{family}": relative_error(posterior.mean, reference.values),
        }
    lines = zip(*(values.tolist() for values in columns.values()), strict=True)
    return [dict(zip(columns, line, strict=True)) for line in lines]


def error_summary(errors: np.ndarray) -> dict[str, float]:
    """Median error [%] and percentage of coefficients under each limit; NaN errors (zero references) do not count."""
    known = errors[np.isfinite(errors)]
    names = [f"under_{limit:g}" for limit in ERROR_LIMITS]
    if not known.size:
        return {"coefficients": 0, "median": np.nan, **dict.fromkeys(names, np.nan)}
    percentages = [100.0 * float((known < limit).mean()) for limit in ERROR_LIMITS]
    return {"coefficients": known.size, "median": float(np.median(known)), **dict(zip(names, percentages, strict=True))}


def summary_rows(
    vessel: Vessel, exact_by_family: Mapping[str, Mapping[str, ExactPosterior]], **labels: Any
) -> list[dict]:
    """Error summary of each DOF and over all; ``coverage`` is the percentage of references inside 90 % intervals."""
    rows = []
    for family, exact in exact_by_family.items():
        errors, inside = {}, {}
        for dof, posterior in exact.items():
            reference = vessel.coefficients(dof).values
            errors[dof] = relative_error(posterior.mean, reference)
            lower, upper = posterior.quantiles([0.05, 0.95])
            inside[dof] = (lower <= reference) & (reference <= upper)
        errors["all"], inside["all"] = (np.concatenate(list(values.values())) for values in (errors, inside))
        rows += [
            {**labels, "family": family, "dof": dof, **error_summary(e), "coverage": 100.0 * float(inside[dof].mean())}
            for dof, e in errors.items()
        ]
    return rows


def published_rows(vessel: Vessel, families: Iterable[str]) -> list[dict]:
    """Error summary of the published estimates, in the form of :func:`summary_rows`."""
    rows = []
    for family in families:
        errors = {
            dof: relative_error(vessel.published_estimates(dof, family), vessel.coefficients(dof).values)
            for dof in vessel.dofs
        }
        errors["all"] = np.concatenate(list(errors.values()))
        rows += [
            {"level": "published", "family": family, "dof": dof, **error_summary(e), "coverage": float("nan")}
            for dof, e in errors.items()
        ]
    return rows


def forecast_row(reference: xr.Dataset, truth: xr.Dataset, tree: xr.DataTree, **labels: Any) -> dict:
    """Score a forecast from :func:`pymc_ship.forecast` against the reference ship on its time grid.

    ``truth`` holds the indices of the reference ship. Keys: ``error``, the RMSE of the median over the range of the
    channel [%], mean over the scored channels that move; ``coverage``, instants inside the band [%], mean likewise;
    ``diverged`` and, NaN where unknown, ``extrapolated`` [%], with the sentence ``extrapolation``; for each index
    its reference, median and band.
    """
    bands = tree["bands"].to_dataset()
    errors, coverages = [], []
    for name in channel_names(lambda channel: channel.scored):
        true = reference[name].values
        if name not in bands or np.ptp(true) == 0.0:
            continue
        lower, median, upper = (bands[name].sel(band=band).values for band in BANDS)
        errors.append(100.0 * np.sqrt(np.mean((median - true) ** 2)) / np.ptp(true))
        coverages.append(100.0 * np.mean((true >= lower) & (true <= upper)))
    row = {
        **labels,
        "manoeuvre": tree.attrs["label"],
        "error": float(np.mean(errors)),
        "coverage": float(np.mean(coverages)),
        "diverged": 100.0 * tree.attrs["diverged_fraction"],
        "extrapolated": 100.0 * tree.attrs["extrapolated_fraction"],
        "extrapolation": tree.attrs["extrapolation"],
    }
    for index, values in tree["index_bands"].to_dataset().data_vars.items():
        row[f"{index}_reference"] = float(truth[index])
        row |= {f"{index}_{band}": float(values.sel(band=band)) for band in BANDS}
    return row


_RESAMPLES = 400


STATISTICS: dict[str, Callable[[np.ndarray], float]] = {
    "median": lambda values: float(np.median(values)),
    "mean": lambda values: float(np.mean(values)),
    "rmse": lambda values: float(np.median(np.sqrt(np.mean(values**2, axis=0)))),  # median over coefficients
    "ratio": lambda values: float(np.median(values[:, 0]) / np.median(values[:, 1])),
}
"""Statistics of the values over the seeds, by name."""


def statistic_and_error(values: np.ndarray, statistic: str) -> tuple[float, float]:
    """Statistic over seeds and its standard error by the bootstrap."""
    rng, function = np.random.default_rng(len(values)), STATISTICS[statistic]
    with np.errstate(invalid="ignore"):
        again = [function(values[rng.integers(0, len(values), len(values))]) for _ in range(_RESAMPLES)]
        value, se = function(values), float(np.std(again))
    return value, 0.0 if se < 1e-9 * abs(value) else se
