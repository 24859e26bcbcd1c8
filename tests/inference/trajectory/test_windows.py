"""Fits to short windows: their times, the forces they identify, and a covariance with model error."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
import xarray as xr

import pymc_ship as ps
from pymc_ship.inference.rows.weak_form import weak_form_start
from pymc_ship.inference.trajectory import prior as priors
from pymc_ship.inference.trajectory import windows as window_fit
from pymc_ship.inference.trajectory.fit import fit_trajectory, initial_problem
from pymc_ship.inference.trajectory.mode import TrajectoryMode
from pymc_ship.inference.trajectory.noise import NoiseChoice, residual_tests
from pymc_ship.inference.trajectory.posterior import laplace_posterior
from pymc_ship.inference.trajectory.prior import wide_prior as window_prior
from pymc_ship.inference.trajectory.runs import trajectory_run
from pymc_ship.inference.trajectory.scale_law import ScaleLaw
from pymc_ship.inference.trajectory.windows import (
    LENGTH,
    SAMPLES,
    Window,
    WindowFit,
    fit_windows,
    inflate_covariance,
    normal_draws,
    prepared_windows,
    thin_record,
    window_misfit,
    window_records,
)
from pymc_ship.machine.errors import TrialError
from pymc_ship.physics.motion.replay import replay
from pymc_ship.physics.vessel.term_sets import with_terms
from pymc_ship.physics.vessel.vessel import coefficient_names, reference_coefficients
from tests.inference.trajectory.cases import correlated
from tests.physics.vessel.cases import small_vessel
from tests.sentences import refused
from tests.ships.identification.cases import RUNS, TRUE_TERMS, tanker, trial, wide_prior, with_values

UNIT = 320.0 / 7.974  # s
FEW = {"surge": ("Xuu",), "sway": ("Yv", "Yr", "Ydelta"), "yaw": ("Nv", "Nr", "Ndelta")}
ERROR = {"u": 0.04, "v": 0.03, "r": 2e-4}
N_WINDOWS, N_SAMPLES, N_SETS = 20, 20, 100


@pytest.fixture(scope="module")
def fast():
    """Record at 20 samples a second, sixteen to an average."""
    return trial(RUNS[0], interval=0.25).interp(time=np.arange(0.0, 599.0, 0.05))


class TestThinned:
    def test_a_fast_record_is_averaged(self, fast):
        thin = thin_record(fast, tanker())
        n = 16
        assert n == int(UNIT / SAMPLES / 0.05)
        whole = fast.sizes["time"] // n
        assert thin.sizes["time"] == whole
        np.testing.assert_allclose(np.diff(thin["time"]), 0.8, rtol=1e-9)
        for name in ("u", "v", "r", "psi", "x", "y", "delta"):
            means = fast[name].values[: whole * n].reshape(whole, n).mean(axis=1)
            np.testing.assert_allclose(thin[name], means, rtol=1e-12, atol=1e-12)
        assert thin.attrs == fast.attrs
        assert thin["u"].attrs == fast["u"].attrs

    def test_a_heading_that_jumps_by_a_circle_is_made_continuous_first(self, fast):
        turned = fast.assign(psi=("time", np.angle(np.exp(1j * (fast["psi"].values + np.pi)))))
        assert np.abs(np.diff(turned["psi"])).max() > 6.0
        continuous, straight = (thin_record(run, tanker())["psi"].values for run in (turned, fast))
        np.testing.assert_allclose(continuous - continuous[0], straight - straight[0], atol=1e-9)

    def test_a_slow_record_is_not_averaged(self):
        run = trial(RUNS[0])
        xr.testing.assert_identical(thin_record(run, tanker()), run)

    @pytest.mark.parametrize("step", [0.05, 0.0166667, UNIT * 2.5 / 300.9 / 20.0])
    def test_half_a_window_is_the_shortest_record(self, step):
        whole = trial(RUNS[0], duration=150.0).interp(time=np.arange(0.0, 110.0, step))
        sizes = np.arange(30 - 60, 30) + int(0.5 * LENGTH * UNIT / step)
        passed = [self.passes(whole.isel(time=slice(0, size))) for size in sizes]
        first = passed.index(True)
        assert 10 < first < 50
        assert all(passed[first:])
        with refused(TrialError, 5, 201):
            thin_record(whole.isel(time=slice(0, sizes[first - 1])), tanker())

    @staticmethod
    def passes(run):
        """Whether a run is long enough; then it has a window."""
        try:
            thin = thin_record(run, tanker())
        except TrialError:
            return False
        assert len(window_records(thin, tanker())) == 1
        return True


class TestWindows:
    @pytest.mark.parametrize(("size", "windows"), [(201, 1), (301, 2), (300, 1), (402, 2), (402 + 100, 3), (501, 2)])
    def test_they_are_consecutive_and_a_remainder_of_half_a_window_counts(self, size, windows):
        record = trial(RUNS[0]).isel(time=slice(0, size))
        windows_of_record = window_records(record, tanker())
        assert len(windows_of_record) == windows
        assert round(LENGTH * UNIT) == 201
        assert all(window.sizes["time"] == 201 for window in windows_of_record[:-1])
        covered = np.concatenate([window["time"].values for window in windows_of_record])
        np.testing.assert_array_equal(covered, record["time"].values[: covered.size])
        assert size - covered.size < 101

    def test_each_is_a_run_that_restarts_from_the_smoothed_record(self):
        run = trial(RUNS[0])
        rough = run.assign(u=run["u"] + 0.05 * np.random.default_rng(3).standard_normal(660))
        windows, records = (make(rough, tanker()) for make in (prepared_windows, window_records))
        for window, record in zip(windows, records, strict=True):
            np.testing.assert_array_equal(window.run.samples[0], record["u"])
            clean = float(run["u"].sel(time=float(record["time"][0])))
            assert abs(window.state[0] - clean) < 0.06
            assert window.state[3:].tolist() == [0.0, 0.0]
            assert window.run.channels == ("u", "v", "r")
        moved = np.mean([abs(w.state[0] - float(r["u"][0])) for w, r in zip(windows, records, strict=True)])
        assert moved > 0.01

    def test_a_rolling_ship_is_also_fitted_to_its_roll(self, container):
        run = trial(ps.zigzag(20.0, 20.0), vessel=container, duration=100.0, interval=0.25)
        (window,) = prepared_windows(run, container)
        assert window.run.channels == ("u", "v", "r", "p", "phi")
        assert np.abs(window_misfit(window, container, reference_coefficients(container))).max() < 0.1

    def test_the_true_forces_have_no_residuals_in_a_clean_record(self):
        windows = prepared_windows(trial(RUNS[0]), tanker())
        true = reference_coefficients(tanker())
        # the first window has the corner of the rudder's first movement, which a record has up to 1 s late
        assert np.abs(window_misfit(windows[0], tanker(), true)).max() < 0.01
        for window in windows[1:]:
            misfit = window_misfit(window, tanker(), true)
            assert misfit.shape == (3, window.run.n_blocks)
            assert np.abs(misfit).max() < 5e-4
        wrong = true.copy()
        wrong[-2] *= 1.1
        assert np.abs(window_misfit(windows[1], tanker(), wrong)).max() > 0.01

    def test_a_ship_that_leaves_the_range_is_nan(self):
        (window, *_) = prepared_windows(trial(RUNS[0]), tanker())
        assert np.isnan(window_misfit(window, tanker(), -100.0 * reference_coefficients(tanker()))).all()


@pytest.fixture(scope="module")
def fitted():
    """Fit of the true terms, from the prior mean, to noise-free windows of three runs."""
    runs = [trial(what) for what in RUNS]
    vessel = with_terms(tanker(), TRUE_TERMS)
    prior = window_prior(runs, vessel)
    start = weak_form_start(runs, vessel, prior.mean, prior.scale, method="rk4")
    windows = [window for run in runs for window in prepared_windows(run, vessel)]
    return fit_windows(windows, vessel, prior, start)


class TestMode:
    def test_draws_are_of_the_fit_with_its_effective_sd(self):
        vessel = with_terms(tanker(), TRUE_TERMS)
        prior, start = wide_prior(reference_coefficients(vessel), 1.0), reference_coefficients(vessel)
        windows = prepared_windows(trial(RUNS[0], seed=1), vessel)
        fit = fit_windows(windows, vessel, prior, start)
        mode_fit = fit.mode
        noise_choice = NoiseChoice(mode_fit, "white", False, np.inf, residual_tests(mode_fit), "")
        np.testing.assert_array_equal(mode_fit.coefficients, fit.coefficients)
        np.testing.assert_allclose(np.linalg.inv(mode_fit.covariance), fit.information, rtol=1e-9)
        for noise in mode_fit.problem.noise:
            np.testing.assert_allclose(noise.sd, list(fit.effective_sd.values()), rtol=0.03)
        tree = laplace_posterior(
            TrajectoryMode(noise_choice, 1, 1, {}), draws=400, chains=2, rng=np.random.default_rng(1)
        )
        drawn = tree["posterior"]["coefficients"].stack(sample=("chain", "draw")).transpose("sample", ...).values
        z = (drawn.mean(axis=0) - fit.coefficients) / (drawn.std(axis=0) / np.sqrt(400))
        assert np.abs(z).max() < 4.5
        wrong = (drawn.mean(axis=0) - fit.coefficients - 0.5 * mode_fit.sd) / (drawn.std(axis=0) / np.sqrt(400))
        assert np.abs(wrong).max() > 4.5


class TestFit:
    def test_a_clean_record_gives_the_indices_of_the_true_ship(self, fitted):
        assert fitted.n_windows == 9
        for what in (*RUNS, ps.turning_circle(25.0)):
            true, fitted_indices = (
                ps.indices(ps.simulate(vessel, what, duration=900.0, step=0.05, record_interval=1.0, method="rk4"))
                for vessel in (tanker(), with_values(tanker(), fitted.coefficients))
            )
            for name in true:
                if np.isfinite(true[name]):
                    assert float(fitted_indices[name]) == pytest.approx(float(true[name]), rel=5e-3), (what.label, name)

    def test_the_estimated_noise_is_that_of_the_residuals(self, fitted):
        assert fitted.channel_sd.keys() == {"u", "v", "r"}
        assert max(fitted.channel_sd["u"], fitted.channel_sd["v"], 100.0 * fitted.channel_sd["r"]) < 1e-3

    def test_its_covariances_are_symmetric_and_not_negative(self, fitted):
        for matrix in (fitted.covariance, fitted.information):
            size = np.sqrt(np.diag(matrix))
            assert np.linalg.eigvalsh(matrix / np.outer(size, size)).min() > -1e-9
            np.testing.assert_allclose(matrix, matrix.T, rtol=1e-6, atol=1e-6 * np.abs(matrix).max())

    def test_a_scale_of_the_prior_is_fixed(self, container, monkeypatch):
        monkeypatch.setattr(priors, "FREEDOM", 1e9)
        ship, reference, windows = tiny(container)
        one = ScaleLaw(np.ones((reference.size, 1)), np.zeros(1), ("tau",))
        tight = replace(wide_prior(1.1 * reference, 1e-4), law=one)
        fit = fit_windows(windows, ship, tight, reference)
        np.testing.assert_allclose(fit.coefficients, 1.1 * reference, rtol=1e-3)
        sd = np.sqrt(np.diag(np.linalg.inv(fit.information)))
        np.testing.assert_allclose(sd, 1.1e-4 * np.abs(reference), rtol=0.01)
        estimated_sd = np.sqrt(np.diag(fit.covariance))  # the prior is an observation, too
        assert (estimated_sd > 0.99 * sd).all()
        assert (estimated_sd < 2.0 * sd).all()


def tiny(container):
    """Hull of seven coefficients, their values, and clean windows of 20 s with states and rudders of any."""
    ship = small_vessel(container, FEW)
    reference = reference_coefficients(ship)
    time, knots = np.arange(float(N_SAMPLES)), np.arange(0.0, N_SAMPLES + 10.0, 10.0)
    windows = []
    for k in range(N_WINDOWS):
        rng = np.random.default_rng(k)
        delta = np.deg2rad(np.interp(time, knots, rng.uniform(-20.0, 20.0, knots.size)))
        state = np.array([12.0, 0.3 * rng.standard_normal(), 0.003 * rng.standard_normal(), 0.0, 0.0])
        motion = replay(ship, delta, state, reference, interval=1.0)[:, 0]
        channels = {name: ("time", motion[row]) for row, name in enumerate(ERROR)} | {"delta": ("time", delta)}
        run = trajectory_run(xr.Dataset(channels, {"time": time}), ship, channels=tuple(ERROR), noise_sd=ERROR)
        windows.append(Window(replace(run, block=1, substeps=1, restart=(state, run.initial_state[1]))))
    return ship, reference, windows


def with_errors(windows, rng, at_lag_one):
    """Windows with errors of their own on every channel."""
    errors = (
        np.array([sd * correlated(rng, N_SAMPLES, at_lag_one=at_lag_one) for sd in ERROR.values()]) for _ in windows
    )
    runs = (replace(w.run, samples=w.run.samples + error) for w, error in zip(windows, errors, strict=True))
    return [Window(run) for run in runs]


@pytest.fixture(scope="module")
def many_fits(container):
    """True coefficients and fits to many data sets whose errors last for seconds."""
    ship, reference, windows = tiny(container)
    prior, rng = wide_prior(reference), np.random.default_rng(8)
    sets = [with_errors(windows, rng, 0.9) for _ in range(N_SETS)]
    return reference, [fit_windows(noisy, ship, prior, reference) for noisy in sets]


class TestConflict:
    """The prior mean of N_v is 20 of its sd from the truth."""

    @staticmethod
    def fits(container):
        ship, reference, windows = tiny(container)
        noisy, known = with_errors(windows, np.random.default_rng(3), 0.9), wide_prior(reference, 0.1)
        off = known.scale * [20.0 * (name == "Nv") for name in coefficient_names(ship)]
        planted = replace(known, mean=known.mean + off)
        return [fit_windows(noisy, ship, prior, reference) for prior in (known, planted)]

    def test_a_prior_that_the_windows_contradict_has_little_weight(self, container):
        right, planted = self.fits(container)
        sd = np.sqrt(np.diag(right.covariance))
        assert (np.abs(planted.coefficients - right.coefficients) < 0.5 * sd).all()
        *others, widest = np.sort(planted.mode.problem.prior.scale / right.mode.problem.prior.scale)
        assert max(others) < 1.1 < 8.0 < widest

    def test_a_normal_prior_the_broken_twin_has_much(self, container, monkeypatch):
        monkeypatch.setattr(priors, "FREEDOM", 1e9)
        right, planted = self.fits(container)
        assert (np.abs(planted.coefficients - right.coefficients) > 10.0 * np.sqrt(np.diag(right.covariance))).any()


class TestSandwich:
    MONTE_CARLO = 1.0 / np.sqrt(2.0 * (N_SETS - 1))  # relative, of a standard deviation from so many sets
    FEW_WINDOWS = len(FEW["sway"]) / (2.0 * N_WINDOWS)  # relative, what the fit takes of the windows' own errors

    @staticmethod
    def ratios(reference, fits, covariance):
        """Estimated standard deviation over that of the estimates, by coefficient."""
        estimates = np.array([fit.coefficients for fit in fits])
        estimated_sd = np.sqrt(np.mean([np.diag(covariance(fit)) for fit in fits], axis=0))
        return estimated_sd / estimates.std(axis=0, ddof=1)

    @pytest.mark.consistency
    def test_its_sd_is_that_of_the_estimates(self, many_fits):
        ratio = self.ratios(*many_fits, lambda fit: fit.covariance)
        assert np.max(np.abs(ratio - 1.0)) < 4.0 * self.MONTE_CARLO + self.FEW_WINDOWS

    @pytest.mark.consistency
    def test_that_of_independent_residuals_is_not(self, many_fits):
        """Broken twin: errors of a correlation of 0.9 count as independent."""
        ratio = self.ratios(*many_fits, lambda fit: np.linalg.inv(fit.information) / fit.design_effect)
        assert np.max(ratio) < 1.0 - 4.0 * self.MONTE_CARLO - self.FEW_WINDOWS

    @pytest.mark.consistency
    def test_the_curvature_is_the_mean_scatter_of_the_windows(self, many_fits):
        for fit in many_fits[1]:
            ratio = np.trace(fit.information @ fit.covariance) / len(fit.coefficients)
            assert ratio == pytest.approx(1.0, abs=0.1)

    @pytest.mark.consistency
    def test_the_estimates_scatter_about_the_truth(self, many_fits):
        reference, fits = many_fits
        estimates = np.array([fit.coefficients for fit in fits])
        standard_error = estimates.std(axis=0, ddof=1) / np.sqrt(N_SETS)
        assert np.max(np.abs(estimates.mean(axis=0) - reference) / standard_error) < 4.0

    @pytest.mark.consistency
    def test_the_noise_is_that_simulated(self, many_fits):
        """But for the degrees of freedom of initial states and coefficients."""
        _, fits = many_fits
        for name, sd in ERROR.items():
            assert 0.5 * sd < np.mean([fit.channel_sd[name] for fit in fits]) < sd

    def test_the_scatter_of_the_gradients_is_that_of_a_sample(self, container):
        """Of four windows: n times the sample covariance of gradients by central differences of each likelihood."""
        ship, reference, windows = tiny(container)
        noisy = with_errors(windows[:4], np.random.default_rng(4), 0.0)
        problem = initial_problem([window.run for window in noisy], ship, wide_prior(reference, 1e3))
        fit = fit_trajectory(problem, np.concatenate([reference, *(window.state for window in noisy)]))

        def log_likelihood(k, coefficients):
            run, noise = problem.runs[k], problem.noise[k]
            start = fit.unknowns[problem.nuisances[k]][: run.n_states]
            motion = replay(ship, run.inputs, start, coefficients, **run.integration)
            residuals = run.block_means(run.samples - motion[list(run.rows), 0])
            return -0.5 * np.sum((residuals / noise.sd[:, None]) ** 2)

        steps = 1e-4 * np.diag(np.abs(fit.coefficients))
        slopes = [
            [log_likelihood(k, fit.coefficients + h) - log_likelihood(k, fit.coefficients - h) for h in steps]
            for k in range(4)
        ]
        gradients = np.array(slopes) / (2.0 * np.diag(steps))
        expected, size = 4 * np.cov(gradients.T), np.sqrt(4.0) * gradients.std(axis=0, ddof=1)
        squared_gradients = window_fit._squared_gradients(fit)
        np.testing.assert_allclose(squared_gradients / np.outer(size, size), expected / np.outer(size, size), atol=0.02)


@pytest.mark.consistency
class TestWithAPrior:
    """A prior about the truth, as wide as the scatter of the estimates, halves the errors of each."""

    N_SETS = 12

    def remaining_error(self, container, many_fits):
        """Fraction of the error of an estimate that remains with the prior: slope over sets and coefficients."""
        ship, reference, windows = tiny(container)
        alone = np.array([fit.coefficients for fit in many_fits[1]])
        sd = alone.std(axis=0, ddof=1)
        prior = replace(wide_prior(reference), scale=sd, unit=sd)
        rng = np.random.default_rng(8)  # the first data sets again
        sets = [with_errors(windows, rng, 0.9) for _ in range(self.N_SETS)]
        combined = np.array([fit_windows(noisy, ship, prior, reference).coefficients for noisy in sets])
        x, y = ((rows - reference) / sd for rows in (alone[: self.N_SETS], combined))
        return np.sum(x * y) / np.sum(x**2)

    def test_windows_and_prior_have_equal_weight(self, container, many_fits):
        assert self.remaining_error(container, many_fits) == pytest.approx(0.5, abs=0.1)

    def test_windows_as_independent_data_outweigh_the_prior(self, container, many_fits, monkeypatch):
        """Broken twin."""
        monkeypatch.setattr(window_fit, "_design_effect", lambda fit: 0.0)
        assert self.remaining_error(container, many_fits) > 0.7


@pytest.mark.parametrize("known", [0.0, 1.0, 1e6])
def test_the_design_effect_does_not_depend_on_the_prior(known, monkeypatch):
    """Gradients that scatter three times as much as their curvature says, and a prior of half the coefficients."""
    root = np.random.default_rng(3).standard_normal((6, 6))
    curvature, precision = root @ root.T, known * np.repeat([0.0, 1.0], 3)
    problem = SimpleNamespace(n_shared=6, precision=precision, unit=np.ones(6), likelihood_design=np.empty((0, 6)))
    covariance = np.linalg.inv(curvature + np.diag(precision))
    fit = SimpleNamespace(square_root=np.linalg.cholesky(covariance), problem=problem)
    monkeypatch.setattr(window_fit, "_squared_gradients", lambda fit: 3.0 * curvature)
    assert window_fit._design_effect(fit) == pytest.approx(3.0, rel=1e-6)


@pytest.mark.consistency
def test_the_part_of_the_prior_is_not_inflated(many_fits):
    fit = many_fits[1][0]
    alone = replace(fit, from_windows=0.0 * fit.from_windows)
    np.testing.assert_array_equal(inflate_covariance(alone, 3.0).covariance, fit.from_prior)
    np.testing.assert_allclose(
        inflate_covariance(fit, 3.0).covariance - fit.covariance, 8.0 * fit.from_windows, rtol=1e-9
    )


def test_draws_have_the_mean_and_covariance_of_the_fit():
    rng = np.random.default_rng(2)
    root = rng.standard_normal((3, 3))
    fit = WindowFit(tanker(), np.array([1.0, -2.0, 3.0]), root @ root.T, np.zeros((3, 3)), np.eye(3), {}, 1.0, 5)
    n = 20_000
    draws = normal_draws(inflate_covariance(fit, 2.0), n, np.random.default_rng(3))
    white = np.linalg.solve(2.0 * root, (draws - fit.coefficients).T)
    assert np.max(np.abs(white.mean(axis=1))) < 4.0 / np.sqrt(n)
    assert np.max(np.abs(np.cov(white) - np.eye(3))) < 4.0 * np.sqrt(2.0 / n)
    assert np.max(np.abs(np.cov(2.0 * white) - np.eye(3))) > 1.0


@pytest.fixture(scope="module")
def without_half(container):
    """Half of noisy windows, ship, a prior that they contradict, and the fit to all windows."""
    ship, reference, windows = tiny(container)
    noisy, known = with_errors(windows, np.random.default_rng(3), 0.9), wide_prior(reference, 0.1)
    prior = replace(known, mean=known.mean + 20.0 * known.scale * (np.array(coefficient_names(ship)) == "Nv"))
    return noisy[: N_WINDOWS // 2], ship, prior, fit_windows(noisy, ship, prior, reference)


class TestConvergence:
    """A fit to half of the windows from the fit to all."""

    @staticmethod
    def distance(fit, other):
        """Largest difference of a coefficient [sd]."""
        return np.max(np.abs(fit.coefficients - other.coefficients) / np.sqrt(np.diag(other.covariance)))

    def test_it_ends_at_the_mode(self, without_half, monkeypatch):
        windows, ship, prior, whole = without_half
        fit = fit_windows(windows, ship, prior, whole)
        with monkeypatch.context() as patch:
            for name, value in {"_CHANGE": 1e-9, "_CONVERGED": 1e-6, "_PASSES": 100}.items():
                patch.setattr(window_fit, name, value)
            mode = fit_windows(windows, ship, prior, whole.coefficients)
        assert self.distance(whole, mode) > 0.5
        assert self.distance(fit, mode) < 0.05
        size = np.sqrt(np.diag(mode.covariance))
        np.testing.assert_allclose(
            fit.covariance / np.outer(size, size), mode.covariance / np.outer(size, size), atol=0.05
        )

    def test_a_start_has_the_initial_states_of_its_runs(self, without_half):
        windows, ship, prior, whole = without_half
        problem = initial_problem([window.run for window in windows[::-1]], ship, prior)
        begin, n = window_fit._unknowns_of(whole.mode, problem), whole.coefficients.size
        states = whole.mode.unknowns[n:].reshape(N_WINDOWS, -1)[: len(windows)]
        np.testing.assert_array_equal(begin[n:].reshape(len(windows), -1), states[::-1])
        np.testing.assert_array_equal(begin[:n], whole.coefficients)
