"""A ship that heels: sets with roll take part, and what is forecast of its roll is theirs."""

from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pytest
import xarray as xr

import pymc_ship as ps
from pymc_ship.physics.forces.terms import SYMBOLS
from pymc_ship.physics.vessel.inertia import with_stability
from pymc_ship.physics.vessel.term_sets import ROLL_SET
from pymc_ship.physics.vessel.vessel import reference_coefficients
from pymc_ship.ships.identification.candidates import default_term_sets
from pymc_ship.ships.identification.model import _prepare
from tests.physics.forces.test_parts import ROLLING, tanker
from tests.ships.ensemble.cases import ship_of, write_index

SETTINGS = {"duration": 450, "step": 0.5, "method": "rk4"}
WITHOUT, WITH = "modular", "modular with roll"
TURN = ps.turning_circle(35)


TANKER = ps.load_vessel("kvlcc2")
KNOWN = replace(TANKER, forces=dict.fromkeys(TANKER.forces, ()))
"""The tanker as its papers describe it, without coefficients and without stability."""


def tender(metacentre):
    """A tanker that rolls, with a metacentric height [m]."""
    vessel = tanker(ROLLING)
    parameters = (replace(c, value=metacentre) if c.name == "GM" else c for c in vessel.parameters)
    return replace(vessel, parameters=tuple(parameters))


def largest_heel(vessel):
    return float(ps.indices(ps.simulate(vessel, TURN, duration=1200, step=0.5, method="rk4"))["maximum_roll_angle"])


@pytest.fixture(scope="module")
def trials():
    rng = np.random.default_rng(4)
    runs = [ps.simulate(tender(0.4), ps.zigzag(angle, angle), **SETTINGS) for angle in (10, 20)]
    return [ps.pollute(run, level=0.005, rng=rng) for run in runs]


@pytest.fixture(scope="module")
def ship(trials):
    return ps.identify_ship(trials, KNOWN, terms=[WITH], draws=60, rng=1).ship


def sets_of(trials):
    return default_term_sets(_prepare(trials, KNOWN, "hull_database"))


def test_sets_with_roll_take_part_where_it_heels_and_it_is_measured(trials):
    assert ROLL_SET in sets_of(trials)
    assert ROLL_SET not in sets_of([trial.drop_vars("p") for trial in trials])
    stiff = [trial.assign(phi=0.1 * trial["phi"]) for trial in trials]
    assert ROLL_SET not in sets_of(stiff)


def test_its_heel_in_the_turn_is_forecast_from_the_zigzags(ship):
    """By the interval of 80 %: that of 95 % has the heavy tail of the growth beyond the runs."""
    lower, median, upper = ps.forecast(ship, TURN, ci_prob=0.8, rng=1)["index_bands"]["maximum_roll_angle"].values
    assert lower < largest_heel(tender(0.4)) < upper
    assert not lower < largest_heel(tender(0.8)) < upper
    assert upper - lower < 0.5 * median


def test_roll_is_that_of_the_sets_that_have_it():
    vessels = ps.with_terms(KNOWN, WITHOUT), tender(0.4)
    models = [
        (vessel, np.tile(reference_coefficients(vessel), (count, 1)))
        for vessel, count in zip(vessels, (3, 40), strict=True)
    ]
    motion = xr.DataArray(np.zeros((2, 6)), {"symbol": list(SYMBOLS)}, ("row", "symbol"))
    mixed = ship_of(*models, motion=motion, index_error={})
    assert mixed.vessel is vessels[1]
    tree = ps.forecast(mixed, TURN, rng=1)
    rolls = np.isfinite(tree["trajectories"]["phi"].isel(time=10).values)
    assert rolls.tolist() == [False] * 3 + [True] * 40
    assert (np.isfinite(tree["indices"]["maximum_roll_angle"].values) == rolls).all()
    heel = np.rad2deg(np.abs(tree["trajectories"]["phi"].values[rolls]).max(axis=1))
    assert heel == pytest.approx(largest_heel(tender(0.4)), rel=0.01)
    assert np.isfinite(tree["index_bands"]["maximum_roll_angle"].values).all()
    assert np.isfinite(tree["indices"]["tactical_diameter"].values).all()
    assert np.isfinite(tree["extrapolation"]["distance"].values).all()


def test_a_saved_ship_rolls(ship, tmp_path):
    again = ps.load_ship(ps.save_ship(ship, tmp_path).parent)
    assert again.vessel.dofs == ("surge", "sway", "yaw", "roll")
    found, expected = (ps.forecast(one, TURN, rng=1)["index_bands"] for one in (again, ship))
    np.testing.assert_allclose(found["maximum_roll_angle"], expected["maximum_roll_angle"], rtol=1e-9)


def test_a_ship_that_was_saved_with_one_size_of_error_has_it(ship, tmp_path):
    """So were those of earlier versions."""
    path = ps.save_ship(ship, tmp_path) / "ship.json"
    index = json.loads(path.read_text(encoding="utf-8"))
    write_index(path.parent, index | {"index_error": {"angle": 0.05}})
    again = ps.load_ship(tmp_path)
    assert {kind: sizes.tolist() for kind, sizes in again.index_error.items()} == {"angle": [0.05]}
    overshoot = ps.forecast(again, ps.zigzag(10, 10), rng=1)["index_bands"]["first_overshoot_angle"].values
    exact = ps.forecast(replace(again, index_error={}), ps.zigzag(10, 10), rng=1)["index_bands"]
    assert np.ptp(overshoot) > np.ptp(exact["first_overshoot_angle"].values)


def test_stability_that_its_papers_leave_out_is_derived_and_said(ship):
    assert any("particulars.GM = 3.48 m (0.06 B), particulars.BM = " in remark for remark in ship.remarks)
    vessel = with_stability(KNOWN)
    assert np.sqrt(vessel.I_xx / vessel.m) * 320.0 / 58.0 == pytest.approx(0.375)
    assert vessel.added_mass["Kpdot"] == pytest.approx(-0.2 * vessel.I_xx)


def test_the_inertia_of_the_waterplane_is_that_of_a_container_ship():
    """Son & Nomoto (1981): KM 10.39 m, KB 4.6154 m."""
    s = replace(KNOWN.particulars, L=175.0, B=25.4, d=8.5, volume=21222.0)
    assert pytest.approx(10.39 - 4.6154, rel=0.05) == with_stability(replace(KNOWN, particulars=s)).particulars.BM


def test_stated_stability_stays():
    stated = replace(KNOWN, I_xx=3e-5, particulars=replace(KNOWN.particulars, GM=2.0))
    vessel = with_stability(stated)
    assert (vessel.particulars.GM, vessel.I_xx) == (2.0, 3e-5)
    assert list(vessel.derived) == ["particulars.BM", "added_mass.Kpdot"]
