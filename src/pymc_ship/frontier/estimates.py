"""Coefficients of a ship from one noisy trial by every method, in one form, and the bound of the unbiased ones."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import xarray as xr
from scipy.optimize import brentq
from scipy.special import erf
from scipy.stats import norm

from pymc_ship.design.identifiability import identifiability
from pymc_ship.frontier.scores import SHARES, error_summary, relative_error
from pymc_ship.motion.equations import reference_coefficients
from pymc_ship.regression.identify import identify
from pymc_ship.trajectory.fit import TrajectoryError, TrajectoryFit
from pymc_ship.trajectory.posterior import TrajectoryMode, trajectory_mode
from pymc_ship.trajectory.runs import trajectory_run
from pymc_ship.vessel.vessel import Vessel

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


@dataclass(frozen=True, eq=False)
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

    def scores(self, vessel: Vessel) -> dict[str, float]:
        """Error summary against the reference and ``coverage``, the share [%] of references inside the intervals."""
        reference = reference_coefficients(vessel)
        inside = (self.lower <= reference) & (reference <= self.upper)
        coverage = 100.0 * float(inside.mean()) if np.isfinite(self.coefficients).all() else float("nan")
        return error_summary(relative_error(self.coefficients, reference)) | {"coverage": coverage}


def exact_estimate(exact: Mapping[str, object]) -> Estimate:
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
    found = identify(trial, vessel, families=("conjugate",), derivative=derivative, interval=interval)
    return exact_estimate(found.exact["conjugate"])


def differencing_estimates(smooth: xr.Dataset, vessel: Vessel) -> dict[str, Estimate]:
    """Estimates by every way of :data:`DIFFERENCES` from a denoised trial."""
    return {
        name: regression_estimate(smooth, vessel, derivative=derivative, interval=interval)
        for name, (derivative, interval) in DIFFERENCES.items()
    }


def weak_form_estimate(noisy: xr.Dataset, vessel: Vessel, *, method: str = "rk4") -> Estimate:
    """Estimate by the weak form from a trial as it was measured; "euler" is exact for Euler steps of its interval."""
    derivative = {"rk4": "weak", "euler": "weak_euler"}[method]
    return regression_estimate(noisy, vessel, derivative=derivative, interval=WEAK_FORM_INTERVAL)


def trajectory_modes(
    trials: xr.Dataset | Sequence[xr.Dataset], vessel: Vessel, priors: Sequence[str], **settings
) -> dict[str, TrajectoryMode | None]:
    """Posterior mode of :func:`trajectory_posterior.trajectory_mode` by prior; None where no start converges."""
    modes: dict[str, TrajectoryMode | None] = {}
    for prior in priors:
        try:
            modes[prior] = trajectory_mode(trials, vessel, prior, **settings)
        except TrajectoryError:
            modes[prior] = None
    return modes


def cramer_rao_bound(
    trials: xr.Dataset | Sequence[xr.Dataset],
    vessel: Vessel,
    noise_sd: Mapping[str, float] | Sequence[Mapping[str, float]],
    *,
    method: str = "rk4",
) -> xr.DataArray:
    """Least standard deviation of unbiased estimates from clean trials with white noise put on them.

    Parameters
    ----------
    trials : Dataset or sequence of Dataset, dims (time,)
        Clean runs of the reference ship; their initial states count as unknown.
    vessel : Vessel
    noise_sd : mapping of str to float, or sequence of them
        Standard deviation of the noise of single samples by channel [SI], of all runs or of each.
    method : {"rk4", "euler"}, optional
        Integrator that made the trials.

    Returns
    -------
    DataArray, dims (coefficient,)
        Prime values; see :func:`pymc_ship.identifiability`.
    """
    trials = [trials] if isinstance(trials, xr.Dataset) else list(trials)
    noises = [noise_sd] * len(trials) if isinstance(noise_sd, Mapping) else list(noise_sd)
    runs, states = [], []
    for trial, noise in zip(trials, noises, strict=True):
        run = trajectory_run(trial, vessel, noise_sd=noise, method=method)
        state = run.initial_state[0].copy()
        state[list(run.rows)] = run.samples[:, 0]
        runs.append(run)
        states.append(state)
    return identifiability(runs, vessel, initial_states=states)["bound"]


def errors_on_bound(relative_bound: np.ndarray) -> dict[str, float]:
    """Error summary to expect of normal, unbiased estimates whose standard deviations are the bound.

    Parameters
    ----------
    relative_bound : ndarray
        [%] of each coefficient, positive; NaN where the reference is zero, infinite where the data tell nothing.

    Returns
    -------
    dict
        As :func:`tables.error_summary`: expected shares, and the error [%] that half of the coefficients stay under.
    """
    known = relative_bound[~np.isnan(relative_bound)]

    def share(limit: float) -> float:
        """Expected share of the errors under a limit."""
        return float(np.mean(erf(limit / (np.sqrt(2.0) * known))))

    most = 10.0 * np.max(known, initial=0.0, where=np.isfinite(known))
    median = brentq(lambda error: share(error) - 0.5, 0.0, most) if most and share(most) > 0.5 else float("inf")
    shares = {f"under_{limit:g}": 100.0 * share(limit) for limit in SHARES}
    return {"coefficients": known.size, "median": median, **shares}
