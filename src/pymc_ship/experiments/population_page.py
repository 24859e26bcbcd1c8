"""Report of a population of ships: tables of results, and a page with coverage, reliability, bands and costs."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from itertools import groupby
from pathlib import Path

import numpy as np

from pymc_ship.experiments import coverage, figures
from pymc_ship.experiments.coverage import Columns, columns_of, where
from pymc_ship.experiments.judged_ship import INDEX, INSTANT, PARTS, STATUSES
from pymc_ship.experiments.store import Store
from pymc_ship.experiments.tables import Costs, group_rows, session_rows
from pymc_ship.machine.files import staged_files
from pymc_ship.pages.page import Content, Page, write_page
from pymc_ship.pages.tables import Table, fixed, number, table

PAGE = Page(
    "index.html",
    Path(__file__).with_name("population.html.j2"),
    own=("figures/*.png", "tables/*.csv"),
    packages=("pymc-ship", "numpy", "scipy", "xarray", "numba"),
    digits=6,
)
"""The page of a population, with its tables and figures beside it."""

_ROWS = ("trials", "hulls", "indices", "distances", "each", "statements", "leads", "beyond", "growth", "alternatives")
_BESIDE = ("trials", "hulls", "indices", "distances", "statements", "leads", "beyond", "alternatives", "growth")
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
    costs, ships = Costs(store.study.timed), []
    with staged_files(store.out, last=PAGE.file, own=PAGE.own) as folder:
        tables = [folder / f"{name}.parquet" for name in ("timings", "results")]
        with (
            store.table_writer(tables[0], store.timings) as add_timings,
            store.table_writer(tables[1], store.results) as add_results,
        ):
            for cell, parts in groupby(store.rows(), key=lambda found: found[0]):
                for _, rows in parts:
                    add_timings(cell, rows)
                    add_results(cell, rows)
                    costs.add(cell.trials, rows)
                    ships += [_ship(cell.trials, row, store.study.seeds) for row in rows.to_pylist()]
        rows = population_rows(ships)
        write_page(PAGE, folder, _content(store, ships, rows, costs))
    return rows["trials"], store.out / PAGE.file


def _ship(trials: str, row: Mapping, seeds: int) -> dict:
    """A result as tables take it."""
    kept = {name: row[name] for name in ("seed", "status", "sentence", "hull", "runs", "indices", "instants")}
    return kept | {"trials": trials, "first": 2 * row["seed"] < seeds}


def population_rows(ships: Sequence[Mapping]) -> dict[str, Sequence[dict]]:
    """Rows of every table by its name; none where no ship was judged."""
    indices, instants = (columns_of(ships, *what) for what in (("indices", INDEX), ("instants", INSTANT)))
    if not indices["ship"].size:
        return dict.fromkeys(_ROWS, ())
    names, distances = coverage.index_names(indices), coverage.distance_names(indices["beyond"])
    every = np.array([" | ".join(key) for key in zip(indices["trials"], distances, names, strict=True)])
    within = indices["beyond"] < 1.0
    parts = {"within one range": within, "one range beyond or more": ~within, "all": within | ~within}
    parts |= {"beyond the motion of the runs": indices["beyond"] > 0.0}
    return {
        "trials": [{"group": "all"} | coverage.coverage_row(indices), *coverage.by(indices, indices["trials"])],
        "hulls": coverage.by(indices, indices["hull"]),
        "indices": coverage.by(indices, names),
        "distances": [
            row for name in coverage.DISTANCES for row in coverage.by(*_only(indices, distances, distances == name))
        ],
        "each": coverage.by(indices, every),
        "statements": [
            {"forecasts": name} | row
            for name, mask in parts.items()
            if mask.any()
            for row in coverage.statements(where(indices, mask))
        ],
        "leads": coverage.motion_rows(instants, np.array([f"{lead:g} L/U" for lead in instants["lead"]])),
        "beyond": coverage.motion_rows(instants, coverage.distance_names(instants["beyond"])),
        "growth": coverage.growth_rows(indices, instants),
        "alternatives": coverage.alternative_rows(indices),
    }


def _only(columns: Columns, group: np.ndarray, mask: np.ndarray) -> tuple[Columns, np.ndarray]:
    return where(columns, mask), group[mask]


def _content(store: Store, ships: Sequence[Mapping], rows: Mapping[str, Sequence[dict]], costs: Costs) -> Content:
    study, n = store.study, number(3)
    indices, instants = (columns_of(ships, *what) for what in (("indices", INDEX), ("instants", INSTANT)))
    sessions = session_rows(costs)
    by_session = {"session": ("run", str), "executor": ("by", str), "workers": ("workers", fixed(0))}
    by_session |= {"tasks": ("ships", fixed(0)), "wall": ("wall s", n), "seconds": ("sum of parts s", n)}
    by_group = {"group": ("trials", str), "tasks": ("ships", fixed(0))}
    by_group |= {name: (f"{name} s", n) for name in PARTS} | {"cpu": ("processor s", n)}
    heads = {"trials": "trials", "hulls": "hull", "indices": "index", "distances": "distance from the runs"}
    values = {
        "title": study.title,
        "ended": {status: sum(ship["status"] == status for ship in ships) for status in STATUSES},
        "study": {
            "ships": study.n_tasks,
            "root_seed": study.root_seed,
            "drawn_by": study.drawn_by,
            "forecasts": list(study.forecasts),
            "trials": {name: str(trials) for name, trials in study.trials.items()},
        },
        "refused": [f"{s['trials']}, ship {s['seed']}: {s['sentence']}" for s in ships if s["status"] != "ok"],
        "coverage": {name: _coverage_table(rows[name], head) for name, head in heads.items()},
        "tables": {
            "statements": table(rows["statements"], _STATEMENTS),
            "leads": _motion_table(rows["leads"], "time since the restart"),
            "beyond": _motion_table(rows["beyond"], "distance from the runs"),
            "growth": table(rows["growth"], _GROWTH),
            "alternatives": table([_with_errors(row) for row in rows["alternatives"]], _ALTERNATIVES),
            "sessions": table(sessions, by_session),
            "groups": table(group_rows(costs), by_group),
        },
        "sure": coverage.sure_statements(indices),
    }
    drawn = {}
    if indices["ship"].size:
        drawn["coverage_by_index"] = figures.coverage_by_index(indices)
        drawn["reliability"] = figures.reliability(indices)
    if instants["ship"].size:
        drawn["motion_by_lead"] = figures.motion_by_lead(instants)
    tables = {"coverage": _split(rows["each"])} | {name: rows[name] for name in _BESIDE}
    return Content(values | {"drawn": list(drawn)}, drawn, tables, sources=_SOURCES)


def _split(rows: Sequence[Mapping]) -> list[dict]:
    """Rows whose group is trials, distance and index."""
    return [
        dict(zip(("trials", "distance", "index"), row["group"].split(" | "), strict=True))
        | {name: value for name, value in row.items() if name != "group"}
        for row in rows
    ]


def _with_errors(row: Mapping) -> dict:
    """The row with each share and score beside its standard error, as text."""
    texts = {}
    for name in row:
        if f"{name}_se" in row:
            form: Callable = number(3) if name == "score" else fixed(0)
            texts[name] = f"{form(row[name])} ± {number(2)(row[f'{name}_se'])}"
    return dict(row) | texts


def _coverage_table(rows: Sequence[Mapping], head: str) -> Table:
    n = number(2)
    columns = {"group": (head, str), "ships": ("ships", fixed(0)), "indices": ("indices", fixed(0))}
    columns |= {"hold_95": ("95 % hold %", str), "hold_50": ("50 % hold %", str), "z": ("rms of error / sd", fixed(2))}
    columns |= {"median_error": ("median error", n), "half_width": ("half width", n), "crps": ("CRPS", n)}
    return table([_with_errors(row) for row in rows], columns)


def _motion_table(rows: Sequence[Mapping], head: str) -> Table:
    """A line a group, a column a state: the share in bands of 90 % with its standard error, and the worst ship."""
    states, lines = list(dict.fromkeys(row["state"] for row in rows)), []
    for group in dict.fromkeys(row["group"] for row in rows):
        mine = {row["state"]: row for row in rows if row["group"] == group}
        cells = {
            name: f"{mine[name]['hold_90']:.0f} ± {mine[name]['se']:.0f} ({mine[name]['worst']:.0f})" for name in mine
        }
        first = next(iter(mine.values()))
        lines.append({"group": group, "ships": first["ships"], "instants": first["instants"]} | cells)
    columns = {"group": (head, str), "ships": ("ships", fixed(0)), "instants": ("instants", fixed(0))}
    return table(lines, columns | {name: (f"{name} %", str) for name in states})


_STATEMENTS = {
    "forecasts": ("forecasts", str),
    "statements": ("statements", fixed(0)),
    "stated": ("stated", lambda value: f"{100.0 * value:g} %"),
    "share": ("held %", lambda value: fixed(1)(100.0 * value)),
    "se": ("± %", lambda value: fixed(1)(100.0 * value)),
}
_GROWTH = {
    "of": ("growth of", str),
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
