"""Cells of a table: numbers as one array where a column has numbers alone, text where not."""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping, Sequence
from contextlib import suppress
from typing import NamedTuple

import numpy as np

MISSING_CELLS = frozenset(("", "-", "--", "---", "*", "nan", "na", "n/a", "#n/a", "null", "none"))
MISSING_CELLS |= {"#div/0!", "#value!", "#ref!", "#num!", "#name?", "--.-", "---.-"}
"""Cells, in lower case, that stand for a missing one."""

_WHOLE = re.compile(r"[-+]?(?:[1-9]\d{0,2}([.,])\d{3}(?:\1\d{3})*|\d{1,3})")  # in groups of one mark, or short
_PLAIN = str.maketrans({"\u2212": "-", "º": "°"} | dict.fromkeys("\u00a0\u2007\u2009\u202f", " "))

_THOUSANDS = re.compile(
    r"[-+]?\d{1,3}(?:([.,])\d{3}(?:\1\d{3})*(?!\1)[.,]\d*|([ '’])\d{3}(?:\2\d{3})*(?:[.,]\d*)?)"
)  # with both marks, or with spaces or apostrophes


class Numbers(NamedTuple):
    """Cells of a column of numbers, NaN where missing, and whether one has a decimal point."""

    values: np.ndarray
    has_point: bool


Cells = Numbers | list[str]


def number_columns(blocks: Iterable[Sequence[Sequence[str]]], columns: Iterable[int]) -> dict[int, Numbers]:
    """Those of some columns whose cells are numbers or missing, from blocks of rows, each as its columns.

    Without those whose points may all separate groups of three digits, as in 1.203: their text decides.
    """
    parts: dict[int, list[np.ndarray]] = {k: [] for k in columns}
    with_point, in_groups = set(), {*parts}
    for block in blocks:
        for k in list(parts):
            numbers = cell_numbers(block[k])
            if None in numbers:
                del parts[k]
                continue
            parts[k].append(np.array(numbers, dtype=float))
            if k not in with_point and any("." in cell for cell in block[k]):
                with_point.add(k)
            if k in in_groups and not all(_is_whole(cell.strip()) for cell in block[k]):
                in_groups.remove(k)
    found = {k: arrays for k, arrays in parts.items() if arrays and k not in with_point & in_groups}
    return {k: Numbers(np.concatenate(arrays), k in with_point) for k, arrays in found.items()}


def cells_of(texts: list[str]) -> Cells:
    """Cells of one column."""
    return number_columns([[texts]], [0]).get(0, texts)


def texts_of(cells: Cells) -> list[str]:
    """Text of each cell, empty where a number is missing."""
    if not isinstance(cells, Numbers):
        return cells
    end = "" if cells.has_point else ".0"
    return ["" if value != value else repr(value).removesuffix(end) for value in cells.values.tolist()]


def plain_text(text: str) -> str:
    """Text with usual minus signs, spaces and signs of degrees."""
    return text if text.isascii() else text.translate(_PLAIN)


def end_to_end(parts: Sequence[Cells]) -> Cells:
    """Cells of one column of several tables."""
    numbers = [part for part in parts if isinstance(part, Numbers)]
    if len(numbers) < len(parts):
        return [text for part in parts for text in texts_of(part)]
    return Numbers(np.concatenate([part.values for part in numbers]), any(part.has_point for part in numbers))


def among_missing(cells: Cells, begin: int, size: int) -> Cells:
    """Cells from a row on, in a column of this size whose others are missing."""
    if not isinstance(cells, Numbers):
        return [*[""] * begin, *cells, *[""] * (size - begin - len(cells))]
    values = np.full(size, np.nan)
    values[begin : begin + cells.values.size] = cells.values
    return cells._replace(values=values)


def number_of_different(cells: Cells) -> int:
    """Number of different cells."""
    return np.unique(cells.values).size if isinstance(cells, Numbers) else len({*cells})


def without_thousands(
    texts: Mapping[str, list[str]], joined: Mapping[str, str]
) -> tuple[dict[str, list[str]], dict[str, int], list[str]]:
    """Cells of columns without separators of groups of three digits, numbers of such cells, and columns in doubt.

    A file has one decimal mark: where other columns have the point alone, whole numbers such as 1,002 have groups. In
    doubt are those whose every cell may have groups, such as 1.203, in a file that shows no decimal mark.
    ``joined`` has the cells of each column as one text, also of those that are numbers.
    """
    plain, counts = dict(texts), {}
    marks = {name: {mark for mark in ",. '’" if mark in text} for name, text in joined.items()}
    decimal = {name: found & {",", "."} for name, found in marks.items()}
    groups = {name for name, cells in texts.items() if len(decimal[name]) == 1 and all(map(_is_whole, cells))}
    mixed = {name for name in groups if any(map(str.isdecimal, texts[name]))}
    is_shown = any(found for name, found in decimal.items() if name not in groups)
    are_thousands = not is_shown and any(_is_smoother(texts[name]) for name in mixed)
    for name, cells in texts.items():
        is_other = name in mixed and {",", "."} - decimal[name] in marks.values()
        is_whole = name in groups and (are_thousands or is_other)
        if not is_whole and (name in groups or (len(marks[name]) < 2 and decimal[name] == marks[name])):
            continue
        found = [(_WHOLE if is_whole else _THOUSANDS).fullmatch(cell) for cell in cells]
        if count := sum(one is not None and one.lastindex is not None for one in found):
            counts[name] = count
            plain[name] = [
                cell.replace(one[one.lastindex], "") if one and one.lastindex else cell
                for one, cell in zip(found, cells, strict=True)
            ]
    return plain, counts, [name for name in texts if name in groups - mixed and not (is_shown or counts)]


def _is_whole(cell: str) -> bool:
    """Whether a cell is a whole number, perhaps in groups of three digits, or missing."""
    return bool(_WHOLE.fullmatch(cell)) or cell.lower() in MISSING_CELLS


def _is_smoother(cells: Sequence[str]) -> bool:
    """Whether whole numbers with and without groups are closer to each other as thousands than as decimals."""
    known = [cell for cell in cells if _WHOLE.fullmatch(cell)]
    grouped = np.array([not cell.lstrip("+-").isdecimal() for cell in known])
    thousands = [float(re.sub("[,.]", "", cell)) for cell in known]
    decimals = [number / 1e3 ** sum(map(cell.count, ",.")) for number, cell in zip(thousands, known, strict=True)]
    steps = np.abs(np.diff([thousands, decimals]))[:, np.diff(grouped)]
    return bool(steps[0].sum() < steps[1].sum())


def cell_numbers(cells: Sequence[str]) -> list[float | None]:
    """Numbers of cells, fast if all are plain numbers."""
    joined = "".join(cells)
    if joined.isascii() and "_" not in joined:
        with suppress(ValueError):
            return list(map(float, cells))
    return [_number(cell.strip()) for cell in cells]


def _number(cell: str) -> float | None:
    """Number of a cell, such as 6.0e-2 or 6.0D-02, NaN for a missing one, None for text."""
    if cell.lower() in MISSING_CELLS:
        return np.nan
    if not cell.isascii() or "_" in cell:
        return None
    for text in (cell, cell.lower().replace("d", "e")):
        with suppress(ValueError):
            return float(text)
    return None
