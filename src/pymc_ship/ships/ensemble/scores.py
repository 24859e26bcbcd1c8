"""Quantile bands of draws, and the continuous ranked probability score."""

import numpy as np
import xarray as xr

from pymc_ship.machine.threads import map_in_threads

BANDS = ("lower", "median", "upper")  # values of the coordinate ``band`` of a forecast


def quantile_bands(values: xr.Dataset, ci_prob: float) -> xr.Dataset:
    """Equal-tailed band and median over the draws that are not NaN."""
    tail = 0.5 * (1.0 - ci_prob)
    named = list(values.data_vars.items())
    bands = map_in_threads(lambda one: quantiles(one[1].values, [tail, 0.5, 1.0 - tail]), named)
    variables = {
        name: (("band", *variable.dims[1:]), band, variable.attrs)
        for (name, variable), band in zip(named, bands, strict=True)
    }
    coords = {"band": list(BANDS)} | {name: values.coords[name] for name in values.coords if name != "draw"}
    return xr.Dataset(variables, coords)


def quantiles(values: np.ndarray, probabilities: list[float]) -> np.ndarray:
    """Quantiles over the first axis without NaN, linear between order statistics."""
    ordered = np.sort(values, axis=0)
    count = np.isfinite(ordered).sum(axis=0)
    rank = np.multiply.outer(probabilities, np.maximum(count - 1, 0))
    below = np.floor(rank).astype(int)
    above = np.minimum(below + 1, np.maximum(count - 1, 0))
    low, high = (np.take_along_axis(ordered, index, axis=0) for index in (below, above))
    return low + (rank - below) * (high - low)


def crps(draws: np.ndarray, measured: np.ndarray) -> float:
    """Continuous ranked probability score of an ensemble (n_draws, n_time), mean over time."""
    sorted_draws = np.sort(draws[np.isfinite(draws[:, -1])], axis=0)
    n = len(sorted_draws)
    # Gneiting & Raftery (2007), doi:10.1198/016214506000001437, Eq. 20
    weight = (2.0 * np.arange(1, n + 1) - n - 1.0) / (n * n)
    return float(np.mean(np.mean(np.abs(sorted_draws - measured), axis=0) - weight @ sorted_draws))
