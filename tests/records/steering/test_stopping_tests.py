"""Stopping tests in records."""

import numpy as np
import pytest
import xarray as xr

import pymc_ship as ps
from pymc_ship.records.steering.measured import denoise_motion
from pymc_ship.records.steering.stopping_tests import INDICES, stopping_of_denoised, stopping_order


@pytest.fixture(scope="module")
def stopped():
    """What the forecast has, and the record of the same ship: 60 s of approach, then full astern."""
    vessel = ps.with_terms(ps.load_vessel("kvlcc2"), "modular at any speed")
    forecast = ps.stopping(vessel, astern=1.0, reversal=30.0).isel(draw=0)
    time = np.arange(0.0, 60.0 + float(forecast["stopping_time"]) + 20.0, 1.0)
    begun = np.clip(time - 60.0, 0.0, None)

    def at(name, before):
        known = np.isfinite(forecast[name].values)
        values = np.interp(begun, forecast["time"].values[known], forecast[name].values[known])
        return np.where(time < 60.0, before(time - 60.0), values)

    speed = vessel.particulars.nominal_speed
    u = at("u", lambda t: np.full(t.shape, speed))
    u[begun > float(forecast["stopping_time"])] = -0.05
    x, y = at("x", lambda t: speed * t), at("y", np.zeros_like)
    psi = np.unwrap(np.arctan2(np.gradient(y, time), np.gradient(x, time)))
    n = np.interp(time, [0.0, 60.0, 90.0], [1.5, 1.5, -1.0])
    channels = {"u": u, "v": 0.0 * u, "r": np.gradient(psi, time), "psi": psi, "x": x, "y": y, "n": n}
    trial = xr.Dataset({name: ("time", values) for name, values in channels.items()}, {"time": time})
    return forecast, trial.assign(delta=("time", 0.0 * u))


def measured(trial):
    return stopping_of_denoised(denoise_motion(trial), stopping_order(trial))


def test_a_record_shows_what_was_forecast(stopped):
    forecast, trial = stopped
    found = measured(trial)
    assert list(found) == list(INDICES)
    assert found["track_reach"] == pytest.approx(float(forecast["track_reach"]), rel=0.02)
    assert found["stopping_time"] == pytest.approx(float(forecast["stopping_time"]), abs=5.0)
    assert found["head_reach"] == pytest.approx(float(forecast["head_reach"]), rel=0.02)


def test_the_order_is_where_revolutions_leave_those_of_the_approach(stopped):
    assert stopping_order(stopped[1]) == pytest.approx(60.0, abs=1.0)


def test_a_ship_that_still_makes_way_has_not_stopped(stopped):
    cut = stopped[1].sel(time=slice(None, 300.0))
    assert np.isnan(measured(cut)["track_reach"])


@pytest.mark.parametrize(
    "change", [lambda t: t.assign(n=("time", np.full(t.sizes["time"], 1.5))), lambda t: t.drop_vars("n")]
)
def test_another_record_is_no_stopping_test(stopped, change):
    assert np.isnan(stopping_order(change(stopped[1])))


def swinging_stop(noise, swing=0.04):
    """A tanker of 7.97 m/s that stops in 1200 s with a slight swing [deg/s] to starboard, rudder amidships."""
    time = np.arange(1400.0)
    begun = np.clip(time - 180.0, 0.0, None)
    u = np.clip(7.97 * (1.0 - begun / 1200.0), -0.1, None)
    r = np.deg2rad(swing) * (1.0 - np.exp(-begun / 150.0))
    v, psi = -0.35 * 320.0 * r, np.concatenate([[0.0], np.cumsum(0.5 * (r[1:] + r[:-1]))])
    rates = np.array([u * np.cos(psi) - v * np.sin(psi), u * np.sin(psi) + v * np.cos(psi)])
    x, y = np.cumsum(rates, axis=1)
    n = np.interp(time, [0.0, 180.0, 210.0], [1.513, 1.513, -1.0])
    channels = {"u": u, "v": v, "r": r, "psi": psi, "x": x, "y": y, "n": n, "delta": 0.0 * u}
    sd = {"u": 0.03, "v": 0.03, "r": 2e-4, "psi": 2e-3, "x": 0.5, "y": 0.5, "delta": 2e-3, "n": 2e-3}
    rng = np.random.default_rng(3)
    read = {name: values + noise * sd[name] * rng.standard_normal(time.size) for name, values in channels.items()}
    return xr.Dataset({name: ("time", values) for name, values in read.items()}, {"time": time})


@pytest.mark.parametrize(("noise", "swing"), [(0.0, 0.04), (1.0, 0.04), (1.0, 0.0)])
def test_the_checks_of_a_stopping_test_ask_for_no_turn_and_no_revolutions_ahead(noise, swing):
    """Rudder amidships, revolutions astern while the ship makes way ahead; astern from the begin is a sign."""
    trial, vessel = swinging_stop(noise, swing), ps.load_vessel("kvlcc2")
    checks = {check.name: check for check in ps.trial_checks(trial, vessel, any_speed=True)}
    assert [name for name, check in checks.items() if check.verdict == "bad"] == []
    assert checks["revolutions"].verdict == "good"
    flipped = ps.trial_checks(trial.assign(n=-trial["n"]), vessel, any_speed=True)
    assert "sign = -1" in next(check.sentence for check in flipped if check.name == "revolutions")


def test_a_rudder_that_rests_in_another_record_is_missed():
    """The twin without an astern order."""
    trial = swinging_stop(0.0).assign(n=("time", np.full(1400, 1.5)))
    checks = {check.name: check.verdict for check in ps.trial_checks(trial, ps.load_vessel("kvlcc2"), any_speed=True)}
    assert checks["rudder unit"] == "bad"
