from __future__ import annotations

import numpy as np
import pytest

from pymc_ship.machine.arguments import check_choice, check_flags, finite_number, label_array, real_array, short_repr
from tests.sentences import refused


class OddError(ValueError):
    pass


def test_a_choice_is_one_of_those_there_are():
    check_choice("The colour", "red", ("red", "blue"))
    check_choice("The colour", "red", {"red": 1, "blue": 2})


@pytest.mark.parametrize("value", ["green", "a red one", None, 1, ["red"]])
def test_another_choice_is_told_with_rule_finding_and_remedy(value):
    with pytest.raises(OddError) as error:
        check_choice("The colour", value, ("red", "blue"), OddError)
    assert str(error.value) == f"The colour is one of red, blue; found {value!r}; choose one of them."


@pytest.mark.parametrize("value", [2, 2.0, np.float32(2.0), np.int64(2)])
def test_a_number_comes_back_as_a_float(value):
    found = finite_number("The size", value, least=2.0)
    assert type(found) is float
    assert found == 2.0


@pytest.mark.parametrize("value", [True, "2", b"2", None, [2.0], {}, np.nan, -np.inf, 10**400])
def test_what_is_no_finite_number(value):
    with pytest.raises(OddError) as error:
        finite_number("The size", value, OddError)
    assert str(error.value) == f"The size must be a finite number, found {short_repr(value)}; correct it."


@pytest.mark.parametrize("value", ["hull", 12.7, [12.7], True, {"a": 1}, None, (1, 2)])
def test_a_short_value_is_shown_as_it_is(value):
    assert short_repr(value) == repr(value)


@pytest.mark.parametrize(
    "value",
    ["y" * 5000, list(range(5000)), {k: k for k in range(5000)}, 10**4000, 16**9000],
    ids=lambda value: type(value).__name__,
)
def test_a_long_value_is_cut(value):
    assert len(short_repr(value)) <= 100
    assert len(short_repr([[[[[value]]]]])) <= 100
    assert len(short_repr([{str(k): {"x" * k: [k] * k for k in range(9)} for k in range(9)}])) <= 100


@pytest.mark.parametrize(
    "values",
    [
        [1, 2, 3],
        np.array([1, 2, 3], dtype=np.int8),
        np.array([1.0, 2.0, 3.0], dtype=object),
        np.array([1.0, 2.0, 3.0], dtype=np.float32),
        np.ma.array([1.0, 2.0, 3.0], mask=False),
    ],
)
def test_real_numbers_come_back_as_a_new_array_of_floats(values):
    found = real_array("The size", values)
    assert (found.dtype, found.tolist(), type(found)) == (np.dtype(float), [1.0, 2.0, 3.0], np.ndarray)
    assert not np.shares_memory(found, values)


def test_nan_is_for_the_caller():
    assert np.isnan(real_array("The size", [np.nan, 1.0])).tolist() == [True, False]


class Lazy:
    """An array of dask, whose conversion by NumPy drops the mask."""

    def __init__(self, values):
        self.values = values

    def compute(self):
        return self.values

    def __array__(self, dtype=None, copy=None):
        return np.asarray(self.values, dtype)


MASKED = np.ma.masked_greater([1.0, 9.96921e36, 2.0], 1e30)


@pytest.mark.parametrize(
    ("values", "found"),
    [
        (MASKED, "1 masked; fill the gaps or leave them out"),
        ([MASKED, MASKED], "2 masked; fill the gaps or leave them out"),
        ([1.0, np.ma.masked], "1 masked; fill the gaps or leave them out"),
        ([1.0, None], "1 missing; fill the gaps or leave them out"),
        (Lazy(MASKED), "1 masked; fill the gaps or leave them out"),
        (np.array([1.0, np.ma.masked], dtype=object), "1 missing; fill the gaps or leave them out"),
        (np.array([1.0 + 2.0j]), "complex values; convert them"),
        (np.array([1.0, 2.0j], dtype=object), "complex values; convert them"),
        (["1", "2"], "texts; convert them"),
        (np.array(["2026-01-01"], dtype="datetime64[s]"), "dates; convert them"),
        (np.array([1, 2], dtype="timedelta64[s]"), "durations; convert them"),
        ([[1.0], [1.0, 2.0]], "[[1.0], [1.0, 2.0]]; convert them"),
    ],
)
def test_what_is_no_array_of_real_numbers(values, found):
    with pytest.raises(OddError) as error:
        real_array("The size", values, OddError)
    assert str(error.value) == f"The size must be real numbers, found {found}."


@pytest.mark.parametrize("values", [["a", "1"], ("a", 1), np.array(["a", "1"]), np.array(["a", 1], dtype=object)])
def test_labels_come_back_as_a_new_array_of_texts(values):
    found = label_array("The run", values)
    assert (found.dtype.kind, found.tolist()) == ("U", ["a", "1"])
    assert not np.shares_memory(found, values)


@pytest.mark.parametrize(
    ("values", "found"),
    [
        (np.ma.masked_equal([1, 2, 2], 2), "2 masked"),
        (["a", None], "1 missing"),
        ([np.nan, 1.0], "1 missing"),
        (np.array(["a", np.ma.masked], dtype=object), "1 missing"),
    ],
)
def test_what_is_no_label(values, found):
    with pytest.raises(OddError) as error:
        label_array("The run", values, OddError)
    assert str(error.value) == f"The run must be labels, found {found}; fill the gaps or leave them out."


def test_a_flag_is_true_or_false():
    check_flags(first=True, second=np.bool_(False))
    for value in ("no", 1, None, [True]):
        with refused(OddError, "progress"):
            check_flags(OddError, progress=value)
