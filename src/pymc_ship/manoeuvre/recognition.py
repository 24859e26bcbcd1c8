"""Which standard manoeuvre a record is, and how the steering gear carried it out.

A zigzag's rudder is reversed a delay after the heading has changed by a whole number of degrees. Each reversal gives
one equation, |heading when the rudder begins to move| = H + delay |r|; the delay is the same in all runs of a ship.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import xarray as xr

from pymc_ship.manoeuvre.standard import Manoeuvre, turning_circle, zigzag
from pymc_ship.trial.record import check_trial
from pymc_ship.vessel.vessel import Vessel

_FULL_TURN = 120.0  # deg of heading that a turning circle changes at least
_LONGEST_DELAY = 0.2  # L/U
_DELAYS = 201
_SKEWED = np.deg2rad(2.0)  # from the course before the execution; a zigzag that swings about another is not corrected
_UNUSUAL = 0.02  # deg^2, cost of a reversal at a heading that is no multiple of 5 deg
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
class Steering:
    """How the rudder was steered: ``rudder_rate_deg`` [deg/s] and ``rudder_delay`` [s], NaN where no run shows them."""

    rudder_rate_deg: float
    rudder_delay: float
    n_reversals: int


def recognise(trials: Sequence[xr.Dataset], vessel: Vessel) -> tuple[list[Manoeuvre | None], Steering]:
    """Recognise the standard manoeuvres among trials and measure how the rudder was steered.

    Parameters
    ----------
    trials : sequence of Dataset, dims (time,)
        With u, r, psi and delta.
    vessel : Vessel
        Gives L and the nominal speed, in which the longest delay is measured.

    Returns
    -------
    manoeuvres : list of Manoeuvre or None
        Zigzag or turning circle at the speed and side of the record; None for any other rudder record.
    steering : Steering
        Medians over all reversals.

    Raises
    ------
    TrialError
        For a trial that lacks a channel.

    Examples
    --------
    >>> import pymc_ship as ps
    >>> vessel = ps.load_vessel("kvlcc2")
    >>> trial = ps.simulate(vessel, ps.zigzag(20, 20), duration=600, step=0.5)
    >>> (manoeuvre,), steering = ps.recognise([trial], vessel)
    >>> manoeuvre.kind, manoeuvre.rudder_deg, manoeuvre.heading_deg, manoeuvre.side
    ('zigzag', 20.0, 20.0, 'port')
    >>> print(f"{steering.rudder_rate_deg:.2f} deg/s")
    2.35 deg/s
    """
    for trial in trials:
        check_trial(trial, ("u", "r", "psi", "delta"), uniform=False)
    found = [_reversals(trial) for trial in trials]
    every = [reversal for reversals in found for reversal in reversals]
    unit = vessel.particulars.ship_time
    delay = _common_delay(found, _LONGEST_DELAY * unit) if every else np.nan
    rate = float(np.rad2deg(np.median([reversal.rudder_rate for reversal in every]))) if every else np.nan
    pairs = zip(trials, found, strict=True)
    return [_manoeuvre(trial, reversals, delay) for trial, reversals in pairs], Steering(rate, delay, len(every))


def with_steering(vessel: Vessel, steering: Steering) -> Vessel:
    """Vessel whose rudder moves as it was measured to; unchanged where nothing was measured."""
    if not steering.n_reversals:
        return vessel
    measured = {"rudder_rate_deg": steering.rudder_rate_deg, "rudder_delay": steering.rudder_delay}
    return replace(vessel, particulars=replace(vessel.particulars, **measured))


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
    """Course [rad] of a record with psi, r and delta: about which a zigzag swings alike, or that before execution."""
    initial = float(np.unwrap(trial["psi"].values)[trial["time"].values <= execution(trial)].mean())
    headings = [reversal.heading for reversal in _reversals(trial)[1:]]
    sides = [[heading for heading in headings if sign * heading > 0.0] for sign in (1.0, -1.0)]
    if not all(sides):
        return initial
    middle = 0.5 * (np.mean(sides[0]) + np.mean(sides[1]))
    return initial + float(middle) if abs(middle) < _SKEWED else initial


def _reversals(trial: xr.Dataset) -> list[Reversal]:
    """Execution and reversals of a rudder that goes from one held angle to its opposite; none for another record."""
    delta, time = trial["delta"].values, trial["time"].values
    angle = _held_angle(delta)
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


def _held_angle(delta: np.ndarray) -> float:
    """Angle [rad] that a rudder holds to both sides for most of a record; 0 where it does not."""
    low, high = np.quantile(delta, [0.05, 0.95])
    angle = 0.5 * (high - low)
    held = np.minimum(np.abs(delta - high), np.abs(delta - low)) < 0.1 * angle
    alike = low < 0.0 < high and abs(high + low) < 0.3 * angle
    return float(angle) if alike and held.mean() > 0.6 and angle > np.deg2rad(1.0) else 0.0


def _switches(reversals: Sequence[Reversal], delays: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Switching headings [deg] from their middle, (n_reversals, n_delays), and the middle, (n_delays,), by delay."""
    heading = np.rad2deg([reversal.heading for reversal in reversals])
    rate = np.rad2deg([reversal.yaw_rate for reversal in reversals])
    side = (-1.0) ** np.arange(heading.size)[:, None]
    switch = np.sign(heading[0]) * side * heading[:, None] - rate[:, None] * delays
    if heading.size < 2:
        return switch, np.zeros(delays.size)
    middle = 0.5 * (switch[0::2].mean(axis=0) - switch[1::2].mean(axis=0))
    return switch - side * middle, middle


def _alike(reversals: Sequence[Reversal]) -> bool:
    """Whether reversals are ordered at one heading to both sides of the course before, as those of a zigzag."""
    if not reversals:
        return False
    switch, middle = _switches(reversals, np.zeros(1))
    within = np.ptp(switch) <= _UNLIKE and abs(middle[0]) <= _UNLIKE
    return bool(within and switch.min() > 0.0 and switch.mean() < _WIDEST)


def _common_delay(runs: Sequence[Sequence[Reversal]], longest: float) -> float:
    """Delay [s] at which the switching headings come closest to whole degrees, the same in a run, and best to fives."""
    delays = np.linspace(0.0, longest, _DELAYS)
    cost = np.zeros(delays.size)
    for reversals in runs:
        if reversals:
            switch, _ = _switches(reversals, delays)
            whole = np.maximum(np.round(switch.mean(axis=0)), 1.0)
            cost += np.sum((switch - whole) ** 2 + _UNUSUAL * (whole % 5.0 > 0.0), axis=0)
    return float(delays[np.argmin(cost)])


def _manoeuvre(trial: xr.Dataset, reversals: Sequence[Reversal], delay: float) -> Manoeuvre | None:
    speed, psi = approach_speed(trial), np.rad2deg(np.unwrap(trial["psi"].values))
    delta = np.rad2deg(trial["delta"].values)
    if reversals:
        switch = max(round(float(_switches(reversals, np.array([delay]))[0].mean())), 1)
        first = "starboard" if reversals[0].heading > 0.0 else "port"
        angle = _ordered(np.rad2deg(_held_angle(trial["delta"].values)))
        return zigzag(angle, switch, side=first, approach_speed=speed)
    angle = float(np.median(delta))
    steady = np.mean(np.abs(delta - angle) < max(0.05 * abs(angle), 0.5)) > 0.7
    if steady and abs(angle) > 3.0 and abs(psi[-1] - psi[0]) > _FULL_TURN:
        side = "starboard" if psi[-1] > psi[0] else "port"
        return turning_circle(_ordered(abs(angle)), side=side, approach_speed=speed)
    return None


def _ordered(angle: float) -> int:
    """Rudder angle [deg] that was ordered: the multiple of 5 nearby, as an indicator is off by some tenths, or else."""
    five = 5 * round(angle / 5.0)
    return five if abs(angle - five) < _ORDERED and five else round(angle)
