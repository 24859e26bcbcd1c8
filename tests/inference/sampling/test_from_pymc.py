"""Models of one's own: their draws in functions of posteriors and of ArviZ."""

from functools import cache

import arviz as az
import matplotlib.pyplot as plt
import numpy as np
import pymc as pm
import pytest
import xarray as xr

import pymc_ship as ps
from pymc_ship.inference.sampling.error_laws import ERRORS, errors_of
from pymc_ship.inference.sampling.from_pymc import posterior_tree
from pymc_ship.inference.sampling.predictive import prior_draws
from pymc_ship.inference.sampling.regression_model import nuts_posterior, pymc_model
from tests.inference.sampling.cases import hyperparameters, regression
from tests.sentences import refused

SETTINGS = {"draws": 500, "tune": 500, "chains": 4}
DATA, PRIOR = regression("zscored"), ps.ConjugatePrior(**hyperparameters())
HORSESHOE = pytest.param("horseshoe", marks=pytest.mark.consistency)  # docs/how_to/change_the_model.md draws one
PATHS = ("conjugate", "gibbs", "nuts", "own", HORSESHOE)


def laplace(name, mu, sigma, given):
    return pm.Laplace(name, mu, sigma / np.sqrt(2.0), **given)


def plain_model():
    """The model of the package, as a user writes it."""
    with pm.Model(coords={"coefficient": DATA.coefficients}) as model:
        sigma2 = pm.InverseGamma("scaled_noise_variance", PRIOR.shape, PRIOR.scale)
        sd = np.sqrt(PRIOR.kappas(DATA.n_terms)) * pm.math.sqrt(sigma2)
        b = pm.Normal("scaled_coefficients", PRIOR.means(DATA.n_terms), sd, dims="coefficient")
        mu = DATA.response_center + DATA.response_scale * (DATA.scaled_design_matrix @ b)
        pm.Normal("y", mu, DATA.response_scale * pm.math.sqrt(sigma2), observed=DATA.response)
    return model


@cache
def sampled():
    with plain_model():
        return pm.sample(500, tune=500, chains=4, cores=1, random_seed=1, progressbar=False, quiet=True)


@cache
def tree_by(path):
    rng = np.random.default_rng(2)
    if path == "own":
        return posterior_tree(sampled(), DATA, plain_model(), prior=PRIOR, rng=rng)
    if path == "nuts":
        return nuts_posterior(DATA, PRIOR, rng=rng, **SETTINGS)
    if path == "horseshoe":
        return nuts_posterior(DATA, ps.horseshoe, errors=laplace, rng=rng, target_accept=0.95, **SETTINGS)
    draw = {"conjugate": ps.exact_posterior, "gibbs": ps.gibbs_posterior}[path]
    tree = draw(DATA, PRIOR, draws=2000 if path == "conjugate" else 500, rng=rng)
    return ps.with_predictive(tree, DATA, PRIOR, rng=rng)


@pytest.mark.parametrize("path", PATHS)
def test_arviz_takes_the_tree(path):
    """Every function of ArviZ that the docs and the report name."""
    tree = tree_by(path)
    groups = [tree[name] for name in ("posterior", "log_likelihood", "posterior_predictive")]
    assert {(group.sizes["chain"], group.sizes["draw"]) for group in groups} == {(4, 500)}
    az.summary(tree, var_names=["coefficients"])
    assert az.loo(tree, var_name="response").elpd < np.inf
    pit = az.loo_pit(tree, var_names="response")["response"]
    assert dict(pit.sizes) == {"row": DATA.n_rows}
    assert ((pit >= 0.0) & (pit <= 1.0)).all()
    sensed = az.psense(tree, group="likelihood", var_names=["coefficients"])
    assert np.isfinite(sensed["coefficients"]).all()
    az.plot_ppc_dist(tree, group="posterior_predictive", num_samples=10)
    az.plot_loo_pit(tree)
    plt.close("all")
    assert az.rhat(tree, var_names=["coefficients"])["coefficients"].max() < 1.05


@pytest.mark.usefixtures("undrawn")
@pytest.mark.parametrize("path", ["own", HORSESHOE])
def test_the_tree_is_reported(path, tmp_path):
    page = ps.diagnostic_report({path: tree_by(path)}, tmp_path)
    text = page.read_text(encoding="utf-8")
    assert ("of its own model" in text) == (path == "horseshoe")
    assert ("that of a normal prior with the same central 95 %" in text) == (path == "horseshoe")
    assert "quantities move with the prior" in text
    assert "no prior/coefficients" not in text
    assert "no posterior_predictive" not in text


def test_own_draws_agree_with_the_exact_posterior():
    exact = PRIOR.exact(DATA)
    table = ps.agreement(exact, {"own": tree_by("own")})
    assert table["agrees"].all(), table.attrs["verdict"]
    wrong = tree_by("own").copy()
    wrong["posterior"] = wrong["posterior"].to_dataset().assign(coefficients=lambda group: 1.05 * group["coefficients"])
    assert not ps.agreement(exact, {"own": wrong})["agrees"].any()


def test_agreement_skips_a_noise_variance_that_is_not_there():
    tree = tree_by("own").copy()
    tree["posterior"] = tree["posterior"].to_dataset().drop_vars(["noise_variance", "scaled_noise_variance"])
    table = ps.agreement(PRIOR.exact(DATA), {"own": tree})
    assert list(table["quantity"].values) == list(DATA.coefficients)
    assert table["agrees"].all()


def test_the_log_likelihood_is_that_of_the_rows():
    own = tree_by("own")
    b, s2 = own["posterior"]["coefficients"].values, own["posterior"]["noise_variance"].values
    residual = DATA.response - b @ DATA.design_matrix.T
    density = -0.5 * (np.log(2.0 * np.pi * s2)[..., None] + residual**2 / s2[..., None])
    np.testing.assert_allclose(own["log_likelihood"]["response"], density, rtol=1e-8, atol=1e-8)


def test_new_rows_are_predicted_by_pymc():
    """From the draws of the model, at rows that it was not fitted to."""
    tree, new = tree_by("own"), DATA.design_matrix[::7] + 0.1
    with pymc_model(DATA, PRIOR):
        rows = np.arange(len(new))
        pm.set_data({"design_matrix": new, "observed_response": np.zeros(len(new))}, coords={"row": rows})
        predicted = pm.sample_posterior_predictive(tree, predictions=True, random_seed=1, progressbar=False)
    drawn = predicted["predictions"]["response"].values.reshape(-1, len(new))
    mean, sd = PRIOR.exact(DATA).predict(new)
    error = sd / np.sqrt(float(az.ess(tree["posterior"]["coefficients"]).min()))
    assert np.max(np.abs(drawn.mean(0) - mean) / error) < 4.5
    np.testing.assert_allclose(drawn.std(0), sd, rtol=0.15)


@pytest.mark.parametrize("prior", [ps.horseshoe, ps.r2d2])
def test_shipped_priors_are_centred(prior):
    """Draws of the prior are symmetric about zero, and vary."""
    with pymc_model(DATA, prior):
        drawn = pm.sample_prior_predictive(2000, random_seed=3)["prior"]["scaled_coefficients"].values[0]
    fraction_positive = (drawn > 0.0).mean(axis=0)
    assert np.all(np.abs(fraction_positive - 0.5) < 4.5 * np.sqrt(0.25 / 2000))
    assert np.all(drawn.std(axis=0) > 0.0)


def test_settings_of_the_sampler_are_checked():
    rng = np.random.default_rng(1)
    for prior in (PRIOR, ps.horseshoe):
        with refused(ValueError, "target_accept", 1.0):
            nuts_posterior(DATA, prior, rng=rng, target_accept=1.0)
    with refused(ValueError, "stan"):
        nuts_posterior(DATA, PRIOR, rng=rng, sampler="stan")


@pytest.mark.parametrize("dim", ["coefficient", "predictor"])
@pytest.mark.parametrize("variable", ["coefficients", "scaled_coefficients"])
def test_draws_are_taken_by_their_labels(variable, dim):
    """The draws of every other variable over the same labels too."""
    group = tree_by("own")["posterior"].to_dataset()
    values, names = group[variable].values, np.array(DATA.coefficients)
    order = np.array([3, 0, 4, 1, 2])
    over = ("chain", "draw", dim)
    own = xr.Dataset(
        {variable: (over, values[..., order]), "local_scale": (over, 2.0 * values[..., order])}, {dim: names[order]}
    )
    found = posterior_tree(xr.DataTree.from_dict({"posterior": own}), DATA)["posterior"]
    np.testing.assert_allclose(found["coefficients"], group["coefficients"])
    np.testing.assert_array_equal(found["local_scale"].sel(coefficient=names[0]), 2.0 * values[..., 0])


def tree_of_rows(labels, observed=None):
    """Draws whose log likelihood counts its rows, with labels of these and of the observed rows."""
    values = np.broadcast_to(np.arange(DATA.n_rows, dtype=float), (4, 500, DATA.n_rows))
    groups = {"posterior": sampled()["posterior"].to_dataset()}
    groups["log_likelihood"] = xr.Dataset({"y": (("chain", "draw", "obs_id"), values)}, {"obs_id": labels})
    if observed is not None:
        groups["observed_data"] = xr.Dataset({"y": ("obs_id", DATA.response)}, {"obs_id": observed})
    return xr.DataTree.from_dict(groups)


ROWS = np.arange(DATA.n_rows)


@pytest.mark.parametrize(
    ("labels", "observed", "expected"),
    [
        (ROWS[::-1], ROWS, ROWS[::-1]),
        (ROWS[::-1], ROWS[::-1], ROWS),
        (np.roll(ROWS, 7), ROWS[::-1], [list(np.roll(ROWS, 7)).index(label) for label in ROWS[::-1]]),
        (ROWS + 7, ROWS, ROWS),
        (ROWS + 7, None, ROWS),
    ],
)
def test_rows_are_taken_by_the_labels_of_the_observed_rows(labels, observed, expected):
    """Labels of another table than the data are no rows of theirs."""
    tree = posterior_tree(tree_of_rows(labels, observed), DATA)
    np.testing.assert_array_equal(tree["log_likelihood"]["response"][0, 0], expected)


def test_rows_of_a_model_keep_its_order():
    """Of a table whose index was shuffled, for example."""
    with pm.Model(coords={"row": ROWS[::-1]}) as model:
        b = pm.Normal("coefficients", 0.0, 10.0, shape=DATA.n_terms)
        pm.Normal("y", pm.math.dot(DATA.design_matrix, b), 1.0, observed=DATA.response, dims="row")
    draws = xr.Dataset({"coefficients": (("chain", "draw", "term"), np.ones((1, 2, DATA.n_terms)))})
    tree = posterior_tree(xr.DataTree.from_dict({"posterior": draws}), DATA, model, rng=1)
    residual = DATA.response - DATA.design_matrix.sum(axis=1)
    density = -0.5 * (np.log(2.0 * np.pi) + residual**2)
    np.testing.assert_allclose(tree["log_likelihood"]["response"][0, 0], density)


def draws_over(**labels):
    values = np.broadcast_to([1.0, 3.0], (2, 4, 2))
    posterior = xr.Dataset({"coefficients": (("chain", "draw", "term"), values)}, labels)
    return xr.DataTree.from_dict({"posterior": posterior})


def test_numbers_may_be_names():
    """Names that count the terms in another order are names as texts, and ambiguous as numbers."""
    data = ps.RegressionData.from_arrays(DATA.design_matrix[:, 1:3], DATA.response, ["1", "0"])
    named = posterior_tree(draws_over(term=["0", "1"]), data)["posterior"]["coefficients"]
    assert named[0, 0].to_series().to_dict() == {"1": 3.0, "0": 1.0}
    for labels in ({"term": [0, 1]}, {}):
        with refused(ValueError, "coefficients", 0, 1):
            posterior_tree(draws_over(**labels), data)


@pytest.mark.parametrize("name", ["design_matrix", "observed_response"])
def test_data_that_the_model_no_longer_has_are_refused(name):
    tree = ps.exact_posterior(DATA, PRIOR, draws=8, rng=1)
    with pymc_model(DATA, PRIOR) as model, refused(ValueError, "response" if "response" in name else name):
        pm.set_data({name: 0.0 * model[name].get_value()})
        posterior_tree(tree, DATA, model, rng=1)


def test_a_tree_of_another_design_is_refused():
    other = ps.RegressionData.from_arrays(DATA.design_matrix * [1, 1, 1, 1, 9], DATA.response, DATA.coefficients)
    with refused(ValueError, "design_matrix"):
        posterior_tree(ps.exact_posterior(DATA, PRIOR, draws=8, rng=1), other)


@pytest.mark.parametrize("factor", [0.3, 1.0, 3.0])
def test_a_prior_of_other_widths_than_the_draws_of_the_model_is_refused(factor):
    """As where sigma was a variance or a precision; without a prior nothing is compared."""
    tree = ps.exact_posterior(DATA, PRIOR, draws=40, rng=1)
    drawn = prior_draws(DATA, PRIOR, 500, rng=np.random.default_rng(1))
    drawn["coefficients"][..., 1] *= factor
    groups = xr.DataTree.from_dict({"posterior": tree["posterior"].to_dataset(), "prior": drawn})
    assert "prior" in posterior_tree(groups, DATA).children
    if factor == 1.0:
        assert "prior" in posterior_tree(groups, DATA, prior=PRIOR).children
        return
    with refused(ps.ShipError, "wide"):
        posterior_tree(groups, DATA, prior=PRIOR)


def own_prior(data, given):
    variance = pm.InverseGamma("scaled_noise_variance", 3.0, 2.0)
    return pm.Normal("scaled_coefficients", 0.0, 1.0, **given), variance


@cache
def tree_of_law(errors, with_model=True):
    """A tree with draws of a custom prior, as its posterior."""
    with pymc_model(DATA, own_prior, errors) as model:
        drawn = pm.sample_prior_predictive(20, random_seed=1, compile_kwargs={"mode": "FAST_COMPILE"})
    groups = xr.DataTree.from_dict(
        {"posterior": drawn["prior"].dataset, "observed_data": drawn["observed_data"].dataset}
    )
    return posterior_tree(groups, DATA, model if with_model else None, rng=1)


@pytest.mark.parametrize("errors", ["normal", "student_t", "ar1"])
def test_the_law_of_the_errors_is_known_by_the_log_likelihood(errors):
    """Whatever the prior: predictions follow it."""
    tree, law = tree_of_law(errors), ERRORS[errors]
    assert errors_of(tree) == errors
    predicted, posterior = ps.predict(tree, DATA.design_matrix, rng=3), tree["posterior"].dataset
    parameter = posterior[law.parameter].values if law.parameter else None
    drawn = law.draw_errors(np.random.default_rng(3), np.sqrt(posterior["noise_variance"].values), parameter, 60)
    np.testing.assert_allclose(predicted["response"] - predicted["expected"], drawn, atol=1e-9)


@pytest.mark.parametrize("tree", [lambda: tree_of_law(laplace), lambda: tree_of_law("student_t", with_model=False)])
def test_a_law_that_is_not_known_is_not_taken_for_the_normal_one(tree):
    assert errors_of(tree()) == "own"
    for use in (
        lambda tree: ps.predict(tree, DATA.design_matrix, rng=1),
        lambda tree: ps.with_predictive(tree, DATA, PRIOR, rng=1),
        lambda tree: ps.agreement(PRIOR.exact(DATA), {"own": tree}),
    ):
        with refused(ValueError):
            use(tree())
