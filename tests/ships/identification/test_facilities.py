"""Runs of two facilities in one identification: each has its own steering gear, and a forecast says whose it uses."""

from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pytest

import pymc_ship as ps
from pymc_ship.cli.main import main
from pymc_ship.records.steering.recognition import Steering, recognise_by_facility
from pymc_ship.ships.identification.page import _steering
from tests.ships.identification.cases import RUNS, TRUE_TERMS, tanker, trial, with_delay

DELAYS = {"basin A": 2.5, "basin B": 7.0}
SPEEDS = {"basin A": None, "basin B": 6.8}
"""Of the approach [m/s]; the nominal one where it is None."""
PAPERS = tanker()


def records():
    """Two runs of the first facility between and around one of the second."""
    made = [("basin A", RUNS[0], 1), ("basin B", RUNS[1], 2), ("basin A", RUNS[2], 3)]
    return [
        trial(
            replace(what, approach_speed=SPEEDS[where]), vessel=with_delay(DELAYS[where]), seed=seed, level=0.005
        ).assign_attrs(facility=where)
        for where, what, seed in made
    ]


@pytest.fixture(scope="module")
def found():
    return ps.identify_ship(records(), PAPERS, terms=[TRUE_TERMS], draws=40, rng=1)


@pytest.fixture(scope="module")
def ship(found):
    return found.ship


def overshoot(tree):
    return float(tree["index_bands"]["first_overshoot_angle"].sel(band="median"))


def test_each_facility_has_its_gear_and_every_run_its_place():
    manoeuvres, facilities = recognise_by_facility(records(), PAPERS)
    assert [manoeuvre.label for manoeuvre in manoeuvres] == [manoeuvre.label for manoeuvre in RUNS]
    assert list(facilities) == ["basin A", "basin B"]
    for name, delay in DELAYS.items():
        assert facilities[name].rudder_delay == pytest.approx(delay, abs=0.6)
        speed = SPEEDS[name] or PAPERS.particulars.nominal_speed
        assert facilities[name].approach_speed == pytest.approx(speed, rel=0.005)


def test_runs_at_several_speeds_have_no_approach_in_common():
    runs = [trial(replace(RUNS[0], approach_speed=speed), duration=400.0) for speed in (6.0, 6.5, 7.0)]
    _, several = ps.recognise(runs, PAPERS)
    _, two = ps.recognise(runs[:2], PAPERS)
    assert np.isnan(several.approach_speed)
    assert two.approach_speed == pytest.approx(6.25, rel=0.005)


def test_runs_without_a_facility_are_of_one():
    _, facilities = recognise_by_facility([record.drop_attrs() for record in records()], PAPERS)
    assert list(facilities) == [""]


def test_held_out_runs_are_steered_as_at_their_facility(found, ship):
    """With the gear of the other basin the overshoot of the second run would be some 0.4 deg less."""
    held_out = found.held_out_indices.sel(run="2", index="first_overshoot_angle")
    forecast, measured = float(held_out["forecast"]), float(held_out["measured"])
    assert forecast == pytest.approx(measured, abs=0.25)
    other = ps.forecast(ship, replace(RUNS[1], approach_speed=SPEEDS["basin B"]), rng=1, facility="basin A")
    assert overshoot(other) < measured - 0.3


def test_the_revolutions_of_a_facility_hold_the_speed_of_its_approaches(ship):
    usual, other = (ps.forecast(ship, RUNS[1], rng=1, facility=name) for name in (None, "basin B"))
    stated = ps.forecast(ship, replace(RUNS[1], approach_speed=7.5), rng=1, facility="basin B")
    assert usual.attrs["approach_speed"] == PAPERS.particulars.nominal_speed
    assert other.attrs["approach_speed"] == ship.facilities["basin B"].approach_speed == pytest.approx(6.8, rel=0.005)
    assert other.attrs["steering"].endswith(f" The approach is at {other.attrs['approach_speed']:.4g} m/s.")
    assert "approach" not in usual.attrs["steering"]
    assert stated.attrs["approach_speed"] == 7.5


def test_a_forecast_takes_the_gear_that_is_asked_for_and_says_so(ship, tmp_path):
    again = ps.load_ship(ps.save_ship(ship, tmp_path).parent)
    assert again.facilities == ship.facilities
    for one in (ship, again):
        usual, first, second = (
            ps.forecast(one, replace(RUNS[0], approach_speed=7.974), rng=1, facility=name)
            for name in (None, "basin A", "basin B")
        )
        assert overshoot(usual) == overshoot(first) < overshoot(second) - 0.1
        assert first.attrs["steering"].startswith(usual.attrs["steering"])
        assert second.attrs["steering"].startswith("The rudder moves as at basin B at 2.35 deg/s after ")


def test_a_facility_whose_runs_show_no_gear_is_not_named_as_if_they_did(found, ship):
    facilities = ship.facilities | {"basin C": Steering(float("nan"), float("nan"), 0)}
    one = replace(ship, index_error={}, facilities=facilities)
    said = ps.forecast(one, RUNS[0], rng=1, facility="basin C").attrs["steering"]
    assert "as at" not in said
    assert " (no run at basin C reverses the rudder). " in said
    assert said.endswith(" before the rudder moves. The approach is at 7.974 m/s.")
    assert _steering(replace(found, ship=one), None)[-2] == (
        "No run at basin C reverses the rudder: the steering gear is that of basin A."
    )


def test_scores_steer_as_at_the_facility_of_the_record(ship):
    record = records()[1]
    tables = (ps.score_indices(ship, one, rng=1) for one in (record, record.drop_attrs()))
    own, elsewhere = (table.sel(run="1", index="first_overshoot_angle") for table in tables)
    assert own["forecast"] > elsewhere["forecast"] + 0.3


# command --------------------------------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def files(tmp_path_factory):
    folder = tmp_path_factory.mktemp("facilities")
    for k, record in enumerate(records()):
        ps.write_trial(record.assign_attrs(facility=""), folder / f"run{k}.csv")  # stated by format files
    for letter in "AB":
        (folder / f"{letter}.toml").write_text(f'facility = "basin {letter}"\n', encoding="utf-8")
    (folder / "nameless.toml").write_text("skip_rows = 0\n", encoding="utf-8")
    return folder


@pytest.mark.usefixtures("undrawn")
def test_runs_of_another_facility_are_named_with_their_format(files, tmp_path, capsys):
    words = ["identify", str(files / "run0.csv"), str(files / "run2.csv"), "--format", str(files / "A.toml")]
    words += ["--facility", str(files / "B.toml"), str(files / "run1.csv"), "--vessel", "kvlcc2"]
    words += ["--terms", TRUE_TERMS, "--draws", "40", "--quiet", "--out", str(tmp_path)]
    assert main(words) == 0
    index = json.loads((tmp_path / "model" / "ship.json").read_text(encoding="utf-8"))
    assert list(index["facilities"]) == ["basin A", "basin B"]
    page = (tmp_path / "index.html").read_text(encoding="utf-8")
    assert "Rudder delay at basin B measured over" in page
    assert "Forecasts use the gear of basin A by default." in page
    capsys.readouterr()
    forecast = ["forecast", str(tmp_path), "--zigzag", "10/10", "--side", "port", "--draws", "20", "--quiet"]
    assert main([*forecast, "--facility", "basin B"]) == 0
    assert "The rudder moves as at basin B at " in capsys.readouterr().out
    measured = ["--measured", str(files / "run1.csv"), "--format", str(files / "B.toml")]
    assert main([*forecast, *measured]) == 0
    text = capsys.readouterr().out
    assert text.count("as at basin A") == 1
    assert text.count("as at basin B") == 1


@pytest.mark.parametrize(
    ("group", "message"),
    [
        (["B.toml"], "--facility takes a format file and then its runs, found "),
        (["nameless.toml", "run1.csv"], 'nameless.toml; add facility = "basin B".'),
    ],
)
def test_a_facility_without_runs_or_name_is_refused(files, tmp_path, capsys, group, message):
    words = ["identify", str(files / "run0.csv"), "--vessel", "kvlcc2", "--quiet", "--out", str(tmp_path / "out")]
    assert main([*words, "--facility", *(str(files / name) for name in group)]) == 2
    assert message in capsys.readouterr().err
