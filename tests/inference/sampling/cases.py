"""Small regressions, their hyperparameters, and the density of a model of them."""

from __future__ import annotations

from functools import cache

import numpy as np
from scipy import stats

from pymc_ship.inference.regression.conjugate import ConjugatePrior
from pymc_ship.inference.regression.semiconjugate import SemiConjugatePrior
from pymc_ship.inference.rows.data import RegressionData
from tests.inference.regression.own_priors import RootPrior

POWER = {ConjugatePrior: 1.0, SemiConjugatePrior: 0.0, RootPrior: 0.5}
"""Power of the noise variance in the prior variance of the coefficients, by family; the last is a user's."""

N_TERMS = 5
"""Number of terms of every regression."""


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


def flat_functions(model):
    """Log density of the model and its scaled parameters, as functions of one flat vector."""
    values = model.value_vars
    outputs = model.replace_rvs_by_values([model["coefficients"], model["noise_variance"]])
    parameters = model.compile_fn(outputs, inputs=values, on_unused_input="ignore", mode="FAST_COMPILE")
    log_density = model.compile_logp(mode="FAST_COMPILE")
    start = model.initial_point()
    splits = np.cumsum([np.size(start[value.name]) for value in values])[:-1]

    def point(flat):
        pieces = np.split(flat, splits)
        return {v.name: piece.reshape(np.shape(start[v.name])) for v, piece in zip(values, pieces, strict=True)}

    return lambda flat: float(log_density(point(flat))), lambda flat: parameters(point(flat))


def log_joint(data, prior, scaled, variance):
    """Log density of the prior on the scaled columns and of the original response, from scipy."""
    spread = np.sqrt(prior.kappa * variance ** POWER[type(prior)])
    density = stats.invgamma.logpdf(variance, prior.shape, scale=prior.scale)
    density += stats.norm.logpdf(scaled, prior.mean, spread).sum()
    noise_sd = data.response_scale * np.sqrt(variance)
    return density + stats.norm.logpdf(data.response, data.design_matrix @ data.to_original(scaled), noise_sd).sum()


def log_density_error(functions, data, prior, rng):
    """Largest error of a log density over random points, against prior, likelihood and Jacobian."""
    log_density, parameters = functions

    def scaled(flat):
        return scaled_parameters(data, *parameters(flat))

    errors = []
    for flat in rng.normal(size=(4, N_TERMS + 1)):
        *coefficients, variance = scaled(flat)
        expected = log_joint(data, prior, np.array(coefficients), variance) + log_volume(scaled, flat)
        errors.append(abs(log_density(flat) - expected) / max(1.0, abs(expected)))
    return max(errors)
