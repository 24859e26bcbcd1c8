"""The current in a record: drift of the track from the log, and from one round of a circle to the next.

In a steady turn the displacement over a full round is that of the water and of the wind drift; the transient is fitted
(IMO MSC/Circ.1053, 3.4.2.5).
"""

from dataclasses import dataclass

import numpy as np
import scipy
import xarray as xr

from pymc_ship.machine.errors import TrialError
from pymc_ship.physics.manoeuvre.steering_record import heading_change, is_manoeuvre
from pymc_ship.records.steering.measured import denoise_motion
from pymc_ship.trial.record import Channels, check_trial, has_ground_speeds

_STEADY = np.pi  # heading change [rad] from which on the turn counts as steady
_SPACING = np.deg2rad(5.0)  # heading between pairs of positions
_LEAST = np.deg2rad(630.0)  # least heading change
_OUTSIDE = 2.448  # radius of the 95 % region of two components [sd]
_DECAY = (0.1, 3.0)  # bounds of the transient's decay [1/rad of heading]


@dataclass(frozen=True)
class DriftCurrent:
    """Current from a turn.

    Attributes
    ----------
    velocity : ndarray, shape (2,); to north and east [m/s]
    sd : ndarray, shape (2,); standard uncertainty of each [m/s]
    local : ndarray, shape (n_pairs, 2); velocities between positions a round apart [m/s]
    """

    velocity: np.ndarray
    sd: np.ndarray
    local: np.ndarray

    @property
    def is_certain(self) -> bool:
        """Whether 0 lies outside the 95 % region of the velocity."""
        return self.speed > self.radius

    @property
    def radius(self) -> float:
        """Radius of the 95 % region [m/s]."""
        return _OUTSIDE * float(self.sd.max())

    @property
    def speed(self) -> float:
        """[m/s]."""
        return float(np.hypot(*self.velocity))

    @property
    def direction(self) -> float:
        """Direction of flow, clockwise from north [deg]."""
        return float(np.rad2deg(np.arctan2(self.velocity[1], self.velocity[0])) % 360.0)

    @property
    def words(self) -> str:
        """Speed and direction as words."""
        return f"{self.speed:.2g} m/s to {round(self.direction) % 360} deg"


def roll_angle(trial: Channels) -> np.ndarray:
    """Roll angle [rad] of a trial, 0 if not measured."""
    return trial["phi"].values if "phi" in trial else np.zeros(trial["time"].size)


def turned_to_earth(u: np.ndarray, v: np.ndarray, trial: Channels) -> tuple[np.ndarray, np.ndarray]:
    """x_dot and y_dot [m/s] of body-fixed u and v [m/s] at the heading and heel of a trial."""
    psi, sway = trial["psi"].values, v * np.cos(roll_angle(trial))
    cos, sin = np.cos(psi), np.sin(psi)
    return u * cos - sway * sin, u * sin + sway * cos


def logged_drift(trial: xr.Dataset) -> np.ndarray | None:
    """Mean velocity [m/s] of a track to north and east less that of the log; None without a log through the water."""
    if not {"u", "v", "psi", "x", "y"} <= set(trial.data_vars) or has_ground_speeds(trial):
        return None
    time = trial["time"].values
    log = [np.trapezoid(velocity, time) for velocity in turned_to_earth(trial["u"].values, trial["v"].values, trial)]
    track = [float(trial[name].values[-1] - trial[name].values[0]) for name in ("x", "y")]
    return np.subtract(track, log) / (time[-1] - time[0])


def ground_speed_text(trial: xr.Dataset, current: DriftCurrent) -> str:
    """Sentence on u and v that drift with the track of a circle; empty where its log shows half of the drift."""
    logged = logged_drift(trial)
    if logged is None or 2.0 * np.hypot(*logged) >= current.speed:
        return ""
    return (
        f"The track of the circle drifts by {current.speed:.2g} m/s, and u and v with it: they are over ground (state "
        'speeds = "over ground"), or wind drives the ship through the water.'
    )


def drift_current(trial: xr.Dataset) -> DriftCurrent:
    """Current from a turning circle of two rounds.

    The trial has psi, delta [rad] and x, y [m] over ground: fixed rudder over a heading change of 630 deg or more (the
    circular requires 720), of which the first 180 are not used. The current is the limit of the velocities between
    positions one round apart, every 5 deg of heading; the circular takes their mean, which includes the transient.
    TrialError for a turn that is too short, or a record without a channel.
    """
    check_trial(trial, ("psi", "delta", "x", "y"))
    inside = is_manoeuvre(trial)
    turned = np.abs(np.diff(heading_change(trial)[inside][[0, -1]])[0])
    if turned < _LEAST:
        raise TrialError(
            f"The current needs a turn of 630 deg at least, found {np.rad2deg(turned):.0f} deg; turn longer."
        )
    smooth = denoise_motion(trial[["psi", "delta", "x", "y"]])
    psi, time, x, y = heading_change(smooth)[inside], *(smooth[name].values[inside] for name in ("time", "x", "y"))
    forward = np.maximum.accumulate(np.sign(psi[-1]) * psi)
    begin = np.arange(_STEADY, forward[-1] - 2.0 * np.pi + 1e-9, _SPACING)
    when = [np.interp(begin + round_, forward, time) for round_ in (0.0, 2.0 * np.pi)]
    lasts = when[1] - when[0]
    local = (np.interp(when[1], time, x + 1j * y) - np.interp(when[0], time, x + 1j * y)) / lasts
    velocity, sd = _fit_velocity(local, begin, np.exp(1j * np.sign(psi[-1]) * begin) / lasts)
    return DriftCurrent(np.array([velocity.real, velocity.imag]), np.full(2, sd), np.stack([local.real, local.imag], 1))


def _fit_velocity(local: np.ndarray, begin: np.ndarray, turning: np.ndarray) -> tuple[complex, float]:
    """Least squares of local = velocity + C exp(-decay (begin - pi)) turning: velocity and standard uncertainty."""

    def fit(decay: float) -> tuple[np.ndarray, np.ndarray]:
        design = np.column_stack([np.ones_like(turning), np.exp(-decay * (begin - _STEADY)) * turning])
        return design, np.linalg.lstsq(design, local, rcond=None)[0]

    def misfit(decay: float) -> float:
        design, coefficients = fit(decay)
        return float(np.sum(np.abs(local - design @ coefficients) ** 2))

    best = scipy.optimize.minimize_scalar(misfit, bounds=_DECAY, method="bounded").x
    design, coefficients = fit(best)
    slope = (begin - _STEADY) * design[:, 1]  # derivative by the decay
    full = np.column_stack([design, slope])
    spread = np.linalg.inv(full.conj().T @ full)[0, 0].real
    variance = misfit(best) / (2.0 * (local.size - 2.0) - 1.0)
    rounds = max((begin[-1] - begin[0]) / (2.0 * np.pi), 1.0)
    return complex(coefficients[0]), float(np.sqrt(variance * spread * local.size / rounds))
