"""The zigzag test as a kind of manoeuvre."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

from pymc_ship.physics.manoeuvre.kinds import SIDES, TRACK, Index, Limit, ManoeuvreKind

if TYPE_CHECKING:
    from pymc_ship.physics.manoeuvre.events import Record
    from pymc_ship.physics.manoeuvre.steering_record import SteeringRecord

BY_HAND = math.radians(1.0)
"""Deviation [rad] from the mean switching heading, beyond which a zigzag was steered by hand."""


def _indices(record: Record, attrs: Mapping[str, Any]) -> dict[str, float]:
    """Indices reached; overshoots count from the switching heading or from ``attrs["reversal_times"]`` [s].

    The base course is ``attrs["base_course"]`` [rad], by default 0.
    """
    heading, side = math.radians(attrs["heading_deg"]), SIDES[attrs["side"]]
    course = attrs.get("base_course", 0.0)
    by_hand: Sequence[float] = attrs.get("reversal_times", ())
    indices: dict[str, float] = {"maximum_roll_angle": math.degrees(record.largest("phi"))}
    switch = record.crossing(heading + side * course, side)
    if not by_hand or side * (record.at("psi", by_hand[0]) - course) > heading - BY_HAND:
        indices["initial_turning_time"] = switch - record.ordered_at
        if math.isfinite(switch):
            indices["initial_turning_distance"] = record.distance(switch)
    switches = list(by_hand[:1]) or [switch]
    for count, name in enumerate(("first", "second", "third")):
        switch = switches[-1]
        peak = record.peak(switch) if math.isfinite(switch) else math.nan
        if not math.isfinite(peak):
            break
        indices[f"{name}_overshoot_angle"] = math.degrees(side * (record.at("psi", peak) - record.at("psi", switch)))
        if count < 2:
            indices[f"{name}_overshoot_time"] = peak - switch
        side = -side
        if count == 0:
            indices["reach"] = record.crossing(side * course, side, after=peak) - record.ordered_at
        if by_hand and count + 1 == len(by_hand):
            break
        level = heading + side * course
        switches.append(by_hand[count + 1] if by_hand else record.crossing(level, side, after=peak))
    if len(switches) > 2:
        indices["period"] = switches[2] - switches[0]
    return indices


def _limits(attrs: Mapping[str, Any], ratio: float) -> Sequence[Limit]:
    angles = (attrs.get("rudder_deg"), attrs.get("heading_deg"))
    if angles == (10.0, 10.0):
        first = ("first_overshoot_angle", min(max(5.0 + 0.5 * ratio, 10.0), 20.0), "deg")
        second = ("second_overshoot_angle", min(max(17.5 + 0.75 * ratio, 25.0), 40.0), "deg")
        return first, second, ("initial_turning_distance", 2.5, "L")
    return (("first_overshoot_angle", 25.0, "deg"),) if angles == (20.0, 20.0) else ()


def _recognise(steering: SteeringRecord) -> tuple[tuple[float, ...], str] | None:
    if not steering.reversals:
        return None
    first = "starboard" if steering.reversals[0].heading > 0.0 else "port"
    return (steering.reversed_angle, steering.switching_heading), first


ZIGZAG = ManoeuvreKind(
    name="zigzag",
    angles=("rudder_deg", "heading_deg"),
    example="20/20",
    option="zigzag",
    title="zigzag test",
    second_execute_factor=-1.0,
    indices={
        "first_overshoot_angle": Index("angle", scored=True),
        "second_overshoot_angle": Index("angle", scored=True),
        "third_overshoot_angle": Index("angle"),
        "first_overshoot_time": Index("time", scored=True),
        "second_overshoot_time": Index("time", scored=True),
        "initial_turning_time": Index("time", scored=True),
        "initial_turning_distance": Index("distance", TRACK, scored=True),
        "reach": Index("time"),
        "period": Index("time", scored=True),
        "maximum_roll_angle": Index("roll", ("phi",), scored=True),
    },
    measure=_indices,
    limits=_limits,
    recognise=_recognise,
    swings=True,
)
