"""The turning circle as a kind of manoeuvre: the rudder is put over and held."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

from pymc_ship.manoeuvre.kinds import SIDES, TRACK, Index, Limit, ManoeuvreKind

if TYPE_CHECKING:
    from pymc_ship.manoeuvre.events import Record
    from pymc_ship.manoeuvre.helm import Helm

_FULL_TURN = 120.0  # deg of heading that a turning circle changes at least
_LEAST_RUDDER = 3.0  # deg
_HARD_OVER = 35.0  # deg, from which on the limits hold
_WATER = ("psi", "u", "v")


def _indices(record: Record, attrs: Mapping) -> dict[str, float]:
    """Indices that the record reaches; headings and distances count from those at its begin."""
    side, course = SIDES[attrs["side"]], record.motion["psi"][0]
    found: dict[str, float] = {"maximum_roll_angle": math.degrees(record.largest("phi"))}
    for angle in (90, 180):
        when = record.crossing(math.radians(angle) + side * course, side)
        found[f"time_to_{angle}"] = when - record.time[0]
        if math.isfinite(when):
            ahead, abeam = record.displacement(when)
            across = side * abeam
            found |= {"advance": ahead, "transfer": across} if angle == 90 else {"tactical_diameter": across}
    if (turn := record.steady()) is not None:
        found["steady_turning_diameter"] = 2.0 * turn.track_speed / turn.yaw_rate
        found["steady_yaw_rate"] = math.degrees(turn.yaw_rate)
        found["steady_speed"] = turn.speed
        found["steady_drift_angle"] = math.degrees(turn.drift)
    return found


def _limits(attrs: Mapping, ratio: float) -> Sequence[Limit]:
    """Limits of the turning circle with hard-over rudder."""
    if attrs.get("rudder_deg", _HARD_OVER) < _HARD_OVER:
        return ()
    return ("advance", 4.5, "L"), ("tactical_diameter", 5.0, "L")


def _recognise(helm: Helm) -> tuple[tuple[float, ...], str] | None:
    """Rudder angle and side of a record that turns far with a rudder that is held."""
    if abs(helm.held_angle) <= _LEAST_RUDDER or abs(helm.turned) <= _FULL_TURN:
        return None
    return (helm.ordered(abs(helm.held_angle)),), "starboard" if helm.turned > 0.0 else "port"


TURNING_CIRCLE = ManoeuvreKind(
    name="turning_circle",
    angles=("rudder_deg",),
    example="35",
    option="turn",
    title="turning circle",
    indices={
        "advance": Index("distance", TRACK, scored=True),
        "transfer": Index("distance", TRACK, scored=True, signed=True),
        "tactical_diameter": Index("distance", TRACK, scored=True),
        "time_to_90": Index("time"),
        "time_to_180": Index("time"),
        "steady_turning_diameter": Index("distance", _WATER),
        "steady_yaw_rate": Index("rate"),
        "steady_speed": Index("speed", _WATER),
        "steady_drift_angle": Index("attitude", _WATER),
        "maximum_roll_angle": Index("attitude", ("phi",)),
    },
    measure=_indices,
    limits=_limits,
    recognise=_recognise,
    circles=True,
)
