from __future__ import annotations

import numpy as np
import pytest

import pymc_ship as ps
from pymc_ship.machine.errors import TrialError
from pymc_ship.records.files.format import TrialFormat, load_format
from tests.records.files.cases import NAMES, columns, written
from tests.sentences import refused


@pytest.fixture
def read(tmp_path):
    """Function that reads a table of columns by a format."""

    def read(table, format=None, **settings):
        (tmp_path / "run.csv").write_text(written(table, **settings))
        return ps.read_trial(tmp_path / "run.csv", format=format)

    return read


def assert_close(trial, run, names=NAMES):
    for name in names:
        np.testing.assert_allclose(trial[name], run[name], rtol=1e-12, atol=1e-13, err_msg=name)


class TestColumns:
    def test_units_signs_and_offsets(self, run, read):
        table = columns(run)
        table["RUD 1"] = -np.rad2deg(table.pop("delta")) + 1.2
        table["speed"] = table.pop("u") * 3600.0 / 1852.0
        choice = {
            "delta": {"column": "RUD 1", "unit": "deg", "sign": -1, "offset": 1.2},
            "u": {"column": "speed", "unit": "kn"},
        }
        trial = read(table, {"columns": choice})
        assert_close(trial, run)
        assert (
            trial.attrs["reading"].splitlines()[0] == "Columns read: u from 'speed' in kn, delta from 'RUD 1' in deg."
        )

    def test_a_unit_stands_in_the_heading_or_in_the_format(self, run, read):
        table = columns(run)
        table["gyro [deg]"] = np.rad2deg(table.pop("psi"))
        assert_close(read(table, {"columns": {"psi": "gyro [deg]"}}), run)
        table["gyro"] = table.pop("gyro [deg]")
        assert_close(read(table, {"columns": {"psi": {"column": "gyro", "unit": "deg"}}}), run)

    def test_a_column_of_another_name_replaces_the_channel_of_that_name(self, run, read):
        table = columns(run) | {"v filtered": run["v"].values + 1.0}
        trial = read(table, {"columns": {"v": "v filtered"}})
        np.testing.assert_array_equal(trial["v"], run["v"] + 1.0)
        assert "Columns left out: v." in trial.attrs["reading"]


class TestFrame:
    def test_earth_fixed_velocities(self, run, read):
        table, psi = columns(run), run["psi"].values
        u, v = table["u"], table["v"]
        table |= {"u": u * np.cos(psi) - v * np.sin(psi), "v": u * np.sin(psi) + v * np.cos(psi)}
        assert_close(read(table, {"frame": {"velocities": "earth"}}), run)
        assert np.abs(read(table)["v"] - run["v"]).max() > 1.0

    @pytest.mark.parametrize(("reference", "x_ref"), [(-11.2, -11.2), ("midship", 0.0), ("origin", 0.0)])
    def test_the_point_of_the_velocities(self, run, read, reference, x_ref):
        table = columns(run)
        table["v"] = table["v"] + x_ref * table["r"]
        assert_close(read(table, {"frame": {"reference": reference}}), run)

    def test_the_antenna_of_a_track(self, run, read):
        """The log stands at the origin, the antenna does not."""
        table, psi = columns(run), run["psi"].values
        table |= {"x": table["x"] + 40.0 * np.cos(psi), "y": table["y"] + 40.0 * np.sin(psi)}
        assert_close(read(table, {"frame": {"antenna": 40}}), run)
        assert np.abs(read(table)["x"] - run["x"]).max() > 20.0

    def test_earth_fixed_velocities_of_another_point(self, run, read):
        table, psi = columns(run), run["psi"].values
        u, v = table["u"], table["v"] + 30.0 * table["r"]
        table |= {"u": u * np.cos(psi) - v * np.sin(psi), "v": u * np.sin(psi) + v * np.cos(psi)}
        trial = read(table, {"frame": {"velocities": "earth", "reference": 30}})
        assert_close(trial, run)
        assert trial.attrs["reading"].splitlines() == [
            "u, v turned from earth-fixed axes into the ship's by psi.",
            "v moved to the origin from a point 30 m forward of it.",
        ]

    def test_a_relative_wind_becomes_the_true_one(self, run, read):
        """A wind of 7 m/s from 60 deg, as an anemometer on board reads it."""
        u, v, psi = (run[name].values for name in ("u", "v", "psi"))
        flow = -7.0 * np.exp(1j * np.deg2rad(60.0)) * np.exp(-1j * psi) - (u + 1j * v)
        table = columns(run) | {"vane": np.rad2deg(np.angle(-flow)), "wind_speed": np.abs(flow)}
        wanted = {"wind_direction": {"column": "vane", "unit": "deg"}, "wind_speed": "wind_speed"}
        trial = read(table, {"columns": wanted, "frame": {"wind": "relative"}})
        np.testing.assert_allclose(trial["wind_speed"], 7.0, rtol=1e-6)
        np.testing.assert_allclose(trial["wind_direction"], np.deg2rad(60.0), rtol=1e-6)
        assert "True wind calculated from relative wind, u, v and psi." in trial.attrs["reading"]

    def test_senses_of_heading_and_rudder(self, run, read):
        table = columns(run)
        table |= {"psi": -table["psi"], "delta": -table["delta"]}
        trial = read(table, {"frame": {"heading": "counterclockwise", "rudder_positive": "starboard"}})
        assert_close(trial, run)
        assert len(trial.attrs["reading"].splitlines()) == 2
        same = read(columns(run), {"frame": {"heading": "clockwise", "rudder_positive": "port"}})
        assert_close(same, run)
        assert same.attrs["reading"] == ""

    @pytest.mark.parametrize("settings", [{"columns": {"psi": "gyro"}}, {}])
    def test_a_compass_heading_is_in_degrees(self, run, read, settings):
        table = columns(run)
        table["gyro" if settings else "Heading"] = np.rad2deg(table.pop("psi")) % 360.0
        trial = read(table, {**settings, "frame": {"heading": "compass"}})
        turns = (trial["psi"] - run["psi"]).values / (2.0 * np.pi)
        np.testing.assert_allclose(turns, np.round(turns[0]), atol=1e-12)


def test_a_model_is_scaled_to_its_ship(run, read):
    """Lengths by lambda, speeds and times by its root, forces by its cube: ratios of the prime system stay."""
    scale = 45.714
    table = columns(run, (*NAMES, "n")) | {
        "thrust": np.full(run.sizes["time"], 2.0),
        "torque": np.full(run.sizes["time"], 3.0),
    }
    for name, power in {"time": 0.5, "u": 0.5, "v": 0.5, "r": -0.5, "p": -0.5, "x": 1.0, "y": 1.0, "n": -0.5}.items():
        table[name] = table[name] / scale**power
    trial = read(table, {"scale": {"froude": scale}})
    assert_close(trial, run, (*NAMES, "n"))
    np.testing.assert_allclose(trial["thrust"], 2.0 * scale**3)
    np.testing.assert_allclose(trial["torque"], 3.0 * scale**4)
    assert "lengths x 45.714, speeds and times x 6.761." in trial.attrs["reading"]


def test_delimiter_and_lines_before_the_header(run, tmp_path):
    path = tmp_path / "run.txt"
    path.write_text(
        "Basin; run 7\nL, B, T\n" + written(columns(run), " ", cell=lambda value: repr(value).replace(".", ","))
    )
    assert_close(ps.read_trial(path, format={"delimiter": " ", "skip_rows": 2}), run)
    with refused(ps.TrialError, "run.txt", 2, 1):
        ps.read_trial(path)


@pytest.mark.parametrize("titles", ["Basin; run 7\nwind;2 Bft", "Basin 4\n\nlogger;7;1 Hz"])
def test_titles_before_the_header_need_no_format(run, tmp_path, titles):
    path = tmp_path / "run.csv"
    path.write_text(f"{titles}\n{written(columns(run), ';')}")
    trial = ps.read_trial(path)
    assert_close(trial, run)
    assert trial.attrs["reading"].splitlines()[0] == "2 lines before the header left out."


PADDED = "M/T Example, zigzag 20/20;;;;;;;;;\nWind 2 Bft;;;;;;;;;\n;;;;;;;;;"


@pytest.mark.parametrize("titles", ["Basin; run 7\nwind;2 Bft", PADDED, "\n".join(f"note {k}" for k in range(60))])
@pytest.mark.parametrize("end", ["", "1.5;2.5", "End of file; 400 rows", "sum;of;squares;0"])
def test_titles_before_the_header_with_an_odd_last_line(run, tmp_path, titles, end):
    path = tmp_path / "run.csv"
    path.write_text(f"{titles}\n{written(columns(run), ';')}{end}")
    trial = ps.read_trial(path)
    np.testing.assert_array_equal(trial["u"], run["u"])
    assert f"{titles.count(chr(10)) + 1} lines before the header left out." in trial.attrs["reading"]
    assert ("breaks off" in trial.attrs["reading"]) is bool(end)


@pytest.mark.parametrize("quote", ["", 'note "5\n'])
def test_headings_with_line_breaks_and_other_spaces(run, tmp_path, quote):
    names = ["time [s]", "u [m/s]", "v\n[m/s]", "yaw\nrate\n[rad/s]", "p\u00a0[rad/s]", "roll angle [rad]"]
    names += ["Heading\u202f[rad]", "x [m]", "y [m]", "Rudder\nangle [rad]"]
    header = [f'"{name}"' if "\n" in name else name for name in names]
    path = tmp_path / "run.csv"
    path.write_text(quote + written(columns(run), ";", header))
    trial = ps.read_trial(path)
    for name in ("v", "r", "p", "psi", "delta"):
        np.testing.assert_array_equal(trial[name], run[name], err_msg=name)
    assert "r from 'yaw rate [rad/s]' in rad/s, p from 'p [rad/s]'" in trial.attrs["reading"]


def test_a_short_header_is_no_title(run, tmp_path):
    path = tmp_path / "run.csv"
    path.write_text(written(columns(run), header=list(NAMES[:-2])))
    with refused(ps.TrialError, "run.csv", 8, 10):
        ps.read_trial(path)


def test_a_row_with_a_date_is_no_header(run, tmp_path):
    path = tmp_path / "run.csv"
    rows = "\n".join(f"2020-01-01T08:00:{second:02d},1,2,3" for second in range(20))
    path.write_text(f"time,u,v\n{rows}\n")
    with refused(ps.TrialError, "run.csv", 3, 4):
        ps.read_trial(path)


def test_a_file_and_its_table_are_the_same(tmp_path):
    path = tmp_path / "format.toml"
    path.write_text(
        'delimiter = ";"\nskip_rows = 3\n[columns]\nu = "xdot"\npsi = { column = "Heading", unit = "deg", sign = -1 }\n'
        '[frame]\nvelocities = "earth"\nreference = -2\n[scale]\nfroude = 25\n'
    )
    table = {
        "delimiter": ";",
        "skip_rows": 3,
        "columns": {"u": "xdot", "psi": {"column": "Heading", "unit": "deg", "sign": -1}},
        "frame": {"velocities": "earth", "reference": -2},
        "scale": {"froude": 25},
    }
    assert load_format(path) == load_format(str(path)) == load_format(table)
    assert load_format(None) == load_format({}) == TrialFormat()


LATITUDE, LONGITUDE = 53.5, 8.1  # deg
RADIUS = 6.378137e6  # m, WGS 84
FLATTENING = 1.0 / 298.257223563


def fixes(x, y):
    """Latitude and longitude [deg] by the radii of curvature of the ellipsoid, to first order."""
    e2, sine = FLATTENING * (2.0 - FLATTENING), np.sin(np.deg2rad(LATITUDE))
    across = RADIUS / np.sqrt(1.0 - e2 * sine**2)
    along = across * (1.0 - e2) / (1.0 - e2 * sine**2)
    longitude = LONGITUDE + np.rad2deg(y / (across * np.cos(np.deg2rad(LATITUDE))))
    return LATITUDE + np.rad2deg(x / along), longitude


def received(run):
    """Table of a gyro, a rudder indicator and a satellite receiver."""
    u, v, psi = (run[name].values for name in ("u", "v", "psi"))
    flow = (u + 1j * v) * np.exp(1j * psi)
    latitude, longitude = fixes(run["x"].values - run["x"].values[0], run["y"].values - run["y"].values[0])
    return {
        "time": run["time"].values,
        "SOG [kn]": np.abs(flow) * 3600.0 / 1852.0,
        "COG [deg]": np.rad2deg(np.angle(flow)) % 360.0,
        "HDT [deg]": np.rad2deg(psi) % 360.0,
        "RSA [deg]": -np.rad2deg(run["delta"].values),
        "Latitude [deg]": latitude,
        "lon [degrees_east]": longitude,
    }


def test_a_receiver_gives_velocities_and_track(run, read):
    trial = read(received(run))
    for name in ("u", "v", "psi", "delta"):
        np.testing.assert_allclose(trial[name], run[name], atol=1e-9, err_msg=name)
    for name in ("x", "y"):
        np.testing.assert_allclose(trial[name], run[name] - run[name][0], atol=0.05, err_msg=name)
    assert trial.attrs["speeds"] == "over ground"
    assert (
        "x, y from latitude and longitude, origin 53.500000, 8.100000 deg; flat to 0.001 m." in trial.attrs["reading"]
    )


@pytest.mark.parametrize("positions", ["degrees", "metres"])
@pytest.mark.parametrize("arm", [-140.0, 30.0])
def test_the_place_of_an_antenna_moves_velocities_and_track(run, read, arm, positions):
    psi, r = run["psi"].values, run["r"].values
    antenna = run.assign(v=run["v"] + arm * r, x=run["x"] + arm * np.cos(psi), y=run["y"] + arm * np.sin(psi))
    table = received(antenna) | {"r [rad/s]": r}
    if positions == "metres":
        table = {name: cells for name, cells in table.items() if not name.startswith(("Lat", "lon"))}
        table |= {"x [m]": antenna["x"].values, "y [m]": antenna["y"].values}
    trial = read(table, {"frame": {"reference": arm}})
    for name in ("u", "v"):
        np.testing.assert_allclose(trial[name], run[name], atol=1e-9, err_msg=name)
    for name in ("x", "y"):
        away = (trial[name] - run[name]).values
        np.testing.assert_allclose(away, away[0], atol=0.05, err_msg=name)
    notes = trial.attrs["reading"].splitlines()
    for names in ("v", "x, y"):
        assert f"{names} moved to the origin from a point {arm:g} m forward of it." in notes


def test_an_antenna_without_a_place_is_said(run, read):
    words = "u, v and the track are those of the antenna; state its place, [frame] reference, m forward of the origin."
    table = received(run) | {"r [rad/s]": run["r"].values}
    assert words in read(table).attrs["reading"].splitlines()
    assert "antenna" not in read(table | {"STW [m/s]": run["u"].values}).attrs["reading"]
    assert "antenna" not in read(columns(run)).attrs["reading"]


def on_rows_of_their_own(table, late=0.01):
    """Table with a row for each cell, one sensor a row, each ``late`` [s] after the one before."""
    names = [name for name in table if name != "time"]
    rows = {"time": np.add.outer(table["time"], late * np.arange(len(names))).ravel()}
    for k, name in enumerate(names):
        rows[name] = np.full(rows["time"].size, np.nan)
        rows[name][k :: len(names)] = table[name]
    return rows


def test_channels_of_a_receiver_on_rows_of_their_own(run, read):
    """Else no row had both speed and course, or latitude and longitude."""
    trial = read(on_rows_of_their_own(received(run)))
    exact = run.interp(time=trial["time"].values - 0.01)
    for name, bound in {"u": 0.02, "v": 0.02, "psi": 1e-3}.items():
        np.testing.assert_allclose(trial[name], exact[name], atol=bound, err_msg=name)
    for name in ("x", "y"):
        away = trial[name].values - exact[name].values
        np.testing.assert_allclose(away, away[0], atol=0.3, err_msg=name)
    for pair, base in (("sog, cog", "sog"), ("latitude, longitude", "latitude")):
        words = f"{pair} of rows of their own: interpolated to the stamps of {base}."
        assert words in trial.attrs["reading"].splitlines()


def test_a_receiver_that_is_not_read_is_not_interpolated(run, read):
    table = received(run) | {"u [m/s]": run["u"].values, "x [m]": run["x"].values, "y [m]": run["y"].values}
    assert "rows of their own" not in read(on_rows_of_their_own(table, 0.005)).attrs["reading"]


def test_a_set_course_on_rows_of_its_own_is_refused(run, read):
    with refused(TrialError, "COG"):
        read(on_rows_of_their_own(received(run) | {"COG [deg]": np.zeros(run["time"].size)}))


@pytest.mark.parametrize("orders", [[0.0], [0.0, 45.0, 20.0]])
def test_a_course_that_keeps_its_value_in_a_turn_is_a_set_one(run, read, orders):
    table = received(run)
    table["Course [deg]"] = np.repeat(orders, -(-run["time"].size // len(orders)))[: run["time"].size]
    del table["COG [deg]"]
    with refused(TrialError, "Course", "course_set"):
        read(table)


def test_a_plain_course_is_taken_as_one_over_ground_and_said(run, read):
    table = {name.replace("COG", "Course"): cells for name, cells in received(run).items()}
    trial = read(table)
    np.testing.assert_allclose(trial["v"], run["v"], atol=1e-9)
    words = "'Course [deg]' taken as course over ground; rename the column if it is a set one."
    assert words in trial.attrs["reading"].splitlines()
    assert "a set one" not in read(received(run)).attrs["reading"]


def test_a_log_precedes_the_receiver(run, read):
    trial = read(received(run) | {"STW [m/s]": run["u"].values})
    np.testing.assert_array_equal(trial["u"], run["u"])
    assert "speeds" not in trial.attrs


def test_stand_ins_of_a_receiver_are_missing_cells(run, read):
    """Else u, v and the track were those of 102.3 kn to the north, from a point beyond the pole."""
    table, clean = received(run), read(received(run))
    wrong = {"SOG [kn]": 102.3, "COG [deg]": 360.0, "HDT [deg]": 511.0, "Latitude [deg]": 91.0}
    wrong["lon [degrees_east]"] = 181.0
    at = 100 + int(np.argmin(np.cos(np.deg2rad(table["COG [deg]"][100:300]))))
    for name, number in wrong.items():
        table[name][at] = number
    trial = read(table)
    for name in ("u", "v", "psi", "x", "y"):
        np.testing.assert_allclose(trial[name], clean[name], atol=0.05, err_msg=name)
    for name, number in wrong.items():
        words = f"{number:g} in 1 cell of {name!r} taken as not available: far from the values beside."
        assert words in trial.attrs["reading"].splitlines()


@pytest.mark.parametrize(("latitude", "words"), [(5000.0, "90"), (60.0, "100")])
def test_positions_of_no_trial_are_refused(run, read, latitude, words):
    table = received(run)
    table["Latitude [deg]"][3] = latitude
    with refused(TrialError, float(words)):
        read(table)


def test_all_missing_units_are_named_at_once(run, read):
    table = {"time": run["time"].values, "HDT": run["psi"].values, "SOG": run["u"].values, "RSA": run["delta"].values}
    with refused(TrialError, "HDT", "SOG", "RSA"):
        read(table)


def test_a_file_without_a_header_is_named(run, read):
    table = columns(run)
    with refused(TrialError, "header"):
        read(table, header=[repr(float(values[0])) for values in table.values()])


def test_columns_of_the_esso_osaka_records_are_known(run, read):
    names = ["t [s]", "u_velo [m/s]", "vm_velo [m/s]", "r_angvelo [rad/s]", "p", "phi", "psi_hat [rad]"]
    names += ["x_position_mid [m]", "y_position_mid [m]", "delta_rudder [rad]"]
    trial = read(columns(run), header=names)
    for name in ("u", "v", "r", "psi", "x", "y", "delta"):
        np.testing.assert_array_equal(trial[name], run[name])


def test_units_stand_below_a_second_row_of_words(tmp_path):
    lines = ["time,STW,Heading", "Clock,Log,Gyro", "[s],[kn],[deg]", *(f"{k},10,{k}" for k in range(9))]
    (tmp_path / "run.csv").write_text("\n".join(lines))
    trial = ps.read_trial(tmp_path / "run.csv")
    np.testing.assert_allclose(trial["psi"], np.deg2rad(np.arange(9.0)))
    np.testing.assert_allclose(trial["u"], 10.0 * 1852.0 / 3600.0)
