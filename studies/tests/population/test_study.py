"""A population of ships as a study: read, run, stopped, gone on with, and its page."""

from __future__ import annotations

import re
import sys
from dataclasses import replace

import numpy as np
import pandas as pd
import pytest

import pymc_ship as ps
from pymc_ship.cli.main import main
from pymc_ship.experiments import run as engine
from pymc_ship.experiments.run import read_study
from pymc_ship.records.steering.stopping_tests import INDICES
from studies.population import judged_ship
from studies.population.judged_ship import INDEX, INSTANT, judge, stop_rows
from studies.population.study import Population, TrialsCell
from studies.tests.population import ships
from studies.tests.population.ships import SD, STUDY, made_up, refused
from tests.experiments.folders import ROOT, run

SHIPS = "studies.tests.population.ships"
TABLES = ("results.parquet", "tables/coverage.csv", "tables/trials.csv", "tables/ships.csv")


def tables(out):
    return {name: (out / name).read_bytes() for name in TABLES}


def test_the_shipped_population_is_of_sixty_ships_or_more():
    population = read_study(ROOT / "studies" / "ships.toml")
    assert isinstance(population, Population)
    assert population.n_tasks >= 60
    assert max(trials.most or len(trials.manoeuvres) for trials in population.trials.values()) == 6
    kinds = {manoeuvre.kind for manoeuvre in population.forecasts.values()}
    assert kinds == {"turning_circle", "zigzag", "pull_out"}


@pytest.mark.parametrize(
    ("change", "sentence"),
    [
        ({"ship": 3}, "unknown key ship; known here are study, title, population"),
        ({"ships": 0}, "ships must be a whole number from 1 up, found 0"),
        ({"root_seed": -1}, "root_seed must be a whole number from 0 up, found -1"),
        ({"study": 3}, "study must be the import path module:class of a kind of study, found 3; correct it"),
        ({"study": f"{SHIPS}:tanker"}, "study must be the import path module:class of a kind of study, found"),
        ({"study": "studies.population:Folk"}, "studies.population has no Folk; correct the name"),
        ({"title": 3}, "title must be a text, found 3"),
        ({"population": 3}, "population must be the import path module:function of what draws a ship, found 3"),
        ({"population": "tanker"}, "population must be the import path module:function .*, found 'tanker'"),
        ({"population": "no_module:f"}, "population cannot have 'no_module:f': ModuleNotFoundError"),
        (
            {"population": "studies.tests.population.ships:none"},
            "studies.tests.population.ships has no none; correct the name",
        ),
        ({"population": f"{SHIPS}:SD"}, "population must be the import path module:function"),
        ({"trials": {}}, "trials must name the trials of a ship, .*, found none; add one"),
        ({"trials": []}, r"trials must be a table, found \[\]; correct it"),
        ({"trials": {"a": []}}, r"trials.a must be a list of at least one text, found \[\]"),
        ({"trials": {"a": ["circle 35"]}}, "a manoeuvre is .*, found 'circle 35'; write it so"),
        ({"trials": {"a": {"most": 2}}}, "trials.a.of is missing; add it"),
        ({"trials": {"a": {"most": 3, "of": ["zigzag 10/10"]}}}, "trials.a has 1 trials, found most = 3; lower it"),
        ({"forecasts": ["zigzag 15/15", "zigzag 15/15 port"]}, "forecasts must name everything once"),
        ({"astern": -0.7}, "astern must be a number from 0 up, found -0.7; correct it"),
        ({"astern": 42.0}, "astern is a share of the nominal revolutions up to 1.5, found 42; lower it"),
    ],
)
def test_what_cannot_be_used_is_one_sentence(change, sentence):
    with pytest.raises(ps.StudyError, match=sentence) as error:
        read_study(STUDY | change)
    assert "\n" not in str(error.value)


def test_methods_are_of_grids():
    with pytest.raises(ps.StudyError, match="is no grid, and takes no methods; leave them out"):
        read_study(STUDY, {"mine": len})


def test_a_ship_belongs_to_its_trials_and_number():
    population = read_study(STUDY)
    first, again = (population.task(TrialsCell("some"), 4) for _ in range(2))
    other = population.task(TrialsCell("some"), 5)
    assert first.sailed() == again.sailed()
    assert first.rng("a").random() == again.rng("a").random() != other.rng("a").random()
    numbers = [len(population.task(TrialsCell("some"), k).sailed()) for k in range(40)]
    assert set(numbers) == {1, 2}
    assert [m.label for m in population.task(TrialsCell("two"), 0).sailed()] == [
        "zigzag 20/20 port",
        "zigzag 10/10 port",
    ]


@pytest.fixture(scope="module")
def plain(tmp_path_factory):
    """Folder of the study of made-up results."""
    out = tmp_path_factory.mktemp("population")
    run(STUDY, out, made_up)
    return out


@pytest.mark.slow
@pytest.mark.consistency
def test_two_workers_give_the_bytes_of_one(plain, tmp_path):
    run(STUDY, tmp_path, made_up, workers=2)
    assert tables(tmp_path) == tables(plain)


def test_what_was_judged_is_kept_and_ships_may_be_added(plain, tmp_path):
    def dying(task):
        if task.seed == 2 and task.trials == "two":
            raise KeyboardInterrupt
        return made_up(task)

    with pytest.raises(KeyboardInterrupt):
        run(STUDY | {"ships": 4}, tmp_path, dying)
    assert not (tmp_path / "index.html").exists()
    run(STUDY, tmp_path, made_up)
    assert tables(tmp_path) == tables(plain)
    assert pd.read_parquet(tmp_path / "timings.parquet").groupby("session").size().tolist() == [2, 10]


@pytest.mark.parametrize(
    ("change", "sentence"),
    [
        ({"ships": 5}, "ships was 6, found 5"),
        ({"root_seed": 4}, "root_seed was 3, found 4"),
        ({"population": "studies.tests.population.ships:sunk"}, "population was studies.tests.population.ships:tanker"),
        ({"forecasts": ["zigzag 15/15 port"]}, "forecasts was"),
        ({"astern": 0.5}, "astern was 0.7, found 0.5"),
        ({"trials": {"two": STUDY["trials"]["two"]}}, "trials had 'some', which is gone"),
        ({"trials": STUDY["trials"] | {"two": ["zigzag 10/10"]}}, "'two' of trials is not what it was"),
        ({"population": None}, "is no record of a study"),
    ],
)
def test_a_study_that_changes_is_refused(plain, change, sentence):
    before = tables(plain)
    study = STUDY | change
    if change.get("population", "") is None:
        study = {"ships": ["container"], "manoeuvres": ["zigzag 20/20"], "methods": ["weak form"], "seeds": 1}
        study |= {"root_seed": 3, "noise": {"white": [0.01]}}
    with pytest.raises(ps.StudyError, match=sentence):
        run(study, plain, made_up)
    assert tables(plain) == before


def test_every_row_is_in_the_results(plain):
    found = pd.read_parquet(plain / "results.parquet")
    assert found.columns.tolist() == [
        "trials",
        "seed",
        "status",
        "sentence",
        "hull",
        "runs",
        "indices",
        "instants",
        "held",
        "stops",
    ]
    assert len(found) == 12
    assert set(found["indices"][0][0]) == set(INDEX)
    assert set(found["instants"][0][0]) == set(INSTANT)
    rows = pd.read_csv(plain / "tables" / "coverage.csv")
    assert rows["indices"].sum() == 12 * len(SD)
    stops = pd.read_csv(plain / "tables" / "stops.csv")
    assert stops[["group", "ships", "indices"]].to_numpy().tolist() == [["track reach", 6, 6]]
    by_trials = pd.read_csv(plain / "tables" / "stops_by_trials.csv")
    assert by_trials["group"].tolist() == ["all", "two", "some"]


def test_the_page_says_what_held_and_what_it_cost(plain):
    text = (plain / "index.html").read_text(encoding="utf-8")
    for words in (
        "What the intervals hold",
        "turning circle, tactical diameter",
        "Other intervals",
        "statements of 99 % on forecasts beyond the motion of the runs",
        "None was refused",
        "stopped with 0.7 of their nominal revolutions astern",
    ):
        assert words in text
    assert text.count("<svg") == 3
    assert {path.stem for path in (plain / "figures").glob("*.png")} == {
        "coverage_by_index",
        "motion_by_lead",
        "reliability",
    }


def test_the_command_tells_coverage_by_trials(plain, tmp_path, capsys, monkeypatch):
    monkeypatch.setattr(Population, "work", staticmethod(made_up))
    path = tmp_path / "study.toml"
    path.write_text(toml())
    assert main(["montecarlo", str(path), "--workers", "1", "--quiet", "--out", str(tmp_path / "out")]) == 0
    printed = capsys.readouterr().out
    assert re.search(r"all +12 +24", printed)
    assert re.search(r"some +6 +12", printed)
    assert tables(tmp_path / "out") == tables(plain)


def toml():
    """File of the study."""
    return (
        f'study = "studies.population:Population"\npopulation = "{SHIPS}:tanker"\n'
        'forecasts = ["turning circle 35 port", "zigzag 15/15 port"]\n'
        'ships = 6\nroot_seed = 3\nastern = 0.7\n[trials]\ntwo = ["zigzag 20/20", "zigzag 10/10"]\n'
        'some = {most = 2, of = ["zigzag 10/10", "zigzag 20/20"]}\n'
    )


def test_a_population_that_is_refused_has_a_page_that_says_why(tmp_path):
    rows, page = run(STUDY | {"ships": 2}, tmp_path, refused)
    assert list(rows) == []
    assert "two, ship 1: No term set can be fitted." in page.read_text(encoding="utf-8")


def test_an_import_path_is_found_from_the_working_folder(tmp_path, monkeypatch):
    (tmp_path / "ships_of_mine.py").write_text("def drawn(rng):\n    return rng\n")
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(sys, "path", [path for path in sys.path if path != str(tmp_path)])
    assert read_study(STUDY | {"population": "ships_of_mine:drawn"}).drawn_by == "ships_of_mine:drawn"


def test_a_function_that_fails_ends_the_study_in_a_sentence(tmp_path):
    sentence = (
        "Ship 0 of the trials 'two' cannot be drawn or sailed: RuntimeError: no such ship; what was judged is kept"
    )
    with pytest.raises(ps.StudyError, match=sentence):
        engine.montecarlo(STUDY | {"population": "studies.tests.population.ships:sunk"}, tmp_path, workers=1)


@pytest.mark.slow
@pytest.mark.consistency
def test_a_tanker_of_the_package_is_found_again():
    """Beside the motion of a stranger, the broken twin, its forecasts do not hold."""
    population = read_study(STUDY)
    result = judge(population.task(TrialsCell("two"), 0, "here"))
    assert (result["status"], result["sentence"], result["hull"], result["runs"]) == ("ok", "", "tanker", 2.0)
    assert (result["block"], result["seed"]) == ("here", 0)
    indices, instants = (pd.DataFrame(result[name]) for name in ("indices", "instants"))
    assert set(indices) == set(INDEX)
    assert set(indices["manoeuvre"]) == {"turning circle", "zigzag"}
    assert {"advance", "tactical_diameter", "steady_speed"} <= set(indices["index"])
    inside = indices["pit"].between(0.005, 0.995)
    assert inside.mean() > 0.8
    assert (indices["sd"] >= 0.9 * indices["draws_sd"]).all()
    assert set(instants["state"]) == {"u", "v", "r", "psi", "x", "y"}
    assert instants["pit"].between(0.0, 1.0).all()
    assert np.isfinite(instants[["error", "sd", "beyond", "far"]]).all().all()
    assert result["identify"] > result["draw"] >= 0.0
    strange = read_study(STUDY | {"population": "studies.tests.population.ships:stranger"})
    other = judge(strange.task(TrialsCell("two"), 0))
    assert pd.DataFrame(other["indices"])["pit"].between(0.005, 0.995).mean() < 0.7


@pytest.mark.slow
@pytest.mark.consistency
def test_a_ship_of_parts_stops_as_forecast_and_one_that_is_pulled_hard_sooner():
    """The second, a broken twin, has a propeller that no prior expects."""
    found = []
    for drawn in ("of_parts", "pulled_hard"):
        population = read_study(STUDY | {"population": f"studies.tests.population.ships:{drawn}"})
        result = judge(replace(population.task(TrialsCell("two"), 0), forecasts=()))
        assert (result["status"], result["stop"] > result["replay"]) == ("ok", True)
        found.append(pd.DataFrame(result["stops"]).set_index("index"))
    right, hard = found
    assert right.index.tolist() == list(INDICES)
    assert right["pit"].between(0.025, 0.975).all()
    assert (right["error"].abs() < 0.5 * right["half_width"]).all()
    assert (hard.loc[["track_reach", "head_reach", "stopping_time"], "pit"] < 0.025).all()


@pytest.mark.parametrize("lacks", ["stop", "propeller", "draught"])
def test_a_ship_that_cannot_be_stopped_is_not(lacks):
    task = read_study(STUDY).task(TrialsCell("two"), 0)
    ship, vessel = ships.of_parts(np.random.default_rng(1)), ps.load_vessel("kvlcc2")
    if lacks == "stop":
        ship = replace(ship, stop=None)
    elif lacks == "propeller":
        vessel = replace(vessel, propeller=None)
    else:
        vessel = replace(vessel, particulars=replace(vessel.particulars, d=0.0))
    assert stop_rows(task, ship, [], vessel) == []


def test_a_study_that_asks_for_no_stopping_test_has_none():
    task = read_study({key: value for key, value in STUDY.items() if key != "astern"}).task(TrialsCell("two"), 0)
    assert stop_rows(task, ships.of_parts(np.random.default_rng(1)), [], ps.load_vessel("kvlcc2")) == []


def test_a_ship_whose_parts_are_not_identified_holds_nothing(monkeypatch):
    def refused(*args, **settings):
        raise ps.FitError("No term set can be fitted.")

    monkeypatch.setattr(judged_ship, "identify_ship", refused)
    task = read_study(STUDY).task(TrialsCell("two"), 0)
    rows = stop_rows(task, ships.of_parts(np.random.default_rng(1)), [], ps.load_vessel("kvlcc2"))
    assert [row["index"] for row in rows] == list(INDICES)
    assert all(np.isnan(row["pit"]) for row in rows)
