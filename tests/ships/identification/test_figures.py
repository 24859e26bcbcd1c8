"""Figures of an identified ship: what was held out, and differences of scores to the best."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from pymc_ship.pages import drawing
from pymc_ship.ships.identification import page as ship_report
from pymc_ship.ships.identification.figures import (
    held_out_overshoots,
    held_out_windows,
    restarted_motion,
    score_differences,
    term_set_scores,
)
from pymc_ship.ships.identification.page import term_set_rows
from tests.ships.identification.three_zigzags import model, runs


def test_held_out_windows_are_what_the_scores_are_made_of():
    best, trials = model().candidates[0], list(runs().values())
    square = [
        np.mean((window.means - forecast) ** 2, axis=1)
        for k in range(3)
        for window, forecast in held_out_windows(best, trials, k)
    ]
    assert np.sqrt(np.mean(square, axis=0)) == pytest.approx(list(best.held_out.rms.values()), rel=1e-12)
    windows = held_out_windows(best, trials, 1)
    time = np.concatenate([window.time for window, _ in windows])
    assert np.all(np.diff(time) > 0.0)
    assert time[-1] > 550.0
    second, _ = windows[1]
    v = np.interp(second.time, trials[1]["time"], trials[1]["v"])
    assert np.abs(second.means[1] - v).max() < 0.06


def test_a_name_with_dollars_is_no_formula():
    windows = held_out_windows(model().candidates[0], list(runs().values()), 0)
    assert "<svg" in drawing.svg(restarted_motion({r"$\no$": windows}), "windows")


def test_the_figure_shows_the_best_and_the_worst_run(monkeypatch):
    shown = {}
    monkeypatch.setattr(ship_report, "restarted_motion", lambda runs: shown.update(runs))
    monkeypatch.setattr(ship_report, "force_curves", lambda *_: None)
    ship_report._figures(model(), list(runs().values()), 3, None)
    density = model().candidates[0].held_out.log_density
    best, worst = (model().names[k] for k in (density.argmax(), density.argmin()))
    assert list(shown) == [f"{best}, the best forecast run", f"{worst}, the worst forecast run"]


def test_overshoots_stand_at_their_measured_values_with_bars_of_95_percent():
    index = model().held_out_indices.sel(index="first_overshoot_angle")
    ax = held_out_overshoots(model().held_out_indices).axes[0]
    points, _, (bars,) = ax.containers[0]
    assert points.get_xdata().tolist() == index["measured"].values.tolist()
    assert points.get_ydata().tolist() == index["forecast"].values.tolist()
    ends = np.array([segment[:, 1] for segment in bars.get_segments()])
    half = 1.959964 * index["sd"].values
    np.testing.assert_allclose(np.ptp(ends, axis=1), 2.0 * half, rtol=1e-6)
    assert ax.get_xlim() == ax.get_ylim()


def test_scores_are_differences_to_the_best_in_every_run():
    best, other = model().candidates
    lost = replace(other, held_out=replace(other.held_out, log_density=np.array([1.0, -np.inf, 2.0])), name="lost")
    found = score_differences([best, other, lost], np.random.default_rng(0))
    apart = other.held_out.log_density - best.held_out.log_density
    assert found[0]["differences"].tolist() == apart.tolist()
    assert found[0]["mean"] == pytest.approx(apart.mean())
    assert apart.min() < found[0]["lower"] < apart.mean() < found[0]["upper"] < apart.max()
    assert np.isnan([found[1][key] for key in ("mean", "lower", "upper")]).all()
    ax = term_set_scores(found, best.name).axes[0]
    assert [label.get_text() for label in ax.get_yticklabels()] == ["loading", "lost"]
    assert [note.get_text() for note in ax.texts] == ["a window diverged"]
    assert ax.get_lines()[1].get_xdata().tolist() == apart.tolist()


def test_a_term_set_that_ran_away_has_no_score():
    best, other = model().candidates
    lost = replace(other, held_out=replace(other.held_out, log_density=np.array([1.0, -np.inf, np.nan])))
    row = term_set_rows(replace(model(), candidates=(best, lost)))[1]
    assert (row["score"], row["to_best"]) == (-np.inf, -np.inf)
    assert np.isnan([row["rms_u"], row["rms_v"], row["rms_r"]]).all()
    ax = term_set_scores(score_differences([best, lost], np.random.default_rng(0)), best.name).axes[0]
    assert ax.get_xlim() == (-1.0, 0.1)
