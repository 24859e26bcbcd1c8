"""Known mistakes put into a record: the check names each one and the key that mends it; a clean record has none."""

from __future__ import annotations

import numpy as np
import pytest

import pymc_ship as ps
from pymc_ship.cli.main import main
from pymc_ship.records.checks.mistakes import PSI_LATE, R_CLIPPED, R_DRIFTS, R_LATE, UNEXPLAINED
from pymc_ship.records.files.columns import AIS
from pymc_ship.trial.record import OVER_GROUND
from tests.records.checks.cases import alarms, changed, checks_by_name, noisy, simulated, with_samples

DEGREE, KNOT = np.pi / 180.0, 1852.0 / 3600.0


def scaled(names, factor):
    return lambda trial: changed(trial, **{name: factor * trial[name].values for name in names.split()})


def swapped(one, other):
    return lambda trial: changed(trial, **{one: trial[other].values, other: trial[one].values})


def coded(trial):
    """The rate of turn as AIS sends it, read in deg/min."""
    rate = trial["r"].values / (DEGREE / 60.0)
    return changed(trial, r=DEGREE / 60.0 * AIS * np.sign(rate) * np.sqrt(np.abs(rate)))


MISTAKES = {
    "r in deg/s": (scaled("r", 1.0 / DEGREE), "yaw rate", 'unit = "deg/s"'),
    "r in deg/min": (scaled("r", 60.0 / DEGREE), "yaw rate", 'unit = "deg/min"'),
    "r in deg/s as deg/min": (scaled("r", 1.0 / 60.0), "yaw rate", "r is deg/s that was converted as deg/min"),
    "r in deg/min as deg/s": (scaled("r", 60.0), "yaw rate", "r is deg/min that was converted as deg/s"),
    "r in rad/s as deg/s": (scaled("r", DEGREE), "yaw rate", "r is rad/s that was converted as deg/s"),
    "psi in rad as deg": (scaled("psi", DEGREE), "yaw rate", "psi is rad that was converted as deg"),
    "r reversed": (scaled("r", -1.0), "yaw rate", "sign = -1"),
    "r coded": (coded, "yaw rate", 'code = "ais"'),
    "r coded and reversed": (lambda trial: scaled("r", -1.0)(coded(trial)), "yaw rate", 'sign = -1 and code = "ais"'),
    "r and psi swapped": (swapped("r", "psi"), "yaw rate", "exchange the columns of r and psi"),
    "p in deg/s": (scaled("p", 1.0 / DEGREE), "roll rate", 'unit = "deg/s"'),
    "psi in deg": (scaled("psi", 1.0 / DEGREE), "yaw rate", 'unit = "deg"'),
    "psi reversed": (scaled("psi", -1.0), "yaw rate", 'heading = "counterclockwise"'),
    "psi and r in deg": (scaled("psi r", 1.0 / DEGREE), "heading", 'unit = "deg/s" and unit = "deg"'),
    "x and y swapped": (swapped("x", "y"), "heading", "exchange the columns of x and y"),
    "y reversed": (scaled("y", -1.0), "heading", "west longitude without its sign"),
    "psi in tenths of a degree": (scaled("psi", 10.0), "yaw rate", 'unit = "0.1 deg"'),
    "psi in gon": (scaled("psi", 1.0 / 0.9), "yaw rate", 'unit = "gon"'),
    "r in tenths": (scaled("r", 10.0), "yaw rate", 'unit = "0.1 deg/min"'),
    "tenths of knots": (scaled("u v", 10.0 / KNOT), "speed", "tenths of a knot"),
    "knots": (scaled("u v", 1.0 / KNOT), "speed", 'unit = "kn"'),
}
"""Mistake put in, the check that names it and the key that mends it."""


@pytest.mark.parametrize("mistake", MISTAKES)
@pytest.mark.parametrize("run", ["zigzag", "circle"])
def test_a_known_mistake_is_named_with_its_key(request, container, mistake, run):
    spoil, name, key = MISTAKES[mistake]
    check = checks_by_name(spoil(request.getfixturevalue(run)), container)[name]
    assert check.verdict == "bad"
    assert key in check.sentence


def test_what_no_mistake_explains_is_said_to_be_so(zigzag, container):
    rate = np.std(zigzag["r"].values) * np.sin(zigzag["time"].values / 30.0)
    check = checks_by_name(changed(zigzag, r=rate), container)["yaw rate"]
    assert check.verdict == "bad"
    assert UNEXPLAINED in check.sentence


def test_a_rate_that_fails_for_a_while_is_judged_apart(zigzag, container):
    check = checks_by_name(with_samples(zigzag, "r", slice(900, 1000), 0.03), container)["yaw rate"]
    assert check.verdict == "doubtful"
    assert "of the record, between 17" in check.sentence
    assert check.value("scale") == pytest.approx(1.0, abs=0.02)


# heading against course


def turned(trial, degrees):
    return changed(trial, psi=trial["psi"].values + np.deg2rad(degrees))


@pytest.mark.parametrize(("degrees", "verdict"), [(1.0, "good"), (3.0, "doubtful"), (-12.0, "bad")])
@pytest.mark.parametrize("without", [[], ["v"]])
def test_a_heading_off_the_course_is_named(approached, container, degrees, verdict, without):
    check = checks_by_name(turned(approached, degrees).drop_vars(without), container)["heading offset"]
    assert check.verdict == verdict
    assert check.value("course less heading") == pytest.approx(-degrees, abs=0.5)
    assert verdict == "good" or "state psi = { ..., offset = " in check.sentence


@pytest.mark.parametrize(("degrees", "verdict"), [(0.0, "good"), (3.0, "doubtful"), (-12.0, "bad")])
def test_a_heading_off_the_course_is_named_where_v_is_of_that_course(approached, container, degrees, verdict):
    """SOG, COG and a heading give v: its angle is the error of the heading, and no drift."""
    read = turned(approached, degrees)
    velocity = (approached["u"].values + 1j * approached["v"].values) * np.exp(-1j * np.deg2rad(degrees))
    ground = changed(read, u=velocity.real, v=velocity.imag).assign_attrs(speeds=OVER_GROUND)
    check = checks_by_name(ground, container)["heading offset"]
    assert check.verdict == verdict
    assert check.value("course less heading") == pytest.approx(-degrees, abs=0.5)


def heading_of_a_receiver(trial):
    """The course over ground where the heading should be."""
    return changed(trial, psi=trial["psi"].values + np.arctan2(trial["v"].values, trial["u"].values))


@pytest.mark.parametrize("run", ["zigzag", "circle"])
def test_a_course_in_the_place_of_the_heading_is_named(request, container, run):
    record = request.getfixturevalue(run)
    bad = [one for one in ps.trial_checks(heading_of_a_receiver(record), container) if one.verdict == "bad"]
    assert bad
    assert run == "circle" or "psi is the course over ground" in bad[0].sentence
    assert checks_by_name(heading_of_a_receiver(record).drop_vars("v"), container)["heading"].verdict == "doubtful"
    assert checks_by_name(record.drop_vars("v"), container)["heading"].verdict == "good"


def test_a_course_with_its_own_rate_is_no_lever_arm(container):
    course = heading_of_a_receiver(simulated(container, ps.zigzag(20.0, 20.0)))
    turned = noisy(changed(course, r=np.gradient(course["psi"].values, course["time"].values)))
    checks = checks_by_name(turned, container)
    assert checks["heading"].verdict == "doubtful"
    assert not checks["lever arm"].mendable
    assert "psi is the course over ground: the record cannot tell" in checks["lever arm"].sentence


@pytest.mark.parametrize(("duration", "by"), [(803.0, "sway sign"), (820.0, "yaw rate")])
def test_a_course_beside_the_rate_of_a_gyro_is_named(duration, by):
    """By the rate, or where too little of it differs, by the track that v does not lead to."""
    vessel = ps.load_vessel("kvlcc2")
    run = ps.simulate(vessel, ps.turning_circle(35.0), duration=duration, record_interval=1.0, method="rk4")
    check = checks_by_name(heading_of_a_receiver(noisy(run, level=0.005)), vessel)[by]
    assert check.verdict == "bad"
    assert "psi is the course over ground" in check.sentence


# numbers that stand for missing cells


@pytest.mark.parametrize(
    ("name", "value", "words"),
    [
        ("r", -127.0 * DEGREE / 60.0, "-127 deg/min in 10 cells of r"),
        ("delta", -999.0 * DEGREE, "-999 deg in 10 cells of delta"),
        ("u", 102.3 * KNOT, "102.3 kn in 10 cells of u"),
        ("psi", 511.0 * DEGREE, "511 deg in 10 cells of psi"),
        ("y", 32767.0, "32767 m in 10 cells of y"),
        ("v", 655.35, "655.35 m/s in 10 cells of v"),
    ],
)
def test_stand_ins_are_counted_and_the_rest_is_checked_without_them(zigzag, container, name, value, words):
    trial = with_samples(zigzag, name, np.arange(700, 710), value)
    checks = checks_by_name(trial, container)
    assert alarms(checks) == {"stand-ins"}
    assert words in checks["stand-ins"].sentence
    assert f"{name} = {{ ..., missing = {words.split()[0]} }}" in checks["stand-ins"].sentence


def test_a_value_that_a_channel_passes_is_no_stand_in(zigzag, container):
    """A track through 360 m, 999 m; a heading through 360 deg."""
    trial = turned(zigzag, 360.0 - np.rad2deg(zigzag["psi"].values[900]))
    assert checks_by_name(trial, container)["stand-ins"].verdict == "good"


# mirror images


def test_a_mirror_image_is_named_beside_the_sign_of_the_rudder(zigzag, container, tmp_path):
    """As ROS writes: x east, y north, psi counterclockwise from east, v to port."""
    zigzag = zigzag.drop_vars(["p", "phi"])
    mirrored = swapped("x", "y")(scaled("r v", -1.0)(changed(zigzag, psi=0.5 * np.pi - zigzag["psi"].values)))
    checks = checks_by_name(mirrored, container)
    assert {name for name in alarms(checks) if checks[name].verdict == "bad"} == {"rudder sign"}
    assert 'convention = "enu-flu"' in checks["rudder sign"].sentence
    ps.write_trial(mirrored, tmp_path / "trial.csv")
    read = ps.read_trial(tmp_path / "trial.csv", format={"frame": {"convention": "enu-flu"}})
    for name in ("x", "y", "psi", "u", "v", "r", "delta"):
        assert np.ptp(read[name].values - zigzag[name].values) < 1e-5 * np.ptp(zigzag[name].values) + 1e-6


# status


@pytest.mark.parametrize(
    ("spoil", "status"), [(lambda trial: trial, 0), (lambda trial: with_samples(trial, "r", 99, 1.0), 4)]
)
def test_the_exit_status_shows_a_corrected_record(tmp_path, capsys, zigzag, spoil, status):
    ps.write_trial(spoil(zigzag), tmp_path / "trial.csv")
    assert main(["check", str(tmp_path / "trial.csv"), "--vessel", "container", "--quiet"]) == status
    assert ("corrected or doubtful: spikes" in capsys.readouterr().err) == (status == 4)


# without a mistake


@pytest.mark.parametrize("ship", ["container", "kvlcc2"])
@pytest.mark.parametrize("level", [0.002, 0.03])
def test_a_clean_record_has_no_mistake(ship, level):
    vessel = ps.load_vessel(ship)
    trial = noisy(simulated(vessel, ps.zigzag(20.0, 20.0), 800.0), 7, level)
    assert alarms(checks_by_name(trial, vessel)) <= {"sampling", "noise"}


# mistakes of a rate, of v and of the clock that leave the slopes right


def shifted(name, seconds):
    return lambda trial: changed(trial, **{name: np.interp(trial["time"] - seconds, trial["time"], trial[name].values)})


def drifting(trial):
    return changed(trial, r=trial["r"].values + 0.1 * DEGREE * (trial["time"] / trial["time"].values[-1]).values)


def smoothed(trial, seconds=2.0):
    weights = np.exp(-np.arange(0.0, 10.0 * seconds, 0.2) / seconds)
    padded = np.concatenate([np.zeros(weights.size - 1), trial["r"].values])
    return changed(trial, r=np.convolve(padded, weights / weights.sum(), "valid"))


@pytest.mark.parametrize(
    ("spoil", "words", "verdict"),
    [
        (shifted("r", 2.5), R_LATE, "doubtful"),
        (smoothed, R_LATE, "doubtful"),
        (drifting, R_DRIFTS, "doubtful"),
        (shifted("psi", 2.5), PSI_LATE, "bad"),
    ],
)
@pytest.mark.parametrize("ship", ["container", "kvlcc2"])
def test_a_rate_that_follows_its_angle_late_is_named(ship, spoil, words, verdict):
    vessel = ps.load_vessel(ship)
    checks = checks_by_name(spoil(noisy(simulated(vessel, ps.zigzag(20.0, 20.0)), level=0.005)), vessel)
    assert checks["yaw rate"].verdict == verdict
    assert f"most probably {words}" in checks["yaw rate"].sentence
    assert checks["lever arm"].verdict != "doubtful"  # a late heading looks like one


@pytest.mark.parametrize(
    ("factor", "words"),
    [
        (1.0 / KNOT, "knots taken for m/s"),
        (3.6 * KNOT, "km/h that were converted as knots"),
        (1.0 / (3.6 * KNOT), "knots that were converted as km/h"),
        (3.6, "km/h taken for m/s"),
        (1.0 / 7.0, "check unit and calibration of v"),
    ],
)
@pytest.mark.parametrize("ship", ["container", "kvlcc2"])
def test_v_in_another_unit_than_u_is_no_lag(ship, factor, words):
    vessel = ps.load_vessel(ship)
    trial = noisy(simulated(vessel, ps.zigzag(20.0, 20.0), 600.0), 2, 0.005)
    checks = checks_by_name(scaled("v", factor)(trial), vessel)
    assert checks["sway sign"].verdict == "bad"
    assert words in checks["sway sign"].sentence
    assert checks["velocity lag"].verdict == checks["lever arm"].verdict == "not checked"


@pytest.mark.parametrize(("factor", "verdict"), [(2.0, "bad"), (1.0 / 1.05, "doubtful")])
@pytest.mark.parametrize("run", ["zigzag", "circle"])
def test_a_clock_that_is_too_quick_or_too_slow_is_one_cause(request, container, factor, verdict, run):
    trial = request.getfixturevalue(run)
    checks = checks_by_name(trial.assign_coords(time=factor * trial["time"]), container)
    for name in ("yaw rate", "speed"):
        assert checks[name].verdict == verdict
        second = checks[name].sentence.split("a second of the file is ")[1].split(" s;")[0]
        assert float(second) == pytest.approx(1.0 / factor, rel=0.01)
    both = checks_by_name(scaled("r", 1.05)(scaled("u v", 1.0 / 1.05)(trial)), container)
    assert not any("a second of the file" in both[name].sentence for name in ("yaw rate", "speed"))


@pytest.mark.parametrize(("unit", "metres"), [("ft", 0.3048), ("nmi", 1852.0)])
def test_a_track_in_another_unit_is_named_with_its_key(zigzag, container, unit, metres):
    check = checks_by_name(scaled("x y", 1.0 / metres)(zigzag), container)["speed"]
    assert check.verdict == "bad"
    assert f'state unit = "{unit}" for x and y' in check.sentence


@pytest.mark.parametrize("run", ["zigzag", "circle"])
@pytest.mark.parametrize("part", [0.6, 0.85])
def test_a_clipped_yaw_rate_is_named_also_beneath_its_noise(request, container, run, part):
    """A rate of another scale is not: it does not match the heading in the rest of the record either."""
    trial = request.getfixturevalue(run)
    r = trial["r"].values
    largest = part * np.quantile(np.abs(r), 0.98)
    read = np.clip(r, -largest, largest)
    check = checks_by_name(changed(trial, r=read), container)["frozen channels"]
    assert (check.verdict, "r stays at its largest value" in check.sentence) == ("bad", True)
    checks = checks_by_name(noisy(changed(trial, r=read), seed=2), container)
    assert run == "circle" or checks["yaw rate"].verdict == "bad"
    assert run == "circle" or R_CLIPPED in checks["yaw rate"].sentence
    assert R_CLIPPED not in checks_by_name(changed(trial, r=r / part), container)["yaw rate"].sentence
