"""Instruments: resolution, missing samples and a clock that jitters, each against what was asked for."""

from __future__ import annotations

import numpy as np
import pytest
import xarray as xr

import pymc_ship as ps
from pymc_ship.records.files.instruments import INSTRUMENTS
from tests.records.files.test_noise import sd_is
from tests.sentences import refused

DEG = np.deg2rad(1.0)


def ramp(n_time=20_000, slope=0.01):
    """A record whose heading grows steadily, at 50 Hz."""
    time = 0.02 * np.arange(n_time)
    channels = {"psi": slope * time, "u": np.full(n_time, 7.0), "delta": np.zeros(n_time)}
    units = {"psi": "rad", "u": "m/s", "delta": "rad"}
    variables = {k: ("time", c, {"units": units[k]}) for k, c in channels.items()}
    return xr.Dataset(variables, {"time": time}, {"vessel": "a"})


def read(instrument, trial=None, seed=1):
    return ps.pollute(ramp() if trial is None else trial, noise=instrument, rng=np.random.default_rng(seed))


def test_readings_are_multiples_of_the_resolution_within_half_a_step():
    trial = ramp()
    reading = read(ps.Instrument(sd={"psi": 0.0}, resolution={"psi": 0.1 * DEG}), trial)
    steps = reading["psi"].values / (0.1 * DEG)
    assert np.abs(steps - np.round(steps)).max() < 1e-9
    error = (reading["psi"] - trial["psi"]).values
    assert 0.049 * DEG < np.abs(error).max() <= 0.05 * DEG * (1.0 + 1e-9)
    assert sd_is(error[::37], 0.1 * DEG / np.sqrt(12.0))  # uniform, where the samples are far apart


def test_noise_has_the_standard_deviation_stated():
    trial = ramp()
    reading = read(ps.Instrument(sd={"psi": 0.2 * DEG, "u": 0.05}), trial)
    for name, sd in (("psi", 0.2 * DEG), ("u", 0.05)):
        error = (reading[name] - trial[name]).values
        assert sd_is(error, sd)
        assert not sd_is(error, 1.1 * sd)
        assert reading.attrs[f"noise_sd_{name}"] == pytest.approx(sd)
    assert reading["delta"].identical(trial["delta"])
    assert "noise_sd_psi" not in trial.attrs


def test_a_clock_that_jitters_errs_by_slope_times_jitter():
    """The stamps stay nominal, the sample is that of another instant; a channel that does not change shows nothing."""
    trial = ramp()
    reading = read(ps.Instrument(sd={"psi": 0.0, "u": 0.0}, jitter=0.03), trial)
    assert reading["time"].identical(trial["time"])
    assert sd_is((reading["psi"] - trial["psi"]).values, 0.01 * 0.03)
    assert not sd_is((reading["psi"] - trial["psi"]).values, 0.01 * 0.04)
    assert np.abs(reading["u"] - trial["u"]).max() < 1e-12


def test_channels_of_an_instrument_share_their_instants():
    trial = ramp().assign(y=("time", 3.0 * ramp()["psi"].values))
    reading = read(ps.Instrument(sd={"psi": 0.0, "y": 0.0}, jitter=0.03), trial)
    np.testing.assert_allclose(reading["y"], 3.0 * reading["psi"], atol=1e-12)


def test_missing_samples_have_the_share_and_the_runs_asked_for():
    """Over 40 records, within four standard errors of their mean."""
    shares, runs = [], []
    for seed in range(40):
        gone = np.isnan(read(ps.Instrument(sd={"u": 0.0, "psi": 0.0}, missing=0.05, run=4.0), seed=seed)["u"].values)
        begins = gone[1:] & ~gone[:-1]
        shares.append(gone.mean())
        runs.append(gone[1:].sum() / max(begins.sum(), 1))
    for estimates, expected in ((shares, 0.05), (runs, 4.0)):
        error = np.std(estimates, ddof=1) / np.sqrt(40)
        assert abs(np.mean(estimates) - expected) < 4.0 * error
        assert abs(np.mean(estimates) - 1.2 * expected) > 4.0 * error


def test_missing_samples_are_filled_by_the_reader_and_refused_elsewhere(tmp_path):
    trial = read(ps.Instrument(sd={"u": 0.0, "psi": 0.0}, missing=0.02, run=2.0), ramp(2000))
    assert np.array_equal(np.isnan(trial["u"]), np.isnan(trial["psi"]))
    with refused(ps.TrialError, "u"):
        ps.denoise(trial)
    again = ps.read_trial(ps.write_trial(trial, tmp_path / "gaps.csv"))
    assert "filled by interpolation" in again.attrs["reading"]
    clean = ramp(2000)["psi"].sel(time=again["time"])
    assert np.abs(again["psi"] - clean).max() < 1e-12


@pytest.mark.parametrize("name", INSTRUMENTS)
def test_a_preset_reads_a_simulated_trial(zigzag_trial, name):
    reading = read(name, zigzag_trial)
    for channel, sd in INSTRUMENTS[name].sd.items():
        error = (reading[channel] - zigzag_trial[channel]).values
        error = error[np.isfinite(error)]
        step = INSTRUMENTS[name].resolution[channel]
        assert sd < error.std() * 1.05 < 1.2 * np.hypot(sd, step)
    untouched = [c for c in ("u", "v", "r", "p", "phi", "psi", "delta") if c not in INSTRUMENTS[name].sd]
    assert all(reading[c].identical(zigzag_trial[c]) for c in untouched)


def test_a_function_is_a_kind_of_noise_and_comes_after_an_instrument():
    def spiky(clean, rng):
        hit = rng.random(clean.sizes["time"]) < 0.01
        return clean.assign(u=clean["u"] + np.where(hit, 1.0, 0.0))

    trial = ramp()
    reading = read(["fluxgate_compass", spiky], trial)
    assert set(np.unique(reading["u"])) == {7.0, 8.0}
    assert not np.array_equal(reading["psi"], trial["psi"])
    assert reading.identical(read(["fluxgate_compass", spiky], trial))


def test_a_function_that_changes_its_argument_leaves_the_clean_trial():
    def shifted(clean, rng):
        clean["psi"].values[:] += 1.0
        clean.attrs["vessel"] = "b"
        return clean

    trial = ramp(100)
    reading = read(shifted, trial)
    assert trial.identical(ramp(100))
    assert reading["psi"].equals(ramp(100)["psi"] + 1.0)
