"""The package where Python lacks the modules that only Unix has, as on Windows."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

import pymc_ship as ps

PACKAGE = Path(ps.__file__).parent
MISSING = ("fcntl", "grp", "pwd", "resource", "termios")
WITHOUT = f"import sys\nsys.modules |= dict.fromkeys({MISSING})\n"


def fresh(code, **settings):
    """Run code in an interpreter that lacks the modules; return what it prints."""
    command = [sys.executable, "-W", "ignore:only soft file lock", "-c", WITHOUT + code]
    done = subprocess.run(command, capture_output=True, text=True, **settings)
    assert done.returncode == 0, done.stderr
    return done.stdout


@pytest.mark.slow
def test_every_module_is_imported_without_the_modules_of_unix():
    paths = [path.relative_to(PACKAGE.parent).with_suffix("").parts for path in PACKAGE.rglob("*.py")]
    names = sorted(".".join(parts).removesuffix(".__init__") for parts in paths if parts[-1] != "__main__")
    assert fresh(f"import importlib\nfor name in {names}:\n    importlib.import_module(name)\nprint('all')") == "all\n"


@pytest.mark.slow
def test_commands_simulate_check_fit_and_forecast_without_the_modules_of_unix(tmp_path):
    """And the shell expands no pattern."""
    lines = [
        "simulate container --zigzag 20/20 --duration 150 --step 0.1 --noise 0.001 --out trial.csv",
        "check *.csv --vessel container",
        "fit tri??.csv --vessel container --draws 40 --out fitted",
        "forecast fitted/trajectory.nc --vessel container --turn 35 --draws 8 --duration 60 --out bands",
    ]
    code = f"from pymc_ship.cli.main import main\nprint([main(line.split()) for line in {lines}])"
    assert fresh(code, cwd=tmp_path).splitlines()[-1] == "[0, 0, 0, 0]"
    written = {path.relative_to(tmp_path).as_posix() for path in tmp_path.rglob("*") if path.is_file()}
    page = {"bands/forecast.html", "bands/tables/forecast_turning_circle_35_port_bands.csv"}
    assert {"fitted/coefficients.csv", "fitted/trajectory.nc", "trial.csv"} | page <= written
    assert {path.split("/")[0] for path in written} == {"bands", "fitted", "trial.csv"}


def test_a_letter_that_the_output_cannot_show_is_a_question_mark(tmp_path):
    words = "'simulate', 'container', '--turn', '35', '--duration', '60', '--quiet', '--out', 'trial.csv'"
    code = f"from pymc_ship.cli.main import main\nprint(main([{words}]), '\\u2192')"
    run = {"env": {"PYTHONIOENCODING": "ascii", "PYTHONPATH": str(PACKAGE.parent)}, "cwd": tmp_path}
    assert fresh(code, **run).splitlines()[-1] == "0 ?"
