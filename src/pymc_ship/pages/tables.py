"""Numbers as text and as cells of tables."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

Columns = dict[str, tuple[str, Callable[[Any], str]]]  # head and formatter of each column, by its key in the rows


@dataclass(frozen=True)
class Table:
    """Heads, numeric columns and formatted cells of a table."""

    heads: list[str]
    numeric: list[bool]
    cells: list[list[str]]


def number(digits: int = 3) -> Callable[[Any], str]:
    """Formatter with significant digits; a dash for NaN."""

    def formatter(value: Any) -> str:
        if not isinstance(value, int | float | np.number):
            return str(value)
        if not np.isfinite(value):
            return "–"
        text = f"{value + 0.0:.{digits}g}"
        if "e" in text and 1.0 <= abs(float(value)) < 1e5:
            text = f"{float(text):.0f}"
        mantissa, *exponent = text.split("e")
        return "e".join([mantissa.replace("-", "−"), *(str(int(power)) for power in exponent)])

    return formatter


def fixed_point(decimals: int) -> Callable[[Any], str]:
    """Formatter with decimals; a dash for NaN."""

    def formatter(value: object) -> str:
        if not isinstance(value, int | float | np.number) or not np.isfinite(value):
            return "–" if isinstance(value, float | np.floating) else str(value)
        rounded = round(float(value), decimals) + 0.0
        return f"{rounded:.{decimals}f}".replace("-", "−")

    return formatter


def at_least(decimals: int) -> Callable[[Any], str]:
    """Formatter with decimals; "< 0.01" for a positive value that would round to 0."""
    plain, least = fixed_point(decimals), 10.0**-decimals

    def formatter(value: Any) -> str:
        return f"< {plain(least)}" if 0.0 < value < 0.5 * least else plain(value)

    return formatter


def percent(fraction: float) -> str:
    """A fraction in percent, with the digits it has."""
    return f"{100.0 * fraction:g} %"


def rounded_percent(fraction: float) -> str:
    """A fraction in percent with two significant digits."""
    return f"{float(f'{100.0 * fraction:.2g}'):g} %"


def heads(form: Callable[[Any], str], **heads: str) -> Columns:
    """Columns of one formatter, each head by its key in the rows."""
    return {key: (head, form) for key, head in heads.items()}


def table(rows: Sequence[Mapping[str, Any]], columns: Columns) -> Table:
    """Format the given keys of rows under their heads."""
    return Table(
        [head for head, _ in columns.values()],
        [form is not str for _, form in columns.values()],
        [[form(row[key]) for key, (_, form) in columns.items()] for row in rows],
    )
