"""Posterior mode of whole trajectories from two weak-form starts."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
import xarray as xr

from pymc_ship.inference.rows.weak_form import weak_form_start
from pymc_ship.inference.trajectory.fit import fit_trajectory
from pymc_ship.inference.trajectory.noise import NoiseChoice, fit_with_noise
from pymc_ship.inference.trajectory.prior import KINDS, CoefficientPrior, coefficient_prior
from pymc_ship.inference.trajectory.runs import Run, trajectory_run
from pymc_ship.machine.arguments import short_repr
from pymc_ship.machine.errors import FitError, InferenceError
from pymc_ship.physics.motion.equations import STATE
from pymc_ship.physics.motion.replay import replay
from pymc_ship.physics.vessel.vessel import Vessel, reference_coefficients
from pymc_ship.records.checks.run_set import run_set_flags
from pymc_ship.trial.record import numbered_trials, trial_list

_SAME_MODE_SD = 0.5  # largest distance of equal modes [posterior sd]


@dataclass(frozen=True)
class TrajectoryMode:
    """Best mode of several starts, how many reached it, and the quality flags of the records."""

    choice: NoiseChoice
    n_starts: int
    n_agreeing: int
    quality_flags: dict[str, str]


def trajectory_mode(
    trials: xr.Dataset | Sequence[xr.Dataset],
    vessel: Vessel,
    prior: str | CoefficientPrior = "order_damped",
    *,
    channels: Sequence[str] | None = None,
    noise_sd: Mapping[str, float] | None = None,
    noise: str = "auto",
    offsets: bool | None = None,
    method: str = "rk4",
) -> TrajectoryMode:
    """Posterior mode from weak-form starts about the mean of the prior and about 0, under the noise model of the first.

    Parameters, errors and references as :func:`pymc_ship.trajectory_posterior`.
    """
    trials = trial_list(trials)
    if not trials:
        raise FitError("A trajectory fit needs at least one trial, found none; give one.")
    quality = run_set_flags(numbered_trials(trials), vessel.particulars.L)
    runs = [trajectory_run(trial, vessel, channels=channels, noise_sd=noise_sd, method=method) for trial in trials]
    trials = [_with_missing_states(trial, run, vessel) for trial, run in zip(trials, runs, strict=True)]
    if isinstance(prior, str):
        prior = coefficient_prior(trials, vessel, prior)
    if not isinstance(prior, CoefficientPrior):
        raise InferenceError(
            f"The prior of a trajectory fit is a CoefficientPrior or one of {', '.join(KINDS)}, found "
            f"{short_repr(type(prior))}; make one by coefficient_prior."
        )
    proper = (prior if np.isfinite(prior.scale).all() else coefficient_prior(trials, vessel)).fixed
    starts = (proper.mean, proper.scale), (np.zeros(proper.mean.size), np.hypot(proper.mean, proper.scale))
    first, second = (weak_form_start(trials, vessel, *start, method=method) for start in starts)
    try:
        choice = fit_with_noise(runs, vessel, prior, first, noise=noise, offsets=offsets)
    except FitError:
        return TrajectoryMode(fit_with_noise(runs, vessel, prior, second, noise=noise, offsets=offsets), 2, 1, quality)
    fit = choice.fit
    try:
        other = fit_trajectory(fit.problem, np.r_[second, fit.unknowns[second.size :]])
    except FitError:
        return TrajectoryMode(choice, 2, 1, quality)
    distance_sd = np.max(np.abs(other.coefficients - fit.coefficients) / fit.sd)
    if other.log_evidence > fit.log_evidence and distance_sd >= _SAME_MODE_SD:
        choice = replace(choice, fit=other)
    return TrajectoryMode(choice, 2, 2 if distance_sd < _SAME_MODE_SD else 1, quality)


def _with_missing_states(trial: xr.Dataset, run: Run, vessel: Vessel) -> xr.Dataset:
    """Trial with its unmeasured states simulated along the measured rudder by the reference coefficients."""
    missing = [name for name in STATE[: 5 if run.rolls else 3] if name not in run.channels]
    if not missing:
        return trial
    start, theta = run.initial_state[0], reference_coefficients(vessel)
    motion = replay(vessel, run.inputs, start, theta, **run.integration)[:, 0]
    if not np.isfinite(motion).all():
        raise FitError(
            f"A fit without {', '.join(missing)} simulates them by the coefficients of the vessel file, found that the "
            "simulation leaves the model's range along this rudder; use the coefficients of a similar ship."
        )
    return trial.assign({name: ("time", motion[STATE.index(name)]) for name in missing})
