"""Checks of the rudder record: unit, sign, zero, angle, rate and delay."""

from collections.abc import Sequence

import numpy as np
import xarray as xr

from pymc_ship.physics.manoeuvre.steering_record import (
    approach_speed,
    first_execute,
    fixed_rudder,
    is_manoeuvre,
    rudder_reversals,
    zigzag_rudder_angle,
)
from pymc_ship.physics.vessel.vessel import Vessel
from pymc_ship.records.checks.verdicts import (
    Check,
    Numbers,
    balance,
    integral,
    missing_channels_text,
    not_checked,
    straight_approach,
)
from pymc_ship.records.files.ship_scale import SIGNIFICANT, Blocks, ShipScale
from pymc_ship.records.files.sides import MIRROR_IMAGE, rudder_effect
from pymc_ship.trial.record import AXES, sampling_interval, second_difference_sd

LARGEST_RUDDER = 1.3  # rudder angle [rad] that no rudder reaches: a record beyond 75 deg is one in degrees
PERCENT = 110.0  # deg, up to which percent of the range, read in deg, can reach
ZERO = 0.3  # rudder angle [deg] up to which a zero error passes: rudder indicators are read to about 0.5 deg
ZEROS_AGREE = 0.3  # difference [deg] up to which approach and zigzag have the same zero error, which is then corrected
OFF_THE_ORDER = 0.75  # deg, difference of a zigzag's angle from its order beyond the usual reading of an indicator
LARGEST_BACKLASH = 1.5  # deg, up to which an angle is that of an order of a multiple of 5 deg, however finely read
CUT_RATIO, CUT_EXCESS = 1.25, 2.0  # heading of a reversal over the angle, and beyond it [deg]: an angle cut off
UNUSUAL = 45.0  # deg, largest angle of a usual rudder
AMIDSHIPS = np.deg2rad(3.0)  # largest rudder angle of a ship that keeps its course
STEPS = (2.0, 1.0, 0.5)  # deg, of coarse indicators
RATE = 0.1  # difference from the vessel file's rudder rate that passes
GEAR, AT_ONCE = 5.0, 3.0  # rate [deg/s] of a quick gear; ratio to the rate of the gear that only an order has
PAUSE = 0.25  # fraction of a move's largest step up to which the rudder pauses
LEAD = -0.035  # L/U, usual shift of this equation of yaw without one; within 0.07 L/U on other simulators' ships
SHIFTED, SHIFT_ERRORS = 0.1, 2.0  # L/U, and standard errors, from which the rudder is shifted
_ONSET, _FEWEST_BLOCKS = 0.1, 8  # L/U, of the blocks of an approach whose last must not turn, and their least number
_TURNING = 0.02  # of the largest yaw rate
_REVERSED = 0.3  # lesser over larger rudder angle, to both sides
_PER_LENGTH = 60  # means in L/U
_MEAN, _SHIFTS = 0.2, np.linspace(-0.4, 0.4, 41)  # L/U of the moving mean; tried shifts
_ONSETS = np.linspace(-0.8, 0.8, 81)  # L/U; tried shifts of the first movement
_LEAST_APPROACH = 0.4  # of the samples about the first execute
_TO_BOTH_SIDES = 0.2  # least angle to one side over that to the other of a zigzag whose zero is off
_SHORTEST_APPROACH = 1.0  # s
_FEWEST_READINGS, _ON_THE_STEP = 5, 0.02  # different readings of a step; distance from a multiple of it, in steps
_FIXED = 0.7  # of a manoeuvre, at one angle
_NOISY_RANGE = 8.0  # standard deviations of the noise: a fixed rudder spans 5 of them
_MOVE = 0.6  # fraction of the way from the middle of the rudder's range to its ends


def is_amidships(trial: xr.Dataset) -> bool:
    """Whether the rudder moves no more than a ship needs that keeps its course."""
    return "delta" in trial and bool((np.abs(trial["delta"].values) < AMIDSHIPS).all())


def rudder_unit_check(trial: xr.Dataset) -> Check:
    """Whether the rudder angle can be in rad."""
    if "delta" not in trial:
        return not_checked("rudder unit", "no delta in the record")
    largest = float(np.abs(trial["delta"].values).max())
    numbers = (("largest rudder angle", np.rad2deg(largest), "deg"),)
    if largest > LARGEST_RUDDER:
        text = f"delta reaches {largest:.3g} rad, beyond any rudder; "
        in_degrees = np.rad2deg(largest) > PERCENT and np.deg2rad(largest) <= LARGEST_RUDDER
        reasons = ["deg"] if in_degrees else ["percent of its range", "a voltage"]
        reasons += ["tenths of a degree"] if np.rad2deg(largest) <= 10.0 * UNUSUAL else []
        text += f"probably it is in {' or '.join(reasons)}: convert it."
        return Check("rudder unit", "bad", text, numbers)
    if np.rad2deg(largest) > UNUSUAL:
        text = f"delta reaches {np.rad2deg(largest):.3g} deg (ships: up to {UNUSUAL:g}, with a flap 70): "
        text += "check that it is an angle, not percent of its range."
        return Check("rudder unit", "doubtful", text, numbers)
    if np.ptp(trial["delta"].values) == 0.0:
        return Check("rudder unit", "bad", "delta never changes; find the column of the rudder.", numbers)
    return Check("rudder unit", "good", f"delta reaches {np.rad2deg(largest):.3g} deg.", numbers)


def rudder_sign_check(trial: xr.Dataset, scale: ShipScale) -> Check:
    """Sign of the yaw acceleration that a rudder angle brings (Nomoto's equation), or of their lagged correlation."""
    if reason := missing_channels_text(trial, ("delta", "r")):
        return not_checked("rudder sign", reason)
    effect = rudder_effect(trial, scale)
    numbers: Numbers = (("yaw acceleration per rudder angle", effect.gain, "U2/L2"),)
    numbers += (("standard error", effect.error, "U2/L2"), ("lagged correlation", effect.correlation, ""))
    if not effect.side:
        return not_checked("rudder sign", "the rudder moves too little for a check", numbers)
    if effect.side == "starboard":
        text = "A positive delta turns the ship to starboard, it should turn the ship to port; flip the sign of delta. "
        text += "" if "psi" in trial else "Or r and v have the opposite sign. "
        return Check("rudder sign", "bad", f"{text}Or the record is {MIRROR_IMAGE}.", numbers)
    text = "A positive delta turns the ship to port, as it should"
    if trial.attrs.get(AXES):
        text += f". The file does not show its axes: so it is, or the record is {MIRROR_IMAGE}"
    return Check("rudder sign", "good", f"{text}.", numbers)


def rudder_zero_check(trial: xr.Dataset) -> Check:
    """Zero of the rudder: mean on the straight approach, and mean of the two angles of a zigzag."""
    name = "rudder zero"
    if "delta" not in trial:
        return not_checked(name, "no delta in the record")
    approach, middle = _approach_zero(trial), _zigzag_zero(trial)
    zeros = [zero for zero in (approach, middle) if np.isfinite(zero)]
    numbers = (("on the approach", approach, "deg"), ("between the sides of the zigzag", middle, "deg"))
    if not zeros:
        return not_checked(name, "neither a straight approach nor a rudder angle to both sides", numbers)
    worst = max(zeros, key=abs)
    if abs(worst) <= ZERO:
        return Check(name, "good", f"The rudder's zero is off by {worst:+.2f} deg at most.", numbers)
    if len(zeros) == 2 and abs(approach - middle) < ZEROS_AGREE:
        text = f"The rudder's zero is off by {middle:+.2f} deg, on the approach and between both sides; subtract it."
        return Check(name, "doubtful", text, numbers, mendable=True)
    if abs(approach) == abs(worst):
        text = f"The rudder on the approach is {approach:+.2f} deg: a zero error, or needed to keep the ship straight."
    else:
        text = f"The two sides of the zigzag are {middle:+.2f} deg off the middle: a zero error, or so ordered."
    return Check(name, "doubtful", f"{text} Check the log of the trial; not mended.", numbers)


def _approach_zero(trial: xr.Dataset) -> float:
    """Mean rudder angle [deg] before it moves, NaN where that is short or the ship turns."""
    n = straight_approach(trial)
    if n < 3 or n == trial.sizes["time"] or (n - 1) * sampling_interval(trial) < _SHORTEST_APPROACH:
        return np.nan
    if "r" in trial:
        r = trial["r"].values
        if abs(r[:n].mean()) > 0.1 * np.quantile(np.abs(r), 0.99):
            return np.nan
    return float(np.rad2deg(trial["delta"].values[:n].mean()))


def _zigzag_zero(trial: xr.Dataset) -> float:
    """Mean [deg] of the two rudder angles of a zigzag, NaN for another record."""
    delta = np.rad2deg(trial["delta"].values)
    low, high = np.quantile(delta, [0.02, 0.98])
    if balance(delta, 0.02) < _TO_BOTH_SIDES or high - low < 2.0:
        return np.nan
    tolerance = 0.05 * (high - low)
    sides = [delta[np.abs(delta - end) < tolerance] for end in (low, high)]
    sizes = [side.size for side in sides]
    if sum(sizes) <= 0.5 * delta.size or min(sizes) <= 0.1 * delta.size:
        return np.nan
    return float(0.5 * (np.median(sides[0]) + np.median(sides[1])))


def rudder_step(delta: np.ndarray) -> float:
    """Step [deg] of an indicator of :data:`STEPS` that has all readings [rad]; 0 for a finer one."""
    readings = np.unique(np.rad2deg(delta))
    for step in STEPS if readings.size >= _FEWEST_READINGS else ():
        if np.abs((readings - readings[0]) / step - np.rint((readings - readings[0]) / step)).max() < _ON_THE_STEP:
            return step
    return 0.0


def rudder_angle_check(trial: xr.Dataset) -> Check:
    """Rudder of a zigzag or circle against ``delta_command`` [rad], of a zigzag else against a multiple of 5 deg."""
    name = "rudder angle"
    if reason := missing_channels_text(trial, ("delta", "psi")):
        return not_checked(name, reason)
    commanded = trial.assign(delta=trial["delta_command"]) if "delta_command" in trial else None
    reversals, step = rudder_reversals(trial), rudder_step(trial["delta"].values)
    is_zigzag = bool(reversals)
    if not is_zigzag and (commanded is None or not _is_fixed(trial) or not _is_fixed(commanded)):
        return not_checked(name, "the rudder is not reversed between two angles, as in a zigzag, or has no order")
    under_way = is_manoeuvre(trial)
    angle, order = (
        _put_over(one["delta"].values[under_way], is_zigzag) if one is not None else 0.0 for one in (trial, commanded)
    )
    stated = order > 0.0
    order = order if stated else 5.0 * round(angle / 5.0)
    numbers: Numbers = (("angle", angle, "deg"), ("order", order, "deg"), ("step", step, "deg"))
    text = f"The rudder reads {angle:.3g} deg" + (" to both sides" if is_zigzag else "")
    text += f", in steps of {step:g} deg" if step else ""
    if abs(angle - order) > OFF_THE_ORDER and (stated or step or abs(angle - order) <= LARGEST_BACKLASH):
        text += (
            f" for {'an order' if stated else 'a probable order'} of {order:.3g} deg: backlash, scale or range of the "
        )
        text += "indicator, which the rudder coefficients take over; calibrate delta."
        return Check(name, "doubtful", text, numbers)
    heading = float(np.rad2deg(np.median([abs(one.heading) for one in reversals]))) if reversals else 0.0
    if not stated and heading > max(CUT_RATIO * angle, angle + CUT_EXCESS):
        text += (
            f" and is reversed at a heading of {heading:.3g} deg, but a standard zigzag has as much rudder or more: "
        )
        return Check(name, "doubtful", f"{text}an indicator that ends there, or its scale; calibrate delta.", numbers)
    return Check(name, "good", f"{text}.", numbers)


def _put_over(delta: np.ndarray, is_zigzag: bool) -> float:
    """Rudder angle [deg] of a zigzag, to both sides, or of a circle, without a sign."""
    return float(np.rad2deg(zigzag_rudder_angle(delta) if is_zigzag else np.median(np.abs(delta))))


def _is_fixed(trial: xr.Dataset) -> bool:
    """Whether the rudder keeps one angle for most of a manoeuvre, as in a circle."""
    return fixed_rudder(trial)[1] > _FIXED


def _moves(trial: xr.Dataset) -> tuple[np.ndarray, np.ndarray]:
    """Last sample before and first sample after each passage of the rudder from one side of its range to the other."""
    delta = trial["delta"].values
    low, high = np.quantile(delta, [0.005, 0.995])
    side = np.zeros(delta.size, dtype=int)
    if high - low > _NOISY_RANGE * second_difference_sd(delta[None])[0]:
        reach = _MOVE * 0.5 * (high - low)
        side[delta > 0.5 * (low + high) + reach] = 1
        side[delta < 0.5 * (low + high) - reach] = -1
    at_side = np.flatnonzero(side)
    across = np.flatnonzero(np.diff(side[at_side]) != 0)
    return at_side[across], at_side[across + 1]


def rudder_rate(trial: xr.Dataset) -> tuple[float, int]:
    """Median rate [deg/s] of the rudder from side to side, and the samples that a move takes; (NaN, 0) without one."""
    before, after = _moves(trial)
    if not before.size:
        return np.nan, 0
    travel = [np.abs(np.diff(trial["delta"].values[k : m + 1])) for k, m in zip(before, after, strict=True)]
    moving = [steps[steps > PAUSE * steps.max()] for steps in travel]
    rate = float(np.median([steps.mean() for steps in moving])) / sampling_interval(trial)
    return float(np.rad2deg(rate)), int(np.median([steps.size for steps in moving]))


def rudder_rate_check(trial: xr.Dataset, vessel: Vessel | None) -> Check:
    """Rate at which the rudder moves, against that of the vessel file."""
    name = "rudder rate"
    if "delta" not in trial:
        return not_checked(name, "no delta in the record")
    rate, samples = rudder_rate(trial)
    usual = vessel.particulars.rudder_rate_deg if vessel else GEAR
    if 0 < samples < 3 and rate > AT_ONCE * usual:
        text = f"The rudder moves at {rate:.3g} deg/s, from side to side within {samples + 1} samples: delta is the "
        text += "ordered angle; find the column of the actual one."
        return Check(name, "doubtful", text, (("rudder rate", rate, "deg/s"),))
    if samples < 3:
        reason = "the rudder never moves from side to side" if not samples else "its moves take fewer than 3 samples"
        return not_checked(name, reason)
    numbers: Numbers = (("rudder rate", rate, "deg/s"),)
    if vessel is None:
        return not_checked(name, f"no vessel to compare with; the rudder moves at {rate:.3g} deg/s", numbers)
    given = vessel.particulars.rudder_rate_deg
    numbers += (("vessel file", given, "deg/s"),)
    if abs(rate / given - 1.0) <= RATE:
        return Check(name, "good", f"The rudder moves at {rate:.3g} deg/s; the vessel file has {given:.3g}.", numbers)
    text = f"The rudder moves at {rate:.3g} deg/s, the vessel file has {given:.3g};"
    if rate < given:
        text = (
            f"{text} steered by hand, it may be slower than its gear, or delta reads {rate / given:.2g} of the angle."
        )
    else:
        text = f"{text} an ordered angle, a quicker gear, or delta reads {rate / given:.2g} times the angle."
    return Check(name, "doubtful", text, numbers)


def rudder_delay_check(trial: xr.Dataset) -> Check:
    """Delay of the rudder behind its command ``delta_command`` [rad], if recorded."""
    name = "rudder delay"
    if "delta" not in trial or "delta_command" not in trial:
        return not_checked(name, "no commanded rudder (delta_command) in the record")
    rate, _ = rudder_rate(trial)
    time, delta, command = (trial[key].values for key in ("time", "delta", "delta_command"))
    steps = np.flatnonzero(np.abs(np.diff(command)) > 0.25 * np.ptp(command)) + 1
    delays = []
    for k in steps:
        middle = 0.5 * (command[k - 1] + command[k])
        reached = np.flatnonzero((delta[k:] - middle) * np.sign(command[k] - command[k - 1]) >= 0.0)
        if reached.size and reached[0] > 0:
            travel = abs(command[k] - middle) / np.deg2rad(rate)
            delays.append(time[k + reached[0]] - time[k] - travel)
    if not delays or not np.isfinite(delays).all():
        return not_checked(name, "the command has no steps that the rudder follows")
    delay = float(np.median(delays))
    numbers = (("delay", delay, "s"),)
    text = f"The rudder follows its command {delay:.2g} s late, in addition to its rate."
    if delay > 0.1 * float(np.ptp(time)) or delay < -2.0 * sampling_interval(trial):
        return Check(name, "doubtful", f"{text} Check which column is the command.", numbers)
    return Check(name, "good", text, numbers)


def rudder_timing_check(trial: xr.Dataset, scale: ShipScale) -> Check:
    """Time of the rudder against the yaw acceleration that it brings, where it is reversed or first put over."""
    name = "rudder timing"
    if reason := missing_channels_text(trial, ("u", "v", "r", "delta")):
        return not_checked(name, reason)
    is_reversed = balance(trial["delta"].values, 0.02) >= _REVERSED
    shift, error, limit = 0.0, np.inf, np.inf
    if scale.known:
        shift, error, limit = _reversal_shift(trial, scale) if is_reversed else _onset_shift(trial, scale)
    numbers = (("shift", shift, "s"), ("standard error", error, "s"))
    if shift < -limit:
        text = (
            f"The ship turns {-shift:.2g} s before the rudder is put over: delta is late; state delay = {-shift:.2g} "
        )
        return Check(name, "doubtful", f"{text}for it.", numbers)
    if not (scale.known and is_reversed) and _turns_before_the_rudder(trial, scale):
        text = "The ship turns before the rudder is put over: delta is late; state its delay."
        return Check(name, "doubtful", text)
    if not np.isfinite(error):
        return not_checked(name, "it needs the L of a vessel file, and a reversed rudder or a straight approach")
    if shift <= limit:
        return Check(name, "good", f"The ship turns when the rudder moves (within {abs(shift):.2g} s).", numbers)
    text = f"The ship turns {shift:.2g} s too late for its rudder: delta is an ordered angle, or its clock is ahead."
    return Check(name, "doubtful", text, numbers)


def _onset_shift(trial: xr.Dataset, scale: ShipScale) -> tuple[float, float, float]:
    """Shift of the first rudder movement [s] that fits Nomoto's equation best, its error, and the largest usual one.

    r = a integral(delta) + b integral(r) + c t + d from L/U before the first execute to L/U after it, with b up to 0.
    """
    time, r, begin, interval = trial["time"].values, trial["r"].values, first_execute(trial), sampling_interval(trial)
    unit = scale.L / max(approach_speed(trial), np.finfo(float).tiny)
    near = np.abs(time - begin) <= unit
    if np.mean(time[near] < begin) < _LEAST_APPROACH or near.sum() < _FEWEST_BLOCKS:
        return 0.0, np.inf, np.inf
    constants, _ = np.linalg.qr(np.column_stack([time[near] - begin, np.ones(near.sum())]))

    def beside(rows: np.ndarray) -> np.ndarray:
        """Rows less their parts in the trend and the constant."""
        return rows - (rows @ constants) @ constants.T

    response, turned = beside(np.array([r[near], integral(r, interval)[near]]))
    misfits = []
    for shift in _ONSETS:
        pushed = beside(integral(np.interp(time - shift * unit, time, trial["delta"].values), interval)[near])
        columns = np.array([pushed, turned])
        coefficients = np.linalg.lstsq(columns @ columns.T, columns @ response)[0]
        freedom = response.size - 4
        if coefficients[-1] > 0.0:  # a slow rudder that is shifted would explain a turn without damping
            coefficients = np.array([pushed @ response / max(pushed @ pushed, np.finfo(float).tiny), 0.0])
            freedom = response.size - 3
        misfits.append(float(np.sum((response - coefficients @ columns) ** 2)))
    late, error = _least(_ONSETS, misfits, freedom)
    return unit * late, unit * error, unit * max(SHIFTED, SIGNIFICANT * error)


def _least(shifts: np.ndarray, misfits: Sequence[float], freedom: float) -> tuple[float, float]:
    """Shift of the least sum of squares, by a parabola, and its standard error; infinite where there is no minimum."""
    best = int(np.clip(np.argmin(misfits), 1, shifts.size - 2))
    curvature, slope, _ = np.polyfit(shifts[best - 1 : best + 2], misfits[best - 1 : best + 2], 2)
    if not curvature > 0.0:
        return 0.0, np.inf
    shift = np.clip(-0.5 * slope / curvature, shifts[0], shifts[-1])
    return float(shift), float(np.sqrt(min(misfits) / max(freedom, 1.0) / curvature))


def _turns_before_the_rudder(trial: xr.Dataset, scale: ShipScale) -> bool:
    """Whether the yaw rate leaves that of a straight approach before the first execute, by more than its noise."""
    r, time, begin = trial["r"].values, trial["time"].values, first_execute(trial)
    blocks = Blocks(max(int(_ONSET * scale.time / sampling_interval(trial)), 1))
    means = blocks.means(r[time <= begin][::-1])  # backwards from the execute
    if means.size < _FEWEST_BLOCKS:
        return False
    last, before = means[0], means[2:]
    departs = abs(last - before.mean())
    return bool(departs > SIGNIFICANT * before.std(ddof=1) and departs > _TURNING * np.abs(r).max())


def _reversal_shift(trial: xr.Dataset, scale: ShipScale) -> tuple[float, float, float]:
    """Shift of the rudder [s] that fits a nonlinear equation of yaw best, its error, and the largest usual one."""
    blocks = Blocks(max(int(scale.time / sampling_interval(trial) / _PER_LENGTH), 1))
    interval = blocks.size * sampling_interval(trial)
    size = max(round(_MEAN * scale.time / interval), 2)
    u, v, r, delta = (blocks.means(trial[name].values) for name in ("u", "v", "r", "delta"))
    u, time = u / scale.U, interval * np.arange(r.size)
    terms = (u * r, r * np.abs(r), u * v, v * np.abs(v), v * np.abs(r), r * np.abs(v), np.ones(r.size))
    basis, _ = np.linalg.qr(np.column_stack([_moving_mean(term, size) for term in terms]))
    acceleration = (r[size:] - r[:-size]) / (size * interval)
    left = acceleration - basis @ (basis.T @ acceleration)
    misfits = []
    for shift in _SHIFTS:
        force = _moving_mean(u**2 * np.interp(time - shift * scale.time, time, delta), size)
        force = force - basis @ (basis.T @ force)
        misfits.append(np.sum((left - force * (force @ left) / max(force @ force, np.finfo(float).tiny)) ** 2))
    late, error = _least(_SHIFTS, misfits, left.size / size - basis.shape[1] - 2.0)
    late = late - LEAD if np.isfinite(error) else late
    return scale.time * late, scale.time * error, scale.time * max(SHIFTED, SHIFT_ERRORS * error)


def _moving_mean(values: np.ndarray, size: int) -> np.ndarray:
    """Means over ``size`` intervals, by trapezoids."""
    total = integral(values, 1.0)
    return (total[size:] - total[:-size]) / size
