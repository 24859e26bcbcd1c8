"""Tables of a Monte-Carlo study: scores by cell with bootstrap standard errors, costs, and a plan."""

import math
from collections.abc import Mapping
from dataclasses import asdict, dataclass

import numpy as np
import pandas as pd
import pyarrow as pa

from pymc_ship.experiments.task import STATUSES, Cell
from pymc_ship.replication.scores import statistic_and_error

STATISTIC = {"median_error": "median", "coverage": "mean", "coverage_half": "mean", "tactical_diameter_error": "median"}
"""Statistic of each score over the seeds."""

BEYOND = 1_000_000  # tasks of the study that is planned

CORES = (64, 1024)  # numbers of cores of the plan, in addition to those of the run


def cell_row(cell: Cell, rows: Mapping[str, np.ndarray]) -> dict:
    """Fields and ``seeds`` of a cell, the number of each status, and each score with its ``_se``.

    ``rows`` are ``status`` and the scores, shape (n_seeds,). A task without coefficients has an infinite error and
    coverages of 0; one without a tactical diameter has an infinite error in that. The standard error of a single seed
    or an infinite statistic is NaN.
    """
    row = asdict(cell) | {"seeds": len(rows["status"])}
    row |= {status: int(np.sum(rows["status"] == status)) for status in STATUSES}
    for name, statistic in STATISTIC.items():
        missing = 0.0 if statistic == "mean" else np.inf
        values = np.where(np.isnan(rows[name]), missing, rows[name])
        if name == "coverage_half" and np.isnan(rows[name]).all():  # a method without intervals of 50 %
            values = rows[name]
        row[name], se = statistic_and_error(values, statistic)
        row[f"{name}_se"] = se if len(values) > 1 and math.isfinite(row[name]) else math.nan
    return row


_SUMMARY = dict.fromkeys(("tasks", "seconds", "cpu"), "sum")
_SUMMARY |= {"executor": "first", "workers": "max", "wall": "max", "parent": "last"}


class Costs:
    """Costs of the tasks of a study, added part by part: sums by group and session, ``timed`` parts of a task."""

    def __init__(self, timed: tuple[str, ...]):
        self.timed = timed
        self.parts: list[pd.DataFrame] = []

    def add(self, group: str, rows: pa.Table) -> None:
        """Count the tasks of a part of a group of cells, such as a method."""
        columns = ["session", "executor", "workers", "wall", "parent", "cpu", *self.timed]
        tasks = rows.select(columns).to_pandas().assign(group=group, tasks=1)
        tasks["seconds"] = tasks[list(self.timed)].sum(axis=1)
        summary = _SUMMARY | dict.fromkeys(self.timed, "sum")
        self.parts.append(tasks.groupby(["group", "session"], as_index=False).agg(summary))

    @property
    def sessions(self) -> pd.DataFrame:
        """Costs of each call of the program, by its start [ns since 1970].

        ``seconds`` and ``cpu`` are sums over its ``tasks``, ``wall`` [s] is from the start to the last result,
        ``parent`` [s] the time to send a task and save its result.
        """
        return pd.concat(self.parts).groupby("session").agg(_SUMMARY)

    @property
    def longest(self) -> pd.Series:
        """Session with the most tasks."""
        return self.sessions.loc[self.sessions["tasks"].idxmax()]

    def mean(self, name: str) -> float:
        """Mean over all tasks of ``seconds`` or ``cpu`` [s]."""
        return float(self.sessions[name].sum() / self.sessions["tasks"].sum())


def group_rows(costs: Costs) -> list[dict]:
    """Mean seconds of each part and of processor time by group."""
    sums = pd.concat(costs.parts).groupby("group", sort=False)[["tasks", *costs.timed, "cpu", "seconds"]].sum()
    means = sums.div(sums["tasks"], axis=0).rename(columns={"seconds": "sum"})
    return means.assign(tasks=sums["tasks"]).reset_index().to_dict("records")


def session_rows(costs: Costs) -> list[dict]:
    """Each session by its start: workers, tasks, wall time against the sum of the parts, ``overhead`` [%] outside."""
    rows = costs.sessions.reset_index(drop=True)
    busy = rows["seconds"] / (rows["workers"] * rows["wall"])
    rows = rows.assign(session=rows.index + 1, overhead=100.0 * (1.0 - busy), speed=rows["tasks"] / rows["wall"])
    return rows.assign(parent_ms=1e3 * rows["parent"]).to_dict("records")


@dataclass(frozen=True)
class Sizes:
    """Sizes of the results and messages of a study."""

    files: int  # of parts
    disk: int  # of these files [bytes]
    sent: int  # for each task and its result [bytes]
    memory: int | None  # largest resident memory of the parent [bytes]; None on Windows
    build: float  # time of the tables [s]


def plan_rows(costs: Costs, sizes: Sizes) -> list[dict]:
    """Extrapolated costs of a study of :data:`BEYOND` tasks: quantity, value, unit, and ``measured``, their source."""
    n, best = int(costs.sessions["tasks"].sum()), costs.longest
    cpu, seconds, parent = costs.mean("cpu"), costs.mean("seconds"), best["parent"]
    efficiency = best["seconds"] / (best["workers"] * best["wall"])
    rows = [("processor time", BEYOND * cpu / 3600.0, "h", f"{cpu:.3g} s a task")]
    for workers in sorted({best["workers"], *CORES}):
        hours = BEYOND * max(seconds / efficiency / workers, parent) / 3600.0
        basis = f"{seconds:.3g} s a task, workers {100.0 * efficiency:.3g} % busy, not faster than the parent"
        rows.append((f"time on {workers} cores", hours, "h", basis))
    by_parent = f"{1e3 * parent:.3g} ms a task, by tasks that do nothing"
    rows += [
        ("work of the parent", BEYOND * parent / 3600.0, "h", by_parent),
        ("workers that one parent can feed", seconds / parent, "", f"{seconds:.3g} s over {1e3 * parent:.3g} ms"),
        ("storage", BEYOND * sizes.disk / n / 1e6, "MB", f"{sizes.disk / n:.3g} bytes a task"),
        ("files", BEYOND * sizes.files / n, "", f"{sizes.files} for {n} tasks"),
        ("sent to and from workers", BEYOND * sizes.sent / 1e9, "GB", f"{sizes.sent} bytes a task"),
        ("tables from the parts", BEYOND * sizes.build / n, "s", f"{1e6 * sizes.build / n:.3g} µs a task"),
    ]
    if sizes.memory is not None:
        basis = "the largest of this run; it does not grow with tasks"
        rows.append(("memory of the parent", sizes.memory / 1e6, "MB", basis))
    return [dict(zip(("quantity", "value", "unit", "measured"), row, strict=True)) for row in rows]


def bottleneck(costs: Costs) -> str:
    """Sentence on the bottleneck of a study of :data:`BEYOND` tasks."""
    seconds, parent = costs.mean("seconds"), costs.longest["parent"]
    most, hours = seconds / parent, BEYOND * parent / 3600.0
    return (
        f"Up to about {most:.2g} workers the cores are the bottleneck; beyond that it is the parent, which hands out "
        f"and keeps one result after the other, {1e3 * parent:.2g} ms each, {hours:.2g} h in all however many workers "
        "there are. Then split the grid into studies with folders of their own: seeds belong to the cell, so that the "
        "results are the same."
    )
