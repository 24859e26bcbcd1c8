"""SI units of the channels: spellings in files, Froude scaling and display units."""

from __future__ import annotations

import math
import re
from collections.abc import Mapping
from dataclasses import dataclass

_DEG, KNOT, _FOOT = math.pi / 180.0, 1852.0 / 3600.0, 0.3048


@dataclass(frozen=True)
class Unit:
    """An SI unit.

    Attributes
    ----------
    name : str
    spellings : mapping of str to float
        Factor to SI of each unit that a file may state, spelled as by :func:`spelling`.
    froude : float
        Exponent of the length scale from model to ship at equal Froude numbers.
    """

    name: str
    spellings: Mapping[str, float]
    froude: float

    def factor(self, stated: str) -> float | None:
        """Factor from a stated unit to this one; None for another quantity."""
        return self.spellings.get(spelling(stated))

    @property
    def display(self) -> str:
        """Unit on figures and tables: deg for rad."""
        return self.name.replace("rad", "deg")

    @property
    def display_factor(self) -> float:
        """Factor from this unit to the display unit."""
        return math.degrees(1.0) if "rad" in self.name else 1.0


_WORDS = {
    r"[\s_]per[\s_]": "/",
    r"_": "/",
    r"[°º]": "deg",
    r"\bdegrees?\b": "deg",
    r"\bradians?\b": "rad",
    r"\bsec(?:ond)?s?\b": "s",
    r"\bminutes?\b": "min",
    r"\bhours?\b": "h",
    r"\bmet(?:re|er)s?\b": "m",
    r"[\s·^*]|(?<!\d)\.|\.(?!\d)": "",  # a point between digits is decimal
    r"(s|min)-1$": r"/\1",
    r"^/": "1/",
}
"""Patterns in units, and what they are read as, in their order."""


def spelling(unit: str) -> str:
    """Unit in lower case, without brackets, spaces and multiplication signs; words and powers as symbols."""
    plain = unit.strip().strip("[](){}").lower()
    for pattern, symbol in _WORDS.items():
        plain = re.sub(pattern, symbol, plain)
    return plain


PURE_NUMBER = Unit("1", {"1": 1.0, "-": 1.0}, froude=0.0)
SECOND = Unit(
    "s",
    {"s": 1.0, "ms": 1e-3, "us": 1e-6, "µs": 1e-6, "ns": 1e-9, "min": 60.0, "h": 3600.0, "days": 86400.0},
    froude=0.5,
)
METRE = Unit(
    "m",
    {"m": 1.0, "mm": 1e-3, "km": 1e3, "ft": _FOOT} | dict.fromkeys(("nmi", "nauticalmiles"), 1852.0),
    froude=1.0,
)
METRE_PER_SECOND = Unit(
    "m/s",
    {"m/s": 1.0, "ft/s": _FOOT}
    | dict.fromkeys(("km/h", "kmh", "kph"), 1 / 3.6)
    | dict.fromkeys(("kn", "kt", "kts", "knot", "knots", "knt", "knts"), KNOT),
    froude=0.5,
)
RADIAN = Unit(
    "rad",
    {"rad": 1.0, "0.1deg": 0.1 * _DEG, "gon": 0.9 * _DEG}
    | dict.fromkeys(("deg", "deg/north", "deg/east", "deg/true", "degtrue", "degt"), _DEG),
    froude=0.0,
)
RADIAN_PER_SECOND = Unit(
    "rad/s",
    {"rad/s": 1.0, "deg/s": _DEG, "deg/min": _DEG / 60.0, "0.1deg/s": 0.1 * _DEG, "0.1deg/min": _DEG / 600.0},
    froude=-0.5,
)
REVOLUTION_PER_SECOND = Unit(
    "rev/s",
    dict.fromkeys(("rev/s", "rps", "hz", "1/s"), 1.0) | dict.fromkeys(("rpm", "rev/min", "1/min", "r/min"), 1 / 60.0),
    froude=-0.5,
)
NEWTON = Unit("N", {"n": 1.0, "kn": 1e3, "mn": 1e6}, froude=3.0)
NEWTON_METRE = Unit("N m", {"nm": 1.0, "knm": 1e3, "mnm": 1e6}, froude=4.0)
