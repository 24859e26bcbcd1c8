"""A record whose file does not show its axes may be its mirror image, which check and pages say."""

from __future__ import annotations

import numpy as np
import pytest

import pymc_ship as ps
from pymc_ship.records.files.format import format_text, load_format
from pymc_ship.records.files.reading import read_file
from pymc_ship.records.files.sides import MIRROR_IMAGE, mirror_remarks
from pymc_ship.trial.record import ASSUMED, AXES
from tests.records.checks.cases import checks_by_name
from tests.records.files.cases import columns, written
from tests.sentences import refused


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
        ({}, {"frame": {"convention": "ned"}}, False),
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


def in_ros_fields(table):
    """Table as ``nav_msgs/Odometry`` and ``sensor_msgs/Imu`` have it, exported by a ROS tool."""
    turned = in_ros_axes(table)
    yaw, roll = 0.5 * turned.pop("psi"), 0.5 * turned.pop("phi")
    odometry = "odom.pose.pose"
    names = {"time": "time", "delta": "delta", "x": f"{odometry}.position.x", "y": f"{odometry}.position.y"}
    names |= {"u": "/odom/twist/twist/linear/x", "v": "/odom/twist/twist/linear/y"}
    names |= {"r": "imu.angular_velocity.z", "p": "imu.angular_velocity.x"}
    parts = {"w": np.cos(yaw) * np.cos(roll), "x": np.cos(yaw) * np.sin(roll)}
    parts |= {"y": np.sin(yaw) * np.sin(roll), "z": np.sin(yaw) * np.cos(roll)}
    fields = {name: turned[channel] for channel, name in names.items()}
    return fields | {f"{odometry}.orientation.{axis}": values for axis, values in parts.items()}


def test_odometry_of_ros_is_read_in_its_own_axes(motion, read, tmp_path):
    own, trial = read(text(motion)), read(text(in_ros_fields(motion)))
    assert "enu-flu" in trial.attrs["reading"]
    assert "psi, phi from the quaternion" in trial.attrs["reading"]
    assert AXES not in trial.attrs
    assert set(trial.data_vars) == set(motion) - {"time", "n"}
    for name, values in trial.data_vars.items():
        np.testing.assert_allclose(values, own[name], atol=1e-9, err_msg=name)
    layout = read_file(tmp_path / "run.csv").layout
    (tmp_path / "own.toml").write_text(format_text(layout, "as read"))
    again = ps.read_trial(tmp_path / "run.csv", format=tmp_path / "own.toml")
    np.testing.assert_array_equal(again["psi"], trial["psi"])


def test_parts_of_a_vector_in_words_are_not_in_axes_of_ros(motion, read):
    """A logger of its own axes may call a column "Position X"."""
    trial = read(text({**motion, "more": motion["x"]}, x="Position X [m]", y="Position Y [m]", more="Orientation X"))
    assert "enu-flu" not in trial.attrs["reading"]
    np.testing.assert_allclose(trial["x"], motion["x"], atol=1e-9)


def test_a_stated_convention_precedes_that_of_ros(motion, read):
    trial = read(text(in_ros_fields(motion)), format={"frame": {"convention": "nwu-flu"}})
    assert "enu-flu" not in trial.attrs["reading"]
    np.testing.assert_allclose(trial["x"], motion["y"], atol=1e-9)


def test_a_file_of_a_bridge_needs_its_convention_alone(motion, read):
    factors = {"psi": np.rad2deg(1.0), "r": np.rad2deg(60.0), "delta": -np.rad2deg(1.0)}
    factors |= dict.fromkeys(("u", "v"), 3600.0 / 1852.0)
    table = {name: factors.get(name, 1.0) * values for name, values in motion.items() if name in {"time", *factors}}
    trial = read(text(table), format={"frame": {"convention": "nmea"}})
    for name, values in trial.data_vars.items():
        np.testing.assert_allclose(values, motion[name], atol=1e-9, err_msg=name)


def test_other_keys_precede_those_of_a_convention():
    mmg = load_format({"frame": {"convention": "mmg"}})
    assert (mmg.rudder_positive, mmg.forces, mmg.heading) == ("starboard", "Ld", "clockwise")
    own = load_format({"frame": {"convention": "mmg", "rudder_positive": "port"}})
    assert (own.rudder_positive, own.forces) == ("port", "Ld")
    for words in ({"convention": "nme"}, {"convention": "enu-flu", "heading": "compass"}):
        with refused(ps.TrialError, "convention"):
            load_format({"frame": words})


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
        'Runs a, b, c do not show the axes of the file: port and starboard are those of convention = "ned", or the '
        f"record is {MIRROR_IMAGE}."
    ]
    stated = read(text(in_ros_axes(flat)), format={"frame": {"convention": "enu-flu"}})
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
    trial = read(text(table), format={"frame": {"convention": "enu-flu"}})
    assert np.ptp(trial["x"].values - north) < 0.01 * np.ptp(north)
    assert np.ptp(trial["y"].values - east) < 0.02 * np.ptp(east) + 0.01 * np.ptp(north)
    np.testing.assert_allclose(trial["psi"], motion["psi"], atol=1e-12)
