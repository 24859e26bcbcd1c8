from dataclasses import replace
from functools import cache
from statistics import NormalDist

import arviz as az
import numpy as np
import pymc as pm
import pytest
from scipy import stats
from scipy.stats import chi2

import pymc_ship as ps
from pymc_ship.inference.regression.tree import read_posterior, write_posterior
from pymc_ship.inference.sampling.trajectory_model import mode_model, mode_nuts_posterior
from pymc_ship.inference.trajectory.fit import fit_trajectory, linearise
from pymc_ship.inference.trajectory.noise import fit_with_noise
from pymc_ship.inference.trajectory.posterior import (
    KHAT_LIMIT,
    TrajectoryMode,
    laplace_posterior,
    log_likelihood_rows,
    log_prior_density,
    trajectory_mode,
    verdict,
)
from pymc_ship.inference.trajectory.prior import coefficient_prior
from pymc_ship.inference.trajectory.runs import trajectory_run
from pymc_ship.inference.trajectory.scale_law import FACTOR_SD
from pymc_ship.trial.quality_flags import quality_flags
from tests.ships.ensemble.cases import posterior_forecast

CASES = {
    "white": {"noise": "white", "offsets": False},
    "correlated": {"noise": "ar1", "offsets": True},
    "student_t": {"noise": "student_t", "offsets": False},
}


@cache
def trial(seed, angle=20.0):
    """60 s of a zigzag at 2 Hz with noise of 2 % of each channel."""
    record = ps.simulate(ps.load_vessel("container"), ps.zigzag(angle, angle), duration=60.0, record_interval=0.5)
    rng = np.random.default_rng(seed)
    for name in ("u", "v", "r", "p", "phi", "psi"):
        sd = 0.02 * np.ptp(record[name].values)
        record[name] = ("time", record[name].values + sd * rng.standard_normal(record["time"].size))
    return record


def close_prior(trials, vessel, **changes):
    """A prior of 5 % about a sister ship with a fixed scale: the posterior is nearly normal."""
    prior = coefficient_prior(trials, vessel, "sister_ship", relative_sd=0.05)
    return replace(prior.fixed, **changes)


@cache
def mode(case="white"):
    vessel = ps.load_vessel("container")
    if case == "two_runs":
        trials = [trial(1), trial(2, 10.0)]
        prior = close_prior(trials, vessel)
        runs = [trajectory_run(trials[0], vessel), trajectory_run(trials[1], vessel, channels=("u", "r", "p", "psi"))]
        return TrajectoryMode(
            fit_with_noise(runs, vessel, prior, prior.mean, **CASES["correlated"]), 1, 1, quality_flags(trials)
        )
    return trajectory_mode(trial(1), vessel, close_prior([trial(1)], vessel), method="euler", **CASES[case])


@cache
def density(case):
    """Log density of the model and its gradient as a function of the coordinates."""
    function = mode_model(mode(case)).logp_dlogp_function(ravel_inputs=True, mode="FAST_COMPILE")
    function.set_extra_values({})
    return function


def log_density(fit, coordinate):
    """Log density of records and prior, without PyMC."""
    unknowns = (fit.unknowns + fit.square_root @ coordinate)[None]
    return float(log_likelihood_rows(fit, unknowns).sum() + log_prior_density(fit, unknowns, np.empty((1, 0)))[0])


def points(fit, count=2):
    return np.random.default_rng(3).standard_normal((count, fit.unknowns.size))


@pytest.mark.parametrize("case", [*CASES, "two_runs"])
def test_log_density_is_that_of_records_and_prior(case):
    fit = mode(case).choice.fit
    for point in points(fit):
        expected = log_density(fit, point)
        assert density(case)(point)[0] == pytest.approx(expected, rel=1e-12)
        assert log_density(halved(fit), point) != pytest.approx(expected, rel=1e-3)


def test_with_factors_the_log_density_has_students_t_and_their_normal_law():
    ship = ps.load_vessel("container")
    chosen = trajectory_mode(trial(1), ship, method="euler", **CASES["white"])
    fit, n = chosen.choice.fit, chosen.choice.fit.unknowns.size
    law, scales = fit.problem.prior.law, fit.problem.current_scales
    function = mode_model(chosen).logp_dlogp_function(ravel_inputs=True, mode="FAST_COMPILE")
    function.set_extra_values({})
    point = 0.3 * np.random.default_rng(5).standard_normal(n + law.center.size)
    unknowns = (fit.unknowns + fit.square_root @ point[:n])[None]
    eta = scales.eta + FACTOR_SD * point[n:]
    expected = log_likelihood_rows(fit, unknowns).sum() + log_prior_density(fit, unknowns, eta[None])[0]
    expected += stats.norm.logpdf(eta, law.center, FACTOR_SD).sum()
    assert function(point)[0] == pytest.approx(float(expected), rel=1e-10)


def halved(fit):
    """The broken twin: noise of half the sd."""
    noise = tuple(replace(noise, sd=0.5 * noise.sd) for noise in fit.problem.noise)
    return replace(fit, problem=replace(fit.problem, noise=noise))


@pytest.mark.parametrize("case", [*CASES, "two_runs"])
def test_gradient_is_that_of_the_sensitivities_and_of_finite_differences(case):
    fit = mode(case).choice.fit
    problem = fit.problem
    for point in points(fit):
        gradient = density(case)(point)[1]
        unknowns = fit.unknowns + fit.square_root @ point
        slope = problem.precision * (unknowns - problem.center) / problem.unit + linearise(problem, unknowns).gradient
        assert np.allclose(gradient, -fit.square_root.T @ (slope / problem.unit), rtol=1e-7, atol=1e-7)
        move = 1e-4 * np.sign(point)
        difference = log_density(fit, point + move) - log_density(fit, point - move)
        assert difference == pytest.approx(2.0 * move @ gradient, rel=1e-5)


def test_a_ship_that_leaves_the_model_has_no_density_and_a_finite_gradient():
    value, gradient = density("correlated")(1e4 * points(mode("correlated").choice.fit)[0])
    assert value == -np.inf
    assert np.isfinite(gradient).all()


def test_the_model_has_named_dims():
    model = mode_model(mode("correlated"))
    assert model.coords["state"] == ("u", "v", "r", "p", "phi")
    assert model.named_vars_to_dims["direction_coordinate"] == ("direction",)
    assert model.named_vars_to_dims["coefficients"] == ("coefficient",)
    assert model.named_vars_to_dims["initial_state"] == ("run", "state")
    assert model.named_vars_to_dims["sensor_offset"] == ("run", "channel")
    assert model.named_vars_to_dims["response"] == ("row", "channel")
    assert np.allclose(model.rvs_to_values[model["response"]].data[:, 1], trial(1)["v"].values)


def test_every_run_has_a_response_and_missing_states_are_nan():
    model = mode_model(mode("two_runs"))
    assert model.named_vars_to_dims["response_1"] == ("row_1", "channel_1")
    assert model.coords["channel_1"] == ("u", "r", "p", "psi")
    point = {"direction_coordinate": points(mode("two_runs").choice.fit)[0]}
    names = ["coefficients", "initial_state", "sensor_offset"]
    outputs = model.replace_rvs_by_values([model[name] for name in names])
    deterministics = model.compile_fn(outputs, inputs=model.value_vars, mode="FAST_COMPILE")(point)
    fit = mode("two_runs").choice.fit
    unknowns = fit.unknowns + fit.square_root @ point["direction_coordinate"]
    first, second = (unknowns[nuisance_slice] for nuisance_slice in fit.problem.nuisances)
    assert np.allclose(deterministics[0], unknowns[: fit.problem.n_coefficients], rtol=1e-12)
    assert np.allclose(deterministics[1], [[*first[:5], np.nan], second[:6]], rtol=1e-12, equal_nan=True)
    offsets = [[*first[5:], np.nan], [second[6], np.nan, second[7], second[8], np.nan, second[9]]]
    assert np.allclose(deterministics[2], offsets, rtol=1e-12, equal_nan=True)


def test_the_verdict_recommends_nuts_where_the_normal_approximation_fails():
    assert verdict(KHAT_LIMIT) == "the normal approximation can be trusted"
    for khat in (KHAT_LIMIT + 0.01, np.inf, np.nan):
        assert verdict(khat).endswith("not to be trusted: sample with trajectory_nuts_posterior")
    tree = laplace_posterior(mode(), draws=200, chains=2, rng=np.random.default_rng(1))
    assert tree.attrs["verdict"] == verdict(tree.attrs["pareto_khat"])


@cache
def nuts(seed=5, draws=300):
    return mode_nuts_posterior(mode(), draws=draws, chains=2, tune=100, rng=np.random.default_rng(seed))


def z_scores(tree, fit):
    """Errors of means and sds of NUTS against a normal posterior in Monte Carlo standard errors, and their limit."""
    draws = tree["posterior"]["coefficients"]
    errors = [draws.mean(("chain", "draw")) - fit.coefficients, draws.std(("chain", "draw"), ddof=1) - fit.sd]
    mcse = [az.mcse(draws, method=method) for method in ("mean", "sd")]
    z = np.abs(np.array(errors) / np.array(mcse))
    return z, NormalDist().inv_cdf(1.0 - 0.5e-3 / z.size)


def r_hat_limit(draws):
    """R-hat that chains of one law exceed by chance in 1e-3 of such tests: the means of four halves of ess/4 draws."""
    between = chi2.isf(1e-3 / draws.sizes["coefficient"], 3) / 3.0
    ess = np.minimum(az.ess(draws, method="bulk"), az.ess(draws, method="sd"))
    return np.sqrt(1.0 + (between - 1.0) / (ess / 4.0))


@pytest.mark.slow
def test_nuts_agrees_with_a_posterior_that_is_normal():
    z, limit = z_scores(nuts(), mode().choice.fit)
    assert z.max() < limit
    draws = nuts()["posterior"]["coefficients"]
    assert (az.rhat(draws) < r_hat_limit(draws)).all()
    assert not nuts()["sample_stats"]["diverging"].any()


@pytest.mark.slow
def test_nuts_under_half_the_noise_fails():
    fit = halved(mode().choice.fit)
    twin = fit_trajectory(fit.problem, fit.unknowns)
    z, limit = z_scores(nuts(), twin)
    assert z.max() > 2.0 * limit


@pytest.mark.slow
def test_layout_is_that_of_the_normal_approximation(tmp_path, container):
    tree = nuts(6, 20)
    laplace = laplace_posterior(mode(), draws=40, chains=2, rng=np.random.default_rng(1))
    assert set(tree.children) == set(laplace.children) | {"sample_stats"}
    for name, group in laplace.children.items():
        for variable, value in group.dataset.variables.items():
            variable_of_tree = tree[name].dataset.variables[variable]
            assert (variable_of_tree.dims, variable_of_tree.shape, variable_of_tree.dtype) == (
                value.dims,
                value.shape,
                value.dtype,
            )
    assert set(tree.attrs) == set(laplace.attrs) - {"pareto_khat"}
    assert tree.attrs["method"] == "trajectory_nuts"
    assert tree.attrs["diverged_fraction"] == 0.0
    assert {"diverging", "energy", "tree_depth", "n_steps", "lp"} <= set(tree["sample_stats"].data_vars)
    lp = tree["log_likelihood"]["response"].sum("row") + tree["log_prior"]["coefficients"]
    assert np.allclose(tree["sample_stats"]["lp"], lp, rtol=1e-10)
    assert read_posterior(write_posterior(tree, tmp_path / "nuts.nc"))["posterior"].identical(tree["posterior"])
    ships = posterior_forecast(container, tree, ps.zigzag(10, 10), draws=20, rng=2, duration=20.0)
    assert ships.attrs["diverged_fraction"] == 0.0


@pytest.mark.slow
@pytest.mark.consistency
def test_draws_depend_on_the_seed_alone():
    again = mode_nuts_posterior(mode(), draws=20, chains=2, tune=100, rng=np.random.default_rng(6))
    assert np.array_equal(again["posterior"]["coefficients"], nuts(6, 20)["posterior"]["coefficients"])
    assert not np.array_equal(again["posterior"]["coefficients"], nuts(7, 20)["posterior"]["coefficients"])


@pytest.mark.slow
@pytest.mark.consistency
def test_pymc_samples_the_model():
    """Compiled by numba, without a warning."""
    with mode_model(mode("correlated")):
        tree = pm.sample(draws=5, tune=5, chains=1, random_seed=1, progressbar=False, quiet=True)
    assert tree["posterior"]["coefficients"].dims == ("chain", "draw", "coefficient")
    assert tree["posterior"]["sensor_offset"].dims == ("chain", "draw", "run", "channel")
    assert tree["observed_data"]["response"].dims == ("row", "channel")
    assert np.isfinite(tree["posterior"]["initial_state"]).all()
