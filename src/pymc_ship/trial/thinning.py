"""Long records thinned while they are read: of each so many rows, the median cell of every column."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from pymc_ship.trial.cells import MISSING_CELLS, Cells, Numbers, cell_numbers

MOST_ROWS = 400_000
"""Rows of a record that are not thinned: 11 hours at 10 Hz, whose check takes 1 GB. Ships move in seconds."""

MOST_CELLS = 24_000_000
"""Cells of a table that is not thinned."""

LARGEST = 1e30  # numbers from here up count as missing, numbers below its inverse as zero
_MOST_THINNED = 8_000_000  # cells of a table that is thinned


class Thinning(NamedTuple):
    """Number of rows of which one is left, and the columns whose cells are stamps or jump by a whole turn."""

    every: int
    clocks: frozenset[int]
    turning: frozenset[int]


def rows_for_one(rows: int, columns: int, whole: bool = True) -> int:
    """Rows of which one is left: an odd number, so that a median is a cell; 1 for a table that is read as it is.

    ``whole``: whether the file is small enough to be in memory as a whole.
    """
    if whole and rows <= MOST_ROWS and rows * columns <= MOST_CELLS:
        return 1
    least = max(-(-rows // MOST_ROWS), -(-rows * columns // _MOST_THINNED))
    return least + 1 - least % 2


def thinning_note(rows: int, every: int) -> str:
    """Sentence on a table of so many rows."""
    return (
        f"{rows} rows are thinned to {rows // every}: the median of each {every} in every column, of stamps and texts "
        "the middle one."
    )


def kept_rows(columns: Sequence[Cells], plan: Thinning) -> list[np.ndarray]:
    """Rows whose cells are left of each column, one of each ``plan.every``, of which the rows are a multiple."""
    known = [_known(cells) for cells in columns]
    stamped = np.sum([known[k] for k in plan.clocks], axis=0) if plan.clocks else np.ones(0)
    kept = []
    for k, cells in enumerate(columns):
        if k in plan.clocks:
            most = np.repeat(stamped.reshape(-1, plan.every).max(axis=1), plan.every)
            kept.append(_middle_rows(stamped == most, plan.every))
            continue
        numbers = cells.values if isinstance(cells, Numbers) else _numbers_of(cells, known[k])
        if numbers is None:
            kept.append(_middle_rows(known[k], plan.every))
            continue
        rows = _median_rows(np.where(known[k], numbers, np.nan), plan.every, k in plan.turning)
        wrong = (known[k] & ~np.isfinite(numbers)).reshape(-1, plan.every)  # cells that the reader refuses
        kept.append(np.where(wrong.any(axis=1), wrong.argmax(axis=1) + plan.every * np.arange(rows.size), rows))
    return kept


def thinned(columns: Sequence[Cells], plan: Thinning) -> list[Cells]:
    """Columns of which one row of each ``plan.every`` is left."""
    if plan.every == 1:
        return list(columns)
    return [
        cells._replace(values=cells.values[rows]) if isinstance(cells, Numbers) else [cells[k] for k in rows.tolist()]
        for cells, rows in zip(columns, kept_rows(columns, plan), strict=True)
    ]


def _known(cells: Cells) -> np.ndarray:
    """Mask of the cells that are not missing."""
    if isinstance(cells, Numbers):
        return np.abs(cells.values) < LARGEST
    return np.array([cell.strip().lower() not in MISSING_CELLS for cell in cells], dtype=bool)


def _numbers_of(texts: list[str], known: np.ndarray) -> np.ndarray | None:
    """Numbers by which texts are in order, NaN for others; None if most of the known ones are none."""
    numbers = np.array(cell_numbers([text.replace(",", ".") for text in texts]), dtype=float)
    return numbers if np.isfinite(numbers[known]).sum() > 0.5 * known.sum() else None


def _middle_rows(known: np.ndarray, every: int) -> np.ndarray:
    """Middle of the known rows of each block."""
    return _median_rows(np.where(known, np.arange(known.size), np.nan), every, False)


def _median_rows(numbers: np.ndarray, every: int, turning: bool) -> np.ndarray:
    """Row of the median of the known numbers of each block; of directions, from the gap that they jump over on."""
    blocks = numbers.reshape(-1, every)
    order = np.argsort(blocks, axis=1)
    count = np.isfinite(blocks).sum(axis=1)
    rank = np.maximum(count - 1, 0) // 2
    if turning:
        gaps = np.nan_to_num(np.diff(np.take_along_axis(blocks, order, axis=1), axis=1))
        begin = np.where(gaps.max(axis=1) > np.pi, gaps.argmax(axis=1) + 1, 0)
        rank = (begin + rank) % np.maximum(count, 1)
    within = np.take_along_axis(order, rank[:, None], axis=1)[:, 0]
    return every * np.arange(rank.size) + within
