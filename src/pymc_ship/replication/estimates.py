"""Coefficients of a ship from one noisy trial by every method, in one form."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import scipy
import xarray as xr

from pymc_ship.inference.regression.identify import identify
from pymc_ship.inference.regression.priors import ExactPosterior
from pymc_ship.inference.trajectory.fit import TrajectoryFit
from pymc_ship.inference.trajectory.mode import TrajectoryMode, trajectory_mode
from pymc_ship.inference.trajectory.posterior import approximate_draws
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

LEVELS = np.array([0.05, 0.25, 0.5, 0.75, 0.95])
"""Probabilities of the ends of the intervals of 90 and 50 %, and of the estimate."""

_DRAWS = 400


@dataclass(frozen=True, eq=False, repr=False)
class Estimate:
    """Coefficients of all DOFs with intervals of 90 and 50 %.

    Attributes
    ----------
    coefficients, lower, upper : ndarray, shape (n_coefficients,)
        Prime values, DOFs one after the other in the vessel's order; NaN where a method failed.
    lower_half, upper_half : ndarray, shape (n_coefficients,), optional
        Ends of the intervals of 50 %.
    """

    coefficients: np.ndarray
    lower: np.ndarray
    upper: np.ndarray
    lower_half: np.ndarray | None = None
    upper_half: np.ndarray | None = None

    __repr__ = field_text

    def scores(self, vessel: Vessel) -> dict[str, float]:
        """Error summary against the reference, and the percentages of references inside the intervals.

        ``coverage`` of 90 % and ``coverage_half`` of 50 %, NaN without such intervals.
        """
        reference = reference_coefficients(vessel)

        def coverage(lower: np.ndarray | None, upper: np.ndarray | None) -> float:
            if lower is None or upper is None or not np.isfinite(self.coefficients).all():
                return float("nan")
            return 100.0 * float(np.mean((lower <= reference) & (reference <= upper)))

        scores = {
            "coverage": coverage(self.lower, self.upper),
            "coverage_half": coverage(self.lower_half, self.upper_half),
        }
        return error_summary(relative_error(self.coefficients, reference)) | scores


def exact_estimate(exact: Mapping[str, ExactPosterior]) -> Estimate:
    """Means and quantiles of the exact posterior of every DOF."""
    ends = [posterior.quantiles(LEVELS) for posterior in exact.values()]
    means = np.concatenate([posterior.mean for posterior in exact.values()])
    return _estimate(means, [np.concatenate(values) for values in zip(*ends, strict=True)])


def trajectory_estimate(fit: TrajectoryFit) -> Estimate:
    """Mode and normal approximation of a trajectory fit; medians and quantiles of draws where the prior has factors."""
    if fit.problem.prior.law is None:
        ends = fit.coefficients + fit.sd * scipy.stats.norm.ppf(LEVELS)[:, None]
    else:
        draws = approximate_draws(fit, 1, _DRAWS, np.random.default_rng(0))[0][:, : fit.coefficients.size]
        ends = np.quantile(draws, LEVELS, axis=0)
    return _estimate(ends[2], ends)


def _estimate(coefficients: np.ndarray, quantiles: Sequence[np.ndarray]) -> Estimate:
    return Estimate(coefficients, quantiles[0], quantiles[4], quantiles[1], quantiles[3])


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
