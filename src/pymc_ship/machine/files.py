"""Results appear under their name only when they are complete; what stood there before stays until then."""

from __future__ import annotations

import csv
import os
import shutil
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path


class OutputError(ValueError):
    """A place where nothing can be written."""


@contextmanager
def staged(path: str | Path) -> Iterator[Path]:
    """Temporary name for a file or folder that is moved to its own name when the block ends without an exception.

    Parameters
    ----------
    path : str or Path
        Final name; its folder must exist.

    Yields
    ------
    Path
        Name beside the final one, with the same ending, to write to.

    Raises
    ------
    OutputError
        When the folder cannot be written.
    """
    path = Path(path)
    partial = path.with_name(f".{path.stem}.partial{path.suffix}")
    try:
        _remove(partial)
        yield partial
        _replace(partial, path)
    except OSError as error:
        raise OutputError(f"{path} cannot be written: {error.strerror or error}; choose another place.") from None
    finally:
        if partial.parent.is_dir():
            _remove(partial)


def writable_folder(path: str | Path) -> Path:
    """Create a folder where it is missing and make sure that it can be written, before long work begins.

    Raises
    ------
    OutputError
        When it cannot.
    """
    path = Path(path)
    probe = path / ".writable"
    try:
        path.mkdir(parents=True, exist_ok=True)
        probe.touch()
        probe.unlink()
    except OSError as error:
        raise OutputError(f"{path} cannot be written: {error.strerror or error}; choose another place.") from None
    return path


def _replace(partial: Path, path: Path) -> None:
    if not (path.is_dir() and partial.is_dir()):
        os.replace(partial, path)
        return
    before = path.with_name(f".{path.name}.before")
    _remove(before)
    try:
        os.replace(path, before)
        os.replace(partial, path)
    except BaseException:
        if before.exists() and not path.exists():
            os.replace(before, path)
        raise
    _remove(before)


def _remove(path: Path) -> None:
    if path.is_dir() and not path.is_symlink():
        shutil.rmtree(path)
    else:
        path.unlink(missing_ok=True)


def write_rows(rows: Sequence[Mapping], path: Path, *, digits: int | None = None) -> Path:
    """Write rows of equal keys as CSV, numbers to so many significant digits, moved into place when complete."""
    keys = list(dict.fromkeys(key for row in rows for key in row))
    if digits is not None:
        rows = [{key: _rounded(value, digits) for key, value in row.items()} for row in rows]
    with staged(path) as partial, partial.open("w", encoding="utf-8", newline="") as file:
        writer = csv.DictWriter(file, keys, lineterminator="\n")
        writer.writeheader()
        writer.writerows(rows)
    return path


def _rounded(value: object, digits: int) -> object:
    return float(f"{value:.{digits}g}") if isinstance(value, float) else value
