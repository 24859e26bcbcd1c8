"""The file of constants: written as it is read, with the statements that the study in ``reports/ships`` counted."""

from __future__ import annotations

import csv
import datetime
from pathlib import Path

import pytest

from pymc_ship.cli.main import run_command
from pymc_ship.machine.errors import StudyError
from pymc_ship.ships.ensemble.calibration import FILE, constants
from studies.population import calibration
from studies.population.calibration import counted, text, with_statements

REPORT = Path(__file__).parents[3] / "reports" / "ships"


def test_the_file_is_what_the_study_writes():
    assert text(constants()) == FILE.read_text(encoding="utf-8")


def test_the_statements_are_those_of_the_report():
    numbers = constants()["calibration_hits"].value, constants()["calibration_trials"].value
    assert counted(REPORT) == numbers


def test_only_the_statements_are_written_anew():
    provenance = {"study": "mine", "seeds": (5,), "commit": "abcdefg", "date": datetime.date(2030, 1, 1)}
    new = with_statements(constants(), (7, 9), **provenance)
    assert list(new) == list(constants())
    assert (new["calibration_hits"].value, new["calibration_trials"].value, new["calibration_trials"].seeds) == (
        7,
        9,
        (5,),
    )
    assert {name for name in new if new[name] != constants()[name]} == {"calibration_hits", "calibration_trials"}


@pytest.fixture
def folder(tmp_path):
    """Folder of a study that counted 7 of 9."""
    (tmp_path / "tables").mkdir()
    with (tmp_path / "tables" / "statements.csv").open("w", encoding="utf-8", newline="") as file:
        csv.writer(file).writerows([["forecasts", "stated", "statements", "held"], [*calibration.COUNTED, 9, 7]])
    return tmp_path


def test_the_command_writes_what_was_counted(folder, tmp_path, monkeypatch, capsys):
    monkeypatch.setattr(calibration, "FILE", tmp_path / "calibration.toml")
    study = Path(__file__).parents[2] / "ships.toml"
    words = [str(folder), "--study", str(study), "--quiet"]
    assert run_command(calibration.parser(), calibration.calibration, words) == 0
    written = (tmp_path / "calibration.toml").read_text(encoding="utf-8")
    assert "value = 7\n" in written
    assert "seeds = [22]\n" in written
    assert "Of 9 statements of 99 %" in capsys.readouterr().out


def test_a_folder_without_such_statements_is_refused(folder):
    path = folder / "tables" / "statements.csv"
    path.write_text(path.read_text(encoding="utf-8").replace("0.99", "0.9"), encoding="utf-8")
    with pytest.raises(StudyError, match="has no statements of 99 %"):
        counted(folder)
    with pytest.raises(StudyError, match="has no statements of 99 %"):
        counted(folder / "none")
