"""Model error of the motion by lead time."""

from __future__ import annotations

import numpy as np
import pytest

import pymc_ship as ps
from pymc_ship.forecasting.motion_error import ERRING, Replayed, motion_error, with_motion_error
from pymc_ship.forecasting.motion_error import GROWTH as BEYOND
from pymc_ship.motion.equations import STATE

DRAWS, TIMES, RUNS = 40, 401, 300
GROWTH = {"u": 0.02, "v": 0.05, "r": 0.1, "psi": 0.1, "x": 0.2, "y": 0.2}
"""Sd of the prime error at 10 L/U."""


@pytest.fixture(scope="module")
def tanker():
    return ps.load_vessel("kvlcc2")


def time_of(vessel):
    return np.linspace(0.0, 10.0, TIMES) * vessel.particulars.ship_time


def units(vessel):
    L, U = vessel.particulars.L, vessel.particulars.nominal_speed
    return {"u": U, "v": U, "r": U / L, "psi": 1.0, "x": L, "y": L}


def replays(vessel, rng, growth=GROWTH, spread=1.0):
    """Ships that sail alike, and records that leave them with time; draws hold a part of it."""
    time, size, found = time_of(vessel), units(vessel), []
    share = time / time[-1]
    for _ in range(RUNS):
        truth = np.zeros((8, TIMES))
        states = np.repeat(truth[:, None], DRAWS, axis=1)
        for name in ERRING:
            sd = growth[name] * size[name]
            states[STATE.index(name)] += spread * sd * rng.standard_normal((DRAWS, 1)) * share
            truth[STATE.index(name)] = np.sqrt(1.0 + spread**2) * sd * rng.standard_normal() * share
        found.append(Replayed(time, states, truth, np.zeros(8)))
    return found


def test_the_error_beyond_the_draws_is_found_by_lead(tanker):
    found = motion_error(replays(tanker, np.random.default_rng(1)), tanker)
    assert found["lead"].values.tolist() == [0.0, 0.5, 1.0, 2.0, 3.0, 5.0, 7.0, 10.0]
    error = 4.0 / np.sqrt(2.0 * RUNS)
    for name in ERRING:
        for lead in (2.0, 5.0, 10.0):
            assert float(found[name].sel(lead=lead)) == pytest.approx(GROWTH[name] * lead / 10.0, rel=error), name


def test_chance_does_not_make_the_error_larger(tanker):
    """Eight replays that err as much at all leads: at 3 L/U the square is right on average, within four errors.

    The broken twin takes the largest that the leads up to there have shown.
    """
    rng, row, unit = np.random.default_rng(4), STATE.index("u"), units(tanker)["u"]
    shares, states, time = [], np.zeros((8, DRAWS, TIMES)), time_of(tanker)
    for _ in range(100):
        measured = np.zeros((8, 8, TIMES))
        measured[:, row] = 0.05 * unit * rng.standard_normal((8, TIMES))
        found = motion_error([Replayed(time, states, seen, np.zeros(8)) for seen in measured], tanker)["u"]
        places = np.searchsorted(time, found["lead"].values[:5] * tanker.particulars.ship_time - 1e-9)
        largest = np.mean((measured[:, row, places] / unit) ** 2, axis=0).max()
        shares.append(np.array([float(found.sel(lead=3.0)) ** 2, largest]) / 0.05**2)
        assert np.all(np.diff(found) >= 0.0)
    (mean, twin), error = np.mean(shares, axis=0), 4.0 * np.std(shares, axis=0) / np.sqrt(len(shares))
    assert mean == pytest.approx(1.0, abs=error[0])
    assert twin > 1.0 + 3.0 * error[1]


def test_bands_with_the_error_hold_new_runs_and_draws_alone_do_not(tanker):
    """Of 300 new runs 95 % lie inside the 95 % bands of heading, within four standard errors."""
    found = motion_error(replays(tanker, np.random.default_rng(1)), tanker)
    row = STATE.index("psi")

    def coverage(error):
        held = []
        for one in replays(tanker, np.random.default_rng(2)):
            drawn = with_motion_error(one.states, one.time, error, tanker)[row, :, -1]
            low, high = np.quantile(drawn, [0.025, 0.975])
            held.append(low <= one.measured[row, -1] <= high)
        return np.mean(held)

    se = np.sqrt(0.95 * 0.05 / RUNS)
    assert coverage(found) == pytest.approx(0.95, abs=4.0 * se)
    assert coverage(motion_error([], tanker)) < 0.95 - 8.0 * se


def test_the_noise_of_readings_is_no_error_of_the_motion(tanker):
    """The broken twin does not know of it, and counts it."""
    rng, noise = np.random.default_rng(3), 0.1 * np.array([*units(tanker).values()])
    rows = [STATE.index(name) for name in ERRING]
    blurred, unknown = [], []
    for one in replays(tanker, np.random.default_rng(1)):
        seen, sd = one.measured.copy(), np.zeros(8)
        seen[rows] += noise[:, None] * rng.standard_normal((len(rows), TIMES))
        sd[rows] = noise
        blurred.append(one._replace(measured=seen, noise_sd=sd))
        unknown.append(one._replace(measured=seen))
    found, twin = (motion_error(seen, tanker) for seen in (blurred, unknown))
    for name in ERRING:
        true, variance = GROWTH[name], 2.0 * GROWTH[name] ** 2 + 0.01  # of an error: ship, draws and reading
        error = 4.0 * variance * np.sqrt(2.0 / RUNS)
        assert abs(float(found[name].sel(lead=10.0)) ** 2 - true**2) < error, name
    assert float(twin["u"].sel(lead=10.0)) > 2.0 * float(found["u"].sel(lead=10.0))


def test_beyond_the_leads_that_were_seen_heading_and_track_go_on_to_err(tanker):
    found = motion_error(replays(tanker, np.random.default_rng(1)), tanker)
    states = np.zeros((8, DRAWS, 2 * TIMES))
    time = np.linspace(0.0, 20.0, 2 * TIMES) * tanker.particulars.ship_time
    drawn = with_motion_error(states, time, found, tanker).std(axis=1)
    for name, growth in (("psi", 2.0), ("v", 1.0)):
        row = STATE.index(name)
        assert drawn[row, -1] / drawn[row, TIMES - 1] == pytest.approx(growth, rel=0.02)


def test_the_error_grows_with_the_distance_from_the_runs(tanker):
    """A range beyond them from 5 L/U on: speeds err at once, the track the longer the ship stays there."""
    states, time = np.zeros((8, 400, TIMES)), time_of(tanker)
    unit, nothing = units(tanker), motion_error([], tanker)
    beyond = np.where(time >= time[TIMES // 2], 1.0, 0.0)
    found = with_motion_error(states, time, nothing, tanker, beyond).std(axis=1)
    assert not found[:, : TIMES // 2 - 1].any()
    for name, stayed in (("u", 1.0), ("v", 1.0), ("r", 1.0), ("psi", 5.0), ("x", 5.0), ("y", 5.0)):
        assert found[STATE.index(name), -1] == pytest.approx(BEYOND[name] * stayed * unit[name], rel=0.03), name
    held = motion_error(replays(tanker, np.random.default_rng(1)), tanker)
    near, far = (with_motion_error(states, time, held, tanker, k * beyond).std(axis=1) for k in (0.0, 30.0))
    row = STATE.index("u")
    assert far[row, -1] == pytest.approx(np.hypot(near[row, -1], 30.0 * BEYOND["u"] * unit["u"]), rel=0.03)


def test_runs_without_a_track_tell_nothing_of_it(tanker):
    seen = replays(tanker, np.random.default_rng(1))
    for one in seen:
        one.measured[STATE.index("x")] = np.nan
    found = motion_error(seen, tanker)
    assert float(found["x"].max()) == 0.0
    assert float(found["y"].max()) > 0.0


def test_no_held_out_run_no_error(tanker):
    found = motion_error([], tanker)
    states = np.ones((8, 3, 5))
    assert (found.sizes, list(found)) == ({"lead": 0}, list(ERRING))
    assert with_motion_error(states, np.arange(5.0), found, tanker) is states
