"""Coverage, width and reliability of the intervals of a population, with standard errors over its ships.

Numbers of one ship err alike, so that a ship counts as one: a standard error is that of the mean over ships. An
interval is equal-tailed; it holds the truth where the share of the draws below the truth says so.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.optimize import minimize, minimize_scalar
from scipy.special import expit, logit
from scipy.stats import norm, t

from pymc_ship.physics.manoeuvre.kinds import SCORED_QUANTITIES
from pymc_ship.physics.manoeuvre.registry import kind_named
from pymc_ship.ships.ensemble import motion_error
from pymc_ship.ships.ensemble.index_error import EXTRAPOLATION_SD, LIKELIHOOD_WEIGHT, TYPICAL
from pymc_ship.ships.ensemble.motion_error import MOTION_EXTRAPOLATION_SD, growth_with_lead_time, size_law

Columns = Mapping[str, np.ndarray]
"""Rows of :data:`studies.population.judged_ship.INDEX` or `INSTANT` of all ships by column, with ``ship``, a number,
``trials``, ``seed``, ``hull`` and ``first``, whether the ship is of the first half of its class of trials."""

STATED = (0.75, 0.9, 0.95, 0.99)
"""Probabilities of statements "at most" and "at least" that are counted."""

DISTANCES = {"within one range of the runs": (0.0, 1.0), "1 to 3 ranges beyond": (1.0, 3.0), "further": (3.0, math.inf)}
"""How far the median ship leaves the motion of its runs [ranges of it]."""

_MOST_GROWTH, _ROUNDING = 0.1, 1e-9
_LOG_TYPICAL = (-12.0, -3.0)
_STRIDE, _CHOSEN_TO = 0.5, 1e-3  # of the law of a model error, in logarithms


def columns_of(ships: Sequence[Mapping], name: str, keys: Iterable[str]) -> dict[str, np.ndarray]:
    """Rows ``name`` of all ships as columns, see :data:`Columns`."""
    rows = [(k, ship, row) for k, ship in enumerate(ships) for row in ship[name]]
    found = {key: np.array([row[key] for _, _, row in rows]) for key in keys}
    found |= {key: np.array([ship[key] for _, ship, _ in rows]) for key in ("trials", "seed", "hull", "first")}
    return found | {"ship": np.array([k for k, _, _ in rows], dtype=int)}


def where(columns: Columns, mask: np.ndarray) -> dict[str, np.ndarray]:
    """Those of the rows."""
    return {name: values[mask] for name, values in columns.items()}


def held(pit: np.ndarray, probability: float) -> np.ndarray:
    """Whether equal-tailed intervals hold the truth; those of no draws hold nothing."""
    tail = 0.5 * (1.0 - probability)
    return (pit >= tail - _ROUNDING) & (pit <= 1.0 - tail + _ROUNDING)


def over_ships(values: np.ndarray, ship: np.ndarray) -> tuple[float, float]:
    """Mean, and its standard error over ships, NaN of a single one; rows of a ship are averaged before."""
    numbers, place = np.unique(ship, return_inverse=True)
    means = np.bincount(place, values.astype(float)) / np.bincount(place)
    error = means.std(ddof=1) / math.sqrt(numbers.size) if numbers.size > 1 else math.nan
    return float(np.mean(values)), float(error)


def coverage_row(columns: Columns) -> dict:
    """Share [%] of indices in intervals of 95 and 50 %, errors, widths, scores, and the mean share of draws below."""
    ship, finite = columns["ship"], np.isfinite(columns["error"])
    row: dict[str, float] = {"ships": np.unique(ship).size, "indices": ship.size}
    for name, probability in (("hold_95", 0.95), ("hold_50", 0.5)):
        row[name], row[f"{name}_se"] = (100.0 * x for x in over_ships(held(columns["pit"], probability), ship))
    row["pit"], row["pit_se"] = over_ships(columns["pit"][finite], ship[finite])
    error, sd = columns["error"][finite], columns["sd"][finite]
    row["z"] = float(np.sqrt(np.mean((error / sd) ** 2)))
    row["median_error"] = float(np.median(np.abs(error)))
    row["half_width"] = float(np.median(columns["half_width"][finite]))
    return row | {"crps": float(np.mean(columns["crps"][finite]))}


def by(columns: Columns, group: np.ndarray) -> list[dict]:
    """Rows of :func:`coverage_row` by group, in the order in which groups appear."""
    return [{"group": str(name)} | coverage_row(where(columns, group == name)) for name in dict.fromkeys(group)]


def ship_rows(columns: Columns) -> list[dict]:
    """Coverage of every ship, that which holds least first, and how far it leaves the motion of its runs at most."""
    rows = []
    for number in np.unique(columns["ship"]):
        mine = where(columns, columns["ship"] == number)
        who = {"trials": str(mine["trials"][0]), "ship": int(mine["seed"][0]), "hull": str(mine["hull"][0])}
        found = coverage_row(mine)
        kept = {name: found[name] for name in ("indices", "hold_95", "hold_50", "z")}
        rows.append(who | kept | {"beyond": float(mine["beyond"].max())})
    return sorted(rows, key=lambda row: row["hold_95"])


def index_names(columns: Columns) -> np.ndarray:
    """Manoeuvre and index in words."""
    pairs = zip(columns["manoeuvre"], columns["index"], strict=True)
    return np.array([f"{manoeuvre}, {index.replace('_', ' ')}" for manoeuvre, index in pairs])


def distance_names(beyond: np.ndarray) -> np.ndarray:
    """Key of :data:`DISTANCES`."""
    names, ends = list(DISTANCES), [low for low, _ in DISTANCES.values()]
    return np.array([names[np.searchsorted(ends, value, "right") - 1] for value in beyond])


def statements(columns: Columns, stated: Sequence[float] = STATED) -> list[dict]:
    """Number and share of the statements "at most" and "at least" that held, by the probability they were made with."""
    pit, ship, rows = columns["pit"], columns["ship"], []
    for probability in stated:
        both = 0.5 * ((pit <= probability + _ROUNDING).astype(float) + (pit >= 1.0 - probability - _ROUNDING))
        share, error = over_ships(both, ship)
        number = {"statements": 2 * pit.size, "held": int(2.0 * both.sum())}
        rows.append({"stated": probability, "share": share, "se": error} | number)
    return rows


def motion_rows(columns: Columns, group: np.ndarray) -> list[dict]:
    """Share [%] of instants of the motion in bands of 90 %, by state and group, with that of the worst ship."""
    rows = []
    for name in dict.fromkeys(columns["state"]):
        for key in dict.fromkeys(group):
            mine = where(columns, (columns["state"] == name) & (group == key))
            inside, ship = held(mine["pit"], 0.9), mine["ship"]
            if ship.size:
                share, error = over_ships(inside, ship)
                worst = min(np.mean(inside[ship == number]) for number in np.unique(ship))
                row = {"state": str(name), "group": key, "ships": np.unique(ship).size, "instants": ship.size}
                rows.append(row | {"hold_90": 100.0 * share, "se": 100.0 * error, "worst": 100.0 * worst})
    return rows


def fitted_growth(columns: Columns, counted: float, far: str = "beyond") -> float:
    """Growth by which the errors are most probable whose sd holds a growth that was ``counted`` already."""
    finite = np.isfinite(columns["error"])
    error, sd, distance = (columns[name][finite] for name in ("error", "sd", far))
    known = np.maximum(sd**2 - (counted * distance) ** 2, 1e-8)

    def surprise(growth: float) -> float:
        variance = known + (growth * distance) ** 2
        return float(np.sum(np.log(variance) + error**2 / variance))

    return float(minimize_scalar(surprise, bounds=(0.0, _MOST_GROWTH), method="bounded").x)


def growth_rows(indices: Columns, instants: Columns) -> list[dict]:
    """The growth that the ships of each half would choose, beside the one that is used."""
    rows = []
    cases = [("index", where(indices, _grows(indices)), EXTRAPOLATION_SD, "beyond")]
    for name, growth in MOTION_EXTRAPOLATION_SD.items():
        mine = where(instants, instants["state"] == name)
        cases.append((name, mine, growth, "far"))
    for name, mine, used, far in cases:
        halves = [where(mine, mine["first"] == first) for first in (True, False)]
        found = [fitted_growth(half, used, far) if half["ship"].size else math.nan for half in halves]
        rows.append({"of": name, "used": used, "first": found[0], "second": found[1]})
    return rows


def _grows(columns: Columns) -> np.ndarray:
    """Whether the error of an index grows by :data:`pymc_ship.ships.ensemble.index_error.EXTRAPOLATION_SD`."""
    return np.isin(_quantities(columns), SCORED_QUANTITIES)


def law_rows(indices: Columns, held: Columns, instants: Columns) -> list[dict]:
    """The laws of the model error that the ships of each half would choose, beside those that are used."""
    halves = []
    for first in (True, False):
        mine = [where(columns, columns["first"] == first) for columns in (indices, held, instants)]
        halves.append([*fitted_law(*mine[:2]), *(fitted_motion(mine[2], name) for name in MOTION_EXTRAPOLATION_SD)])
    used = {f"typical error, {kind}": value for kind, value in TYPICAL.items()} | {
        "weight of an index": LIKELIHOOD_WEIGHT
    }
    used |= {f"typical error of the motion, {name}": value for name, value in motion_error.TYPICAL.items()}
    first, second = halves
    return [{"of": of, "used": used[of], "first": first[k], "second": second[k]} for k, of in enumerate(used)]


def fitted_motion(instants: Columns, name: str) -> float:
    """Typical error of a state under which its errors are most probable, were nothing held out; NaN without an instant.

    Each ship counts as one.
    """
    mine = where(instants, (instants["state"] == name) & np.isfinite(instants["error"] + instants["draws_sd"]))
    known = mine["draws_sd"] ** 2 + (MOTION_EXTRAPOLATION_SD[name] * mine["far"]) ** 2
    none = np.empty(0)
    law = size_law(none, none, none, 1.0)

    def surprise(log_typical: float) -> float:
        typical = math.exp(log_typical) * growth_with_lead_time(name, mine["lead"])
        return -over_ships(_log_densities(mine["error"], known, typical, law), mine["ship"])[0]

    if not mine["ship"].size:
        return math.nan
    return math.exp(minimize_scalar(surprise, bounds=_LOG_TYPICAL, method="bounded").x)


def fitted_law(indices: Columns, held: Columns) -> np.ndarray:
    """Typical errors by kind and weight of an index under which the errors of forecasts are most probable.

    Each ship's size has the law of its held-out runs, and each ship counts as one; NaN of a kind without an index.
    """
    mine = where(indices, _grows(indices) & np.isfinite(indices["error"]))
    kind, variance = _places(_quantities(mine)), mine["draws_sd"] ** 2 + (EXTRAPOLATION_SD * mine["beyond"]) ** 2
    forecasts = {"kind": kind, "error": mine["error"], "known": variance}
    told = {"kind": _places(held["kind"]), "error": held["error"], "known": held["known"]}
    ships = [
        (where(told, held["ship"] == ship), where(forecasts, mine["ship"] == ship)) for ship in np.unique(mine["ship"])
    ]
    shown = np.append(np.isin(np.arange(len(TYPICAL)), kind), kind.size > 0)  # alone are fitted
    begin = np.append(np.log(list(TYPICAL.values())), logit(LIKELIHOOD_WEIGHT))

    def surprise(chosen: np.ndarray) -> float:
        unknowns = begin.copy()
        unknowns[shown] = chosen
        typical, likelihood_weight, total = np.exp(unknowns[:-1]), expit(unknowns[-1]), 0.0
        for seen, ahead in ships:
            law = size_law(seen["error"], seen["known"], typical[seen["kind"]], likelihood_weight)
            total -= np.mean(_log_densities(ahead["error"], ahead["known"], typical[ahead["kind"]], law))
        return total

    found = np.full(shown.size, math.nan)
    if shown.any():
        simplex = np.vstack([begin[shown], begin[shown] + _STRIDE * np.eye(shown.sum())])
        settings = {"initial_simplex": simplex, "xatol": _CHOSEN_TO, "fatol": _CHOSEN_TO}
        found[shown] = minimize(surprise, begin[shown], method="Nelder-Mead", options=settings).x
    return np.append(np.exp(found[:-1]), expit(found[-1]))


def _log_densities(
    error: np.ndarray, known: np.ndarray, typical: np.ndarray, law: tuple[np.ndarray, np.ndarray]
) -> np.ndarray:
    """Log density of each error but for a constant, with the variance known of it and that of each size of a law."""
    size, log_weight = law
    variance = known[:, None] + (typical[:, None] * size) ** 2
    return np.logaddexp.reduce(log_weight - 0.5 * (np.log(variance) + error[:, None] ** 2 / variance), axis=1)


def _places(kinds: np.ndarray) -> np.ndarray:
    """Place of each kind among those of the law."""
    return np.array([list(TYPICAL).index(kind) for kind in kinds], dtype=int)


def _quantities(columns: Columns) -> np.ndarray:
    """Quantity of each index."""
    pairs = zip(columns["manoeuvre"], columns["index"], strict=True)
    return np.array([kind_named(words.replace(" ", "_")).indices[name].quantity for words, name in pairs], dtype=object)


@dataclass(frozen=True)
class Alternative:
    """Another way to an interval: what it is, its scale from the rows, and its quantile from the rows of other ships.

    ``quantile`` takes the rows of the ships it is chosen on and a probability, and returns the half width over the
    scale, for every row or by kind of index.
    """

    words: str
    scale: Callable[[Columns], np.ndarray]
    quantile: Callable[[Columns, float], float | Mapping[str, float]]


def _normal(chosen: Columns, probability: float) -> float:
    return float(norm.ppf(0.5 + 0.5 * probability))


def _student(chosen: Columns, probability: float) -> float:
    nu, _, size = t.fit(chosen["error"] / chosen["sd"], floc=0.0)
    return float(size * t.ppf(0.5 + 0.5 * probability, nu))


def _conformal(chosen: Columns, probability: float) -> float:
    size = np.sort(np.abs(chosen["error"] / chosen["sd"]))
    rank = min(math.ceil((size.size + 1) * probability), size.size)
    return float(size[rank - 1])


def _conformal_by_kind(chosen: Columns, probability: float) -> dict[str, float]:
    kinds = index_names(chosen)
    return {kind: _conformal(where(chosen, kinds == kind), probability) for kind in dict.fromkeys(kinds)}


def _without_growth(columns: Columns) -> np.ndarray:
    less = columns["sd"] ** 2 - np.where(_grows(columns), EXTRAPOLATION_SD * columns["beyond"], 0.0) ** 2
    return np.sqrt(np.maximum(less, columns["draws_sd"] ** 2))


def _as_they_are(columns: Columns) -> np.ndarray:
    return columns["sd"]


ALTERNATIVES = (
    Alternative("as the package states them, by the normal law", _as_they_are, _normal),
    Alternative("draws alone, no model error", lambda columns: columns["draws_sd"], _normal),
    Alternative("no growth beyond the runs", _without_growth, _normal),
    Alternative("Student's t for the normal law", _as_they_are, _student),
    Alternative("conformal: one factor from other ships", _as_they_are, _conformal),
    Alternative("conformal by kind of index", _as_they_are, _conformal_by_kind),
)
"""Other intervals about the same medians."""


def alternative_rows(columns: Columns) -> list[dict]:
    """Every alternative, chosen on each half of the ships and shown on the other.

    The interval score of 95 % (Gneiting & Raftery 2007, doi:10.1198/016214506000001437) is the width, and forty times
    by how much the truth is outside; the smaller the better.
    """
    finite = where(columns, np.isfinite(columns["error"]) & (columns["sd"] > 0.0))
    first = finite["first"]
    rows = []
    for other in ALTERNATIVES:
        inside, width, score = ({p: np.zeros(first.size) for p in (0.95, 0.5)} for _ in range(3))
        for half in (True, False):
            mine, chosen = where(finite, first == half), where(finite, first != half)
            if not (mine["ship"].size and chosen["ship"].size):
                return []
            for p in (0.95, 0.5):
                q = other.quantile(chosen, p)
                q = np.array([q.get(kind, math.inf) for kind in index_names(mine)]) if isinstance(q, Mapping) else q
                size, error = q * other.scale(mine), np.abs(mine["error"])
                inside[p][first == half], width[p][first == half] = error <= size, size
                score[p][first == half] = 2.0 * size + 2.0 / (1.0 - p) * np.maximum(error - size, 0.0)
        row: dict[str, float | str] = {"intervals": other.words, "half_width": float(np.median(width[0.95]))}
        for p, name in ((0.95, "hold_95"), (0.5, "hold_50")):
            row[name], row[f"{name}_se"] = (100.0 * x for x in over_ships(inside[p], finite["ship"]))
        row["score"], row["score_se"] = over_ships(score[0.95], finite["ship"])
        rows.append(row)
    return rows
