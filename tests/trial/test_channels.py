from __future__ import annotations

import numpy as np
import pytest

from pymc_ship.physics.motion.equations import STATE, VELOCITIES
from pymc_ship.trial.channels import CHANNELS, SIMULATED, channel_names, default_channels, file_columns


def test_the_table_has_each_channel_once_and_time_is_none_of_them():
    assert tuple(CHANNELS) == (*STATE, "delta", "n", "thrust", "torque", "wind_speed", "wind_direction")
    assert all(channel.name == name for name, channel in CHANNELS.items())
    assert list(file_columns()) == ["time", *CHANNELS]


def test_what_is_picked_from_the_table_keeps_its_order():
    assert (*STATE, "delta") == SIMULATED
    assert VELOCITIES == ("u", "v", "r", "p")
    assert default_channels() == ("u", "v", "r", "p", "phi")
    assert default_channels(rolling=False) == ("u", "v", "r")
    assert channel_names(lambda channel: channel.denoised) == STATE[:6]


def test_what_a_trajectory_is_fitted_to_is_a_state_with_a_size_and_noise():
    assert set(default_channels()) <= set(STATE)
    assert all(CHANNELS[name].noise_factor > 0.0 for name in default_channels())
    assert all(CHANNELS[name].size > 0.0 for name in STATE)


@pytest.mark.parametrize(
    ("name", "axis", "short"),
    [
        ("u", "surge velocity u [m/s]", "u [m/s]"),
        ("r", "yaw rate r [deg/s]", "r [deg/s]"),
        ("phi", "roll angle φ [deg]", "roll angle φ [deg]"),
        ("delta", "rudder δ [deg]", "rudder δ [deg]"),
    ],
)
def test_an_axis_says_what_it_shows_with_angles_in_degrees(name, axis, short):
    assert (CHANNELS[name].axis, CHANNELS[name].short_axis) == (axis, short)


def test_the_factor_of_what_is_shown_goes_with_its_unit():
    factors = {name: CHANNELS[name].unit.display_factor for name in ("phi", "p", "x", "thrust")}
    assert factors == {"phi": np.rad2deg(1.0), "p": np.rad2deg(1.0), "x": 1.0, "thrust": 1.0}
