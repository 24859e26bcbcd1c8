"""Simulation-based calibration of posteriors, on data simulated from the prior."""

import math
from collections.abc import Callable
from dataclasses import replace

import numpy as np
import scipy
import xarray as xr
from numpy.typing import ArrayLike

from pymc_ship.inference.regression.priors import Prior, check_prior
from pymc_ship.inference.rows.data import RegressionData
from pymc_ship.machine.arguments import check_callables, check_counts
from pymc_ship.machine.seeds import Seed, random_generator

LEVEL = 1e-3  # probability that any comparison of a table exceeds its limit under a correct sampler

Draws = tuple[np.ndarray, np.ndarray]  # coefficients, shape (draws, n_terms), and noise variance, shape (draws,)
_CUTS, _TINY = 50, 1e-15


def exact_draws(data: RegressionData, prior: Prior, draws: int, rng: np.random.Generator) -> Draws:
    """Independent draws from the exact posterior."""
    return prior.exact(data).draw(draws, rng)


def simulation_based_calibration(
    data: RegressionData,
    prior: Prior,
    sample: Callable[[RegressionData, Prior, int, np.random.Generator], Draws] = exact_draws,
    *,
    simulations: int = 1000,
    draws: int = 99,
    rng: Seed,
) -> xr.Dataset:
    """Ranks of true parameters among posterior draws, with tests of uniformity.

    Parameters
    ----------
    data : RegressionData
        Design and scaling; the response is simulated.
    prior : Prior
    sample : callable, optional
        ``sample(data, prior, draws, rng)`` returns independent :data:`Draws`.
    simulations, draws : int, optional
        Number of simulated data sets, and of posterior draws for each.
    rng : int, SeedSequence or Generator

    Returns
    -------
    Dataset
        Dims simulation, quantity (every coefficient, ``"noise_variance"``, ``"log_likelihood"``): ``rank``,
        ``p_value`` and ``z`` of uniformity; attrs ``largest_z``, ``z_limit``, ``comparisons``, ``calibrated`` (0 or 1).
        Talts et al. (2018), arXiv:1804.06788; Modrak et al. (2023), doi:10.1214/23-BA1404.
    """
    check_counts(simulations=simulations, draws=draws)
    check_callables(sample=sample)
    rng = random_generator(rng)
    check_prior(prior, data)
    ranks = np.empty((simulations, data.n_terms + 2), dtype=int)
    for k in range(simulations):
        truth, simulated = simulated_from_prior(data, prior, rng)
        ranks[k] = np.sum(quantities(simulated, sample(simulated, prior, draws, rng)) < truth, axis=0)
    p = np.array([rank_p_value(column, draws) for column in ranks.T])
    names = [*data.coefficients, "noise_variance", "log_likelihood"]
    values = {"rank": (("simulation", "quantity"), ranks), "p_value": ("quantity", p), "z": ("quantity", _z(p))}
    return with_z_limit(xr.Dataset(values, {"quantity": names}))


def rank_p_value(ranks: np.ndarray, draws: int) -> float:
    """Simultaneous p-value of the uniformity of ranks, shape (n,), among 0..draws, doi:10.1007/s11222-022-10090-6."""
    n = len(ranks)
    cuts = np.unique(np.arange(1, _CUTS) * (draws + 1) // _CUTS)
    cuts = cuts[cuts > 0]
    probability = cuts / (draws + 1)
    counts = np.arange(n + 1)
    at_most = scipy.special.bdtr(counts, n, probability[:, None])
    at_least = scipy.special.bdtr(n - counts, n, 1.0 - probability[:, None])  # the other ranks number at most n - count
    tail = np.minimum(at_most, at_least)
    observed = np.searchsorted(np.sort(ranks), cuts)
    inside = tail > max(tail[np.arange(cuts.size), observed].min() * (1.0 + 1e-9), _TINY)
    factorial = scipy.special.gammaln(counts + 1.0)
    here, chance, before = np.array([0]), np.array([1.0]), 0.0
    for allowed, now in zip(inside, probability, strict=True):
        there, q = np.flatnonzero(allowed), (now - before) / (1.0 - before)
        more = there - here[:, None]
        log = factorial[n - here][:, None] - factorial[np.abs(more)] - factorial[n - there]
        log += more * math.log(q) + (n - there) * math.log1p(-q)
        chance = chance @ np.where(more >= 0, np.exp(np.where(more >= 0, log, 0.0)), 0.0)
        here, before = there, now
    return float(np.clip(1.0 - chance.sum(), _TINY, 1.0))


def simulated_from_prior(
    data: RegressionData, prior: Prior, rng: np.random.Generator
) -> tuple[np.ndarray, RegressionData]:
    """Parameters drawn from the prior (coefficients, noise variance, log likelihood), and data simulated with them."""
    scaled, variance = prior.draw(data.n_terms, rng)
    coefficients, noise_variance = data.to_original(scaled), float(data.response_scale**2 * variance)
    simulated = with_response(data, coefficients, noise_variance, rng)
    return quantities(simulated, (coefficients[None], np.array([noise_variance])))[0], simulated


def with_response(
    data: RegressionData, coefficients: np.ndarray, noise_variance: float, rng: np.random.Generator
) -> RegressionData:
    """Data with a response simulated from coefficients and noise variance."""
    return replace(data, response=rng.normal(data.design_matrix @ coefficients, math.sqrt(noise_variance)))


def quantities(data: RegressionData, draws: Draws) -> np.ndarray:
    """Coefficients, noise variance and joint log likelihood of draws, shape (draws, n_terms + 2)."""
    coefficients, variance = draws
    square = np.sum((data.response - coefficients @ data.design_matrix.T) ** 2, axis=1)
    log_likelihood = -0.5 * (data.n_rows * np.log(2.0 * math.pi * variance) + square / variance)
    return np.column_stack([coefficients, variance, log_likelihood])


def _z(p_value: ArrayLike) -> np.ndarray:
    """Two-sided normal quantile of p-values."""
    return np.abs(scipy.special.ndtri(0.5 * np.asarray(p_value)))


def with_z_limit(table: xr.Dataset) -> xr.Dataset:
    """Table of z-scores with the attrs comparisons, largest_z, z_limit and calibrated."""
    size, largest = table["z"].size, float(np.abs(table["z"].to_numpy()).max())
    limit = float(_z(LEVEL / size))
    return table.assign_attrs(comparisons=size, largest_z=largest, z_limit=limit, calibrated=int(largest <= limit))
