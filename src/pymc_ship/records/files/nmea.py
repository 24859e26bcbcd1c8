"""Logs of NMEA 0183 as tables; the library is imported on use."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Callable, Mapping, Sequence, Set
from contextlib import suppress
from functools import reduce
from operator import xor
from pathlib import Path
from typing import Any

from pymc_ship.machine.errors import TrialError
from pymc_ship.trial.units import KNOT

_BEFORE = " ,;\t[]"  # about the stamp of a logger, which stands before a sentence
_TAGS = re.compile(r"\\(?:[^\\]*\bc:(\d+))?[^\\]*\\")  # tag block of IEC 61162-450, with its clock if it has one
_SENTENCE = re.compile(r"[$!](P[A-Z0-9]{2,}|[A-Z]{5}),")
_NMEA = {  # unit, and type and fields of the sentences of each quantity, the first choice first
    "psi": (
        "deg",
        (
            ("HDT", "heading"),
            ("THS", "heading"),
            ("HDG", "true heading"),
            ("VHW", "heading_true"),
            ("HDG", "magnetic heading"),
            ("HDM", "magnetic heading"),
        ),
    ),
    "r": ("deg/min", (("ROT", "rate_of_turn"),)),
    "delta": ("deg", (("RSA", "rsa_starboard"), ("RSA", "rsa_port"))),
    "phi": ("deg", (("XDR", "roll"),)),
    "u": ("kn", (("VBW", "lon_water_spd"), ("VHW", "water_speed_knots"))),
    "v": ("kn", (("VBW", "trans_water_spd"),)),
    "sog": ("kn", (("VTG", "spd_over_grnd_kts"), ("RMC", "spd_over_grnd"))),
    "cog": ("deg", (("VTG", "true_track"), ("RMC", "true_course"))),
    "latitude": ("deg", (("GGA", "latitude"), ("RMC", "latitude"), ("GLL", "latitude"))),
    "longitude": ("deg", (("GGA", "longitude"), ("RMC", "longitude"), ("GLL", "longitude"))),
    "n": ("rpm", (("RPM", "speed"),)),
    "wind_speed": ("kn", (("MWD", "true speed"), ("MWV", "relative speed"))),
    "wind_direction": ("deg", (("MWD", "direction_true"), ("MWV", "relative angle"))),
}
_STATUS = {"rsa_starboard": "rsa_starboard_status", "rsa_port": "rsa_port_status"}
_STATUS |= dict.fromkeys(("lon_water_spd", "trans_water_spd"), "data_validity_water_spd")
_FIELDS_OF_THS = (("Heading", "heading"), ("Mode", "status"))
_KNOTS = {"N": 1.0, "M": 1.0 / KNOT, "K": 1.0 / 3.6 / KNOT}  # by unit of a wind speed
_ROLL = ("ROLL", "HEEL")  # names of a transducer


def _true_heading(message: Any) -> float:
    """Magnetic heading plus deviation and variation, easterly positive; TypeError without the variation."""
    deviation = float(message.deviation or 0.0) * (-1.0 if message.dev_dir == "W" else 1.0)
    return float(message.heading) + deviation + float(message.variation) * (-1.0 if message.var_dir == "W" else 1.0)


def _roll(message: Any) -> float | None:
    """Angle [deg] of the first transducer of roll."""
    sensors = map(message.get_transducer, range(message.num_transducers))
    return next((float(one.value) for one in sensors if one.type == "A" and one.id.strip().upper() in _ROLL), None)


def _true_wind_speed(message: Any) -> float | None:
    """Speed [kn] beside a direction from true north."""
    if message.direction_true is None:
        return None
    knots = message.wind_speed_knots
    return float(message.wind_speed_meters) / KNOT if knots is None else float(knots)


def _relative_wind_speed(message: Any) -> float | None:
    return float(message.wind_speed) * _KNOTS[message.wind_speed_units] if message.reference == "R" else None


_CALCULATED: Mapping[str, Callable[[Any], Any]] = {
    "true heading": _true_heading,
    "magnetic heading": lambda message: f"{float(message.heading)} M",
    "roll": _roll,
    "true speed": _true_wind_speed,
    "relative speed": _relative_wind_speed,
    "relative angle": lambda message: f"{float(message.wind_angle)} R" if message.reference == "R" else "",
}
"""Value of what is no field of its own; M and R are the letters of a magnetic heading and a relative wind."""
_SHORTEST_LOG = 0.5  # fraction of the first lines that are sentences


def nmea_columns(lines: Sequence[str], path: Path) -> tuple[dict[str, list[str]], dict[str, str], list[str]] | None:
    """Cells and units by heading of a log of NMEA 0183, with sentences; None for another text.

    The time is the stamp of the logger before each sentence, or the last UTC of one sensor. A sensor has one column.
    """
    first = [line for line in lines[:200] if line.strip()][:50]
    if sum(bool(_SENTENCE.search(line)) for line in first) <= _SHORTEST_LOG * len(first):
        return None
    summed = sum("*" in line for line in first) > _SHORTEST_LOG * len(first)
    readings, unread, damaged = _sentences(lines, path, summed)
    logger = sum(bool(stamp) for stamp, _ in readings) > 0.5 * len(readings)
    messages = [message for _, message in readings]
    sources, notes = _sensors(messages, unread)
    clocks = [stamp for stamp, _ in readings] if logger else _clocks(messages, sources.get("latitude", ("", ""))[0][:2])
    rows: list[dict[str, str]] = []
    for time, message in zip(clocks, messages, strict=True):
        cells = {name: _field(message, of) for name, (sensor, of) in sources.items() if sensor == _sensor(message)}
        cells = {name: cell for name, cell in cells.items() if cell}
        if not time or not cells:
            continue
        if rows and rows[-1]["time"] == time and not cells.keys() & rows[-1].keys():
            rows[-1] |= cells
        else:
            rows.append({"time": time, **cells})
    notes += [f"{damaged} damaged sentences left out."] if damaged else []
    notes += [] if summed else ["The sentences have no checksum, which would show damaged ones."]
    columns = {name: [row.get(name, "") for row in rows] for name in ("time", *sources)}
    return columns, {name: _NMEA[name][0] for name in sources}, notes


def _sentences(lines: Sequence[str], path: Path, summed: bool) -> tuple[list[tuple[str, Any]], set[str], int]:
    """Messages with the stamps before them, kinds of whole sentences that are not read, number of damaged ones."""
    try:
        import pynmea2
    except ImportError:
        raise TrialError(f"{path}: NMEA 0183 needs pynmea2, found none; pip install 'pymc-ship[formats]'.") from None
    type("THS", (pynmea2.TalkerSentence,), {"fields": _FIELDS_OF_THS})  # it lacks this one
    readings, unread, damaged = [], set(), 0
    for line in lines:
        matched = _SENTENCE.search(line)
        text = line[matched.start() :].strip() if matched else ""
        try:
            message = pynmea2.parse(text, check=summed) if matched else None
            whole = True
        except (pynmea2.ParseError, ValueError, TypeError) as error:
            message, whole = None, _is_whole(text) if summed else isinstance(error, pynmea2.SentenceTypeError)
        if matched and hasattr(message, "talker"):
            readings.append((_TAGS.sub(r"\1", line[: matched.start()]).strip(_BEFORE), message))
        elif matched and whole:
            unread.add(matched[1])
        else:
            damaged += bool(line.strip())
    return readings, unread, damaged


def _is_whole(sentence: str) -> bool:
    """Whether the checksum of a sentence is that of its letters."""
    body, _, stated = sentence[1:].partition("*")
    return stated[:2].upper() == f"{reduce(xor, body.encode(), 0):02X}"


def _clocks(messages: Sequence[Any], talker: str) -> list[str]:
    """UTC at each message, never backwards: of the sensor of a talker that shows most stamps before its others do."""
    stamps, clocks, clock = [], [], ""
    for message in messages:
        stamps.append("")
        with suppress(AttributeError, ValueError, TypeError):
            stamps[-1] = f"{message.timestamp:%H:%M:%S.%f}" if message.timestamp else ""
    given = [(stamp, _sensor(message)) for stamp, message in zip(stamps, messages, strict=True) if stamp]
    given = [(stamp, sensor) for stamp, sensor in given if sensor.startswith(talker)] or given
    most, firsts = Counter(sensor for _, sensor in given), Counter(dict(reversed(given)).values())
    usual = [sensor for sensor in most if most[sensor] > 0.5 * max(most.values())]
    sensor = max(usual, key=lambda one: firsts[one], default="")
    for stamp, message in zip(stamps, messages, strict=True):
        if stamp and _sensor(message) == sensor and (stamp > clock or (clock[:2], stamp[:2]) == ("23", "00")):
            clock = stamp
        clocks.append(clock)
    return clocks


def _sensor(message: Any) -> str:
    """Name of a sensor: talker, type, and for revolutions source and number."""
    more = f" {message.source}{message.engine_no}" if message.sentence_type == "RPM" else ""
    return f"{message.talker}{message.sentence_type}{more}"


def _sensors(messages: Sequence[Any], unread: Set[str]) -> tuple[dict[str, tuple[str, str]], list[str]]:
    """Sensor and field of each quantity, and a sentence on the sensors that are not used."""
    sources = {}
    for name, (_, choices) in _NMEA.items():
        for kind, of in choices:
            given = [message for message in messages if message.sentence_type == kind and _field(message, of)]
            if known := Counter(map(_sensor, given)):
                sources[name] = (max(known, key=lambda sensor: (" E" not in sensor, known[sensor])), of)
                break
    used = {sensor for sensor, _ in sources.values()}
    unused = sorted({*map(_sensor, messages), *unread} - used)
    notes = ["NMEA 0183: " + ", ".join(f"{name} of {sensor}" for name, (sensor, _) in sources.items()) + "."]
    notes += [f"Sensors left out: {', '.join(unused)}."] if unused else []
    if " E" in sources.get("n", ("", ""))[0]:
        notes.append("RPM has an engine alone: n is its speed, which a gear may change.")
    if sources.get("delta", ("", ""))[1] == "rsa_port":
        notes.append("RSA has a port rudder alone: delta is that one.")
    elif any(message.sentence_type == "RSA" and _field(message, "rsa_port") for message in messages):
        notes.append("RSA has a port rudder, which is left out: delta is the starboard one.")
    return sources, notes


def _field(message: Any, name: str) -> str:
    """Number of a field as text; empty if it is missing or declared invalid."""
    status = _STATUS.get(name, "status")
    is_fix = getattr(message, "lat", "") and str(getattr(message, "gps_qual", "1")) != "0"
    modes = {getattr(message, key, "") for key in ("faa_mode", "mode_indicator")}
    if str(getattr(message, status, "A") or "A") == "V" or "N" in modes or (name.endswith("itude") and not is_fix):
        return ""
    try:
        value = _CALCULATED[name](message) if name in _CALCULATED else getattr(message, name, "")
        return value if isinstance(value, str) and value[-1:] in "MR" else repr(float(value))
    except (ValueError, TypeError, KeyError, AttributeError):
        return ""
