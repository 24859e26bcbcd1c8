"""Bags of ROS 1 and 2, written by rosbags, with the odometry, the gyroscope and the rudder as topics of their own."""

from __future__ import annotations

import sqlite3
from contextlib import closing

import numpy as np
import pytest
from rosbags.highlevel import AnyReader
from rosbags.rosbag1 import Writer as Writer1
from rosbags.rosbag2 import StoragePlugin
from rosbags.rosbag2 import Writer as Writer2
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

import pymc_ship as ps
from tests.records.files.cases import columns
from tests.records.files.test_axes import in_ros_axes
from tests.sentences import refused

RUDDER = {"columns": {"delta": {"column": "/rudder.data", "unit": "deg"}}}
LATE = 50_000_000  # ns between a message and its recording
START = 1_700_000_000_000_000_000  # ns


def fields(store, one, time):
    """Messages of one row by topic, at a time [ns]."""
    types = store.types
    header = {"stamp": types["builtin_interfaces/msg/Time"](*divmod(time, 1_000_000_000)), "frame_id": "map"}
    header |= {"seq": 0} if "seq" in types["std_msgs/msg/Header"].__dataclass_fields__ else {}
    head = types["std_msgs/msg/Header"](**header)
    vector = types["geometry_msgs/msg/Vector3"]
    attitude = types["geometry_msgs/msg/Quaternion"](0.0, 0.0, np.sin(0.5 * one["psi"]), np.cos(0.5 * one["psi"]))
    pose = types["geometry_msgs/msg/Pose"](types["geometry_msgs/msg/Point"](one["x"], one["y"], 0.0), attitude)
    twist = types["geometry_msgs/msg/Twist"](vector(one["u"], one["v"], 0.0), vector(0.0, 0.0, one["r"]))
    free = np.zeros(36)
    odometry = types["nav_msgs/msg/Odometry"](
        head,
        "ship",
        types["geometry_msgs/msg/PoseWithCovariance"](pose, free),
        types["geometry_msgs/msg/TwistWithCovariance"](twist, free),
    )
    return {
        "/odom": odometry,
        "/rudder": types["std_msgs/msg/Float64"](np.rad2deg(one["delta"])),
        "/name": types["std_msgs/msg/String"]("calm"),
    }


def bag(folder, run, version):
    """Path of a bag of a run."""
    table = in_ros_axes({name: values for name, values in columns(run).items() if name != "phi"})
    store = get_typestore(Stores.ROS1_NOETIC if version == "ros1" else Stores.ROS2_HUMBLE)
    encode = store.serialize_ros1 if version == "ros1" else store.serialize_cdr
    if version == "ros1":
        writer = Writer1(folder / "run.bag")
    else:
        writer = Writer2(folder / "run", version=9, storage_plugin=StoragePlugin[version])
    with writer:
        connections = {}
        for k, time in enumerate(table["time"]):
            stamp = START + round(1e9 * float(time))
            rows = {name: float(values[k]) for name, values in table.items()}
            for topic, message in fields(store, rows, stamp).items():
                if topic not in connections:
                    connections[topic] = writer.add_connection(topic, message.__msgtype__, typestore=store)
                late = 0 if topic == "/rudder" else LATE
                writer.write(connections[topic], stamp + late, encode(message, message.__msgtype__))
    suffix = {"MCAP": "mcap", "SQLITE3": "db3"}
    return folder / "run.bag" if version == "ros1" else folder / "run" / f"run.{suffix[version]}"


@pytest.mark.parametrize("version", ["ros1", "MCAP", "SQLITE3"])
def test_a_bag_is_the_trial_that_was_recorded(run, tmp_path, version):
    path = bag(tmp_path, run, version)
    trial = ps.read_trial(path, format=RUDDER)
    assert "enu-flu" in trial.attrs["reading"]
    for channel in ("x", "y", "psi", "u", "v", "r", "delta"):
        np.testing.assert_allclose(
            trial[channel], run[channel], atol=2e-6 * np.abs(run[channel]).max(), err_msg=channel
        )


def test_a_folder_with_metadata_is_its_bag(run, tmp_path):
    path = bag(tmp_path, run, "MCAP")
    assert ps.read_trial(path.parent, format=RUDDER).identical(ps.read_trial(path, format=RUDDER))


def test_a_bag_without_its_metadata_is_refused(run, tmp_path):
    path = bag(tmp_path, run, "MCAP")
    (path.parent / "metadata.yaml").unlink()
    with refused(ps.TrialError, "metadata.yaml"):
        ps.read_trial(path, format=RUDDER)
    path.write_bytes(path.read_bytes()[:500])
    with refused(ps.TrialError, "run.mcap"):
        ps.read_trial(path, format=RUDDER)


OTHERS = {"ours/msg/Status": "uint8 header\nuint8[] cells\nstring word\n", "ours/msg/Secret": "float64 value\n"}


def test_topics_of_other_messages_do_not_hide_the_motion(run, tmp_path):
    """A field called header that is none, and a message whose definition the bag lacks."""
    path = bag(tmp_path, run, "SQLITE3")
    plain = ps.read_trial(path, format=RUDDER)
    store = get_typestore(Stores.ROS2_HUMBLE)
    for name, text in OTHERS.items():
        store.register(get_types_from_msg(text, name))
    status, secret = (store.types[name] for name in OTHERS)
    with Writer2(tmp_path / "both", version=8, storage_plugin=StoragePlugin.SQLITE3) as writer:
        with AnyReader([path.parent], default_typestore=store) as reader:
            for one in reader.connections:
                to = writer.add_connection(one.topic, one.msgtype, typestore=store)
                for _, time, raw in reader.messages([one]):
                    writer.write(to, time, raw)
        for topic, message in {"/status": status(3, np.zeros(2, np.uint8), "calm"), "/secret": secret(1.0)}.items():
            to = writer.add_connection(topic, message.__msgtype__, typestore=store)
            writer.write(to, START, store.serialize_cdr(message, message.__msgtype__))
    database = tmp_path / "both" / "both.db3"
    with closing(sqlite3.connect(database)) as base, base:
        base.execute("DELETE FROM message_definitions WHERE topic_type = 'ours/msg/Secret'")
    trial = ps.read_trial(database, format=RUDDER)
    assert "Topics without a definition of their message left out: /secret." in trial.attrs["reading"]
    np.testing.assert_allclose(trial["psi"], plain["psi"])
