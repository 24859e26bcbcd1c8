"""Command lines that are run in this process or refused, and the files they write."""

from __future__ import annotations

import csv
import sys
from pathlib import Path

import numpy as np

from pymc_ship.cli.main import main


def program(*words):
    """Command line of a true run."""
    return [str(Path(sys.executable).with_name("pymc-ship")), *map(str, words)]


def run(*words):
    """Run a command line that must succeed."""
    assert main(list(map(str, words))) == 0


def files(folder):
    return sorted(str(path.relative_to(folder)) for path in folder.rglob("*") if not path.is_dir())


def rows(path):
    """Rows of a CSV below its line of provenance."""
    with path.open(encoding="utf-8") as file:
        return list(csv.DictReader(line for line in file if line[0] != "#"))


def column(table, name):
    return np.array([float(row[name]) for row in table])


ALL_COMMANDS = [
    "simulate container --turn 35",
    "denoise {made}/trial.csv",
    "regress {made}/trial.csv --vessel {made}/small.toml",
    "tune {made}/trial.csv --vessel {made}/small.toml --dof yaw --family conjugate",
    "forecast {made}/identified --vessel {made}/small.toml --turn 35",
    "study",
]
"""Each command, to be given an --out."""
LONG_WORK = {
    "simulate": "pymc_ship.simulate",
    "denoise": "pymc_ship.denoise",
    "regress": "pymc_ship.regression_data",
    "tune": "pymc_ship.cli.commands.tune_prior",
    "forecast": "pymc_ship.forecast",
    "study": "pymc_ship.simulate",
}
"""What each command spends its time on."""


def stop(*args, **settings):
    raise KeyboardInterrupt
