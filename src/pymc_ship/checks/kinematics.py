"""Kinematic closure of a trial: whether measured velocities lead to the measured heading, roll and track.

psi_dot = r cos phi, phi_dot = p, x_dot = u cos psi - v cos phi sin psi, y_dot = u sin psi + v cos phi cos psi. Both
sides are integrated and averaged over blocks of a share of L/U, and the increments from block to block regressed on
each other: the noise of a position or an angle is averaged, that of a velocity integrated, and the increments are close
to independent, so that ordinary standard errors hold.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import xarray as xr

from pymc_ship.checks.verdicts import (
    SIGNIFICANT,
    Blocks,
    Check,
    ShipScale,
    integral,
    not_checked,
    regressed,
    ship_blocks,
)
from pymc_ship.trial.record import sampling_interval

SCALE_DOUBTFUL, SCALE_BAD = 0.02, 0.1
"""Scale errors of a rate: gyros are good to 1 %, and a 10 % error in r changes what every coefficient of it means."""

SWAPPED = 0.5
"""Share of the changes of a rate that the integral of its angle may leave where the two columns are swapped."""

SPEED_BAD = 0.2
"""Scale error of the speed beyond which neither a current nor the calibration of a log explains it."""

HEADING_DRIFT = 0.2
"""Drift of the heading [deg] in five L/U, the window a model is scored on, from which a gyro offset matters."""

LEVER = 0.005
"""Lever arm over L from which it matters: v' is then off by as much per r', 1 to 2 % of its size in a turn."""

LONGEST_LEVER = 0.6
"""Lever arm over L that a point on board can have; what looks longer is no lever arm."""

SEEN_LEVER = 0.05
"""Lever arm over L that a record must be able to show; a steady turn cannot, where it looks like an offset of v."""

BETTER = 3.0
"""How many times smaller the misfit must be to believe in earth-fixed velocities or a flipped v."""

DRIFT_GOOD, DRIFT_BAD = (0.05, 0.005), (0.25, 0.025)
"""Drift of the integrated track over L, and over the distance sailed; the larger of the two counts."""

FACTORS = {
    0.514444: "knots taken for m/s",
    1.0 / 3.6: "km/h taken for m/s",
    0.3048: "ft/s taken for m/s",
    1.943844: "m/s that were converted as knots or a track in nautical units",
    3.6: "m/s that were converted as km/h",
    0.001: "a track in km, or speeds in mm/s",
    1000.0: "a track in mm, or speeds in km/s",
}
"""Track over velocity, and the mistake behind it."""

_RATE_CHECKS = {"r": ("yaw rate", "gyro offset"), "p": ("roll rate", "roll rate offset")}
_DEGREE = 180.0 / np.pi
_YAW_BLOCK, _ROLL_BLOCK = 0.25, 0.05  # share of L/U
_LOG_WIDTH = 0.05  # a ratio this near to a known factor is that factor


def rate_checks(trial: xr.Dataset, scale: ShipScale, rate: str, angle: str) -> tuple[Check, Check]:
    """Scale and sign, and offset, of r against psi or of p against phi.

    Parameters
    ----------
    trial : Dataset, dims (time,)
    scale : ShipScale
    rate, angle : str
        ``r`` and ``psi``, or ``p`` and ``phi``.

    Returns
    -------
    tuple of Check
        "yaw rate", "gyro offset" or "roll rate", "roll rate offset"; the offset is a number in deg/s.
    """
    name, offset_name = _RATE_CHECKS[rate]
    missing = [channel for channel in (rate, angle) if channel not in trial]
    if missing:
        reason = f"no {' and no '.join(missing)} in the record"
        return not_checked(name, reason), not_checked(offset_name, reason)
    blocks = ship_blocks(trial, scale, _YAW_BLOCK if rate == "r" else _ROLL_BLOCK)
    turning = trial[rate].values * (np.cos(_phi(trial)) if rate == "r" else 1.0)
    predicted = blocks.increments(integral(turning, sampling_interval(trial)))
    found, time = blocks.increments(trial[angle].values), blocks.increments(trial["time"].values)
    check = _rate_scale(rate, angle, *_slope(predicted, time, found))
    if check.verdict in ("bad", "not checked"):
        check = _swapped(trial, blocks, time, rate, angle) or check
        return check, not_checked(offset_name, f"the {name} does not lead to {angle}")
    drift = (predicted - found) / time
    error = drift.std(ddof=1) / np.sqrt(drift.size) + 0.1 * SCALE_DOUBTFUL * abs(turning.mean())
    return check, _rate_offset(rate, angle, drift.mean(), error, scale)


def _swapped(trial: xr.Dataset, blocks: Blocks, time: np.ndarray, rate: str, angle: str) -> Check | None:
    """Check that says that the columns of a rate and its angle are swapped; None where they are not."""
    predicted = blocks.increments(integral(trial[angle].values, sampling_interval(trial)))
    slope, error, left, size = _slope(predicted, time, blocks.increments(trial[rate].values))
    if abs(slope - 1.0) > SIGNIFICANT * error + SCALE_BAD or left > SWAPPED * size or error > SCALE_BAD:
        return None
    text = f"The integral of {angle} follows {rate} with a scale of {slope:.3g}: the two columns are swapped."
    return Check(_RATE_CHECKS[rate][0], "bad", text, (("scale of the swapped columns", slope, ""),))


def _slope(predicted: np.ndarray, time: np.ndarray, found: np.ndarray) -> tuple[float, float, float, float]:
    """Slope, its standard error, and root mean squares of residuals and response.

    In a steady turn an offset cannot be told from the slope; it is then left out and changes the slope by its share.
    """
    size = np.sqrt(np.mean(found**2))
    (slope, _), (error, _), residuals = regressed([predicted, time], found)
    if error > 0.01:
        (slope,), (error,), residuals = regressed([predicted], found)
    return float(slope), float(error), float(np.sqrt(np.mean(residuals**2))), float(size)


def _rate_scale(rate: str, angle: str, slope: float, error: float, left: float, size: float) -> Check:
    name, _ = _RATE_CHECKS[rate]
    numbers = (("scale", slope, ""), ("standard error", error, ""))
    if size == 0.0 or slope == 0.0:
        return not_checked(name, f"{angle if size == 0.0 else rate} does not change", numbers)
    if error > 0.2 * abs(slope):
        if left > 0.9 * size > np.deg2rad(1.0):
            text = f"The integral of {rate} does not follow {angle} at all; check which columns they are."
            return Check(name, "bad", text, numbers)
        return not_checked(name, f"{angle} changes too little to tell the scale of {rate}", numbers)
    if slope < 0.0:
        text = f"{rate} has the opposite sign of the change of {angle} (scale {slope:.3g}); flip {rate} or {angle}."
        return Check(name, "bad", text, numbers)
    if abs(abs(np.log(max(slope, 1e-99))) - np.log(_DEGREE)) < _LOG_WIDTH:
        culprit, unit = (angle, "deg") if slope > 1.0 else (rate, "deg/s")
        text = f"The change of {angle} is {slope:.4g} times the integral of {rate}: {culprit} is in {unit}; convert it."
        return Check(name, "bad", text, numbers)
    off, certain = abs(slope - 1.0), abs(slope - 1.0) > SIGNIFICANT * error
    if certain and off > SCALE_BAD:
        text = f"The change of {angle} is {slope:.4g} times the integral of {rate}; check units and calibration."
        return Check(name, "bad", text, numbers)
    if certain and off > SCALE_DOUBTFUL:
        text = f"The change of {angle} is {slope:.4g} times the integral of {rate}; check the calibration."
        return Check(name, "doubtful", text, numbers)
    return Check(name, "good", f"{rate} leads to {angle} with a scale of {slope:.4g}.", numbers)


def _rate_offset(rate: str, angle: str, offset: float, error: float, scale: ShipScale) -> Check:
    _, name = _RATE_CHECKS[rate]
    degrees, drift = np.rad2deg(offset), abs(np.rad2deg(offset)) * 5.0 * scale.time
    numbers = (
        ("offset", float(degrees), "deg/s"),
        ("standard error", float(np.rad2deg(error)), "deg/s"),
        ("drift in 5 L/U", float(drift), "deg"),
    )
    if abs(offset) > SIGNIFICANT * error and drift > HEADING_DRIFT:
        text = f"{rate} has an offset of {degrees:+.4f} deg/s against {angle}, {drift:.2g} deg in 5 L/U; subtract it."
        return Check(name, "doubtful", text, numbers, mendable=True)
    return Check(name, "good", f"{rate} has no offset that matters ({degrees:+.2g} deg/s).", numbers)


@dataclass(frozen=True)
class _Track:
    """Increments of a track over blocks of time [s] with mean heading psi, in the axes of that heading."""

    blocks: Blocks
    interval: float
    psi: np.ndarray
    time: np.ndarray

    def increments(self, x: np.ndarray, y: np.ndarray) -> np.ndarray:
        """Increments of a track forward and to starboard of the mean heading, shape (2, n_blocks - 1)."""
        x, y, cos, sin = self.blocks.increments(x), self.blocks.increments(y), np.cos(self.psi), np.sin(self.psi)
        return np.array([cos * x + sin * y, cos * y - sin * x])

    def sailed(self, x_dot: np.ndarray, y_dot: np.ndarray) -> np.ndarray:
        """The same of the integral of an earth-fixed velocity."""
        return self.increments(integral(x_dot, self.interval), integral(y_dot, self.interval))

    def earth(self, increments: np.ndarray) -> np.ndarray:
        """Increments turned back to x and y."""
        cos, sin = np.cos(self.psi), np.sin(self.psi)
        forward, starboard = increments
        return np.array([cos * forward - sin * starboard, sin * forward + cos * starboard])


def _phi(trial: xr.Dataset) -> np.ndarray:
    return trial["phi"].values if "phi" in trial else np.zeros(trial.sizes["time"])


def _track(trial: xr.Dataset, scale: ShipScale) -> tuple[_Track, np.ndarray]:
    """Blocks of a trial and the increments of its measured track."""
    blocks = ship_blocks(trial, scale, _YAW_BLOCK)
    psi, time = blocks.middles(trial["psi"].values), blocks.increments(trial["time"].values)
    track = _Track(blocks, sampling_interval(trial), psi, time)
    return track, track.increments(trial["x"].values, trial["y"].values)


def earth_velocity(trial: xr.Dataset, axes: str = "body", sign: float = 1.0) -> tuple[np.ndarray, np.ndarray]:
    """x_dot and y_dot [m/s] that u and v of a trial mean when they stand in body or earth axes."""
    u, v = trial["u"].values, sign * trial["v"].values
    if axes == "earth":
        return u, v
    psi, sway = trial["psi"].values, v * np.cos(_phi(trial))
    return u * np.cos(psi) - sway * np.sin(psi), u * np.sin(psi) + sway * np.cos(psi)


def body_velocity(trial: xr.Dataset) -> tuple[np.ndarray, np.ndarray]:
    """Body-fixed u and v [m/s] where those of the trial are x_dot and y_dot."""
    x_dot, y_dot, psi = trial["u"].values, trial["v"].values, trial["psi"].values
    sway = y_dot * np.cos(psi) - x_dot * np.sin(psi)
    return x_dot * np.cos(psi) + y_dot * np.sin(psi), sway / np.cos(_phi(trial))


def _lever_column(trial: xr.Dataset, track: _Track) -> np.ndarray:
    """What a lever arm of 1 m adds to the track."""
    rate, psi = trial["r"].values * np.cos(_phi(trial)), trial["psi"].values
    return track.sailed(-rate * np.sin(psi), rate * np.cos(psi))


def _needed(trial: xr.Dataset, channels: tuple[str, ...]) -> str:
    missing = [name for name in channels if name not in trial]
    return f"no {', '.join(missing)} in the record" if missing else ""


def heading_check(trial: xr.Dataset, scale: ShipScale) -> Check:
    """Heading against the course over ground: psi in deg or another frame (both r and psi may be wrong alike)."""
    if reason := _needed(trial, ("x", "y", "psi")):
        return not_checked("heading", reason)
    blocks = ship_blocks(trial, scale, _YAW_BLOCK)
    course = np.unwrap(np.arctan2(blocks.increments(trial["y"].values), blocks.increments(trial["x"].values)))
    psi = blocks.middles(trial["psi"].values)
    if psi.std() < np.deg2rad(2.0):
        return not_checked("heading", "the heading hardly changes")
    (slope, _), *_ = regressed([psi - psi.mean(), np.ones(psi.size)], course)
    numbers = (("course over heading", float(slope), ""),)
    if 0.3 < slope < 3.0:
        text = f"The course over ground changes with the heading ({slope:.3g} rad per rad)."
        return Check("heading", "good", text, numbers)
    text = f"The course over ground changes by {slope:.3g} rad per rad of heading; check unit and sign of psi, x and y."
    return Check("heading", "bad", text, numbers)


def speed_check(trial: xr.Dataset, scale: ShipScale) -> Check:
    """Speed over ground of the track over that of u and v: units, calibration, current."""
    if reason := _needed(trial, ("x", "y", "u", "v")):
        return not_checked("speed", reason)
    blocks, interval = ship_blocks(trial, scale, _YAW_BLOCK), sampling_interval(trial)
    distance = np.hypot(*(blocks.increments(trial[name].values) for name in ("x", "y"))).sum()
    sailed = blocks.increments(integral(np.hypot(trial["u"].values, trial["v"].values), interval)).sum()
    if not (sailed > 0.0 and distance > 0.0):
        return Check("speed", "bad", "The ship does not move; check u, v, x and y.")
    ratio = float(distance / sailed)
    numbers = (("track over velocity", ratio, ""),)
    for factor, mistake in FACTORS.items():
        if abs(np.log(ratio / factor)) < _LOG_WIDTH:
            text = f"The track is {ratio:.4g} times as long as u and v say, as of {mistake}; convert the column."
            return Check("speed", "bad", text, numbers)
    if abs(ratio - 1.0) > SPEED_BAD:
        text = f"The track is {ratio:.4g} times as long as u and v say; check the units of u, v, x, y and time."
        return Check("speed", "bad", text, numbers)
    if abs(ratio - 1.0) > SCALE_DOUBTFUL:
        text = f"The track is {ratio:.4g} times as long as u and v say: a current, or a log out of calibration."
        return Check("speed", "doubtful", text, numbers)
    return Check("speed", "good", f"The track is {ratio:.4g} times as long as u and v say.", numbers)


def axes_checks(trial: xr.Dataset, scale: ShipScale) -> tuple[Check, Check]:
    """Whether u and v are body-fixed and v has the right sign, from which reading of them leads to the track.

    Parameters
    ----------
    trial : Dataset, dims (time,)
    scale : ShipScale

    Returns
    -------
    tuple of Check
        "velocity axes" and "sway sign"; misfits in m/s.
    """
    names = ("velocity axes", "sway sign")
    if reason := _needed(trial, ("x", "y", "psi", "u", "v", "r")):
        return tuple(not_checked(name, reason) for name in names)
    track, measured = _track(trial, scale)
    readings = ("body", 1.0), ("earth", 1.0), ("body", -1.0)
    body, earth, flipped = (_misfit(trial, track, measured, scale, *reading) for reading in readings)
    seen = body > 0.01 * scale.U
    numbers = (("misfit body-fixed", body, "m/s"), ("misfit earth-fixed", earth, "m/s"))
    axes = Check(names[0], "good", f"u and v are body-fixed: they miss the track by {body:.2g} m/s.", numbers)
    if seen and earth * BETTER < body and earth <= flipped:
        text = f"u and v miss the track by {body:.2g} m/s as body-fixed, by {earth:.2g} m/s as earth-fixed; turn them."
        return Check(names[0], "doubtful", text, numbers, mendable=True), not_checked(names[1], "u, v are earth-fixed")
    numbers = (("misfit", body, "m/s"), ("misfit flipped", flipped, "m/s"))
    if seen and flipped * BETTER < body:
        text = f"v misses the track by {body:.2g} m/s, -v by {flipped:.2g} m/s; flip its sign (starboard is positive)."
        return axes, Check(names[1], "bad", text, numbers)
    if flipped < BETTER * body or flipped < 0.01 * scale.U:
        return axes, not_checked(names[1], "v is too small or too uncertain to tell its sign by the track", numbers)
    return axes, Check(names[1], "good", "v has the sign that leads to the track.", numbers)


def _misfit(trial: xr.Dataset, track: _Track, measured: np.ndarray, scale: ShipScale, axes: str, sign: float) -> float:
    """Root mean square of the velocity [m/s] that is missing when a lever arm and constant offsets are allowed for."""
    missing = measured - track.sailed(*earth_velocity(trial, axes, sign))
    lever, _, residuals = _lever(trial, track, missing)
    if abs(lever) > LONGEST_LEVER * scale.L:
        residuals = missing.ravel()
    return float(np.sqrt(2.0 * np.mean((residuals / np.tile(track.time, 2)) ** 2)))


def _lever(trial: xr.Dataset, track: _Track, missing: np.ndarray) -> tuple[float, float, np.ndarray]:
    """Lever arm [m], its standard error and the residuals, beside constant offsets of both velocities."""
    idle = np.zeros_like(track.time)
    columns = [
        _lever_column(trial, track).ravel(),
        np.concatenate([track.time, idle]),
        np.concatenate([idle, track.time]),
    ]
    coefficients, errors, residuals = regressed(columns, missing.ravel())
    return float(coefficients[0]), float(errors[0]), residuals


def lever_check(trial: xr.Dataset, scale: ShipScale) -> Check:
    """Distance from the point whose velocity is measured forward to the point whose track is measured."""
    if reason := _needed(trial, ("x", "y", "psi", "u", "v", "r")):
        return not_checked("lever arm", reason)
    track, measured = _track(trial, scale)
    lever, error, _ = _lever(trial, track, measured - track.sailed(*earth_velocity(trial)))
    numbers = (("lever arm", lever, "m"), ("standard error", error, "m"), ("lever arm over L", lever / scale.L, ""))
    if abs(lever) > LONGEST_LEVER * scale.L:
        return not_checked("lever arm", f"what the track misses is no lever arm ({lever:.3g} m)", numbers)
    if abs(lever) <= SIGNIFICANT * error > SEEN_LEVER * scale.L:
        return not_checked("lever arm", f"the record tells it to {error:.2g} m only, a zigzag tells it better", numbers)
    if abs(lever) > SIGNIFICANT * error and abs(lever) > LEVER * scale.L:
        side = "aft" if lever > 0.0 else "forward"
        text = f"v is that of a point {abs(lever):.3g} m {side} of the one whose track is x, y; move it there."
        return Check("lever arm", "doubtful", text, numbers, mendable=True)
    text = f"u, v and the track are those of one point (lever arm {lever:.2g} m, error {error:.1g} m)."
    return Check("lever arm", "good", text, numbers)


def drift_check(trial: xr.Dataset, scale: ShipScale) -> Check:
    """Drift of the integrated velocity from the track, and what a current and a scale of the speed leave of it."""
    if reason := _needed(trial, ("x", "y", "psi", "u", "v")):
        return not_checked("track closure", reason)
    track, measured = _track(trial, scale)
    predicted = track.sailed(*earth_velocity(trial))
    missing, sailed = track.earth(measured - predicted), float(np.hypot(*measured).sum())
    idle = np.zeros_like(track.time)
    constant = [np.concatenate([track.time, idle]), np.concatenate([idle, track.time])]
    fit, _, residuals = regressed([*constant, track.earth(predicted).ravel()], missing.ravel())
    drift, left = (float(np.hypot(*np.cumsum(rows, axis=1)).max()) for rows in (missing, residuals.reshape(2, -1)))
    numbers = (("drift", drift, "m"), ("drift over L", drift / scale.L, ""), ("unexplained", left, "m"))
    good, bad = (max(a * scale.L, b * sailed) for a, b in (DRIFT_GOOD, DRIFT_BAD))
    if drift <= good:
        text = f"The integrated velocity misses the track by at most {drift:.2g} m over {sailed:.0f} m."
        return Check("track closure", "good", text, numbers)
    if left > bad:
        text = (
            f"The integrated velocity misses the track by {drift:.3g} m, {left:.3g} m of it unexplained; do not fit it."
        )
        return Check("track closure", "bad", text, numbers)
    current = float(np.hypot(*fit[:2]))
    text = (
        f"The integrated velocity misses the track by {drift:.3g} m; a current or offset of {current:.2g} m/s and a "
        f"scale of {1.0 + fit[2]:.3f} leave {left:.2g} m: use velocities through the water."
    )
    return Check("track closure", "doubtful", text, numbers)
