"""Clocks of trial files: stamps of any usual kind as seconds, and sentences on how they are read.

Dates and times are counted from the first stamp; numbers in s, ms, min, ... keep their origin.
"""

from __future__ import annotations

import re
import warnings
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from pymc_ship.machine.errors import TrialError
from pymc_ship.records.files.columns import Column, channels_of, name_and_unit, plain_name
from pymc_ship.trial.channels import TIME
from pymc_ship.trial.thinning import Thinning

DAY, WEEK = 86400.0, 604800.0
_EPOCH = (1e9, 2.6e9)  # s since 1970: September 2001 to 2052
_EPOCH_UNITS = {"s": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9}
_UNITS = _EPOCH_UNITS | {"min": 60.0, "h": 3600.0, "days": DAY}
_RESOLUTIONS = _UNITS | dict.fromkeys(("hhmmss", "yyyymmddhhmmss"), 1.0)  # s of 1 in a cell
_STEPS = (1e-4, 100.0)  # s between samples of an epoch clock
_LONGEST_STEP = 10.0  # s between samples, from which whole numbers are no seconds
_FIRST_DAY, _DAY_STEP = 2e4, 2e-4  # days: 1954 in a spreadsheet; 17 s between samples
_FAR = 1e7  # s, four months: a clock that begins later is counted from its first stamp
_AGREEMENT = 2.5  # largest ratio of a unit to that by which track and speed agree
_CHORDS = 60  # pieces of a record over which track and turn are compared
_LEAST_TURN = 0.5  # rad
_NEAR = 6.0  # sampling intervals between the stamps at a full minute or a rollover, at most
_COMPACT_DATES = (1.9e13, 2.2e13)  # yyyymmddhhmmss
_TIME_OF_DAY = re.compile(r"(?:(\d{1,9}):)?(\d{1,2}):(\d{1,2}(?:\.\d*)?)\s*([ap]m)?", re.IGNORECASE)
_WITHOUT_SECONDS = re.compile(r"[ T]\d{1,2}:\d{2}(?:\s*[ap]m|Z)?$", re.IGNORECASE)
_HOURS = 24  # of a day
_REPEATED = 1.5  # rows of one stamp, from which hours and minutes are as probable as minutes and seconds
_DECIMALS = re.compile(r":\d{1,2}\.(\d+)")
_ZONE_NAME = re.compile(r"\s+(?:UTC|GMT|[A-Z]{3,4})$")
_ZONE = re.compile(r"\s*(?:Z|UTC|GMT|\s[A-Z]{3,4}|[+-]\d{2}:?\d{2})$")
_DATE = re.compile(r"\d+([-/.])\w+\1\d+")  # without a time, as spreadsheets write midnight
_WHOLE_SECONDS = re.compile(r"(:\d{2}:\d{2})(?![.\d])")
_MIDNIGHT = re.compile(r"(?<![\d:.])24(:00(?::00(?:\.0*)?)?)(?![:\d])")  # the end of a day
_FRACTIONS = re.compile(r"(.*?)([nm])(?:ano|illi)?_?s(?:ecs?|econds?)?")  # of a second, in a column of their own
_DIGITS = {"n": 9, "m": 3}
_WHOLE_STAMP = re.compile(r"(?:.*:\d{1,2}|\d+)")
_FASTEST = 5e-4  # s between samples, below which numbers of no unit are probably no seconds
_HARDEST = 3.0  # m/s2 of a turn, from which they are probably none, either: ships stay below 1

_DATE_PARTS = (
    {"year", "yyyy"},
    {"month", "mon"},
    {"day", "day of month"},
    {"hour", "hours", "hh"},
    {"min", "minute", "minutes"},
    {"sec", "secs", "second", "seconds", "ss"},
)
_SECONDS = _DATE_PARTS[-1]
_TURNING = ("psi", "cog", "wind_direction", "longitude")  # channels that jump by a whole turn

Channels = dict[str, np.ndarray]
Clock = tuple[np.ndarray, np.ndarray, str, list[str]]  # stamps [s], their resolution [s], unit in the file, sentences


def fraction_columns(headings: Sequence[str]) -> dict[int, tuple[int, int]]:
    """Columns of milli- or nanoseconds, and their digits, by that of the seconds or stamps beside them."""
    names = [plain_name(heading) for heading in headings]
    found: dict[int, tuple[int, int]] = {}
    for index, name in enumerate(names):
        if matched := _FRACTIONS.fullmatch(name):
            beside = [k for k, one in enumerate(names) if one in [matched[1] + word for word in _SECONDS]]
            before = [index - 1] if index and not matched[1] and TIME in channels_of(headings[index - 1]) else []
            found |= dict.fromkeys((beside or before)[:1], (index, _DIGITS[matched[2]]))
    return found


def stamp_parts(headings: Sequence[str]) -> set[int]:
    """Columns of the parts of a date and time, and of stamps with their milli- or nanoseconds beside them."""
    return {*date_columns(headings)}.union(*((k, more) for k, (more, _) in fraction_columns(headings).items()))


def thinning(headings: Sequence[str], chosen: Mapping[str, Mapping[str, Any]], every: int) -> Thinning:
    """Thinning of a table with these headings; ``chosen`` are the columns of a format by channel."""
    named = {name: entry["column"].strip() for name, entry in chosen.items()}

    def columns_of(*names: str) -> set[int]:
        stated = {named[name] for name in names if name in named}
        return {k for k, one in enumerate(headings) if one in stated or {c.name for c in channels_of(one)} & {*names}}

    return Thinning(every, frozenset(stamp_parts(headings) | columns_of(TIME.name)), frozenset(columns_of(*_TURNING)))


def with_fraction(stamp: str, fraction: str, digits: int) -> str:
    """Stamp of whole seconds with the decimals of another cell; ValueError for other cells."""
    if not (_WHOLE_STAMP.fullmatch(stamp.strip()) and fraction.strip().isdecimal() and len(fraction.strip()) <= digits):
        raise ValueError(fraction)
    return f"{stamp.strip()}.{int(fraction):0{digits}d}"


def date_columns(headings: Sequence[str]) -> list[int]:
    """Columns of year, month, day, hour, minute and second, or of the last three; empty without them."""
    names = [name_and_unit(heading)[0] for heading in headings]
    found = [next((k for k, name in enumerate(names) if name in known), -1) for known in _DATE_PARTS]
    return found if -1 not in found else found[3:] if -1 not in found[3:] else []


def stamp_of_parts(parts: Sequence[str]) -> str:
    """Stamp of the parts of a date and time, or of a time; empty where one lacks."""
    whole, _, decimals = parts[-1].strip().replace(",", ".").partition(".")
    try:
        *date, hour, minute, second = (int(float(part.replace(",", "."))) for part in (*parts[:-1], whole))
    except (ValueError, OverflowError):
        return ""
    begin = f"{date[0] + 2000 * (date[0] < 100):04d}-{date[1]:02d}-{date[2]:02d}T" if date else ""
    return f"{begin}{hour:02d}:{minute:02d}:{second:02d}" + (f".{decimals}" if decimals else "")


def clock_of_text(
    cells: Sequence[str],
    lines: Sequence[int] | np.ndarray,
    column: Column,
    channels: Channels,
    where: str,
    begins: Sequence[int] = (),
) -> Clock:
    """Clock of dates and times such as ``2020-01-01T08:00:00Z`` or ``08:00:00.5``; a cell is empty where one lacks.

    Where stamps such as ``08:00`` may be minutes and seconds, the ``channels`` [SI] tell as in numbers of no unit.
    ``begins``: the first row of each file, for stamps of several.
    """
    cells = [cell.replace(",", ".") for cell in cells]
    known = [k for k, cell in enumerate(cells) if cell]
    decimals = max((len(digits) for cell in cells for digits in _DECIMALS.findall(cell)), default=0)
    time, quantum = np.full(len(cells), np.nan), np.full(len(cells), 10.0**-decimals)
    stamps = _without_zone([cells[k] for k in known])
    unit_notes: list[str] = []
    unit = "s"
    if not _TIME_OF_DAY.fullmatch(stamps[0]):
        unit = "min" if all(map(_WITHOUT_SECONDS.search, stamps)) else "s"
        seconds, kind, first, period = _dates(stamps)
    else:
        if stamps[0].count(":") == 1:
            unit, unit_notes = _unit_of_pairs(cells, column, channels, where)
        seconds, kind, first, period = _times_of_day(stamps, unit)
    quantum *= _UNITS[unit]
    bad = np.flatnonzero(~np.isfinite(seconds))
    if bad.size:
        raise TrialError(
            f"{where}, line {lines[known[bad[0]]]}, column {column.heading}: a stamp is a number of seconds, a time "
            f"such as 08:00:00.5 or a date and time such as 2020-01-01T08:00:00Z, found {stamps[bad[0]]!r}; correct it."
        )
    time[known] = seconds
    time, notes = _without_rollovers(time, period, 0.5 * period, begins)
    note = f"time from {column.heading!r}: {kind}, counted from {first}."
    return time - time[known[0]], quantum, kind, [note, *unit_notes, *notes]


def _without_zone(stamps: list[str]) -> list[str]:
    """Times of day without the zone behind each of them; other stamps as they are."""
    bare = [_ZONE.sub("", stamp) for stamp in stamps]
    zones = {stamp[len(one) :] for stamp, one in zip(stamps, bare, strict=True)}
    return bare if len(zones) == 1 and _TIME_OF_DAY.fullmatch(bare[0]) else stamps


def _alike(stamps: list[str]) -> tuple[list[str], np.ndarray]:
    """Dates and times of one pattern, at midnight and at whole seconds, too, and the days [s] to add for 24:00."""
    timed = any(":" in stamp for stamp in stamps)
    full = [f"{stamp} 00:00:00" if timed and _DATE.fullmatch(stamp) else stamp for stamp in stamps]
    begun = [_MIDNIGHT.sub(r"00\1", stamp) for stamp in full]
    days = DAY * np.array([one != stamp for one, stamp in zip(begun, full, strict=True)])
    decimals = any(map(_DECIMALS.search, begun))
    return [_WHOLE_SECONDS.sub(r"\1.0", stamp) if decimals else stamp for stamp in begun], days


def _unit_of_pairs(cells: Sequence[str], column: Column, channels: Channels, where: str) -> tuple[str, list[str]]:
    """Unit of the last number of stamps such as ``08:00``, s or min, and a sentence where it is not sure.

    TrialError where stamps repeat, so that one of the two units is far off, and nothing tells which.
    """
    stamps = [cell for cell in cells if cell]
    seconds = np.full(len(cells), np.nan)
    seconds[[k for k, cell in enumerate(cells) if cell]] = _times_of_day(stamps, "s")[0]
    if any(stamp[-1] in "mM" for stamp in stamps):
        return "min", []
    if any("." in stamp for stamp in stamps) or not np.nanmax(seconds) < 60.0 * _HOURS:
        return "s", []
    if column.unit_by == "the format file" and column.unit in ("s", "min"):
        return column.unit, []
    for ratio, reason in _ratios(seconds, channels):
        for unit, other in (("s", "min"), ("min", "s")):
            if max(ratio / _UNITS[unit], _UNITS[unit] / ratio) <= _AGREEMENT:
                return unit, [f"time from {column.heading!r}: so {reason} agree; {_key(column, other)}"]
    if len(stamps) > _REPEATED * len(set(stamps)):
        raise TrialError(
            f"{where}, column {column.heading!r}: the channels of a trial show whether a stamp is hours and minutes or "
            f"minutes and seconds, found {stamps[0]!r} and none that show it; state it, [columns] time = "
            f'{{ column = "{column.heading}", unit = "min" }}, or "s".'
        )
    return "s", [f"time from {column.heading!r}: no channels show that the last number is s; {_key(column, 'min')}"]


def _dates(stamps: list[str]) -> tuple[np.ndarray, str, str, float]:
    """Seconds from the first date and time, NaN for what is none; its kind, the first as text, its period."""
    import pandas as pd

    stamps, days = _alike([_ZONE_NAME.sub("", stamp) for stamp in stamps])
    readings: list[tuple[np.ndarray, str]] = []
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # on formats that pandas guesses
        for settings in ({"format": "ISO8601"}, {}, {"dayfirst": True}, {"yearfirst": True}, {"format": "mixed"}):
            if readings and "format" in settings:
                continue
            try:
                dates = pd.to_datetime(stamps, utc=True, **settings)
            except (ValueError, OverflowError, TypeError):
                continue
            passed = np.asarray((dates - dates[0]).total_seconds(), dtype=float) + days - days[0]
            readings.append((passed, _date_text(dates[0])))
            if settings.get("format") == "ISO8601":
                break
        if not readings:
            bad = np.asarray(pd.to_datetime(stamps, utc=True, format="mixed", errors="coerce").isna())
            return np.where(bad, np.nan, 0.0), "", "", np.inf
    seconds, first = min(readings, key=lambda reading: np.ptp(reading[0]))  # day or month first: the shorter record
    return seconds, "dates and times", first, np.inf


def _date_text(date: object) -> str:
    return f"{date:%Y-%m-%d %H:%M:%S} UTC"


def _times_of_day(stamps: list[str], last: str) -> tuple[np.ndarray, str, str, float]:
    """As :func:`_dates`, of stamps such as ``08:00:00``, ``8:00:00 PM`` or ``00:59.5``; ``last``: unit at their end."""
    seconds = np.full(len(stamps), np.nan)
    for k, stamp in enumerate(stamps):
        if matched := _TIME_OF_DAY.fullmatch(stamp):
            hour, minute, second, half = matched.groups()
            if last == "min":
                hour, minute, second = (minute, second, 0) if hour is None else (None, 0, np.nan)
            hours = int(hour or 0) if not half else int(hour or 0) % 12 + 12 * (half.lower() == "pm")
            seconds[k] = 3600.0 * hours + 60.0 * int(minute) + float(second)
    has_hours = stamps[0].count(":") == 2 or last == "min"
    seconds = seconds % DAY if has_hours and np.nanmax(seconds) == DAY else seconds  # 24:00 ends a day
    period = DAY if has_hours else 3600.0
    kind = "hours, minutes and seconds" if has_hours else "minutes and seconds"
    kind = "hours and minutes" if last == "min" else kind
    return seconds, kind, stamps[0], period if np.nanmax(seconds) < period else np.inf


def clock_of_numbers(
    cells: np.ndarray, quantum: np.ndarray, column: Column, channels: Channels, begins: Sequence[int] = ()
) -> Clock:
    """Clock of numbers: in the unit of the column or, without a stated one, in the most probable one.

    ``quantum`` is the resolution of the cells. Track and speed, or heading and yaw rate, of the ``channels`` [SI] tell
    a unit that is not stated.
    """
    known = cells[np.isfinite(cells)]
    step = _step(known)
    for read in (_compact_times, _compact_dates, _epoch_seconds):
        clock = read(cells, known, step, column) if known.size > 1 else None
        if clock:
            time, unit, note, period = clock
            first = time[np.isfinite(time)][0]
            time, notes = _without_rollovers(time - first, period, 0.5 * period, begins)
            return time, _RESOLUTIONS[unit] * quantum, unit, [f"time from {column.heading!r}: {note}", *notes]
    unit, notes = (column.unit, []) if column.stated else _probable_unit(cells, step, column, channels)
    factor = column.factor if column.stated else _UNITS[unit]
    time = factor * (column.sign * cells + column.offset)
    largest = np.nanmax(time) if known.size else 0.0
    period = 2.0**32 * factor if unit in ("ms", "us") else WEEK if largest > DAY else DAY
    if known.size and largest <= period and np.nanmin(time) >= 0.0:
        time, rollovers = _without_rollovers(time, period, period - _NEAR * factor * step, begins)
        notes += rollovers
    if known.size and factor * known[0] > _FAR:
        time = time - factor * known[0]
        notes.append(f"time from {column.heading!r}: counted from its first stamp, {known[0]:.15g} {unit}.")
    return time, factor * quantum, unit, notes


def _step(known: np.ndarray) -> float:
    """Median of the positive steps; 0 without any."""
    steps = np.diff(known)
    return float(np.median(steps[steps > 0.0])) if (steps > 0.0).any() else 0.0


Reading = tuple[np.ndarray, str, str, float] | None  # stamps [s], unit in the file, kind, period [s]


def _compact_times(cells: np.ndarray, known: np.ndarray, step: float, column: Column) -> Reading:
    """Times as hhmmss, known by their steps at full minutes: 41 for one second."""
    whole = np.floor(known)
    if known.min() < 0.0 or known.max() >= 240000.0 or (whole % 100 >= 60).any() or (whole // 100 % 100 >= 60).any():
        return None
    time = 3600.0 * (cells // 10000) + 60.0 * (cells // 100 % 100) + cells % 100
    steps, raw = np.diff(time[np.isfinite(time)]), np.diff(known)
    full = (np.diff(whole // 100) != 0.0) & (raw > 0.0)
    shown = full & (raw - steps >= 40.0) & (raw > 1.5 * step) & (steps <= _NEAR * step)
    if not shown.any() or shown.sum() < 0.5 * full.sum():
        return None
    jump = f"{raw[shown][0]:g} at a full minute are {steps[shown][0]:g} s"
    return time, "hhmmss", f"hhmmss, as a step of {jump}; counted from {known[0]:09.2f}.", DAY


def _compact_dates(cells: np.ndarray, known: np.ndarray, step: float, column: Column) -> Reading:
    """Dates as yyyymmddhhmmss."""
    if known.min() < _COMPACT_DATES[0] or known.max() > _COMPACT_DATES[1]:
        return None
    import pandas as pd

    texts = pd.Series(np.floor(known).astype(np.int64).astype(str))
    dates = pd.to_datetime(texts, format="%Y%m%d%H%M%S", errors="coerce")
    if dates.isna().any():
        return None
    time = np.full(cells.size, np.nan)
    time[np.isfinite(cells)] = np.asarray((dates - dates[0]).dt.total_seconds(), dtype=float) + known % 1.0
    note = f"dates as yyyymmddhhmmss, counted from {dates[0]:%Y-%m-%d %H:%M:%S}."
    return time, "yyyymmddhhmmss", note, np.inf


def _epoch_seconds(cells: np.ndarray, known: np.ndarray, step: float, column: Column) -> Reading:
    """Seconds since 1970, or days of a spreadsheet, counted from the first."""
    for unit, factor in _EPOCH_UNITS.items():
        inside = _EPOCH[0] <= factor * known.min() and factor * known.max() <= _EPOCH[1]
        plausible = _STEPS[0] <= factor * step <= _STEPS[1] and (not column.stated or column.factor == factor)
        if inside and plausible:
            import pandas as pd

            first = _date_text(pd.Timestamp(round(factor * known[0] * 1e3), unit="ms"))
            return factor * (cells - known[0]), unit, f"{unit} since 1970, counted from {first}.", np.inf
    if known.min() >= _FIRST_DAY and 0.0 < step < _DAY_STEP and not column.stated:
        note = f"days as in a spreadsheet, counted from {known[0]:.10g}; {_key(column, 's')}"
        return DAY * (cells - known[0]), "days", note, np.inf
    return None


def _key(column: Column, unit: str) -> str:
    return f'if not, state [columns] time = {{ column = "{column.heading}", unit = "{unit}" }}.'


def _probable_unit(cells: np.ndarray, step: float, column: Column, channels: Channels) -> tuple[str, list[str]]:
    """Unit of stamps without a stated one, and a sentence if it is not s."""
    for ratio, reason in _ratios(cells, channels):
        unit = min(_UNITS, key=lambda unit: abs(np.log(_UNITS[unit] / ratio)))
        if max(ratio / _UNITS[unit], _UNITS[unit] / ratio) <= _AGREEMENT:
            sentence = f"time from {column.heading!r} read in {unit}, in which {reason} agree; {_key(column, 's')}"
            return unit, [] if unit == "s" else [sentence]
    known = cells[np.isfinite(cells)]
    if step < _LONGEST_STEP or (known % 1.0).any():
        turn = _hardest_turn(cells, channels)
        if 0.0 < step < _FASTEST or turn > _HARDEST:
            probable = (unit for unit in ("min", "h") if turn < _UNITS[unit] and step * _UNITS[unit] > _FASTEST)
            why = f"samples are {step:.3g} s apart" + (f" and the ship turns at {turn:.2g} m/s2" if turn else "")
            key = _key(column, next(probable, "days"))
            return "s", [f"time from {column.heading!r} read in s, in which {why}; {key}"]
        return "s", []
    unit = next((unit for unit in ("ms", "us", "ns") if _UNITS[unit] * step < _LONGEST_STEP), "s")
    sentence = f"time from {column.heading!r} read in {unit}: in s there were {step:g} s between samples; "
    return unit, [] if unit == "s" else [sentence + _key(column, "s")]


def _ratios(cells: np.ndarray, channels: Channels) -> list[tuple[float, str]]:
    """Length of the unit of time [s] by the track and the speed, and by heading and yaw rate."""
    ratios = []
    v = channels.get("v", np.zeros(cells.size))
    rows = _common_rows(cells, channels, ("x", "y", "u"))
    if rows is not None:
        x, y, u, v = (_filled(values)[rows] for values in (channels["x"], channels["y"], channels["u"], v))
        path, run = np.hypot(_chords(x), _chords(y)).sum(), _integrals(cells[rows], np.hypot(u, v)).sum()
        ratios += [(float(path / run), "track and speed")] if path > 0.0 and run > 0.0 else []
    rows = _common_rows(cells, channels, ("psi", "r"))
    if rows is not None:
        turn = np.abs(_chords(_filled(channels["psi"])[rows])).sum()
        rate = np.abs(_integrals(cells[rows], _filled(channels["r"])[rows])).sum()
        ratios += [(float(turn / rate), "heading and yaw rate")] if turn > _LEAST_TURN and rate > 0.0 else []
    return ratios


def _hardest_turn(cells: np.ndarray, channels: Channels) -> float:
    """Acceleration [m/s2] of the ship in its turns if the stamps are seconds; 0 without heading and speed."""
    rows = _common_rows(cells, channels, ("psi", "u"))
    if rows is None:
        return 0.0
    turns, steps = (np.abs(_chords(values)) for values in (np.unwrap(_filled(channels["psi"])[rows]), cells[rows]))
    rates = turns[steps > 0.0] / steps[steps > 0.0]
    return float(np.nanmedian(np.abs(channels["u"][rows])) * np.quantile(rates, 0.9)) if rates.size else 0.0


def _common_rows(cells: np.ndarray, channels: Channels, names: tuple[str, ...]) -> np.ndarray | None:
    """Rows with a stamp between the first and the last cell of all channels; None for too few."""
    if not set(names) <= set(channels):
        return None
    ends = [np.flatnonzero(np.isfinite(channels[name]))[[0, -1]] for name in names if np.isfinite(channels[name]).any()]
    if len(ends) < len(names):
        return None
    begin, end = np.max(ends, axis=0)[0], np.min(ends, axis=0)[1]
    rows = np.flatnonzero(np.isfinite(cells[begin : end + 1])) + begin
    return rows if rows.size >= 2 * _CHORDS else None


def _filled(values: np.ndarray) -> np.ndarray:
    index, known = np.arange(values.size), np.isfinite(values)
    return np.interp(index, index[known], values[known]) if known.any() else np.zeros(values.size)


def _chords(values: np.ndarray) -> np.ndarray:
    return np.diff(values[np.linspace(0, values.size - 1, _CHORDS).astype(int)])


def _integrals(time: np.ndarray, rate: np.ndarray) -> np.ndarray:
    steps = np.maximum(np.diff(time), 0.0)
    return _chords(np.concatenate([[0.0], np.cumsum(0.5 * (rate[1:] + rate[:-1]) * steps)]))


def _without_rollovers(
    time: np.ndarray, period: float, least: float, begins: Sequence[int]
) -> tuple[np.ndarray, list[str]]:
    """Stamps with a period [s] added from each jump back by ``least`` [s] or more on, and a sentence.

    Each of several files counts its own, from that period in which it begins nearest to the first.
    """
    known = np.flatnonzero(np.isfinite(time))
    if not np.isfinite(period) or not known.size:
        return time, []
    turns = np.concatenate([[0], np.cumsum(np.diff(time[known]) < -least)])
    for begin in np.searchsorted(known, begins[1:]):
        if begin < known.size:
            nearest = round(float(time[known[0]] - time[known[begin]]) / period)
            turns[begin:] += nearest - turns[begin]
    if not turns.any():
        return time, []
    continuous = time.copy()
    continuous[known] += period * turns
    times = f"{int(turns.max())} time{'s' if turns.max() > 1 else ''}"
    return continuous, [f"time: the clock starts again {times}, as at midnight; {period:g} s added each time."]
