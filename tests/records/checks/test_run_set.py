"""Runs against each other: the same motion twice is named, two runs of one manoeuvre are not."""

from __future__ import annotations

import numpy as np
import pytest

import pymc_ship as ps
from pymc_ship.records.checks.run_set import repeated_runs
from tests.records.checks.cases import changed, noisy, simulated


@pytest.fixture(scope="module")
def run(container):
    return simulated(container, ps.zigzag(20, 20))


def later(trial, seconds):
    return trial.assign_coords(time=trial["time"] + seconds)


@pytest.mark.parametrize("level", [0.0, 0.003, 0.03])
@pytest.mark.parametrize(
    "copy",
    [
        lambda trial, noise: noise(trial, 1),
        lambda trial, noise: noise(trial, 2),  # a second logger
        lambda trial, noise: noise(trial.isel(time=slice(150, None)), 2),
        lambda trial, noise: later(noise(trial.isel(time=slice(50, None, 2)), 2), 7.0),
    ],
)
def test_a_run_given_twice_is_named(run, copy, level):
    def noise(trial, seed):
        return noisy(trial, seed, level) if level else trial

    (sentence,) = repeated_runs({"a": noise(run, 1), "b": copy(run, noise)})
    assert "Runs a and b" in sentence


def test_a_shift_of_the_clock_is_stated(run):
    (sentence,) = repeated_runs({"a": run, "b": later(run, 3600.0)})
    assert "3.6e+03 s apart" in sentence


@pytest.mark.parametrize(
    "other",
    [
        ps.zigzag(20, 20, side="starboard"),
        ps.zigzag(20, 18),
        ps.zigzag(10, 10),
        ps.zigzag(18, 20),
        ps.turning_circle(20),
    ],
)
def test_other_runs_are_not(run, container, other):
    runs = {"a": noisy(run), "b": noisy(simulated(container, other), 2)}
    assert repeated_runs(runs) == []


def test_the_same_manoeuvre_with_the_rudder_a_second_late_is_another_run(run, container):
    """As a helmsman steers: 1 s of 80 s between reversals."""
    late = np.interp(run["time"] - 1.0 * (run["time"] > 60.0), run["time"], run["delta"])
    assert repeated_runs({"a": noisy(run), "b": noisy(changed(run, delta=late), 2)}) == []


def test_runs_without_a_rudder_are_not_compared(run):
    assert repeated_runs({"a": run.drop_vars("delta"), "b": run}) == []
