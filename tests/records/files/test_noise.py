from __future__ import annotations

import numpy as np
import pytest
import xarray as xr
from scipy.stats import chi2, kstest

import pymc_ship as ps
from pymc_ship.records.files.noise import NOISES, noise_factors, noisy_trial
from pymc_ship.trial.record import second_difference_sd
from tests.sentences import refused

FACTORS = {"u": 0.3, "v": 1.0, "r": 0.3, "p": 0.3, "phi": 0.3, "psi": 0.3}
LEVEL = 0.05
ALPHA = 1e-4
"""Chance that a right channel lies outside its interval; the seeds are fixed, so a test fails always or never."""


def noise_of(trial, polluted, name):
    return polluted[name].values - trial[name].values


def sd_is(sample, sd):
    """Whether a sample about zero has the standard deviation sd, by its chi-square interval."""
    low, high = chi2.ppf([ALPHA / 2.0, 1.0 - ALPHA / 2.0], sample.size)
    return low < np.sum(sample**2) / sd**2 < high


@pytest.fixture(scope="module")
def polluted(zigzag_trial):
    return ps.pollute(zigzag_trial, level=LEVEL, rng=np.random.default_rng(7))


@pytest.mark.parametrize("channel", FACTORS)
def test_the_standard_deviation_is_level_times_factor_times_the_largest_value(zigzag_trial, polluted, channel):
    noise = noise_of(zigzag_trial, polluted, channel)
    sd = LEVEL * FACTORS[channel] * float(np.abs(zigzag_trial[channel]).max())
    assert sd_is(noise, sd)
    assert polluted.attrs[f"noise_sd_{channel}"] == pytest.approx(sd, rel=1e-12)
    for wrong in (0.95 * sd, 1.05 * sd, LEVEL * sd, sd / FACTORS[channel] * 1.3):
        assert not sd_is(noise, wrong)


@pytest.mark.parametrize("channel", FACTORS)
def test_the_noise_is_gaussian_and_white(zigzag_trial, polluted, channel):
    noise = noise_of(zigzag_trial, polluted, channel) / polluted.attrs[f"noise_sd_{channel}"]
    assert kstest(noise, "norm").pvalue > ALPHA
    assert kstest(np.abs(noise), "norm").pvalue < ALPHA  # the broken twin
    n = noise.size
    for lag in (1, 2, 50):
        assert abs(np.mean(noise[lag:] * noise[:-lag])) < 4.0 / np.sqrt(n)


def test_channels_are_independent(zigzag_trial, polluted):
    noise = np.array([noise_of(zigzag_trial, polluted, name) for name in FACTORS])
    correlation = np.corrcoef(noise) - np.eye(len(FACTORS))
    assert np.abs(correlation).max() < 4.5 / np.sqrt(noise.shape[1])


def test_the_rudder_and_the_track_carry_no_noise(zigzag_trial, polluted):
    for name in ("delta", "x", "y", "time"):
        np.testing.assert_array_equal(polluted[name], zigzag_trial[name])


def test_the_literal_level_has_variance_one_fifth(zigzag_trial):
    literal = ps.pollute(zigzag_trial, level="literal", rng=np.random.default_rng(8))
    assert literal.attrs["noise_level"] == pytest.approx(0.447, abs=5e-4)
    sway = noise_of(zigzag_trial, literal, "v") / float(np.abs(zigzag_trial["v"]).max())
    assert sd_is(sway, np.sqrt(0.2))
    assert not sd_is(sway, 0.2)


def test_the_same_seed_gives_the_same_noise(zigzag_trial, polluted):
    again = ps.pollute(zigzag_trial, level=LEVEL, rng=np.random.default_rng(7))
    other = ps.pollute(zigzag_trial, level=LEVEL, rng=np.random.default_rng(8))
    assert again.identical(polluted)
    assert (other["u"] != polluted["u"]).all()


def test_level_zero_is_the_clean_trial(zigzag_trial):
    clean = ps.pollute(zigzag_trial, level=0.0, rng=np.random.default_rng(9))
    for name in FACTORS:
        np.testing.assert_array_equal(clean[name], zigzag_trial[name])


def test_the_trial_itself_stays_clean(container):
    trial = ps.simulate(container, ps.zigzag(20, 20), duration=20.0)
    before = trial.copy(deep=True)
    polluted = ps.pollute(trial, level=1.0, rng=np.random.default_rng(10))
    assert trial.identical(before)
    assert polluted["u"].attrs == trial["u"].attrs
    assert polluted.attrs["manoeuvre"] == "zigzag"


def test_factors_choose_the_channels(zigzag_trial):
    polluted = ps.pollute(zigzag_trial, level=1.0, rng=np.random.default_rng(11), factors={"x": 0.01})
    assert sd_is(noise_of(zigzag_trial, polluted, "x"), 0.01 * float(np.abs(zigzag_trial["x"]).max()))
    for name in FACTORS:
        np.testing.assert_array_equal(polluted[name], zigzag_trial[name])


def test_channels_a_trial_does_not_have_are_left_out():
    trial = xr.Dataset({"u": ("time", np.ones(10))}, {"time": np.arange(10.0)})
    polluted = ps.pollute(trial, level=0.1, rng=np.random.default_rng(12))
    assert list(polluted.data_vars) == ["u"]


# kinds of noise


def unit_noise(kind, n_records=50):
    """Records of 4000 samples of noise with standard deviation 1, without an offset."""
    nothing = np.zeros(4000)
    return np.array([NOISES[kind](nothing, 1.0, 0.0, np.random.default_rng(k)) for k in range(n_records)])


@pytest.mark.parametrize("kind", NOISES)
def test_noise_has_the_standard_deviation_asked_for(kind):
    power = np.mean(np.clip(unit_noise(kind), -30.0, 30.0) ** 2, axis=1)
    assert abs(power.mean() - 1.0) < 4.0 * power.std() / np.sqrt(50)


@pytest.mark.parametrize("time_constant", [0.2, 1.0])
def test_correlated_noise_forgets_within_its_time_constant(time_constant):
    noise = unit_noise(f"correlated {time_constant:g} s")
    lag = round(time_constant / 0.02)
    correlation = np.mean(noise[:, lag:] * noise[:, :-lag], axis=1)
    assert abs(correlation.mean() - np.exp(-1.0)) < 4.0 * correlation.std() / np.sqrt(50)


def test_offsets_are_half_to_all_of_the_level(small):
    clean = ps.simulate(small, ps.zigzag(20, 20), duration=40.0)
    offsets = []
    for seed in range(20):
        shifted = noisy_trial(clean, 0.01, "offsets", np.random.default_rng(seed))
        offsets += [float((shifted[c] - clean[c]).mean() / np.abs(clean[c]).max()) for c in ("u", "r")]
    offsets = np.array(offsets)
    spread = 0.003 / np.sqrt(clean.sizes["time"])  # of the mean of the white noise on top
    assert np.all((np.abs(offsets) > 0.005 - 5.0 * spread) & (np.abs(offsets) < 0.01 + 5.0 * spread))
    assert {-1.0, 1.0} == set(np.sign(offsets))


def test_white_noise_is_that_of_pollute_on_the_sensors(zigzag_trial):
    """The same draws of the same size; the products are taken in another order."""
    noisy = noisy_trial(zigzag_trial, LEVEL, "white", np.random.default_rng(7))
    sensors = {name: factor for name, factor in noise_factors().items() if name != "psi"}
    polluted = ps.pollute(zigzag_trial, level=LEVEL, rng=np.random.default_rng(7), factors=sensors)
    for name in sensors:
        np.testing.assert_allclose(noise_of(zigzag_trial, noisy, name), noise_of(zigzag_trial, polluted, name))
        assert noisy.attrs[f"noise_sd_{name}"] == pytest.approx(polluted.attrs[f"noise_sd_{name}"], rel=1e-15)
    np.testing.assert_array_equal(noisy["psi"], zigzag_trial["psi"])


def test_a_kind_of_noise_is_one_entry(zigzag_trial, monkeypatch):
    def spiky(values, sd, peak, rng):
        return np.where(rng.random(values.size) < 0.01, values + peak, values)

    monkeypatch.setitem(NOISES, "spikes", spiky)
    noisy = noisy_trial(zigzag_trial, LEVEL, "spikes", np.random.default_rng(3))
    hit = noise_of(zigzag_trial, noisy, "v") > 0.0
    assert 0.005 < hit.mean() < 0.015
    assert noise_of(zigzag_trial, noisy, "v")[hit] == pytest.approx(LEVEL * float(np.abs(zigzag_trial["v"]).max()))


class TestSecondDifferences:
    def test_second_differences_find_white_noise_on_a_smooth_signal(self):
        """Averaged over 200 records, to within their scatter."""
        rng, t = np.random.default_rng(1), 0.1 * np.arange(1000)
        estimates = second_difference_sd(3.0 * np.sin(0.1 * t) + 0.02 * rng.standard_normal((200, 1000)))
        assert abs(estimates.mean() / 0.02 - 1.0) < 4.0 * estimates.std() / 0.02 / np.sqrt(200)
        assert abs(np.diff(rng.standard_normal((200, 1000))).std() - 1.0) > 0.3

    def test_they_are_blind_to_outliers_and_to_a_polynomial(self):
        rng, t = np.random.default_rng(2), np.arange(2000.0)
        plain = rng.standard_normal(2000)
        spoiled = plain.copy()
        spoiled[::100] += 1e3
        assert second_difference_sd(spoiled) == pytest.approx(second_difference_sd(plain), rel=0.1)
        assert second_difference_sd(plain + 5.0 * t - 7.0) == pytest.approx(second_difference_sd(plain))
        assert second_difference_sd(5.0 * t - 7.0) == 0.0

    def test_they_miss_most_of_a_noise_that_is_correlated(self):
        walk = np.cumsum(np.random.default_rng(3).standard_normal(5000))
        assert second_difference_sd(walk) < 0.1 * walk.std()


@pytest.mark.parametrize("factor", [-1.0, np.nan, np.inf, None])
def test_a_factor_that_is_no_size_is_refused(zigzag_trial, factor):
    with refused(ps.TrialError, "r"):
        ps.pollute(zigzag_trial, level=0.1, rng=1, factors={"r": factor})
