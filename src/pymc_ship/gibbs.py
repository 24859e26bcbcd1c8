"""Gibbs sampler under the semi-conjugate prior, in coordinates where a step costs O(n_terms).

With W = X diag(kappa)^(1/2) = U S R', the rotated coefficients g = R' diag(kappa)^(-1/2) (b - mean) are independent
given sigma2, and the sum of squared residuals is |e|^2 + |z - s g|^2 with z = U' (y - X mean) and the explicit residual
e = y - X mean - U z. So neither conditional needs the rows, a matrix, or a factorisation.
"""

from __future__ import annotations

import math

import numpy as np
import xarray as xr
from numba import njit

from pymc_ship.posterior import posterior_tree, rng_state
from pymc_ship.priors import PriorError, SemiConjugatePrior
from pymc_ship.regression_data import RegressionData


@njit(cache=True)
def _sweep(rng, start, likelihood, prior, rotated, noise_variance):
    """Run every chain from its noise variance; the draws of the warm-up are overwritten."""
    s, z, residual_square, n_rows, tune = likelihood
    shape, scale = prior
    for chain in range(start.size):
        variance = start[chain]
        for step in range(-tune, noise_variance.shape[1]):
            g = rotated[chain, max(step, 0)]
            square = residual_square
            for i in range(s.size):
                total = variance + s[i] ** 2
                g[i] = (s[i] * z[i] + math.sqrt(variance * total) * rng.standard_normal()) / total
                square += (z[i] - s[i] * g[i]) ** 2
            variance = (scale + 0.5 * square) / rng.standard_gamma(shape + 0.5 * n_rows)
            noise_variance[chain, max(step, 0)] = variance


@njit(cache=True, fastmath={"reassoc", "contract"})
def _map_back(rotated, columns, center):
    """Replace each rotated draw by the original coefficients; the columns are those of the basis, as rows."""
    g = np.empty(center.size)
    for draw in rotated:
        g[:] = draw
        for j in range(g.size):
            total = center[j]
            for i in range(g.size):
                total += columns[j, i] * g[i]
            draw[j] = total


def gibbs(
    data: RegressionData,
    prior: SemiConjugatePrior,
    *,
    draws: int = 1000,
    chains: int = 4,
    tune: int = 500,
    rng: np.random.Generator,
) -> tuple[np.ndarray, np.ndarray]:
    """Gibbs draws under a semi-conjugate prior, without the layout.

    Parameters
    ----------
    data : RegressionData
    prior : SemiConjugatePrior
        On the scaled columns; mean and kappa may be vectors.
    draws : int, optional
        Draws of each chain that are kept.
    chains : int, optional
        The chains start at noise variances spread evenly in the logarithm from a third of the smallest mode that the
        conditional of sigma2 can have to three times the largest.
    tune : int, optional
        Draws of each chain that are made first and thrown away.
    rng : numpy.random.Generator

    Returns
    -------
    coefficients : ndarray, shape (chains, draws, n_terms)
        Original scale.
    noise_variance : ndarray, shape (chains, draws)
        Of the original response.

    Raises
    ------
    PriorError
        For a prior of the other family, or vectors of the wrong length.
    ValueError
        When draws or chains are not positive, or tune is negative.

    References
    ----------
    Xue et al. (2020), Algorithm 1 and Eq. 19-20, doi:10.1016/j.oceaneng.2019.106612; Gelfand & Smith (1990),
    doi:10.1080/01621459.1990.10476213.
    """
    if not isinstance(prior, SemiConjugatePrior):
        raise PriorError(
            f"The Gibbs sampler takes a SemiConjugatePrior, found {type(prior).__name__}; give one or use the "
            "conjugate posterior, which needs no sampler."
        )
    if draws < 1 or chains < 1 or tune < 0:
        raise ValueError(
            f"The sampler makes at least one draw in one chain, found draws {draws}, chains {chains}, tune {tune}; "
            "raise them."
        )
    s, z, residual_square, center, basis = _rotate(data, prior)
    scale = prior.scale * data.response_scale**2
    rate = scale + 0.5 * residual_square
    low = rate / (prior.shape + 0.5 * data.n_rows)
    high = (rate + 0.5 * np.sum(z**2)) / (prior.shape + 0.5 * max(data.n_rows - data.n_terms, 0))
    start = np.geomspace(low / 3.0, 3.0 * high, chains)
    rotated, noise_variance = np.empty((chains, draws, data.n_terms)), np.empty((chains, draws))
    likelihood = (s, z, residual_square, data.n_rows, tune)
    _sweep(rng, start, likelihood, (prior.shape, scale), rotated, noise_variance)
    _map_back(rotated.reshape(-1, data.n_terms), np.ascontiguousarray(basis.T), center)
    return rotated, noise_variance


def gibbs_posterior(
    data: RegressionData,
    prior: SemiConjugatePrior,
    *,
    draws: int = 1000,
    chains: int = 4,
    tune: int = 500,
    rng: np.random.Generator,
) -> xr.DataTree:
    """Gibbs draws under a semi-conjugate prior, laid out as a DataTree.

    Parameters
    ----------
    data : RegressionData
    prior : SemiConjugatePrior
    draws, chains, tune : int, optional
        Draws kept of each chain, chains, and draws of each chain thrown away first; as :func:`gibbs`.
    rng : numpy.random.Generator

    Returns
    -------
    DataTree
        As :func:`~pymc_ship.posterior.posterior_tree`: dims chain (``chains``), draw (``draws``), coefficient, row.

    Raises
    ------
    PriorError
        For a prior of the other family, or vectors of the wrong length.
    ValueError
        When draws or chains are not positive, or tune is negative.
    """
    state = rng_state(rng)
    coefficients, noise_variance = gibbs(data, prior, draws=draws, chains=chains, tune=tune, rng=rng)
    return posterior_tree(data, prior, coefficients, noise_variance, method="gibbs", rng_state=state)


def _rotate(data: RegressionData, prior: SemiConjugatePrior):
    """Singular values, projections, residual sum of squares, centre and basis (see the module's docstring)."""
    root, wide = np.sqrt(prior.kappas(data.n_terms)), data.n_terms > data.n_rows
    mean = prior.means(data.n_terms)
    if np.ndim(prior.kappa) or wide:
        left, s, right = np.linalg.svd(data.scaled_design_matrix * root, full_matrices=wide)
    else:
        left, s, right = data.svd
        s = s * root
    residual = data.response_scale * (data.scaled_response - data.scaled_design_matrix @ mean)
    z = left.T @ residual
    residual_square = float(np.sum((residual - left @ z) ** 2))
    unseen = np.zeros(data.n_terms - len(s))
    basis = (right * root) @ data.transformation[1].T
    s = data.response_scale * s
    return np.append(s, unseen), np.append(z, unseen), residual_square, data.to_original(mean), basis
