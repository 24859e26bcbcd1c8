from __future__ import annotations

import numpy as np
import pytest

import pymc_ship as ps
from pymc_ship.physics.manoeuvre.standard import written_manoeuvre
from tests.sentences import refused


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
    np.testing.assert_allclose(constructor("port").command(time), np.deg2rad([20.0, 20.0]))
    np.testing.assert_allclose(constructor("starboard").command(time), np.deg2rad([-20.0, -20.0]))


def test_a_programme_is_linear_between_its_breakpoints_and_constant_beyond():
    programme = ps.rudder_programme([0.0, 10.0, 30.0], [0.1, 0.3, -0.1])
    np.testing.assert_allclose(programme.command(np.array([0.0, 5.0, 20.0, 99.0])), [0.1, 0.2, 0.1, -0.1])


def test_a_manoeuvre_shows_itself_in_one_line():
    slow = ps.turning_circle(side="starboard", approach_speed=6.5)
    record = ps.rudder_programme(np.arange(500.0), np.linspace(-0.1, 0.2, 500), rate_limited=False)
    assert repr(ps.zigzag(20, 10)) == "<Manoeuvre: zigzag 20/10 port>"
    assert repr(slow) == "<Manoeuvre: turning circle 35 starboard, from 6.5 m/s>"
    angles = "500 angles of -5.73 to 11.5 deg up to 499 s"
    assert repr(record) == f"<Manoeuvre: rudder programme, {angles}, which the rudder follows exactly>"


@pytest.mark.parametrize(
    "manoeuvre", [ps.zigzag(20, 10), ps.zigzag(7.5, 5, side="starboard"), ps.turning_circle(side="starboard")]
)
def test_a_label_is_read_back(manoeuvre):
    assert written_manoeuvre(manoeuvre.label) == manoeuvre
    assert written_manoeuvre(manoeuvre.label.rsplit(maxsplit=1)[0]).side == "port"


_NO_LABELS = ("", "port", "zigzag", "zigzag 20", "zigzag a/b", "turning circle 35/35", "rudder programme", "spiral 20")


@pytest.mark.parametrize("text", _NO_LABELS)
def test_other_words_are_no_manoeuvre(text):
    assert written_manoeuvre(text) is None


@pytest.mark.parametrize(
    ("manoeuvre", "switch"),
    [
        (ps.zigzag(20, 10), (np.deg2rad(10.0), -1.0)),
        (ps.turning_circle(35), (np.inf, 1.0)),
        (ps.rudder_programme([0.0], [0.1]), (np.inf, 1.0)),
    ],
)
def test_the_rudder_is_reversed_where_the_kind_says_so(manoeuvre, switch):
    assert manoeuvre.switch == switch


def test_a_manoeuvre_is_a_value():
    assert ps.zigzag(20, 20) == ps.zigzag(20.0, 20.0)
    assert len({ps.zigzag(20, 20), ps.zigzag(20, 20), ps.rudder_programme([0, 1], [0, 1])}) == 2


def test_a_programme_does_not_follow_the_arrays_it_was_made_from():
    delta = np.array([0.0, 0.1])
    programme = ps.rudder_programme([0.0, 1.0], delta)
    delta[:] = 9.0
    assert programme.delta == (0.0, 0.1)


def test_a_text_is_no_angle_no_speed_and_no_flag():
    with refused(ps.SimulationError, "rudder_deg"):
        ps.zigzag("20", 20)
    with refused(ps.SimulationError, "speed"):
        ps.turning_circle(35, approach_speed="7")
    with refused(ps.SimulationError, "rate_limited", "no"):
        ps.rudder_programme([0.0, 1.0], [0.0, 0.1], rate_limited="no")
