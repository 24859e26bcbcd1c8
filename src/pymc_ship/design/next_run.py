"""Which run to sail next of an identified ship: what its indices would tell of the manoeuvres that are to be known.

An identified ship is an ensemble, draws of several models. Every draw is sailed through the candidates and through the
manoeuvres that are to be known. What the indices of a candidate would tell of the others is the linear Bayes estimate
over the ensemble (Goldstein & Wooff 2007, doi:10.1002/9780470065662, section 3.1). Its noise is the error of an index
that held-out runs and other ships show: waves, gusts, sensors, and forces that no model of the ensemble has. A run also
moves the edge of the motion that is known, beyond which these errors grow.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple, Protocol

import numpy as np
import xarray as xr
from scipy.special import ndtri

from pymc_ship.design.candidates import labelled_trials
from pymc_ship.design.trial_design import TrialDesignError
from pymc_ship.forces.terms import SYMBOLS
from pymc_ship.forecasting.draws import knowing_models, thinned_draws
from pymc_ship.forecasting.extrapolation import extrapolation
from pymc_ship.forecasting.forecast import pooled_forecast
from pymc_ship.forecasting.index_error import error_sizes, steady_error
from pymc_ship.manoeuvre.indices import indices
from pymc_ship.manoeuvre.standard import STANDARD, Manoeuvre, pull_out, turning_circle, zigzag
from pymc_ship.motion.equations import STATE
from pymc_ship.motion.prime_record import prime_record
from pymc_ship.motion.simulation import simulate
from pymc_ship.motion.stepping import simulation_settings
from pymc_ship.vessel.vessel import Vessel

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
_DRAWS = 200  # of an outlook, at most


class Ensemble(Protocol):
    """What is needed of an identified ship, see :class:`pymc_ship.IdentifiedShip`."""

    models: list[tuple[Vessel, np.ndarray]]
    motion: xr.DataArray
    model_error: dict[str, np.ndarray]
    motion_error: xr.Dataset


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
        """Indices of the draws (n_draws, n_names), those beyond the central :data:`_INSIDE` moved to its ends."""
        values = np.reshape([self.indices[name].values for name in names], (len(names), -1)).T
        tail = 0.5 * (1.0 - _INSIDE)
        return np.clip(values, *np.nanquantile(values, [tail, 1.0 - tail], axis=0)) if names else values


class _Known(NamedTuple):
    """What some runs tell: the columns of their indices (n_draws, k) with their noise (k,), and the motion so far."""

    seen: np.ndarray
    noise: np.ndarray
    motion: xr.DataArray


def next_runs(
    ship: Ensemble,
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
    ship : IdentifiedShip or ShipModel
        From :func:`pymc_ship.identify_ship` or :func:`pymc_ship.load_ship`.
    candidates : mapping of str to Manoeuvre or sequence of Manoeuvre, optional
        Of kinds that have indices.
    n : int, optional
        Runs to choose, one after the other; a candidate can be chosen again.
    interest : sequence of Manoeuvre, optional
        Manoeuvres to forecast well, in calm water: overshoot angles, advance, transfer and tactical diameter.
    sea_room : float, optional
        [m]; a candidate takes the largest distance between two points of its track, that of 95 % of the draws.
    wind : (speed, direction), optional
        Of the runs to come, as in :func:`pymc_ship.simulate`; leaves the term sets out that know no wind.
    draws : int, optional
        At most.
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
    TrialDesignError
        Without a candidate that has indices and sea room, or a target that nine tenths of the draws reach; for counts
        below one.
    SimulationError
        For a wind that no term set of the ship knows.

    Examples
    --------
    Two 10/10 zigzags say little of a hard turn:

    >>> import numpy as np
    >>> import pymc_ship as ps
    >>> vessel, rng = ps.load_vessel("kvlcc2"), np.random.default_rng(1)
    >>> sides = ("port", "starboard")
    >>> runs = [ps.simulate(vessel, ps.zigzag(10, 10, side=side), duration=600, step=0.5) for side in sides]
    >>> runs = [ps.pollute(run, level=0.01, rng=rng) for run in runs]
    >>> ship = ps.identify_ship(runs, vessel, terms=["modular"], draws=100, rng=rng)
    >>> plan = ps.next_runs(ship, [ps.zigzag(10, 10), ps.turning_circle(35)])
    >>> plan["chosen"].item()
    'turning circle 35 port'
    """
    labelled = labelled_trials(candidates)
    if n < 1 or draws < 2 or not labelled or not all(one.traits.indices for one in labelled.values()):
        raise TrialDesignError(
            "The next run is chosen from one candidate or more that have indices, with one step and two draws or more, "
            f"found {list(labelled)}, {n} and {draws}; correct them."
        )
    models = thinned_draws(knowing_models(ship.models, wind=wind), draws)
    sailed: dict[tuple[Manoeuvre, bool], _Run] = {}

    def run_of(manoeuvre: Manoeuvre, *, windy: bool) -> _Run:
        if (manoeuvre, windy) not in sailed:
            progress(f"sailing the {manoeuvre.label}")
            sailed[manoeuvre, windy] = _sailed(models, manoeuvre, **({"wind": wind} if windy else {}))
        return sailed[manoeuvre, windy]

    targets = [run_of(manoeuvre, windy=False) for manoeuvre in interest]
    offered = {label: run_of(manoeuvre, windy=wind is not None) for label, manoeuvre in labelled.items()}
    return _chosen(_design(ship, models[0][0], targets), offered, n, sea_room)


def _sailed(models: Sequence[tuple[Vessel, np.ndarray]], manoeuvre: Manoeuvre, **around: object) -> _Run:
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

    ``errors`` are the sizes of the model error by kind, ``central`` is the draw nearest to the middle of all targets,
    ``known`` what is known before any run is added.
    """

    vessel: Vessel
    errors: Mapping[str, np.ndarray]
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
        """Standard deviation of the error of each index, (n_names,), of a model fitted to this motion."""
        middle = run.indices[list(names)].median("draw", keep_attrs=True).expand_dims("draw")
        ship = run.ships.isel(draw=self.central)
        beyond = float(np.nanmax(extrapolation(self.vessel, ship, motion)["distance"]))
        sizes = error_sizes(middle, self.errors, self.vessel, beyond=beyond, place=np.full(1, 0.5))
        return np.array([sizes[name][0] for name in names])

    def after(self, known: _Known, run: _Run) -> _Known:
        """What is known once a run was sailed, too."""
        names = run.reached([name for name, index in run.manoeuvre.traits.indices.items() if index.quantity != "roll"])
        ship = run.ships.isel(draw=self.central, time=slice(None, int(run.end[self.central]) + 1))
        prime, _, _ = prime_record(self.vessel, {name: ship[name].values for name in (*STATE[:5], "delta")})
        rows = xr.DataArray(np.column_stack([prime[symbol] for symbol in SYMBOLS]), dims=("row", "symbol"))
        rows = rows.assign_coords(symbol=list(SYMBOLS)).dropna("row")
        seen = np.concatenate([known.seen, run.columns(names)], axis=1)
        noise = np.append(known.noise, self._error(run, names, known.motion))
        return _Known(seen, noise, xr.concat([known.motion, rows], "row"))

    def half_widths(self, known: _Known) -> np.ndarray:
        """Half widths of the intervals of the targets, (n_targets,)."""
        error = np.concatenate([self._error(run, names, known.motion) for run, names in self.targets])
        variance = left_after(self.asked, known.seen, known.noise)
        return ndtri(0.5 + 0.5 * _INSIDE) * np.sqrt(variance + error**2)


def _design(ship: Ensemble, vessel: Vessel, sailed: Sequence[_Run]) -> _Design:
    """The targets of an ensemble; TrialDesignError where too few draws reach any."""
    targets = []
    for run in sailed:
        table = run.manoeuvre.traits.indices
        names = run.reached([name for name, index in table.items() if index.scored and index.quantity in _ASKED])
        targets += [(run, names)] if names else []
    if not targets:
        raise TrialDesignError(
            "Nine tenths of the draws reach no index of a manoeuvre of interest; give others, or identify her from "
            "more runs."
        )
    asked = np.concatenate([run.columns(names) for run, names in targets], axis=1)
    sd = np.nanstd(asked, axis=0)
    away = (asked - np.nanmedian(asked, axis=0)) / np.where(sd > 0.0, sd, 1.0)
    return _Design(
        vessel=vessel,
        errors=ship.model_error | steady_error(ship.motion_error),
        targets=targets,
        asked=asked,
        central=int(np.argmin(np.sum(np.nan_to_num(away, nan=np.inf) ** 2, axis=1))),
        known=_Known(np.empty((len(asked), 0)), np.empty(0), ship.motion),
    )


def left_after(asked: np.ndarray, seen: np.ndarray, noise: np.ndarray) -> np.ndarray:
    """Variance that the linear Bayes estimate leaves of some columns of an ensemble when others were measured.

    Parameters
    ----------
    asked : ndarray, shape (n_draws, m)
    seen : ndarray, shape (n_draws, k)
    noise : ndarray, shape (k,)
        Standard deviation of the measurement of each column; the draws that reach all columns count.

    Returns
    -------
    ndarray, shape (m,)
        Corrected for the k directions in which any ensemble is explained by chance.
    """
    whole = np.isfinite(asked).all(axis=1) & np.isfinite(seen).all(axis=1)
    a, s = (values[whole] - values[whole].mean(axis=0) for values in (asked, seen))
    count = len(a)
    prior = np.sum(a**2, axis=0) / (count - 1)
    unit = np.sqrt(np.sum(s**2, axis=0) / (count - 1) + noise**2)
    told, s = unit > 0.0, s / np.where(unit > 0.0, unit, 1.0)
    s, noise = s[:, told], (noise / np.where(unit > 0.0, unit, 1.0))[told]
    shared, across = s.T @ s / (count - 1) + np.diag(noise**2), s.T @ a / (count - 1)
    gain = np.linalg.pinv(shared, hermitian=True) @ across
    chance = (count - 1) / max(count - 1 - told.sum(), 1)
    return np.minimum(np.maximum(prior - np.sum(gain * across, axis=0), 0.0) * chance, prior)


def _chosen(design: _Design, offered: Mapping[str, _Run], n: int, sea_room: float) -> xr.Dataset:
    """Choose run after run by the intervals that it leaves."""
    room = {label: _room(run) for label, run in offered.items()}
    fitting = {label: run for label, run in offered.items() if room[label] <= sea_room}
    if not fitting:
        least = min(room, key=room.get)
        raise TrialDesignError(
            f"No candidate has enough sea room in {sea_room:g} m: the {least} takes {room[least]:.0f} m; give more "
            "room or shorter runs."
        )
    known, chosen, widths = design.known, [], [design.half_widths(design.known)]
    ratio = np.full((n, len(offered)), np.nan)
    for step in range(n):
        ahead = {label: design.after(known, run) for label, run in fitting.items()}
        found = {label: design.half_widths(one) for label, one in ahead.items()}
        for label, width in found.items():
            ratio[step, list(offered).index(label)] = np.exp(np.mean(np.log(width / widths[0])))
        chosen.append(min(found, key=lambda label: ratio[step, list(offered).index(label)]))
        known = ahead[chosen[-1]]
        widths.append(found[chosen[-1]])
    return xr.Dataset(
        {
            "width_ratio": (("step", "candidate"), ratio),
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


def outlook(ship: Ensemble, rng: np.random.Generator) -> tuple[str, ...]:
    """Sentences on the turning circle of an identified ship, and on the standard manoeuvre that would tell most next.

    Empty where hardly any draw reaches an index.
    """
    vessel, drawn = ship.models[0][0], thinned_draws(ship.models, _DRAWS)
    settings = simulation_settings(vessel) | {"ci_prob": _INSIDE, "rng": rng, "motion": ship.motion}
    settings["errors"] = ship.model_error | steady_error(ship.motion_error)
    turns = []
    for manoeuvre in (one for one in STANDARD if one.traits.circles):
        duration = manoeuvre.traits.reach * vessel.particulars.ship_time
        bands = pooled_forecast(drawn, manoeuvre, duration=duration, **settings)["index_bands"]["tactical_diameter"]
        lower, median, upper = (bands / vessel.particulars.L).values.tolist()
        turns += [f"{median:.2f} L ({lower:.2f} to {upper:.2f}) to {manoeuvre.side}"] if np.isfinite(median) else []
    said = [f"Tactical diameter of the turning circle of 35 deg: {', '.join(turns)}."] if turns else []
    try:
        plan = next_runs(ship, STANDARD, draws=_DRAWS)
    except TrialDesignError:
        return tuple(said)
    best = plan.sel(candidate=plan["chosen"].item(), step=1)
    now, then = plan["half_width"].values
    most = int(np.argmin(then / now))
    target, unit = (str(plan[name].values[most]) for name in ("target", "units"))
    width = np.array([then[most], now[most]]) / (vessel.particulars.L if unit == "m" else 1.0)
    said.append(
        f"As the next run the {best['candidate'].item()} would tell most: the intervals of the standard manoeuvres "
        f"would be {float(best['width_ratio']):.2f} times as wide, that of the {target} ± {width[0]:.2g} in place of "
        f"± {width[1]:.2g} {unit if unit != 'm' else 'L'}. It takes "
        f"{float(best['sea_room']) / vessel.particulars.L:.1f} L of sea room."
    )
    return tuple(said)
