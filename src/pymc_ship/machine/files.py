"""A result appears under its name only when it is complete; an earlier result stays until then.

What a run writes lies in a folder of its own, ``.partial-HOST-PID-RANDOM`` beside the result, until it is complete.
What is guaranteed, whatever run is killed when and however many runs write to one place:

- A file is the earlier or the new one, whole.
- A folder that is replaced, and files of one folder that belong together, are the earlier or the new ones for every
  reader that calls :func:`settle` first, as those of this package do. They are moved one after the other: another
  program that looks after a kill in the middle of that, before the next run, may find no folder or files of both.
- Of two runs at one place the one that ends last stands whole: a run moves its files while no other one does.
- What a killed run left is removed by the next run in the same folder, but never the folder of a run that lives. That
  is known from a lock that ends with its process; of another machine, whose locks may not be seen here, only what has
  not changed for :data:`OLD` by the clock of the file system is taken for left behind.
"""

from __future__ import annotations

import hashlib
import os
import platform
import re
import shutil
import stat
import tempfile
import uuid
from collections.abc import Iterable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from filelock import lock_descriptor

from pymc_ship.machine.errors import OutputError

OLD = 7 * 86400.0
"""Seconds without a change after which a folder of partial results of another machine is taken for left behind."""

_HOST = hashlib.sha256(f"{platform.node()} {uuid.getnode()}".encode()).hexdigest()[:12]
_BOX = re.compile(r"\.partial-[0-9a-f]{12}-\d+-\w+")
_KINDS = {stat.S_IFCHR: "a device", stat.S_IFBLK: "a device", stat.S_IFIFO: "a pipe", stat.S_IFSOCK: "a socket"}

# Inside a folder of partial results: the lock of its run, what is being written, the earlier folder while a new one
# takes its place, and files that are complete and on their way; a list of names that go with their arrival.
_LOCK, _GONE = ".lock", ".gone"
_NEW, _BEFORE, _READY = "new", "before", "ready"
_TURN = ".partial-turn"
_POLL = 0.01  # seconds between two looks at a lock that another run has


@contextmanager
def staged_path(path: str | Path) -> Iterator[Path]:
    """Temporary name for a file or folder that is moved to its own name when the block ends without an exception.

    Parameters
    ----------
    path : str or Path
        Final name; its folder must exist. Where it is a link, what the link leads to is written.

    Yields
    ------
    Path
        The same name in a temporary folder beside the final one, to write to.

    Raises
    ------
    OutputError
        When the folder cannot be written, or the name is that of a device or a pipe.
    """
    path = final_path(path)
    with _told(path), _box(path.parent) as box:
        yield box / _NEW / path.name
        made = box / _NEW / path.name
        if not made.is_dir() and not path.is_dir():
            os.replace(made, path)
            return
        with _turn(path.parent):  # another writer may have made the folder since
            if path.is_dir():
                _swap(box, path)
            else:
                os.replace(made, path)


@contextmanager
def staged_files(folder: str | Path, *, last: str = "", own: Iterable[str] = ()) -> Iterator[Path]:
    """Temporary folder whose files are moved into a folder together when the block ends without an exception.

    Parameters
    ----------
    folder : str or Path
        Where the files go, to the same places as in the temporary folder; other files of it stay.
    last : str, optional
        Name of the file that is moved last.
    own : iterable of str, optional
        Patterns of files of an earlier result, which go where the new one does not have them.

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
    with _told(folder / last), _box(folder) as box:
        new = box / _NEW
        yield new
        made = _files(new)
        for name in made:
            (folder / name).parent.mkdir(parents=True, exist_ok=True)
            if (folder / name).is_dir():
                raise IsADirectoryError(None, f"{name} is a folder there")
        gone = {path.relative_to(folder) for pattern in own for path in folder.glob(pattern)}.difference(made)
        (box / _GONE).write_text("\n".join(map(str, sorted(gone))), encoding="utf-8")
        with _turn(folder):
            os.replace(new, box / _READY)
            try:
                _deliver(box, last)
            except KeyboardInterrupt:
                _deliver(box, last)
                raise


def final_path(path: str | Path) -> Path:
    """Final name of a result, behind all links.

    Raises
    ------
    OutputError
        For a device, a pipe or a socket.
    """
    path = Path(path)
    with _told(path):
        if not path.is_symlink() and not path.exists():
            return path
        real = Path(os.path.realpath(path)) if path.is_symlink() else path
        kind = _KINDS.get(stat.S_IFMT(real.stat().st_mode)) if os.path.lexists(real) else None
    if kind:
        raise OutputError(f"A result is written to a file or a folder, found {kind} at {path}; choose another place.")
    return real


def writable_folder(path: str | Path) -> Path:
    """Create a folder where it is missing and make sure that it can be written, before long work begins.

    Raises
    ------
    OutputError
        When it cannot.
    """
    path = Path(path)
    with _told(path):
        path.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryFile(dir=path):
            pass
    settle(path)
    return path


def settle(folder: str | Path) -> None:
    """Bring to its end what killed runs left in a folder: move what was complete, remove the rest.

    A folder that cannot be read or written is left as it is.
    """
    folder = Path(folder)
    with suppress(OSError):
        boxes = [path for path in folder.iterdir() if _BOX.fullmatch(path.name)]
        if not boxes and not (folder / _TURN).exists():
            return
        with tempfile.TemporaryFile(dir=folder) as fresh:
            clock = os.fstat(fresh.fileno()).st_mtime
        with _turn(folder):
            for box in boxes:
                with suppress(OSError):
                    _end(box, clock)
                with suppress(OSError):  # empty now, or killed before its lock was made or after it was removed
                    box.rmdir()


@contextmanager
def _told(path: Path) -> Iterator[None]:
    """Say where nothing can be written."""
    try:
        yield
    except BrokenPipeError:  # of the standard output
        raise
    except OSError as error:
        raise OutputError(f"{path} cannot be written: {error.strerror or error}; choose another place.") from None


@contextmanager
def _box(folder: Path) -> Iterator[Path]:
    """Folder of partial results of this run, locked as long as the block lasts and removed then."""
    settle(folder)
    lock = None
    while lock is None:
        box = Path(tempfile.mkdtemp(prefix=f".partial-{_HOST}-{os.getpid()}-", dir=folder))
        with suppress(FileNotFoundError):  # another run took the folder, empty yet, for left behind
            lock = _locked(box / _LOCK)
    try:
        (box / _NEW).mkdir()
        yield box
    finally:
        if (box / _READY).exists():  # a later run moves what could not be moved now
            os.close(lock)
        else:
            _clear(box, lock)
            with suppress(OSError):
                box.rmdir()


@contextmanager
def _turn(folder: Path) -> Iterator[None]:
    """Wait until no other run moves results into a folder."""
    path, lock = folder / _TURN, None
    while lock is None:
        lock = _locked(path, wait=True)
    try:
        yield
    finally:
        _unlock(path, lock)


def _locked(path: Path, *, wait: bool = False) -> int | None:
    """Descriptor of a file that is locked until it is closed; None where another process was quicker.

    A file system without locks gives the descriptor all the same.
    """
    descriptor, held = os.open(path, os.O_RDWR | os.O_CREAT, 0o666), False
    try:
        with suppress(FileNotFoundError):
            held = _take(descriptor, wait) and os.path.samestat(os.fstat(descriptor), os.stat(path))
    finally:
        if not held:
            os.close(descriptor)
    return descriptor if held else None


def _take(descriptor: int, wait: bool = False) -> bool:
    """Lock an open file; False where another process has it. A file system without locks gives every lock."""
    try:
        return lock_descriptor(descriptor, blocking=wait, poll_interval=_POLL)
    except OSError:
        return True


def _unlock(path: Path, descriptor: int | None) -> None:
    """Remove the file of a lock and free the lock.

    Where an open file can be removed, that is done first: once free, the lock may be another run's. Windows removes no
    open file, and so none that another run has.
    """
    if os.name != "nt":
        path.unlink(missing_ok=True)
    if descriptor is not None:
        os.close(descriptor)
    if os.name == "nt":
        with suppress(OSError):
            path.unlink()


def _end(box: Path, clock: float) -> None:
    """Bring to its end what a run that has ended left in its folder; the folder of a run that lives stays."""
    lock, here = None, False
    try:
        with suppress(OSError):  # no lock there, or a file system without locks
            lock = os.open(box / _LOCK, os.O_RDWR)
            if not lock_descriptor(lock, blocking=False):
                return
            here = box.name.startswith(f".partial-{_HOST}-")
        changed = (path.lstat().st_mtime for path in (box, *box.rglob("*")))
        if here or max(changed) < clock - OLD:
            _resume(box)
            _clear(box, lock)
            lock = None
    finally:
        if lock is not None:
            os.close(lock)


def _resume(box: Path) -> None:
    """Move what a killed run had on its way."""
    if (box / _READY).exists():
        _deliver(box)
    elif (box / _BEFORE).exists():
        for new in (box / _NEW).glob("*"):
            if not os.path.lexists(box.parent / new.name):
                os.replace(new, box.parent / new.name)


def _deliver(box: Path, last: str = "") -> None:
    """Move complete files to their places; called again, it goes on."""
    ready, folder = box / _READY, box.parent
    for name in sorted(_files(ready), key=lambda name: name == Path(last)):
        os.replace(ready / name, folder / name)
    for gone in (box / _GONE).read_text(encoding="utf-8").splitlines():
        (folder / gone).unlink(missing_ok=True)
    _remove(ready)


def _swap(box: Path, path: Path) -> None:
    """Put a new folder in the place of an earlier one."""
    new, before = box / _NEW / path.name, box / _BEFORE
    if not new.is_dir():
        os.replace(new, path)
        return
    try:
        os.replace(path, before)
        os.replace(new, path)
    except BaseException:
        if before.exists() and not path.exists():
            os.replace(before, path)
        raise


def _files(folder: Path) -> list[Path]:
    """Files below a folder, by their places in it."""
    return sorted(path.relative_to(folder) for path in folder.rglob("*") if path.is_file())


def _clear(box: Path, lock: int | None) -> None:
    """Empty a folder of partial results, its lock last, so that a kill meanwhile leaves it to the next run."""
    for path in box.iterdir():
        if path.name != _LOCK:
            _remove(path)
    _unlock(box / _LOCK, lock)


def _remove(path: Path) -> None:
    if path.is_dir() and not path.is_symlink():
        shutil.rmtree(path)
    else:
        path.unlink(missing_ok=True)
