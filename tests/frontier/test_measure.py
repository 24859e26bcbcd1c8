"""The frontier at small scale: honest intervals cover, broken ones are seen, the same seed gives the same tables."""

from __future__ import annotations

import csv
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

import pymc_ship as ps
from pymc_ship.cli.main import main
from pymc_ship.frontier import measure as frontier
from pymc_ship.frontier import page as frontier_report
from pymc_ship.frontier import tables
from pymc_ship.frontier.data_sets import SLOW_SPEED, Cell, DataSet, data_set
from pymc_ship.frontier.scores import with_error
from pymc_ship.frontier.tables import (
    AIMS,
    DIFFERENCES,
    METHODS,
    Aim,
    aim_rows,
    best_differencing,
    bound_down_rows,
    over_seeds,
)
from pymc_ship.trajectory.fit import TrajectoryError, fit_trajectory, initial_problem
from pymc_ship.trajectory.prior import CoefficientPrior
from pymc_ship.trajectory.runs import trajectory_run
from pymc_ship.trial.noise import NOISES, noisy_trial
from pymc_ship.vessel.vessel import reference_coefficients
from tests.vessel.cases import small_vessel

Measurement = frontier.Measurement

NAMES = {"surge": ("Xu", "Xuu", "Xvr"), "sway": ("Yv", "Yr", "Ydelta"), "yaw": ("Nv", "Nr", "Ndelta")}
LEVEL, DURATION = 0.05, 60.0
PLAIN = Cell("white", ("bound", "plain", "halved"), (LEVEL,))
WHOLE = (
    Cell("white", ("bound", "flat", "forecasts", "regressions"), (0.01,)),
    Cell("one designed run", ("starts",), (LEVEL,), n_designed=1),
    Cell("offsets", ("white assumed",), (0.01,), noise="offsets"),
)


@pytest.fixture(scope="module")
def small(container):
    """Nine of the container ship's coefficients, without roll."""
    return small_vessel(container, NAMES)


def one_fit(data, sd_factor):
    """Fit with a flat prior from the truth, under a noise of so many times the estimated size."""
    run = trajectory_run(data.trials[0], data.vessel, method="euler")
    run = replace(run, sample_sd=sd_factor * run.sample_sd)
    free = np.full(data.truth.size, np.inf)
    prior = CoefficientPrior(0.0 * data.truth, free, np.abs(data.truth), np.isfinite(free), "flat")
    start = np.concatenate([data.truth, run.initial_state[0]])
    fit = fit_trajectory(initial_problem([run], data.vessel, prior), start)
    return fit.coefficients, fit.sd


@pytest.fixture(scope="module")
def many(small):
    """Honest fits of 30 data sets and their broken twins, whose noise is taken for half of what it is."""
    estimators = {
        "plain": lambda data: [frontier._scored(data, "plain", *one_fit(data, 1.0))],
        "halved": lambda data: [frontier._scored(data, "halved", *one_fit(data, 0.5))],
    }
    with pytest.MonkeyPatch.context() as patch:
        for name, estimator in estimators.items():
            patch.setitem(frontier.ESTIMATORS, name, estimator)
        return frontier.frontier(small, seeds=30, seed=1, cells=[PLAIN], duration=DURATION, workers=1)


def score(found, estimator, column, statistic="mean"):
    return with_error(over_seeds(found, "white", LEVEL, (estimator,), column), statistic)


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
def whole(small):
    """Every estimator on two data sets."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(frontier, "DRAWS", 40)
        return frontier.frontier(small, seeds=2, seed=3, cells=WHOLE, duration=120.0, workers=1)


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
def test_the_report_holds_every_table_and_the_figure(whole, small, tmp_path):
    page = frontier_report.write_frontier(whole, small, tmp_path, seeds=2, seed=3)
    text = page.read_text(encoding="utf-8")
    assert "pymc-ship frontier --seeds 2 --seed 3" in text
    assert all(label in text for label in METHODS.values())
    assert (tmp_path / "figures" / "from_the_bound_down.png").read_bytes().startswith(b"\x89PNG")
    tables = {p.stem: list(csv.DictReader(p.read_text().splitlines())) for p in (tmp_path / "tables").iterdir()}
    assert set(tables) == {"aims", "from_the_bound_down", "fits", "coefficients", "measurements"}
    assert len(tables["measurements"]) == len(whole)
    assert len(tables["coefficients"]) == 9
    assert [row["method"] for row in tables["from_the_bound_down"][:6]] == list(METHODS.values())
    assert {row["cell"] for row in tables["fits"]} == {cell.name for cell in WHOLE}


@pytest.mark.slow
def test_the_processes_do_not_matter_but_the_seed_does(small):
    settings = {"seeds": 2, "cells": [Cell("white", ("bound", "flat"), (LEVEL,))], "duration": DURATION}
    lines = []
    one = frontier.frontier(small, seed=5, workers=1, progress=lines.append, **settings)
    two = frontier.frontier(small, seed=5, workers=2, **settings)
    other = frontier.frontier(small, seed=6, workers=1, **settings)
    assert [(m.values, m.deviation.tobytes()) for m in one] == [(m.values, m.deviation.tobytes()) for m in two]
    assert [m.values for m in one] != [m.values for m in other]
    assert lines[-1].endswith("2 of 2 data sets")


def test_a_frontier_needs_two_seeds(small):
    with pytest.raises(ValueError, match="two seeds or more, found 1"):
        frontier.frontier(small, seeds=1)


@pytest.mark.parametrize("name", NOISES)
def test_noise_has_unit_variance(name):
    noise = np.array([NOISES[name](4000, np.random.default_rng(k)) for k in range(50)])
    power = np.mean(np.clip(noise, -30.0, 30.0) ** 2, axis=1)
    assert abs(power.mean() - 1.0) < 4.0 * power.std() / np.sqrt(50)


@pytest.mark.parametrize("time_constant", [0.2, 1.0])
def test_correlated_noise_forgets_within_its_time_constant(time_constant):
    noise = np.array([NOISES[f"correlated {time_constant:g} s"](4000, np.random.default_rng(k)) for k in range(50)])
    lag = round(time_constant / 0.02)
    correlation = np.mean(noise[:, lag:] * noise[:, :-lag], axis=1)
    assert abs(correlation.mean() - np.exp(-1.0)) < 4.0 * correlation.std() / np.sqrt(50)


def test_offsets_are_half_to_all_of_the_level(small):
    clean = ps.simulate(small, ps.zigzag(20, 20), duration=40.0)
    offsets = []
    for seed in range(20):
        shifted = noisy_trial(clean, 0.01, "offsets", np.random.default_rng(seed))
        offsets += [float((shifted[c] - clean[c]).mean() / np.abs(clean[c]).max()) for c in ("u", "r")]
    offsets = np.array(offsets)
    spread = 0.003 / np.sqrt(clean.sizes["time"])  # of the mean of the white noise on top
    assert np.all((np.abs(offsets) > 0.005 - 5.0 * spread) & (np.abs(offsets) < 0.01 + 5.0 * spread))
    assert {-1.0, 1.0} == set(np.sign(offsets))


def test_designed_runs_come_after_the_zigzag(small):
    data = data_set(small, Cell("two", (), n_designed=2), 0.01, 0, root=1, duration=20.0)
    assert [trial.sizes["time"] for trial in data.trials] == [1000] * 3
    assert float(data.clean[1]["u"][0]) == SLOW_SPEED
    other = data_set(small, Cell("two", (), n_designed=2), 0.01, 1, root=1, duration=20.0)
    assert not data.clean[1].equals(other.clean[1])
    assert data.clean[2].equals(other.clean[2])


def test_the_bound_falls_with_the_noise_and_with_runs(small):
    cells = [Cell(name, ("bound",), n_designed=n) for name, n in (("one", 0), ("two", 1))]
    one, quiet = (data_set(small, cells[0], level, 0, root=1, duration=DURATION).bound for level in (0.01, 0.001))
    more = data_set(small, cells[1], 0.01, 0, root=1, duration=DURATION).bound
    np.testing.assert_allclose(one, 10.0 * quiet, rtol=1e-6)
    assert np.all(more < one)


def test_a_fit_that_fails_counts_as_infinitely_wrong(small, monkeypatch):
    def fail(*args, **settings):
        raise TrajectoryError("No minimum was found.")

    monkeypatch.setattr(frontier, "trajectory_mode", fail)
    data = DataSet(small, Cell("white", ()), 0.01, 0, 1)
    default, *forecasts = frontier._forecasts(data)
    assert default.values == {"median_error": np.inf, "coverage": 0.0, "failed": 1.0, "reaching": 0.0}
    assert [one.values["error"] for one in forecasts] == [np.inf] * len(frontier.FORECASTS)


@pytest.mark.parametrize(
    ("shift", "evidence", "expected"), [(0.0, 5.0, 50.0), (3.0, 5.0, 0.0), (3.0, -5.0, 50.0), (0.1, 5.0, 50.0)]
)
def test_starts_miss_where_the_truth_leads_to_another_and_better_mode(small, monkeypatch, shift, evidence, expected):
    truth, sd = reference_coefficients(small), np.ones(9)
    problem = SimpleNamespace(runs=(), prior=None)
    mode = SimpleNamespace(
        choice=SimpleNamespace(fit=SimpleNamespace(coefficients=truth, sd=sd, log_evidence=0.0, problem=problem)),
        n_agreeing=1,
        n_starts=2,
    )
    best = SimpleNamespace(fit=SimpleNamespace(coefficients=truth + shift * sd, log_evidence=evidence))
    monkeypatch.setattr(frontier, "fit_with_noise", lambda *args: best)
    assert frontier._reaching(DataSet(small, Cell("white", ()), 0.01, 0, 1), mode)["reaching"] == expected


def made_up(estimator, values, cell="white", level=0.01):
    return [Measurement(cell, level, k, estimator, {"x": x}, np.full(2, x)) for k, x in enumerate(values)]


def test_the_error_of_a_mean_is_its_standard_error():
    values = np.random.default_rng(0).standard_normal(200)
    assert with_error(values, "mean")[1] == pytest.approx(values.std() / np.sqrt(200), rel=0.15)


@pytest.mark.parametrize(
    ("value", "verdict"), [(1.0, "yes"), (2.0, "yes"), (2.1, "no"), (np.inf, "no"), (np.nan, "no")]
)
def test_an_aim_is_met_within_its_limits_alone(monkeypatch, value, verdict):
    aim = Aim("x", "%", "white", ("fit",), "x", "median", {0.01: (1.0, 2.0)})
    monkeypatch.setattr(tables, "AIMS", (aim,))
    (row,) = aim_rows(made_up("fit", [value] * 3))
    assert row["met"] == verdict


def test_the_ratio_is_that_of_the_medians():
    found = made_up("a", [10.0, 20.0, 90.0]) + made_up("b", [4.0, 1.0, 5.0])
    assert with_error(over_seeds(found, "white", 0.01, ("a", "b"), "x"), "ratio")[0] == 5.0


def test_the_best_differencing_has_the_smallest_median():
    found = [
        replace(one, values={"median_error": one.values["x"]})
        for k, name in enumerate(DIFFERENCES)
        for one in made_up(name, [5.0 - k, 50.0, 5.0 - k])
    ]
    assert best_differencing(found, 0.01) == list(DIFFERENCES)[-1]


@pytest.mark.slow
def test_methods_are_compared_with_the_bound(whole):
    rows = bound_down_rows(whole)
    assert [row["times_bound"] for row in rows if row["method"] == METHODS["bound"]] == [1.0]
    assert all(row["by"] in DIFFERENCES for row in rows if row["method"] == METHODS["best differencing"])


def test_the_command_passes_its_options_on_and_prints_the_table(tmp_path, monkeypatch, capsys):
    called = []

    def reported_frontier(out, **settings):
        called.append((out, settings))
        return "| a |", tmp_path / "index.html"

    monkeypatch.setattr(frontier_report, "reported_frontier", reported_frontier)
    assert main(["frontier", "--seeds", "3", "--seed", "7", "--quiet", "--out", str(tmp_path)]) == 0
    ((out, settings),) = called
    settings.pop("progress")("unheard")
    assert (out, settings) == (str(tmp_path), {"seeds": 3, "seed": 7})
    assert capsys.readouterr() == ("| a |\n", "")


def test_one_seed_is_refused_in_a_sentence(tmp_path, capsys):
    assert main(["frontier", "--seeds", "1", "--out", str(tmp_path)]) == 2
    assert "two seeds or more, found 1" in capsys.readouterr().err
    assert list(tmp_path.iterdir()) == []


def test_a_place_that_cannot_be_written_is_refused_before_long_work(tmp_path, monkeypatch, capsys):
    def forbid(*args, **settings):
        raise AssertionError("long work has begun")

    monkeypatch.setattr(frontier_report, "frontier", forbid)
    (tmp_path / "file").write_text("kept")
    assert main(["frontier", "--out", str(tmp_path / "file" / "below")]) == 2
    assert "cannot be written" in capsys.readouterr().err
