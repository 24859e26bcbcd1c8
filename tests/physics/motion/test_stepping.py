from __future__ import annotations

import numpy as np
import pytest

from pymc_ship.physics.motion.equations import STATE
from pymc_ship.physics.motion.replay import replay
from pymc_ship.physics.motion.sensitivities import sensitivities
from pymc_ship.physics.motion.stepping import in_range, simulation_settings
from pymc_ship.physics.vessel.vessel import reference_coefficients

NOMINAL = 8.0
HULL = np.rec.array([(NOMINAL, 0.01)], names="nominal_speed,slowest")[0]
STRAIGHT = np.array([NOMINAL, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0])


def with_state(name, value):
    state = STRAIGHT.copy()
    state[STATE.index(name)] = value
    return state


def within(state):
    """Whether the second of two ships is in range; the first is not."""
    return bool(in_range(np.column_stack([np.zeros(8), state]), HULL, 1))


def test_a_ship_on_a_straight_course_is_in_range():
    assert within(STRAIGHT)
    assert not in_range(np.column_stack([np.zeros(8), STRAIGHT]), HULL, 0)


@pytest.mark.parametrize(
    ("name", "inside", "outside"),
    [
        ("u", 0.011 * NOMINAL, 0.009 * NOMINAL),
        ("u", 4.99 * NOMINAL, 5.01 * NOMINAL),
        ("u", NOMINAL, -NOMINAL),
        ("v", 4.89 * NOMINAL, 4.91 * NOMINAL),
        ("phi", 1.57, 1.58),
        ("phi", -1.57, -1.58),
    ],
)
def test_the_range_ends_at_speeds_and_at_capsizing(name, inside, outside):
    assert within(with_state(name, inside))
    assert not within(with_state(name, outside))


@pytest.mark.parametrize("name", STATE[:6])
@pytest.mark.parametrize("value", [np.nan, np.inf, -np.inf])
def test_a_state_that_is_not_finite_is_out_of_range(name, value):
    assert not within(with_state(name, value))


@pytest.mark.parametrize("name", STATE[:6])
def test_simulator_and_sensitivities_have_one_range(container, name):
    """The heading, too, although none of the forces depends on it."""
    theta, delta = reference_coefficients(container), np.full(10, 0.1)
    for value, diverges in ((0.01 + 8.0 * (name == "u"), False), (np.nan, True)):
        start = with_state(name, value)
        run = replay(container, delta, start[None], theta[None], interval=0.5)
        motion, jacobian = sensitivities(container, delta, start, interval=0.5)
        assert [np.isnan(one).all() for one in (run, motion, jacobian)] == [diverges] * 3
        np.testing.assert_allclose(motion, run[:, 0], rtol=1e-12)


def test_the_interval_of_the_samples_follows_a_given_step(container):
    by_default, given = simulation_settings(container), simulation_settings(container, step=0.25, wind=(5.0, 0.0))
    assert by_default["step"] == pytest.approx(container.particulars.ship_time / 60)
    assert by_default["record_interval"] == by_default["step"] > 0.25
    assert given == {"step": 0.25, "record_interval": 0.25, "method": "rk4", "wind": (5.0, 0.0)}
    assert simulation_settings(container, step=0.1)["record_interval"] == pytest.approx(0.3)
    assert simulation_settings(container, step=0.5)["record_interval"] == 0.5
    assert simulation_settings(container, step=0.1, record_interval=0.1)["record_interval"] == 0.1
