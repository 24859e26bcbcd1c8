"""The zero, rate and delay of the rudder: measured, corrected or reported."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import pymc_ship as ps
from tests.records.checks.cases import (
    INTERVAL,
    alarms,
    changed,
    checks_by_name,
    noisy,
    simulated,
    steered,
    through_backlash,
)


@pytest.mark.parametrize(
    ("per_radian", "words"),
    [
        (180.0 / np.pi, "probably it is in deg:"),
        (100.0 / np.deg2rad(35.0), "probably it is in percent of its range"),
        (10.0, "or tenths of a degree: convert it"),
        (np.deg2rad(100.0) / np.deg2rad(35.0), "probably it is in percent of its range"),
    ],
)
def test_a_rudder_in_no_angle_is_named(circle, container, per_radian, words):
    """Degrees, percent, and percent read in degrees."""
    check = checks_by_name(changed(circle, delta=per_radian * circle["delta"].values), container)["rudder unit"]
    assert check.verdict == "bad"
    assert words in check.sentence


def test_without_a_heading_a_turn_of_the_wrong_sign_may_be_meant(zigzag, container):
    reversed_turn = changed(zigzag, r=-zigzag["r"].values, v=-zigzag["v"].values)
    check = checks_by_name(reversed_turn.drop_vars(["psi", "x", "y", "p", "phi"]), container)["rudder sign"]
    assert check.verdict == "bad"
    assert "Or r and v have the opposite sign." in check.sentence
    flipped = changed(zigzag, delta=-zigzag["delta"].values)
    assert "Or r and v" not in checks_by_name(flipped, container)["rudder sign"].sentence


def test_the_rudders_zero_is_mended_where_approach_and_zigzag_agree(container, approached):
    trial = changed(approached, delta=approached["delta"].values + np.deg2rad(1.2))
    checks = ps.trial_checks(trial, container)
    assert alarms({check.name: check for check in checks}) == {"rudder zero"}
    mended = ps.corrected_trial(trial, checks)
    assert np.rad2deg(np.abs(mended["delta"].values - approached["delta"].values).max()) < 0.05
    assert mended.attrs["corrections"] == ["+1.20 deg subtracted from delta."]


def test_a_rudder_that_holds_the_ship_straight_is_told_and_not_mended(container):
    """An approach with 1 deg of rudder, as a ship needs whose propeller turns it."""
    trial = changed(noisy(steered(container, first=0.0)))
    delta = trial["delta"].values.copy()
    delta[trial["time"].values <= 40.0] = np.deg2rad(-0.8)
    checks = checks_by_name(changed(trial, delta=delta), container)
    assert checks["rudder zero"].verdict == "doubtful"
    assert not checks["rudder zero"].mendable
    assert checks["rudder zero"].value("on the approach") == pytest.approx(-0.8)


@pytest.mark.parametrize("degrees", [-8.0, 2.0, 5.0])
def test_a_zigzag_whose_sides_differ_is_doubted(zigzag, container, degrees):
    """Without an approach, a zero error of any size: an indicator that reads 25 and -15 deg for 20/20."""
    off = changed(zigzag, delta=zigzag["delta"].values + np.deg2rad(degrees))
    check = checks_by_name(off.sel(time=slice(20.0, None)), container)["rudder zero"]
    assert (check.verdict, check.mendable) == ("doubtful", False)
    assert check.value("between the sides of the zigzag") == pytest.approx(degrees, abs=0.2)


@pytest.mark.parametrize("read", [lambda delta: np.clip(delta, *np.deg2rad([-15.0, 15.0])), lambda delta: 0.75 * delta])
def test_an_indicator_that_ends_before_the_order_is_doubted_by_the_heading(zigzag, container, read):
    assert checks_by_name(zigzag, container)["rudder angle"].verdict == "good"
    cut = changed(zigzag, delta=read(zigzag["delta"].values))
    check = checks_by_name(cut, container)["rudder angle"]
    assert (check.verdict, check.value("angle")) == ("doubtful", pytest.approx(15.0, abs=0.2))
    assert "an indicator that ends there" in check.sentence
    ordered = cut.assign(delta_command=cut["delta"])
    assert checks_by_name(ordered, container)["rudder angle"].verdict == "good"


def test_a_turn_after_a_straight_approach_is_no_zigzag_of_another_zero(container):
    """Its rudder scatters about 0, to both sides, and then keeps one angle."""
    turn = ps.rudder_programme([0.0, 150.0, 155.0, 400.0], np.deg2rad([0.0, 0.0, 20.0, 20.0]))
    check = checks_by_name(noisy(simulated(container, turn)), container)["rudder zero"]
    assert (check.verdict, np.isnan(check.value("between the sides of the zigzag"))) == ("good", True)


def test_an_approach_on_which_the_ship_turns_tells_no_zero(container):
    """Five degrees of rudder for 40 s are helm."""
    runs = (noisy(steered(container, first=first)).sel(time=slice(10.0, None)) for first in (5.0, 0.0))
    turning, straight = (checks_by_name(run, container)["rudder zero"] for run in runs)
    assert np.isnan(turning.value("on the approach"))
    assert turning.value("between the sides of the zigzag") == pytest.approx(0.0, abs=0.1)
    assert straight.value("on the approach") == pytest.approx(0.0, abs=0.1)


@pytest.mark.parametrize("run", ["zigzag", "circle", "approached"])
def test_the_rudder_rate_is_that_of_the_vessel_or_told(request, container, run):
    trial = request.getfixturevalue(run)
    check = checks_by_name(trial, container)["rudder rate"]
    assert (check.verdict, check.value("rudder rate")) == ("good", pytest.approx(2.3, rel=0.05))
    slow = replace(container, particulars=replace(container.particulars, rudder_rate_deg=5.0))
    assert checks_by_name(trial, slow)["rudder rate"].verdict == "doubtful"
    assert checks_by_name(trial)["rudder rate"].verdict == "not checked"


@pytest.mark.parametrize("delay", [0.0, 1.0, 3.0])
def test_the_delay_behind_the_command_is_measured(container, approached, delay):
    time = approached["time"].values + delay
    command = np.where(time < 40.1, 0.0, np.where((time - 40.1) // 50.0 % 2 == 0.0, 1.0, -1.0) * np.deg2rad(15.0))
    check = checks_by_name(approached.assign(delta_command=("time", command)), container)["rudder delay"]
    assert check.verdict == "good"
    assert check.value("delay") == pytest.approx(delay, abs=2.0 * INTERVAL)


def test_a_command_later_than_the_rudder_has_a_negative_delay(container, approached):
    time = approached["time"].values - 3.0
    command = np.where(time < 40.1, 0.0, np.where((time - 40.1) // 50.0 % 2 == 0.0, 1.0, -1.0) * np.deg2rad(15.0))
    check = checks_by_name(approached.assign(delta_command=("time", command)), container)["rudder delay"]
    assert check.verdict == "doubtful"
    assert check.value("delay") == pytest.approx(-3.0, abs=2.0 * INTERVAL)


@pytest.mark.parametrize(("given", "words"), [(5.0, "steered by hand"), (1.0, "a quicker gear")])
def test_a_rudder_that_is_slower_or_quicker_than_its_file_is_explained(zigzag, container, given, words):
    vessel = replace(container, particulars=replace(container.particulars, rudder_rate_deg=given))
    assert words in checks_by_name(zigzag, vessel)["rudder rate"].sentence


def test_a_command_that_comes_after_the_rudder_is_doubted(container, approached):
    command = np.roll(approached["delta"].values, 100)
    check = checks_by_name(approached.assign(delta_command=("time", np.sign(command) * 0.26)), container)[
        "rudder delay"
    ]
    assert check.verdict in ("doubtful", "not checked")


def test_an_ordered_angle_is_named(container):
    """The order is at the other side within one sample; the rudder of the file takes some seconds."""
    zigzag = simulated(container, ps.zigzag(20, 20))
    ordered = np.deg2rad(20.0) * np.sign(np.gradient(zigzag["delta"].values))
    moving = np.abs(np.gradient(zigzag["delta"].values)) > 1e-6
    held = np.maximum.accumulate(np.where(moving, np.arange(moving.size), 0))
    check = checks_by_name(changed(zigzag, delta=ordered[held]), container)["rudder rate"]
    assert check.verdict == "doubtful"
    assert "delta is the ordered angle; find the column of the actual one" in check.sentence


def read_by_indicator(trial, backlash, step):
    delta = through_backlash(np.rad2deg(trial["delta"].values), backlash)
    return changed(trial, delta=np.deg2rad(step * np.round(delta / step) if step else delta))


@pytest.mark.parametrize(
    ("backlash", "step", "verdict", "reads"),
    [
        (2, 1, "doubtful", "19 deg to both sides, in steps of 1 deg"),
        (3, 1, "doubtful", "18 deg to both sides, in"),
        (0, 1, "good", "20 deg to both sides, in steps of 1 deg"),
        (0.3, 0, "good", "19.9 deg to both sides."),
        (2.2, 0, "doubtful", "18.9 deg to both sides for"),
        (4.4, 0, "good", "17.8 deg to both sides."),
    ],
)
@pytest.mark.parametrize("ship", ["container", "kvlcc2"])
def test_an_indicator_that_falls_short_of_the_order_is_named(ship, backlash, step, verdict, reads):
    vessel = ps.load_vessel(ship)
    check = checks_by_name(read_by_indicator(simulated(vessel, ps.zigzag(20, 20)), backlash, step), vessel)
    assert check["rudder angle"].verdict == verdict
    assert reads in check["rudder angle"].sentence
    assert ("order of 20 deg" in check["rudder angle"].sentence) == (verdict == "doubtful")


@pytest.mark.parametrize(("ordered", "verdict"), [(12.0, "good"), (14.0, "doubtful")])
def test_the_recorded_order_is_what_an_angle_is_compared_with(container, ordered, verdict):
    run = simulated(container, ps.zigzag(12, 10))
    order = np.deg2rad(ordered) * np.sign(run["delta"].values)
    assert checks_by_name(run.assign(delta_command=("time", order)), container)["rudder angle"].verdict == verdict


@pytest.mark.parametrize("manoeuvre", [ps.turning_circle(34), ps.zigzag(12, 10)])
def test_an_order_between_two_multiples_of_five_degrees_is_no_error(container, manoeuvre):
    check = checks_by_name(simulated(container, manoeuvre), container)["rudder angle"]
    assert check.verdict == ("good" if manoeuvre.kind == "zigzag" else "not checked")


@pytest.mark.parametrize("angles", [(20, 20), (10, 10), (20, 10)])
@pytest.mark.parametrize("ship", ["container", "kvlcc2"])
def test_a_rudder_without_its_sign_is_named(ship, angles):
    vessel = ps.load_vessel(ship)
    run = simulated(vessel, ps.zigzag(*angles))
    check = checks_by_name(changed(run, delta=np.abs(run["delta"].values)), vessel)["signs"]
    assert (check.verdict, "its sign is lost" in check.sentence) == ("bad", True)
    for manoeuvre in (ps.turning_circle(35), ps.pull_out(20)):
        assert checks_by_name(simulated(vessel, manoeuvre), vessel)["signs"].verdict == "good"


def test_a_rudder_in_volts_is_not_one_without_its_sign(container):
    run = simulated(container, ps.zigzag(20, 20))
    volts = 2.5 + np.rad2deg(run["delta"].values) / 20.0
    check = checks_by_name(changed(run, delta=np.deg2rad(volts)), container)["signs"]
    assert (check.verdict, "moves about 2." in check.sentence, "its sign is lost" in check.sentence) == (
        "bad",
        True,
        False,
    )


@pytest.mark.parametrize(("factor", "words"), [(0.5, "delta reads 0.5 of the angle"), (1.6, "delta reads 1.6 times")])
def test_a_rudder_of_another_scale_is_one_cause_of_its_rate(zigzag, container, factor, words):
    """The mean of two indicators of which one is dead; per cent of 35 deg."""
    check = checks_by_name(changed(zigzag, delta=factor * zigzag["delta"].values), container)["rudder rate"]
    assert (check.verdict, words in check.sentence) == ("doubtful", True)


@pytest.mark.parametrize("level", [0.0, 0.01])
@pytest.mark.parametrize(("shift", "text"), [(-4.0, "delta is late; state delay = "), (4.0, "its clock is ahead")])
def test_a_rudder_with_a_clock_of_its_own_is_found(container, level, shift, text):
    """L/U are 18 s; a record without a shift is good."""
    run = simulated(container, ps.zigzag(20, 20))
    run = noisy(run, level=level) if level else run
    assert checks_by_name(run, container)["rudder timing"].verdict == "good"
    time = run["time"].values
    moved = changed(run, delta=np.interp(time + shift, time, run["delta"].values))
    check = checks_by_name(moved, container)["rudder timing"]
    assert check.verdict == "doubtful"
    assert text in check.sentence
    assert check.value("shift") == pytest.approx(shift, abs=1.5)


def test_the_time_of_a_rudder_needs_a_vessel_and_a_reversal(container):
    assert (
        checks_by_name(simulated(container, ps.turning_circle(35)), container)["rudder timing"].verdict == "not checked"
    )
    assert checks_by_name(simulated(container, ps.zigzag(20, 20)), None)["rudder timing"].verdict == "not checked"


def circle_with_late_rudder(vessel, approach, seconds):
    """A circle to starboard after an approach [s] on a straight course, whose rudder is read late [s]."""
    when = [0.0, approach, approach + 15.2, approach + 800.0]
    programme = ps.rudder_programme(when, np.deg2rad([0.0, 0.0, -35.0, -35.0]))
    run = ps.simulate(vessel, programme, duration=approach + 700.0, step=0.5, method="rk4")
    time, delta = run["time"].values, run["delta"].values
    return run.assign(delta=("time", np.interp(time - seconds, time, delta)))


@pytest.mark.parametrize("level", [0.0, 0.005])
@pytest.mark.parametrize("share", [0.0, 0.05, 0.4, 0.8])
def test_a_ship_that_turns_before_its_rudder_has_a_late_rudder_and_no_other_sign(container, share, level):
    late = circle_with_late_rudder(container, 73.0, share * container.particulars.ship_time)
    checks = checks_by_name(noisy(late, level=level) if level else late, container)
    assert checks["rudder sign"].verdict == "good"
    timing = checks["rudder timing"]
    assert timing.verdict == ("doubtful" if share > 0.3 else "good")
    assert share < 0.3 or "before the rudder is put over" in timing.sentence
    assert timing.value("shift") == pytest.approx(-share * container.particulars.ship_time, abs=2.0)


@pytest.mark.parametrize("name", ["kvlcc2", "container"])
@pytest.mark.parametrize(("share", "words"), [(0.3, "delta is late; state delay ="), (-0.3, "its clock is ahead")])
def test_the_time_of_a_rudder_is_judged_in_a_circle(name, share, words):
    """Also one that is early; a record without a shift is good."""
    vessel = ps.load_vessel(name)
    seconds = share * vessel.particulars.ship_time
    check = checks_by_name(noisy(circle_with_late_rudder(vessel, 90.0, seconds)), vessel)["rudder timing"]
    assert (check.verdict, words in check.sentence) == ("doubtful", True)
    assert check.value("shift") == pytest.approx(-seconds, abs=0.1 * vessel.particulars.ship_time)
    assert checks_by_name(circle_with_late_rudder(vessel, 90.0, 0.0), vessel)["rudder timing"].verdict == "good"


@pytest.mark.parametrize("approach", [9.0, 60.0])
def test_noise_of_the_yaw_rate_is_no_turn_before_the_rudder(container, approach):
    """Forty records of strong noise, on an approach of half a ship time and of three."""
    clean = circle_with_late_rudder(container, approach, 0.0)
    verdicts = {checks_by_name(noisy(clean, seed, 0.05), container)["rudder timing"].verdict for seed in range(40)}
    assert verdicts <= {"good", "not checked"}


@pytest.mark.parametrize(("part", "verdict"), [(0.01, "good"), (0.1, "doubtful")])
def test_a_slight_turn_before_the_rudder_does_not_matter(container, part, verdict):
    """A part of the largest yaw rate, from 2 s before the first execute, after an approach without any."""
    clean = circle_with_late_rudder(container, 73.0, 0.0)
    time, r = clean["time"].values, clean["r"].values
    kicked = np.where(time < 71.0, 0.0, np.where(time < 73.8, part * r[np.argmax(np.abs(r))], r))
    assert checks_by_name(changed(clean, r=kicked), container)["rudder timing"].verdict == verdict


def test_a_late_rudder_has_the_sign_of_the_steady_turn(container):
    """The gain of Nomoto's equation has the other sign, by more than five standard errors."""
    late = circle_with_late_rudder(container, 36.5, 0.3 * container.particulars.ship_time)
    assert checks_by_name(late, container)["rudder sign"].verdict == "good"


@pytest.mark.parametrize(("degrees", "verdict"), [(45.0, "good"), (57.0, "doubtful"), (70.0, "doubtful")])
def test_a_rudder_beyond_usual_angles_may_be_in_percent(zigzag, container, degrees, verdict):
    largest = np.rad2deg(np.abs(zigzag["delta"].values).max())
    check = checks_by_name(changed(zigzag, delta=degrees / largest * zigzag["delta"].values), container)["rudder unit"]
    assert check.verdict == verdict
    assert verdict == "good" or "percent" in check.sentence


@pytest.mark.parametrize("name", ["container", "kvlcc2"])
def test_an_indicator_that_is_clipped_is_found_by_the_order(name):
    """At 25 deg in a circle at 35 deg; the record that is not clipped is good."""
    vessel = ps.load_vessel(name)
    run = circle_with_late_rudder(vessel, 90.0, 0.0)
    run = run.assign(delta_command=("time", np.deg2rad(-35.0) * (run["time"].values > 89.0)))
    read = np.clip(run["delta"].values, -np.deg2rad(25.0), None)
    check = checks_by_name(changed(run, delta=read), vessel)["rudder angle"]
    assert (check.verdict, "range of" in check.sentence, "25 deg" in check.sentence) == ("doubtful", True, True)
    assert checks_by_name(run, vessel)["rudder angle"].verdict == "good"
