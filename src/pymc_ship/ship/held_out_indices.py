"""Indices of held-out manoeuvres beside their forecasts."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
import xarray as xr

from pymc_ship.forecasting.index_error import index_scale, robust_sd
from pymc_ship.manoeuvre.recognition import unrecognised
from pymc_ship.manoeuvre.standard import Manoeuvre
from pymc_ship.ship.held_out import forecast_indices, sailed_in, scored_indices
from pymc_ship.trial.channels import without_roll
from pymc_ship.trial.record import moving
from pymc_ship.vessel.vessel import Vessel


def left_out(trials: Mapping[str, xr.Dataset], manoeuvres: Sequence[Manoeuvre | None], vessel: Vessel) -> list[str]:
    """Sentences on runs without held-out indices, as no manoeuvre is recognised, and on channels not modelled."""
    found = [
        f"Run {name}: {unrecognised(trial)} It is fitted, but no index of it is held out."
        for (name, trial), manoeuvre in zip(trials.items(), manoeuvres, strict=True)
        if manoeuvre is None
    ]
    recorded = dict.fromkeys(name for trial in trials.values() for name in moving(trial))
    unrolled = "" if "roll" in vessel.dofs else without_roll(recorded)
    return [*found, unrolled] if unrolled else found


def index_rows(
    run: str,
    trial: xr.Dataset,
    manoeuvre: Manoeuvre,
    models: Sequence[tuple[Vessel, np.ndarray]],
    weight: np.ndarray,
) -> list[dict]:
    """Indices of a held-out run beside their forecast.

    Parameters
    ----------
    run : str
        Name of the run.
    trial : Dataset, dims (time,)
    manoeuvre : Manoeuvre
    models : sequence of (Vessel, ndarray of shape (1 + n_draws, n_coefficients))
        Fits made without the run: the estimate, then draws.
    weight : ndarray, shape (n_models,)

    Returns
    -------
    list of dict
        ``run``, ``manoeuvre``, ``index``, ``kind``, ``measured``, ``forecast``, ``parameter_sd``, ``model_sd`` (between
        the models) and ``scale``, for every index that both reach.
    """
    duration = float(np.ptp(trial["time"].values))
    found = [
        forecast_indices(vessel, coefficients, manoeuvre, duration, **sailed_in(trial, vessel))
        for vessel, coefficients in models
    ]
    rows = []
    delay = models[0][0].particulars.rudder_delay
    for name, measured in scored_indices(trial, manoeuvre, delay).items():
        mean = np.array([values[name][0] for values in found])
        sd = np.array([robust_sd(values[name][1:]) for values in found])
        forecast = float(weight @ mean)
        if np.isfinite([measured, forecast, *sd]).all():
            between = float(np.sqrt(weight @ (mean - forecast) ** 2))
            kind = manoeuvre.traits.indices[name].quantity
            row = {"run": run, "manoeuvre": manoeuvre.label, "index": name, "kind": kind}
            row |= {"measured": measured, "forecast": forecast, "parameter_sd": float(np.sqrt(weight @ sd**2))}
            scale = index_scale(kind, measured, manoeuvre.heading_deg, models[0][0])
            rows.append(row | {"model_sd": between, "scale": float(scale)})
    return rows
