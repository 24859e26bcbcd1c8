from __future__ import annotations

import numpy as np
import pytest

import pymc_ship as ps
from pymc_ship.manoeuvre.standard import rudder_command


@pytest.mark.parametrize(
    ("manoeuvre", "label"),
    [
        (ps.zigzag(20, 10), "zigzag 20/10 port"),
        (ps.zigzag(7.5, 5, side="starboard"), "zigzag 7.5/5 starboard"),
        (ps.turning_circle(), "turning circle 35 port"),
        (ps.rudder_programme([0.0, 1.0], [0.0, 0.1]), "rudder programme"),
    ],
)
def test_labels(manoeuvre, label):
    assert manoeuvre.label == label


@pytest.mark.parametrize(
    "constructor", [lambda side: ps.zigzag(20, 20, side=side), lambda side: ps.turning_circle(20, side=side)]
)
def test_a_positive_rudder_angle_turns_to_port(constructor):
    time = np.array([0.0, 5.0])
    np.testing.assert_allclose(rudder_command(constructor("port"), time), np.deg2rad([20.0, 20.0]))
    np.testing.assert_allclose(rudder_command(constructor("starboard"), time), np.deg2rad([-20.0, -20.0]))


def test_a_programme_is_linear_between_its_breakpoints_and_held_beyond():
    programme = ps.rudder_programme([0.0, 10.0, 30.0], [0.1, 0.3, -0.1])
    np.testing.assert_allclose(rudder_command(programme, np.array([0.0, 5.0, 20.0, 99.0])), [0.1, 0.2, 0.1, -0.1])


def test_a_manoeuvre_is_a_value():
    assert ps.zigzag(20, 20) == ps.zigzag(20.0, 20.0)
    assert len({ps.zigzag(20, 20), ps.zigzag(20, 20), ps.rudder_programme([0, 1], [0, 1])}) == 2


def test_a_programme_does_not_follow_the_arrays_it_was_made_from():
    delta = np.array([0.0, 0.1])
    programme = ps.rudder_programme([0.0, 1.0], delta)
    delta[:] = 9.0
    assert programme.delta == (0.0, 0.1)


@pytest.mark.parametrize("angle", [0.0, -20.0, 90.0, np.nan, np.inf])
def test_angles_are_magnitudes_below_a_right_angle(angle):
    with pytest.raises(ps.ManoeuvreError, match=r"rudder_deg is a magnitude.*found"):
        ps.zigzag(angle, 20.0)
    with pytest.raises(ps.ManoeuvreError, match=r"heading_deg is a magnitude.*found"):
        ps.zigzag(20.0, angle)
    with pytest.raises(ps.ManoeuvreError, match=r"rudder_deg is a magnitude.*found"):
        ps.turning_circle(angle)


def test_sides_are_port_and_starboard():
    with pytest.raises(ps.ManoeuvreError, match=r"'starboard' or 'port', found 'left'"):
        ps.zigzag(20.0, 20.0, side="left")
    with pytest.raises(ps.ManoeuvreError, match=r"'starboard' or 'port', found 'left'"):
        ps.turning_circle(20.0, side="left")


@pytest.mark.parametrize("speed", [0.0, -1.0, np.nan, np.inf])
def test_the_approach_speed_is_positive_and_finite(speed):
    for constructor in (
        lambda: ps.zigzag(20.0, 20.0, approach_speed=speed),
        lambda: ps.turning_circle(20.0, approach_speed=speed),
        lambda: ps.rudder_programme([0.0], [0.0], approach_speed=speed),
    ):
        with pytest.raises(ps.ManoeuvreError, match="approach speed must be positive and finite, found"):
            constructor()


@pytest.mark.parametrize(
    ("time", "delta", "message"),
    [
        ([], [], "one angle for each time, found shapes"),
        ([0.0, 1.0], [0.0], "one angle for each time, found shapes"),
        ([[0.0, 1.0]], [[0.0, 1.0]], "one angle for each time, found shapes"),
        ([0.0, 0.0], [0.0, 1.0], "increasing times"),
        ([1.0, 0.0], [0.0, 1.0], "increasing times"),
        ([0.0, np.nan], [0.0, 1.0], "finite, increasing times"),
        ([0.0, 1.0], [0.0, np.inf], "finite angles"),
    ],
)
def test_programmes_that_no_rudder_can_follow(time, delta, message):
    with pytest.raises(ps.ManoeuvreError, match=message):
        ps.rudder_programme(time, delta)
