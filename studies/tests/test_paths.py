"""Paths to the coefficients: each judged on the run it was not given, its failures told."""

from __future__ import annotations

import csv
from dataclasses import replace
from functools import cache

import numpy as np
import pytest

import pymc_ship as ps
from pymc_ship.cli.main import run_command
from pymc_ship.inference.trajectory import windows
from pymc_ship.machine.errors import FitError, TrialError
from pymc_ship.physics.vessel.vessel import reference_coefficients
from pymc_ship.ships.identification.held_out import score_folds
from studies import paths as ship_paths
from studies.paths import PATHS, compare_paths, regression_rows
from tests.ships.identification.three_zigzags import clean, kvlcc2, model, runs


@cache
def rows():
    return compare_paths(list(runs().values()), model().candidates[0].vessel, names=list(runs()))


def prepared():
    return ship_paths._prepared(list(runs().values()), model().candidates[0].vessel, "order_damped", list(runs()))


def test_every_path_is_scored_on_every_run():
    assert [row["path"] for row in rows()] == list(PATHS)
    assert all(np.isfinite(row["log_density"]) and row["remark"] == "" for row in rows())
    assert all((row["reached"], row["measured"]) == (21, 21) for row in rows())
    assert all(0.0 < row["first_overshoot_angle_mean"] <= row["first_overshoot_angle_max"] < 1.0 for row in rows())


def test_the_trajectory_path_is_that_of_the_ship():
    """Made anew it is what the identification found; given, it is taken as it is."""
    best = model().candidates[0]
    row = rows()[-1]
    assert row["log_density"] == pytest.approx(best.held_out.log_density.sum(), rel=1e-4)
    assert {name: row[f"rms_{name}"] for name in ("u", "v", "r")} == pytest.approx(best.held_out.rms, rel=1e-4)
    spoilt = replace(
        best.held_out, fits=tuple(replace(fit, coefficients=0.9 * fit.coefficients) for fit in best.held_out.fits)
    )
    given = compare_paths(list(runs().values()), best.vessel, trajectory=spoilt)[-1]
    assert given["log_density"] < row["log_density"] - 1.0
    again = score_folds(prepared().windows, best.vessel, spoilt.fits)
    assert given["log_density"] == pytest.approx(again.log_density.sum(), rel=1e-12)


def test_rows_of_a_regression_hold_for_the_reference_ship():
    vessel, trial = kvlcc2(), clean("b")
    reference = np.split(
        reference_coefficients(vessel), np.cumsum([len(vessel.terms(dof)) for dof in vessel.dofs])[:-1]
    )
    for by_speed in (True, False):
        found = regression_rows(trial, vessel, by_speed=by_speed)
        for dof, coefficients in zip(vessel.dofs, reference, strict=True):
            X, y = found[dof]
            inner = slice(20, -20)
            assert np.abs(X @ coefficients - y)[inner].max() < 0.08 * np.abs(y).max()


def test_rows_are_weighted_by_the_square_of_the_speed_at_their_time():
    vessel, trial = kvlcc2(), runs()["b"]
    speed = np.hypot(trial["u"].values, trial["v"].values) / vessel.particulars.nominal_speed
    assert speed.min() < 0.85
    plain, weighted = (regression_rows(trial, vessel, by_speed=by_speed) for by_speed in (False, True))
    for dof in vessel.dofs:
        assert len(plain[dof][1]) == trial.sizes["time"]
        np.testing.assert_allclose(weighted[dof][0], plain[dof][0] * speed[:, None] ** 2, rtol=1e-12, atol=1e-300)
        np.testing.assert_allclose(weighted[dof][1], plain[dof][1] * speed**2, rtol=1e-12)


def test_the_weights_are_what_sets_the_first_path_apart():
    assert rows()[0]["log_density"] != rows()[1]["log_density"]
    plain, n = prepared(), len(kvlcc2().terms("surge"))
    for path, by_speed in zip(PATHS[:2], (True, False), strict=True):
        found = next(iter(ship_paths._ESTIMATES[path](plain))).coefficients[:n]
        X, y = (
            np.concatenate(parts) for parts in zip(*(_surge(name, by_speed=by_speed) for name in "bc"), strict=True)
        )
        expected = ship_paths.empirical_bayes_mean(X, y, plain.prior.mean[:n], plain.prior.scale[:n])
        np.testing.assert_allclose(found, expected, rtol=1e-9)


def _surge(name, *, by_speed):
    return regression_rows(runs()[name], model().candidates[0].vessel, by_speed=by_speed)["surge"]


@pytest.mark.parametrize(("path", "same"), list(zip(PATHS, (1e-12, 1e-12, 1e-12, 0.02), strict=True)))
def test_a_fit_does_not_see_the_run_it_is_judged_on(path, same, monkeypatch):
    """Another first run changes every fit but the first; the trajectory fit begins elsewhere and is let settle."""
    monkeypatch.setattr(windows, "_CHANGE", 1e-4)
    before = prepared()
    trials = [before.trials[0].assign(r=1.1 * before.trials[0]["r"]), *before.trials[1:]]
    after = replace(before, trials=trials, windows=[ship_paths.prepared_windows(t, before.vessel) for t in trials])
    old, new = ([fit.coefficients for fit in ship_paths._ESTIMATES[path](one)] for one in (before, after))
    apart = [np.linalg.norm(b - a) / np.linalg.norm(a) for a, b in zip(old, new, strict=True)]
    assert apart[0] <= same * min(apart[1:])
    assert min(apart[1:]) > 1e-3


def test_a_path_that_runs_away_says_so(monkeypatch):
    wild = [ship_paths.Estimated(c * reference_coefficients(kvlcc2())) for c in (1.0, -40.0, 1.0)]
    monkeypatch.setitem(ship_paths._ESTIMATES, "weak form", lambda _: iter(wild))
    found = compare_paths(
        list(runs().values()), kvlcc2(), names=list(runs()), trajectory=model().candidates[0].held_out
    )
    row = found[PATHS.index("weak form")]
    assert row["log_density"] == -np.inf
    assert row["remark"] == "Fitted to the other runs, it cannot be simulated along b."
    assert np.isnan([row[f"rms_{name}"] for name in ("u", "v", "r")]).all()
    assert (row["reached"], row["measured"]) == (14, 21)
    assert np.isfinite([other["log_density"] for other in found if other is not row]).all()


def test_a_path_that_cannot_be_fitted_says_so(monkeypatch):
    def fails(_):
        raise FitError("No minimum was found.")
        yield

    monkeypatch.setitem(ship_paths._ESTIMATES, "weak form", fails)
    found = compare_paths(list(runs().values()), kvlcc2(), trajectory=model().candidates[0].held_out)
    row = found[PATHS.index("weak form")]
    assert (row["log_density"], row["remark"]) == (-np.inf, "It cannot be fitted: No minimum was found.")
    assert row.keys() == found[0].keys()


def test_a_single_run_cannot_be_left_out():
    with pytest.raises(TrialError, match="two runs or more, found 1"):
        compare_paths([runs()["a"]], kvlcc2())


@pytest.fixture
def command(tmp_path, monkeypatch):
    """Function that runs the command line on so many of the runs, with the ship identified before."""
    monkeypatch.setattr(ship_paths, "identify_ship", lambda *_, **__: model())
    files = [str(ps.write_trial(run, tmp_path / f"{name}.csv")) for name, run in runs().items()]
    words = ["--vessel", "kvlcc2", "--out", str(tmp_path / "out"), "--quiet"]
    return lambda n: run_command(ship_paths.parser(), ship_paths.paths, [*files[:n], *words])


def test_the_command_writes_every_path(command, tmp_path, capsys):
    assert command(3) == 0
    with (tmp_path / "out" / "paths.csv").open(encoding="utf-8", newline="") as file:
        found = list(csv.DictReader(file))
    for row, expected in zip(found, rows(), strict=True):
        assert row["path"] == expected["path"]
        assert float(row["log_density"]) == pytest.approx(expected["log_density"], rel=1e-3)
    assert f"On the terms of {model().candidates[0].name}:" in capsys.readouterr().out


def test_the_command_refuses_a_single_run_in_one_sentence(command, tmp_path, capsys):
    assert command(1) == 2
    assert "two runs or more, found 1" in capsys.readouterr().err
    assert not (tmp_path / "out" / "paths.csv").exists()
