"""Report of a population of ships: tables of results, and a page with coverage, reliability, bands and costs."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

from pymc_ship.experiments.store import Store
from pymc_ship.experiments.tables import Costs, group_rows, session_rows
from pymc_ship.machine.files import staged_files
from pymc_ship.pages.page import Content, Page, write_page
from pymc_ship.pages.tables import Table, fixed_point, number, table
from pymc_ship.ships.forecasting.stopping import REVERSAL
from studies.population import coverage, figures
from studies.population.coverage import Columns, columns_of, where
from studies.population.judged_ship import HELD_INDEX, INDEX, INSTANT, STAGES, STATUSES, STOP

PAGE = Page(
    "index.html",
    Path(__file__).with_name("page.html.j2"),
    own=("figures/*.png", "tables/*.csv"),
    packages=("pymc-ship", "numpy", "scipy", "xarray", "numba"),
    digits=6,
)
"""The page of a population, with its tables and figures beside it."""

WORST = 10
"""Ships that the page shows; ``tables/ships.csv`` has all."""

_TABLES = (
    *("trials", "hulls", "halves", "indices", "distances", "ships", "coverage"),
    *("statements", "leads", "beyond", "stops", "stops_by_trials", "growth", "model_error", "alternatives"),
)
_BEYOND = "beyond the motion of the runs"
_SOURCES = (
    "Gneiting, T., Balabdaoui, F. & Raftery, A. E. (2007). Probabilistic forecasts, calibration and sharpness. J. R. "
    "Stat. Soc. B 69, 243-268. doi:10.1111/j.1467-9868.2007.00587.x",
    "Gneiting, T. & Raftery, A. E. (2007). Strictly proper scoring rules, prediction, and estimation. J. Am. Stat. "
    "Assoc. 102, 359-378. doi:10.1198/016214506000001437",
    "Vovk, V., Gammerman, A. & Shafer, G. (2005). Algorithmic learning in a random world. Springer. "
    "doi:10.1007/b106715",
)


def write_population(store: Store) -> tuple[list[dict], Path]:
    """Write the tables and the page of a population that is complete; they appear together.

    ``results.parquet`` and the tables depend on the study alone, ``timings.parquet`` and the page on the runs, too.

    Parameters
    ----------
    store : Store

    Returns
    -------
    list of dict, Path
        Coverage of all ships and by class of trials, and the page, ``index.html``, which is moved into place last.

    Raises
    ------
    OutputError
        When the folder cannot be written.
    """
    costs, ships, seeds = Costs(store.study.timed), [], store.study.seeds
    with staged_files(store.out, last=PAGE.file, own=PAGE.own) as folder:
        for cell, part in store.written(folder):
            costs.add(cell.trials, part)
            ships += [row | {"trials": cell.trials, "first": 2 * row["seed"] < seeds} for row in part.to_pylist()]
        kept = (("indices", INDEX), ("instants", INSTANT), ("held", HELD_INDEX), ("stops", STOP))
        indices, instants, held, stops = (columns_of(ships, *what) for what in kept)
        rows = dict.fromkeys(_TABLES, ())
        if indices["ship"].size:
            rows = population_rows(indices, instants, held, stops)
        write_page(PAGE, folder, _content(store, ships, rows, costs, _figures(indices, rows)))
    return rows["trials"], store.out / PAGE.file


def population_rows(indices: Columns, instants: Columns, held: Columns, stops: Columns) -> dict[str, Sequence[dict]]:
    """Rows of every table by its name, from the columns of ships of which one was judged or more."""
    distances = coverage.distance_names(indices["beyond"])
    within = indices["beyond"] < 1.0
    parts = {"within one range": within, "one range beyond or more": ~within, "all": within | ~within}
    parts |= {_BEYOND: indices["beyond"] > 0.0}
    return {
        "trials": _all_and_by_trials(indices),
        "hulls": coverage.by(indices, indices["hull"]),
        "halves": coverage.by(indices, np.where(indices["first"], "first", "second")),
        "indices": coverage.by(indices, coverage.index_names(indices)),
        "distances": sorted(
            coverage.by(indices, distances), key=lambda row: list(coverage.DISTANCES).index(row["group"])
        ),
        "ships": coverage.ship_rows(indices),
        "coverage": list(_by_trials_and_distance(indices, distances)),
        "statements": [
            {"forecasts": name} | row
            for name, mask in parts.items()
            if mask.any()
            for row in coverage.statements(where(indices, mask))
        ],
        "leads": coverage.motion_rows(instants, instants["lead"]),
        "beyond": coverage.motion_rows(instants, coverage.distance_names(instants["beyond"])),
        "stops": coverage.by(stops, np.array([name.replace("_", " ") for name in stops["index"]])),
        "stops_by_trials": _all_and_by_trials(stops) if stops["ship"].size else [],
        "growth": coverage.growth_rows(indices, instants),
        "model_error": coverage.law_rows(indices, held, instants),
        "alternatives": coverage.alternative_rows(indices),
    }


def _all_and_by_trials(columns: Columns) -> list[dict]:
    """Coverage of all ships and by class of trials."""
    return [{"group": "all"} | coverage.coverage_row(columns), *coverage.by(columns, columns["trials"])]


def _by_trials_and_distance(indices: Columns, distances: np.ndarray) -> Iterator[dict]:
    """Coverage of every index by the trials and how far the forecast goes beyond them."""
    for trials in dict.fromkeys(indices["trials"]):
        for distance in coverage.DISTANCES:
            mine = where(indices, (indices["trials"] == trials) & (distances == distance))
            for row in coverage.by(mine, coverage.index_names(mine)):
                yield {"trials": str(trials), "distance": distance, "index": row.pop("group")} | row


def _figures(indices: Columns, rows: Mapping[str, Sequence[dict]]) -> dict[str, Figure]:
    """Figures of what there is."""
    drawn = {}
    if rows["indices"]:
        drawn["coverage_by_index"] = figures.coverage_by_index(rows["indices"])
        drawn["reliability"] = figures.reliability(indices)
    if rows["leads"]:
        drawn["motion_by_lead"] = figures.motion_by_lead(rows["leads"])
    return drawn


def _content(
    store: Store,
    ships: Sequence[Mapping],
    rows: Mapping[str, Sequence[dict]],
    costs: Costs,
    drawn: Mapping[str, Figure],
) -> Content:
    study, n = store.study, number(3)
    sessions = session_rows(costs)
    by_session = {"session": ("run", str), "executor": ("by", str), "workers": ("workers", fixed_point(0))}
    by_session |= {"tasks": ("ships", fixed_point(0)), "wall": ("wall s", n), "seconds": ("sum of parts s", n)}
    by_group = {"group": ("trials", str), "tasks": ("ships", fixed_point(0))}
    by_group |= {name: (f"{name} s", n) for name in STAGES} | {"cpu": ("processor s", n)}
    heads = {
        "trials": "trials",
        "hulls": "hull",
        "halves": "half",
        "indices": "index",
        "distances": "distance from the runs",
        "stops": "index",
        "stops_by_trials": "trials",
    }
    values = {
        "title": study.title,
        "ended": {status: sum(ship["status"] == status for ship in ships) for status in STATUSES},
        "study": {
            "ships": study.n_tasks,
            "root_seed": study.root_seed,
            "drawn_by": study.drawn_by,
            "forecasts": list(study.forecasts),
            "astern": study.astern,
            "reversal": REVERSAL,
            "trials": {name: str(trials) for name, trials in study.trials.items()},
        },
        "refused": [f"{s['trials']}, ship {s['seed']}: {s['sentence']}" for s in ships if s["status"] != "ok"],
        "coverage": {name: _coverage_table(rows[name], head) for name, head in heads.items()},
        "tables": {
            "ships": table(rows["ships"][:WORST], _SHIPS),
            "statements": table(rows["statements"], _STATEMENTS),
            "leads": _motion_table(rows["leads"], "time since the restart", "{:g} L/U"),
            "beyond": _motion_table(rows["beyond"], "distance from the runs"),
            "growth": table(rows["growth"], {"of": ("growth of", str)} | _CHOSEN),
            "model_error": table(rows["model_error"], {"of": ("of", str)} | _CHOSEN),
            "alternatives": table([_with_errors(row) for row in rows["alternatives"]], _ALTERNATIVES),
            "sessions": table(sessions, by_session),
            "groups": table(group_rows(costs), by_group),
        },
        "sure": [row for row in rows["statements"] if (row["forecasts"], row["stated"]) == (_BEYOND, 0.99)],
    }
    return Content(values | {"drawn": list(drawn)}, drawn, rows, sources=_SOURCES)


def _with_errors(row: Mapping) -> dict:
    """The row with each share and score beside its standard error, as text."""
    texts = {}
    for name in row:
        if f"{name}_se" in row:
            form: Callable = {"score": number(3), "pit": fixed_point(2)}.get(name, fixed_point(0))
            texts[name] = f"{form(row[name])} ± {number(2)(row[f'{name}_se'])}"
    return dict(row) | texts


def _coverage_table(rows: Sequence[Mapping], head: str) -> Table:
    n = number(2)
    columns = {"group": (head, str), "ships": ("ships", fixed_point(0)), "indices": ("indices", fixed_point(0))}
    columns |= {
        "hold_95": ("95 % hold %", str),
        "hold_50": ("50 % hold %", str),
        "pit": ("mean PIT", str),
        "z": ("rms of error / sd", fixed_point(2)),
    }
    columns |= {"median_error": ("median error", n), "half_width": ("half width", n), "crps": ("CRPS", n)}
    return table([_with_errors(row) for row in rows], columns)


def _motion_table(rows: Sequence[Mapping], head: str, form: str = "{}") -> Table:
    """A line a group, a column a state: the share in bands of 90 % with its standard error, and the worst ship."""
    states, lines = list(dict.fromkeys(row["state"] for row in rows)), []
    for group in dict.fromkeys(row["group"] for row in rows):
        mine = {row["state"]: row for row in rows if row["group"] == group}
        cells = {
            name: f"{mine[name]['hold_90']:.0f} ± {mine[name]['se']:.0f} ({mine[name]['worst']:.0f})" for name in mine
        }
        first = next(iter(mine.values()))
        lines.append({"group": form.format(group), "ships": first["ships"], "instants": first["instants"]} | cells)
    columns = {"group": (head, str), "ships": ("ships", fixed_point(0)), "instants": ("instants", fixed_point(0))}
    return table(lines, columns | {name: (f"{name} %", str) for name in states})


_SHIPS = {
    "trials": ("trials", str),
    "ship": ("ship", fixed_point(0)),
    "hull": ("hull", str),
    "indices": ("indices", fixed_point(0)),
    "hold_95": ("95 % hold %", fixed_point(0)),
    "hold_50": ("50 % hold %", fixed_point(0)),
    "z": ("rms of error / sd", fixed_point(2)),
    "beyond": ("ranges beyond the runs", fixed_point(1)),
}
_STATEMENTS = {
    "forecasts": ("forecasts", str),
    "statements": ("statements", fixed_point(0)),
    "stated": ("stated", lambda value: f"{100.0 * value:g} %"),
    "share": ("held %", lambda value: fixed_point(1)(100.0 * value)),
    "se": ("± %", lambda value: fixed_point(1)(100.0 * value)),
}
_CHOSEN = {
    "used": ("used", number(2)),
    "first": ("first half would choose", number(2)),
    "second": ("second half would choose", number(2)),
}
_ALTERNATIVES = {
    "intervals": ("intervals", str),
    "hold_95": ("95 % hold %", str),
    "hold_50": ("50 % hold %", str),
    "half_width": ("median half width", number(2)),
    "score": ("interval score", str),
}
