"""Parquet, xlsx, NetCDF and MAT files as the table of a text file; each library is imported when it is needed."""

from __future__ import annotations

import pickle
import subprocess
import sys
import zipfile
from collections.abc import Callable, Iterator, Mapping
from contextlib import closing
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
