"""Conditions of a sea trial: the file, and the limits of the circular."""

import numpy as np
import pytest

import pymc_ship as ps
from pymc_ship.ships.sea_trials.conditions import Conditions, beaufort, condition_rows, load_conditions

VESSEL = ps.load_vessel("kvlcc2")


@pytest.mark.parametrize(("speed", "number"), [(0.0, 0), (0.3, 1), (5.4, 3), (10.7, 5), (10.8, 6), (33.0, 12)])
def test_wind_has_its_beaufort_number(speed, number):
    assert beaufort(speed) == number


def test_a_file_is_read(tmp_path):
    (tmp_path / "day.toml").write_text(
        "[water]\ndepth = 90.0\nsea_state = 3\n[wind]\nspeed = 6.0\nfrom = 210.0\n[loading]\nfore = 20.6\naft = 21.0\n"
        'full_load = 20.8\n[engine]\nspeed_at_85_percent = 8.0\n[form]\nship_type = "tanker"\n'
    )
    conditions = load_conditions(tmp_path / "day.toml")
    assert (conditions.water_depth, conditions.sea_state, conditions.wind) == (90.0, 3.0, (6.0, 210.0))
    assert conditions.draught(VESSEL) == pytest.approx(20.8)
    assert conditions.form == {"ship_type": "tanker"}
    assert load_conditions(None) == load_conditions({}) or np.isnan(load_conditions({}).water_depth)


def conformities(conditions, **known):
    settings = {"wind": 4.0, "speeds": {"a": 7.9}} | known
    return {row["condition"]: row["conformity"] for row in condition_rows(conditions, VESSEL, **settings)}


def test_every_limit_can_be_met_and_missed():
    good = Conditions(water_depth=90.0, sea_state=3.0, full_load=20.8, speed_at_85_percent=8.0)
    assert set(conformities(good).values()) == {"met"}
    bad = Conditions(water_depth=80.0, sea_state=5.0, full_load=22.0, speed_at_85_percent=9.0)
    assert set(conformities(bad, wind=11.0).values()) == {"not met"}
    assert set(conformities(Conditions(), wind=np.nan, speeds={}).values()) == {"not stated"}


def test_the_slowest_run_counts():
    noted = Conditions(speed_at_85_percent=8.0)
    assert conformities(noted, speeds={"a": 8.0, "b": 7.0})["slowest approach speed"] == "not met"
