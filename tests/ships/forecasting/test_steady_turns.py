"""Steady turns and the spiral."""

from dataclasses import replace

import numpy as np
import pytest

import pymc_ship as ps
from pymc_ship.physics.motion.stability import growth_rates
from pymc_ship.physics.vessel.vessel import coefficient_names, reference_coefficients
from pymc_ship.ships.forecasting.steady_turns import (
    RATES,
    largest_loop,
    spiral_curve,
    spiral_indices,
    spiral_sentence,
    steady_turns,
)
from tests.ships.ensemble.cases import ship_of


def turns_of(vessel, draws=None):
    return steady_turns(vessel if draws is None else ship_of((vessel, draws)))


@pytest.fixture(scope="module")
def kvlcc2():
    return ps.load_vessel("kvlcc2")


@pytest.mark.parametrize("kind", ["kvlcc2", "container", "parts"])
def test_a_simulated_turn_ends_on_the_curve(kind, kvlcc2):
    vessel = ps.with_terms(kvlcc2, "modular") if kind == "parts" else ps.load_vessel(kind)
    turns = turns_of(vessel).isel(draw=0)
    for side, sign in (("starboard", 1.0), ("port", -1.0)):
        run = ps.simulate(vessel, ps.turning_circle(20, side=side), duration=3000, step=0.5, method="rk4")
        half = turns.where(sign * turns["rate"] > 0.1, drop=True)
        order = np.argsort(half["delta"].values)
        for name, last in (("r", np.rad2deg(run["r"][-1])), ("speed", np.hypot(run["u"], run["v"])[-1])):
            interpolated = np.interp(-sign * 20.0, half["delta"].values[order], half[name].values[order])
            assert interpolated == pytest.approx(float(last), rel=5e-3)


def test_a_ship_has_a_loop_where_a_straight_course_is_unstable(kvlcc2):
    """Yaw damping from little to much: the loop ends where the growth of a disturbance changes its sign."""
    draws = np.tile(reference_coefficients(kvlcc2), (9, 1))
    column = coefficient_names(kvlcc2).index("Nr")
    draws[:, column] += np.linspace(0.001, -0.004, 9)
    names = coefficient_names(kvlcc2)
    draws[:, [names.index(name) for name in names if name[1:] in ("0", "|r|", "g|r|")]] = 0.0  # sides alike
    growth = growth_rates(kvlcc2, draws, kvlcc2.particulars.nominal_speed)
    spiral = spiral_indices(turns_of(kvlcc2, draws))
    unstable = spiral["loop_width"].values > 0.0
    np.testing.assert_array_equal(unstable, growth > 0.0)
    assert 2 < unstable.sum() < 8
    assert (np.diff(spiral["loop_width"].values[unstable]) < 0.0).all()
    sides = [spiral[f"residual_rate_{side}"].values[unstable] for side in ("starboard", "port")]
    np.testing.assert_allclose(*sides, rtol=1e-3)
    run = ps.simulate(
        kvlcc2,
        ps.rudder_programme([0, 600, 640, 6000], np.deg2rad([-20, -20, 0, 0])),
        duration=6000,
        step=0.5,
        coefficients=draws[:1],
    )
    assert sides[0][0] == pytest.approx(abs(np.rad2deg(run["r"].values[0, -1])), rel=0.02)


def test_a_rudder_beyond_its_range_is_not_shown(kvlcc2):
    turns = turns_of(kvlcc2)
    known = np.isfinite(turns["delta"].values)
    assert known[0, RATES.size // 2]
    assert not known[0, [0, -1]].any()
    assert np.abs(turns["delta"].values[known]).max() <= 40.0


def test_the_sentence_without_a_steady_course():
    vessel = ps.load_vessel("kvlcc2")
    lost = turns_of(vessel, np.full((1, reference_coefficients(vessel).size), np.nan))
    assert np.isnan(spiral_indices(lost)["loop_width"]).all()
    assert spiral_sentence(lost).startswith("No draw has a steady straight course")


def test_limits_of_the_loop():
    """IMO MSC/Circ.1053: none below 9 s, a third of L/U less 3, 12 deg from 45 s."""
    assert [largest_loop(unit) for unit in (5.0, 9.0, 30.0, 45.0, 100.0)] == [0.0, 0.0, 7.0, 12.0, 12.0]


def test_the_sentence_has_probabilities_and_widths(kvlcc2):
    draws = np.tile(reference_coefficients(kvlcc2), (400, 1))
    draws[:200, coefficient_names(kvlcc2).index("Nr")] -= 0.004
    text = spiral_sentence(turns_of(kvlcc2, draws))
    assert text.startswith("Course-stable with probability 0.50 by these draws; loop of the spiral 1.6 deg")
    assert "within the 10.4 deg of IMO MSC/Circ.1053 with probability more than 0.99" in text
    assert spiral_sentence(turns_of(kvlcc2, draws[:2])).endswith("no loop in the spiral.")
    assert spiral_sentence(turns_of(kvlcc2, draws[:2])).startswith("Course-stable with probability 0.75 by these draws")


def test_the_curve_is_drawn_against_the_rudder(kvlcc2):
    draws = np.tile(reference_coefficients(kvlcc2), (5, 1)) * np.random.default_rng(1).normal(1.0, 0.02, (5, 1))
    ax = spiral_curve(turns_of(kvlcc2, draws)).axes[0]
    assert ax.get_xlabel() == "rudder δ [deg], positive to port"
    median = ax.lines[0]
    assert median.get_xdata()[0] == median.get_xdata().max()
    assert ax.get_legend_handles_labels()[1] == ["95 % band", "median"]


def test_a_curve_of_ships_without_steady_turns_is_empty(kvlcc2):
    turns = turns_of(kvlcc2)
    turns = turns.assign({name: np.nan * turns[name] for name in ("delta", "r")})
    ax = spiral_curve(turns).axes[0]
    assert ax.get_legend_handles_labels()[1] == []
    assert ax.get_legend() is None
    assert "its course stability is unknown" in spiral_sentence(turns)


def test_models_are_pooled(kvlcc2):
    parts = ps.with_terms(kvlcc2, "modular")
    both = steady_turns(ship_of(kvlcc2, parts))
    assert both.sizes["draw"] == 2
    np.testing.assert_array_equal(both["delta"].values[1], turns_of(parts)["delta"].values[0])
    slower = replace(kvlcc2, particulars=replace(kvlcc2.particulars, nominal_speed=4.0))
    assert turns_of(slower).attrs["ship_time"] == pytest.approx(80.0)
