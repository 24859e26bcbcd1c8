"""A sea trial: its runs, what they were sailed in, and their indices as measured and corrected."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr

from pymc_ship.machine.errors import TrialError
from pymc_ship.machine.fields import field_text
from pymc_ship.machine.seeds import Seed, random_generator
from pymc_ship.physics.forces.surroundings import WIND
from pymc_ship.physics.manoeuvre.standard import Manoeuvre
from pymc_ship.physics.vessel.reading import VesselLike, as_vessel
from pymc_ship.physics.vessel.vessel import Vessel
from pymc_ship.records.steering.recognition import recognise_by_facility, unrecognised_text
from pymc_ship.records.steering.stopping_tests import INDICES as STOPPING
from pymc_ship.records.steering.stopping_tests import LABEL, LIMIT, measured_stopping
from pymc_ship.ships.ensemble.ship import Ship
from pymc_ship.ships.forecasting.steady_turns import largest_loop, steady_turns
from pymc_ship.ships.sea_trials.conditions import condition_rows, load_conditions
from pymc_ship.ships.sea_trials.corrections import Model, corrected_indices, mean_wind, subtract_wind_drift
from pymc_ship.ships.sea_trials.current import DriftCurrent, drift_current
from pymc_ship.ships.sea_trials.form import form_rows, ship_rows
from pymc_ship.ships.sea_trials.measured_spiral import measured_spiral, spiral_rows
from pymc_ship.ships.sea_trials.uncertainty import PARTS, uncertainty_budget
from pymc_ship.trial.record import facility_of, trial_list


@dataclass(frozen=True, repr=False)
class SeaTrial:
    """What is known of a sea trial.

    Attributes
    ----------
    trials : dict of str to Dataset
        Records by name.
    vessel : Vessel
        As she was tried.
    manoeuvres : dict of str to Manoeuvre
        Of each run that was recognised, by its name.
    indices : list of dict
        Rows of :func:`pymc_ship.ships.sea_trials.corrections.corrected_indices` with their uncertainty, see
        :func:`.uncertainty_budget`, and ``run``, ``manoeuvre`` and ``side``; those of
        stopping and spiral tests are as measured, their side is empty.
    currents : dict of str to DriftCurrent
        By which each run was corrected; runs without one are left out.
    winds : dict of str to (float, float)
        Mean speed [m/s] of the true wind and where it comes from [deg], of the runs that know it.
    conditions : list of dict
        See :func:`pymc_ship.ships.sea_trials.conditions.condition_rows`.
    ship_data, form : list of dict
        See :func:`pymc_ship.ships.sea_trials.form.ship_rows` and :func:`pymc_ship.ships.sea_trials.form.form_rows`.
    spirals : dict of str to Dataset
        Steady turns of each spiral test, see :func:`pymc_ship.ships.sea_trials.measured_spiral.measured_spiral`.
    turns : Dataset or None
        Steady turns of the identified ship beside them, see :func:`pymc_ship.steady_turns`.
    remarks : tuple of str
        What was left out or not corrected, and why.
    """

    trials: dict[str, xr.Dataset]
    vessel: Vessel
    manoeuvres: dict[str, Manoeuvre]
    indices: list[dict]
    currents: dict[str, DriftCurrent]
    winds: dict[str, tuple[float, float]]
    conditions: list[dict]
    ship_data: list[dict]
    form: list[dict]
    spirals: dict[str, xr.Dataset]
    turns: xr.Dataset | None
    remarks: tuple[str, ...]

    __repr__ = field_text


def sea_trial(
    trials: Mapping[str, xr.Dataset] | Sequence[xr.Dataset],
    vessel: VesselLike,
    *,
    conditions: str | Path | Mapping | None = None,
    ship: Ship | None = None,
    full_load: VesselLike | None = None,
    rng: Seed,
    progress: Callable[[str], None] = lambda _: None,
) -> SeaTrial:
    """Measure and correct the indices of a sea trial as IMO MSC/Circ.1053 has it.

    Parameters
    ----------
    trials : mapping of str to Dataset, or sequence of Dataset
        Checked and corrected records of one day, by name: zigzags, turning circles, pull-outs, stopping and spiral
        tests. The current is that of the circles that turn 630 deg or more; other runs take the mean of theirs.
    vessel : Vessel, str or Path
        As she was tried.
    conditions : str, Path or mapping, optional
        TOML file, or its table, of what was noted of the day; see docs/how_to/report_a_sea_trial.md.
    ship : Ship, optional
        By which wind and loading are corrected; without her they are not.
    full_load : Vessel, str or Path, optional
        Her file at full load, where she was tried at another draught.
    rng : int, SeedSequence or Generator
        Of the draws behind the uncertainties.
    progress : callable, optional
        Called with a short text before each step.

    Returns
    -------
    SeaTrial

    Raises
    ------
    TrialError
        For conditions that cannot be read, runs of which none is a standard manoeuvre, or another loading without a
        ship of parts.
    TrialError
        For conditions that cannot be read, runs of which none is a standard manoeuvre, or another loading without a
        ship of parts. For a record that lacks u, r, psi or delta.

    References
    ----------
    IMO (2002), Explanatory notes to the standards for ship manoeuvrability, MSC/Circ.1053.

    Examples
    --------
    A turning circle and a zigzag in a current, which the circle shows:

    >>> import pymc_ship as ps
    >>> vessel, current = ps.load_vessel("kvlcc2"), (0.5, 90)
    >>> runs = {"circle": ps.simulate(vessel, ps.turning_circle(35), duration=2400, step=0.5, current=current)}
    >>> runs["zigzag"] = ps.simulate(vessel, ps.zigzag(10, 10), duration=900, step=0.5, current=current)
    >>> found = ps.sea_trial(runs, vessel, rng=1)
    >>> row = next(row for row in found.indices if row["index"] == "tactical_diameter")
    >>> print(f"{row['raw']:.2f} L, without the current {row['corrected']:.2f} L, limit {row['limit']:g} L")
    2.91 L, without the current 3.61 L, limit 5 L
    """
    rng, vessel, noted = random_generator(rng), as_vessel(vessel), load_conditions(conditions)
    named = _named(trials)
    loaded = None if full_load is None else as_vessel(full_load)
    recognised, facilities = recognise_by_facility(list(named.values()), vessel)
    manoeuvres = {name: one for name, one in zip(named, recognised, strict=True) if one is not None}
    stops = {name: measured_stopping(trial) for name, trial in named.items() if name not in manoeuvres}
    stops = {name: found for name, found in stops.items() if found}
    unit = vessel.particulars.ship_time
    others = [name for name in named if name not in manoeuvres and name not in stops]
    spirals = {name: turns for name in others if (turns := measured_spiral(named[name], unit)) is not None}
    if not manoeuvres and not stops and not spirals:
        raise TrialError(f"No run is of a standard manoeuvre. {unrecognised_text(next(iter(named.values())))}")
    lost = [name for name in others if name not in spirals]
    remarks = [f"{name} is left out. {unrecognised_text(named[name])}" for name in lost]
    winds = {name: wind for name in named if (wind := mean_wind(named[name], noted)) is not None}
    model, said = _model(ship, vessel, loaded, blowing=bool(winds))
    corrected = winds if model.models and model.wind else {}
    progress("current")
    currents, more = _currents({name: named[name] for name in manoeuvres}, manoeuvres, corrected, model)
    rows = []
    for name, manoeuvre in manoeuvres.items():
        progress(f"indices of {name}")
        delay = facilities[facility_of(named[name])].rudder_delay
        known: dict[str, Any] = {"rudder_delay": float(np.nan_to_num(delay)), "current": currents.get(name)}
        known |= {"wind": corrected.get(name), "model": model, "rng": rng}
        found = corrected_indices(named[name], manoeuvre, vessel, **known)
        rows += [{"run": name, "manoeuvre": manoeuvre.label, "side": manoeuvre.side} | row for row in found]
    for name, stop in stops.items():
        rows += [{"run": name} | row for row in _stopping_rows(stop, vessel.particulars.L)]
    for name, turns in spirals.items():
        rows += [{"run": name} | row for row in spiral_rows(turns, largest_loop(unit))]
    rows = uncertainty_budget(rows, rng)
    speeds = {name: manoeuvre.approach_speed or np.nan for name, manoeuvre in manoeuvres.items()}
    windiest = max((speed for speed, _ in winds.values()), default=np.nan)
    return SeaTrial(
        trials=named,
        vessel=vessel,
        manoeuvres=manoeuvres,
        indices=rows,
        currents=currents,
        winds=winds,
        conditions=condition_rows(noted, vessel, wind=windiest, speeds=speeds),
        ship_data=ship_rows(vessel, loaded, noted, windiest),
        form=form_rows(rows),
        spirals=spirals,
        turns=steady_turns(ship) if spirals and ship is not None else None,
        remarks=(*remarks, *said, *more),
    )


def _named(trials: Mapping[str, xr.Dataset] | Sequence[xr.Dataset]) -> dict[str, xr.Dataset]:
    if isinstance(trials, Mapping):
        return dict(trials)
    return {str(k + 1): trial for k, trial in enumerate(trial_list(trials))}


def _currents(
    trials: Mapping[str, xr.Dataset],
    manoeuvres: Mapping[str, Manoeuvre],
    winds: Mapping[str, tuple[float, float]],
    model: Model,
) -> tuple[dict[str, DriftCurrent], list[str]]:
    """Current of each run, less the drift by the winds that a model knows, and a sentence where none is shown."""
    own, said = {}, []
    for name, manoeuvre in manoeuvres.items():
        if manoeuvre.traits.circles:
            try:
                found = drift_current(trials[name])
                wind = winds.get(name)
                own[name] = found if wind is None else subtract_wind_drift(found, trials[name], manoeuvre, wind, model)
            except TrialError as error:
                said.append(f"{name} shows no current: {error}")
    if not own:
        return {}, [*said, "No run shows the current, and no index is corrected for it; turn through 720 deg."]
    mean = _mean_current(list(own.values()))
    return {name: own.get(name, mean) for name, trial in trials.items() if {"x", "y"} <= set(trial.data_vars)}, said


def _mean_current(found: Sequence[DriftCurrent]) -> DriftCurrent:
    """Mean of the currents of circles; its uncertainty is theirs and, of two or more, their scatter as well."""
    velocities, sds = (np.array([getattr(one, key) for one in found]) for key in ("velocity", "sd"))
    scatter = velocities.std(axis=0, ddof=1) if len(found) > 1 else np.zeros(2)
    sd = np.hypot(np.sqrt(np.mean(sds**2, axis=0)), scatter)
    return DriftCurrent(velocities.mean(axis=0), sd, np.vstack([one.local for one in found]))


def _model(ship: Ship | None, vessel: Vessel, loaded: Vessel | None, *, blowing: bool) -> tuple[Model, list[str]]:
    """Model by which wind and loading are corrected, and a sentence on what is not."""
    if ship is None:
        if loaded is not None:
            raise TrialError("Another loading is corrected by an identified ship, found none; give the ship, too.")
        said = "Wind is not corrected for: that needs an identified ship."
        return Model(wind=not blowing), [said] if blowing else []
    known = [one for one in ship.models if WIND.name in one[0].parts]
    wind = blowing and bool(known)
    models = known if wind else ship.models
    models = [one for one in models if loaded is None or one[0].modular]
    if not models:
        raise TrialError(
            "No term set of this ship knows another draught: her forces are polynomials; state d in her vessel file "
            "and identify her anew."
        )
    said = "Wind is not corrected for: no term set of the ship knows it; state [windage] and identify her anew."
    return Model(models, vessel, loaded, wind or not blowing), [said] if blowing and not wind else []


def _stopping_rows(stop: Mapping[str, float], L: float) -> list[dict]:
    """Indices of a stopping test as measured, in L, s and deg."""
    rows = []
    for name, units in STOPPING.items():
        value = stop[name] / (L if units == "m" else 1.0)
        row: dict[str, Any] = {"manoeuvre": LABEL, "side": "", "index": name, "units": "L" if units == "m" else units}
        row |= dict.fromkeys(("raw", "without_current", "corrected"), value) | {"ratio": 1.0}
        row |= {"limit": LIMIT if name == "track_reach" and np.isfinite(value) else np.nan}
        rows.append(row | dict.fromkeys(PARTS, np.full(1, np.nan)))
    return rows
