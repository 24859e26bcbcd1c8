"""The table of channels: name, unit, labels and use of every quantity that a record may have.

:func:`register_channel` adds one: it is then read, scaled, written, polluted, denoised and labelled like any other.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from typing import Any

from pymc_ship.machine.errors import TrialError
from pymc_ship.machine.fields import field_text
from pymc_ship.trial.units import (
    METRE,
    METRE_PER_SECOND,
    NEWTON,
    NEWTON_METRE,
    RADIAN,
    RADIAN_PER_SECOND,
    REVOLUTION_PER_SECOND,
    SECOND,
    Unit,
)


@dataclass(frozen=True)
class Channel:
    """A quantity that a record may have.

    Attributes
    ----------
    name : str
    unit : Unit
        SI unit of its values.
    label, short : str
        Words and symbol; short label, ``label`` by default.
    headings : tuple of str
        Other names in the heading of a file, in lower case.
    part : {"motion", "rudder", "auxiliary"}
        A state of the motion, the rudder, or neither.
    rolling, fitted, denoised, scored : bool
        Whether it belongs to roll, trajectories are fitted to it by default, :func:`pymc_ship.denoise` denoises it,
        forecasts are scored on it.
    noise_factor : float or None
        Factor k of the sensor noise, Xue et al. (2020), Eq. 22; None for no noise.
    size : float
        Prior standard deviation of a state that is not measured: its magnitude in hard manoeuvres.
    """

    name: str
    unit: Unit
    label: str
    short: str = ""
    headings: tuple[str, ...] = ()
    part: str = "auxiliary"
    rolling: bool = False
    fitted: bool = False
    noise_factor: float | None = None
    denoised: bool = False
    scored: bool = False
    size: float = math.nan

    def __repr__(self) -> str:
        return field_text(self)

    @property
    def short_label(self) -> str:
        """``short``, or ``label`` without one."""
        return self.short or self.label

    @property
    def axis(self) -> str:
        """Label of an axis, with the display unit."""
        return f"{self.label} [{self.unit.display}]"

    @property
    def short_axis(self) -> str:
        """Short label of an axis, with the display unit."""
        return f"{self.short_label} [{self.unit.display}]"


_HEADINGS = {  # other names of each channel in files
    "time": (
        "t, elapsed time, timestamp, time stamp, datetime, date time, date/time, utc, utc time, time utc, "
        "date/time utc, gps time, local time, sec, secs, seconds, stamp sec, stamp secs, elapsed, time since start, "
        "date and time, date & time, time of day, clock, clock time, header stamp sec, header stamp secs, "
        "field header stamp secs, date"
    ),
    "u": (
        "stw, speed through water, water speed, log speed, speed log, speedlog, u velo, surge, surge velocity, "
        "surge speed, longitudinal velocity, longitudinal speed, linear x"
    ),
    "v": "vm velo, sway, sway velocity, sway speed, transverse velocity, transverse speed, lateral velocity, linear y",
    "r": (
        "turn rate, r angvelo, yaw rate, yawrate, yaw velocity, rate of turn, rot, yaw, heading rate, angular z, "
        "angular velocity z, psi dot, psidot"
    ),
    "p": "roll rate, rollrate, roll velocity, roll, angular x, angular velocity x",
    "phi": "roll, roll angle, heel, heel angle, φ",
    "psi": (
        "hdt, hdm, ths, true heading, heading true, gyro, gyro heading, psi hat, heading, heading angle, yaw, "
        "yaw angle, hdg, ψ"
    ),
    "x": "x position mid, x position, x pos, north, northing, position x",
    "y": "y position mid, y position, y pos, east, easting, position y",
    "delta": (
        "rsa, actual rudder, delta rudder, rudder, rudder angle, actual rudder angle, rudder angle actual, "
        "rudder feedback, rudder response, rudder position, rud, δ"
    ),
    "n": "n prop, rpm, rps, propeller, shaft, revs, revolutions, propeller speed, shaft speed",
    "thrust": "propeller thrust",
    "torque": "propeller torque, shaft torque",
    "wind_speed": "true wind speed, wind velocity true, wind velo true",
    "wind_direction": "true wind direction, wind direction true, wind dir true",
}


def _channel(name: str, unit: Unit, label: str, **settings: Any) -> Channel:
    return Channel(name, unit, label, headings=tuple(_HEADINGS[name].split(", ")), **settings)


def _motion(name: str, unit: Unit, label: str, size: float, **settings: Any) -> Channel:
    return _channel(name, unit, label, part="motion", size=size, **settings)


def _noisy_motion(name: str, unit: Unit, label: str, size: float, *, k: float = 0.3, **settings: Any) -> Channel:
    """State of the motion with noise of factor k, which is denoised."""
    return _motion(name, unit, label, size, noise_factor=k, denoised=True, **settings)


TIME = _channel("time", SECOND, "time")

_CHANNELS = (
    _noisy_motion("u", METRE_PER_SECOND, "surge velocity u", 5.0, short="u", fitted=True, scored=True),
    _noisy_motion("v", METRE_PER_SECOND, "sway velocity v", 0.5, k=1.0, short="v", fitted=True, scored=True),
    _noisy_motion("r", RADIAN_PER_SECOND, "yaw rate r", 0.005, short="r", fitted=True, scored=True),
    _noisy_motion("p", RADIAN_PER_SECOND, "roll rate p", 0.005, short="p", rolling=True, fitted=True),
    _noisy_motion("phi", RADIAN, "roll angle φ", 0.05, rolling=True, fitted=True, scored=True),
    _noisy_motion("psi", RADIAN, "heading ψ", 1.0, scored=True),
    _motion("x", METRE, "track north x", 100.0, short="x"),
    _motion("y", METRE, "track east y", 100.0, short="y"),
    _channel("delta", RADIAN, "rudder δ", part="rudder"),
    _channel("n", REVOLUTION_PER_SECOND, "propeller speed n"),
    _channel("thrust", NEWTON, "propeller thrust"),
    _channel("torque", NEWTON_METRE, "propeller torque"),
    _channel("wind_speed", METRE_PER_SECOND, "true wind speed"),
    _channel("wind_direction", RADIAN, "direction the true wind comes from", short="wind from"),
)

CHANNELS = {channel.name: channel for channel in _CHANNELS}
"""Channels by name, in the order of a file; the motion in the order of the state vector."""


def register_channel(channel: Channel) -> None:
    """Register a channel.

    Parameters
    ----------
    channel : Channel

    Raises
    ------
    TrialError
        For anything else, and when its name is taken.
    """
    from pymc_ship.machine.arguments import check_kind  # with NumPy, which --help does without

    check_kind("A channel", channel, Channel, "make one by ps.Channel", TrialError)
    if channel.name in file_columns():
        raise TrialError(
            f"The name of a channel must be new, found {channel.name!r} among {', '.join(file_columns())}; rename it."
        )
    CHANNELS[channel.name] = channel


def channel_names(condition: Callable[[Channel], object]) -> tuple[str, ...]:
    """Names of the channels that satisfy a condition, in the order of the table."""
    return tuple(name for name, channel in CHANNELS.items() if condition(channel))


def default_channels(*, rolling: bool = True) -> tuple[str, ...]:
    """Channels that a trajectory is fitted to by default, with those of roll if ``rolling``."""
    return channel_names(lambda channel: channel.fitted and (rolling or not channel.rolling))


def unmodelled_roll_text(recorded: Iterable[str], dofs: Iterable[str]) -> str:
    """Sentence on recorded roll that a model of these degrees of freedom ignores; empty if it ignores none."""
    labels = [CHANNELS[name].label for name in recorded if name in CHANNELS and CHANNELS[name].rolling]
    if "roll" in dofs or not labels:
        return ""
    return (
        f"The record has {' and '.join(labels)}, but the vessel file has no coefficients of roll: roll is neither "
        "modelled nor forecast; add [coefficients.roll] to model it."
    )


def file_columns() -> dict[str, Channel]:
    """Time and every channel by name: the columns that a file may have."""
    return {TIME.name: TIME} | CHANNELS


SIMULATED = channel_names(lambda channel: channel.part != "auxiliary")  # motion and rudder
