"""Channels on one time base: sensors of their own stamps and rates, ordered rudders, rows that stand twice."""

from __future__ import annotations

import numpy as np
import pytest

import pymc_ship as ps
from tests.records.files.cases import columns, written
from tests.records.files.test_clock import motion

DURATION = 300.0


def sensor_rows(rng, intervals, delta=None):
    """Table with one sensor a row: each channel at its own interval, phase and jitter."""
    rows = []
    for name, interval in intervals.items():
        stamps = np.arange(rng.uniform(0.0, interval), DURATION, interval)
        stamps = np.round(stamps + rng.uniform(-0.02, 0.02, stamps.size) * interval, 3)
        fine = np.arange(0.0, DURATION + 10.0, 0.01)
        values = delta(stamps) if name == "delta" else np.interp(stamps, fine, motion(fine)[name])
        rows += [(stamp, name, value) for stamp, value in zip(stamps, values, strict=True)]
    rows.sort()
    table = {"time": np.array([stamp for stamp, _, _ in rows])}
    for name in intervals:
        table[name] = np.array([value if of == name else np.nan for _, of, value in rows])
    return table


EVEN = {"u": 1.0, "r": 1.0, "psi": 1.0, "x": 2.0, "y": 2.0}


def test_sensors_with_a_row_each_come_to_one_base(read):
    trial = read(written(sensor_rows(np.random.default_rng(3), EVEN)))
    assert np.diff(trial["time"]).mean() == pytest.approx(1.0, rel=2e-3)
    assert trial.sizes["time"] > 290
    fine = np.arange(0.0, DURATION, 0.01)
    for name, tolerance in {"u": 1e-9, "r": 1e-5, "psi": 3e-4, "x": 0.15, "y": 0.15}.items():
        np.testing.assert_allclose(trial[name], np.interp(trial["time"], fine, motion(fine)[name]), atol=tolerance)
    assert "The rows have one sensor each: channels interpolated to" in trial.attrs["reading"]
    assert "rows_lost" not in trial.attrs


def logged(held=(), rows=10, jitter=0):
    """Table of one row a second, of which some channels hold each reading for rows."""
    zigzag = ps.simulate("kvlcc2", ps.zigzag(20, 20), duration=600, step=1.0)
    table = columns(zigzag)
    row = np.arange(table["time"].size)
    late = np.random.default_rng(7).integers(0, jitter + 1, row.size)
    begins = [k + late[k] for k in range(0, row.size - rows, rows)]  # rows at which a reading comes in
    newest = np.array(begins)[np.clip(np.searchsorted(begins, row, "right") - 1, 0, None)]
    return table, table | {name: table[name][newest] for name in held}


@pytest.mark.parametrize("held", [("x", "y"), ("psi",), ("r", "x", "y")])
@pytest.mark.parametrize("jitter", [0, 1])
def test_a_reading_that_is_held_is_one_reading(read, held, jitter):
    """Ten rows of each: as it stands the channel is late by 4.5 s, or 35 m."""
    true, table = logged(held, jitter=jitter)
    trial = read(written(table))
    note = f"held: {', '.join(f'{name} for 10 rows' for name in held)}; the first"
    assert note in trial.attrs["reading"]
    for name in held:
        expected = np.interp(trial["time"], true["time"], true[name])
        as_it_stands = np.abs(table[name] - true[name]).mean()
        assert np.abs(trial[name] - expected).mean() < (0.15 + 0.1 * jitter) * as_it_stands, name


def test_a_rounded_channel_a_rudder_and_a_thinned_record_are_not_held(read):
    """Rounded headings of a turn, ordered angles, channels that stand still together, or for uneven times."""
    true, _ = logged()
    time = true["time"]
    turn = {**true, "psi": np.floor(0.5 * time) * np.deg2rad(1.0), "r": np.full(time.size, np.deg2rad(0.5))}
    orders = {**true, "delta": np.random.default_rng(8).uniform(-0.3, 0.3, time.size)[np.arange(time.size) // 20 * 20]}
    together = {
        name: values if name == "time" else values[np.arange(time.size) // 5 * 5] for name, values in true.items()
    }
    now_and_then = np.maximum.accumulate(
        np.where(np.random.default_rng(9).random(time.size) < 0.3, np.arange(time.size), 0)
    )
    uneven = {**true, "r": true["r"][now_and_then]}
    for table in (true, turn, orders, together, uneven):
        assert "is held" not in read(written(table)).attrs["reading"]


def test_a_channel_that_stops_costs_no_rows(read):
    table = sensor_rows(np.random.default_rng(4), EVEN)
    for name in ("x", "y"):
        table[name][table["time"] > 0.6 * DURATION] = np.nan
    trial = read(written(table))
    assert trial.sizes["time"] > 290
    assert not {"x", "y"} & set(trial)
    assert "x left out:" in trial.attrs["reading"]


def test_a_heading_over_north_is_turned_the_short_way(read):
    table = sensor_rows(np.random.default_rng(5), EVEN)
    continuous = read(written(table))["psi"].values
    table["psi"] = np.rad2deg(table["psi"] - 0.3) % 360.0
    trial = read(written(table).replace("psi", "psi [deg]"))
    turns = trial["psi"].values - continuous + 0.3
    np.testing.assert_allclose(turns, np.round(turns[0] / (2.0 * np.pi)) * 2.0 * np.pi, atol=1e-9)


def orders(stamps):
    return 0.35 * np.sign(np.sin(0.05 * stamps))


def test_an_ordered_rudder_keeps_its_value_and_a_measured_one_does_not(read):
    intervals = {"r": 1.0, "psi": 1.0, "u": 1.0, "delta": 4.0}
    trial = read(written(sensor_rows(np.random.default_rng(6), intervals, orders)))
    assert set(np.abs(trial["delta"].values)) == {0.35}
    gear = read(written(sensor_rows(np.random.default_rng(6), intervals, lambda stamps: 0.35 * np.sin(0.05 * stamps))))
    assert np.unique(gear["delta"]).size > 0.9 * gear.sizes["time"]


def test_orders_between_uneven_stamps_are_not_ramped(read):
    time = np.cumsum(np.random.default_rng(7).uniform(0.8, 1.2, 300))
    trial = read(written({"time": time, **motion(time), "delta": orders(time)}))
    assert set(np.abs(trial["delta"].values)) == {0.35}


def test_the_wind_turns_the_short_way_over_a_gap(read):
    time = np.arange(200.0)
    wind = (0.1 * np.sin(0.1 * time)) % (2.0 * np.pi)
    wind[[60, 61, 62, 63]] = np.nan
    trial = read(
        written({"time": time, "u": motion(time)["u"], "wind_speed": 5.0 + 0.0 * time, "wind_direction": wind})
    )
    assert np.abs(np.sin(trial["wind_direction"].values[58:66])).max() < 0.11
    assert np.cos(trial["wind_direction"].values).min() > 0.9


def gaps(trial, vessel):
    return next(check for check in ps.trial_checks(trial, vessel) if check.name == "gaps")


class TestRepeatedStamps:
    def log(self, offset, noise=0.0):
        """1 Hz log with two rows a stamp, the second of an instant ``offset`` s later."""
        time = np.repeat(np.arange(400.0), 2)
        instants = time + np.tile([0.0, offset], 400)
        table = {
            name: values + noise * np.random.default_rng(8).standard_normal(800)
            for name, values in motion(instants).items()
        }
        return {"time": time, **table}

    @pytest.mark.parametrize("noise", [0.0, 1e-4])
    def test_rows_that_stand_twice_are_one(self, read, noise):
        trial = read(written(self.log(0.0, noise)))
        np.testing.assert_array_equal(trial["time"], np.arange(400.0))
        assert "400 of 800 rows repeat stamp and motion of the row before: left out." in trial.attrs["reading"]
        assert "rows_lost" not in trial.attrs

    def test_samples_of_a_coarse_clock_are_two(self, read):
        trial = read(written(self.log(0.5, 1e-4)))
        assert np.diff(trial["time"]).mean() == pytest.approx(0.5, rel=2e-3)
        assert trial.sizes["time"] == 800


@pytest.mark.parametrize(
    ("begin", "end", "lost", "verdict"),
    [(20, 30, 0.04, "doubtful"), (100, 120, 0.21, "doubtful"), (220, 250, 0.47, "doubtful"), (0, 0, 0.0, "good")],
)
def test_the_check_of_gaps_has_the_rows_that_are_left_out(read, container, begin, end, lost, verdict):
    time = np.delete(np.arange(500.0), np.arange(begin, end))
    check = gaps(read(written({"time": time, **motion(time)})), container)
    assert check.verdict == verdict
    assert check.value("rows left out over rows") == pytest.approx(lost, abs=0.01)
    assert ("of the rows are left out" in check.sentence) == (lost > 0.1)


def test_a_record_that_loses_half_its_rows_is_bad(read, container):
    time = np.concatenate([200.0 * k + np.arange(150.0) for k in range(4)])
    check = gaps(read(written({"time": time, **motion(time)})), container)
    assert check.verdict == "bad"
    assert check.sentence.startswith("75% of the rows are left out. 3 gaps of more than")
