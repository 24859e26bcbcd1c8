"""Page of a Monte-Carlo study with figures, costs and a plan, and its tables as files."""

import json
import pickle
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict
from itertools import groupby
from pathlib import Path
from time import perf_counter

import numpy as np
import pyarrow as pa

from pymc_ship.experiments import tables
from pymc_ship.experiments.figures import scores
from pymc_ship.experiments.store import Store
from pymc_ship.experiments.task import STAGES, STATUSES, Cell
from pymc_ship.machine.files import staged_files
from pymc_ship.machine.memory import peak_memory
from pymc_ship.pages import drawing
from pymc_ship.pages.page import Content, Page, write_page
from pymc_ship.pages.tables import Columns, Table, fixed_point, heads, number, table

PAGE = Page("index.html", Path(__file__).with_name("page.html.j2"), digits=6, tables=".")
"""The page of a study, in one folder with ``cells.csv``."""

MOST_FIGURES, MOST_ROWS = 12, 400  # figures and rows of cells that the page shows; ``cells.csv`` has all

_SHARED = ("ship", "manoeuvre", "noise")


def write_report(store: Store) -> tuple[list[dict], Path]:
    """Scores by cell, and the path of the page, of a complete study; tables and page are written together.

    ``results.parquet`` and ``cells.csv`` depend on the study alone, ``timings.parquet`` and the page on the runs, too.
    OutputError when the folder cannot be written.
    """
    costs, start = tables.Costs(store.study.timed), perf_counter()
    with staged_files(store.out, last=PAGE.file) as folder:
        rows = list(_cells(store.written(folder), costs))
        sizes = _sizes(store, folder, perf_counter() - start)
        write_page(PAGE, folder, _content(store, rows, costs, sizes))
    return rows, store.out / PAGE.file


def _cells(written: Iterator[tuple[Cell, pa.Table]], costs: tables.Costs) -> Iterator[dict]:
    for cell, parts in groupby(written, key=lambda item: item[0]):
        mine = []
        for _, rows in parts:
            costs.add(cell.method, rows)
            mine.append(rows.select(["status", *tables.STATISTIC]))
        whole = pa.concat_tables(mine)
        yield tables.cell_row(cell, {name: np.array(whole[name].to_pylist()) for name in whole.column_names})


def _sizes(store: Store, folder: Path, build: float) -> tables.Sizes:
    """Files and bytes of the results and messages, memory of the parent, time of the tables [s]."""
    parts = list((store.out / "parts").rglob("*.parquet"))
    cell, _, part = next(store.study.parts())
    result = dict.fromkeys((*store.results, *store.timings), 0.0)
    sent = len(pickle.dumps(store.study.task(cell, 0, part))) + len(json.dumps(result)) + len(part)
    return tables.Sizes(
        len(parts), sum(path.stat().st_size for path in [*parts, *folder.glob("*.parquet")]), sent, peak_memory(), build
    )


def cell_table(rows: Sequence[Mapping]) -> Table:
    """One line for each cell: scores with their standard errors, and the number of each status."""
    lines = [dict(row) | {name: _with_error(row[name], row[f"{name}_se"]) for name in tables.STATISTIC} for row in rows]
    columns: Columns = {name: (name, str) for name in _SHARED if len({row[name] for row in rows}) > 1}
    columns |= heads(number(3), level="noise level") | heads(str, method="method", median_error="median error %")
    columns |= heads(str, coverage="90 % intervals cover %", coverage_half="50 % intervals cover %")
    columns |= heads(str, tactical_diameter_error="tactical diameter error %")
    return table(lines, columns | {name: (name, fixed_point(0)) for name in STATUSES})


def _with_error(value: float, standard_error: float) -> str:
    text = number(3)(value)
    return f"{text} ± {number(2)(standard_error)}" if np.isfinite(standard_error) else text


def _content(store: Store, rows: Sequence[Mapping], costs: tables.Costs, sizes: tables.Sizes) -> Content:
    n, grid = number(3), store.study
    sessions = tables.session_rows(costs)
    by_session = heads(str, session="run", executor="by") | heads(fixed_point(0), workers="workers", tasks="tasks")
    by_session |= heads(n, wall="wall s", seconds="sum of parts s") | heads(fixed_point(1), overhead="overhead %")
    by_session |= heads(n, speed="tasks/s", parent_ms="parent ms/task")
    by_method = heads(str, group="method") | heads(fixed_point(0), tasks="tasks")
    by_method |= heads(n, **{name: f"{name} s" for name in STAGES}, sum="sum s", cpu="processor s")
    plan = heads(str, quantity="") | heads(n, value="value") | heads(str, unit="", measured="from")
    groups = [list(group) for _, group in groupby(rows, key=lambda row: [row[name] for name in _SHARED])]
    shown = {f"scores_{k}": group for k, group in enumerate(groups[:MOST_FIGURES])}
    values = {
        "title": grid.title,
        "grid": asdict(grid) | {"n_cells": len(rows), "n_tasks": grid.n_tasks},
        "ended": {status: sum(row[status] for row in rows) for status in STATUSES},
        "captions": {name: ", ".join(str(group[0][key]) for key in _SHARED) for name, group in shown.items()},
        "left_out": len(groups) - len(shown),
        "rows_left_out": max(0, len(rows) - MOST_ROWS),
        "tables": {
            "cells": cell_table(rows[:MOST_ROWS]),
            "sessions": table(sessions, by_session),
            "methods": table(tables.group_rows(costs), by_method),
            "plan": table(tables.plan_rows(costs, sizes), plan),
        },
        "wall": n(sum(row["wall"] for row in sessions)),
        "beyond": f"{tables.BEYOND:.0e}".replace("e+0", "e"),
        "bottleneck": tables.bottleneck(costs),
    }
    figures = {name: drawing.svg(scores(group), name) for name, group in shown.items()}
    return Content(values, figures, {"cells": rows})
