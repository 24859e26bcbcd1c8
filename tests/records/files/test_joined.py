"""A run whose sensors have a file each, joined on one base of time."""

from __future__ import annotations

import numpy as np
import pytest

import pymc_ship as ps
from pymc_ship.cli.main import main
from pymc_ship.machine.errors import TrialError
from tests.sentences import refused

UNITS = {"psi": "deg", "r": "deg/s", "delta": "deg"}
SENSORS = {"gps": (("u", "v", "x", "y"), 4, 0.0), "gyro": (("psi", "r"), 1, 0.0), "rudder": (("delta",), 2, 0.05)}
"""Channels, samples of 0.25 s a row, and how much later [s] the clock of each is read."""


@pytest.fixture(scope="module")
def run():
    """A 20/20 zigzag, sampled finely."""
    vessel = ps.load_vessel("kvlcc2")
    return ps.simulate(vessel, ps.zigzag(20, 20), duration=600.0, step=0.05, method="rk4")


def seconds(time):
    return [f"{value:.2f}" for value in time]


def stamps(time):
    return [str(np.datetime64("2026-03-01T23:57:00") + np.timedelta64(round(1e3 * value), "ms")) for value in time]


def write(folder, run, clock=seconds, heading="time [s]", delays=None):
    """A CSV file of each sensor, with stamps of its own, and values that are old by a delay [s]."""
    folder.mkdir()
    for sensor, (names, stride, late) in SENSORS.items():
        time = np.arange(late, 599.0, 0.25 * stride)
        rows = [",".join([heading, *(f"{name} [{UNITS.get(name, run[name].attrs['units'])}]" for name in names)])]
        at = run.interp(time=np.maximum(time - (delays or {}).get(sensor, 0.0), 0.0))
        columns = [np.rad2deg(at[name].values) if name in UNITS else at[name].values for name in names]
        for stamp, *cells in zip(clock(time), *columns, strict=True):
            rows.append(",".join([stamp, *(f"{cell:.6f}" for cell in cells)]))
        (folder / f"{sensor}.csv").write_text("\n".join(rows), "utf-8")
    return folder


@pytest.mark.parametrize(("clock", "heading"), [(seconds, "time [s]"), (stamps, "timestamp")])
def test_channels_of_all_files_are_on_the_base_of_the_fastest(tmp_path, run, clock, heading):
    trial = ps.read_trial(write(tmp_path / "run", run, clock, heading))
    assert float(np.diff(trial["time"]).mean()) == pytest.approx(0.25, rel=1e-6)
    exact = run.interp(time=trial["time"].values)
    for name, bound in {"u": 2e-3, "v": 2e-3, "x": 0.05, "y": 0.05, "psi": 1e-4, "r": 1e-5, "delta": 0.03}.items():
        assert np.abs(trial[name] - exact[name]).max() < bound, name
    assert "gyro.csv: 2396 rows." in trial.attrs["reading"]


def times_of_day(time):
    return [stamp[11:] for stamp in stamps(time)]


def compact_times(time):
    return [stamp.replace(":", "") for stamp in times_of_day(time)]


@pytest.mark.parametrize("clock", [times_of_day, compact_times])
@pytest.mark.parametrize("cut", [0, 250])
def test_clocks_of_several_files_start_again_at_midnight(tmp_path, run, clock, cut):
    """Also that of a file which begins after midnight, 180 s after the first row of the others."""
    folder, dated = write(tmp_path / "run", run, clock, "time"), write(tmp_path / "dated", run, stamps, "time")
    for one in (folder, dated):
        lines = (one / "gyro.csv").read_text("utf-8").splitlines()
        (one / "gyro.csv").write_text("\n".join([lines[0], *lines[1 + 4 * cut :]]), "utf-8")
    trial, exact = ps.read_trial(folder), ps.read_trial(dated)
    np.testing.assert_allclose(np.diff(trial["time"]), np.diff(exact["time"]), atol=1e-6)
    for name in ("u", "psi", "delta"):
        np.testing.assert_allclose(trial[name], exact[name], atol=1e-6, err_msg=name)
    assert "time: the clock starts again 1 time, as at midnight; 86400 s added each time." in trial.attrs["reading"]


def test_a_coarse_clock_of_one_file_is_not_read(tmp_path, run):
    folder = write(tmp_path / "run", run)
    exact = ps.read_trial(folder)
    lines = (folder / "gyro.csv").read_text("utf-8").splitlines()
    (folder / "gyro.csv").write_text("\n".join([f"time,{lines[0]}", *(f"08:00,{line}" for line in lines[1:])]), "utf-8")
    np.testing.assert_array_equal(ps.read_trial(folder)["psi"], exact["psi"])


def test_a_heading_of_two_files_has_the_name_of_the_second(tmp_path, run):
    folder = write(tmp_path / "run", run)
    text = (folder / "gyro.csv").read_text("utf-8")
    (folder / "gyro2.csv").write_text(text, "utf-8")
    assert "Columns left out: gyro2.psi [deg], gyro2.r [deg/s]" in ps.read_trial(folder).attrs["reading"]
    stated = {"columns": {"psi": {"column": "gyro2.psi [deg]"}}}
    assert "psi from 'gyro2.psi [deg]'" in ps.read_trial(folder, format=stated).attrs["reading"]


@pytest.mark.parametrize("late", [0.0, 0.2])
def test_speed_and_course_of_two_files_make_velocities(tmp_path, run, late):
    folder = tmp_path / "run"
    folder.mkdir()
    flow = (run["u"].values + 1j * run["v"].values) * np.exp(1j * run["psi"].values)
    table = {"SOG [m/s]": np.abs(flow), "COG [deg]": np.rad2deg(np.angle(flow)) % 360.0}
    table |= {"HDT [deg]": np.rad2deg(run["psi"].values), "RSA [deg]": -np.rad2deg(run["delta"].values)}
    for k, (heading, values) in enumerate(table.items()):
        rows = [f"{time:.2f},{value:.9f}" for time, value in zip(run["time"].values, values, strict=True)]
        rows = rows[round(20 * late) * k :: 20]
        (folder / f"{k}.csv").write_text("\n".join([f"time [s],{heading}", *rows]), "utf-8")
    trial = ps.read_trial(folder)
    exact = run.interp(time=trial["time"].values)
    for name, bound in {"u": 0.02, "v": 0.02, "psi": 1e-3}.items():
        np.testing.assert_allclose(trial[name], exact[name], atol=bound, err_msg=name)
    assert trial.attrs["speeds"] == "over ground"


def test_clocks_of_two_units_are_an_error(tmp_path, run):
    folder = write(tmp_path / "run", run)
    text = (folder / "gyro.csv").read_text("utf-8")
    (folder / "gyro.csv").write_text(text.replace("time [s]", "time [ms]"), "utf-8")
    with refused(TrialError, "ms", "gyro.csv"):
        ps.read_trial(folder)


def test_a_file_whose_time_goes_back_is_named(tmp_path, run):
    folder = write(tmp_path / "run", run)
    lines = (folder / "gps.csv").read_text("utf-8").splitlines()
    lines[100:140] = lines[60:100]
    (folder / "gps.csv").write_text("\n".join(lines), "utf-8")
    with refused(TrialError, "gps.csv"):
        ps.read_trial(folder)


def test_a_file_without_a_clock_is_named(tmp_path, run):
    folder = write(tmp_path / "run", run)
    (folder / "notes.txt").write_text("a b\n1 2\n3 4\n5 6\n", "utf-8")
    with refused(TrialError, "notes.txt"):
        ps.read_trial(folder)


def test_a_folder_needs_two_files(tmp_path):
    with refused(TrialError, "0"):
        ps.read_trial(tmp_path)


def test_the_command_takes_a_folder_with_the_option_alone(tmp_path, run, capsys):
    folder = str(write(tmp_path / "run", run))
    assert main(["check", folder, "--quiet"]) == 2
    assert "--join" in capsys.readouterr().err
    assert main(["check", folder, "--join", "--quiet"]) in (0, 4)
    assert "zigzag 20/20" in capsys.readouterr().out


@pytest.mark.parametrize("delay", [1.3, -0.7])
@pytest.mark.parametrize("sensor", SENSORS)
def test_a_stated_delay_is_removed(tmp_path, run, sensor, delay):
    folder = write(tmp_path / "run", run, delays={sensor: delay})
    names = {name: f"{name} [{UNITS.get(name, run[name].attrs['units'])}]" for name in SENSORS[sensor][0]}
    stated = {"columns": {name: {"column": heading, "delay": delay} for name, heading in names.items()}}
    late, trial = ps.read_trial(folder), ps.read_trial(folder, format=stated)
    for record, bound in ((late, np.inf), (trial, 1.0)):
        errors = [np.abs(record[name] - run[name].interp(time=record["time"].values))[40:-40].mean() for name in names]
        sizes = [np.abs(run[name].differentiate("time")).mean() * abs(delay) for name in names]
        ratio = float(np.max(np.array(errors) / np.array(sizes)))
        assert ratio < 0.35 * bound, record.attrs["reading"]
        assert bound < np.inf or ratio > 0.5
    assert f"the delay of {delay:g} s removed" in trial.attrs["reading"]


def test_the_time_has_no_delay(tmp_path, run):
    folder = write(tmp_path / "run", run)
    with refused(TrialError, "delay"):
        ps.read_trial(folder, format={"columns": {"time": {"column": "time [s]", "delay": 1.0}}})


def test_clocks_that_do_not_overlap_are_refused(tmp_path, run):
    """A file of another time zone."""
    folder = write(tmp_path / "run", run, stamps, "timestamp")
    text = (folder / "rudder.csv").read_text("utf-8")
    (folder / "rudder.csv").write_text(text.replace("T23:", "T21:").replace("-02T00:", "-01T22:"), "utf-8")
    with refused(TrialError, "rudder.csv", "gps.csv"):
        ps.read_trial(folder)
