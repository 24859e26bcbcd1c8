from __future__ import annotations

import numpy as np
import pytest

from pymc_ship.trial.cells import (
    Numbers,
    among_missing,
    cells_of,
    end_to_end,
    number_columns,
    number_of_different,
    texts_of,
)


@pytest.mark.parametrize(
    ("texts", "values", "has_point"),
    [
        (["1", " 2 ", "-3"], [1.0, 2.0, -3.0], False),
        (["0.5", "", "n/a", "NaN"], [0.5, np.nan, np.nan, np.nan], True),
        (["1e-5", "6.0D-02"], [1e-5, 0.06], True),
        (["0.123", "1.203"], [0.123, 1.203], True),
    ],
)
def test_a_column_of_numbers_is_an_array(texts, values, has_point):
    cells = cells_of(texts)
    np.testing.assert_array_equal(cells.values, values)
    assert cells.has_point is has_point


@pytest.mark.parametrize("texts", [["1", "N"], ["1,5", "2"], ["08:00:00"], ["1_000"], ["1.203", "12"], ["53.1 N"]])
def test_a_column_with_other_cells_or_with_groups_of_three_digits_stays_text(texts):
    assert cells_of(texts) == texts


def test_one_other_cell_in_a_later_block_makes_the_whole_column_text():
    blocks = [(("0", "1"), ("0.5", "0.6")), (("2",), ("port",))]
    assert list(number_columns(blocks, [0, 1])) == [0]


def test_groups_of_three_digits_in_the_first_block_are_numbers_by_a_later_one():
    (cells,) = number_columns([(("1.203", "1.204"),), (("1.2", "7"),)], [0]).values()
    np.testing.assert_array_equal(cells.values, [1.203, 1.204, 1.2, 7.0])


def test_the_texts_of_numbers_are_their_cells():
    for texts in (["0.5", "", "1e-05"], ["7", "", "-12"]):
        assert texts_of(cells_of(texts)) == texts


def test_files_of_one_run_are_joined_as_numbers_or_as_text():
    first, second = cells_of(["0", "1"]), cells_of(["0.5", ""])
    joined = end_to_end([first, second])
    np.testing.assert_array_equal(joined.values, [0.0, 1.0, 0.5, np.nan])
    assert joined.has_point
    assert end_to_end([first, ["08:00"]]) == ["0", "1", "08:00"]
    np.testing.assert_array_equal(among_missing(first, 1, 4).values, [np.nan, 0.0, 1.0, np.nan])
    assert among_missing(["N"], 1, 3) == ["", "N", ""]


def test_missing_cells_count_as_one():
    assert number_of_different(Numbers(np.array([1.0, 1.0, np.nan, np.nan]), has_point=False)) == 2
    assert number_of_different(["a", "a", ""]) == 2
