"""The Cramer-Rao bound of clean trials, and the errors of estimates that reach it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
import xarray as xr
from scipy.optimize import brentq
from scipy.special import erf

from pymc_ship.inference.identifiability.information import identifiability
from pymc_ship.inference.trajectory.runs import trajectory_run
from pymc_ship.physics.vessel.vessel import Vessel
from pymc_ship.trial.record import trial_list

SHARES = (5.0, 20.0, 50.0)
"""Error limits [%] under which shares of the coefficients are counted."""


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
    trials = trial_list(trials)
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
