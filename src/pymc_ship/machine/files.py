"""A result appears under its name only when it is complete; an earlier result stays until then."""

from __future__ import annotations

import os
import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path


class OutputError(ValueError):
    """A folder or file that cannot be written."""


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
    with _partial(path) as partial:
        yield partial
        _replace(partial, path)


@contextmanager
def staged_files(folder: str | Path, *, last: str) -> Iterator[Path]:
    """Temporary folder whose files are moved into a folder when the block ends without an exception.

    Parameters
    ----------
    folder : str or Path
        Where the files go, to the same places as in the temporary folder; other files of it stay.
    last : str
        Name of the file that is moved last.

    Yields
    ------
    Path
        Folder inside the final one to write to.

    Raises
    ------
    OutputError
        When the folder cannot be written.
    """
    folder = Path(folder)
    with _partial(folder / last) as partial:
        partial.mkdir()
        yield partial
        made = sorted(path.relative_to(partial) for path in partial.rglob("*") if path.is_file())
        for path in sorted(made, key=lambda path: path == Path(last)):
            (folder / path).parent.mkdir(parents=True, exist_ok=True)
            os.replace(partial / path, folder / path)


def writable_folder(path: str | Path) -> Path:
    """Create a folder where it is missing and make sure that it can be written, before long work begins.

    Raises
    ------
    OutputError
        When it cannot.
    """
    path = Path(path)
    probe = path / ".writable"
    with _told(path):
        path.mkdir(parents=True, exist_ok=True)
        probe.touch()
        probe.unlink()
    return path


@contextmanager
def _told(path: Path) -> Iterator[None]:
    """Say where nothing can be written."""
    try:
        yield
    except OSError as error:
        raise OutputError(f"{path} cannot be written: {error.strerror or error}; choose another place.") from None


@contextmanager
def _partial(path: Path) -> Iterator[Path]:
    """Temporary name beside a final one, with nothing under it before and after the block."""
    partial = path.with_name(f".{path.stem}.partial{path.suffix}")
    with _told(path):
        try:
            _remove(partial)
            yield partial
        finally:
            if partial.parent.is_dir():
                _remove(partial)


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
