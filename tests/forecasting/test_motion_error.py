"""Model error of the motion by lead time."""

from __future__ import annotations

import numpy as np
import pytest

import pymc_ship as ps
from pymc_ship.forecasting.motion_error import ERRING, Replayed, motion_error, with_motion_error
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
        found.append(Replayed(time, states, truth))
    return found


def test_the_error_beyond_the_draws_is_found_by_lead(tanker):
    found = motion_error(replays(tanker, np.random.default_rng(1)), tanker)
    assert found["lead"].values.tolist() == [0.0, 0.5, 1.0, 2.0, 3.0, 5.0, 7.0, 10.0]
    error = 4.0 / np.sqrt(2.0 * RUNS)
    for name in ERRING:
        for lead in (2.0, 5.0, 10.0):
            assert float(found[name].sel(lead=lead)) == pytest.approx(GROWTH[name] * lead / 10.0, rel=error), name


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


def test_beyond_the_leads_that_were_seen_heading_and_track_go_on_to_err(tanker):
    found = motion_error(replays(tanker, np.random.default_rng(1)), tanker)
    states = np.zeros((8, DRAWS, 2 * TIMES))
    time = np.linspace(0.0, 20.0, 2 * TIMES) * tanker.particulars.ship_time
    drawn = with_motion_error(states, time, found, tanker).std(axis=1)
    for name, growth in (("psi", 2.0), ("v", 1.0)):
        row = STATE.index(name)
        assert drawn[row, -1] / drawn[row, TIMES - 1] == pytest.approx(growth, rel=0.02)


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
