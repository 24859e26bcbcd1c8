"""Bands of draws, and the score of a forecast distribution."""

from __future__ import annotations

import numpy as np
import xarray as xr

BANDS = ("lower", "median", "upper")
"""Coordinate ``band`` of what a forecast summarises."""


def quantile_bands(values: xr.Dataset, ci_prob: float) -> xr.Dataset:
    """Equal-tailed band and median over the draws that are not NaN."""
    tail = 0.5 * (1.0 - ci_prob)
    variables = {
        name: (("band", *variable.dims[1:]), quantiles(variable.values, [tail, 0.5, 1.0 - tail]), variable.attrs)
        for name, variable in values.data_vars.items()
    }
    coords = {"band": list(BANDS)} | {name: values.coords[name] for name in values.coords if name != "draw"}
    return xr.Dataset(variables, coords)


def quantiles(values: np.ndarray, probabilities: list[float]) -> np.ndarray:
    """Quantiles over the first axis without NaN (which sorts last), linear between order statistics."""
    ordered = np.sort(values, axis=0)
    count = np.isfinite(ordered).sum(axis=0)
    rank = np.multiply.outer(probabilities, np.maximum(count - 1, 0))
    below = np.floor(rank).astype(int)
    above = np.minimum(below + 1, np.maximum(count - 1, 0))
    low, high = (np.take_along_axis(ordered, index, axis=0) for index in (below, above))
    return low + (rank - below) * (high - low)


def crps(drawn: np.ndarray, seen: np.ndarray) -> float:
    """Continuous ranked probability score of an ensemble (n_draws, n_time), mean over time.

    Gneiting & Raftery (2007), doi:10.1198/016214506000001437, Eq. 20, with the spread of a sorted ensemble.
    """
    held = np.sort(drawn[np.isfinite(drawn[:, -1])], axis=0)
    n = len(held)
    weight = (2.0 * np.arange(1, n + 1) - n - 1.0) / (n * n)
    return float(np.mean(np.mean(np.abs(held - seen), axis=0) - weight @ held))
