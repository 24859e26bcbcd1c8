"""Write what a study found into the constants of the package: ``python -m studies.population.calibration FOLDER``.

FOLDER is that of the study of ``--study``, such as ``reports/ships``. The statements of 99 % beyond the motion of the
runs, which no constant was chosen by, are counted there. The other constants were chosen by hand from
``tables/growth.csv`` and ``tables/model_error.csv`` of earlier populations; they stay as they are.
"""

from __future__ import annotations

import argparse
import csv
import datetime
import json
import subprocess
import sys
import tomllib
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

from pymc_ship.cli.files import Outcome, Progress
from pymc_ship.cli.main import run_command
from pymc_ship.machine.errors import StudyError
from pymc_ship.machine.files import staged_path
from pymc_ship.ships.ensemble.calibration import FILE, Constant, constants
from studies.command_line import study_parser

COUNTED = ("beyond the motion of the runs", 0.99)
"""Forecasts and stated probability of the statements that are counted."""

_HEAD = (
    "# Constants of the model error that other ships than the user's have chosen, each with where it comes from.\n"
    "# Written by studies/population/calibration.py; studies/LOG.md says how each was chosen.\n"
)


def counted(folder: str | Path) -> tuple[int, int]:
    """Statements that held and those that were made, of :data:`COUNTED`, in the folder of a population."""
    path, rows = Path(folder) / "tables" / "statements.csv", {}
    if path.exists():
        with path.open(encoding="utf-8", newline="") as file:
            rows = {(row["forecasts"], float(row["stated"])): row for row in csv.DictReader(file)}
    if COUNTED not in rows:
        raise StudyError(f"{folder} has no statements of 99 % {COUNTED[0]}; run its study first.")
    return int(rows[COUNTED]["held"]), int(rows[COUNTED]["statements"])


def with_statements(
    known: Mapping[str, Constant], numbers: tuple[int, int], **provenance: object
) -> dict[str, Constant]:
    """The constants with statements that held and were made, and ``study``, ``seeds``, ``commit``, ``date`` of both."""
    names = ("calibration_hits", "calibration_trials")
    new = {name: replace(known[name], value=number, **provenance) for name, number in zip(names, numbers, strict=True)}
    return {**known, **new}


def text(known: Mapping[str, Constant]) -> str:
    """File of the constants, as :func:`pymc_ship.ships.ensemble.calibration.constants` reads it."""
    lines = [_HEAD.rstrip("\n")]
    for name, one in known.items():
        value = repr(one.value)
        if isinstance(one.value, Mapping):
            value = "{ " + ", ".join(f"{key} = {number!r}" for key, number in one.value.items()) + " }"
        lines += ["", f"[{name}]", f"about = {_quoted(one.about)}", f"unit = {_quoted(one.unit)}", f"value = {value}"]
        lines += [f"study = {_quoted(one.study)}", f"seeds = {list(one.seeds)}"]
        lines += [f"commit = {_quoted(one.commit)}", f"date = {one.date}"]
    return "\n".join(lines) + "\n"


def _quoted(words: str) -> str:
    return json.dumps(words, ensure_ascii=False)


def calibration(args: argparse.Namespace, progress: Progress) -> Outcome:
    """Write the file of constants with the statements that a study counted; the text has their numbers."""
    held, made = counted(args.folder)
    study = tomllib.loads(Path(args.study).read_text(encoding="utf-8"))
    commit = subprocess.run(["git", "rev-parse", "--short=7", "HEAD"], capture_output=True, text=True, check=True)
    provenance = {"study": args.study, "seeds": (study["root_seed"],), "commit": commit.stdout.strip()}
    new = with_statements(constants(), (held, made), date=datetime.date.today(), **provenance)
    with staged_path(FILE) as partial:
        partial.write_text(text(new), encoding="utf-8")
    return f"Of {made} statements of 99 % {COUNTED[0]}, {held} held.", FILE


def parser() -> argparse.ArgumentParser:
    """Words of the command line."""
    words = study_parser("population.calibration", "count statements of a population into the package's constants")
    words.add_argument("folder", metavar="FOLDER", help="of the complete study, with its tables")
    words.add_argument("--study", default="studies/ships.toml", help="its TOML file (%(default)s)")
    return words


if __name__ == "__main__":
    sys.exit(run_command(parser(), calibration))
