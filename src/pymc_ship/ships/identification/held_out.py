"""Leave-one-run-out cross-validation: log predictive density of windows and indices of manoeuvres.

The score of a run is a mean over windows of a sum over channels: each channel of a run counts as one observation.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from types import MappingProxyType
from typing import Any

import numpy as np
import xarray as xr

from pymc_ship.inference.trajectory.randomize_then_optimize import randomize_then_optimize
from pymc_ship.inference.trajectory.windows import Window, WindowFit, window_misfit, with_constants
from pymc_ship.physics.forces.surroundings import CURRENT, CURRENT_COMPONENTS
from pymc_ship.physics.manoeuvre.indices import indices
from pymc_ship.physics.manoeuvre.standard import Manoeuvre
from pymc_ship.physics.manoeuvre.steering_record import base_course
from pymc_ship.physics.motion.simulation import simulate
from pymc_ship.physics.motion.stepping import simulation_settings
from pymc_ship.physics.vessel.vessel import Vessel, coefficient_names
from pymc_ship.records.steering.measured import index_draws, measured_indices, recorded_settings
from pymc_ship.records.steering.recognition import unrecognised_text
from pymc_ship.ships.ensemble.draws import robust_sd
from pymc_ship.ships.ensemble.index_error import index_scale
from pymc_ship.trial.channels import default_channels, unmodelled_roll_text
from pymc_ship.trial.record import nonzero_channels

SCORED_CHANNELS = default_channels(rolling=False)
"""Channels of the score, the same for a model that rolls and one that does not."""

_LOG_2PI = np.log(2.0 * np.pi)
_RECORD_DRAWS = 40  # draws of the denoised motion of a recorded manoeuvre


@dataclass(frozen=True)
class CrossValidation:
    """Fits without each run, and their predictions of it."""

    fits: tuple[WindowFit, ...]  # fit to all runs but that of the same index
    coefficients: tuple[np.ndarray, ...]  # (n_coefficients,) of each fit, with the constants of the held-out run
    log_density: np.ndarray  # (n_runs,); log predictive density, minus infinity with a diverged window
    rms: dict[str, float]  # RMS error of each channel over the held-out windows that did not diverge [SI]

    def draws(self, k: int, count: int, rng: np.random.Generator) -> np.ndarray:
        """Draws of the fit without run k, with the constants of the run, (count, n_coefficients)."""
        return randomize_then_optimize(self.fits[k], count, rng) + self.coefficients[k] - self.fits[k].coefficients


def cross_validate(
    runs: Sequence[Sequence[Window]],
    vessel: Vessel,
    fit: Callable[[Sequence[Window]], WindowFit],
    scored_windows: Sequence[Sequence[Window]] | None = None,
) -> CrossValidation:
    """Leave each run out once, fit to the others, and score its windows with its own current.

    ``runs`` are the windows of two runs or more, ``fit`` estimates the coefficients from the windows of several runs,
    and ``scored_windows`` are those for the score, by default the same.
    """
    fits = [fit([window for j, run in enumerate(runs) if j != k for window in run]) for k in range(len(runs))]
    run_coefficients = [with_constants(windows, fold) for windows, fold in zip(runs, fits, strict=True)]
    return score_folds(scored_windows or runs, vessel, fits, run_coefficients)


def hold_out_harder(
    runs: Sequence[Sequence[Window]],
    harder: Sequence[int],
    vessel: Vessel,
    fit: Callable[[Sequence[Window]], WindowFit],
    each: CrossValidation,
) -> CrossValidation:
    """As :func:`cross_validate`, all harder runs left out at once; ``each`` is with one run left out."""
    if len(harder) == 1:
        milder_fit = each.fits[harder[0]]
    else:
        milder_fit = fit([window for k, windows in enumerate(runs) if k not in harder for window in windows])
    held_out = [runs[k] for k in harder]
    fits = [milder_fit] * len(harder)
    return score_folds(held_out, vessel, fits, [with_constants(windows, milder_fit) for windows in held_out])


def score_folds(
    runs: Sequence[Sequence[Window]],
    vessel: Vessel,
    fits: Sequence[WindowFit],
    coefficients: Sequence[np.ndarray] | None = None,
) -> CrossValidation:
    """Score the windows of each run under its fit, or under given coefficients."""
    run_coefficients = [fit.coefficients for fit in fits] if coefficients is None else coefficients
    misfits = [
        [window_misfit(window, vessel, values) for window in windows]
        for windows, values in zip(runs, run_coefficients, strict=True)
    ]
    square = np.array([np.mean(misfit**2, axis=1) for run in misfits for misfit in run])
    complete = np.isfinite(square).all(axis=1)
    sd = np.sqrt(np.mean(square[complete], axis=0)) if complete.any() else np.full(square.shape[1], np.nan)
    channels = runs[0][0].run.channels
    channel_rows = [row for row, name in enumerate(channels) if name in SCORED_CHANNELS]
    by_window = [[_log_density(misfit[channel_rows], sd[channel_rows]) for misfit in run] for run in misfits]
    log_density = np.array([np.mean(of_run) for of_run in by_window])
    rms = dict(zip(channels, sd.tolist(), strict=True))
    return CrossValidation(tuple(fits), tuple(run_coefficients), log_density, rms)


def _log_density(misfit: np.ndarray, sd: np.ndarray) -> float:
    """Log density of one window by the mean square of each channel."""
    square = np.mean(misfit**2, axis=1)
    if not np.isfinite(square).all():
        return -np.inf
    return float(-np.sum(np.log(sd) + 0.5 * _LOG_2PI + 0.5 * square / sd**2))


def _through_water(
    trial: xr.Dataset, manoeuvre: Manoeuvre, vessel: Vessel, coefficients: np.ndarray
) -> tuple[Manoeuvre, np.ndarray, dict]:
    """Manoeuvre, coefficients and settings with the run's current subtracted from the approach speed over ground."""
    settings = recorded_settings(trial, vessel)
    if CURRENT.name not in vessel.parts:
        return manoeuvre, coefficients, settings
    names, in_still_water = coefficient_names(vessel), coefficients.copy()
    current_indices = [names.index(name) for name in CURRENT_COMPONENTS]
    drift = vessel.particulars.nominal_speed * complex(*coefficients[0, current_indices])
    drift *= np.exp(-1j * base_course(trial))
    in_still_water[:, current_indices] = 0.0
    settings["current"] = abs(drift), float(np.rad2deg(np.angle(drift)))
    return replace(manoeuvre, approach_speed=manoeuvre.approach_speed - drift.real), in_still_water, settings


def forecast_indices(
    vessel: Vessel, coefficients: np.ndarray, manoeuvre: Manoeuvre, duration: float, **settings_of_run: Any
) -> dict[str, np.ndarray]:
    """Scored indices of a manoeuvre for each row of coefficients, shape (n_draws,), with settings of a simulation."""
    settings = simulation_settings(vessel, **settings_of_run, duration=duration)
    simulated = indices(simulate(vessel, manoeuvre, coefficients=coefficients, **settings))
    return {name: simulated[name].values for name in manoeuvre.traits.scored if name in simulated}


def recorded_indices(trial: xr.Dataset, manoeuvre: Manoeuvre, rudder_delay: float = 0.0) -> dict[str, float]:
    """Scored indices of a recorded standard manoeuvre, NaN where missing; ``rudder_delay`` [s] of the steering gear."""
    measured = measured_indices(trial, manoeuvre.attrs | {"rudder_delay": rudder_delay})
    return {name: measured.get(name, np.nan) for name in manoeuvre.traits.scored}


def index_noise_sd(trial: xr.Dataset, manoeuvre: Manoeuvre, delay: float, rng: np.random.Generator) -> dict[str, float]:
    """Sd of each index over draws of the denoised motion; ``delay`` [s] of the steering gear."""
    draws_by_index = index_draws(trial, manoeuvre.attrs | {"rudder_delay": delay}, draws=_RECORD_DRAWS, rng=rng)
    return {name: float(np.std(values)) for name, values in draws_by_index.items()}


def unscored_run_remarks(
    trials: Mapping[str, xr.Dataset], manoeuvres: Sequence[Manoeuvre | None], vessel: Vessel
) -> list[str]:
    """Remarks on runs without a recognised manoeuvre, and on roll that is not modelled."""
    unit = vessel.particulars.ship_time
    remarks = [
        f"Run {name}: {unrecognised_text(trial, unit)} The fit uses it, but no index is compared."
        for (name, trial), manoeuvre in zip(trials.items(), manoeuvres, strict=True)
        if manoeuvre is None
    ]
    recorded = dict.fromkeys(name for trial in trials.values() for name in nonzero_channels(trial))
    roll_remark = unmodelled_roll_text(recorded, vessel.dofs)
    return [*remarks, roll_remark] if roll_remark else remarks


def forecast_rows(
    run: str,
    trial: xr.Dataset,
    manoeuvre: Manoeuvre,
    models: Sequence[tuple[Vessel, np.ndarray]],
    weight: np.ndarray,
    noise: Mapping[str, float] = MappingProxyType({}),
) -> list[dict]:
    """Measured indices of a held-out run and their forecasts.

    ``models`` are fits without the run, with its constants: a vessel and the estimate, then draws, shape (1 + n_draws,
    n_coefficients); ``weight`` has shape (n_models,); ``noise`` is the sd of the measured indices, from
    :func:`index_noise_sd`. Rows have ``run``, ``manoeuvre``, ``index``, ``kind``, ``measured``, ``forecast``,
    ``parameter_sd``, ``model_sd`` (between the models), ``measured_sd`` and ``scale``, for every index that the run and
    all models with it reach.
    """
    duration = float(np.ptp(trial["time"].values))
    forecasts = []
    for vessel, coefficients in models:
        adjusted, in_still_water, settings_of_run = _through_water(trial, manoeuvre, vessel, coefficients)
        forecasts.append(forecast_indices(vessel, in_still_water, adjusted, duration, **settings_of_run))
    rows = []
    delay = models[0][0].particulars.rudder_delay
    for name, measured in recorded_indices(trial, manoeuvre, delay).items():
        models_with_index = [k for k, values in enumerate(forecasts) if name in values]
        if not models_with_index:
            continue
        weights = weight[models_with_index] / weight[models_with_index].sum()
        index_draws = [forecasts[k][name] for k in models_with_index]
        mean = np.array([values[0] for values in index_draws])
        sd = np.array([robust_sd(values[1:]) for values in index_draws])
        forecast = float(weights @ mean)
        kind = manoeuvre.traits.indices[name].quantity
        scale = float(index_scale(kind, measured, manoeuvre.heading_deg, models[0][0]))
        if np.isfinite([measured, forecast, *sd]).all() and scale > 0.0:
            between = float(np.sqrt(weights @ (mean - forecast) ** 2))
            row: dict[str, Any] = {"run": run, "manoeuvre": manoeuvre.label, "index": name, "kind": kind}
            row |= {"measured": measured, "forecast": forecast, "parameter_sd": float(np.sqrt(weights @ sd**2))}
            rows.append(row | {"model_sd": between, "measured_sd": noise.get(name, 0.0), "scale": scale})
    return rows
