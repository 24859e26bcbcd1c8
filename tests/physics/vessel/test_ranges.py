"""Ships that exist lie in the usual ranges, model or full scale, and every number of a file has a range."""

from __future__ import annotations

import math
from dataclasses import fields
from pathlib import Path

import pytest

import pymc_ship as ps
from pymc_ship.physics.forces.propeller import Propeller
from pymc_ship.physics.vessel.plausibility import findings
from pymc_ship.physics.vessel.ranges import INERTIA, PARTICULARS, PROPELLER, ROLL_COUPLINGS
from pymc_ship.physics.vessel.vessel import ADDED_MASS, Particulars
from tests.journeys.markdown import Page

ROOT = Path(__file__).parents[3]
RULES = (*PARTICULARS, *INERTIA, *ROLL_COUPLINGS, *PROPELLER)
SHIPS = {
    "KVLCC2 tanker": (320.0, 58.0, 20.8, 312622.0, 7.97),
    "KCS container ship": (230.0, 32.2, 10.8, 52030.0, 12.35),
    "DTMB 5415 destroyer, 18 kn": (142.0, 19.06, 6.15, 8424.0, 9.26),
    "DTMB 5415 destroyer, 30 kn": (142.0, 19.06, 6.15, 8424.0, 15.43),
    "Esso Osaka tanker, 8 kn": (325.0, 53.0, 21.73, 311901.0, 4.1),
    "tanker in ballast": (325.0, 53.0, 8.8, 120000.0, 8.0),
    "Mariner cargo ship": (160.93, 23.17, 8.23, 18541.0, 7.72),
    "S175 container ship": (175.0, 25.4, 9.5, 24739.0, 11.4),
    "container ship of 20000 TEU": (380.0, 61.0, 16.0, 235000.0, 11.8),
    "tractor tug": (30.0, 10.0, 4.2, 730.0, 6.5),
    "short tug": (22.5, 10.84, 4.0, 540.0, 6.2),
    "trawler": (34.5, 7.6, 2.65, 425.0, 5.5),
    "pushed barge": (91.0, 27.4, 5.5, 13400.0, 3.0),
    "ferry": (150.0, 27.0, 6.5, 14000.0, 10.8),
    "cruise ship": (270.0, 36.0, 8.2, 51000.0, 11.3),
    "corvette": (80.0, 11.0, 3.5, 1500.0, 13.4),
}
"""L, B, d [m], volume [m3] and speed [m/s]."""


def particulars_toml(L, B, d, volume, speed, scale=1.0):
    """Vessel file of the particulars of a ship, or of its model at the same Froude number."""
    return (
        'name = "ship"\n[particulars]\nx_G = 0\n'
        f"L = {L / scale}\nB = {B / scale}\nd = {d / scale}\nvolume = {volume / scale**3}\n"
        f"nominal_speed = {speed / math.sqrt(scale)}\nrudder_rate_deg = {2.32 * math.sqrt(scale)}\n"
    )


@pytest.mark.parametrize("scale", [1.0, 40.0])
@pytest.mark.parametrize("ship", SHIPS)
def test_a_ship_that_exists_is_not_doubted(tmp_path, ship, scale):
    path = tmp_path / "ship.toml"
    path.write_text(particulars_toml(*SHIPS[ship], scale=scale))
    assert findings(ps.load_vessel(path)) == []


@pytest.mark.parametrize("source", ["container", "kvlcc2", ROOT / "docs/tutorials/your_ship/my_ship.toml"])
def test_a_vessel_of_the_house_is_not_doubted_and_nothing_of_it_is_derived(source):
    vessel = ps.load_vessel(source)
    assert findings(vessel) == []
    assert vessel.derived == {}


def test_the_vessel_of_the_how_to_is_not_doubted(tmp_path):
    path = tmp_path / "ship.toml"
    path.write_text(Page("docs/how_to/write_a_vessel.md").blocks("toml")[0])
    assert findings(ps.load_vessel(path)) == []


def test_every_number_of_a_file_has_a_range():
    keys = {rule.key for rule in RULES}
    assert {f"particulars.{field.name}" for field in fields(Particulars)} <= keys
    assert {f"propeller.{field.name}" for field in fields(Propeller)} <= keys
    assert {f"added_mass.{name}" for name in ADDED_MASS} <= keys
    assert {f"inertia.{name}" for name in ("m", "I_zz", "I_xx")} <= keys


def test_a_usual_number_is_possible():
    for rule in RULES:
        assert rule.possible[0] <= rule.usual[0] < rule.usual[1] <= rule.possible[1], rule.key
