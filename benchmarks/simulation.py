"""The ship: one run, a thousand runs, derivatives, and the simulator of shipmmg on the same vessel."""

from __future__ import annotations

import statistics
from collections.abc import Iterator

import numpy as np
from scipy.integrate import solve_ivp

import pymc_ship as ps
from benchmarks import kvlcc2
from benchmarks.table import Row, imported, median_seconds
from pymc_ship.physics.motion.replay import replay
from pymc_ship.physics.motion.sensitivities import sensitivities
from pymc_ship.physics.vessel.term_sets import with_terms
from pymc_ship.physics.vessel.vessel import reference_coefficients
from tests.physics.motion import plain_hull


def plain_zigzag(n_steps: int, step: float) -> np.ndarray:
    """Heading of the container ship's 20/20 zigzag to port by a loop over the plain equations of plain_hull."""
    state, delta, target = np.array([plain_hull.NOMINAL_SPEED, *[0.0] * 7]), 0.0, np.deg2rad(20.0)
    travel, heading = np.deg2rad(2.3) * step, np.empty(n_steps)
    for k in range(n_steps):
        heading[k] = state[5]
        if (target > 0.0 and state[5] <= -np.deg2rad(20.0)) or (target < 0.0 and state[5] >= np.deg2rad(20.0)):
            target = -target
        state = state + step * np.array(plain_hull.rate(state, delta))
        delta += min(max(target - delta, -travel), travel)
    return heading


def one_run(vessel) -> Iterator[Row]:
    """One 20000-step zigzag against a plain NumPy loop, and its rudder record against scipy."""
    manoeuvre = ps.zigzag(20, 20)
    ps.simulate(vessel, manoeuvre, duration=1)
    ours, trial = median_seconds(lambda: ps.simulate(vessel, manoeuvre, duration=400), 15)
    plain, heading = median_seconds(lambda: plain_zigzag(20000, 0.02))
    gap = np.abs(heading - trial["psi"].values).max()
    yield Row(
        "20/20 zigzag, 20000 Euler steps", ours, "the same in a NumPy loop", plain, "max |d psi| [rad]", gap, 1e-9
    )
    delta, time = trial["delta"].values, trial["time"].values
    programme = ps.rudder_programme(time, delta, rate_limited=False)
    ours, record = median_seconds(lambda: ps.simulate(vessel, programme, duration=400, step=0.1, method="rk4"), 15)
    start, span = [vessel.particulars.nominal_speed, *[0.0] * 7], (0.0, record["time"].values[-1])

    def rate(t, state):
        return plain_hull.rate(state, np.interp(t, time, delta))

    theirs, solution = median_seconds(lambda: solve_ivp(rate, span, start, rtol=1e-8, atol=1e-8), 3)
    gap = abs(solution.y[5, -1] - record["psi"].values[-1])
    peer = "scipy solve_ivp (RK45, rtol 1e-8)"
    yield Row("the same rudder record, RK4 at 0.1 s", ours, peer, theirs, "|d psi| at the end [rad]", gap, 1e-4)


def batch(vessel) -> Iterator[Row]:
    """A thousand posterior draws against one at a time; sixteen lanes against one lane, on one core."""
    rng = np.random.default_rng(0)
    reference = reference_coefficients(vessel)
    draws = reference * (1.0 + 0.01 * rng.standard_normal((1000, reference.size)))
    settings = {"duration": 400, "record_interval": 0.5}

    def alone(lanes):
        return [ps.simulate(vessel, ps.zigzag(10, 10), coefficients=draw[None], **settings) for draw in lanes]

    ours, many = median_seconds(lambda: ps.simulate(vessel, ps.zigzag(10, 10), coefficients=draws, **settings), 3)
    theirs, one = median_seconds(lambda: alone(draws[:50]))
    gap = max(np.abs(run["psi"].values[0] - many["psi"].values[k]).max() for k, run in enumerate(one))
    yield Row(
        "1000 draws x 20000 steps", ours, "one draw at a time (50, scaled)", 20 * theirs, "max |d psi| [rad]", gap, 1e-9
    )
    ours, lanes = median_seconds(lambda: ps.simulate(vessel, ps.zigzag(10, 10), coefficients=draws[:16], **settings), 5)
    theirs, one = median_seconds(lambda: alone(draws[:16]), 3)
    gap = max(np.abs(run["psi"].values[0] - lanes["psi"].values[k]).max() for k, run in enumerate(one))
    yield Row(
        "16 draws in the 16 lanes of one core", ours, "16 calls with one lane", theirs, "max |d psi| [rad]", gap, 1e-9
    )


def derivatives(vessel, trial) -> Iterator[Row]:
    """Sensitivities of 107 columns along 20000 steps against central differences of as many runs, side by side."""
    delta, start = trial["delta"].values, np.array([vessel.particulars.nominal_speed, 0.1, 0.0, 0.0, 0.0])
    point = np.concatenate([reference_coefficients(vessel), start])
    n = point.size - start.size
    widths = np.maximum(1e-4 * np.abs(point), 1e-7)
    points = np.concatenate([point + np.diag(widths), point - np.diag(widths)])
    for method in ("euler", "rk4"):
        settings = {"interval": 0.02, "method": method, "block": 10}

        def differences(settings=settings):
            plus, minus = np.split(replay(vessel, delta, points[:, n:], points[:, :n], **settings), 2, axis=1)
            return (plus - minus) / (2.0 * widths[:, None])

        sensitivities(vessel, delta[:20], start, **settings)
        replay(vessel, delta[:20], points[:1, n:], points[:1, :n], **settings)
        ours, (_, jacobian) = median_seconds(lambda s=settings: sensitivities(vessel, delta, start, **s), 9)
        theirs, expected = median_seconds(differences)
        expected = expected.transpose(0, 2, 1)
        gap = np.median(np.abs(jacobian - expected).max(axis=1) / np.abs(expected).max(axis=1))
        peer = "central differences, 214 runs in the lanes"
        yield Row(
            f"derivatives, 107 x 20000 steps, {method}", ours, peer, theirs, "median column's |d| / max", gap, 1e-3
        )


def parts() -> Iterator[Row]:
    """A ship of parts against one of 45 polynomial terms, the KVLCC2 both times: 8000 evaluations for each ship.

    The two ships take turns on one core; the check is that a lane is the ship alone.
    """
    modular, polynomial = with_terms(ps.load_vessel("kvlcc2"), "modular"), kvlcc2.vessel()

    def run(vessel, count):
        step = vessel.particulars.ship_time / 60.0
        theta = np.tile(reference_coefficients(vessel), (count, 1))
        settings = {"duration": 2000.0 * step, "step": step, "method": "rk4"}
        return ps.simulate(vessel, ps.zigzag(20, 20), coefficients=theta, **settings)["psi"].values

    for count, who in ((1, "one ship"), (16, "16 ships in the lanes of one core")):
        run(modular, count), run(polynomial, count)
        by_turns = [
            [median_seconds(lambda n=count, v=v: run(v, n))[0] for v in (modular, polynomial)] for _ in range(41)
        ]
        ours, theirs = (statistics.median(seconds) for seconds in zip(*by_turns, strict=True))
        psi = run(modular, count)
        gap = np.abs(psi[0] - run(modular, 1)[0]).max()
        what, peer = f"{who} by {len(modular.parameters)} parameters of parts", "by 45 polynomial terms"
        yield Row(what, ours, peer, theirs, "max |d psi| to one alone [rad]", gap, 1e-9)


def shipmmg() -> Iterator[Row]:
    """The simulator of shipmmg on a vessel both can express: see :mod:`benchmarks.kvlcc2`."""
    what, peer = "KVLCC2 model in 3 DOF, 200 s", "shipmmg simulate_mmg_3dof, rtol 1e-6"
    library = imported("shipmmg.mmg_3dof", what, peer)
    vessel, inputs = kvlcc2.vessel(), kvlcc2.shipmmg_inputs(library)
    time = np.arange(2001) * 0.1
    delta = np.deg2rad(20.0) * np.sin(2.0 * np.pi * time / 40.0)
    programme = ps.rudder_programme(time, delta, rate_limited=False)
    ps.simulate(vessel, programme, duration=1.0, step=0.1, method="rk4")
    ours, run = median_seconds(lambda: ps.simulate(vessel, programme, duration=200.1, step=0.1, method="rk4"), 15)
    propeller = np.full(time.size, kvlcc2.REVOLUTIONS)

    def theirs_run():
        settings = {"u0": kvlcc2.SPEED, "rtol": 1e-6, "atol": 1e-8}
        return library.simulate_mmg_3dof(*inputs, time, delta, propeller, **settings)

    theirs, solution = median_seconds(theirs_run, 3)
    heading = solution.sol(run["time"].values)[5]
    gap = np.abs(heading - run["psi"].values).max()
    note = (
        f"the same ship, rudder and accuracy: ours has {kvlcc2.n_terms()} terms and fixed Runge-Kutta steps, "
        "shipmmg the sines, roots and splines themselves and adaptive steps; no wake, no flow straightening, "
        "centre of gravity amidships, as both can express them"
    )
    yield Row(what, ours, peer, theirs, "max |d psi| [rad]", gap, 1e-4, note=note)
    rates = 4 * 2001 / ours, solution.nfev / theirs
    check = ("max |d psi| [rad]", gap, 1e-4, "/s")
    yield Row("the same, evaluations of the equations of motion", rates[0], peer, rates[1], *check)
