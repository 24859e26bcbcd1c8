"""What a study is to the engine: tasks, how one is done, what is kept of it and how the results are reported.

A grid of experiments is one; a TOML file names any other by its import path.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, ClassVar, Protocol, Self

import pyarrow as pa

from pymc_ship.machine.toml import Entry


class Study(Protocol):
    """What the engine asks of a study, which is a dataclass."""

    __dataclass_fields__: ClassVar[dict[str, Any]]

    @property
    def title(self) -> str:
        """Head of the page."""

    @property
    def seeds(self) -> int:
        """Tasks of each cell."""

    @property
    def scores(self) -> Mapping[str, pa.DataType]:
        """Columns of a result beside seed, status and sentence."""

    @property
    def timed(self) -> tuple[str, ...]:
        """Parts of a task whose seconds are kept."""

    @property
    def n_tasks(self) -> int:
        """Number of tasks."""

    def remarks(self) -> list[str]:
        """Sentences on what it read that are shown before it begins."""

    def parts(self) -> Iterator[tuple[Any, range, str]]:
        """Every cell's seeds in parts, and the name of the part's results without an ending.

        A cell is a dataclass of texts and numbers, which are columns of the results.
        """

    def task(self, cell: Any, seed: int, block: str = "") -> Any:
        """Task of one seed of a cell."""

    def work(self, task: Any) -> dict:
        """Do a task; its result has the columns of this study, ``block``, ``seed`` and ``cpu`` [s]."""

    def empty(self, task: Any) -> dict:
        """A result without work."""

    def record(self) -> dict:
        """What the results depend on, as it is kept beside them."""

    def difference(self, old: Mapping) -> str:
        """First thing in which this study does more than extend that of another record; empty where none does."""

    def report(self, store: Any) -> tuple[list[dict], Path]:
        """Write tables and page of a complete :class:`pymc_ship.experiments.store.Store`; main table and page."""

    def columns(self, rows: Sequence[Mapping]) -> dict[str, str]:
        """Heads of the columns of the main table that a terminal shows, by key."""


class StudyKind(Study, Protocol):
    """A study that a TOML file names by its import path."""

    @classmethod
    def read(cls, file: Entry, folder: Path) -> Self:
        """Study of the table of a TOML file, in a folder from which the paths in it count.

        Raises
        ------
        StudyError
            For what cannot be used; the sentence names the key.
        """
