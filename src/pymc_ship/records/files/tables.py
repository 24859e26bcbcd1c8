"""Parquet, xlsx, NetCDF and MAT files and bags of ROS as tables; libraries are imported on use."""

from __future__ import annotations

import json
import os
import pickle
import re
import subprocess
import sys
import zipfile
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import closing, suppress
from dataclasses import is_dataclass
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import scipy

from pymc_ship.machine.errors import TrialError
from pymc_ship.machine.text import MOST_BLOCKS, MOST_BYTES
from pymc_ship.records.files.clock import thinning
from pymc_ship.records.files.columns import channels_of
from pymc_ship.trial.cells import Cells, Numbers, cells_of, plain_text
from pymc_ship.trial.channels import TIME
from pymc_ship.trial.thinning import MOST_CELLS, Thinning, kept_rows, rows_for_one, thinning_note

_CHILD = "import sys; from pymc_ship.records.files.tables import send_columns; send_columns(*sys.argv[1:])"
_LONGEST = 30.0  # s of the processor, for a file that a process of its own reads
_LONGEST_WAIT = 120.0  # s for that process on a busy machine
_MOST_UNPACKED = 4 * MOST_BYTES
_LONGEST_CELL = 60  # letters
_SAME_CLOCK = 1_000_000_000  # ns between the stamp of a message and its recording, at most
_STORAGE = (".db3", ".mcap")  # of ROS 2
_SHEET_ROWS = 2**20  # of a worksheet
_MOST_ROWS, _MOST_COLUMNS = 40_000_000, 1000  # of a trial, the most rows read in minutes
_CHUNK = 2**17  # rows that are in memory at a time
_BUFFER = 2**20  # bytes of each column of a Parquet file

_INDEX = re.compile(r"__index_level_\d+__")  # of pandas, without a name
_OF_XLSX = "[Content_Types].xml"
_MOST_TITLES = 50  # rows of a worksheet that may come before its header
_SHORTEST_SERIES = 0.01  # fraction of the rows of a table below which a vector is a setting
_MOST_NAMED = 12  # columns that a sentence names


class Series(NamedTuple):
    """Values of a column, its heading and unit, and where in the file it stands, such as its struct."""

    heading: str
    values: Any
    unit: str = ""
    place: str = ""


Columns = list[Series]
Chosen = Mapping[str, Mapping[str, Any]]  # columns of a format by channel


class Table(NamedTuple):
    """Columns and sentences of a file, and the number of its rows of which one is left."""

    columns: Columns
    notes: list[str]
    every: int = 1


def bag_of(path: Path) -> Path:
    """Storage file of the ROS 2 bag that a folder is; the path itself for any other."""
    bag = os.path.isdir(path) and (path / "metadata.yaml").is_file()
    return next((one for one in sorted(path.iterdir()) if one.suffix in _STORAGE), path) if bag else path


def binary_columns(path: Path, chosen: Chosen) -> Table | None:
    """Columns, of one length, and sentences on what is left out; None for a text file.

    A long table is thinned, for which ``chosen`` has the columns of a format by channel. TrialError for a damaged file,
    and for two columns of one channel.
    """
    if not os.path.isfile(path):  # False for a path that no file can have
        return None
    try:
        with path.open("rb") as file:
            begin = file.read(16)
    except OSError:
        return None  # the reader of text says why
    kind = next((kind for mark, kind in _KINDS.items() if begin.startswith(mark)), "")
    if not kind:
        return None
    most = MOST_BLOCKS if kind in _IN_BLOCKS else MOST_BYTES
    if path.stat().st_size > most:
        raise TrialError(f"{path}: a trial in {kind} has at most {most / 1e6:.0f} MB, found more; split it.")
    try:
        columns, notes, every = (_columns_by_process if kind in _IN_C else _read)(kind, path, chosen)
    except TrialError:
        raise
    except ImportError as error:
        raise TrialError(f"{path}: {kind} needs {error.name}, found none; pip install 'pymc-ship[formats]'.") from None
    except Exception as error:  # libraries raise any class for damaged files
        words = "".join(letter for letter in (str(error).splitlines() or [""])[0] if letter.isprintable())
        reason = words[:100] or type(error).__name__
        raise TrialError(f"{path} cannot be read as {kind}: {reason}; write it anew, or as CSV.") from None
    columns = [one._replace(values=np.asarray(one.values)) for one in columns]
    lengths = [one.values.size for one in columns if one.values.ndim == 1]
    rows = max(set(lengths), key=lambda size: size * lengths.count(size), default=0)
    table = [one for one in columns if one.values.shape == (rows,)]
    check_size(path, [rows] * len(table))
    if rows < 2 or len(table) < 2:
        raise TrialError(f"{path}: a trial has two columns and two rows at least, found none in this {kind}; check it.")
    _check_single(path, [one for one in columns if one.values.size >= _SHORTEST_SERIES * rows])
    notes = [*notes, *_other_lengths(columns, rows)]
    plan = thinning([one.heading for one in table], chosen, rows_for_one(rows, len(table)))
    if plan.every == 1:
        return Table(table, notes, every)
    values = thinned_arrays([one.values[: rows // plan.every * plan.every] for one in table], plan)
    table = [one._replace(values=left) for one, left in zip(table, values, strict=True)]
    return Table(table, [*notes, thinning_note(rows, plan.every)], plan.every)


def thinned_arrays(columns: Sequence[np.ndarray], plan: Thinning) -> list[np.ndarray]:
    """Cells that are left of columns of a binary file, whose rows are a multiple of ``plan.every``."""
    cells = [
        Numbers(np.where(np.isnat(values), np.nan, values.astype("i8")), False)
        if values.dtype.kind == "M"
        else column_cells(values)
        for values in columns
    ]
    return [values[rows] for values, rows in zip(columns, kept_rows(cells, plan), strict=True)]


def _other_lengths(columns: Columns, rows: int) -> list[str]:
    """Sentence on the columns that do not have the rows of the table."""
    others = [one for one in columns if one.values.shape not in ((rows,), ())]
    names = [f"{one.heading} ({' x '.join(map(str, one.values.shape))} rows)" for one in others]
    more = f" and {len(names) - _MOST_NAMED} more" if len(names) > _MOST_NAMED else ""
    return [f"Columns left out: {', '.join(names[:_MOST_NAMED])}{more}; the table has {rows}."] if names else []


def _check_single(path: Path, columns: Columns) -> None:
    """Raise TrialError for two columns of one heading, of time or a channel, that differ."""
    first: dict[str, Series] = {}
    for one in columns:
        other = first.setdefault(one.heading, one)
        if other is one or not channels_of(one.heading) or cell_texts(one.values) == cell_texts(other.values):
            continue
        raise TrialError(
            f"{path}: {one.heading} is to be read from one column, found {other.place or 'the file'} and "
            f"{one.place or 'the file'}; write each run to a file, or each sensor of one run to a file of one folder."
        )


def check_size(path: Path, lengths: Sequence[int], every: int = 1) -> None:
    """Raise TrialError if columns of these lengths, of which one row in so many is left, are more than a trial has."""
    rows, columns, cells = max(lengths, default=0), len(lengths), sum(lengths) // every
    if rows > _MOST_ROWS or columns > _MOST_COLUMNS or cells > MOST_CELLS:
        raise TrialError(
            f"{path}: a trial has at most {_MOST_ROWS / 1e6:g} million rows, {_MOST_COLUMNS} columns and "
            f"{MOST_CELLS / 1e6:g} million cells, found {rows} rows and {columns} columns; split it, or thin it."
        )


def cell_texts(values: np.ndarray) -> list[str]:
    """Cells as a text file has them, empty where missing."""
    if values.dtype.kind == "M":
        return ["" if text == "NaT" else text for text in np.datetime_as_string(values).tolist()]
    return [
        "" if value is None or value != value else plain_text(str(value)[:_LONGEST_CELL]) for value in values.tolist()
    ]


def column_cells(values: np.ndarray) -> Cells:
    """Cells of a column of a binary file, numbers where it has numbers alone."""
    if values.dtype.kind in "iuf" and values.dtype.itemsize <= 8:
        return Numbers(values.astype(float, copy=False), values.dtype.kind == "f" and bool(np.isfinite(values).any()))
    return cells_of(cell_texts(values))


def _parquet(path: Path, chosen: Chosen) -> Table:
    from pyarrow import parquet, types

    schema = parquet.read_schema(path)
    texts = [field.name for field in schema if types.is_string(field.type) or types.is_large_string(field.type)]
    names = [field.name for field in schema if not types.is_nested(field.type)]
    with parquet.ParquetFile(path, read_dictionary=texts, buffer_size=_BUFFER, pre_buffer=False) as file:
        size = sum(file.metadata.row_group(k).total_byte_size for k in range(file.metadata.num_row_groups))
        rows = file.metadata.num_rows
        plan = thinning(names, chosen, rows_for_one(rows, len(names), size <= _MOST_UNPACKED))
        check_size(path, [rows] * len(names), plan.every)
        if plan.every == 1:
            _check_unpacked(path, size)
            table = file.read(names)
            columns = [_arrow_values(table[name]) for name in names]
        else:
            parts = _parquet_parts(file, names, plan.every)
            columns = _end_to_end(thinned_arrays(part, plan) for part in parts)
    clocks = [name for name in names if _INDEX.fullmatch(name) and types.is_temporal(schema.field(name).type)]
    headings = dict.fromkeys(clocks if len(clocks) == 1 and not any(map(_is_clock, names)) else (), TIME.name)
    notes = ["The index without a name is taken as the time."] if headings else []
    notes += [thinning_note(rows, plan.every)] if plan.every > 1 else []
    series = [Series(headings.get(name, name), values) for name, values in zip(names, columns, strict=True)]
    return Table(series, notes, plan.every)


def _parquet_parts(file: Any, names: list[str], every: int) -> Iterator[list[np.ndarray]]:
    """Columns of consecutive rows, each a multiple of ``every``."""
    from pyarrow import Table as ArrowTable

    rest: list[Any] = []
    for batch in file.iter_batches(_CHUNK, columns=names):
        table = ArrowTable.from_batches([*rest, batch])
        rows = table.num_rows // every * every
        if rows:
            yield [_arrow_values(column) for column in table.slice(0, rows).columns]
        rest = table.slice(rows).to_batches()


def _end_to_end(parts: Iterable[list[np.ndarray]]) -> list[np.ndarray]:
    """Columns of consecutive parts of a table."""
    return [np.concatenate(column) for column in zip(*parts, strict=True)]


def _is_clock(heading: object) -> bool:
    """Whether a cell is a heading of time."""
    return isinstance(heading, str) and TIME in channels_of(heading)


def _arrow_values(column: Any) -> np.ndarray:
    """Values of a column; equal texts of a dictionary are one object."""
    is_dictionary = str(column.type).startswith("dictionary")
    return column.to_pandas().astype(object).to_numpy() if is_dictionary else column.to_numpy()


def _xlsx(path: Path) -> Table:
    from openpyxl import load_workbook
    from openpyxl.utils import get_column_letter

    with zipfile.ZipFile(path) as archive:
        _check_unpacked(path, sum(member.file_size for member in archive.infolist()))
        for member in archive.infolist():
            with archive.open(member) as part:
                if b"<!DOCTYPE" in part.read(4096):
                    raise TrialError(f"{path}: a workbook has no DTD, found one in {member.filename}; save it anew.")
        if _OF_XLSX not in archive.namelist():
            names = ", ".join(map(repr, archive.namelist()[:_MOST_NAMED]))
            raise TrialError(f"{path}: a trial is a file or a folder, found an archive of {names}; unpack it.")
    with path.open("rb") as file, closing(load_workbook(file, read_only=True, data_only=True)) as book:
        begins = {sheet.title: _rows(path, sheet, _MOST_TITLES) for sheet in book.worksheets}
        tables = [title for title, rows in begins.items() if any(map(_is_header, rows))]
        if len(tables) > 1:
            raise TrialError(
                f"{path}: a workbook of a trial has one table, found one in each of the sheets {', '.join(tables)}; "
                "save each as a workbook."
            )
        title = next(iter(tables), book.worksheets[0].title)
        rows = _rows(path, book[title], _SHEET_ROWS)
    others = [other for other, cells in begins.items() if cells and other != title]
    notes = [f"Sheet {title} read; sheets left out: {', '.join(others[:_MOST_NAMED])}."] if others else []
    texts = (k for k, row in enumerate(rows) if sum(isinstance(cell, str) for cell in row) > 1)
    begin = next((k for k, row in enumerate(rows[:_MOST_TITLES]) if _is_header(row)), next(texts, 0))
    header, *cells = rows[begin:]
    check_size(path, [len(cells)] * len(header))
    columns = np.full((len(header), len(cells)), None, dtype=object)
    for k, row in enumerate(cells):
        columns[: len(row), k] = row[: len(header)]
    named = [(k, str(name), column) for k, (name, column) in enumerate(zip(header, columns, strict=True), 1) if name]
    return Table([Series(name, column, place=f"column {get_column_letter(k)}") for k, name, column in named], notes)


def _rows(path: Path, sheet: Any, most: int) -> list[tuple[Any, ...]]:
    """Rows of a worksheet that are not empty, among the first ``most``."""
    rows, cells_read = [], 0
    sheet.reset_dimensions()
    for row in sheet.iter_rows(max_row=most, values_only=True):
        cells_read += len(row)
        _check_unpacked(path, 24 * cells_read)
        if any(cell is not None for cell in row):
            rows.append(row)
    return rows


def _is_header(row: Sequence[Any]) -> bool:
    """Whether a row of a worksheet has headings of time and of another quantity."""
    return any(map(_is_clock, row)) and any(
        channels_of(cell) and not _is_clock(cell) for cell in row if isinstance(cell, str)
    )


def _netcdf(path: Path, chosen: Chosen) -> tuple[dict[str, tuple[str, np.ndarray, dict[str, Any]]], list[str], int]:
    """Dimension, values as stored and attributes of each vector, with the other items of :class:`Table`."""
    from netCDF4 import Dataset

    with Dataset(path) as file:
        file.set_auto_maskandscale(False)
        file.set_auto_chartostring(False)
        vectors = {name: one for name, one in file.variables.items() if one.ndim == 1}
        sizes = [one.size for one in vectors.values()]
        rows = max(sizes, default=0)
        long = {name: one for name, one in vectors.items() if one.size == rows}
        plan = thinning([*long], chosen, rows_for_one(rows, len(vectors)))
        check_size(path, sizes, plan.every)
        values = {name: one[:] for name, one in vectors.items() if plan.every == 1 or name not in long}
        if plan.every > 1:
            step, end = plan.every * max(_CHUNK // plan.every, 1), rows // plan.every * plan.every
            parts = ([one[k : min(k + step, end)] for one in long.values()] for k in range(0, end, step))
            values |= zip(long, _end_to_end(thinned_arrays(part, plan) for part in parts), strict=True)
        read = {name: (*one.dimensions, values[name], one.__dict__) for name, one in vectors.items()}
    _check_unpacked(path, sum(values.nbytes for _, values, _ in read.values()))
    return read, [thinning_note(rows, plan.every)] if plan.every > 1 else [], plan.every


def _decoded(vectors: Mapping[str, tuple[str, np.ndarray, dict[str, Any]]], notes: list[str], every: int) -> Table:
    """Table of the vectors of :func:`_netcdf`, by the CF conventions; without xarray their process starts sooner."""
    import xarray as xr

    clock = xr.coders.CFDatetimeCoder(use_cftime=False)
    data = xr.decode_cf(xr.Dataset(dict(vectors)), decode_times=clock, decode_timedelta=False)
    series = {str(name): one for name, one in data.variables.items() if one.ndim == 1}
    columns = [Series(name, one.values, str(one.attrs.get("units", ""))) for name, one in series.items()]
    return Table(columns, notes, every)


def _matlab(path: Path) -> Table:
    return Table(list(_series(scipy.io.loadmat(path, simplify_cells=True))), [])


def _matlab_73(path: Path) -> Table:
    """Vectors of each group; links to other files are not followed."""
    import h5py

    vectors: dict[str, Any] = {}

    def collect(name: str, one: Any) -> None:
        is_vector = isinstance(one, h5py.Dataset) and one.size == max(one.shape or (), default=0)
        if is_vector and one.dtype.kind in "biuf" and not name.startswith("#"):
            vectors[name] = one

    table: dict[str, Any] = {}
    with h5py.File(path) as file:
        file.visititems(collect)
        check_size(path, [one.size for one in vectors.values()])
        for name, one in vectors.items():
            *groups, last = name.split("/")
            parent = table
            for group in groups:
                parent = parent.setdefault(group, {})
            parent[last] = np.reshape(one[()], -1)
    return Table(list(_series(table)), [])


def _bag(path: Path) -> Table:
    """A row for each time: that of a message's header or, if that is of another clock, of its recording."""
    from rosbags.highlevel import AnyReader
    from rosbags.typesys import Stores, get_typestore

    if path.suffix != ".bag" and not (path.parent / "metadata.yaml").is_file():
        raise TrialError(f"{path}: a bag of ROS 2 has a file metadata.yaml in its folder, found none; copy the folder.")
    rows: dict[int, dict[str, float]] = {}  # by time [ns]
    store = get_typestore(Stores.LATEST)  # for bags without definitions of their messages
    with AnyReader([path if path.suffix == ".bag" else path.parent], default_typestore=store) as bag:
        without_numbers, known = set(), [one for one in bag.connections if one.msgtype in bag.typestore.types]
        unknown = sorted({one.topic for one in bag.connections} - {one.topic for one in known})
        for connection, time, raw in bag.messages(known) if known else ():
            if connection.id in without_numbers:
                continue
            message = bag.deserialize(raw, connection.msgtype)
            numbers = dict(_numbers_of(message, connection.topic))
            if not numbers:
                without_numbers.add(connection.id)
                continue
            if stamped := getattr(getattr(message, "header", None), "stamp", None):
                stamp = 1_000_000_000 * stamped.sec + stamped.nanosec
                time = stamp if abs(stamp - time) < _SAME_CLOCK else time
            rows.setdefault(time, {}).update(numbers)
            check_size(path, [len(rows)])
    names, times = list(dict.fromkeys(name for row in rows.values() for name in row)), sorted(rows)
    check_size(path, [len(rows)] * len(names))
    columns = [Series(name, np.array([rows[time].get(name, np.nan) for time in times])) for name in names]
    topics = ", ".join(unknown[:_MOST_NAMED])
    notes = [f"Topics without a definition of their message left out: {topics}."] if topics else []
    return Table([Series("time", 1e-9 * (np.array(times) - times[0]), "s"), *columns] if times else [], notes)


def _numbers_of(message: Any, name: str) -> Iterator[tuple[str, float]]:
    """Numbers of a message, but for its header, by topic and field."""
    for part, value in vars(message).items():
        if isinstance(value, (int, float)) and not isinstance(value, bool):
            yield f"{name}.{part}", float(value)
        elif is_dataclass(value) and part != "header":
            yield from _numbers_of(value, f"{name}.{part}")


def _columns_by_process(kind: str, path: Path, chosen: Chosen) -> Table:
    """Read a file in a process of its own: at damaged files these libraries can end their process, or never return."""
    headings = json.dumps({name: {"column": one["column"]} for name, one in chosen.items()})
    try:
        child = subprocess.run(
            [sys.executable, "-c", _CHILD, kind, path, headings],
            env=os.environ | {"OPENBLAS_NUM_THREADS": "1"},
            capture_output=True,
            timeout=_LONGEST_WAIT,
            check=True,
        )
    except subprocess.SubprocessError:
        raise TrialError(
            f"{path} cannot be read as {kind}: its structure is damaged, or takes more than 1 GB or {_LONGEST:g} s; "
            "write it anew, or as CSV."
        ) from None
    read = pickle.loads(child.stdout)
    if isinstance(read, Exception):
        raise read
    return _decoded(*read) if kind == "NetCDF" else read


def _read(kind: str, path: Path, chosen: Chosen) -> Any:
    """Columns of a file by the reader of its kind."""
    return _READERS[kind](path, chosen) if kind in _IN_BLOCKS else _READERS[kind](path)


def send_columns(kind: str, path: str, chosen: str) -> None:
    """Write what a file contains, pickled, or the error of their reader, to the standard output."""
    with suppress(ImportError, OSError, ValueError):  # on Windows the time alone is limited
        import resource

        resource.setrlimit(resource.RLIMIT_DATA, 2 * (2 * _MOST_UNPACKED,))
        resource.setrlimit(resource.RLIMIT_CPU, 2 * (round(_LONGEST),))  # also where the reading process is killed
    read: Any
    try:
        read = _read(kind, Path(path), json.loads(chosen))
    except Exception as error:
        read = error
    pickle.dump(read, sys.stdout.buffer)


def _series(table: Mapping[str, Any], place: str = "") -> Iterator[Series]:
    """Series of a workspace and of its structs by their last name; signals of Simulink by their label."""
    for name, value in table.items():
        if name.startswith("__"):
            continue
        if isinstance(value, Mapping) and "values" in value:
            label = value.get("label")
            yield Series(label if isinstance(label, str) and label else name, value["values"], place=place)
        elif isinstance(value, Mapping):
            yield from _series(value, f"{place}.{name}".strip("."))
        elif isinstance(value, list):
            structs = {f"{name} {k}": one for k, one in enumerate(value, 1) if isinstance(one, Mapping)}
            yield from _series(structs, place)
        elif isinstance(value, np.ndarray) and value.ndim == 1 and value.dtype.kind in "biuf":
            yield Series(name, value, place=place)


def _check_unpacked(path: Path, size: int) -> None:
    if size > _MOST_UNPACKED:
        raise TrialError(f"{path}: a trial has at most {_MOST_UNPACKED / 1e6:.0f} MB unpacked, found more; split it.")


_KINDS = {
    b"PAR1": "Parquet",
    b"PK\x03\x04": "xlsx",
    b"\x89HDF": "NetCDF",
    b"CDF": "NetCDF",
    b"MATLAB 5.0": "MAT",
    b"MATLAB 7.3": "MAT 7.3",
    b"#ROSBAG": "ROS bag",
    b"SQLite format 3": "ROS bag",
    b"\x89MCAP": "ROS bag",
}
"""Kind of a file by its first bytes; a MAT file of version 7.3 is HDF5 behind a header of its own."""

_READERS: Mapping[str, Callable[..., Any]] = {
    "Parquet": _parquet,
    "xlsx": _xlsx,
    "NetCDF": _netcdf,
    "MAT": _matlab,
    "MAT 7.3": _matlab_73,
    "ROS bag": _bag,
}
_IN_C = ("NetCDF", "MAT", "MAT 7.3", "ROS bag")  # kinds that a process of its own reads
_IN_BLOCKS = ("Parquet", "NetCDF")  # kinds of which a part is in memory at a time
