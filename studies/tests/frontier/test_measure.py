"""The frontier at small scale: honest intervals cover, broken ones do not, and every table is made."""

from __future__ import annotations

import csv
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from pymc_ship.inference.trajectory.fit import fit_trajectory, initial_problem
from pymc_ship.inference.trajectory.prior import CoefficientPrior
from pymc_ship.inference.trajectory.runs import trajectory_run
from pymc_ship.machine.errors import FitError
from pymc_ship.physics.vessel.vessel import reference_coefficients
from pymc_ship.replication.scores import statistic_and_error
from studies.frontier import measure as frontier
from studies.frontier import page as frontier_report
from studies.frontier.data_sets import Cell, DataSet
from studies.frontier.tables import AIMS, DIFFERENCES, METHODS, aim_rows, bound_down_rows, over_seeds

LEVEL = 0.05
DURATION = 60.0
PLAIN = Cell("white", ("bound", "plain", "halved"), (LEVEL,))
WHOLE = (
    Cell("white", ("bound", "flat", "forecasts", "regressions"), (0.01,)),
    Cell("one designed run", ("starts",), (LEVEL,), n_designed=1),
    Cell("offsets", ("white assumed",), (0.01,), noise="offsets"),
)


def one_fit(data, sd_factor):
    """Fit with a flat prior from the truth, under a noise of so many times the estimated size."""
    run = trajectory_run(data.trials[0], data.vessel, method="euler")
    run = replace(run, sample_sd=sd_factor * run.sample_sd)
    free = np.full(data.truth.size, np.inf)
    prior = CoefficientPrior(0.0 * data.truth, free, np.abs(data.truth), "flat")
    start = np.concatenate([data.truth, run.initial_state[0]])
    fit = fit_trajectory(initial_problem([run], data.vessel, prior), start)
    return fit.coefficients, fit.sd


@pytest.fixture(scope="module")
def many(nine):
    """Honest fits of 30 data sets and their broken twins, whose noise is taken for half of what it is."""
    estimators = {
        "plain": lambda data: [frontier._scored(data, "plain", *one_fit(data, 1.0))],
        "halved": lambda data: [frontier._scored(data, "halved", *one_fit(data, 0.5))],
    }
    with pytest.MonkeyPatch.context() as patch:
        for name, estimator in estimators.items():
            patch.setitem(frontier.ESTIMATORS, name, estimator)
        return frontier.frontier(nine, seeds=30, seed=1, cells=[PLAIN], duration=DURATION, workers=1)


def score(found, estimator, column, statistic="mean"):
    return statistic_and_error(over_seeds(found, "white", LEVEL, (estimator,), column), statistic)


def test_honest_intervals_cover_90_percent(many):
    value, se = score(many, "plain", "coverage")
    assert abs(value - 90.0) < 3.5 * se
    assert se < 4.0


def test_intervals_from_half_the_noise_cover_too_little(many):
    """1.645 / 2 standard deviations hold 59 %."""
    value, se = score(many, "halved", "coverage")
    assert abs(value - 58.9) < 3.5 * se
    assert value + 5.0 * se < 87.0


def test_a_flat_fit_sits_on_the_bound(many):
    value, se = score(many, "plain", "deviation", "rmse")
    assert abs(value - 1.0) < 3.5 * se
    assert se < 0.12


def test_the_error_at_the_bound_is_that_of_the_fits(many):
    bound, fit = score(many, "bound", "median_error", "median"), score(many, "plain", "median_error", "median")
    assert abs(fit[0] - bound[0]) < 3.5 * fit[1]


@pytest.fixture(scope="module")
def whole(nine):
    """Every estimator on two data sets."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(frontier, "DRAWS", 40)
        return frontier.frontier(nine, seeds=2, seed=3, cells=WHOLE, duration=80.0, workers=1)


@pytest.mark.slow
def test_every_aim_stands_in_the_table_at_the_levels_measured(whole):
    rows = aim_rows(whole)
    aims = [aim for aim in AIMS if aim.cell in ("white", "one designed run") or aim.estimators == ("white assumed",)]
    levels = {"white": 0.01, "one designed run": LEVEL, "offsets": 0.01}
    expected = [(aim.label, levels[aim.cell]) for aim in aims if aim.cell in levels]
    assert [(row["measure"], row["level"]) for row in rows] == expected
    assert all(row["met"] in ("yes", "no", "") and not row["se"] < 0.0 for row in rows)
    shown = frontier_report.aim_table(rows)
    assert shown.heads == ["20/20 zigzag, white noise at level", "", "1 %", "aim", "5 %", "aim"]
    assert len(shown.cells) == len({row["measure"] for row in rows})


@pytest.mark.slow
def test_the_report_holds_every_table_and_the_figure(whole, nine, tmp_path):
    page = frontier_report.write_frontier(whole, nine, tmp_path, seeds=2, seed=3)
    text = page.read_text(encoding="utf-8")
    assert "python -m studies.frontier --seeds 2 --seed 3" in text
    assert all(label in text for label in METHODS.values())
    assert (tmp_path / "figures" / "from_the_bound_down.png").read_bytes().startswith(b"\x89PNG")
    tables = {p.stem: list(csv.DictReader(p.read_text().splitlines())) for p in (tmp_path / "tables").iterdir()}
    assert set(tables) == {"aims", "from_the_bound_down", "fits", "coefficients", "measurements"}
    assert len(tables["measurements"]) == len(whole)
    assert len(tables["coefficients"]) == 9
    assert [row["method"] for row in tables["from_the_bound_down"][:6]] == list(METHODS.values())
    assert {row["cell"] for row in tables["fits"]} == {cell.name for cell in WHOLE}


@pytest.mark.slow
def test_the_processes_do_not_matter_but_the_seed_does(nine):
    settings = {"seeds": 2, "cells": [Cell("white", ("bound", "flat"), (LEVEL,))], "duration": DURATION}
    lines = []
    one = frontier.frontier(nine, seed=5, workers=1, progress=lines.append, **settings)
    two = frontier.frontier(nine, seed=5, workers=2, **settings)
    other = frontier.frontier(nine, seed=6, workers=1, **settings)
    assert [(m.values, m.deviation.tobytes()) for m in one] == [(m.values, m.deviation.tobytes()) for m in two]
    assert [m.values for m in one] != [m.values for m in other]
    assert lines[-1].endswith("2 of 2 data sets")


def test_a_frontier_needs_two_seeds(nine):
    with pytest.raises(ValueError, match="two seeds or more, found 1"):
        frontier.frontier(nine, seeds=1)


def test_a_fit_that_fails_counts_as_infinitely_wrong(nine, monkeypatch):
    def fail(*args, **settings):
        raise FitError("No minimum was found.")

    monkeypatch.setattr(frontier, "trajectory_mode", fail)
    data = DataSet(nine, Cell("white", ()), 0.01, 0, 1)
    default, *forecasts = frontier._forecasts(data)
    assert default.values == {"median_error": np.inf, "coverage": 0.0, "failed": 1.0, "reaching": 0.0}
    assert [one.values["error"] for one in forecasts] == [np.inf] * len(frontier.FORECASTS)


@pytest.mark.parametrize(
    ("shift", "evidence", "expected"), [(0.0, 5.0, 50.0), (3.0, 5.0, 0.0), (3.0, -5.0, 50.0), (0.1, 5.0, 50.0)]
)
def test_starts_miss_where_the_truth_leads_to_another_and_better_mode(nine, monkeypatch, shift, evidence, expected):
    truth, sd = reference_coefficients(nine), np.ones(9)
    problem = SimpleNamespace(runs=(), prior=None)
    mode = SimpleNamespace(
        choice=SimpleNamespace(fit=SimpleNamespace(coefficients=truth, sd=sd, log_evidence=0.0, problem=problem)),
        n_agreeing=1,
        n_starts=2,
    )
    best = SimpleNamespace(fit=SimpleNamespace(coefficients=truth + shift * sd, log_evidence=evidence))
    monkeypatch.setattr(frontier, "fit_with_noise", lambda *args: best)
    assert frontier._reaching(DataSet(nine, Cell("white", ()), 0.01, 0, 1), mode)["reaching"] == expected


@pytest.mark.slow
def test_methods_are_compared_with_the_bound(whole):
    rows = bound_down_rows(whole)
    assert [row["times_bound"] for row in rows if row["method"] == METHODS["bound"]] == [1.0]
    assert all(row["by"] in DIFFERENCES for row in rows if row["method"] == METHODS["best differencing"])
