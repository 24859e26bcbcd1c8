"""Cross-validation over whole runs: a model is fitted to all runs but one and judged on that one.

The score of a run is the log predictive density of its windows, restarted from the measured state: the mean over
windows of a sum over channels, so that each channel of a run counts as one observation. What a model cannot do it
cannot do in all windows of a run. Whole runs are left out because a window from a run that was trained on knows its
rudder zero, its weather and its loading. Standard manoeuvres among the runs are forecast in closed loop, too, from the
approach speed, and their indices compared.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from types import MappingProxyType
from typing import Any

import numpy as np
import xarray as xr

from pymc_ship.inference.trajectory.randomize_then_optimize import randomize_then_optimize
from pymc_ship.inference.trajectory.windows import Window, WindowFit, window_misfit, with_constants
from pymc_ship.physics.forces.surroundings import CURRENT, CURRENT_COMPONENTS, WIND
from pymc_ship.physics.manoeuvre.indices import indices
from pymc_ship.physics.manoeuvre.standard import Manoeuvre
from pymc_ship.physics.manoeuvre.steering_record import base_course, first_execute
from pymc_ship.physics.motion.inputs import revolutions_measured, takes_revolutions
from pymc_ship.physics.motion.simulation import simulate
from pymc_ship.physics.motion.stepping import simulation_settings
from pymc_ship.physics.vessel.vessel import Vessel, coefficient_names
from pymc_ship.records.steering.measured import index_draws, measured_indices
from pymc_ship.records.steering.recognition import unrecognised_text
from pymc_ship.ships.ensemble.draws import robust_sd
from pymc_ship.ships.ensemble.index_error import index_scale
from pymc_ship.trial.channels import default_channels, unmodelled_roll_text
from pymc_ship.trial.record import nonzero_channels

SCORED_CHANNELS = default_channels(rolling=False)
"""Channels of the score, the same for a model that rolls and one that does not."""

_LOG_2PI = np.log(2.0 * np.pi)
_READINGS = 40  # draws of the denoised motion of a recorded manoeuvre


@dataclass(frozen=True)
class CrossValidation:
    """What a model said of runs it was not fitted to.

    Attributes
    ----------
    fits : tuple of WindowFit
        Fit to all runs but the one of the same place.
    coefficients : tuple of ndarray, shape (n_coefficients,)
        Of each fit, with the constants that the run it has not seen calls for.
    log_density : ndarray, shape (n_runs,)
        Log predictive density of each run; minus infinity where a window ran away.
    rms : dict of str to float
        Root mean square error of each channel over all held-out windows that did not run away, SI; NaN without any.
    """

    fits: tuple[WindowFit, ...]
    coefficients: tuple[np.ndarray, ...]
    log_density: np.ndarray
    rms: dict[str, float]

    def draws(self, k: int, count: int, rng: np.random.Generator) -> np.ndarray:
        """Draws of the fit without run k, with the constants that the run calls for, (count, n_coefficients)."""
        return randomize_then_optimize(self.fits[k], count, rng) + self.coefficients[k] - self.fits[k].coefficients


def cross_validate(
    runs: Sequence[Sequence[Window]],
    vessel: Vessel,
    fit: Callable[[Sequence[Window]], WindowFit],
    judged: Sequence[Sequence[Window]] | None = None,
) -> CrossValidation:
    """Leave each run out once, fit to the others, and score its windows, with the current that it calls for.

    Parameters
    ----------
    runs : sequence of sequence of Window
        Windows of each run; two runs or more.
    vessel : Vessel
    fit : callable
        Fit to the windows of several runs; or any other estimate of the coefficients from them.
    judged : sequence of sequence of Window, optional
        Other windows of each run, by which it is judged.

    Returns
    -------
    HeldOut
    """
    fits = []
    for k in range(len(runs)):
        fits.append(fit([window for j, windows in enumerate(runs) if j != k for window in windows]))
    own = [with_constants(windows, one) for windows, one in zip(runs, fits, strict=True)]
    return score_folds(judged or runs, vessel, fits, own)


def score_folds(
    runs: Sequence[Sequence[Window]],
    vessel: Vessel,
    fits: Sequence[WindowFit],
    coefficients: Sequence[np.ndarray] | None = None,
) -> CrossValidation:
    """Score the windows of each run under the fit of its place, or under coefficients that stand for it."""
    own = [fit.coefficients for fit in fits] if coefficients is None else coefficients
    misfits = [
        [window_misfit(window, vessel, values) for window in windows] for windows, values in zip(runs, own, strict=True)
    ]
    square = np.array([np.mean(misfit**2, axis=1) for run in misfits for misfit in run])
    stayed = np.isfinite(square).all(axis=1)
    sd = np.sqrt(np.mean(square[stayed], axis=0)) if stayed.any() else np.full(square.shape[1], np.nan)
    channels = runs[0][0].run.channels
    judged = [row for row, name in enumerate(channels) if name in SCORED_CHANNELS]
    log_density = np.array(
        [np.mean([_log_density(np.mean(misfit[judged] ** 2, axis=1), sd[judged]) for misfit in run]) for run in misfits]
    )
    return CrossValidation(tuple(fits), tuple(own), log_density, dict(zip(channels, sd.tolist(), strict=True)))


def _log_density(square: np.ndarray, sd: np.ndarray) -> float:
    """Log density of one window: each channel once, at its mean square."""
    if not np.isfinite(square).all():
        return -np.inf
    return float(-np.sum(np.log(sd) + 0.5 * _LOG_2PI + 0.5 * square / sd**2))


def recorded_settings(trial: xr.Dataset, vessel: Vessel) -> dict[str, Any]:
    """Revolutions [1/s] and wind (speed [m/s], from where to the base course [deg]) of a recorded manoeuvre.

    As settings of a simulation: those that were measured and that the forces of the vessel know.
    """
    found: dict[str, Any] = {}
    after = trial["time"].values >= first_execute(trial)
    if takes_revolutions(vessel) and revolutions_measured(trial):
        found["n"] = float(np.median(trial["n"].values[after]))
    if WIND.name in vessel.parts and {"wind_speed", "wind_direction"} <= set(trial.data_vars):
        flow = np.mean((trial["wind_speed"].values * np.exp(1j * trial["wind_direction"].values))[after])
        found["wind"] = float(np.abs(flow)), float(np.rad2deg(np.angle(flow) - base_course(trial)))
    return found


def _through_water(
    trial: xr.Dataset, manoeuvre: Manoeuvre, vessel: Vessel, coefficients: np.ndarray
) -> tuple[Manoeuvre, np.ndarray, dict]:
    """A recorded manoeuvre as it was sailed through the water: manoeuvre, coefficients and settings of a simulation.

    Where speeds were measured over ground, the constants of the run hold its current. The approach speed is then less
    what the current adds along the base course, and the track drifts with the current.
    """
    settings = recorded_settings(trial, vessel)
    if CURRENT.name not in vessel.parts:
        return manoeuvre, coefficients, settings
    names, still = coefficient_names(vessel), coefficients.copy()
    places = [names.index(name) for name in CURRENT_COMPONENTS]
    drift = vessel.particulars.nominal_speed * complex(*coefficients[0, places])
    drift *= np.exp(-1j * base_course(trial))
    still[:, places] = 0.0
    settings["current"] = abs(drift), float(np.rad2deg(np.angle(drift)))
    return replace(manoeuvre, approach_speed=manoeuvre.approach_speed - drift.real), still, settings


def forecast_indices(
    vessel: Vessel, coefficients: np.ndarray, manoeuvre: Manoeuvre, duration: float, **around: Any
) -> dict[str, np.ndarray]:
    """Scored indices of a manoeuvre that the vessel models, for each row of coefficients, each of shape (n_draws,).

    ``around`` are revolutions, wind and current, as of :func:`pymc_ship.simulate`.
    """
    settings = simulation_settings(vessel) | around
    found = indices(simulate(vessel, manoeuvre, duration=duration, coefficients=coefficients, **settings))
    return {name: found[name].values for name in manoeuvre.traits.scored if name in found}


def recorded_indices(trial: xr.Dataset, manoeuvre: Manoeuvre, rudder_delay: float = 0.0) -> dict[str, float]:
    """Scored indices of a recorded standard manoeuvre; NaN where the record ends before them or lacks a channel.

    A zigzag that was steered by hand was reversed ``rudder_delay`` [s] before its rudder moved.
    """
    found = measured_indices(trial, manoeuvre.attrs | {"rudder_delay": rudder_delay})
    return {name: found.get(name, np.nan) for name in manoeuvre.traits.scored}


def index_noise_sd(trial: xr.Dataset, manoeuvre: Manoeuvre, delay: float, rng: np.random.Generator) -> dict[str, float]:
    """Standard deviation of each index of a recorded manoeuvre over draws of its denoised motion.

    Indices that no draw reaches have none, nor has a record that cannot be denoised; ``delay`` [s] is that of the
    steering gear.
    """
    drawn = index_draws(trial, manoeuvre.attrs | {"rudder_delay": delay}, draws=_READINGS, rng=rng)
    return {name: float(np.std(values)) for name, values in drawn.items()}


def unscored_run_remarks(
    trials: Mapping[str, xr.Dataset], manoeuvres: Sequence[Manoeuvre | None], vessel: Vessel
) -> list[str]:
    """Sentences on runs without held-out indices, as no manoeuvre is recognised, and on channels not modelled."""
    found = [
        f"Run {name}: {unrecognised_text(trial)} It is fitted, but no index of it is held out."
        for (name, trial), manoeuvre in zip(trials.items(), manoeuvres, strict=True)
        if manoeuvre is None
    ]
    recorded = dict.fromkeys(name for trial in trials.values() for name in nonzero_channels(trial))
    unrolled = "" if "roll" in vessel.dofs else unmodelled_roll_text(recorded)
    return [*found, unrolled] if unrolled else found


def forecast_rows(
    run: str,
    trial: xr.Dataset,
    manoeuvre: Manoeuvre,
    models: Sequence[tuple[Vessel, np.ndarray]],
    weight: np.ndarray,
    noise: Mapping[str, float] = MappingProxyType({}),
) -> list[dict]:
    """Indices of a held-out run beside their forecast.

    Parameters
    ----------
    run : str
        Name of the run.
    trial : Dataset, dims (time,)
    manoeuvre : Manoeuvre
    models : sequence of (Vessel, ndarray of shape (1 + n_draws, n_coefficients))
        Fits made without the run, with the constants that the run calls for: the estimate, then draws.
    weight : ndarray, shape (n_models,)
    noise : mapping of str to float, optional
        Standard deviation of the measured indices, from :func:`index_noise_sd`; exact ones by default.

    Returns
    -------
    list of dict
        ``run``, ``manoeuvre``, ``index``, ``kind``, ``measured``, ``forecast``, ``parameter_sd``, ``model_sd`` (between
        the models), ``measured_sd`` and ``scale``, for every index that the run and all models reach that have it:
        models without roll say nothing of its angle.
    """
    duration = float(np.ptp(trial["time"].values))
    found = []
    for vessel, coefficients in models:
        approached, still, around = _through_water(trial, manoeuvre, vessel, coefficients)
        found.append(forecast_indices(vessel, still, approached, duration, **around))
    rows = []
    delay = models[0][0].particulars.rudder_delay
    for name, measured in recorded_indices(trial, manoeuvre, delay).items():
        having = [k for k, values in enumerate(found) if name in values]
        if not having:
            continue
        share, drawn = weight[having] / weight[having].sum(), [found[k][name] for k in having]
        mean = np.array([values[0] for values in drawn])
        sd = np.array([robust_sd(values[1:]) for values in drawn])
        forecast = float(share @ mean)
        kind = manoeuvre.traits.indices[name].quantity
        scale = float(index_scale(kind, measured, manoeuvre.heading_deg, models[0][0]))
        if np.isfinite([measured, forecast, *sd]).all() and scale > 0.0:
            between = float(np.sqrt(share @ (mean - forecast) ** 2))
            row: dict[str, Any] = {"run": run, "manoeuvre": manoeuvre.label, "index": name, "kind": kind}
            row |= {"measured": measured, "forecast": forecast, "parameter_sd": float(np.sqrt(share @ sd**2))}
            rows.append(row | {"model_sd": between, "measured_sd": noise.get(name, 0.0), "scale": scale})
    return rows
