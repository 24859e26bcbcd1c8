from __future__ import annotations

import pytest

from pymc_ship.machine.arguments import check_choice
from pymc_ship.machine.names import did_you_mean
from tests.sentences import refused

NAMES = ("heading", "kvlcc2", "--vessel")


@pytest.mark.parametrize(
    ("word", "name"), [("headng", "heading"), ("Heading", "heading"), ("kvlc2", "kvlcc2"), ("--vesel", "--vessel")]
)
def test_a_misspelt_name_has_a_nearest_one(word, name):
    assert did_you_mean(word, NAMES) == f" (did you mean {name}?)"


def test_two_names_as_near_are_no_hint():
    assert did_you_mean("basin C", ("basin A", "basin B")) == ""
    assert did_you_mean("basin B1", ("basin A", "basin B")) == " (did you mean basin B?)"


@pytest.mark.parametrize("word", ["rudder", "", 3, None, "heading" * 1000])
def test_another_word_has_none(word):
    assert did_you_mean(word, NAMES) == ""


def test_a_choice_names_the_nearest():
    with refused(ValueError, "headin", "heading"):
        check_choice("The channel", "headin", NAMES)
