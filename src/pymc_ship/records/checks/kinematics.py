"""Kinematic closure of a trial, psi_dot = r cos phi and phi_dot = p, and the length of the track against the speed.

Both sides are integrated and averaged over blocks; their increments between blocks are regressed on each other.
"""

from __future__ import annotations

import numpy as np
import xarray as xr

from pymc_ship.records.checks.verdicts import (
    SIGNIFICANT,
    SLOW,
    Blocks,
    Check,
    Numbers,
    ShipScale,
    integral,
    least_squares,
    longest_piece,
    missing_channels_text,
    not_checked,
    ship_blocks,
)
from pymc_ship.trial.record import sampling_interval

SCALE_DOUBTFUL, SCALE_BAD = 0.02, 0.1  # scale error of a rate from which it is doubtful, and from which it is bad
SWAPPED = 0.5  # largest residual, as fraction of the changes of a rate, from which two columns count as swapped
SPEED_BAD = 0.2  # scale error of the speed from which it is bad: larger than by a current or a log
HEADING_DRIFT = 0.2  # drift of the heading [deg] in five L/U from which a gyro offset matters
YAW_BLOCK = 0.25  # averaging time of yaw and track, in L/U
FACTORS = {
    0.514444: "knots taken for m/s",
    1.0 / 3.6: "km/h taken for m/s",
    0.3048: "ft/s taken for m/s",
    1.943844: "m/s that were converted as knots or a track in nautical units",
    3.6: "m/s that were converted as km/h",
    0.001: "a track in km, or speeds in mm/s",
    1000.0: "a track in mm, or speeds in km/s",
}
"""Ratio of track to velocity, and the probable mistake."""

_RATE_CHECKS = {"r": ("yaw rate", "gyro offset"), "p": ("roll rate", "roll rate offset")}
_DEGREE = 180.0 / np.pi
_ROLL_BLOCK = 0.05  # L/U
_LOG_WIDTH = 0.05  # a ratio this near to a known factor is that factor


def rate_checks(trial: xr.Dataset, scale: ShipScale, rate: str, angle: str) -> tuple[Check, Check]:
    """Checks of scale and sign, and of the offset [deg/s], of r against psi or of p against phi."""
    name, offset_name = _RATE_CHECKS[rate]
    if reason := missing_channels_text(trial, (rate, angle)):
        return not_checked(name, reason), not_checked(offset_name, reason)
    blocks = ship_blocks(trial, scale, YAW_BLOCK if rate == "r" else _ROLL_BLOCK)
    turning = trial[rate].values * (np.cos(heel(trial)) if rate == "r" else 1.0)
    predicted = blocks.increments(integral(turning, sampling_interval(trial)))
    measured, time = blocks.increments(trial[angle].values), blocks.increments(trial["time"].values)
    check = _rate_scale(rate, angle, *_slope(predicted, time, measured))
    if check.verdict in ("bad", "not checked"):
        check = _swap_check(trial, blocks, time, rate, angle) or check
        return check, not_checked(offset_name, f"the integral of the {name} does not match {angle}")
    drift = (predicted - measured) / time
    error = drift.std(ddof=1) / np.sqrt(drift.size) + 0.1 * SCALE_DOUBTFUL * abs(turning.mean())
    return check, _rate_offset(rate, angle, drift.mean(), error, scale)


def _swap_check(trial: xr.Dataset, blocks: Blocks, time: np.ndarray, rate: str, angle: str) -> Check | None:
    """Check of swapped columns of a rate and its angle; None if they are not swapped."""
    predicted = blocks.increments(integral(trial[angle].values, sampling_interval(trial)))
    slope, error, left, size = _slope(predicted, time, blocks.increments(trial[rate].values))
    if abs(slope - 1.0) > SIGNIFICANT * error + SCALE_BAD or left > SWAPPED * size or error > SCALE_BAD:
        return None
    text = f"The integral of {angle} follows {rate} with a scale of {slope:.3g}: the two columns are swapped."
    return Check(_RATE_CHECKS[rate][0], "bad", text, (("scale of the swapped columns", slope, ""),))


def _slope(predicted: np.ndarray, time: np.ndarray, measured: np.ndarray) -> tuple[float, float, float, float]:
    """Slope, its standard error, root mean squares of residuals and response; without an offset in a steady turn."""
    size = np.sqrt(np.mean(measured**2))
    (slope, _), (error, _), residuals = least_squares([predicted, time], measured)
    if error > 0.01:
        (slope,), (error,), residuals = least_squares([predicted], measured)
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
        return not_checked(name, f"{angle} changes too little for an estimate of the scale of {rate}", numbers)
    if slope < 0.0:
        text = f"{rate} has the opposite sign of the change of {angle} (scale {slope:.3g}); flip {rate} or {angle}."
        return Check(name, "bad", text, numbers)
    if abs(abs(np.log(max(slope, 1e-99))) - np.log(_DEGREE)) < _LOG_WIDTH:
        culprit, unit = (angle, "deg") if slope > 1.0 else (rate, "deg/s")
        text = f"The change of {angle} is {slope:.4g} times the integral of {rate}: {culprit} is in {unit}; convert it."
        return Check(name, "bad", text, numbers)
    off = abs(slope - 1.0)
    if off > SIGNIFICANT * error and off > SCALE_DOUBTFUL:
        verdict, cause = ("bad", "units and calibration") if off > SCALE_BAD else ("doubtful", "the calibration")
        text = f"The change of {angle} is {slope:.4g} times the integral of {rate}; check {cause}."
        return Check(name, verdict, text, numbers)
    return Check(name, "good", f"The integral of {rate} matches {angle} with a scale of {slope:.4g}.", numbers)


def _rate_offset(rate: str, angle: str, offset: float, error: float, scale: ShipScale) -> Check:
    _, name = _RATE_CHECKS[rate]
    degrees, drift = np.rad2deg(offset), abs(np.rad2deg(offset)) * 5.0 * scale.time
    numbers: Numbers = (("offset", float(degrees), "deg/s"), ("standard error", float(np.rad2deg(error)), "deg/s"))
    numbers += (("drift in 5 L/U", float(drift), "deg"),)
    if abs(offset) > SIGNIFICANT * error and drift > HEADING_DRIFT:
        text = f"{rate} has an offset of {degrees:+.4f} deg/s against {angle}, {drift:.2g} deg in 5 L/U; subtract it."
        return Check(name, "doubtful", text, numbers, mendable=True)
    return Check(name, "good", f"{rate} has no offset that matters ({degrees:+.2g} deg/s).", numbers)


def heel(trial: xr.Dataset) -> np.ndarray:
    """Roll angle [rad] of a trial, 0 if not measured."""
    return trial["phi"].values if "phi" in trial else np.zeros(trial.sizes["time"])


def heading_check(trial: xr.Dataset, scale: ShipScale) -> Check:
    """Heading against the course over ground: psi in deg or another frame (both r and psi may be wrong alike)."""
    if reason := missing_channels_text(trial, ("x", "y", "psi")):
        return not_checked("heading", reason)
    blocks = ship_blocks(trial, scale, YAW_BLOCK)
    course = np.arctan2(*(blocks.increments(trial[name].values) for name in ("y", "x")))
    piece = _under_way(trial, blocks)
    course, psi = np.unwrap(course[piece]), blocks.middles(trial["psi"].values)[piece]
    if psi.size < 10 or psi.std() < np.deg2rad(2.0):
        return not_checked("heading", "the heading hardly changes while the ship is under way")
    (slope, _), *_ = least_squares([psi - psi.mean(), np.ones(psi.size)], course)
    numbers = (("course over heading", float(slope), ""),)
    if 0.3 < slope < 3.0:
        text = f"The course over ground changes with the heading ({slope:.3g} rad per rad)."
        return Check("heading", "good", text, numbers)
    text = f"The course over ground changes by {slope:.3g} rad per rad of heading; check unit and sign of psi, x and y."
    return Check("heading", "bad", text, numbers)


def _under_way(trial: xr.Dataset, blocks: Blocks) -> slice:
    """Longest piece of a track, in blocks, in which the ship makes way ahead."""
    speed = np.hypot(*(blocks.increments(trial[name].values) for name in ("x", "y")))
    moving = speed > SLOW * np.quantile(speed, 0.95)
    if "u" in trial:
        moving &= blocks.middles(trial["u"].values) > 0.0
    return longest_piece(moving)


def speed_check(trial: xr.Dataset, scale: ShipScale) -> Check:
    """Speed over ground of the track over that of u and v: units, calibration, current."""
    if reason := missing_channels_text(trial, ("x", "y", "u", "v")):
        return not_checked("speed", reason)
    blocks, interval = ship_blocks(trial, scale, YAW_BLOCK), sampling_interval(trial)
    distance = np.hypot(*(blocks.increments(trial[name].values) for name in ("x", "y"))).sum()
    distance_from_speed = blocks.increments(integral(np.hypot(trial["u"].values, trial["v"].values), interval)).sum()
    if not (distance_from_speed > 0.0 and distance > 0.0):
        return Check("speed", "bad", "The ship does not move; check u, v, x and y.")
    ratio = float(distance / distance_from_speed)
    numbers = (("track over velocity", ratio, ""),)
    for factor, mistake in FACTORS.items():
        if abs(np.log(ratio / factor)) < _LOG_WIDTH:
            text = f"The track is {ratio:.4g} times the distance from u and v, as of {mistake}; convert the column."
            return Check("speed", "bad", text, numbers)
    if abs(ratio - 1.0) > SPEED_BAD:
        text = f"The track is {ratio:.4g} times the distance from u and v; check the units of u, v, x, y and time."
        return Check("speed", "bad", text, numbers)
    if abs(ratio - 1.0) > SCALE_DOUBTFUL:
        text = f"The track is {ratio:.4g} times the distance from u and v: a current, or a log out of calibration."
        return Check("speed", "doubtful", text, numbers)
    return Check("speed", "good", f"The track is {ratio:.4g} times the distance from u and v.", numbers)
