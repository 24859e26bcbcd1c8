"""Gaussian likelihood of earlier runs, for fits to later runs."""

from dataclasses import replace

import numpy as np
import pytest

import pymc_ship as ps
from pymc_ship.inference.trajectory.prior import CoefficientPrior, GaussianLikelihood
from pymc_ship.inference.trajectory.sequential_likelihood import (
    EarlierLikelihood,
    commensurate_likelihood,
    joint_likelihood,
    window_likelihood,
)
from pymc_ship.inference.trajectory.windows import WindowFit

RNG = np.random.default_rng(4)
N = len(ps.load_vessel("kvlcc2").forces["surge"]) + 2 * len(ps.load_vessel("kvlcc2").forces["yaw"])


def linear_case(earlier=None):
    """A fit of a linear model: prior, windows' precision and their own estimate, and the fit that both make."""
    vessel = ps.load_vessel("kvlcc2")
    scale = 10.0 ** RNG.uniform(-5, -2, N)
    mean = scale * RNG.standard_normal(N)
    prior = CoefficientPrior(mean, scale, scale, "stated", likelihood=earlier)
    root = RNG.standard_normal((N + 5, N)) / scale
    windows, own = root.T @ root, mean + scale * RNG.standard_normal(N)
    design = prior.likelihood_or_flat.design
    information = windows + np.diag(scale**-2.0) + design.T @ design
    right = windows @ own + mean / scale**2 + design.T @ prior.likelihood_or_flat.response
    size = np.sqrt(np.diag(information))
    mean_of_all = np.linalg.solve(information / np.outer(size, size), right / size) / size
    zero = np.zeros((N, N))
    return WindowFit(vessel, mean_of_all, zero, zero, information, {}, 1.0, 1), prior, windows, own


@pytest.mark.parametrize("earlier", [None, GaussianLikelihood(1e3 * np.eye(N)[:4], np.ones(4))])
def test_a_linear_fit_has_the_likelihood_of_its_windows(earlier):
    fit, prior, windows, own = linear_case(earlier)
    likelihood = window_likelihood(fit, prior)
    unit = np.outer(prior.scale, prior.scale)
    np.testing.assert_allclose(likelihood.design.T @ likelihood.design * unit, windows * unit, rtol=1e-6, atol=1e-6)
    assert np.abs(likelihood.residuals(own)).max() < 1e-5 * np.abs(likelihood.response).max()


def test_an_inflated_fit_has_a_wider_likelihood():
    fit, prior, *_ = linear_case()
    plain, wide = window_likelihood(fit, prior), window_likelihood(fit, prior, 2.0)
    np.testing.assert_allclose(2.0 * wide.design, plain.design)
    np.testing.assert_allclose(2.0 * wide.response, plain.response)


def test_the_likelihood_leaves_out_constants_of_a_run():
    vessel = ps.with_terms(ps.load_vessel("kvlcc2"), "modular")
    parameters = tuple(replace(c, per_run=k == 3) for k, c in enumerate(vessel.parameters))
    n = len(parameters)
    scale = np.full(n, 0.1)
    prior = CoefficientPrior(np.zeros(n), scale, scale, "stated")
    zero = np.zeros((n, n))
    fit = WindowFit(replace(vessel, parameters=parameters), np.ones(n), zero, zero, 300.0 * np.eye(n), {}, 1.0, 1)
    likelihood = window_likelihood(fit, prior)
    assert not likelihood.design[:, 3].any()
    assert len(likelihood.design) == n - 1


def test_the_product_has_the_rows_in_order():
    one, other = (
        GaussianLikelihood(np.eye(2), np.array([1.0, 2.0])),
        GaussianLikelihood(np.ones((1, 2)), np.array([3.0])),
    )
    assert joint_likelihood([None, None]) is None
    both = joint_likelihood([one, None, other])
    np.testing.assert_array_equal(both.response, [1.0, 2.0, 3.0])
    assert both.design.shape == (3, 2)


@pytest.mark.parametrize(("shift", "low", "high"), [(0.0, 0.0, 0.0), (0.5, 0.3, 0.8)])
def test_the_discrepancy_scale_is_the_distance_of_the_coefficients(shift, low, high):
    n = 40
    moved = shift * np.random.default_rng(2).standard_normal(n)
    prior = CoefficientPrior(np.zeros(n), np.ones(n), np.ones(n), "stated")
    likelihood = GaussianLikelihood(100.0 * np.eye(n), np.zeros(n))
    commensurate, (scale,) = commensurate_likelihood(likelihood, prior, moved, 1e-4 * np.eye(n))
    assert low <= scale <= high
    assert np.linalg.norm(commensurate.design) <= np.linalg.norm(likelihood.design) * (1.0 + 1e-12)


def test_coefficients_of_a_facility_have_a_discrepancy_scale_of_their_own():
    """Five of forty have moved by their prior sd; one scale for all, the broken twin, widens the others, too."""
    n, own = 40, [3, 7, 11, 20, 33]
    moved = np.zeros(n)
    moved[own] = (1.0, -1.2, 0.9, -0.8, 1.1)
    prior = CoefficientPrior(np.zeros(n), np.ones(n), np.ones(n), "stated")
    likelihood = GaussianLikelihood(100.0 * np.eye(n), np.zeros(n))
    commensurate, (common, own_scale) = commensurate_likelihood(likelihood, prior, moved, 1e-4 * np.eye(n), own)
    assert common == 0.0
    assert 0.7 < own_scale <= 1.0
    sizes = np.linalg.norm(commensurate.design, axis=0)
    others = np.setdiff1d(np.arange(n), own)
    assert sizes[own].max() < 2.0
    np.testing.assert_allclose(sizes[others], 100.0)
    alike, (scale,) = commensurate_likelihood(likelihood, prior, moved, 1e-4 * np.eye(n))
    assert scale > 0.2
    assert np.linalg.norm(alike.design, axis=0).max() < 10.0


def test_at_another_draught_each_coefficient_is_as_many_prior_sd_from_its_mean():
    rng = np.random.default_rng(7)
    names, n = ("Yv", "Nr", "R0", "gone"), 4
    mean, scale = rng.normal(size=n), rng.uniform(0.5, 2.0, n)
    here = EarlierLikelihood(
        names, GaussianLikelihood(rng.normal(size=(6, n)), rng.normal(size=6)), np.zeros(2), mean, scale
    )
    other = CoefficientPrior(rng.normal(size=3), rng.uniform(0.5, 2.0, 3), np.ones(3), "stated")
    there = here.at_draught(names[:3], other)
    away = rng.normal(size=n)
    moved = np.append(other.mean + other.scale * away[:3], mean[3] + scale[3] * away[3])
    np.testing.assert_allclose(there.gaussian.residuals(moved), here.gaussian.residuals(mean + scale * away))
    again = there.at_draught(names, CoefficientPrior(mean, scale, np.ones(n), "stated"))
    np.testing.assert_allclose(again.gaussian.design, here.gaussian.design)
    np.testing.assert_allclose(again.gaussian.response, here.gaussian.response)
