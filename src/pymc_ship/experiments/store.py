"""Results of a Monte-Carlo study on disk.

Each result is a line of JSON in the journal of its part; a complete part becomes a Parquet file with a checksum. An
incomplete line is dropped; of two results of one task the first counts.
"""

import hashlib
import json
import os
from collections import Counter
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import asdict
from pathlib import Path
from typing import Any, get_type_hints

import pyarrow as pa
import pyarrow.parquet as pq
from filelock import lock_descriptor

from pymc_ship.experiments.study import Study
from pymc_ship.machine.errors import OutputError, ShipError, StudyError
from pymc_ship.machine.files import staged_path, writable_folder

_BEGIN, _TIMED = ("seed", "status", "sentence"), ("cpu", "session", "executor", "workers", "wall", "parent")
_TYPES = {"status": pa.string(), "sentence": pa.string(), "executor": pa.string()}
_TYPES |= dict.fromkeys(("seed", "session", "workers"), pa.int64())
_OF_CELL = {str: pa.string(), float: pa.float64()}
_ROWS, _SUM = 5_000, b"sha256"


class Store:
    """Results of a study in a folder.

    ``results`` are the columns of a result, which do not depend on the machine. ``timings``: seconds of the parts
    and of processor time; the session (its start [ns since 1970]), executor and workers; seconds to the saved
    result (``wall``) and of the parent's handling of a task (``parent``).
    """

    def __init__(self, out: Path, study: Study):
        self.out, self.study = out, study
        self.results, self.timings = (*_BEGIN, *study.scores), ("seed", *study.timed, *_TIMED)
        types = _TYPES | dict(study.scores)
        self._schema = pa.schema(
            [pa.field(name, types.get(name, pa.float64())) for name in (*self.results, *self.timings[1:])]
        )
        self._left: Counter[str] = Counter()

    def missing(self) -> list[tuple[Any, str, Sequence[int]]]:
        """Cell, part and seeds of the missing results, in the order of the results."""
        unfinished: list[tuple[Any, str, Sequence[int]]] = []
        self._left.clear()
        for cell, seeds, part in self.study.parts():
            done = self._seeds_done(part, len(seeds))
            left = [seed for seed in seeds if seed not in done] if done else seeds
            if left:
                unfinished.append((cell, part, left))
                self._left[part] = len(left)
            else:
                self._write_part(part)
        return unfinished

    def add(self, result: dict) -> None:
        """Append a result of the study's ``work``, with the rest of its timings, to the journal."""
        part = result["block"]
        line = json.dumps({name: result[name] for name in self._schema.names}) + "\n"
        journal = self._journal(part)
        try:
            journal.parent.mkdir(parents=True, exist_ok=True)
            with journal.open("ab") as file:
                file.write(line.encode())
        except OSError as error:
            reason = f"{journal} cannot be written: {error.strerror or error}"
            raise OutputError(f"{reason}; what was measured is kept: make room and run again.") from None
        self._left[part] -= 1
        if not self._left[part]:
            self._write_part(part)

    def rows(self) -> Iterator[tuple[Any, pa.Table]]:
        """Rows of every part in the order of the study, by seed; read when asked for."""
        for cell, _, part in self.study.parts():
            yield cell, self._read(part)

    def written(self, folder: Path) -> Iterator[tuple[Any, pa.Table]]:
        """Rows of every part; the two Parquet files of a folder appear after the last part."""
        with (
            self._writer(folder / "timings.parquet", self.timings) as add_timings,
            self._writer(folder / "results.parquet", self.results) as add_results,
        ):
            for cell, rows in self.rows():
                add_timings(cell, rows)
                add_results(cell, rows)
                yield cell, rows

    def _seeds_done(self, part: str, size: int) -> set[int] | range:
        path, journal = self._parquet(part), self._journal(part)
        if path.exists():
            with _study_errors(path):
                if pq.read_metadata(path).num_rows == size:
                    return range(size)
            done = set(self._read(part)["seed"].to_pylist())
        else:
            done = set()
        return done | {row["seed"] for row in self._journal_rows(journal)}

    def _write_part(self, part: str) -> None:
        path, journal = self._parquet(part), self._journal(part)
        if not journal.exists():
            return
        rows: dict[int, dict] = {}
        before = self._read(part).to_pylist() if path.exists() else []
        for row in before + self._journal_rows(journal):
            rows.setdefault(row["seed"], row)
        table = pa.Table.from_pylist([rows[seed] for seed in sorted(rows)], self._schema)
        with staged_path(path) as partial:
            pq.write_table(table.replace_schema_metadata({_SUM: _checksum(table, part)}), partial)
        journal.unlink()

    def _read(self, part: str) -> pa.Table:
        """Rows of a part, where checksum and columns are right."""
        path = self._parquet(part)
        with _study_errors(path), pq.ParquetFile(path) as file:
            table = file.read()
            if not table.schema.equals(self._schema) or table.schema.metadata[_SUM] != _checksum(table, part):
                raise ShipError("its checksum does not fit")
            return table.replace_schema_metadata()

    def _journal_rows(self, path: Path) -> list[dict]:
        """Results in a journal; an incomplete last line is cut off."""
        if not path.exists():
            return []
        data = path.read_bytes()
        whole = data.rfind(b"\n") + 1
        if whole < len(data):
            os.truncate(path, whole)
        try:
            table = pa.Table.from_pylist([json.loads(line) for line in data[:whole].splitlines()], self._schema)
            if any(column.null_count for column in table.columns):
                raise ShipError("a line lacks a column")
            return table.to_pylist()
        except (ValueError, TypeError, AttributeError, RecursionError, pa.ArrowException):
            raise StudyError(f"The journal {path} is damaged; delete it, its tasks will be done again.") from None

    @contextmanager
    def _writer(self, path: Path, columns: Sequence[str]) -> Iterator:
        """Function (cell, rows) that adds columns of a part, after those of its cell, to a file that is staged."""
        first, *_ = self.study.parts()
        keys = [pa.field(name, _OF_CELL[kind]) for name, kind in get_type_hints(type(first[0])).items()]
        schema, pending = pa.schema([*keys, *(self._schema.field(name) for name in columns)]), []
        with staged_path(path) as partial, pq.ParquetWriter(partial, schema, write_page_checksum=True) as writer:

            def add(cell: Any, rows: pa.Table) -> None:
                values = asdict(cell).values()
                fixed = [pa.array([value] * len(rows), one.type) for value, one in zip(values, keys, strict=True)]
                pending.append(pa.table([*fixed, *(rows[name] for name in columns)], schema=schema))
                if sum(map(len, pending)) >= _ROWS:
                    flush()

            def flush() -> None:
                writer.write_table(pa.concat_tables(pending).combine_chunks())
                pending.clear()

            yield add
            if pending:
                flush()

    def _parquet(self, part: str) -> Path:
        return self.out / "parts" / f"{part}.parquet"

    def _journal(self, part: str) -> Path:
        path = self._parquet(part)
        return path.with_name(f"_{path.stem}.jsonl")


@contextmanager
def locked_store(out: str | Path, study: Study) -> Iterator[Store]:
    """Store of a study in a folder, locked against other runs.

    StudyError where another run has the lock, or the study does not extend the one in the folder. OutputError for a
    folder that cannot be written.
    """
    out = writable_folder(out)
    with (out / ".lock").open("w") as lock:
        if not lock_descriptor(lock.fileno(), blocking=False):
            raise StudyError(f"Another run is at work in {out}; let it end or choose another folder.")
        _write_record(out / "study.json", study)
        yield Store(out, study)


def _write_record(path: Path, study: Study) -> None:
    """Save the settings that the results depend on; raise where the folder has those of another study."""
    if path.exists():
        try:
            changed = study.difference(json.loads(path.read_text(encoding="utf-8")))
        except (ValueError, KeyError, TypeError, AttributeError, RecursionError, OSError):
            raise StudyError(f"{path} is no record of a study; choose another folder.") from None
        if changed:
            raise StudyError(
                f"{path.parent} holds another study, which can only be extended: {changed}; choose another folder."
            )
    with staged_path(path) as partial:
        partial.write_text(json.dumps(study.record(), indent=1) + "\n", encoding="utf-8")


def _checksum(table: pa.Table, part: str) -> bytes:
    return hashlib.sha256(json.dumps([part, table.to_pydict()]).encode()).hexdigest().encode()


@contextmanager
def _study_errors(path: Path) -> Iterator[None]:
    try:
        yield
    except (ValueError, KeyError, TypeError, OSError, pa.ArrowException) as error:
        raise StudyError(
            f"The results {path} are damaged: {error}; delete the file, its tasks will be done again."
        ) from None
