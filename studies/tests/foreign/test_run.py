"""The cases and what is made of their results; the identification itself is played."""

from __future__ import annotations

import ast
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import pytest
import xarray as xr

import pymc_ship as ps
from studies.foreign import run, sailing
from studies.foreign.cases import FOUR, SHIPS, named_cases

ROOMS = ("mmg", "mariner", "s175", "sailing", "cases")
CASES = named_cases()
TRUTH = {
    trial.label: {"advance": 960.0, "transfer": 400.0, "tactical_diameter": 1000.0}
    if trial.kind == "circle"
    else {"first_overshoot_angle": 10.0, "second_overshoot_angle": 20.0}
    for trial in sailing.JUDGED
}


@pytest.mark.parametrize("file", ROOMS)
def test_a_simulator_shares_no_code_with_the_package(file):
    tree = ast.parse(Path(run.__file__).with_name(f"{file}.py").read_text(encoding="utf-8"))
    names = {alias.name for node in ast.walk(tree) if isinstance(node, ast.Import) for alias in node.names}
    names |= {str(node.module) for node in ast.walk(tree) if isinstance(node, ast.ImportFrom)}
    allowed = {"__future__", "dataclasses", "json", "math", "numpy", "scipy", "xarray", "studies"}
    assert {name.split(".")[0] for name in names} <= allowed
    assert {name for name in names if name.startswith("studies.")} <= {
        "studies.foreign",
        *(f"studies.foreign.{room}" for room in ROOMS),
    }


def test_every_ship_is_sailed_in_every_kind_of_case():
    kinds = {"calm", "clean", "two", "wind", "current", "no-propeller"}
    wanted = {f"{ship}-{kind}" for ship in ("kvlcc2", "cargo", "mariner", "s175") for kind in kinds}
    assert set(CASES) == wanted | {"kvlcc2-race", "cargo-race"}
    assert {case.ship for case in CASES.values()} == set(SHIPS)


@pytest.mark.parametrize("name", SHIPS)
def test_the_papers_are_a_vessel_file_without_coefficients(tmp_path, name):
    ship = SHIPS[name]()
    for propeller in (True, False):
        path = tmp_path / "vessel.toml"
        path.write_text(sailing.vessel_file(ship, propeller=propeller))
        vessel = ps.load_vessel(path)
        assert not any(vessel.forces.values())
        assert vessel.particulars.L == ship.papers.L
        assert (vessel.propeller is not None) is propeller


def test_only_a_case_without_a_propeller_states_none():
    assert [name for name, case in CASES.items() if "[propeller]" not in case.vessel_file()] == [
        f"{ship}-no-propeller" for ship in ("kvlcc2", "cargo", "mariner", "s175")
    ]


def test_the_records_of_a_case_are_trials_of_the_package_with_noise_by_seed():
    case = replace(CASES["mariner-wind"], trials=FOUR[:1])
    (record,) = case.records(seed=3)
    (found,), _ = ps.recognise([record], "kvlcc2")
    assert (found.kind, found.rudder_deg, found.side) == ("zigzag", 10.0, "starboard")
    assert record.equals(case.records(seed=3)[0])
    assert not record.equals(case.records(seed=4)[0])


def played(monkeypatch, median):
    """Let forecasts be ``median`` times the truth, with intervals of 10 % to both sides."""
    bands = {"lower": 0.9 * median, "median": median, "upper": 1.1 * median}

    def forecast(ship, manoeuvre, rng):
        label = f"{'circle' if manoeuvre.kind == 'turning_circle' else 'zigzag'} "
        angles = f"{manoeuvre.rudder_deg:g}" + (f"/{manoeuvre.heading_deg:g}" if "zigzag" in label else "")
        known = TRUTH[f"{label}{angles} {manoeuvre.side}"]
        rows = {name: ("band", [value * factor for factor in bands.values()]) for name, value in known.items()}
        return {"index_bands": xr.Dataset(rows, {"band": list(bands)})}

    found = SimpleNamespace(ship=ps.Ship.from_vessel("kvlcc2"))
    monkeypatch.setattr(run, "truths", lambda ship: TRUTH)
    monkeypatch.setattr(ps, "identify_ship", lambda *args, **settings: found)
    monkeypatch.setattr(ps, "forecast", forecast)
    monkeypatch.setattr(ps, "validated_trial", lambda record, path: record)
    monkeypatch.setattr("studies.foreign.cases.Case.records", lambda self, seed: [])


def test_a_forecast_is_scored_against_the_truth(monkeypatch):
    played(monkeypatch, 1.05)
    result = run.judged(CASES["kvlcc2-calm"], seed=1, draws=10)
    assert len(result.scores) == 10
    assert all(score.inside for score in result.scores)
    assert [score.error for score in result.scores] == pytest.approx([0.05] * 10)
    assert result.scores[0].truth == pytest.approx(3.0)
    assert run.of_diameters([result]) == pytest.approx((5.0, 10.5))
    assert run.summary([result]).startswith("1 of 1 cases identified; 10 of 10 indices inside (100 %")


def test_a_forecast_beside_the_truth_misses(monkeypatch):
    played(monkeypatch, 1.3)
    result = run.judged(CASES["kvlcc2-calm"], seed=1, draws=10)
    assert not any(score.inside for score in result.scores)
    assert run.line_of(result)[2] == "0 of 10"


def test_a_refused_case_is_shown_with_its_sentence(monkeypatch, tmp_path, capsys):
    played(monkeypatch, 1.0)

    def refuse(*args, **settings):
        raise ps.FitError("All term sets run away; give more trials.")

    monkeypatch.setattr(ps, "identify_ship", refuse)
    monkeypatch.setattr(run, "named_cases", lambda: {"kvlcc2-calm": CASES["kvlcc2-calm"]})
    assert run.main(["--out", str(tmp_path)]) == 0
    text = (tmp_path / "foreign.md").read_text()
    for shown in (capsys.readouterr().out, text):
        assert "All term sets run away; give more trials." in shown
        assert "0 of 1 cases identified; 0 of 0 indices inside" in shown


def test_one_case_alone_writes_no_page(monkeypatch, tmp_path, capsys):
    played(monkeypatch, 1.0)
    assert run.main(["--case", "s175-calm", "--out", str(tmp_path)]) == 0
    assert list(tmp_path.iterdir()) == []
    assert "1 of 1 cases identified; 10 of 10 indices inside" in capsys.readouterr().out
