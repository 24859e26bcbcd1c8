from __future__ import annotations

import zipfile

import h5py
import numpy as np
import openpyxl
import pandas as pd
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


def sheets(path, tables):
    book = openpyxl.Workbook()
    book.remove(book.active)
    for title, rows in tables.items():
        sheet = book.create_sheet(title)
        for row in rows:
            sheet.append(row)
    book.save(path)


def rows_of(table, headings=None):
    return [headings or list(table), *zip(*(values.tolist() for values in table.values()), strict=True)]


def test_structs_of_the_same_names_are_refused(run, tmp_path):
    """Also where one has another length, or lacks a channel."""
    table = columns(run)
    for other in (
        {name: values[:-5] for name, values in table.items()},
        {name: 2.0 * table[name] for name in ("time", "u")},
    ):
        scipy.io.savemat(tmp_path / "run.mat", {"zigzag": table, "circle": other})
        with refused(TrialError, "time", "zigzag", "circle"):
            ps.read_trial(tmp_path / "run.mat")


def test_structs_that_agree_or_differ_in_settings_are_read(run, tmp_path):
    table = columns(run)
    ship = {"name": "a", "x": np.arange(3.0), "steps": np.arange(run.sizes["time"])}
    other = {"time": table["time"], "steps": -ship["steps"]}
    scipy.io.savemat(tmp_path / "run.mat", {"run": table, "more": other, "ship": ship})
    trial = ps.read_trial(tmp_path / "run.mat")
    for name in MOTION:
        np.testing.assert_allclose(trial[name], run[name], rtol=1e-12, atol=1e-13, err_msg=name)
    assert f"Columns left out: x (3 rows); the table has {run.sizes['time']}." in trial.attrs["reading"].splitlines()


@pytest.mark.parametrize("name", ["run.mat", "run.nc"])
def test_a_column_of_another_length_is_named(run, tmp_path, name):
    table = columns(run)
    late = table.pop("delta")[::10]
    if name == "run.mat":
        scipy.io.savemat(tmp_path / name, {**table, "delta": late})
    else:
        data = xr.Dataset({key: ("time", table[key]) for key in table if key != "time"}, {"time": table["time"]})
        data.assign(delta=("other", late)).to_netcdf(tmp_path / name)
    words = f"Columns left out: delta ({late.size} rows); the table has {run.sizes['time']}."
    assert words in ps.read_trial(tmp_path / name).attrs["reading"].splitlines()


def test_tables_side_by_side_are_refused(run, tmp_path):
    table = columns(run)
    changed = rows_of({name: 1.01 * values for name, values in table.items()})
    sheets(tmp_path / "run.xlsx", {"d": [[*a, None, *b] for a, b in zip(rows_of(table), changed, strict=True)]})
    with refused(TrialError, "time", "L"):
        ps.read_trial(tmp_path / "run.xlsx")


def test_a_sheet_that_is_no_table_is_named_and_two_tables_are_refused(run, tmp_path):
    table, path = columns(run), tmp_path / "run.xlsx"
    sheets(path, {"info": [["Ship", "KCS"], ["Date", "May 4"]], "run 7": rows_of(table), "none": []})
    trial = ps.read_trial(path)
    np.testing.assert_allclose(trial["u"], run["u"], rtol=1e-12)
    assert trial.attrs["reading"].splitlines()[0] == "Sheet run 7 read; sheets left out: info."
    sheets(path, {"zigzag": [["Zigzag", "20/20"], *rows_of(table)], "circle": rows_of(table)})
    with refused(TrialError, "zigzag", "circle"):
        ps.read_trial(path)


def test_a_workbook_may_have_titles_and_a_row_of_units(run, tmp_path):
    table, path = columns(run), tmp_path / "run.xlsx"
    table["psi"] = np.rad2deg(table["psi"])
    units = {"time": "s", "psi": "[deg]", "x": "m", "y": "m", "u": "m/s", "v": "m/s"}
    units |= {"r": "rad/s", "p": "rad/s", "phi": "rad", "delta": "rad"}
    header, *cells = rows_of(table, ["Heading" if name == "psi" else name for name in table])
    sheets(path, {"d": [["MT Example", "zigzag"], header, [units[name] for name in table], *cells]})
    trial = ps.read_trial(path)
    for name in MOTION:
        np.testing.assert_allclose(trial[name], run[name], rtol=1e-12, atol=1e-13, err_msg=name)


def test_headings_of_a_workbook_have_line_breaks(run, tmp_path):
    names = {"time": "Time\n[s]", "u": "STW\n[m/s]", "psi": "Heading\u00a0[rad]", "delta": "Rudder\nangle\n[rad]"}
    sheets(tmp_path / "run.xlsx", {"run": rows_of({heading: columns(run)[name] for name, heading in names.items()})})
    trial = ps.read_trial(tmp_path / "run.xlsx")
    np.testing.assert_allclose(trial["psi"], run["psi"], atol=1e-12)
    np.testing.assert_allclose(np.abs(trial["delta"]), np.abs(run["delta"]), atol=1e-12)
    assert "delta from 'Rudder angle [rad]' in rad" in trial.attrs["reading"]


def test_an_index_of_stamps_without_a_name_is_the_time(run, tmp_path):
    table = pd.DataFrame({"u [m/s]": run["u"].values, "psi [rad]": run["psi"].values})
    exact = table.set_index(pd.Timestamp("2026-01-31T23:59:50") + pd.to_timedelta(run["time"].values, "s"))
    exact.to_parquet(tmp_path / "run.parquet")
    trial = ps.read_trial(tmp_path / "run.parquet")
    np.testing.assert_allclose(trial["time"], run["time"], atol=1e-6)
    assert trial.attrs["reading"].startswith("The index without a name is taken as the time.")
    table.set_index(np.arange(len(table)) * 3).to_parquet(tmp_path / "rows.parquet")
    with refused(ps.TrialError, "time"):
        ps.read_trial(tmp_path / "rows.parquet")


def test_an_archive_is_named(tmp_path):
    with zipfile.ZipFile(tmp_path / "run.zip", "w") as archive:
        archive.writestr("gps.csv", "time,u\n0,1\n1,2\n")
    with refused(ps.TrialError, "gps.csv"):
        ps.read_trial(tmp_path / "run.zip")
