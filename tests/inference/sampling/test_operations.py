"""The density of pooled groups against that of the normal law of all rows, and its derivatives against differences."""

import numpy as np
import pytest
from scipy import stats
from scipy.linalg import block_diag
from scipy.optimize import approx_fprime

from pymc_ship.inference.sampling.hierarchical_model import marginal_density, reduced_groups
from pymc_ship.inference.sampling.operations import pooled_density
from tests.inference.sampling.test_hierarchical_model import GROUPS, PRIOR, SPREAD, columns, data_of, truth

P = 2
WORSE = pytest.mark.parametrize("size", [1e-3, 1.0, 1e3])


def drawn(size=1.0):
    rng = np.random.default_rng(8)
    _, _, each, variance = truth(rng)
    data = data_of(rng, each, variance)
    return data, np.abs(rng.standard_normal(P)) * size, stats.invgamma(4.0).rvs(GROUPS, random_state=rng)


def rows_of(data):
    """Inputs of the density besides tau and sigma2."""
    return [*reduced_groups(data, PRIOR, columns()[1]), 1.0 / PRIOR.kappas(P)]


def evaluated(data, tau, variance):
    return pooled_density(tau, variance, *rows_of(data))


def of_all_rows(data, tau, variance):
    """Log density of the scaled response with the coefficients of groups and means integrated out."""
    X, group = data.scaled_design_matrix, columns()[1]
    by_group = block_diag(*(X[group == g] for g in range(GROUPS)))
    between = np.kron(np.eye(GROUPS), np.diag(tau**2)) + np.kron(np.ones((GROUPS, GROUPS)), np.diag(PRIOR.kappas(P)))
    covariance = np.diag(variance[group]) + by_group @ between @ by_group.T
    return stats.multivariate_normal(X @ PRIOR.means(P), covariance).logpdf(data.scaled_response)


@WORSE
def test_it_is_that_of_all_rows_up_to_a_constant(size):
    data, tau, variance = drawn(size)
    constant = [
        evaluated(data, tau * k, variance * k)[0] - of_all_rows(data, tau * k, variance * k) for k in (1.0, 0.3)
    ]
    assert constant[0] == pytest.approx(constant[1], abs=1e-6)
    assert evaluated(data, tau, variance)[0] - of_all_rows(data, tau, 2.0 * variance) != pytest.approx(
        constant[0], abs=1e-3
    )


@WORSE
def test_its_derivatives_are_those_of_differences(size):
    data, tau, variance = drawn(size)
    _, of_tau, of_variance = evaluated(data, tau, variance)
    step = 1e-6
    np.testing.assert_allclose(
        of_tau * tau,
        approx_fprime(np.log(tau), lambda t: evaluated(data, np.exp(t), variance)[0], step),
        atol=1e-4,
    )
    np.testing.assert_allclose(
        of_variance * variance,
        approx_fprime(np.log(variance), lambda v: evaluated(data, tau, np.exp(v))[0], step),
        atol=1e-4,
    )


def test_an_overflowing_spread_has_density_nan():
    data, tau, variance = drawn()
    assert np.isnan(evaluated(data, tau * 1e200, variance)[0])


def test_the_density_of_nuts_is_that_of_prior_and_rows():
    """With its gradient, in log tau and log sigma2, up to a constant."""
    data, tau, variance = drawn()
    density = marginal_density(reduced_groups(data, PRIOR, columns()[1]), PRIOR, SPREAD)
    differences = []
    for factor in (1.0, 0.7, 1.6):
        point = np.log(factor * np.concatenate([tau, variance]))
        expected = of_all_rows(data, factor * tau, factor * variance) + point.sum()
        expected += stats.halfnorm(scale=SPREAD).logpdf(factor * tau).sum()
        expected += stats.invgamma(PRIOR.shape, scale=PRIOR.scale).logpdf(factor * variance).sum()
        value, gradient = density.log_density(point)
        differences.append(value - expected)
        slopes = approx_fprime(point, lambda x: density.log_density(x)[0], 1e-6)
        np.testing.assert_allclose(gradient, slopes, atol=1e-4)
    np.testing.assert_allclose(differences, differences[0], atol=1e-6)
    kept = density.parameters(point)
    np.testing.assert_allclose(np.concatenate([*kept.values()]), 1.6 * np.concatenate([tau, variance]))
