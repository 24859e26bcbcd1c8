"""Sampling, noise, spikes, gaps and frozen sensors: each is reported, and corrected where possible."""

from __future__ import annotations

import numpy as np
import pytest

import pymc_ship as ps
from pymc_ship.records.checks.record_quality import spikes
from pymc_ship.records.checks.verdicts import balance
from tests.records.checks.cases import (
    INTERVAL,
    alarms,
    changed,
    checks_by_name,
    noisy,
    simulated,
    steered,
    with_samples,
)


def wrapped(trial):
    return changed(trial, psi=(trial["psi"].values + 3.3 + np.pi) % (2.0 * np.pi) - np.pi - 3.3)


@pytest.mark.parametrize(("every", "verdict"), [(1, "good"), (5, "good"), (15, "doubtful"), (30, "bad")])
def test_the_sampling_is_judged_by_the_ship(zigzag, container, every, verdict):
    checks = checks_by_name(zigzag.isel(time=slice(None, None, every)), container)
    assert checks["sampling"].verdict == verdict
    assert checks["sampling"].value("interval") == pytest.approx(INTERVAL * every)


def test_a_record_in_days_that_is_read_in_seconds_has_too_many_samples(zigzag, container):
    days = zigzag.assign_coords(time=zigzag["time"] / 86400.0)
    check = checks_by_name(days, container)["sampling"]
    assert check.verdict == "bad"
    assert "No logger is so fast: state the unit of time in the format" in check.sentence


@pytest.mark.parametrize("times", [2, 3])
def test_readings_that_stand_several_times_are_counted(zigzag, container, times):
    """A log at 1 Hz whose every reading stands twice, read as one at 2 Hz."""
    held = noisy(zigzag).isel(time=np.arange(zigzag.sizes["time"]) // times * times)
    check = checks_by_name(held.assign_coords(time=zigzag["time"]), container)["sampling"]
    assert check.verdict == "doubtful"
    assert f"Each reading is repeated {times} times" in check.sentence
    one_slow = noisy(zigzag).assign(x=held["x"].variable, y=held["y"].variable)
    assert checks_by_name(one_slow, container)["sampling"].verdict == "good"


def test_a_rudder_that_jumps_between_samples_is_doubted(container):
    trial = noisy(steered(container, rate_limited=False)).isel(time=slice(None, None, 5))
    checks = checks_by_name(trial, container)
    assert alarms(checks) == {"sampling", "rudder rate"}
    assert "of its range between samples" in checks["sampling"].sentence
    assert "an ordered angle" in checks["sampling"].sentence
    assert "delta is the ordered angle" in checks["rudder rate"].sentence


def test_a_gear_that_moves_within_a_few_samples_asks_for_more_of_them():
    """2.35 deg/s, 20 deg from side to side, at 3 s: a gear as ships have it."""
    vessel = ps.load_vessel("kvlcc2")
    check = checks_by_name(ps.simulate(vessel, ps.zigzag(10.0, 10.0), duration=600.0, record_interval=3.0), vessel)[
        "sampling"
    ]
    assert check.verdict == "doubtful"
    assert check.sentence.endswith("of its range between samples; sample faster.")


@pytest.mark.parametrize(("share", "verdict"), [(0.1, "good"), (0.5, "doubtful"), (1.5, "bad")])
def test_noise_is_judged_by_the_spread_of_its_channel(zigzag, container, share, verdict):
    v = zigzag["v"].values
    v = v + share * v.std() * np.random.default_rng(3).standard_normal(v.size)
    checks = checks_by_name(changed(zigzag, v=v), container)
    assert checks["noise"].verdict == verdict
    assert checks["noise"].value("sd v") == pytest.approx(share * zigzag["v"].values.std(), rel=0.1)


@pytest.mark.parametrize("noise", [("gnss", "mems_gyro", "fluxgate_compass"), "mems_gyro", "mru"])
def test_noise_and_steps_of_roll_are_those_of_a_ship_that_rolls(container, noise):
    """A ship without roll has p and phi of 0, of which an instrument makes noise that no fit uses."""
    vessel = ps.load_vessel("kvlcc2")
    trial = ps.simulate(vessel, ps.zigzag(20.0, 20.0), duration=400.0, record_interval=1.0)
    read = ps.pollute(trial, noise=noise, rng=1).interpolate_na("time", fill_value="extrapolate")
    checks = checks_by_name(read, vessel)
    assert not {check.name for check in checks.values() if check.verdict == "bad"}
    rolling = checks_by_name(read, container)
    assert "bad" in {rolling["noise"].verdict, rolling["resolution"].verdict}


@pytest.mark.parametrize(("step", "verdict"), [(0.001, "good"), (0.05, "doubtful"), (0.2, "bad")])
def test_a_coarse_channel_is_told(container, step, verdict):
    trial = simulated(container, ps.zigzag(20.0, 20.0))
    size = step * np.ptp(trial["v"].values)
    check = checks_by_name(changed(trial, v=size * np.rint(trial["v"].values / size)), container)["resolution"]
    assert check.verdict == verdict
    assert verdict == "good" or "v has" in check.sentence


def test_spikes_are_found_told_and_mended(zigzag, container):
    where = np.array([100, 400, 401, 1500])
    trial = with_samples(zigzag, "r", where, 0.2)
    trial = with_samples(trial, "y", [777], 1e4)
    checks = ps.trial_checks(trial, container)
    named = {check.name: check for check in checks}
    assert alarms(named) == {"spikes"}
    assert (named["spikes"].value("spikes, r"), named["spikes"].value("spikes, y")) == (4.0, 1.0)
    mended = ps.corrected_trial(trial, checks)
    for name in ("r", "y"):
        others = np.setdiff1d(np.arange(zigzag.sizes["time"]), [*where, 777])
        assert (mended[name].values[others] == zigzag[name].values[others]).all()
        assert np.abs(mended[name].values - zigzag[name].values).max() < 0.05 * np.ptp(zigzag[name].values)
    assert mended.attrs["corrections"] == ["Samples replaced by interpolation: 5."]


def test_many_spikes_are_a_broken_sensor(zigzag, container):
    trial = with_samples(zigzag, "r", np.arange(5, 2000, 20), 0.2)
    assert checks_by_name(trial, container)["spikes"].verdict == "bad"


def test_white_noise_steps_and_corners_have_no_spikes(zigzag):
    rng = np.random.default_rng(5)
    assert spikes(rng.standard_normal(200_000)).size == 0
    assert spikes(np.repeat([0.0, 1.0, 0.0], 50)).size == 0
    assert spikes(zigzag["delta"].values[::20]).size == 0
    assert spikes(np.zeros(100)).size == 0


def faults_of_a_sensor(zigzag):
    """Records with a jump, by the channel that jumps."""
    turned = 900 + int(np.argmax(np.abs(zigzag["v"].values[900:1300])))
    half, part = np.arange(zigzag.sizes["time"]) > turned, slice(turned, turned + 60)
    return {
        "u": changed(zigzag, u=zigzag["u"].values * np.where(half, 1.944, 1.0)).drop_vars(["x", "y"]),
        "v": changed(zigzag, v=zigzag["v"].values * np.where(half, 1.944, 1.0)).drop_vars(["x", "y"]),
        "psi": changed(zigzag, psi=zigzag["psi"].values + np.deg2rad(10.0) * half).drop_vars("r"),
        "x": changed(zigzag, x=zigzag["x"].values + 25.0 * half),
        "r": with_samples(zigzag, "r", part, 0.0),
        "delta": with_samples(zigzag, "delta", part, 0.0),
    }


@pytest.mark.parametrize("level", [0.0, 0.01])
def test_a_jump_of_a_sensor_is_found(zigzag, container, level):
    """A unit that changes half way, a gyro that is set, a jump of a receiver, a sensor that drops out."""
    for name, trial in faults_of_a_sensor(noisy(zigzag, level=level) if level else zigzag).items():
        check = checks_by_name(trial, container)["jumps"]
        assert check.verdict == ("doubtful" if name in ("psi", "x", "v") else "bad"), name
        assert [label for label, *_ in check.numbers] == [f"jumps, {name}"]
        assert f" of {name} by " in check.sentence


def test_an_order_recorded_as_the_angle_of_a_circle_is_doubtful(container):
    """The helmsman steers by hand on the approach, then the log jumps to the order."""
    run = ps.simulate(container, ps.turning_circle(20.0), duration=400.0, record_interval=0.2)
    wave = np.deg2rad(12.0) * (1.0 - np.cos(0.1 * np.arange(300.0)))
    straight = {name: np.append(np.full(300, run[name].values[0]), run[name].values[:-300]) for name in ("u", "r")}
    delta = np.append(wave * (np.arange(300) < 250), np.full(run.sizes["time"] - 300, run["delta"].values[-1]))
    trial = changed(run.drop_vars(["x", "y", "v", "psi", "p", "phi"], errors="ignore"), delta=delta, **straight)
    check = checks_by_name(trial, container)["jumps"]
    assert check.verdict == "doubtful"
    assert "Or delta is the ordered angle." in check.sentence
    dropped = np.append(wave[:220], np.where(np.arange(run.sizes["time"] - 220) < 300, wave[220], 0.0))
    assert checks_by_name(changed(trial, delta=dropped), container)["jumps"].verdict == "bad"


def test_two_runs_in_one_file_are_named(zigzag, circle, container):
    n = zigzag.sizes["time"] // 2
    both = {
        name: np.append(zigzag[name].values[:n], circle[name].values[-n:])
        for name in zigzag.data_vars
        if "time" in zigzag[name].dims
    }
    check = checks_by_name(changed(zigzag.isel(time=slice(2 * n)), **both), container)["jumps"]
    assert check.verdict == "bad"
    assert "two runs in one file?" in check.sentence


def test_held_readings_and_quick_gears_do_not_jump(zigzag, container):
    held = zigzag.isel(time=np.arange(zigzag.sizes["time"]) // 5 * 5).assign_coords(time=zigzag["time"])
    assert checks_by_name(held, container)["jumps"].verdict == "good"
    assert checks_by_name(zigzag.isel(time=slice(None, None, 20)), container)["jumps"].verdict == "good"


@pytest.mark.parametrize("name", ["v", "r"])
def test_a_velocity_without_its_sign_is_named(zigzag, container, name):
    unsigned = changed(zigzag, **{name: np.abs(zigzag[name].values)})
    check = checks_by_name(unsigned.drop_vars(["x", "y", "psi"]), container)["signs"]
    assert check.verdict == "bad"
    assert check.sentence.startswith(f"{name} stays on one side")


def test_a_sway_velocity_that_drifts_to_one_side_keeps_its_sign(zigzag, container):
    """As in wind from abeam: larger than that of the zigzag."""
    drifting = changed(zigzag, v=zigzag["v"].values + 1.1 * np.abs(zigzag["v"].values).max())
    assert checks_by_name(drifting.drop_vars(["x", "y", "psi"]), container)["signs"].verdict == "good"


@pytest.mark.parametrize(
    ("values", "expected"), [([-1.0, 2.0], 0.5), ([1.0, 2.0], -0.5), ([-3.0, -1.5], -0.5), ([0.0, 0.0], 0.0)]
)
def test_the_balance_is_the_lesser_extreme_over_the_larger(values, expected):
    assert balance(np.array(values), 0.0) == pytest.approx(expected)


def test_a_stuck_rudder_indicator_is_found(zigzag, circle, container):
    """From the middle of the second hold on; a turning circle with a fixed rudder is one."""
    delta = zigzag["delta"].values
    stuck = with_samples(zigzag, "delta", slice(900, None), delta[900])
    check = checks_by_name(stuck, container)["frozen channels"]
    assert check.verdict == "bad"
    assert check.value("frozen, delta") > 180.0
    assert checks_by_name(circle, container)["frozen channels"].verdict == "good"


def test_noise_on_a_fixed_rudder_is_no_finding(circle, container):
    delta = circle["delta"].values + np.deg2rad(0.05) * np.random.default_rng(1).standard_normal(circle.sizes["time"])
    steady = changed(circle, delta=delta).isel(time=slice(300, None))
    checks = checks_by_name(steady.assign_coords(time=steady["time"] - steady["time"][0]), container)
    assert "(delta)" not in checks["noise"].sentence
    assert checks["rudder rate"].verdict == "not checked"


def test_a_heading_that_wraps_is_unwrapped(circle, container):
    trial = wrapped(circle)
    checks = ps.trial_checks(trial, container)
    named = {check.name: check for check in checks}
    assert alarms(named) == {"heading wraps"}
    assert named["heading wraps"].value("jumps") >= 1.0
    mended = ps.corrected_trial(trial, checks)["psi"].values
    assert np.ptp(mended - circle["psi"].values) < 1e-9


def test_a_heading_that_jumps_by_less_than_a_turn_does_not_wrap(circle, container):
    jumped = with_samples(circle, "psi", slice(1000, None), circle["psi"].values[1000:] + np.deg2rad(250.0))
    check = checks_by_name(jumped, container)["heading wraps"]
    assert (check.verdict, check.value("jumps")) == ("good", 0.0)


def test_equal_values_of_a_rounded_channel_are_not_frozen(container):
    """A speed shown in steps of 0.01 m/s stays for seconds; one that stays for L/U stands still all the same."""
    trial = simulated(container, ps.zigzag(20.0, 20.0))
    rounded = changed(trial, u=0.01 * np.rint(trial["u"].values / 0.01))
    assert checks_by_name(rounded, container)["frozen channels"].verdict == "good"
    stuck = with_samples(rounded, "u", slice(500, 700), rounded["u"].values[500])
    assert checks_by_name(stuck, container)["frozen channels"].verdict == "bad"


@pytest.mark.parametrize(("seconds", "verdict"), [(2.0, "good"), (10.0, "doubtful"), (40.0, "bad")])
def test_a_sensor_that_stands_still_is_found(zigzag, container, seconds, verdict):
    where = slice(500, 500 + round(seconds / INTERVAL))
    checks = checks_by_name(with_samples(zigzag, "u", where, zigzag["u"].values[500]), container)
    assert checks["frozen channels"].verdict == verdict
    if verdict != "good":
        assert checks["frozen channels"].value("frozen, u") == pytest.approx(seconds, abs=INTERVAL)


def test_a_channel_that_never_changes_is_bad(zigzag, container):
    assert checks_by_name(changed(zigzag, v=0.0 * zigzag["v"].values), container)["frozen channels"].verdict == "bad"


def test_gaps_that_the_reading_told_of_are_passed_on(zigzag):
    reading = "Comma separated.\n2 gaps of up to 3 samples: 4 filled by interpolation."
    check = checks_by_name(zigzag.assign_attrs(reading=reading))["gaps"]
    assert check.verdict == "doubtful"
    assert check.sentence.startswith("2 gaps of up to 3 samples")
    assert checks_by_name(zigzag.assign_attrs(reading="Comma separated."))["gaps"].verdict == "good"
    assert checks_by_name(zigzag)["gaps"].verdict == "not checked"


@pytest.mark.parametrize("stuck", [0.0, 7.0])
@pytest.mark.parametrize("name", ["u", "v", "r", "psi"])
def test_a_channel_that_stands_still_is_one_finding(zigzag, container, name, stuck):
    """A dead speed log is not also u and v swapped."""
    dead = changed(zigzag, **{name: np.full(zigzag.sizes["time"], stuck)})
    checks = checks_by_name(dead, container)
    assert {key for key in alarms(checks) if checks[key].verdict == "bad"} == {"frozen channels"}
    assert checks["plausibility"].verdict == ("good" if name in ("r", "psi") else "not checked")
    assert f"{name} stands still" in " ".join(check.sentence for check in checks.values())


@pytest.mark.parametrize(("course", "verdict"), [(0.0, "good"), (0.1, "bad")])
def test_a_coordinate_stands_still_only_while_the_ship_heads_along_the_other(container, course, verdict):
    """A ship gathers way along x; y is 0 until the rudder moves, also if the heading says otherwise."""
    straight = ps.rudder_programme([0.0, 90.0, 91.0], [0.0, 0.0, 0.3], approach_speed=6.0)
    run = simulated(container, straight, 200.0)
    before = run["time"].values < 80.0
    psi = np.where(before, course + 1e-4 * np.sin(run["time"].values), run["psi"].values)
    run = changed(run, y=np.where(before, 0.0, run["y"].values), psi=psi)
    assert checks_by_name(run, container)["frozen channels"].verdict == verdict


def test_the_signal_of_a_steady_sway_is_its_size(circle, container):
    """In a steady turn v is constant: its noise counts against v itself; a twin of noise about zero is noise."""
    steady = noisy(circle.isel(time=slice(1000, None)), level=0.02)
    ratio = checks_by_name(steady[["u", "v", "r", "psi", "x", "y", "delta"]], container)["noise"]
    assert ratio.verdict == "good"
    about_zero = changed(steady, v=steady["v"].values - steady["v"].values.mean())
    assert "(v)" in checks_by_name(about_zero.drop_vars(["p", "phi"]), container)["noise"].sentence
