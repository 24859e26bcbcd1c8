from __future__ import annotations

import zipfile

import h5py
import numpy as np
import openpyxl
import pyarrow
import pyarrow.parquet
import pytest
import scipy.io
import xarray as xr

import pymc_ship as ps
from pymc_ship.machine.errors import TrialError
from tests.records.files.cases import NAMES, columns
from tests.sentences import refused

MOTION = NAMES[1:]


def parquet(path, table):
    pyarrow.parquet.write_table(pyarrow.table(table), path)


def workbook(path, table):
    book = openpyxl.Workbook()
    book.active.append(["run 7"])
    book.active.append(list(table))
    for row in zip(*(values.tolist() for values in table.values()), strict=True):
        book.active.append(row)
    book.save(path)


def netcdf(path, table):
    data = xr.Dataset({name: ("time", values) for name, values in table.items() if name != "time"})
    data["psi"] = ("time", np.rad2deg(table["psi"]), {"units": "degree_true"})
    data.assign_coords(time=("time", table["time"], {"units": "s"})).to_netcdf(path)


def matlab(path, table):
    scipy.io.savemat(path, {"run": {**table, "L": 230.0, "note": "calm"}})


def simulink(path, table):
    """A structure with time, as the block To Workspace writes it."""
    signals = [{"values": values[:, None], "label": name} for name, values in table.items() if name != "time"]
    scipy.io.savemat(path, {"out": {"time": table["time"][:, None], "signals": signals}})


def matlab_73(path, table):
    with h5py.File(path, "w", userblock_size=512) as file:
        for name, values in table.items():
            file[f"run/{name}"] = values[None]
    with path.open("r+b") as file:
        file.write(b"MATLAB 7.3 MAT-file, Platform: GLNXA64".ljust(124))


WRITERS = {
    "run.parquet": parquet,
    "run.xlsx": workbook,
    "run.nc": netcdf,
    "run.mat": matlab,
    "simulink.mat": simulink,
    "run73.mat": matlab_73,
}


@pytest.mark.parametrize("name", WRITERS)
def test_a_table_of_another_writer_is_the_same_trial(run, tmp_path, name):
    WRITERS[name](tmp_path / name, columns(run))
    trial = ps.read_trial(tmp_path / name)
    for channel in MOTION:
        np.testing.assert_allclose(trial[channel], run[channel], rtol=1e-12, atol=1e-13, err_msg=channel)


@pytest.mark.parametrize("name", ["run.parquet", "run.nc"])
def test_dates_are_a_clock(run, tmp_path, name):
    table = columns(run)
    table["time"] = np.datetime64("2020-01-01T23:59:50", "ns") + (1e9 * table["time"]).round().astype("timedelta64[ns]")
    if name == "run.nc":
        xr.Dataset({key: ("time", table[key]) for key in MOTION}, {"time": table["time"]}).to_netcdf(tmp_path / name)
    else:
        parquet(tmp_path / name, table)
    trial = ps.read_trial(tmp_path / name)
    np.testing.assert_allclose(trial["time"], run["time"] - run["time"][0], atol=1e-6)
    np.testing.assert_allclose(trial["u"], run["u"], rtol=1e-9)


@pytest.mark.parametrize(("part", "size"), [("<!DOCTYPE a [<!ENTITY b 'c'>]>", 0), ("", 700_000_000)])
def test_bombs_are_refused(tmp_path, part, size):
    with (
        zipfile.ZipFile(tmp_path / "run.xlsx", "w", zipfile.ZIP_DEFLATED, compresslevel=1) as archive,
        archive.open("xl/workbook.xml", "w") as member,
    ):
        member.write(part.encode())
        for _ in range(size // 10_000_000):
            member.write(bytes(10_000_000))
    with refused(TrialError, "DTD" if part else "unpacked"):
        ps.read_trial(tmp_path / "run.xlsx")
