"""Lag of velocities behind the track, by kind, distinguished from a lever arm and corrected; one lag for all runs."""

from __future__ import annotations

import re

import numpy as np
import pytest

import pymc_ship as ps
from pymc_ship.records.checks.lag import LAG, NAME, READINGS, VelocityLag, common_lag, lag_of
from pymc_ship.records.checks.track import body_velocity, earth_velocity
from pymc_ship.records.checks.verdicts import Check
from pymc_ship.records.files.ship_scale import SIGNIFICANT
from tests.records.checks.cases import changed, checks_by_name, lever, noisy

SECONDS = 0.8


def earlier(trial, values, seconds):
    time = trial["time"].values
    return np.interp(time - seconds, time, values)


def late_body(trial, seconds=SECONDS):
    """u and v of so many seconds ago."""
    return changed(trial, **{name: earlier(trial, trial[name].values, seconds) for name in ("u", "v")})


def late_earth(trial, seconds=SECONDS):
    """Earth-fixed velocities of so many seconds ago, turned into the body by the present heading."""
    x_dot, y_dot = (earlier(trial, values, seconds) for values in earth_velocity(trial))
    u, v = body_velocity(changed(trial, u=x_dot, v=y_dot))
    return changed(trial, u=u, v=v)


def late_heading(trial, seconds=SECONDS):
    """psi and r of so many seconds ago."""
    return changed(trial, **{name: earlier(trial, trial[name].values, seconds) for name in ("psi", "r")})


LATE = {"earth": late_earth, "body": late_body, "heading": late_heading}


@pytest.fixture(scope="module")
def runs(container):
    """Two zigzags and a circle, clean, sampled at 5 Hz, integrated by RK4 so that no step is late itself."""
    manoeuvres = ps.zigzag(20.0, 20.0), ps.zigzag(10.0, 10.0, side="starboard"), ps.turning_circle(35.0)
    return [ps.simulate(container, one, duration=400.0, record_interval=0.2, method="rk4") for one in manoeuvres]


@pytest.mark.parametrize("kind", LATE)
@pytest.mark.parametrize("run", [0, 1, 2])
def test_a_lag_is_told_by_kind_and_not_taken_for_a_lever_arm(runs, container, kind, run):
    checks = checks_by_name(noisy(LATE[kind](runs[run]), level=0.002), container)
    lag = lag_of(checks["velocity lag"])
    assert checks["velocity lag"].verdict == "doubtful"
    assert lag.kind == kind
    assert lag.seconds == pytest.approx(SECONDS, abs=SIGNIFICANT * lag.error + 0.02)
    assert checks["lever arm"].verdict != "doubtful"


@pytest.mark.parametrize("kind", LATE)
def test_all_channels_that_are_late_are_set_right(runs, container, kind):
    late = LATE[kind](runs[0])
    mended = ps.validated_trial(late, container)
    true = runs[0].sel(time=mended["time"])
    for name in READINGS[kind][0]:
        before = np.abs(late[name].sel(time=mended["time"]) - true[name]).max()
        assert float(np.abs(mended[name] - true[name]).max()) < 0.05 * float(before)
    assert "later" in mended.attrs["corrections"][0]


@pytest.mark.parametrize("kind", ["body", "earth"])
@pytest.mark.parametrize("wrong", [False, True])
def test_a_long_lag_is_no_other_unit_or_sign_of_v(runs, container, kind, wrong):
    """5 s, which half of v, or knots, explain in part; a v of another sign is still one."""
    late = noisy(LATE[kind](runs[0], 5.0), level=0.002)
    checks = checks_by_name(changed(late, v=-late["v"].values) if wrong else late, container)
    assert (checks["sway sign"].verdict == "bad") == wrong
    if not wrong:
        assert lag_of(checks["velocity lag"]).kind == kind
        assert lag_of(checks["velocity lag"]).seconds == pytest.approx(5.0, abs=0.2)
        assert checks["velocity lag"].mendable


@pytest.mark.parametrize("antenna", [60.0, -60.0])
@pytest.mark.parametrize("late", [("x", "y"), ("u", "v"), ("psi", "r")], ids="-".join)
@pytest.mark.parametrize("run", [0, 1])
def test_a_late_sensor_and_an_antenna_off_the_origin_are_told_apart(runs, container, antenna, late, run):
    psi, x, y = (runs[run][name].values for name in ("psi", "x", "y"))
    trial = changed(runs[run], x=x + antenna * np.cos(psi), y=y + antenna * np.sin(psi))
    trial = changed(trial, **{name: earlier(trial, trial[name].values, 2.0) for name in late})
    checks = checks_by_name(noisy(trial.sel(time=slice(10.0, None)), level=0.002), container)
    assert abs(lag_of(checks["velocity lag"]).seconds) == pytest.approx(2.0, abs=0.15)
    assert lag_of(checks["velocity lag"]).late == late
    assert checks["lever arm"].value("lever arm") == pytest.approx(antenna, abs=3.0)


@pytest.mark.parametrize(("share", "mendable"), [(0.45, True), (0.7, False)])
def test_a_lag_of_half_a_ship_length_is_named_and_not_mended(runs, container, share, mendable):
    seconds = share * container.particulars.L / container.particulars.nominal_speed
    check = checks_by_name(noisy(late_body(runs[1], seconds), level=0.002), container)["velocity lag"]
    assert (check.verdict, check.mendable, "state their delay" in check.sentence) == (
        "doubtful",
        mendable,
        not mendable,
    )


@pytest.mark.parametrize("run", [0, 1])
def test_late_positions_leave_the_velocities_alone(runs, container, run):
    """A receiver that filters is late; velocities that are early do not exist."""
    late = changed(runs[run], **{name: earlier(runs[run], runs[run][name].values, 3.0) for name in ("x", "y")})
    mended = ps.validated_trial(late, container)
    true = runs[run].sel(time=mended["time"])
    for name in ("u", "v"):
        assert (mended[name] == true[name]).all()
    for name in ("x", "y"):
        settled = slice(20.0, None)  # x, y before the first sample are not known
        before, after = (np.abs((one[name] - true[name]).sel(time=settled)).max() for one in (late, mended))
        assert float(after) < 0.05 * float(before)
    assert re.fullmatch(r"x and y taken from (2.9\d|3.0?\d?) s later.", mended.attrs["corrections"][0])


@pytest.mark.parametrize("run", [0, 1])
def test_a_lever_arm_is_no_lag(runs, container, run):
    checks = checks_by_name(noisy(lever(runs[run])), container)
    assert checks["velocity lag"].verdict == "good"
    assert checks["lever arm"].mendable
    assert checks["lever arm"].value("lever arm") == pytest.approx(20.0, abs=1.0)


def test_where_a_late_heading_may_be_a_lever_arm_nothing_is_moved(runs, container):
    """In much noise, the speed of a 10/10 zigzag varies too little to distinguish them."""
    trial = noisy(lever(runs[1]), level=0.03)
    check = checks_by_name(trial, container)["lever arm"]
    assert (check.verdict, check.mendable) == ("doubtful", False)
    assert "psi and r are" in check.sentence
    assert (ps.validated_trial(trial, container)["v"] == trial["v"]).all()


@pytest.mark.parametrize("run", [0, 1, 2])
def test_a_sound_record_has_no_lag(runs, container, run):
    checks = checks_by_name(noisy(runs[run]), container)
    assert checks["velocity lag"].verdict == "good"
    assert common_lag([tuple(checks.values())]) is None


def test_one_lag_of_a_facility_is_that_of_all_its_runs(runs, container):
    checked = [ps.trial_checks(noisy(late_earth(run), seed=k), container) for k, run in enumerate(runs)]
    lag = common_lag(checked)
    assert lag.kind == "earth"
    assert lag.seconds == pytest.approx(SECONDS, abs=SIGNIFICANT * lag.error + 0.02)
    assert lag.error < min(lag_of(next(c for c in checks if c.name == "velocity lag")).error for checks in checked)


def test_a_run_with_an_uncertain_lag_is_corrected_by_that_of_the_others(runs, container):
    lag = VelocityLag("earth", SECONDS, 0.01)
    quiet = noisy(late_earth(runs[1]), level=0.05)
    check = checks_by_name(quiet, container)["velocity lag"]
    common = {one.name: one for one in ps.trial_checks(quiet, container, lag=lag)}["velocity lag"]
    assert lag_of(common).seconds == SECONDS
    assert common.mendable
    assert "all runs" in common.sentence
    assert check.sentence != common.sentence


def test_a_lag_shorter_than_matters_is_left_alone(runs, container):
    L_over_U = container.particulars.L / container.particulars.nominal_speed
    short = late_earth(runs[0], 0.5 * LAG * L_over_U)
    assert checks_by_name(short, container)["velocity lag"].verdict == "good"


def test_a_lag_shorter_than_a_sample_is_left_alone(runs, container):
    """Half a second is resolved at 5 Hz; at 1 Hz the interpolation between samples is as far off."""
    late = late_earth(runs[0], 0.5)
    assert checks_by_name(late, container)["velocity lag"].verdict == "doubtful"
    assert checks_by_name(late.isel(time=slice(None, None, 5)), container)["velocity lag"].verdict == "good"


@pytest.mark.parametrize("error", [0.05, 0.1, 0.4])
def test_the_error_of_a_common_lag_is_that_of_a_mean(error):
    """Of runs of equal error: from their scatter where that is larger than the error of each, else from that."""
    seconds = np.array([0.6, 0.7, 0.95, 0.75])
    lag = common_lag([(lag_check_of(value, error),) for value in seconds])
    assert lag.seconds == pytest.approx(seconds.mean(), rel=1e-12)
    assert lag.error == pytest.approx(max(seconds.std(ddof=1), error) / 2.0, rel=1e-9)


def lag_check_of(seconds, error):
    """Check with such a lag."""
    numbers = [("lag", seconds), ("standard error", error), ("misfit", 1.0)]
    values = ((f"{name}, {kind}", value, "") for kind in READINGS for name, value in numbers)
    return Check(NAME, "doubtful", "", tuple(values), mendable=True)
