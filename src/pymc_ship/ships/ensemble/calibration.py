"""Constants of the model error that other ships than the user's have chosen, with where each comes from.

``calibration.toml`` beside this file holds them; ``studies/population`` writes it.
"""

from __future__ import annotations

import datetime
import tomllib
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from types import MappingProxyType

FILE = Path(__file__).with_suffix(".toml")
"""The file of the constants."""


@dataclass(frozen=True)
class Constant:
    """A constant that a study chose.

    Attributes
    ----------
    about : str
        What it is.
    unit : str
    value : int, float or mapping of str to float
        By kind of index or by state where there is one for each.
    study : str
        The ships that chose it.
    seeds : tuple of int
        Roots of their random numbers; empty where none is known.
    commit : str
        Of this package, which has the value for the first time.
    date : date
        Of the commit.
    """

    about: str
    unit: str
    value: int | float | Mapping[str, float]
    study: str
    seeds: tuple[int, ...]
    commit: str
    date: datetime.date


@cache
def constants() -> Mapping[str, Constant]:
    """All constants by name, read once."""
    tables = tomllib.loads(FILE.read_text(encoding="utf-8"))
    found = {name: Constant(**table | {"seeds": tuple(table["seeds"])}) for name, table in tables.items()}
    return MappingProxyType(found)


def calibrated(name: str) -> float:
    """Value of a constant that is a number."""
    value = constants()[name].value
    if isinstance(value, Mapping):
        raise TypeError(f"The constant {name} has a value for each of {', '.join(value)}; ask for calibrated_by.")
    return value


def calibrated_by(name: str) -> dict[str, float]:
    """Values of a constant that has one for each kind or state."""
    value = constants()[name].value
    if not isinstance(value, Mapping):
        raise TypeError(f"The constant {name} is one number; ask for calibrated.")
    return dict(value)
