"""Wavelet denoising against R and its invariants."""

from __future__ import annotations

import csv
import gzip
import re
from pathlib import Path

import numpy as np
import pytest
import pywt
import xarray as xr

from pymc_ship.records.denoising.denoise import denoise, denoise_signal
from pymc_ship.records.denoising.derivative import derivative
from pymc_ship.records.denoising.draws import denoise_draws
from pymc_ship.records.denoising.ebayes import ebayes_threshold, mad
from tests.sentences import refused

DATA = Path(__file__).parents[2] / "data" / "wavelet"
SMOOTHED = ("u", "v", "r", "psi")
FILTERS = {"haar": "haar", "la8": "sym4", "d8": "db4", "la10": "sym10"}


def donoho_johnstone(signal: str) -> tuple[np.ndarray, np.ndarray]:
    with gzip.open(DATA / f"{signal}_1024.csv.gz", "rt") as file:
        clean, noisy = np.loadtxt(file, delimiter=",", skiprows=2).T
    return clean, noisy


def rmse_of_r() -> list[tuple[str, str, float]]:
    with (DATA / "rmse_of_R.csv").open() as file:
        rows = list(csv.reader(file))[2:]
    method = re.compile(r"(ti|dwt)\.\w+\.(laplaceNA|laplace\.5|cauchy)\.(median|mean)\.(all|L6)$")
    return [(signal, name, float(rmse)) for signal, name, rmse in rows if method.match(name)]


def rms(error: np.ndarray) -> float:
    return float(np.sqrt(np.mean(np.square(error))))


def zigzag(n_time: int = 4000, step: float = 0.1) -> xr.Dataset:
    """A clean record that looks like a zigzag test, with a kink in the rudder and an end in full turn."""
    time = step * np.arange(n_time)
    psi = 0.35 * np.tanh(time / 10.0) * np.sin(time / 15.0)
    channels = {
        "u": 7.0 - 1.5 * np.tanh(time / 60.0) + 0.1 * np.cos(time / 7.5),
        "v": 0.8 * np.sin(time / 15.0 - 0.6),
        "r": np.gradient(psi, step),
        "psi": psi,
        "x": 7.0 * time,
        "delta": np.clip(np.sin(time / 15.0 + 0.5), -0.35, 0.35),
    }
    return xr.Dataset({k: ("time", c) for k, c in channels.items()}, {"time": time}, {"vessel": "somebody"})


def noisy(trial: xr.Dataset, level: float, seed: int = 0) -> xr.Dataset:
    rng = np.random.default_rng(seed)
    return trial.assign(
        {k: trial[k] + level * float(abs(trial[k]).max()) * rng.normal(size=trial.time.size) for k in SMOOTHED}
    )


# Against R and PyWavelets


@pytest.mark.parametrize(("signal", "name", "rmse"), rmse_of_r())
def test_error_is_that_of_r(signal, name, rmse):
    clean, observed = donoho_johnstone(signal)
    transform, wavelet, prior, rule, finest = name.replace("laplace.5", "laplace").split(".")
    options = {
        "wavelet": FILTERS[wavelet],
        "prior": prior.removesuffix("NA"),
        "translation_invariant": transform == "ti",
        "scale": None if prior.endswith("NA") else 0.5,
        "rule": rule,
    }
    levels = {"all": 9, "L6": 6}[finest]
    periodic = rms(denoise_signal(observed, levels=levels, boundary="periodic", **options) - clean)
    here = rms(denoise_signal(observed, **options) - clean)
    if name.startswith("ti.la8.laplaceNA.median"):
        assert max(periodic, here) < 1.05 * rmse
    assert 0.8 * rmse < min(periodic, here)  # the phase of the filters is not R's
    assert max(periodic, here) < 1.2 * rmse


def test_rows_of_r_are_complete():
    assert len(rmse_of_r()) == 52


@pytest.mark.parametrize(("prior", "scale"), [("laplace", None), ("laplace", 0.5), ("cauchy", None)])
@pytest.mark.parametrize("rule", ["median", "soft"])
def test_details_are_thresholded_level_by_level(prior, scale, rule):
    observed = donoho_johnstone("bumps")[1]
    approximation, *details = pywt.wavedec(observed, "sym4", "periodization", level=3)
    sdev = mad(details[-1] - np.median(details[-1]))
    details = [ebayes_threshold(detail, prior, scale, sdev, rule).estimate for detail in details]
    expected = pywt.waverec([approximation, *details], "sym4", "periodization")
    options = {"scale": scale, "rule": rule, "levels": 3, "boundary": "periodic"}
    assert np.abs(denoise_signal(observed, "sym4", prior, False, **options) - expected).max() < 1e-11


# Invariants of a signal


@pytest.mark.parametrize(("translation_invariant", "holds"), [(True, True), (False, False)])
def test_shifts_commute_with_the_stationary_transform_only(translation_invariant, holds):
    observed = donoho_johnstone("doppler")[1]

    def smooth(y):
        return denoise_signal(y, translation_invariant=translation_invariant, boundary="periodic")

    difference = np.abs(smooth(np.roll(observed, 37)) - np.roll(smooth(observed), 37)).max()
    assert bool(difference < 1e-9) is holds


@pytest.mark.parametrize("translation_invariant", [True, False])
@pytest.mark.parametrize("n_time", [16, 17, 100, 1001])
def test_any_length_scale_and_offset(n_time, translation_invariant):
    rng = np.random.default_rng(2)
    observed = np.sin(np.arange(n_time) / 20.0) + 0.1 * rng.normal(size=n_time)
    smooth = denoise_signal(observed, translation_invariant=translation_invariant)
    assert smooth.shape == (n_time,)
    other = denoise_signal(3.0 - 1e-3 * observed, translation_invariant=translation_invariant)
    assert np.abs(other - (3.0 - 1e-3 * smooth)).max() < 1e-3 * 1e-6


@pytest.mark.parametrize("wavelet", ["haar", "db4", "sym8", "coif3"])
def test_noise_alone_is_removed_but_for_the_approximation(wavelet):
    noise = np.random.default_rng(3).normal(size=4096)
    smooth = denoise_signal(noise, wavelet, boundary="periodic")
    assert smooth.mean() == pytest.approx(noise.mean(), abs=1e-12)
    assert rms(smooth) < 2.0 * np.sqrt(8 / 4096)  # eight coefficients are left alone


@pytest.mark.parametrize("slope", [0.02, 0.2, 2.0, 20.0])
def test_ramp_does_not_ring_at_the_ends(slope):
    ramp = slope * np.arange(4096)
    ends = np.r_[:64, 4032:4096]
    errors = {"reflect": [], "periodic": []}
    for seed in range(5):
        observed = ramp + np.random.default_rng(seed).normal(size=ramp.size)
        for boundary, end_errors in errors.items():
            end_errors.append((denoise_signal(observed, "sym8", boundary=boundary) - ramp)[ends])
    assert rms(np.array(errors["reflect"])) < 0.2  # noise standard deviations
    assert rms(np.array(errors["periodic"])) > 0.4


TIME = np.arange(4096)


@pytest.mark.parametrize(
    ("curve", "limit"), [(np.sin(TIME / 160.0 + 0.3), 3.0), (np.log1p(TIME / 30.0), 5.0)], ids=["wave", "turn"]
)
def test_curved_ends_cost_little_more_than_the_middle(curve, limit):
    noise = np.random.default_rng(6).normal(size=(8, TIME.size))
    errors = np.array([denoise_signal(curve + 0.003 * row, "sym8") - curve for row in noise])
    middle = rms(errors[:, 64:-64])
    assert rms(errors[:, :64]) < limit * middle
    assert rms(errors[:, -64:]) < limit * middle


def test_ends_that_differ_do_not_meet():
    noise = np.random.default_rng(7).normal(size=(8, TIME.size))
    ends = np.r_[:500, 3596:4096]
    step, flat = (
        rms(np.array([denoise_signal(signal + row, "sym8") - signal for row in noise])[:, ends])
        for signal in (30.0 * np.tanh((TIME - 2048) / 40.0), np.zeros(TIME.size))
    )
    assert step < 1.45 * flat  # 1.9 where the mirror images meet with a jump a twentieth of the record away


def test_derivative_of_the_smooth_signal_beats_that_of_the_noisy_one():
    clean = zigzag()
    observed = noisy(clean, 0.01)
    truth = derivative(clean["v"], 0.1, "central")
    raw = rms(derivative(observed["v"], 0.1, "central") - truth)
    smooth = rms(derivative(denoise(observed)["v"], 0.1, "central") - truth)
    assert smooth < raw / 10.0


# A trial


@pytest.mark.parametrize("level", [0.001, 0.01, 0.1])
def test_trial_comes_nearer_to_the_truth(level):
    clean = zigzag()
    observed = noisy(clean, level)
    smooth = denoise(observed)
    for name in SMOOTHED:
        sdev = level * float(abs(clean[name]).max())
        assert smooth[name].attrs["noise_sdev"] == pytest.approx(sdev, rel=0.1)
        assert rms((smooth[name] - clean[name]).to_numpy()) < 0.3 * sdev


@pytest.mark.parametrize("translation_invariant", [True, False])
def test_clean_trial_is_left_alone(translation_invariant):
    clean = zigzag()
    smooth = denoise(clean, translation_invariant=translation_invariant)
    for name in SMOOTHED:
        assert float(abs(smooth[name] - clean[name]).max()) < 1e-7 * float(abs(clean[name]).max())


def test_rest_of_the_trial_stays_and_the_record_says_what_was_done():
    observed = noisy(zigzag(), 0.01)
    observed["v"].attrs["units"] = "m/s"
    before = observed.copy(deep=True)
    smooth = denoise(observed, "sym4", "cauchy", channels=["v", "r"], rule="mean", scale=None)
    xr.testing.assert_identical(observed, before)
    for name in ("u", "psi", "x", "delta", "time"):
        xr.testing.assert_identical(smooth[name], observed[name])
    assert not np.array_equal(smooth["r"], observed["r"])
    assert smooth["v"].attrs["units"] == "m/s"
    assert smooth.attrs == {
        "vessel": "somebody",
        "denoised": "v r",
        "denoise_wavelet": "sym4",
        "denoise_transform": "translation invariant",
        "denoise_prior": "cauchy",
        "denoise_rule": "mean",
    }
    for attrs in (smooth.attrs, smooth["v"].attrs):
        assert all(type(value) in (str, int, float) for value in attrs.values())  # what netCDF can hold


def test_trial_is_denoised_channel_by_channel():
    observed = noisy(zigzag(), 0.01)
    smooth = denoise(observed, "db4", rule="soft", levels=5)
    for name in SMOOTHED:
        alone = denoise_signal(observed[name], "db4", rule="soft", levels=5)
        assert np.array_equal(smooth[name], alone)


@pytest.mark.parametrize("translation_invariant", [True, False])
def test_channels_without_noise_pass_unharmed(translation_invariant):
    trial = zigzag()
    time = trial.time.size
    trial["u"] = ("time", np.full(time, 0.1))
    trial["v"] = ("time", np.zeros(time))
    trial["psi"] = trial["psi"].round(1)  # eight values
    with pytest.warns() as caught:
        smooth = denoise(trial, translation_invariant=translation_invariant)
    assert [" psi " in f" {warning.message} " for warning in caught] == [True]
    for name in ("u", "v", "psi"):
        assert np.array_equal(smooth[name], trial[name])
        assert smooth[name].attrs["noise_sdev"] == 0.0


@pytest.mark.parametrize("translation_invariant", [True, False])
@pytest.mark.parametrize("rest", [slice(0, 2600), slice(1500, None), slice(1000, 2500)])
@pytest.mark.parametrize("step", [0.0, 0.03])
def test_a_sensor_at_rest_for_a_part_of_the_record_has_the_noise_of_the_rest(rest, step, translation_invariant):
    rng = np.random.default_rng(8)
    clean = np.sin(TIME / 160.0)
    clean[rest] = clean[rest][0]
    noise = 0.05 * rng.normal(size=TIME.size)
    noise[rest] = 0.0
    observed = clean + noise
    if step:
        clean[rest] = (clean[rest] / step).round() * step
        observed = (observed / step).round() * step
    moving = np.ones(TIME.size, dtype=bool)
    moving[rest] = False
    smooth = denoise_signal(observed, "sym8", translation_invariant=translation_invariant)
    assert rms((smooth - clean)[moving]) < 0.25 * rms((observed - clean)[moving])


@pytest.mark.parametrize("step", [0.003, 0.01, 0.03, 0.1])
@pytest.mark.parametrize("sdev", [0.0, 0.003, 0.01, 0.03])
def test_a_rounded_signal_comes_nearer_to_the_truth(sdev, step):
    """Rounding is noise of step / 12^(1/2); where it is most of the noise, it is not white."""
    clean = np.sin(TIME / 160.0 + 0.3)
    observed = ((clean + sdev * np.random.default_rng(9).normal(size=TIME.size)) / step).round() * step
    error = rms(denoise_signal(observed, "sym8") - clean)
    assert error < (0.7 if sdev < 0.2 * step else 0.5) * rms(observed - clean)


def test_an_order_is_not_smoothed():
    """Steps between a few values are no rounding."""
    order = np.where((TIME // 400) % 2, 0.35, -0.35)
    with pytest.warns():
        assert np.array_equal(denoise_signal(order), order)


@pytest.mark.parametrize("method", ["wavelet", "savitzky_golay", "low_pass", "rts"])
@pytest.mark.parametrize("step", [1.0, 0.25, np.deg2rad(0.25)])
def test_straight_lines_have_no_noise(step, method):
    """Their even steps are no rounding; so are those of a rudder between two angles at which it rests."""
    ramp = step * np.arange(400.0)
    rudder = np.clip(ramp, 50.0 * step, 200.0 * step)
    for signal in (ramp, ramp - 100.0 * step, rudder, rudder[::-1]):
        assert np.array_equal(denoise_signal(signal, method=method), signal)


def test_time_is_not_denoised():
    for channels in (["time"], ["u", "time"], ["u", "u"], "u"):
        with refused(ValueError, "time" if "time" in channels else "u"):
            denoise(zigzag(100), channels=channels)


@pytest.mark.parametrize("method", ["wavelet", "rts"])
def test_a_heading_that_jumps_by_whole_turns_is_smoothed_across_the_jump(method):
    record = noisy(zigzag(), 0.01)
    rate = 2.0 * np.pi / 500.0
    record["psi"] = record["psi"] + rate * np.arange(record.time.size)
    wrapped = record.assign(psi=(record["psi"] + np.pi) % (2.0 * np.pi) - np.pi)
    jumps = np.abs(np.diff(wrapped["psi"].values)) > 3.0
    assert jumps.sum() > 4
    whole, parts = denoise(record, method=method)["psi"], denoise(wrapped, method=method)["psi"]
    turns = (parts - whole).values / (2.0 * np.pi)
    np.testing.assert_allclose(turns, (wrapped["psi"] - record["psi"]).values / (2.0 * np.pi), atol=1e-9)
    if method == "wavelet":
        drawn = [denoise_draws(one, draws=2, rng=1)["psi"].values for one in (record, wrapped)]
        np.testing.assert_allclose(drawn[1] - drawn[0], np.tile(2.0 * np.pi * turns, (2, 1)), atol=1e-7)
