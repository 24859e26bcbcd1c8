"""Kinematic closure of a trial, psi_dot = r cos phi and phi_dot = p, and the length of the track against the speed.

Both sides are integrated and averaged over blocks; their increments between blocks are regressed on each other.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial

import numpy as np
import xarray as xr

from pymc_ship.records.checks.mistakes import COURSE, UNEXPLAINED, Mistake, explanation, speed_units
from pymc_ship.records.checks.verdicts import (
    SLOW,
    Check,
    Numbers,
    integral,
    longest_piece,
    missing_channels_text,
    not_checked,
    straight_approach,
)
from pymc_ship.records.files.ship_scale import SIGNIFICANT, Blocks, ShipScale, least_squares, ship_blocks
from pymc_ship.records.steering.current import roll_angle
from pymc_ship.trial.record import Channels, has_ground_speeds, sampling_interval, second_difference_sd, unwrapped

SCALE_DOUBTFUL, SCALE_BAD = 0.02, 0.1  # scale error of a rate from which it is doubtful, and from which it is bad
RESIDUAL_SUSPECT = 0.03  # residual of a rate over the changes of its angle from which a known mistake is sought
RESIDUAL_MATCH, RESIDUAL_BAD = 0.1, 0.5  # such a residual up to which the rate matches; from which it is bad
NOISE_FACTOR = 3.0  # ratio of a residual to the noise of the record from which it is more than noise
OUTLIER_FRACTION = 0.25  # largest fraction of the blocks that is left out as outliers
SPEED_BAD = 0.2  # scale error of the speed from which it is bad: larger than by a current or a log
SMOOTHED = 0.1  # standard deviation [L/U] of a smoother from which r or psi is doubted
HEADING_DRIFT = 0.2  # drift of the heading [deg] in five L/U from which a gyro offset matters
MISALIGNED = 0.35  # rad, largest deviation of a compass
NO_DRIFT = 0.1  # drift angle over rL/U up to which the point of the track has none; ships: 0.3 to 0.7 at midship
HEADING_OFF = 2.0  # difference of course and heading [deg] on a straight approach from which it is doubtful
CROSS_CURRENT = 1.0  # current [m/s] across the course, or leeway, that no trial is made in
SHORTEST_APPROACH, STRAIGHT_TURN = 0.25, 0.03  # approach in L/U, and change of heading [rad] in L/U on it
YAW_BLOCK = 0.25  # averaging time of yaw and track, in L/U
_RATE_CHECKS = {"r": ("yaw rate", "gyro offset"), "p": ("roll rate", "roll rate offset")}
_GON = 0.9  # deg in a gon; a mistake too small beside the drift angle for a ratio of misfits
_ROLL_BLOCK = 0.05  # L/U
SAME_SCALE = 0.15  # relative difference of the logarithms of two scales up to which they are of one clock
_Mistakes = tuple[Mistake, ...]
_LOG_WIDTH = 0.05  # a ratio this near to a known factor is that factor


def rate_checks(trial: xr.Dataset, scale: ShipScale, rate: str, angle: str) -> tuple[Check, Check]:
    """Checks of scale and sign, and of the offset [deg/s], of r against psi or of p against phi."""
    name, offset_name = _RATE_CHECKS[rate]
    if reason := missing_channels_text(trial, (rate, angle)):
        return not_checked(name, reason), not_checked(offset_name, reason)
    blocks = ship_blocks(trial, scale, YAW_BLOCK if rate == "r" else _ROLL_BLOCK)
    turning = trial[rate].values * (np.cos(roll_angle(trial)) if rate == "r" else 1.0)
    predicted = blocks.increments(integral(turning, sampling_interval(trial)))
    measured, time = blocks.increments(trial[angle].values), blocks.increments(trial["time"].values)
    noise = _increment_noise(trial, turning, trial[angle].values, blocks.size)
    fit = _rate_fit(predicted, time, measured, noise)

    def explain(*, rate_alone: bool) -> tuple[_Mistakes, str]:
        alone = partial(_rate_misfit, scale=scale, rate=rate, angle=angle)
        return explanation(trial, (rate, angle), alone if rate_alone else _misfit(trial, scale))

    check = _rate_scale_check(rate, angle, fit, explain)
    if check.verdict in ("bad", "not checked"):
        return check, not_checked(offset_name, f"the integral of the {name} does not match {angle}")
    if check.verdict == "good" and not fit.used.all():
        out = np.flatnonzero(~fit.used) * blocks.size
        begin, end = (
            float(trial["time"].values[k]) for k in (out[0], min(out[-1] + 2 * blocks.size, turning.size) - 1)
        )
        text = f"The integral of {rate} does not follow {angle} in {np.mean(~fit.used):.0%} of the record, between "
        check = replace(check, verdict="doubtful", sentence=f"{text}{begin:.4g} and {end:.4g} s; cut that part out.")
    if check.verdict == "good" and rate == "r":
        text = _smoothing_text(trial, turning, scale)
        check = replace(check, verdict="doubtful", sentence=text) if text else check
    drift = ((predicted - measured) / time)[fit.used]
    error = drift.std(ddof=1) / np.sqrt(drift.size) + 0.1 * SCALE_DOUBTFUL * abs(turning.mean())
    return check, _rate_offset_check(rate, angle, drift.mean(), error, scale)


def _smoothing_text(trial: xr.Dataset, turning: np.ndarray, scale: ShipScale) -> str:
    """Sentence on r or psi smoothed to both sides, beside scale, offset and lag of r; empty without it.

    The integral of a rate smoothed with a standard deviation s exceeds the angle by s^2/2 times the acceleration.
    """
    blocks, interval = ship_blocks(trial, scale, YAW_BLOCK), sampling_interval(trial)
    columns = (integral(turning, interval), trial["time"].values, turning, np.gradient(turning, interval))
    (*_, slope), (*_, error), _ = least_squares(
        [blocks.increments(column) for column in columns], blocks.increments(trial["psi"].values)
    )
    width = float(np.sqrt(2.0 * abs(slope)))
    if abs(slope) <= SIGNIFICANT * error or width <= SMOOTHED * scale.time:
        return ""
    late, early, remedy = ("r", "psi", "take r from psi") if slope < 0.0 else ("psi", "r", "leave psi out")
    return (
        f"{late} changes less abruptly than {early}: it is smoothed to both sides, over a standard deviation of "
        f"{width:.2g} s; take the raw column, or {remedy}."
    )


def _increment_noise(trial: xr.Dataset, rate: np.ndarray, angle: np.ndarray, size: int) -> float:
    """Standard deviation of an increment of an angle less that of its integrated rate, from the noise of samples."""
    rate_sd, angle_sd = second_difference_sd(np.array([rate, angle], dtype=float))
    rate_step, angle_step = (_step(values) / np.sqrt(12.0) for values in (rate, angle))
    angle_noise = np.hypot(angle_sd / np.sqrt(size), angle_step)
    rate_noise = np.hypot(rate_sd / np.sqrt(size), rate_step)
    return float(np.hypot(np.sqrt(2.0) * angle_noise, rate_noise * size * sampling_interval(trial)))


def _step(values: np.ndarray) -> float:
    """Smallest difference of neighbours, the step of a rounded channel; 0 where they never differ."""
    differences = np.abs(np.diff(values))
    return float(np.min(differences, where=differences > 0.0, initial=np.inf)) if differences.any() else 0.0


@dataclass(frozen=True)
class RateFit:
    """Slope of an angle on its integrated rate, with its error; rms of residuals, of angle changes and of noise.

    ``predicted_sd`` is the sd of the changes by the rate; ``used`` are the blocks of the fit.
    """

    slope: float
    error: float
    residual_rms: float
    angle_rms: float
    noise: float
    predicted_sd: float
    used: np.ndarray


def _rate_fit(predicted: np.ndarray, time: np.ndarray, measured: np.ndarray, noise: float) -> RateFit:
    """Slope beside an offset, without one in a steady turn; blocks far off are left out where they are few."""
    angle_rms = float(np.sqrt(np.mean(measured**2)))
    least = max(noise, 0.5 * RESIDUAL_MATCH * angle_rms)
    large = np.abs(predicted) > np.median(np.abs(predicted))
    slope, offset = float(np.median(measured[large] / predicted[large])) if large.any() else 0.0, 0.0
    for _ in range(3):
        away = np.abs(measured - slope * predicted - offset * time)
        used = away <= SIGNIFICANT * max(1.5 * float(np.median(away)), least)
        used |= np.mean(used) < 1.0 - OUTLIER_FRACTION
        (slope, offset), (error, _), residual = least_squares([predicted[used], time[used]], measured[used])
        if error > 0.01:
            (slope,), (error,), residual = least_squares([predicted[used]], measured[used])
            offset = 0.0
    residual_rms, predicted_sd = float(np.sqrt(np.mean(residual**2))), float(predicted.std())
    return RateFit(float(slope), float(error), residual_rms, angle_rms, noise, predicted_sd=predicted_sd, used=used)


def _rate_scale_check(rate: str, angle: str, fit: RateFit, explain: Callable[..., tuple[_Mistakes, str]]) -> Check:
    """Check of the slope and of its residual; ``explain`` returns known mistakes behind it, and words on them."""
    name, _ = _RATE_CHECKS[rate]
    slope, error, off = fit.slope, fit.error, abs(fit.slope - 1.0)
    numbers = (("scale", slope, ""), ("standard error", error, ""))
    if fit.angle_rms == 0.0 or slope == 0.0:
        return not_checked(name, f"{angle if fit.angle_rms == 0.0 else rate} does not change", numbers)
    relative, noise = fit.residual_rms / fit.angle_rms, NOISE_FACTOR * fit.noise
    follows = fit.residual_rms <= max(RESIDUAL_MATCH * fit.angle_rms, noise)
    if max(fit.angle_rms, fit.predicted_sd) < noise or (follows and error > 0.2 * max(abs(slope), 1.0)):
        return not_checked(name, f"{angle} changes too little for an estimate of the scale of {rate}", numbers)
    differs = off > SIGNIFICANT * error
    is_wrong = not follows or (differs and off > SCALE_BAD)
    leaves_more_than_noise = fit.residual_rms > max(RESIDUAL_SUSPECT * fit.angle_rms, noise)
    mistakes: _Mistakes = ()
    cause = UNEXPLAINED
    if is_wrong or leaves_more_than_noise:
        mistakes, cause = explain(rate_alone=not is_wrong)
    if is_wrong or mistakes:
        is_gradual = len(mistakes) == 1 and mistakes[0].gradual
        slight = relative < RESIDUAL_BAD and (is_gradual or not (mistakes or differs))
        verdict = "doubtful" if slight else "bad"
        if not mistakes and angle == "psi" and abs(slope * _GON - 1.0) < SIGNIFICANT * error:
            cause = 'perhaps psi is gon that was converted as deg: state unit = "gon"'
        cause += "" if mistakes else "; check units and calibration"
        text = f"The change of {angle} is {slope:.4g} times the integral of {rate}, and {relative:.0%} of it"
        return Check(name, verdict, f"{text} is left over; {cause}.", numbers)
    if differs and off > SCALE_DOUBTFUL:
        text = f"The change of {angle} is {slope:.4g} times the integral of {rate}; check the calibration."
        return Check(name, "doubtful", text, numbers)
    return Check(name, "good", f"The integral of {rate} matches {angle} with a scale of {slope:.4g}.", numbers)


def _misfit(record: xr.Dataset, scale: ShipScale) -> Callable[[Channels], float]:
    """Root mean square of what the channels leave of each other, rate by angle and heading by course, over its size.

    It is of a record with mended channels; parts without one of these are computed once.
    """
    channels: Channels = dict(record.variables)
    parts: list[tuple[set[str], Callable[[Channels], float]]] = [
        ({rate, angle}, partial(_rate_misfit, scale=scale, rate=rate, angle=angle))
        for rate, angle in (("r", "psi"), ("p", "phi"))
    ]
    parts.append(({"x", "y", "psi"}, partial(_course_misfit, scale=scale)))
    known = [(names, part, part(channels)) for names, part in parts if channels.keys() >= names]

    def misfit(mended: Channels) -> float:
        other = {name for name in channels.keys() - {"time"} if mended[name].values is not channels[name].values}
        read_by_all = other & {"phi", "u"}  # of the rate of turn, of the way ahead
        left = [part(mended) if read_by_all or other & names else value for names, part, value in known]
        return float(np.sqrt(np.mean(np.square(left)))) if left else 0.0

    return misfit


def _rate_misfit(trial: Channels, scale: ShipScale, rate: str, angle: str) -> float:
    blocks = ship_blocks(trial, scale, YAW_BLOCK if rate == "r" else _ROLL_BLOCK)
    turning = trial[rate].values * (np.cos(roll_angle(trial)) if rate == "r" else 1.0)
    predicted = blocks.increments(integral(turning, sampling_interval(trial)))
    measured = blocks.increments(unwrapped(trial[angle].values))
    return _relative_rms(measured - predicted, measured)


def _course_misfit(trial: Channels, scale: ShipScale) -> float:
    """What the heading leaves of the course over ground beside a drift angle in proportion to the rate of turn.

    A misaligned compass explains a constant difference up to :data:`MISALIGNED`.
    """
    course, psi = _course(trial, scale)
    if psi.size < 10:
        return 0.0
    (_, offset), _, residual = least_squares([np.gradient(course), np.ones(psi.size)], course - psi)
    offset = np.angle(np.exp(1j * offset))
    return _relative_rms(residual + offset - np.clip(offset, -MISALIGNED, MISALIGNED), course - course.mean())


def _relative_rms(residual: np.ndarray, signal: np.ndarray) -> float:
    """Root mean square of residuals over that of the signal, up to 1."""
    return float(min(1.0, np.sqrt(np.mean(residual**2) / max(np.mean(signal**2), 1e-300))))


def _rate_offset_check(rate: str, angle: str, offset: float, error: float, scale: ShipScale) -> Check:
    _, name = _RATE_CHECKS[rate]
    degrees, drift = np.rad2deg(offset), abs(np.rad2deg(offset)) * 5.0 * scale.time
    numbers: Numbers = (("offset", float(degrees), "deg/s"), ("standard error", float(np.rad2deg(error)), "deg/s"))
    numbers += (("drift in 5 L/U", float(drift), "deg"),)
    if abs(offset) > SIGNIFICANT * error and drift > HEADING_DRIFT:
        text = f"{rate} has an offset of {degrees:+.4f} deg/s against {angle}, {drift:.2g} deg in 5 L/U; subtract it."
        return Check(name, "doubtful", text, numbers, mendable=True)
    return Check(name, "good", f"{rate} has no offset that matters ({degrees:+.2g} deg/s).", numbers)


def heading_check(trial: xr.Dataset, scale: ShipScale) -> Check:
    """Heading against the course over ground: psi in deg or another frame (both r and psi may be wrong alike)."""
    if reason := missing_channels_text(trial, ("x", "y", "psi")):
        return not_checked("heading", reason)
    course, psi = _course(trial, scale)
    if psi.size < 10 or psi.std() < np.deg2rad(2.0):
        return not_checked("heading", "the heading hardly changes while the ship is under way")
    (slope, _), *_ = least_squares([psi - psi.mean(), np.ones(psi.size)], course)
    numbers = (("course over heading", float(slope), ""),)
    if 0.3 < slope < 3.0 and (text := _no_drift_text(trial, scale, psi, psi - course)):
        return Check("heading", "doubtful", text, numbers)
    if 0.3 < slope < 3.0:
        text = f"The course over ground changes with the heading ({slope:.3g} rad per rad)."
        return Check("heading", "good", text, numbers)
    _, cause = explanation(trial, ("psi", "r", "x", "y"), _misfit(trial, scale))
    text = f"The course over ground changes by {slope:.3g} rad per rad of heading; check unit and sign of psi, x and y"
    return Check("heading", "bad", f"{text}: {cause}.", numbers)


def _no_drift_text(trial: xr.Dataset, scale: ShipScale, psi: np.ndarray, drift: np.ndarray) -> str:
    """Sentence on a course that shows no drift angle in a turn, by heading and drift angle in blocks; else empty."""
    if not scale.known:
        return ""
    interval = ship_blocks(trial, scale, YAW_BLOCK).size * sampling_interval(trial)
    turning = np.gradient(psi, interval / scale.time)  # rL/U
    throughout = np.quantile(np.abs(turning), 0.05) > 0.5 * np.abs(turning).max()  # shows the ratio, and no slope
    columns = [] if throughout else [np.ones(drift.size)]
    columns += [np.cos(psi), np.sin(psi)] if np.ptp(psi) > 2.0 * np.pi else []  # of a current
    (slope, *_), (error, *_), _ = least_squares([turning, *columns], drift)
    if slope + SIGNIFICANT * error > NO_DRIFT:
        return ""
    text = f"The course over ground has a drift angle of {slope:.2g} rL/U (ships: 0.3 to 0.7): {COURSE}, or the "
    return f"{text}antenna stands at the pivot point; take the heading of a compass, or state [frame] antenna."


def _course(trial: Channels, scale: ShipScale) -> tuple[np.ndarray, np.ndarray]:
    """Course over ground and heading [rad] of the longest piece under way, in blocks."""
    blocks = ship_blocks(trial, scale, YAW_BLOCK)
    course = np.arctan2(*(blocks.increments(trial[name].values) for name in ("y", "x")))
    piece = _under_way(trial, blocks)
    return np.unwrap(course[piece]), blocks.middles(trial["psi"].values)[piece]


def _under_way(trial: Channels, blocks: Blocks) -> slice:
    """Longest piece of a track, in blocks, in which the ship makes way ahead."""
    speed = np.hypot(*(blocks.increments(trial[name].values) for name in ("x", "y")))
    moving = speed > SLOW * np.quantile(speed, 0.95)
    if "u" in trial:
        moving &= blocks.middles(trial["u"].values) > 0.0
    return longest_piece(moving)


def heading_offset_check(trial: xr.Dataset, scale: ShipScale) -> Check:
    """Course over ground less heading, and less the drift angle through the water, on the straight approach."""
    name = "heading offset"
    if reason := missing_channels_text(trial, ("x", "y", "psi", "delta")):
        return not_checked(name, reason)
    n, time = straight_approach(trial), trial["time"].values
    if n < 5 or time[n - 1] - time[0] < SHORTEST_APPROACH * scale.time:
        return not_checked(name, "no straight approach to compare course and heading on")
    trial, time = trial.isel(time=slice(0, n)), time[:n] - time[:n].mean()
    columns = [time, np.ones(n)]
    ((x_dot, _), x_errors, _), ((y_dot, _), y_errors, _), ((r, psi), psi_errors, _) = (
        least_squares(columns, trial[key].values) for key in ("x", "y", "psi")
    )
    speed = float(np.hypot(x_dot, y_dot))
    if speed * scale.time < SLOW * scale.L or abs(r) * scale.time > STRAIGHT_TURN:
        return not_checked(name, "the ship is slow or turns on the approach")
    logged = {"u", "v"} <= set(trial) and not has_ground_speeds(trial)  # else v is of the same course
    drift = np.arctan2(trial["v"].values.mean(), trial["u"].values.mean()) if logged else 0.0
    off = float(np.rad2deg(np.angle(np.exp(1j * (np.arctan2(y_dot, x_dot) - psi - drift)))))
    error = float(np.rad2deg(np.hypot(np.hypot(x_errors[0], y_errors[0]) / speed, psi_errors[1])))
    numbers = (("course less heading", off, "deg"), ("standard error", error, "deg"))
    text = f"On the straight approach the course over ground is {off:+.2g} deg off the heading (error {error:.1g} deg)"
    if abs(off) <= max(HEADING_OFF, SIGNIFICANT * error):
        return Check(name, "good", f"{text}.", numbers)
    across = speed * abs(np.sin(np.deg2rad(off)))
    verdict = "bad" if across > CROSS_CURRENT else "doubtful"
    text = f"{text}: a current of {across:.2g} m/s across, or a magnetic or misaligned heading"
    return Check(name, verdict, f"{text}; for that, state psi = {{ ..., offset = {off:.3g} }}.", numbers)


def clock_checks(yaw: Check, speed: Check) -> tuple[Check, Check]:
    """Checks of yaw rate and speed; where both have the same scale, the clock is the cause."""
    scales = [{label: value for label, value, _ in check.numbers} for check in (yaw, speed)]
    turn, way = scales[0].get("scale", 1.0), scales[1].get("track over velocity", 1.0)
    off = min(abs(turn - 1.0), abs(way - 1.0))
    if off <= SCALE_DOUBTFUL or turn <= 0.0 or abs(np.log(turn / way)) > SAME_SCALE * abs(np.log(way)):
        return yaw, speed
    text = f"psi and the track change by {turn:.3g} and {way:.3g} times the integrals of r and of u, v: a "
    text += f"second of the file is {way:.3g} s; correct the unit of time or the sampling interval."
    verdict = "bad" if off > SCALE_BAD else "doubtful"
    return replace(yaw, verdict=verdict, sentence=text), replace(speed, verdict=verdict, sentence=text)


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
    text = f"The track is {ratio:.4g} times the distance from u and v"
    mistakes, keys = speed_units(ratio, _LOG_WIDTH)
    if mistakes:
        return Check("speed", "bad", f"{text}, as of {mistakes}; state {keys}.", numbers)
    if abs(ratio - 1.0) > SPEED_BAD:
        return Check("speed", "bad", f"{text}; check the units of u, v, x, y and time.", numbers)
    if abs(ratio - 1.0) > SCALE_DOUBTFUL:
        return Check("speed", "doubtful", f"{text}: a current, or a log out of calibration.", numbers)
    return Check("speed", "good", f"{text}.", numbers)
