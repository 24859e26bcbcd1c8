"""Runs against each other: the same motion twice is named, two runs of one manoeuvre are not."""

from __future__ import annotations

from dataclasses import replace
from itertools import combinations

import numpy as np
import pytest

import pymc_ship as ps
from pymc_ship.physics.vessel.vessel import Windage
from pymc_ship.records.checks.run_set import contradicting_runs, repeated_runs
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


FLEET = {"z10": ps.zigzag(10, 10), "z20": ps.zigzag(20, 20, side="starboard"), "z15": ps.zigzag(15, 10)}


def fleet_run(vessel, manoeuvre, seed=1, level=0.01, **settings):
    ship_time = vessel.particulars.L / vessel.particulars.nominal_speed
    interval = round(ship_time / 30.0, 1)
    duration = interval * round(15.0 * ship_time / interval)
    run = ps.simulate(vessel, manoeuvre, duration=duration, record_interval=interval, method="rk4", **settings)
    return noisy(run, seed, level)


@pytest.fixture(scope="module")
def tanker():
    return ps.load_vessel("kvlcc2")


@pytest.fixture(scope="module")
def tanker_runs(tanker):
    return {name: fleet_run(tanker, manoeuvre, seed) for seed, (name, manoeuvre) in enumerate(FLEET.items())}


def test_runs_of_one_ship_do_not_contradict_each_other(tanker, tanker_runs):
    turn = fleet_run(tanker, ps.turning_circle(35), 3)
    slow = fleet_run(tanker, ps.zigzag(20, 20, approach_speed=5.0), 4)
    in_current = fleet_run(tanker, ps.zigzag(15, 15), 6, current=(0.5, 60.0))
    noisier = fleet_run(tanker, ps.zigzag(10, 5), 7, level=0.03)
    runs = tanker_runs | {"turn": turn, "slow": slow, "current": in_current, "noise": noisier}
    assert contradicting_runs(runs, tanker.particulars.L) == []
    for one, other in combinations(runs, 2):
        assert contradicting_runs({one: runs[one], other: runs[other]}, tanker.particulars.L) == []


def test_neither_do_runs_in_calm_and_in_wind(tanker):
    windage = Windage(frontal_area=1160.0, lateral_area=4260.0)
    vessel = ps.with_terms(replace(tanker, windage=windage), "modular at any speed")
    runs = {name: fleet_run(vessel, manoeuvre, 1, wind=(9.0, 60.0)) for name, manoeuvre in FLEET.items()}
    assert contradicting_runs(runs | {"calm": fleet_run(vessel, FLEET["z10"], 2)}, tanker.particulars.L) == []


@pytest.mark.parametrize("manoeuvre", [ps.zigzag(10, 10), ps.zigzag(20, 20)])
def test_a_run_of_another_ship_is_named(container, tanker, tanker_runs, manoeuvre):
    (sentence,) = contradicting_runs(tanker_runs | {"other": fleet_run(container, manoeuvre)}, tanker.particulars.L)
    assert "Run other contradicts the other runs" in sentence
    assert "another ship, loading or scale" in sentence


def times(factor, *names):
    return lambda trial: changed(trial, **{name: factor * trial[name] for name in names})


@pytest.mark.parametrize(
    ("wrong", "words"),
    [
        (times(-1.0, "delta"), "Most probably delta has the opposite sign: state sign = -1"),
        (times(-1.0, "v"), "Most probably v has the opposite sign: state sign = -1"),
        (times(-1.0, "r"), "Most probably r has the opposite sign: state sign = -1"),
        (times(2.0, "u", "v"), "another ship"),  # the U of another ship
        (times(0.4, "r"), "another ship"),  # the L of another ship
        (times(0.4, "delta"), "another ship"),
    ],
)
def test_a_wrong_channel_of_one_run_is_named(tanker, tanker_runs, wrong, words):
    runs = tanker_runs | {"wrong": wrong(fleet_run(tanker, ps.zigzag(20, 20), 9))}
    (sentence,) = contradicting_runs(runs, tanker.particulars.L)
    assert "Run wrong" in sentence
    assert words in sentence


def test_of_two_runs_both_are_named(container, tanker, tanker_runs):
    runs = {"a": tanker_runs["z20"], "b": fleet_run(container, ps.zigzag(20, 20))}
    (sentence,) = contradicting_runs(runs, tanker.particulars.L)
    assert sentence.startswith("Runs a, b contradict each other")


def test_runs_without_sway_or_at_rest_are_not_compared(tanker, tanker_runs):
    runs = {"a": tanker_runs["z10"].drop_vars("v"), "b": times(0.0, "u", "v")(tanker_runs["z20"])}
    assert contradicting_runs(runs | {"c": tanker_runs["z20"]}, tanker.particulars.L) == []
