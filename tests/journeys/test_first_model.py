"""The script a PyMC user reads first runs as it stands, and both of its models agree with the closed form."""

from __future__ import annotations

import re
import subprocess
import sys
from pathlib import Path

import pytest

from pymc_ship.physics.vessel.reading import shipped_vessels

SCRIPT = Path(__file__).parents[2] / "models" / "first_model.py"


def test_it_is_short_and_no_vessel():
    assert SCRIPT.read_text(encoding="utf-8").count("\n") < 65
    assert "first_model" not in shipped_vessels()


@pytest.mark.consistency
def test_both_forms_agree_with_the_closed_form_and_the_changed_model_runs():
    command = [sys.executable, SCRIPT, "250"]
    printed = subprocess.run(command, check=True, capture_output=True, text=True).stdout
    assert "coefficients[Ydelta]" in printed
    largest = [float(z) for z in re.findall(r"largest \|z\| ([\d.]+)", printed)]
    limit = float(re.search(r"limit ([\d.]+)", printed)[1])
    assert len(largest) == 2
    assert max(largest) < limit
    paper, horseshoe = (float(value) for value in re.findall(r"elpd (-?[\d.]+)", printed))
    assert abs(paper - horseshoe) < 50.0
