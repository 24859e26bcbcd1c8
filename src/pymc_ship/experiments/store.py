"""Results of a Monte-Carlo study on disk: nothing that was measured is lost or measured again.

Each result is appended to the journal of its part (a line of JSON) the moment it is there. A part that has all its
results becomes a Parquet file with a checksum under ``parts/ship=.../manoeuvre=.../noise=.../level=.../method=.../``,
and its journal goes. A line that a kill cut off is dropped and its task done again; of a result that stands twice the
first counts.
"""

from __future__ import annotations

import hashlib
import json
import os
from collections import Counter
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import asdict
from pathlib import Path

import pyarrow as pa
import pyarrow.parquet as pq

from pymc_ship.experiments.grid import Cell, Grid, difference
from pymc_ship.experiments.task import PARTS, SCORES, MonteCarloError
from pymc_ship.machine.files import OutputError, staged, writable_folder

RESULTS = ("seed", "status", "sentence", *SCORES)
"""Columns of a result: the same whatever ran where and when."""

TIMINGS = ("seed", *PARTS, "cpu", "session", "executor", "workers", "wall", "parent")
"""Columns of its timing: seconds of the parts and of processor time; the session (its start [ns since 1970]) with its
executor and workers; seconds from the session's start to when the result was kept (``wall``), and those in which its
parent hands out a task and keeps its result (``parent``)."""

_TEXTS, _WHOLE = ("status", "sentence", "executor"), ("seed", "session", "workers")
_ROWS, _SUM = 5_000, b"sha256"


def _field(name: str) -> pa.Field:
    return pa.field(name, pa.string() if name in _TEXTS else pa.int64() if name in _WHOLE else pa.float64())


_SCHEMA = pa.schema([_field(name) for name in (*RESULTS, *TIMINGS[1:])])


class Store:
    """Results of a grid in a folder.

    Attributes
    ----------
    out : Path
    grid : Grid
    """

    def __init__(self, out: Path, grid: Grid):
        self.out, self.grid = out, grid
        self._left: Counter[str] = Counter()

    def missing(self) -> list[tuple[Cell, str, Sequence[int]]]:
        """Cell, part and seeds of what is still to be measured, in the order of the results."""
        found = []
        self._left.clear()
        for cell, seeds, part in self.grid.parts():
            done = self._done(part, len(seeds))
            left = [seed for seed in seeds if seed not in done] if done else seeds
            if left:
                found.append((cell, part, left))
                self._left[part] = len(left)
            else:
                self._seal(part)
        return found

    def add(self, result: dict) -> None:
        """Keep a result: what ``montecarlo_task.measure`` returns with what is left of :data:`TIMINGS`."""
        part = result["block"]
        line = json.dumps({name: result[name] for name in _SCHEMA.names}) + "\n"
        journal = self._journal(part)
        try:
            journal.parent.mkdir(parents=True, exist_ok=True)
            with journal.open("ab") as file:
                file.write(line.encode())
        except OSError as error:
            raise _unwritable(journal, error) from None
        self._left[part] -= 1
        if not self._left[part]:
            self._seal(part)

    def results(self) -> Iterator[tuple[Cell, pa.Table]]:
        """Rows of every part in the order of the grid, by seed; read when asked for."""
        for cell, _, part in self.grid.parts():
            yield cell, _read(self._parquet(part), part)

    def _done(self, part: str, size: int) -> set[int] | range:
        """Seeds that have their results."""
        path, journal = self._parquet(part), self._journal(part)
        if path.exists():
            with _whole(path):
                if pq.read_metadata(path).num_rows == size:
                    return range(size)
            done = set(_read(path, part)["seed"].to_pylist())
        else:
            done = set()
        return done | {row["seed"] for row in _lines(journal)}

    def _seal(self, part: str) -> None:
        """Turn a journal into the Parquet file of its part."""
        path, journal = self._parquet(part), self._journal(part)
        if not journal.exists():
            return
        rows = {}
        before = _read(path, part).to_pylist() if path.exists() else []
        for row in before + _lines(journal):
            rows.setdefault(row["seed"], row)
        table = pa.Table.from_pylist([rows[seed] for seed in sorted(rows)], _SCHEMA)
        with staged(path) as partial:
            pq.write_table(table.replace_schema_metadata({_SUM: _checksum(table, part)}), partial)
        journal.unlink()

    def _parquet(self, part: str) -> Path:
        return self.out / "parts" / f"{part}.parquet"

    def _journal(self, part: str) -> Path:
        path = self._parquet(part)
        return path.with_name(f"_{path.stem}.jsonl")


@contextmanager
def opened(out: str | Path, grid: Grid) -> Iterator[Store]:
    """Store of a study in a folder that no other run uses meanwhile.

    Raises
    ------
    MonteCarloError
        Where another run is at work, or the folder holds another study that this one does not just extend.
    OutputError
        For a folder that cannot be written.
    """
    import fcntl

    out = writable_folder(out)
    with (out / ".lock").open("w") as lock:
        try:
            fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            raise MonteCarloError(f"Another run is at work in {out}; let it end or choose another folder.") from None
        _remember(out / "study.json", grid.record())
        yield Store(out, grid)


def _remember(path: Path, record: dict) -> None:
    """Keep what the results depend on; refuse to mix them with those of another study."""
    if path.exists():
        try:
            changed = difference(json.loads(path.read_text(encoding="utf-8")), record)
        except (ValueError, KeyError, TypeError, AttributeError, RecursionError, OSError):
            raise MonteCarloError(f"{path} is no record of a study; choose another folder.") from None
        if changed:
            raise MonteCarloError(
                f"{path.parent} holds another study, which can only be extended: {changed}; choose another folder."
            )
    with staged(path) as partial:
        partial.write_text(json.dumps(record, indent=1) + "\n", encoding="utf-8")


def _read(path: Path, part: str) -> pa.Table:
    """Rows of a part, when they have their checksum and are its own."""
    with _whole(path), pq.ParquetFile(path) as file:
        table = file.read()
        if not table.schema.equals(_SCHEMA) or table.schema.metadata[_SUM] != _checksum(table, part):
            raise ValueError("its checksum does not fit")
        return table.replace_schema_metadata()


def _checksum(table: pa.Table, part: str) -> bytes:
    return hashlib.sha256(json.dumps([part, table.to_pydict()]).encode()).hexdigest().encode()


@contextmanager
def _whole(path: Path) -> Iterator[None]:
    """Say where a part cannot be read."""
    try:
        yield
    except (ValueError, KeyError, TypeError, OSError, pa.ArrowException) as error:
        raise MonteCarloError(
            f"The results {path} are damaged: {error}; delete the file, its tasks will be done again."
        ) from None


def _lines(path: Path) -> list[dict]:
    """Results in a journal; the end of it that is no whole line is cut off."""
    if not path.exists():
        return []
    data = path.read_bytes()
    whole = data.rfind(b"\n") + 1
    if whole < len(data):
        os.truncate(path, whole)
    try:
        table = pa.Table.from_pylist([json.loads(line) for line in data[:whole].splitlines()], _SCHEMA)
        if any(column.null_count for column in table.columns):
            raise ValueError("a line lacks a column")
        return table.to_pylist()
    except (ValueError, TypeError, AttributeError, RecursionError, pa.ArrowException):
        raise MonteCarloError(f"The journal {path} is damaged; delete it, its tasks will be done again.") from None


@contextmanager
def table_writer(path: Path, columns: Sequence[str]) -> Iterator:
    """Function (cell, rows) that adds columns of a part to a Parquet file, which appears when it is complete.

    Parameters
    ----------
    path : Path
    columns : sequence of str
        Those after the columns of the cell.
    """
    keys = [pa.field(name, pa.float64() if name == "level" else pa.string()) for name in Cell.__annotations__]
    schema, pending = pa.schema([*keys, *(_field(name) for name in columns)]), []
    with staged(path) as partial, pq.ParquetWriter(partial, schema, write_page_checksum=True) as writer:

        def add(cell: Cell, rows: pa.Table) -> None:
            fixed = [
                pa.array([value] * len(rows), field.type) for value, field in zip(_values(cell), keys, strict=True)
            ]
            pending.append(pa.table([*fixed, *(rows[name] for name in columns)], schema=schema))
            if sum(map(len, pending)) >= _ROWS:
                flush()

        def flush() -> None:
            writer.write_table(pa.concat_tables(pending).combine_chunks())
            pending.clear()

        yield add
        if pending:
            flush()


def _values(cell: Cell) -> list:
    return list(asdict(cell).values())


def _unwritable(path: Path, error: OSError) -> OutputError:
    reason = error.strerror or error
    return OutputError(f"{path} cannot be written: {reason}; what was measured is kept: make room and run again.")
