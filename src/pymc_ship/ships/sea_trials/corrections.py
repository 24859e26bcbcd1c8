"""Indices of a sea trial corrected for current, wind and loading, with the deviations by draws.

The current is subtracted from the denoised track. Wind and loading: R = T F / B (IMO MSC/Circ.1053, 3.4.1.2), with the
measured index T and the model's index at full load in calm, F, and in the trial's conditions, B.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import xarray as xr

from pymc_ship.machine.errors import TrialError
from pymc_ship.physics.manoeuvre.criteria import imo_limits
from pymc_ship.physics.manoeuvre.indices import indices
from pymc_ship.physics.manoeuvre.kinds import TRACK_QUANTITIES
from pymc_ship.physics.manoeuvre.standard import Manoeuvre
from pymc_ship.physics.manoeuvre.steering_record import base_course
from pymc_ship.physics.motion.inputs import recorded_wind
from pymc_ship.physics.motion.simulation import simulate
from pymc_ship.physics.motion.stepping import simulation_settings
from pymc_ship.physics.vessel.vessel import Vessel
from pymc_ship.records.steering.current import DriftCurrent, drift_current
from pymc_ship.records.steering.measured import denoise_motion, index_draws, indices_of_denoised, indices_of_draws
from pymc_ship.records.steering.stopping_tests import INDICES as STOPPING
from pymc_ship.records.steering.stopping_tests import LABEL, LIMIT, stopping_of_denoised, stopping_order
from pymc_ship.ships.ensemble.draws import thinned_draws
from pymc_ship.ships.sea_trials.conditions import Conditions
from pymc_ship.ships.sea_trials.loading import at_loading
from pymc_ship.trial.record import has_ground_speeds

DRAWS = 100  # draws of each part: record, current and model
_DRIFTS = 30  # draws of the wind drift
_LONGER = 1.3  # simulated time over that of the record, for slower draws


@dataclass(frozen=True)
class Model:
    """Models for the corrections of wind and loading."""

    # vessels with draws (n_draws, n_coefficients); empty for no correction
    models: list[tuple[Vessel, np.ndarray]] = field(default_factory=list)
    tried: Vessel | None = None  # at the loading of the trial
    loaded: Vessel | None = None  # at full load, where that is another loading
    wind: bool = True  # whether the models have wind forces; True in calm

    @property
    def corrects_wind(self) -> bool:
        """Whether the models have the forces of the wind."""
        return bool(self.models) and self.wind


def corrected_indices(
    trial: xr.Dataset,
    manoeuvre: Manoeuvre,
    vessel: Vessel,
    *,
    rudder_delay: float,
    wind: tuple[float, float] | None,
    current: DriftCurrent | None,
    model: Model,
    rng: np.random.Generator,
) -> list[dict]:
    """Indices of one run, measured and corrected, with the parts of their uncertainty.

    ``manoeuvre`` is recognised in the trial; ``rudder_delay`` [s]; ``wind`` has speed [m/s] and direction of origin
    [deg] of the mean true wind, None for no correction. Rows have ``index``, ``units`` (L for distances), ``raw``,
    ``without_current``, ``ratio`` F / B (1 without a model), ``corrected``, ``corrected_for`` (drift, wind, loading or
    nothing), ``limit`` of IMO MSC.137(76) (NaN for none), and the deviations ``u_record``, ``u_current`` and
    ``u_model``, shape (n_draws,), NaN where unknown. TrialError when every draw diverges in the manoeuvre.
    """
    attrs = manoeuvre.attrs | {"rudder_delay": rudder_delay, "approach_speed": manoeuvre.approach_speed}
    smooth, flow = denoise_motion(trial), np.zeros(2) if current is None else current.velocity
    measured = indices_of_denoised(smooth, attrs)
    in_still_water = indices_of_denoised(without_current(smooth, flow), attrs)
    by_record = _deviations(
        index_draws(trial, attrs, draws=DRAWS, rng=rng, corrected=lambda drawn: without_current(drawn, flow))
    )
    by_current = _by_current(smooth, current, attrs, rng)
    by_model = _ratios(manoeuvre, trial, wind, model)
    limits = {name: limit for name, limit, _, _ in imo_limits(attrs, vessel)}
    unknown = np.full(1, np.nan)
    rows = []
    for name, index in manoeuvre.traits.indices.items():
        if index.quantity not in TRACK_QUANTITIES or not np.isfinite(in_still_water.get(name, np.nan)):
            continue
        distance = index.units == "m"
        unit = vessel.particulars.L if distance else 1.0
        ratios = by_model.get(name, unknown if by_model or not model.wind else np.ones(1))
        ratio = float(np.nan_to_num(np.median(ratios), nan=1.0))
        modelled = {"wind": wind is not None, "loading": model.loaded is not None}
        causes = ["drift"] if in_still_water[name] != measured.get(name) else []
        causes += [cause for cause, applies in modelled.items() if applies and name in by_model]
        value = in_still_water[name] / unit
        rows.append(
            {
                "index": name,
                "units": "L" if distance else index.units,
                "raw": measured.get(name, np.nan) / unit,
                "without_current": value,
                "ratio": ratio,
                "corrected": value * ratio,
                "corrected_for": " and ".join(causes) or "nothing",
                "limit": limits.get(name, np.nan),
                "u_record": ratio * by_record.get(name, unknown) / unit,
                "u_current": ratio * by_current.get(name, unknown) / unit if distance else np.zeros(1),
                "u_model": value * (ratios - ratio),
            }
        )
    return rows


def corrected_stopping(
    trial: xr.Dataset, current: DriftCurrent | None, L: float, rng: np.random.Generator
) -> list[dict]:
    """Indices of a stopping test, measured and without the current; rows as :func:`corrected_indices`, in L, s, deg.

    The deviations of the current are those of an index that is linear in it.
    """
    flow, sd = (np.zeros(2), np.full(2, np.nan)) if current is None else (current.velocity, current.sd)
    smooth, begin = denoise_motion(trial), stopping_order(trial)
    flows = (np.zeros(2), flow, *(flow + np.diag(sd)))
    measured, still, *shifted = (stopping_of_denoised(without_current(smooth, one), begin) for one in flows)
    drawn = rng.standard_normal((DRAWS, 2))
    rows = []
    for name, units in STOPPING.items():
        scale = 1.0 / L if units == "m" else 1.0
        slopes = [scale * (one[name] - still[name]) for one in shifted]
        row: dict[str, Any] = {"manoeuvre": LABEL, "side": "", "index": name, "units": "L" if units == "m" else units}
        row |= {"raw": scale * measured[name], "without_current": scale * still[name], "ratio": 1.0}
        row |= {"corrected": row["without_current"], "u_current": drawn @ slopes}
        row["corrected_for"] = "drift" if still[name] != measured[name] else "nothing"
        row["limit"] = LIMIT if name == "track_reach" and np.isfinite(row["raw"]) else np.nan
        rows.append(row | dict.fromkeys(("u_record", "u_model"), np.full(1, np.nan)))
    return rows


def without_current(smooth: xr.Dataset, velocity: np.ndarray) -> xr.Dataset:
    """Trial with the current subtracted from track and velocities over ground.

    ``velocity`` [m/s] to north and east has shape (2,), or (n_draws, 2) for a trial of each draw, dims (draw, time).
    """
    channels, time = {}, smooth["time"].values - smooth["time"].values[0]
    north, east = velocity[..., 0, None], velocity[..., 1, None]
    for name, rate in (("x", north), ("y", east)):
        if name in smooth:
            channels[name] = smooth[name].values - rate * time
    if has_ground_speeds(smooth) and {"u", "v", "psi"} <= set(smooth.data_vars):
        body_current = (north + 1j * east) * np.exp(-1j * smooth["psi"].values)
        channels |= {"u": smooth["u"].values - body_current.real, "v": smooth["v"].values - body_current.imag}
    return smooth.assign({name: (("draw", "time")[-values.ndim :], values) for name, values in channels.items()})


def mean_wind(trial: xr.Dataset, conditions: Conditions) -> tuple[float, float] | None:
    """Speed [m/s] and direction of origin [deg] of a run's mean true wind: recorded, noted or None."""
    wind = recorded_wind(trial)
    return conditions.wind if wind is None else (abs(wind), float(np.rad2deg(np.angle(wind)) % 360.0))


def subtract_wind_drift(
    current: DriftCurrent, trial: xr.Dataset, manoeuvre: Manoeuvre, wind: tuple[float, float], model: Model
) -> DriftCurrent:
    """Current of a turn minus the model's wind drift in the same turn and wind; F / B corrects the indices for it."""
    course = float(base_course(trial))
    duration = _LONGER * float(trial["time"].values[-1] - trial["time"].values[0])
    drifts = []
    for vessel, rows in thinned_draws(model.models, _DRIFTS):
        settings = simulation_settings(vessel, duration=duration, wind=_from_bow(wind, course))
        ships = simulate(vessel, manoeuvre, coefficients=rows, **settings)
        ships = ships.isel(draw=~ships["diverged"].values)
        drifts += [drift_current(ships.isel(draw=k)).velocity @ (1.0, 1j) for k in range(ships.sizes["draw"])]
    if not drifts:
        raise TrialError(f"Every draw diverges in the {manoeuvre.label} in this wind; leave ship out.")
    over_ground = np.array(drifts) * np.exp(1j * course)
    parts = np.stack([over_ground.real, over_ground.imag], axis=1)
    return DriftCurrent(current.velocity - parts.mean(axis=0), np.hypot(current.sd, parts.std(axis=0)), current.local)


def _from_bow(wind: tuple[float, float], course: float) -> tuple[float, float]:
    """Wind relative to a base course of 0; course in rad, directions in deg."""
    return wind[0], wind[1] - float(np.rad2deg(course))


def _by_current(
    smooth: xr.Dataset, current: DriftCurrent | None, attrs: Mapping, rng: np.random.Generator
) -> dict[str, np.ndarray]:
    if current is None:
        return {}
    drawn = current.velocity + current.sd * rng.standard_normal((DRAWS, 2))
    return _deviations(indices_of_draws(without_current(smooth, drawn), attrs))


def _deviations(values: Mapping[str, np.ndarray]) -> dict[str, np.ndarray]:
    return {name: column - column.mean() for name, column in values.items()}


def _ratios(
    manoeuvre: Manoeuvre, trial: xr.Dataset, wind: tuple[float, float] | None, model: Model
) -> dict[str, np.ndarray]:
    """F / B of each index over draws of the ship; empty without a correction."""
    if not model.models or (wind is None and model.loaded is None):
        return {}
    trial_wind = None if wind is None else _from_bow(wind, base_course(trial))
    by_index: dict[str, list[np.ndarray]] = {}
    for vessel, rows in thinned_draws(model.models, DRAWS):
        full = vessel, rows
        if model.loaded is not None and model.tried is not None:
            full = at_loading(vessel, rows, model.tried, model.loaded)
        both_indices = []
        for ship, draws, wind_of_run in ((*full, None), (vessel, rows, trial_wind)):
            settings = simulation_settings(ship, duration=manoeuvre.traits.reach * ship.particulars.ship_time)
            both_indices.append(indices(simulate(ship, manoeuvre, coefficients=draws, wind=wind_of_run, **settings)))
        for name in both_indices[0]:
            with np.errstate(divide="ignore", invalid="ignore"):
                by_index.setdefault(str(name), []).append(both_indices[0][name].values / both_indices[1][name].values)
    ratios = {name: np.concatenate(values) for name, values in by_index.items()}
    ratios = {name: values[np.isfinite(values)] for name, values in ratios.items() if np.isfinite(values).any()}
    if not ratios:
        raise TrialError(f"Every draw diverges in the {manoeuvre.label} in these conditions; leave ship out.")
    return ratios
