"""A regression whose columns differ in centre and scale, and its posterior in plain linear algebra."""

from __future__ import annotations

from functools import cache
from types import SimpleNamespace

import numpy as np
from scipy import stats

from pymc_ship.inference.regression.families import FAMILIES
from pymc_ship.inference.rows.data import RegressionData

NAMES = ("Y0", "Yv", "Yr", "Yv|v|", "Ydelta")
HELD = {"Yv|v|": 0.7}


@cache
def ship(scaling="zscore", constant=True):
    """Rows whose columns differ in centre and scale by orders of magnitude."""
    rng = np.random.default_rng(20201)
    X = rng.normal([0.0, 3.0, -0.5, 40.0, 0.2], [1.0, 0.5, 2.0, 10.0, 0.05], size=(30, 5))
    X[:, 0] = 1.0
    y = X @ np.array([5.0, -1.3, 2.0, 0.6, 8.0]) + 2.0 * rng.normal(size=30)
    columns = slice(None) if constant else slice(1, None)
    return RegressionData.from_arrays(X[:, columns], y, NAMES[columns], scaling=scaling)


def base(family, n_terms=5):
    mean, kappa = np.linspace(-0.2, 0.3, n_terms), np.linspace(0.5, 4.0, n_terms)
    return FAMILIES[family](mean=mean, kappa=kappa, shape=4.0, scale=0.6)


def plain(X, y, mean, variance, noise, family):
    """Posterior of plain linear algebra: coefficients of prior variance ``variance`` at the mean noise variance."""
    shape, scale = noise
    precision, gram, n_rows = np.diag(1.0 / variance), X.T @ X, len(y)
    if family == "conjugate":
        precision = precision * scale / (shape - 1.0)
        posterior = np.linalg.inv(precision + gram)
        middle = posterior @ (precision @ mean + X.T @ y)
        misfit = np.sum((y - X @ middle) ** 2) + (middle - mean) @ precision @ (middle - mean)
        a, b = shape + 0.5 * n_rows, scale + 0.5 * misfit
        noise_mean = b / (a - 1.0)
        return summary(middle, noise_mean * posterior, noise_mean, noise_mean / np.sqrt(a - 2.0))
    t = np.linspace(np.log(1e-3 * np.var(y)), np.log(1e2 * np.var(y)), 2001)
    weights, middles, covariances = np.empty(t.size), np.empty((t.size, len(mean))), []
    for k, sigma2 in enumerate(np.exp(t)):
        marginal = sigma2 * np.eye(n_rows) + (X * variance) @ X.T
        density = stats.multivariate_normal.logpdf(y, X @ mean, marginal)
        weights[k] = density + stats.invgamma.logpdf(sigma2, shape, scale=scale) + t[k]
        covariances.append(np.linalg.inv(precision + gram / sigma2))
        middles[k] = covariances[-1] @ (precision @ mean + X.T @ y / sigma2)
    weights = np.exp(weights - weights.max())
    weights /= weights.sum()
    middle = weights @ middles
    covariance = np.tensordot(weights, covariances, 1) + ((middles - middle).T * weights) @ (middles - middle)
    noise_mean = weights @ np.exp(t)
    return summary(middle, covariance, noise_mean, np.sqrt(weights @ (np.exp(t) - noise_mean) ** 2))


def summary(mean, covariance, noise_mean, noise_sd, offset=0.0, matrix=None):
    matrix = np.eye(len(mean)) if matrix is None else matrix
    sd = np.sqrt(np.diag(matrix @ covariance @ matrix.T))
    return SimpleNamespace(
        mean=offset + matrix @ mean,
        covariance=covariance,
        sd=sd,
        noise_variance_mean=noise_mean,
        noise_variance_sd=noise_sd,
    )


def agree(exact, known, rtol=1e-8):
    for name in ("mean", "sd", "noise_variance_mean", "noise_variance_sd"):
        np.testing.assert_allclose(getattr(exact, name), getattr(known, name), rtol=rtol, err_msg=name)
