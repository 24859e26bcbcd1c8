"""The turning circle and the pull-out as kinds of manoeuvre."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

from pymc_ship.physics.manoeuvre.kinds import SIDES, TRACK, Index, Limit, ManoeuvreKind

if TYPE_CHECKING:
    from pymc_ship.physics.manoeuvre.events import Record
    from pymc_ship.physics.manoeuvre.steering_record import SteeringRecord

_FULL_TURN = 120.0  # deg of heading that a turning circle changes at least
_LEAST_RUDDER = 3.0  # deg
_HARD_OVER = 35.0  # deg, least rudder angle to which the IMO limits apply
_WATER = ("psi", "u", "v")
_LAST = 0.1  # of the time with the rudder amidships, over which the residual rate is averaged
_LEFT = 0.5  # of the rate of the turn, at which the time is measured
_AMIDSHIPS = 0.2  # of the fixed angle: a smaller angle is amidships
_AFTER = 0.5  # of the time of the turn, least time amidships of a pull-out


def _indices(record: Record, attrs: Mapping[str, Any]) -> dict[str, float]:
    """Indices that the record reaches; headings count from the first sample, times and distances from the order."""
    side, course = SIDES[attrs["side"]], record.motion["psi"][0]
    indices: dict[str, float] = {"maximum_roll_angle": math.degrees(record.largest("phi"))}
    for angle in (90, 180):
        when = record.crossing(math.radians(angle) + side * course, side)
        indices[f"time_to_{angle}"] = when - record.ordered_at
        if math.isfinite(when):
            ahead, abeam = record.displacement(when)
            across = side * abeam
            indices |= {"advance": ahead, "transfer": across} if angle == 90 else {"tactical_diameter": across}
    if (turn := record.steady()) is not None:
        indices["steady_turning_diameter"] = 2.0 * turn.track_speed / turn.yaw_rate
        indices["steady_yaw_rate"] = math.degrees(turn.yaw_rate)
        indices["steady_speed"] = turn.speed
        indices["steady_drift_angle"] = math.degrees(turn.drift)
    return indices


def _limits(attrs: Mapping[str, Any], ratio: float) -> Sequence[Limit]:
    if attrs.get("rudder_deg", _HARD_OVER) < _HARD_OVER:
        return ()
    return ("advance", 4.5, "L"), ("tactical_diameter", 5.0, "L")


def _recognise(steering: SteeringRecord) -> tuple[tuple[float, ...], str] | None:
    """Rudder angle and side of a turn of more than 120 deg with a fixed rudder."""
    angle, turned = steering.fixed_rudder_deg, steering.heading_change_deg
    if abs(angle) <= _LEAST_RUDDER or abs(turned) <= _FULL_TURN:
        return None
    return (steering.ordered_angle(abs(angle)),), "starboard" if turned > 0.0 else "port"


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
        "steady_turning_diameter": Index("diameter", _WATER),
        "steady_yaw_rate": Index("rate"),
        "steady_speed": Index("speed", _WATER),
        "steady_drift_angle": Index("drift", _WATER),
        "maximum_roll_angle": Index("roll", ("phi",), scored=True),
    },
    measure=_indices,
    limits=_limits,
    recognise=_recognise,
    circles=True,
)


def _pull_out_indices(record: Record, attrs: Mapping[str, Any]) -> dict[str, float]:
    """Indices of the yaw rate after the rudder is ordered amidships; the base course as of a zigzag."""
    import numpy as np

    side, course = SIDES[attrs["side"]], attrs.get("base_course", 0.0)
    begin = record.crossing(math.radians(attrs["heading_deg"]) + side * course, side)
    after = record.time >= begin
    if not math.isfinite(begin) or after.sum() < 2:
        return {}
    rate, time = side * record.psi_dot, record.time
    before = float(np.interp(begin, time, rate))
    last = time >= time[-1] - _LAST * (time[-1] - begin)
    indices = {"rate_before": math.degrees(before), "residual_yaw_rate": math.degrees(rate[last].mean())}
    slow = np.flatnonzero(after & (rate <= _LEFT * before))
    if slow.size:
        k = max(int(slow[0]), 1)
        half = float(np.interp(-_LEFT * before, -rate[k - 1 : k + 1], time[k - 1 : k + 1]))
        indices["time_to_half_rate"] = half - begin
    return indices


def _recognise_pull_out(steering: SteeringRecord) -> tuple[tuple[float, ...], str] | None:
    """Rudder angle, heading and side of a turn of 60 to 120 deg that ends with the rudder amidships."""
    import numpy as np

    from pymc_ship.physics.manoeuvre.steering_record import first_execute, is_manoeuvre

    angle, turned = steering.fixed_rudder_deg, steering.heading_change_deg
    if abs(angle) <= _LEAST_RUDDER or not 0.5 * _FULL_TURN <= abs(turned) <= _FULL_TURN:
        return None
    time, delta = steering.trial["time"].values, np.rad2deg(steering.trial["delta"].values)
    end = time[is_manoeuvre(steering.trial)][-1]
    after = delta[time > end + _AMIDSHIPS * (end - first_execute(steering.trial))]
    lasts = time[-1] - end >= _AFTER * (end - first_execute(steering.trial))
    if not lasts or not after.size or np.quantile(np.abs(after), 0.9) > _AMIDSHIPS * abs(angle):
        return None
    heading = 5 * max(round(abs(turned) / 5.0), 1)
    return (steering.ordered_angle(abs(angle)), heading), "starboard" if turned > 0.0 else "port"


PULL_OUT = ManoeuvreKind(
    name="pull_out",
    angles=("rudder_deg", "heading_deg"),
    example="20/90",
    option="pull-out",
    title="pull-out, rudder amidships after a change of heading",
    second_execute_factor=0.0,
    indices={
        "rate_before": Index("rate", ("psi", "r"), signed=True),
        "time_to_half_rate": Index("time", ("psi", "r"), scored=True),
        "residual_yaw_rate": Index("rate", ("psi", "r"), signed=True),
    },
    measure=_pull_out_indices,
    recognise=_recognise_pull_out,
    reach=60.0,
)
