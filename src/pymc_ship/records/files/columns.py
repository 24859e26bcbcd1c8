"""Columns of a trial file: which channel a heading names, in which unit, and the factor to SI."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from types import MappingProxyType
from typing import Any

import numpy as np

from pymc_ship.machine.errors import TrialError
from pymc_ship.trial.channels import CHANNELS, TIME, Channel, file_columns
from pymc_ship.trial.units import RADIAN, spelling

_OTHER_UNITS = frozenset(("kw", "mw", "degc", "pa", "kpa", "bar", "%", "kg", "m/s2", "deg/s2", "rad/s2", "g", "volt"))
"""Units of quantities that are none of a trial's channels: power P, temperature T, ..."""


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


def is_unit(text: str) -> bool:
    """Whether a text is a unit, in brackets or not, of any quantity."""
    known = any(one.unit.factor(text) for one in file_columns().values())
    return known or spelling(text) in _OTHER_UNITS


def _named(heading: str) -> list[Channel]:
    """Channels that a heading in small letters and without its unit may name."""
    return [one for one in file_columns().values() if heading == _plain(one.name) or heading in one.headings]


def _name_and_unit(heading: str) -> tuple[str, str | None]:
    """Name in small letters with single spaces, and the unit the heading states: ``u [m/s]``, ``r_deg/s``, ``U kn``."""
    bracketed = re.fullmatch(r"(.*?)\s*[\[({]([^\])}]*)[\])}]\s*", heading)
    if bracketed:
        return _plain(bracketed[1]), bracketed[2].strip() or None
    if _named(_plain(heading)):
        return _plain(heading), None
    for place in re.finditer(r"[_\s,/]+", heading):
        name, unit = _plain(heading[: place.start()]), heading[place.end() :]
        if _named(name) and is_unit(unit):
            return name, unit
    return _plain(heading), None


def _plain(name: str) -> str:
    return re.sub(r"[\s_.-]+", " ", name).strip().lower()


def matched_columns(
    headings: Sequence[str],
    units: Sequence[str],
    chosen: Mapping[str, Mapping[str, Any]],
    where: str,
    unstated: Mapping[str, str] = MappingProxyType({}),
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
        Unit of a channel where none is stated and it is not the SI unit.

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
        found[channel] = _chosen_column(file_columns()[channel], choice, headings, units, unstated.get(channel), where)
    left_out, offers = _offers(headings, units, found, where, unstated)
    for channel, columns in offers.items():
        found[channel] = _one_of(channel, columns, where)
        left_out += [column.heading for column in columns if column is not found[channel]]
    if "time" not in found or len(found) < 2:
        lacking = "time" if "time" not in found else f"any of {', '.join(CHANNELS)}"
        raise TrialError(
            f"{where}: columns are time and any of {', '.join(CHANNELS)}, found {', '.join(headings)!r} without "
            f"{lacking}; rename one or name it in a format file."
        )
    ordered = {name: found[name] for name in file_columns() if name in found}
    return ordered, _interpreted(ordered, left_out)


def _offers(
    headings: Sequence[str], units: Sequence[str], found: Mapping[str, Column], where: str, unstated: Mapping[str, str]
) -> tuple[list[str], dict[str, list[Column]]]:
    """Headings of no use, and the columns that offer each channel that is not found yet.

    A column whose unit cannot be told is an error where no other has its channel.
    """
    taken = {column.index for column in found.values()}
    left_out: list[str] = []
    offers: dict[str, list[Column]] = {}
    errors: dict[str, TrialError] = {}
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
    for heading, unreadable in errors.items():
        if {*found, *offers}.isdisjoint(one.name for one in _named(_name_and_unit(heading)[0])):
            raise unreadable
    return left_out, offers


def _interpreted(columns: Mapping[str, Column], left_out: list[str]) -> list[str]:
    read = [
        f"{c.channel} from {c.heading!r} in {c.unit}"
        for c in columns.values()
        if (c.heading, c.unit) != (c.channel, file_columns()[c.channel].unit.name)
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
    channels = _named(name)
    if not channels:
        return None
    unit = stated or unit_below or (name if channels[0].unit.factor(name) else None)
    if not unit:
        return _without_unit(index, heading, channels, where, unstated)
    for channel in channels:
        if factor := channel.unit.factor(unit):
            return Column(channel=channel.name, index=index, heading=heading, unit=unit, factor=factor)
    if is_unit(unit):
        return None
    raise TrialError(_unknown_unit(where, heading, channels[0], unit))


def _without_unit(
    index: int, heading: str, channels: Sequence[Channel], where: str, unstated: Mapping[str, str]
) -> Column:
    """Column whose unit nothing states: the one the format implies, or the SI unit of a channel called by its name."""
    channel = next((one for one in channels if one.name in unstated), channels[0])
    unit = unstated.get(channel.name, channel.unit.name)
    factor = channel.unit.factor(unit)
    by_name = channel is TIME or _name_and_unit(heading)[0] == _plain(channel.name)
    if factor is None or not (by_name or channel.name in unstated):
        last = channels[-1].unit
        raise TrialError(
            f"{where}, column {heading!r}: its unit is not stated; call it "
            f"'{heading} [{'deg' if last is RADIAN else last.name}]' or as it is."
        )
    return Column(channel=channel.name, index=index, heading=heading, unit=unit, factor=factor)


def _unknown_unit(where: str, heading: str, channel: Channel, unit: str) -> str:
    known = ", ".join(channel.unit.spellings)
    return f"{where}, column {heading!r}: the unit of {channel.name} is one of {known}, found {unit!r}; correct it."


def _chosen_column(
    channel: Channel,
    choice: Mapping[str, Any],
    headings: Sequence[str],
    units: Sequence[str],
    unstated: str | None,
    where: str,
) -> Column:
    wanted = choice["column"].strip()
    found = [index for index, heading in enumerate(headings) if heading == wanted]
    if len(found) != 1:
        raise TrialError(
            f"{where}: the format reads {channel.name} from a column {wanted!r} that stands there once, found "
            f"{len(found)} among {', '.join(headings)}; correct the format."
        )
    stated = choice.get("unit") or _name_and_unit(wanted)[1] or units[found[0]]
    unit = stated or unstated or channel.unit.name
    factor = channel.unit.factor(unit)
    if factor is None:
        raise TrialError(_unknown_unit(where, wanted, channel, unit))
    signs = {key: choice[key] for key in ("sign", "offset") if key in choice}
    return Column(channel=channel.name, index=found[0], heading=wanted, unit=unit, factor=factor, **signs)
