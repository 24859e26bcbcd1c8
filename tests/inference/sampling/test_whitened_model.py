import numpy as np
import pytest

from pymc_ship.inference.regression.conjugate import ConjugatePrior
from pymc_ship.inference.sampling.whitened_model import whitened_model
from tests.inference.sampling.cases import (
    N_TERMS,
    POWER,
    flat_functions,
    hyperparameters,
    log_density_error,
    regression,
)

CASES = ("tall", "zscored", "wide")


@pytest.mark.parametrize("family", POWER)
@pytest.mark.parametrize("case", CASES)
def test_log_density_is_prior_times_likelihood_with_constants(case, family):
    data, prior = regression(case), family(**hyperparameters())
    assert log_density_error(whitened_model(data, prior), data, prior, np.random.default_rng(1)) < 1e-7


@pytest.mark.parametrize("wrong", [{"scale": 1.0 / 9.0}, {"kappa": hyperparameters()["kappa"] ** 2}, {"shape": 9.0}])
def test_a_wrong_prior_has_another_log_density(wrong):
    data, prior = regression("tall"), ConjugatePrior(**hyperparameters())
    model = whitened_model(data, ConjugatePrior(**hyperparameters(**wrong)))
    assert log_density_error(model, data, prior, np.random.default_rng(1)) > 1e-3


@pytest.mark.parametrize("family", POWER)
@pytest.mark.parametrize("case", CASES)
def test_whitened_directions_are_exactly_standard_normal(case, family):
    model = whitened_model(regression(case), family(**hyperparameters(kappa=1e4)))
    log_density, _ = flat_functions(model)
    for flat in np.random.default_rng(2).normal(size=(4, N_TERMS + 1)):
        center = np.append(flat[0], np.zeros(N_TERMS))
        assert model.value_vars[0].name == "noise_coordinate"
        assert log_density(flat) - log_density(center) == pytest.approx(-0.5 * np.sum(flat[1:] ** 2), abs=1e-9)


@pytest.mark.parametrize("family", POWER)
@pytest.mark.parametrize("case", CASES)
def test_chains_start_at_the_mode_of_the_noise_and_the_centre_of_the_directions(case, family):
    model = whitened_model(regression(case), family(**hyperparameters()))
    assert all(np.all(value == 0.0) for value in model.initial_point().values())
    log_density, _ = flat_functions(model)
    grid = np.linspace(-6.0, 6.0, 241)
    density = [log_density(np.append(level, np.zeros(N_TERMS))) for level in grid]
    assert grid[np.argmax(density)] == pytest.approx(0.0, abs=0.05)
