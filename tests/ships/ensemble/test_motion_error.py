"""Model error of the motion by the time since a start."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.special import ndtri

import pymc_ship as ps
from pymc_ship.physics.motion.equations import STATE
from pymc_ship.ships.ensemble.motion_error import (
    ERROR_STATES,
    LEADS,
    MOTION_EXTRAPOLATION_SD,
    RISE,
    SIZES,
    TYPICAL,
    OpenLoopSimulation,
    mixture_quantiles,
    motion_error,
    motion_size,
    with_motion_error,
)

DRAWS, TIMES, RUNS = 200, 41, 300
GROWTH = {"u": 0.02, "v": 0.05, "r": 0.1, "psi": 0.1, "x": 0.2, "y": 0.2}
"""Sd of the prime error at 10 L/U."""

EXACT = {name: np.array([sd]) for name, sd in GROWTH.items()}


@pytest.fixture(scope="module")
def tanker():
    return ps.load_vessel("kvlcc2")


def time_of(vessel):
    return np.linspace(0.0, 10.0, TIMES) * vessel.particulars.ship_time


def units(vessel):
    L, U = vessel.particulars.L, vessel.particulars.nominal_speed
    return {"u": U, "v": U, "r": U / L, "psi": 1.0, "x": L, "y": L}


def replays(vessel, rng, growth=GROWTH, spread=0.2):
    """Equal simulations, and records whose error grows with time; draws contain a part of it."""
    time, size, simulations = time_of(vessel), units(vessel), []
    for _ in range(RUNS):
        truth = np.zeros((8, TIMES))
        states = np.repeat(truth[:, None], DRAWS, axis=1)
        for name in ERROR_STATES:
            sd, rise = growth[name] * size[name], (time / time[-1]) ** RISE[name]
            states[STATE.index(name)] += spread * sd * rng.standard_normal((DRAWS, 1)) * rise
            truth[STATE.index(name)] = np.sqrt(1.0 + spread**2) * sd * rng.standard_normal() * rise
        simulations.append(OpenLoopSimulation(time, states, truth, np.zeros((8, TIMES))))
    return simulations


def test_the_error_beyond_the_draws_is_estimated(tanker):
    """Of 300 runs the estimate is the true error; without an error beyond the draws it is small."""
    sizes = motion_error(replays(tanker, np.random.default_rng(1)), tanker)
    none = motion_error(replays(tanker, np.random.default_rng(1), growth=dict.fromkeys(ERROR_STATES, 1e-9)), tanker)
    for name in ERROR_STATES:
        assert sizes[name].shape == (SIZES,)
        assert np.all(np.diff(sizes[name]) >= 0.0)
        assert np.median(sizes[name]) == pytest.approx(GROWTH[name], rel=0.15), name
        assert np.quantile(none[name], 0.9) < TYPICAL[name], name


def test_one_simulation_leaves_the_law_wide(tanker):
    """One simulation with ten times the typical error moves the law, and leaves it wide."""
    time, states, measured = time_of(tanker), np.zeros((8, DRAWS, TIMES)), np.zeros((8, TIMES))
    measured[STATE.index("u")] = 10.0 * TYPICAL["u"] * units(tanker)["u"]
    ratios = (
        motion_error([OpenLoopSimulation(time, states, measured, np.zeros((8, TIMES)))], tanker)["u"] / TYPICAL["u"]
    )
    assert 1.0 < np.median(ratios) < 10.0
    assert np.quantile(ratios, 0.95) > 4.0 * np.median(ratios)


def test_widely_scattered_draws_give_no_information_on_the_error(tanker):
    """The broken twin, the excess of the squared error, is negative."""
    time, states = time_of(tanker), np.zeros((8, DRAWS, TIMES))
    wide = 100.0 * np.array([TYPICAL[name] * units(tanker)[name] for name in ERROR_STATES])
    states[[STATE.index(name) for name in ERROR_STATES]] = wide[:, None, None] * np.random.default_rng(
        1
    ).standard_normal((len(ERROR_STATES), DRAWS, 1))
    some, none = (
        motion_error(3 * [OpenLoopSimulation(time, states, np.zeros((8, TIMES)), np.zeros((8, TIMES)))], tanker),
        motion_error([], tanker),
    )
    for name in ERROR_STATES:
        assert np.median(some[name]) == pytest.approx(np.median(none[name]), rel=0.1), name
        excess = np.median(states[STATE.index(name), :, -1]) ** 2 - np.var(states[STATE.index(name), :, -1])
        assert excess < 0.0


def test_without_a_held_out_run_the_error_is_that_of_other_ships(tanker):
    sizes = motion_error([], tanker)
    for name in ERROR_STATES:
        assert np.median(sizes[name]) == pytest.approx(TYPICAL[name], rel=0.03)
        assert np.mean(sizes[name] > 5.0 * TYPICAL[name]) == pytest.approx(0.126, abs=0.01)  # half-Cauchy


def test_the_size_of_a_ship_is_that_of_heading_and_track(tanker):
    """1 without a held-out run; 300 runs show it, and other states do not change it."""
    assert motion_size(motion_error([], tanker)) == pytest.approx(1.0, rel=0.03)
    errors = motion_error(replays(tanker, np.random.default_rng(1)), tanker)
    ratios = [GROWTH[name] / TYPICAL[name] for name in ("psi", "x", "y")]
    assert motion_size(errors) == pytest.approx(np.prod(ratios) ** (1.0 / 3.0), rel=0.15)
    assert motion_size(errors | {"r": 9.0 * errors["r"]}) == motion_size(errors)
    one_large = {name: np.full(SIZES, TYPICAL[name] * (8.0 if name == "psi" else 1.0)) for name in ERROR_STATES}
    assert motion_size(one_large) == pytest.approx(2.0, rel=1e-12)


def test_bands_with_the_error_cover_new_runs_and_draws_alone_do_not(tanker):
    """Of 300 new runs 95 % lie inside the 95 % bands of heading, within four standard errors."""
    errors = motion_error(replays(tanker, np.random.default_rng(1)), tanker)
    row = STATE.index("psi")

    def coverage(error):
        inside = []
        for one in replays(tanker, np.random.default_rng(2)):
            drawn = with_motion_error(one.states, one.time, error, tanker)[row, :, -1]
            low, high = np.quantile(drawn, [0.025, 0.975])
            inside.append(low <= one.measured[row, -1] <= high)
        return np.mean(inside)

    se = np.sqrt(0.95 * 0.05 / RUNS)
    assert coverage(errors) == pytest.approx(0.95, abs=4.0 * se)
    assert coverage({}) < 0.95 - 8.0 * se


def test_the_noise_of_readings_is_no_error_of_the_motion(tanker):
    """The broken twin has no noise of readings and takes it for model error."""
    rng, noise = (
        np.random.default_rng(3),
        np.array([10.0 * TYPICAL[name] * units(tanker)[name] for name in ERROR_STATES]),
    )
    rows = [STATE.index(name) for name in ERROR_STATES]
    blurred, unknown = [], []
    for one in replays(tanker, np.random.default_rng(1), growth=dict.fromkeys(ERROR_STATES, 1e-9)):
        readings, sd = one.measured.copy(), np.zeros((8, TIMES))
        readings[rows] += noise[:, None] * rng.standard_normal((len(rows), TIMES))
        sd[rows] = noise[:, None]
        blurred.append(one._replace(measured=readings, noise_sd=sd))
        unknown.append(one._replace(measured=readings))
    errors, twin = (motion_error(records, tanker) for records in (blurred, unknown))
    for name in ERROR_STATES:
        assert np.median(errors[name]) < 1.1 * TYPICAL[name], name
        assert np.median(twin[name]) > 5.0 * TYPICAL[name], name


def test_errors_keep_growing_except_those_of_speeds(tanker):
    states, time = np.zeros((8, DRAWS, 3)), np.array([10.0, LEADS[-1], 4.0 * LEADS[-1]]) * tanker.particulars.ship_time
    drawn = with_motion_error(states, time, EXACT, tanker).std(axis=1)
    for name, longer in (("psi", 4.0), ("v", 1.0), ("x", 8.0)):
        first, at_20, later = drawn[STATE.index(name)]
        assert later / at_20 == pytest.approx(longer, rel=1e-6)
        assert at_20 / first == pytest.approx(2.0 ** RISE[name], rel=1e-6)


def test_the_error_grows_with_the_distance_from_the_runs(tanker):
    """One range beyond the runs from 5 L/U on: an error of speeds at once, of the track growing with time."""
    states, time = np.zeros((8, 400, TIMES)), time_of(tanker)
    unit = units(tanker)
    beyond = np.where(time >= time[TIMES // 2], 1.0, 0.0)
    sd = with_motion_error(states, time, {}, tanker, beyond).std(axis=1)
    assert not sd[:, : TIMES // 2 - 1].any()
    for name, stayed in (("u", 1.0), ("v", 1.0), ("r", 1.0), ("psi", 5.0), ("x", 5.0), ("y", 5.0)):
        assert sd[STATE.index(name), -1] == pytest.approx(
            MOTION_EXTRAPOLATION_SD[name] * stayed * unit[name], rel=0.04
        ), name
    near, far = (with_motion_error(states, time, EXACT, tanker, k * beyond).std(axis=1) for k in (0.0, 3.0))
    row = STATE.index("u")
    assert far[row, -1] == pytest.approx(
        np.hypot(near[row, -1], 3.0 * MOTION_EXTRAPOLATION_SD["u"] * unit["u"]), rel=0.05
    )


def test_the_growth_beyond_the_runs_is_a_law_over_draws(tanker):
    """Twice the growth is twice the error; of two growths the larger decides the tails."""
    states, time = np.zeros((8, 400, TIMES)), time_of(tanker)
    row, beyond = STATE.index("u"), np.ones(TIMES)
    one, twice, law = (
        with_motion_error(states, time, {}, tanker, beyond, growth)[row, :, -1]
        for growth in (1.0, 2.0, np.array([1.0, 50.0]))
    )
    np.testing.assert_allclose(twice, 2.0 * one, rtol=1e-3)
    assert np.quantile(law, 0.9) > 10.0 * np.quantile(one, 0.9)


def test_a_mixture_has_the_quantiles_of_its_draws():
    rng, sd, p = np.random.default_rng(1), np.array([0.1, 0.1, 1.0, 20.0]), np.array([0.025, 0.3, 0.5, 0.8, 0.99])
    drawn = rng.choice(sd, 400_000) * rng.standard_normal(400_000)
    expected = mixture_quantiles(sd, p)
    fractions = np.mean(drawn < expected[:, None], axis=1)
    np.testing.assert_allclose(fractions, p, atol=4.0 * 0.5 / np.sqrt(drawn.size))
    np.testing.assert_allclose(mixture_quantiles(np.array([2.0]), p), 2.0 * ndtri(p), rtol=1e-3, atol=1e-12)


def test_runs_without_a_track_give_no_information_on_it(tanker):
    simulations, none = replays(tanker, np.random.default_rng(1)), motion_error([], tanker)
    for one in simulations:
        one.measured[STATE.index("x")] = np.nan
    errors = motion_error(simulations, tanker)
    assert errors["x"].tolist() == none["x"].tolist()
    assert np.median(errors["y"]) > 10.0 * np.median(none["y"])


def test_no_error_leaves_the_motion(tanker):
    states = np.ones((8, 3, 5))
    np.testing.assert_array_equal(with_motion_error(states, np.arange(5.0), {}, tanker), states)
