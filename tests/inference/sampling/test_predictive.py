import warnings
from dataclasses import replace

import arviz as az
import matplotlib
import numpy as np
import pytest
import xarray as xr
from scipy import stats

import pymc_ship as ps
from pymc_ship.inference.regression.conjugate import ConjugatePrior
from pymc_ship.inference.regression.semiconjugate import SemiConjugatePrior
from pymc_ship.inference.regression.tree import exact_posterior, read_posterior, write_posterior
from pymc_ship.inference.sampling.error_laws import ERRORS
from pymc_ship.inference.sampling.gibbs import gibbs_posterior
from pymc_ship.inference.sampling.predictive import PREDICTIVE_DRAWS, predict, predictive, prior_draws, with_predictive
from tests.inference.sampling.cases import hyperparameters, regression
from tests.sentences import refused

FAMILIES = (ConjugatePrior, SemiConjugatePrior)
LIMIT = 4.8
"""Two-sided normal quantile at 1e-3 for some 600 comparisons."""


def tree_of(family, case="zscored", draws=4000):
    data, prior = regression(case), family(**hyperparameters())
    return data, prior, exact_posterior(data, prior, draws=draws, rng=np.random.default_rng(1))


def z_of_moments(draws, mean, sd):
    """z-scores of mean and variance of independent draws, shape (n, ...), with errors estimated from them."""
    square = (draws - mean) ** 2
    root = np.sqrt(len(draws))
    return np.abs((draws.mean(0) - mean) / draws.std(0) * root), np.abs((square.mean(0) - sd**2) / square.std(0) * root)


@pytest.mark.parametrize("case", ["tall", "zscored", "wide"])
@pytest.mark.parametrize("family", FAMILIES)
def test_posterior_predictive_has_the_exact_mean_and_variance(family, case):
    data, prior, tree = tree_of(family, case)
    mean, sd = prior.exact(data).predict(data.design_matrix)
    checked = with_predictive(tree, data, prior, rng=np.random.default_rng(2), draws=4000)
    response = checked["posterior_predictive"]["response"].values.reshape(4000, -1)
    z_mean, z_variance = z_of_moments(response, mean, sd)
    assert max(z_mean.max(), z_variance.max()) < LIMIT


@pytest.mark.parametrize("family", FAMILIES)
def test_predictions_without_noise_or_under_another_prior_fail(family):
    data, prior, tree = tree_of(family)
    mean, sd = prior.exact(data).predict(data.design_matrix)
    fit = tree["posterior"]["coefficients"].values.reshape(4000, -1) @ data.design_matrix.T
    assert z_of_moments(fit, mean, sd)[1].max() > LIMIT

    data, prior, tree = tree_of(family, "wide")
    _, sd = prior.exact(data).predict(data.design_matrix)
    wrong = family(**hyperparameters(mean=np.array([0.0, 0.3, -0.2, 1.0, 5.0])))
    mean, _ = wrong.exact(data).predict(data.design_matrix)
    checked = with_predictive(tree, data, prior, rng=np.random.default_rng(2), draws=4000)
    assert z_of_moments(checked["posterior_predictive"]["response"].values.reshape(4000, -1), mean, sd)[0].max() > LIMIT


@pytest.mark.parametrize("family", FAMILIES)
def test_prior_draws_follow_the_prior(family):
    data, prior = regression("zscored"), family(**hyperparameters())
    drawn = prior_draws(data, prior, 4000, rng=np.random.default_rng(3))
    variance = drawn["noise_variance"].values[0] / data.response_scale**2
    scaled = data.to_scaled(drawn["coefficients"].values[0])
    factor = np.sqrt(variance)[:, None] if family is ConjugatePrior else 1.0
    standard = (scaled - prior.mean) / np.sqrt(prior.kappa) / factor
    p = [stats.kstest(column, "norm").pvalue for column in standard.T]
    p.append(stats.kstest(variance, stats.invgamma(prior.shape, scale=prior.scale).cdf).pvalue)
    assert min(p) > 1e-4
    assert stats.kstest(variance, stats.invgamma(prior.shape, scale=1.0 / prior.scale).cdf).pvalue < 1e-4
    parted = np.corrcoef(np.abs(scaled - prior.mean)[:, 0], np.sqrt(variance))[0, 1]
    assert (parted > 0.1) == (family is ConjugatePrior)


@pytest.mark.parametrize("family", FAMILIES)
def test_prior_predictive_has_the_mean_and_variance_of_the_prior(family):
    data, prior = regression("tall"), family(**hyperparameters())
    drawn = prior_draws(data, prior, 8000, rng=np.random.default_rng(4))
    response = predictive(data, drawn, rng=np.random.default_rng(5))["response"].values[0]
    noise = prior.scale / (prior.shape - 1.0)
    explained = data.design_matrix**2 @ prior.kappa * (noise if family is ConjugatePrior else 1.0)
    z_mean, z_variance = z_of_moments(response, data.design_matrix @ prior.mean, np.sqrt(explained + noise))
    assert max(z_mean.max(), z_variance.max()) < LIMIT


def test_errors_of_each_law_have_their_variance_and_correlation():
    rng, n = np.random.default_rng(6), 20000
    sd = np.full((1, n), 2.0)
    t = ERRORS["student_t"].draw_errors(rng, sd, np.full((1, n), 6.0), 3)[0]
    assert min(stats.kstest(column / 2.0, stats.t(6.0).cdf).pvalue for column in t.T) > 1e-4
    ar1 = ERRORS["ar1"].draw_errors(rng, sd, np.full((1, n), -0.7), 5)[0]
    expected = 4.0 * (-0.7) ** np.abs(np.subtract.outer(np.arange(5), np.arange(5)))
    assert np.abs(np.cov(ar1.T) - expected).max() < 5.0 * 4.0 * np.sqrt(2.0 / n)


@pytest.mark.parametrize("errors", ["student_t", "ar1"])
def test_prior_of_the_errors_parameter(errors):
    drawn = prior_draws(regression("tall"), ConjugatePrior(), 4000, rng=np.random.default_rng(7), errors=errors)
    law = stats.gamma(2.0, scale=10.0) if errors == "student_t" else stats.uniform(-1.0, 2.0)
    assert stats.kstest(drawn[ERRORS[errors].parameter].values[0], law.cdf).pvalue > 1e-4
    response = predictive(regression("tall"), drawn, rng=np.random.default_rng(8), errors=errors)["response"]
    assert np.isfinite(response).all()


def test_layout():
    data, prior, tree = tree_of(ConjugatePrior)
    checked = with_predictive(tree, data, prior, rng=np.random.default_rng(9))
    assert set(checked.children) - set(tree.children) == {"prior", "prior_predictive", "posterior_predictive"}
    assert all(checked[name].identical(group) for name, group in tree.children.items())
    assert checked.attrs == tree.attrs
    posterior, drawn = checked["posterior"].dataset, checked["prior"].dataset
    assert {name: value.dims for name, value in drawn.items()} == {n: v.dims for n, v in posterior.items()}
    predicted = checked["posterior_predictive"]["response"]
    assert predicted.dims == checked["prior_predictive"]["response"].dims == ("chain", "draw", "row")
    assert predicted.shape == (4, 1000, data.n_rows)
    assert checked["prior_predictive"]["response"].shape == (1, PREDICTIVE_DRAWS, data.n_rows)
    assert predicted["draw"].equals(posterior["draw"])
    residual = predicted - checked["constant_data"]["design_matrix"].dot(posterior["coefficients"])
    assert float(residual.var()) == pytest.approx(float(posterior["noise_variance"].mean()), rel=0.05)


def test_same_seed_same_draws_and_round_trip(tmp_path):
    data, prior = regression("tall"), SemiConjugatePrior(**hyperparameters())
    tree = gibbs_posterior(data, prior, draws=50, chains=2, rng=np.random.default_rng(1))
    first, again, other = (with_predictive(tree, data, prior, rng=np.random.default_rng(seed)) for seed in (1, 1, 2))
    assert first.identical(again)
    for group, name in (
        ("prior", "coefficients"),
        ("prior_predictive", "response"),
        ("posterior_predictive", "response"),
    ):
        assert not np.array_equal(first[group][name], other[group][name])
    assert read_posterior(write_posterior(first, tmp_path / "tree.nc")).identical(first)
    assert read_posterior(write_posterior(first, tmp_path / "tree.zarr")).identical(first)


def test_predictive_checks_of_arviz_run():
    matplotlib.use("agg")
    data, prior, tree = tree_of(ConjugatePrior)
    checked = with_predictive(tree, data, prior, rng=np.random.default_rng(9))
    for group in ("prior_predictive", "posterior_predictive"):
        az.plot_ppc_dist(checked, group=group, backend="matplotlib", num_samples=20)
    az.plot_prior_posterior(checked, var_names=["noise_variance"], backend="matplotlib")
    matplotlib.pyplot.close("all")


def test_a_nearly_improper_prior_gives_finite_draws():
    drawn = prior_draws(regression("tall"), ConjugatePrior(shape=1e-3, scale=1e-3), 500, rng=np.random.default_rng(1))
    assert all(np.isfinite(value).all() for value in drawn.values())


def test_predictions_need_the_rows_of_the_fit():
    """Names and number of rows may be those of other data."""
    data, prior, tree = tree_of(ConjugatePrior, draws=40)
    for other in (replace(data, response=2.0 * data.response), replace(data, design_matrix=data.design_matrix + 1e-3)):
        part = "response" if other.response is not data.response else "design"
        for use in (
            lambda other=other: with_predictive(tree, other, prior, rng=1),
            lambda other=other: predict(tree, [], data=other, rng=1),
        ):
            with refused(ValueError, part):
                use()
    for other in (replace(prior, kappa=2.0 * prior.kappa), replace(prior, mean=prior.mean + 1.0)):
        with refused(ValueError, "kappa" if np.all(other.mean == prior.mean) else "mean"):
            with_predictive(tree, data, other, rng=1)
    with refused(ValueError, "family"):
        with_predictive(tree, data, SemiConjugatePrior(**hyperparameters()), rng=1)
    rounded = replace(data, response=data.response * (1.0 + 1e-15))
    assert with_predictive(tree, rounded, prior, rng=1).identical(with_predictive(tree, data, prior, rng=1))


def test_coefficients_restored_one_after_the_other_are_those_restored_at_once():
    data, prior, fixed = regression("tall"), ConjugatePrior(), {"x1": -1.0, "x2": 0.4}
    free = exact_posterior(ps.hold_fixed(data, fixed), prior, draws=40, rng=1)
    once = ps.restore_fixed(free, fixed, data.coefficients)
    twice = ps.restore_fixed(ps.restore_fixed(free, {"x2": 0.4}), {"x1": -1.0}, data.coefficients)
    found, expected = (predict(tree, data.design_matrix, data=data, rng=1) for tree in (twice, once))
    xr.testing.assert_identical(found, expected)
    assert with_predictive(twice, data, prior, rng=1)["prior"].equals(
        with_predictive(once, data, prior, rng=1)["prior"]
    )


def test_a_restored_posterior_predicts_the_observed_data():
    """Which are without the fixed part."""
    data, prior = regression("tall"), ConjugatePrior()
    free = ps.gibbs_posterior(ps.hold_fixed(data, {"x2": 0.4}), prior, draws=50, rng=1)
    checked = with_predictive(ps.restore_fixed(free, {"x2": 0.4}, data.coefficients), data, prior, rng=2)
    observed = checked["observed_data"]["response"]
    residual = checked["posterior_predictive"]["response"].mean(("chain", "draw")) - observed
    assert np.abs(residual).max() < 5.0 * float(free["posterior"]["noise_variance"].mean()) ** 0.5
    assert np.corrcoef(observed, data.response)[0, 1] < 1.0
    drawn, posterior = checked["prior"]["coefficients"], checked["posterior"]["coefficients"]
    assert drawn["coefficient"].equals(posterior["coefficient"])
    assert (drawn.std(("chain", "draw")) > 1e-9).values.tolist() == [True, False, True, True, True]
    assert (drawn.sel(coefficient="x2") == 0.4).all()


@pytest.mark.parametrize("fixed", [{}, {"x2": 0.4}])
def test_a_log_likelihood_that_was_left_out_comes_back(fixed):
    data, prior = regression("tall"), ConjugatePrior()
    tree = ps.gibbs_posterior(ps.hold_fixed(data, fixed) if fixed else data, prior, draws=50, rng=1)
    if fixed:
        tree = ps.restore_fixed(tree, fixed, data.coefficients)
    checked = with_predictive(tree.drop_nodes("log_likelihood"), data, prior, rng=2)
    again, stored = (one["log_likelihood"].to_dataset() for one in (checked, tree))
    xr.testing.assert_allclose(again, stored, rtol=1e-9)


def test_the_order_of_dims_changes_nothing():
    data, prior, tree = tree_of(ConjugatePrior, draws=40)
    turned = tree.copy()
    turned["posterior"] = tree["posterior"].to_dataset().transpose("coefficient", "draw", "chain")
    found, expected = (with_predictive(one, data, prior, rng=1)["posterior_predictive"] for one in (turned, tree))
    assert found.identical(expected)
    found, expected = (predict(one, data.design_matrix[:3], rng=1) for one in (turned, tree))
    assert found.identical(expected)


def with_draws(tree, **draws):
    return tree.assign({"posterior": xr.DataTree(tree["posterior"].to_dataset().assign(draws))})


def test_broken_draws_predict_nothing():
    data, prior, tree = tree_of(ConjugatePrior, draws=40)
    posterior = tree["posterior"].to_dataset()
    broken = {
        "NaN": {"coefficients": posterior["coefficients"].where(posterior["draw"] > 3)},
        "positive": {"noise_variance": -posterior["noise_variance"]},
        "dims": {"coefficients": posterior["coefficients"].isel(chain=0)},
    }
    for word, draws in broken.items():
        with refused(ps.InferenceError, word):
            predict(with_draws(tree, **draws), data.design_matrix, rng=1)
        with refused(ps.InferenceError, word):
            with_predictive(with_draws(tree, **draws), data, prior, rng=1)


def test_chains_of_two_fits_are_told():
    """Their mean is that of neither; chains of one fit are quiet, short ones also."""
    data, _, tree = tree_of(ConjugatePrior, draws=40)
    apart = np.array([0.0, 0.0, 1.0, 1.0])[:, None, None]
    predict(tree, data.design_matrix, rng=1)
    joined = with_draws(tree, coefficients=tree["posterior"]["coefficients"] + apart)
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        predict(joined, data.design_matrix, rng=1)
    assert [one.category for one in caught] == [UserWarning]
