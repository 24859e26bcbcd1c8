"""Ships of parts in motion: derivatives against differences, revolutions, wind and current as inputs."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import pymc_ship as ps
from pymc_ship.physics.motion.inputs import recorded_inputs
from pymc_ship.physics.motion.replay import replay
from pymc_ship.physics.motion.sensitivities import sensitivities
from pymc_ship.physics.vessel.parts import with_parts
from pymc_ship.physics.vessel.vessel import Windage, coefficient_names, reference_coefficients
from tests.physics.forces.test_parts import AHEAD, ANY_SPEED, ROLLING, tanker

SETTINGS = {"interval": 0.5, "method": "rk4"}
UNIT = np.array([7.0, 1.0, 0.01, 1.0, 1.0, 1.0, 100.0, 100.0])


def inputs(vessel):
    """A zigzag's rudder with revolutions and wind that change."""
    delta = ps.simulate(vessel, ps.zigzag(20, 20), duration=150, step=0.5, method="rk4")["delta"].values
    k = np.arange(delta.size)
    return np.array([delta, 1.0 + 0.3 * np.sin(0.05 * k), 0.5 + 0.0 * k, -0.8 + 0.002 * k])


def in_wind():
    """The tanker by terms, with the parts wind and constant force."""
    vessel = replace(ps.load_vessel("kvlcc2"), windage=Windage(1000.0, 3000.0))
    return with_parts(vessel, ("wind", "constant force"))


SHIPS = {
    "ahead": lambda: tanker((*AHEAD, "wind", "current", "constant force")),
    "any speed": lambda: tanker(ANY_SPEED),
    "with roll": lambda: tanker(ROLLING),
    "terms in wind": in_wind,
}


@pytest.mark.parametrize("name", SHIPS)
def test_derivatives_by_every_parameter_and_state_are_those_of_differences(name):
    vessel = SHIPS[name]()
    given, start = inputs(vessel), np.array([7.0, 0.3, 0.002, 0.0, 0.0, 0.3, 0.0, 0.0])
    rolls = "roll" in vessel.dofs
    start[3:5] = (0.01, 0.2) if rolls else 0.0
    sd = np.array([parameter.sd for parameter in vessel.parameters])
    linear = reference_coefficients(vessel)[: -sd.size]
    sd = np.concatenate([0.1 * np.abs(linear) + 1e-5, sd])
    theta = reference_coefficients(vessel) + 0.02 * sd
    _, jacobian = sensitivities(vessel, given, start, theta, **SETTINGS)
    point, unit = np.concatenate([theta, start]), np.concatenate([sd, UNIT])
    labels = [*coefficient_names(vessel), *"uvrp", "phi", "psi", "x", "y"]
    for k, label in enumerate(labels):
        if label in ("p", "phi") and not rolls:
            continue
        step = np.zeros(point.size)
        step[k] = 3e-5 * unit[k]
        ahead, back = (
            replay(vessel, given, end[None, sd.size :], end[None, : sd.size], **SETTINGS)[:, 0]
            for end in (point + step, point - step)
        )
        difference = (ahead - back) / (2.0 * step[k])
        size = np.abs(difference).max(axis=1, keepdims=True) + 1e-6 / unit[k]
        np.testing.assert_allclose(jacobian[:, :, k] / size, difference / size, atol=1e-4, err_msg=label)


def test_nominal_revolutions_and_no_wind_change_nothing():
    vessel = tanker((*AHEAD, "wind"))
    turn, settings = ps.turning_circle(35), {"duration": 300, "step": 0.5, "method": "rk4"}
    plain = ps.simulate(vessel, turn, **settings)
    same = ps.simulate(vessel, turn, n=vessel.propeller.n, wind=(0.0, 77.0), **settings)
    for name in ("u", "v", "r", "x", "y"):
        np.testing.assert_allclose(same[name], plain[name], rtol=0.0, atol=1e-9 * np.abs(plain[name]).max())


def test_more_revolutions_are_faster_and_head_wind_is_slower():
    vessel = tanker((*AHEAD, "wind"))
    straight, settings = ps.rudder_programme([0.0, 900.0], [0.0, 0.0]), {"duration": 600, "step": 0.5, "method": "rk4"}
    plain, fast, windy = (
        float(ps.simulate(vessel, straight, **settings, **around)["u"][-1])
        for around in ({}, {"n": 1.1 * vessel.propeller.n}, {"wind": (25.0, 0.0)})
    )
    assert windy < plain - 0.05
    assert fast > 1.05 * plain


def test_a_current_carries_the_track_and_nothing_else():
    vessel, turn = tanker(AHEAD), ps.turning_circle(20)
    settings = {"duration": 200, "step": 0.5, "method": "rk4"}
    plain, carried = ps.simulate(vessel, turn, **settings), ps.simulate(vessel, turn, current=(0.5, 90.0), **settings)
    np.testing.assert_array_equal(carried["u"], plain["u"])
    np.testing.assert_allclose(carried["y"] - plain["y"], 0.5 * plain["time"], rtol=1e-12)
    np.testing.assert_allclose(carried["x"], plain["x"], atol=1e-9)


def test_the_part_of_a_current_is_the_same_current_seen_over_ground():
    """Speeds over ground with the part; through the water with the simulator's current."""
    plain, U = tanker(AHEAD), tanker(AHEAD).particulars.nominal_speed
    drifting = with_parts(plain, (*AHEAD, "current"), {c.name: c for c in plain.parameters})
    theta = reference_coefficients(drifting)
    theta[-2:] = 0.3 / U, -0.4 / U
    water = ps.simulate(plain, ps.zigzag(20, 20), duration=300, step=0.5, method="rk4")
    start = np.zeros(8)
    start[:2] = U + 0.3, -0.4
    ground = replay(drifting, water["delta"].values, start[None], theta[None], **SETTINGS)[:, 0]
    t = water["time"].values
    np.testing.assert_allclose(ground[5], water["psi"], atol=2e-4)
    np.testing.assert_allclose(ground[6], water["x"] + 0.3 * t, atol=0.3)
    np.testing.assert_allclose(ground[7], water["y"] - 0.4 * t, atol=0.3)


def test_recorded_revolutions_and_wind_are_inputs():
    vessel = tanker((*AHEAD, "wind"))
    trial = ps.simulate(vessel, ps.zigzag(10, 10), duration=100, step=0.5)
    plain = recorded_inputs(trial, vessel)
    np.testing.assert_allclose(plain[1], 1.0, rtol=1e-3)
    np.testing.assert_array_equal(plain[2:], 0.0)
    wind = {"wind_speed": 5.0, "wind_direction": np.pi / 2.0}
    full = trial.assign({name: ("time", np.full(200, value)) for name, value in ({"n": 1.2} | wind).items()})
    recorded = recorded_inputs(full, vessel)
    np.testing.assert_allclose(recorded[1], 1.2 / vessel.propeller.n)
    np.testing.assert_allclose(recorded[3], -5.0 / vessel.particulars.nominal_speed)
    np.testing.assert_allclose(recorded[2], 0.0, atol=1e-12)


def test_wind_of_a_record_acts_on_a_ship_of_terms_with_the_part():
    vessel = in_wind()
    trial = ps.simulate(vessel, ps.zigzag(10, 10), duration=100, step=0.5)
    wind = {"wind_speed": 5.0, "wind_direction": 0.0}
    recorded = recorded_inputs(trial.assign({k: ("time", np.full(200, v)) for k, v in wind.items()}), vessel)
    np.testing.assert_allclose(recorded[2], -5.0 / vessel.particulars.nominal_speed)


def test_a_correction_of_the_nominal_revolutions_is_other_nominal_revolutions():
    vessel, turn = tanker(AHEAD), ps.turning_circle(20)
    known = {c.name: c for c in vessel.parameters}
    fewer = with_parts(vessel, AHEAD, known | {"n_0": replace(known["n_0"], value=0.9)})
    stated = replace(vessel, propeller=replace(vessel.propeller, n=0.9 * vessel.propeller.n))
    one, other, plain = (
        ps.simulate(ship, turn, duration=200, step=0.5, n=1.2)["u"].values for ship in (fewer, stated, vessel)
    )
    np.testing.assert_allclose(one, other, rtol=1e-12)
    assert np.abs(one - plain).max() > 0.1


def test_revolutions_of_an_unstated_propeller_are_those_of_the_begin_unless_the_nominal_ones_are_free():
    stated = tanker(AHEAD)
    vessel = with_parts(replace(stated, propeller=None, parts=(), parameters=()), AHEAD)
    known = with_parts(vessel, AHEAD, {c.name: c for c in vessel.parameters}, fixed=("n_0",))
    trial = ps.simulate(stated, ps.zigzag(10, 10), duration=100, step=0.5)
    n = np.linspace(1.2, 1.5, trial.sizes["time"])
    trial = trial.assign(n=("time", n))
    np.testing.assert_allclose(recorded_inputs(trial, known)[1], n / 1.2, rtol=1e-4)
    free = recorded_inputs(trial, vessel)[1]
    np.testing.assert_allclose(free / free[0], n / 1.2)
    assert abs(free[0] - 1.0) > 0.01
