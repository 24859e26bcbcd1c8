"""The Cramer-Rao bound of clean trials, and the errors of estimates that reach it."""

from collections.abc import Mapping, Sequence

import numpy as np
import scipy
import xarray as xr

from pymc_ship.inference.identifiability.information import identifiability
from pymc_ship.inference.trajectory.runs import trajectory_run
from pymc_ship.physics.vessel.vessel import Vessel
from pymc_ship.trial.record import trial_list

ERROR_LIMITS = (5.0, 20.0, 50.0)  # error limits [%] of the counts of coefficients


def cramer_rao_bound(
    trials: xr.Dataset | Sequence[xr.Dataset],
    vessel: Vessel,
    noise_sd: Mapping[str, float] | Sequence[Mapping[str, float]],
    *,
    method: str = "rk4",
) -> xr.DataArray:
    """Cramer-Rao bound on the sd of coefficients (prime) from clean trials of the reference ship plus white noise.

    Initial states count as unknown. ``noise_sd`` is the sd of single samples by channel [SI], for all runs or for each;
    ``method`` the integrator of the trials.
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
    """Expected summary of the errors of normal, unbiased estimates that reach a relative bound [%]; NaN: left out."""
    bounds = relative_bound[~np.isnan(relative_bound)]

    def probability(limit: float) -> float:
        """Mean probability of an error under a limit [%]."""
        return float(np.mean(scipy.special.erf(limit / (np.sqrt(2.0) * bounds))))

    most = 10.0 * np.max(bounds, initial=0.0, where=np.isfinite(bounds))
    half = most and probability(most) > 0.5
    median = scipy.optimize.brentq(lambda error: probability(error) - 0.5, 0.0, most) if half else float("inf")
    counts = {f"under_{limit:g}": 100.0 * probability(limit) for limit in ERROR_LIMITS}
    return {"coefficients": bounds.size, "median": median, **counts}
