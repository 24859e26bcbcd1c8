"""Length and speed of the ship in a record, block means in its own time, and least squares with honest errors."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import xarray as xr

from pymc_ship.physics.vessel.vessel import Vessel
from pymc_ship.trial.record import Channels, sampling_interval

TIGHTEST_TURN = 0.4  # L over the smallest radius U/|r| where L is unknown; merchant ships reach 0.3 to 0.6
SIGNIFICANT = 5.0  # standard errors from which a finding counts: a false alarm in 1e5 trials of a few dozen tests
_IDLE = 1e-100


@dataclass(frozen=True)
class ShipScale:
    """Length [m] and speed [m/s] of the ship; ``known`` where the length is that of a vessel file.

    ``nominal_time`` is L/U [s] at the nominal speed where that is known.
    """

    L: float
    U: float
    known: bool
    nominal_time: float

    @property
    def time(self) -> float:
        """L/U [s]."""
        return self.L / self.U


def ship_scale(trial: xr.Dataset, vessel: Vessel | None) -> ShipScale:
    """Length and speed of the ship; without a vessel, the length from the tightest turn (:data:`TIGHTEST_TURN`)."""
    time = trial["time"].values
    duration = float(time[-1] - time[0])
    U = vessel.particulars.nominal_speed if vessel else 1.0
    if "u" in trial:
        v = trial["v"].values if "v" in trial else 0.0
        U = float(np.median(np.hypot(trial["u"].values, v))) or U
    elif {"x", "y"} <= set(trial.data_vars):
        U = float(np.hypot(np.diff(trial["x"].values), np.diff(trial["y"].values)).sum() / duration) or U
    if vessel:
        return ShipScale(vessel.particulars.L, U, known=True, nominal_time=vessel.particulars.ship_time)
    turning = _turning_rate(trial)
    ship_time = TIGHTEST_TURN / turning if turning > 0.0 else duration
    ship_time = float(np.clip(ship_time, duration / 500.0, duration / 5.0))
    return ShipScale(U * ship_time, U, known=False, nominal_time=ship_time)


def _turning_rate(trial: xr.Dataset) -> float:
    """Largest rate of turn [rad/s] of the gyro or the heading, the smaller of the two; 0 without both."""
    rates = []
    if "r" in trial:
        rates.append(float(np.quantile(np.abs(trial["r"].values), 0.99)))
    if "psi" in trial:
        size = max(1, trial.sizes["time"] // 200)
        changes = np.abs(Blocks(size).increments(np.unwrap(trial["psi"].values)))
        rates.append(float(np.quantile(changes, 0.99)) / (size * sampling_interval(trial)))
    return min(filter(None, rates), default=0.0)


@dataclass(frozen=True)
class Blocks:
    """Means over blocks of ``size`` samples, against the noise of position and heading."""

    size: int

    def means(self, values: np.ndarray) -> np.ndarray:
        """Block means, shape (n_blocks,)."""
        n = values.size // self.size
        return values[: n * self.size].reshape(n, self.size).mean(axis=1)

    def increments(self, values: np.ndarray) -> np.ndarray:
        """Differences of the means of neighbouring blocks, shape (n_blocks - 1,)."""
        return np.diff(self.means(values))

    def middles(self, values: np.ndarray) -> np.ndarray:
        """Means over two neighbouring blocks, shape (n_blocks - 1,)."""
        means = self.means(values)
        return 0.5 * (means[1:] + means[:-1])


def ship_blocks(trial: Channels, scale: ShipScale, fraction: float) -> Blocks:
    """Blocks of a fraction of L/U, of three samples or more, at least ten of them where the record allows."""
    n_time = trial["time"].size
    return Blocks(max(1, min(max(3, round(fraction * scale.time / sampling_interval(trial))), n_time // 10)))


def least_squares(columns: list[np.ndarray], response: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Least squares: coefficients, their standard errors and the residuals.

    The larger of ordinary and HC3 errors (MacKinnon & White 1985, doi:10.1016/0304-4076(85)90158-7), inflated for
    autocorrelated residuals.
    """
    X = np.column_stack(columns)
    scale = np.sqrt(np.mean(X**2, axis=0))
    idle = scale < _IDLE
    scale[idle] = 1.0
    left, s, right = np.linalg.svd(np.where(idle, 0.0, X) / scale, full_matrices=False)
    determined = s > s[0] * 1e-12
    inverse = right.T * np.where(determined, 1.0 / np.where(determined, s, 1.0), 0.0)
    coefficients = inverse @ (left.T @ response) / scale
    residuals = response - X @ coefficients
    sd = np.sqrt(residuals @ residuals / max(1, response.size - X.shape[1]))
    ordinary = sd * np.sqrt(np.sum(inverse**2, axis=1))
    free = np.maximum(1.0 - np.sum(left**2, axis=1), 1e-6)
    robust = np.sqrt(np.sum((inverse @ left.T * (residuals / free)) ** 2, axis=1))
    inflation = np.sqrt(variance_inflation(residuals)) / scale
    return coefficients, np.maximum(ordinary, robust) * inflation, residuals


def variance_inflation(residuals: np.ndarray) -> float:
    """Factor by which autocorrelation of the first order, up to 0.9, increases the variance of a mean."""
    correlation = residuals[1:] @ residuals[:-1] / max(residuals @ residuals, np.finfo(float).tiny)
    correlation = np.clip(correlation, 0.0, 0.9)
    return float((1.0 + correlation) / (1.0 - correlation))
