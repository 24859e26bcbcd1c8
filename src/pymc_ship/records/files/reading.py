"""Reading of trial files: text or gzip, any usual delimiter, headings with units, rows with gaps."""

from __future__ import annotations

import csv
import os
import re
from collections import Counter
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import dataclass, field, replace
from itertools import accumulate
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr

from pymc_ship.machine.arguments import as_path
from pymc_ship.machine.errors import TrialError
from pymc_ship.machine.text import TextError, file_text
from pymc_ship.records.files.clock import (
    clock_of_numbers,
    clock_of_text,
    date_columns,
    fraction_columns,
    stamp_of_parts,
    with_fraction,
)
from pymc_ship.records.files.columns import (
    GROUND,
    MISSING_CELLS,
    OF_CLOCK,
    PAIRS,
    ROS,
    Column,
    cell_numbers,
    channels_of,
    clock_column,
    is_over_ground,
    is_unit,
    matched_columns,
    plain_text,
    receiver_stand_ins,
    without_thousands,
)
from pymc_ship.records.files.format import (
    TrialFormat,
    at_origin,
    check_course,
    full_scale,
    load_format,
    with_ground,
    with_signs,
    with_true_wind,
)
from pymc_ship.records.files.interpolation import brought_together, interpolated
from pymc_ship.records.files.sides import (
    FOUND,
    bare_numbers,
    shows_axes,
    with_letters_beside,
    with_minutes,
    with_rudder_side,
)
from pymc_ship.records.files.tables import Columns, bag_of, binary_columns, cell_texts, check_size, nmea_columns
from pymc_ship.records.files.time_base import Regular, in_order, regular, rounding
from pymc_ship.trial.channels import CHANNELS, TIME
from pymc_ship.trial.record import ASSUMED, AXES, OVER_GROUND, SETTINGS, rudder_line

_COMMENTS = ("#", "%")
_FEWEST_LINES, _MOST_TITLES = 4, 200  # lines of a table that have titles before the header, and the most of these
_LONGEST_HEADING, _LONGEST_STAMP = 100, 40  # letters
_COUNTED = 1000  # rows by which a counter is known
_SIDES = ("port", "starboard")
_OPEN_QUOTE = re.compile(r'(?:^|[,;\t])"[^"]*$')  # of a cell that goes on in the next line
_BEGIN_OF_STAMP = re.compile(r"\s*\d+[-:/.]\d")
_DATE_AND_TIME = re.compile(r"(\d[-/.]\d+) +(\d+:\d)")  # of one heading, in columns between white space
_REPEATED = 1.5  # rows of one stamp, in the mean, from which another clock precedes
_AROUND_UNITS = " []{}()-"
_LARGEST = 1e30  # numbers from here up count as missing, numbers below its inverse as zero


def read_trial(path: str | Path, *, format: str | Path | Mapping[str, Any] | None = None) -> xr.Dataset:
    """Read a trial from a file, text, NMEA 0183, Parquet, xlsx, NetCDF, MAT or a bag of ROS, or from several.

    Columns are recognised by their headings: names of channels, in SI units unless stated (``u``, ``psi [deg]``,
    ``n_rpm``), or words such as ``Heading (deg)``. Uneven time and short gaps are interpolated, and reported.

    Parameters
    ----------
    path : str or Path
        Text (delimiters are comma, semicolon, tab or white space; lines that begin with # or % are comments), or a
        table of another format, known by its content, whose columns have the headings of a text file. Or a folder: the
        files of one run by the same clock, such as one for each sensor, are joined.
    format : str, Path or mapping, optional
        TOML file, or its table, with columns, units, signs, frame and scale; see docs/reference/format_toml.md.

    Returns
    -------
    Dataset, dims (time,)
        Finite channels over uniform time. ``attrs["reading"]`` has a line for each interpretation or change.

    Raises
    ------
    TrialError
        For a file, a format, a heading or a cell that cannot be read; names file and line or column.

    Examples
    --------
    >>> import numpy as np
    >>> import pymc_ship as ps
    >>> rows = ["time [s],u [kn],Heading [deg]", "0,10,359", "1,10,0", "2,10,1"]
    >>> np.savetxt("run.csv", rows, fmt="%s")
    >>> trial = ps.read_trial("run.csv")
    >>> print(trial["u"].values.round(3))
    [5.144 5.144 5.144]
    >>> print(trial.attrs["reading"].splitlines()[-1])
    psi made continuous over 1 jump of 360 deg.
    """
    return read_file(path, format).trial


@dataclass(frozen=True)
class FileReading:
    """Trial of a file; the format that reproduces it, columns by channel, and the headings that were left out."""

    trial: xr.Dataset
    layout: TrialFormat
    columns: dict[str, Column]
    left_out: tuple[str, ...]


def read_file(path: str | Path, format: str | Path | Mapping[str, Any] | None = None) -> FileReading:
    """Trial of a file as by :func:`read_trial`, with what each column was taken for."""
    path, given = bag_of(as_path("path", path, TrialError)), load_format(format)
    table = _with_whole_stamps(text_table(path, given))
    columns, stated, notes = _chosen_columns(table, given, str(path))
    (time, channels, time_notes, rows_lost), layout = _time_series(table, columns, stated, path)
    notes += time_notes
    for to_ship in (at_origin, with_true_wind):
        channels, changes = to_ship(channels, layout, str(path))
        notes += changes
    time, channels, scale_notes = full_scale(time, channels, layout.froude)
    variables = {name: ("time", values, {"units": CHANNELS[name].unit.name}) for name, values in channels.items()}
    attrs: dict[str, Any] = {"reading": "\n".join([*notes, *scale_notes])}
    if not (table.shows_axes or shows_axes(columns, layout)):
        attrs[AXES] = ASSUMED
    if rows_lost:
        attrs["rows_lost"] = rows_lost
    if layout.speeds == OVER_GROUND:
        attrs["speeds"] = OVER_GROUND
    if layout.facility:
        attrs["facility"] = layout.facility
    trial = xr.Dataset(variables, {"time": ("time", time, {"units": "s"})}, attrs)
    side = table.rudder_positive if layout.rudder_positive == "auto" else layout.rudder_positive
    trial = with_rudder_side(trial, side or "auto", str(path))
    used = {column.index for column in columns.values()}
    left_out = tuple(heading for k, heading in enumerate(table.headings) if heading and k not in used)
    settings = {"rudder_positive": trial.attrs.get(FOUND, side or "auto")}
    settings |= {"columns": {name: column.choice() for name, column in columns.items()}}
    return FileReading(trial, replace(stated, **settings), columns, left_out)


def _chosen_columns(
    table: TextTable, layout: TrialFormat, where: str
) -> tuple[dict[str, Column], TrialFormat, list[str]]:
    """Columns by channel, the format with what the file itself states, and notes."""
    usual = TrialFormat()
    settings: dict[str, Any] = {k: v for k, v in table.settings.items() if getattr(layout, k) == getattr(usual, k)}
    layout = replace(layout, **settings)
    unstated, coarse = layout.unstated_units, _coarse(table)
    columns, notes = matched_columns(table.headings, table.units, layout.columns, where, unstated, coarse)
    columns, minute_notes = with_minutes(columns, table.rows)
    counters = [one for one in columns.values() if _is_counter(one, table.rows)]
    notes += minute_notes + [f"{one.heading!r} counts the rows: left out." for one in counters]
    columns = {name: one for name, one in columns.items() if one not in counters}
    if not layout.convention and any(column.named_by == ROS for column in columns.values()):
        layout = replace(layout, convention="enu-flu")
        notes.append('Axes of ROS: x east, y north, v to port; for others, state the convention, such as "ned".')
    return columns, layout, [*table.notes, *notes]


def _is_counter(column: Column, rows: list[list[str]]) -> bool:
    """Whether a column of no stated unit, other than the time, has the number of each row, as an n may."""
    if column.stated or column.channel == TIME.name or column.named_by == "the format file":
        return False
    numbers = np.array(cell_numbers([row[column.index].strip() for row in rows[:_COUNTED]]), dtype=float)
    if numbers.size <= _FEWEST_LINES or not np.isfinite(numbers[0]):
        return False
    return np.array_equal(numbers, numbers[0] + np.arange(numbers.size))


def _time_series(
    table: TextTable, columns: dict[str, Column], stated: TrialFormat, path: Path
) -> tuple[Regular, TrialFormat]:
    """Channels of a table in the units and axes of the package, over uniform time; the format with what they showed."""
    where, clock, stamps = str(path), columns["time"], _stamps(table, columns["time"])
    numeric = {name: column for name, column in columns.items() if column is not clock or not stamps}
    cells, cell_notes = table_cells(table, numeric, path)
    raw = {name: column.si(cells[name]) for name, column in numeric.items() if column is not clock}
    channels, layout, sign_notes = _in_ship_axes(raw, stated, where)
    begins = [*table.begins.values()]
    if stamps:
        time, quantum, clock_notes = clock_of_text(stamps, table.lines, clock, channels, where, begins)
    else:
        time, quantum, clock_notes = clock_of_numbers(cells["time"], rounding(cells["time"]), clock, channels, begins)
    check_course(columns, raw, time, where)
    delays = {name: column.delay for name, column in columns.items() if column.delay}
    pairs = [pair for pair, made in PAIRS.items() if made.isdisjoint(columns)]
    raw, pair_notes = brought_together(time, _undelayed(raw, time, delays), pairs)
    if delays or pair_notes:
        channels, layout, sign_notes = _in_ship_axes(raw, stated, where)
        sign_notes += pair_notes + [f"{name}: the delay of {delay:g} s removed." for name, delay in delays.items()]
    if table.begins:
        time, quantum, channels = in_order(time, quantum, channels, table.begins)
    series = regular(time, quantum, channels, where)
    notes = [*clock_notes, *cell_notes, *_implausible(columns, cells), *sign_notes, *series.notes]
    return series._replace(notes=notes), layout


def _in_ship_axes(
    raw: dict[str, np.ndarray], layout: TrialFormat, where: str
) -> tuple[dict[str, np.ndarray], TrialFormat, list[str]]:
    """Channels of the columns with the signs of the format, over ground where they are of a receiver; sentences."""
    channels, sign_notes = with_signs(raw, layout)
    channels, layout, ground_notes = with_ground(channels, layout, where)
    return channels, layout, [*sign_notes, *ground_notes]


def _undelayed(raw: dict[str, np.ndarray], time: np.ndarray, delays: Mapping[str, float]) -> dict[str, np.ndarray]:
    """Channels with those of a delay [s] as they were at their stamps; NaN where that is later than their last."""
    channels = dict(raw)
    for name, delay in delays.items():
        known = np.flatnonzero(np.isfinite(raw[name] + time))
        known = known[np.argsort(time[known], kind="stable")]
        stamps, values = time[known], raw[name][known]
        values = np.unwrap(values) if name in ("psi", "cog") else values
        at = stamps + delay
        inside = (at >= stamps[0]) & (at <= stamps[-1]) if known.size else np.zeros(0, dtype=bool)
        channels[name] = np.full(time.size, np.nan)
        channels[name][known[inside]] = interpolated(name, at[inside], stamps, values)
    return channels


@dataclass(frozen=True)
class TextTable:
    """Headings, units, rows of cells, line number of each row, notes, and the side of the rudder if the file has it.

    ``settings``: keys of the format that a file of :func:`pymc_ship.write_trial` states, such as ``facility``.
    ``shows_axes``: whether a file of its kind has axes of its own, that of a logger or of this package. ``begins``: the
    first row of each file, for a table of several.
    """

    headings: list[str]
    units: list[str]
    rows: list[list[str]]
    lines: list[int]
    notes: list[str]
    rudder_positive: str = ""
    shows_axes: bool = False
    begins: dict[str, int] = field(default_factory=dict)
    settings: dict[str, str] = field(default_factory=dict)


def _text(path: Path) -> str:
    try:
        return plain_text(file_text(path))
    except TextError as error:
        raise TrialError(f"The trial {path} cannot be read: {error}.") from None


def text_table(path: Path, layout: TrialFormat) -> TextTable:
    """Header, units and rows of a file or of those of a folder; TrialError if one cannot be read or is not a table."""
    if os.path.isdir(path):  # False for a name that no file can have
        return _joined_table(path, layout)
    if binary := binary_columns(path):
        return _with_bare_numbers(_table_of_series(*binary))
    text = _text(path)
    check_size(path, [max(map(text.count, "\n\r"))])
    lines = _unbroken(re.split(r"\r\n|\n|\r", text))
    if log := nmea_columns(lines, path):
        return _table_of_log(*log)
    skipped = layout.skip_rows
    numbered = [(number, line) for number, line in enumerate(lines, 1) if number > skipped and line.strip()]
    comments = [(number, line) for number, line in numbered if line.lstrip().startswith(_COMMENTS)]
    content = [(number, line) for number, line in numbered if not line.lstrip().startswith(_COMMENTS)]
    content = _with_header(content, comments)
    titles = _titles(content, layout.delimiter or "")
    content = content[titles:]
    if content and all(map(_is_number, _cells_of_line(content[0][1], _delimiter(content[0][1])))):
        raise TrialError(
            f"{path}, line {content[0][0]}: a trial has a header before its numbers, found "
            f"{content[0][1].strip()[:60]!r}; add a line such as time [s], u [kn], psi [deg]."
        )
    if len(content) < 3:
        raise TrialError(f"{path}: a trial has a header and at least two rows, found {len(content)} lines; check it.")
    delimiter = layout.delimiter or _delimiter(content[0][1])
    if delimiter == " " and len(content[-1][1].split()) == len(content[0][1].split()) + 1:
        content = [(number, _DATE_AND_TIME.sub(r"\1T\2", line)) for number, line in content]
    first = _cells_of_line(content[1][1], delimiter)
    check_size(path, [len(content)] * len(first))
    heads = [line.strip() for _, line in content[: 2 if _is_unit_row(first) else 1]]
    body = [(number, line) for number, line in content[len(heads) :] if line.strip() not in heads]
    again = len(content) - len(heads) - len(body)
    rows = [(number, _cells_of_line(line, delimiter)) for number, line in body]
    headings = _headings(content[0][1], delimiter, max([len(first), *(len(cells) for _, cells in rows)]))
    units = [cell.strip(_AROUND_UNITS) for cell in first] if len(heads) > 1 else []
    units += [""] * (len(headings) - len(units))
    whole, notes = _whole_rows(rows, len(headings), path)
    notes = [f"The header is repeated {again} times: these lines left out.", *notes] if again else notes
    notes = [f"{titles} lines before the header left out.", *notes] if titles else notes
    cells, at = [row for _, row in whole], [number for number, _ in whole]
    table = TextTable(headings, units, cells, lines=at, notes=notes)
    return _with_bare_numbers(replace(table, **_stated_in([line for _, line in comments])))


def _stated_in(comments: list[str]) -> dict[str, Any]:
    """What the comments of a file of :func:`pymc_ship.write_trial` state of its table."""
    side = next((side for line in comments for side in _SIDES if line.startswith(rudder_line(side))), "")
    begins = {key: f'# {key} = "' for key in SETTINGS}
    settings = {k: one.split('"')[1] for k, begin in begins.items() for one in comments if one.startswith(begin)}
    own = bool(side) and not any(ASSUMED in line for line in comments)
    return {"rudder_positive": side, "shows_axes": own, "settings": settings}


def _joined_table(folder: Path, layout: TrialFormat) -> TextTable:
    """Rows of the files of a folder, one file after the other; a heading of a second file has its name before it."""
    files = [one for one in sorted(folder.iterdir()) if one.is_file() and one.suffix != ".toml" and one.name[0] != "."]
    if len(files) < 2:
        raise TrialError(f"{folder}: a folder of one run has two files or more, found {len(files)}; name the file.")
    headings, units, clocks = [""], [""], {}
    joined = TextTable(headings, units, rows=[], lines=[], notes=[])
    stated, size, side, own = layout.columns.get("time", {}).get("column", ""), 0, "", False
    for file in files:
        table = _with_whole_stamps(text_table(file, layout))
        clock, clocks[file.name] = clock_column(table.headings, table.units, stated, str(file), _coarse(table))
        headings[0], units[0] = headings[0] or table.headings[clock], units[0] or table.units[clock]
        side, own = side or table.rudder_positive, own or table.shows_axes
        targets, begin = [k for k, heading in enumerate(table.headings) if heading and k != clock], len(headings)
        names = [table.headings[k] for k in targets]
        headings += [f"{file.stem}.{name}" if name in headings else name for name in names]
        units += [table.units[k] for k in targets]
        joined.begins[file.name], size = len(joined.rows), size + len(table.rows)
        check_size(folder, [size] * len(headings))
        joined.rows.extend([row[clock], *[""] * (begin - 1), *(row[k] for k in targets)] for row in table.rows)
        joined.lines.extend(table.lines)
        joined.notes.extend(f"{file.name}: {note}" for note in [f"{len(table.rows)} rows.", *table.notes])
    if len(set(clocks.values())) > 1:
        found = ", ".join(f"{unit or 'no unit'} in {name}" for name, unit in clocks.items())
        raise TrialError(f"{folder}: the time of the files of a run has one unit, found {found}; state the same one.")
    rows = [row + [""] * (len(headings) - len(row)) for row in joined.rows]
    return replace(joined, rows=rows, rudder_positive=side, shows_axes=own)


def _table_of_series(columns: Columns, notes: list[str]) -> TextTable:
    """Table of the columns of a binary file, whose first row may have the units."""
    cells, units = [cell_texts(one.values) for one in columns], [one.unit for one in columns]
    if not any(units) and _is_unit_row([column[0] for column in cells]):
        units = [column[0].strip(_AROUND_UNITS) for column in cells]
        cells = [column[1:] for column in cells]
    return _table_of_columns([one.heading for one in columns], units, cells, notes)


def _table_of_log(cells: dict[str, list[str]], units: dict[str, str], notes: list[str]) -> TextTable:
    """Table of a log of NMEA 0183, which counts the rudder positive to starboard."""
    table = _table_of_columns(list(cells), [units.get(name, "") for name in cells], list(cells.values()), notes)
    return replace(_with_bare_numbers(table), rudder_positive="starboard", shows_axes=True)


def _table_of_columns(headings: list[str], units: list[str], columns: list[list[str]], notes: list[str]) -> TextTable:
    rows = [list(row) for row in zip(*columns, strict=True)]
    return TextTable([*map(_heading, headings)], units, rows, lines=list(range(1, len(rows) + 1)), notes=notes)


def _with_header(content: list[tuple[int, str]], comments: list[tuple[int, str]]) -> list[tuple[int, str]]:
    """Lines with the header first; it may be the last comment before the numbers."""
    first = _cells_of_line(content[0][1], _delimiter(content[0][1]))[0] if content else ""
    if not (_is_number(first) or _BEGIN_OF_STAMP.match(first)):
        return content
    before = [(number, line.strip(" \t#%")) for number, line in comments if number < content[0][0]]
    return [*before[-1:], *content]


def _unbroken(lines: list[str]) -> list[str]:
    """Lines with each quoted heading in one of them; those that it took are empty."""
    lines = list(lines)
    for k in [k for k, line in enumerate(lines[:_MOST_TITLES]) if _OPEN_QUOTE.search(line)]:
        quotes = accumulate(line.count('"') for line in lines[k : k + _MOST_TITLES])
        last = k + next((more for more, count in enumerate(quotes) if count % 2 == 0), 0)
        taken = lines[k + 1 : last + 1]
        if not any(_is_number(_cells_of_line(line, _delimiter(line))[0]) for line in taken if line.strip()):
            lines[k : last + 1] = [" ".join([lines[k], *taken]), *[""] * len(taken)]
    return lines


def _titles(content: list[tuple[int, str]], delimiter: str) -> int:
    """Number of lines before the header, which is filled, of words, and as wide as most rows at the end of the file."""
    ends = [line for _, line in content[-2 * _FEWEST_LINES :]]
    mark = delimiter or Counter(map(_delimiter, ends)).most_common(1)[0][0] if ends else " "
    width, rows = Counter(len(_cells_of_line(line, mark)) for line in ends).most_common(1)[0] if ends else (0, 0)
    if mark == " " or len(content) < _FEWEST_LINES or rows <= 0.5 * len(ends):
        return 0
    for titles, (_, line) in enumerate(content[:_MOST_TITLES]):
        cells = _cells_of_line(line, mark)
        if len(cells) == width and sum(map(bool, map(str.strip, cells))) > 0.5 * width:
            return 0 if _is_unit_row(cells) or any(map(_is_number, cells)) else titles
    return 0


def _delimiter(header: str) -> str:
    plain = re.sub(r"\[[^\[\]]*\]|\([^()]*\)", "", header)
    return next((delimiter for delimiter in (";", "\t", ",") if delimiter in plain), " ")


def _cells_of_line(line: str, delimiter: str) -> list[str]:
    if delimiter == " ":
        return line.split()
    if '"' in line:
        with suppress(csv.Error, StopIteration):
            return next(csv.reader([line], delimiter=delimiter))
    return line.split(delimiter)


def _headings(line: str, delimiter: str, n_cells: int) -> list[str]:
    """Names in the header, but for a last one without cells, such as remarks, in rows of ``n_cells`` at most.

    In a table with white space a bracketed unit belongs to the name before it.
    """
    if delimiter != " ":
        headings = [heading.strip() for heading in _cells_of_line(line, delimiter)]
    else:
        joined = re.sub(r"(?<!\s)\s+([\[(])", r"\1", line.strip())
        headings = joined.split()
        if len(headings) != n_cells:
            headings = re.split(r"\s{2,}|\t", joined)
    while headings and not headings[-1]:
        headings.pop()
    if len(headings) == n_cells + 1 and any(map(channels_of, headings)) and not channels_of(headings[-1]):
        headings.pop()
    return [*map(_heading, headings)]


def _heading(text: str) -> str:
    """First letters of a heading, those that are not printed replaced."""
    plain = re.sub(r"\s", " ", plain_text(text[:_LONGEST_HEADING]))
    return "".join(letter if letter.isprintable() else "?" for letter in plain)


def _is_unit_row(cells: list[str]) -> bool:
    if not any(map(is_unit, cells)) or any(map(_is_number, cells)):
        return False
    named = [cell for cell in cells if channels_of(cell) and not is_unit(cell)]
    return all(OF_CLOCK.fullmatch(cell.strip(_AROUND_UNITS)) for cell in named)


def _is_number(cell: str) -> bool:
    try:
        float(cell.strip().replace(",", "."))
    except ValueError:
        return False
    return True


def _whole_rows(rows: list[tuple[int, list[str]]], n: int, path: Path) -> tuple[list[tuple[int, list[str]]], list[str]]:
    """Rows with a cell for each heading, without empty rows and an incomplete last one."""
    filled = [(number, cells) for number, cells in rows if any(map(str.strip, cells))]
    notes = [f"{len(rows) - len(filled)} empty rows left out."] if len(filled) < len(rows) else []
    if filled and len(filled[-1][1]) < n:
        number, cells = filled[-1]
        notes.append(f"Line {number}, the last, left out: it breaks off after {len(cells)} of {n} columns.")
        filled.pop()
    if len(filled) < 2:
        raise TrialError(f"{path}: a trial has a header and at least two rows, found {len(filled)} complete; check it.")
    for number, cells in filled:
        if len(cells) < n or any(map(str.strip, cells[n:])):
            raise TrialError(
                f"{path}, line {number}: the header has {n} columns, found {len(cells)}; mend it, or state how many "
                "lines stand before the header, skip_rows, in a format file."
            )
    return filled, notes


def _with_whole_stamps(table: TextTable) -> TextTable:
    """Table whose milli- or nanoseconds are decimals of the stamps beside, and whose parts of a date are one stamp."""
    headings, rows, notes = list(table.headings), table.rows, list(table.notes)
    for seconds, (fraction, digits) in fraction_columns(headings).items():
        with suppress(ValueError):
            stamps = [with_fraction(row[seconds], row[fraction], digits) for row in rows]
            rows = [[*row[:seconds], stamp, *row[seconds + 1 :]] for row, stamp in zip(rows, stamps, strict=True)]
            notes.append(f"{headings[fraction]!r} added to {headings[seconds]!r}.")
            headings[fraction] = ""
    if parts := date_columns(headings):
        *others, last = parts
        notes.append(f"Stamps of {', '.join(repr(headings[k]) for k in parts)}.")
        rows = [[*row[:last], stamp_of_parts([row[k] for k in parts]), *row[last + 1 :]] for row in rows]
        headings = ["" if k in others else "time" if k == last else heading for k, heading in enumerate(headings)]
    return replace(table, headings=headings, rows=rows, notes=notes)


def _coarse(table: TextTable) -> set[int]:
    """Columns of time most of whose stamps repeat."""
    clocks = [k for k, heading in enumerate(table.headings) if TIME in channels_of(heading)]
    if len(clocks) < 2:
        return set()
    return {k for k in clocks if len(table.rows) > _REPEATED * len({row[k] for row in table.rows})}


def _with_bare_numbers(table: TextTable) -> TextTable:
    """Table whose cells have numbers alone; a rudder with letters of its side is positive to starboard."""
    headings, rows = with_letters_beside(table.headings, table.rows)
    units, notes, stated = list(table.units), list(table.notes), dict(table.settings)
    for k, heading in enumerate(table.headings):
        if read := bare_numbers(heading, units[k], rows, k):
            rows = [[*row[:k], number, *row[k + 1 :]] for row, number in zip(rows, read.cells, strict=True)]
            stated |= read.stated
            units[k] = read.unit
            notes += read.notes
    side = stated.pop("rudder_positive", table.rudder_positive)
    return replace(table, headings=headings, units=units, rows=rows, notes=notes, rudder_positive=side, settings=stated)


def _stamps(table: TextTable, column: Column) -> list[str]:
    """Stamps if most of them are text, empty where missing; no item if most are numbers."""
    stamps = [row[column.index].strip()[:_LONGEST_STAMP] for row in table.rows]
    stamps = ["" if stamp.lower() in MISSING_CELLS else stamp for stamp in stamps]
    texts = sum(not _is_number(stamp) for stamp in stamps if stamp)
    return stamps if texts > 0.5 * sum(map(bool, stamps)) else []


def table_cells(table: TextTable, columns: dict[str, Column], path: Path) -> tuple[dict[str, np.ndarray], list[str]]:
    """Numbers of each column, NaN for missing cells."""
    texts = {name: [row[column.index].strip() for row in table.rows] for name, column in columns.items()}
    joined = {name: "".join(cells) for name, cells in texts.items()}
    texts, counts, doubtful = without_thousands(texts, joined)
    joined |= {name: "".join(texts[name]) for name in counts}
    notes = [f"Thousands separators of {count} cells of {columns[k].heading} left out." for k, count in counts.items()]
    notes += [
        f"{columns[name].heading}: marks as in {texts[name][0]!r} taken as decimal; if they separate thousands, leave "
        "them out of the file."
        for name in doubtful
    ]
    with_mark = {mark: [name for name, text in joined.items() if mark in text] for mark in ",."}
    if with_mark[","] and not with_mark["."]:
        texts = {name: [cell.replace(",", ".") for cell in cells] for name, cells in texts.items()}
        notes.append("Decimal commas read as points.")
    numbers = {}
    for name, cells in texts.items():
        values = cell_numbers(cells)
        if None in values:
            position = values.index(None)
            cell = cells[position][:_LONGEST_STAMP]
            marked = ", ".join(columns[one].heading for one in with_mark["."] if "," in cell)
            remedy = f"beside points in {marked}; write one decimal mark" if marked else "correct or empty the cell"
            raise TrialError(
                f"{path}, line {table.lines[position]}, column {columns[name].heading}: a number is needed, found "
                f"{cell!r}{' ' if marked else '; '}{remedy}."
            )
        numbers[name] = np.array(values)
        numbers[name][~(np.abs(numbers[name]) < _LARGEST)] = np.nan
        small = (numbers[name] != 0.0) & (np.abs(numbers[name]) < 1.0 / _LARGEST)
        numbers[name][small] = 0.0
        if small.any():
            notes.append(f"{int(small.sum())} cells of {name}, all within {1.0 / _LARGEST:g} of zero, read as 0.")
    return numbers, [*notes, *_without_stand_ins(columns, numbers)]


def _without_stand_ins(columns: dict[str, Column], numbers: dict[str, np.ndarray]) -> list[str]:
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


def _implausible(columns: dict[str, Column], cells: dict[str, np.ndarray]) -> list[str]:
    """A remark on rudder and roll angles that are too large for rad."""
    notes = []
    for name in ("phi", "delta"):
        if name in columns and columns[name].unit == "rad":
            largest = np.abs(cells[name][np.isfinite(cells[name])]).max(initial=0.0)
            if largest > 0.5 * np.pi:
                notes.append(f"{name} reaches {largest:.3g} rad; if it is in deg, call the column '{name} [deg]'.")
    return notes
