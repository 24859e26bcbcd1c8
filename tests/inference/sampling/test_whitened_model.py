"""The density of a regression that NUTS draws from without compilation."""

import numpy as np
import pytest
from scipy.optimize import approx_fprime

from pymc_ship.inference.regression.conjugate import ConjugatePrior
from pymc_ship.inference.sampling.whitened_model import whitened_density
from tests.inference.sampling.cases import N_TERMS, POWER, hyperparameters, log_density_error, regression

CASES = ("tall", "zscored", "wide")


def functions(density):
    """Log density and scaled parameters as functions of the coordinates."""
    return lambda flat: density.log_density(flat)[0], lambda flat: density.parameters(flat).values()


@pytest.mark.parametrize("family", POWER)
@pytest.mark.parametrize("case", CASES)
def test_log_density_is_prior_times_likelihood_with_constants(case, family):
    data, prior = regression(case), family(**hyperparameters())
    density = whitened_density(data, prior)
    assert log_density_error(functions(density), data, prior, np.random.default_rng(1)) < 1e-7


@pytest.mark.parametrize("wrong", [{"scale": 1.0 / 9.0}, {"kappa": hyperparameters()["kappa"] ** 2}, {"shape": 9.0}])
def test_a_wrong_prior_has_another_log_density(wrong):
    data, prior = regression("tall"), ConjugatePrior(**hyperparameters())
    density = whitened_density(data, ConjugatePrior(**hyperparameters(**wrong)))
    assert log_density_error(functions(density), data, prior, np.random.default_rng(1)) > 1e-3


@pytest.mark.parametrize("family", POWER)
@pytest.mark.parametrize("case", CASES)
def test_its_gradient_is_that_of_differences(case, family):
    density = whitened_density(regression(case), family(**hyperparameters()))
    log_density, _ = functions(density)
    for flat in np.random.default_rng(3).normal(size=(4, N_TERMS + 1)):
        slopes = approx_fprime(flat, log_density, 1e-6)
        np.testing.assert_allclose(density.log_density(flat)[1], slopes, atol=1e-4)


@pytest.mark.parametrize("family", POWER)
@pytest.mark.parametrize("case", CASES)
def test_whitened_directions_are_exactly_standard_normal(case, family):
    log_density, _ = functions(whitened_density(regression(case), family(**hyperparameters(kappa=1e4))))
    for flat in np.random.default_rng(2).normal(size=(4, N_TERMS + 1)):
        center = np.append(flat[0], np.zeros(N_TERMS))
        assert log_density(flat) - log_density(center) == pytest.approx(-0.5 * np.sum(flat[1:] ** 2), abs=1e-9)


@pytest.mark.parametrize("family", POWER)
@pytest.mark.parametrize("case", CASES)
def test_chains_start_at_the_mode_of_the_noise_and_the_centre_of_the_directions(case, family):
    density = whitened_density(regression(case), family(**hyperparameters()))
    assert np.all(density.start == 0.0)
    log_density, _ = functions(density)
    grid = np.linspace(-6.0, 6.0, 241)
    values = [log_density(np.append(level, np.zeros(N_TERMS))) for level in grid]
    assert grid[np.argmax(values)] == pytest.approx(0.0, abs=0.05)


@pytest.mark.parametrize("coordinate", [-1e6, 1e6])
def test_far_from_the_mode_the_density_is_not_finite_and_raises_nothing(coordinate):
    density = whitened_density(regression("tall"), ConjugatePrior())
    assert not np.isfinite(density.log_density(np.append(coordinate, np.zeros(N_TERMS)))[0])
