"""The table of channels: name, unit, labels and use of every quantity that a record may have.

:func:`register_channel` adds a channel: its column is then read, scaled to the ship, written, polluted, denoised and
labelled like any other. The equations of motion use the motion and the rudder only; auxiliary channels are not fitted.
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
    """A quantity that a record may have.

    Attributes
    ----------
    name : str
        Its name in a record.
    unit : Unit
        SI unit of its values.
    label : str
        Words and symbol.
    short : str
        Short label; the label by default.
    headings : tuple of str
        Other names in the heading of a file, in lower case.
    part : {"motion", "rudder", "auxiliary"}
        A state of the motion, the rudder, or neither.
    rolling : bool
        Whether it belongs to roll, which a vessel may lack.
    fitted : bool
        Whether trajectories are fitted to it by default.
    noise_factor : float or None
        Factor k of the sensor noise, Xue et al. (2020), Eq. 22; None for no noise.
    denoised : bool
        Whether :func:`pymc_ship.denoise` denoises it.
    scored : bool
        Whether forecasts are scored on it.
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
        """Short label."""
        return self.short or self.label

    @property
    def axis(self) -> str:
        """Label of an axis, with the display unit."""
        return f"{self.label} [{self.unit.display}]"

    @property
    def short_axis(self) -> str:
        """Short label of an axis, with the display unit."""
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
"""Channels by name, in the order of a file; the motion in the order of the state vector."""


def register_channel(channel: Channel) -> None:
    """Add a channel to files, scaling, noise, denoising and pages, for this process.

    Parameters
    ----------
    channel : Channel
        Placed after the registered channels.

    Raises
    ------
    TrialError
        When its name is taken.
    """
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


def unmodelled_roll_text(recorded: Iterable[str]) -> str:
    """Sentence on recorded roll that a model without roll ignores; empty without recorded roll."""
    labels = [CHANNELS[name].label for name in recorded if name in CHANNELS and CHANNELS[name].rolling]
    if not labels:
        return ""
    return (
        f"The record has {' and '.join(labels)}, but the vessel file has no coefficients of roll: roll is neither "
        "modelled nor forecast; add [coefficients.roll] to model it."
    )


def file_columns() -> dict[str, Channel]:
    """Time and every channel by name: the columns that a file may have."""
    return {TIME.name: TIME} | CHANNELS


SIMULATED = channel_names(lambda channel: channel.part != "auxiliary")
"""Channels of a simulated record: motion and rudder."""
