"""Current, wind and loading taken off the indices of a sea trial, and how far draws leave what is left.

An index is measured on the denoised record, from whose track the current has been taken. Wind and loading are corrected
as IMO MSC/Circ.1053 has it (3.4.1.2): R = T F / B, the index T of the trial times what a model says of full load in
calm, F, over what the same model says of the trial's loading and wind, B.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np
import xarray as xr

from pymc_ship.machine.errors import TrialError
from pymc_ship.physics.manoeuvre.criteria import imo_limits
from pymc_ship.physics.manoeuvre.indices import indices
from pymc_ship.physics.manoeuvre.kinds import TRACK_QUANTITIES
from pymc_ship.physics.manoeuvre.standard import Manoeuvre
from pymc_ship.physics.manoeuvre.steering_record import base_course
from pymc_ship.physics.motion.simulation import simulate
from pymc_ship.physics.motion.stepping import simulation_settings
from pymc_ship.physics.vessel.vessel import Vessel
from pymc_ship.records.steering.measured import denoise_motion, finite_indices, index_draws, indices_of_denoised
from pymc_ship.ships.ensemble.draws import thinned_draws
from pymc_ship.ships.sea_trials.conditions import Conditions
from pymc_ship.ships.sea_trials.current import DriftCurrent, drift_current
from pymc_ship.ships.sea_trials.loading import at_loading
from pymc_ship.trial.record import OVER_GROUND

DRAWS = 100
"""Draws of the record, of the current and of the model, each."""

_DRIFTS = 30  # draws of the drift by the wind
_LONGER = 1.3  # than the record, for which ships turn that are slower than she


@dataclass(frozen=True)
class Model:
    """The ship by which wind and loading are corrected.

    Attributes
    ----------
    models : list of (Vessel, ndarray of shape (n_draws, n_coefficients))
        As identified, see :class:`pymc_ship.Ship`; empty where nothing is
        corrected.
    tried : Vessel or None
        Her file at the loading of the trial.
    loaded : Vessel or None
        Her file at full load, where that is another loading.
    wind : bool
        Whether the models know the wind that blew; True in calm.
    """

    models: list[tuple[Vessel, np.ndarray]] = field(default_factory=list)
    tried: Vessel | None = None
    loaded: Vessel | None = None
    wind: bool = True


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
    """Indices of one run as measured and corrected, with the parts of their uncertainty.

    Parameters
    ----------
    trial : Dataset, dims (time,)
        Checked and corrected record of the run.
    manoeuvre : Manoeuvre
        What the run was recognised as.
    vessel : Vessel
        Gives L.
    rudder_delay : float
        Of the steering gear [s].
    wind : (float, float) or None
        Speed [m/s] of the mean true wind and where it comes from [deg]; None where it is not corrected for.
    current : DriftCurrent or None
    model : Model
    rng : Generator

    Returns
    -------
    list of dict
        For each angle, time and distance that the record reaches: ``index``, ``units`` (L for distances), ``raw``,
        ``less_current``, ``ratio`` F / B (1 without a model), ``corrected``, ``limit`` of IMO MSC.137(76), NaN where
        there is none, and the deviations of ``u_record``, ``u_current`` and ``u_model``, arrays of shape (n_draws,).
        They are NaN for a record that cannot be denoised, a distance without a current, and a wind without a model.

    Raises
    ------
    TrialError
        When the model cannot sail the manoeuvre.
    """
    attrs = manoeuvre.attrs | {"rudder_delay": rudder_delay, "approach_speed": manoeuvre.approach_speed}
    smooth, flow = denoise_motion(trial), np.zeros(2) if current is None else current.velocity
    measured = indices_of_denoised(smooth, attrs)
    still = indices_of_denoised(without_current(smooth, flow), attrs)
    by_record = _by_record(trial, flow, attrs, rng)
    by_current = _by_current(smooth, current, attrs, rng)
    by_model = _ratios(manoeuvre, trial, wind, model)
    limits = {name: limit for name, limit, _, _ in imo_limits(attrs, vessel)}
    unknown = np.full(1, np.nan)
    rows = []
    for name, index in manoeuvre.traits.indices.items():
        if index.quantity not in TRACK_QUANTITIES or not np.isfinite(still.get(name, np.nan)):
            continue
        distance = index.units == "m"
        unit = vessel.particulars.L if distance else 1.0
        ratios = by_model.get(name, unknown if by_model or not model.wind else np.ones(1))
        ratio = float(np.nan_to_num(np.median(ratios), nan=1.0))
        value = still[name] / unit
        rows.append(
            {
                "index": name,
                "units": "L" if distance else index.units,
                "raw": measured.get(name, np.nan) / unit,
                "without_current": value,
                "ratio": ratio,
                "corrected": value * ratio,
                "limit": limits.get(name, np.nan),
                "u_record": ratio * by_record.get(name, unknown) / unit,
                "u_current": ratio * by_current.get(name, unknown) / unit if distance else np.zeros(1),
                "u_model": value * (ratios - ratio),
            }
        )
    return rows


def without_current(smooth: xr.Dataset, velocity: np.ndarray) -> xr.Dataset:
    """Trial as it would be in still water: its track and, where they are over ground, its velocities."""
    moved, time = {}, smooth["time"].values - smooth["time"].values[0]
    for name, rate in zip(("x", "y"), velocity, strict=True):
        if name in smooth:
            moved[name] = ("time", smooth[name].values - rate * time)
    if smooth.attrs.get("speeds") == OVER_GROUND and {"u", "v", "psi"} <= set(smooth.data_vars):
        turned = (velocity[0] + 1j * velocity[1]) * np.exp(-1j * smooth["psi"].values)
        moved |= {"u": ("time", smooth["u"].values - turned.real), "v": ("time", smooth["v"].values - turned.imag)}
    return smooth.assign(moved)


def mean_wind(trial: xr.Dataset, conditions: Conditions) -> tuple[float, float] | None:
    """Mean true wind of a run, speed [m/s] and where it comes from [deg]: as recorded, else as noted, else None."""
    if not {"wind_speed", "wind_direction"} <= set(trial.data_vars):
        return conditions.wind
    flow = np.nanmean(trial["wind_speed"].values * np.exp(1j * trial["wind_direction"].values))
    return float(np.abs(flow)), float(np.rad2deg(np.angle(flow)) % 360.0)


def subtract_wind_drift(
    found: DriftCurrent, trial: xr.Dataset, manoeuvre: Manoeuvre, wind: tuple[float, float], model: Model
) -> DriftCurrent:
    """Current of a turn without what the wind drifts the ship, as the model has it in the same turn and wind.

    Indices keep that drift: F / B takes it off.
    """
    course = float(base_course(trial))
    lasts = _LONGER * float(trial["time"].values[-1] - trial["time"].values[0])
    drifts = []
    for vessel, rows in thinned_draws(model.models, _DRIFTS):
        settings = simulation_settings(vessel) | {"duration": lasts, "wind": _from_bow(wind, course)}
        ships = simulate(vessel, manoeuvre, coefficients=rows, **settings)
        ships = ships.isel(draw=~ships["diverged"].values)
        drifts += [drift_current(ships.isel(draw=k)).velocity @ (1.0, 1j) for k in range(ships.sizes["draw"])]
    if not drifts:
        raise TrialError(f"No drawn ship sails the {manoeuvre.label} in this wind; leave the ship out.")
    turned = np.array(drifts) * np.exp(1j * course)
    parts = np.stack([turned.real, turned.imag], axis=1)
    return DriftCurrent(found.velocity - parts.mean(axis=0), np.hypot(found.sd, parts.std(axis=0)), found.local)


def _from_bow(wind: tuple[float, float], course: float) -> tuple[float, float]:
    """Wind as a simulated ship meets it, whose first course is 0; the course is in rad, directions are in deg."""
    return wind[0], wind[1] - float(np.rad2deg(course))


def _by_record(trial: xr.Dataset, flow: np.ndarray, attrs: Mapping, rng: np.random.Generator) -> dict[str, np.ndarray]:
    """Deviation of each index over draws of the denoised record; empty for one that cannot be denoised."""
    return _deviations(
        index_draws(trial, attrs, draws=DRAWS, rng=rng, corrected=lambda smooth: without_current(smooth, flow))
    )


def _by_current(
    smooth: xr.Dataset, current: DriftCurrent | None, attrs: Mapping, rng: np.random.Generator
) -> dict[str, np.ndarray]:
    """Deviation of each index over draws of the current; empty without one."""
    if current is None:
        return {}
    drawn = current.velocity + current.sd * rng.standard_normal((DRAWS, 2))
    return _deviations(
        finite_indices(indices_of_denoised(without_current(smooth, velocity), attrs) for velocity in drawn)
    )


def _deviations(values: Mapping[str, np.ndarray]) -> dict[str, np.ndarray]:
    """Values of each index about their mean."""
    return {name: column - column.mean() for name, column in values.items()}


def _ratios(
    manoeuvre: Manoeuvre, trial: xr.Dataset, wind: tuple[float, float] | None, model: Model
) -> dict[str, np.ndarray]:
    """F / B of each index over draws of the ship; empty where nothing is to be corrected."""
    if not model.models or (wind is None and model.loaded is None):
        return {}
    around = None if wind is None else _from_bow(wind, base_course(trial))
    found: dict[str, list[np.ndarray]] = {}
    for vessel, rows in thinned_draws(model.models, DRAWS):
        full = (
            (vessel, rows)
            if model.loaded is None or model.tried is None
            else at_loading(vessel, rows, model.tried, model.loaded)
        )
        both = []
        for ship, draws, blowing in ((*full, None), (vessel, rows, around)):
            settings = simulation_settings(ship) | {"duration": manoeuvre.traits.reach * ship.particulars.ship_time}
            both.append(indices(simulate(ship, manoeuvre, coefficients=draws, wind=blowing, **settings)))
        for name in both[0]:
            with np.errstate(divide="ignore", invalid="ignore"):
                found.setdefault(str(name), []).append(both[0][name].values / both[1][name].values)
    ratios = {name: np.concatenate(values) for name, values in found.items()}
    ratios = {name: values[np.isfinite(values)] for name, values in ratios.items()}
    if not any(values.size for values in ratios.values()):
        raise TrialError(f"No drawn ship sails the {manoeuvre.label} in these conditions; leave the model out.")
    return {name: values for name, values in ratios.items() if values.size}
