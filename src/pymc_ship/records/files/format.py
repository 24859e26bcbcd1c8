"""The format of a trial file, a small TOML: columns, units, signs, frame, scale; see docs/reference/format_toml.md."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np

from pymc_ship.machine.errors import TrialError
from pymc_ship.machine.toml import Entry, toml_table
from pymc_ship.records.files.columns import (
    CODES,
    GROUND,
    LEAST_TURN,
    QUATERNION,
    SETTINGS,
    Column,
    is_over_ground,
    quantities,
)
from pymc_ship.trial.channels import CHANNELS
from pymc_ship.trial.record import OVER_GROUND

_EARTH = 6.371e6  # m
_FARTHEST = 1e5  # m, where the plane is off by 4 m
_FEWEST_CHANGES = 10  # of a course over ground whose heading turns by LEAST_TURN between two of them

DELIMITERS = (",", ";", "\t", " ")  # the space stands for any white space

_CONVENTIONS: Mapping[str, Mapping[str, str]] = {
    "ned": {},
    "enu-flu": {},
    "nwu-flu": {},
    "nmea": {"heading": "compass", "rudder_positive": "starboard"},
    "mmg": {"rudder_positive": "starboard", "forces": "Ld"},
}
"""Other keys of the frame that a convention states; the axes are north-east-down but for those of ROS."""

_Z_UP = ("enu-flu", "nwu-flu")  # conventions of ROS
_RECEIVER = "receiver"  # velocities along x and y of the point that x and y are of; no key states it

_NMEA_UNITS = {
    "psi": "deg",
    "r": "deg/min",
    "delta": "deg",
    "u": "kn",
    "v": "kn",
    "sog": "kn",
    "n": "rpm",
} | dict.fromkeys(("cog", "latitude", "longitude"), "deg")

_FRAME = {
    "convention": tuple(_CONVENTIONS),
    "velocities": ("body", "earth"),
    "heading": ("clockwise", "counterclockwise", "compass"),
    "rudder_positive": ("auto", "port", "starboard"),
    "speeds": ("through water", "over ground"),
    "wind": ("true", "relative"),
    "forces": ("L2", "Ld"),
}


@dataclass(frozen=True)
class TrialFormat:
    """Format of a trial file; the default has the units and signs of the package.

    The fields are the keys of docs/reference/format_toml.md: ``columns`` by channel; ``convention`` of axes, sides and
    units, empty where not stated; ``reference`` and ``antenna``, the points of u, v and of x, y forward of the origin
    [m]; ``forces``, the area L^2 or L d of prime captive forces; ``froude``, the length of the ship over that of the
    model; ``delimiter``, by default that of the header; ``facility``, empty for a single one.
    """

    columns: dict[str, dict[str, Any]] = field(default_factory=dict)
    convention: str = ""
    velocities: str = "body"
    reference: float = 0.0
    antenna: float | None = None
    heading: str = "clockwise"
    rudder_positive: str = "auto"
    speeds: str = "through water"
    wind: str = "true"
    forces: str = "L2"
    froude: float = 1.0
    delimiter: str | None = None
    skip_rows: int = 0
    facility: str = ""

    @property
    def unstated_units(self) -> dict[str, str]:
        """Default units of channels that are not the SI unit."""
        if self.convention == "nmea":
            return _NMEA_UNITS
        return {"psi": "deg"} if self.heading == "compass" else {}


def load_format(source: str | Path | Mapping[str, Any] | None) -> TrialFormat:
    """Checked format, from a TOML file or its table; None for the format of the package; TrialError for a wrong one."""
    if source is None:
        return TrialFormat()
    return _format(toml_table(source, "The format", TrialError))


def _format(file: Entry) -> TrialFormat:
    file.check_keys(("columns", "frame", "scale", "delimiter", "skip_rows", "facility"))
    frame, scale, columns = (file.at(key, {}) for key in ("frame", "scale", "columns"))
    frame.check_keys((*_FRAME, "reference", "antenna"))
    scale.check_keys(("froude",))
    columns.check_keys(quantities())
    froude, reference = scale.at("froude", 1.0), frame.at("reference", 0.0)
    if froude.number() <= 0.0:
        froude.fail(f"must be positive, found {froude.value:g}; correct it.")
    convention = frame.at("convention").choice(tuple(_CONVENTIONS)) if "convention" in frame else ""
    if convention in _Z_UP and frame.at("heading", "clockwise").value != "clockwise":
        frame.at("heading").fail(
            f"must not be given beside convention = {convention!r}, which has its own; leave one of them out."
        )
    settings = {key: frame.at(key).choice(known) for key, known in _FRAME.items() if key in frame}
    return TrialFormat(
        columns={channel: _column(columns.at(channel), channel) for channel in columns},
        **({**_CONVENTIONS[convention], **settings} if convention else settings),
        reference=0.0 if reference.value in ("origin", "midship") else reference.number(),
        antenna=frame.at("antenna").number() if "antenna" in frame else None,
        froude=froude.number(),
        delimiter=file.at("delimiter").choice(DELIMITERS) if "delimiter" in file else None,
        skip_rows=file.at("skip_rows", 0).whole(least=0),
        facility=file.at("facility", "").text(),
    )


def _column(entry: Entry, channel: str) -> dict[str, Any]:
    """Entry of a channel: ``column``, ``sign``, ``offset``, ``missing``, ``delay``, perhaps ``unit`` and ``code``."""
    if not isinstance(entry.value, Mapping):
        entry = replace(entry, value={"column": entry.value})
    entry.check_keys(("column", "unit", *SETTINGS))
    column, unit = entry.value.get("column"), quantities()[channel].unit
    if not isinstance(column, str) or not column.strip():
        entry.fail(f"must be the heading of a column, found {column!r}; correct it.")
    stated = entry.at("unit", unit.name)
    if not isinstance(stated.value, str) or not unit.factor(stated.value):
        stated.fail(f"must be a unit like {unit.name}, found {stated.value!r}; correct it.")
    sign = entry.at("sign", 1).number()
    if abs(sign) != 1.0:
        entry.at("sign").fail(f"must be 1 or -1, found {sign:g}; correct it.")
    if channel == "time" and "delay" in entry:
        entry.at("delay").fail("must be of another column than the time, found it there; state it of each late sensor.")
    if "code" in entry:
        entry.at("code").choice(tuple(CODES))
    stand_ins = entry.value.get("missing", [])
    stand_ins = stand_ins if isinstance(stand_ins, list) else [stand_ins]
    missing = tuple(replace(entry.at("missing"), value=value).number() for value in stand_ins)
    numbers = {key: entry.at(key, 0.0).number() for key in ("offset", "delay")}
    return {**entry.value, "sign": sign, **numbers, "missing": missing}


def format_text(layout: TrialFormat, remark: str) -> str:
    """Text of a format file, with a comment in its first line."""
    top = {"delimiter": layout.delimiter, "skip_rows": layout.skip_rows, "facility": layout.facility}
    frame = {key: getattr(layout, key) for key in ("convention", "reference", "antenna", *_FRAME) if key != "forces"}
    lines = [f"# {remark}", *(f"{key} = {_toml(value)}" for key, value in top.items() if value)]
    for name, table in (("columns", layout.columns), ("frame", frame), ("scale", {"froude": layout.froude})):
        lines += [
            "",
            f"[{name}]",
            *(f"{key} = {_toml(value)}" for key, value in table.items() if value not in ("", None)),
        ]
    return "\n".join(lines) + "\n"


def _toml(value: Any) -> str:
    """Value of a key, a table in one line."""
    if isinstance(value, Mapping):
        return "{ " + ", ".join(f"{key} = {_toml(one)}" for key, one in value.items()) + " }"
    return json.dumps(value, ensure_ascii=False).replace("\x7f", "\\u007F")


def with_signs(channels: dict[str, np.ndarray], layout: TrialFormat) -> tuple[dict[str, np.ndarray], list[str]]:
    """Channels in axes with z down, psi clockwise and continuous; sentences on the changes."""
    channels, attitude_notes = _with_attitude(channels)
    signed, notes = _north_east_down(channels, layout)
    notes = attitude_notes + notes
    if layout.heading == "counterclockwise" and "psi" in signed:
        signed["psi"] = -signed["psi"]
        notes.append("psi changed in sign: the file counts it counterclockwise.")
    if "psi" in signed:
        signed["psi"], jumps = _without_jumps(signed["psi"])
        notes += [f"psi made continuous over {jumps} jump{'s' if jumps > 1 else ''} of 360 deg."] if jumps else []
    return signed, notes


def _with_attitude(channels: dict[str, np.ndarray]) -> tuple[dict[str, np.ndarray], list[str]]:
    """Channels with psi, and phi if the ship rolls, of a quaternion; a sentence."""
    others = {name: values for name, values in channels.items() if name not in QUATERNION}
    if not channels.keys() >= QUATERNION.keys():
        return others, []
    x, y, z, w = (channels[name] for name in QUATERNION)
    angles = {
        "psi": np.arctan2(2.0 * (w * z + x * y), w**2 + x**2 - y**2 - z**2),
        "phi": np.arctan2(2.0 * (w * x + y * z), w**2 - x**2 - y**2 + z**2),
    }
    if not np.nan_to_num(angles["phi"]).any():
        del angles["phi"]
    return angles | others, [f"{', '.join(angles)} from the quaternion."]


def _north_east_down(channels: dict[str, np.ndarray], layout: TrialFormat) -> tuple[dict[str, np.ndarray], list[str]]:
    """Channels in axes with z down, from those with z up, x east or north and v to port; a sentence."""
    turned = dict(channels)
    if layout.convention not in _Z_UP:
        return turned, []
    for name in ("y", "psi", "v", "r"):
        if name in turned:
            turned[name] = -turned[name]
    if layout.convention == "enu-flu":
        for first, second in (("x", "y"), ("u", "v"))[: 2 if layout.velocities == "earth" else 1]:
            east, minus_north = turned.pop(first, None), turned.pop(second, None)
            if east is not None:
                turned[second] = east
            if minus_north is not None:
                turned[first] = -minus_north
        if "psi" in turned:
            turned["psi"] = turned["psi"] + 0.5 * np.pi
    return turned, [f"Axes turned from {layout.convention} to ned: x north, y east, psi clockwise, v to starboard."]


def _without_jumps(psi: np.ndarray) -> tuple[np.ndarray, int]:
    """Continuous heading and the number of jumps removed, for a heading within one turn."""
    known = np.isfinite(psi)
    inside = psi[known]
    jumps = int((np.abs(np.diff(inside)) > 1.5 * np.pi).sum())
    if not jumps or np.ptp(inside) > 2.0 * np.pi * 1.001:
        return psi, 0
    continuous = psi.copy()
    continuous[known] = np.unwrap(inside, discont=1.5 * np.pi)
    return continuous, jumps


def with_ground(
    channels: dict[str, np.ndarray], layout: TrialFormat, where: str
) -> tuple[dict[str, np.ndarray], TrialFormat, list[str]]:
    """dict[str, np.ndarray] with u, v and x, y of the ground where the file has no others, format and sentences.

    The velocities are those of the receiver, which the format then states. TrialError for positions that are none.
    """
    channels, notes = dict(channels), []
    sog, cog, latitude, longitude = (channels.pop(name, None) for name in GROUND)
    if sog is not None and cog is not None and is_over_ground({*channels, *GROUND}) and not _apart(sog, cog):
        channels |= {"u": sog * np.cos(cog), "v": sog * np.sin(cog)}
        layout = replace(layout, velocities=_RECEIVER, speeds=OVER_GROUND)
        notes.append("u, v from speed and course over ground: each trial has an unknown current.")
    has_track = bool({"x", "y"} & set(channels))
    if latitude is not None and longitude is not None and not (has_track or _apart(latitude, longitude)):
        north, east, note = _local_plane(latitude, longitude, where)
        channels |= {"x": north, "y": east}
        notes.append(note)
    return channels, layout, notes


def check_course(
    columns: Mapping[str, Column], channels: Mapping[str, np.ndarray], time: np.ndarray, where: str
) -> None:
    """Raise TrialError for a course over ground [rad] that keeps its value while the heading turns."""
    if not is_over_ground(columns):
        return
    order = np.argsort(time, kind="stable")
    at, turned = (order[np.isfinite(channels[name] + time)[order]] for name in ("cog", "psi"))
    if not at.size or not turned.size:
        return
    course = channels["cog"][at]
    heading = np.rad2deg(np.interp(time[at], time[turned], np.unwrap(channels["psi"][turned])))
    changes = np.flatnonzero(np.diff(course) != 0.0) + 1
    turn = max(float(np.ptp(part)) for part in np.split(heading, changes))
    if changes.size < _FEWEST_CHANGES and turn > LEAST_TURN:
        raise TrialError(
            f"{where}, column {columns['cog'].heading!r}: a course over ground turns with the ship, found one value "
            f"while the heading turns by {turn:.3g} deg; rename a set course, such as 'course_set'."
        )


def _apart(first: np.ndarray, second: np.ndarray) -> bool:
    """Whether no row has both quantities, which have rows of their own."""
    return bool(np.isfinite(first).any() and np.isfinite(second).any() and not np.isfinite(first + second).any())


def _local_plane(latitude: np.ndarray, longitude: np.ndarray, where: str) -> tuple[np.ndarray, np.ndarray, str]:
    """Metres north and east of the first fix in the plane that touches the ellipsoid WGS 84 there, and a sentence."""
    try:
        from pymap3d import geodetic2enu
    except ImportError:
        raise TrialError(
            f"{where}: latitude and longitude need the package pymap3d, found none; "
            "pip install 'pymc-ship[formats]', or give x and y."
        ) from None
    fixes = np.flatnonzero(np.isfinite(latitude) & np.isfinite(longitude))
    degrees = np.abs(np.rad2deg([latitude[fixes], longitude[fixes]]))
    if not fixes.size or (degrees > [[90.0], [360.0]]).any():
        largest = ", ".join(f"{angle:.7g}" for angle in degrees.max(axis=1, initial=0.0))
        raise TrialError(
            f"{where}: a latitude is within 90 deg and a longitude within 360 deg, found up to {largest} deg; correct "
            "the cells, or state their unit."
        )
    first = (latitude[fixes[0]], longitude[fixes[0]], 0.0)
    east, north, _ = geodetic2enu(latitude, longitude, 0.0, *first, deg=False)
    far = float(np.nanmax(np.hypot(east, north)))
    if far > _FARTHEST:
        raise TrialError(
            f"{where}: a trial lies within {_FARTHEST / 1e3:g} km, found positions {far / 1e3:.4g} km apart; "
            "leave out wrong fixes, or give x and y."
        )
    error = far**3 / (6.0 * _EARTH**2)
    origin = f"{np.rad2deg(first[0]):.6f}, {np.rad2deg(first[1]):.6f} deg"
    return north, east, f"x, y from latitude and longitude, origin {origin}; flat to {max(error, 1e-3):.1g} m."


def at_origin(
    channels: dict[str, np.ndarray], layout: TrialFormat, where: str
) -> tuple[dict[str, np.ndarray], list[str]]:
    """Channels with u, v, x, y in ship axes at the origin, sentences on the changes; TrialError for a missing channel.

    The track of a receiver whose velocities u and v are moves with them, unless the format states its antenna.
    """
    moved, notes, arm = dict(channels), [], layout.reference
    received = layout.velocities == _RECEIVER
    antenna = layout.antenna if layout.antenna is not None else arm * received
    if layout.velocities in ("earth", _RECEIVER):
        _check_channels(moved, ("u", "v", "psi"), "velocities = 'earth'", where)
        cosine, sine = np.cos(moved["psi"]), np.sin(moved["psi"])
        u, v = moved["u"], moved["v"]
        moved |= {"u": u * cosine + v * sine, "v": v * cosine - u * sine}
        notes.append("u, v turned from earth-fixed axes into the ship's by psi.")
    if arm:
        _check_channels(moved, ("v", "r"), f"reference = {arm:g}", where)
        moved["v"] = moved["v"] - arm * moved["r"]
        notes.append(f"v moved to the origin from a point {arm:g} m forward of it.")
    elif received:
        names = "u, v and the track" if {"x", "y"} <= set(moved) else "u, v"
        notes.append(f"{names} are those of the antenna; state its place, [frame] reference, m forward of the origin.")
    if antenna and (layout.antenna is not None or {"x", "y"} <= set(moved)):
        _check_channels(moved, ("x", "y", "psi"), f"antenna = {antenna:g}", where)
        cosine, sine = np.cos(moved["psi"]), np.sin(moved["psi"])
        moved |= {"x": moved["x"] - antenna * cosine, "y": moved["y"] - antenna * sine}
        notes.append(f"x, y moved to the origin from a point {antenna:g} m forward of it.")
    return moved, notes


def with_true_wind(
    channels: dict[str, np.ndarray], layout: TrialFormat, where: str
) -> tuple[dict[str, np.ndarray], list[str]]:
    """Channels with true wind, clockwise from north where it blows from; a sentence. TrialError if one is missing."""
    if layout.wind == "true":
        words = 'wind_direction taken as that of the true wind, from which it blows; else state wind = "relative".'
        return channels, [words] if "wind_direction" in channels else []
    _check_channels(channels, ("wind_speed", "wind_direction", "u", "v", "psi"), "wind = 'relative'", where)
    flow = true_air(*(channels[name] for name in ("wind_speed", "wind_direction", "u", "v", "psi")))
    moved = channels | {"wind_speed": np.abs(flow), "wind_direction": np.angle(-flow) % (2.0 * np.pi)}
    return moved, ["True wind calculated from relative wind, u, v and psi."]


def true_air(speed: np.ndarray, bow: np.ndarray, u: np.ndarray, v: np.ndarray, psi: np.ndarray) -> np.ndarray:
    """Velocity of the air, north + i east, from relative wind speed and direction from the bow."""
    return (u + 1j * v - speed * np.exp(1j * bow)) * np.exp(1j * psi)


def _check_channels(channels: dict[str, Any], needed: tuple[str, ...], setting: str, where: str) -> None:
    missing = [name for name in needed if name not in channels]
    if missing:
        raise TrialError(
            f"{where}: {setting} needs the channels {', '.join(needed)}; {', '.join(missing)} missing; "
            "add them or change the format."
        )


def full_scale(
    time: np.ndarray, channels: dict[str, np.ndarray], froude: float
) -> tuple[np.ndarray, dict[str, np.ndarray], list[str]]:
    """Time and channels of the ship from those of its model, by Froude's law; sentences on it."""
    if froude == 1.0:
        return time, channels, []
    scaled = {name: values * froude ** CHANNELS[name].unit.froude for name, values in channels.items()}
    note = f"Scaled to the ship by Froude's law: lengths x {froude:g}, speeds and times x {math.sqrt(froude):.4g}."
    return time * math.sqrt(froude), scaled, [note]
