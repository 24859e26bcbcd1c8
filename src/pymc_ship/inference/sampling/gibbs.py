"""Gibbs sampler in the rotated coordinates of :mod:`pymc_ship.inference.regression.priors`, O(n_terms) per step.

Given sigma2 the rotated coefficients g are independent; the residual sum of squares is |e|^2 + |z - s g|^2. Under the
conjugate prior g'g is added to it, with shape A + (n + c)/2 of sigma2 (Xue et al. 2020, Eq. 15).
"""

import math

import numpy as np
import xarray as xr
from numba import njit

from pymc_ship.inference.regression.priors import Prior, check_prior, rotate, rotate_back, warn_of_rows
from pymc_ship.inference.regression.tree import draws_tree, rng_state
from pymc_ship.inference.rows.data import RegressionData
from pymc_ship.machine.arguments import check_counts
from pymc_ship.machine.errors import InferenceError
from pymc_ship.machine.seeds import Seed, random_generator


@njit(cache=True)
def _sweep(
    rng: np.random.Generator,
    start: np.ndarray,
    likelihood: tuple[np.ndarray, np.ndarray, float, int],
    prior: tuple[float, float, float],
    rotated: np.ndarray,
    noise_variance: np.ndarray,
) -> None:
    """Run all chains in place; ``shape``: conditional of sigma2, ``ridge``: prior precision of g times sigma2, or 0."""
    s, z, residual_square, tune = likelihood
    shape, scale, ridge = prior
    for chain in range(start.size):
        variance = start[chain]
        for step in range(-tune, noise_variance.shape[1]):
            g = rotated[chain, max(step, 0)]
            square = residual_square
            for i in range(s.size):
                total = (ridge if ridge > 0.0 else variance) + s[i] ** 2
                # g_i given sigma2: N(s z / total, sigma2 / total), total = ridge or sigma2, plus s^2
                g[i] = (s[i] * z[i] + math.sqrt(variance * total) * rng.standard_normal()) / total
                square += (z[i] - s[i] * g[i]) ** 2 + ridge * g[i] ** 2
            variance = (scale + 0.5 * square) / rng.standard_gamma(shape)  # sigma2 given g: inverse gamma
            noise_variance[chain, max(step, 0)] = variance


def gibbs(
    data: RegressionData, prior: Prior, *, draws: int = 1000, chains: int = 4, tune: int = 500, rng: Seed
) -> tuple[np.ndarray, np.ndarray]:
    """Coefficients (chains, draws, n_terms) and noise variance (chains, draws) of :func:`gibbs_posterior` as arrays."""
    check_counts(draws=draws, chains=chains)
    check_counts(least=0, tune=tune)
    rng = random_generator(rng)
    check_prior(prior, data)
    if prior.noise_power not in (0, 1):
        raise InferenceError(
            "The Gibbs sampler needs coefficients whose prior variance is proportional to the noise variance or "
            f"independent of it, found its power {prior.noise_power:g} in the {prior.family} family; use "
            "nuts_posterior."
        )
    warn_of_rows(data, prior)
    rotation, unit = rotate(data, prior), data.response_scale
    s, z = unit * rotation.singular_values, unit * rotation.projection
    residual_square, scale = unit**2 * rotation.residual_square, unit**2 * prior.scale
    rate = scale + 0.5 * residual_square
    low = rate / (prior.shape + 0.5 * data.n_rows)
    high = (rate + 0.5 * np.sum(z**2)) / (prior.shape + 0.5 * max(data.n_rows - data.n_terms, 0))
    # log-spaced from a third of the least possible conditional mode of sigma2 to three times the largest
    start = np.geomspace(low / 3.0, 3.0 * high, chains)
    rotated, noise_variance = np.empty((chains, draws, data.n_terms)), np.empty((chains, draws))
    shape = prior.shape + 0.5 * (data.n_rows + data.n_terms * prior.noise_power)
    full_conditional = (shape, scale, unit**2 * float(prior.noise_power))
    _sweep(rng, start, (s, z, residual_square, tune), full_conditional, rotated, noise_variance)
    rotate_back(rotated.reshape(-1, data.n_terms), np.ascontiguousarray(rotation.basis.T), rotation.center)
    return rotated, noise_variance


def gibbs_posterior(
    data: RegressionData, prior: Prior, *, draws: int = 1000, chains: int = 4, tune: int = 500, rng: Seed
) -> xr.DataTree:
    """Posterior by Gibbs sampling, as a DataTree.

    Parameters
    ----------
    data : RegressionData
    prior : Prior
        On the scaled columns; mean and kappa may be vectors.
    draws, chains, tune : int, optional
        Draws of each chain, chains, and warm-up draws of each chain.
    rng : int, SeedSequence or Generator

    Returns
    -------
    DataTree
        As :func:`~pymc_ship.inference.regression.tree.draws_tree`: dims chain (``chains``), draw (``draws``),
        coefficient, row.

    Raises
    ------
    InferenceError
        For vectors of the wrong length, or a family whose ``noise_power`` is neither 0 nor 1.
    ValueError
        When draws or chains are not positive, or tune is negative.

    References
    ----------
    Xue et al. (2020), Algorithm 1 and Eq. 19-20, doi:10.1016/j.oceaneng.2019.106612; Gelfand & Smith (1990),
    doi:10.1080/01621459.1990.10476213.
    """
    rng = random_generator(rng)
    state = rng_state(rng)
    coefficients, noise_variance = gibbs(data, prior, draws=draws, chains=chains, tune=tune, rng=rng)
    return draws_tree(data, prior, coefficients, noise_variance, method="gibbs", rng_state=state)
