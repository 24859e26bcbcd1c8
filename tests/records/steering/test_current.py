"""The current from a turn of two rounds."""

import numpy as np
import pytest

import pymc_ship as ps
from pymc_ship.records.steering.current import drift_current
from tests.ships.sea_trials.cases import CURRENT, run_record


@pytest.mark.parametrize(("side", "direction"), [("port", 20.0), ("starboard", 250.0)])
@pytest.mark.parametrize("rounds", [2, 3])
def test_a_turn_in_still_air_shows_the_current(side, direction, rounds):
    """The broken twin, the mean of the circular, has the error of the transient."""
    turn = run_record(ps.turning_circle(35, side=side), 2400, wind=None, current=(0.6, direction))
    turn = turn.sel(time=turn["time"][np.abs(turn["psi"].values) < 2.0 * np.pi * rounds])
    current = drift_current(turn)
    true = 0.6 * np.array([np.cos(np.deg2rad(direction)), np.sin(np.deg2rad(direction))])
    error = np.abs(current.velocity - true).max()
    assert error < 3.0 * current.sd.max() < 0.06
    assert np.abs(current.local.mean(axis=0) - true).max() > 2.0 * error
    assert current.speed == pytest.approx(0.6, abs=0.06)
    assert current.direction == pytest.approx(direction, abs=6.0)


def test_its_uncertainty_is_that_of_noisy_positions():
    """Over seeds 95 % of the errors are within two sd; within a tenth of it, the broken twin, few are."""
    turn = run_record(ps.turning_circle(35), 2400, wind=None)
    true, z = np.array([0.0, CURRENT[0]]), []
    for seed in range(20):
        rng = np.random.default_rng(seed)
        current = drift_current(
            turn.assign({name: turn[name] + 4.0 * rng.standard_normal(turn.sizes["time"]) for name in ("x", "y")})
        )
        z.append((current.velocity - true) / current.sd)
    inside = np.abs(z) < 2.0
    assert inside.mean() >= 0.95 - 2.0 * np.sqrt(0.95 * 0.05 / inside.size)
    assert np.mean(np.abs(z) < 0.2) < 0.8
