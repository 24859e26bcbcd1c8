"""A sea trial: its runs, their conditions, and their indices as measured and corrected."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import xarray as xr

from pymc_ship.machine.arguments import check_callables, check_kind
from pymc_ship.machine.errors import TrialError, VesselError
from pymc_ship.machine.fields import field_text
from pymc_ship.machine.seeds import Seed, random_generator
from pymc_ship.physics.forces.surroundings import WIND
from pymc_ship.physics.manoeuvre.standard import Manoeuvre
from pymc_ship.physics.vessel.reading import VesselLike, as_vessel
from pymc_ship.physics.vessel.vessel import Vessel
from pymc_ship.records.checks.revolutions_and_wind import from_first_course_text
from pymc_ship.records.checks.run_set import contradicting_runs, repeated_runs
from pymc_ship.records.files.sides import mirror_remarks
from pymc_ship.records.steering.current import DriftCurrent, drift_current, ground_speed_text, logged_drift
from pymc_ship.records.steering.measured import order_delay, order_sentence
from pymc_ship.records.steering.recognition import recognise_by_facility, reversals_text, unrecognised_text
from pymc_ship.records.steering.stopping_tests import stopping_order
from pymc_ship.ships.ensemble.ship import Ship
from pymc_ship.ships.forecasting.steady_turns import largest_loop, steady_turns
from pymc_ship.ships.sea_trials.conditions import condition_rows, load_conditions
from pymc_ship.ships.sea_trials.corrections import (
    Model,
    corrected_indices,
    corrected_stopping,
    mean_wind,
    subtract_wind_drift,
)
from pymc_ship.ships.sea_trials.form import form_rows, ship_rows
from pymc_ship.ships.sea_trials.measured_spiral import measured_spiral, spiral_rows
from pymc_ship.ships.sea_trials.uncertainty import uncertainty_budget
from pymc_ship.trial.quality_flags import quality_remarks
from pymc_ship.trial.record import facility_of, numbered_trials, run_names

_OTHER_CURRENT = 0.7  # difference of two drifts over one of them, from which they are not of one current


@dataclass(frozen=True, repr=False)
class SeaTrial:
    """Results of a sea trial.

    Attributes
    ----------
    trials : dict of str to Dataset; records by name
    vessel : Vessel; at the draught of the trial
    manoeuvres : dict of str to Manoeuvre; recognised manoeuvres, by the name of the run
    indices : list of dict; rows of :func:`.uncertainty_budget` with ``run``; stopping and spiral tests have no side
    currents : dict of str to DriftCurrent; current of each corrected run
    winds : dict of str to (float, float); speed [m/s] and direction of origin [deg] of the mean true wind, by run
    conditions, ship_data, form : list of dict; rows of :func:`.condition_rows`, :func:`.ship_rows`, :func:`.form_rows`
    spirals : dict of str to Dataset; steady turns of each spiral test, from :func:`.measured_spiral`
    turns : Dataset or None; steady turns of the identified ship, from :func:`pymc_ship.steady_turns`
    remarks : tuple of str; doubtful checks of the records, runs left out and corrections not made, with the reason
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
    """Indices of a sea trial, measured and corrected (IMO MSC/Circ.1053).

    Parameters
    ----------
    trials : mapping of str to Dataset, or sequence of Dataset
        Checked and corrected records, by name. A circle of 630 deg or more gives its own drift; if the conditions state
        ``form.date``, all runs are of that day and take the mean current.
    vessel : Vessel, str or Path
        At the draught of the trial.
    conditions : str, Path or mapping, optional
        TOML file of the day's conditions, or its table; see docs/how_to/report_a_sea_trial.md.
    ship : Ship, optional
        Corrects wind and loading; without it they are not corrected.
    full_load : Vessel, str or Path, optional
        Vessel file at full load, where the trial was at another draught.
    rng : int, SeedSequence or Generator
        For the draws of the uncertainties.
    progress : callable, optional
        Called with a short text before each step.

    Returns
    -------
    SeaTrial

    Raises
    ------
    TrialError
        For unreadable conditions, no standard manoeuvre, another loading without a modular model, or a record without
        u, r, psi or delta.

    Examples
    --------
    A turning circle, which gives the current, and a zigzag:

    >>> import pymc_ship as ps
    >>> vessel, current = ps.load_vessel("kvlcc2"), (0.5, 90)
    >>> runs = {"circle": ps.simulate(vessel, ps.turning_circle(35), duration=2400, step=0.5, current=current)}
    >>> runs["zigzag"] = ps.simulate(vessel, ps.zigzag(10, 10), duration=900, step=0.5, current=current)
    >>> result = ps.sea_trial(runs, vessel, rng=1)
    >>> row = next(row for row in result.indices if row["index"] == "tactical_diameter")
    >>> print(f"{row['raw']:.2f} L, without the current {row['corrected']:.2f} L, limit {row['limit']:g} L")
    2.91 L, without the current 3.61 L, limit 5 L
    """
    check_callables(progress=progress)
    rng, vessel, trial_conditions = random_generator(rng), as_vessel(vessel), load_conditions(conditions)
    records = numbered_trials(trials)
    run_names("A sea trial", records, len(records))
    if ship is not None:
        check_kind("ship", ship, Ship, "give that of identify_ship, or leave it out", VesselError)
    loaded = None if full_load is None else as_vessel(full_load)
    runs = _runs_by_kind(records, vessel)
    winds = {name: wind for name in records if (wind := mean_wind(records[name], trial_conditions)) is not None}
    model, model_remarks = _model(ship, vessel, loaded, blowing=bool(winds))
    progress("current")
    one_day = "date" in trial_conditions.form
    currents, current_remarks = _currents(records, runs, winds, model, one_day=one_day)
    corrections = _Corrections(vessel, currents, winds, model, rng)
    rows = uncertainty_budget(_index_rows(records, runs, corrections, progress), rng)
    speeds = {name: manoeuvre.approach_speed or np.nan for name, manoeuvre in runs.manoeuvres.items()}
    windiest = max((speed for speed, _ in winds.values()), default=np.nan)
    unchecked = {name: records[name] for name in winds if "record_remarks" not in records[name].attrs}
    from_first_course = from_first_course_text(unchecked)  # of the others it is among their remarks
    wind_remarks = [*filter(None, [from_first_course]), *model_remarks]
    doubts = [*quality_remarks(records), *mirror_remarks(records), *repeated_runs(records)]
    doubts += contradicting_runs(records, vessel.particulars.L)
    return SeaTrial(
        trials=records,
        vessel=vessel,
        manoeuvres=runs.manoeuvres,
        indices=rows,
        currents=currents,
        winds=winds,
        conditions=condition_rows(trial_conditions, vessel, wind=windiest, speeds=speeds),
        ship_data=ship_rows(vessel, loaded, trial_conditions, windiest),
        form=form_rows(rows),
        spirals=runs.spirals,
        turns=steady_turns(ship) if runs.spirals and ship is not None else None,
        remarks=(*doubts, *runs.left_out, *wind_remarks, *current_remarks, *_order_remarks(runs)),
    )


class _Runs(NamedTuple):
    """Runs by kind of test, delay [s] from order to rudder movement by run, remarks on left-out runs and gear."""

    manoeuvres: dict[str, Manoeuvre]
    delays: dict[str, float]
    stops: list[str]
    spirals: dict[str, xr.Dataset]
    left_out: list[str]
    gear: list[str]


class _Corrections(NamedTuple):
    """Corrections of the indices of runs: current and wind by run, model, and the generator of its draws."""

    vessel: Vessel
    currents: Mapping[str, DriftCurrent]
    winds: Mapping[str, tuple[float, float]]
    model: Model
    rng: np.random.Generator


def _index_rows(
    trials: Mapping[str, xr.Dataset], runs: _Runs, by: _Corrections, progress: Callable[[str], None]
) -> list[dict]:
    rows: list[dict] = []
    for name, manoeuvre in runs.manoeuvres.items():
        progress(f"indices of {name}")
        settings: dict[str, Any] = {"rudder_delay": runs.delays[name], "current": by.currents.get(name)}
        settings |= {"wind": by.winds.get(name) if by.model.corrects_wind else None, "model": by.model, "rng": by.rng}
        index_rows = corrected_indices(trials[name], manoeuvre, by.vessel, **settings)
        rows += [{"run": name, "manoeuvre": manoeuvre.label, "side": manoeuvre.side} | row for row in index_rows]
    for name in runs.stops:
        index_rows = corrected_stopping(trials[name], by.currents.get(name), by.vessel.particulars.L, by.rng)
        rows += [{"run": name} | row for row in index_rows]
    for name, turns in runs.spirals.items():
        index_rows = spiral_rows(turns, largest_loop(by.vessel.particulars.ship_time))
        rows += [{"run": name} | row for row in index_rows]
    return rows


def _runs_by_kind(records: Mapping[str, xr.Dataset], vessel: Vessel) -> _Runs:
    ship_time = vessel.particulars.ship_time
    recognised, facilities = recognise_by_facility(list(records.values()), vessel)
    manoeuvres = {name: kind for name, kind in zip(records, recognised, strict=True) if kind is not None}
    delays = {
        name: order_delay(records[name], facilities[facility_of(records[name])].rudder_delay) for name in manoeuvres
    }
    others = [name for name in records if name not in manoeuvres]
    stops = [name for name in others if np.isfinite(stopping_order(records[name]))]
    others = [name for name in others if name not in stops]
    spirals = {name: turns for name in others if (turns := measured_spiral(records[name], ship_time)) is not None}
    if not manoeuvres and not stops and not spirals:
        raise TrialError(
            f"No run is of a standard manoeuvre. {unrecognised_text(next(iter(records.values())), ship_time)}"
        )
    unknown = [name for name in others if name not in spirals]
    left_out = [f"{name} is left out. {unrecognised_text(records[name], ship_time)}" for name in unknown]
    gear = [
        f"{facility or 'Steering gear'}: {text}"
        for facility, steering in facilities.items()
        if (text := reversals_text([one for one in records.values() if facility_of(one) == facility], steering))
    ]
    return _Runs(manoeuvres, delays, stops, spirals, left_out, gear)


def _order_remarks(runs: _Runs) -> list[str]:
    begins: dict[str, list[str]] = {}
    for name, manoeuvre in runs.manoeuvres.items():
        sentence = order_sentence(runs.delays[name], manoeuvre.approach_speed or np.nan)
        begins.setdefault(sentence, []).append(name)
    return [*(f"{', '.join(names)}: {sentence}" for sentence, names in begins.items()), *runs.gear]


def _currents(
    trials: Mapping[str, xr.Dataset],
    runs: _Runs,
    winds: Mapping[str, tuple[float, float]],
    model: Model,
    *,
    one_day: bool,
) -> tuple[dict[str, DriftCurrent], list[str]]:
    """Current of each run and remarks; that of a circle, without its wind drift, is of the other runs of ``one_day``.

    Drift in a wind that no model describes is of its own run alone, and a run whose log shows another drift does not
    take that of a circle.
    """
    currents, remarks = _currents_of_circles(trials, runs, winds, model)
    if not currents:
        return {}, [*remarks, "The indices are not corrected for current, as no run gives it; turn through 720 deg."]
    with_wind = [name for name in currents if winds.get(name, (0.0, 0.0))[0] > 0.0 and not model.corrects_wind]
    if mixed := [name for name in with_wind if currents[name].velocity.any()]:
        remarks.append(
            f"The drift of {', '.join(mixed)} is that of current and wind together, as no model gives the wind's."
        )
    tests = [name for name in (*runs.manoeuvres, *runs.stops) if {"x", "y"} <= set(trials[name].data_vars)]
    others = [name for name in tests if name not in currents]
    reason = "it includes that of their wind" if with_wind else "no date states that all runs are of one day"
    if others and (with_wind or not one_day):
        remedy = "identify the ship with [windage]" if with_wind else "state form.date in the conditions"
        remarks.append(f"The drift of the circles is not subtracted from {', '.join(others)}: {reason}; {remedy}.")
        return currents, remarks
    mean = _mean_current(list(currents.values()))
    for name in others:
        logged = logged_drift(trials[name])
        if logged is None or np.hypot(*(logged - mean.velocity)) <= max(_OTHER_CURRENT * mean.speed, mean.radius):
            currents[name] = mean
            continue
        remarks.append(
            f"The drift of the circles, {mean.words}, is not subtracted from {name}: its log and track show "
            f"{replace(mean, velocity=logged).words}. Count psi, x and y of all runs from north, or sail a circle in "
            "the same tide."
        )
    return currents, remarks


def _currents_of_circles(
    trials: Mapping[str, xr.Dataset], runs: _Runs, winds: Mapping[str, tuple[float, float]], model: Model
) -> tuple[dict[str, DriftCurrent], list[str]]:
    """Current of each circle and remarks; a velocity below its own error is 0, and keeps its uncertainty."""
    currents, remarks = {}, []
    for name, manoeuvre in runs.manoeuvres.items():
        if not manoeuvre.traits.circles:
            continue
        try:
            current = drift_current(trials[name])
            if name in winds and model.corrects_wind:
                current = subtract_wind_drift(current, trials[name], manoeuvre, winds[name], model)
        except TrialError as error:
            remarks.append(f"{name} gives no current: {error}")
            continue
        if not current.is_certain:
            remarks.append(
                f"The drift of {name}, {current.speed:.2g} m/s, is not subtracted: with a standard uncertainty of "
                f"{current.sd.max():.2g} m/s in each direction, its region of 95 % includes 0."
            )
            current = replace(current, velocity=np.zeros(2))
        elif (words := ground_speed_text(trials[name], current)) not in trials[name].attrs.get("record_remarks", ""):
            remarks.append(f"{name}: {words}")
        currents[name] = current
    return currents, remarks


def _mean_current(currents: Sequence[DriftCurrent]) -> DriftCurrent:
    velocities, sds = (np.array([getattr(current, key) for current in currents]) for key in ("velocity", "sd"))
    scatter = velocities.std(axis=0, ddof=1) if len(currents) > 1 else np.zeros(2)
    sd = np.hypot(np.sqrt(np.mean(sds**2, axis=0)), scatter)
    return DriftCurrent(velocities.mean(axis=0), sd, np.vstack([current.local for current in currents]))


def _model(ship: Ship | None, vessel: Vessel, loaded: Vessel | None, *, blowing: bool) -> tuple[Model, list[str]]:
    """Model for the corrections of wind and loading, and a remark on wind that is not corrected."""
    if ship is None:
        if loaded is not None:
            raise TrialError("A correction for loading needs an identified ship, found none; give ship.")
        remark = "The indices are not corrected for wind: that needs an identified ship."
        return Model(wind=not blowing), [remark] if blowing else []
    wind_models = [pair for pair in ship.models if WIND.name in pair[0].parts]
    wind = blowing and bool(wind_models)
    models = wind_models if wind else ship.models
    models = [pair for pair in models if loaded is None or pair[0].modular]
    if not models:
        raise TrialError(
            "A correction for loading needs a modular term set, found polynomials alone; state d in the vessel file "
            "and identify the ship again."
        )
    remark = (
        "The indices are not corrected for wind: no term set of the ship has wind forces; add [windage] to the vessel "
        "file and identify the ship again."
    )
    return Model(models, vessel, loaded, wind or not blowing), [remark] if blowing and not wind else []
