import numpy as np
import pytest

from pymc_ship.pages.tables import fixed_point, heads, number, percent, table
from tests.sentences import refused

MINUS, DASH = "−", "–"


@pytest.mark.parametrize(
    ("digits", "value", "text"),
    [
        (3, 3.14159, "3.14"),
        (2, 0.0123456, "0.012"),
        (3, 0.0, "0"),
        (3, 254.09, "254"),
        (3, 7, "7"),
        (3, np.float32(2.5), "2.5"),
        (4, np.int64(12346), "12350"),
    ],
)
def test_number_keeps_significant_digits(digits, value, text):
    assert number(digits)(value) == text


@pytest.mark.parametrize(
    ("digits", "value", "text"),
    [(1, 2e2, "200"), (2, 254.09, "250"), (2, 2e2, "200"), (2, 98765.0, "99000"), (3, 99999.9, "100000")],
)
def test_number_writes_no_exponent_from_one_to_1e5(digits, value, text):
    assert number(digits)(value) == text


@pytest.mark.parametrize(
    ("value", "text"),
    [
        (1e5, "1e5"),
        (239908.87, "2.4e5"),
        (2.65e13, "2.6e13"),
        (1.9900060e-7, "2e-7"),
        (6.41025641e-06, "6.4e-6"),
        (1e-100, "1e-100"),
    ],
)
def test_number_writes_exponents_without_padding(value, text):
    assert number(2)(value) == text


def test_number_of_a_negative_value_has_a_minus_sign():
    assert number(3)(-226.2) == f"{MINUS}226"
    assert number(2)(-226.2) == f"{MINUS}230"
    assert number(2)(-0.5) == f"{MINUS}0.5"


def test_number_of_a_small_negative_value_has_the_same_minus_sign():
    assert number(2)(-4.4e-5)[:4] == f"{MINUS}4.4"


def test_a_value_that_rounds_to_zero_has_no_sign():
    assert fixed_point(2)(-0.001) == "0.00"
    assert number(3)(-0.0) == "0"


@pytest.mark.parametrize("value", [float("nan"), np.float64("nan"), np.float32("nan"), float("inf"), -np.inf])
def test_number_of_what_is_not_finite_is_a_dash(value):
    assert number()(value) == DASH


def test_number_passes_words_on():
    assert number()("published") == "published"


@pytest.mark.parametrize("value", [0.0, 1.0, 2e2, 0.0123, 1234.5, 99999.4, 1e5, 3.3e-9, 4.567e11])
@pytest.mark.parametrize("digits", [1, 2, 3, 4])
def test_number_is_read_back_to_its_digits(value, digits):
    """Half a unit of the last digit, for every magnitude; the broken twin has a digit less."""
    assert float(number(digits)(value)) == pytest.approx(value, rel=0.5 * 10.0 ** (1 - digits) + 1e-12, abs=0.0)


def test_reading_back_can_fail():
    assert float(number(1)(1234.5)) != pytest.approx(1234.5, rel=0.05)


@pytest.mark.parametrize(
    ("decimals", "value", "text"),
    [
        (0, 63.325, "63"),
        (1, 3180.92, "3180.9"),
        (2, -0.4, f"{MINUS}0.40"),
        (2, 7, "7.00"),
        (4, np.float64(1.0), "1.0000"),
    ],
)
def test_fixed_keeps_decimals(decimals, value, text):
    assert fixed_point(decimals)(value) == text


@pytest.mark.parametrize("value", [float("nan"), np.float64("nan"), float("inf")])
def test_fixed_of_what_is_not_finite_is_a_dash(value):
    assert fixed_point(2)(value) == DASH


def test_fixed_passes_words_on():
    assert fixed_point(2)("not reached") == "not reached"


@pytest.mark.parametrize(("share", "text"), [(0.95, "95 %"), (0.9, "90 %"), (0.005, "0.5 %"), (1.0, "100 %")])
def test_a_share_is_written_in_percent(share, text):
    assert percent(share) == text


COLUMNS = {
    "dof": ("DOF", str),
    "median": ("median %", number(2)),
    "rows": ("rows", str),
    "share": ("< 5 %", fixed_point(0)),
}


def test_a_table_picks_its_columns_in_their_order_and_marks_the_numeric_ones():
    rows = [
        {"share": 54.84, "median": 254.09, "dof": "surge", "rows": 400, "not_shown": 1.0},
        {"share": float("nan"), "median": -0.5, "dof": "sway", "rows": 400, "not_shown": 2.0},
    ]
    made = table(rows, COLUMNS)
    assert made.heads == ["DOF", "median %", "rows", "< 5 %"]
    assert made.numeric == [False, True, False, True]
    assert made.cells == [["surge", "250", "400", "55"], ["sway", f"{MINUS}0.5", "400", DASH]]


def test_a_table_without_rows_keeps_its_heads():
    made = table([], COLUMNS)
    assert made.cells == []
    assert len(made.heads) == len(made.numeric) == 4


def test_a_row_that_lacks_a_column_is_an_error():
    with refused(KeyError, "rows"):
        table([{"dof": "yaw", "median": 1.0, "share": 2.0}], COLUMNS)


def test_columns_of_one_formatter_keep_their_order_and_join_those_of_another():
    made = table([{"b": 1.0, "a": 2.0, "c": "x"}], heads(fixed_point(1), b="B", a="A %") | heads(str, c="C"))
    assert (made.heads, made.numeric, made.cells) == (["B", "A %", "C"], [True, True, False], [["1.0", "2.0", "x"]])
