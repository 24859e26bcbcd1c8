"""The one table of channels: what a record may hold, and what every wing asks about it.

A sensor that a facility has beside these is made known by :func:`register_channel`: its column is then read, scaled to
the ship, written, polluted, denoised and labelled like any other. The model of a ship knows only her motion and her
rudder: the other channels stand beside them and are not fitted.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable
from dataclasses import dataclass

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
    """A quantity that a record may hold.

    Attributes
    ----------
    name : str
        Its name in a record.
    unit : Unit
        SI unit of its values.
    label : str
        What it is in words, with its symbol.
    short : str
        Label where there is little room; the label by default.
    headings : tuple of str
        Words by which the heading of a file may name it, in small letters, beside its own name.
    part : {"motion", "rudder", "beside"}
        What it is to the model of a ship: a state of her motion, her rudder, or none of them.
    rolling : bool
        Whether it is of the roll, which a ship may be without.
    fitted : bool
        Whether a trajectory is fitted to it where no channels are named.
    noise_factor : float or None
        Factor k of its sensor noise, Xue et al. (2020), Eq. 22; None where the sensor is taken as exact.
    denoised : bool
        Whether denoising a record denoises it.
    scored : bool
        Whether a forecast is scored on it.
    size : float
        Its size in hard manoeuvring, the standard deviation of a state that is not measured.
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
        """Label where there is little room."""
        return self.short or self.label

    @property
    def axis(self) -> str:
        """Label of an axis, with the unit in which values are shown."""
        return f"{self.label} [{self.unit.display}]"

    @property
    def short_axis(self) -> str:
        """Label of a small axis, with the unit in which values are shown."""
        return f"{self.short_label} [{self.unit.display}]"


TIME = Channel("time", SECOND, "time", headings=("t", "elapsed time", "timestamp", "time stamp"))

_MOTION = (
    Channel(
        "u",
        METRE_PER_SECOND,
        "surge velocity u",
        short="u",
        headings=("surge", "surge velocity", "surge speed", "longitudinal velocity", "longitudinal speed"),
        part="motion",
        fitted=True,
        noise_factor=0.3,
        denoised=True,
        scored=True,
        size=5.0,
    ),
    Channel(
        "v",
        METRE_PER_SECOND,
        "sway velocity v",
        short="v",
        headings=(
            *("sway", "sway velocity", "sway speed", "transverse velocity", "transverse speed"),
            "lateral velocity",
        ),
        part="motion",
        fitted=True,
        noise_factor=1.0,
        denoised=True,
        scored=True,
        size=0.5,
    ),
    Channel(
        "r",
        RADIAN_PER_SECOND,
        "yaw rate r",
        short="r",
        headings=("yaw rate", "yawrate", "yaw velocity", "rate of turn", "rot", "yaw", "heading rate"),
        part="motion",
        fitted=True,
        noise_factor=0.3,
        denoised=True,
        scored=True,
        size=0.005,
    ),
    Channel(
        "p",
        RADIAN_PER_SECOND,
        "roll rate p",
        short="p",
        headings=("roll rate", "rollrate", "roll velocity", "roll"),
        part="motion",
        rolling=True,
        fitted=True,
        noise_factor=0.3,
        denoised=True,
        size=0.005,
    ),
    Channel(
        "phi",
        RADIAN,
        "roll angle φ",
        headings=("roll", "roll angle", "heel", "heel angle", "φ"),
        part="motion",
        rolling=True,
        fitted=True,
        noise_factor=0.3,
        denoised=True,
        scored=True,
        size=0.05,
    ),
    Channel(
        "psi",
        RADIAN,
        "heading ψ",
        headings=("heading", "heading angle", "yaw", "yaw angle", "hdg", "ψ"),
        part="motion",
        noise_factor=0.3,
        denoised=True,
        scored=True,
        size=1.0,
    ),
    Channel(
        "x",
        METRE,
        "track north x",
        short="x",
        headings=("x position", "x pos", "north", "northing"),
        part="motion",
        size=100.0,
    ),
    Channel(
        "y",
        METRE,
        "track east y",
        short="y",
        headings=("y position", "y pos", "east", "easting"),
        part="motion",
        size=100.0,
    ),
)
_RUDDER = Channel("delta", RADIAN, "rudder δ", headings=("rudder", "rudder angle", "δ"), part="rudder")
_PROPELLER = (
    Channel(
        "n",
        REVOLUTION_PER_SECOND,
        "propeller speed n",
        headings=("rpm", "rps", "propeller", "shaft", "revs", "revolutions", "propeller speed", "shaft speed"),
    ),
    Channel("thrust", NEWTON, "propeller thrust", headings=("propeller thrust",)),
    Channel("torque", NEWTON_METRE, "propeller torque", headings=("propeller torque", "shaft torque")),
)
_WIND = (
    Channel(
        "wind_speed",
        METRE_PER_SECOND,
        "true wind speed",
        headings=("true wind speed", "wind velocity true", "wind velo true"),
    ),
    Channel(
        "wind_direction",
        RADIAN,
        "direction the true wind comes from",
        short="wind from",
        headings=("true wind direction", "wind direction true", "wind dir true"),
    ),
)

CHANNELS = {channel.name: channel for channel in (*_MOTION, _RUDDER, *_PROPELLER, *_WIND)}
"""Every channel by name, in the order of a file; the states of the motion in the order of a state array."""


def register_channel(channel: Channel) -> None:
    """Make a channel known to files, scaling, noise, denoising and pages, for this process.

    Parameters
    ----------
    channel : Channel
        It comes after those that are known already.

    Raises
    ------
    TrialError
        When another channel has its name.
    """
    if channel.name in file_columns():
        raise TrialError(
            f"Each channel has its own name, found another {channel.name!r} beside {', '.join(file_columns())}; "
            "rename it."
        )
    CHANNELS[channel.name] = channel


def channel_names(condition: Callable[[Channel], object]) -> tuple[str, ...]:
    """Names of the channels that a condition picks, in the order of the table."""
    return tuple(name for name, channel in CHANNELS.items() if condition(channel))


def default_channels(*, rolling: bool = True) -> tuple[str, ...]:
    """Channels that a trajectory is fitted to where none are named; those of the roll where the ship rolls."""
    return channel_names(lambda channel: channel.fitted and (rolling or not channel.rolling))


def unmodelled_roll_text(recorded: Iterable[str]) -> str:
    """Sentence on the recorded channels that a model without roll leaves out; empty where there are none."""
    left = [CHANNELS[name].label for name in recorded if name in CHANNELS and CHANNELS[name].rolling]
    if not left:
        return ""
    return (
        f"The record has {' and '.join(left)}, the vessel file has no roll: it is not modelled and not forecast; give "
        "the vessel coefficients of roll to model it."
    )


def file_columns() -> dict[str, Channel]:
    """What a column of a file may be: time and every channel, by name."""
    return {TIME.name: TIME} | CHANNELS


SIMULATED = channel_names(lambda channel: channel.part != "auxiliary")
"""Channels of a simulated record: the motion of the ship and her rudder."""
