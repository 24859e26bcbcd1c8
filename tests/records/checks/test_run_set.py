"""Runs against each other: the same motion twice is named, two runs of one manoeuvre are not."""

from __future__ import annotations

from dataclasses import replace
from itertools import combinations

import numpy as np
import pytest

import pymc_ship as ps
from pymc_ship.physics.vessel.vessel import Windage
from pymc_ship.records.checks.run_set import contradicting_runs, cut_runs, repeated_runs, run_set_flags
from tests.records.checks.cases import changed, noisy, simulated, steered


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


@pytest.mark.parametrize(
    "rudder",
    [lambda delta: 0.9 * delta, lambda delta: delta + np.deg2rad(1.0), lambda delta: -delta],
)
def test_neither_another_rudder_indicator_nor_a_clock_hides_a_second_logger(run, rudder):
    second = noisy(run, 2)
    other = changed(second, delta=rudder(second["delta"].values))
    fast = other.assign_coords(time=1.01 * other["time"])
    for copy in (other, fast):
        (sentence,) = repeated_runs({"a": noisy(run), "b": copy})
        assert "Runs a and b are the same motion" in sentence


def mirrored(trial):
    return changed(trial, **{name: -trial[name].values for name in ("y", "psi", "v", "r", "p", "phi", "delta")})


def test_a_mirrored_copy_is_named_by_its_noise_and_a_run_to_the_other_side_is_not(run):
    trial = noisy(run)
    (sentence,) = repeated_runs({"a": trial, "b": mirrored(trial)})
    assert "mirror images with one noise" in sentence
    assert repeated_runs({"a": trial, "b": mirrored(noisy(run, 2))}) == []  # of a symmetric ship
    assert repeated_runs({"a": trial, "b": noisy(mirrored(run), 1)}) == []  # one seed


def test_yaw_rates_of_noise_alone_are_no_copies(run):
    rng = np.random.default_rng(3)
    still = [changed(run, r=1e-4 * rng.standard_normal(run.sizes["time"])) for _ in range(4)]
    assert repeated_runs(dict(zip("abcd", still, strict=True))) == []


def test_the_noise_of_one_seed_makes_no_copy_of_another_circle(container):
    runs = {angle: noisy(simulated(container, ps.turning_circle(float(angle))), 1, 0.03) for angle in ("20", "22")}
    assert repeated_runs(runs) == []


@pytest.mark.parametrize("wrong", [{"r": lambda r: 60.0 * r + 1e-3}, {"delta": np.sign}])
def test_a_copy_is_named_in_another_unit_and_with_another_rudder(run, wrong):
    trial = noisy(run)
    copy = changed(trial, **{name: change(trial[name].values) for name, change in wrong.items()})
    (sentence,) = repeated_runs({"a": trial, "b": copy.assign_coords(time=2.0 * copy["time"])})
    assert "Runs a and b are the same motion" in sentence


def test_a_short_overlap_of_two_files_is_named(run):
    trial = noisy(run)
    (sentence,) = repeated_runs({"a": trial.isel(time=slice(0, 1300)), "b": trial.isel(time=slice(1100, None))})
    assert "Runs a and b are the same motion" in sentence


@pytest.mark.parametrize("level", [0.0, 0.01])
def test_a_run_cut_in_two_is_named(run, container, level):
    trial = noisy(run, 1, level) if level else run
    begin, end = (trial.isel(time=part) for part in (slice(0, 900), slice(900, None)))
    end = changed(end, x=end["x"] - 900.0, psi=end["psi"] + 2.0 * np.pi)  # its own origin
    (sentence,) = cut_runs({"b": end, "a": begin})
    assert sentence.startswith("Run b goes on with run a")
    others = {"a": begin, "c": noisy(simulated(container, ps.zigzag(10, 10)), 3), "d": noisy(steered(container), 4)}
    assert cut_runs(others) == []


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


def test_the_flags_of_a_set_have_what_its_runs_show_together(tanker, tanker_runs):
    one = {"a": tanker_runs["z10"]}
    L = tanker.particulars.L
    assert run_set_flags(one, L) == {"record_verdict": "not checked", "record_remarks": ""}
    flags = run_set_flags(one | {"b": tanker_runs["z10"], "c": times(-1.0, "delta")(tanker_runs["z20"])}, L)
    assert flags["record_verdict"] == "doubtful"
    same, contradiction = flags["record_remarks"].splitlines()
    assert same.startswith("Runs a and b")
    assert contradiction.startswith("Run c contradicts")
