"""The current of a sea trial, from a turning circle of two rounds (IMO MSC/Circ.1053, 3.4.2.5).

Once the turn is steady, the ship is back on the same heading after every round. What she has moved in between, the
water has moved; wind that drifts her is in it, too, as the circular has it. What a turn has yet to settle is fitted.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import xarray as xr

from pymc_ship.machine.errors import TrialError
from pymc_ship.physics.manoeuvre.steering_record import heading_change, is_manoeuvre
from pymc_ship.records.steering.measured import denoise_motion
from pymc_ship.trial.record import check_trial

_STEADY = np.pi  # rad of heading from the execution, from which on the circular has the turn steady
_SPACING = np.deg2rad(5.0)  # from one pair of positions to the next
_LEAST = np.deg2rad(630.0)  # of heading in all: pairs over a quarter of a round
_DECAY = (0.1, 3.0)  # 1/rad of heading, of what a turn has to settle


@dataclass(frozen=True)
class DriftCurrent:
    """Current that a turn shows.

    Attributes
    ----------
    velocity : ndarray, shape (2,)
        To north and east [m/s].
    sd : ndarray, shape (2,)
        Standard uncertainty of each [m/s].
    local : ndarray, shape (n_pairs, 2)
        Velocities between positions a round apart [m/s].
    """

    velocity: np.ndarray
    sd: np.ndarray
    local: np.ndarray

    @property
    def speed(self) -> float:
        """[m/s]."""
        return float(np.hypot(*self.velocity))

    @property
    def direction(self) -> float:
        """Where the current goes to, clockwise from north [deg]."""
        return float(np.rad2deg(np.arctan2(self.velocity[1], self.velocity[0])) % 360.0)


def drift_current(trial: xr.Dataset) -> DriftCurrent:
    """Measure the current by a turning circle of two rounds.

    Parameters
    ----------
    trial : Dataset, dims (time,)
        With psi, delta [rad] and x, y [m] over ground; the rudder is held while the heading changes by 630 deg or more,
        of which the first 180 do not count. The circular asks for 720.

    Returns
    -------
    DriftCurrent
        What the velocities between pairs of positions on the same heading, a round apart, every 5 deg, tend to. The
        circular takes their mean; a large ship still loses speed in her second round, and that mean is off by what the
        turn has to settle. The standard uncertainty is that of the fit, from as many independent pairs as there are
        rounds in which they begin, one at least.

    Raises
    ------
    TrialError
        For a turn that is too short. For a record that lacks a channel.

    References
    ----------
    IMO (2002), Explanatory notes to the standards for ship manoeuvrability, MSC/Circ.1053, 3.4.2.5.

    Examples
    --------
    A tanker that turns in a current of 0.5 m/s to the east:

    >>> import pymc_ship as ps
    >>> from pymc_ship.ships.sea_trials.current import drift_current
    >>> circle = ps.simulate("kvlcc2", ps.turning_circle(35), duration=2400, step=0.5, current=(0.5, 90))
    >>> found = drift_current(circle)
    >>> print(f"{found.speed:.2f} m/s to {found.direction:.0f} deg")
    0.50 m/s to 90 deg
    """
    check_trial(trial, ("psi", "delta", "x", "y"))
    smooth = denoise_motion(trial)
    inside = is_manoeuvre(trial)
    psi, time, x, y = heading_change(smooth)[inside], *(smooth[name].values[inside] for name in ("time", "x", "y"))
    turned = np.abs(psi[-1] - psi[0])
    if turned < _LEAST:
        raise TrialError(
            f"A current is measured by a turn of 720 deg, of 630 at least, found {np.rad2deg(turned):.0f}; turn longer."
        )
    forward = np.maximum.accumulate(np.sign(psi[-1]) * psi)
    begin = np.arange(_STEADY, forward[-1] - 2.0 * np.pi + 1e-9, _SPACING)
    when = [np.interp(begin + round_, forward, time) for round_ in (0.0, 2.0 * np.pi)]
    lasts = when[1] - when[0]
    local = (np.interp(when[1], time, x + 1j * y) - np.interp(when[0], time, x + 1j * y)) / lasts
    velocity, sd = _settled(local, begin, np.exp(1j * np.sign(psi[-1]) * begin) / lasts)
    return DriftCurrent(np.array([velocity.real, velocity.imag]), np.full(2, sd), np.stack([local.real, local.imag], 1))


def _settled(local: np.ndarray, begin: np.ndarray, turning: np.ndarray) -> tuple[complex, float]:
    """Velocity that pairs tend to as the turn settles, and the standard uncertainty of its parts.

    Radius and drift angle of a turn settle exponentially, so that a round is not closed by a vector that turns with the
    heading and decays: local = velocity + C exp(-decay (begin - pi)) turning, with complex C.
    """
    from scipy.optimize import minimize_scalar

    def fitted(decay: float) -> tuple[np.ndarray, np.ndarray]:
        design = np.column_stack([np.ones_like(turning), np.exp(-decay * (begin - _STEADY)) * turning])
        return design, np.linalg.lstsq(design, local, rcond=None)[0]

    def misfit(decay: float) -> float:
        design, found = fitted(decay)
        return float(np.sum(np.abs(local - design @ found) ** 2))

    best = minimize_scalar(misfit, bounds=_DECAY, method="bounded").x
    design, found = fitted(best)
    slope = (begin - _STEADY) * design[:, 1]  # of the decay, by which the fit is uncertain, too
    full = np.column_stack([design, slope])
    spread = np.linalg.inv(full.conj().T @ full)[0, 0].real
    variance = misfit(best) / (2.0 * (local.size - 2.0) - 1.0)
    rounds = max((begin[-1] - begin[0]) / (2.0 * np.pi), 1.0)
    return complex(found[0]), float(np.sqrt(variance * spread * local.size / rounds))
