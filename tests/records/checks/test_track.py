"""Numbers of the track checks: misfits, lever arms and drift of a size that is put in."""

from __future__ import annotations

import numpy as np
import pytest

import pymc_ship as ps
from pymc_ship.records.checks.track import DRIFT_GOOD, axes_checks, drift_check, earth_velocity, lever_check
from pymc_ship.records.checks.verdicts import integral
from pymc_ship.records.files.ship_scale import ship_scale
from tests.records.checks.cases import INTERVAL, alarms, changed, checks_by_name, noisy, simulated


@pytest.fixture(scope="module")
def clean(container):
    """A zigzag without noise."""
    return simulated(container, ps.zigzag(20.0, 20.0))


def with_own_track(trial):
    """Trial with the track of its own velocities."""
    x, y = (integral(values, INTERVAL) for values in earth_velocity(trial))
    return changed(trial, x=x, y=y)


def test_the_misfit_is_the_rms_of_the_velocity_that_is_missing(clean, container):
    """A track that sways by a sine: its amplitude times its frequency over the root of 2."""
    omega, amplitude = 2.0 * np.pi / 90.0, 4.0
    trial = changed(clean, y=clean["y"].values + amplitude * np.sin(omega * clean["time"].values))
    axes, _ = axes_checks(trial, ship_scale(trial, container), lambda _: np.inf)
    assert axes.value("misfit body-fixed") == pytest.approx(amplitude * omega / np.sqrt(2.0), rel=0.1)


@pytest.mark.parametrize(("arm", "side"), [(20.0, "aft"), (-20.0, "forward")])
def test_the_lever_arm_of_a_ship_that_heels_is_its_length(clean, container, arm, side):
    heeled = with_own_track(changed(clean, phi=np.full(clean.sizes["time"], 0.5)))
    trial = changed(heeled, v=heeled["v"].values - arm * heeled["r"].values)
    check = lever_check(trial, ship_scale(trial, container))
    assert check.value("lever arm") == pytest.approx(arm, rel=1e-3)
    assert f"20 m {side} of" in check.sentence


def test_a_speed_log_of_another_scale_and_a_current_are_separated_by_their_size(clean, container):
    """The log shows 5 % too little, and the track is carried to the east."""
    true = with_own_track(clean)
    drifting = changed(true, y=true["y"].values + 0.4 * true["time"].values)
    trial = changed(drifting, u=0.95 * true["u"].values, v=0.95 * true["v"].values)
    check = drift_check(trial, ship_scale(trial, container))
    assert check.verdict == "doubtful"
    assert "current or offset of 0.4 m/s and a scale of 1.053" in check.sentence
    assert check.value("unexplained") < 1.0
    assert check.value("drift") > 100.0


@pytest.mark.parametrize("seconds", [100.0, 400.0])
def test_a_drift_is_compared_with_the_length_or_the_distance(clean, container, seconds):
    """By that which allows more: the length in a short record, the distance in a long one."""
    whole = with_own_track(clean)
    trial = whole.sel(time=slice(0.0, seconds))
    time, L = trial["time"].values, container.particulars.L
    distance = float(np.hypot(np.diff(trial["x"]), np.diff(trial["y"])).sum())
    allowed = [fraction * size for fraction, size in zip(DRIFT_GOOD, (L, distance), strict=True)]
    assert (allowed[1] > 1.3 * allowed[0]) == (seconds > 300.0)
    for drift, verdict in ((np.mean(allowed), "good"), (1.3 * max(allowed), "doubtful")):
        carried = changed(trial, y=trial["y"].values + drift * time / seconds)
        assert drift_check(carried, ship_scale(carried, container)).verdict == verdict


@pytest.mark.parametrize("step", [0.5, 1.0])
def test_half_a_sample_of_travel_is_no_lever_arm(step):
    """Euler steps, whose track is half a step behind: 2.4 m of 320 m at 1 s."""
    vessel = ps.load_vessel("kvlcc2")
    run = ps.simulate(vessel, ps.zigzag(20.0, 20.0), duration=800.0, step=step)
    assert checks_by_name(noisy(run, level=0.005), vessel)["lever arm"].verdict == "good"


@pytest.mark.parametrize(
    ("wrong", "words"),
    [
        (lambda trial: changed(trial, u=-trial["u"].values), "with -u by"),
        (lambda trial: changed(trial, psi=trial["psi"].values + np.pi), "with a heading off by 180 deg by"),
    ],
)
def test_way_astern_does_not_blame_the_sign_of_v(zigzag, container, wrong, words):
    checks = checks_by_name(wrong(zigzag), container)
    assert checks["velocity axes"].verdict == "bad"
    assert words in checks["velocity axes"].sentence
    assert checks["sway sign"].verdict == "not checked"
    assert checks["track closure"].verdict == "not checked"


@pytest.mark.parametrize("direction", [0.0, 90.0, 200.0])
@pytest.mark.parametrize(("name", "interval"), [("container", 0.5), ("kvlcc2", 1.0)])
def test_a_current_is_neither_a_lag_nor_a_scale_of_v(name, interval, direction):
    """A clean zigzag through water that sets with 6 % of the speed: the checks that know a current may name it."""
    vessel = ps.load_vessel(name)
    flow, unit = (0.06 * vessel.particulars.nominal_speed, direction), vessel.particulars.ship_time
    settings = {"record_interval": interval, "method": "rk4", "current": flow}
    run = ps.simulate(vessel, ps.zigzag(20.0, 20.0), duration=interval * round(20.0 * unit / interval), **settings)
    checks = checks_by_name(noisy(run), vessel)
    assert alarms(checks) - {"approach"} <= {"heading offset", "speed", "track closure"}
    assert {checks[one].verdict for one in ("velocity lag", "lever arm", "sway sign")} == {"good"}


@pytest.fixture(scope="module")
def tanker():
    return ps.load_vessel("kvlcc2")


@pytest.fixture(scope="module")
def two_rounds(tanker):
    """A circle of two rounds in a current of 0.5 m/s, with noise."""
    run = ps.simulate(tanker, ps.turning_circle(35), duration=2400, record_interval=2.0, current=(0.5, 70.0))
    return noisy(run)


def test_velocities_over_ground_drift_with_the_track_of_a_circle(tanker, two_rounds):
    """Those through the water miss it by the current."""
    flow = 0.5 * np.exp(1j * (np.deg2rad(70.0) - two_rounds["psi"].values))
    ground = changed(two_rounds, u=two_rounds["u"].values + flow.real, v=two_rounds["v"].values + flow.imag)
    for trial, words in ((ground, "over ground"), (two_rounds, "use velocities through the water")):
        check = checks_by_name(trial, tanker)["track closure"]
        assert (check.verdict, words in check.sentence) == ("doubtful", True)
    assert checks_by_name(ground.assign_attrs(speeds="over ground"), tanker)["track closure"].verdict == "good"


@pytest.mark.parametrize("direction", [0.0, 90.0, 270.0])
@pytest.mark.parametrize("run", ["zigzag", "approach and turn", "quarter"])
def test_velocities_over_ground_show_a_current_across_where_the_ship_does_not_turn(tanker, run, direction):
    """In a turn alone nothing shows it; velocities through the water show none, nor those stated as over ground."""
    manoeuvres = {
        "zigzag": ps.zigzag(10.0, 10.0),
        "approach and turn": ps.rudder_programme([0.0, 120.0, 131.0, 600.0], np.deg2rad([0.0, 0.0, 20.0, 20.0])),
        "quarter": ps.turning_circle(20.0),
    }
    duration = 300 if run == "quarter" else 600
    settings = {"duration": duration, "record_interval": 1.0, "current": (0.6, direction)}
    water = noisy(ps.simulate(tanker, manoeuvres[run], **settings), level=0.005)
    flow = 0.6 * np.exp(1j * (np.deg2rad(direction) - water["psi"].values))
    ground = changed(water, u=water["u"].values + flow.real, v=water["v"].values + flow.imag)
    shown = run != "quarter" and direction != 0.0
    for trial, told in ((ground, shown), (water, False), (ground.assign_attrs(speeds="over ground"), False)):
        check = checks_by_name(trial, tanker)["track closure"]
        assert ("a current across, and u, v over ground" in check.sentence) == told
        assert check.verdict == "doubtful" or not told


@pytest.mark.parametrize("degrees", [0.0, 8.0, -4.0])
def test_a_misaligned_heading_beside_speeds_over_ground_is_named_in_a_zigzag(tanker, degrees):
    """v is of the course less the heading, and leads to the track."""
    run = noisy(ps.simulate(tanker, ps.zigzag(20.0, 20.0), duration=600, record_interval=1.0), level=0.005)
    over = (run["u"].values + 1j * run["v"].values) * np.exp(-1j * np.deg2rad(degrees))
    off = changed(run, u=over.real, v=over.imag, psi=run["psi"].values + np.deg2rad(degrees))
    check = checks_by_name(off.assign_attrs(speeds="over ground"), tanker)["track closure"]
    assert (check.verdict, "misaligned heading" in check.sentence) == (
        ("doubtful", True) if degrees else ("good", False)
    )
    if degrees:
        offset = float(check.sentence.split("offset = ")[1].split(" ")[0])
        assert offset == pytest.approx(-degrees, abs=0.5)


def test_a_circle_of_two_rounds_in_a_current_is_that_of_its_ship(tanker, two_rounds):
    """Neither a course instead of a heading, nor the low speed of a long turn, is found in it."""
    assert alarms(checks_by_name(two_rounds, tanker)) <= {"track closure", "speed", "sampling"}
