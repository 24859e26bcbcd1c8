"""A row of the benchmark: what was timed, ours beside a named peer, and how far the two results are apart."""

from __future__ import annotations

import csv
import math
import statistics
import time
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from importlib import import_module
from pathlib import Path
from types import ModuleType

HEADER = ("what is timed", "ours", "peer", "its", "ratio", "check", "verdict")


@dataclass(frozen=True)
class Row:
    """One comparison.

    Attributes
    ----------
    what : str
        What is timed.
    ours : float
        Seconds, or work per second where ``unit`` is "/s".
    peer : str
        Who does the same work.
    theirs : float
        As ``ours``; NaN where the peer is missing.
    check : str
        What ``value`` measures: the difference between the two results, or a ratio of their errors.
    value, limit : float
        The results disagree where value is above the limit, or NaN.
    unit : {"s", "/s"}
    note : str
        Why a row was skipped, or what is not the same.
    """

    what: str
    ours: float
    peer: str
    theirs: float
    check: str = ""
    value: float = math.nan
    limit: float = math.nan
    unit: str = "s"
    note: str = ""

    @property
    def skipped(self) -> bool:
        """Whether the peer was missing."""
        return math.isnan(self.theirs)

    @property
    def ratio(self) -> float:
        """How many times as fast as the peer ours is."""
        return self.theirs / self.ours if self.unit == "s" else self.ours / self.theirs

    @property
    def verdict(self) -> str:
        """Whether the peer is missing, the results disagree, or the peer wins; empty where ours wins."""
        if self.skipped:
            return "skipped"
        if not self.value <= self.limit:
            return "RESULTS DIFFER"
        return "the peer wins" if self.ratio < 1.0 else ""

    @property
    def cells(self) -> tuple[str, ...]:
        """Texts of the row under :data:`HEADER`."""
        if self.skipped:
            return self.what, "", self.peer, "", "", self.note, self.verdict
        measured = (f"{self.ours:.3g} {self.unit}", self.peer, f"{self.theirs:.3g} {self.unit}", f"{self.ratio:.3g} x")
        check = f"{self.check} {self.value:.2g} (<= {self.limit:.2g})"
        return self.what, *measured, check, self.verdict


class MissingPeer(Exception):
    """A peer that is not installed; ``what`` it was to be timed at, its name and why it is missing."""

    def __init__(self, what: str, peer: str, note: str):
        super().__init__(f"{peer}: {note}")
        self.what, self.peer, self.note = what, peer, note


def imported(module: str, what: str, peer: str) -> ModuleType:
    """Import a peer; MissingPeer where it is not installed."""
    try:
        return import_module(module)
    except ImportError as error:
        raise MissingPeer(what, peer, f"not run: {error}") from None


def collected(measurements: Iterable[Callable[[], Iterator[Row]]]) -> Iterator[Row]:
    """Rows of all measurements in order; a missing peer makes a skipped row and ends its measurement only."""
    for measurement in measurements:
        try:
            yield from measurement()
        except MissingPeer as missing:
            yield Row(missing.what, math.nan, missing.peer, math.nan, note=missing.note)


def median_seconds(work: Callable[[], object], repeats: int = 1) -> tuple[float, object]:
    """Median wall time of a call over repeats, and its last result."""
    seconds, result = [], None
    for _ in range(repeats):
        start = time.perf_counter()
        result = work()
        seconds.append(time.perf_counter() - start)
    return statistics.median(seconds), result


def line(cells: Iterable[str]) -> str:
    """One line of the printed table."""
    widths = (52, 11, 42, 11, 9, 62, 0)
    return " ".join(f"{cell:<{width}}" for cell, width in zip(cells, widths, strict=True)).rstrip()


def markdown(rows: Iterable[Row]) -> str:
    """The table in Markdown, verdicts in bold, notes below it."""
    rows = list(rows)
    cells = [HEADER, ("---",) * len(HEADER)]
    cells += [(*row.cells[:-1], f"**{row.verdict}**" if row.verdict else "") for row in rows]
    table = "\n".join("| " + " | ".join(cell.replace("|", "\\|") for cell in row) + " |" for row in cells)
    notes = "".join(f"- {row.what}, {row.peer}: {row.note}.\n" for row in rows if row.note and not row.skipped)
    return f"{table}\n\n{notes}" if notes else f"{table}\n"


def write_csv(rows: Iterable[Row], path: Path) -> None:
    """Write every row, numbers in full."""
    with path.open("w", encoding="utf-8", newline="") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(
            ("what", "unit", "ours", "peer", "theirs", "ratio", "check", "value", "limit", "verdict", "note")
        )
        for row in rows:
            numbers = ("", "", "") if row.skipped else (row.ours, row.theirs, row.ratio)
            values = ("", "") if row.skipped else (row.value, row.limit)
            ours, theirs, ratio = (f"{number:.6g}" if number != "" else "" for number in numbers)
            value, limit = (f"{number:.3g}" if number != "" else "" for number in values)
            writer.writerow(
                (row.what, row.unit, ours, row.peer, theirs, ratio, row.check, value, limit, row.verdict, row.note)
            )
