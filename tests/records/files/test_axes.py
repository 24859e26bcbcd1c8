"""A record whose file does not show its axes may be its mirror image, which check and pages say."""

from __future__ import annotations

import numpy as np
import pytest

import pymc_ship as ps
from pymc_ship.records.files.sides import MIRROR_IMAGE, mirror_remarks
from pymc_ship.trial.record import ASSUMED, AXES
from tests.records.checks.cases import checks_by_name
from tests.records.files.cases import columns, written


@pytest.fixture(scope="module")
def motion(container):
    return columns(ps.simulate(container, ps.zigzag(20, 20), duration=300.0, record_interval=0.5))


def in_ros_axes(table):
    """x east, y north, psi counterclockwise from east, v and r to port."""
    turned = {"x": table["y"], "y": table["x"], "psi": 0.5 * np.pi - table["psi"], "v": -table["v"], "r": -table["r"]}
    return {**table, **turned}


def text(table, **headings):
    """Table without the line on the side of the rudder."""
    header = [headings.get(name, name) for name in table]
    return "\n".join(written(table, header=header).splitlines()[:-1]) + "\n"


@pytest.mark.parametrize(
    ("headings", "format", "assumed"),
    [
        ({}, None, True),
        ({"psi": "yaw [rad]"}, {"frame": {"rudder_positive": "port"}}, True),
        ({"psi": "heading [rad]"}, None, True),
        ({"x": "north [m]", "y": "east [m]"}, None, False),
        ({"psi": "HDT [rad]"}, None, False),
        ({"r": "ROT [rad/s]"}, None, False),
        ({}, {"frame": {"axes": "ned-frd"}}, False),
        ({}, {"frame": {"heading": "compass"}, "columns": {"psi": {"column": "psi", "unit": "rad"}}}, False),
    ],
)
def test_headings_and_format_show_the_axes(motion, read, container, headings, format, assumed):
    trial = read(text(motion, **headings), format=format)
    assert (trial.attrs.get(AXES) == ASSUMED) == assumed
    assert bool(mirror_remarks({"a": trial})) == assumed
    check = checks_by_name(trial, container)["rudder sign"]
    assert check.verdict == "good"
    assert (MIRROR_IMAGE in check.sentence) == assumed


def test_north_and_east_without_a_heading_show_no_side(motion, read):
    table = {name: values for name, values in motion.items() if name != "psi"}
    assert read(text(table, x="north [m]", y="east [m]")).attrs[AXES] == ASSUMED


def test_a_perfect_mirror_image_is_a_turn_to_the_other_side(motion, read, container, tmp_path):
    """Read as it is, the zigzag to port begins to starboard; no check can know, and the words go on with the record."""
    flat = {name: values for name, values in motion.items() if name not in ("p", "phi")}
    trial = read(text(in_ros_axes(flat)))
    checks = ps.trial_checks(trial, container)
    assert not [check.name for check in checks if check.verdict == "bad"]
    assert ps.recognise([trial], container)[0][0].side == "starboard"
    corrected = ps.corrected_trial(trial, checks)
    back = ps.read_trial(ps.write_trial(corrected, tmp_path / "corrected.csv"))
    assert mirror_remarks({"a": trial, "b": back, "c": corrected}) == [
        'Runs a, b, c do not show the axes of the file: port and starboard are those of axes = "ned-frd", or the '
        f"record is {MIRROR_IMAGE}."
    ]
    stated = read(text(in_ros_axes(flat)), format={"frame": {"axes": "enu-flu"}})
    assert ps.recognise([stated], container)[0][0].side == "port"
    assert not mirror_remarks({"a": stated})


def test_heel_shows_the_mirror_image(motion, read, container):
    """Roll has one sense in both axes: as read, the ship heels into its turn."""
    trial = read(text(in_ros_axes(motion)))
    check = checks_by_name(trial, container)["plausibility"]
    assert check.verdict == "bad"
    assert MIRROR_IMAGE in check.sentence
    own = read(written(motion)).assign(phi=-trial["phi"], p=-trial["p"])
    assert MIRROR_IMAGE not in checks_by_name(own, container)["plausibility"].sentence


def test_positions_of_a_receiver_have_no_axes_of_the_file(motion, read):
    """Latitude and longitude beside heading and rates as ROS has them."""
    pytest.importorskip("pymap3d")
    north, east = motion["x"], motion["y"]
    ros = in_ros_axes(motion)
    place = {"latitude [rad]": 0.8 + north / 6.37e6, "longitude [rad]": 0.2 + east / (6.37e6 * np.cos(0.8))}
    table = {name: values for name, values in ros.items() if name not in ("x", "y")} | place
    trial = read(text(table), format={"frame": {"axes": "enu-flu"}})
    assert np.ptp(trial["x"].values - north) < 0.01 * np.ptp(north)
    assert np.ptp(trial["y"].values - east) < 0.02 * np.ptp(east) + 0.01 * np.ptp(north)
    np.testing.assert_allclose(trial["psi"], motion["psi"], atol=1e-12)
