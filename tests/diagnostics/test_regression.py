"""The numbers of a saved posterior against closed forms, exact posteriors and series whose nature is known."""

import arviz as az
import numpy as np
import pytest
import xarray as xr
from scipy import stats

import pymc_ship as ps
from pymc_ship.diagnostics import posterior_statistics as statistics
from pymc_ship.diagnostics import regression as d
from pymc_ship.inference.sampling.error_laws import with_errors
from tests.sentences import refused

TRUTH = np.array([1.0, -2.0, 0.0])


def made(noise, *, kappa=100.0, family=ps.ConjugatePrior, columns=None, draws=600, seed=5):
    """Posterior of a regression with the given noise, with its data and exact moments."""
    rng = np.random.default_rng(seed)
    X = rng.standard_normal((len(noise), 3)) if columns is None else columns
    data = ps.RegressionData.from_arrays(
        X, X @ TRUTH + noise, ("Ya", "Yb", "Yc"), dof="sway", vessel="none", scaling="none"
    )
    prior = family(kappa=kappa, shape=3.0, scale=0.5)
    return ps.exact_posterior(data, prior, draws=4 * draws, chains=4, rng=rng), data, prior


def white(n=300, sd=0.3, seed=1):
    return sd * np.random.default_rng(seed).standard_normal(n)


def wave(n=300, r=0.9, seed=2):
    """Autoregressive noise of first order."""
    shocks = white(n, seed=seed)
    for k in range(1, n):
        shocks[k] += r * shocks[k - 1]
    return shocks


@pytest.fixture(scope="module")
def good():
    return made(white())


def changed(tree, **draws):
    """Copy with other draws."""
    return tree.assign({"posterior": xr.DataTree(tree["posterior"].to_dataset().assign(draws))})


def without(tree, *groups):
    return xr.DataTree.from_dict(
        {"/": tree.to_dataset(), **{k: v.to_dataset() for k, v in tree.children.items() if k not in groups}}
    )


def diagnostic(tree, name):
    return next(row for row in statistics.convergence_diagnostics(tree) if row["diagnostic"] == name)


# convergence


def test_independent_draws_pass_every_diagnostic(good):
    rows = statistics.convergence_diagnostics(good[0])
    assert [row["diagnostic"] for row in rows] == ["largest R-hat", "least bulk ESS", "least tail ESS"]
    assert all(row["passes"] for row in rows)
    assert rows[1]["value"] == pytest.approx(2400, rel=0.2)


def test_a_chain_that_stands_elsewhere_fails_the_diagnostic_of_its_coefficient(good):
    draws = good[0]["posterior"]["coefficients"].copy()
    draws[2, :, 1] += 1.0
    row = diagnostic(changed(good[0], coefficients=draws), "largest R-hat")
    assert (row["passes"], row["where"]) == (False, "Yb")
    assert row["value"] > 1.5


@pytest.mark.filterwarnings("ignore::RuntimeWarning")
def test_chains_that_stand_still_and_single_chains_fail(good):
    still = changed(good[0], noise_variance=xr.zeros_like(good[0]["posterior"]["noise_variance"]) + 1.0)
    assert not all(row["passes"] for row in statistics.convergence_diagnostics(still))
    one = xr.DataTree.from_dict(
        {"/": good[0].to_dataset(), "posterior": good[0]["posterior"].to_dataset().isel(chain=[0])}
    )
    assert np.isnan(diagnostic(one, "largest R-hat")["value"])
    assert not diagnostic(one, "largest R-hat")["passes"]


def test_sticky_chains_have_too_few_effective_draws(good):
    draws = good[0]["posterior"]["coefficients"]
    sticky = draws.isel(draw=np.repeat(np.arange(30), 20)).assign_coords(draw=draws["draw"])
    assert not diagnostic(changed(good[0], coefficients=sticky), "least bulk ESS")["passes"]


def test_divergences_and_energy_are_judged_where_they_are_known(good):
    rng = np.random.default_rng(0)
    shape = (4, 600)
    stats_of = {"diverging": rng.random(shape) < 0.0, "energy": rng.standard_normal(shape)}
    calm = sampled(good[0], stats_of)
    assert diagnostic(calm, "divergences")["passes"]
    assert diagnostic(calm, "least E-BFMI")["value"] == pytest.approx(2.0, abs=0.3)
    stats_of["diverging"][3, 7] = True
    stats_of["energy"] = np.cumsum(stats_of["energy"], axis=1)
    wild = sampled(good[0], stats_of)
    assert diagnostic(wild, "divergences")["value"] == 1.0
    assert not diagnostic(wild, "divergences")["passes"]
    assert not diagnostic(wild, "least E-BFMI")["passes"]


def sampled(tree, values):
    group = xr.Dataset({name: (("chain", "draw"), value) for name, value in values.items()})
    return tree.assign({"sample_stats": xr.DataTree(group)})


def test_the_summary_agrees_with_the_exact_posterior(good):
    tree, data, prior = good
    exact, found = prior.exact(data), statistics.summary(tree)
    z = (found["mean"].values[:-1] - exact.mean) / found["mcse_mean"].values[:-1]
    assert np.abs(z).max() < stats.norm.ppf(1 - 0.5e-3 / 3)
    lower, upper = exact.quantiles([0.025, 0.975])
    assert found["lower"].values[:-1] == pytest.approx(lower, abs=0.2 * exact.sd.max())
    assert found["upper"].values[:-1] == pytest.approx(upper, abs=0.2 * exact.sd.max())
    assert found.attrs == {"ci_prob": 0.95, "ci_kind": "eti"}


def test_standard_errors_are_those_of_any_unit():
    """Draws of slowly varying size; the noise variance of a ship in prime units is of the order 1e-9."""
    chains = np.stack([wave(500, seed=seed) for seed in range(4)])
    draws = np.sign(chains) * chains**2
    found = {}
    for unit in (1.0, 1e-9):
        group = {"coefficients": (("chain", "draw", "coefficient"), unit * draws[..., None])}
        tree = xr.DataTree.from_dict({"posterior": xr.Dataset(group, {"coefficient": ["Ya"]})})
        table = statistics.summary(tree).isel(quantity=0)
        found[unit] = [float(table[name]) / unit for name in ("mean", "sd", "mcse_mean", "mcse_sd")]
        found[unit] += [float(table[name]) for name in ("ess_bulk", "ess_tail", "r_hat")]
    assert found[1.0] == pytest.approx(found[1e-9], rel=1e-6)
    assert found[1.0][3] > 2.0 * found[1.0][1] / np.sqrt(2.0 * draws.size)


# what the data determine


@pytest.mark.parametrize("spoil", [lambda rows: 2.0 * rows, lambda rows: rows.roll(row=1)], ids=["twice", "rows"])
def test_log_densities_of_other_values_are_refused(good, spoil):
    """Draws of the same labels; a constant is that of a law."""
    density, tree = good[0]["log_likelihood"].to_dataset(), good[0].copy(deep=True)
    tree["log_likelihood"] = density + 3.0
    d.check_posterior(tree)
    tree["log_likelihood"] = spoil(density)
    with refused(ps.ShipError, "anew"):
        d.check_posterior(tree)


def test_large_coefficients_are_determined_and_a_zero_is_not(good):
    found = d.contraction(good[0])
    assert found["determined"].values.tolist() == [True, True, False]
    assert found["is_contracted"].values.all()


@pytest.mark.parametrize(("family", "kappa"), [(ps.ConjugatePrior, 0.02), (ps.SemiConjugatePrior, 4.0)])
def test_contraction_against_the_normal_posterior(family, kappa):
    """One orthogonal column of square norm n: posterior variance is 1/(n/sigma2 + 1/prior variance)."""
    X = np.sqrt(3.0) * np.tile(np.eye(3), (40, 1))
    tree, _, _ = made(white(120, sd=6.0), kappa=kappa, family=family, columns=X, draws=2500)
    sigma2 = float(tree["posterior"]["noise_variance"].mean())
    prior = kappa * (sigma2 if family is ps.ConjugatePrior else 1.0)
    found = d.contraction(tree)
    assert found["prior_sd"].values == pytest.approx(np.sqrt(prior))
    expected = 1.0 - 1.0 / (1.0 + prior * 120.0 / sigma2)
    assert found["contraction"].values == pytest.approx(expected, abs=0.06 * (1 - expected) + 1e-3)
    assert [row["data_precision"] for row in d.singular_directions(tree)] == pytest.approx([expected] * 3, abs=1e-6)


def test_prior_spread_is_mapped_back_from_the_scaled_columns():
    """Prior draws on the scaled columns, mapped by the data itself, have the prior sd of the original ones."""
    rng = np.random.default_rng(3)
    X = np.column_stack([np.ones(60), 5.0 + rng.standard_normal(60), 0.01 * rng.standard_normal(60)])
    data = ps.RegressionData.from_arrays(
        X, X @ [1.0, 2.0, 3.0] + rng.standard_normal(60), scaling="zscore", dof="yaw", vessel="none"
    )
    tree = ps.exact_posterior(data, ps.SemiConjugatePrior(kappa=2.0), draws=400, chains=4, rng=rng)
    drawn = data.to_original(np.sqrt(2.0) * rng.standard_normal((40000, 3)))
    assert d.contraction(tree)["prior_sd"].values == pytest.approx(drawn.std(axis=0), rel=0.02)
    again = d.data_of(tree)
    assert again.scaled_design_matrix == pytest.approx(data.scaled_design_matrix)
    assert again.scaled_response == pytest.approx(data.scaled_response)


@pytest.mark.filterwarnings("ignore:The columns must be linearly independent:UserWarning")
def test_a_direction_the_data_do_not_see_follows_the_prior():
    """Two equal columns: their difference has no data, its coefficients are the most correlated pair."""
    rng = np.random.default_rng(4)
    column = rng.standard_normal(200)
    X = np.column_stack([column, column, rng.standard_normal(200)])
    tree, _, _ = made(white(200), columns=X)
    weakest = d.singular_directions(tree)[0]
    assert weakest["data_precision"] == pytest.approx(0.0, abs=1e-9)
    assert weakest["direction"].startswith(("+0.71 Ya -0.71 Yb", "+0.71 Yb -0.71 Ya"))
    pair = statistics.correlated_pairs(tree, 1)[0]
    assert {pair["first"], pair["second"]} == {"Ya", "Yb"}
    assert pair["correlation"] < -0.99
    assert not d.contraction(tree)["determined"].values[:2].any()


# residuals


def test_white_noise_passes_and_a_wave_fails():
    calm, rough = statistics.whiteness(white(2000)), statistics.whiteness(wave(2000))
    assert calm["p_value"] > 0.01
    assert abs(calm["r1"]) < 3.0 * calm["band"] / 1.96
    assert rough["p_value"] < 1e-12
    assert rough["r1"] == pytest.approx(0.9, abs=0.05)


def test_the_whiteness_test_is_as_large_as_it_says():
    """At the 5 % level white noise is rejected in 5 % of 1000 series, within four binomial standard errors."""
    rng = np.random.default_rng(8)
    rejected = np.mean([statistics.whiteness(rng.standard_normal(200))["p_value"] < 0.05 for _ in range(1000)])
    assert rejected == pytest.approx(0.05, abs=4.0 * np.sqrt(0.05 * 0.95 / 1000))


def test_the_statistic_of_ljung_and_box_by_hand():
    values = np.tile([1.0, -1.0], 5)
    found = statistics.whiteness(values)
    r = np.array([-0.9, 0.8])
    assert found["lags"] == 2
    assert statistics.autocorrelation(values, 2) == pytest.approx(r)
    assert found["statistic"] == pytest.approx(10 * 12 * np.sum(r**2 / [9, 8]))
    assert found["p_value"] == pytest.approx(np.exp(-0.5 * found["statistic"]))
    with refused(ValueError, 9):
        statistics.whiteness(values[:9])


def test_residuals_of_a_posterior_show_the_noise_of_its_data():
    assert statistics.whiteness(d.residuals(made(wave())[0]).values)["r1"] == pytest.approx(0.9, abs=0.08)
    seeds = range(60)
    found = [
        statistics.whiteness(d.residuals(made(white(seed=k), draws=5, seed=k + 100)[0]).values)["p_value"]
        for k in seeds
    ]
    assert stats.kstest(found, "uniform").pvalue > 1e-3


def test_residuals_are_in_order_of_time():
    """Rows in any order of a file show the correlation of neighbours in time."""
    rng, noise = np.random.default_rng(3), wave()
    X, order = rng.standard_normal((noise.size, 3)), rng.permutation(noise.size)
    data = ps.RegressionData.from_arrays(X[order], (X @ TRUTH + noise)[order], time=np.arange(noise.size)[order])
    found = d.residuals(ps.exact_posterior(data, ps.ConjugatePrior(), rng=1))
    assert (np.diff(found["time"]) > 0.0).all()
    assert statistics.whiteness(found.values)["r1"] == pytest.approx(0.9, abs=0.08)


def test_a_posterior_in_another_order_has_the_same_residuals(good):
    _, data, prior = good
    free = ps.exact_posterior(ps.hold_fixed(data, {"Yc": 0.0}), prior, rng=1)
    restored = ps.restore_fixed(free, {"Yc": 0.0}, ["Yb", "Yc", "Ya"])
    d.check_posterior(restored)
    xr.testing.assert_allclose(d.residuals(d.free_posterior(restored)), d.residuals(free))
    other = free["posterior"].to_dataset().assign_coords(coefficient=["Yb", "Yd"])
    renamed = free.assign({"posterior": xr.DataTree(other)})
    with refused(ValueError, "Yd"):
        d.free_posterior(renamed)


def test_groups_of_a_posterior_are_of_its_draws(good):
    tree = good[0]
    part = tree["posterior"].to_dataset().isel(draw=slice(None, None, 10))
    with refused(ValueError, "log_likelihood"):
        d.check_posterior(tree.assign({"posterior": xr.DataTree(part)}))


# cross-validation, sensitivity and prediction


def test_leave_one_out_of_a_right_model(good):
    """About one effective parameter a coefficient and one for sigma2; intervals hold their share of the rows."""
    loo = statistics.cross_validation(good[0])
    assert float(loo.p) == pytest.approx(4.0, abs=1.5)
    assert (loo.pareto_k.values < loo.good_k).all()
    whole = d.with_posterior_predictive(good[0], np.random.default_rng(0))
    pit = d.loo_pit(whole, loo)
    xr.testing.assert_allclose(pit, az.loo_pit(whole, var_names="response", pareto_pit=True))
    half, most = d.loo_pit_coverage(pit)
    assert half == pytest.approx(0.5, abs=4 * np.sqrt(0.25 / 300))
    assert most == pytest.approx(0.95, abs=4 * np.sqrt(0.0475 / 300))


def test_an_outlier_has_a_large_pareto_k():
    noise = white(60)
    noise[17] = 40.0
    loo = statistics.cross_validation(made(noise)[0])
    assert int(np.argmax(loo.pareto_k.values)) == 17
    assert loo.pareto_k.values[17] > loo.good_k


def test_a_strong_prior_is_felt_and_a_weak_one_is_not():
    weak = statistics.prior_sensitivity(made(white(), kappa=1e4)[0])
    strong = statistics.prior_sensitivity(made(white(), kappa=0.02, family=ps.SemiConjugatePrior)[0])
    assert [row["quantity"] for row in weak] == ["Ya", "Yb", "Yc", "noise_variance"]
    assert max(row["prior"] for row in weak[:3]) < statistics.PSENSE_LIMIT
    assert strong[1]["prior"] > statistics.PSENSE_LIMIT


def test_predictive_draws_have_the_spread_of_the_response(good):
    tree = good[0]
    drawn = d.with_posterior_predictive(tree, np.random.default_rng(0))
    response = drawn["posterior_predictive"]["response"]
    assert response.dims == ("chain", "draw", "row")
    spread = response.var(("chain", "draw")).mean()
    assert float(spread) == pytest.approx(float(tree["posterior"]["noise_variance"].mean()), rel=0.05)
    assert "posterior_predictive" not in tree.children
    assert d.with_posterior_predictive(drawn, np.random.default_rng(1)) is drawn


@pytest.mark.parametrize("errors", ["normal", "ar1"])
def test_draws_and_data_give_the_log_likelihood_again(good, errors):
    tree, data, _ = good
    if errors == "ar1":
        tree = with_errors(tree, data, "ar1", np.full((4, 600), 0.5))
    bare = without(tree, "log_likelihood")
    again = d.with_log_likelihood(bare)["log_likelihood"].to_dataset()
    xr.testing.assert_allclose(again, tree["log_likelihood"].to_dataset(), rtol=1e-10)
    assert d.with_log_likelihood(tree) is tree
    assert statistics.missing(bare, *d.required_for_likelihood(bare)) == []


def test_a_law_that_is_not_known_gives_no_log_likelihood(good):
    bare = without(good[0], "log_likelihood").assign()
    bare.attrs["errors"] = "own"
    assert d.required_for_likelihood(bare) == ("log_likelihood/response",)


@pytest.mark.parametrize(("errors", "correlation"), [("ar1", 0.9), ("normal", 0.0)])
def test_predictive_draws_obey_the_law_of_the_errors(good, errors, correlation):
    tree, data, _ = good
    if errors == "ar1":
        tree = with_errors(tree, data, "ar1", np.full((4, 600), 0.9))
    drawn = d.with_posterior_predictive(tree, np.random.default_rng(0))["posterior_predictive"]["response"].values
    error = drawn - tree["posterior"]["coefficients"].values @ data.design_matrix.T
    found = np.sum(error[..., 1:] * error[..., :-1]) / np.sum(error**2)
    assert found == pytest.approx(correlation, abs=0.01)


def test_the_prior_predicts_with_the_law_of_the_errors():
    """Where errors are all that the response has, those of Student's t spread more."""
    tree, data, _ = made(white(), kappa=1e-4)
    heavy = with_errors(tree, data, "student_t", np.full((4, 600), 5.0))
    normal, t = (d.prior_predictive_ratio(given, np.random.default_rng(0)) for given in (tree, heavy))
    assert (t > normal).all()
    assert t[2] > 1.2 * normal[2]


def test_prior_draws_of_the_noise_variance_have_its_prior(good):
    drawn = d.prior_noise_variance(good[0], 4000, np.random.default_rng(0))
    assert stats.kstest(drawn, stats.invgamma(3.0, scale=0.5).cdf).pvalue > 1e-3
    assert stats.kstest(drawn, stats.invgamma(0.5, scale=3.0).cdf).pvalue < 1e-3


def test_the_noise_variance_is_narrowed_by_the_data(good):
    """Widths of log10 of an inverse gamma, from its quantile function."""
    prior, posterior = d.noise_variance_widths(good[0], np.random.default_rng(0))
    assert prior == pytest.approx(np.ptp(np.log10(stats.invgamma(3.0).ppf([0.025, 0.975]))), rel=0.03)
    assert posterior == pytest.approx(np.ptp(np.log10(stats.invgamma(3.0 + 150.0).ppf([0.025, 0.975]))), rel=0.1)


def test_a_wide_prior_predicts_more_than_the_record(good):
    low, middle, high = d.prior_predictive_ratio(good[0], np.random.default_rng(0))
    assert 0.3 < low < middle < high
    assert middle > 1.5


# what is no posterior


def test_missing_variables_are_named(good):
    assert statistics.missing(good[0], "log_likelihood/response", *d.DESIGN) == []
    assert statistics.missing(without(good[0], "constant_data"), *d.DESIGN) == ["constant_data/design_matrix"]
