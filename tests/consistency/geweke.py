"""Joint-distribution test of a Gibbs sampler, which the calibration by ranks shares its simulations with."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
import xarray as xr

from pymc_ship.inference.regression.calibration import quantities, simulated_from_prior, with_response, with_z_limit
from pymc_ship.inference.regression.priors import Prior
from pymc_ship.inference.rows.data import RegressionData


def geweke(
    data: RegressionData,
    prior: Prior,
    step: Callable[[RegressionData, Prior, float, np.random.Generator], tuple[np.ndarray, float]],
    *,
    chains: int = 200,
    steps: int = 100,
    rng: np.random.Generator,
) -> xr.Dataset:
    """Joint-distribution test of a Gibbs sampler ("getting it right").

    Chains that alternate a step of the sampler with a new response given its parameters keep prior times likelihood.
    As they start there, independently, their means have the error of the spread between chains.

    Parameters
    ----------
    data, prior
        As in the calibration by ranks; few rows, lest the chains move slowly.
    step : callable
        ``step(data, prior, noise_variance, rng)`` returns coefficients, shape (n_terms,), and noise variance after one
        sweep from a given noise variance.
    chains, steps, rng

    Returns
    -------
    Dataset
        Dim moment (first and second of every standardised scaled coefficient and of the log noise variance, and the
        log likelihood): ``difference``, ``error`` and ``z``; attrs as in the calibration by ranks.

    References
    ----------
    Geweke (2004), JASA 99(467):799, doi:10.1198/016214504000001132.
    """
    direct, means = np.empty((chains * 10, 2 * data.n_terms + 3)), np.empty((chains, 2 * data.n_terms + 3))
    for k in range(len(direct)):
        truth, simulated = simulated_from_prior(data, prior, rng)
        direct[k] = _moments(simulated, prior, truth)
    for k in range(chains):
        truth, simulated = simulated_from_prior(data, prior, rng)
        visited = np.empty((steps, means.shape[1]))
        for i in range(steps):
            coefficients, noise_variance = step(simulated, prior, truth[-2], rng)
            truth = quantities(simulated, (coefficients[None], np.array([noise_variance])))[0]
            visited[i] = _moments(simulated, prior, truth)
            simulated = with_response(simulated, coefficients, noise_variance, rng)
        means[k] = visited.mean(axis=0)
    error = np.sqrt(direct.var(axis=0, ddof=1) / len(direct) + means.var(axis=0, ddof=1) / chains)
    difference = means.mean(axis=0) - direct.mean(axis=0)
    values = {"difference": difference, "error": error, "z": difference / error}
    first = [*data.coefficients, "log_noise_variance"]
    names = [*first, *(f"{name}^2" for name in first), "log_likelihood"]
    return with_z_limit(xr.Dataset({key: ("moment", value) for key, value in values.items()}, {"moment": names}))


def _moments(data: RegressionData, prior: Prior, truth: np.ndarray) -> np.ndarray:
    scaled = (data.to_scaled(truth[:-2]) - prior.means(data.n_terms)) / np.sqrt(prior.kappas(data.n_terms))
    first = np.append(scaled, math.log(truth[-2] / (data.response_scale**2 * prior.scale)))
    return np.concatenate([first, first**2, truth[-1:]])
