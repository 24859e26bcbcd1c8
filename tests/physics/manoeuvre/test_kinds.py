"""Kinds of manoeuvre: what one definition contains, and what is refused."""

from __future__ import annotations

from dataclasses import replace

import pytest

import pymc_ship as ps
from pymc_ship.physics.manoeuvre.kinds import UNITS
from pymc_ship.physics.manoeuvre.registry import KINDS, RUDDER_PROGRAMME, either, kind_named, register_manoeuvre
from pymc_ship.physics.manoeuvre.turning_circles import PULL_OUT, TURNING_CIRCLE
from pymc_ship.physics.manoeuvre.zigzags import ZIGZAG
from tests.sentences import refused


def test_the_standard_kinds_are_known_in_this_order():
    assert list(KINDS.values()) == [ZIGZAG, TURNING_CIRCLE, PULL_OUT, RUDDER_PROGRAMME]
    assert kind_named("zigzag") is ZIGZAG


@pytest.mark.parametrize(
    ("kind", "words", "metavar", "option"),
    [(ZIGZAG, "zigzag", "RUDDER/HEADING", "zigzag"), (TURNING_CIRCLE, "turning circle", "RUDDER", "turn")],
)
def test_a_kind_says_how_it_is_written(kind, words, metavar, option):
    assert (kind.words, kind.metavar, kind.option) == (words, metavar, option)
    assert kind.example.count("/") == metavar.count("/")


def test_these_indices_are_compared_on_held_out_runs():
    zigzag = ("first_overshoot_angle", "second_overshoot_angle", "first_overshoot_time", "second_overshoot_time")
    assert ZIGZAG.scored == (
        *zigzag,
        "initial_turning_time",
        "initial_turning_distance",
        "period",
        "maximum_roll_angle",
    )
    assert TURNING_CIRCLE.scored == ("advance", "transfer", "tactical_diameter", "maximum_roll_angle")
    assert RUDDER_PROGRAMME.scored == ()


@pytest.mark.parametrize("kind", [ZIGZAG, TURNING_CIRCLE])
def test_units_of_the_indices_are_those_of_their_names(kind):
    ends = {"angle": "deg", "time": "s", "distance": "m", "diameter": "m", "speed": "m/s", "rate": "deg/s"}
    for name, index in kind.indices.items():
        assert index.units == ends.get(name.split("_")[-1], index.units)
    assert set(UNITS.values()) == {*ends.values()}


@pytest.mark.parametrize("twin", [replace(ZIGZAG, option=""), replace(ZIGZAG, name="other")])
def test_a_name_and_an_option_belong_to_one_kind(twin):
    with refused(ps.SimulationError, "zigzag"):
        register_manoeuvre(twin)
    assert list(KINDS) == ["zigzag", "turning_circle", "pull_out", "rudder_programme"]


@pytest.mark.parametrize(
    ("names", "text"),
    [(["zigzag"], "a zigzag"), (["zigzag", "circle"], "a zigzag or a circle"), (["a", "b", "c"], "an a, a b or a c")],
)
def test_alternatives_are_joined(names, text):
    assert either(names) == text
