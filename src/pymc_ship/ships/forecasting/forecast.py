"""Forecasts of manoeuvres from posterior draws: bands of channels and intervals of indices."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
import xarray as xr

from pymc_ship.machine.arguments import check_choice, check_counts, check_probabilities
from pymc_ship.machine.errors import FitError, TrialError
from pymc_ship.machine.seeds import Seed, random_generator
from pymc_ship.pages.tables import rounded_percent
from pymc_ship.physics.manoeuvre.indices import indices, needs_roll
from pymc_ship.physics.manoeuvre.standard import Manoeuvre, one_manoeuvre
from pymc_ship.physics.motion.inputs import speed_remarks
from pymc_ship.physics.motion.simulation import simulate
from pymc_ship.physics.motion.stepping import simulation_settings
from pymc_ship.physics.vessel.vessel import Vessel, most_dofs
from pymc_ship.records.steering.measured import order_sentence, recorded_settings
from pymc_ship.records.steering.recognition import Steering, with_steering
from pymc_ship.ships.ensemble.draws import Models, suitable_models, thinned_draws
from pymc_ship.ships.ensemble.feasibility import feasible_runs
from pymc_ship.ships.ensemble.index_error import reliability, steady_error, with_model_error
from pymc_ship.ships.ensemble.scores import quantile_bands, quantiles
from pymc_ship.ships.ensemble.ship import Ship, ShipLike, as_ship
from pymc_ship.ships.forecasting.extrapolation import UNKNOWN, extrapolation, percentage_outside, sentence
from pymc_ship.trial.channels import CHANNELS, SIMULATED
from pymc_ship.trial.record import facility_of

_SPARSE = 20  # samples from one to the next that is compared, where a manoeuvre has no indices
NO_ROLL = "There is no forecast of roll angles: none or too few of the simulated ships roll."


def forecast(
    ship: ShipLike,
    manoeuvre: Manoeuvre,
    *,
    rng: Seed,
    draws: int = 1000,
    duration: float | None = None,
    ci_prob: float = 0.95,
    n: float | None = None,
    wind: tuple[float, float] | None = None,
    current: tuple[float, float] | None = None,
    facility: str | None = None,
    **settings: Any,
) -> xr.DataTree:
    """Forecast a manoeuvre with one simulation for each draw.

    Parameters
    ----------
    ship : Ship, Vessel, str or Path
        A vessel is a ship of one draw.
    manoeuvre : Manoeuvre
    rng : int, SeedSequence or Generator
    draws : int, optional
        Largest number; the models of an ensemble keep their proportions.
    duration : float, optional
        [s]; by default that of the kind of manoeuvre, 40 L/U for the standard ones.
    ci_prob : float, optional
        Probability inside the equal-tailed bands.
    n, wind, current
        As in :func:`pymc_ship.simulate`; models without forces of revolutions or wind are left out.
    facility : str, optional
        Facility of the trials that gives steering gear and approach speed (unless the manoeuvre or ``n`` does); by
        default the gear of most trials and the nominal speed.
    **settings
        ``step``, ``method`` and ``record_interval`` of :func:`pymc_ship.simulate`; by default they follow L/U.

    Returns
    -------
    DataTree
        ``trajectories`` (dims draw, time; with ``diverged`` and ``diverged_at``), ``bands`` (dims band, time) and, for
        a manoeuvre that has indices, ``indices`` (dims draw) and ``index_bands`` (dims band). Bands are quantiles of
        the draws that have not diverged; ``measured_bands`` add the sensor noise where it is known. For a ship with
        model error, ``indices`` and their bands include it, and infeasible draws are left out. ``extrapolation``, where
        the motion of the runs is known: ``outside_fraction`` and median ``distance`` over time, medians of
        :func:`.extrapolation` over symbol. Attrs: ``median_draw`` (nearest the medians of indices or track),
        ``diverged_fraction``, ``infeasible_fraction``, ``extrapolated_fraction`` (NaN where unknown), and the sentences
        ``extrapolation`` and ``steering``.

    Raises
    ------
    FitError
        When fewer than two draws of a ship with model error are feasible.
    TrialError
        For an unknown facility, or a motion of the runs that cannot be read.
    SimulationError
        For invalid settings, or revolutions or wind that no model of the ship has.
    ValueError
        For fewer than two draws or ``ci_prob`` not in (0, 1).

    Examples
    --------
    A turning circle, forecast from a noisy zigzag; the 90 % interval covers the true diameter:

    >>> import numpy as np
    >>> import pymc_ship as ps
    >>> vessel, rng = ps.load_vessel("kvlcc2"), np.random.default_rng(1)
    >>> trial = ps.pollute(ps.simulate(vessel, ps.zigzag(20, 20), duration=600, step=0.5), level=0.01, rng=rng)
    >>> ship = ps.Ship.from_posterior(vessel, ps.trajectory_posterior(trial, vessel, rng=rng), draws=40, rng=rng)
    >>> turn = ps.forecast(ship, ps.turning_circle(35), duration=900, ci_prob=0.9, rng=rng)
    >>> lower, median, upper = turn["index_bands"]["tactical_diameter"].values
    >>> truth = ps.indices(ps.simulate(vessel, ps.turning_circle(35), duration=900, step=0.5))["tactical_diameter"]
    >>> turn.attrs["diverged_fraction"], bool(lower < truth < upper)
    (0.0, True)
    """
    check_counts(least=2, draws=draws)
    check_probabilities(ci_prob=ci_prob)
    rng, ship, manoeuvre = random_generator(rng), as_ship(ship), one_manoeuvre(manoeuvre)
    environment = {"n": n, "wind": wind, "current": current}
    all_models = suitable_models(_models_at_facility(ship, facility), n=n, wind=wind)
    if facility is not None and manoeuvre.approach_speed is None and n is None:
        speed = ship.facilities[facility].approach_speed
        manoeuvre = replace(manoeuvre, approach_speed=speed if np.isfinite(speed) else None)
    settings |= {**environment, "duration": duration, "ci_prob": ci_prob}
    tree = _ship_forecast(ship, thinned_draws(all_models, draws), manoeuvre, rng, facility, **settings)
    tree.attrs["steering"] = " ".join(filter(None, [tree.attrs["steering"], *_left_out(ship, all_models)]))
    return tree


def known_facility(ship: Ship, trial: xr.Dataset) -> str | None:
    """Facility of a trial, if the ship was identified at it."""
    name = facility_of(trial)
    return name if name and name in ship.facilities else None


def recorded_forecast(
    ship: Ship, manoeuvre: Manoeuvre, trial: xr.Dataset, *, rng: np.random.Generator, draws: int = 1000, **settings: Any
) -> xr.DataTree:
    """Forecast of a recorded manoeuvre, as :func:`forecast`: at its facility, revolutions and in its mean wind.

    A term set without revolutions or forces of wind is simulated without them.
    """
    check_counts(least=2, draws=draws)
    facility = known_facility(ship, trial)
    models = thinned_draws(_models_at_facility(ship, facility), draws)
    each = [recorded_settings(trial, vessel) for vessel, _ in models]
    tree = _ship_forecast(ship, models, manoeuvre, rng, facility, each=each, **settings)
    for group in tree.subtree:
        group.attrs.pop("n", None)  # the revolutions of the approach, with which the criteria are measured
    tree.attrs["steering"] = " ".join([tree.attrs["steering"], *_recorded_sentences(each)])
    return tree


def _recorded_sentences(each: Sequence[Mapping[str, Any]]) -> list[str]:
    """Sentences on the revolutions and the wind of a record in the simulations of each term set."""
    sentences, of_all = [], {key: value for own in each for key, value in own.items()}
    if "n" in of_all:
        sentences.append(f"The forecast has the median revolutions of the record, {60.0 * of_all['n']:.3g} 1/min.")
    if "wind" in of_all:
        speed, bow = of_all["wind"]
        sentences.append(
            f"The forecast has the mean wind of the record, {speed:.3g} m/s from {round(bow) % 360} deg off the bow of "
            "the approach."
        )
    for key, words in (("n", "revolutions"), ("wind", "forces of wind")):
        lacking = sum(key not in own for own in each)
        if lacking and key in of_all:
            sentences.append(f"{lacking} of {len(each)} term sets have no {words}.")
    return sentences


def _ship_forecast(
    ship: Ship,
    models: Models,
    manoeuvre: Manoeuvre,
    rng: np.random.Generator,
    facility: str | None,
    *,
    duration: float | None = None,
    ci_prob: float = 0.95,
    **settings: Any,
) -> xr.DataTree:
    """Forecast of models of a ship, with its model error; settings as of :func:`pooled_forecast`."""
    vessel = models[0][0]
    duration = manoeuvre.traits.reach * vessel.particulars.ship_time if duration is None else duration
    errors = None if ship.index_error is None else ship.index_error | steady_error(ship.motion_error)
    data: dict[str, Any] = {"noise": ship.noise_sd, "motion": ship.motion, "errors": errors}
    data |= {"growth": ship.growth_at, "only_feasible": errors is not None}
    settings = simulation_settings(vessel, **settings, duration=duration, ci_prob=ci_prob)
    tree = pooled_forecast(models, manoeuvre, rng=rng, **data, **settings)
    approach = tree.attrs["approach_speed"]
    sentences = [_steering_sentence(vessel, ship.facilities, facility)]
    sentences += [order_sentence(tree.attrs["rudder_delay"], approach)] if manoeuvre.traits.indices else []
    sentences += speed_remarks([vessel for vessel, _ in models], approach, settings.get("n"))
    sentences += [f"The approach is at {approach:.4g} m/s."] if facility is not None else []
    tree.attrs["steering"] = " ".join(sentences)
    return tree


def _left_out(ship: Ship, suitable: Models) -> list[str]:
    """Sentence on the draws of term sets that do not depend on the given revolutions or wind; none without any."""
    lacking = 1.0 - sum(len(rows) for _, rows in suitable) / ship.draws
    if lacking <= 0.0:
        return []
    n = len(ship.models) - len(suitable)
    return [
        f"{n} of {len(ship.models)} term sets, with {rounded_percent(lacking)} of the draws, do not depend on the "
        "given revolutions or wind and are left out."
    ]


def _feasible(models: Models, manoeuvre: Manoeuvre, runs: list[xr.Dataset]) -> list[xr.Dataset]:
    """Simulated draws of the models that are feasible; FitError where fewer than two are."""
    feasible = [feasible_runs(ship, manoeuvre, run) for run, (ship, _) in zip(runs, models, strict=True)]
    if sum(map(np.sum, feasible)) < 2:
        raise FitError(
            f"A forecast needs two feasible draws, found fewer: the others diverge in the {manoeuvre.label}; "
            "add trials or a prior."
        )
    return [run if rows.all() else run[{"draw": rows}] for run, rows in zip(runs, feasible, strict=True)]


def _steering_sentence(vessel: Vessel, facilities: Mapping[str, Steering], facility: str | None) -> str:
    gear, where = vessel.particulars, facility or next(iter(facilities), "")
    named = f" as at {where}" if where and facilities[where].n_reversals else ""
    unidentified = f" (no run at {where} reverses the rudder)" if where and not named else ""
    return f"The rudder moves{named} at {gear.rudder_rate_deg:.3g} deg/s after {gear.rudder_delay:.3g} s{unidentified}."


def _models_at_facility(ship: Ship, facility: str | None) -> list[tuple[Vessel, np.ndarray]]:
    """Models of a ship with the steering gear of a facility; TrialError for an unknown one."""
    if facility is None:
        return ship.models
    named = tuple(filter(None, ship.facilities))
    if not named:
        raise TrialError(
            f"The trials of this ship have no facility, found facility={facility!r}; leave it out, or add facility "
            "to their format files and identify the ship again."
        )
    check_choice("A facility", facility, named, TrialError)
    return [(with_steering(vessel, ship.facilities[facility]), rows) for vessel, rows in ship.models]


def pooled_forecast(
    models: Models,
    manoeuvre: Manoeuvre,
    *,
    duration: float,
    ci_prob: float,
    rng: np.random.Generator,
    noise: Mapping[str, float] | None = None,
    motion: xr.DataArray | None = None,
    errors: Mapping[str, np.ndarray | float] | None = None,
    growth: Callable[[float], np.ndarray | float] = lambda beyond: 1.0,
    only_feasible: bool = False,
    each: Sequence[dict[str, Any]] | None = None,
    **settings: Any,
) -> xr.DataTree:
    """As :func:`forecast`, with the draws of models that differ in terms and parts alone.

    Roll comes from the models that have it; with too few draws for the band, ``dofs`` in attrs has no roll. ``models``
    are pairs of a vessel and draws (n_draws, n_coefficients), fitted to the prime ``motion``, dims (row, symbol).
    ``noise`` is the sd of the sensors by channel [SI], ``errors`` the error of the indices by kind, from
    :func:`.model_error`, and ``growth`` that of the error at a distance beyond the motion, such as
    :meth:`.Ship.growth_at`. ``each`` has settings of each model, beside those of all.
    """
    settings |= {"duration": duration}
    runs = [
        simulate(ship, manoeuvre, coefficients=rows, **settings | own)
        for (ship, rows), own in zip(models, each or [{}] * len(models), strict=True)
    ]
    if only_feasible:
        runs = _feasible(models, manoeuvre, runs)
    rolling = np.concatenate([np.full(run.sizes["draw"], "roll" in run.attrs["dofs"].split()) for run in runs])
    if not rolling.all() and rolling.sum() < round(2.0 / (1.0 - ci_prob)):
        rolling[:] = False
    vessel = most_dofs(ship for ship, _ in models if rolling.any() or "roll" not in ship.dofs)
    shown = [name for name in SIMULATED if "roll" in vessel.dofs or not CHANNELS[name].rolling]
    simulated = xr.concat(runs, "draw", combine_attrs="override") if len(runs) > 1 else runs[0]
    simulated = simulated.assign_coords(draw=np.arange(simulated.sizes["draw"]))
    of_all = {key: value for run in runs for key, value in run.attrs.items()}
    simulated = simulated.assign_attrs(of_all | runs[0].attrs, dofs=" ".join(vessel.dofs))
    ships = _nan_without_roll(simulated, rolling, lambda name: name in CHANNELS and CHANNELS[name].rolling)
    groups = {"trajectories": ships, "bands": quantile_bands(ships[shown], ci_prob)}
    if noise:
        groups["measured_bands"] = quantile_bands(_with_noise(ships[shown], noise, rng), ci_prob)
    departures = None if motion is None else _summarise_extrapolation(extrapolation(vessel, simulated, motion))
    beyond = float(np.nanmax(departures["distance"])) if departures is not None else 0.0
    compared = ships[["x", "y", "psi"]].isel(time=slice(0, None, _SPARSE))
    if manoeuvre.traits.indices:
        kinds = manoeuvre.traits.indices
        index_draws = _nan_without_roll(indices(simulated), rolling, lambda name: needs_roll(kinds[name]))
        compared = index_draws
        if errors is not None:
            index_draws = with_model_error(index_draws, errors, vessel, rng, beyond=beyond, growth=growth(beyond))
        groups |= {"indices": index_draws, "index_bands": quantile_bands(index_draws, ci_prob)}
    attrs = ships.attrs | {"label": manoeuvre.label, "draws": ships.sizes["draw"], "ci_prob": ci_prob, "ci_kind": "eti"}
    attrs |= {
        "term_sets": sum(run.sizes["draw"] > 0 for run in runs),
        "median_draw": _median_draw(compared, ~ships["diverged"].values),
        "infeasible_fraction": 1.0 - ships.sizes["draw"] / sum(len(rows) for _, rows in models),
        "diverged_fraction": float(ships["diverged"].mean()),
        "extrapolated_fraction": np.nan,
        "extrapolation": UNKNOWN,
    }
    attrs |= reliability(beyond) if errors is not None else {}
    if departures is not None:
        groups["extrapolation"] = departures
        attrs["extrapolated_fraction"] = departures.attrs["extrapolated_fraction"]
        attrs["extrapolation"] = sentence(vessel, departures)
    return xr.DataTree.from_dict({"/": xr.Dataset(attrs=attrs), **groups})


def _median_draw(values: xr.Dataset, running: np.ndarray) -> int:
    """Draw whose values, dims (draw, ...), are nearest their medians; a diverged one if all diverged."""
    distance = np.zeros(running.size)
    for value in np.concatenate([one.values.reshape(running.size, -1) for one in values.data_vars.values()], axis=1).T:
        if np.isfinite(value).any() and np.nanstd(value) > 0.0:
            away = ((value - np.nanmedian(value)) / np.nanstd(value)) ** 2
            distance += np.where(np.isfinite(away), away, 100.0)
    return int(np.argmin(np.where(running, distance, np.inf) if running.any() else distance))


def _nan_without_roll(values: xr.Dataset, rolling: np.ndarray, of_roll: Callable[[str], bool]) -> xr.Dataset:
    """Values by draw; those of roll are NaN for draws without roll."""
    if rolling.all() or not rolling.any():
        return values
    mask = xr.DataArray(rolling, dims="draw")
    return values.assign({name: values[name].where(mask) for name in values if of_roll(str(name))})


def has_roll(tree: xr.DataTree) -> bool:
    """Whether a forecast has roll."""
    return "roll" in tree.attrs["dofs"].split()


def draws_text(tree: xr.DataTree) -> str:
    """Text on the draws: number of draws, percentage diverged and, where known, extrapolated."""
    extrapolated = tree.attrs["extrapolated_fraction"]
    text = f"{tree.attrs['draws']} draws, {100.0 * tree.attrs['diverged_fraction']:.3g} % diverged"
    known = np.isfinite(extrapolated)
    return text + (f", {percentage_outside(extrapolated)} of the instants extrapolated" if known else "")


def _with_noise(ships: xr.Dataset, noise: Mapping[str, float], rng: np.random.Generator) -> xr.Dataset:

    def noisy(channel: xr.DataArray) -> xr.DataArray:
        return channel + noise[str(channel.name)] * rng.standard_normal(channel.shape)

    return ships[[name for name in ships if name in noise]].map(noisy, keep_attrs=True)


def _summarise_extrapolation(departures: xr.Dataset) -> xr.Dataset:
    """Fraction outside and median distance over time; medians over symbols; totals in attrs."""
    distance, outside = departures["distance"].values, departures["outside"].values
    count = np.isfinite(distance).sum(axis=0)
    fraction = np.where(count > 0, outside.sum(axis=0) / np.maximum(count, 1), np.nan)
    median_distance = ("time", quantiles(distance, [0.5])[0], departures["distance"].attrs)
    over_time = {"outside_fraction": ("time", fraction), "distance": median_distance}
    over_symbol = departures.drop_dims("time").median("draw", keep_attrs=True)
    beyond = float(np.median(distance[outside])) if outside.any() else 0.0
    attrs = {"extrapolated_fraction": float(outside.sum() / count.sum()), "median_distance": beyond}
    return over_symbol.assign(over_time).assign_coords(time=departures["time"]).assign_attrs(attrs)
