"""One task: its noise, its scores, and what fails in it."""

from __future__ import annotations

import numpy as np
import pytest

import pymc_ship as ps
from pymc_ship.experiments import task as task_module
from pymc_ship.experiments.task import METHODS, Task, measure_task, turn_error
from pymc_ship.physics.vessel.vessel import reference_coefficients


def test_methods_have_the_same_noise_and_everything_else_its_own(small):
    def first(manoeuvre="zigzag", noise="white", level=0.01, method="weak form", seed=0, root=7):
        runs = {"zigzag": ps.zigzag(20, 20), "turn": ps.turning_circle(35)}
        return Task(small, runs[manoeuvre], noise, level, method, seed, root, 60.0).rng().random()

    assert len({first(method=method) for method in METHODS}) == 1
    others = [first(seed=1), first(level=0.02), first(noise="offsets"), first(manoeuvre="turn"), first(root=8)]
    assert len({first(), *others}) == 6


def test_coefficients_that_are_not_finite_fail(small, monkeypatch):
    failed = np.full(reference_coefficients(small).size, np.nan)
    monkeypatch.setitem(METHODS, "weak form", lambda *_: task_module.Estimate(failed, failed, failed))
    found = measure_task(Task(small, ps.zigzag(20, 20), "white", 0.01, "weak form", 0, 1, 30.0))
    assert (found["status"], np.isnan(found["median_error"])) == ("failed", True)


def test_a_record_that_diverges_fails(small):
    wild = small.with_coefficients({"surge": np.array([5.0, *small.coefficients("surge").values[1:]])})
    found = measure_task(Task(wild, ps.zigzag(20, 20), "white", 0.01, "weak form", 0, 1, 400.0))
    assert found["status"] == "failed"
    assert "the record diverged at t = " in found["sentence"]


def test_a_ship_that_diverges_in_the_turn_has_coefficients_and_no_diameter(container, monkeypatch):
    wild = reference_coefficients(container)
    wild[0] = 5.0
    monkeypatch.setitem(METHODS, "weak form", lambda *_: task_module.Estimate(wild, wild - 9.0, wild + 9.0))
    found = measure_task(Task(container, ps.zigzag(20, 20), "white", 0.01, "weak form", 0, 1, 30.0))
    assert found["status"] == "diverged"
    assert "diverged in the turning circle 35 port at t = " in found["sentence"]
    assert np.isnan(found["tactical_diameter_error"])
    assert found["median_error"] == pytest.approx(0.0, abs=1e-9)
    assert found["coverage"] == 100.0


def test_the_error_of_the_turn_is_that_of_the_tactical_diameter(container):
    truth = reference_coefficients(container)
    for vessel in (container, ps.load_vessel("kvlcc2")):  # a tanker needs more than 400 s to turn by 180 deg
        assert turn_error(vessel, reference_coefficients(vessel))[0] == 0.0
    ships = np.stack([truth, 1.01 * truth])
    turned = ps.simulate(container, ps.turning_circle(35), duration=400.0, coefficients=ships, step=0.1, method="rk4")
    true, other = ps.indices(turned)["tactical_diameter"].values
    error, diverged_at = turn_error(container, ships[1])
    assert error == pytest.approx(100.0 * abs(other - true) / true, rel=1e-4)
    assert error > 0.1
    assert np.isnan(diverged_at)


@pytest.mark.parametrize("error", [MemoryError("much"), OSError(28, "No space left on device")])
def test_an_error_of_the_machine_is_no_result(small, monkeypatch, error):
    def fails(*_):
        raise error

    monkeypatch.setitem(METHODS, "weak form", fails)
    with pytest.raises(type(error)):
        measure_task(Task(small, ps.zigzag(20, 20), "white", 0.01, "weak form", 0, 1, 30.0))
