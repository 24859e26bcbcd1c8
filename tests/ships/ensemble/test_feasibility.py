"""Feasible models and models that diverge, each by the limit it exceeds."""

from __future__ import annotations

import numpy as np
import pytest

import pymc_ship as ps
from pymc_ship.physics.vessel.vessel import coefficient_names, reference_coefficients
from pymc_ship.ships.ensemble import feasibility as soundness
from pymc_ship.ships.ensemble.feasibility import first_failure, is_feasible
from tests.ships.identification.cases import tanker

UNSOUND = {
    "thrust that brakes a slow ship": {"XT": -94e-5},
    "sway force that grows with the drift": {"Yv": 0.2},
    "drift that drives the ship": {"Xvv": 0.4},
    "resistance that stops it in a turn only": {"Xvv": -0.2},
    "turn on the spot": {"Ngsincos": -0.02},
}


def changed(**values):
    names, row = coefficient_names(tanker()), reference_coefficients(tanker())
    for name, value in values.items():
        row[names.index(name)] = value
    return row


def extremes(row, manoeuvre, vessel=None):
    """Greatest speed over the approach speed and greatest L |r| / U that one ship reaches, or None if it diverges."""
    settings = {"duration": 2400.0, "step": 0.5, "method": "rk4"}
    run = ps.simulate(vessel or tanker(), manoeuvre, coefficients=row[None], **settings)
    if run["diverged"][0]:
        return None
    speed = np.hypot(run["u"], run["v"])
    return float(speed.max()) / 7.974, float((abs(run["r"]) * 320.0 / speed).max())


def test_the_shipped_model_is_feasible():
    feasible = is_feasible(tanker(), reference_coefficients(tanker())[None])
    assert feasible.dtype == bool
    assert feasible.tolist() == [True]


@pytest.mark.parametrize("name", UNSOUND)
def test_a_model_that_diverges_is_not_feasible(name):
    assert not is_feasible(tanker(), changed(**UNSOUND[name])[None])[0]


def test_each_row_is_tested_alone():
    rows = np.array([changed(), changed(**UNSOUND["turn on the spot"]), changed(Yv=-0.0225)])
    many = np.tile(rows, (12, 1))
    assert is_feasible(tanker(), many).tolist() == [True, False, True] * 12


def test_a_ship_may_diverge_in_one_manoeuvre_only():
    row = changed(**UNSOUND["resistance that stops it in a turn only"])
    assert extremes(row, ps.zigzag(20.0, 20.0)) is not None
    assert extremes(row, ps.turning_circle(35.0)) is None
    assert not is_feasible(tanker(), row[None])[0]


def test_the_speed_is_limited_by_the_approach_speed(monkeypatch):
    row = changed(Yv=0.15)
    fastest, _ = extremes(row, ps.zigzag(10.0, 10.0))
    assert fastest > 1.15
    assert not is_feasible(tanker(), row[None])[0]
    monkeypatch.setattr(soundness, "FASTEST", 2.0)
    assert is_feasible(tanker(), row[None])[0]


def test_the_radius_of_turn_is_limited(monkeypatch):
    row = changed(Ngsincos=-0.008)
    reached = [extremes(row, what) for what in (ps.zigzag(10.0, 10.0), ps.zigzag(20.0, 20.0), ps.turning_circle(35.0))]
    assert max(speed for speed, _ in reached) < 1.15
    assert max(rate for _, rate in reached) > 2.0
    assert not is_feasible(tanker(), row[None])[0]
    monkeypatch.setattr(soundness, "TIGHTEST", 0.4)
    assert is_feasible(tanker(), row[None])[0]


def test_a_model_valid_at_any_speed_may_turn_on_the_spot(monkeypatch):
    vessel = ps.with_terms(tanker(), "modular at any speed")
    row = reference_coefficients(vessel)
    assert max(extremes(row, what, vessel)[1] for what in soundness.STANDARD) > 2.0
    assert is_feasible(vessel, row[None])[0]
    assert first_failure(vessel, row) is None
    monkeypatch.setattr(soundness, "valid_at_any_speed", lambda _: False)
    assert not is_feasible(vessel, row[None])[0]
    assert "turns on a radius below 0.5 L" in str(first_failure(vessel, row))


def test_a_model_valid_at_any_speed_has_the_limit_of_speed():
    vessel = ps.with_terms(tanker(), "modular at any speed")
    row = reference_coefficients(vessel)
    row[coefficient_names(vessel).index("Xvv")] = 0.2
    assert extremes(row, ps.zigzag(20.0, 20.0), vessel)[0] > 1.15
    assert not is_feasible(vessel, row[None])[0]
