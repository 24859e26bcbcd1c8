"""The report of a sea trial: page, form and command."""

import csv

import pytest

import pymc_ship as ps
from pymc_ship.cli.main import main
from pymc_ship.ships.sea_trials import corrections
from pymc_ship.ships.sea_trials.form import form_rows
from tests.ships.sea_trials.cases import run_record, tanker

DAY = {"water": {"depth": 90.0, "sea_state": 3}, "loading": {"fore": 20.8, "aft": 20.8, "full_load": 20.8}}


@pytest.fixture(scope="module")
def result():
    runs = {
        "circle": run_record(ps.turning_circle(35), 2400, wind=None),
        "other circle": run_record(ps.turning_circle(35, side="starboard"), 2400, wind=None),
        "zigzag": run_record(ps.zigzag(10, 10), 900, wind=None),
        "straight": run_record(ps.zigzag(10, 10), 20, wind=None).pipe(lambda t: t.assign(delta=0.0 * t["delta"])),
    }
    with pytest.MonkeyPatch.context() as patched:
        patched.setattr(corrections, "DRAWS", 10)
        return ps.sea_trial(runs, tanker(), conditions=DAY, rng=1)


@pytest.fixture(scope="module")
def page(result, tmp_path_factory):
    return ps.trial_report(result, tmp_path_factory.mktemp("report"), command="made by a test")


def test_the_page_has_the_form_conditions_corrections_and_figures(page):
    text = page.read_text(encoding="utf-8")
    for words in (
        "appendix 6",
        "made by a test",
        "tactical diameter",
        "above 4",
        "straight is left out",
        "U (k = 2)",
        "corrected for",
    ):
        assert words in text
    absent = ("band: the identified ship", "F and B are forecasts", "take the mean of the day")  # nothing of these
    assert [sentence for sentence in absent if sentence in text] == []
    assert text.count("<svg") == 2
    assert {path.name for path in (page.parent / "figures").iterdir()} == {
        "sea_trial_circles.png",
        "sea_trial_zigzags.png",
    }


def test_the_tables_have_the_rows(page, result):
    with (page.parent / "tables" / "sea_trial_indices.csv").open() as file:
        rows = list(csv.DictReader(file))
    assert len(rows) == len(result.indices)
    assert float(rows[0]["corrected"]) == result.indices[0]["corrected"]


def test_the_same_trial_gives_the_same_page(page, result, tmp_path):
    assert ps.trial_report(result, tmp_path, command="made by a test").read_bytes() == page.read_bytes()


def test_each_side_of_the_form_shows_its_run(result):
    line = {row["item"]: row for row in result.form}["turning circle, tactical diameter"]
    sides = {row["side"]: row for row in result.indices if row["index"] == "tactical_diameter"}
    for side in ("port", "starboard"):
        assert line[side].startswith(f"{sides[side]['corrected']:.2f} ± ")
    assert (line["criterion"], line["conformity"]) == ("5 L", "met")


def row(value, conformity, side="port", U=0.1, runs=2):
    known = {"manoeuvre": "zigzag 10/10 port", "index": "first_overshoot_angle", "units": "deg", "limit": 20.0}
    return known | {"runs": runs, "side": side, "corrected": value, "U": U, "conformity": conformity}


def test_the_form_has_the_least_favourable_run_and_conformity():
    rows = [row(12.0, "met"), row(19.9, "open"), row(8.0, "met", side="starboard", runs=1)]
    (line,) = [one for one in form_rows(rows) if one["item"] == "zigzag 10/10, first overshoot angle"]
    assert line["port"] == "19.90 ± 0.10 deg"
    assert line["starboard"] == "8.00 ± 0.10 deg in one run"
    assert line["conformity"] == "open"
    (lacking,) = [one for one in form_rows(rows) if one["item"] == "zigzag 10/10, second overshoot angle"]
    assert (lacking["port"], lacking["conformity"]) == ("not measured", "")
    (other,) = [one for one in form_rows(rows) if one["item"] == "stopping, track reach"]
    assert (other["port"], other["conformity"]) == ("not run", "")


def test_an_uncertainty_that_rounds_to_nothing_is_not_zero():
    (line, *_) = [one for one in form_rows([row(3.8, "met", U=2.8e-31)]) if one["item"].startswith("zigzag 10/10")]
    assert line["port"] == "3.80 ± < 0.01 deg"


@pytest.fixture(scope="module")
def trial(tmp_path_factory):
    path = tmp_path_factory.mktemp("runs") / "circle.csv"
    assert (
        main(["simulate", "kvlcc2", "--turn", "35", "--duration", "1500", "--step", "1", "--quiet", "--out", str(path)])
        == 0
    )
    return path


def test_it_prints_the_form_and_writes_the_page(trial, tmp_path, capsys):
    assert main(["trial-report", str(trial), "--vessel", "kvlcc2", "--quiet", "--out", str(tmp_path / "r")]) == 0
    printed = capsys.readouterr()
    assert "turning circle, tactical diameter" in printed.out
    assert "3.60" in printed.out
    assert printed.err == ""
    assert (tmp_path / "r" / "sea_trial.html").exists()


def test_a_wrong_key_is_one_sentence(trial, tmp_path, capsys):
    (tmp_path / "day.toml").write_text("[water]\ndeep = 3\n")
    words = ["--conditions", str(tmp_path / "day.toml"), "--out", str(tmp_path / "r")]
    assert main(["trial-report", str(trial), "--vessel", "kvlcc2", "--quiet", *words]) == 2
    text = capsys.readouterr().err
    assert text.count("\n") == 1
    assert "unknown key water.deep" in text
    assert not (tmp_path / "r" / "sea_trial.html").exists()


def test_a_full_load_without_a_ship_is_one_sentence(trial, tmp_path, capsys):
    words = ["--full-load", "kvlcc2", "--out", str(tmp_path / "r")]
    assert main(["trial-report", str(trial), "--vessel", "kvlcc2", "--quiet", *words]) == 2
    assert "give ship" in capsys.readouterr().err
