"""Parquet, xlsx, NetCDF and MAT files, bags of ROS and logs of NMEA 0183 as tables; libraries are imported on use."""

from __future__ import annotations

import os
import pickle
import re
import subprocess
import sys
import zipfile
from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import closing, suppress
from dataclasses import is_dataclass
from pathlib import Path
from typing import Any

import numpy as np

from pymc_ship.machine.errors import TrialError
from pymc_ship.machine.text import MOST_BYTES

_CHILD = "import sys; from pymc_ship.records.files.tables import send_columns; send_columns(*sys.argv[1:])"
_LONGEST = 30.0  # s
_MOST_UNPACKED = 4 * MOST_BYTES
_LONGEST_CELL = 60  # letters
_SAME_CLOCK = 1_000_000_000  # ns between the stamp of a message and its recording, at most
_STORAGE = (".db3", ".mcap")  # of ROS 2
_SHEET_ROWS = 2**20  # of a worksheet
_MOST_ROWS, _MOST_COLUMNS, _MOST_CELLS = 5_000_000, 1000, 24_000_000  # of a trial, read in 2 GB

Columns = dict[str, tuple[Any, str]]  # values and unit by heading


def bag_of(path: Path) -> Path:
    """Storage file of the ROS 2 bag that a folder is; the path itself for any other."""
    bag = os.path.isdir(path) and (path / "metadata.yaml").is_file()
    return next((one for one in sorted(path.iterdir()) if one.suffix in _STORAGE), path) if bag else path


def binary_columns(path: Path) -> Columns | None:
    """Values, of one length, and unit of each column; None for a text file, TrialError for a damaged file."""
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
    if path.stat().st_size > MOST_BYTES:
        raise TrialError(f"{path}: a trial has at most {MOST_BYTES / 1e6:.0f} MB, found more; split it.")
    try:
        columns = _columns_by_process(kind, path) if kind in _IN_C else _READERS[kind](path)
    except TrialError:
        raise
    except ImportError as error:
        raise TrialError(f"{path}: {kind} needs {error.name}, found none; pip install 'pymc-ship[formats]'.") from None
    except Exception as error:  # libraries raise any class for damaged files
        words = "".join(letter for letter in (str(error).splitlines() or [""])[0] if letter.isprintable())
        reason = words[:100] or type(error).__name__
        raise TrialError(f"{path} cannot be read as {kind}: {reason}; write it anew, or as CSV.") from None
    columns = {name: (np.asarray(values), unit) for name, (values, unit) in columns.items()}
    lengths = [values.size for values, _ in columns.values() if values.ndim == 1]
    rows = max(set(lengths), key=lambda size: size * lengths.count(size), default=0)
    columns = {name: column for name, column in columns.items() if column[0].shape == (rows,)}
    check_size(path, [rows] * len(columns))
    if rows < 2 or len(columns) < 2:
        raise TrialError(f"{path}: a trial has two columns and two rows at least, found none in this {kind}; check it.")
    return columns


def check_size(path: Path, lengths: Sequence[int]) -> None:
    """Raise TrialError if columns of these lengths are more than a trial has."""
    rows, columns, cells = max(lengths, default=0), len(lengths), sum(lengths)
    if rows > _MOST_ROWS or columns > _MOST_COLUMNS or cells > _MOST_CELLS:
        raise TrialError(
            f"{path}: a trial has at most {_MOST_ROWS / 1e6:g} million rows, {_MOST_COLUMNS} columns and "
            f"{_MOST_CELLS / 1e6:g} million cells, found {rows} rows and {columns} columns; split it, or thin it."
        )


def cell_texts(values: np.ndarray) -> list[str]:
    """Cells as a text file has them, empty where missing."""
    if values.dtype.kind == "M":
        return ["" if text == "NaT" else text for text in np.datetime_as_string(values).tolist()]
    return ["" if value is None or value != value else str(value)[:_LONGEST_CELL] for value in values.tolist()]


def _parquet(path: Path) -> Columns:
    from pyarrow import parquet, types

    schema = parquet.read_schema(path)
    texts = [field.name for field in schema if types.is_string(field.type) or types.is_large_string(field.type)]
    names = [field.name for field in schema if not types.is_nested(field.type)]
    with parquet.ParquetFile(path, read_dictionary=texts) as file:
        groups = (file.metadata.row_group(k) for k in range(file.metadata.num_row_groups))
        _check_unpacked(path, sum(one.total_byte_size for one in groups))
        check_size(path, [file.metadata.num_rows] * len(names))
        table = file.read(names)
    return {name: (_arrow_values(table[name]), "") for name in table.column_names}


def _arrow_values(column: Any) -> np.ndarray:
    """Values of a column; equal texts of a dictionary are one object."""
    is_dictionary = str(column.type).startswith("dictionary")
    return column.to_pandas().astype(object).to_numpy() if is_dictionary else column.to_numpy()


def _xlsx(path: Path) -> Columns:
    from openpyxl import load_workbook

    with zipfile.ZipFile(path) as archive:
        _check_unpacked(path, sum(member.file_size for member in archive.infolist()))
        for member in archive.infolist():
            with archive.open(member) as part:
                if b"<!DOCTYPE" in part.read(4096):
                    raise TrialError(f"{path}: a workbook has no DTD, found one in {member.filename}; save it anew.")
    rows, cells_read = [], 0
    with path.open("rb") as file, closing(load_workbook(file, read_only=True, data_only=True)) as book:
        sheet = book.worksheets[0]
        sheet.reset_dimensions()
        for row in sheet.iter_rows(max_row=_SHEET_ROWS, values_only=True):
            cells_read += len(row)
            _check_unpacked(path, 24 * cells_read)
            if any(cell is not None for cell in row):
                rows.append(row)
    begin = next((k for k, row in enumerate(rows) if sum(isinstance(cell, str) for cell in row) > 1), 0)
    header, *cells = rows[begin:]
    check_size(path, [len(cells)] * len(header))
    columns = np.full((len(header), len(cells)), None, dtype=object)
    for k, row in enumerate(cells):
        columns[: len(row), k] = row[: len(header)]
    return {str(name): (column, "") for name, column in zip(header, columns, strict=True) if name is not None}


def _netcdf(path: Path) -> Columns:
    import xarray as xr
    from netCDF4 import Dataset

    with Dataset(path) as file:
        check_size(path, [one.size for one in file.variables.values() if one.ndim == 1])
    clock = xr.coders.CFDatetimeCoder(use_cftime=False)
    with xr.open_dataset(path, engine="netcdf4", decode_times=clock, decode_timedelta=False) as data:
        series = {str(name): one for name, one in data.variables.items() if one.ndim == 1}
        _check_unpacked(path, sum(one.nbytes for one in series.values()))
        return {name: (one.values, str(one.attrs.get("units", ""))) for name, one in series.items()}


def _matlab(path: Path) -> Columns:
    from scipy.io import loadmat

    return dict(_series(loadmat(path, simplify_cells=True)))


def _matlab_73(path: Path) -> Columns:
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
    return dict(_series(table))


def _bag(path: Path) -> Columns:
    """A row for each time: that of a message's header or, if that is of another clock, of its recording."""
    from rosbags.highlevel import AnyReader
    from rosbags.typesys import Stores, get_typestore

    if path.suffix != ".bag" and not (path.parent / "metadata.yaml").is_file():
        raise TrialError(f"{path}: a bag of ROS 2 has a file metadata.yaml in its folder, found none; copy the folder.")
    rows: dict[int, dict[str, float]] = {}  # by time [ns]
    store = get_typestore(Stores.LATEST)  # for bags without definitions of their messages
    with AnyReader([path if path.suffix == ".bag" else path.parent], default_typestore=store) as bag:
        without_numbers = set()
        for connection, time, raw in bag.messages():
            if connection.id in without_numbers:
                continue
            message = bag.deserialize(raw, connection.msgtype)
            numbers = dict(_numbers_of(message, connection.topic))
            if not numbers:
                without_numbers.add(connection.id)
                continue
            if header := getattr(message, "header", None):
                stamp = 1_000_000_000 * header.stamp.sec + header.stamp.nanosec
                time = stamp if abs(stamp - time) < _SAME_CLOCK else time
            rows.setdefault(time, {}).update(numbers)
            check_size(path, [len(rows)])
    names, times = list(dict.fromkeys(name for row in rows.values() for name in row)), sorted(rows)
    check_size(path, [len(rows)] * len(names))
    columns = {name: (np.array([rows[time].get(name, np.nan) for time in times]), "") for name in names}
    return {"time": (1e-9 * (np.array(times) - times[0]), "s"), **columns} if times else {}


def _numbers_of(message: Any, name: str) -> Iterator[tuple[str, float]]:
    """Numbers of a message, but for its header, by topic and field."""
    for part, value in vars(message).items():
        if isinstance(value, (int, float)) and not isinstance(value, bool):
            yield f"{name}.{part}", float(value)
        elif is_dataclass(value) and part != "header":
            yield from _numbers_of(value, f"{name}.{part}")


def _columns_by_process(kind: str, path: Path) -> Columns:
    """Read a file in a process of its own: at damaged files these libraries can end their process, or never return."""
    try:
        child = subprocess.run(
            [sys.executable, "-c", _CHILD, kind, path],
            env=os.environ | {"OPENBLAS_NUM_THREADS": "1"},
            capture_output=True,
            timeout=_LONGEST,
            check=True,
        )
    except subprocess.SubprocessError:
        raise TrialError(
            f"{path} cannot be read as {kind}: its structure is damaged, or takes more than 1 GB; write it anew, or "
            "as CSV."
        ) from None
    columns = pickle.loads(child.stdout)
    if isinstance(columns, Exception):
        raise columns
    return columns


def send_columns(kind: str, path: str) -> None:
    """Write the pickled columns of a file, or the error of their reader, to the standard output."""
    with suppress(ImportError, OSError, ValueError):  # on Windows the time alone is limited
        import resource

        resource.setrlimit(resource.RLIMIT_DATA, 2 * (2 * _MOST_UNPACKED,))
        resource.setrlimit(resource.RLIMIT_CPU, 2 * (round(_LONGEST),))  # also where the reading process is killed
    columns: Columns | Exception
    try:
        columns = _READERS[kind](Path(path))
    except Exception as error:
        columns = error
    pickle.dump(columns, sys.stdout.buffer)


def _series(table: Mapping[str, Any]) -> Iterator[tuple[str, tuple[Any, str]]]:
    """Series of a workspace and of its structs by their last name; signals of Simulink by their label."""
    for name, value in table.items():
        if name.startswith("__"):
            continue
        if isinstance(value, Mapping) and "values" in value:
            label = value.get("label")
            yield (label if isinstance(label, str) and label else name), (value["values"], "")
        elif isinstance(value, Mapping):
            yield from _series(value)
        elif isinstance(value, list):
            yield from _series({f"{name} {k}": one for k, one in enumerate(value, 1) if isinstance(one, Mapping)})
        elif isinstance(value, np.ndarray) and value.ndim == 1 and value.dtype.kind in "biuf":
            yield name, (value, "")


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

_READERS: Mapping[str, Callable[[Path], Columns]] = {
    "Parquet": _parquet,
    "xlsx": _xlsx,
    "NetCDF": _netcdf,
    "MAT": _matlab,
    "MAT 7.3": _matlab_73,
    "ROS bag": _bag,
}
_IN_C = ("NetCDF", "MAT", "MAT 7.3", "ROS bag")  # kinds that a process of its own reads


_BEFORE = " ,;\t"  # between the stamp of a logger and a sentence
_SENTENCE = re.compile(r"[$!][A-Z]{5},")
_NMEA = {  # unit, and type and fields of the sentences of each quantity, the first choice first
    "psi": ("deg", (("HDT", "heading"),)),
    "r": ("deg/min", (("ROT", "rate_of_turn"),)),
    "delta": ("deg", (("RSA", "rsa_starboard"),)),
    "u": ("kn", (("VBW", "lon_water_spd"), ("VHW", "water_speed_knots"))),
    "v": ("kn", (("VBW", "trans_water_spd"),)),
    "sog": ("kn", (("VTG", "spd_over_grnd_kts"), ("RMC", "spd_over_grnd"))),
    "cog": ("deg", (("VTG", "true_track"), ("RMC", "true_course"))),
    "latitude": ("deg", (("GGA", "latitude"), ("RMC", "latitude"), ("GLL", "latitude"))),
    "longitude": ("deg", (("GGA", "longitude"), ("RMC", "longitude"), ("GLL", "longitude"))),
    "n": ("rpm", (("RPM", "speed"),)),
}
_STATUS = {"rsa_starboard": "rsa_starboard_status", "rsa_port": "rsa_port_status"}
_STATUS |= dict.fromkeys(("lon_water_spd", "trans_water_spd"), "data_validity_water_spd")
_SHORTEST_LOG = 0.5  # fraction of the first lines that are sentences


def nmea_columns(lines: Sequence[str], path: Path) -> tuple[dict[str, list[str]], dict[str, str], list[str]] | None:
    """Cells and units by heading of a log of NMEA 0183, with sentences; None for another text.

    The time is the stamp of the logger before each sentence, or the last UTC in the log. A sensor has one column.
    """
    first = [line for line in lines[:200] if line.strip()][:50]
    if sum(bool(_SENTENCE.search(line)) for line in first) <= _SHORTEST_LOG * len(first):
        return None
    try:
        import pynmea2
    except ImportError:
        raise TrialError(f"{path}: NMEA 0183 needs pynmea2, found none; pip install 'pymc-ship[formats]'.") from None
    readings, damaged, utc = [], 0, ""
    for line in lines:
        matched = _SENTENCE.search(line)
        begin = matched.start() if matched else 0
        try:
            message = pynmea2.parse(line[begin:].strip(), check=True) if matched else None
        except pynmea2.SentenceTypeError:
            continue
        except (pynmea2.ParseError, ValueError, TypeError):
            message = None
        damaged += message is None and bool(line.strip())
        if message is None or not hasattr(message, "talker"):
            continue
        with suppress(AttributeError, ValueError, TypeError):
            utc = f"{message.timestamp:%H:%M:%S.%f}" if message.timestamp else utc
        readings.append((line[:begin].strip(_BEFORE), utc, message))
    logger = sum(bool(stamp) for stamp, _, _ in readings) > 0.5 * len(readings)
    sources, notes = _sensors([message for _, _, message in readings])
    rows: list[dict[str, str]] = []
    for stamp, clock, message in readings:
        time = stamp if logger else clock
        cells = {name: _field(message, of) for name, (sensor, of) in sources.items() if sensor == _sensor(message)}
        cells = {name: cell for name, cell in cells.items() if cell}
        if not time or not cells:
            continue
        if rows and rows[-1]["time"] == time and not cells.keys() & rows[-1].keys():
            rows[-1] |= cells
        else:
            rows.append({"time": time, **cells})
    notes += [f"{damaged} damaged sentences left out."] if damaged else []
    columns = {name: [row.get(name, "") for row in rows] for name in ("time", *sources)}
    return columns, {name: _NMEA[name][0] for name in sources}, notes


def _sensor(message: Any) -> str:
    """Name of a sensor: talker, type, and for revolutions source and number."""
    more = f" {message.source}{message.engine_no}" if message.sentence_type == "RPM" else ""
    return f"{message.talker}{message.sentence_type}{more}"


def _sensors(messages: Sequence[Any]) -> tuple[dict[str, tuple[str, str]], list[str]]:
    """Sensor and field of each quantity, and a sentence on the sensors that are not used."""
    counts = Counter((message.sentence_type, _sensor(message)) for message in messages)
    sources = {}
    for name, (_, choices) in _NMEA.items():
        for kind, of in choices:
            known = {sensor: count for (one, sensor), count in counts.items() if one == kind}
            if known:
                sources[name] = (max(known, key=lambda sensor: known[sensor]), of)
                break
    used = {sensor for sensor, _ in sources.values()}
    unused = sorted({sensor for _, sensor in counts} - used)
    notes = ["NMEA 0183: " + ", ".join(f"{name} of {sensor}" for name, (sensor, _) in sources.items()) + "."]
    notes += [f"Sensors left out: {', '.join(unused)}."] if unused else []
    if any(message.sentence_type == "RSA" and _field(message, "rsa_port") for message in messages):
        notes.append("RSA has a port rudder, which is left out: delta is the starboard one.")
    return sources, notes


def _field(message: Any, name: str) -> str:
    """Number of a field as text; empty if it is missing or declared invalid."""
    status = _STATUS.get(name, "status")
    if str(getattr(message, status, "A") or "A") == "V" or (name.endswith("itude") and not getattr(message, "lat", "")):
        return ""
    try:
        value = getattr(message, name, "")
        return repr(float(value)) if value not in ("", None) else ""
    except (ValueError, TypeError):
        return ""
