import subprocess
import sys
from functools import cache
from statistics import NormalDist

import arviz as az
import numpy as np
import pymc as pm
import pytest

from pymc_ship.inference.regression.conjugate import ConjugatePrior
from pymc_ship.inference.regression.semiconjugate import SemiConjugatePrior
from pymc_ship.inference.regression.tree import exact_posterior, read_posterior, write_posterior
from pymc_ship.inference.sampling.prior_laws import horseshoe
from pymc_ship.inference.sampling.regression_model import nuts_posterior, pymc_model
from tests.inference.sampling.cases import POWER, flat_functions, hyperparameters, log_density_error, regression
from tests.sentences import refused

CASES = ("tall", "zscored", "wide")
SAMPLED = (pytest.param("tall", marks=pytest.mark.consistency), "zscored", "wide")
"""The cases, of which the first two differ in their scales alone."""


@pytest.mark.parametrize("family", POWER)
@pytest.mark.parametrize("case", CASES)
def test_log_density_is_prior_times_likelihood_with_constants(case, family):
    data, prior = regression(case), family(**hyperparameters())
    error = log_density_error(flat_functions(pymc_model(data, prior)), data, prior, np.random.default_rng(1))
    assert error < 1e-7


@pytest.mark.parametrize("wrong", [{"scale": 1.0 / 9.0}, {"kappa": hyperparameters()["kappa"] ** 2}, {"shape": 9.0}])
def test_a_wrong_prior_has_another_log_density(wrong):
    data, prior = regression("tall"), ConjugatePrior(**hyperparameters())
    model = pymc_model(data, ConjugatePrior(**hyperparameters(**wrong)))
    assert log_density_error(flat_functions(model), data, prior, np.random.default_rng(1)) > 1e-3


def test_the_model_has_named_dims():
    data = regression("zscored")
    model = pymc_model(data, ConjugatePrior())
    assert model.coords["coefficient"] == data.coefficients
    assert model.coords["row"] == tuple(range(data.n_rows))
    assert model.named_vars_to_dims["coefficients"] == ("coefficient",)
    assert model.named_vars_to_dims["response"] == ("row",)
    assert np.array_equal(model["observed_response"].get_value(), data.response)


@pytest.mark.parametrize("prior", [ConjugatePrior(kappa=100.0), horseshoe])
@pytest.mark.parametrize("errors", ["normal", "student_t", "ar1"])
def test_chains_start_at_the_fit(prior, errors):
    """Not at the mean of the prior, many posterior standard deviations away in the coordinates of the model."""
    start = pymc_model(regression("zscored"), prior, errors).initial_point()
    np.testing.assert_allclose(start["scaled_coefficients_linear__"], 0.0, atol=1e-9)


def test_variational_inference_and_the_mode_agree_with_the_exact_posterior():
    """From the defaults of PyMC; the mean-field approximation is nearly exact in these coordinates."""
    data, prior = regression("zscored"), ConjugatePrior(kappa=100.0)
    exact = prior.exact(data)
    sd = np.sqrt(np.diag(exact.covariance))
    with pymc_model(data, prior):
        drawn = pm.fit(10000, progressbar=False, random_seed=1).sample(2000, random_seed=1)
        mode = pm.find_MAP(progressbar=False, jitter=False, return_inferencedata=True)
    for tree in (drawn, mode):
        coefficients = tree["posterior"]["coefficients"].mean(("chain", "draw")).to_numpy()
        assert np.abs((coefficients - exact.mean) / sd).max() < 0.3


@cache
def nuts(case, family, sampler=None):
    rng, prior = np.random.default_rng(7), family(**hyperparameters())
    return nuts_posterior(regression(case), prior, draws=2000, rng=rng, sampler=sampler)


def conjugate_moments(data, prior):
    """Mean and sd of the coefficients and the noise variance on the original scale, from the normal equations."""
    X, y = data.scaled_design_matrix, data.scaled_response
    precision = np.diag(1.0 / prior.kappa)
    covariance = np.linalg.inv(precision + X.T @ X)
    mean = covariance @ (precision @ prior.mean + X.T @ y)
    shape = prior.shape + 0.5 * len(y)
    scale = prior.scale + 0.5 * (np.sum((y - X @ mean) ** 2) + np.sum((mean - prior.mean) ** 2 / prior.kappa))
    noise = scale / (shape - 1.0) * data.response_scale**2
    T = data.transformation[1]
    sd = np.sqrt(np.diag(T @ covariance @ T.T) * scale / (shape - 1.0))
    return np.append(data.to_original(mean), noise), np.append(sd, noise / np.sqrt(shape - 2.0))


def z_scores(tree, mean, sd):
    """Errors of the means and standard deviations of draws in Monte Carlo standard errors, and their limit."""
    posterior = tree["posterior"].dataset
    draws = np.dstack([posterior["coefficients"], posterior["noise_variance"]])
    errors = [draws.mean((0, 1)) - mean, draws.std((0, 1), ddof=1) - sd]
    mcse = [[az.mcse(draws[..., j], method=method) for j in range(draws.shape[2])] for method in ("mean", "sd")]
    z = np.abs(np.array(errors) / np.array(mcse))
    return z, NormalDist().inv_cdf(1.0 - 0.5e-3 / z.size)


def check_convergence(tree):
    posterior = tree["posterior"].dataset
    assert max(az.rhat(posterior["coefficients"]).max(), az.rhat(posterior["noise_variance"])) < 1.01
    assert az.ess(posterior["coefficients"]).min() > 1000
    assert not tree["sample_stats"]["diverging"].any()
    assert not tree["sample_stats"]["reached_max_treedepth"].any()


@pytest.mark.slow
@pytest.mark.parametrize("case", SAMPLED)
def test_nuts_agrees_with_the_closed_form(case):
    tree = nuts(case, ConjugatePrior)
    z, limit = z_scores(tree, *conjugate_moments(regression(case), ConjugatePrior(**hyperparameters())))
    assert z.max() < limit
    check_convergence(tree)
    assert tree["sample_stats"]["n_steps"].mean() < 8


@pytest.mark.slow
@pytest.mark.parametrize("wrong", [{"scale": 1.0 / 9.0}, {"shape": 12.0}, {"kappa": hyperparameters()["kappa"] ** 2}])
def test_nuts_under_another_prior_fails(wrong):
    mean, sd = conjugate_moments(regression("tall"), ConjugatePrior(**hyperparameters(**wrong)))
    z, limit = z_scores(nuts("tall", ConjugatePrior), mean, sd)
    assert z.max() > limit


@pytest.mark.slow
@pytest.mark.parametrize("case", SAMPLED)
def test_nuts_agrees_with_quadrature(case):
    exact = SemiConjugatePrior(**hyperparameters()).exact(regression(case))
    tree = nuts(case, SemiConjugatePrior)
    mean, sd = np.append(exact.mean, exact.noise_variance_mean), np.append(exact.sd, exact.noise_variance_sd)
    z, limit = z_scores(tree, mean, sd)
    assert z.max() < limit
    check_convergence(tree)


@pytest.mark.slow
def test_the_sampler_of_pymc_on_the_model_agrees_with_the_closed_form():
    tree = nuts("zscored", ConjugatePrior, "pymc")
    z, limit = z_scores(tree, *conjugate_moments(regression("zscored"), ConjugatePrior(**hyperparameters())))
    assert z.max() < limit
    check_convergence(tree)
    assert tree["sample_stats"].attrs["inference_library"] == "pymc"
    usual = nuts("zscored", ConjugatePrior)["sample_stats"].dataset
    assert {name: value.dtype for name, value in tree["sample_stats"].data_vars.items()} == {
        name: value.dtype for name, value in usual.data_vars.items()
    }


@pytest.mark.slow
def test_draws_depend_on_seed_data_and_prior_alone():
    data, prior = regression("tall"), SemiConjugatePrior(**hyperparameters())

    def draw(seed, data=data, prior=prior):
        tree = nuts_posterior(data, prior, draws=20, tune=100, chains=2, rng=np.random.default_rng(seed))
        return tree["posterior"]["coefficients"].values

    first = draw(3)
    assert not np.array_equal(draw(4), first)
    assert not np.array_equal(draw(3, regression("zscored"), ConjugatePrior()), first)
    assert np.array_equal(draw(3), first)


@pytest.mark.slow
def test_layout_is_that_of_every_posterior():
    data, prior = regression("zscored"), ConjugatePrior(**hyperparameters())
    rng = np.random.default_rng(5)
    tree = nuts_posterior(data, prior, draws=10, tune=100, chains=3, rng=rng)
    exact = exact_posterior(data, prior, draws=30, chains=3, rng=rng)
    checks = {"prior", "prior_predictive", "posterior_predictive"}
    assert set(tree.children) == set(exact.children) | checks | {"sample_stats"}
    for name, group in exact.children.items():
        for variable, value in group.dataset.variables.items():
            variable_of_tree = tree[name].dataset.variables[variable]
            assert (variable_of_tree.dims, variable_of_tree.shape, variable_of_tree.dtype) == (
                value.dims,
                value.shape,
                value.dtype,
            )
    assert set(tree.attrs) == set(exact.attrs)
    assert tree.attrs["method"] == "nuts"
    assert {value.dims for value in tree["sample_stats"].data_vars.values()} == {("chain", "draw")}


@pytest.mark.slow
def test_netcdf_keeps_the_sampler_statistics(tmp_path):
    rng = np.random.default_rng(5)
    tree = nuts_posterior(regression("tall"), ConjugatePrior(), draws=10, tune=100, chains=2, rng=rng)
    stats_read = read_posterior(write_posterior(tree, tmp_path / "nuts.nc"))["sample_stats"].dataset
    assert stats_read.identical(tree["sample_stats"].dataset)
    assert stats_read["diverging"].dtype == bool


@pytest.mark.slow
def test_sampling_is_silent(capfd, caplog):
    nuts_posterior(regression("tall"), ConjugatePrior(), draws=10, tune=100, rng=np.random.default_rng(6))
    assert tuple(capfd.readouterr()) == ("", "")
    assert not caplog.records


def test_a_text_does_not_switch_progress_on():
    with refused(ValueError, "progress", "no"):
        nuts_posterior(regression("tall"), ConjugatePrior(), draws=10, tune=10, rng=1, progress="no")


def test_neither_import_nor_nuts_of_normal_errors_loads_pymc():
    """Whose import and compilation take longer than the draws."""
    code = "import sys, pymc_ship.inference.sampling.regression_model, pymc_ship.diagnostics.page\n"
    code += "print({'pymc', 'nutpie', 'arviz'} & set(sys.modules))\n"
    code += "import numpy, pymc_ship as ps\n"
    code += "data = ps.RegressionData.from_arrays(numpy.eye(6)[:, :2], numpy.arange(6.0))\n"
    code += "ps.nuts_posterior(data, ps.ConjugatePrior(), draws=10, tune=100, chains=1, rng=1)\n"
    code += "print({'pymc', 'pytensor'} & set(sys.modules))\n"
    printed = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True).stdout
    assert printed.split("\n") == ["set()", "set()", ""]
