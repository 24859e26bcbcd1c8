"""One ship of a population: drawn, sailed, identified from its trials, and its forecasts beside its own motion.

What is kept of a forecast is its error over what such an error is measured in, and where the truth lies among the draws
(the probability integral transform, Gneiting et al. 2007, doi:10.1111/j.1467-9868.2007.00587.x): from these every
coverage, width and score of the page follows.
"""

from __future__ import annotations

import math
import warnings
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from time import process_time

import numpy as np
import xarray as xr

from pymc_ship.experiments.task import stopwatch
from pymc_ship.machine.errors import FitError, StudyError
from pymc_ship.machine.seeds import generator
from pymc_ship.machine.threads import one_thread
from pymc_ship.machine.workers import MACHINE, error_text
from pymc_ship.physics.manoeuvre.indices import indices
from pymc_ship.physics.manoeuvre.standard import Manoeuvre
from pymc_ship.physics.vessel.reading import VesselLike, as_vessel
from pymc_ship.physics.vessel.term_sets import ANY_SPEED_SET, supports_part_sets, with_terms
from pymc_ship.physics.vessel.vessel import Vessel
from pymc_ship.records.checks.trial_checks import validated_trial
from pymc_ship.records.steering.stopping_tests import INDICES
from pymc_ship.ships.ensemble.draws import robust_sd
from pymc_ship.ships.ensemble.index_error import index_scale, scaled_error
from pymc_ship.ships.ensemble.index_table import index_rows as table_rows
from pymc_ship.ships.ensemble.motion_error import ERROR_STATES, prime_units, time_beyond
from pymc_ship.ships.ensemble.scores import crps
from pymc_ship.ships.ensemble.ship import Ship
from pymc_ship.ships.forecasting.forecast import forecast
from pymc_ship.ships.forecasting.stopping import LONGEST, StoppingTest, stopping, stopping_indices
from pymc_ship.ships.identification.model import ShipIdentification, identify_ship
from pymc_ship.ships.identification.replay import extrapolation_distance, replay

STAGES = ("draw", "identify", "forecast", "replay", "stop")
"""Stages of a task, which are timed [s]; the motion that is forecast is sailed in ``forecast`` and in ``stop``."""

STATUSES = ("ok", "refused", "failed")
"""How a task ends. `ok`: identified and judged. `refused`: the package says in a sentence why it does not identify the
ship. `failed`: any other error."""

_TOLD = dict.fromkeys(("error", "half_width", "sd", "pit", "crps"), "float")

INDEX = {"manoeuvre": "str", "index": "str"} | _TOLD | dict.fromkeys(("draws_sd", "beyond"), "float")
"""Columns of a forecast index. Errors of the median, half widths of 95 %, sd (half the width of the central 68 %) and
CRPS are in swings of the heading, L/U, L, U/L, U, rad of drift or the angle of roll; ``pit`` is the share of the draws
below the truth; ``draws_sd`` is the sd without the model error; ``beyond`` is how far the median ship leaves the motion
of its runs [ranges]."""

INSTANT = {"state": "str"} | dict.fromkeys(("lead", "error", "sd", "pit", "draws_sd", "beyond", "far"), "float")
"""Columns of a state some time (``lead`` [L/U]) after a restart in a run that it was not given: prime error of the
median, prime sd (half the width of the central 68 %), share of the draws below the truth, sd without the model error,
distance from the motion of the runs at that instant, and, of heading and track, its sum over time (``far``
[ranges L/U])."""

HELD_INDEX = {"kind": "str", "error": "float", "known": "float"}
"""Columns of an index of a run that was held out in the identification: kind, error of the forecast and variance that
draws, term sets and the noise of readings explain of it, in the units of :data:`INDEX`."""

STOP = {"index": "str"} | _TOLD
"""Columns of an index of a stopping test, as those of :data:`INDEX`; changes of heading are in rad."""

LEADS = (1.0, 3.0, 5.0, 10.0, 15.0)
"""Times from a restart at which the motion is judged [L/U]."""

_RESTARTS = (0.0, 5.0, 10.0)  # L/U from the approach
_DRAWS, _REPLAYED = 500, 100  # of a forecast and of a replay


@dataclass(frozen=True)
class DrawnShip:
    """A ship of a population: what is known of it, and how it sails.

    Attributes
    ----------
    hull : str
        Kind of ship, by which the page tells them apart.
    vessel : Vessel, str or Path
        Papers of the ship, without coefficients.
    sail : callable
        Takes a Manoeuvre and a duration [s] and returns its exact motion in calm water from the straight course, a
        Dataset with dims (time,): u, v, r, psi, x, y, delta, n, and p and phi of a ship that rolls; the attr
        ``rudder_delay`` [s] is the time from an order to the movement of the rudder, from which indices count.
    record : callable
        Takes a Manoeuvre and the number of the run, from 0, and returns a record of it as its sensors read it in the
        weather of its trials.
    stop : callable, optional
        Takes a StoppingTest with all its numbers and a duration [s] and returns its exact motion until it makes no way
        ahead, as ``sail`` does; None for a ship whose forces mean nothing there.
    """

    hull: str
    vessel: VesselLike
    sail: Callable[[Manoeuvre, float], xr.Dataset]
    record: Callable[[Manoeuvre, int], xr.Dataset]
    stop: Callable[[StoppingTest, float], xr.Dataset] | None = None


Draw = Callable[[np.random.Generator], DrawnShip]
"""What draws a ship of a population."""


@dataclass(frozen=True)
class ShipTask:
    """What one task judges: a ship that ``draw`` draws, its trials (all, or up to ``most`` by chance) and forecasts.

    ``astern`` is the share of the nominal revolutions that stop the ship, 0 for no stopping test. ``trials``,
    ``seed`` and ``root`` name the ship's random numbers, ``block`` says where the result belongs.
    """

    draw: Draw
    manoeuvres: tuple[Manoeuvre, ...]
    most: int
    forecasts: tuple[Manoeuvre, ...]
    astern: float
    trials: str
    seed: int
    root: int
    block: str = ""

    def rng(self, purpose: str) -> np.random.Generator:
        """Generator of one purpose of this ship."""
        return generator(self.root, purpose, self.trials, self.seed)

    def sailed(self) -> list[Manoeuvre]:
        """Trials of this ship."""
        if not self.most:
            return list(self.manoeuvres)
        rng = self.rng("trials of a ship of a population")
        chosen = rng.permutation(len(self.manoeuvres))[: rng.integers(1, self.most + 1)]
        return [self.manoeuvres[k] for k in chosen]


def judge(task: ShipTask) -> dict:
    """Draw, identify and judge a ship; a ship that is refused is a result like any other.

    Parameters
    ----------
    task : ShipTask

    Returns
    -------
    dict
        ``block``, ``seed``, ``status`` (of :data:`STATUSES`), ``sentence`` (why it is not ok), ``hull``, ``runs``,
        rows of :data:`INDEX`, :data:`INSTANT`, :data:`HELD_INDEX` (``held``) and :data:`STOP` (``stops``), those of
        :data:`STAGES` [s] and ``cpu`` [s].

    Raises
    ------
    StudyError
        Where the function that draws ships fails.
    """
    began, parts, found = process_time(), dict.fromkeys(STAGES, 0.0), _nothing()
    with one_thread(), warnings.catch_warnings():
        warnings.simplefilter("ignore")
        with stopwatch(parts, "draw"):
            drawn, records = _drawn(task)
        found |= {"hull": drawn.hull, "runs": float(len(records))}
        try:
            found |= _judged(task, drawn, records, parts)
            status, sentence = "ok", ""
        except (*MACHINE, StudyError):  # says nothing of the ship
            raise
        except ValueError as error:
            status, sentence = "refused", str(error)
        except Exception as error:  # whatever goes wrong is what the study is to find out
            status, sentence = "failed", error_text(error)
    identity = {"block": task.block, "seed": task.seed, "status": status, "sentence": sentence}
    return identity | found | parts | {"cpu": process_time() - began}


def unjudged(task: ShipTask) -> dict:
    """A result as :func:`judge` returns it, made without any work; it shows what the keeping of results costs."""
    identity = {"block": task.block, "seed": task.seed, "status": "ok", "sentence": ""}
    return identity | _nothing() | dict.fromkeys((*STAGES, "cpu"), 0.0)


def _nothing() -> dict:
    return {"hull": "", "runs": 0.0, "indices": [], "instants": [], "held": [], "stops": []}


def _drawn(task: ShipTask) -> tuple[DrawnShip, list[xr.Dataset]]:
    """Ship and records of its trials."""
    with _of_the_user(task):
        ship = task.draw(task.rng("ship of a population"))
        return ship, [ship.record(manoeuvre, k) for k, manoeuvre in enumerate(task.sailed())]


@contextmanager
def _of_the_user(task: ShipTask) -> Iterator[None]:
    """Raise a StudyError in place of any error of the function that draws a ship, or of the ship it returns."""
    try:
        yield
    except MACHINE:
        raise
    except Exception as error:  # whatever the user's function does
        raise StudyError(
            f"Ship {task.seed} of the trials {task.trials!r} cannot be drawn or sailed: {error_text(error)}; what was "
            "judged is kept: mend the function that draws ships."
        ) from error


def _judged(task: ShipTask, drawn: DrawnShip, records: list[xr.Dataset], parts: dict[str, float]) -> dict:
    """Rows of indices and instants; the seconds are filled in."""
    with stopwatch(parts, "identify"):
        vessel = as_vessel(drawn.vessel)
        trials = [validated_trial(record, vessel) for record in records]
        identified = identify_ship(trials, vessel, rng=task.rng("identification"))
    ship = identified.ship
    found: dict[str, list] = {"indices": [], "instants": [], "held": held_rows(identified)}
    for manoeuvre in task.forecasts:
        with stopwatch(parts, "forecast"):
            tree = forecast(ship, manoeuvre, rng=task.rng(f"forecast of a {manoeuvre.label}"), draws=_DRAWS)
            with _of_the_user(task):
                run = drawn.sail(manoeuvre, float(tree["trajectories"]["time"][-1]))
            found["indices"] += index_rows(tree, run, manoeuvre, ship.vessel)
        with stopwatch(parts, "replay"):
            found["instants"] += [row for start in _RESTARTS for row in instant_rows(ship, run, start)]
    with stopwatch(parts, "stop"):
        found["stops"] = stop_rows(task, drawn, trials, vessel)
    return found


def stop_rows(task: ShipTask, drawn: DrawnShip, trials: list[xr.Dataset], vessel: Vessel) -> list[dict]:
    """Stopping test of a ship beside the forecast by the parts that hold at any speed, rows of :data:`STOP`.

    There is none where the study asks for no test, the ship cannot be stopped or its papers state no draught or no
    propeller. Numbers are NaN where these parts are not identified.
    """
    if not task.astern or drawn.stop is None or vessel.propeller is None or not supports_part_sets(vessel):
        return []
    full = StoppingTest(task.astern * vessel.propeller.n).on(with_terms(vessel, ANY_SPEED_SET))
    with _of_the_user(task):
        run = drawn.stop(full, LONGEST * vessel.particulars.ship_time)
        motion = {name: run[name].values[None] for name in ("u", "psi", "x", "y")}
        truth = stopping_indices(motion, run["time"].values).isel(draw=0)
    try:
        rng = task.rng("identification of a ship that is stopped")
        stopped_ship = identify_ship(trials, vessel, terms=[ANY_SPEED_SET], draws=_DRAWS, rng=rng).ship
        forecasts = stopping(stopped_ship, astern=full.astern)
    except FitError:
        forecasts = truth.expand_dims("draw").isel(draw=[])
    scale = {"m": vessel.particulars.L, "s": vessel.particulars.ship_time, "deg": math.degrees(1.0)}
    return [
        {"index": name} | _told(_errors(forecasts[name], float(truth[name]), scale[units]))
        for name, units in INDICES.items()
        if math.isfinite(truth[name])
    ]


def held_rows(identified: ShipIdentification) -> list[dict]:
    """Indices of its held-out runs, rows of :data:`HELD_INDEX`."""
    rows = []
    for row in table_rows(identified.held_out_indices):
        error, known = scaled_error(row)
        rows.append({"kind": row["kind"], "error": error, "known": known})
    return rows


def index_rows(tree: xr.DataTree, run: xr.Dataset, manoeuvre: Manoeuvre, vessel: Vessel) -> list[dict]:
    """Indices of a forecast beside those of the exact motion, rows of :data:`INDEX`; those it does not reach are out.

    A forecast none of whose draws reaches an index that the ship has holds nothing: its numbers are NaN.
    """
    rolls = "phi" in run
    run = run if rolls else run.assign({name: xr.zeros_like(run["u"]) for name in ("p", "phi")})
    truth = indices(run.assign_attrs(manoeuvre.attrs | {"dofs": "surge sway yaw" + " roll" * rolls}))
    ships = tree["trajectories"].to_dataset()
    bare = indices(ships.fillna(dict.fromkeys(("p", "phi"), 0.0)))  # of sets without roll, which have none
    bare = bare.where(np.isfinite(tree["indices"].to_dataset()))
    beyond = float(np.nanmax(tree["extrapolation"]["distance"]))
    rows = []
    for name in truth.data_vars:
        value = float(truth[name])
        if not math.isfinite(value) or name not in tree["indices"]:
            continue
        quantity = manoeuvre.traits.indices[str(name)].quantity
        scale = float(index_scale(quantity, value, manoeuvre.heading_deg, vessel))
        drawn, alone = (_errors(indexed[name], value, scale) for indexed in (tree["indices"], bare))
        row = {"manoeuvre": manoeuvre.traits.words, "index": str(name), "beyond": beyond} | _told(drawn)
        rows.append(row | {"draws_sd": robust_sd(alone) if drawn.size else math.nan})
    return rows


def _told(drawn: np.ndarray) -> dict[str, float]:
    """What the scaled errors of the draws tell of a forecast; NaN of none."""
    if not drawn.size:
        return dict.fromkeys(_TOLD, math.nan)
    row = {"error": float(np.median(drawn)), "pit": float(np.mean(drawn < 0.0))}
    row["half_width"] = 0.5 * float(np.diff(np.quantile(drawn, [0.025, 0.975]))[0])
    return row | {"sd": robust_sd(drawn), "crps": crps(drawn[:, None], np.zeros(1))}


def _errors(drawn: xr.DataArray, truth: float, scale: float) -> np.ndarray:
    """Scaled errors of the draws that reach an index."""
    values = drawn.values
    return (values[np.isfinite(values)] - truth) / scale


def instant_rows(ship: Ship, run: xr.Dataset, start: float) -> Iterator[dict]:
    """Motion of a ship restarted in an exact run ``start`` L/U from its begin, rows of :data:`INSTANT`."""
    unit, units = ship.vessel.particulars.ship_time, prime_units(ship.vessel)
    begin = start * unit
    if run["time"].values[-1] < begin + LEADS[-1] * unit:
        return
    tree = replay(ship, run, start=begin, duration=LEADS[-1] * unit, draws=_REPLAYED)
    measured, time = tree["measured"], tree["measured"]["time"].values
    beyond = np.nan_to_num(
        extrapolation_distance(ship, tree["trajectories"].dataset.median("draw"), run.sel(time=time))
    )
    since = (time - time[0]) / unit
    far = time_beyond(beyond, since)
    for lead in LEADS:
        k = min(int(np.searchsorted(since, lead - 1e-9)), since.size - 1)
        for name in ERROR_STATES:
            seen, alone = (
                (tree[group][name].values[:, k] - measured[name].values[k]) / units[name]
                for group in ("predictive", "trajectories")
            )
            drawn = seen[np.isfinite(seen)]
            told_by = (np.median(drawn), robust_sd(drawn), np.mean(drawn < 0.0)) if drawn.size else 3 * (math.nan,)
            numbers = map(float, (lead, *told_by, robust_sd(alone), beyond[k], far[name][k]))
            yield dict(zip(INSTANT, (name, *numbers), strict=True))
