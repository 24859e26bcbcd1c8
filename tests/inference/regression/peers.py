"""What statistics are compared with: a plain sampler, results computed elsewhere, and limits for z-scores."""

from __future__ import annotations

import json
from functools import cache
from pathlib import Path
from types import SimpleNamespace

import arviz as az
import numpy as np
from scipy.stats import norm

from pymc_ship.inference.rows.data import RegressionData

FOLDER = Path(__file__).parents[2] / "data" / "regression"

SEMICONJUGATE = {
    "ds1": {"kappa": 10.0, "shape": 3.0, "scale": 2.0, "log_evidence": -735.1186354518},
    "ds2": {"kappa": 100.0, "shape": 2.0, "scale": 1.0, "log_evidence": -547.7150867445},
}
"""Semi-conjugate priors of the oracle and the evidence under them; the conjugate ones have the same numbers."""


def cholesky_gibbs(X, y, prior, draws, rng):
    """Gibbs sampler of Xue et al. (2020), Algorithm 1, as printed: one Cholesky factor of X'X / sigma2 + V^-1 a draw.

    Returns coefficients, shape (draws, n_terms), and noise variances, shape (draws,); it starts at the variance of the
    response.
    """
    n_rows, n_terms = X.shape
    gram, moment = X.T @ X, X.T @ y
    precision, mean = np.diag(1.0 / prior.kappas(n_terms)), prior.means(n_terms)
    pull = precision @ mean
    coefficients, noise_variance = np.empty((draws, n_terms)), np.empty(draws)
    sigma2 = np.var(y)
    for k in range(draws):
        factor = np.linalg.cholesky(precision + gram / sigma2)
        middle = np.linalg.solve(factor, pull + moment / sigma2)
        beta = np.linalg.solve(factor.T, middle + rng.standard_normal(n_terms))
        rate = prior.scale + 0.5 * np.sum((y - X @ beta) ** 2)
        sigma2 = rate / rng.standard_gamma(prior.shape + 0.5 * n_rows)
        coefficients[k], noise_variance[k] = beta, sigma2
    return coefficients, noise_variance


@cache
def oracle(name):
    """Data set of the oracle with its exact semi-conjugate and conjugate posterior."""
    rows = np.loadtxt(FOLDER / f"{name}.csv.gz", delimiter=",", skiprows=2)
    exact = np.genfromtxt(FOLDER / f"{name}_exact.csv", delimiter=",", skip_header=2)[:, 1:]
    return SimpleNamespace(
        data=RegressionData.from_arrays(rows[:, 1:], rows[:, 0], scaling="none"),
        mean=exact[:-1, 0],
        sd=exact[:-1, 1],
        quantiles=exact[:-1, 2:].T,
        noise_variance=exact[-1],
        covariance=np.loadtxt(FOLDER / f"{name}_exact_cov.csv", delimiter=","),
        conjugate=json.loads((FOLDER / f"{name}_conjugate_nig.json").read_text()),
        probabilities=(0.025, 0.05, 0.25, 0.5, 0.75, 0.95, 0.975),
        **SEMICONJUGATE[name],
    )


def simulated(n_rows, n_terms, *, seed, noise=1.0):
    """Plain regression data: independent columns, coefficients of order one."""
    rng = np.random.default_rng(seed)
    X = rng.standard_normal((n_rows, n_terms))
    return RegressionData.from_arrays(
        X, X @ rng.standard_normal(n_terms) + noise * rng.standard_normal(n_rows), scaling="none"
    )


def z_limit(comparisons):
    """Two-sided normal quantile at 1e-3, shared among the comparisons."""
    return norm.isf(0.5e-3 / comparisons)


def largest_z(coefficients, noise_variance, exact):
    """Largest z-score of the means and standard deviations of draws (chain, draw, ...), by their own Monte-Carlo error.

    Returns it with the number of comparisons.
    """
    draws = np.concatenate([coefficients, noise_variance[..., None]], axis=-1)
    truth = np.append(exact.mean, exact.noise_variance_mean), np.append(exact.sd, exact.noise_variance_sd)
    z = []
    for j in range(draws.shape[-1]):
        x = draws[..., j]
        z.append((x.mean() - truth[0][j]) / float(az.mcse(x, method="mean")))
        z.append((x.std() - truth[1][j]) / float(az.mcse(x, method="sd")))
    return np.abs(z).max(), len(z)


def exact_of(data, prior):
    """Exact posterior of a pair of data and prior."""
    return prior.exact(data)
