"""Posterior draws of denoised signals: calibrated in one basis, conservative over shifts, against broken twins."""

from __future__ import annotations

import numpy as np
import pytest
import pywt
import xarray as xr

import pymc_ship as ps
from pymc_ship.records.denoising import wavelets
from pymc_ship.records.denoising.ebayes import posterior_draw, posterior_mean, posterior_median
from pymc_ship.records.denoising.wavelet_posterior import wavelet_posterior
from pymc_ship.trial.record import check_trial
from tests.records.denoising.cases import SHAPES, classic, posterior_weight
from tests.sentences import refused

NOMINAL = 0.9
N_DRAWS = 200


def covered_fraction(truth, drawn):
    """Fraction of the truth inside pointwise equal-tailed intervals."""
    low, high = np.quantile(drawn, [0.5 - 0.5 * NOMINAL, 0.5 + 0.5 * NOMINAL], axis=0)
    return float(np.mean((low <= truth) & (truth <= high)))


def narrowed(drawn, factor):
    """Draws of a posterior whose standard deviation is that of another noise."""
    middle = drawn.mean(axis=0)
    return middle + factor * (drawn - middle)


def coverage(name, *, translation_invariant):
    """Mean coverage over four records of a classic signal: as drawn, and with half the standard deviation."""
    fractions = []
    for seed in range(4):
        rng, truth = np.random.default_rng(seed), classic(name)
        noisy = truth + rng.normal(size=truth.size)
        drawn = ps.denoise_signal_draws(noisy, translation_invariant=translation_invariant, draws=N_DRAWS, rng=rng)
        fractions.append([covered_fraction(truth, drawn), covered_fraction(truth, narrowed(drawn, 0.5))])
    return np.mean(fractions, axis=0)


# the kernel


@pytest.mark.parametrize("prior", ["laplace", "cauchy"])
@pytest.mark.parametrize("weight", [0.05, 0.6, 1.0])
@pytest.mark.parametrize("x", [0.0, 0.3, 2.0, 5.0, -8.0, 60.0])
def test_draws_of_a_mean_have_its_posterior_mean_median_and_weight(prior, weight, x):
    """Within four standard errors of 40 000 draws; the moments come from the closed forms, which R's numbers check."""
    n, scale = 40_000, 0.7
    drawn = posterior_draw(np.full(n, x), weight, prior, scale, rng=np.random.default_rng(5))
    probability = float(posterior_weight(x, weight, prior, scale))
    assert abs(np.mean(drawn != 0.0) - probability) <= 4.0 * np.sqrt(probability * (1.0 - probability) / n)
    mean, median = posterior_mean(x, weight, prior, scale), posterior_median(x, weight, prior, scale)
    assert abs(drawn.mean() - mean) <= 4.0 * drawn.std() / np.sqrt(n)
    for below in (drawn < median, drawn > median):
        assert np.mean(below) <= 0.5 + 4.0 * 0.5 / np.sqrt(n)


@pytest.mark.parametrize("prior", ["laplace", "cauchy"])
def test_draws_of_a_mean_hold_means_of_the_prior_as_often_as_they_say(prior):
    """Truths of the prior, data of the truths: the rank of a truth among its draws is uniform; not with half the sd."""
    rng, n, weight, scale = np.random.default_rng(6), 4000, 0.5, 0.5
    slab = rng.laplace(scale=1.0 / scale, size=n) if prior == "laplace" else _quasi_cauchy(rng, n)
    truth = np.where(rng.random(n) < weight, slab, 0.0)
    x = truth + rng.standard_normal(n)
    drawn = np.array([posterior_draw(x, weight, prior, scale, rng=rng) for _ in range(99)])
    ranks = (drawn < truth).sum(axis=0) + (rng.random(n) * (1 + (drawn == truth).sum(axis=0))).astype(int)
    twin = np.array([posterior_draw(x, 1.0, prior, scale, rng=rng) for _ in range(99)])
    wrong = (twin < truth).sum(axis=0) + (rng.random(n) * (1 + (twin == truth).sum(axis=0))).astype(int)
    assert _chi2(ranks) < _CHI2_LIMIT
    assert _chi2(wrong) > _CHI2_LIMIT  # the twin forgets that a mean may be zero


_CHI2_LIMIT = 27.88
"""99.9 % quantile of chi-square with 9 degrees of freedom."""


def _quasi_cauchy(rng, n):
    return rng.standard_normal(n) * np.sqrt(1.0 / rng.beta(0.5, 1.0, n) - 1.0)


def _chi2(ranks):
    counts = np.bincount(ranks // 10, minlength=10)
    return float(np.sum((counts - ranks.size / 10) ** 2) / (ranks.size / 10))


# a signal


def test_the_mean_over_all_shifts_is_the_translation_invariant_estimate():
    noisy = classic("blocks")[:64] + np.random.default_rng(0).normal(size=64)
    posterior = wavelet_posterior(noisy, "signal", "sym4", "laplace", True, levels=2)
    settings = [{"weight": weight, "scale": scale} for weight, scale in posterior.level_priors]
    estimates = []
    for shift in range(4):
        approximation, details = wavelets.transform(np.roll(posterior.padded, -shift), posterior.filters, 2, False)
        means = [
            posterior.sdev * posterior_mean(detail / posterior.sdev, prior="laplace", **one)
            for detail, one in zip(details, settings, strict=True)
        ]
        smooth = np.roll(wavelets.inverse(approximation, means, posterior.filters, False), shift)
        estimates.append(smooth[posterior.before : posterior.before + 64] + posterior.trend)
    assert np.abs(np.mean(estimates, axis=0) - posterior.estimate("mean")).max() < 1e-12
    assert np.abs(estimates[0] - posterior.estimate("mean")).max() > 0.1


@pytest.mark.parametrize("translation_invariant", [True, False])
def test_the_mean_of_the_draws_is_the_estimate_of_the_posterior_mean(translation_invariant):
    noisy = classic("bumps") + np.random.default_rng(1).normal(size=1024)
    settings = {"translation_invariant": translation_invariant}
    drawn = ps.denoise_signal_draws(noisy, draws=800, rng=np.random.default_rng(2), **settings)
    z = np.sqrt(800) * (drawn.mean(axis=0) - ps.denoise_signal(noisy, rule="mean", **settings)) / drawn.std(axis=0)
    assert np.abs(z).max() < 5.0
    assert 0.8 < np.sqrt(np.mean(z**2)) < 1.2


def test_intervals_cover_a_truth_drawn_from_the_prior():
    """Details of a spike and slab in a periodic basis: 90 % of samples within four standard errors over records.

    The finest level is noise alone, from which the noise is estimated.
    """
    fractions, halves = [], []
    for seed in range(12):
        rng = np.random.default_rng(seed)
        details = [np.where(rng.random(n) < 0.3, rng.laplace(scale=5.0, size=n), 0.0) for n in (64, 128, 256)]
        details.append(np.zeros(512))
        truth = pywt.waverec([10.0 * rng.standard_normal(64), *details], "sym4", "periodization")
        drawn = ps.denoise_signal_draws(
            *(truth + rng.standard_normal(1024), "sym4", "laplace", False),
            **{"draws": N_DRAWS, "rng": rng, "levels": 4, "boundary": "periodic"},
        )
        fractions.append(covered_fraction(truth, drawn))
        halves.append(covered_fraction(truth, narrowed(drawn, 0.5)))
    error = np.std(fractions, ddof=1) / np.sqrt(len(fractions))
    assert abs(np.mean(fractions) - NOMINAL) < 4.0 * error + 1.0 / N_DRAWS
    assert np.mean(halves) < NOMINAL - 10.0 * error


@pytest.mark.parametrize("name", SHAPES)
def test_intervals_over_shifts_hold_at_least_what_they_say(name):
    """A mixture over shifts is wider than the error of its mean (Jensen): coverage 0.97 to 0.98 at a nominal 0.90."""
    fraction, twin = coverage(name, translation_invariant=True)
    assert fraction > NOMINAL > twin


@pytest.mark.parametrize("name", SHAPES)
def test_intervals_of_one_basis_hold_about_what_they_say(name):
    """Truths not drawn from the prior: coverage 0.90 to 0.97 at a nominal 0.90; steps and peaks are the worst."""
    fraction, twin = coverage(name, translation_invariant=False)
    assert NOMINAL - 0.03 < fraction < 0.99
    assert twin < NOMINAL - 0.1


def test_a_signal_without_noise_has_draws_that_are_the_signal():
    drawn = ps.denoise_signal_draws(np.full(100, 3.0), draws=3, rng=np.random.default_rng(0))
    assert np.array_equal(drawn, np.full((3, 100), 3.0))


# a trial


def record():
    time = 0.1 * np.arange(600)
    rng = np.random.default_rng(3)
    channels = {name: np.sin(time / 9.0) + 0.05 * rng.standard_normal(600) for name in ("u", "v")}
    channels["delta"] = np.cos(time / 9.0)
    units = {"u": "m/s", "v": "m/s", "delta": "rad"}
    variables = {k: ("time", c, {"units": units[k]}) for k, c in channels.items()}
    return xr.Dataset(variables, {"time": time}, {"vessel": "a"})


def test_each_draw_of_a_trial_is_a_trial():
    trial = record()
    drawn = ps.denoise_draws(trial, "sym4", draws=5, rng=np.random.default_rng(1))
    one = drawn.isel(draw=2)
    check_trial(one, ["u", "v", "delta"])
    assert drawn["u"].dims == ("draw", "time")
    assert drawn["delta"].identical(trial["delta"])
    assert drawn["v"].attrs == {"units": "m/s"}
    assert drawn.attrs == {"vessel": "a", "denoised": "u v"}
    again = ps.denoise_draws(trial, "sym4", draws=5, rng=np.random.default_rng(1))
    assert drawn.identical(again)
    assert not np.array_equal(drawn["u"].values - trial["u"].values, drawn["v"].values - trial["v"].values)


def test_channels_are_chosen_as_in_denoise():
    drawn = ps.denoise_draws(record(), draws=2, rng=np.random.default_rng(1), channels=["v"])
    assert drawn["u"].dims == ("time",)
    with refused(ValueError, "p"):
        ps.denoise_draws(record(), draws=2, rng=np.random.default_rng(1), channels=["p"])


def test_a_text_is_no_transform():
    with refused(ValueError, "translation_invariant", "no"):
        ps.denoise_signal_draws(record()["u"].values, translation_invariant="no", rng=1)
