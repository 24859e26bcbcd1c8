"""How the rudder of a record was steered: its execution, the angles it holds and its reversals."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise

import numpy as np
import xarray as xr

from pymc_ship.trial.record import second_difference_sd

_SKEWED = np.deg2rad(2.0)  # from the course before the execution; a zigzag that swings about another is not corrected
_ORDERED = 1.0  # deg, within which an angle is a multiple of 5
_INNER = 0.6  # share of the rudder angle between which its rate is measured
_NEAR = 0.3  # share of the rudder angle by which both sides of a zigzag differ at most
_LASTS = 0.1  # share of the longest time for which a manoeuvre's rudder angle is held
_FLAT, _NOISE, _FLAT_SHARE = 0.05, 3.0, 0.5  # of the angle, or sd of noise: within it stays half of what is held
_SETTLED = 0.02  # share of what follows the execution, over which speed and course before it are measured
_SIDES_HELD = 0.4  # share of the time from the execution; a sine is so near its extremes for 0.29 of it
_ONE_HELD = 0.7  # share of the time from the execution that the rudder of a turning circle is held
_UNLIKE = 0.8  # of their median, by which switching headings of a zigzag that is steered by hand are off it
_WIDEST = 45.0  # deg, switching heading


@dataclass(frozen=True)
class Reversal:
    """One reversal of a zigzag: when the rudder began to move [s] and at what rate [rad/s].

    ``heading`` [rad] is its change since the execution at that time.
    """

    time: float
    heading: float
    rudder_rate: float


@dataclass(frozen=True)
class Swings:
    """Heading of a zigzag and the reversals of its rudder.

    Attributes
    ----------
    time : ndarray, shape (n_time,)
        [s].
    heading : ndarray, shape (n_time,)
        Change since the execution [rad].
    reversals : sequence of Reversal
        From :func:`rudder_reversals`.
    """

    time: np.ndarray
    heading: np.ndarray
    reversals: Sequence[Reversal]

    def switching_headings(self, delays: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Headings [deg] at which the reversals were ordered if the rudder followed after these delays [s].

        Returns
        -------
        headings : ndarray, shape (n_reversals, n_delays)
            About their middle, positive to the side turned to.
        middle : ndarray, shape (n_delays,)
        """
        begin = np.array([reversal.time for reversal in self.reversals])
        heading = np.rad2deg(np.interp(begin[:, None] - delays, self.time, self.heading))
        side = np.sign(self.reversals[0].heading) * (-1.0) ** np.arange(begin.size)[:, None]
        if begin.size < 2:
            return side * heading, np.zeros(delays.size)
        middle = 0.5 * (heading[0::2].mean(axis=0) + heading[1::2].mean(axis=0))
        return side * (heading - middle), middle


@dataclass(frozen=True)
class SteeringRecord:
    """What the helmsman did in a record, for the functions that recognise manoeuvres.

    Attributes
    ----------
    trial : Dataset, dims (time,)
        With u, r, psi and delta.
    reversals : sequence of Reversal
        From :func:`rudder_reversals`; empty where the rudder does not go from one angle to its opposite at one heading.
    delay : float
        From the switching heading to the rudder's first movement [s]; NaN where no run shows a reversal.
    """

    trial: xr.Dataset
    reversals: Sequence[Reversal]
    delay: float

    @cached_property
    def turned(self) -> float:
        """Change of heading from the execution to the end of the last angle held [deg], positive to starboard."""
        return float(np.rad2deg(heading_change(self.trial)[is_manoeuvre(self.trial)][-1]))

    @cached_property
    def held_angle(self) -> float:
        """Rudder angle [deg] that is held for more than 70 % of the time from the execution on; 0 where none is."""
        angle, share = fixed_rudder(self.trial)
        return angle if share > _ONE_HELD else 0.0

    @cached_property
    def reversed_angle(self) -> int:
        """Rudder angle [deg] that was ordered to both sides."""
        return self.ordered(np.rad2deg(zigzag_rudder_angle(self.trial["delta"].values[is_manoeuvre(self.trial)])))

    @cached_property
    def switching_heading(self) -> int:
        """Heading [deg] from the base course at which the rudder was reversed, a whole number from 1 up.

        It is the multiple of 5 where the reversals scatter so far that their mean may be it.
        """
        headings, _ = swings(self.trial, self.reversals).switching_headings(np.array([self.delay]))
        return whole_heading(headings)

    @staticmethod
    def ordered(angle: float) -> int:
        """Rudder angle [deg] that was ordered: the multiple of 5 nearby, as an indicator is off, or a whole number."""
        five = 5 * round(angle / 5.0)
        return five if abs(angle - five) < _ORDERED and five else round(angle)


def whole_heading(headings: np.ndarray) -> int:
    """Heading [deg] that reversals at these headings [deg] were ordered at."""
    mean = float(headings.mean())
    five = 5 * round(mean / 5.0)
    error = float(headings.std(ddof=1)) / np.sqrt(headings.size) if headings.size > 1 else 0.0
    return five if five and abs(mean - five) <= 2.0 * error else max(round(mean), 1)


def held_angle(delta: np.ndarray) -> float:
    """Magnitude of the rudder angle [rad] that a manoeuvre is made with; 0 for a rudder that is never put over.

    Of all ranges of a tenth of the angle, it is the middle of the one in which the square of the rudder angle has its
    largest sum: the angle held the longest, where a large one weighs more than the helm that keeps her straight.
    """
    size = np.sort(np.abs(delta))
    work = np.concatenate([[0.0], np.cumsum(size**2)])
    end = np.searchsorted(size, 1.1 * size, side="right")
    begin = int(np.argmax(work[end] - work[:-1]))
    return float(np.median(size[begin : end[begin]]))


def fixed_rudder_intervals(delta: np.ndarray) -> list[tuple[int, int]]:
    """First sample and end of each time for which a rudder is held at :func:`held_angle` to either side.

    Helm on the approach passes this angle, too: what is not flat or lasts less than a tenth of the longest does not
    count.
    """
    angle = held_angle(delta)
    near = np.abs(np.abs(delta) - angle) <= _NEAR * angle
    side = np.concatenate([[0], np.where(near, np.sign(delta), 0), [0]])
    edges = np.flatnonzero(np.diff(side))
    found = [(int(k), int(end)) for k, end in pairwise(edges) if side[k + 1]]
    longest = max((end - k for k, end in found), default=0)
    flat = max(_FLAT * angle, _NOISE * float(second_difference_sd(delta)) if delta.size > 2 else 0.0)

    def is_held(k: int, end: int) -> bool:
        return bool(np.mean(np.abs(delta[k:end] - np.median(delta[k:end])) <= flat) >= _FLAT_SHARE)

    return [(k, end) for k, end in found if end - k >= _LASTS * longest and is_held(k, end)]


def first_execute(trial: xr.Dataset) -> float:
    """Time [s] at which the rudder is first put over.

    Parameters
    ----------
    trial : Dataset, dims (time,)
        With delta, which may have gaps.

    Returns
    -------
    float
        Where the straight line through the last moments at which the rudder has done a quarter and a half of its way to
        the first angle that it holds begins, so that neither noise nor the helm on the approach counts; the first
        instant of a record that begins with the rudder put over or that never puts it over.
    """
    known = np.isfinite(trial["delta"].values)
    delta, time = trial["delta"].values[known].astype(float), trial["time"].values[known]
    found = fixed_rudder_intervals(delta)
    if not found or found[0][0] == 0:
        return float(time[0])
    first, end = found[0]
    towards = np.sign(delta[first]) * delta[: first + 1]
    full = float(np.abs(np.median(delta[first:end])))
    rough = _line_begin(time, towards, (0.7 * full, 0.6 * full), 0.0)
    ahead = rough - time[: first + 1]
    settled = towards[(ahead >= 0.0) & (ahead <= _LASTS * (time[end - 1] - time[first]))]
    helm = float(np.median(settled)) if settled.size else float(towards[0])
    if helm >= 0.5 * full:
        return float(time[first])
    way = full - helm
    return max(float(time[0]), _line_begin(time, towards, (helm + 0.5 * way, helm + 0.25 * way), helm))


def _line_begin(time: np.ndarray, rising: np.ndarray, levels: tuple[float, float], start: float) -> float:
    """Time at which the line through the last passages of two levels, the higher first, is at ``start``."""
    when = []
    for level in levels:
        k = int(np.flatnonzero(rising[:-1] < level)[-1]) if (rising[:-1] < level).any() else 0
        when.append(float(np.interp(level, rising[k : k + 2], time[k : k + 2])))
    high, low = levels
    return when[1] - (low - start) * (when[0] - when[1]) / (high - low)


def is_manoeuvre(trial: xr.Dataset) -> np.ndarray:
    """Whether a sample is between the execution and the end of the last angle held; of all where none is."""
    delta, time = trial["delta"].values, trial["time"].values
    found = fixed_rudder_intervals(delta)
    until = time[found[-1][1] - 1] if found else time[-1]
    return (time >= first_execute(trial)) & (time <= until)


def fixed_rudder(trial: xr.Dataset) -> tuple[float, float]:
    """Median rudder angle [deg] while it is put over, and the share of that time for which it is held."""
    delta = np.rad2deg(trial["delta"].values[is_manoeuvre(trial)])
    angle = float(np.median(delta))
    return angle, float(np.mean(np.abs(delta - angle) < max(0.05 * abs(angle), 0.5)))


def is_approach(trial: xr.Dataset) -> np.ndarray:
    """Whether a sample is of the last part of the approach, in which speed and course are those of the manoeuvre."""
    time, begin = trial["time"].values, first_execute(trial)
    last = time[max(int(np.searchsorted(time, begin, side="right")) - 1, 0)]
    return (time <= last) & (time >= last - _SETTLED * (time[-1] - last))


def approach_speed(trial: xr.Dataset) -> float:
    """Speed [m/s] at the begin of a manoeuvre: mean u just before the execution."""
    return float(trial["u"].values[is_approach(trial)].mean())


def heading_change(trial: xr.Dataset) -> np.ndarray:
    """Change of heading [rad] since the execution, shape (n_time,)."""
    psi = np.unwrap(trial["psi"].values)
    return psi - psi[is_approach(trial)].mean()


def base_course(trial: xr.Dataset) -> float:
    """Base course [rad] of a record with psi and delta.

    The course about which a zigzag swings equally to both sides; for other records the course before the rudder is put
    over.
    """
    initial = float(np.unwrap(trial["psi"].values)[is_approach(trial)].mean())
    headings = [reversal.heading for reversal in rudder_reversals(trial)[1:]]
    sides = [[heading for heading in headings if sign * heading > 0.0] for sign in (1.0, -1.0)]
    if not all(sides):
        return initial
    middle = 0.5 * (np.mean(sides[0]) + np.mean(sides[1]))
    return initial + float(middle) if abs(middle) < _SKEWED else initial


def swings(trial: xr.Dataset, reversals: Sequence[Reversal]) -> Swings:
    """Heading of a zigzag beside the reversals of its rudder."""
    return Swings(trial["time"].values, heading_change(trial), reversals)


def rudder_reversals(trial: xr.Dataset) -> list[Reversal]:
    """Reversals of a rudder that goes from one held angle to its opposite; none for another record than a zigzag."""
    found = reversals_at_any_heading(trial)
    return found if found and not zigzag_fault(found) else []


def reversals_at_any_heading(trial: xr.Dataset) -> list[Reversal]:
    """Reversals of a rudder between two opposite angles, at whatever headings."""
    delta, time = trial["delta"].values, trial["time"].values
    angle = zigzag_rudder_angle(delta[is_manoeuvre(trial)])
    if not angle:
        return []
    psi = heading_change(trial)
    side = np.where(delta > 0.8 * angle, 1, np.where(delta < -0.8 * angle, -1, 0))
    at_angle = np.flatnonzero(side * (time >= first_execute(trial)))
    found = []
    for k in np.flatnonzero(np.diff(side[at_angle]) != 0):
        path = slice(at_angle[k], at_angle[k + 1] + 1)
        away = side[at_angle[k]] * delta[path]
        when = [_passage(time[path], away, level) for level in (_INNER * angle, -_INNER * angle)]
        rate = 2.0 * _INNER * angle / (when[1] - when[0])
        begin = when[0] - (1.0 - _INNER) * angle / rate
        found.append(Reversal(begin, float(np.interp(begin, time, psi)), rate))
    return found


def _passage(time: np.ndarray, falling: np.ndarray, level: float) -> float:
    """Time at which values that fall, but for noise, pass a level that the first is above and the last below."""
    last_above = np.flatnonzero(falling > level)[-1]
    first_below = np.flatnonzero(falling <= level)[0]
    return 0.5 * sum(
        float(np.interp(-level, -falling[k - 1 : k + 1], time[k - 1 : k + 1])) for k in (first_below, last_above + 1)
    )


def zigzag_rudder_angle(delta: np.ndarray) -> float:
    """Angle [rad] that a rudder holds to both sides for most of a manoeuvre; 0 for a rudder that holds none."""
    low, high = np.quantile(delta, [0.05, 0.95])
    angle = 0.5 * (high - low)
    near = np.minimum(np.abs(delta - high), np.abs(delta - low)) < 0.1 * angle
    alike = low < 0.0 < high and abs(high + low) < _NEAR * angle
    return float(angle) if alike and near.mean() > _SIDES_HELD and angle > np.deg2rad(1.0) else 0.0


def zigzag_fault(reversals: Sequence[Reversal]) -> str:
    """Why reversals are not those of a zigzag, at one heading to both sides; empty where they are."""
    side = np.sign(reversals[0].heading) * (-1.0) ** np.arange(len(reversals))
    heading = np.rad2deg([reversal.heading for reversal in reversals]) * side
    middle = np.median(heading)
    if heading.min() > 0.0 and np.abs(heading - middle).max() <= _UNLIKE * middle and middle < _WIDEST:
        return ""
    changes = ", ".join(f"{value:.1f}" for value in side * heading)
    return f"the rudder is reversed at heading changes of {changes} deg, not at one to both sides up to {_WIDEST:g} deg"


def steering_text(trial: xr.Dataset) -> str:
    """What the rudder of a record does that is neither a zigzag nor a turning circle."""
    if not fixed_rudder_intervals(trial["delta"].values):
        return "the rudder is never put over to an angle that it holds"
    if reversals := reversals_at_any_heading(trial):
        return zigzag_fault(reversals)
    angle, share = fixed_rudder(trial)
    if share <= _ONE_HELD:
        first = np.rad2deg(held_angle(trial["delta"].values))
        return (
            f"the rudder is put over to {first:.3g} deg, but is then held neither at one angle nor at two opposite ones"
        )
    turned = SteeringRecord(trial, (), np.nan).turned
    return f"the rudder is held at {angle:.3g} deg while the heading changes by {turned:.0f} deg"
