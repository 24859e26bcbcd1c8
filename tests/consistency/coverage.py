"""Coverage of central posterior intervals over data simulated from the prior, against their probability."""

from __future__ import annotations

import numpy as np
import xarray as xr
from scipy.special import ndtri
from scipy.stats import binomtest

from pymc_ship.inference.regression.calibration import simulated_from_prior, with_z_limit

PROBABILITIES = np.array([0.5, 0.8, 0.95])


def exact_quantiles(data, prior, probabilities):
    exact = prior.exact(data)
    return np.column_stack([exact.quantiles(probabilities), exact.noise_variance_quantiles(probabilities)])


def coverage(data, prior, quantiles=exact_quantiles, *, simulations, rng):
    """Dataset with dims interval, quantity: ``share`` and ``z`` of the binomial test; attrs as the calibration.

    ``quantiles(data, prior, probabilities)`` has shape (n, n_terms + 1), that of the noise variance last.
    """
    ends = np.concatenate([0.5 * (1.0 - PROBABILITIES), 0.5 * (1.0 + PROBABILITIES)])
    inside = np.zeros((PROBABILITIES.size, data.n_terms + 1), dtype=int)
    for _ in range(simulations):
        truth, simulated = simulated_from_prior(data, prior, rng)
        low, high = np.split(quantiles(simulated, prior, ends), 2)
        inside += (low < truth[:-1]) & (truth[:-1] < high)
    rows = zip(inside.tolist(), PROBABILITIES, strict=True)
    z = np.abs(ndtri(0.5 * np.array([[binomtest(k, simulations, at).pvalue for k in row] for row, at in rows])))
    values = {"share": (("interval", "quantity"), inside / simulations), "z": (("interval", "quantity"), z)}
    coords = {"interval": PROBABILITIES, "quantity": [*data.coefficients, "noise_variance"]}
    return with_z_limit(xr.Dataset(values, coords))
