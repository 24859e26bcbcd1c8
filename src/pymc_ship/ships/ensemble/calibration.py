"""Constants of the model error, calibrated on other ships; ``studies/population`` writes ``calibration.toml``."""

import datetime
import tomllib
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from types import MappingProxyType

FILE = Path(__file__).with_suffix(".toml")  # the file of the constants


@dataclass(frozen=True)
class Constant:
    """A calibrated constant."""

    about: str
    unit: str
    value: int | float | Mapping[str, float]  # by kind of index or by state where there are several
    study: str  # which names the ships of the calibration
    seeds: tuple[int, ...]  # of the study, empty if unknown
    commit: str  # first one of this package with the value
    date: datetime.date  # of the commit


@cache
def constants() -> Mapping[str, Constant]:
    """All constants by name, read once."""
    tables = tomllib.loads(FILE.read_text(encoding="utf-8"))
    calibration = {name: Constant(**table | {"seeds": tuple(table["seeds"])}) for name, table in tables.items()}
    return MappingProxyType(calibration)


def constant_value(name: str) -> float:
    """Value of a constant that is a number."""
    value = constants()[name].value
    if isinstance(value, Mapping):
        raise TypeError(f"The constant {name} has values by kind, found a use as one number; use constant_by_kind.")
    return value


def constant_by_kind(name: str) -> dict[str, float]:
    """Values of a constant that has one for each kind or state."""
    value = constants()[name].value
    if not isinstance(value, Mapping):
        raise TypeError(f"The constant {name} is one number, found a request by kind; use constant_value.")
    return dict(value)
