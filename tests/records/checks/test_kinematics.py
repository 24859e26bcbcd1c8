"""Faults of sensors, units and signs: each is detected alone, and corrected where its number is known."""

from __future__ import annotations

import re

import numpy as np
import pytest
from scipy.ndimage import gaussian_filter1d

import pymc_ship as ps
from pymc_ship.records.checks.kinematics import RateFit, _rate_scale_check
from pymc_ship.records.checks.mistakes import UNEXPLAINED
from pymc_ship.records.checks.track import earth_velocity
from pymc_ship.trial.units import KNOT
from tests.records.checks.cases import (
    INTERVAL,
    alarms,
    changed,
    checks_by_name,
    lever,
    noisy,
    offset,
    simulated,
    steered,
    units,
)


def roll_offset(trial):
    return changed(trial, p=trial["p"].values - np.deg2rad(0.01))


def earth_fixed(trial):
    return changed(trial, **dict(zip("uv", earth_velocity(trial), strict=True)))


MENDABLE = {
    "gyro offset": (offset, "offset", 0.005, 5e-4),
    "roll rate offset": (roll_offset, "offset", -0.01, 1e-3),
    "velocity axes": (earth_fixed, "misfit earth-fixed", 0.0, 0.02),
    "lever arm": (lever, "lever arm", 20.0, 0.5),
}
"""Fault, and the number that tells its size, what it should be and how far it may be off."""


@pytest.mark.parametrize("name", MENDABLE)
@pytest.mark.parametrize("seed", [1, 2])
def test_a_fault_of_the_velocities_is_found_alone_and_mended(container, approached, name, seed):
    fault, number, size, error = MENDABLE[name]
    trial = noisy(steered(container), seed)
    checks = ps.trial_checks(fault(trial), container)
    named = {check.name: check for check in checks}
    assert alarms(named) == {name}
    assert named[name].mendable
    assert named[name].value(number) == pytest.approx(size, abs=error)
    mended = ps.corrected_trial(fault(trial), checks)
    assert len(mended.attrs["corrections"]) == 1
    for channel in ("u", "v", "r", "p"):
        spread = np.std(trial[channel].values)
        assert np.abs(mended[channel].values - trial[channel].values).max() < 0.03 * spread
    assert alarms(checks_by_name(mended, container)) == set()


def test_faults_that_come_together_are_told_apart(container, zigzag):
    """Gyro offset, lever arm and earth-fixed velocities, as one measured file has them."""
    trial = earth_fixed(lever(zigzag)).assign(r=zigzag["r"] + np.deg2rad(0.005))
    checks = ps.trial_checks(trial, container)
    named = {check.name: check for check in checks}
    assert alarms(named) == {"gyro offset", "velocity axes", "lever arm"}
    assert named["lever arm"].value("lever arm") == pytest.approx(20.0, abs=1.0)
    mended = ps.corrected_trial(trial, checks)
    assert np.abs(mended["v"].values - zigzag["v"].values).max() < 0.05
    assert len(mended.attrs["corrections"]) == 3


def test_a_lever_arm_needs_no_vessel_but_a_turn_that_changes(circle, zigzag):
    check = checks_by_name(lever(zigzag))["lever arm"]
    assert (check.verdict, check.value("lever arm")) == ("doubtful", pytest.approx(20.0, abs=1.0))
    assert checks_by_name(lever(circle))["lever arm"].verdict == "not checked"


def faster(factor):
    return lambda trial: changed(trial, **{name: factor * trial[name].values for name in ("u", "v")})


def all_in_degrees(trial):
    return changed(trial, psi=np.rad2deg(trial["psi"].values), r=np.rad2deg(trial["r"].values))


BAD = {
    "psi in deg": (units("psi", 180.0 / np.pi), "yaw rate", "psi is in deg"),
    "r in deg/s": (units("r", 180.0 / np.pi), "yaw rate", "r is in deg/s"),
    "r flipped": (units("r", -1.0), "yaw rate", "opposite sign"),
    "r of another scale": (units("r", 1.3), "yaw rate", "calibration"),
    "p in deg/s": (units("p", 180.0 / np.pi), "roll rate", "p is in deg/s"),
    "phi flipped": (units("phi", -1.0), "roll rate", "opposite sign"),
    "psi and r in deg": (all_in_degrees, "heading", "unit and sign of psi"),
    "speeds in knots": (faster(1.0 / KNOT), "speed", "as of knots taken for m/s; state"),
    "km/h as knots": (faster(3.6 * KNOT), "speed", "as of km/h that were converted as knots; state"),
    "v flipped": (units("v", -1.0), "sway sign", "flip its sign"),
    "delta in deg": (units("delta", 180.0 / np.pi), "rudder unit", "it is in deg"),
    "delta flipped": (units("delta", -1.0), "rudder sign", "turns the ship to starboard"),
}


@pytest.mark.parametrize("fault", BAD)
@pytest.mark.parametrize("run", ["zigzag", "circle"])
def test_units_and_signs_that_are_wrong_are_bad_and_refused(request, container, fault, run):
    trial = request.getfixturevalue(run)
    spoil, name, words = BAD[fault]
    checks = ps.trial_checks(spoil(trial), container if run == "zigzag" else None)
    named = {check.name: check for check in checks}
    assert named[name].verdict == "bad"
    assert words in named[name].sentence
    with pytest.raises(ps.TrialError) as error:
        ps.corrected_trial(spoil(trial), checks)
    assert f"{name}: " in str(error.value)


def test_a_gyro_that_is_two_per_cent_off_is_doubtful(zigzag, container):
    check = checks_by_name(units("r", 1.05)(zigzag), container)["yaw rate"]
    assert (check.verdict, check.mendable) == ("doubtful", False)
    assert check.value("scale") == pytest.approx(1.0 / 1.05, abs=2e-3)


@pytest.mark.parametrize(("axis", "dropped", "speed"), [("y", (), "0.3"), ("x", (), "0.3"), ("x", ("v",), "0.29")])
def test_a_current_is_told_and_not_mended(zigzag, container, axis, dropped, speed):
    """Without v along the heading."""
    assert checks_by_name(zigzag.drop_vars(dropped), container)["track closure"].verdict == "good"
    trial = changed(zigzag, **{axis: zigzag[axis].values + 0.3 * zigzag["time"].values}).drop_vars(dropped)
    checks = checks_by_name(trial, container)
    assert alarms(checks) - ({"speed"} if axis == "x" else set()) == {"track closure"}
    assert checks["track closure"].verdict == "doubtful"
    assert f"current or offset of {speed} m/s" in checks["track closure"].sentence
    sentence, drift = checks["track closure"].sentence, checks["track closure"].value("drift")
    assert "use velocities through the water" in sentence
    assert ("along the heading" in sentence) == bool(dropped)
    assert dropped or drift == pytest.approx(0.3 * 400.0, rel=0.05)


def test_a_position_that_slides_is_no_current(zigzag, container):
    """Along the heading, by half a ship length within a minute."""
    slide = 120.0 * np.clip((zigzag["time"].values - 150.0) / 60.0, 0.0, 1.0)
    for dropped in ((), ("v",)):
        trial = changed(zigzag, x=zigzag["x"].values + slide).drop_vars(dropped)
        check = checks_by_name(trial, container)["track closure"]
        assert (check.verdict, "probably slid" in check.sentence) == ("doubtful", True)


@pytest.mark.parametrize("dropped", [(), ("v",)])
def test_a_track_that_nothing_mends_is_refused(zigzag, container, dropped):
    """A track that sways, or surges, as the ship does not."""
    sway = 120.0 * np.sin(2.0 * np.pi * zigzag["time"].values / 300.0)
    wrong = {"x": zigzag["x"].values + sway} if dropped else {"y": zigzag["y"].values + sway}
    checks = ps.trial_checks(changed(zigzag, **wrong).drop_vars(dropped), container)
    assert alarms({check.name: check for check in checks}) >= {"track closure"}
    with pytest.raises(ps.TrialError) as error:
        ps.corrected_trial(zigzag, checks)
    assert "track closure: " in str(error.value)


@pytest.mark.parametrize(
    ("slope", "error", "verdict"),
    [(1.15, 0.01, "bad"), (1.15, 0.06, "good"), (0.85, 0.01, "bad"), (1.05, 0.005, "doubtful"), (1.05, 0.02, "good")],
)
def test_a_scale_is_wrong_only_beyond_what_the_record_can_tell(slope, error, verdict):
    """10 % are bad, 2 % doubtful, where they are several standard errors."""
    fit = RateFit(slope, error, 0.1, 1.0, 0.0, 1.0, np.ones(1, dtype=bool))
    assert _rate_scale_check("r", "psi", fit, lambda **_: ((), UNEXPLAINED)).verdict == verdict


def test_a_scale_error_in_a_steady_turn_is_not_mended_as_an_offset(container):
    """Half a per cent of the scale, which a gyro may have: in a turn alone an offset looks the same."""
    turn = simulated(container, ps.turning_circle(35.0), 600.0)
    assert checks_by_name(units("r", 1.005)(turn), container)["gyro offset"].verdict == "good"
    zigzag = simulated(container, ps.zigzag(20.0, 20.0))
    slip = 0.005 * np.abs(turn["r"].values).mean()
    assert checks_by_name(changed(zigzag, r=zigzag["r"].values + slip), container)["gyro offset"].verdict == "doubtful"


@pytest.mark.parametrize("begin", [30.0, 60.0, 80.0])
def test_a_turn_whose_begin_is_not_recorded_is_sound(container, begin):
    """The yaw rate decays towards the steady one: no drift angle of the wrong sign, v and p are no noise."""
    turn = ps.simulate(container, ps.turning_circle(35.0), duration=900.0, step=0.5, method="rk4")
    sd = {"u": 0.03, "v": 0.03, "r": 2e-4, "p": 4e-4, "phi": 1e-3, "psi": 2e-3, "x": 0.5, "y": 0.5, "delta": 2e-3}
    rng = np.random.default_rng(1)
    read = changed(turn, **{name: turn[name] + size * rng.standard_normal(1800) for name, size in sd.items()})
    checks = checks_by_name(read.sel(time=slice(begin, None)), container)
    assert checks["heading"].verdict == "good"
    assert checks["noise"].verdict == "good"


@pytest.mark.parametrize(("name", "other"), [("r", "psi"), ("psi", "r")])
def test_a_channel_that_is_smoothed_to_both_sides_is_doubted(zigzag, container, name, other):
    """Over 0.3 L/U; without orders the rudder cannot show it. Then the time of the rudder is not judged."""
    width = 0.3 * container.particulars.ship_time
    smooth = gaussian_filter1d(zigzag[name].values, width / INTERVAL)
    checks = checks_by_name(changed(zigzag, **{name: smooth}), container)
    check = checks["yaw rate"]
    assert (check.verdict, check.sentence.split(":")[0]) == ("doubtful", f"{name} changes less abruptly than {other}")
    assert float(re.search(r"deviation of ([\d.]+) s", check.sentence).group(1)) == pytest.approx(width, rel=0.4)
    assert checks["rudder timing"].verdict == "not checked"
    assert checks_by_name(zigzag, container)["yaw rate"].verdict == "good"
