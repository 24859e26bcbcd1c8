"""The command that scores a ship on records."""

from __future__ import annotations

import csv
from pathlib import Path

import pytest

import pymc_ship as ps
from pymc_ship.cli.argument_types import flow
from pymc_ship.cli.main import main


@pytest.fixture(scope="module")
def record(tmp_path_factory):
    """A zigzag of the tanker as a file."""
    path = tmp_path_factory.mktemp("score") / "zigzag.csv"
    ps.write_trial(ps.simulate("kvlcc2", ps.zigzag(20, 20), duration=600, step=0.5, method="rk4"), path)
    return str(path)


def test_a_table_of_every_channel_and_a_score(record, tmp_path, capsys):
    out = tmp_path / "scored"
    assert main(["score", "kvlcc2", record, "--length", "150", "--quiet", "--out", str(out)]) == 0
    text = capsys.readouterr().out
    assert "position" in text
    assert "In windows of 150 s the bands of 90 % contain " in text
    assert "of the samples. Score 0.0" in text
    assert "first overshoot angle" in text
    assert (out / "score.html").exists()
    with (out / "tables" / "score_channels.csv").open(encoding="utf-8") as file:
        rows = list(csv.DictReader(file))
    assert [row["channel"] for row in rows] == ["u", "v", "r", "psi", "position"]
    assert all(float(row["relative"]) < 0.1 for row in rows)


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["--length", "-3"], "windows of positive length and distance"),
        (["--length", "0.1"], "one sampling interval of 0.5 s or more, found length = 0.1 s and every = 0.1 s"),
        (["--every", "1e-9"], "and every = 1e-09 s"),
        (["--length", "nan"], "found length = nan s"),
        (["--length", "1e5"], "A score needs a record of"),
        (["--draws", "0"], "draws must be a whole number from 1 up"),
    ],
)
def test_what_cannot_be_scored_is_one_sentence(record, capsys, words, message):
    assert main(["score", "kvlcc2", record, "--quiet", *words]) == 2
    error = capsys.readouterr().err
    assert message in error
    assert error.strip().count("\n") == 0


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["--duration", "1e9"], "The duration has at most 1e+08 steps"),
        (["--duration", "1e308"], "The duration has at most 1e+08 steps"),
        (["--step", "1e-9"], "The duration has at most 1e+08 steps"),
    ],
)
def test_a_simulation_of_too_many_steps_is_refused(tmp_path, capsys, words, message):
    out = str(tmp_path / "t.csv")
    assert main(["simulate", "kvlcc2", "--turn", "35", "--duration", "60", "--quiet", "--out", out, *words]) == 2
    error = capsys.readouterr().err
    assert message in error
    assert error.strip().count("\n") == 0


@pytest.mark.parametrize(
    ("words", "name"),
    [(["--sea-room", "-1"], "sea_room"), (["--sea-room", "nan"], "sea_room"), (["--n", "1000000"], "n of")],
)
def test_impossible_numbers_of_a_design_are_refused(tmp_path, capsys, words, name):
    saved = Path(__file__).parents[1] / "data" / "ships" / "format_4"
    assert main(["design", str(saved), "--quiet", "--out", str(tmp_path / "out"), *words]) == 2
    assert name in capsys.readouterr().err


def test_wind_and_current_are_a_speed_and_a_direction():
    assert flow("10/270") == (10.0, 270.0)


@pytest.mark.parametrize("option", [["--wind", "strong"], ["--current", "1"], ["--n", "fast"]])
def test_words_that_are_no_wind_current_or_revolutions_are_refused(capsys, option):
    with pytest.raises(SystemExit) as status:
        main(["forecast", "reports/none", "--turn", "35", *option])
    assert status.value.code == 2
    assert capsys.readouterr().err.strip().count("\n") == 0
