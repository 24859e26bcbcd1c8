"""Regressions and priors for tests of exact posteriors, and a density of the noise variance by dense matrices."""

from __future__ import annotations

import numpy as np
from scipy import stats

from pymc_ship.inference.regression.semiconjugate import SemiConjugatePrior
from pymc_ship.inference.rows.data import RegressionData
from tests.inference.regression.peers import simulated


def vector_prior(n_terms, family=SemiConjugatePrior):
    rng = np.random.default_rng(9)
    return family(mean=rng.standard_normal(n_terms), kappa=rng.uniform(0.2, 5.0, n_terms), shape=3.5, scale=0.7)


def case():
    return simulated(20, 3, seed=14), vector_prior(3)


def two_modes():
    """Rows that either a coefficient of 25 or the noise explains; the marginal of log sigma2 has two modes."""
    x = np.array([1.0, 2.0, 3.0, -2.0, -1.0])
    data = RegressionData.from_arrays(x[:, None], 25.0 * x + [1.0, -1.0, 0.5, 0.0, -0.5], scaling="none")
    return data, SemiConjugatePrior(kappa=10.0, shape=2.0, scale=1.0)


def dense(X, y, prior, t):
    """Log of p(y, t) at values of t = log sigma2, by dense matrices."""
    prior_covariance = (X * prior.kappas(X.shape[1])) @ X.T
    residual = y - X @ prior.means(X.shape[1])
    values, vectors = np.linalg.eigh(prior_covariance)
    variances = np.clip(values, 0.0, None) + np.exp(t)[:, None]
    log_likelihood = -0.5 * np.sum(np.log(2.0 * np.pi * variances) + (vectors.T @ residual) ** 2 / variances, axis=1)
    return log_likelihood + stats.invgamma.logpdf(np.exp(t), prior.shape, scale=prior.scale) + t
