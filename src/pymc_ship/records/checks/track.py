"""Whether measured velocities lead to the measured track: axes, sign of v, lever arm and drift.

x_dot = u cos psi - v cos phi sin psi, y_dot = u sin psi + v cos phi cos psi, over blocks as in :mod:`.kinematics`.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
import xarray as xr

from pymc_ship.machine.errors import TrialError
from pymc_ship.records.checks.kinematics import SHORTEST_APPROACH, STRAIGHT_TURN, YAW_BLOCK
from pymc_ship.records.checks.mistakes import COURSE, speed_units
from pymc_ship.records.checks.verdicts import (
    Check,
    balance,
    integral,
    missing_channels_text,
    not_checked,
    straight_approach,
)
from pymc_ship.records.files.ship_scale import SIGNIFICANT, Blocks, ShipScale, least_squares, ship_blocks
from pymc_ship.records.steering.current import drift_current, ground_speed_text, roll_angle, turned_to_earth
from pymc_ship.trial.record import Channels, has_ground_speeds, sampling_interval

LEVER = 0.005  # lever arm over L from which it matters: error of v' per r'
LONGEST_LEVER = 0.6  # lever arm over L that a point on board can have
SEEN_LEVER = 0.05  # lever arm over L that a record must be able to show; in a steady turn it looks like an offset of v
BETTER = 3.0  # ratio of misfits from which velocities count as earth-fixed, or v as reversed in sign
FASTEST_CURRENT = 0.3  # over the speed of the ship
V_SCALE, V_UNIT = 0.25, 0.15  # error of a factor of v from which v is wrong; its logarithm, up to which it is a unit's
ACROSS = 0.035  # sway at no yaw over U, as of a drift angle of 2 deg, from which it is that of a current
_FEWEST_BLOCKS, _BOTH_SIDES = 20, 0.5  # blocks that show it; lesser over larger yaw rate to both sides
NO_SWAY = 0.1  # factor of v up to which the track has none
DRIFT_GOOD, DRIFT_BAD = (
    (0.05, 0.005),
    (0.25, 0.025),
)  # drift of the track over L, and over the distance; the larger counts


@dataclass(frozen=True)
class TrackBlocks:
    """Increments of a track over blocks of time [s] with mean heading psi, in the axes of that heading.

    ``speed`` [m/s] is the mean along the track.
    """

    blocks: Blocks
    interval: float
    psi: np.ndarray
    time: np.ndarray
    speed: float

    def fit(self, columns: list[np.ndarray], missing: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Least squares of missing increments (2, n_blocks - 1) beside offsets of the log, or a current.

        The offsets are constant in the axes of the ship, the current in those of the earth: the set that leaves less
        is taken, a current up to :data:`FASTEST_CURRENT` times the speed.
        """
        idle, north, east = np.zeros_like(self.time), self.time * np.cos(self.psi), self.time * np.sin(self.psi)
        sets = ((self.time, idle), (idle, self.time)), ((north, -east), (east, north))
        log, current = (least_squares([*columns, *map(np.concatenate, constant)], missing.ravel()) for constant in sets)
        slow = np.hypot(*current[0][-2:]) <= FASTEST_CURRENT * self.speed
        return current if slow and current[2] @ current[2] < log[2] @ log[2] else log

    def missing_velocity(self, residuals: np.ndarray) -> float:
        """Root mean square of a velocity [m/s] whose increments of the track are these residuals, of both axes."""
        return float(np.sqrt(2.0 * np.mean((residuals / np.tile(self.time, 2)) ** 2)))

    def increments(self, x: np.ndarray, y: np.ndarray) -> np.ndarray:
        """Increments of a track forward and to starboard of the mean heading, shape (2, n_blocks - 1)."""
        x, y, cos, sin = self.blocks.increments(x), self.blocks.increments(y), np.cos(self.psi), np.sin(self.psi)
        return np.array([cos * x + sin * y, cos * y - sin * x])

    def increments_of(self, x_dot: np.ndarray, y_dot: np.ndarray) -> np.ndarray:
        """Increments of the integral of an earth-fixed velocity."""
        return self.increments(integral(x_dot, self.interval), integral(y_dot, self.interval))

    def earth(self, increments: np.ndarray) -> np.ndarray:
        """Increments turned back to x and y."""
        cos, sin = np.cos(self.psi), np.sin(self.psi)
        forward, starboard = increments
        return np.array([cos * forward - sin * starboard, sin * forward + cos * starboard])


def track_blocks(trial: Channels, scale: ShipScale) -> tuple[TrackBlocks, np.ndarray]:
    """Blocks of a trial and the increments of its measured track."""
    blocks = ship_blocks(trial, scale, YAW_BLOCK)
    psi, time = blocks.middles(trial["psi"].values), blocks.increments(trial["time"].values)
    x, y = trial["x"].values, trial["y"].values
    speed = float(np.hypot(blocks.increments(x), blocks.increments(y)).sum() / time.sum())
    track = TrackBlocks(blocks, sampling_interval(trial), psi, time, speed)
    return track, track.increments(x, y)


def earth_velocity(trial: Channels, axes: str = "body", sign: float = 1.0) -> tuple[np.ndarray, np.ndarray]:
    """x_dot and y_dot [m/s] from u and v of a trial in body or earth axes."""
    u, v = trial["u"].values, sign * trial["v"].values
    return (u, v) if axes == "earth" else turned_to_earth(u, v, trial)


def body_velocity(trial: xr.Dataset) -> tuple[np.ndarray, np.ndarray]:
    """Body-fixed u and v [m/s] where those of the trial are x_dot and y_dot."""
    x_dot, y_dot, psi = trial["u"].values, trial["v"].values, trial["psi"].values
    cos, sin = np.cos(psi), np.sin(psi)
    return x_dot * cos + y_dot * sin, (y_dot * cos - x_dot * sin) / np.cos(roll_angle(trial))


def lever_column(trial: xr.Dataset, track: TrackBlocks) -> np.ndarray:
    """Increments of the track from a lever arm of 1 m."""
    rate, psi = trial["r"].values * np.cos(roll_angle(trial)), trial["psi"].values
    return track.increments_of(-rate * np.sin(psi), rate * np.cos(psi))


def axes_checks(trial: xr.Dataset, scale: ShipScale, late: Callable[[xr.Dataset], float]) -> tuple[Check, Check]:
    """Checks that u and v are body-fixed and v has the right sign, as the track shows; misfits in m/s.

    ``late`` gives the misfit of a trial with a late channel; a lag that leaves less precedes a sign or scale of v.
    """
    names = ("velocity axes", "sway sign")
    if reason := missing_channels_text(trial, ("x", "y", "psi", "u", "v", "r")):
        return not_checked(names[0], reason), not_checked(names[1], reason)
    track, measured = track_blocks(trial, scale)
    readings = ("body", 1.0), ("earth", 1.0), ("body", -1.0)
    body, earth, flipped = (_misfit(trial, track, measured, scale, *reading) for reading in readings)
    significant = body > 0.01 * scale.U
    numbers = (("misfit body-fixed", body, "m/s"), ("misfit earth-fixed", earth, "m/s"))
    axes = Check(names[0], "good", f"u and v are body-fixed: they miss the track by {body:.2g} m/s.", numbers)
    if significant and earth * BETTER < body and earth <= flipped:
        text = f"u and v miss the track by {body:.2g} m/s as body-fixed, by {earth:.2g} m/s as earth-fixed; turn them."
        return Check(names[0], "doubtful", text, numbers, mendable=True), not_checked(names[1], "u, v are earth-fixed")
    numbers = (("misfit", body, "m/s"), ("misfit flipped", flipped, "m/s"))
    backward = trial.assign(u=-trial["u"])
    for words, key, sign in (
        ("-u", "sign = -1 for u", 1.0),
        ("a heading off by 180 deg", "psi = { offset = 180 }", -1.0),
    ):
        reading = _misfit(backward, track, measured, scale, "body", sign)
        if significant and reading * BETTER < min(body, flipped):
            text = f"u and v miss the track by {body:.2g} m/s, with {words} by {reading:.2g} m/s; state {key}."
            return replace(axes, verdict="bad", sentence=text), not_checked(names[1], "the ship seems to go astern")
    if significant and (text := _sway_scale_text(trial, track, measured, scale, min(body, flipped), late)):
        return axes, Check(names[1], "bad", text, numbers)
    if significant and flipped * BETTER < body and min(flipped, late(trial.assign(v=-trial["v"]))) < late(trial):
        text = f"v misses the track by {body:.2g} m/s, -v by {flipped:.2g} m/s; flip its sign (starboard is positive)."
        return axes, Check(names[1], "bad", text, numbers)
    if flipped < BETTER * body or flipped < 0.01 * scale.U:
        return axes, not_checked(names[1], "v is too small or too uncertain to check its sign by the track", numbers)
    return axes, Check(names[1], "good", "v has the sign that leads to the track.", numbers)


def _sway_scale_text(
    trial: xr.Dataset,
    track: TrackBlocks,
    measured: np.ndarray,
    scale: ShipScale,
    misfit: float,
    late: Callable[[xr.Dataset], float],
) -> str:
    """Sentence on the factor of v that leads to the track, beside a lever arm and offsets; empty without one."""
    u, v = trial["u"].values, trial["v"].values
    missing = measured - track.increments_of(*turned_to_earth(u, 0.0 * v, trial))
    sway = track.increments_of(*turned_to_earth(0.0 * u, v, trial))
    (factor, lever, *_), (error, *_), _ = track.fit([sway.ravel(), lever_column(trial, track).ravel()], missing)
    if (
        factor <= -NO_SWAY
        or abs(lever) > LONGEST_LEVER * scale.L
        or abs(factor - 1.0) <= max(V_SCALE, SIGNIFICANT * error)
    ):
        return ""
    left = _misfit(trial.assign(v=factor * trial["v"]), track, measured, scale, "body", 1.0)
    if left * BETTER >= misfit or late(trial) <= left:
        return ""
    text = f"u and v miss the track by {misfit:.2g} m/s, with {factor:.3g} v by {left:.2g} m/s"
    if factor < NO_SWAY:
        return f"{text}: {COURSE}; take the heading of a compass."
    if words := speed_units(factor, V_UNIT)[0]:
        return f"{text}: v is probably {words.split(',')[0]}; state its unit."
    return f"{text}: check unit and calibration of v; a drift angle is no velocity."


def _misfit(
    trial: xr.Dataset, track: TrackBlocks, measured: np.ndarray, scale: ShipScale, axes: str, sign: float
) -> float:
    """Root mean square of the missing velocity [m/s] beside a lever arm and constant offsets."""
    missing = measured - track.increments_of(*earth_velocity(trial, axes, sign))
    lever, _, residuals = lever_fit(trial, track, missing)
    if abs(lever) > LONGEST_LEVER * scale.L:
        residuals = missing.ravel()
    return track.missing_velocity(residuals)


def track_misfit(trial: Channels, scale: ShipScale) -> float:
    """What u and v leave of the track over its size; 0 without a track."""
    if not trial.keys() >= {"x", "y", "psi", "u", "v"}:
        return 0.0
    track, measured = track_blocks(trial, scale)
    missing = measured - track.increments_of(*earth_velocity(trial))
    return float(np.sqrt(np.mean(missing**2) / max(np.mean(measured**2), 1e-300)))


def lever_fit(trial: xr.Dataset, track: TrackBlocks, missing: np.ndarray) -> tuple[float, float, np.ndarray]:
    """Lever arm [m], its standard error and the residuals, as :meth:`TrackBlocks.fit`."""
    coefficients, errors, residuals = track.fit([lever_column(trial, track).ravel()], missing)
    return float(coefficients[0]), float(errors[0]), residuals


def lever_check(trial: xr.Dataset, scale: ShipScale) -> Check:
    """Distance from the point whose velocity is measured forward to the point whose track is measured."""
    if reason := missing_channels_text(trial, ("x", "y", "psi", "u", "v", "r")):
        return not_checked("lever arm", reason)
    track, measured = track_blocks(trial, scale)
    lever, error, _ = lever_fit(trial, track, measured - track.increments_of(*earth_velocity(trial)))
    numbers = (("lever arm", lever, "m"), ("standard error", error, "m"), ("lever arm over L", lever / scale.L, ""))
    if abs(lever) > LONGEST_LEVER * scale.L:
        return not_checked("lever arm", f"the misfit is not that of a lever arm ({lever:.3g} m)", numbers)
    if abs(lever) <= SIGNIFICANT * error > SEEN_LEVER * scale.L:
        return not_checked("lever arm", f"its standard error is {error:.2g} m; use a zigzag", numbers)
    half_sample = 0.5 * scale.U * sampling_interval(trial)  # of travel, which the clock of a sensor explains
    if abs(lever) > SIGNIFICANT * error + half_sample and abs(lever) > LEVER * scale.L:
        side = "aft" if lever > 0.0 else "forward"
        text = f"v is measured {abs(lever):.3g} m {side} of the point of x, y (for an antenna off the origin, state "
        text += f"[frame] antenna = {lever:.3g}); move v there."
        return Check("lever arm", "doubtful", text, numbers, mendable=True)
    text = f"u, v and the track are of one point (lever arm {lever:.2g} m, error {error:.1g} m)."
    return Check("lever arm", "good", text, numbers)


def _drift_of_the_log(trial: xr.Dataset, least: float) -> str:
    """Sentence on a log that drifts with the track of a circle by more than ``least`` [m]; empty without one."""
    try:
        current = drift_current(trial)
    except TrialError:
        return ""
    duration = float(np.ptp(trial["time"].values))
    is_certain = current.speed > max(SIGNIFICANT * float(current.sd.max()), least / duration)
    return ground_speed_text(trial, current) if is_certain else ""


def _sway_at_no_yaw(trial: xr.Dataset, scale: ShipScale) -> tuple[float, float]:
    """Sway [m/s] without a turn and its standard error, infinite where the record does not show it.

    v = a r + b r|r| + c dr/dt + d, over blocks, of a ship that turns to both sides; else v = d on a straight approach.
    Speeds over ground have d in proportion to u, as by a heading that is off; their approach is another check's.
    """
    n, interval = straight_approach(trial), sampling_interval(trial)
    r, over_ground = trial["r"], has_ground_speeds(trial)
    turns = abs(float(r[: max(n, 1)].mean())) * scale.time > STRAIGHT_TURN
    blocks = ship_blocks(trial, scale, YAW_BLOCK)
    u, v, yaw = (blocks.middles(trial[name].values) for name in ("u", "v", "r"))
    if yaw.size >= _FEWEST_BLOCKS and balance(yaw, 0.02) >= _BOTH_SIDES:
        rate = blocks.middles(np.gradient(r.values, interval))
        columns = [yaw, yaw * np.abs(yaw), rate, u / np.median(u) if over_ground else np.ones_like(u)]
    elif over_ground or turns or (n - 1) * interval < SHORTEST_APPROACH * scale.time:
        return 0.0, np.inf
    else:
        columns, v = [np.ones(n)], trial["v"].values[:n]
    (*_, sway), (*_, error), _ = least_squares(columns, v)
    return float(sway), float(error)


def _current_across(trial: xr.Dataset, scale: ShipScale) -> str:
    """Sentence on a sway without a turn, of velocities that lead to the track; empty without one."""
    if not {"v", "r"} <= set(trial):
        return ""
    sway, error = _sway_at_no_yaw(trial, scale)
    if abs(sway) <= max(ACROSS * scale.U, SIGNIFICANT * error):
        return ""
    if has_ground_speeds(trial):
        off = float(np.rad2deg(np.arctan2(sway, np.median(trial["u"].values))))
        text = f"v over ground is {sway:+.2g} m/s where the ship does not turn: a current across, wind, or a magnetic "
        return f"{text}or misaligned heading; for that, state psi = {{ ..., offset = {off:.2g} }}."
    return (
        f"u and v lead to the track, but v is {sway:+.2g} m/s where the ship does not turn: a current across, and u, v "
        'over ground (state speeds = "over ground"), or wind. A current along the course the record does not show.'
    )


def drift_check(trial: xr.Dataset, scale: ShipScale) -> Check:
    """Drift of the integrated velocity from the track, with and without a current and a scale of the speed.

    Without v both are compared along the heading alone.
    """
    if reason := missing_channels_text(trial, ("x", "y", "psi", "u")):
        return not_checked("track closure", reason)
    track, measured = track_blocks(trial, scale)
    known = trial if "v" in trial else trial.assign(v=0.0 * trial["u"])
    predicted, distance = track.increments_of(*earth_velocity(known)), float(np.hypot(*measured).sum())
    time, seen = trial["time"].values, np.array([[1.0], [float("v" in trial)]])  # forward, to starboard
    constant = [track.increments(time, 0.0 * time), track.increments(0.0 * time, time)]
    missing, *columns = (track.earth(seen * rows) for rows in (measured - predicted, *constant, predicted))
    fit, _, residuals = least_squares([column.ravel() for column in columns], missing.ravel())
    drift, left = (float(np.hypot(*np.cumsum(rows, axis=1)).max()) for rows in (missing, residuals.reshape(2, -1)))
    numbers = (("drift", drift, "m"), ("drift over L", drift / scale.L, ""), ("unexplained", left, "m"))
    good, bad = (max(a * scale.L, b * distance) for a, b in (DRIFT_GOOD, DRIFT_BAD))
    text = f"The integrated velocity misses the track by {drift:.3g} m"
    text += "" if "v" in trial else " along the heading"
    if drift > good and left > bad:
        return Check("track closure", "bad", f"{text}, {left:.3g} m unexplained; do not fit it.", numbers)
    if words := _drift_of_the_log(trial, good):
        return Check("track closure", "doubtful", words, numbers)
    if drift <= good:
        if words := _current_across(trial, scale):
            return Check("track closure", "doubtful", words, numbers)
        return Check("track closure", "good", f"{text} at most, over {distance:.0f} m.", numbers)
    current = float(np.hypot(*fit[:2]))
    text += f"; a current or offset of {current:.2g} m/s and a scale of {1.0 + fit[2]:.3f} leave {left:.2g} m: "
    text += "use velocities through the water." if left <= good else "the position, or the log, probably slid."
    return Check("track closure", "doubtful", text, numbers)
