"""Small regressions, their hyperparameters, and the parameters that the whitened models sample."""

from __future__ import annotations

from functools import cache

import numpy as np

from pymc_ship.inference.regression.conjugate import ConjugatePrior
from pymc_ship.inference.regression.semiconjugate import SemiConjugatePrior
from pymc_ship.inference.rows.data import RegressionData
from tests.inference.regression.own_priors import RootPrior

POWER = {ConjugatePrior: 1.0, SemiConjugatePrior: 0.0, RootPrior: 0.5}
"""Power of the noise variance in the prior variance of the coefficients, by family; the last is a user's."""

N_TERMS = 5
"""One number of terms throughout: the whitened model is compiled once."""


@cache
def regression(case):
    """Rows with nearly collinear columns; z-scored around a constant column; fewer rows than terms."""
    rng = np.random.default_rng(20200)
    n_rows = 4 if case == "wide" else 60
    X = rng.normal(size=(n_rows, N_TERMS))
    X[:, 1] = X[:, 0] + 0.02 * X[:, 1]
    if case == "zscored":
        X[:, 0], X[:, 2] = 2.0, 40.0 + 3.0 * X[:, 2]
    response = X @ np.array([1.0, -2.0, 0.5, 3.0, 0.0]) + 1.5 * rng.normal(size=n_rows)
    return RegressionData.from_arrays(X, response, scaling="zscore" if case == "zscored" else "none")


def hyperparameters(**changes):
    mean, kappa = np.array([0.0, 0.3, -0.2, 1.0, 0.0]), np.array([4.0, 1.0, 2.0, 0.5, 3.0])
    return {"mean": mean, "kappa": kappa, "shape": 6.0, "scale": 9.0} | changes


def scaled_parameters(data, coefficients, noise_variance):
    return np.append(data.to_scaled(coefficients), noise_variance / data.response_scale**2)


def log_volume(function, flat, step=1e-5):
    """Log of the volume that a function stretches, by central differences."""
    moves = step * np.eye(len(flat))
    jacobian = [(function(flat + move) - function(flat - move)) / (2.0 * step) for move in moves]
    return np.linalg.slogdet(np.array(jacobian))[1]
