"""Columns of a trial file: channel, unit and factor to SI of each heading."""

from __future__ import annotations

import re
from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from types import MappingProxyType
from typing import Any

import numpy as np

from pymc_ship.machine.errors import TrialError
from pymc_ship.machine.names import did_you_mean
from pymc_ship.trial.cells import Cells, Numbers, cell_numbers
from pymc_ship.trial.channels import CHANNELS, TIME, Channel, file_columns
from pymc_ship.trial.units import METRE_PER_SECOND, PURE_NUMBER, RADIAN, spelling

_OTHER_UNITS = frozenset(("kw", "mw", "degc", "pa", "kpa", "bar", "%", "kg", "m/s2", "deg/s2", "rad/s2", "g", "volt"))
"""Units of quantities that are not channels of a trial, such as power P or temperature T."""

OF_CLOCK = re.compile(
    r"(?:(?:ut|utc|gmt|[a-z]{2,3}t)?(?:[-+]\d{1,2}(?::?\d{2})?)?|z|lt|(?:local|ship)(?: time)?|iso(?:[ -]?8601)?"
    r"|(?:(?:%[a-z]|[ymdhsf]{2,4}|min|[ap]m(?:/[ap]m)?|[hms](?=:|$))(?:[-:/., t]+|$)){2,}|hhmmss(?:\.s+)?)",
    re.IGNORECASE,
)
"""Zones, and patterns of dates and times, that stand for a unit of time and are none."""

SI_UNIT = "no other stated"
"""What a unit is known by if neither the file nor its format states it."""

ROS = "a heading of ROS"
"""What a channel is known by whose heading is a field of a ROS message, such as ``pose.pose.position.x``."""

_CAPITAL = re.compile(r"[A-SU-Z]")
_TOGETHER = ({"U", "V", "R"}, {"X", "Y"})
"""Capital letters that are channels without a unit where all of them are there; P may be power, N a row or north."""

_DIRECTIONS = ("psi", "cog")
_TRUE = re.compile(r"(?<![a-z])(?:t|true|degt)(?![a-z])")
_MAGNETIC = re.compile(r"(?<![a-z])(?:m|mag|magnetic|degm|hdm)(?![a-z])")
_OF_NORTH = re.compile(r"[ (]*(?<![a-z])(?:t|true|m|mag|magnetic)(?![a-z])\)?")
"""The north of a direction, true or magnetic: of its name and unit, and what is none of its name."""

MAGNETIC = "deg M"  # unit of a direction beside the letter M

_OF_MINUTES = re.compile(r"d{2,3}m{2}\.m+", re.IGNORECASE)  # unit of degrees and minutes in one number

_SHIP_SPEED = "the speed of the ship"
"""What the surge velocity is known by in a column V, the symbol of ITTC."""

_SPEED = re.compile(r"(?:(?:ship|ship's|vessel|boat) )?speed")  # through water or over ground

_PART = re.compile(r"(?:^|[ /])(position|orientation|linear|angular|angular velocity)[ /]([xyzw])$")
_ROS_FIELD = re.compile(
    r"(?:position|orientation|linear|angular|angular_velocity)[./][xyzw]\b"
)  # a space is none of ROS

AIS = 4.733  # of the rate of turn, ITU-R M.1371-5, Table 48

CODES: Mapping[str, Callable[[np.ndarray], np.ndarray]] = {
    "none": lambda cells: cells,
    "ais": lambda cells: np.sign(cells) * (cells / AIS) ** 2,
    "ddmm": lambda cells: np.trunc(cells / 100.0) + np.fmod(cells, 100.0) / 60.0,
}
"""Cells as numbers of their unit, by code.

``ais`` is 4.733 times the root of a rate of turn in deg/min; ``ddmm`` has degrees and minutes in one number, 5329.9996.
"""


MISSING_CODES = {
    "rad": (360.0, 511.0),
    "rad/s": (127.0, 128.0, 731.0),
    "m/s": (102.3,),
    "": (99.9, 255.0, 327.67, 655.35, 999.0, 999.9, 3276.7, 6553.5, 9999.0, 32767.0, 32768.0, 65535.0, 99999.0, 1e6),
}
"""Numbers, of either sign, that stand for "not available" in the unit of a file, by SI unit; "" for every channel.

AIS (ITU-R M.1371): heading 511, course 360.0, speed 102.3, rate of turn 128, 127 without an indicator and 731 as
decoded; the largest numbers of 8 and 16 bits, with up to two decimals; rows of nines.
"""

JUMP = 8.0  # steps of a channel, at their 99 % quantile, from which a stand-in is none of its values
_OF_SENSORS = {
    "sog": (102.3,),
    "cog": (360.0,),
    "psi": (511.0,),
    "latitude": (91.0,),
    "longitude": (181.0,),
    "delta": (),
}
_FEWEST_COUNTED, _COUNTED = 4, 1000  # rows by which a counter of them is known
_WHOLE_TURN, LEAST_TURN = 360.0, 5.0  # deg; the least is of a course that is none beside others


def standing_out(values: np.ndarray, cells: np.ndarray, least: float = 0.0, period: float | None = None) -> np.ndarray:
    """Those of some cells whose run lies far from its neighbours, measured by the steps of the others."""
    steps, far = np.abs(np.diff(values)), np.zeros_like(cells)
    steps = steps if period is None else np.minimum(steps % period, -steps % period)
    others = steps[~(cells[1:] | cells[:-1])]
    if not others.size:
        return far
    wide = (steps > JUMP * np.quantile(others, 0.99)) & (steps > least)
    edges = np.flatnonzero(np.diff(cells.astype(int), prepend=0, append=0))
    for begin, end in zip(edges[::2], edges[1::2], strict=True):
        far[begin:end] = (begin == 0 or wide[begin - 1]) and (end == cells.size or wide[end - 1])
    return far


def receiver_stand_ins(name: str, cells: np.ndarray) -> dict[float, np.ndarray]:
    """Cells of a receiver, a heading or a rudder that a stand-in fills, by its number in the unit of the file."""
    left, found = cells.copy(), {}
    turn, least = (_WHOLE_TURN, LEAST_TURN) if name in ("cog", "psi") else (None, 0.0)
    for number in (*_OF_SENSORS[name], *(one for one in MISSING_CODES[""] if one > _WHOLE_TURN)):
        known = np.flatnonzero(np.isfinite(left))
        values = left[known]
        held = np.abs(np.abs(values) - number) < 1e-6 * number
        if not held.any() or held.all():
            continue
        beyond = turn is not None and number > turn and np.abs(values[~held]).max() <= turn
        far = known[held if beyond else standing_out(values, held, least, turn)]
        if far.size:
            left[far], found[number] = np.nan, np.isin(np.arange(cells.size), far)
    return found


SETTINGS = ("sign", "offset", "code", "missing", "delay")
"""Settings of a column that a format file states, beside its heading and unit."""


@dataclass(frozen=True)
class Column:
    """A column of a file: ``value = factor (sign cell + offset)`` in SI units, of the decoded cell, ``delay`` [s] ago.

    ``named_by`` and ``unit_by``: what the channel and the unit are known by; see :data:`SI_UNIT`.
    """

    channel: str
    index: int
    heading: str
    unit: str
    factor: float
    sign: float = 1.0
    offset: float = 0.0
    code: str = "none"
    missing: tuple[float, ...] = ()
    delay: float = 0.0
    named_by: str = "its name"
    unit_by: str = "its name"

    @property
    def stated(self) -> bool:
        """Whether the file or its format states the unit."""
        return self.unit_by != SI_UNIT

    def choice(self) -> dict[str, Any]:
        """Entry of a format file that reads this column; without the unit of a clock that none is stated of."""
        entry: dict[str, Any] = {"column": self.heading}
        if self.stated or self.channel != TIME.name:
            entry["unit"] = self.unit
        settings = {key: getattr(self, key) for key in SETTINGS if getattr(self, key) != getattr(Column, key)}
        return entry | {key: list(value) if isinstance(value, tuple) else value for key, value in settings.items()}

    def si(self, cells: np.ndarray) -> np.ndarray:
        """Values in SI units, NaN for the numbers that stand for missing ones."""
        known = np.where(np.isin(cells, self.missing), np.nan, cells) if self.missing else cells
        return self.factor * (self.sign * CODES[self.code](known) + self.offset)


GROUND = {
    "sog": Channel("sog", METRE_PER_SECOND, "speed over ground", headings=("speed over ground", "ground speed")),
    "cog": Channel("cog", RADIAN, "course over ground", headings=("course over ground", "course")),
    "latitude": Channel("latitude", RADIAN, "latitude", headings=("lat",)),
    "longitude": Channel("longitude", RADIAN, "longitude", headings=("lon", "long")),
}
"""Quantities of a satellite receiver, of which channels are made."""

PAIRS = {("sog", "cog"): {"u", "v"}, ("latitude", "longitude"): {"x", "y"}}
"""Channels that two of :data:`GROUND` make together, where a file has neither of them."""

QUATERNION = {
    f"q{axis}": Channel(f"q{axis}", PURE_NUMBER, f"component {axis} of a quaternion", headings=(f"orientation {axis}",))
    for axis in "xyzw"
}
"""Components of an attitude, of which psi and phi are made."""


def is_over_ground(names: Collection[str]) -> bool:
    """Whether u and v are made of speed and course over ground, given the names of columns or channels."""
    return {"sog", "cog", "psi"} <= set(names) and not {"u", "v"} & set(names)


def quantities() -> dict[str, Channel]:
    """Time, channels, :data:`GROUND` and :data:`QUATERNION` by name: what a column of a file may be."""
    return file_columns() | GROUND | QUATERNION


def is_unit(text: str) -> bool:
    """Whether a text is a unit, in brackets or not, of any quantity."""
    spelled = spelling(text)
    return spelled in _OTHER_UNITS or any(spelled in one.unit.spellings for one in quantities().values())


def _channels_named(heading: str) -> list[Channel]:
    """Channels that a lower-case heading without unit may name; of a vector's part, the end counts."""
    if part := _PART.search(heading):
        heading = f"{part[1]} {part[2]}"
    named = [one for one in quantities().values() if heading == plain_name(one.name) or heading in one.headings]
    bare = _OF_NORTH.sub("", heading).strip()
    return named if named or bare == heading else [one for one in _channels_named(bare) if one.name in _DIRECTIONS]


def is_from_true_north(heading: str) -> bool:
    """Whether the heading of a column of directions states that they are true ones."""
    name, unit = name_and_unit(heading)
    return bool(_TRUE.search(f"{name} {spelling(unit or '')}"))


def channels_of(heading: str) -> list[Channel]:
    """Channels that a heading may name, perhaps with a unit."""
    return _channels_named(name_and_unit(heading)[0])


def name_and_unit(heading: str) -> tuple[str, str | None]:
    """Lower-case name and unit of a heading such as ``u [m/s]``, ``r_deg/s``, ``U kn``."""
    bracketed = re.fullmatch(r"(.*?)\s*[\[({]([^\])}]*)[\])}]\s*", heading, re.DOTALL)
    if bracketed:
        return plain_name(bracketed[1]), _unit_of(plain_name(bracketed[1]), bracketed[2].strip())
    if _channels_named(plain_name(heading)):
        return plain_name(heading), None
    for separator in re.finditer(r"[_\s,/]+", heading):
        name, unit = plain_name(heading[: separator.start()]), heading[separator.end() :]
        if _channels_named(name) and is_unit(unit):
            return name, unit
    return plain_name(heading), None


def _unit_of(name: str, stated: str) -> str | None:
    """Unit that is stated of a column; None without one, and for a zone or a pattern of a clock."""
    channels = _channels_named(name)
    if any(one.name in _DIRECTIONS for one in channels) and stated.lower() in ("t", "true"):
        return "°T"
    return None if not stated or (TIME in channels and OF_CLOCK.fullmatch(stated)) else stated


def plain_name(name: str) -> str:
    """Name in lower case, with a space for each separator."""
    return re.sub(r"[\s_.-]+", " ", name).strip().lower()


def matched_columns(
    headings: Sequence[str],
    units: Sequence[str],
    chosen: Mapping[str, Mapping[str, Any]],
    where: str,
    unstated: Mapping[str, str] = MappingProxyType({}),
    coarse: Collection[int] = (),
) -> tuple[dict[str, Column], list[str]]:
    """Columns of a file by channel, time first, and sentences on interpreted and unused headings.

    ``units`` is the row below the headings; ``chosen`` (channel -> an entry of the format) precedes
    them; ``unstated`` are units of channels without one, if not SI; ``coarse`` the clocks whose stamps repeat.
    TrialError for a column that is missing, ambiguous or without a readable unit.
    """
    matched = {
        name: _chosen_column(quantities()[name], choice, headings, units, unstated.get(name), where)
        for name, choice in chosen.items()
    }
    left_out, candidates_by_channel = _candidates(headings, units, matched, where, unstated)
    for channel, columns in candidates_by_channel.items():
        matched[channel] = _single_column(channel, columns, where, coarse)
        left_out += [column.heading for column in columns if column is not matched[channel]]
    hints = {heading: nearest_heading(heading, matched) for heading in left_out}
    if "time" not in matched or len(matched) < 2:
        lacking = "time" if "time" not in matched else f"any of {', '.join(CHANNELS)}"
        clocks = (did_you_mean(name_and_unit(heading)[0], (TIME.name, *TIME.headings)) for heading in left_out)
        near = next(filter(None, clocks if lacking == "time" else hints.values()), "")
        raise TrialError(
            f"{where}: columns are time and any of {', '.join(CHANNELS)}, found {', '.join(headings)!r} "
            f"without {lacking}{near}; rename one or name it in a format file."
        )
    ordered = {name: matched[name] for name in quantities() if name in matched}
    return ordered, _reading_notes(ordered, [f"{heading}{hint}" for heading, hint in hints.items()])


def nearest_heading(heading: str, matched: Mapping[str, Column]) -> str:
    """Remark on an unused heading: a capital letter, or a misspelt one of a channel that no column has; else empty."""
    channels = [one for one in channels_of(heading) if one.name not in matched]
    if channels and _is_symbol(heading, "V") and (heading != "V" or "u" in matched):
        return f" ({_SHIP_SPEED}; for the channel v, write {_with_unit('v')})"
    if channels and _CAPITAL.fullmatch(heading):
        name = _SHIP_SPEED if heading == "V" else f"the channel {channels[0].name}"
        return f" (a capital letter without a unit; for {name}, write {_with_unit(heading)})"
    lacking = [one for name, one in quantities().items() if name not in matched]
    name, unit = name_and_unit(heading)
    if _SPEED.fullmatch(name):
        remark = f" ({_SHIP_SPEED}: write STW for the one through water, SOG for the one over ground)"
        return remark if {"u", "sog"}.isdisjoint(matched) else ""
    known = [word for one in lacking for word in (one.name, *one.headings)]
    for one in lacking:
        if unit and one.unit.factor(unit) and name.startswith(one.headings):
            return f" (if it is {one.name}, name it in a format file)"
    return "" if name.lower() in map(str.lower, known) else did_you_mean(name, known)


def _candidates(
    headings: Sequence[str],
    units: Sequence[str],
    matched: Mapping[str, Column],
    where: str,
    unstated: Mapping[str, str],
) -> tuple[list[str], dict[str, list[Column]]]:
    """Unused headings, and the candidate columns of channels that the format does not name."""
    taken = {column.index for column in matched.values()}
    left_out: list[str] = []
    candidates_by_channel: dict[str, list[Column]] = {}
    errors: dict[str, TrialError] = {}
    capitals = _bare_capitals(headings, units)
    is_pair = any(_is_symbol(heading, "U") for heading in headings)
    for index, heading in enumerate(headings):
        if index in taken or not heading:
            continue
        column = None
        try:
            column = None if heading in capitals else _column_of_heading(index, heading, units[index], where, unstated)
        except TrialError as error:
            errors[heading] = error
        if column and _is_symbol(heading, "V") and not is_pair:
            column = replace(column, channel="u", named_by=_SHIP_SPEED)
        if column and column.channel not in matched:
            candidates_by_channel.setdefault(column.channel, []).append(column)
        else:
            left_out.append(heading)
    speeds = [one for one in candidates_by_channel.get("u", []) if one.named_by == _SHIP_SPEED]
    if speeds and (candidates_by_channel["u"] != speeds or "sog" in {*matched, *candidates_by_channel}):
        others = [one for one in candidates_by_channel.pop("u") if one not in speeds]
        candidates_by_channel |= {"u": others} if others else {}
        left_out += [one.heading for one in speeds]
    needed = [
        heading
        for heading in errors
        if {*matched, *candidates_by_channel}.isdisjoint(one.name for one in _channels_named(name_and_unit(heading)[0]))
    ]
    unstated_units = [heading for heading in needed if isinstance(errors[heading], _UnstatedUnitError)]
    if len(unstated_units) > 1:
        names, stated = ", ".join(map(repr, unstated_units)), ", ".join(map(_with_unit, unstated_units))
        raise TrialError(f"{where}, columns {names}: their units are not stated; state them, such as {stated}.")
    if needed:
        raise errors[needed[0]]
    return left_out, candidates_by_channel


def _is_symbol(heading: str, letter: str) -> bool:
    """Whether a heading is a capital letter as written, perhaps with a unit."""
    return heading.startswith(letter) and name_and_unit(heading)[0] == letter.lower()


def _bare_capitals(headings: Sequence[str], units: Sequence[str]) -> set[str]:
    """Headings of one capital letter and no unit that are not channels."""
    bare = {heading for heading, unit in zip(headings, units, strict=True) if _CAPITAL.fullmatch(heading) and not unit}
    return bare - {letter for letters in _TOGETHER if bare >= letters for letter in letters}


def clock_column(
    headings: Sequence[str], units: Sequence[str], stated: str, where: str, coarse: Collection[int]
) -> tuple[int, str]:
    """Index of the column of time, ``stated`` by its heading or known by it, and its unit; TrialError without one."""
    named = [k for k, heading in enumerate(headings) if heading == stated]
    named = named or [k for k, heading in enumerate(headings) if TIME in _channels_named(name_and_unit(heading)[0])]
    if not named:
        raise TrialError(
            f"{where}: each file of a run has a column of time, found {', '.join(headings)!r}; rename one to time, or "
            "take the file out of the folder."
        )
    index = min(named, key=lambda k: (k in coarse, _clock_rank(headings[k])))
    name, unit = name_and_unit(headings[index])
    return index, unit or _unit_of(name, units[index]) or ""


def _clock_rank(heading: str) -> int:
    """Rank of a heading among those of time, the usual one first."""
    name, ranks = name_and_unit(heading)[0], (TIME.name, *TIME.headings)
    return ranks.index(name) if name in ranks else 0


def _reading_notes(columns: Mapping[str, Column], left_out: list[str]) -> list[str]:
    read = [
        f"{c.channel} from {c.heading!r}" + (f" in {c.unit}" if c.stated else "")
        for c in columns.values()
        if (c.heading, c.unit) != (c.channel, quantities()[c.channel].unit.name)
    ]
    notes = [f"Columns read: {', '.join(read)}."] if read else []
    if "u" in columns and columns["u"].named_by == _SHIP_SPEED:
        notes.append(f"{columns['u'].heading!r} taken as {_SHIP_SPEED}, which is u but for drift; for v, write v.")
    elif {"v", "psi"} <= columns.keys() and {"u", "sog", "x"}.isdisjoint(columns):
        notes.append(f"{columns['v'].heading!r} taken as the sway velocity v; if it is {_SHIP_SPEED}, call it u.")
    if is_over_ground(columns) and name_and_unit(columns["cog"].heading)[0] == "course":
        notes.append(f"{columns['cog'].heading!r} taken as course over ground; rename the column if it is a set one.")
    return [*notes, f"Columns left out: {', '.join(left_out)}."] if left_out else notes


def _single_column(channel: str, columns: list[Column], where: str, coarse: Collection[int]) -> Column:
    exact = [column for column in columns if column.index not in coarse] or columns
    candidates = [column for column in exact if column.heading == channel] or exact
    if {name_and_unit(column.heading)[0] for column in candidates} == {channel}:  # of u and U, the symbol as written
        candidates = [column for column in candidates if column.heading.startswith(channel)] or candidates
    if channel == TIME.name:  # clocks of a file show the same time
        return min(candidates, key=lambda column: _clock_rank(column.heading))
    if len(candidates) > 1:
        names = [column.heading for column in candidates]
        remedy = "name one of them in a format file" if len({*names}) > 1 else "rename one of them, or take it out"
        raise TrialError(
            f"{where}: {channel} is to be read from one column, found {', '.join(map(repr, names))}; {remedy}."
        )
    return candidates[0]


def _column_of_heading(
    index: int, heading: str, unit_below: str, where: str, unstated: Mapping[str, str]
) -> Column | None:
    """Column of a heading; None for another quantity."""
    name, stated = name_and_unit(heading)
    channels = _channels_named(name)
    if not channels:
        return None
    unit = stated or _unit_of(name, unit_below) or (name if channels[0].unit.factor(name) else None)
    if channels[0].name in _DIRECTIONS and _MAGNETIC.search(plain_name(f"{heading} {unit_below}")):
        raise TrialError(
            f"{where}, column {heading!r}: a direction is counted from true north, found a magnetic one; state the "
            f'declination, [columns] {channels[0].name} = {{ column = "{heading}", unit = "deg", offset = 2.5 }}.'
        )
    if not unit:
        return _without_unit(index, heading, channels, where, unstated)
    unit_by = "its name" if unit != unit_below or stated else "the file"
    unit, code = ("deg", "ddmm") if _OF_MINUTES.fullmatch(unit) else (unit, Column.code)
    for channel in channels:
        if factor := channel.unit.factor(unit):
            known: dict[str, Any] = {"named_by": _named_by(channel, name, heading), "unit_by": unit_by, "code": code}
            return Column(channel=channel.name, index=index, heading=heading, unit=unit, factor=factor, **known)
    if is_unit(unit):
        return None
    raise TrialError(_unknown_unit(where, heading, channels[0], unit))


def _named_by(channel: Channel, name: str, heading: str) -> str:
    """What a channel is known by in a file with this heading, whose plain name is ``name``."""
    if _ROS_FIELD.search(heading):
        return ROS
    return "its name" if name == plain_name(channel.name) else "a usual name"


class _UnstatedUnitError(TrialError):
    """A column whose unit is not stated."""


def _with_unit(heading: str) -> str:
    """Heading with a usual unit, in quotes."""
    unit = _channels_named(name_and_unit(heading)[0])[-1].unit
    return f"'{heading} [{'deg' if unit is RADIAN else unit.name}]'"


def _without_unit(
    index: int, heading: str, channels: Sequence[Channel], where: str, unstated: Mapping[str, str]
) -> Column:
    """Column without a stated unit: the unit of the format, or SI if the heading is the name of the channel."""
    channel = next((one for one in channels if one.name in unstated), channels[0])
    unit = unstated.get(channel.name, channel.unit.name)
    factor, heading_name = channel.unit.factor(unit), name_and_unit(heading)[0]
    by_name = (
        channel is TIME
        or channel.name in QUATERNION
        or (heading_name == plain_name(channel.name) and channel.name not in GROUND)
    )
    named_by = _named_by(channel, heading_name, heading)
    if factor is None or not (by_name or named_by == ROS or channel.name in unstated):
        raise _UnstatedUnitError(
            f"{where}, column {heading!r}: its unit is not stated; state it, such as {_with_unit(heading)}."
        )
    known: dict[str, Any] = {
        "named_by": named_by,
        "unit_by": "the format file" if channel.name in unstated else ROS if named_by == ROS else SI_UNIT,
    }
    return Column(channel=channel.name, index=index, heading=heading, unit=unit, factor=factor, **known)


def _unknown_unit(where: str, heading: str, channel: Channel, unit: str) -> str:
    known, hint = ", ".join(channel.unit.spellings), did_you_mean(unit, channel.unit.spellings)
    return (
        f"{where}, column {heading!r}: the unit of {channel.name} is one of {known}, found {unit!r}{hint}; correct it."
    )


def _chosen_column(
    channel: Channel,
    choice: Mapping[str, Any],
    headings: Sequence[str],
    units: Sequence[str],
    unstated: str | None,
    where: str,
) -> Column:
    wanted = choice["column"].strip()
    matched = [index for index, heading in enumerate(headings) if heading == wanted]
    if len(matched) != 1:
        raise TrialError(
            f"{where}: the format reads {channel.name} from one column {wanted!r}, found {len(matched)} of this name "
            f"among {', '.join(headings)}{did_you_mean(wanted, headings)}; correct the format."
        )
    sources = (
        ("the format file", choice.get("unit")),
        ("its name", name_and_unit(wanted)[1]),
        ("the file", _unit_of(name_and_unit(wanted)[0], units[matched[0]])),
        ("the format file", unstated),
        (SI_UNIT, channel.unit.name),
    )
    unit_by, unit = next((by, unit) for by, unit in sources if unit)
    factor = channel.unit.factor(unit)
    if factor is None:
        raise TrialError(_unknown_unit(where, wanted, channel, unit))
    known: dict[str, Any] = {key: choice[key] for key in SETTINGS if key in choice}
    known |= {"unit": unit, "factor": factor, "named_by": "the format file", "unit_by": unit_by}
    return Column(channel=channel.name, index=matched[0], heading=wanted, **known)


def without_stand_ins(columns: dict[str, Column], numbers: dict[str, np.ndarray]) -> list[str]:
    """Empty the cells of a satellite receiver and a rudder that stand for missing ones; sentences on them.

    Other channels keep theirs for the check of stand-ins, but for a heading that turns velocities over ground.
    """
    names, notes = [name for name in (*GROUND, "delta") if name in columns], []
    if is_over_ground(columns):
        names.append("psi")
    for name in names:
        for number, cells in receiver_stand_ins(name, numbers[name]).items():
            numbers[name][cells] = np.nan
            count = int(cells.sum())
            held = f"{count} cell{'s' if count > 1 else ''} of {columns[name].heading!r}"
            notes.append(f"{number:g} in {held} taken as not available: far from the values beside.")
    return notes


def implausible_angles(columns: dict[str, Column], cells: dict[str, np.ndarray]) -> list[str]:
    """A remark on rudder and roll angles that are too large for rad."""
    notes = []
    for name in ("phi", "delta"):
        if name in columns and columns[name].unit == "rad":
            largest = np.abs(cells[name][np.isfinite(cells[name])]).max(initial=0.0)
            if largest > 0.5 * np.pi:
                notes.append(f"{name} reaches {largest:.3g} rad; if it is in deg, call the column '{name} [deg]'.")
    return notes


def counts_the_rows(column: Column, cells: Cells) -> bool:
    """Whether a column of no stated unit, other than the time, has the number of each row, as an n may."""
    if column.stated or column.channel == TIME.name or column.named_by == "the format file":
        return False
    if isinstance(cells, Numbers):
        numbers = cells.values[:_COUNTED]
    else:
        numbers = np.array(cell_numbers(cells[:_COUNTED]), dtype=float)
    if numbers.size <= _FEWEST_COUNTED or not np.isfinite(numbers[0]):
        return False
    return np.array_equal(numbers, numbers[0] + np.arange(numbers.size))
