"""Posteriors from whole trajectories: densities, evidence by importance sampling, and the tree."""

from __future__ import annotations

import json
import sys
import warnings
from dataclasses import replace

import arviz as az
import numpy as np
import pytest
from arviz_stats.base.array import array_stats
from scipy import stats
from scipy.special import logsumexp

import pymc_ship as ps
from pymc_ship.inference.rows.weak_form import coefficient_scales
from pymc_ship.inference.trajectory.fit import fit_trajectory
from pymc_ship.inference.trajectory.posterior import (
    log_likelihood_rows,
    log_prior_density,
    pareto_khat,
    trajectory_mode,
    trajectory_posterior,
)
from pymc_ship.inference.trajectory.scale_law import FREEDOM
from pymc_ship.physics.forces.terms import SYMBOLS
from pymc_ship.physics.vessel.vessel import coefficient_names, reference_coefficients
from tests.inference.trajectory.cases import SD, problem_of, record, rough, truth
from tests.ships.ensemble.cases import posterior_forecast


@pytest.fixture(scope="module")
def trials(ship, zigzag):
    """Two runs, the second shorter, sampled at another interval and with the heading."""
    circle = record(ship, ps.turning_circle(35.0, approach_speed=9.0), duration=60.0, interval=0.2, begin=5.0)
    return [rough(zigzag, 0), rough(circle, 1)]


@pytest.fixture(scope="module")
def tree(ship, trials):
    return trajectory_posterior(trials, ship, draws=400, rng=np.random.default_rng(1))


@pytest.fixture(scope="module")
def shifted_fit(ship, trials):
    """Correlated noise on one run, offsets on the other."""
    problem = problem_of(ship, trials)
    first, second = problem.noise
    noise = (replace(first, correlation=np.full(3, 0.5)), replace(second, offsets=True))
    return fit_trajectory(replace(problem, noise=noise), np.append(truth(ship, trials), np.zeros(3)))


def test_runs_of_one_motion_are_named_in_the_posterior_and_others_are_not(ship, zigzag, trials):
    assert trajectory_mode(trials, ship).quality_flags["record_remarks"] == ""
    flags = trajectory_mode([rough(zigzag, 0), rough(zigzag, 2)], ship).quality_flags
    assert "Runs 1 and 2 are the same motion" in flags["record_remarks"]
    assert flags["record_verdict"] == "doubtful"


class TestDensities:
    def test_rows_of_the_log_likelihood_sum_to_that_of_the_fit(self, shifted_fit):
        rows = log_likelihood_rows(shifted_fit, shifted_fit.unknowns[None])
        assert rows.shape == (1, 600 + 300)
        assert rows.sum() == pytest.approx(shifted_fit.point.log_likelihood, rel=1e-10)

    def test_the_log_prior_integrates_to_one(self, shifted_fit):
        """Draws of the prior have the mean log density of a normal: minus its entropy."""
        problem, rng = shifted_fit.problem, np.random.default_rng(2)
        sd = problem.unit / np.sqrt(problem.precision)
        fixed = replace(shifted_fit, problem=replace(problem, prior=problem.prior.fixed))
        sd = problem.unit / np.sqrt(fixed.problem.precision)
        unknowns = problem.center + sd * rng.standard_normal((4000, sd.size))
        log_prior = log_prior_density(fixed, unknowns, np.empty((4000, 0)))
        expected = -np.sum(0.5 * np.log(2.0 * np.pi * np.e) + np.log(sd))
        assert abs(log_prior.mean() - expected) < 4.0 * log_prior.std() / np.sqrt(4000)
        assert log_prior.std() == pytest.approx(np.sqrt(0.5 * sd.size), rel=0.1)

    def test_with_factors_it_is_that_of_students_t(self, shifted_fit):
        problem, rng = shifted_fit.problem, np.random.default_rng(3)
        law, n = problem.prior.law, problem.n_coefficients
        eta = law.center + rng.standard_normal((2, law.center.size))
        unknowns = problem.center + problem.unit * rng.standard_normal((2, problem.unit.size))
        scale = problem.prior.scale * np.exp(eta @ law.exponents.T)
        of_t = stats.t.logpdf(unknowns[:, :n], FREEDOM, problem.prior.mean, scale).sum(axis=1)
        others = stats.norm.logpdf(unknowns[:, n:], problem.center[n:], problem.unit[n:]).sum(axis=1)
        np.testing.assert_allclose(log_prior_density(shifted_fit, unknowns, eta), of_t + others, rtol=1e-10)

    def test_the_log_evidence_is_that_of_importance_sampling(self, ship, zigzag):
        """Three free coefficients, all others fixed by a table: weights are even and their mean is the evidence."""
        free, names, reference = ("Yv", "Nr", "Xuu"), coefficient_names(ship), reference_coefficients(ship)
        typical = coefficient_scales([zigzag], ship)
        table = {
            name: (value, (0.5 if name in free else 1e-6) * size)
            for name, value, size in zip(names, reference, typical, strict=True)
        }
        prior = ps.coefficient_prior([zigzag], ship, "flat", table=table)
        fit = fit_trajectory(problem_of(ship, [rough(zigzag, 3)], prior), truth(ship, [zigzag]))
        standard = np.random.default_rng(3).standard_normal((1000, fit.unknowns.size))
        unknowns = fit.unknowns + standard @ fit.square_root.T
        log_q = -0.5 * np.sum(standard**2 + np.log(2.0 * np.pi), axis=1) - np.linalg.slogdet(fit.square_root)[1]
        log_weight = (
            log_likelihood_rows(fit, unknowns).sum(axis=1)
            + log_prior_density(fit, unknowns, np.empty((1000, 0)))
            - log_q
        )
        weight = np.exp(log_weight - log_weight.max())
        error = weight.std() / weight.mean() / np.sqrt(weight.size)
        assert error < 0.05
        assert logsumexp(log_weight) - np.log(1000) == pytest.approx(fit.log_evidence, abs=4.0 * error + 0.02)

    def test_draws_that_diverge_are_nan(self, shifted_fit):
        bad = np.stack([shifted_fit.unknowns, -shifted_fit.unknowns])
        rows = log_likelihood_rows(shifted_fit, bad)
        assert np.isfinite(rows[0]).all()
        assert np.isnan(rows[1]).any()


class TestKhat:
    @pytest.mark.parametrize("shape", [0.2, 0.5, 0.9])
    def test_it_is_the_shape_of_a_pareto_tail(self, shape):
        log_weight = -shape * np.log(np.random.default_rng(4).uniform(size=20_000))
        assert pareto_khat(log_weight) == pytest.approx(shape, abs=0.15)

    @pytest.mark.parametrize("count", [225, 226, 1000])
    def test_it_is_that_of_arviz(self, count):
        log_weight = np.random.default_rng(6).standard_t(4.0, count)
        expected = array_stats.psislw(log_weight.max() - log_weight)[1]
        assert pareto_khat(log_weight) == pytest.approx(expected, rel=1e-12)
        assert pareto_khat(1.01 * log_weight) != pytest.approx(expected, rel=1e-5)

    def test_equal_weights_have_no_tail(self):
        assert np.isnan(pareto_khat(np.zeros(100)))

    def test_a_narrow_proposal_has_a_large_k_hat(self):
        """Weights of a normal target under a normal of half its sd have no variance: k-hat about 3/4 and more."""
        z = np.random.default_rng(5).standard_normal((4000, 5))
        assert pareto_khat(-0.375 * -np.sum(z**2, axis=1)) > 0.7
        assert pareto_khat(-0.05 * np.sum(z**2, axis=1)) < 0.3


class TestMode:
    def test_two_distant_starts_reach_the_same_mode(self, ship, trials, monkeypatch):
        module, starts = sys.modules["pymc_ship.inference.trajectory.mode"], []
        plain = module.weak_form_start
        monkeypatch.setattr(
            module, "weak_form_start", lambda *args, **settings: starts.append(plain(*args, **settings)) or starts[-1]
        )
        mode = trajectory_mode(trials, ship)
        assert (mode.n_starts, mode.n_agreeing, len(starts)) == (2, 2, 2)
        assert np.max(np.abs(starts[0] - starts[1]) / mode.choice.fit.sd) > 1.0

    @pytest.mark.parametrize("prior", ["sister_ship", "flat"])
    def test_every_prior_leads_close_to_the_truth(self, ship, zigzag, prior):
        mode = trajectory_mode(rough(zigzag, 0, factor=0.1), ship, prior)
        fit = mode.choice.fit
        assert fit.problem.prior.kind == prior
        assert np.max(np.abs(fit.coefficients - reference_coefficients(ship)) / fit.sd) < 4.5
        assert mode.n_agreeing == 2


class TestTree:
    def test_groups_dims_and_coordinates(self, tree, ship):
        assert set(tree.children) == {"posterior", "log_likelihood", "log_prior", "observed_data", "constant_data"}
        posterior = tree["posterior"]
        assert dict(posterior.sizes) == {"chain": 4, "draw": 100, "coefficient": 53, "run": 2, "state": 5, "factor": 12}
        assert posterior["coefficient"].values.tolist() == coefficient_names(ship)
        assert posterior["state"].values.tolist() == ["u", "v", "r", "p", "phi"]
        assert tree["log_likelihood"]["response"].dims == ("chain", "draw", "row")
        assert tree["observed_data"]["response"].sizes == {"row": 900, "channel": 3}
        assert tree["constant_data"]["symbol"].values.tolist() == list(SYMBOLS)
        assert "sensor_offset" not in posterior

    def test_records_and_fit_are_stored_by_run_and_time(self, tree, trials):
        constant, observed = tree["constant_data"], tree["observed_data"]["response"]
        run = constant["run"].values
        assert np.bincount(run).tolist() == [600, 300]
        np.testing.assert_allclose(constant["time"].values[[0, 599, 600]], [0.05, 119.85, 5.0])
        np.testing.assert_allclose(observed[600:].sel(channel="r"), trials[1]["r"], rtol=1e-12)
        misfit = (observed - constant["fitted"]) / constant["block_sd"].isel(run_index=0)
        np.testing.assert_allclose(misfit[:600].std("row"), 1.0, atol=0.1)
        expected = [SD["u"], SD["v"], SD["r"]]
        np.testing.assert_allclose(constant["noise_sd"], expected, rtol=0.1)

    def test_draws_of_a_fixed_prior_have_the_moments_of_the_normal_approximation(self, ship, trials):
        fixed = ps.coefficient_prior(trials, ship).fixed
        fit = trajectory_mode(trials, ship, fixed).choice.fit
        tree = trajectory_posterior(trials, ship, fixed, draws=400, rng=np.random.default_rng(1))
        draws = tree["posterior"]["coefficients"].stack(sample=("chain", "draw")).values
        z = (draws.mean(axis=1) - fit.coefficients) / fit.sd * np.sqrt(400)
        assert np.abs(z).max() < 4.5
        np.testing.assert_allclose(draws.std(axis=1) / fit.sd, 1.0, atol=4.5 / np.sqrt(800))

    def test_attrs_describe_the_fit(self, tree, ship):
        attrs = tree.attrs
        assert attrs["method"] == "trajectory"
        assert attrs["noise_model"] == "white"
        assert attrs["noise_sentence"].startswith("Fitted with white normal noise")
        assert (attrs["starts"], attrs["starts_agreeing"], attrs["diverged_fraction"]) == (2, 2, 0.0)
        assert attrs["chi2"] == pytest.approx(1.0, abs=0.1)
        assert np.isfinite(attrs["pareto_khat"])
        factors = json.loads(attrs["prior"])["factors"]
        assert list(factors) == tree["posterior"]["factor"].values.tolist()
        np.testing.assert_allclose(
            list(factors.values()), tree["posterior"]["scale_factor"].median(("chain", "draw")), rtol=1e-4
        )

    def test_the_same_seed_gives_the_same_tree_and_another_one_another(self, ship, trials, tree):
        again = trajectory_posterior(trials, ship, draws=400, rng=np.random.default_rng(1))
        assert again.identical(tree)
        other = trajectory_posterior(trials, ship, draws=400, rng=np.random.default_rng(2))
        assert not other["posterior"].identical(tree["posterior"])

    def test_offsets_of_the_sensors_are_stored_by_run_and_channel(self, ship, trials):
        log_prior = trajectory_posterior(trials[1], ship, draws=40, offsets=True, rng=np.random.default_rng(1))
        offset = log_prior["posterior"]["sensor_offset"]
        assert offset.sizes == {"chain": 4, "draw": 10, "run": 1, "channel": 3}
        assert log_prior.attrs["noise_model"] == "white + offsets"
        assert np.abs(offset.mean(("chain", "draw")) / offset.std(("chain", "draw"))).max() < 5.0

    @pytest.mark.parametrize("ending", ["nc", "zarr"])
    def test_it_is_read_back_as_written(self, tree, tmp_path, ending):
        path = tmp_path / f"posterior.{ending}"
        ps.write_posterior(tree, path)
        back = ps.read_posterior(path)
        for group in tree.children:
            for name, values in tree[group].data_vars.items():
                np.testing.assert_array_equal(back[group][name].values, values.values)
        assert back.attrs["pareto_khat"] == tree.attrs["pareto_khat"]
        assert back.attrs["prior"] == tree.attrs["prior"]

    def test_arviz_reads_it(self, tree):
        table = az.summary(tree, var_names=["coefficients"], round_to="none")
        assert len(table) == 53
        assert (table["r_hat"].astype(float) < 1.05).all()
        assert az.ess(tree["posterior"].dataset)["coefficients"].min() > 200

    def test_leaving_one_out_counts_the_coefficients_that_the_records_determine(self, ship, zigzag):
        """One run at a tenth of the noise: up to 53 coefficients and 3 initial states."""
        trial = rough(zigzag, 0, factor=0.1)
        one = trajectory_posterior(trial, ship, draws=400, rng=np.random.default_rng(1))
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", UserWarning)  # a few rows of high Pareto k
            loo = az.loo(one)
        rows = one["log_likelihood"]["response"]
        assert loo.n_data_points == rows.sizes["row"] == 600
        assert 40.0 < loo.p < 70.0
        assert loo.elpd < float(rows.mean(("chain", "draw")).sum())

    def test_forecasts_take_it(self, tree, ship):
        forecast = posterior_forecast(ship, tree, ps.zigzag(10.0, 10.0), draws=50, rng=1, duration=60.0)
        expected = ps.simulate(ship, ps.zigzag(10.0, 10.0), duration=60.0, record_interval=0.5)
        low, high = (forecast["bands"]["psi"].sel(band=name) for name in ("lower", "upper"))
        assert (high - low).max() < 0.1 * np.ptp(expected["psi"].values)
        assert forecast.attrs["diverged_fraction"] == 0.0
