"""How the rudder of a record was steered: its execution, the angles it holds and its reversals."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import xarray as xr

_SKEWED = np.deg2rad(2.0)  # from the course before the execution; a zigzag that swings about another is not corrected
_ORDERED = 1.0  # deg, within which an angle is a multiple of 5
_INNER = 0.6  # share of the rudder angle between which its rate is measured
_UNLIKE = 3.0  # deg between the switching headings of one zigzag, or from their middle to the course before it
_WIDEST = 45.0  # deg, switching heading


@dataclass(frozen=True)
class Reversal:
    """One reversal of a zigzag: when the rudder began to move [s] and at what rate [rad/s].

    ``heading`` [rad] is its change since the execution, ``yaw_rate`` |r| [rad/s], both at that time.
    """

    time: float
    heading: float
    yaw_rate: float
    rudder_rate: float


@dataclass(frozen=True)
class Helm:
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
        """Change of heading from the first to the last sample [deg], positive to starboard."""
        psi = np.rad2deg(np.unwrap(self.trial["psi"].values))
        return float(psi[-1] - psi[0])

    @cached_property
    def held_angle(self) -> float:
        """Rudder angle [deg] that is held for more than 70 % of the record; 0 where none is."""
        delta = np.rad2deg(self.trial["delta"].values)
        angle = float(np.median(delta))
        steady = np.mean(np.abs(delta - angle) < max(0.05 * abs(angle), 0.5)) > 0.7
        return angle if steady else 0.0

    @cached_property
    def reversed_angle(self) -> int:
        """Rudder angle [deg] that was ordered to both sides."""
        return self.ordered(np.rad2deg(angle_to_both_sides(self.trial["delta"].values)))

    @cached_property
    def switching_heading(self) -> int:
        """Heading [deg] from the base course at which the rudder was reversed, a whole number from 1 up."""
        headings, _ = switching_headings(self.reversals, np.array([self.delay]))
        return max(round(float(headings.mean())), 1)

    @staticmethod
    def ordered(angle: float) -> int:
        """Rudder angle [deg] that was ordered: the multiple of 5 nearby, as an indicator is off, or a whole number."""
        five = 5 * round(angle / 5.0)
        return five if abs(angle - five) < _ORDERED and five else round(angle)


def execution(trial: xr.Dataset) -> float:
    """Time [s] at which the rudder is first put over: the last instant before it leaves its initial angle."""
    delta, time = trial["delta"].values, trial["time"].values
    moved = np.abs(delta - delta[0]) > 0.05 * np.ptp(delta)
    return float(time[max(int(np.argmax(moved)) - 1, 0)])


def approach_speed(trial: xr.Dataset) -> float:
    """Speed [m/s] at the begin of a manoeuvre: mean u up to the execution."""
    before = trial["time"].values <= execution(trial)
    return float(trial["u"].values[before].mean())


def base_course(trial: xr.Dataset) -> float:
    """Base course [rad] of a record with psi, r and delta.

    The course about which a zigzag swings equally to both sides; for other records the course before the rudder is put
    over.
    """
    initial = float(np.unwrap(trial["psi"].values)[trial["time"].values <= execution(trial)].mean())
    headings = [reversal.heading for reversal in rudder_reversals(trial)[1:]]
    sides = [[heading for heading in headings if sign * heading > 0.0] for sign in (1.0, -1.0)]
    if not all(sides):
        return initial
    middle = 0.5 * (np.mean(sides[0]) + np.mean(sides[1]))
    return initial + float(middle) if abs(middle) < _SKEWED else initial


def rudder_reversals(trial: xr.Dataset) -> list[Reversal]:
    """Execution and reversals of a rudder that goes from one held angle to its opposite; none for another record."""
    delta, time = trial["delta"].values, trial["time"].values
    angle = angle_to_both_sides(delta)
    if not angle:
        return []
    psi, r = np.unwrap(trial["psi"].values), np.abs(trial["r"].values)
    psi -= psi[time <= execution(trial)].mean()
    side = np.where(delta > 0.8 * angle, 1, np.where(delta < -0.8 * angle, -1, 0))
    held = np.flatnonzero(side)
    found = []
    for k in np.flatnonzero(np.diff(side[held]) != 0):
        path = slice(held[k], held[k + 1] + 1)
        away = side[held[k]] * delta[path]
        when = [np.interp(-level, -away, time[path]) for level in (_INNER * angle, -_INNER * angle)]
        rate = 2.0 * _INNER * angle / (when[1] - when[0])
        begin = when[0] - (1.0 - _INNER) * angle / rate
        found.append(Reversal(begin, float(np.interp(begin, time, psi)), float(np.interp(begin, time, r)), rate))
    return found if _alike(found) else []


def angle_to_both_sides(delta: np.ndarray) -> float:
    """Angle [rad] that a rudder holds to both sides for most of a record; 0 for a rudder that holds none."""
    low, high = np.quantile(delta, [0.05, 0.95])
    angle = 0.5 * (high - low)
    held = np.minimum(np.abs(delta - high), np.abs(delta - low)) < 0.1 * angle
    alike = low < 0.0 < high and abs(high + low) < 0.3 * angle
    return float(angle) if alike and held.mean() > 0.6 and angle > np.deg2rad(1.0) else 0.0


def switching_headings(reversals: Sequence[Reversal], delays: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Switching headings [deg] about their middle, (n_reversals, n_delays), and that middle, (n_delays,)."""
    heading = np.rad2deg([reversal.heading for reversal in reversals])
    rate = np.rad2deg([reversal.yaw_rate for reversal in reversals])
    side = (-1.0) ** np.arange(heading.size)[:, None]
    switch = np.sign(heading[0]) * side * heading[:, None] - rate[:, None] * delays
    if heading.size < 2:
        return switch, np.zeros(delays.size)
    middle = 0.5 * (switch[0::2].mean(axis=0) - switch[1::2].mean(axis=0))
    return switch - side * middle, middle


def _alike(reversals: Sequence[Reversal]) -> bool:
    """Whether the rudder was reversed at the same heading change to both sides, as in a zigzag."""
    if not reversals:
        return False
    switch, middle = switching_headings(reversals, np.zeros(1))
    within = np.ptp(switch) <= _UNLIKE and abs(middle[0]) <= _UNLIKE
    return bool(within and switch.min() > 0.0 and switch.mean() < _WIDEST)
