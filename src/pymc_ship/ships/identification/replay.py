"""Open-loop simulation along the measured inputs of a record, and its score."""

from collections.abc import Sequence
from copy import deepcopy
from typing import Any

import numpy as np
import scipy
import xarray as xr

from pymc_ship.machine.arguments import check_counts, check_probabilities, number_or_nan, short_repr
from pymc_ship.machine.errors import FitError, TrialError
from pymc_ship.machine.seeds import Seed, random_generator
from pymc_ship.physics.manoeuvre.standard import Manoeuvre
from pymc_ship.physics.motion.equations import STATE
from pymc_ship.records.steering.recognition import recognise_by_facility, with_steering
from pymc_ship.ships.ensemble.draws import thinned_draws
from pymc_ship.ships.ensemble.index_error import index_sd
from pymc_ship.ships.ensemble.index_table import index_rows, index_table
from pymc_ship.ships.ensemble.motion_error import with_motion_error
from pymc_ship.ships.ensemble.scores import BANDS, crps, quantile_bands
from pymc_ship.ships.ensemble.ship import Ship, ShipLike, as_ship
from pymc_ship.ships.forecasting.extrapolation import extrapolation
from pymc_ship.ships.forecasting.forecast import recorded_forecast
from pymc_ship.ships.identification.held_out import forecast_rows, index_noise_sd
from pymc_ship.ships.identification.open_loop import reading_noise_sd, replay_noise_sd, simulate_open_loop
from pymc_ship.trial.channels import CHANNELS
from pymc_ship.trial.record import as_trial, check_trial, facility_of, run_names, sampling_interval, trial_list

SCORED = ("u", "v", "r", "psi", "position")  # channels of a score; the position is the distance between the tracks
_VELOCITIES = SCORED[:3]
_OF_WINDOW = ("square", "coverage", "crps")
_MEASURED = ("u", "v", "r", "psi", "delta")
_NO_INTERVAL = {"lower": np.nan, "upper": np.nan}


def replay(
    ship: ShipLike,
    trial: xr.Dataset,
    *,
    start: float | None = None,
    duration: float | None = None,
    draws: int = 200,
    ci_prob: float = 0.9,
) -> xr.DataTree:
    """Simulate a ship along the measured inputs of a record.

    Parameters
    ----------
    ship : Ship, Vessel, str or Path
        A vessel is a ship of one draw.
    trial : Dataset, dims (time,)
        u, v, r, psi and delta; n, wind_speed and wind_direction for models with these forces; x and y for the track.
    start : float, optional
        Start time [s] in the record; the first sample by default.
    duration : float, optional
        [s]; to the end of the record by default.
    draws : int, optional
        Largest number.
    ci_prob : float, optional
        Probability inside the equal-tailed bands.

    Returns
    -------
    DataTree
        ``trajectories`` (dims draw, time), ``predictive``, the same with model error, ``bands`` (dims band, time) of
        ``predictive``, and ``measured`` (dims time). Diverged draws are NaN; ``diverged_fraction`` in attrs.

    Raises
    ------
    TrialError
        For missing channels, or a start or duration outside the record.
    ValueError
        For no draws, or ``ci_prob`` not in (0, 1).

    Examples
    --------
    >>> import pymc_ship as ps
    >>> vessel = ps.load_vessel("kvlcc2")
    >>> trial = ps.simulate(vessel, ps.zigzag(20, 20), duration=600, step=0.5)
    >>> tree = ps.replay(vessel, trial, start=100, duration=200)
    >>> bool(abs(tree["bands"]["u"].sel(band="median") - tree["measured"]["u"]).max() < 0.05)
    True
    """
    check_counts(draws=draws)
    check_probabilities(ci_prob=ci_prob)
    ship, trial = as_ship(ship), as_trial(trial)
    samples = _samples(trial, start, duration)
    piece, models = trial.isel(time=samples), thinned_draws(ship.models, draws)
    states = np.concatenate([simulate_open_loop(vessel, rows, trial, samples) for vessel, rows in models], axis=1)
    coords = {"draw": np.arange(states.shape[1]), "time": piece["time"].values}
    units = {name: {"units": CHANNELS[name].unit.name} for name in STATE}

    def motion(values: np.ndarray) -> xr.Dataset:
        return xr.Dataset({n: (("draw", "time"), values[k], units[n]) for k, n in enumerate(STATE)}, coords)

    ships = motion(states)
    predictive = ships
    if ship.motion_error:
        lead = piece["time"].values - piece["time"].values[0]
        beyond = extrapolation_distance(ship, ships.median("draw"), piece)
        growth = ship.growth_at(_greatest(beyond))
        predictive = motion(with_motion_error(states, lead, ship.motion_error, ship.vessel, beyond, growth))
    measured = piece[[name for name in STATE if name in piece]]
    attrs = {"ci_prob": ci_prob, "ci_kind": "eti", "draws": states.shape[1]}
    attrs["diverged_fraction"] = float(np.isnan(states[0, :, -1]).mean())
    groups = {"trajectories": ships, "predictive": predictive, "measured": measured}
    groups["bands"] = quantile_bands(predictive, ci_prob)
    return xr.DataTree.from_dict({"/": xr.Dataset(attrs=attrs), **groups})


def extrapolation_distance(ship: Ship, median: xr.Dataset, piece: xr.Dataset) -> np.ndarray | None:
    """Distance of the median ship from the motion of the runs of the identification, by instant."""
    if ship.motion is None:
        return None
    return extrapolation(ship.vessel, median.assign(delta=piece["delta"]), ship.motion)["distance"].values


def score(
    ship: ShipLike,
    trials: xr.Dataset | Sequence[xr.Dataset],
    *,
    names: Sequence[str] | None = None,
    length: float | None = None,
    every: float | None = None,
    draws: int = 100,
    ci_prob: float = 0.9,
) -> xr.Dataset:
    """Score of replays in windows.

    Parameters
    ----------
    ship : Ship, Vessel, str or Path
    trials : Dataset or sequence of Dataset
        Records as for :func:`replay`.
    names : sequence of str, optional
        Of the records; numbers by default.
    length : float, optional
        Of a window [s]; 5 L/U by default.
    every : float, optional
        From the start of a window to the next [s]; a window's length by default.
    draws, ci_prob
        As :func:`replay`.

    Returns
    -------
    Dataset, dims (run, channel)
        ``rmse`` (SI) of the median ship; ``relative``, over the sd of the channel in all records (psi and position:
        over the motion within windows); ``coverage`` of the bands with measurement noise; ``crps`` (SI; position: mean
        distance of the draws). By run ``windows``, ``diverged`` windows and ``score``, the mean of ``relative``, NaN
        with a diverged window. Attr ``score``: mean over the runs.

    Raises
    ------
    TrialError
        For a record shorter than a window, and as :func:`replay`.

    Examples
    --------
    >>> import pymc_ship as ps
    >>> vessel = ps.load_vessel("kvlcc2")
    >>> trial = ps.simulate(vessel, ps.zigzag(20, 20), duration=600, step=0.5)
    >>> scores = ps.score(vessel, trial)
    >>> bool(scores.attrs["score"] < 0.05), int(scores["diverged"].sum())
    (True, 0)
    """
    check_counts(draws=draws)
    check_probabilities(ci_prob=ci_prob)
    ship, trials = as_ship(ship), trial_list(trials)
    for trial in trials:
        check_trial(trial, (*_MEASURED, "x", "y"))
    names = run_names("A score", names, len(trials))
    unit = ship.vessel.particulars.ship_time
    length = 5.0 * unit if length is None else length
    every = length if every is None else every
    shortest = max(map(sampling_interval, trials))
    if not all(shortest <= number_or_nan(value) < np.inf for value in (length, every)):
        found = f"length = {short_repr(length)} s and every = {short_repr(every)} s"
        raise TrialError(
            f"A score needs windows of positive length and distance, one sampling interval of {shortest:.4g} s or "
            f"more, found {found}; correct them."
        )
    means = {name: float(np.mean(np.concatenate([trial[name].values for trial in trials]))) for name in _VELOCITIES}
    settings: dict[str, Any] = {"windows": (length, every), "means": means, "draws": draws, "ci_prob": ci_prob}
    rows = {name: _score_run(ship, trial, **settings) for name, trial in zip(names, trials, strict=True)}
    keys, dims = ("rmse", "coverage", "crps"), ("run", "channel")
    table = {key: (dims, np.array([row[key] for row in rows.values()])) for key in keys}
    mean_squares = np.array([row["mean_square_motion"] for row in rows.values()])
    table["relative"] = dims, table["rmse"][1] / np.sqrt(np.mean(mean_squares, axis=0))
    by_run = {key: ("run", [row[key] for row in rows.values()]) for key in ("windows", "diverged")}
    scores = xr.Dataset(table | by_run, {"run": list(rows), "channel": list(SCORED)})
    scores["score"] = scores["relative"].mean("channel", skipna=False)
    attrs = {"score": float(scores["score"].mean(skipna=False)), "length": length, "every": every, "ci_prob": ci_prob}
    return scores.assign_attrs(attrs)


def score_indices(
    ship: ShipLike,
    trials: xr.Dataset | Sequence[xr.Dataset],
    *,
    names: Sequence[str] | None = None,
    draws: int = 200,
    rng: Seed,
) -> xr.Dataset:
    """Measured and forecast indices of recorded manoeuvres.

    Parameters
    ----------
    ship, trials, names
        As for :func:`score`.
    draws : int, optional
        Largest number; term sets keep their proportions.
    rng : int, SeedSequence or Generator
        For the draws of the denoised records, which give ``measured_sd``, and of the forecasts.

    Returns
    -------
    Dataset, dims (run, index)
        ``measured``, ``forecast``, ``parameter_sd``, ``model_sd`` (between the models), ``measured_sd`` (of the
        measurement noise), ``scale``, ``beyond``, the distance of the record from the runs of the identification, and
        ``sd`` of the error, with the model error at this distance; all sds are 0 for a vessel. ``lower`` and ``upper``
        are the interval of 95 % of :func:`pymc_ship.forecast`, at the facility and in the wind of the record; NaN for
        a vessel.
        Coordinates ``manoeuvre`` (run), ``quantity`` and ``units`` (index). Records of no standard
        manoeuvre are left out.

    Raises
    ------
    TrialError
        For a trial that lacks a channel.
    """
    check_counts(draws=draws)
    rng, ship, trials = random_generator(rng), as_ship(ship), trial_list(trials)
    start = deepcopy(rng)  # the random numbers of every forecast
    names = run_names("A score", names, len(trials))
    drawn_models, errors = thinned_draws(ship.models, draws), ship.index_error or {}
    estimates = [member.estimate for member in ship.members if len(member.draws)]
    weight = np.array([len(rows) for _, rows in drawn_models], dtype=float)
    manoeuvres, _ = recognise_by_facility(trials, ship.vessel)
    rows = []
    for name, trial, manoeuvre in zip(names, trials, manoeuvres, strict=True):
        if manoeuvre is not None:
            gear = ship.facilities.get(facility_of(trial))
            models = [
                (with_steering(vessel, gear) if gear else vessel, np.vstack([estimate, drawn]))
                for (vessel, drawn), estimate in zip(drawn_models, estimates, strict=True)
            ]
            delay = models[0][0].particulars.rudder_delay
            noise = {} if ship.index_error is None else index_noise_sd(trial, manoeuvre, delay, rng)
            forecasts = forecast_rows(name, trial, manoeuvre, models, weight / weight.sum(), noise)
            beyond = 0.0 if ship.index_error is None else _greatest(extrapolation_distance(ship, trial, trial))
            growth = ship.growth_at(beyond)
            intervals = _intervals(ship, manoeuvre, trial, deepcopy(start))
            forecasts = [row | {"beyond": beyond} | intervals.get(row["index"], _NO_INTERVAL) for row in forecasts]
            rows += [row | {"sd": index_sd(row, errors, growth)} for row in forecasts]
    return index_table(rows)


def _intervals(
    ship: Ship, manoeuvre: Manoeuvre, trial: xr.Dataset, rng: np.random.Generator
) -> dict[str, dict[str, float]]:
    """Intervals of the forecast of a recorded manoeuvre by index; none for a single draw, or with one feasible draw."""
    if ship.draws < 2:
        return {}
    try:
        bands = recorded_forecast(ship, manoeuvre, trial, rng=rng)["index_bands"].to_dataset()
    except FitError:
        return {}
    return {str(name): {end: float(values.sel(band=end)) for end in _NO_INTERVAL} for name, values in bands.items()}


def _greatest(distance: np.ndarray | None) -> float:
    return 0.0 if distance is None else float(np.nanmax(distance, initial=0.0))


def _score_run(
    ship: Ship, trial: xr.Dataset, windows: tuple[float, float], means: dict[str, float], **bands: Any
) -> dict:
    """Errors, coverage and CRPS of the windows of one record, each list in the order of :data:`SCORED`."""
    time, (length, every) = trial["time"].values, windows
    begins = np.arange(time[0], time[-1] - length + 1e-9, every)
    if not begins.size:
        raise TrialError(
            f"A score needs a record of {length:g} s or more, found {np.ptp(time):.4g} s; give a shorter length."
        )
    trees = [replay(ship, trial, start=float(begin), duration=length, **bands) for begin in begins]
    complete = [tree for tree in trees if np.isfinite(tree["bands"].dataset["u"].values[:, -1]).all()]
    noise_sd = reading_noise_sd(trial)
    window_scores = [_score_window(tree, replay_noise_sd(noise_sd, tree["measured"].dataset)) for tree in complete]
    mean = dict.fromkeys(_OF_WINDOW, np.full(len(SCORED), np.nan))
    if window_scores:
        mean = {key: np.mean([window[key] for window in window_scores], axis=0) for key in _OF_WINDOW}
    n_diverged = len(trees) - len(complete)
    mean["rmse"] = np.full(len(SCORED), np.nan) if n_diverged else np.sqrt(mean["square"])
    mean["mean_square_motion"] = np.mean([_mean_square(tree["measured"].dataset, means) for tree in trees], axis=0)
    return {**mean, "windows": len(trees), "diverged": n_diverged}


def _mean_square(measured: xr.Dataset, means: dict[str, float]) -> list[float]:
    """Mean square of the motion of a window, in the order of :data:`SCORED`."""
    squares = []
    for name in SCORED[:-1]:
        values = measured[name].values
        squares.append(float(np.mean((values - means.get(name, values[0])) ** 2)))
    track = (measured[name].values for name in "xy")
    return [*squares, float(sum(np.mean((values - values[0]) ** 2) for values in track))]


def _score_window(tree: xr.DataTree, noise_sd: np.ndarray) -> dict[str, list[float]]:
    """Squared error, coverage and CRPS of a window, in the order of :data:`SCORED`; ``noise_sd`` (8, n_time)."""
    ships, measured, bands = (tree[name].dataset for name in ("predictive", "measured", "bands"))
    median, ci_prob = tree["trajectories"].dataset.median("draw"), tree.attrs["ci_prob"]
    noise = dict(zip(STATE, noise_sd, strict=True))
    scores: dict[str, list[float]] = {key: [] for key in _OF_WINDOW}
    for name in SCORED[:-1]:
        values = measured[name].values
        low, middle, high = (bands[name].sel(band=band).values for band in BANDS)
        reach = scipy.special.ndtri(0.5 + 0.5 * ci_prob) * noise[name]
        half = np.where(values < middle, middle - low, high - middle)
        scores["square"].append(float(np.mean((median[name].values - values) ** 2)))
        scores["coverage"].append(float(np.mean(np.abs(values - middle) <= np.hypot(half, reach))))
        scores["crps"].append(crps(ships[name].values, values))
    distance = np.hypot(*(median[name].values - measured[name].values for name in "xy"))
    reach = np.nanquantile(np.hypot(*(ships[name].values - median[name].values for name in "xy")), ci_prob, axis=0)
    noise_radius = np.sqrt(-2.0 * np.log1p(-ci_prob)) * np.sqrt(0.5 * (noise["x"] ** 2 + noise["y"] ** 2))
    scores["square"].append(float(np.mean(distance**2)))
    scores["coverage"].append(float(np.mean(distance <= np.hypot(reach, noise_radius))))
    scores["crps"].append(float(np.nanmean(np.hypot(*(ships[name].values - measured[name].values for name in "xy")))))
    return scores


def _samples(trial: xr.Dataset, start: float | None, duration: float | None) -> slice:
    check_trial(trial, _MEASURED)
    time = trial["time"].values
    begin = float(time[0]) if start is None else number_or_nan(start)
    end = float(time[-1]) if duration is None else begin + number_or_nan(duration)
    if not time[0] <= begin < end <= time[-1] + 1e-9:
        raise TrialError(
            f"A replay begins and ends inside the record, {time[0]:g} to {time[-1]:g} s, found {begin:g} to {end:g} s; "
            "correct start and duration."
        )
    return slice(*np.searchsorted(time, (begin - 1e-9, end + 1e-9)).tolist())


def channel_rows(scores: xr.Dataset) -> list[dict]:
    """One row for each channel of each run of a score."""
    columns = scores[["rmse", "relative", "coverage", "crps"]].to_dataframe(dim_order=["run", "channel"])
    return columns.reset_index().to_dict("records")


def run_rows(scores: xr.Dataset) -> list[dict]:
    """One row for each run of a score."""
    return scores[["windows", "diverged", "score"]].astype(float).to_dataframe().reset_index().to_dict("records")


def index_errors(indices: xr.Dataset) -> list[dict]:
    """Rows of :func:`pymc_ship.score_indices` with the error, and whether the 95 % interval covers the measurement."""
    rows = []
    for row in index_rows(indices):
        error = row["forecast"] - row["measured"]
        lower, upper = row.get("lower", np.nan), row.get("upper", np.nan)
        inside = ("no", "yes")[lower <= row["measured"] <= upper] if np.isfinite([lower, upper]).all() else ""
        names = {"run": row["run"], "manoeuvre": row["manoeuvre"], "index": row["index"].replace("_", " ")}
        numbers = {key: row[key] for key in ("measured", "forecast", "sd")}
        rows.append(names | numbers | {"lower": lower, "upper": upper, "error": error, "inside": inside})
    return rows
