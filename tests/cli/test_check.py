from __future__ import annotations

import re

import numpy as np
import pandas as pd
import pytest

import pymc_ship as ps
from pymc_ship.cli.check import column_rows
from pymc_ship.cli.main import main
from pymc_ship.records.files.format import format_text
from pymc_ship.records.files.reading import read_file
from tests.records.files.cases import columns, written
from tests.records.files.test_nmea import log

WORDS = {
    "time": ("Time [s]", 1.0),
    "u": ("STW [kn]", 3600.0 / 1852.0),
    "r": ("ROT [deg/min]", np.rad2deg(60.0)),
    "psi": ("HDT [deg]", np.rad2deg(1.0)),
    "delta": ("RSA [deg]", -np.rad2deg(1.0)),
}


@pytest.fixture(scope="module")
def logged(container):
    """Text of a 20/20 zigzag of 300 s at 2 Hz as a logger of a ship writes it, and the record."""
    run = ps.simulate(container, ps.zigzag(20.0, 20.0), duration=300.0, step=0.1, record_interval=0.5, method="rk4")
    table = {heading: factor * run[name].values for name, (heading, factor) in WORDS.items()}
    table["HDT [deg]"] %= 360.0
    return written({**table, "Temp": np.full(run.sizes["time"], 20.0)}, cell=lambda value: f"{value:.5f}"), run


@pytest.fixture
def check(tmp_path, logged, monkeypatch, capsys):
    """Function that checks a text and returns status, lines of the output and the error."""
    monkeypatch.chdir(tmp_path)

    def check(*words, text=logged[0]):
        (tmp_path / "run.csv").write_text(text)
        status = main(["check", "run.csv", "--quiet", *words])
        printed = capsys.readouterr()
        return status, printed.out.splitlines(), printed.err

    return check


def cells(line):
    return re.split(r"\s{2,}", line)


def test_the_first_minute_needs_no_option(check):
    status, lines, _ = check()
    assert status == 0
    assert lines[0] == "Columns of run.csv:"
    assert cells(lines[1]) == ["column", "channel", "unit", "channel from", "unit from"]
    assert cells(lines[2]) == ["Time [s]", "time", "s", "its name", "its name"]
    assert cells(lines[3]) == ["STW [kn]", "u", "kn", "a usual name", "its name"]
    assert cells(lines[7])[0] == "Temp"
    assert cells(lines[7])[-1] == "left out"
    assert lines[9].startswith("An identification needs, in addition: a vessel file")
    assert "The trial is recognised as a zigzag 20/20 port." in lines
    assert cells(lines[lines.index("Indices of the denoised record:") + 1])[2:] == [
        "unit",
        "IMO MSC.137(76)",
        "verdict",
    ]


STAMPS = pd.Timestamp("2024-05-01T08:00:00") + pd.to_timedelta(np.arange(600.0), unit="s")
CLOCKS = {
    "s": ("s", np.arange(600.0)),
    "min": ("min", np.arange(600.0) / 60.0),
    "spreadsheet": ("days", 45000.0 + np.arange(600.0) / 86400.0),
    "epoch": ("ms", 1.7e12 + 1e3 * np.arange(600.0)),
    "dates": ("dates and times", STAMPS.strftime("%Y-%m-%dT%H:%M:%S")),
    "day": ("hours, minutes and seconds", STAMPS.strftime("%H:%M:%S")),
    "noon": ("hours, minutes and seconds", STAMPS.strftime("%I:%M:%S %p")),
    "short": ("minutes and seconds", STAMPS.strftime("%M:%S")),
    "hhmmss": ("hhmmss", STAMPS.strftime("%H%M%S")),
    "whole": ("yyyymmddhhmmss", STAMPS.strftime("%Y%m%d%H%M%S")),
}


@pytest.mark.parametrize("clock", CLOCKS)
def test_the_table_has_the_unit_of_the_clock(tmp_path, clock):
    unit, cells = CLOCKS[clock]
    angle = 0.05 * np.arange(600.0)
    table = {"time": cells, "psi [deg]": 10.0 * np.sin(angle), "r [deg/min]": 30.0 * np.cos(angle)}
    pd.DataFrame(table).to_csv(tmp_path / "run.csv", index=False)
    reading = read_file(tmp_path / "run.csv")
    source = "no other stated" if unit == "s" else "its cells"
    assert column_rows(reading)[0] == ("time", "time", unit, "its name", source)
    assert column_rows(reading)[2][2] == "deg/min"
    (tmp_path / "format.toml").write_text(format_text(reading.layout, "check"))
    assert read_file(tmp_path / "run.csv", tmp_path / "format.toml").trial.equals(reading.trial)


def test_the_table_has_the_code_of_a_column(tmp_path):
    drift = np.arange(60.0)
    table = {"time": drift, "lat [deg]": 5300.0 + 0.01 * drift, "lon [deg]": 700.0 + 0.01 * drift}
    pd.DataFrame(table).to_csv(tmp_path / "run.csv", index=False)
    units = [row[2] for row in column_rows(read_file(tmp_path / "run.csv"))]
    assert units == ["s", "deg (ddmm)", "deg (ddmm)"]


def test_indices_stand_beside_their_limits(check, logged):
    _, lines, _ = check("--vessel", "container")
    assert "An identification needs nothing else." in lines
    rows = {cells(line)[0]: cells(line)[1:] for line in lines[lines.index("Indices of the denoised record:") + 2 :]}
    overshoot = ps.indices(logged[1])["first_overshoot_angle"]
    value, unit, limit, verdict = rows["first overshoot angle"]
    assert float(value) == pytest.approx(float(overshoot), abs=0.05)
    assert (unit, limit, verdict) == ("deg", "25 deg", "met")


def test_limits_in_ship_lengths_need_the_vessel(check, circle_trial, container):
    circle = circle_trial.isel(time=slice(None, None, 25))
    text = written({name: circle[name].values for name in ("time", "u", "v", "r", "psi", "x", "y", "delta")})
    rows = {cells(line)[0]: cells(line)[3:] for line in check(text=text)[1] if line.startswith(("adv", "tac"))}
    assert rows == {"advance": ["4.5 L", "needs --vessel"], "tactical diameter": ["5 L", "needs --vessel"]}
    (row,) = [cells(line) for line in check("--vessel", "container", text=text)[1] if line.startswith("advance")]
    limit = 4.5 * container.particulars.L
    is_met = float(ps.indices(circle)["advance"]) <= limit
    assert row[3:] == [f"4.5 L = {limit:.4g} m", "met" if is_met else "not met"]


def test_misspelt_headings_and_missing_channels_are_named(check, logged):
    _, lines, _ = check(text=logged[0].replace("HDT", "Headng"))
    assert any(cells(line)[-1] == "left out (did you mean heading?)" for line in lines)
    assert any(line.startswith("An identification needs, in addition: psi (heading ψ), a vessel") for line in lines)


def test_a_mended_finding_says_how(check, logged):
    offset = written({**columns(logged[1], [n for n in WORDS if n != "r"]), "r": logged[1]["r"].values + 1e-3})
    status, lines, _ = check(text=offset)
    assert status == 4
    (line,) = [line for line in lines if line.startswith("gyro offset")]
    assert re.search(r"deg in 5 L/U; mended: \+0\.05\d+ deg/s subtracted from r\.$", line)


def test_the_page_shows_track_heading_and_checks(check, logged, tmp_path):
    run = logged[1]
    text = written({name: run[name].values for name in ("time", "u", "v", "r", "psi", "x", "y", "delta")})
    check("--out", "check.html", text=text)
    page = (tmp_path / "check.html").read_text()
    assert all(part in page for part in ('id="track"', 'id="heading_and_rudder"', "first overshoot angle", "its name"))
    assert sorted(path.name for path in tmp_path.iterdir()) == ["check.html", "run.csv"]


def test_a_bad_trial_has_a_page_but_no_corrected_record(check, logged, tmp_path):
    text = written(columns(logged[1], WORDS)).replace('"port"', '"starboard"')
    assert check("--out", "corrected.csv", text=text)[0] == 3
    assert not (tmp_path / "corrected.csv").exists()
    assert check("--out", "check.html", text=text)[0] == 3
    assert "The trial cannot be fitted: rudder sign" in (tmp_path / "check.html").read_text()


def layouts(text, run):
    """Texts of files with the format, if any, that reads them."""
    si = written(columns(run, WORDS))
    stamped = si.replace("\n1.5,", "\n,")  # a stamp is missing
    return {
        "words": (text, None),
        "si": (si, None),
        "missing": (stamped, None),
        "commas": (text.replace(",", ";").replace(".", ","), {"delimiter": ";"}),
        "model": (si, {"scale": {"froude": 30.0}, "frame": {"reference": "midship", "rudder_positive": "port"}}),
        "ros": (si, {"frame": {"convention": "enu-flu"}}),
        "chosen": (
            text.replace("RSA [deg]", "helm"),
            {"columns": {"delta": {"column": "helm", "unit": "deg", "sign": -1, "offset": 0.25, "missing": [99, -99]}}},
        ),
        "clock": (si.replace("time,", "t,"), {"frame": {"heading": "counterclockwise"}}),
        "nmea": ("\n".join(log(run.isel(time=slice(40)), True)), None),
    }


LAYOUTS = ("words", "si", "missing", "commas", "model", "ros", "chosen", "clock", "nmea")


@pytest.mark.parametrize("name", LAYOUTS)
def test_the_written_format_reproduces_the_reading(logged, tmp_path, name):
    text, layout = layouts(*logged)[name]
    (tmp_path / "run.csv").write_text(text)
    reading = read_file(tmp_path / "run.csv", layout)
    (tmp_path / "format.toml").write_text(format_text(reading.layout, "check"))
    again = read_file(tmp_path / "run.csv", tmp_path / "format.toml")
    assert reading.trial.equals(again.trial)
    assert again.layout == reading.layout


def test_the_command_writes_the_format_once(check, tmp_path):
    assert check("--write-format", "run.toml")[0] == 0
    first = (tmp_path / "run.toml").read_text()
    assert first.startswith("# pymc-ship")
    (tmp_path / "run.toml").write_text(f"{first}# mine\n")
    status, _, error = check("--write-format", "run.toml")
    assert (status, "--force to replace it" in error) == (2, True)
    assert (tmp_path / "run.toml").read_text().endswith("# mine\n")
    assert check("--write-format", "run.toml", "--force")[0] == 0
    assert (tmp_path / "run.toml").read_text() == first


@pytest.mark.parametrize("name", ["run.csv", "other.csv", "link.csv"])
def test_nothing_is_lost_without_force(check, logged, tmp_path, name):
    (tmp_path / "other.csv").write_text("mine\n")
    (tmp_path / "link.csv").symlink_to("run.csv")
    status, _, error = check("--out", name)
    assert (status, "--force" in error) == (2, True)
    assert (tmp_path / "other.csv").read_text() == "mine\n"
    assert (tmp_path / "run.csv").read_text() == logged[0]
    assert check("--out", name, "--force")[0] == 0
    assert (tmp_path / name).read_text().startswith("# pymc-ship")


def test_the_same_command_renews_its_result(check):
    assert [check("--out", "out.csv")[0] for _ in range(2)] == [0, 0]
    assert [check("--out", "out.html")[0] for _ in range(2)] == [0, 0]
    assert check("--out", "out.csv", "--vessel", "container")[0] == 2
    assert check("--out", "out.html", "--vessel", "container")[0] == 2
