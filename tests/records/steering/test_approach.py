"""A manoeuvre that begins while the ship gathers way, loses way or turns is no standard one, for every command."""

from __future__ import annotations

import numpy as np
import pytest
import xarray as xr

import pymc_ship as ps
from pymc_ship.physics.manoeuvre.steering_record import first_execute
from pymc_ship.physics.motion.equations import STATE
from pymc_ship.records.checks.plausibility import cut_to_piece
from pymc_ship.records.steering.approach import UNSTEADY, WHOLE_APPROACH, approach_fault, speed_trend
from pymc_ship.records.steering.recognition import recognise, unrecognised_text
from tests.records.checks.cases import checks_by_name, noisy


def from_speed(vessel, fraction, wait, manoeuvre=None):
    """Straight run of ``wait`` L/U from a fraction of the nominal speed, then a manoeuvre."""
    unit, speed = vessel.particulars.ship_time, vessel.particulars.nominal_speed
    wait = float(round(wait * unit))
    straight = ps.rudder_programme([0.0, wait], [0.0, 0.0], approach_speed=fraction * speed)
    before = ps.simulate(vessel, straight, duration=wait, record_interval=1.0)
    start = [float(before[name][-1]) for name in STATE]
    duration = float(round(15.0 * unit))
    run = ps.simulate(
        vessel, manoeuvre or ps.zigzag(10, 10), duration=duration, record_interval=1.0, initial_state=start
    )
    parts = (before.sel(time=slice(None, wait - 0.5)), run.assign_coords(time=run["time"] + wait))
    return xr.concat([part[[*STATE, "delta"]] for part in parts], "time")


@pytest.fixture(scope="module", params=["container", "kvlcc2"])
def vessel(request):
    return ps.load_vessel(request.param)


@pytest.mark.parametrize("manoeuvre", [ps.zigzag(10, 10), ps.turning_circle(35)])
@pytest.mark.parametrize(("fraction", "steady"), [(0.5, False), (1.0, True), (2.5, False)])
def test_a_manoeuvre_at_a_changing_speed_is_no_standard_one(vessel, manoeuvre, fraction, steady):
    run = noisy(from_speed(vessel, fraction, 1.5, manoeuvre), level=0.005)
    (recognised,), steering = recognise([run], vessel)
    assert (recognised is not None) == steady
    if not steady:
        sentence = unrecognised_text(run, vessel.particulars.ship_time)
        assert sentence.startswith("It is no standard manoeuvre: it begins while the speed changes by ")
        assert ("+" in sentence) == (fraction < 1.0)
    assert (steering.n_reversals > 0) == (manoeuvre.kind == "zigzag")


def test_a_long_approach_is_judged_by_its_end(vessel):
    """From half of the speed, but 12 L/U before the first execute."""
    run = from_speed(vessel, 0.5, 12.0, ps.turning_circle(35))
    assert recognise([run], vessel)[0][0].label == "turning circle 35 port"
    assert checks_by_name(run, vessel)["approach"].value("change of speed in L/U") < 0.5 * UNSTEADY


def test_the_piece_with_the_ship_ahead_has_the_approach_of_the_record(vessel):
    """From rest the piece begins near the first execute, or after it; the verdict is that of the whole record."""
    run = from_speed(vessel, 0.05, 1.0)
    check = checks_by_name(run, vessel)["motion ahead"]
    piece = cut_to_piece(run, check)
    assert check.mendable
    assert piece.attrs[WHOLE_APPROACH] == approach_fault(run, vessel.particulars.ship_time)
    assert recognise([piece], vessel)[0] == recognise([run], vessel)[0] == [None]
    assert unrecognised_text(piece, vessel.particulars.ship_time) == unrecognised_text(
        run, vessel.particulars.ship_time
    )


def test_a_piece_that_begins_after_the_first_execute_is_no_standard_manoeuvre(vessel):
    run = ps.simulate(vessel, ps.zigzag(20, 20), duration=15.0 * vessel.particulars.ship_time, record_interval=1.0)
    u = np.where(run["time"] < 0.8 * vessel.particulars.ship_time, 0.01 * run["u"], run["u"])
    slow = run.assign(u=("time", u))
    piece = ps.corrected_trial(slow, [check for check in ps.trial_checks(slow, vessel) if check.name == "motion ahead"])
    assert piece.sizes["time"] < run.sizes["time"]
    assert recognise([piece], vessel)[0] == [None]
    assert "before the ship makes way ahead" in unrecognised_text(piece, vessel.particulars.ship_time)


STEPS = {
    "another angle": [-5.0, -5.0],
    "weaving": [10.0, -10.0],
    "a kick": [-10.0, 0.0],
    "to the other side": [5.0, 5.0],
}


@pytest.mark.parametrize("before", STEPS.values(), ids=STEPS)
def test_a_manoeuvre_that_begins_in_a_turn_is_no_standard_one(vessel, before):
    unit = vessel.particulars.ship_time
    when = unit * np.array([0.0, 3.0, 3.02, 4.0, 4.02, 5.0, 5.02, 30.0])
    angles = np.deg2rad([0.0, 0.0, before[0], before[0], before[1], before[1], -35.0, -35.0])
    settings = {"duration": float(round(30.0 * unit)), "record_interval": 1.0}
    run = noisy(ps.simulate(vessel, ps.rudder_programme(when, angles), **settings), level=0.005)
    assert abs(first_execute(run) - 5.0 * unit) < 0.2 * unit
    assert recognise([run], vessel)[0] == [None]
    assert "turns" in unrecognised_text(run, unit)
    angles[2:6] *= 0.05
    run = noisy(ps.simulate(vessel, ps.rudder_programme(when, angles), **settings), level=0.005)
    assert recognise([run], vessel)[0][0].label == "turning circle 35 starboard"


@pytest.mark.parametrize("manoeuvre", [ps.turning_circle(35), ps.zigzag(20, 20)])
def test_a_record_that_begins_in_the_manoeuvre_is_no_standard_one(vessel, manoeuvre):
    unit = vessel.particulars.ship_time
    run = noisy(ps.simulate(vessel, manoeuvre, duration=float(round(20.0 * unit)), record_interval=1.0), level=0.005)
    assert recognise([run], vessel)[0][0].label == manoeuvre.label
    late = run.isel(time=slice(round(0.6 * unit), None))
    assert recognise([late], vessel)[0] == [None]
    assert "approach" in unrecognised_text(late, unit)


def test_a_trend_needs_half_of_L_over_U_and_is_of_the_last_two():
    time = np.arange(100.0)
    u = np.where(time < 60.0, 1.0, 5.0 + 0.01 * (time - 60.0))
    change, error = speed_trend(time, u, 15.0)
    assert change == pytest.approx(0.01 * 15.0 / np.mean(u[time >= 69.0]), rel=1e-6)
    assert error < 1e-9
    assert np.isnan(speed_trend(time[:7], u[:7], 15.0)).all()
    assert np.isfinite(speed_trend(time[:9], u[:9], 15.0)).all()
