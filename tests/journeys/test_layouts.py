"""The page of layouts: each file begins as the page shows, and is read as the run that was simulated."""

from __future__ import annotations

import re

import numpy as np
import pytest

import pymc_ship as ps
from tests.journeys.markdown import Page
from tests.records.files.test_format import fixes
from tests.records.files.test_nmea import sentence

PAGE = Page("docs/how_to/my_file_looks_like_this.md")
KNOT, FROUDE = 1852.0 / 3600.0, 45.714
EXACT = {"u": 4e-3, "v": 6e-3, "r": 3e-5, "psi": 1.2e-3, "delta": 1.5e-3}
"""Resolution of the layouts."""


@pytest.fixture(scope="module")
def run():
    """A 20/20 zigzag at 2 Hz."""
    return ps.simulate(
        ps.load_vessel("kvlcc2"), ps.zigzag(20, 20), duration=600.0, step=0.1, record_interval=0.5, method="rk4"
    )


def degrees(run, name, sign=1.0):
    return sign * np.rad2deg(run[name].values)


def compass(run):
    return (degrees(run, "psi") + 45.0) % 360.0


def rows(header, columns, delimiter=",", decimals=(), comma=False):
    """Lines of a table; stamps are text."""
    lines = [header]
    for cells in zip(*columns, strict=True):
        texts = [
            cell if isinstance(cell, str) else f"{np.round(cell, count) + 0.0:.{count}f}"
            for cell, count in zip(cells, decimals, strict=True)
        ]
        lines.append(delimiter.join(text.replace(".", ",") if comma and k else text for k, text in enumerate(texts)))
    return lines


def symbols(run):
    columns = [run["time"].values, run["u"].values, run["v"].values]
    columns += [degrees(run, name) for name in ("r", "psi", "delta")]
    return {
        "run.csv": rows(
            "time [s],u [m/s],v [m/s],r [deg/s],psi [deg],delta [deg]", columns, decimals=(1, 3, 3, 3, 2, 2)
        )
    }


def words(run):
    clock = [f"31.01.2026 08:{int(t) // 60:02d}:{t % 60:04.1f}" for t in run["time"].values]
    columns = [clock, run["u"].values / KNOT, run["v"].values, 60.0 * degrees(run, "r"), compass(run)]
    columns.append(degrees(run, "delta", -1.0))
    header = "Date/Time;STW;Sway;ROT;Heading;RSA\n;kn;m/s;deg/min;deg;deg"
    table = rows(header, columns, ";", (0, 2, 3, 1, 1, 1), comma=True)
    return {"logger.csv": ["M/T Example, zigzag 20/20", *table]}


def sentences(run):
    rudder, heading, rate, lines = degrees(run, "delta", -1.0) + 0.0, compass(run), 60.0 * degrees(run, "r"), []
    for k, time in enumerate(run["time"].values):
        bodies = [
            f"AGRSA,{rudder[k]:.2f},A,,V",
            f"HEHDT,{heading[k]:.2f},T",
            f"TIROT,{rate[k]:.2f},A",
            f"VDVBW,{run['u'].values[k] / KNOT:.3f},{run['v'].values[k] / KNOT:.3f},A,,,V",
        ]
        lines += [f"2026-01-31T08:{int(time) // 60:02d}:{time % 60:04.1f}Z,{sentence(body)}" for body in bodies]
    return {"bridge.nmea": lines}


def receiver(run):
    course = np.deg2rad(45.0)
    c, s = np.cos(course), np.sin(course)
    x, y = run["x"].values, run["y"].values
    latitude, longitude = fixes(c * x - s * y, s * x + c * y)
    track = run["u"].values + 1j * run["v"].values
    columns = [[f"{1769846400000 + round(1e3 * t)}" for t in run["time"].values], latitude, longitude]
    columns += [np.abs(track) / KNOT, (np.rad2deg(np.angle(track)) + compass(run)) % 360.0, compass(run)]
    columns.append(degrees(run, "delta", -1.0))
    header = "timestamp,Latitude [deg],Longitude [deg],SOG [kn],COG [deg],HDT [deg],Rudder angle [deg]"
    return {"gps.csv": rows(header, columns, decimals=(0, 7, 7, 2, 2, 2, 1))}


def sensors(run):
    slow, late = run.isel(time=slice(None, None, 2)), run.interp(time=run["time"].values[:-1] + 0.2)
    return {
        "run7/gps.csv": rows(
            "time [s],x [m],y [m],u [m/s],v [m/s]",
            [slow[name].values for name in ("time", "x", "y", "u", "v")],
            decimals=(1, 2, 2, 3, 3),
        ),
        "run7/gyro.csv": rows(
            "time [s],psi [deg],r [deg/s]",
            [run["time"].values, degrees(run, "psi"), degrees(run, "r")],
            decimals=(1, 2, 3),
        ),
        "run7/rudder.csv": rows("time [s],delta [deg]", [late["time"].values, degrees(late, "delta")], decimals=(1, 2)),
    }


def basin(run):
    psi, root = run["psi"].values, np.sqrt(FROUDE)
    north = run["u"].values * np.cos(psi) - run["v"].values * np.sin(psi)
    east = run["u"].values * np.sin(psi) + run["v"].values * np.cos(psi)
    columns = [run["time"].values / root, run["x"].values / FROUDE, run["y"].values / FROUDE, degrees(run, "psi")]
    columns += [north / root, east / root, degrees(run, "delta")]
    return {"model.dat": rows("t X Y PSI VN VE RUD", columns, " ", (4, 4, 4, 3, 4, 4, 2))}


LAYOUTS = {
    "Symbols and units": symbols,
    "Words, titles and decimal commas": words,
    "NMEA 0183": sentences,
    "Latitude and longitude": receiver,
    "A file for each sensor": sensors,
    "A model at its own scale": basin,
}


def section(name):
    """Text of a section of the page."""
    (text,) = re.findall(rf"^## \d {name}\n(.*?)(?=^## |\Z)", PAGE.text, flags=re.MULTILINE | re.DOTALL)
    return text


def blocks(text, language):
    return re.findall(rf"^```{language}\n(.*?)^```$", text, flags=re.MULTILINE | re.DOTALL)


@pytest.mark.parametrize("name", LAYOUTS)
def test_a_file_of_the_layout_is_the_run(tmp_path, run, name):
    files = {path: "\n".join(lines) + "\n" for path, lines in LAYOUTS[name](run).items()}
    for text, shown in zip(files.values(), blocks(section(name), "text"), strict=True):
        assert text.startswith(shown.removesuffix("...\n"))
    for path, text in files.items():
        (tmp_path / path).parent.mkdir(exist_ok=True)
        (tmp_path / path).write_text(text, "utf-8")
    format_file = None
    if tables := blocks(section(name), "toml"):
        format_file = tmp_path / "format.toml"
        format_file.write_text(tables[0], "utf-8")
    first = next(iter(files))
    trial = ps.read_trial(tmp_path / (first.split("/")[0] if len(files) > 1 else first), format=format_file)
    exact = run.interp(time=trial["time"].values)
    turned = {"psi": float((trial["psi"] - exact["psi"]).median())}
    for channel, resolution in EXACT.items():
        if channel in trial:
            error = np.abs(trial[channel] - exact[channel] - turned.get(channel, 0.0))
            assert error.mean() < resolution, channel
    assert {"u", "v", "psi", "delta"} <= set(trial.data_vars)


def test_every_layout_of_the_page_is_read_here_or_with_the_formats_of_libraries():
    names = re.findall(r"^## \d (.*)$", PAGE.text, flags=re.MULTILINE)
    assert [name for name in names if name not in LAYOUTS] == ["A ROS bag", "MATLAB, Excel, NetCDF, Parquet"]
