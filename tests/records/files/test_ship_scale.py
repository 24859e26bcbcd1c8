from __future__ import annotations

import numpy as np
import pytest

from pymc_ship.records.files.ship_scale import TIGHTEST_TURN, least_squares, ship_scale


def test_the_length_is_that_of_the_vessel_or_of_the_tightest_turn(zigzag_trial, container):
    known, guessed = ship_scale(zigzag_trial, container), ship_scale(zigzag_trial, None)
    assert (known.L, known.known, guessed.known) == (container.particulars.L, True, False)
    assert known.U == guessed.U
    rate = np.quantile(np.abs(zigzag_trial["r"]), 0.99)
    assert guessed.time == pytest.approx(TIGHTEST_TURN / rate, rel=0.1)


def test_errors_of_least_squares_are_those_of_repetitions():
    """200 repetitions: the standard deviation is known to 5 %, four times of that pass."""
    rng = np.random.default_rng(4)
    x, noise = rng.standard_normal(300), rng.standard_normal((200, 300))
    fits = [least_squares([x], 2.0 * x + row) for row in noise]
    slopes, errors = (np.array([float(fit[k][0]) for fit in fits]) for k in (0, 1))
    assert slopes.std() == pytest.approx(errors.mean(), rel=0.2)
    assert abs(slopes.mean() - 2.0) < 4.0 * errors.mean() / np.sqrt(200)
