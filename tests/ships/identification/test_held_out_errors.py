"""Errors of held-out indices: those of overshoots, and intervals that do not count the run they are of."""

from __future__ import annotations

import numpy as np
import pytest

from pymc_ship.ships.ensemble.index_error import EXTRAPOLATION_SD, index_sd, model_error
from pymc_ship.ships.ensemble.index_table import index_table
from pymc_ship.ships.ensemble.motion_error import motion_error
from pymc_ship.ships.identification.held_out_errors import (
    coverage,
    harder_index_rows,
    index_error_rows,
    overshoot_errors,
)
from tests.ships.ensemble.cases import ship_of
from tests.ships.identification.cases import tanker


def index_row(run, index, measured, forecast, sd=0.5, kind="angle"):
    """Row as of a model, without spread of the draws."""
    row = {"run": run, "manoeuvre": "zigzag", "index": index, "kind": kind, "measured": measured, "forecast": forecast}
    return row | {"parameter_sd": 0.0, "model_sd": 0.0, "measured_sd": 0.0, "scale": measured, "sd": sd}


def test_errors_of_overshoots():
    index = [
        index_row("a", "first_overshoot_angle", 5.0, 5.5),
        index_row("b", "first_overshoot_angle", 5.0, 4.8),
        index_row("a", "second_overshoot_angle", 9.0, 7.0),
        index_row("a", "first_overshoot_time", 100.0, 97.0, kind="time"),
        index_row("a", "second_overshoot_time", 50.0, 50.5, kind="time"),
        index_row("b", "second_overshoot_time", 50.0, 51.0, kind="time"),
        index_row("a", "period", 50.0, 90.0, kind="time"),
    ]
    assert overshoot_errors(index) == pytest.approx(
        {
            "first_overshoot_angle_mean": 0.35,
            "first_overshoot_angle_max": 0.5,
            "second_overshoot_angle_mean": 2.0,
            "second_overshoot_angle_max": 2.0,
            "overshoot_time_median": 2.0,
        }
    )
    assert np.isnan(list(overshoot_errors([]).values())).all()


def test_held_out_rows_take_the_model_error_of_the_other_runs():
    index = [
        index_row("a", "first_overshoot_angle", 10.0, 4.0, sd=0.6),
        index_row("b", "first_overshoot_angle", 10.0, 10.2, sd=0.6),
        index_row("c", "first_overshoot_angle", 10.0, 10.4, sd=0.6),
    ]
    found = index_error_rows(index_table(index))
    assert [row["z"] for row in found] == pytest.approx([-10.0, 0.2 / 0.6, 0.4 / 0.6])
    expected = [index_sd(row, model_error([one for one in index if one is not row])) for row in index]
    assert [row["leave_one_out_sd"] for row in found] == pytest.approx(expected, rel=1e-12)
    assert found[0]["leave_one_out_sd"] < found[1]["leave_one_out_sd"]
    assert coverage(found) == {"90": 2, "90_leave_one_out": 2, "95": 2, "95_leave_one_out": 2}
    assert index_error_rows(index_table(index[:1]))[0]["leave_one_out_sd"] == pytest.approx(
        index_sd(index[0], model_error([])), rel=1e-12
    )
    motion = motion_error((), tanker())
    wider = {name: 9.0 * sizes for name, sizes in motion.items()}
    for errors in (motion, wider):
        first = index_error_rows(index_table(index[:1]), errors)[0]
        assert first["leave_one_out_sd"] == pytest.approx(index_sd(index[0], model_error([], errors)), rel=1e-12)


def test_indices_of_harder_runs_have_the_error_beyond_the_milder_ones():
    row = index_row("a", "first_overshoot_angle", 10.0, 12.0) | {"beyond": 2.0}
    known = {"harder_indices": index_table([row]), "extrapolation_growth": np.full(1, 5.0)}
    (found,) = harder_index_rows(ship_of(tanker(), **known))
    assert (found["error"], found["beyond"]) == (2.0, 2.0)
    assert found["sd"] == pytest.approx(10.0 * 2.0 * 5.0 * EXTRAPOLATION_SD, rel=1e-12)
    assert found["z"] == pytest.approx(2.0 / found["sd"], rel=1e-12)
