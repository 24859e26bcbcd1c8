"""Lag of measured velocities behind the measured track, distinguished from a lever arm, and its correction."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np
import xarray as xr

from pymc_ship.machine.errors import TrialError
from pymc_ship.records.checks.track import (
    TrackBlocks,
    body_velocity,
    earth_velocity,
    lever_fit,
    track_blocks,
    turned_to_earth,
)
from pymc_ship.records.checks.verdicts import Check, Numbers, missing_channels_text, not_checked
from pymc_ship.records.files.ship_scale import SIGNIFICANT, ShipScale, least_squares
from pymc_ship.trial.record import sampling_interval

LAG = 0.01  # lag over L/U from which it is corrected
LONGEST_LAG = 0.5  # largest lag over L/U that is accepted as one
READINGS = {"earth": "earth-fixed velocities turned by the present heading", "body": "u and v as a whole"}
NAME = "velocity lag"  # name of the check
_STEPS = 12
_CONVERGED = 1e-4  # s


@dataclass(frozen=True)
class VelocityLag:
    """Lag [s] of the velocities behind the track, of a kind in :data:`READINGS`, and its standard error [s].

    A negative one of earth-fixed velocities is a lag of the track: sensors are late, never early.
    """

    kind: str
    seconds: float
    error: float

    @property
    def is_of_track(self) -> bool:
        """Whether x and y are late, and not the velocities."""
        return self.kind == "earth" and self.seconds < 0.0


def without_lag(trial: xr.Dataset, lag: VelocityLag) -> xr.Dataset:
    """Trial with u and v, or x and y, moved forward by their lag; samples at the end without a value are cut."""
    time = trial["time"].values
    if lag.is_of_track:
        track = {name: ("time", _later(time, trial[name].values, -lag.seconds), trial[name].attrs) for name in "xy"}
        return trial.assign(track).isel(time=time - lag.seconds <= time[-1])
    if lag.kind == "earth":
        x_dot, y_dot = (_later(time, values, lag.seconds) for values in earth_velocity(trial))
        trial = trial.assign(u=("time", x_dot, trial["u"].attrs), v=("time", y_dot, trial["v"].attrs))
        velocities = dict(zip(("u", "v"), body_velocity(trial), strict=True))
    else:
        velocities = {name: _later(time, trial[name].values, lag.seconds) for name in ("u", "v")}
    trial = trial.assign({name: ("time", values, trial[name].attrs) for name, values in velocities.items()})
    known = (time + lag.seconds >= time[0]) & (time + lag.seconds <= time[-1])
    return trial.isel(time=known)


def _later(time: np.ndarray, values: np.ndarray, seconds: float) -> np.ndarray:
    """Values at times later by ``seconds``; the last ones stay."""
    return np.interp(time + seconds, time, values)


def _track_increments(
    trial: xr.Dataset, track: TrackBlocks, kind: str, seconds: float
) -> tuple[np.ndarray, np.ndarray]:
    """Increments of the track from late velocities, and their derivative by the lag, each (2, n_blocks - 1)."""
    time, interval = trial["time"].values, sampling_interval(trial)
    pair = earth_velocity(trial) if kind == "earth" else (trial["u"].values, trial["v"].values)
    u, v = (_later(time, values, seconds) for values in pair)
    pairs = [(u, v), (np.gradient(u, interval), np.gradient(v, interval))]
    if kind == "body":
        pairs = [turned_to_earth(*velocity, trial) for velocity in pairs]
    predicted, slope = (track.increments_of(*velocity) for velocity in pairs)
    return predicted, slope


def _lag_fit(
    trial: xr.Dataset, track: TrackBlocks, measured: np.ndarray, kind: str, longest: float
) -> tuple[float, float, float]:
    """Least-squares lag of a kind [s] beside constant offsets (Gauss-Newton), its error [s] and the misfit [m]."""
    seconds = 0.0
    for _ in range(_STEPS):
        predicted, slope = _track_increments(trial, track, kind, seconds)
        columns = [slope.ravel(), *track.offsets]
        (step, *_), (error, *_), residuals = least_squares(columns, (measured - predicted).ravel())
        seconds = float(np.clip(seconds + step, -longest, longest))
        if abs(step) < _CONVERGED:
            break
    return seconds, float(error), float(np.sqrt(np.mean(residuals**2)))


def lag_check(trial: xr.Dataset, scale: ShipScale, known: VelocityLag | None = None) -> Check:
    """Lag of u and v behind the track, distinguished from a lever arm; a ``known`` lag of all runs takes precedence."""
    if reason := missing_channels_text(trial, ("x", "y", "psi", "u", "v", "r")):
        return not_checked(NAME, reason)
    track, measured = track_blocks(trial, scale)
    fits = {kind: _lag_fit(trial, track, measured, kind, LONGEST_LAG * scale.time) for kind in READINGS}
    _, _, arm = lever_fit(trial, track, measured - track.increments_of(*earth_velocity(trial)))
    arm_misfit = float(np.sqrt(np.mean(arm**2)))
    numbers: Numbers = ()
    for kind, (seconds, error, misfit) in fits.items():
        numbers += ((f"lag, {kind}", seconds, "s"), (f"standard error, {kind}", error, "s"))
        numbers += ((f"misfit, {kind}", misfit, "m"),)
    numbers += (("misfit, lever arm", arm_misfit, "m"), ("interval", sampling_interval(trial), "s"))
    numbers += (("lag over L/U", fits["earth"][0] / scale.time, ""),)
    if known:
        numbers += ((f"lag of all runs, {known.kind}", known.seconds, "s"),)
        text = f"{_lag_text(known, ' of all runs')}; shift them."
        return Check(NAME, "doubtful", text, numbers, mendable=True)
    kind = min(fits, key=lambda name: fits[name][2])
    seconds, error, misfit = fits[kind]
    found = VelocityLag(kind, seconds, error)
    matters = abs(seconds) > max(LAG * scale.time, sampling_interval(trial), SIGNIFICANT * error)
    if not matters or misfit >= arm_misfit or abs(seconds) >= LONGEST_LAG * scale.time:
        text = f"The velocities do not lag the track ({seconds:.2g} s, error {error:.1g} s)."
        return Check(NAME, "good", text, numbers)
    text = f"{_lag_text(found)}: the misfit is {misfit:.2g} m, with a lever arm {arm_misfit:.2g} m; shift them."
    return Check(NAME, "doubtful", text, numbers, mendable=True)


def _lag_text(lag: VelocityLag, whose: str = "") -> str:
    if lag.is_of_track:
        return f"The positions{whose} lag the velocities by {-lag.seconds:.2g} s"
    return f"The velocities{whose} lag the track by {lag.seconds:.2g} s, {READINGS[lag.kind]}"


def lag_correction(check: Check) -> str:
    """What :func:`without_lag` does by a check."""
    lag = lag_of(check)
    channels, seconds = ("x and y", -lag.seconds) if lag.is_of_track else ("u and v", lag.seconds)
    return f"{channels} taken from {seconds:.3g} s later."


def explains_better(check: Check, scale: ShipScale) -> bool:
    """Whether an uncertain lag explains the track better than a lever arm."""
    if check.mendable or not check.numbers:
        return False
    lag = lag_of(check)
    matters = abs(lag.seconds) > max(LAG * scale.time, check.value("interval"))
    return matters and check.value(f"misfit, {lag.kind}") < check.value("misfit, lever arm")


def lag_of(check: Check) -> VelocityLag:
    """Lag of a check: that of all runs if given, else the one with the smallest misfit."""
    values = {label: value for label, value, _ in check.numbers}
    for kind in READINGS:
        if (label := f"lag of all runs, {kind}") in values:
            return VelocityLag(kind, values[label], values[f"standard error, {kind}"])
    kind = min(READINGS, key=lambda name: values[f"misfit, {name}"])
    return VelocityLag(kind, values[f"lag, {kind}"], values[f"standard error, {kind}"])


def common_lag(checked: Iterable[Sequence[Check]]) -> VelocityLag | None:
    """One lag of several runs of a facility; None where no run shows a lag that matters.

    The kind has the smallest product of misfits over the runs. The value is the mean of the runs, weighted by the
    inverse of the variance of each and of the scatter between them (DerSimonian & Laird 1986,
    doi:10.1016/0197-2456(86)90046-2). ``checked`` are the :func:`pymc_ship.trial_checks` of each run, else TrialError.
    """
    every = [check for checks in checked for check in ([checks] if isinstance(checks, Check) else checks)]
    if not all(isinstance(check, Check) for check in every):
        raise TrialError("A common lag needs the checks of the runs, found something else; give trial_checks.")
    lag_checks = [check for check in every if check.name == NAME and check.numbers]
    if not any(check.mendable for check in lag_checks):
        return None
    kind = min(READINGS, key=lambda name: sum(np.log(check.value(f"misfit, {name}")) for check in lag_checks))
    values = np.array([check.value(f"lag, {kind}") for check in lag_checks])
    variance = np.array([check.value(f"standard error, {kind}") for check in lag_checks]) ** 2
    weight = 1.0 / variance
    spread = weight @ (values - weight @ values / weight.sum()) ** 2 - (values.size - 1)
    between = max(spread / max(weight.sum() - weight @ weight / weight.sum(), np.finfo(float).tiny), 0.0)
    weight = 1.0 / (variance + between)
    return VelocityLag(kind, float(weight @ values / weight.sum()), float(1.0 / np.sqrt(weight.sum())))
