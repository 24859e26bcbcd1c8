"""Columns of a trial file: which channel a heading names, in which unit, and the factor to SI."""

from __future__ import annotations

import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from pymc_ship.trial.record import EXTRA_UNITS, UNITS, TrialError

SI = {"time": "s", **UNITS, **EXTRA_UNITS}
"""Time and every channel that is read, with its SI unit."""

_DEG, _KNOT, _FOOT = math.pi / 180.0, 1852.0 / 3600.0, 0.3048

FACTORS = {
    "s": {"s": 1.0, "sec": 1.0, "second": 1.0, "seconds": 1.0, "ms": 1e-3, "min": 60.0, "minutes": 60.0, "h": 3600.0},
    "m": {"m": 1.0, "metre": 1.0, "metres": 1.0, "meter": 1.0, "meters": 1.0, "mm": 1e-3, "km": 1e3, "ft": _FOOT},
    "m/s": {"m/s": 1.0, "ms-1": 1.0, "km/h": 1 / 3.6, "ft/s": _FOOT}
    | dict.fromkeys(("kn", "kt", "kts", "knot", "knots"), _KNOT),
    "rad": {"rad": 1.0, "radian": 1.0, "radians": 1.0} | dict.fromkeys(("deg", "degree", "degrees"), _DEG),
    "rad/s": {"rad/s": 1.0, "rads-1": 1.0, "rad/sec": 1.0, "deg/min": _DEG / 60.0}
    | dict.fromkeys(("deg/s", "degs-1", "deg/sec", "degree/s", "degrees/s", "degrees/sec"), _DEG),
    "rev/s": dict.fromkeys(("rev/s", "rps", "hz", "1/s", "s-1"), 1.0)
    | dict.fromkeys(("rpm", "rev/min", "1/min", "min-1"), 1 / 60.0),
    "N": {"n": 1.0, "kn": 1e3, "mn": 1e6},
    "N m": {"nm": 1.0, "knm": 1e3, "mnm": 1e6},
}
"""SI unit -> spellings that are read, in small letters without spaces, and their factors."""

_OTHER_UNITS = frozenset(("kw", "mw", "degc", "pa", "kpa", "bar", "%", "kg", "m/s2", "deg/s2", "rad/s2", "g", "volt"))
"""Units of quantities that are none of a trial's channels: power P, temperature T, ..."""

_WORDS = {
    "time": ("elapsed time", "timestamp", "time stamp"),
    "u": ("surge", "surge velocity", "surge speed", "longitudinal velocity", "longitudinal speed"),
    "v": ("sway", "sway velocity", "sway speed", "transverse velocity", "transverse speed", "lateral velocity"),
    "r": ("yaw rate", "yawrate", "yaw velocity", "rate of turn", "rot", "yaw", "heading rate"),
    "p": ("roll rate", "rollrate", "roll velocity", "roll"),
    "phi": ("roll", "roll angle", "heel", "heel angle", "φ"),
    "psi": ("heading", "heading angle", "yaw", "yaw angle", "hdg", "ψ"),
    "x": ("x position", "x pos", "north", "northing"),
    "y": ("y position", "y pos", "east", "easting"),
    "delta": ("rudder", "rudder angle", "δ"),
    "n": ("rpm", "rps", "propeller", "shaft", "revs", "revolutions", "propeller speed", "shaft speed"),
    "thrust": ("propeller thrust",),
    "torque": ("propeller torque", "shaft torque"),
}
_SYMBOLS = {name: (name,) for name in SI} | {"t": ("time",)}
_CHANNELS_OF = _SYMBOLS | {
    word: tuple(channel for channel, words in _WORDS.items() if word in words)
    for words in _WORDS.values()
    for word in words
}


@dataclass(frozen=True)
class Column:
    """A column of a file: ``value = factor (sign cell + offset)`` in SI units."""

    channel: str
    index: int
    heading: str
    unit: str
    factor: float
    sign: float = 1.0
    offset: float = 0.0

    def si(self, cells: np.ndarray) -> np.ndarray:
        """Values in SI units."""
        return self.factor * (self.sign * cells + self.offset)


def unit_factor(unit: str, si_unit: str) -> float | None:
    """Factor from a unit to its SI unit; None where it is none of its spellings."""
    return FACTORS[si_unit].get(_spelling(unit))


def is_unit(text: str) -> bool:
    """Whether a text is a unit, in brackets or not, of any quantity."""
    return any(_spelling(text) in spellings for spellings in (*FACTORS.values(), _OTHER_UNITS))


def _spelling(unit: str) -> str:
    plain = unit.strip().strip("[](){}").lower().replace("°", "deg").replace("_per_", "/").replace("_", "/")
    return re.sub(r"[\s.·^*]", "", plain)


def _name_and_unit(heading: str) -> tuple[str, str | None]:
    """Name in small letters with single spaces, and the unit the heading states: ``u [m/s]``, ``r_deg/s``, ``U kn``."""
    bracketed = re.fullmatch(r"(.*?)\s*[\[({]([^\])}]*)[\])}]\s*", heading)
    if bracketed:
        return _plain(bracketed[1]), bracketed[2].strip() or None
    if _plain(heading) in _CHANNELS_OF:
        return _plain(heading), None
    for place in re.finditer(r"[_\s,/]+", heading):
        name, unit = _plain(heading[: place.start()]), heading[place.end() :]
        if name in _CHANNELS_OF and is_unit(unit):
            return name, unit
    return _plain(heading), None


def _plain(name: str) -> str:
    return re.sub(r"[\s_.-]+", " ", name).strip().lower()


def matched_columns(
    headings: Sequence[str],
    units: Sequence[str],
    chosen: Mapping[str, Mapping],
    where: str,
    unstated: Mapping[str, str] = SI,
) -> tuple[dict[str, Column], list[str]]:
    """Column of every channel that a file has.

    Parameters
    ----------
    headings : sequence of str
        Header of the file.
    units : sequence of str
        Row of units below it; empty texts where there is none.
    chosen : mapping
        Channel -> ``{"column": ..., "unit": ..., "sign": ..., "offset": ...}``, before what the headings say.
    where : str
        Name of the file, for errors.
    unstated : mapping of str, optional
        Unit of a channel where none is stated.

    Returns
    -------
    dict of Column, list of str
        Columns by channel, time first; sentences on headings that had to be interpreted or are left out.

    Raises
    ------
    TrialError
        For a column that is missing, ambiguous or without a unit that can be read.
    """
    found = {}
    for channel, choice in chosen.items():
        choice = {**choice, "unstated": unstated[channel]}
        found[channel] = _chosen_column(channel, choice, headings, units, where)
    left_out, offers = _offers(headings, units, found, where, unstated)
    for channel, columns in offers.items():
        found[channel] = _one_of(channel, columns, where)
        left_out += [column.heading for column in columns if column is not found[channel]]
    if "time" not in found or len(found) < 2:
        lacking = "time" if "time" not in found else f"any of {', '.join(list(SI)[1:])}"
        raise TrialError(
            f"{where}: columns are time and any of {', '.join(list(SI)[1:])}, found {', '.join(headings)!r} without "
            f"{lacking}; rename one or name it in a format file."
        )
    ordered = {channel: found[channel] for channel in SI if channel in found}
    return ordered, _interpreted(ordered, left_out)


def _offers(
    headings: Sequence[str], units: Sequence[str], found: Mapping[str, Column], where: str, unstated: Mapping[str, str]
) -> tuple[list[str], dict[str, list[Column]]]:
    """Headings of no use, and the columns that offer each channel that is not found yet.

    A column whose unit cannot be told is an error where no other has its channel.
    """
    taken = {column.index for column in found.values()}
    left_out, offers, errors = [], {}, {}
    for index, heading in enumerate(headings):
        if index in taken or not heading:
            continue
        column = None
        try:
            column = _recognised(index, heading, units[index], where, unstated)
        except TrialError as error:
            errors[heading] = error
        if column and column.channel not in found:
            offers.setdefault(column.channel, []).append(column)
        else:
            left_out.append(heading)
    for heading, error in errors.items():
        if not {*found, *offers}.intersection(_CHANNELS_OF[_name_and_unit(heading)[0]]):
            raise error
    return left_out, offers


def _interpreted(columns: Mapping[str, Column], left_out: list[str]) -> list[str]:
    read = [
        f"{c.channel} from {c.heading!r} in {c.unit}"
        for c in columns.values()
        if (c.heading, c.unit) != (c.channel, SI[c.channel])
    ]
    notes = [f"Columns read: {', '.join(read)}."] if read else []
    return [*notes, f"Columns left out: {', '.join(left_out)}."] if left_out else notes


def _one_of(channel: str, columns: list[Column], where: str) -> Column:
    exact = [column for column in columns if column.heading == channel]
    candidates = exact or columns
    if len(candidates) > 1:
        raise TrialError(
            f"{where}: {channel} is to be read from one column, found "
            f"{', '.join(repr(column.heading) for column in candidates)}; name one of them in a format file."
        )
    return candidates[0]


def _recognised(index: int, heading: str, unit_below: str, where: str, unstated: Mapping[str, str]) -> Column | None:
    """Column that a heading names; None for one of another quantity."""
    name, stated = _name_and_unit(heading)
    channels = _CHANNELS_OF.get(name, ())
    unit = stated or unit_below or {"rpm": "rpm", "rps": "rps"}.get(name)
    if not channels:
        return None
    if not unit:
        channel = next((channel for channel in channels if unstated[channel] != SI[channel]), None)
        if channel:
            return Column(channel, index, heading, unstated[channel], FACTORS[SI[channel]][unstated[channel]])
        if name not in _SYMBOLS and channels != ("time",):
            raise TrialError(
                f"{where}, column {heading!r}: its unit is not stated; call it "
                f"'{heading} [{'deg' if SI[channels[-1]] == 'rad' else SI[channels[-1]]}]' or as it is."
            )
        return Column(channels[0], index, heading, SI[channels[0]], 1.0)
    for channel in channels:
        if factor := unit_factor(unit, SI[channel]):
            return Column(channel, index, heading, unit, factor)
    if is_unit(unit):
        return None
    raise TrialError(_unknown_unit(where, heading, channels[0], unit))


def _unknown_unit(where: str, heading: str, channel: str, unit: str) -> str:
    known = ", ".join(FACTORS[SI[channel]])
    return f"{where}, column {heading!r}: the unit of {channel} is one of {known}, found {unit!r}; correct it."


def _chosen_column(channel: str, choice: Mapping, headings: Sequence[str], units: Sequence[str], where: str) -> Column:
    wanted = choice["column"].strip()
    found = [index for index, heading in enumerate(headings) if heading == wanted]
    if len(found) != 1:
        raise TrialError(
            f"{where}: the format reads {channel} from a column {wanted!r} that stands there once, found {len(found)} "
            f"among {', '.join(headings)}; correct the format."
        )
    unit = choice.get("unit") or _name_and_unit(wanted)[1] or units[found[0]] or choice["unstated"]
    factor = unit_factor(unit, SI[channel])
    if factor is None:
        raise TrialError(_unknown_unit(where, wanted, channel, unit))
    return Column(channel, found[0], wanted, unit, factor, choice.get("sign", 1.0), choice.get("offset", 0.0))
