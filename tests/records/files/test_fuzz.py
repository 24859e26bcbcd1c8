"""Damaged files and files that are bombs: each is read, or refused in one sentence, soon and in bounded memory."""

from __future__ import annotations

import os
import socket
import struct
import sys
import time
import zipfile
import zlib
from collections import Counter

import h5py
import netCDF4
import numpy as np
import openpyxl
import pyarrow
import pyarrow.parquet
import pytest

import pymc_ship as ps
from pymc_ship.machine.memory import peak_memory
from tests.records.files.file_fuzz import KINDS, reading, spoilt_file
from tests.sentences import refused

SHEET = (
    '<worksheet xmlns="http://schemas.openxmlformats.org/spreadsheetml/2006/main"><sheetData>{}</sheetData></worksheet>'
)
MOST_MEMORY = 1.2e9  # bytes
LONGEST = 30.0  # s of the processor


def test_damaged_files_of_every_format_are_read_or_refused_in_a_sentence(run, tmp_path):
    """The first of the files of ``python -m tests.records.files.file_fuzz``."""
    counts = Counter()
    for seed in range(4 * len(KINDS)):
        path = spoilt_file(seed, run.isel(time=slice(120)), tmp_path)
        counts[reading(path)] += 1
    assert min(counts["read"], counts["refused"]) > len(KINDS), counts


# bombs ----------------------------------------------------------------------------------------------------------------


def workbook(sheet):
    """Writer of a workbook with this sheet."""

    def write(path):
        book = openpyxl.Workbook()
        book.save(path)
        with zipfile.ZipFile(path) as archive:
            members = {name: archive.read(name) for name in archive.namelist()}
        members["xl/worksheets/sheet1.xml"] = SHEET.format(sheet).encode()
        with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
            for name, part in members.items():
                archive.writestr(name, part)

    return write


def matlab_of_zeros(path):
    """A matrix of 1.2 GB, compressed."""
    size, packed = 12 * 10**8, zlib.compressobj(1)
    head = struct.pack("<10I", 14, size + 56, 6, 8, 6, 0, 5, 8, 1, size // 8)
    parts = [packed.compress(head + struct.pack("<2I8s2I", 1, 1, b"u", 9, size))]
    parts += [packed.compress(bytes(10**7)) for _ in range(size // 10**7)]
    data = b"".join([*parts, packed.flush()])
    path.write_bytes(b"MATLAB 5.0".ljust(124) + struct.pack("<HH2I", 0x100, 0x4D49, 15, len(data)) + data)


def hdf5_of_many(path):
    """60 vectors of 60 million numbers, none of them written, and groups that contain each other."""
    with h5py.File(path, "w", userblock_size=512) as file:
        for k in range(60):
            file.create_dataset(f"c{k}", (1, 60_000_000), dtype="f8", chunks=(1, 1_000_000))
            file.create_group(f"g{k}")["back"] = file["/"]
    with path.open("r+b") as file:
        file.write(b"MATLAB 7.3 MAT-file".ljust(124))


def netcdf_of_many(path):
    with netCDF4.Dataset(path, "w") as data:
        data.createDimension("time", 1_000_000_000)
        for name in ("time", "u"):
            data.createVariable(name, "f8", ("time",), zlib=True)


def netcdf_of_other_calendar(path):
    with netCDF4.Dataset(path, "w") as data:
        data.createDimension("row", 4_000_000)
        data.createVariable("time", "i4", ("row",), zlib=True).setncatts(
            {"units": "days since 2000-01-01", "calendar": "360_day"}
        )
        data["time"][:] = 1


def parquet_of_one_text(path):
    """A text of 1 MB in 100 000 rows."""
    texts = pyarrow.DictionaryArray.from_arrays(
        pyarrow.array(np.zeros(100_000, np.int32)), pyarrow.array(["x" * 10**6])
    )
    table = pyarrow.table({"time": np.arange(1e5), "u": texts})
    pyarrow.parquet.write_table(table, path, store_schema=False)


def parquet_of_lists(path):
    table = pyarrow.table({"time": np.arange(3.0), "u": pyarrow.array([[1.0] * 10_000] * 3)})
    pyarrow.parquet.write_table(table, path)


def parquet_of_rows(path):
    pyarrow.parquet.write_table(pyarrow.table({name: np.zeros(6_000_000) for name in ("time", "u")}), path)


def text(content):
    """Writer of a text."""
    return lambda path: path.write_bytes(content())


BOMBS = {
    "far.xlsx": workbook('<row r="99999999999"><c r="A99999999999"><v>1</v></c></row>'),
    "wide.xlsx": workbook("".join(f'<row r="{k}"><c r="XFD{k}"><v>1</v></c></row>' for k in range(1, 1_500))),
    "zeros.mat": matlab_of_zeros,
    "many.mat": hdf5_of_many,
    "many.nc": netcdf_of_many,
    "calendar.nc": netcdf_of_other_calendar,
    "text.parquet": parquet_of_one_text,
    "lists.parquet": parquet_of_lists,
    "rows.parquet": parquet_of_rows,
    "rows.csv": text(lambda: b"time,u\n" + b",\n" * 60_000_000),
    "columns.csv": text(lambda: (b"u," * 60_000 + b"\n") * 30),
    "logs.nmea": text(lambda: (b"$HEHDT,1.0,T*2F\n" * 100 + b" ,;\t" * 100_000 + b"x\n") * 2),
    "spaces.txt": text(lambda: b"time" + b" " * 900_000 + b"u [m/s\n0 1\n1 1\n2 3\n"),
    "brackets.txt": text(lambda: b"time " + b"[" * 900_000 + b"(u\n0 1\n1 1\n2 3\n"),
    "bars.csv": text(lambda: b"time," + b"u_" * 450_000 + b"\n0,1\n1,1\n2,3\n"),
    "digits.csv": text(lambda: b"time,u\n" + b"9" * 10_000 + b":00:00,1\n08:00:01,1\n08:00:02,3\n"),
    "cell.csv": text(lambda: b"time,u\n0,1\n1," + b"x" * 5_000_000 + b"\n2,3\n"),
}


@pytest.mark.parametrize("name", BOMBS)
def test_a_bomb_is_refused_soon_and_in_bounded_memory(tmp_path, name):
    path = tmp_path / name
    BOMBS[name](path)
    begin, memory = time.process_time(), peak_memory()
    assert reading(path) == "refused"
    assert time.process_time() - begin < LONGEST
    assert memory is None or peak_memory() - memory < MOST_MEMORY


# paths that are no file -----------------------------------------------------------------------------------------------


@pytest.mark.skipif(sys.platform == "win32", reason="Windows has no such files")
def test_paths_that_are_no_file_are_refused_in_a_sentence(tmp_path):
    os.mkfifo(tmp_path / "pipe.csv")
    (tmp_path / "nothing.csv").symlink_to(tmp_path / "none")
    (tmp_path / "itself.csv").symlink_to(tmp_path / "itself.csv")
    with socket.socket(socket.AF_UNIX) as server:
        server.bind(os.path.relpath(tmp_path / "socket.csv"))
        for path in (
            "pipe.csv",
            "socket.csv",
            "nothing.csv",
            "itself.csv",
            ".",
            "x" * 5_000,
            "none.csv/run.csv",
            "a\0b",
        ):
            with refused(ps.TrialError):
                ps.read_trial(tmp_path / path)
    with refused(ps.TrialError, "device"):
        ps.read_trial("/dev/zero")
