from __future__ import annotations

import numpy as np
import pytest

from pymc_ship.machine.arguments import check_choice, finite_number, shown


class OddError(ValueError):
    pass


def test_a_choice_is_one_of_those_there_are():
    check_choice("The colour", "red", ("red", "blue"))
    check_choice("The colour", "red", {"red": 1, "blue": 2})


@pytest.mark.parametrize("value", ["green", "RED", None, 1, ["red"]])
def test_another_choice_is_told_with_rule_finding_and_remedy(value):
    with pytest.raises(OddError) as error:
        check_choice("The colour", value, ("red", "blue"), OddError)
    assert str(error.value) == f"The colour is one of red, blue; found {value!r}; choose one of them."


def test_signs_among_the_choices_are_quoted():
    with pytest.raises(ValueError, match=r"^The sign is one of ',', '\\t', tab; found '\|'; choose one of them\.$"):
        check_choice("The sign", "|", (",", "\t", "tab"))


@pytest.mark.parametrize("value", [2, 2.0, np.float32(2.0), np.int64(2)])
def test_a_number_comes_back_as_a_float(value):
    found = finite_number("The size", value, least=2.0)
    assert type(found) is float
    assert found == 2.0


@pytest.mark.parametrize("value", [True, "2", b"2", None, [2.0], {}, np.nan, -np.inf, 10**400])
def test_what_is_no_finite_number(value):
    with pytest.raises(OddError) as error:
        finite_number("The size", value, OddError)
    assert str(error.value) == f"The size must be a finite number, found {shown(value)}; correct it."


def test_a_number_may_have_a_least_value():
    with pytest.raises(ValueError, match=r"^The size must be a number from 0\.5 up, found 0\.4; correct it\.$"):
        finite_number("The size", 0.4, least=0.5)


@pytest.mark.parametrize("value", ["hull", 12.7, [12.7], True, {"a": 1}, None, (1, 2)])
def test_a_short_value_is_shown_as_it_is(value):
    assert shown(value) == repr(value)


@pytest.mark.parametrize(
    "value",
    ["y" * 5000, list(range(5000)), {k: k for k in range(5000)}, 10**4000, 16**9000],
    ids=lambda value: type(value).__name__,
)
def test_a_long_value_is_cut(value):
    assert len(shown(value)) <= 100
    assert len(shown([[[[[value]]]]])) <= 100
    assert len(shown([{str(k): {"x" * k: [k] * k for k in range(9)} for k in range(9)}])) <= 100
