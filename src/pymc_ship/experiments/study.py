"""Interface of a study: tasks, work on one, settings, report. A grid is one; a TOML file names any other."""

from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, ClassVar, Protocol, Self

import pyarrow as pa

from pymc_ship.machine.toml import Entry


class Study(Protocol):
    """Interface of a study, which is a dataclass."""

    __dataclass_fields__: ClassVar[dict[str, Any]]

    @property
    def title(self) -> str:
        """Head of the page."""

    @property
    def seeds(self) -> int:
        """Tasks of each cell."""

    @property
    def scores(self) -> Mapping[str, pa.DataType]:
        """Columns of a result besides seed, status and sentence."""

    @property
    def timed(self) -> tuple[str, ...]:
        """Parts of a task whose seconds are recorded."""

    @property
    def n_tasks(self) -> int:
        """Number of tasks."""

    def remarks(self) -> list[str]:
        """Sentences shown before the first task."""

    def parts(self) -> Iterator[tuple[Any, range, str]]:
        """Seeds of every cell, a dataclass of texts and numbers, in parts, each with its file name without suffix."""

    def task(self, cell: Any, seed: int, block: str = "") -> Any:
        """Task of one seed of a cell."""

    def work(self, task: Any) -> dict:
        """Do a task; its result has the columns of this study, ``block``, ``seed`` and ``cpu`` [s]."""

    def empty(self, task: Any) -> dict:
        """A result without work."""

    def record(self) -> dict:
        """The settings that the results depend on, saved with them."""

    def difference(self, old: Mapping) -> str:
        """First setting that does not merely extend the study of another record; empty where none."""

    def report(self, store: Any) -> tuple[list[dict], Path]:
        """Write tables and page of a complete :class:`pymc_ship.experiments.store.Store`; main table and page."""

    def columns(self, rows: Sequence[Mapping]) -> dict[str, str]:
        """Heads of the columns of the main table that a terminal shows, by key."""


class StudyKind(Study, Protocol):
    """A study that a TOML file names by its import path."""

    @classmethod
    def read(cls, file: Entry, folder: Path) -> Self:
        """Study of the table of a TOML file, with paths relative to the folder; a StudyError names a wrong key."""
