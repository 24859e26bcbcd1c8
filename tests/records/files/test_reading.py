from __future__ import annotations

import gzip
import tracemalloc

import numpy as np
import pandas as pd
import pytest
import xarray as xr

import pymc_ship as ps
from pymc_ship.machine import text
from pymc_ship.machine.errors import TrialError
from pymc_ship.records.files import text_rows
from pymc_ship.records.files.reading import read_file
from pymc_ship.trial.record import check_trial
from tests.records.files.cases import NAMES, columns, written
from tests.records.files.mutated import mutated
from tests.sentences import refused


def assert_same(trial, run, names=NAMES):
    for name in names:
        np.testing.assert_array_equal(trial[name], run[name], err_msg=name)


class TestText:
    def test_a_file_of_this_package_is_taken_as_it_is(self, run, tmp_path):
        trial = ps.read_trial(ps.write_trial(run, tmp_path / "run.csv"))
        assert_same(trial, run, (*NAMES, "n"))
        assert trial["n"].attrs["units"] == "rev/s"
        assert trial.attrs == {"reading": ""}

    @pytest.mark.parametrize("delimiter", [",", ";", "\t", " ", "   ", " ; ", ", "])
    def test_delimiters(self, run, read, delimiter):
        trial = read(written(columns(run), delimiter))
        assert_same(trial, run)
        assert trial.attrs["reading"] == ""

    @pytest.mark.parametrize("delimiter", [";", "\t", " "])
    def test_decimal_commas(self, run, read, delimiter):
        trial = read(written(columns(run), delimiter, cell=lambda value: repr(value).replace(".", ",")))
        assert_same(trial, run)
        assert trial.attrs["reading"] == "Decimal commas read as points."

    def test_a_counter_of_rows_is_no_channel(self, run, read):
        table = columns(run)
        trial = read(written({"n": np.arange(len(run["time"])), **table}))
        assert "n" not in trial
        assert trial.attrs["reading"] == "'n' counts the rows: left out."
        trial = read(written({**table, "n": np.arange(len(run["time"]))}), format={"columns": {"n": "n"}})
        assert trial["n"].values[-1] == len(run["time"]) - 1

    def test_a_date_and_a_time_of_one_heading(self, run, read):
        """In columns between white space they are two cells."""
        rows = ["Timestamp u[m/s] psi[deg]"]
        rows += [f"31.01.2026 08:00:{k:02d} {float(run['u'].values[k])!r} {k}" for k in range(20)]
        trial = read("\n".join(rows))
        np.testing.assert_array_equal(trial["time"], np.arange(20.0))
        np.testing.assert_array_equal(trial["u"], run["u"].values[:20])

    def test_a_zone_or_a_pattern_stands_in_a_row_of_units(self, read):
        for unit in ("UTC", "hh:mm:ss AM/PM", "[hh:mm:ss]"):
            trial = read(f"Time,Heading,STW\n{unit},deg,kn\n1:00:00 PM,1,2\n1:00:01 PM,1,2\n1:00:02 PM,1,2\n")
            np.testing.assert_allclose(trial["u"], 2.0 * 1852.0 / 3600.0)

    def test_units_and_hemispheres_behind_the_numbers(self, run, tmp_path):
        """As loggers with a display write: 15.5 kn, 12.1°, 53.49 N."""
        path = tmp_path / "display.csv"
        rows = ["time,u,v,psi,r,RSA,Latitude,Longitude"]
        for k, time in enumerate(run["time"].values):
            u, v, psi, r, delta, x, y = (run[name].values[k] for name in ("u", "v", "psi", "r", "delta", "x", "y"))
            cells = f"{time} s,{u / 0.5144444444:.5f} kn,{v:.5f} m/s,{np.rad2deg(psi):.4f}°,{np.rad2deg(r):.5f} deg/s"
            north, west = f"{53.5 + x / 111e3:.7f}° N", f"{8.1 - y / 66e3:.7f} W"
            rows.append(f"{cells},{-np.rad2deg(delta):.4f}°,{north},{west}")
        path.write_text("\n".join(rows))
        trial = ps.read_trial(path)
        for name in ("u", "v", "psi", "r", "delta"):
            np.testing.assert_allclose(trial[name], run[name], atol=1e-4, err_msg=name)
        assert np.corrcoef(trial["y"], run["y"])[0, 1] > 0.999
        assert "Longitude: E and W behind each number read." in trial.attrs["reading"].splitlines()

    @pytest.mark.parametrize("beside", ["before", "behind", "column"])
    def test_letters_of_a_side_are_signs(self, run, read, beside):
        """Rudder 10.0 P, rate of turn S 3.1, or the letter in a column beside."""
        table, lines = columns(run), ["time,u [m/s],Heading [deg],ROT [deg/s],ROT dir,Rudder angle [deg],Side"]
        for time, u, psi, *turned in zip(*(table[name] for name in ("time", "u", "psi", "r", "delta")), strict=True):
            cells = []
            for value, port in zip(np.rad2deg(turned), "PS", strict=True):
                letter, number = "PS"[("PS"[int(value < 0)] == port)], f"{abs(value):.9f}"
                together = f"{letter} {number}" if beside == "before" else f"{number}{letter}"
                cells += [number, letter] if beside == "column" else [together, ""]
            lines.append(",".join([repr(float(time)), repr(float(u)), f"{np.rad2deg(psi) % 360.0:.9f}T", *cells]))
        text = "\n".join(lines)
        trial = read(text if beside == "column" else text.replace("ROT dir,", ",").replace(",Side", ","))
        for name in ("u", "r", "delta"):
            np.testing.assert_allclose(trial[name], run[name], atol=1e-9, err_msg=name)
        np.testing.assert_allclose(np.diff(trial["psi"]), np.diff(run["psi"]), atol=1e-9)
        notes = trial.attrs["reading"].splitlines()
        assert "Rudder angle [deg]: P and S behind each number read." in notes
        assert "delta changed in sign: the file counts it positive to starboard." in notes

    @pytest.mark.parametrize("heading", ["", "T/M", "ref", "heading ref"])
    def test_the_letter_of_north_beside_a_heading(self, read, heading):
        """True or magnetic, as HDT,123.4,T split into columns has it; also where a number is missing."""
        rows = "".join(f"{k},5,{12 + k},{{0}},0\n" for k in range(5))
        table = f"time,u,Heading [deg],{heading},v\n{rows}5,5,,{{0}},0\n"
        trial = read(table.format("T"))
        np.testing.assert_allclose(np.rad2deg(trial["psi"]), 12.0 + np.arange(trial.sizes["time"]))
        assert "Heading [deg]: T behind each number read." in trial.attrs["reading"].splitlines()
        with refused(TrialError, "Heading", "offset"):
            read(table.format("M"))
        stated = {"columns": {"psi": {"column": "Heading [deg]", "unit": "deg", "offset": 2.5}}}
        trial = read(table.format("M"), format=stated)
        np.testing.assert_allclose(np.rad2deg(trial["psi"]), 14.5 + np.arange(trial.sizes["time"]))
        assert "Heading [deg]: M behind each number read." in trial.attrs["reading"].splitlines()

    def test_the_letter_of_reference_beside_a_wind(self, read):
        """R of MWV is a relative wind, T a true one; both in one column are refused."""
        head = "time,u,v,psi [deg],wind_speed,Wind direction [deg],ref\n"
        still = head + "".join(f"{k},5,0,0,5,0,{{0}}\n" for k in range(5))  # the ship's own wind
        assert read(still.format("R"))["wind_speed"].values == pytest.approx(0.0)
        assert read(still.format("T"))["wind_speed"].values == pytest.approx(5.0)
        with refused(TrialError, "direction"):
            read(still.replace("0,5,0,0,5,0,{0}", "0,5,0,0,5,0,R").format("T"))

    @pytest.mark.parametrize("words", ["wind_direction", "Wind direction true"])
    def test_what_the_wind_is_taken_for_is_stated(self, read, words):
        still = f"time,u,wind_speed,{words} [deg]\n" + "".join(f"{k},5,5,0\n" for k in range(5))
        assert "wind_direction taken as that of the true wind" in read(still).attrs["reading"]

    @pytest.mark.parametrize("north", [33.9, -33.9])
    @pytest.mark.parametrize(
        "form",
        ["columns", "{d}°{m:.7f}'{s}", "{s} {d} {m:.7f}", "{d}°{w}'{t:.5f}\"{s}", "{d}:{m:.7f}{s}", "{d}-{m:.7f}{s}"],
    )
    def test_positions_with_minutes_and_letters(self, run, read, form, north):
        """Also the letters of hemispheres in columns of their own, which signed numbers do not need."""
        x, y = (run[name].values - run[name].values[0] for name in ("x", "y"))
        lines = ["time;u;Latitude [deg];N/S;Longitude [deg];E/W"]
        for k, place in enumerate(zip(north + x / 111e3, -58.2 + y / 92.4e3, strict=True)):
            cells = [repr(float(run["time"][k])), "5.5"]
            for value, letters in zip(place, ("NS", "EW"), strict=True):
                letter, size = letters[int(value < 0)], abs(value)
                minutes = 60.0 * (size % 1.0)
                parts = {"d": int(size), "m": minutes, "w": int(minutes), "t": 60.0 * (minutes % 1.0), "s": letter}
                cells += [f"{size:.9f}", letter] if form == "columns" else [form.format(**parts)]
            lines.append(";".join(cells))
        trial = read(
            "\n".join(lines if form == "columns" else [lines[0].replace("N/S;", "").replace(";E/W", ""), *lines[1:]])
        )
        assert np.corrcoef(trial["x"], x)[0, 1] > 0.9999
        assert np.corrcoef(trial["y"], y)[0, 1] > 0.9999
        assert f"origin {north:.6f}, -58.200000 deg" in trial.attrs["reading"]

    def test_signed_positions_need_no_letters(self, read):
        rows = "".join(f"{k};{-33.9 + 1e-5 * k:.6f};S;{58.2 + 1e-5 * k:.6f};E\n" for k in range(9))
        trial = read("time;Latitude [deg];N/S;Longitude [deg];E/W\n" + rows)
        assert trial["x"][-1] > 5.0
        assert "origin -33.900000, 58.200000 deg" in trial.attrs["reading"]

    @pytest.mark.parametrize("cells", ["-1.5 P", "1.5 N", "1.5 P S"])
    def test_a_letter_that_contradicts_its_number_is_refused(self, read, cells):
        with refused(TrialError, "Rudder"):
            read(f"time;u;Rudder [deg]\n0;5;{cells}\n1;5;2 P\n2;5;2 S\n")

    @pytest.mark.parametrize("cell", ["−1.5", "-1.5D+00", "-0.15d1", "-1.5E0"])
    def test_other_spellings_of_a_number(self, read, cell):
        trial = read(f"time;v;x\n0;{cell};1 000.5\n1;---;10’000.5\n2;{cell};1\u202f000\u202f000.5\n")
        np.testing.assert_array_equal(trial["v"], [-1.5, -1.5, -1.5])
        np.testing.assert_array_equal(trial["x"], [1000.5, 10000.5, 1000000.5])
        assert "Thousands separators of 3 cells of x left out." in trial.attrs["reading"].splitlines()

    def test_a_word_among_numbers_with_a_unit_is_refused(self, tmp_path):
        path = tmp_path / "display.csv"
        path.write_text("time [s],u,v [m/s]\n0,15.5 kn,0\n1,fast,0\n2,15.4 kn,0\n")
        with refused(TrialError, "u"):
            ps.read_trial(path)

    def test_a_unit_behind_the_numbers_that_is_not_that_of_the_heading_is_refused(self, tmp_path):
        path = tmp_path / "display.csv"
        path.write_text("time [s],u [m/s],v [m/s]\n0,15.5 kn,0\n1,15.4 kn,0\n2,15.4 kn,0\n")
        with refused(TrialError, "u"):
            ps.read_trial(path)

    @pytest.mark.parametrize("marks", [",.", ".,"])
    def test_separators_of_thousands(self, run, read, marks):
        """1,002.48 and 1.002,48: both marks in one cell leave no doubt."""
        table = columns(run) | {"x": 1000.0 * columns(run)["x"]}
        swap = str.maketrans(",.", marks)
        trial = read(written(table, ";", cell=lambda value: f"{value:,.6f}".translate(swap)))
        np.testing.assert_allclose(trial["x"], table["x"], atol=1e-6)
        assert trial.attrs["reading"].startswith("Thousands separators of ")

    @pytest.mark.parametrize("marks", [",.", ".,"])
    def test_separators_of_whole_thousands(self, read, marks):
        """Beside decimals of the other mark, and whole numbers below a thousand."""
        swap = str.maketrans(",.", marks)
        x = [-1500, 6, 999, 1002, 1234567]
        rows = [f"{0.5 * k:.1f};{-0.25:.2f};{value:,}".translate(swap) for k, value in enumerate(x)]
        trial = read("\n".join(["time;u;x", *rows]))
        np.testing.assert_array_equal(trial["x"], x)
        assert "Thousands separators of 3 cells of x left out." in trial.attrs["reading"].splitlines()

    @pytest.mark.parametrize("cells", [["1.002", "1.003", "1.004"], ["0.998", "1.002", "2"]])
    def test_points_that_may_be_decimal_beside_decimal_commas_are_refused(self, read, cells):
        with refused(TrialError, "time"):
            read("\n".join(["time;u;x", *(f"{k},0;0,5;{cell}" for k, cell in enumerate(cells))]))

    def test_thousands_of_a_file_without_decimals_are_shown_by_their_neighbours(self, read):
        """996, 999, 1.002 as metres; 5, 5.125, 5.25 as a speed would have steps of thousands."""
        x = 990 + 3 * np.arange(9)
        trial = read("\n".join(["time;x;u", *(f"{k};{value:,};7".replace(",", ".") for k, value in enumerate(x))]))
        np.testing.assert_array_equal(trial["x"], x)
        assert trial.attrs["reading"] == "Thousands separators of 5 cells of x left out."
        rows = (f"{k};{value:,};{value + 9000:,}".replace(",", ".") for k, value in enumerate(x))
        np.testing.assert_array_equal(read("\n".join(["time;x;y", *rows]))["y"], x + 9000)
        trial = read("\n".join(["time;x;u", *(f"{k};{5 + k % 2 * 0.125};7" for k in range(9))]).replace("5.0", "5"))
        np.testing.assert_array_equal(trial["x"], 5.0 + 0.125 * (np.arange(9) % 2))

    def test_thousands_that_no_cell_shows_are_decimals_with_a_word(self, read):
        rows = "".join(f"{k};7;{1.203 + 0.001 * k:.3f}\n" for k in range(9))
        trial = read("time;u;shaft [rpm]\n" + rows)
        np.testing.assert_allclose(60.0 * trial["n"], 1.203 + 0.001 * np.arange(9))
        assert "shaft [rpm]: marks as in '1.203' taken as decimal" in trial.attrs["reading"]
        shown = read("time;u;shaft [rpm]\n" + rows.replace(";7;", ";7.5;"))
        assert "marks" not in shown.attrs["reading"]

    def test_numbers_that_no_sensor_tells_from_zero_are_zero(self, read):
        trial = read("time,u,v\n0,5,1e-300\n1,5,-4e-31\n2,5,2e-30\n")
        np.testing.assert_array_equal(trial["v"], [0.0, 0.0, 2e-30])
        assert trial.attrs["reading"] == "2 cells of v, all within 1e-30 of zero, read as 0."

    def test_gzip_is_known_by_its_content(self, run, read):
        raw = gzip.compress(written(columns(run)).encode())
        assert_same(read(raw, "run.csv.gz"), run)
        assert_same(read(raw, "run.csv"), run)

    @pytest.mark.parametrize("end", ["\n", "\r\n", "\r"])
    def test_byte_order_mark_comments_and_line_ends(self, run, read, end):
        text = "\ufeff# facility\n% run 7\n\n" + written(columns(run)) + "# end\n"
        trial = read(text.replace("\n", end))
        assert_same(trial, run)
        assert trial.attrs["reading"] == ""

    @pytest.mark.parametrize("mark", ["# ", "%"])
    def test_a_header_in_the_last_comment(self, run, read, mark):
        assert_same(read("# facility\n" + mark + written(columns(run), " ")), run)

    @pytest.mark.parametrize("form", ["2026-01-31T23:59:{:02d}", "31.01.2026 23:59:{:02d}", "23:59:{:02d}"])
    def test_a_header_in_the_last_comment_before_stamps(self, read, form):
        rows = "".join(f"{form.format(k)},5,{0.01 * k:.2f}\n" for k in range(20))
        trial = read(f"# facility, ship, run\n# Time,u,psi\n{rows}# end\n")
        np.testing.assert_allclose(trial["psi"], 0.01 * np.arange(20))
        assert "time from 'Time'" in trial.attrs["reading"]

    def test_a_header_on_every_page(self, run, read):
        """Also with its row of units."""
        header, *rows = written(columns(run)).splitlines()
        heads = [header, ",".join(["s", "m/s", "m/s", "rad/s", "rad/s", "rad", "rad", "m", "m", "rad"])]
        for lines in (heads[:1], heads):
            trial = read("\n".join([*lines, *rows[:100], *lines, *rows[100:250], *lines, *rows[250:]]))
            assert_same(trial, run)
            note = f"The header is repeated {2 * len(lines)} times: these lines left out."
            assert trial.attrs["reading"].splitlines()[0] == note

    def test_a_header_below_titles_may_have_the_name_of_a_unit(self, read):
        """rpm, or n."""
        trial = read("Log\nShip: a, IMO 1\nTime,u,RPM\n" + "".join(f"{k},7,90\n" for k in range(9)))
        np.testing.assert_allclose(trial["n"], 1.5)

    def test_a_last_heading_without_cells(self, read):
        """As LabVIEW writes it."""
        trial = read("time,u,Comment\n0,1\n1,2\n2,3\n")
        np.testing.assert_array_equal(trial["u"], [1.0, 2.0, 3.0])
        with refused(TrialError, "3", "2"):
            read("time,u,psi\n0,1\n1,2\n2,3\n")

    @pytest.mark.parametrize("place", [(53.4999, 8.0999), (-0.8, 104.1), (1.2, -0.01)])
    @pytest.mark.parametrize("letters", [True, False])
    def test_positions_as_degrees_and_minutes_in_one_number(self, run, read, tmp_path, place, letters):
        """5329.9940 for 53 degrees and 29.9940 minutes, with the letter of the hemisphere or a sign."""
        x, y = (run[name].values - run[name].values[0] for name in ("x", "y"))
        lines = ["time,u,Latitude [deg],Longitude [deg]"]
        angles = zip(place[0] + x / 111e3, place[1] + y / 111e3 / np.cos(np.deg2rad(place[0])), strict=True)
        for time, pair in zip(run["time"].values, angles, strict=True):
            cells = []
            for angle, sides in zip(pair, ("NS", "EW"), strict=True):
                number = f"{100 * int(abs(angle)) + 60.0 * (abs(angle) % 1.0):010.5f}"
                cells.append(number + sides[int(angle < 0)] if letters else "-" * int(angle < 0) + number)
            lines.append(",".join([repr(float(time)), "5.5", *cells]))
        trial = read("\n".join(lines))
        np.testing.assert_allclose(trial["x"], x, rtol=0.01, atol=0.1)
        np.testing.assert_allclose(trial["y"], y, rtol=0.01, atol=0.1)
        assert "Latitude [deg] and Longitude [deg]: degrees and minutes in one" in trial.attrs["reading"]
        assert read_file(tmp_path / "run.csv").columns["latitude"].choice()["code"] == "ddmm"

    def test_quoted_cells(self, read):
        trial = read('"time","u [m/s]"\n"0","1.5"\n"1","2.5"\n')
        assert trial["u"].values.tolist() == [1.5, 2.5]

    def test_empty_columns_and_rows_at_the_end(self, run, read):
        lines = written(columns(run)).splitlines()
        trial = read("\n".join([line + ",," for line in lines] + ["," * 11] * 3) + "\n\n\n")
        assert_same(trial, run)
        assert trial.attrs["reading"] == "3 empty rows left out."

    def test_a_last_line_that_breaks_off(self, run, read):
        text = written(columns(run))
        trial = read(text[: text.rstrip().rindex(",") - 30])
        assert trial.sizes["time"] == run.sizes["time"] - 1
        assert trial.attrs["reading"].startswith(
            f"Line {run.sizes['time'] + 1}, the last, left out: it breaks off after"
        )

    def test_text_in_a_column_that_is_not_read_does_no_harm(self, read):
        trial = read("time,remark,u\n0,start,1\n1,,2\n")
        assert trial["u"].values.tolist() == [1.0, 2.0]
        assert trial.attrs["reading"] == "Columns left out: remark."


class TestMissingCells:
    @pytest.mark.parametrize(
        "missing", ["", "nan", "NaN", "-", "N/A", "inf", "null", "1e300", "---", "#DIV/0!", "#VALUE!"]
    )
    def test_a_short_run_is_filled(self, run, read, missing):
        lines = written(columns(run, ("time", "u"))).splitlines()
        for i in range(101, 106):
            lines[i] = lines[i].split(",")[0] + "," + missing
        trial = read("\n".join(lines))
        assert trial.attrs["reading"] == f"u: 5 of {run.sizes['time']} cells missing, filled by interpolation."
        np.testing.assert_allclose(trial["u"], run["u"], atol=2e-4)
        present = np.r_[0:100, 105 : run.sizes["time"]]
        np.testing.assert_array_equal(trial["u"].values[present], run["u"].values[present])

    def test_a_stand_in_of_the_rudder_hides_no_side(self, run, read):
        table = {"time": run["time"].values, "psi": run["psi"].values, "r": run["r"].values}
        table |= {"delta [deg]": -np.rad2deg(run["delta"].values)}
        lines = written(table).splitlines()
        lines[50::60] = [line[: line.rindex(",")] + ",9999" for line in lines[50::60]]
        trial = read("\n".join(lines))
        assert np.abs(trial["delta"] - run["delta"]).max() < np.deg2rad(2.0)
        assert "9999 in 6 cells of 'delta [deg]' taken as not available: far" in trial.attrs["reading"]

    def test_at_a_long_run_the_record_is_cut(self, run, read):
        table = columns(run)
        table["v"][100:130] = np.nan
        trial = read(written(table))
        notes = trial.attrs["reading"].splitlines()
        assert notes[0] == "v: 30 cells missing in longer runs or at an end, their rows left out."
        assert notes[1].startswith(
            "1 gap of more than 2 s, the longest from 9.9 to 13 s: the longest piece is used, 270 of"
        )
        assert_same(trial, run.isel(time=slice(130, None)))

    def test_at_the_ends_rows_are_left_out(self, run, read):
        table = columns(run)
        table["psi"][:3], table["r"][-2:] = np.nan, np.nan
        trial = read(written(table))
        assert_same(trial, run.isel(time=slice(3, -2)))
        assert len(trial.attrs["reading"].splitlines()) == 2

    def test_a_channel_that_misses_most_is_left_out(self, run, read):
        table = columns(run)
        table["p"][50:] = np.nan
        trial = read(written(table))
        assert "p" not in trial
        assert (
            trial.attrs["reading"] == f"p left out: {run.sizes['time'] - 50} of {run.sizes['time']} cells are missing."
        )
        assert_same(trial, run, [name for name in NAMES if name != "p"])

    def test_the_propeller_does_not_cut_the_record(self, run, read):
        table = columns(run, (*NAMES, "n"))
        table["n"][100:130] = np.nan
        trial = read(written(table))
        assert "n" not in trial
        assert_same(trial, run)

    def test_a_channel_at_a_tenth_of_the_rate_is_filled(self, run, read):
        table = columns(run)
        coarse = np.arange(run.sizes["time"]) % 10 > 0
        table["x"][coarse] = np.nan
        trial = read(written(table))
        np.testing.assert_allclose(trial["x"], run["x"][:391], atol=5e-3)
        assert trial.attrs["reading"] == "x interpolated to the stamps of u; x every 1 s."


class TestHeading:
    def test_jumps_of_a_full_turn_are_taken_out(self, run, read):
        table = columns(run)
        table["psi"] = np.rad2deg(table["psi"]) % 360.0
        header = [name if name != "psi" else "psi [deg]" for name in NAMES]
        trial = read(written(table, header=header))
        assert (np.abs(np.diff(table["psi"])) > 180.0).sum() == 1
        turns = (trial["psi"] - run["psi"]) / (2.0 * np.pi)
        np.testing.assert_allclose(turns, np.round(turns.values[0]), atol=1e-12)
        assert "psi made continuous over 1 jump of 360 deg." in trial.attrs["reading"]

    def test_a_heading_that_runs_through_stays(self, read):
        """Two turns without a jump, and a jump that a heading within one turn cannot make."""
        psi = np.append(np.linspace(0.0, 12.0, 50), 5.0)
        trial = read(written({"time": np.arange(51.0), "psi": psi}))
        np.testing.assert_array_equal(trial["psi"], psi)
        assert trial.attrs["reading"] == ""


def test_angles_too_large_for_rad_are_remarked_on(run, read):
    table = columns(run)
    assert "reaches" not in read(written(table)).attrs["reading"]
    table["delta"] = np.rad2deg(table["delta"])
    assert (
        "delta reaches 20 rad; if it is in deg, call the column 'delta [deg]'." in read(written(table)).attrs["reading"]
    )


def test_a_record_and_its_reading_go_to_netcdf_and_back(run, tmp_path, read):
    trial = read(written(columns(run)) + "1.5")
    trial.to_netcdf(tmp_path / "run.nc")
    with xr.open_dataset(tmp_path / "run.nc") as back:
        assert back.identical(trial)


def fuzz(base, path, seeds):
    """Read mutated files; count those that are read as they are, mended and refused."""
    counts = {"as it is": 0, "mended": 0, "refused": 0}
    for seed in seeds:
        path.write_bytes(mutated(base, np.random.default_rng(seed)))
        try:
            trial = ps.read_trial(path)
        except ps.TrialError as error:
            sentence = str(error)
            assert str(path) in sentence
            assert sentence.isprintable(), seed
            assert sentence.endswith("."), seed
            counts["refused"] += 1
            continue
        check_trial(trial, trial.data_vars)
        assert len(trial.data_vars) > 0, seed
        assert trial.sizes["time"] > 1, seed
        assert all(line.endswith(".") for line in trial.attrs["reading"].splitlines()), seed
        counts["mended" if trial.attrs["reading"] else "as it is"] += 1
    return counts


def test_mutated_files_are_read_or_refused_in_a_sentence(run, tmp_path):
    base = written(columns(run.isel(time=slice(120))))
    counts = fuzz(base, tmp_path / "run.csv", range(300))
    assert min(counts.values()) > 20, counts


class TestLongRecords:
    @pytest.mark.parametrize(("ending", "write", "most"), [("csv", "to_csv", 90), ("parquet", "to_parquet", 60)])
    def test_the_peak_memory_of_a_cell_that_is_a_number_is_bounded(self, tmp_path, monkeypatch, ending, write, most):
        rows = 30_000
        angles = np.sin(0.02 * np.arange(rows)[:, None] - np.arange(7))
        table = pd.DataFrame(angles.round(5), columns=["u", "v", "r", "psi", "phi", "x", "y"])
        table.insert(0, "time", np.arange(rows) / 8.0)
        getattr(table, write)(tmp_path / f"run.{ending}", index=False)
        monkeypatch.setattr(text, "MOST_BYTES", 2**22)  # a buffer of this size, most of it never touched
        tracemalloc.start()
        ps.read_trial(tmp_path / f"run.{ending}")
        peak = tracemalloc.get_traced_memory()[1]
        tracemalloc.stop()
        assert peak < most * table.size

    @pytest.mark.parametrize("delimiter", [",", " "])
    def test_columns_read_as_text_give_the_same_record(self, run, read, monkeypatch, delimiter):
        text = written(columns(run), delimiter)
        numbers = read(text)
        monkeypatch.setattr(text_rows, "number_columns", lambda blocks, columns: {})
        xr.testing.assert_identical(read(text), numbers)
