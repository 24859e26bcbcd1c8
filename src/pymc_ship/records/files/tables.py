"""Parquet, xlsx, NetCDF and MAT files and logs of NMEA 0183 as tables; each library is imported when it is needed."""

from __future__ import annotations

import pickle
import re
import subprocess
import sys
import zipfile
from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import closing, suppress
from pathlib import Path
from typing import Any

import numpy as np

from pymc_ship.machine.errors import TrialError
from pymc_ship.machine.text import MOST_BYTES

_CHILD = """
import pickle, sys
from scipy.io import loadmat
pickle.dump(loadmat(sys.argv[1], simplify_cells=True), sys.stdout.buffer)
"""
_LONGEST = 120.0  # s

Columns = dict[str, tuple[Any, str]]  # values and unit by heading


def binary_columns(path: Path) -> Columns | None:
    """Values, of one length, and unit of each column; None for a text file, TrialError for a damaged file."""
    if not path.is_file():
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
        columns = _READERS[kind](path)
    except TrialError:
        raise
    except ImportError as error:
        raise TrialError(f"{path}: {kind} needs {error.name}, found none; pip install 'pymc-ship[formats]'.") from None
    except Exception as error:  # libraries raise any class for damaged files
        reason = (str(error).splitlines() or [""])[0][:100] or type(error).__name__
        raise TrialError(f"{path} cannot be read as {kind}: {reason}; write it anew, or as CSV.") from None
    columns = {name: (np.asarray(values), unit) for name, (values, unit) in columns.items()}
    lengths = [values.size for values, _ in columns.values() if values.ndim == 1]
    rows = max(set(lengths), key=lambda size: size * lengths.count(size), default=0)
    columns = {name: column for name, column in columns.items() if column[0].shape == (rows,)}
    if rows < 2 or len(columns) < 2:
        raise TrialError(f"{path}: a trial has two columns and two rows at least, found none in this {kind}; check it.")
    return columns


def cell_texts(values: np.ndarray) -> list[str]:
    """Cells as a text file has them, empty where missing."""
    if values.dtype.kind == "M":
        return ["" if text == "NaT" else text for text in np.datetime_as_string(values).tolist()]
    return ["" if value is None or value != value else str(value) for value in values.tolist()]


def _parquet(path: Path) -> Columns:
    import pyarrow.parquet as parquet

    file = parquet.ParquetFile(path)
    groups = (file.metadata.row_group(k) for k in range(file.metadata.num_row_groups))
    _check_size(
        path, max(8 * file.metadata.num_rows * len(file.schema_arrow), sum(one.total_byte_size for one in groups))
    )
    table = file.read()
    return {name: (table[name].to_numpy(), "") for name in table.column_names}


def _xlsx(path: Path) -> Columns:
    from openpyxl import load_workbook

    with zipfile.ZipFile(path) as archive:
        _check_size(path, sum(member.file_size for member in archive.infolist()))
        for member in archive.infolist():
            with archive.open(member) as part:
                if b"<!DOCTYPE" in part.read(4096):
                    raise TrialError(f"{path}: a workbook has no DTD, found one in {member.filename}; save it anew.")
    with closing(load_workbook(path, read_only=True, data_only=True)) as book:
        sheet = book.worksheets[0]
        sheet.reset_dimensions()
        rows = [row for row in sheet.iter_rows(values_only=True) if any(cell is not None for cell in row)]
    begin = next((k for k, row in enumerate(rows) if sum(isinstance(cell, str) for cell in row) > 1), 0)
    header, *cells = rows[begin:]
    columns = np.full((len(header), len(cells)), None, dtype=object)
    for k, row in enumerate(cells):
        columns[: len(row), k] = row[: len(header)]
    return {str(name): (column, "") for name, column in zip(header, columns, strict=True) if name is not None}


def _netcdf(path: Path) -> Columns:
    import xarray as xr

    with xr.open_dataset(path, engine="netcdf4", decode_timedelta=False) as data:
        _check_size(path, data.nbytes)
        series = {str(name): one for name, one in data.variables.items() if one.ndim == 1}
        return {name: (one.values, str(one.attrs.get("units", ""))) for name, one in series.items()}


def _matlab(path: Path) -> Columns:
    """In a process of its own, since the reader of SciPy ends its process at some damaged files."""
    try:
        child = subprocess.run([sys.executable, "-c", _CHILD, path], capture_output=True, timeout=_LONGEST, check=True)
    except subprocess.SubprocessError:
        raise TrialError(f"{path} cannot be read as MAT: its structure is damaged; write it anew, or as CSV.") from None
    return dict(_series(pickle.loads(child.stdout)))


def _matlab_73(path: Path) -> Columns:
    import h5py

    def numbers(group: Any) -> Mapping[str, Any]:
        names = [name for name in group if not name.startswith("#")]
        parts = {name: group[name] for name in names}
        return {
            name: numbers(one) if isinstance(one, h5py.Group) else _values(one, path) for name, one in parts.items()
        }

    with h5py.File(path) as file:
        return dict(_series(numbers(file)))


def _values(data: Any, path: Path) -> np.ndarray:
    _check_size(path, data.nbytes)
    return np.squeeze(data[()])


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


def _check_size(path: Path, size: int) -> None:
    if size > 4 * MOST_BYTES:
        raise TrialError(f"{path}: a trial has at most {4 * MOST_BYTES / 1e6:.0f} MB unpacked, found more; split it.")


_KINDS = {
    b"PAR1": "Parquet",
    b"PK\x03\x04": "xlsx",
    b"\x89HDF": "NetCDF",
    b"CDF": "NetCDF",
    b"MATLAB 5.0": "MAT",
    b"MATLAB 7.3": "MAT 7.3",
}
"""Kind of a file by its first bytes; a MAT file of version 7.3 is HDF5 behind a header of its own."""

_READERS: Mapping[str, Callable[[Path], Columns]] = {
    "Parquet": _parquet,
    "xlsx": _xlsx,
    "NetCDF": _netcdf,
    "MAT": _matlab,
    "MAT 7.3": _matlab_73,
}


_SENTENCE = re.compile(r"^(.*?)[ ,;\t]*([$!][A-Z]{2}[A-Z]{3},.*)$")
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
    if sum(bool(_SENTENCE.match(line)) for line in first) <= _SHORTEST_LOG * len(first):
        return None
    try:
        import pynmea2
    except ImportError:
        raise TrialError(f"{path}: NMEA 0183 needs pynmea2, found none; pip install 'pymc-ship[formats]'.") from None
    readings, damaged, utc = [], 0, ""
    for line in lines:
        matched = _SENTENCE.match(line)
        try:
            message = pynmea2.parse(matched[2].strip(), check=True) if matched else None
        except pynmea2.SentenceTypeError:
            continue
        except (pynmea2.ParseError, ValueError, TypeError):
            message = None
        damaged += message is None and bool(line.strip())
        if message is None or not hasattr(message, "talker"):
            continue
        with suppress(AttributeError, ValueError, TypeError):
            utc = f"{message.timestamp:%H:%M:%S.%f}" if message.timestamp else utc
        readings.append((matched[1].strip() if matched else "", utc, message))
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
