"""The files of the tutorial: what its script makes, with the faults it says they have."""

from __future__ import annotations

import importlib.util
from pathlib import Path

import numpy as np
import pytest

import pymc_ship as ps

FOLDER = Path(__file__).parents[2] / "docs" / "tutorials" / "your_ship"
FORMAT, VESSEL = FOLDER / "format.toml", FOLDER / "my_ship.toml"
ZIGZAGS = sorted(FOLDER.glob("zigzag_*.csv"))


@pytest.fixture(scope="module")
def script():
    """The script that makes the files, as a module."""
    spec = importlib.util.spec_from_file_location("make_trials", FOLDER / "make_trials.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def test_the_script_makes_the_files_that_are_there(script, tmp_path):
    """To the last digit of all but a few cells, which rounding may tip over on another machine."""
    script.main(tmp_path)
    assert {path.name for path in tmp_path.iterdir()} == {path.name for path in FOLDER.glob("*.csv")}
    for path in tmp_path.iterdir():
        made, kept = (file.read_text(encoding="utf-8").splitlines() for file in (path, FOLDER / path.name))
        assert len(made) == len(kept)
        assert sum(a != b for a, b in zip(made, kept, strict=True)) <= 0.01 * len(kept)


@pytest.mark.parametrize("path", ZIGZAGS, ids=lambda path: path.stem)
def test_checks_find_gyro_and_rudder_and_mend_them(script, path):
    trial, vessel = ps.read_trial(path, format=FORMAT), ps.load_vessel(VESSEL)
    checks = {check.name: check for check in ps.trial_checks(trial, vessel)}
    offset = {name: value for name, value, _ in checks["gyro offset"].numbers}
    assert checks["gyro offset"].verdict == checks["rudder zero"].verdict == "doubtful"
    assert next(iter(offset.values())) == pytest.approx(0.9 / 60.0, rel=0.1)
    mended = ps.corrected_trial(trial, tuple(checks.values()))
    held = np.rad2deg(np.quantile(mended["delta"].values, [0.02, 0.98]))
    assert abs(held.sum()) < 0.2
    assert ("gap" in trial.attrs["reading"]) == (script.RUNS[path.stem][3] is not None)


def test_the_manoeuvres_are_recognised(script):
    vessel = ps.load_vessel(VESSEL)
    paths = sorted(FOLDER.glob("*.csv"))
    trials = [ps.read_trial(path, format=FORMAT) for path in paths]
    trials = [ps.corrected_trial(trial, ps.trial_checks(trial, vessel)) for trial in trials]
    found, steering = ps.recognise(trials, vessel)
    assert [manoeuvre.label for manoeuvre in found] == [script.RUNS[path.stem][0].label for path in paths]
    true = script.true_ship().particulars
    assert steering.rudder_rate_deg == pytest.approx(true.rudder_rate_deg, rel=0.05)
    assert steering.rudder_delay == pytest.approx(true.rudder_delay, abs=1.0)


def test_no_term_set_has_the_forces_of_the_tutorials_ship(script):
    names = {c.term for force in script.true_ship().forces.values() for c in force}
    vessel = ps.load_vessel(VESSEL)
    for name in ps.term_sets(vessel):
        mine = {c.term for force in ps.with_terms(vessel, name).forces.values() for c in force}
        assert not names <= mine
