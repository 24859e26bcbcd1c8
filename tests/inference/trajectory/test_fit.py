"""Fits of whole trajectories: exact derivatives and densities, one mode from every start, evidence of the scales."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy import stats

import pymc_ship as ps
from pymc_ship.inference.rows.weak_form import coefficient_scales, weak_form_start
from pymc_ship.inference.trajectory.fit import fit_trajectory, linear_problem, linearise, whiten
from pymc_ship.inference.trajectory.prior import CoefficientPrior
from pymc_ship.machine.errors import FitError
from pymc_ship.physics.motion.replay import replay
from pymc_ship.physics.vessel.vessel import coefficient_names, reference_coefficients
from tests.inference.trajectory.cases import SD, problem_of, record, rough, truth

SD_GIVEN = {"u": SD["u"], "r": SD["r"]}
CORRELATION = np.array([0.0, 0.7, -0.3])


@pytest.fixture(scope="module")
def circle(ship):
    """Another length, another speed and another sampling interval."""
    return record(ship, ps.turning_circle(35.0, approach_speed=9.0), duration=60.0, interval=0.2)


@pytest.fixture(scope="module")
def problem(ship, zigzag):
    return problem_of(ship, [rough(zigzag, 0)])


@pytest.fixture(scope="module")
def two_runs(ship, zigzag, circle):
    """Correlated noise and offsets on the second of two runs."""
    problem = problem_of(ship, [rough(zigzag, 0).isel(time=slice(0, 400)), rough(circle, 1)])
    white, other = problem.noise
    return replace(problem, noise=(white, replace(other, correlation=CORRELATION, offsets=True)))


@pytest.fixture(scope="module")
def from_truth(problem, ship, zigzag):
    return fit_trajectory(problem, truth(ship, [zigzag]))


@pytest.fixture(scope="module")
def nearby(two_runs, ship, zigzag, circle):
    """Unknowns near the truth, offsets last."""
    at = np.concatenate([truth(ship, [zigzag, circle]), np.zeros(3)])
    return at + 0.01 * two_runs.unit * np.random.default_rng(5).standard_normal(at.size)


def weak_start(problem, trials):
    start = weak_form_start(trials, problem.vessel, problem.prior.mean, problem.prior.scale, method="rk4")
    return np.concatenate([start, *(run.initial_state[0] for run in problem.runs)])


def fitted_values(problem, unknowns):
    """Block means of all channels of all runs, offsets included, from the simulator alone."""
    values, n = [], problem.n_coefficients
    for run, noise, nuisance_slice in zip(problem.runs, problem.noise, problem.nuisances, strict=True):
        motion = replay(
            problem.vessel,
            run.inputs,
            unknowns[nuisance_slice][: run.n_states],
            unknowns[:n],
            interval=run.interval,
            substeps=run.substeps,
            block=run.block,
        )[list(run.rows), 0]
        values.append((motion + (unknowns[nuisance_slice][run.n_states :, None] if noise.offsets else 0.0)).ravel())
    return np.concatenate(values)


def dense_covariance(problem):
    """Covariance of all block means, written out."""
    blocks = []
    for run, noise in zip(problem.runs, problem.noise, strict=True):
        lag = np.abs(np.subtract.outer(np.arange(run.n_blocks), np.arange(run.n_blocks)))
        blocks += [sd**2 * rho**lag for sd, rho in zip(noise.sd, noise.correlation, strict=True)]
    covariance, begin = np.zeros((sum(map(len, blocks)),) * 2), 0
    for block in blocks:
        covariance[begin : begin + len(block), begin : begin + len(block)] = block
        begin += len(block)
    return covariance


def measured(problem):
    return np.concatenate([noise.values.ravel() for noise in problem.noise])


def log_normal(values, mean, covariance):
    """Log density of a multivariate normal."""
    size = np.sqrt(np.diag(covariance))
    root = np.linalg.cholesky(covariance / np.outer(size, size))
    return stats.norm.logpdf(np.linalg.solve(root, (values - mean) / size)).sum() - np.log(np.diag(root) * size).sum()


def differences(problem, unknowns, columns):
    """Central differences of the fitted values in the problem's units."""
    slopes = []
    for column in columns:
        move = np.zeros(unknowns.size)
        move[column] = 1e-4 * problem.unit[column]
        slopes.append((fitted_values(problem, unknowns + move) - fitted_values(problem, unknowns - move)) / 2e-4)
    return np.column_stack(slopes)


class TestLinearisation:
    def test_the_log_likelihood_is_the_normal_density_with_its_covariance_written_out(self, two_runs, nearby):
        expected = log_normal(measured(two_runs), fitted_values(two_runs, nearby), dense_covariance(two_runs))
        assert linearise(two_runs, nearby).log_likelihood == pytest.approx(expected, rel=1e-10)
        forgetful = replace(two_runs, noise=tuple(replace(n, correlation=np.zeros(3)) for n in two_runs.noise))
        assert abs(linearise(forgetful, nearby).log_likelihood - expected) > 1.0

    def test_the_gradient_is_that_of_finite_differences(self, two_runs, nearby):
        point, rng = linearise(two_runs, nearby), np.random.default_rng(6)
        for direction in rng.standard_normal((5, nearby.size)):
            low, high = (
                linearise(two_runs, nearby + size * two_runs.unit * direction).log_likelihood for size in (-1e-6, 1e-6)
            )
            assert point.gradient @ direction == pytest.approx((low - high) / 2e-6, rel=1e-5)

    def test_gradient_and_matrix_are_those_of_the_dense_normal_equations(self, two_runs, nearby):
        n = nearby.size
        columns = [0, 7, 20, 33, 52, 53, 54, 55, *range(n - 8, n - 5), *range(n - 3, n)]
        J, W = differences(two_runs, nearby, columns), np.linalg.inv(dense_covariance(two_runs))
        point, misfit = linearise(two_runs, nearby), measured(two_runs) - fitted_values(two_runs, nearby)
        expected = J.T @ W @ J
        size = np.sqrt(np.diag(expected))  # the differences err by the kinks of |v| and |r|
        information = point.matrix[np.ix_(columns, columns)]
        np.testing.assert_allclose(information / np.outer(size, size), expected / np.outer(size, size), atol=2e-4)
        np.testing.assert_allclose(point.gradient[columns] / size, -(J.T @ W @ misfit) / size, atol=2e-3)

    def test_the_information_of_two_runs_adds(self, two_runs, nearby):
        n, whole = two_runs.n_coefficients, linearise(two_runs, nearby)
        parts = []
        for run, noise, nuisance_slice in zip(two_runs.runs, two_runs.noise, two_runs.nuisances, strict=True):
            part = replace(two_runs, runs=(run,), noise=(noise,))
            parts.append(linearise(part, np.concatenate([nearby[:n], nearby[nuisance_slice]])))
        np.testing.assert_allclose(whole.matrix[:n, :n], sum(part.matrix[:n, :n] for part in parts), rtol=1e-12)
        assert whole.log_likelihood == pytest.approx(sum(part.log_likelihood for part in parts), rel=1e-13)
        first, second = two_runs.nuisances
        assert (whole.matrix[first, second] == 0.0).all()

    @pytest.mark.parametrize("correlation", [0.0, 0.8, -0.5])
    def test_whitened_noise_has_unit_covariance(self, correlation):
        lag = np.abs(np.subtract.outer(np.arange(30), np.arange(30)))
        root = np.linalg.cholesky(9.0 * correlation**lag)
        np.testing.assert_allclose(whiten(root, 3.0, correlation), np.eye(30), atol=1e-14)

    def test_a_ship_that_diverges_has_none(self, problem, ship, zigzag):
        assert linearise(problem, -truth(ship, [zigzag])) is None


class TestMode:
    def test_a_clean_record_gives_the_true_coefficients(self, ship, zigzag):
        given = {name: 1e-4 * SD[name] for name in ("u", "v", "r")}
        problem, expected = problem_of(ship, [zigzag], "flat", noise_sd=given), truth(ship, [zigzag])
        damped = ps.coefficient_prior([zigzag], ship)
        start = weak_form_start(zigzag, ship, damped.mean, damped.scale, method="rk4")
        fit = fit_trajectory(problem, np.concatenate([start, problem.runs[0].initial_state[0]]))
        assert fit.chi2 < 1e-4
        assert np.max(np.abs(fit.coefficients - expected[:53]) / fit.sd) < 0.05
        known = expected[:53] != 0.0
        assert np.max(np.abs(fit.coefficients[known] / expected[:53][known] - 1.0)) < 1e-3

    def test_it_is_the_same_from_the_truth_and_from_the_weak_form(self, problem, ship, zigzag, from_truth):
        start = weak_start(problem, rough(zigzag, 0))
        fit = fit_trajectory(problem, start)
        assert np.max(np.abs(start[:53] - from_truth.coefficients) / from_truth.sd) > 1.0
        assert np.max(np.abs(fit.unknowns - from_truth.unknowns)[:53] / from_truth.sd) < 0.01
        assert fit.log_evidence == pytest.approx(from_truth.log_evidence, abs=0.01)

    def test_the_posterior_falls_in_every_direction_from_the_mode(self, from_truth):
        problem, best = from_truth.problem, from_truth.unknowns

        def cost(unknowns):
            prior = np.sum(problem.precision * ((unknowns - problem.center) / problem.unit) ** 2)
            return 0.5 * prior - linearise(problem, unknowns).log_likelihood

        for standard in np.random.default_rng(7).standard_normal((5, best.size)):
            rise = cost(best + from_truth.square_root @ standard) - cost(best)
            assert rise == pytest.approx(0.5 * standard @ standard, rel=0.3)

    def test_all_channels_with_heading_and_track(self, ship, zigzag):
        channels = ["u", "v", "r", "psi", "x", "y"]
        trial = rough(zigzag, 0)
        problem = problem_of(ship, [trial], channels=channels)
        fit = fit_trajectory(problem, weak_start(problem, trial))
        plain = problem_of(ship, [trial])
        assert fit.unknowns.size == 53 + 8
        assert fit.chi2 == pytest.approx(1.0, abs=0.1)
        n = problem.n_coefficients
        gained = (
            linearise(problem, fit.unknowns).matrix[:n, :n] - linearise(plain, fit.unknowns[: n + 5]).matrix[:n, :n]
        )
        assert np.linalg.eigvalsh(gained).min() > -1e-6 * np.linalg.eigvalsh(gained).max()

    def test_a_record_may_begin_in_a_turn(self, ship, zigzag):
        late = rough(zigzag, 3).isel(time=slice(300, None))
        problem = problem_of(ship, [late])
        fit = fit_trajectory(problem, weak_start(problem, late))
        assert fit.chi2 == pytest.approx(1.0, abs=0.1)
        clean = [float(zigzag[name][300]) for name in ("u", "v", "r")]
        sd = np.sqrt(np.sum(fit.square_root[53:56] ** 2, axis=1))
        assert np.max(np.abs(fit.unknowns[53:56] - clean) / sd) < 4.0

    def test_fewer_values_than_unknowns_need_a_prior(self, ship):
        """20 s of two channels at 1 s: 40 values for 58 unknowns."""
        clean = record(ship, ps.zigzag(20.0, 20.0), duration=20.0, interval=1.0)
        settings = {"channels": ["u", "r"], "noise_sd": SD_GIVEN}
        sister = problem_of(ship, [rough(clean, 0)], "sister_ship", **settings)
        sister = replace(sister, prior=sister.prior.fixed)
        fit = fit_trajectory(sister, truth(ship, [clean]))
        assert fit.residuals[0].size == 40 < fit.unknowns.size
        assert (fit.sd < sister.prior.scale * (1.0 + 1e-9)).all()
        assert (fit.sd < 0.9 * sister.prior.scale).any()
        with pytest.raises(FitError):
            fit_trajectory(problem_of(ship, [clean], "flat", **settings), truth(ship, [clean]))


class TestApproximation:
    def test_the_square_root_is_that_of_the_inverse_of_the_gauss_newton_matrix(self, from_truth):
        problem = from_truth.problem
        H = linearise(problem, from_truth.unknowns).matrix + np.diag(problem.precision)
        root = from_truth.square_root / problem.unit[:, None]
        np.testing.assert_allclose(root.T @ H @ root, np.eye(len(H)), atol=1e-5)
        np.testing.assert_allclose(np.sqrt(np.diag(from_truth.covariance)), from_truth.sd, rtol=1e-12)

    @pytest.mark.parametrize("correlation", [0.0, 0.6])
    def test_the_log_evidence_is_the_density_of_the_data_under_the_linearised_model(self, ship, circle, correlation):
        """N(f(mode) + J (center - mode), noise + J prior J'), all matrices written out."""
        problem = problem_of(ship, [rough(circle, 2)])
        noise = tuple(replace(n, correlation=np.full(3, correlation), offsets=True) for n in problem.noise)
        problem = replace(problem, noise=noise)
        fit = fit_trajectory(problem, np.append(truth(ship, [circle]), np.zeros(3)))
        problem = fit.problem
        J = differences(problem, fit.unknowns, range(fit.unknowns.size))
        mean = fitted_values(problem, fit.unknowns) + J @ ((problem.center - fit.unknowns) / problem.unit)
        covariance = dense_covariance(problem) + J / problem.precision @ J.T
        expected = log_normal(measured(problem), mean, covariance)
        assert fit.log_evidence == pytest.approx(expected, abs=0.01)

    def test_few_free_coefficients_have_the_variance_of_their_own_normal_equations(self, ship, zigzag):
        """A table fixes all others: the sd of three is that of a problem of three and the initial state."""
        free, names, reference = ("Yv", "Nr", "Xuu"), coefficient_names(ship), reference_coefficients(ship)
        typical = coefficient_scales([zigzag], ship)
        table = {
            name: (value, 1e-7 * size)
            for name, value, size in zip(names, reference, typical, strict=True)
            if name not in free
        }
        prior = ps.coefficient_prior([zigzag], ship, "flat", table=table)
        problem = problem_of(ship, [rough(zigzag, 4)], prior)
        fit = fit_trajectory(problem, truth(ship, [zigzag]))
        columns = [*(names.index(name) for name in free), 53, 54, 55]
        J = differences(problem, fit.unknowns, columns) / problem.unit[columns]
        sd = np.repeat(problem.noise[0].sd, problem.runs[0].n_blocks)[:, None]
        expected = np.sqrt(np.diag(np.linalg.inv((J / sd).T @ (J / sd))))[:3]
        np.testing.assert_allclose(fit.sd[columns[:3]], expected, rtol=2e-3)
        assert np.max(np.abs(fit.coefficients - reference)[columns[:3]] / expected) < 4.0


class TestScales:
    def test_the_nuisances_are_integrated_out_and_drawn_given_the_coefficients(self, from_truth):
        """Of the joint normal law of all unknowns under the fitted scales: marginal, and conditional mean and sd."""
        problem, n = from_truth.problem, 53
        point = linearise(problem, from_truth.unknowns)
        linear, nuisances = linear_problem(problem, problem.prior.law, from_truth.unknowns, point)
        joint = np.linalg.inv(point.matrix + np.diag(problem.precision))
        marginal = np.linalg.inv(linear.information + np.diag(problem.current_scales.sd**-2.0))
        unit = np.outer(problem.unit[:n], problem.unit[:n])
        np.testing.assert_allclose(marginal / unit, joint[:n, :n], rtol=1e-5, atol=1e-9 * np.abs(joint[:n, :n]).max())
        slope = joint[n:, :n] @ np.linalg.inv(joint[:n, :n])
        np.testing.assert_allclose(nuisances.slope * problem.unit[:n], slope, rtol=1e-3, atol=1e-5)
        spread = joint[n:, n:] - slope @ joint[:n, n:]
        np.testing.assert_allclose(nuisances.root @ nuisances.root.T, spread, rtol=1e-4, atol=1e-12)
        at_mode = (from_truth.unknowns - problem.center)[n:] / problem.unit[n:]
        np.testing.assert_allclose(nuisances.mean, at_mode, atol=1e-2 * np.sqrt(np.diag(spread)).max())

    def test_the_records_choose_the_scales_whatever_the_units_of_the_prior(self, problem, ship, zigzag, from_truth):
        prior = replace(problem.prior, unit=3.0 * problem.prior.unit)
        fit = fit_trajectory(replace(problem, prior=prior), truth(ship, [zigzag]))
        np.testing.assert_allclose(fit.problem.scales.eta, from_truth.problem.scales.eta, atol=0.02)
        assert np.max(np.abs(fit.coefficients - from_truth.coefficients) / from_truth.sd) < 0.05

    def test_a_fixed_prior_stays(self, problem, ship, zigzag, from_truth):
        fit = fit_trajectory(replace(problem, prior=problem.prior.fixed), truth(ship, [zigzag]))
        assert fit.problem.scales is None
        np.testing.assert_array_equal(fit.problem.current_scales.sd, problem.prior.fixed.scale)
        assert fit.log_evidence < from_truth.log_evidence

    def test_under_a_very_narrow_prior_the_fit_stays_at_its_mean(self, problem, ship, zigzag):
        reference, scale = reference_coefficients(ship), 1e-9 * problem.prior.unit
        prior = CoefficientPrior(reference, scale, scale, "known")
        fit = fit_trajectory(replace(problem, prior=prior), truth(ship, [zigzag]))
        np.testing.assert_allclose(fit.sd, scale, rtol=1e-3)
        np.testing.assert_allclose(fit.coefficients, reference, atol=1e-8 * np.abs(reference).max())
