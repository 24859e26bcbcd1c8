from dataclasses import replace
from functools import cache
from statistics import NormalDist

import arviz as az
import numpy as np
import nutpie
import pytest
import xarray as xr
from scipy import linalg, stats

from pymc_ship.inference.regression.conjugate import ConjugatePrior
from pymc_ship.inference.regression.tree import read_posterior, write_posterior
from pymc_ship.inference.rows.data import RegressionData
from pymc_ship.inference.sampling.error_laws import ERRORS, draw_errors, log_likelihood
from pymc_ship.inference.sampling.regression_model import nuts_posterior, pymc_model
from tests.inference.sampling.cases import N_TERMS, POWER, hyperparameters, log_volume, regression, scaled_parameters

pytestmark = pytest.mark.slow

PARAMETER = {"student_t": "degrees_of_freedom", "ar1": "autocorrelation"}
TRUE = np.array([1.0, -2.0, 0.5, 3.0, 0.0])


def log_rows(errors, residual, noise_variance, parameter):
    """Joint log density of the rows, from scipy; that of AR(1) from its covariance matrix."""
    if errors == "student_t":
        return stats.t.logpdf(residual, parameter, scale=np.sqrt(noise_variance)).sum()
    covariance = noise_variance * linalg.toeplitz(parameter ** np.arange(len(residual)))
    return stats.multivariate_normal.logpdf(residual, cov=covariance)


def log_prior(prior, scaled, variance, errors, parameter):
    spread = np.sqrt(prior.kappa * variance ** POWER[type(prior)])
    density = stats.invgamma.logpdf(variance, prior.shape, scale=prior.scale)
    density += stats.norm.logpdf(scaled, prior.mean, spread).sum()
    law = stats.gamma(2.0, scale=10.0) if errors == "student_t" else stats.uniform(-1.0, 2.0)
    return density + law.logpdf(parameter)


def density_and_parameters(model, errors):
    """Log density of the model, and its parameters on the original scale, as functions of one flat vector."""
    values = model.value_vars
    start = model.initial_point()
    splits = np.cumsum([np.size(start[value.name]) for value in values])[:-1]
    wanted = [model["coefficients"], model["noise_variance"], model[PARAMETER[errors]]]
    outputs = model.replace_rvs_by_values(wanted)
    parameters = model.compile_fn(outputs, inputs=values, on_unused_input="ignore", mode="FAST_COMPILE")
    log_density = model.compile_logp(mode="FAST_COMPILE")

    def point(flat):
        pieces = np.split(flat, splits)
        return {v.name: piece.reshape(np.shape(start[v.name])) for v, piece in zip(values, pieces, strict=True)}

    return lambda flat: float(log_density(point(flat))), lambda flat: parameters(point(flat))


def density_error(model, data, prior, errors, twist=lambda parameter: parameter):
    """Largest relative error over random points of the model's log density against prior, likelihood and Jacobian."""
    log_density, parameters = density_and_parameters(model, errors)

    def scaled(flat):
        coefficients, noise_variance, parameter = parameters(flat)
        return np.append(scaled_parameters(data, coefficients, noise_variance), parameter)

    errors_of_density = []
    for flat in np.random.default_rng(1).normal(size=(3, N_TERMS + 2)):
        coefficients, noise_variance, parameter = parameters(flat)
        *own, variance, _ = scaled(flat)
        residual = data.response - data.design_matrix @ coefficients
        expected = log_rows(errors, residual, noise_variance, twist(parameter)) + log_volume(scaled, flat)
        expected += log_prior(prior, np.array(own), variance, errors, parameter)
        errors_of_density.append(abs(log_density(flat) - expected) / max(1.0, abs(expected)))
    return max(errors_of_density)


@pytest.mark.parametrize("family", POWER)
@pytest.mark.parametrize("case", ["tall", "zscored", "wide"])
@pytest.mark.parametrize("errors", PARAMETER)
def test_log_density_is_prior_times_likelihood_with_constants(errors, case, family):
    data, prior = regression(case), family(**hyperparameters())
    assert density_error(pymc_model(data, prior, errors), data, prior, errors) < 1e-6


@pytest.mark.parametrize("errors", PARAMETER)
def test_another_parameter_has_another_log_density(errors):
    data, prior = regression("tall"), ConjugatePrior(**hyperparameters())
    model = pymc_model(data, prior, errors)
    assert density_error(model, data, prior, errors, twist=lambda parameter: 0.9 * parameter) > 1e-4


@pytest.mark.parametrize("errors", PARAMETER)
def test_log_likelihood_of_the_rows_adds_up_to_the_joint_one(errors):
    residual = np.random.default_rng(2).normal(size=(2, 3, 20))
    noise_variance = np.array([[0.5, 1.0, 2.0], [0.1, 3.0, 1.5]])
    parameter = np.array([[3.0, 50.0, 0.7], [8.0, 1.0, 200.0]]) if errors == "student_t" else 0.4 * noise_variance - 0.6
    rows = ERRORS[errors].log_likelihood(residual.copy(), noise_variance, parameter)
    assert rows.shape == residual.shape
    for index in np.ndindex(2, 3):
        expected = log_rows(errors, residual[index], noise_variance[index], parameter[index])
        assert rows[index].sum() == pytest.approx(expected, rel=1e-10)


def test_the_laws_have_the_normal_law_as_limit():
    residual, variance = np.random.default_rng(2).normal(size=(2, 20)), np.array([0.5, 2.0])

    def rows(errors, parameter):
        return ERRORS[errors].log_likelihood(residual.copy(), variance, parameter)

    normal = rows("normal", None)
    assert rows("ar1", np.zeros(2)) == pytest.approx(normal, abs=1e-12)
    assert rows("student_t", np.full(2, 1e9)) == pytest.approx(normal, abs=1e-6)


@pytest.mark.parametrize("errors", PARAMETER)
def test_log_prior_of_the_parameter_is_a_density(errors):
    grid = np.linspace(1e-9, 400.0, 400001) if errors == "student_t" else np.linspace(-1.0, 1.0, 1001)
    assert np.trapezoid(np.exp(ERRORS[errors].log_parameter(grid)), grid) == pytest.approx(1.0, abs=1e-6)


def noise(errors, parameter, n_rows, rng):
    if errors == "student_t":
        return rng.standard_t(parameter, n_rows) if np.isfinite(parameter) else rng.normal(size=n_rows)
    e = rng.normal(size=n_rows)
    for t in range(1, n_rows):
        e[t] = parameter * e[t - 1] + np.sqrt(1.0 - parameter**2) * e[t]
    return e


def simulated_rows(errors, parameter, seed, n_rows=200):
    """Rows with slow columns, as a ship's, and errors of the given law."""
    rng = np.random.default_rng(seed)
    slow = np.sin(
        np.arange(n_rows)[:, None] * 2.0 * np.pi / rng.uniform(30.0, 120.0, N_TERMS) + rng.uniform(0, 6, N_TERMS)
    )
    X = slow + 0.1 * rng.normal(size=(n_rows, N_TERMS))
    return RegressionData.from_arrays(X, X @ TRUE + noise(errors, parameter, n_rows, rng), scaling="none")


def fit(data, errors, prior=None, **options):
    options = {"rng": np.random.default_rng(11), "draws": 500, "tune": 500} | options
    return nuts_posterior(data, prior or ConjugatePrior(), errors=errors, **options)


def moments(tree, name="coefficients"):
    draws = tree["posterior"][name]
    return draws.mean(("chain", "draw")).values, draws.std(("chain", "draw"), ddof=1).values


def exact_ar1(data, prior):
    """Posterior mean of coefficients and autocorrelation: quadrature over rho of the conjugate posterior of each."""
    grid = np.linspace(-0.999, 0.999, 1500)
    log_weight, means = [], []
    for rho in grid:
        root = np.sqrt(1.0 - rho**2)
        X, y = (np.concatenate([v[:1], (v[1:] - rho * v[:-1]) / root]) for v in (data.design_matrix, data.response))
        exact = prior.exact(RegressionData.from_arrays(X, y, scaling="none"))
        log_weight.append(exact.log_evidence - (data.n_rows - 1) * np.log(root))
        means.append(np.append(exact.mean, [exact.noise_variance_mean, rho]))
    weight = np.exp(np.array(log_weight) - max(log_weight))
    return weight @ np.array(means) / weight.sum()


@cache
def ar1_case(sampler=None):
    options = {"sampler": sampler, "draws": 1500, "tune": 1000}
    return fit(simulated_rows("ar1", 0.8, 3), "ar1", ConjugatePrior(**hyperparameters()), **options)


def z_scores(tree, exact, names):
    """|mean - exact| over its Monte Carlo standard error, and the limit for as many comparisons."""
    posterior = tree["posterior"].dataset
    mean = np.concatenate([np.atleast_1d(posterior[name].mean(("chain", "draw"))) for name in names])
    mcse = np.concatenate([np.atleast_1d(az.mcse(posterior[name])) for name in names])
    return np.abs(mean - exact) / mcse, NormalDist().inv_cdf(1.0 - 0.5e-3 / len(mean))


NAMES = ("coefficients", "noise_variance", "autocorrelation")


@pytest.mark.consistency
def test_ar1_agrees_with_quadrature_over_the_autocorrelation():
    data, prior, tree = simulated_rows("ar1", 0.8, 3), ConjugatePrior(**hyperparameters()), ar1_case()
    z, limit = z_scores(tree, exact_ar1(data, prior), NAMES)
    assert z.max() < limit
    assert az.rhat(tree["posterior"]["autocorrelation"]) < 1.01
    assert not tree["sample_stats"]["diverging"].any()
    assert tree["sample_stats"]["n_steps"].mean() < 16


@pytest.mark.slow
@pytest.mark.consistency
def test_chains_reach_an_autocorrelation_near_one():
    """As in denoised ship data; from rho = 0 a chain may end at -1."""
    tree = fit(simulated_rows("ar1", 0.995, 7, n_rows=400), "ar1", draws=1000, tune=1000)
    assert az.rhat(tree["posterior"]["autocorrelation"]) < 1.02
    assert tree["posterior"]["autocorrelation"].min() > 0.9


@pytest.mark.slow
@pytest.mark.consistency
def test_ar1_under_another_prior_fails():
    wrong = ConjugatePrior(**hyperparameters(scale=30.0))
    z, limit = z_scores(ar1_case(), exact_ar1(simulated_rows("ar1", 0.8, 3), wrong), NAMES)
    assert z.max() > limit


@pytest.mark.slow
@pytest.mark.consistency
def test_student_t_on_normal_errors_is_the_normal_fit():
    """The t estimate has an efficiency of 0.99 or so at nu = 20: its distance from the normal one is about 0.1 sd."""
    data = simulated_rows("student_t", np.inf, 4, n_rows=400)
    exact, tree = ConjugatePrior().exact(data), fit(data, "student_t")
    mean, sd = moments(tree)
    assert np.abs((mean - exact.mean) / exact.sd).max() < 0.4
    assert sd == pytest.approx(exact.sd, rel=0.15)
    assert moments(tree, "degrees_of_freedom")[0] > 12.0


@pytest.mark.slow
@pytest.mark.consistency
def test_student_t_recovers_heavy_tails_and_beats_the_normal_fit():
    error, normal_error, scores = 0.0, 0.0, []
    for seed in range(8):
        data = simulated_rows("student_t", 3.0, 100 + seed)
        exact, tree = ConjugatePrior().exact(data), fit(data, "student_t")
        error += np.sum(((moments(tree)[0] - TRUE) / exact.sd) ** 2)
        normal_error += np.sum(((exact.mean - TRUE) / exact.sd) ** 2)
        log_nu = np.log(tree["posterior"]["degrees_of_freedom"].values)
        scores.append((log_nu.mean() - np.log(3.0)) / log_nu.std())
    assert error < 0.8 * normal_error
    assert np.abs(scores).max() < 3.5


@pytest.mark.slow
@pytest.mark.consistency
def test_ar1_is_calibrated_where_the_normal_fit_is_overconfident():
    """Squared z-scores of the coefficients over seeds; the normal fit is the broken twin."""
    square, normal_square, wider, scores = 0.0, 0.0, [], []
    seeds = 10
    for seed in range(seeds):
        data = simulated_rows("ar1", 0.8, 200 + seed)
        exact, tree = ConjugatePrior().exact(data), fit(data, "ar1")
        mean, sd = moments(tree)
        square += np.sum(((mean - TRUE) / sd) ** 2)
        normal_square += np.sum(((exact.mean - TRUE) / exact.sd) ** 2)
        rho, rho_sd = moments(tree, "autocorrelation")
        scores.append((rho - 0.8) / rho_sd)
        wider.append(np.mean(sd / exact.sd))
    low, high = stats.chi2(N_TERMS * seeds).ppf([5e-4, 1.0 - 5e-4])
    assert low < square < high < normal_square
    assert np.abs(scores).max() < 3.5
    assert min(wider) > 1.0


@pytest.mark.slow
@pytest.mark.parametrize("errors", PARAMETER)
def test_layout_draws_and_round_trip(errors, tmp_path, monkeypatch):
    data, name = simulated_rows(errors, 5.0 if errors == "student_t" else 0.5, 5, n_rows=50), PARAMETER[errors]
    options = {"draws": 20, "tune": 100, "chains": 2}
    compiled = nutpie.compile_pymc_model(pymc_model(data, ConjugatePrior(), errors))
    monkeypatch.setattr(nutpie, "compile_pymc_model", lambda model: compiled)  # the same three times
    tree = fit(data, errors, **options)
    posterior, prior = tree["posterior"].dataset, tree["prior"].dataset
    assert set(posterior.data_vars) == set(prior.data_vars) == {"coefficients", "noise_variance", name}
    assert {v: posterior[v].dims for v in posterior} == {v: prior[v].dims for v in prior}
    assert posterior[name].dims == tree["log_prior"][name].dims == ("chain", "draw")
    assert tree.attrs["errors"] == errors
    assert name in tree.attrs["error_prior"]
    residual = data.response - data.design_matrix @ posterior["coefficients"].values[1, 7]
    expected = log_rows(errors, residual, posterior["noise_variance"].values[1, 7], posterior[name].values[1, 7])
    assert float(tree["log_likelihood"]["response"][1, 7].sum()) == pytest.approx(expected)
    again, other = fit(data, errors, **options), fit(data, errors, **options, rng=np.random.default_rng(12))
    assert again.identical(tree)
    assert not np.array_equal(other["posterior"][name], posterior[name])
    assert not np.array_equal(other["prior"][name], prior[name])
    assert read_posterior(write_posterior(tree, tmp_path / "tree.nc")).identical(tree)


@pytest.mark.slow
@pytest.mark.consistency
def test_the_sampler_of_pymc_agrees():
    tree = ar1_case(sampler="pymc")
    z, limit = z_scores(tree, exact_ar1(simulated_rows("ar1", 0.8, 3), ConjugatePrior(**hyperparameters())), NAMES)
    assert z.max() < limit


def two_runs():
    data = regression("tall")
    return replace(data, run=np.repeat(["a", "b"], [25, 35]), time=np.r_[0.0:25.0, 7.0:42.0])


def test_ar1_begins_anew_with_each_run():
    """In the log likelihood and in the model."""
    data = two_runs()
    model = pymc_model(data, ConjugatePrior(), "ar1")
    wanted = model.replace_rvs_by_values([model[name] for name in NAMES])
    density = model.logp(vars=[model["response"]], sum=False)
    values = model.compile_fn([*density, *wanted], inputs=model.value_vars, mode="FAST_COMPILE")
    start = model.initial_point()
    rows, b, variance, rho = values(start | {"autocorrelation_interval__": np.array(1.2)})
    residual = data.response - data.design_matrix @ b
    for run in (slice(0, 25), slice(25, 60)):
        assert rows[run].sum() == pytest.approx(log_rows("ar1", residual[run], variance, rho))
    draw = {"coefficients": (("chain", "draw", "coefficient"), b[None, None])}
    draw |= {"noise_variance": (("chain", "draw"), [[variance]]), "autocorrelation": (("chain", "draw"), [[rho]])}
    assert log_likelihood(data, "ar1", xr.Dataset(draw))[0, 0] == pytest.approx(rows)


def test_drawn_ar1_errors_begin_anew_with_each_run():
    sd, rho = np.ones(4000), np.full(4000, 0.9)
    errors = draw_errors(two_runs(), "ar1", np.random.default_rng(1), sd, rho)
    between = [np.corrcoef(errors[:, k - 1], errors[:, k])[0, 1] for k in (24, 25, 26)]
    assert between == pytest.approx([0.9, 0.0, 0.9], abs=0.08)
