"""Reading of trial files: text or gzip, any usual delimiter, headings with units, rows with gaps."""

from __future__ import annotations

import os
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import dataclass, field, replace
from itertools import chain
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr

from pymc_ship.machine.arguments import as_path
from pymc_ship.machine.errors import TrialError
from pymc_ship.machine.text import MOST_BYTES, TextError, file_text, text_blocks, text_size
from pymc_ship.records.files.clock import (
    clock_of_numbers,
    clock_of_text,
    date_columns,
    fraction_columns,
    stamp_of_parts,
    with_fraction,
)
from pymc_ship.records.files.columns import (
    PAIRS,
    ROS,
    Column,
    channels_of,
    clock_column,
    counts_the_rows,
    implausible_angles,
    matched_columns,
    without_stand_ins,
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
from pymc_ship.records.files.interpolation import brought_together, undelayed
from pymc_ship.records.files.sides import (
    FOUND,
    bare_numbers,
    shows_axes,
    with_letters_beside,
    with_minutes,
    with_rudder_side,
)
from pymc_ship.records.files.tables import (
    Columns,
    bag_of,
    binary_columns,
    cell_texts,
    check_size,
    column_cells,
)
from pymc_ship.records.files.text_rows import (
    AROUND_UNITS,
    is_number,
    is_unit_row,
    line_blocks,
    nmea_columns,
    plain_heading,
    text_rows,
)
from pymc_ship.records.files.time_base import Regular, in_order, regular, rounding, without_mixed_medians
from pymc_ship.trial.cells import (
    MISSING_CELLS,
    Cells,
    Numbers,
    among_missing,
    cell_numbers,
    cells_of,
    end_to_end,
    number_of_different,
    texts_of,
    without_thousands,
)
from pymc_ship.trial.channels import CHANNELS, TIME
from pymc_ship.trial.record import ASSUMED, AXES, OVER_GROUND, SETTINGS, rudder_line
from pymc_ship.trial.thinning import LARGEST, MOST_ROWS

_LONGEST_STAMP = 40  # letters
_FIRST_LINES = 200  # that may come before the rows, and by which a long log is known
_SIDES = ("port", "starboard")
_REPEATED = 1.5  # rows of one stamp, in the mean, from which another clock precedes


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
    """Trial of a file; the format that reproduces it, columns by channel, and the headings that were left out.

    The column of time has the unit that its cells showed, such as days.
    """

    trial: xr.Dataset
    layout: TrialFormat
    columns: dict[str, Column]
    left_out: tuple[str, ...]


def read_file(path: str | Path, format: str | Path | Mapping[str, Any] | None = None) -> FileReading:
    """Trial of a file as by :func:`read_trial`, with what each column was taken for."""
    path, given = bag_of(as_path("path", path, TrialError)), load_format(format)
    table = _with_whole_stamps(text_table(path, given))
    columns, stated, notes = _chosen_columns(table, given, str(path))
    (time, channels, time_notes, rows_lost), layout, unit = _time_series(table, columns, stated, path)
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
    if unit != columns["time"].unit:
        columns = columns | {"time": replace(columns["time"], unit=unit, unit_by="its cells")}
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
    columns, minute_notes = with_minutes(columns, table.columns)
    counters = [one for one in columns.values() if counts_the_rows(one, table.columns[one.index])]
    notes += minute_notes + [f"{one.heading!r} counts the rows: left out." for one in counters]
    columns = {name: one for name, one in columns.items() if one not in counters}
    if not layout.convention and any(column.named_by == ROS for column in columns.values()):
        layout = replace(layout, convention="enu-flu")
        notes.append('Axes of ROS: x east, y north, v to port; for others, state the convention, such as "ned".')
    return columns, layout, [*table.notes, *notes]


def _time_series(
    table: TextTable, columns: dict[str, Column], stated: TrialFormat, path: Path
) -> tuple[Regular, TrialFormat, str]:
    """Channels of a table in SI units and ship axes over uniform time, their format, and the unit of the clock."""
    where, clock, stamps = str(path), columns["time"], _stamps(table, columns["time"])
    numeric = {name: column for name, column in columns.items() if column is not clock or not stamps}
    cells, cell_notes = table_cells(table, numeric, path)
    raw = {name: column.si(cells[name]) for name, column in numeric.items() if column is not clock}
    channels, layout, sign_notes = _in_ship_axes(raw, stated, where)
    begins = [*table.begins.values()]
    if stamps:
        time, quantum, unit, clock_notes = clock_of_text(stamps, table.lines, clock, channels, where, begins)
    else:
        resolution = rounding(cells["time"])
        time, quantum, unit, clock_notes = clock_of_numbers(cells["time"], resolution, clock, channels, begins)
    check_course(columns, raw, time, where)
    if table.every > 1:
        time, gap_notes = without_mixed_medians(time, quantum, begins)
        clock_notes += gap_notes
    delays = {name: column.delay for name, column in columns.items() if column.delay}
    pairs = [pair for pair, made in PAIRS.items() if made.isdisjoint(columns)]
    raw, pair_notes = brought_together(time, undelayed(raw, time, delays), pairs)
    if delays or pair_notes:
        channels, layout, sign_notes = _in_ship_axes(raw, stated, where)
        sign_notes += pair_notes + [f"{name}: the delay of {delay:g} s removed." for name, delay in delays.items()]
    if table.begins:
        time, quantum, channels = in_order(time, quantum, channels, table.begins)
    series = regular(time, quantum, channels, where)
    notes = [*clock_notes, *cell_notes, *implausible_angles(columns, cells), *sign_notes, *series.notes]
    return series._replace(notes=notes), layout, unit


def _in_ship_axes(
    raw: dict[str, np.ndarray], layout: TrialFormat, where: str
) -> tuple[dict[str, np.ndarray], TrialFormat, list[str]]:
    """Channels of the columns with the signs of the format, over ground where they are of a receiver; sentences."""
    channels, sign_notes = with_signs(raw, layout)
    channels, layout, ground_notes = with_ground(channels, layout, where)
    return channels, layout, [*sign_notes, *ground_notes]


@dataclass(frozen=True)
class TextTable:
    """Headings, units, cells of each column, line number of each row, notes, and the side of the rudder if it is known.

    ``settings``: keys of the format that a file of :func:`pymc_ship.write_trial` states, such as ``facility``.
    ``shows_axes``: whether a file of its kind has axes of its own, that of a logger or of this package. ``begins``: the
    first row of each file, for a table of several. ``every``: rows of a file of which one is left, at most.
    """

    headings: list[str]
    units: list[str]
    columns: list[Cells]
    lines: np.ndarray
    notes: list[str]
    rudder_positive: str = ""
    shows_axes: bool = False
    begins: dict[str, int] = field(default_factory=dict)
    settings: dict[str, str] = field(default_factory=dict)
    every: int = 1


def text_table(path: Path, layout: TrialFormat) -> TextTable:
    """Header, units and rows of a file or of those of a folder; TrialError if one cannot be read or is not a table."""
    if os.path.isdir(path):  # False for a name that no file can have
        return _joined_table(path, layout)
    if binary := binary_columns(path, layout.columns):
        return _with_bare_numbers(_table_of_series(*binary))
    try:
        return _table_of_text(path, layout)
    except TextError as error:
        raise TrialError(f"The trial {path} cannot be read: {error}.") from None


def _table_of_text(path: Path, layout: TrialFormat) -> TextTable:
    """Table of a text file; TextError for one that cannot be read."""
    n_bytes, n_lines = text_size(path)
    whole = n_bytes <= MOST_BYTES and n_lines <= MOST_ROWS + _FIRST_LINES
    blocks = line_blocks([file_text(path)] if whole else text_blocks(path))
    lines = next(blocks)
    if log := nmea_columns(lines if whole else lines[:_FIRST_LINES], path):
        if not whole:
            raise TextError(f"its log has more than {MOST_BYTES / 1e6:.0f} MB or {MOST_ROWS} lines; split it")
        return _table_of_log(*log)
    read = text_rows(chain([lines], blocks), n_lines, layout, path, whole=whole)
    table = TextTable(read.headings, read.units, read.columns, lines=read.lines, notes=read.notes, every=read.every)
    return _with_bare_numbers(replace(table, **_stated_in(read.comments)))


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
    joined = TextTable(headings, units, columns=[], lines=np.array([], dtype=int), notes=[])
    stated = layout.columns.get("time", {}).get("column", "")
    side, own, size, every = "", False, 0, 1
    stamps: list[Cells] = []
    placed: list[tuple[Cells, int]] = []  # cells of a file and its first row
    lines: list[np.ndarray] = []
    for file in files:
        table = _with_whole_stamps(text_table(file, layout))
        clock, clocks[file.name] = clock_column(table.headings, table.units, stated, str(file), _coarse(table))
        headings[0], units[0] = headings[0] or table.headings[clock], units[0] or table.units[clock]
        side, own, every = side or table.rudder_positive, own or table.shows_axes, max(every, table.every)
        targets = [k for k, heading in enumerate(table.headings) if heading and k != clock]
        names = [table.headings[k] for k in targets]
        headings += [f"{file.stem}.{name}" if name in headings else name for name in names]
        units += [table.units[k] for k in targets]
        joined.begins[file.name] = size
        placed += [(table.columns[k], size) for k in targets]
        stamps.append(table.columns[clock])
        lines.append(table.lines)
        size += table.lines.size
        check_size(folder, [size] * len(headings))
        joined.notes.extend(f"{file.name}: {note}" for note in [f"{table.lines.size} rows.", *table.notes])
    if len(set(clocks.values())) > 1:
        found = ", ".join(f"{unit or 'no unit'} in {name}" for name, unit in clocks.items())
        raise TrialError(f"{folder}: the time of the files of a run has one unit, found {found}; state the same one.")
    columns = [end_to_end(stamps), *(among_missing(cells, begin, size) for cells, begin in placed)]
    return replace(
        joined, columns=columns, lines=np.concatenate(lines), rudder_positive=side, shows_axes=own, every=every
    )


def _table_of_series(columns: Columns, notes: list[str], every: int) -> TextTable:
    """Table of the columns of a binary file, whose first row may have the units."""
    first, units = ["".join(cell_texts(one.values[:1])) for one in columns], [one.unit for one in columns]
    has_units = not any(units) and is_unit_row(first)
    units = [cell.strip(AROUND_UNITS) for cell in first] if has_units else units
    cells = [column_cells(one.values[int(has_units) :]) for one in columns]
    lines = np.arange(1, columns[0].values.size + 1 - has_units)
    return TextTable(
        [plain_heading(one.heading) for one in columns], units, cells, lines=lines, notes=notes, every=every
    )


def _table_of_log(cells: dict[str, list[str]], units: dict[str, str], notes: list[str]) -> TextTable:
    """Table of a log of NMEA 0183, which counts the rudder positive to starboard."""
    lines = np.arange(1, len(cells["time"]) + 1)
    columns = [cells_of(texts) for texts in cells.values()]
    table = TextTable(list(cells), [units.get(name, "") for name in cells], columns, lines=lines, notes=notes)
    return replace(_with_bare_numbers(table), rudder_positive="starboard", shows_axes=True)


def _with_whole_stamps(table: TextTable) -> TextTable:
    """Table whose milli- or nanoseconds are decimals of the stamps beside, and whose parts of a date are one stamp."""
    headings, columns, notes = list(table.headings), list(table.columns), list(table.notes)
    for seconds, (fraction, digits) in fraction_columns(headings).items():
        with suppress(ValueError):
            pairs = zip(texts_of(columns[seconds]), texts_of(columns[fraction]), strict=True)
            columns[seconds] = [with_fraction(stamp, more, digits) for stamp, more in pairs]
            notes.append(f"{headings[fraction]!r} added to {headings[seconds]!r}.")
            headings[fraction] = ""
    if parts := date_columns(headings):
        *others, last = parts
        notes.append(f"Stamps of {', '.join(repr(headings[k]) for k in parts)}.")
        columns[last] = [stamp_of_parts(row) for row in zip(*(texts_of(columns[k]) for k in parts), strict=True)]
        headings = ["" if k in others else "time" if k == last else heading for k, heading in enumerate(headings)]
    return replace(table, headings=headings, columns=columns, notes=notes)


def _coarse(table: TextTable) -> set[int]:
    """Columns of time most of whose stamps repeat."""
    clocks = [k for k, heading in enumerate(table.headings) if TIME in channels_of(heading)]
    if len(clocks) < 2:
        return set()
    return {k for k in clocks if table.lines.size > _REPEATED * number_of_different(table.columns[k])}


def _with_bare_numbers(table: TextTable) -> TextTable:
    """Table whose cells have numbers alone; a rudder with letters of its side is positive to starboard."""
    headings, columns = with_letters_beside(table.headings, table.columns)
    units, notes, stated = list(table.units), list(table.notes), dict(table.settings)
    for k, heading in enumerate(table.headings):
        if read := bare_numbers(heading, units[k], columns[k]):
            columns[k] = cells_of(read.cells)
            stated |= read.stated
            units[k] = read.unit
            notes += read.notes
    side = stated.pop("rudder_positive", table.rudder_positive)
    table = replace(table, headings=headings, units=units, columns=columns, notes=notes)
    return replace(table, rudder_positive=side, settings=stated)


def _stamps(table: TextTable, column: Column) -> list[str]:
    """Stamps if most of them are text, empty where missing; no item if most are numbers."""
    cells = table.columns[column.index]
    stamps = [] if isinstance(cells, Numbers) else [cell.strip()[:_LONGEST_STAMP] for cell in cells]
    stamps = ["" if stamp.lower() in MISSING_CELLS else stamp for stamp in stamps]
    texts = sum(not is_number(stamp) for stamp in stamps if stamp)
    return stamps if texts > 0.5 * sum(map(bool, stamps)) else []


def table_cells(table: TextTable, columns: dict[str, Column], path: Path) -> tuple[dict[str, np.ndarray], list[str]]:
    """Numbers of each column, NaN for missing cells."""
    read = {name: table.columns[column.index] for name, column in columns.items()}
    texts = {name: [cell.strip() for cell in cells] for name, cells in read.items() if not isinstance(cells, Numbers)}
    joined = {
        name: "." * cells.has_point if isinstance(cells, Numbers) else "".join(texts[name])
        for name, cells in read.items()
    }
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
    for name, cells in read.items():
        parsed = [] if isinstance(cells, Numbers) else cell_numbers(texts[name])
        if None in parsed:
            position = parsed.index(None)
            cell = texts[name][position][:_LONGEST_STAMP]
            marked = ", ".join(columns[one].heading for one in with_mark["."] if "," in cell)
            remedy = f"beside points in {marked}; write one decimal mark" if marked else "correct or empty the cell"
            raise TrialError(
                f"{path}, line {table.lines[position]}, column {columns[name].heading}: a number is needed, found "
                f"{cell!r}{' ' if marked else '; '}{remedy}."
            )
        values = cells.values if isinstance(cells, Numbers) else np.array(parsed, dtype=float)
        numbers[name] = np.where(np.abs(values) < LARGEST, values, np.nan)
        small = (numbers[name] != 0.0) & (np.abs(numbers[name]) < 1.0 / LARGEST)
        numbers[name][small] = 0.0
        if small.any():
            notes.append(f"{int(small.sum())} cells of {name}, all within {1.0 / LARGEST:g} of zero, read as 0.")
    return numbers, [*notes, *without_stand_ins(columns, numbers)]
