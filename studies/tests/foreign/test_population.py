"""Ships of the population: drawn, brought to scale, sailed as ships sail."""

from __future__ import annotations

from collections import Counter
from dataclasses import replace

import numpy as np
import pytest

import pymc_ship as ps
from pymc_ship.ships.forecasting.stopping import StoppingTest
from studies.foreign import mariner, mmg, s175, sailing
from studies.foreign.population import _CARGO, _FORMS, HULLS, LEFT_OUT, a_form, a_ship, as_trial, drawn, scaled, usual

RNG = np.random.default_rng


@pytest.fixture(scope="module")
def ships():
    """Ships drawn until there is one of every kind, by hull."""
    found = {}
    for seed in range(40):
        one = drawn(RNG(seed))
        found.setdefault(one.hull, one)
        if len(found) == len(HULLS):
            break
    return found


@pytest.mark.consistency
def test_there_is_every_kind_of_ship(ships):
    assert set(ships) == set(HULLS)


@pytest.mark.consistency
def test_a_ship_is_the_same_for_the_same_numbers():
    one, again, other = (drawn(RNG(seed)) for seed in (5, 5, 6))
    manoeuvre = ps.turning_circle(35)
    first, second = (ship.sail(manoeuvre, 100.0) for ship in (one, again))
    assert first.identical(second)
    assert one.record(manoeuvre, 0).identical(again.record(manoeuvre, 0))
    assert not np.array_equal(first["u"], other.sail(manoeuvre, 100.0)["u"])


@pytest.mark.consistency
@pytest.mark.parametrize("hull", HULLS)
def test_it_is_none_of_the_published_ships_and_has_papers_that_the_package_reads(ships, hull):
    one = ships[hull]
    assert one.vessel.particulars.L > 50.0
    published = {"tanker": mmg.kvlcc2(), "mariner": mariner.Mariner(), "s175": s175.S175()}.get(hull, mmg.cargo())
    own = one.sail(ps.turning_circle(35, side="port"), 14.0 * one.vessel.particulars.ship_time)
    trial = sailing.Trial("circle", 35.0, side="port")
    other = sailing.sail(published, trial)
    diameters = [
        sailing.indices(run, trial)["tactical_diameter"] / L
        for run, L in ((own, one.vessel.particulars.L), (other, published.papers.L))
    ]
    assert abs(diameters[0] / diameters[1] - 1.0) > 1e-3


@pytest.mark.consistency
@pytest.mark.parametrize("hull", HULLS)
def test_its_records_are_noisy_and_judged_sound(ships, hull):
    one = ships[hull]
    for run, manoeuvre in enumerate([ps.zigzag(20, 20), ps.turning_circle(35), ps.pull_out(15, 90)]):
        record = one.record(manoeuvre, run)
        assert np.abs(np.diff(record["u"], 2)).max() > 0.0
        assert ps.validated_trial(record, one.vessel).sizes["time"] > 100


@pytest.mark.consistency
def test_its_motion_is_measured_by_the_package_as_by_its_own_kind(ships):
    one = ships["tanker"]
    for manoeuvre in (ps.turning_circle(35, side="starboard"), ps.zigzag(15, 15, side="starboard")):
        run = one.sail(manoeuvre, 25.0 * one.vessel.particulars.ship_time)
        own = sailing.indices(run, as_trial(manoeuvre))
        still = dict.fromkeys(("p", "phi"), run["u"] * 0.0)
        found = ps.indices(run.assign(still).assign_attrs(manoeuvre.attrs))
        for name, value in own.items():
            assert float(found[name]) == pytest.approx(value, rel=5e-3), name


@pytest.mark.consistency
def test_a_pull_out_ends_with_the_rudder_amidships(ships):
    run = ships["mariner"].sail(ps.pull_out(20, 90), 25.0 * ships["mariner"].vessel.particulars.ship_time)
    turned, delta = np.abs(np.rad2deg(run["psi"].values)), np.abs(np.rad2deg(run["delta"].values))
    assert delta.max() == pytest.approx(20.0, abs=0.01)
    late = run["time"].values > run["time"].values[np.argmax(turned >= 90.0)] + 12.0
    assert delta[late].max() < 1e-9
    assert turned.max() > 90.0


@pytest.mark.consistency
def test_those_whose_forces_stay_finite_are_stopped(ships):
    assert {hull for hull, ship in ships.items() if ship.stop} == {"cargo ship", "cross flow"}
    ship = ships["cargo ship"]
    unit = ship.vessel.particulars.ship_time
    run = ship.stop(StoppingTest(astern=1.0, reversal=unit), 150.0 * unit)
    assert run["n"].values[-1] == pytest.approx(-1.0)
    assert run["u"].values[-1] <= 0.0 < float(run["psi"][-1])


@pytest.mark.consistency
def test_a_scaled_ship_sails_the_same_circle_in_lengths():
    whole, small = mmg.kvlcc2(), scaled(mmg.kvlcc2(), 0.7)
    assert pytest.approx(0.7 * whole.papers.L) == small.papers.L
    quick = sailing.Trial("circle", 35.0)
    found = []
    for ship in (whole, small):
        papers = replace(ship.papers, rudder_rate_deg=2.34 * whole.papers.unit / ship.papers.unit, rudder_delay=0.0)
        record = sailing.sail(replace(ship, papers=papers), quick, interval=0.1)
        found.append(np.array(list(sailing.indices(record, quick).values())) / ship.papers.L)
    np.testing.assert_allclose(*found, rtol=2e-3)


def test_forms_are_within_the_range_of_the_regressions():
    rng = RNG(1)
    for form in (a_form(rng, _CARGO) for _ in range(200)):
        assert 0.09 < form.block * form.B / form.L < 0.145
        assert 2.2 <= form.B / form.d <= 3.6
        assert form.d > form.D


def test_forms_left_out_are_outside_that_range():
    fuller, finer = (a_form(RNG(1), _FORMS[hull]) for hull in ("fuller", "finer"))
    assert fuller.block * fuller.B / fuller.L > 0.14
    assert finer.block * finer.B / finer.L < 0.09
    assert set(LEFT_OUT) == {"rudder stall", *_FORMS}


def test_a_rudder_that_stalls_loses_lift():
    """The normal force follows the sine up to the stall, and falls towards 60 % of its value there."""
    rudder = replace(mmg.kvlcc2().rudder, stall=np.radians(20.0))
    below, above, far = (rudder.lift(np.radians(angle)) for angle in (19.0, -21.0, 60.0))
    assert below == np.sin(np.radians(19.0))
    assert -np.sin(np.radians(20.0)) < above < -0.9 * np.sin(np.radians(20.0))
    assert far == pytest.approx(0.6 * np.sin(np.radians(20.0)), rel=1e-3)
    assert mmg.kvlcc2().rudder.lift(1.0) == np.sin(1.0)
    stalls = [a_ship("rudder stall", RNG(seed)).rudder.stall for seed in range(5)]
    assert all(np.radians(15.0) < stall < np.radians(25.0) for stall in stalls)


def test_the_sides_of_a_single_screw_differ():
    ship = a_ship("cargo ship", RNG(2))
    assert ship.wake.port != ship.wake.starboard
    assert ship.rudder.gamma_port != ship.rudder.gamma_starboard


def test_the_cross_flow_of_equal_sections_is_that_of_a_plate():
    """C_D over 3 r|r| / 32 in yaw alone (twenty sections), C_D v|v| in drift alone; no polynomial has the sum."""
    hull = mmg.cross_flow(mmg.Form(), 0.8, 0.0, 0.0).hull
    assert hull.cross_flow(0.2, 0.0) == (pytest.approx(-0.8 * 0.04), pytest.approx(0.0, abs=1e-12))
    Y, N = hull.cross_flow(0.0, -0.5)
    assert pytest.approx(0.0, abs=1e-12) == Y
    assert pytest.approx(0.8 * 0.25 / 32.0, rel=0.01) == N
    skewed = mmg.cross_flow(mmg.Form(), 0.8, 0.5, 0.0).hull
    assert skewed.cross_flow(0.2, 0.0)[1] < 0.0


def test_a_ship_that_turns_as_no_ship_does_is_not_usual():
    ship = mmg.kvlcc2()
    assert usual(ship)
    assert not usual(replace(ship, rudder=replace(ship.rudder, area=0.2 * ship.rudder.area)))
    spinning = [(name, 2.0 * value if name == "v" else value) for name, value in ship.hull.N]
    assert not usual(replace(ship, hull=replace(ship.hull, N=tuple(spinning))))


def test_kinds_are_equally_likely():
    counts = Counter(HULLS[int(RNG(seed).integers(len(HULLS)))] for seed in range(1000))
    assert min(counts.values()) > 200.0 - 4.0 * np.sqrt(160.0)
