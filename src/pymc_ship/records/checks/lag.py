"""Lag of velocities, heading or track behind each other, distinguished from a lever arm, and its correction."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np
import xarray as xr

from pymc_ship.machine.errors import TrialError
from pymc_ship.records.checks.mistakes import changed
from pymc_ship.records.checks.track import (
    TrackBlocks,
    body_velocity,
    earth_velocity,
    lever_column,
    lever_fit,
    track_blocks,
)
from pymc_ship.records.checks.verdicts import Check, Numbers, missing_channels_text, not_checked
from pymc_ship.records.files.ship_scale import SIGNIFICANT, ShipScale, variance_inflation
from pymc_ship.records.steering.current import turned_to_earth
from pymc_ship.trial.record import sampling_interval

LAG = 0.01  # lag over L/U from which it is corrected
LONGEST_LAG, LONGEST_SOUGHT = 0.5, 1.0  # largest lag over L/U that is corrected, and that is sought
PREFERRED = 4.5  # log likelihood ratio, of three standard errors, of a lag that is no lever arm, or an arm no lag
READINGS = {
    "earth": (("u", "v"), ("x", "y")),  # u and v are earth-fixed velocities turned by the present heading
    "body": (("u", "v"), ("x", "y", "psi", "r")),
    "heading": (("psi", "r"), ("u", "v", "x", "y")),
}
"""Kinds of lag, with the channels that are late where it is positive, and where it is negative."""

NAME = "velocity lag"  # name of the check
_RATIO = "log likelihood ratio, lag over lever arm"
_STEPS = 12
_BOTH = 12.5  # log likelihood ratio, of five standard errors, of a lag beside a lever arm to either alone
_CONVERGED, _SHORT = 1e-4, 0.1  # s


@dataclass(frozen=True)
class VelocityLag:
    """Lag [s] of some channels behind the others, of a kind in :data:`READINGS`, and its standard error [s].

    A negative one is a lag of the other channels: sensors are late, never early.
    """

    kind: str
    seconds: float
    error: float

    @property
    def late(self) -> tuple[str, ...]:
        """Channels that are late."""
        return READINGS[self.kind][self.seconds < 0.0]

    @property
    def words(self) -> str:
        """Words on the late channels."""
        return f"{', '.join(self.late[:-1])} and {self.late[-1]}"

    @property
    def turned(self) -> bool:
        """Whether the late velocities were turned to body axes by the present heading."""
        return self.kind == "earth" and self.seconds >= 0.0


def without_lag(trial: xr.Dataset, lag: VelocityLag) -> xr.Dataset:
    """Trial whose late channels are moved forward by their lag; samples at the end without a value are cut."""
    time, seconds = trial["time"].values, abs(lag.seconds)
    values = {name: trial[name].values for name in lag.late}
    if lag.turned:
        values = dict(zip(lag.late, earth_velocity(trial), strict=True))
    moved = changed(trial, **{name: _later(time, late, seconds) for name, late in values.items()})
    if lag.turned:
        moved = changed(moved, **dict(zip(lag.late, body_velocity(moved), strict=True)))
    return moved.isel(time=time + seconds <= time[-1])


def _later(time: np.ndarray, values: np.ndarray, seconds: float) -> np.ndarray:
    """Values at times later by ``seconds``; the last ones stay."""
    return np.interp(time + seconds, time, values)


def _track_increments(
    trial: xr.Dataset, track: TrackBlocks, kind: str, seconds: float
) -> tuple[np.ndarray, np.ndarray]:
    """Increments of the track with a lag mended, and their derivative by the lag, each (2, n_blocks - 1)."""
    time, interval = trial["time"].values, sampling_interval(trial)
    if kind == "heading":
        moved = changed(trial, psi=_later(time, trial["psi"].values, seconds))
        x_dot, y_dot = earth_velocity(moved)
        rate = np.gradient(moved["psi"].values, interval)
        return track.increments_of(x_dot, y_dot), track.increments_of(-rate * y_dot, rate * x_dot)
    pair = earth_velocity(trial) if kind == "earth" else (trial["u"].values, trial["v"].values)
    u, v = (_later(time, values, seconds) for values in pair)
    pairs = [(u, v), (np.gradient(u, interval), np.gradient(v, interval))]
    if kind == "body":
        pairs = [turned_to_earth(*velocity, trial) for velocity in pairs]
    predicted, slope = (track.increments_of(*velocity) for velocity in pairs)
    return predicted, slope


def _lag_fit(
    trial: xr.Dataset, track: TrackBlocks, measured: np.ndarray, kind: str, longest: float, *, lever: bool
) -> tuple[float, float, np.ndarray]:
    """Least-squares lag of a kind [s] by Gauss-Newton, its error [s] and the residuals [m]; beside a ``lever`` arm."""
    seconds, arm = 0.0, 0.0
    for _ in range(_STEPS):
        predicted, slope = _track_increments(trial, track, kind, seconds)
        arms = [_lever_columns(trial, track, kind, moment) for moment in (seconds, seconds + _SHORT)] if lever else []
        if arms:
            slope = slope + arm * (arms[1] - arms[0]) / _SHORT
        columns = [slope.ravel(), *(column.ravel() for column in arms[:1])]
        (step, *others), (error, *_), residuals = track.fit(columns, measured - predicted)
        seconds, arm = float(np.clip(seconds + step, -longest, longest)), others[0] if arms else 0.0
        if abs(step) < _CONVERGED:
            break
    return seconds, float(error), residuals


def _lever_columns(trial: xr.Dataset, track: TrackBlocks, kind: str, seconds: float) -> np.ndarray:
    """Increments of a track a unit length forward; psi and r are of the time of the track."""
    late = seconds if kind == "heading" else min(seconds, 0.0) if kind == "earth" else 0.0
    time = trial["time"].values
    return lever_column(
        changed(trial, **{name: _later(time, trial[name].values, late) for name in ("psi", "r")}), track
    )


def late_misfit(scale: ShipScale, trial: xr.Dataset) -> float:
    """Velocity that misses the track [m/s] with the late channels moved, of the kind that leaves least."""
    track, measured = track_blocks(trial, scale)
    fits, kind = _lag_fits(trial, track, measured, scale, lever=True)
    return track.missing_velocity(fits[kind][2])


def _rms(residuals: np.ndarray) -> float:
    return float(np.sqrt(np.mean(residuals**2)))


def _log_likelihood_ratio(residuals: np.ndarray, others: np.ndarray) -> float:
    """Log likelihood of residuals less that of others; autocorrelated ones count as fewer."""
    best = min(residuals, others, key=_rms)
    tiny = np.finfo(float).tiny
    independent = best.size / variance_inflation(best)
    return float(independent * np.log(max(_rms(others), tiny) / max(_rms(residuals), tiny)))


def _lag_fits(
    trial: xr.Dataset, track: TrackBlocks, measured: np.ndarray, scale: ShipScale, *, lever: bool = False
) -> tuple[dict[str, tuple[float, float, np.ndarray]], str]:
    """Lag of every kind, as :func:`_lag_fit`, and the kind that leaves least."""
    longest = LONGEST_SOUGHT * scale.time
    fits = {kind: _lag_fit(trial, track, measured, kind, longest, lever=lever) for kind in READINGS}
    return fits, min(fits, key=lambda name: _rms(fits[name][2]))


def lag_check(trial: xr.Dataset, scale: ShipScale, known: VelocityLag | None = None) -> Check:
    """Lag of velocities, heading or track, distinguished from a lever arm; a ``known`` one of all runs prevails."""
    if reason := missing_channels_text(trial, ("x", "y", "psi", "u", "v", "r")):
        return not_checked(NAME, reason)
    track, measured = track_blocks(trial, scale)
    lever, error, arm = lever_fit(trial, track, measured - track.increments_of(*earth_velocity(trial)))
    fits, kind = _lag_fits(trial, track, measured, scale)
    if abs(lever) > SIGNIFICANT * error:  # perhaps a late receiver off the origin
        both, kind_of_both = _lag_fits(trial, track, measured, scale, lever=True)
        if all(_log_likelihood_ratio(both[kind_of_both][2], one) > _BOTH for one in (fits[kind][2], arm)):
            fits, kind = both, kind_of_both
    found, ratio = VelocityLag(kind, *fits[kind][:2]), _log_likelihood_ratio(fits[kind][2], arm)
    numbers: Numbers = ()
    for name, (seconds, error, residuals) in fits.items():
        numbers += ((f"lag, {name}", seconds, "s"), (f"standard error, {name}", error, "s"))
        numbers += ((f"misfit, {name}", _rms(residuals), "m"),)
    numbers += (("misfit, lever arm", _rms(arm), "m"), ("interval", sampling_interval(trial), "s"))
    numbers += (("lag over L/U", found.seconds / scale.time, ""), (_RATIO, ratio, ""))
    if known:
        numbers += ((f"lag of all runs, {known.kind}", known.seconds, "s"),)
        text = f"{_lag_text(known, 'in all runs, ')}; shift them."
        return Check(NAME, "doubtful", text, numbers, mendable=True)
    matters = abs(found.seconds) > max(LAG * scale.time, sampling_interval(trial), SIGNIFICANT * found.error)
    if not matters or ratio < PREFERRED:
        text = f"No channel lags the others ({found.seconds:.2g} s, error {found.error:.1g} s)."
        return Check(NAME, "good", text, numbers)
    misfits = f"the misfit is {_rms(fits[kind][2]):.2g} m, with a lever arm {_rms(arm):.2g} m"
    if abs(found.seconds) < LONGEST_LAG * scale.time:
        return Check(NAME, "doubtful", f"{_lag_text(found)}: {misfits}; shift them.", numbers, mendable=True)
    text = f"Probably {_lag_text(found)}, {LONGEST_LAG:g} L/U or more: {misfits}; state their delay."
    return Check(NAME, "doubtful", text, numbers)


def _lag_text(lag: VelocityLag, where: str = "") -> str:
    how = " (earth-fixed velocities turned by the present heading)" if lag.turned else ""
    return f"{where}{lag.words} are {abs(lag.seconds):.2g} s late{how}"


def lag_correction(check: Check) -> str:
    """What :func:`without_lag` does by a check."""
    lag = lag_of(check)
    return f"{lag.words} taken from {abs(lag.seconds):.3g} s later."


def rival_of_lever(check: Check) -> str:
    """Words on a lag that explains the track as well as a lever arm does; empty without one."""
    is_rival = check.numbers and not check.mendable and check.value(_RATIO) > -PREFERRED
    return _lag_text(lag_of(check)) if is_rival else ""


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
