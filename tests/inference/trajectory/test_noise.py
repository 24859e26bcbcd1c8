"""Noise models chosen by residuals, fits under them, and intervals where the noise is ignored."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from scipy import stats
from scipy.linalg import block_diag

from pymc_ship.inference.rows.weak_form import weak_form_start
from pymc_ship.inference.trajectory import noise as trajectory_noise
from pymc_ship.inference.trajectory.fit import fit_trajectory, run_rows, white_noise, whiten
from pymc_ship.inference.trajectory.noise import (
    ALPHA,
    LAGS,
    fit_with_noise,
    kurtosis_test,
    offset_test,
    residual_tests,
    sample_residuals,
    serial_test,
)
from pymc_ship.inference.trajectory.posterior import approximate_draws
from pymc_ship.machine.errors import FitError
from pymc_ship.physics.vessel.vessel import reference_coefficients
from pymc_ship.trial.record import second_difference_sd
from tests.inference.trajectory.cases import SD, correlated, heavy_tailed, problem_of, rough, truth, white
from tests.sentences import refused

HEADING = ("u", "v", "r", "psi")


def briefly_correlated(rng, n):
    """A correlation that is gone after half a second."""
    return correlated(rng, n, at_lag_one=0.7)


def far_off(rng, n):
    """White noise about an offset; heading and rate of turn together identify it."""
    return rng.standard_normal(n) + 4.0 * rng.choice([-1.0, 1.0])


@pytest.fixture(scope="module")
def choose(ship, zigzag):
    """Noise chosen for the zigzag with noise of a law."""

    def chosen(law, seed=0, channels=("u", "v", "r"), **settings):
        trial = rough(zigzag, seed, law)
        problem = problem_of(ship, [trial], channels=channels)
        start = weak_form_start(trial, ship, problem.prior.mean, problem.prior.scale, method="rk4")
        return fit_with_noise(problem.runs, ship, problem.prior, start, **settings)

    return chosen


@pytest.fixture(scope="module")
def choices(choose):
    laws = {"white": white, "ar1": briefly_correlated, "student_t": heavy_tailed}
    chosen = {name: choose(law) for name, law in laws.items()}
    return chosen | {name: choose(law, channels=HEADING) for name, law in (("heading", white), ("offsets", far_off))}


def covered_fraction(fit, ship):
    draws = approximate_draws(fit, 1, 400, np.random.default_rng(0))[0][:, : fit.coefficients.size]
    low, high = np.quantile(draws, (0.05, 0.95), axis=0)
    reference = reference_coefficients(ship)
    return np.mean((low <= reference) & (reference <= high))


def test_a_text_does_not_switch_offsets_on(ship, zigzag):
    with refused(FitError, "offsets", "no"):
        fit_with_noise([], ship, None, truth(ship, []), offsets="no")


class TestChoice:
    @pytest.mark.parametrize("name", ["white", "heading"])
    def test_white_noise_stays_white(self, choices, name):
        choice = choices[name]
        tests = choice.tests
        assert (choice.kind, choice.offsets, choice.degrees_of_freedom) == ("white", False, np.inf)
        assert min(tests.serial, tests.offset, tests.tails, tests.size) > 10.0 * ALPHA
        assert choice.fit.chi2 == pytest.approx(1.0, abs=0.1)
        assert choice.sentence.startswith("Fitted with white normal noise: the residuals are white; chi2 per value 0.9")

    def test_correlated_noise_is_whitened(self, choices):
        """The correlation is that of blocks of two samples: (1 + 0.7)^2 0.7 / (2 (1 + 0.7)) of an AR(1) with 0.7."""
        choice = choices["ar1"]
        assert choice.kind == "ar1"
        assert choice.tests.serial < ALPHA
        np.testing.assert_allclose(choice.fit.problem.noise[0].correlation, 0.5 * 0.7 * 1.7, atol=0.12)
        assert choice.fit.chi2 == pytest.approx(1.0, abs=0.05)
        assert "show serial correlation (p = " in choice.sentence
        for residuals in choice.fit.residuals[0]:
            assert abs(np.corrcoef(residuals[1:], residuals[:-1])[0, 1]) < 4.0 / np.sqrt(residuals.size) + 0.05

    def test_heavy_tails_lead_to_students_t(self, choices, ship):
        choice = choices["student_t"]
        assert choice.kind == "student_t"
        assert choice.degrees_of_freedom in (2.5, 3.0, 4.0)
        assert choice.tests.tails < ALPHA
        scale = choice.fit.problem.noise[0].sd * np.sqrt(2.0 * (choice.degrees_of_freedom + 1.0))
        scale /= np.sqrt(choice.degrees_of_freedom + 3.0)
        np.testing.assert_allclose(scale, np.array([SD["u"], SD["v"], SD["r"]]) / np.sqrt(3.0), rtol=0.2)

    def test_offsets_are_estimated(self, choices, zigzag, choose):
        choice = choices["offsets"]
        assert (choice.kind, choice.offsets) == ("white", True)
        assert choice.tests.offset < ALPHA
        assert "and a constant offset of each sensor" in choice.sentence
        fit = choice.fit
        drawn = np.median([rough(zigzag, 0, far_off)[name] - zigzag[name] for name in HEADING], axis=1)
        sd = np.sqrt(np.sum(fit.square_root[-4:] ** 2, axis=1))
        assert np.max(np.abs(fit.unknowns[-4:] - drawn) / sd) < 4.0
        assert abs(fit.unknowns[-2]) / sd[-2] > 5.0

    def test_a_noise_sd_other_than_given_is_corrected(self, ship, zigzag):
        trial = rough(zigzag, 0)
        problem = problem_of(ship, [trial], noise_sd={name: 2.0 * SD[name] for name in ("u", "v", "r")})
        start = truth(ship, [zigzag])[:53]
        choice = fit_with_noise(problem.runs, ship, problem.prior, start)
        assert (choice.kind, choice.offsets) == ("white", False)
        assert choice.tests.size < ALPHA
        assert "a size that differs from the sd assumed" in choice.sentence
        np.testing.assert_allclose(choice.fit.problem.noise[0].sd / problem.noise[0].sd, 0.5, rtol=0.1)

    def test_a_given_noise_model_is_used(self, choose, choices):
        choice = choose(white, noise="ar1", offsets=True)
        assert (choice.kind, choice.offsets) == ("ar1", True)
        assert np.abs(choice.fit.problem.noise[0].correlation).max() < 0.15
        plain = choose(far_off, channels=HEADING, noise="white", offsets=False)
        assert (plain.kind, plain.offsets) == ("white", False)
        assert plain.tests == choices["offsets"].tests
        assert plain.fit.log_evidence < choices["offsets"].fit.log_evidence - 10.0

    def test_noise_correlated_over_seconds_is_fitted_though_second_differences_miss_it(self, choose, ship):
        choice = choose(correlated)
        assert choice.kind == "ar1"
        assert choice.fit.chi2 == pytest.approx(1.0, abs=0.05)
        run = choice.fit.problem.runs[0]
        assert (choice.fit.problem.noise[0].sd > 3.0 * run.sample_sd / np.sqrt(run.block)).all()
        assert covered_fraction(choice.fit, ship) > 0.75

    def test_runs_of_several_lengths(self, ship, zigzag):
        trials = [rough(zigzag, 0, heavy_tailed), rough(zigzag, 1, heavy_tailed).isel(time=slice(0, 700))]
        problem = problem_of(ship, trials)
        choice = fit_with_noise(problem.runs, ship, problem.prior, truth(ship, [zigzag])[:53])
        assert choice.kind == "student_t"
        assert [residuals.shape for residuals in choice.fit.residuals] == [(3, 600), (3, 350)]


class TestTests:
    def test_they_reject_no_more_often_than_they_should(self, ship, zigzag, monkeypatch):
        """Residuals of white noise alone, 100 times: p below 0.05 in 5 %, with Bonferroni's loss."""
        problem = problem_of(ship, [rough(zigzag, 0)])
        fit = fit_trajectory(problem, truth(ship, [zigzag]))
        clean = fit.problem.runs[0].samples - sample_residuals(fit.problem, fit.unknowns)[0]
        monkeypatch.setattr(trajectory_noise, "offset_test", lambda fit: 1.0)
        rng, p_values = np.random.default_rng(8), []
        run = fit.problem.runs[0]
        for _ in range(100):
            errors = run.sample_sd[:, None] * rng.standard_normal(clean.shape)
            other = replace(run, samples=clean + errors)
            white_residuals = run.block_means(errors) / fit.problem.noise[0].sd[:, None]
            drawn = replace(fit, problem=replace(fit.problem, runs=(other,)), residuals=(white_residuals,))
            tests = residual_tests(drawn)
            p_values.append((tests.serial, tests.tails, tests.size))
        rejected = np.sum(np.array(p_values) < 0.05, axis=0)
        assert (rejected <= stats.binom.isf(1e-4, 100, 0.05)).all()
        assert rejected[0] + rejected[1] >= 2

    @pytest.fixture(scope="class")
    @classmethod
    def one_channel(cls, ship, zigzag):
        """Run of one channel with five samples to a block."""
        (run,) = problem_of(ship, [rough(zigzag, 0)], channels=("u",)).runs
        return replace(run, block=5)

    @staticmethod
    def fit_of(run, errors, monkeypatch, factor=1.0):
        """Residuals of a run: errors of its samples, whitened by ``factor`` times the sd assumed."""
        monkeypatch.setattr(trajectory_noise, "offset_test", lambda fit: 1.0)
        monkeypatch.setattr(trajectory_noise, "sample_residuals", lambda problem, unknowns: [errors])
        noise = white_noise(run)
        noise = replace(noise, sd=factor * noise.sd)
        residuals = (run.block_means(errors) / noise.sd[:, None],)
        problem = SimpleNamespace(runs=(run,), noise=(noise,))
        return SimpleNamespace(problem=problem, residuals=residuals, unknowns=None)

    @pytest.mark.parametrize("n", [40, 20_000])
    def test_the_test_of_tails_is_that_of_scipy(self, n):
        samples = np.random.default_rng(5).standard_t(8.0, (4, n))
        expected = stats.kurtosistest(samples, axis=1, alternative="greater").pvalue
        np.testing.assert_allclose(kurtosis_test(samples), expected, rtol=1e-11)

    def test_the_size_scatters_as_its_p_says_where_the_sd_is_right(self, one_channel, monkeypatch):
        """White noise whose sd comes from its own second differences, 800 times: squares of a standard normal value."""
        rng, p = np.random.default_rng(9), []
        for _ in range(800):
            errors = rng.standard_normal(one_channel.samples.shape)
            run = replace(one_channel, sample_sd=second_difference_sd(errors))
            p.append(residual_tests(self.fit_of(run, errors, monkeypatch)).size)
        assert abs(np.mean(stats.norm.isf(0.5 * np.array(p)) ** 2) - 1.0) < 4.0 * np.sqrt(2.0 / 800)

    def test_the_size_does_not_depend_on_the_sd_that_whitened_the_residuals(self, one_channel, monkeypatch):
        errors = one_channel.sample_sd[:, None] * np.random.default_rng(10).standard_normal(one_channel.samples.shape)
        sizes = [residual_tests(self.fit_of(one_channel, errors, monkeypatch, by)).size for by in (1.0, 0.5, 3.0)]
        assert 1e-3 < sizes[0] < 0.999
        np.testing.assert_allclose(sizes, sizes[0], rtol=1e-9)

    def test_the_sd_of_blocks_of_students_t_is_that_of_their_pseudo_data(self, one_channel, monkeypatch):
        """The mean of scores over the Fisher information has the variance 1 / (n I) about a motion that is given."""
        errors = stats.t.rvs(3.0, size=(1, 200_000), random_state=np.random.default_rng(11))
        motion = np.linspace(0.0, 5.0, errors.size)[None]
        run = replace(one_channel, samples=motion + errors, inputs=np.zeros((4, errors.size)))
        nu, (noise,) = trajectory_noise._student_noise(self.fit_of(run, errors, monkeypatch), offsets=False)
        square = ((noise.values - run.block_means(motion)) / noise.sd[:, None]) ** 2
        assert nu == 3.0
        assert abs(square.mean() - 1.0) < 4.0 * square.std() / np.sqrt(square.size)

    @pytest.mark.parametrize("n", [16, 44])
    def test_the_mean_of_ljung_and_box_is_the_number_of_lags_in_short_records_too(self, n):
        """Normal noise about 0 has E r_k^2 = (n - k) / (n (n + 2)) exactly (Ljung & Box 1978, Eq. 2.3)."""
        lags = min(LAGS, n // 4)
        rows = np.random.default_rng(3).standard_normal((4000, n))
        p = [serial_test(SimpleNamespace(residuals=(row[None],))) for row in rows]
        statistics = stats.chi2.isf(p, lags)
        assert statistics.mean() == pytest.approx(lags, abs=4.0 * statistics.std() / np.sqrt(statistics.size))

    def test_samples_are_fitted_motion_and_residuals(self, choices):
        fit = choices["offsets"].fit
        run, values = fit.problem.runs[0], sample_residuals(fit.problem, fit.unknowns)[0]
        blocks = run.block_means(values) / fit.problem.noise[0].sd[:, None]
        np.testing.assert_allclose(blocks, fit.residuals[0], atol=1e-6)

    @pytest.mark.parametrize("name", ["heading", "offsets", "ar1"])
    def test_the_offset_test_is_that_of_generalised_least_squares(self, choices, name):
        """Constants regressed on the residuals of the linearised model, with all covariances written out."""
        fit = choices[name].fit
        problem, n = fit.problem, fit.problem.n_coefficients
        fit = fit_trajectory(replace(problem, noise=(replace(problem.noise[0], offsets=False),)), fit.unknowns[: n + 6])
        problem, run, noise = fit.problem, fit.problem.runs[0], fit.problem.noise[0]
        misfit, design = run_rows(problem.vessel, run, noise, fit.coefficients, fit.unknowns[n:])
        J = np.vstack(list(design)) * problem.unit
        linear_residuals = misfit.ravel() + J @ ((fit.unknowns - problem.center) / problem.unit)
        ones = np.ones(run.n_blocks)
        X = block_diag(*(whiten(ones, *law)[:, None] for law in zip(noise.sd, noise.correlation, strict=True)))
        C = np.eye(len(J)) + J / problem.precision @ J.T
        score, information = X.T @ np.linalg.solve(C, linear_residuals), X.T @ np.linalg.solve(C, X)
        statistic = score @ np.linalg.solve(information, score)
        assert offset_test(fit) == pytest.approx(stats.chi2.sf(statistic, X.shape[1]), rel=0.02, abs=1e-12)

    def test_the_offset_test_of_diverging_unknowns_is_an_error(self, choices):
        fit = choices["heading"].fit
        with pytest.raises(FitError):
            offset_test(replace(fit, unknowns=1e3 * fit.unknowns))


@pytest.mark.slow
@pytest.mark.consistency
class TestCoverage:
    """Fractions of 53 coefficients within their 90 % intervals over 30 seeds, with the scatter between seeds."""

    def ensemble(self, ship, zigzag, law, **settings):
        shares = []
        for seed in range(30):
            trial = rough(zigzag, 100 + seed, law)
            problem = problem_of(ship, [trial])
            start = weak_form_start(trial, ship, problem.prior.mean, problem.prior.scale, method="rk4")
            shares.append(
                covered_fraction(fit_with_noise(problem.runs, ship, problem.prior, start, **settings).fit, ship)
            )
        return np.mean(shares), np.std(shares) / np.sqrt(len(shares))

    def test_intervals_hold_under_white_noise_and_would_not_at_a_third_of_its_sd(self, ship, zigzag):
        mean, error = self.ensemble(ship, zigzag, white)
        assert abs(mean - 0.9) < 4.0 * error + 0.02
        narrow = []
        for seed in range(10):
            problem = problem_of(ship, [rough(zigzag, 100 + seed)])
            third = tuple(replace(noise, sd=noise.sd / 3.0) for noise in problem.noise)
            fit = fit_trajectory(replace(problem, noise=third), truth(ship, [zigzag]))
            narrow.append(covered_fraction(fit, ship))
        assert np.mean(narrow) < 0.8

    def test_intervals_hold_under_correlated_noise_unless_it_is_ignored(self, ship, zigzag):
        mean, error = self.ensemble(ship, zigzag, briefly_correlated)
        ignored, _ = self.ensemble(ship, zigzag, briefly_correlated, noise="white", offsets=False)
        assert mean > 0.84 - 4.0 * error
        assert ignored < mean - 0.05

    def test_intervals_hold_under_heavy_tails_and_are_tighter_than_those_of_a_normal(self, ship, zigzag):
        mean, error = self.ensemble(ship, zigzag, heavy_tailed)
        assert abs(mean - 0.9) < 4.0 * error + 0.03
