"""Coefficients of a ship from one noisy trial by every method, in one form."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import xarray as xr
from scipy.stats import norm

from pymc_ship.inference.regression.identify import identify
from pymc_ship.inference.regression.priors import ExactPosterior
from pymc_ship.inference.trajectory.fit import TrajectoryFit
from pymc_ship.inference.trajectory.mode import TrajectoryMode, trajectory_mode
from pymc_ship.machine.errors import FitError
from pymc_ship.machine.fields import field_text
from pymc_ship.physics.vessel.vessel import Vessel, reference_coefficients
from pymc_ship.replication.scores import error_summary, relative_error

DIFFERENCES = {
    "central difference at 1 s": ("central", 1.0),
    "central difference": ("central", None),
    "Savitzky-Golay at 1 s": ("savgol", 1.0),
    "Savitzky-Golay": ("savgol", None),
}
"""Rivals of the paper's differences: derivative and interval of the rows [s], on the denoised record."""

WEAK_FORM_INTERVAL = 4.0
"""Interval of the rows of the weak form [s]: closer ones share noise, and their intervals get too narrow."""

_REACH = float(norm.ppf(0.95))


@dataclass(frozen=True, eq=False, repr=False)
class Estimate:
    """Coefficients of all DOFs and the ends of their intervals of 90 %.

    Attributes
    ----------
    coefficients, lower, upper : ndarray, shape (n_coefficients,)
        Prime values, DOFs one after the other in the vessel's order; NaN where a method failed.
    """

    coefficients: np.ndarray
    lower: np.ndarray
    upper: np.ndarray

    __repr__ = field_text

    def scores(self, vessel: Vessel) -> dict[str, float]:
        """Error summary against the reference and ``coverage``, the percentage of references inside the intervals."""
        reference = reference_coefficients(vessel)
        inside = (self.lower <= reference) & (reference <= self.upper)
        coverage = 100.0 * float(inside.mean()) if np.isfinite(self.coefficients).all() else float("nan")
        return error_summary(relative_error(self.coefficients, reference)) | {"coverage": coverage}


def exact_estimate(exact: Mapping[str, ExactPosterior]) -> Estimate:
    """Means and quantiles of the exact posterior of every DOF."""
    ends = [posterior.quantiles([0.05, 0.95]) for posterior in exact.values()]
    lower, upper = (np.concatenate(values) for values in zip(*ends, strict=True))
    return Estimate(np.concatenate([posterior.mean for posterior in exact.values()]), lower, upper)


def trajectory_estimate(fit: TrajectoryFit) -> Estimate:
    """Mode and normal approximation of a trajectory fit."""
    reach = _REACH * fit.sd
    return Estimate(fit.coefficients, fit.coefficients - reach, fit.coefficients + reach)


def regression_estimate(
    trial: xr.Dataset, vessel: Vessel, *, derivative: str = "euler", interval: float | None = 1.0
) -> Estimate:
    """Conjugate posterior at the evidence maximum; trial, derivative and interval as :func:`pymc_ship.identify`."""
    identification = identify(trial, vessel, families=("conjugate",), derivative=derivative, interval=interval)
    return exact_estimate(identification.exact["conjugate"])


def differencing_estimates(smooth: xr.Dataset, vessel: Vessel) -> dict[str, Estimate]:
    """Estimates by every way of :data:`DIFFERENCES` from a denoised trial."""
    return {
        name: regression_estimate(smooth, vessel, derivative=derivative, interval=interval)
        for name, (derivative, interval) in DIFFERENCES.items()
    }


def weak_form_estimate(noisy: xr.Dataset, vessel: Vessel, *, method: str = "rk4") -> Estimate:
    """Estimate by the weak form from a measured trial; "euler" is exact for Euler steps of its interval."""
    derivative = {"rk4": "weak", "euler": "weak_euler"}[method]
    return regression_estimate(noisy, vessel, derivative=derivative, interval=WEAK_FORM_INTERVAL)


def trajectory_modes(
    trials: xr.Dataset | Sequence[xr.Dataset], vessel: Vessel, priors: Sequence[str], **settings: Any
) -> dict[str, TrajectoryMode | None]:
    """Posterior mode of :func:`trajectory_posterior.trajectory_mode` by prior; None where no start converges."""
    modes: dict[str, TrajectoryMode | None] = {}
    for prior in priors:
        try:
            modes[prior] = trajectory_mode(trials, vessel, prior, **settings)
        except FitError:
            modes[prior] = None
    return modes
