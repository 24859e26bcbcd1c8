"""Tables of a Monte-Carlo study: scores by cell with bootstrap standard errors, costs, and a plan."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field

import numpy as np
import pyarrow as pa

from pymc_ship.experiments.task import STATUSES, Cell
from pymc_ship.replication.scores import statistic_and_error

STATISTIC = {
    "median_error": "median",
    "coverage": "mean",
    "coverage_half": "mean",
    "tactical_diameter_error": "median",
}
"""What is made of a score over the seeds."""

BEYOND = 1_000_000
"""Tasks of the study that is planned."""

CORES = (64, 1024)
"""Numbers of cores of the plan, in addition to those of the run."""


def cell_row(cell: Cell, rows: Mapping[str, np.ndarray]) -> dict:
    """Fields and ``seeds`` of a cell, the number of each status, and each score with its ``_se``.

    ``rows`` are ``status`` and the scores, shape (n_seeds,). A task without coefficients has an infinite error and
    coverages of 0; one without a tactical diameter has an infinite error in that.
    """
    row = asdict(cell) | {"seeds": len(rows["status"])}
    row |= {status: int(np.sum(rows["status"] == status)) for status in STATUSES}
    for name, statistic in STATISTIC.items():
        missing = 0.0 if statistic == "mean" else np.inf
        values = np.where(np.isnan(rows[name]), missing, rows[name])
        if name == "coverage_half" and np.isnan(rows[name]).all():  # a method without intervals of 50 %
            values = rows[name]
        row[name], row[f"{name}_se"] = _with_error(values, statistic)
    return row


def _with_error(values: np.ndarray, statistic: str) -> tuple[float, float]:
    """Statistic and its standard error; NaN for a single seed or an infinite statistic."""
    value, se = statistic_and_error(values, statistic)
    return value, se if len(values) > 1 and math.isfinite(value) else float("nan")


@dataclass
class Session:
    """Costs of the tasks of one call of the program; seconds are sums over the tasks of the parts.

    ``wall`` [s] is from the start to the last result, ``parent`` [s] the time to send a task and save its result.
    """

    executor: str
    workers: int = 0
    tasks: int = 0
    seconds: float = 0.0
    cpu: float = 0.0
    wall: float = 0.0
    parent: float = 0.0

    def add(self, row: Mapping, seconds: float) -> None:
        """Count a task whose parts took so many seconds."""
        self.workers, self.tasks = max(self.workers, row["workers"]), self.tasks + 1
        self.seconds += seconds
        self.cpu += row["cpu"]
        self.wall, self.parent = max(self.wall, row["wall"]), row["parent"]

    @property
    def overhead(self) -> float:
        """Percentage of the workers' time outside the parts."""
        return 100.0 * (1.0 - self.seconds / (self.workers * self.wall))


@dataclass
class Costs:
    """Costs of the tasks of a study, added part by part.

    ``sessions`` by their start [ns since 1970]; ``groups`` of cells, such as a method: ``tasks``, seconds of each
    part of a task (``timed``) and ``cpu``.
    """

    timed: tuple[str, ...]

    sessions: dict[int, Session] = field(default_factory=dict)
    groups: dict[str, dict[str, float]] = field(default_factory=dict)

    def add(self, group: str, rows: pa.Table) -> None:
        """Count the tasks of a part."""
        mine = self.groups.setdefault(group, dict.fromkeys(("tasks", *self.timed, "cpu"), 0.0))
        for row in rows.select(["session", "executor", "workers", "wall", "parent", "cpu", *self.timed]).to_pylist():
            session = self.sessions.setdefault(row["session"], Session(row["executor"]))
            session.add(row, sum(row[name] for name in self.timed))
            mine["tasks"] += 1
            for name in (*self.timed, "cpu"):
                mine[name] += row[name]

    @property
    def tasks(self) -> int:
        """Number of tasks."""
        return sum(session.tasks for session in self.sessions.values())

    def mean(self, name: str) -> float:
        """Mean over all tasks of ``seconds`` or ``cpu`` [s]."""
        return sum(getattr(session, name) for session in self.sessions.values()) / self.tasks

    @property
    def longest(self) -> Session:
        """Session with the most tasks."""
        return max(self.sessions.values(), key=lambda session: session.tasks)


def group_rows(costs: Costs) -> list[dict]:
    """Mean seconds of each part and of processor time by group."""
    return [
        {"group": group, "tasks": int(sums["tasks"])}
        | {name: sums[name] / sums["tasks"] for name in (*costs.timed, "cpu")}
        | {"sum": sum(sums[name] for name in costs.timed) / sums["tasks"]}
        for group, sums in costs.groups.items()
    ]


def session_rows(costs: Costs) -> list[dict]:
    """Each session by its start: workers, tasks, wall time against the sum of the parts."""
    rows = []
    for number, (_, session) in enumerate(sorted(costs.sessions.items()), start=1):
        row = {"session": number} | asdict(session)
        row |= {"speed": session.tasks / session.wall, "overhead": session.overhead}
        rows.append(row | {"parent_ms": 1e3 * session.parent})
    return rows


@dataclass(frozen=True)
class Sizes:
    """Files of parts, and bytes on disk and ``sent`` for each task and result; ``build`` [s] of the tables.

    ``memory`` is the largest resident memory of the parent [bytes]; None on Windows.
    """

    files: int
    disk: int
    sent: int
    memory: int | None
    build: float


def plan_rows(costs: Costs, sizes: Sizes, tasks: int = BEYOND) -> list[dict]:
    """Extrapolated costs of a study of so many tasks: quantity, value, unit, and ``measured``, their source."""
    n, cpu, seconds, best = costs.tasks, costs.mean("cpu"), costs.mean("seconds"), costs.longest
    parent, efficiency = best.parent, best.seconds / (best.workers * best.wall)
    rows = [("processor time", tasks * cpu / 3600.0, "h", f"{cpu:.3g} s a task")]
    for workers in sorted({best.workers, *CORES}):
        hours = tasks * max(seconds / efficiency / workers, parent) / 3600.0
        basis = f"{seconds:.3g} s a task, workers {100.0 * efficiency:.3g} % busy, not faster than the parent"
        rows.append((f"time on {workers} cores", hours, "h", basis))
    rows += [
        ("work of the parent", tasks * parent / 3600.0, "h", f"{1e3 * parent:.3g} ms a task, by tasks that do nothing"),
        ("workers that one parent can feed", seconds / parent, "", f"{seconds:.3g} s over {1e3 * parent:.3g} ms"),
        ("storage", tasks * sizes.disk / n / 1e6, "MB", f"{sizes.disk / n:.3g} bytes a task"),
        ("files", tasks * sizes.files / n, "", f"{sizes.files} for {n} tasks"),
        ("sent to and from workers", tasks * sizes.sent / 1e9, "GB", f"{sizes.sent} bytes a task"),
        ("tables from the parts", tasks * sizes.build / n, "s", f"{1e6 * sizes.build / n:.3g} µs a task"),
    ]
    if sizes.memory is not None:
        basis = "the largest of this run; it does not grow with tasks"
        rows.append(("memory of the parent", sizes.memory / 1e6, "MB", basis))
    return [dict(zip(("quantity", "value", "unit", "measured"), row, strict=True)) for row in rows]


def bottleneck(costs: Costs, tasks: int = BEYOND) -> str:
    """Sentence on the bottleneck of a study of so many tasks."""
    seconds, parent = costs.mean("seconds"), costs.longest.parent
    most, hours = seconds / parent, tasks * parent / 3600.0
    return (
        f"Up to about {most:.2g} workers the cores are the bottleneck; beyond that it is the parent, which hands out "
        f"and keeps one result after the other, {1e3 * parent:.2g} ms each, {hours:.2g} h in all however many workers "
        "there are. Then split the grid into studies with folders of their own: seeds belong to the cell, so that the "
        "results are the same."
    )
