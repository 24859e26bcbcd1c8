"""The integrator with controlled error against those with fixed steps: orders, tolerance, switches and the gear."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import pymc_ship as ps
from pymc_ship.physics.motion import simulation
from pymc_ship.physics.motion.stepping import simulation_settings
from tests.physics.motion.test_simulation import CHANNELS, RAMP, only

MANOEUVRES = {
    "zigzag": ps.zigzag(20, 20),
    "turning circle": ps.turning_circle(35, side="starboard"),
    "programme": ps.rudder_programme([0.0, 10.0, 10.5, 40.0, 60.0], [0.0, 0.1, -0.3, 0.2, 0.2]),
    "rudder record": ps.rudder_programme([0.0, 10.0, 30.0], [0.05, 0.1, -0.3], rate_limited=False),
}
RATE = np.deg2rad(2.3)


def error(run, reference):
    """Largest difference of the motion, relative to the largest value of each channel."""
    return max(float(abs(run[c] - reference[c]).max() / abs(reference[c]).max()) for c in CHANNELS[:-1])


def order(errors, steps):
    """Slope of log error by log step."""
    return float(np.polyfit(np.log(steps), np.log(errors), 1)[0])


@pytest.fixture(scope="module")
def late(container):
    """The container ship with a delay between the switching heading and the rudder."""
    return replace(container, particulars=replace(container.particulars, rudder_delay=1.3))


@pytest.fixture(scope="module")
def references(late):
    return {
        name: ps.simulate(late, manoeuvre, duration=120.0, step=1.0, method="dop853", tolerance=1e-12)
        for name, manoeuvre in MANOEUVRES.items()
    }


@pytest.mark.parametrize("name", MANOEUVRES)
def test_a_smaller_tolerance_gives_a_smaller_error(late, references, name):
    runs = [
        ps.simulate(late, MANOEUVRES[name], duration=120.0, step=1.0, method="dop853", tolerance=tolerance)
        for tolerance in (1e-4, 1e-6, 1e-8)
    ]
    errors = [error(run, references[name]) for run in runs]
    assert errors[0] > 5.0 * errors[1] > 25.0 * errors[2]
    assert errors[2] < 1e-6


@pytest.mark.parametrize(
    ("method", "expected", "steps"), [("euler", 1, (0.1, 0.05, 0.025)), ("rk4", 4, (0.2, 0.1, 0.05))]
)
def test_fixed_steps_converge_to_it_at_their_order(container, method, expected, steps):
    """Along a rudder without a kink, and without terms that have one."""
    smooth = only(container, lambda dof, term: "|" not in term)
    reference = ps.simulate(smooth, RAMP, duration=60.0, step=1.0, method="dop853", tolerance=1e-13)
    settings = {"duration": 60.0, "record_interval": 1.0, "method": method}
    errors = [error(ps.simulate(smooth, RAMP, step=step, **settings), reference) for step in steps]
    assert order(errors, steps) == pytest.approx(expected, abs=0.15)


@pytest.mark.parametrize("name", MANOEUVRES)
def test_runge_kutta_steps_converge_to_it_in_every_manoeuvre(late, references, name):
    """To first order where a programme orders the rudder between two steps; the tolerance of dop853 is far below."""
    steps = (0.1, 0.05, 0.02, 0.01, 0.005)
    settings = {"duration": 120.0, "record_interval": 1.0, "method": "rk4"}
    errors = [error(ps.simulate(late, MANOEUVRES[name], step=step, **settings), references[name]) for step in steps]
    assert order(errors, steps) > 0.8
    assert errors[-1] < 0.1 * errors[0]
    assert (
        float(
            abs(ps.simulate(late, MANOEUVRES[name], step=0.005, **settings)["delta"] - references[name]["delta"]).max()
        )
        < 0.005 * RATE
    )


@pytest.mark.parametrize("name", ["zigzag", "turning circle"])
def test_runge_kutta_steps_have_the_impulse_of_a_rudder_that_kinks_between_them(late, references, name):
    """The chord of the rudder in a step alone, or of the heading, errs four times as much at least."""
    run = ps.simulate(late, MANOEUVRES[name], duration=120.0, step=0.1, record_interval=1.0, method="rk4")
    assert error(run, references[name]) < 4e-6


@pytest.mark.parametrize("angle", [5.0, 10.0, 20.0])
@pytest.mark.parametrize("name", ["container", "kvlcc2"])
def test_the_steps_of_a_forecast_have_the_indices_of_controlled_error(name, angle):
    vessel, zigzag = ps.load_vessel(name), ps.zigzag(angle, angle)
    duration, settings = 20.0 * vessel.particulars.ship_time, simulation_settings(vessel)
    ours = ps.indices(ps.simulate(vessel, zigzag, duration=duration, **settings))
    exact = {"step": settings["step"], "method": "dop853", "tolerance": 1e-11}
    theirs = ps.indices(ps.simulate(vessel, zigzag, duration=duration, **exact))
    for index, value in theirs.data_vars.items():  # the largest roll is the largest of the samples
        tolerance = 1e-4 if index == "maximum_roll_angle" else 3e-5
        np.testing.assert_allclose(ours[index], value, rtol=tolerance, err_msg=index)


@pytest.mark.parametrize("delay", [0.0, 0.13, 1.3])
def test_runge_kutta_switches_the_rudder_within_a_step(container, delay, monkeypatch):
    """Times that are no multiple of the step; between steps only, the rudder is late by up to one."""
    ship = replace(container, particulars=replace(container.particulars, rudder_delay=delay))
    settings = {"duration": 120.0, "record_interval": 0.5}
    exact = ps.simulate(ship, ps.zigzag(20, 20), step=0.5, method="dop853", **settings)["delta"]

    def off(step):
        return float(
            abs(ps.simulate(ship, ps.zigzag(20, 20), step=step, method="rk4", **settings)["delta"] - exact).max()
        )

    assert order([off(step) for step in (0.5, 0.25, 0.125)], (0.5, 0.25, 0.125)) > 1.8
    assert off(0.25) < 0.01 * 0.25 * RATE
    steering = simulation._steering
    monkeypatch.setattr(simulation, "_steering", lambda *given: steering(*given)._replace(within=0.0))
    assert off(0.25) > 0.1 * 0.25 * RATE


def test_euler_switches_the_rudder_between_steps(container):
    run = ps.simulate(container, ps.zigzag(20, 20), duration=60.0, step=0.5, method="euler")
    moved = np.abs(np.diff(run["delta"].values)) / (0.5 * RATE)
    begins = np.flatnonzero((moved[1:] > 0.0) & (moved[:-1] == 0.0)) + 1
    assert begins.size >= 1
    np.testing.assert_allclose(moved[begins], 1.0, rtol=1e-12)


def test_the_rudder_is_switched_a_delay_after_the_heading(late):
    """The kinks of the rudder, from its ramps on both sides, and the heading at the instant that led to each."""
    run = ps.simulate(late, ps.zigzag(15, 10), duration=120.0, step=0.01, method="dop853")
    time, delta = run["time"].values, np.rad2deg(run["delta"].values)
    moving = np.abs(np.diff(delta)) > 1e-9
    begins = np.flatnonzero(moving[1:] & ~moving[:-1])
    assert begins.size >= 2
    for sign, begin in zip((1.0, -1.0), begins, strict=False):
        ramp = begin + 20
        start = time[ramp] - abs(delta[ramp] - sign * 15.0) / np.rad2deg(RATE)
        heading = np.interp(start - 1.3, time, np.rad2deg(run["psi"].values))
        assert abs(heading) == pytest.approx(10.0, abs=1e-5)
        early = np.interp(start - 1.29, time, np.rad2deg(run["psi"].values))
        assert abs(early) != pytest.approx(10.0, abs=1e-5)


def test_the_gear_follows_orders_at_its_rate(container):
    """An order that jumps, one slower and one faster than the gear, one it meets on the way back."""
    programme = ps.rudder_programme([0.0, 20.0, 30.0, 40.0, 41.0, 50.0], [0.2, 0.2, 0.1, 0.1, -0.2, 0.3])
    run = ps.simulate(container, programme, duration=70.0, step=0.01, method="dop853")
    fine = ps.simulate(container, programme, duration=70.0, step=0.01, method="rk4")
    assert float(abs(run["delta"] - fine["delta"]).max()) < 0.011 * 0.3  # a step of the fastest order
    np.testing.assert_allclose(run["delta"].sel(time=[2.0, 19.0, 25.0]), [2.0 * RATE, 0.2, 0.15], atol=1e-12)
    assert float(abs(run["delta"].diff("time")).max()) <= 0.01 * RATE * (1.0 + 1e-9)


def test_a_rudder_that_follows_exactly_is_where_it_was_recorded(container):
    time, delta = np.arange(0.0, 30.5, 0.5), np.random.default_rng(5).uniform(-0.6, 0.6, 61)
    programme = ps.rudder_programme(time, delta, rate_limited=False)
    run = ps.simulate(container, programme, duration=40.0, step=0.1, method="dop853")
    np.testing.assert_allclose(run["delta"], np.interp(run["time"], time, delta), atol=1e-13)


def test_a_ship_that_leaves_the_range_is_nan_from_then_on(container):
    """Near the time of small Runge-Kutta steps; the other draw does not diverge."""
    reference = np.concatenate([container.coefficients(dof) for dof in container.dofs])
    draws = np.array([reference, 3.0 * np.abs(reference)])
    settings = {"duration": 60.0, "coefficients": draws, "record_interval": 0.5}
    run = ps.simulate(container, ps.turning_circle(35), step=0.5, method="dop853", **settings)
    steps = ps.simulate(container, ps.turning_circle(35), step=0.005, method="rk4", **settings)
    assert run["diverged"].values.tolist() == [False, True]
    assert steps["diverged"].values.tolist() == [False, True]
    assert float(run["diverged_at"][1]) == pytest.approx(float(steps["diverged_at"][1]), abs=0.02)
    gone = run["time"] >= run["diverged_at"][1]
    assert bool(np.isnan(run["psi"][1][gone]).all())
    assert bool(np.isfinite(run["psi"][1][~gone]).all())
    assert bool(np.isfinite(run["psi"][0]).all())


def test_a_run_says_how_it_was_integrated(container):
    run = ps.simulate(container, ps.zigzag(20, 20), duration=10.0, step=0.5, method="dop853")
    assert [run.attrs[name] for name in ("method", "step", "tolerance")] == ["dop853", 0.5, 1e-9]
    assert run.sizes["time"] == 20
    assert float(run["u"][0]) == container.particulars.nominal_speed
