"""The package where Python lacks the modules that only Unix has, as on Windows."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

import pymc_ship as ps

PACKAGE = Path(ps.__file__).parent
MISSING = ("fcntl", "grp", "pwd", "resource", "termios")
WITHOUT = f"import sys\nsys.modules |= dict.fromkeys({MISSING})\n"


@pytest.fixture(scope="module")
def without(tmp_path_factory):
    """Lines that commands print in an interpreter without the modules, which then imports every room; the folder.

    The output has the encoding ASCII, and the shell expands no pattern.
    """
    folder = tmp_path_factory.mktemp("platform")
    lines = [
        "simulate container --zigzag 20/20 --duration 150 --step 0.1 --noise 0.001 --out trial.csv",
        "check *.csv --vessel container",
        "fit tri??.csv --vessel container --draws 40 --out fitted",
        "forecast fitted/trajectory.nc --vessel container --turn 35 --draws 8 --duration 60 --out bands",
    ]
    paths = [path.relative_to(PACKAGE.parent).with_suffix("").parts for path in PACKAGE.rglob("*.py")]
    names = sorted(".".join(parts).removesuffix(".__init__") for parts in paths if parts[-1] != "__main__")
    code = f"from pymc_ship.cli.main import main\nprint([main(line.split()) for line in {lines}], '\\u2192')\n"
    code += f"import importlib\nfor name in {names}:\n    importlib.import_module(name)\nprint('all')"
    command = [sys.executable, "-W", "ignore:only soft file lock", "-c", WITHOUT + code]
    environment = os.environ | {"PYTHONIOENCODING": "ascii", "PYTHONPATH": str(PACKAGE.parent)}
    done = subprocess.run(command, capture_output=True, text=True, env=environment, cwd=folder)
    assert done.returncode == 0, done.stderr
    return done.stdout.splitlines(), folder


@pytest.mark.slow
def test_every_module_is_imported_without_the_modules_of_unix(without):
    assert without[0][-1] == "all"


@pytest.mark.slow
def test_commands_simulate_check_fit_and_forecast_without_the_modules_of_unix(without):
    printed, folder = without
    assert printed[-2].startswith("[0, 0, 0, 0] ")
    written = {path.relative_to(folder).as_posix() for path in folder.rglob("*") if path.is_file()}
    page = {"bands/forecast.html", "bands/tables/forecast_turning_circle_35_port_bands.csv"}
    assert {"fitted/coefficients.csv", "fitted/trajectory.nc", "trial.csv"} | page <= written
    assert {path.split("/")[0] for path in written} == {"bands", "fitted", "trial.csv"}


@pytest.mark.slow
def test_a_letter_that_the_output_cannot_show_is_a_question_mark(without):
    assert without[0][-2].endswith(" ?")
