"""Design of the next run of a ship: the candidate whose indices reduce the intervals of the targets most.

Variance of the targets given the indices of a candidate: linear Bayes estimate over the ensemble of draws (Goldstein &
Wooff 2007, doi:10.1002/9780470065662, section 3.1).
"""

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
import scipy
import xarray as xr

from pymc_ship.machine.arguments import check_callables, check_counts, number_or_nan, short_repr
from pymc_ship.machine.errors import SimulationError
from pymc_ship.physics.forces.terms import SYMBOLS
from pymc_ship.physics.manoeuvre.indices import indices
from pymc_ship.physics.manoeuvre.standard import STANDARD, Manoeuvre, pull_out, turning_circle, zigzag
from pymc_ship.physics.motion.equations import STATE
from pymc_ship.physics.motion.prime_record import prime_record
from pymc_ship.physics.motion.simulation import simulate
from pymc_ship.physics.motion.stepping import simulation_settings
from pymc_ship.physics.vessel.vessel import Vessel
from pymc_ship.ships.ensemble.draws import Models, suitable_models, thinned_draws
from pymc_ship.ships.ensemble.index_error import (
    equivalent_sd,
    error_sizes,
    low_discrepancy,
    measurement_sd,
    model_error,
    steady_error,
)
from pymc_ship.ships.ensemble.index_table import index_rows
from pymc_ship.ships.ensemble.motion_error import SIZES, motion_error
from pymc_ship.ships.ensemble.ship import Ship, ShipLike, as_ship
from pymc_ship.ships.forecasting.extrapolation import extrapolation

_SIDES = ("port", "starboard")
CANDIDATES = (
    *(zigzag(angle, angle, side=side) for angle in (10, 20, 35) for side in _SIDES),
    *(turning_circle(angle, side=side) for angle in (15, 35) for side in _SIDES),
    *(pull_out(20, 90, side=side) for side in _SIDES),
)
_TARGET_QUANTITIES = ("angle", "distance")
_REACHED = 0.9  # least fraction of the draws that reach an index
_INSIDE = 0.95  # probability of intervals, and fraction of the draws inside the sea room
_ROUNDS = np.deg2rad(540.0)  # change of heading at the end of a circle
_SWINGS = 3  # swings of a zigzag
_POINTS = 64  # points of a track
_MOST_RUNS = 100  # runs to choose
_FAR, _TINY = 1e3, 1e-12  # distance [sd] of a draw without an index, and least half width
_QUANTILE = float(scipy.special.ndtri(0.5 + 0.5 * _INSIDE))


class _Run(NamedTuple):
    """Simulations of a manoeuvre with all draws."""

    manoeuvre: Manoeuvre
    ships: xr.Dataset  # motion (draw, time)
    end: np.ndarray  # last sample of each draw
    indices: xr.Dataset

    def reached_indices(self, names: Sequence[str]) -> list[str]:
        """Indices that at least :data:`_REACHED` of the draws reach."""
        return [name for name in names if name in self.indices and np.isfinite(self.indices[name]).mean() >= _REACHED]

    def columns(self, names: Sequence[str]) -> np.ndarray:
        """Indices of the draws (n_draws, n_names)."""
        values = [self.indices[name].values for name in names]
        return np.array(values).T if names else np.empty((self.indices.sizes["draw"], 0))


class _Data(NamedTuple):
    indices: np.ndarray  # (n_draws, k)
    noise_sd: np.ndarray  # (k,)
    motion: xr.DataArray  # prime, of all runs


def design(
    ship: ShipLike,
    candidates: Mapping[str, Manoeuvre] | Sequence[Manoeuvre] = CANDIDATES,
    n: int = 1,
    *,
    interest: Sequence[Manoeuvre] = STANDARD,
    sea_room: float = np.inf,
    wind: tuple[float, float] | None = None,
    draws: int = 400,
    progress: Callable[[str], None] = lambda _: None,
) -> xr.Dataset:
    """Next runs that reduce the intervals of target manoeuvres most.

    Parameters
    ----------
    ship : Ship
        One without model error has the typical error of other ships.
    candidates : mapping of str to Manoeuvre or sequence of Manoeuvre, optional
        Manoeuvres with indices.
    n : int, optional
        Number of runs, chosen one after the other, possibly repeated.
    interest : sequence of Manoeuvre, optional
        Manoeuvres to forecast well, in calm water: overshoot angles, advance, transfer and tactical diameter.
    sea_room : float, optional
        [m]. A candidate needs the longest distance of two points of its track, for 95 % of the draws.
    wind : (speed, direction), optional
        Of the next runs, as in :func:`pymc_ship.simulate`, direction relative to the approach course. Term sets
        without wind forces are omitted.
    draws : int, optional
        Total number, at least one of each term set.
    progress : callable, optional
        Called with a short text before each manoeuvre.

    Returns
    -------
    Dataset, dims (step, candidate, stage, target)
        ``width_ratio`` (step, candidate): width of the target intervals over that of today, geometric mean; NaN
        without enough sea room. ``sea_room`` (candidate) [m]. ``chosen`` (step). ``half_width`` (stage, target) of
        intervals of 95 %, now and after each run, in the ``units`` of the target.

    Raises
    ------
    SimulationError
        For a count below one, or without a candidate that has indices and sea room, a target that nine tenths of the
        draws reach or, with wind, a term set with wind forces.

    Examples
    --------
    After two 10/10 zigzags, a turning circle reduces the intervals most:

    >>> import numpy as np
    >>> import pymc_ship as ps
    >>> vessel, rng = ps.load_vessel("kvlcc2"), np.random.default_rng(1)
    >>> sides = ("port", "starboard")
    >>> runs = [ps.simulate(vessel, ps.zigzag(10, 10, side=side), duration=600, step=0.5) for side in sides]
    >>> runs = [ps.pollute(run, level=0.01, rng=rng) for run in runs]
    >>> ship = ps.identify_ship(runs, vessel, terms=["hull and loading, cubic"], draws=100, rng=rng).ship
    >>> plan = ps.design(ship, [ps.zigzag(10, 10), ps.turning_circle(35)])
    >>> plan["chosen"].item()
    'turning circle 35 port'
    """
    check_counts(SimulationError, n=n)
    if n > _MOST_RUNS:
        raise SimulationError(f"A design chooses n of at most {_MOST_RUNS} runs, found {short_repr(n)}; lower it.")
    check_counts(SimulationError, least=2, draws=draws)
    check_callables(progress=progress)
    ship, by_label, targeted = as_ship(ship), _manoeuvres_by_label(candidates), _manoeuvres_by_label(interest)
    given = (*by_label.values(), *targeted.values())
    have_indices = [isinstance(one, Manoeuvre) and bool(one.traits.indices) for one in given]
    if not by_label or not targeted or not all(have_indices):
        raise SimulationError(
            "A design needs one candidate and one target manoeuvre or more that have indices, found "
            f"{list(by_label)} and {list(targeted)}; correct them."
        )
    if not number_or_nan(sea_room) > 0.0:
        raise SimulationError(f"sea_room must be a positive number [m], found {short_repr(sea_room)}; correct it.")
    models = thinned_draws(suitable_models(ship.models, wind=wind), draws)
    runs: dict[tuple[Manoeuvre, bool], _Run] = {}

    def run_of(manoeuvre: Manoeuvre, *, windy: bool) -> _Run:
        if (manoeuvre, windy) not in runs:
            progress(f"simulating the {manoeuvre.label}")
            runs[manoeuvre, windy] = _simulate_run(models, manoeuvre, **({"wind": wind} if windy else {}))
        return runs[manoeuvre, windy]

    targets = [run_of(manoeuvre, windy=False) for manoeuvre in targeted.values()]
    candidate_runs = {label: run_of(manoeuvre, windy=wind is not None) for label, manoeuvre in by_label.items()}
    return _choose_runs(_design(ship, models[0][0], targets), candidate_runs, n, sea_room)


def _simulate_run(models: Models, manoeuvre: Manoeuvre, **around: Any) -> _Run:
    runs = []
    for vessel, rows in models:
        settings = simulation_settings(vessel, duration=manoeuvre.traits.reach * vessel.particulars.ship_time)
        runs.append(simulate(vessel, manoeuvre, coefficients=rows, **settings, **around))
    ships = xr.concat(runs, "draw", combine_attrs="override")
    heading_change, last_index = ships["psi"].values - ships["psi"].values[:, :1], ships.sizes["time"] - 1
    finished = np.zeros(heading_change.shape, dtype=bool)
    if manoeuvre.traits.circles:
        finished = np.abs(heading_change) >= _ROUNDS
    elif manoeuvre.traits.swings:
        crossed = np.diff(np.sign(heading_change), axis=1, prepend=0.0) * np.sign(heading_change) == 2.0
        finished = np.cumsum(crossed, axis=1) >= _SWINGS
    end = np.where(finished.any(axis=1), finished.argmax(axis=1), last_index)
    return _Run(manoeuvre, ships, end, indices(ships))


def _room(run: _Run) -> float:
    """Largest distance of two track points [m], for :data:`_INSIDE` of the draws."""
    samples = np.round(np.linspace(0.0, 1.0, _POINTS) * run.end[:, None]).astype(int)
    track = np.take_along_axis(run.ships["x"].values + 1j * run.ships["y"].values, samples, axis=1)
    distance = np.abs(track[:, :, None] - track[:, None, :]).max(axis=(1, 2))
    return float(np.nanquantile(distance, _INSIDE))


@dataclass(frozen=True, eq=False)
class _Design:
    """Targets of a design, and what the intervals of their indices depend on."""

    vessel: Vessel
    errors: Mapping[str, np.ndarray]  # sizes of the model error by kind
    growth: Callable[[float], np.ndarray]  # of this error at a distance beyond the motion
    rows: Sequence[Mapping]  # held-out indices
    targets: Sequence[tuple[_Run, list[str]]]  # runs with the names of their target indices
    target_values: np.ndarray  # (n_draws, n_targets)
    central: int  # draw nearest to the median of all targets
    data: _Data  # before any new run

    def _error(self, run: _Run, names: Sequence[str], motion: xr.DataArray) -> np.ndarray:
        if not names:
            return np.empty((0, SIZES))
        middle = run.indices[list(names)].median("draw", keep_attrs=True).expand_dims(draw=SIZES)
        beyond = float(np.nanmax(extrapolation(self.vessel, self._central_motion(run), motion)["distance"]))
        quantile = (np.arange(SIZES) + 0.5) / SIZES
        laws = {"quantile": quantile, "growth": self.growth(beyond), "growth_quantile": low_discrepancy(SIZES)}
        sizes = error_sizes(middle, self.errors, self.vessel, beyond=beyond, **laws)
        return np.array([sizes[name] for name in names])

    def _central_motion(self, run: _Run) -> xr.Dataset:
        return run.ships.isel(draw=self.central, time=slice(None, int(run.end[self.central]) + 1))

    def _measured_indices(self, run: _Run) -> list[str]:
        """Indices of a run with a known model error."""
        table, known = run.manoeuvre.traits.indices, {*self.errors, *(("diameter",) if "rate" in self.errors else ())}
        return run.reached_indices([name for name, index in table.items() if index.quantity in known - {"roll"}])

    def after(self, data: _Data, run: _Run) -> _Data:
        """Data after one more run."""
        names, ship = self._measured_indices(run), self._central_motion(run)
        prime, _, _ = prime_record(self.vessel, {name: ship[name].values for name in (*STATE[:5], "delta")})
        rows = xr.DataArray(np.column_stack([prime[symbol] for symbol in SYMBOLS]), dims=("row", "symbol"))
        rows = rows.assign_coords(symbol=list(SYMBOLS)).dropna("row")
        readings = measurement_sd(run.indices[names], self.rows, self.vessel)
        errors = zip(names, self._error(run, names, data.motion), strict=True)
        noise_sd = [equivalent_sd(np.hypot(sd, readings[name])) for name, sd in errors]
        columns = np.concatenate([data.indices, run.columns(names)], axis=1)
        return _Data(columns, np.append(data.noise_sd, noise_sd), xr.concat([data.motion, rows], "row"))

    def half_widths(self, data: _Data) -> np.ndarray:
        """Half widths of the intervals of the targets, (n_targets,)."""
        error = np.concatenate([self._error(run, names, data.motion) for run, names in self.targets])
        lower, upper = np.nanquantile(self.target_values, [0.5 - 0.5 * _INSIDE, 0.5 + 0.5 * _INSIDE], axis=0)
        fraction = remaining_variance(self.target_values, data.indices, data.noise_sd)
        variance = (0.5 * (upper - lower) / _QUANTILE) ** 2 * fraction
        sd = np.sqrt(variance[:, None] + error**2)
        return np.maximum(_QUANTILE * np.array([equivalent_sd(row) for row in sd]), _TINY)


def _design(ship: Ship, vessel: Vessel, runs: Sequence[_Run]) -> _Design:
    """Targets of an ensemble; SimulationError where fewer than nine tenths of the draws reach any."""
    targets = []
    for run in runs:
        table = run.manoeuvre.traits.indices
        scored = [name for name, index in table.items() if index.scored and index.quantity in _TARGET_QUANTITIES]
        targets += [(run, names)] if (names := run.reached_indices(scored)) else []
    if not targets:
        raise SimulationError(
            "A design needs target indices that nine tenths of the draws reach, found none of "
            f"{[run.manoeuvre.label for run in runs]}; give other manoeuvres, or identify the ship from more runs."
        )
    if ship.motion is None:
        raise SimulationError(
            "A design needs the motion of the runs so far, found a ship without it; give that of identify_ship, or of "
            "a posterior whose constant_data has `motion`."
        )
    target_values = np.concatenate([run.columns(names) for run, names in targets], axis=1)
    sd = np.nanstd(target_values, axis=0)
    distance = (target_values - np.nanmedian(target_values, axis=0)) / np.where(sd > 0.0, sd, 1.0)
    if ship.index_error is None:  # the typical errors of other ships
        errors = model_error(()) | steady_error(motion_error((), ship.vessel))
    else:
        errors = ship.index_error | steady_error(ship.motion_error)
    return _Design(
        vessel=vessel,
        errors=errors,
        growth=ship.growth_at,
        rows=list(index_rows(ship.held_out_indices)),
        targets=targets,
        target_values=target_values,
        central=int(np.argmin(np.sum(np.nan_to_num(distance, nan=_FAR) ** 2, axis=1))),
        data=_Data(np.empty((len(target_values), 0)), np.empty(0), ship.motion.drop_vars("row", errors="ignore")),
    )


def remaining_variance(targets: np.ndarray, measured: np.ndarray, noise: np.ndarray) -> np.ndarray:
    """Remaining variance of target columns of an ensemble, as a fraction, when other columns are measured.

    Linear Bayes estimate over the draws that reach all columns, corrected for the trace(S (S + N)^-1) directions that
    any ensemble explains by chance; S covariance of the measured columns, N of their noise. ``targets`` (n_draws, m),
    ``measured`` (n_draws, k), ``noise`` sd (k,); the fraction (m,) is 1 where too few draws reach all columns.
    """
    complete = np.isfinite(targets).all(axis=1) & np.isfinite(measured).all(axis=1)
    count = int(complete.sum())
    if not measured.shape[1] or count < 3:
        return np.ones(targets.shape[1])
    tail, both = 0.5 - 0.5 * _INSIDE, (targets[complete], measured[complete])
    clipped = [np.clip(values, *np.quantile(values, [tail, 1.0 - tail], axis=0)) for values in both]  # diverged draws
    a, s = (values - values.mean(axis=0) for values in clipped)
    unit = np.sqrt(np.mean(s**2, axis=0) + noise**2)
    unit[unit == 0.0] = 1.0
    own, across = s.T @ s / np.outer(unit, unit) / count, s.T @ a / unit[:, None] / count
    inverse = np.linalg.pinv(own + np.diag((noise / unit) ** 2), hermitian=True)
    determined, variance = float(np.trace(own @ inverse)), np.mean(a**2, axis=0)
    if determined >= count - 2:
        return np.ones(targets.shape[1])
    explained = np.sum(across * (inverse @ across), axis=0) / np.where(variance > 0.0, variance, 1.0)
    chance = (count - 1) / (count - 1 - determined)
    return np.clip((1.0 - explained) * chance, 0.0, 1.0)


def _choose_runs(design: _Design, candidate_runs: Mapping[str, _Run], n: int, sea_room: float) -> xr.Dataset:
    """Runs chosen one after the other by the mean width of the target intervals."""
    room = {label: _room(run) for label, run in candidate_runs.items()}
    fitting = {label: run for label, run in candidate_runs.items() if room[label] <= sea_room}
    if not fitting:
        least = min(room, key=lambda label: room[label])
        raise SimulationError(
            f"A design needs a candidate that fits in {sea_room:g} m: the {least} takes {room[least]:.0f} m; give more "
            "sea room or shorter runs."
        )
    data, chosen, widths, ratios = design.data, [], [design.half_widths(design.data)], []
    for _ in range(n):
        data_after = {label: design.after(data, run) for label, run in fitting.items()}
        half_widths = {label: design.half_widths(one) for label, one in data_after.items()}
        ratio = {label: float(np.exp(np.mean(np.log(width / widths[0])))) for label, width in half_widths.items()}
        best = min(ratio, key=ratio.__getitem__)
        data = data_after[best]
        chosen.append(best)
        widths.append(half_widths[best])
        ratios.append([ratio.get(label, np.nan) for label in candidate_runs])
    targets = [(run.manoeuvre, name) for run, names in design.targets for name in names]
    variables = {
        "width_ratio": (("step", "candidate"), ratios),
        "sea_room": ("candidate", list(room.values()), {"units": "m"}),
        "chosen": ("step", chosen),
        "half_width": (("stage", "target"), np.array(widths)),
        "units": ("target", [manoeuvre.traits.indices[name].units for manoeuvre, name in targets]),
    }
    coords = {
        "step": 1 + np.arange(n),
        "candidate": list(candidate_runs),
        "stage": np.arange(n + 1),
        "target": [f"{manoeuvre.label}, {name.replace('_', ' ')}" for manoeuvre, name in targets],
    }
    return xr.Dataset(variables, coords, {"vessel": design.vessel.name})


def _manoeuvres_by_label(manoeuvres: Mapping[str, Manoeuvre] | Sequence[Manoeuvre]) -> dict[str, Manoeuvre]:
    """Manoeuvres by their label, or by their own label and approach speed, with a number where it repeats."""
    if isinstance(manoeuvres, Mapping):
        return dict(manoeuvres)
    labelled: dict[str, Manoeuvre] = {}
    for one in manoeuvres if isinstance(manoeuvres, Iterable) else [manoeuvres]:
        label = short_repr(one)
        if isinstance(one, Manoeuvre):
            label = one.label + (f" from {one.approach_speed:g} m/s" if one.approach_speed else "")
        same = sum(name.split(" #")[0] == label for name in labelled)
        labelled[f"{label} #{same + 1}" if same else label] = one
    return labelled
