from __future__ import annotations

import gzip

import numpy as np
import pandas as pd
import pytest
import xarray as xr

import pymc_ship as ps
from pymc_ship.machine import text
from pymc_ship.machine.errors import TrialError
from pymc_ship.records.files import reading
from pymc_ship.trial import thinning
from pymc_ship.trial.cells import Numbers
from pymc_ship.trial.thinning import Thinning, kept_rows, rows_for_one, thinned
from tests.sentences import refused

ROWS, EVERY = 9_003, 5
MOST = 2_000


@pytest.fixture
def few_rows(monkeypatch):
    """Tables of some thousand rows are long."""
    monkeypatch.setattr(thinning, "MOST_ROWS", MOST)
    monkeypatch.setattr(reading, "MOST_ROWS", MOST)
    monkeypatch.setattr(text, "LONGEST_LINE", 2**10)
    monkeypatch.setattr(text, "_BLOCK", 2**13)


def motion(rows):
    """Zigzag on a northern course, whose heading passes 0 and 360 deg."""
    time = np.arange(rows) * 0.01
    angle = 0.2 * time
    return pd.DataFrame(
        {
            "time [s]": time.round(2),
            "u [m/s]": 7.0 + 0.5 * np.cos(2 * angle),
            "r [deg/s]": 2.0 * np.cos(angle),
            "psi [deg]": 10.0 * np.sin(angle),
            "delta [deg]": np.where(np.sin(angle + 0.6) > 0.0, 10.0, -10.0),
        }
    )


def noisy(table):
    rng = np.random.default_rng(0)
    for name, sd in {"u [m/s]": 0.05, "r [deg/s]": 0.2, "psi [deg]": 0.5}.items():
        table[name] = (table[name] + rng.normal(0.0, sd, len(table))).round(4)
    table["psi [deg]"] %= 360.0
    return table


def csv(table, path):
    table.to_csv(path, index=False)


def semicolons(table, path):
    table.to_csv(path, index=False, sep=";", decimal=",")


def blanks(table, path):
    path.write_text(table.to_csv(index=False, sep="\t").replace(" [", "[").replace("\t", "  "))


def zipped(table, path):
    path.write_bytes(gzip.compress(table.to_csv(index=False).encode()))


def commented(table, path):
    """Titles, comments, empty rows and repeated headers among the rows."""
    head, *lines = table.to_csv(index=False).splitlines()
    lines[4000:4000] = ["# a comment", ",,,,", head]
    path.write_text("\n".join(["A ship", "of a firm", head, *lines]))


def dated(table, path):
    stamps = pd.Timestamp("2024-05-01T08:00:00Z") + pd.to_timedelta(table["time [s]"], unit="s")
    table.assign(**{"time [s]": stamps.dt.strftime("%Y-%m-%dT%H:%M:%S.%f")}).rename(
        columns={"time [s]": "time"}
    ).to_csv(path, index=False)


def netcdf(table, path):
    columns = {name.split()[0]: ("row", table[name].values, {"units": name.split("[")[1][:-1]}) for name in table}
    xr.Dataset(columns).to_netcdf(path)


WRITERS = {
    "csv": csv,
    "semicolons": semicolons,
    "blanks": blanks,
    "gzip": zipped,
    "comments": commented,
    "dates": dated,
    "parquet": lambda table, path: table.to_parquet(path, index=False, row_group_size=1_001),
    "netcdf": netcdf,
}


@pytest.mark.parametrize("layout", WRITERS)
def test_a_long_record_is_that_of_the_motion_with_less_noise(few_rows, tmp_path, layout):
    path = tmp_path / "run"
    WRITERS[layout](noisy(motion(ROWS)), path)
    trial, run = ps.read_trial(path), motion(ROWS)[EVERY // 2 :: EVERY][: ROWS // EVERY]
    assert f"{ROWS} rows are thinned to {ROWS // EVERY}: the median of each {EVERY}" in trial.attrs["reading"]
    time = run["time [s]"].values
    begin = time[0] if layout == "dates" else 0.0
    np.testing.assert_allclose(trial["time"], time - begin, atol=1e-6)
    np.testing.assert_array_equal(np.abs(trial["delta"]), np.deg2rad(10.0))
    for name, sd in {"u": 0.05, "r": np.deg2rad(0.2), "psi": np.deg2rad(0.5)}.items():
        column = next(one for one in run if one.startswith(f"{name} "))
        error = trial[name] - (run[column] if name == "u" else np.deg2rad(run[column]))
        assert abs(error.mean()) < 0.1 * sd
        assert 0.3 * sd < error.std() < 0.65 * sd, name


def test_a_record_below_the_bound_is_read_as_it_is(few_rows, tmp_path, monkeypatch):
    csv(noisy(motion(MOST)), tmp_path / "run.csv")
    trial = ps.read_trial(tmp_path / "run.csv")
    assert trial.sizes["time"] == MOST
    monkeypatch.undo()
    xr.testing.assert_identical(trial, ps.read_trial(tmp_path / "run.csv"))


class TestGaps:
    """The heading falls with the time, also over a gap, and is in every second row: of three and two, one and two.

    A block over a gap would have the time of its middle row, and the heading of the other side.
    """

    def check(self, path, layout, stamps):
        table = pd.DataFrame({"time [s]": stamps.round(2), "psi [deg]": -stamps, "u [m/s]": 7.0 + 0.0 * stamps})
        table.loc[::2, "psi [deg]"] = np.nan
        WRITERS[layout](table, path)
        trial = ps.read_trial(path)
        begin = stamps[2] if layout == "dates" else 0.0
        np.testing.assert_allclose(-np.rad2deg(trial["psi"]), trial["time"] + begin, atol=0.03)

    @pytest.mark.parametrize("layout", sorted({*WRITERS} - {"blanks"}))
    @pytest.mark.parametrize("gap", [1.5, 60.0])
    @pytest.mark.parametrize("side", [4_003, 4_007])
    def test_no_sample_is_of_both_sides_of_a_gap(self, few_rows, tmp_path, layout, gap, side):
        stamps = 0.01 * np.arange(ROWS)
        stamps[side:] += gap
        self.check(tmp_path / "run", layout, stamps)

    @pytest.mark.parametrize("side", [5_003, 5_007])
    def test_no_sample_is_of_two_clocks(self, few_rows, tmp_path, side):
        stamps = 0.01 * np.arange(ROWS)
        stamps[side:] -= 40.0
        self.check(tmp_path / "run", "csv", stamps)

    @pytest.mark.parametrize("side", [4_003, 4_007])
    def test_newest_rows_first(self, few_rows, tmp_path, side):
        stamps = 0.01 * np.arange(ROWS)[::-1]
        stamps[:side] += 60.0
        self.check(tmp_path / "run", "csv", stamps)

    @pytest.mark.parametrize("side", [4_003, 4_007])
    def test_the_files_of_a_folder_have_gaps_of_their_own(self, few_rows, tmp_path, side):
        stamps = 0.01 * np.arange(ROWS)
        late = stamps + 1.5 * (np.arange(ROWS) >= side)
        gyro = pd.DataFrame({"time [s]": late.round(2), "psi [deg]": -late})
        gyro.loc[::2, "psi [deg]"] = np.nan
        csv(gyro, tmp_path / "gyro.csv")
        csv(pd.DataFrame({"time [s]": stamps.round(2), "u [m/s]": 7.0 + 0.0 * stamps}), tmp_path / "log.csv")
        trial = ps.read_trial(tmp_path)
        np.testing.assert_allclose(-np.rad2deg(trial["psi"]), trial["time"], atol=0.03)

    def test_a_clock_of_whole_seconds_has_no_gaps(self, few_rows, tmp_path):
        table = motion(ROWS)
        table["time [s]"] = table["time [s]"] // 1.0
        csv(table, tmp_path / "run.csv")
        assert "beside gaps" not in ps.read_trial(tmp_path / "run.csv").attrs["reading"]


def test_a_vibration_above_the_sampling_is_damped_and_not_folded(few_rows, tmp_path):
    table = motion(ROWS)
    vibration = np.sin(2.0 * np.pi * 0.39 * np.arange(ROWS))
    table["u [m/s]"] += vibration
    csv(table, tmp_path / "run.csv")
    error = ps.read_trial(tmp_path / "run.csv")["u"].values - motion(ROWS)["u [m/s]"][2::5][: ROWS // EVERY]
    assert error.std() < 0.5 * vibration[2::5].std()


def test_a_wrong_cell_and_a_short_row_are_refused_with_their_line(few_rows, tmp_path):
    lines = motion(ROWS).to_csv(index=False).splitlines()
    for row, sentence in {"40.0,x,1,1,1": "'x'", "40.0,1,1": "5001"}.items():
        (tmp_path / "run.csv").write_text("\n".join([*lines[:5000], row, *lines[5000:]]))
        with refused(TrialError, sentence):
            ps.read_trial(tmp_path / "run.csv")


def test_captive_tests_are_not_thinned(few_rows, tmp_path):
    (tmp_path / "tests.csv").write_text("beta [deg],speed [kn],X',Y',N'\n" + "8,15.5,-1e-4,5e-4,-3e-4\n" * 3000)
    with refused(TrialError, "captive"):
        ps.read_captive(tmp_path / "tests.csv", "kvlcc2")


class TestKeptRows:
    def kept(self, cells, clocks=(), turning=()):
        return thinned([cells], Thinning(5, frozenset(clocks), frozenset(turning)))[0]

    def numbers(self, cells, **roles):
        return self.kept(Numbers(np.array(cells, dtype=float), True), **roles).values.tolist()

    def test_the_median_of_the_cells_that_are_not_missing(self):
        assert self.numbers([5, 1, 4, 2, 3, np.nan, np.nan, 7, np.nan, np.nan]) == [3, 7]

    def test_a_stand_in_of_one_row_and_the_step_of_an_order_leave_no_mean(self):
        assert self.numbers([2, 2, 9999, 2, 2, 10, 10, -10, -10, -10]) == [2, -10]

    def test_a_heading_goes_the_short_way_round(self):
        assert self.numbers([359.8, 0.1, 359.9, 0.2, 0.0], turning=[0]) == [0.0]
        assert self.numbers([6.2, 0.1, 6.1, 0.2, 0.0], turning=[0]) == [0.0]

    def test_a_stamp_is_that_of_the_middle_row(self):
        assert self.numbers([235958, 235959, 0, 1, 2], clocks=[0]) == [0]

    def test_texts_of_numbers_are_in_the_order_of_their_numbers(self):
        assert self.kept(["10,5", "9,1", "", "11,0", "8"]) == ["9,1"]
        assert self.kept(["a", "b", "c", "", "e"]) == ["b"]

    def test_the_parts_of_a_stamp_are_of_one_row(self):
        columns = [["1", "1", "", "1", "2"], ["7", "8", "9", "", "0"]]
        rows = kept_rows(columns, Thinning(5, frozenset((0, 1)), frozenset()))
        assert [one.tolist() for one in rows] == [[1], [1]]


def test_one_row_of_an_odd_number_is_left():
    assert rows_for_one(thinning.MOST_ROWS, 8) == 1
    assert rows_for_one(thinning.MOST_ROWS + 1, 8) == 3
    assert rows_for_one(10_000_000, 8) == 25
    assert rows_for_one(10_000, 900, whole=False) == 3  # nine million cells


def test_fill_values_are_no_median():
    cells = Numbers(np.array([9.97e36, 9.97e36, 2.0, 3.0, np.nan, 9.97e36]), False)
    (rows,) = kept_rows([cells], Thinning(3, frozenset(), frozenset()))
    assert rows.tolist() == [2, 3]
