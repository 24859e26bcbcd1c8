"""Constants that other ships chose: each has its provenance, and what asks for the wrong kind is told."""

from __future__ import annotations

import datetime

import pytest

from pymc_ship.ships.ensemble.calibration import constant_by_kind, constant_value, constants


@pytest.mark.parametrize("name", constants())
def test_every_constant_says_what_it_is_and_who_chose_it(name):
    one = constants()[name]
    assert one.about.endswith(".")
    assert one.unit
    assert one.study
    assert len(one.commit) == 7
    assert isinstance(one.date, datetime.date)
    values = one.value.values() if isinstance(one.value, dict) else [one.value]
    assert all(value > 0.0 for value in values)


def test_a_number_and_a_table_are_not_taken_for_each_other():
    assert constant_value("index_extrapolation_sd") == 0.003
    assert constant_by_kind("index_typical")["time"] == 0.0021
    with pytest.raises(TypeError):
        constant_value("index_typical")
    with pytest.raises(TypeError):
        constant_by_kind("index_extrapolation_sd")


def test_what_is_changed_in_an_answer_changes_no_other():
    constant_by_kind("motion_rise")["u"] = 9.0
    assert constant_by_kind("motion_rise")["u"] == 0.5
