from pathlib import Path

import pytest

import pymc_ship as ps
from pymc_ship.cli import main as cli
from pymc_ship.cli.main import main


def test_version_is_the_packages(capsys):
    with pytest.raises(SystemExit, match="0"):
        main(["--version"])
    assert capsys.readouterr().out == f"pymc-ship {ps.__version__}\n"


def test_only_the_command_line_prints():
    source = Path(cli.__file__).parent
    printing = [path.name for path in source.glob("*.py") if "print(" in path.read_text().replace("fingerprint(", "")]
    assert printing == ["main.py"]
