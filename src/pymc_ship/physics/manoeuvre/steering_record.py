"""Steering in a record: first execute, fixed rudder angles and rudder reversals."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property, lru_cache, wraps
from itertools import pairwise

import numpy as np
import xarray as xr

from pymc_ship.trial.record import Channels, second_difference_sd, unwrapped

_SKEWED = np.deg2rad(2.0)  # largest shift of the base course from the course of the approach
_ORDERED = 1.0  # deg, within which an angle is a multiple of 5
_BACKLASH = 1.5  # deg, by which both sides of a zigzag fall short of it: backlash of 2 deg, half a step of 1 deg
_INNER = 0.6  # of the rudder angle, between which the rudder rate is measured
_NEAR = 0.3  # of the rudder angle, largest difference of the two sides of a zigzag
_LASTS = 0.1  # of the longest time at a fixed rudder
_FLAT, _NOISE, _FLAT_SHARE = 0.05, 3.0, 0.5  # of the angle, or sd of noise: half of the samples of a fixed rudder
_SETTLED = 0.02  # of the time after the first execute: length of the approach that is averaged
_BOTH_SIDES = 0.4  # of the time from the first execute; a sine is so near its extremes for 0.29 of it
_ONE_SIDE = 0.7  # of the time from the first execute that the rudder of a turning circle is fixed
_BREAK = 0.05  # of the time from there to a heading change of 180 deg, in which a fixed rudder is not at its angle
_SCATTER = 0.8  # of their median, largest deviation of the switching headings of a zigzag steered by hand
_WIDEST = 45.0  # deg, switching heading
_LONGEST_CACHED = 200_000  # samples of the series whose values are cached


@dataclass(frozen=True)
class Reversal:
    """Second or later execute of a zigzag: begin [s], heading since the first execute [rad], rudder rate [rad/s]."""

    time: float
    heading: float
    rudder_rate: float


@dataclass(frozen=True)
class SteeringRecord:
    """Steering in a trial with u, r, psi and delta, from which a kind of manoeuvre is recognised."""

    trial: xr.Dataset
    reversals: Sequence[Reversal]  # of a zigzag, else empty
    delay: float  # of the steering gear [s], NaN without a reversal in any run

    @cached_property
    def heading_change_deg(self) -> float:
        """Change of heading from the first execute to the end of the last fixed rudder [deg], positive to starboard."""
        return float(np.rad2deg(heading_change(self.trial)[is_manoeuvre(self.trial)][-1]))

    @cached_property
    def fixed_rudder_deg(self) -> float:
        """Rudder angle [deg] that is fixed for more than 70 % of the manoeuvre, and not left early; 0 without one."""
        angle, fraction = fixed_rudder(self.trial)
        return angle if fraction > _ONE_SIDE and not _left_early(self.trial, angle) else 0.0

    @cached_property
    def reversed_angle(self) -> int:
        """Rudder angle [deg] of a zigzag, as ordered."""
        angle = np.rad2deg(zigzag_rudder_angle(self.trial["delta"].values[is_manoeuvre(self.trial)]))
        return self.ordered_angle(angle, short=_BACKLASH)

    @cached_property
    def switching_heading(self) -> int:
        """Switching heading [deg] from the base course, a whole number from 1."""
        headings, _ = switching_headings(self.trial, self.reversals, np.array([self.delay]))
        return whole_heading(headings)

    @staticmethod
    def ordered_angle(angle: float, short: float = _ORDERED) -> int:
        """Ordered rudder angle [deg]: the multiple of 5 within 1 deg or ``short`` of it, else the whole number."""
        five = 5 * round(angle / 5.0)
        return five if -short < angle - five < _ORDERED and five else round(angle)


def whole_heading(headings: np.ndarray) -> int:
    """Ordered switching heading [deg]: a multiple of 5 within two standard errors of the mean, or a whole number."""
    mean = float(headings.mean())
    five = 5 * round(mean / 5.0)
    error = float(headings.std(ddof=1)) / np.sqrt(headings.size) if headings.size > 1 else 0.0
    return five if five and abs(mean - five) <= 2.0 * error else max(round(mean), 1)


def manoeuvre_rudder_angle(delta: np.ndarray) -> float:
    """Rudder angle [rad] of a manoeuvre, 0 amidships: median of the range of 10 % with the largest sum of squares."""
    size = np.sort(np.abs(delta))
    work = np.concatenate([[0.0], np.cumsum(size**2)])
    end = np.searchsorted(size, 1.1 * size, side="right")
    begin = int(np.argmax(work[end] - work[:-1]))
    return float(np.median(size[begin : end[begin]]))


def _cache_by_values[Value](function: Callable[..., Value]) -> Callable[..., Value]:
    """Function of series that keeps its last values: draws of one record have one rudder angle and one time."""

    @lru_cache(maxsize=8)
    def of_bytes(*series: bytes) -> Value:
        return function(*map(np.frombuffer, series))

    @wraps(function)
    def cached(*series: np.ndarray) -> Value:
        floats = [np.ascontiguousarray(one, dtype=float) for one in series]
        is_long = sum(one.size for one in floats) > _LONGEST_CACHED
        return function(*floats) if is_long else of_bytes(*(one.tobytes() for one in floats))

    return cached


@_cache_by_values
def fixed_rudder_intervals(delta: np.ndarray) -> Sequence[tuple[int, int]]:
    """First sample and end of each flat interval at :func:`manoeuvre_rudder_angle` to either side, if not too short."""
    angle = manoeuvre_rudder_angle(delta)
    near = np.abs(np.abs(delta) - angle) <= _NEAR * angle
    side = np.concatenate([[0], np.where(near, np.sign(delta), 0), [0]])
    edges = np.flatnonzero(np.diff(side))
    intervals = [(int(k), int(end)) for k, end in pairwise(edges) if side[k + 1]]
    longest = max((end - k for k, end in intervals), default=0)
    flat = max(_FLAT * angle, _NOISE * float(second_difference_sd(delta)) if delta.size > 2 else 0.0)

    def is_flat(k: int, end: int) -> bool:
        return bool(np.mean(np.abs(delta[k:end] - np.median(delta[k:end])) <= flat) >= _FLAT_SHARE)

    return tuple((k, end) for k, end in intervals if end - k >= _LASTS * longest and is_flat(k, end))


def first_execute(trial: Channels) -> float:
    """Time [s] of the first execute, at which the rudder is first put over; of a record without an approach its begin.

    Begin of the line through the last instants at a quarter and a half of the way to the first fixed angle.
    """
    delta, time = trial["delta"].values, trial["time"].values
    known = np.isfinite(delta)
    return _first_execute(delta, time) if known.all() else _first_execute(delta[known], time[known])


@_cache_by_values
def _first_execute(delta: np.ndarray, time: np.ndarray) -> float:
    intervals = fixed_rudder_intervals(delta)
    if not intervals or intervals[0][0] == 0:
        return float(time[0])
    first, end = intervals[0]
    towards = np.sign(delta[first]) * delta[: first + 1]
    full = float(np.abs(np.median(delta[first:end])))
    rough = _line_begin(time, towards, (0.7 * full, 0.6 * full), 0.0)
    ahead = rough - time[: first + 1]
    moving = time[first] - rough
    for longest in (_LASTS * (time[end - 1] - time[first]), moving):
        settled = towards[(ahead >= 0.0) & (ahead <= longest)]
        settled_angle = float(np.median(settled)) if settled.size else float(towards[0])
        if settled_angle >= 0.5 * full:
            return float(time[first])
        travel = full - settled_angle
        begin = _line_begin(time, towards, (settled_angle + 0.5 * travel, settled_angle + 0.25 * travel), settled_angle)
        if rough - begin <= moving:  # else the line begins before another angle, which lasts
            break
    return max(float(time[0]), begin)


def _line_begin(time: np.ndarray, rising: np.ndarray, levels: tuple[float, float], start: float) -> float:
    """Time at which the line through the last passages of two levels, the higher first, is at ``start``."""
    when = []
    for level in levels:
        k = int(np.flatnonzero(rising[:-1] < level)[-1]) if (rising[:-1] < level).any() else 0
        when.append(float(np.interp(level, rising[k : k + 2], time[k : k + 2])))
    high, low = levels
    return when[1] - (low - start) * (when[0] - when[1]) / (high - low)


def is_manoeuvre(trial: Channels) -> np.ndarray:
    """Mask of the samples from the first execute to the end of the last fixed rudder; without one, to the end."""
    delta, time = trial["delta"].values, trial["time"].values
    intervals = fixed_rudder_intervals(delta)
    until = time[intervals[-1][1] - 1] if intervals else time[-1]
    return (time >= first_execute(trial)) & (time <= until)


def fixed_rudder(trial: xr.Dataset) -> tuple[float, float]:
    """Median rudder angle [deg] of a manoeuvre, and the fraction of its time with the rudder at that angle."""
    delta = np.rad2deg(trial["delta"].values[is_manoeuvre(trial)])
    angle = float(np.median(delta))
    return angle, float(np.mean(np.abs(delta - angle) < max(0.05 * abs(angle), 0.5)))


def _left_early(trial: xr.Dataset, angle: float) -> bool:
    """Whether a rudder that has reached its angle [deg] leaves it before the heading has changed by 180 deg."""
    turned = np.abs(heading_change(trial)) >= np.pi
    until = int(np.argmax(turned)) if turned.any() else turned.size
    delta = np.rad2deg(trial["delta"].values[:until][is_manoeuvre(trial)[:until]])
    away = np.abs(delta - angle) > _NEAR * abs(angle)
    return bool(away.size) and float(np.mean(away[int(np.argmin(away)) :])) > _BREAK


def is_approach(trial: Channels) -> np.ndarray:
    """Mask of the last part of the approach, from which approach speed and initial course are averaged."""
    time, begin = trial["time"].values, first_execute(trial)
    last = time[max(int(np.searchsorted(time, begin, side="right")) - 1, 0)]
    return (time <= last) & (time >= last - _SETTLED * (time[-1] - last))


def approach_speed(trial: xr.Dataset) -> float:
    """Approach speed [m/s]: mean u just before the first execute."""
    return float(trial["u"].values[is_approach(trial)].mean())


def heading_change(trial: Channels) -> np.ndarray:
    """Change of heading [rad] since the first execute, shape (n_time,)."""
    psi = unwrapped(trial["psi"].values)
    return psi - psi[is_approach(trial)].mean()


def base_course(trial: Channels) -> float:
    """Base course [rad]: of a zigzag the middle of the switching headings, otherwise the course of the approach."""
    initial = float(unwrapped(trial["psi"].values)[is_approach(trial)].mean())
    headings = [reversal.heading for reversal in rudder_reversals(trial)[1:]]
    sides = [[heading for heading in headings if sign * heading > 0.0] for sign in (1.0, -1.0)]
    if not all(sides):
        return initial
    middle = 0.5 * (np.mean(sides[0]) + np.mean(sides[1]))
    return initial + float(middle) if abs(middle) < _SKEWED else initial


def switching_headings(
    trial: xr.Dataset, reversals: Sequence[Reversal], delays: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Headings [deg] of the reversals from their middle (n_reversals, n_delays), and the middle, for delays [s]."""
    begin = np.array([reversal.time for reversal in reversals])
    heading = np.rad2deg(np.interp(begin[:, None] - delays, trial["time"].values, heading_change(trial)))
    side = np.sign(reversals[0].heading) * (-1.0) ** np.arange(begin.size)[:, None]
    if begin.size < 2:
        return side * heading, np.zeros(delays.size)
    middle = 0.5 * (heading[0::2].mean(axis=0) + heading[1::2].mean(axis=0))
    return side * (heading - middle), middle


def rudder_reversals(trial: Channels) -> list[Reversal]:
    """Rudder reversals of a zigzag, its second and later executes; empty for another record."""
    reversals = reversals_at_any_heading(trial)
    return reversals if reversals and not zigzag_fault(reversals) else []


def reversals_at_any_heading(trial: Channels) -> list[Reversal]:
    """Rudder reversals between two opposite angles, at any heading."""
    delta, time = trial["delta"].values, trial["time"].values
    angle = zigzag_rudder_angle(delta[is_manoeuvre(trial)])
    if not angle:
        return []
    return list(_reversals(delta, time, heading_change(trial), np.array([angle, first_execute(trial)])))


@_cache_by_values
def _reversals(delta: np.ndarray, time: np.ndarray, psi: np.ndarray, steering: np.ndarray) -> Sequence[Reversal]:
    """Reversals between two opposite angles; ``steering`` is the angle [rad] and the time of the first execute [s]."""
    angle, execute = steering
    side = np.where(delta > 0.8 * angle, 1, np.where(delta < -0.8 * angle, -1, 0))
    at_angle = np.flatnonzero(side * (time >= execute))
    reversals = []
    for k in np.flatnonzero(np.diff(side[at_angle]) != 0):
        path = slice(at_angle[k], at_angle[k + 1] + 1)
        away = side[at_angle[k]] * delta[path]
        when = [_passage(time[path], away, level) for level in (_INNER * angle, -_INNER * angle)]
        rate = 2.0 * _INNER * angle / (when[1] - when[0])
        begin = when[0] - (1.0 - _INNER) * angle / rate
        reversals.append(Reversal(begin, float(np.interp(begin, time, psi)), rate))
    return tuple(reversals)


def _passage(time: np.ndarray, falling: np.ndarray, level: float) -> float:
    """Time at which noisy falling values pass a level: mean of the first and the last crossing."""
    first, last = np.flatnonzero(falling <= level)[0], np.flatnonzero(falling > level)[-1] + 1
    return 0.5 * sum(float(np.interp(-level, -falling[k - 1 : k + 1], time[k - 1 : k + 1])) for k in (first, last))


@_cache_by_values
def zigzag_rudder_angle(delta: np.ndarray) -> float:
    """Rudder angle [rad] to both sides for most of a manoeuvre; 0 without one."""
    low, high = np.quantile(delta, [0.05, 0.95])
    angle = 0.5 * (high - low)
    near = np.minimum(np.abs(delta - high), np.abs(delta - low)) < 0.1 * angle
    alike = low < 0.0 < high and abs(high + low) < _NEAR * angle
    return float(angle) if alike and near.mean() > _BOTH_SIDES and angle > np.deg2rad(1.0) else 0.0


def zigzag_fault(reversals: Sequence[Reversal]) -> str:
    """Reason for which reversals are not those of a zigzag; empty for a zigzag."""
    side = np.sign(reversals[0].heading) * (-1.0) ** np.arange(len(reversals))
    heading = np.rad2deg([reversal.heading for reversal in reversals]) * side
    middle = np.median(heading)
    if heading.min() > 0.0 and np.abs(heading - middle).max() <= _SCATTER * middle and middle < _WIDEST:
        return ""
    changes = ", ".join(f"{value:.1f}" for value in side * heading)
    return f"the rudder is reversed at heading changes of {changes} deg, not at one to both sides up to {_WIDEST:g} deg"


def steering_text(trial: xr.Dataset) -> str:
    """Description of the rudder in a record that is neither a zigzag nor a turning circle."""
    if not fixed_rudder_intervals(trial["delta"].values):
        return "the rudder is never fixed at an angle"
    if reversals := reversals_at_any_heading(trial):
        return zigzag_fault(reversals)
    angle, fraction = fixed_rudder(trial)
    if fraction <= _ONE_SIDE:
        first = np.rad2deg(manoeuvre_rudder_angle(trial["delta"].values))
        return f"the rudder is put over to {first:.3g} deg, but not fixed at one angle or at two opposite angles"
    if abs(angle) > _BACKLASH and _left_early(trial, angle):
        return f"the rudder leaves {angle:.3g} deg before the heading has changed by 180 deg"
    turned = SteeringRecord(trial, (), np.nan).heading_change_deg
    return f"the rudder is fixed at {angle:.3g} deg while the heading changes by {turned:.0f} deg"
