"""Constants calibrated on other ships: provenance, and the error for the wrong kind."""

from __future__ import annotations

import datetime

import pytest

from pymc_ship.ships.ensemble.calibration import constant_by_kind, constant_value, constants


@pytest.mark.parametrize("name", constants())
def test_every_constant_has_a_unit_and_a_source(name):
    one = constants()[name]
    assert one.about.endswith(".")
    assert one.unit
    assert one.study
    assert len(one.commit) == 7
    assert isinstance(one.date, datetime.date)
    values = one.value.values() if isinstance(one.value, dict) else [one.value]
    assert all(value > 0.0 for value in values)


def test_a_number_and_a_table_by_kind_are_not_exchanged():
    assert constant_value("index_extrapolation_sd") == 0.003
    assert constant_by_kind("index_typical")["time"] == 0.0021
    with pytest.raises(TypeError):
        constant_value("index_typical")
    with pytest.raises(TypeError):
        constant_by_kind("index_extrapolation_sd")


def test_a_changed_copy_leaves_the_constant():
    constant_by_kind("motion_rise")["u"] = 9.0
    assert constant_by_kind("motion_rise")["u"] == 0.5
