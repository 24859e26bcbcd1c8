"""Hierarchical law of the scales of a prior: exact answers of small problems, calibration, and the mode."""

from __future__ import annotations

import arviz as az
import numpy as np
import pytest
from scipy import stats

from pymc_ship.inference.trajectory import scale_law
from pymc_ship.inference.trajectory.scale_law import (
    FACTOR_SD,
    FREEDOM,
    LinearProblem,
    ScaleLaw,
    Scales,
    gibbs_draws,
    probable_scales,
)
from pymc_ship.machine.threads import one_thread

INFORMATION = np.array([[2.0, 0.8], [0.8, 1.0]])
SCORE = np.array([3.0, -1.0])
PAIR = ScaleLaw(np.array([[1.0], [1.0]]), np.zeros(1), ("tau",))


def problem(law=PAIR, scale=None, mode=None):
    """Two coefficients of one factor; the likelihood is the same about any mode."""
    mode = np.zeros(2) if mode is None else mode
    scale = np.array([0.5, 1.5]) if scale is None else scale
    return LinearProblem(law, scale, INFORMATION, SCORE - INFORMATION @ mode, mode)


def moments_by_quadrature(one, sd=FACTOR_SD):
    """Mean and sd of both deviations and of eta, by sums over a grid of all three."""
    axis, etas = np.linspace(-8.0, 10.0, 181), np.linspace(-5.0 * sd, 5.0 * sd, 81)
    first, second = np.meshgrid(axis, axis, indexing="ij")
    change = np.stack([first - one.mode[0], second - one.mode[1]])
    log_likelihood = -0.5 * np.einsum("iab,ij,jab->ab", change, one.information, change)
    log_likelihood += np.einsum("i,iab->ab", one.score, change)
    density = np.empty((etas.size, axis.size, axis.size))
    for k, eta in enumerate(etas):
        size = one.scale * np.exp(eta)
        of_prior = stats.t.logpdf(first, FREEDOM, 0.0, size[0]) + stats.t.logpdf(second, FREEDOM, 0.0, size[1])
        density[k] = log_likelihood + of_prior + stats.norm.logpdf(eta, 0.0, sd)
    weight = np.exp(density - density.max())
    weight /= weight.sum()
    values = (first[None], second[None], etas[:, None, None])
    means = [float(np.sum(weight * value)) for value in values]
    return means, [float(np.sqrt(np.sum(weight * (v - m) ** 2))) for v, m in zip(values, means, strict=True)]


def largest_z(draws, means):
    """Largest distance of the means of draws (chain, draw, quantity) from the exact ones, in Monte-Carlo errors."""
    error = az.mcse({"x": draws})["x"].values
    return float(np.max(np.abs(draws.mean(axis=(0, 1)) - means) / error))


def largest_z_of_sd(draws, sds):
    """The same of the sds."""
    error = az.mcse({"x": draws}, method="sd")["x"].values
    return float(np.max(np.abs(draws.std(axis=(0, 1)) - sds) / error))


class TestGibbs:
    @pytest.mark.parametrize("mode", [np.zeros(2), np.array([1.2, -0.7])])
    def test_draws_have_the_moments_of_the_quadrature_and_those_of_another_law_have_not(self, mode):
        one = problem(mode=mode)
        start = probable_scales(one, PAIR.center)
        draws = np.concatenate(gibbs_draws(one, start, 4, 60000, np.random.default_rng(1)), axis=2)
        means, sds = moments_by_quadrature(one)
        assert largest_z(draws, means) < 4.5
        assert largest_z_of_sd(draws, sds) < 4.5
        means, sds = moments_by_quadrature(one, 1.05 * FACTOR_SD)
        assert largest_z(draws, means) > 4.5
        assert largest_z_of_sd(draws, sds) > 8.0

    def test_ranks_of_the_truth_are_uniform_and_under_a_fixed_damping_are_not(self):
        """Simulation-based calibration of six coefficients of orders 1 to 3, each measured with an error."""
        rng, order = np.random.default_rng(2), np.array([0.0, 0.0, 1.0, 1.0, 2.0, 2.0])
        law = ScaleLaw(np.column_stack([np.ones(6), order]), np.zeros(2), ("tau", "damping"))
        damped = ScaleLaw(np.column_stack([np.ones(6)]), np.zeros(1), ("tau",))
        ranks, of_damped = [], []
        for _ in range(150):
            eta = FACTOR_SD * rng.standard_normal(2)
            truth = np.exp(law.exponents @ eta) * rng.standard_t(FREEDOM, 6)
            measured = truth + rng.standard_normal(6)
            for chosen, scale, out in ((law, np.ones(6), ranks), (damped, 0.3**order, of_damped)):
                one = LinearProblem(chosen, scale, np.eye(6), measured, np.zeros(6))
                start = Scales(chosen.center, one.factor(chosen.center))
                drawn = gibbs_draws(one, start, 1, 100, rng)[0][0]
                out.append(np.mean(drawn < truth, axis=0))
        p = [stats.chisquare(np.histogram(np.ravel(out), 5, (0.0, 1.0))[0]).pvalue for out in (ranks, of_damped)]
        assert p[0] > 1e-4
        assert p[1] < 1e-8

    def test_the_same_seed_gives_the_same_draws(self):
        one, start = problem(), probable_scales(problem(), PAIR.center)
        draws = [gibbs_draws(one, start, 2, 50, np.random.default_rng(3))[0] for _ in range(2)]
        np.testing.assert_array_equal(*draws)

    def test_threads_do_not_change_the_draws(self):
        one, start = problem(), probable_scales(problem(), PAIR.center)
        in_threads = gibbs_draws(one, start, 3, 50, np.random.default_rng(3))[0]
        with one_thread():
            np.testing.assert_array_equal(gibbs_draws(one, start, 3, 50, np.random.default_rng(3))[0], in_threads)
        assert np.unique(in_threads[:, :, 0]).size == in_threads[:, :, 0].size

    def test_a_start_far_too_narrow_is_left(self):
        """Where the slope of the evidence is so steep that a leapfrog overshoots every scale."""
        law = ScaleLaw(np.ones((8, 1)), np.zeros(1), ("tau",))
        one = LinearProblem(law, np.ones(8), 1e6 * np.eye(8), 3e6 * np.ones(8), np.zeros(8))
        narrow = Scales(np.array([-8.0]), one.factor(np.array([-8.0])))
        drawn, eta = gibbs_draws(one, narrow, 4, 500, np.random.default_rng(7))
        np.testing.assert_allclose(drawn[:, 100:], 3.0, atol=6e-3)
        expected = gibbs_draws(one, probable_scales(one, law.center), 4, 500, np.random.default_rng(8))[1]
        assert largest_z(eta[:, 100:], expected[:, 100:].mean(axis=(0, 1))) < 6.0

    def test_a_coefficient_without_factors_keeps_its_normal_law(self):
        law = ScaleLaw(np.array([[1.0], [0.0]]), np.zeros(1), ("tau",))
        one = LinearProblem(law, np.array([1.0, 0.5]), np.diag([4.0, 0.0]), np.array([2.0, 0.0]), np.zeros(2))
        drawn = gibbs_draws(one, probable_scales(one, law.center), 4, 2000, np.random.default_rng(4))[0][:, :, 1]
        assert stats.kstest(drawn[:, ::4].ravel() / 0.5, "norm").pvalue > 1e-4


class TestMode:
    def test_eta_is_where_the_expected_log_density_is_greatest(self):
        """Of the expectation-maximisation: at its end, another eta has a smaller expected log density."""
        one = problem()
        scales = probable_scales(one, np.array([1.5]))
        covariance = np.linalg.inv(one.information + np.diag(scales.sd**-2.0))
        square = (covariance @ one.score) ** 2 + np.diag(covariance)
        mixing = (scales.sd / one.factor(scales.eta)) ** 2

        def expected(eta):
            variance = one.factor(np.array([eta])) ** 2 * mixing
            return -0.5 * np.sum(np.log(variance) + square / variance) - 0.5 * (eta / FACTOR_SD) ** 2

        at = float(scales.eta[0])
        assert abs(expected(at + 1e-4) - expected(at - 1e-4)) / 2e-4 < 0.05
        assert expected(at) > max(expected(at + 0.2), expected(at - 0.2))
        np.testing.assert_allclose(
            mixing, (FREEDOM + square / one.factor(scales.eta) ** 2) / (FREEDOM + 1.0), rtol=1e-2
        )

    def test_small_coefficients_get_small_scales(self):
        measured = np.full(8, 0.02)
        law = ScaleLaw(np.ones((8, 1)), np.zeros(1), ("tau",))
        one = LinearProblem(law, np.ones(8), 1e6 * np.eye(8), 1e6 * measured, np.zeros(8))
        assert probable_scales(one, law.center).eta[0] < -2.0

    def test_the_size_of_a_conflict_is_bounded(self, monkeypatch):
        law = ScaleLaw(np.ones((2, 1)), np.zeros(1), ("tau",))
        one = LinearProblem(law, np.ones(2), 1e12 * np.eye(2), 1e12 * np.array([1e6, 0.0]), np.zeros(2))
        ratio = (probable_scales(one, law.center).sd / one.factor(probable_scales(one, law.center).eta)) ** 2
        assert ratio.max() == pytest.approx(scale_law._LARGEST_MIXING)


def test_the_density_is_that_of_students_t_with_the_scales_multiplied():
    law = ScaleLaw(np.array([[1.0, 0.0], [1.0, 2.0], [0.0, 0.0]]), np.zeros(2), ("tau", "damping"))
    z, eta = np.array([[0.3, -2.0, 1.0]]), np.array([[0.2, -0.4]])
    expected = stats.t.logpdf(0.3, FREEDOM, 0.0, np.exp(0.2)) + stats.t.logpdf(-2.0, FREEDOM, 0.0, np.exp(0.2 - 0.8))
    np.testing.assert_allclose(law.log_density(z, eta), expected + stats.norm.logpdf(1.0))
