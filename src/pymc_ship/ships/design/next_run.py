"""Which run to sail next of an identified ship: what its indices would tell of the manoeuvres that are to be known.

An identified ship is an ensemble, draws of several models. Every draw is sailed through the candidates and through the
manoeuvres that are to be known. What the indices of a candidate would tell of the others is the linear Bayes estimate
over the ensemble (Goldstein & Wooff 2007, doi:10.1002/9780470065662, section 3.1). Its noise is the error of an index
that held-out runs and other ships show (waves, gusts, and forces that no model of the ensemble has), and the noise of
the readings in held-out runs. A run also moves the edge of the motion that is known, beyond which errors grow.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
import xarray as xr
from scipy.special import ndtri

from pymc_ship.machine.errors import SimulationError
from pymc_ship.physics.forces.terms import SYMBOLS
from pymc_ship.physics.manoeuvre.indices import indices
from pymc_ship.physics.manoeuvre.standard import STANDARD, Manoeuvre, pull_out, turning_circle, zigzag
from pymc_ship.physics.motion.equations import STATE
from pymc_ship.physics.motion.prime_record import prime_record
from pymc_ship.physics.motion.simulation import simulate
from pymc_ship.physics.motion.stepping import simulation_settings
from pymc_ship.physics.vessel.vessel import Vessel
from pymc_ship.ships.ensemble.draws import suitable_models, thinned_draws
from pymc_ship.ships.ensemble.index_error import equivalent_sd, error_sizes, model_error, readings_noise, steady_error
from pymc_ship.ships.ensemble.index_table import index_rows
from pymc_ship.ships.ensemble.motion_error import SIZES, motion_error
from pymc_ship.ships.ensemble.ship import Ship, ShipLike, as_ship
from pymc_ship.ships.forecasting.extrapolation import extrapolation

CANDIDATES = tuple(
    make(*angles, side=side)
    for make, angles in (
        (zigzag, (10, 10)),
        (zigzag, (20, 20)),
        (zigzag, (35, 35)),
        (turning_circle, (15,)),
        (turning_circle, (35,)),
        (pull_out, (20, 90)),
    )
    for side in ("port", "starboard")
)
"""Runs to choose from where none are given."""

_ASKED = ("angle", "distance")  # quantities of the indices that are to be known
_REACHED = 0.9  # of the draws, by which an index is reached that counts
_INSIDE = 0.95  # probability of intervals, and share of the draws whose track the sea room holds
_ROUNDS = np.deg2rad(540.0)  # of a circle, until which it is sailed
_SWINGS = 3  # of a zigzag
_POINTS = 64  # of a track
_FAR, _TINY = 1e3, 1e-12  # sd from the middle of a draw without an index, and an interval without width
_QUANTILE = float(ndtri(0.5 + 0.5 * _INSIDE))


class _Run(NamedTuple):
    """A manoeuvre that all draws sail: motion (draw, time), samples at which each draw ends it, and its indices."""

    manoeuvre: Manoeuvre
    ships: xr.Dataset
    end: np.ndarray
    indices: xr.Dataset

    def reached(self, names: Sequence[str]) -> list[str]:
        """Those of the indices that :data:`_REACHED` of the draws reach."""
        return [name for name in names if name in self.indices and np.isfinite(self.indices[name]).mean() >= _REACHED]

    def columns(self, names: Sequence[str]) -> np.ndarray:
        """Indices of the draws (n_draws, n_names)."""
        values = [self.indices[name].values for name in names]
        return np.array(values).T if names else np.empty((self.indices.sizes["draw"], 0))


class _Known(NamedTuple):
    """What some runs tell: the columns of their indices (n_draws, k) with their noise (k,), and the motion so far."""

    seen: np.ndarray
    noise: np.ndarray
    motion: xr.DataArray


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
    """Choose the runs of an identified ship that would tell most of what she does in other manoeuvres.

    Parameters
    ----------
    ship : Ship
        From :func:`pymc_ship.identify_ship`, :func:`pymc_ship.load_ship` or :meth:`pymc_ship.Ship.from_posterior`. A
        ship without laws of its errors has those that are typical of other ships.
    candidates : mapping of str to Manoeuvre or sequence of Manoeuvre, optional
        Of kinds that have indices.
    n : int, optional
        Runs to choose, one after the other; a candidate can be chosen again.
    interest : sequence of Manoeuvre, optional
        Manoeuvres to forecast well, in calm water: overshoot angles, advance, transfer and tactical diameter.
    sea_room : float, optional
        Longest distance that there is [m]. A candidate needs the longest one between two points of its track, that
        of 95 % of the draws.
    wind : (speed, direction), optional
        Of the runs to come, as in :func:`pymc_ship.simulate`: its direction counts from the course of the approach.
        Term sets that know no wind are left out.
    draws : int, optional
        Draws that are sailed, in all, and one of each term set at least; one that leaves the model's range reaches no
        index.
    progress : callable, optional
        Called with a short text before each manoeuvre.

    Returns
    -------
    Dataset, dims (step, candidate, stage, target)
        ``width_ratio`` (step, candidate): how many times as wide as now the intervals of the targets would be,
        geometric mean; NaN of a run without sea room. ``sea_room`` (candidate) [m]. ``chosen`` (step). ``half_width``
        (stage, target) of intervals of 95 %, now and after each chosen run, in the ``units`` of the target.

    Raises
    ------
    SimulationError
        Without a candidate that has indices and sea room, or a target that nine tenths of the draws reach; for counts
        below one.
    SimulationError
        Without a candidate that has indices and sea room, or a target that nine tenths of the draws reach; for counts
        below one. For a wind that no term set of the ship knows.

    Examples
    --------
    Two 10/10 zigzags say little of a hard turn:

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
    ship, labelled = as_ship(ship), labelled_trials(candidates)
    sailable = [isinstance(one, Manoeuvre) and bool(one.traits.indices) for one in (*labelled.values(), *interest)]
    if n < 1 or draws < 2 or not labelled or not interest or not all(sailable):
        raise SimulationError(
            "The next run is chosen from one manoeuvre or more that have indices, for others that have some, with one "
            f"step and two draws or more; found {list(labelled)}, {[one.label for one in interest]}, {n} and {draws}; "
            "correct them."
        )
    models = thinned_draws(suitable_models(ship.models, wind=wind), draws)
    sailed: dict[tuple[Manoeuvre, bool], _Run] = {}

    def run_of(manoeuvre: Manoeuvre, *, windy: bool) -> _Run:
        if (manoeuvre, windy) not in sailed:
            progress(f"sailing the {manoeuvre.label}")
            sailed[manoeuvre, windy] = _sailed(models, manoeuvre, **({"wind": wind} if windy else {}))
        return sailed[manoeuvre, windy]

    targets = [run_of(manoeuvre, windy=False) for manoeuvre in interest]
    offered = {label: run_of(manoeuvre, windy=wind is not None) for label, manoeuvre in labelled.items()}
    return _chosen(_design(ship, models[0][0], targets), offered, n, sea_room)


def _sailed(models: Sequence[tuple[Vessel, np.ndarray]], manoeuvre: Manoeuvre, **around: Any) -> _Run:
    runs = [
        simulate(
            vessel,
            manoeuvre,
            duration=manoeuvre.traits.reach * vessel.particulars.ship_time,
            coefficients=rows,
            **simulation_settings(vessel),
            **around,
        )
        for vessel, rows in models
    ]
    ships = xr.concat(runs, "draw", combine_attrs="override")
    turned, last = ships["psi"].values - ships["psi"].values[:, :1], ships.sizes["time"] - 1
    done = np.zeros(turned.shape, dtype=bool)
    if manoeuvre.traits.circles:
        done = np.abs(turned) >= _ROUNDS
    elif manoeuvre.traits.swings:
        crossed = np.diff(np.sign(turned), axis=1, prepend=0.0) * np.sign(turned) == 2.0
        done = np.cumsum(crossed, axis=1) >= _SWINGS
    end = np.where(done.any(axis=1), done.argmax(axis=1), last)
    return _Run(manoeuvre, ships, end, indices(ships))


def _room(run: _Run) -> float:
    """Largest distance between two points of the track [m], that of :data:`_INSIDE` of the draws."""
    places = np.round(np.linspace(0.0, 1.0, _POINTS) * run.end[:, None]).astype(int)
    track = np.take_along_axis(run.ships["x"].values + 1j * run.ships["y"].values, places, axis=1)
    widest = np.abs(track[:, :, None] - track[:, None, :]).max(axis=(1, 2))
    return float(np.nanquantile(widest, _INSIDE))


@dataclass(frozen=True, eq=False)
class _Design:
    """Targets of an ensemble: each run with the names of those of its indices, and the indices (n_draws, n_targets).

    ``errors`` are the sizes of the model error by kind, ``rows`` the held-out indices, ``central`` is the draw that is
    nearest to the middle of all targets, ``known`` what is known before any run is added.
    """

    vessel: Vessel
    errors: Mapping[str, np.ndarray]
    rows: Sequence[Mapping]
    targets: Sequence[tuple[_Run, list[str]]]
    asked: np.ndarray
    central: int
    known: _Known

    @property
    def labels(self) -> list[str]:
        """Manoeuvre and index of each target, in words."""
        return [f"{run.manoeuvre.label}, {name.replace('_', ' ')}" for run, names in self.targets for name in names]

    @property
    def units(self) -> list[str]:
        """Unit of each target."""
        return [run.manoeuvre.traits.indices[name].units for run, names in self.targets for name in names]

    def _error(self, run: _Run, names: Sequence[str], motion: xr.DataArray) -> np.ndarray:
        """Standard deviations of the error of each index, (n_names, SIZES), of a model fitted to this motion."""
        if not names:
            return np.empty((0, SIZES))
        middle = run.indices[list(names)].median("draw", keep_attrs=True).expand_dims(draw=SIZES)
        beyond = float(np.nanmax(extrapolation(self.vessel, self._sailed(run), motion)["distance"]))
        quantile = (np.arange(SIZES) + 0.5) / SIZES
        sizes = error_sizes(middle, self.errors, self.vessel, beyond=beyond, quantile=quantile)
        return np.array([sizes[name] for name in names])

    def _sailed(self, run: _Run) -> xr.Dataset:
        """Motion of the central ship until the run ends."""
        return run.ships.isel(draw=self.central, time=slice(None, int(run.end[self.central]) + 1))

    def _measured(self, run: _Run) -> list[str]:
        """Indices that a run tells: those whose error is known."""
        table, known = run.manoeuvre.traits.indices, {*self.errors, *(("diameter",) if "rate" in self.errors else ())}
        return run.reached([name for name, index in table.items() if index.quantity in known - {"roll"}])

    def after(self, known: _Known, run: _Run) -> _Known:
        """What is known once a run was sailed, too."""
        names, ship = self._measured(run), self._sailed(run)
        prime, _, _ = prime_record(self.vessel, {name: ship[name].values for name in (*STATE[:5], "delta")})
        rows = xr.DataArray(np.column_stack([prime[symbol] for symbol in SYMBOLS]), dims=("row", "symbol"))
        rows = rows.assign_coords(symbol=list(SYMBOLS)).dropna("row")
        readings = readings_noise(run.indices[names], self.rows, self.vessel)
        errors = zip(names, self._error(run, names, known.motion), strict=True)
        noise = [equivalent_sd(np.hypot(sd, readings[name])) for name, sd in errors]
        seen = np.concatenate([known.seen, run.columns(names)], axis=1)
        return _Known(seen, np.append(known.noise, noise), xr.concat([known.motion, rows], "row"))

    def half_widths(self, known: _Known) -> np.ndarray:
        """Half widths of the intervals of the targets, (n_targets,)."""
        error = np.concatenate([self._error(run, names, known.motion) for run, names in self.targets])
        lower, upper = np.nanquantile(self.asked, [0.5 - 0.5 * _INSIDE, 0.5 + 0.5 * _INSIDE], axis=0)
        variance = (0.5 * (upper - lower) / _QUANTILE) ** 2 * remaining_variance(self.asked, known.seen, known.noise)
        sd = np.sqrt(variance[:, None] + error**2)
        return np.maximum(_QUANTILE * np.array([equivalent_sd(row) for row in sd]), _TINY)


def _design(ship: Ship, vessel: Vessel, sailed: Sequence[_Run]) -> _Design:
    """The targets of an ensemble; SimulationError where too few draws reach any."""
    targets = []
    for run in sailed:
        table = run.manoeuvre.traits.indices
        names = run.reached([name for name, index in table.items() if index.scored and index.quantity in _ASKED])
        targets += [(run, names)] if names else []
    if not targets:
        raise SimulationError(
            "What is to be known are indices that nine tenths of the draws reach, found none of "
            f"{[run.manoeuvre.label for run in sailed]}; give other manoeuvres, or identify her from more runs."
        )
    asked = np.concatenate([run.columns(names) for run, names in targets], axis=1)
    sd = np.nanstd(asked, axis=0)
    away = (asked - np.nanmedian(asked, axis=0)) / np.where(sd > 0.0, sd, 1.0)
    return _Design(
        vessel=vessel,
        errors=_laws(ship),
        rows=list(index_rows(ship.held_out_indices)),
        targets=targets,
        asked=asked,
        central=int(np.argmin(np.sum(np.nan_to_num(away, nan=_FAR) ** 2, axis=1))),
        known=_Known(np.empty((len(asked), 0)), np.empty(0), _motion(ship)),
    )


def _laws(ship: Ship) -> dict[str, np.ndarray]:
    """Laws of the errors of a ship; those typical of other ships where the ship has none."""
    if ship.index_error is None:
        return model_error(()) | steady_error(motion_error((), ship.vessel))
    return ship.index_error | steady_error(ship.motion_error)


def _motion(ship: Ship) -> xr.DataArray:
    """Prime motion of the runs of a ship.

    Raises
    ------
    SimulationError
        Where it is unknown: how far a run leaves it cannot be said.
    """
    if ship.motion is None:
        raise SimulationError(
            "A design needs the motion of the runs so far, found a ship without it; give that of identify_ship, or of "
            "a posterior whose constant_data has `motion`."
        )
    return ship.motion.drop_vars("row", errors="ignore")


def remaining_variance(asked: np.ndarray, seen: np.ndarray, noise: np.ndarray) -> np.ndarray:
    """Share of the variance of some columns of an ensemble that is left when others were measured.

    That of the linear Bayes estimate among the draws that reach all columns, corrected for the directions in which any
    ensemble is explained by chance: as many as the measurements determine, trace(S (S + N)^-1) with S the covariance of
    the columns that are seen and N that of their noise. Columns are clipped to the central :data:`_INSIDE` of their
    draws, as a few that run away would make all others depend on theirs.

    Parameters
    ----------
    asked : ndarray, shape (n_draws, m)
    seen : ndarray, shape (n_draws, k)
    noise : ndarray, shape (k,)
        Standard deviation of the measurement of each column.

    Returns
    -------
    ndarray, shape (m,)
        From 0 to 1; 1 where too few draws reach all columns.
    """
    whole = np.isfinite(asked).all(axis=1) & np.isfinite(seen).all(axis=1)
    count = int(whole.sum())
    if not seen.shape[1] or count < 3:
        return np.ones(asked.shape[1])
    tail = 0.5 - 0.5 * _INSIDE
    both = [np.clip(values[whole], *np.quantile(values[whole], [tail, 1.0 - tail], axis=0)) for values in (asked, seen)]
    a, s = (values - values.mean(axis=0) for values in both)
    unit = np.sqrt(np.mean(s**2, axis=0) + noise**2)
    unit[unit == 0.0] = 1.0
    own, across = s.T @ s / np.outer(unit, unit) / count, s.T @ a / unit[:, None] / count
    inverse = np.linalg.pinv(own + np.diag((noise / unit) ** 2), hermitian=True)
    determined, variance = float(np.trace(own @ inverse)), np.mean(a**2, axis=0)
    if determined >= count - 2:
        return np.ones(asked.shape[1])
    explained = np.sum(across * (inverse @ across), axis=0) / np.where(variance > 0.0, variance, 1.0)
    chance = (count - 1) / (count - 1 - determined)
    return np.clip((1.0 - explained) * chance, 0.0, 1.0)


def _chosen(design: _Design, offered: Mapping[str, _Run], n: int, sea_room: float) -> xr.Dataset:
    """Choose run after run by the intervals that it leaves."""
    room = {label: _room(run) for label, run in offered.items()}
    fitting = {label: run for label, run in offered.items() if room[label] <= sea_room}
    if not fitting:
        least = min(room, key=lambda label: room[label])
        raise SimulationError(
            f"No candidate has enough sea room in {sea_room:g} m: the {least} takes {room[least]:.0f} m; give more "
            "room or shorter runs."
        )
    known, chosen, widths, ratios = design.known, [], [design.half_widths(design.known)], []
    for _ in range(n):
        ahead = {label: design.after(known, run) for label, run in fitting.items()}
        found = {label: design.half_widths(one) for label, one in ahead.items()}
        ratio = {label: float(np.exp(np.mean(np.log(width / widths[0])))) for label, width in found.items()}
        chosen.append(min(ratio.items(), key=lambda pair: pair[1])[0])
        known = ahead[chosen[-1]]
        widths.append(found[chosen[-1]])
        ratios.append([ratio.get(label, np.nan) for label in offered])
    return xr.Dataset(
        {
            "width_ratio": (("step", "candidate"), ratios),
            "sea_room": ("candidate", list(room.values()), {"units": "m"}),
            "chosen": ("step", chosen),
            "half_width": (("stage", "target"), np.array(widths)),
            "units": ("target", design.units),
        },
        {
            "step": 1 + np.arange(n),
            "candidate": list(offered),
            "stage": np.arange(n + 1),
            "target": design.labels,
        },
        {"vessel": design.vessel.name},
    )


def labelled_trials(manoeuvres: Mapping[str, Manoeuvre] | Sequence[Manoeuvre]) -> dict[str, Manoeuvre]:
    """Manoeuvres by label.

    A manoeuvre without a label is named by kind, angles and speed, and by a number where a name repeats.
    """
    if isinstance(manoeuvres, Mapping):
        return dict(manoeuvres)
    labelled: dict[str, Manoeuvre] = {}
    for one in manoeuvres:
        label = one.label + (f" from {one.approach_speed:g} m/s" if one.approach_speed else "")
        same = sum(name.split(" #")[0] == label for name in labelled)
        labelled[f"{label} #{same + 1}" if same else label] = one
    return labelled
