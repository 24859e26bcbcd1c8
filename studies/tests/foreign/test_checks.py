"""Checks of records of ships of other forces than the package's."""

from __future__ import annotations

import pytest

import pymc_ship as ps
from pymc_ship.records.checks.rudder import SHIFTED
from studies.foreign import sailing
from studies.foreign.cases import SENSORS, SHIPS


@pytest.mark.parametrize("angle", [10.0, 20.0])
@pytest.mark.parametrize("name", ["kvlcc2", "cargo", "mariner", "s175"])
def test_the_yaw_of_every_ship_follows_its_rudder_alike(name, angle, tmp_path):
    """Without a shift of the rudder, the shift found is well below the one that is doubted."""
    ship = SHIPS[name]()
    (tmp_path / "ship.toml").write_text(sailing.vessel_file(ship), encoding="utf-8")
    zigzag = sailing.Trial("zigzag", angle, angle, "starboard")
    record = sailing.sail(ship, zigzag, sensors=SENSORS, duration=18.0 * ship.papers.unit, interval=1.0)
    vessel = ps.load_vessel(tmp_path / "ship.toml")
    check = next(check for check in ps.trial_checks(record, vessel) if check.name == "rudder timing")
    assert check.verdict == "good"
    assert abs(check.value("shift")) < 0.75 * SHIFTED * ship.papers.unit
