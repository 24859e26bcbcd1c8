"""Atomic output: a result appears under its name only when it is complete; an earlier result stays until then.

A run writes to a folder ``.partial-HOST-PID-RANDOM`` beside the result, and the last run to end leaves its result.
A reader calls :func:`finish_killed_runs` first: it delivers or removes the folders of killed runs alone.
"""

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

from pymc_ship.machine.arguments import as_path
from pymc_ship.machine.errors import OutputError
from pymc_ship.machine.text import SPECIAL_FILES

OLD = 7 * 86400.0  # seconds without a change after which a partial folder of another machine counts as abandoned

_HOST = hashlib.sha256(f"{platform.node()} {uuid.getnode()}".encode()).hexdigest()[:12]
_BOX = re.compile(r"\.partial-[0-9a-f]{12}-\d+-\w+")

# Names inside a partial folder: lock of its run; files to delete on delivery; files being written; the earlier folder
# during a swap; complete files during delivery.
_LOCK, _OBSOLETE = ".lock", ".gone"
_NEW, _BEFORE, _READY = "new", "before", "ready"
_DELIVERY = ".partial-turn"
_POLL = 0.01  # seconds between two attempts to lock


@contextmanager
def staged_path(path: str | Path) -> Iterator[Path]:
    """Temporary path of a file or folder, renamed to its final path if the block ends without an exception.

    The folder of the final path must exist; a symbolic link is followed. OutputError if it cannot be written.
    """
    path = final_path(path)
    with _output_errors(path), _partial_folder(path.parent) as box:
        new = box / _NEW / path.name
        yield new
        if not new.is_dir() and not path.is_dir():
            os.replace(new, path)
            return
        with _delivery_lock(path.parent):  # another writer may have made the folder since
            if path.is_dir():
                _swap(box, path)
            else:
                os.replace(new, path)


@contextmanager
def staged_files(folder: str | Path, *, last: str = "", own: Iterable[str] = ()) -> Iterator[Path]:
    """Temporary folder whose files are moved into a folder together if the block ends without an exception.

    ``last`` is the file to move last; files of an earlier result that match a pattern in ``own`` are deleted unless the
    new result has them; other files stay. OutputError if the folder cannot be written.
    """
    folder = Path(folder)
    with _output_errors(folder / last), _partial_folder(folder) as box:
        new = box / _NEW
        yield new
        names = _files(new)
        for name in names:
            (folder / name).parent.mkdir(parents=True, exist_ok=True)
            if (folder / name).is_dir():
                raise IsADirectoryError(None, f"{name} is a folder there")
        obsolete = {path.relative_to(folder) for pattern in own for path in folder.glob(pattern)}.difference(names)
        (box / _OBSOLETE).write_text("\n".join(map(str, sorted(obsolete))), encoding="utf-8")
        with _delivery_lock(folder):
            os.replace(new, box / _READY)
            try:
                _deliver(box, last)
            except KeyboardInterrupt:
                _deliver(box, last)
                raise


def final_path(path: str | Path) -> Path:
    """Path of a result with symbolic links resolved; OutputError for a device, a pipe or a socket."""
    path, kind = Path(path), None
    with _output_errors(path), suppress(FileNotFoundError):  # nothing there, or another run is just replacing it
        kind = SPECIAL_FILES.get(stat.S_IFMT(path.stat().st_mode))
    if kind:
        raise OutputError(f"A result is written to a file or a folder, found {kind} at {path}; choose another path.")
    return Path(os.path.realpath(path)) if path.is_symlink() else path


def writable_folder(path: str | Path) -> Path:
    """Create a folder if it is missing; OutputError if it cannot be written."""
    path = as_path("out", path, OutputError)
    with _output_errors(path):
        path.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryFile(dir=path):
            pass
    finish_killed_runs(path)
    return path


def finish_killed_runs(folder: str | Path) -> None:
    """Finish the work of killed runs in a folder that can be written: deliver complete files, delete the others."""
    folder = Path(folder)
    with suppress(OSError):
        boxes = [path for path in folder.iterdir() if _BOX.fullmatch(path.name)]
        if not boxes and not (folder / _DELIVERY).exists():
            return
        with tempfile.TemporaryFile(dir=folder) as fresh:
            clock = os.fstat(fresh.fileno()).st_mtime
        with _delivery_lock(folder):
            for box in boxes:
                with suppress(OSError):
                    _finish(box, clock)
                with suppress(OSError):  # empty, or killed before its lock existed or after it was removed
                    box.rmdir()


@contextmanager
def _output_errors(path: Path) -> Iterator[None]:
    try:
        yield
    except BrokenPipeError:  # of the standard output
        raise
    except OSError as error:
        raise OutputError(f"{path} cannot be written: {error.strerror or error}; choose another path.") from None


@contextmanager
def _partial_folder(folder: Path) -> Iterator[Path]:
    """Partial folder of this run, locked during the block and removed after it."""
    finish_killed_runs(folder)
    lock = None
    while lock is None:
        box = Path(tempfile.mkdtemp(prefix=f".partial-{_HOST}-{os.getpid()}-", dir=folder))
        with suppress(FileNotFoundError):  # another run removed the folder before its lock existed
            lock = _lock_file(box / _LOCK)
    try:
        (box / _NEW).mkdir()
        yield box
    finally:
        if (box / _READY).exists():  # a later run delivers the rest
            os.close(lock)
        else:
            _clear(box, lock)
            with suppress(OSError):
                box.rmdir()


@contextmanager
def _delivery_lock(folder: Path) -> Iterator[None]:
    """Lock that only one run holds while it moves results into a folder."""
    path, lock = folder / _DELIVERY, None
    while lock is None:
        lock = _lock_file(path, wait=True)
    try:
        yield
    finally:
        _unlock(path, lock)


def _lock_file(path: Path, *, wait: bool = False) -> int | None:
    """Descriptor of a file that stays locked until it is closed; None if another process holds the lock."""
    descriptor, is_locked = os.open(path, os.O_RDWR | os.O_CREAT, 0o666), False
    try:
        with suppress(FileNotFoundError):
            is_locked = _acquire(descriptor, wait) and os.path.samestat(os.fstat(descriptor), os.stat(path))
    finally:
        if not is_locked:
            os.close(descriptor)
    return descriptor if is_locked else None


def _acquire(descriptor: int, wait: bool = False) -> bool:
    """Lock an open file; False if another process holds the lock, True on a file system without locks."""
    try:
        return lock_descriptor(descriptor, blocking=wait, poll_interval=_POLL)
    except OSError:
        return True


def _unlock(path: Path, descriptor: int | None) -> None:
    """Remove a lock file, then release its lock: another run may lock it after that. Windows: the other way round."""
    if os.name != "nt":
        path.unlink(missing_ok=True)
    if descriptor is not None:
        os.close(descriptor)
    if os.name == "nt":
        with suppress(OSError):
            path.unlink()


def _finish(box: Path, clock: float) -> None:
    """Deliver or delete the partial folder of a run that has ended; that of a live run stays."""
    lock, is_local = None, False
    try:
        with suppress(OSError):  # no lock there, or a file system without locks
            lock = os.open(box / _LOCK, os.O_RDWR)
            if not lock_descriptor(lock, blocking=False):
                return
            is_local = box.name.startswith(f".partial-{_HOST}-")
        changes = (path.lstat().st_mtime for path in (box, *box.rglob("*")))
        if is_local or max(changes) < clock - OLD:
            _resume(box)
            _clear(box, lock)
            lock = None
    finally:
        if lock is not None:
            os.close(lock)


def _resume(box: Path) -> None:
    """Continue the delivery or the swap of a killed run."""
    if (box / _READY).exists():
        _deliver(box)
    elif (box / _BEFORE).exists():
        for new in (box / _NEW).glob("*"):
            if not os.path.lexists(box.parent / new.name):
                os.replace(new, box.parent / new.name)


def _deliver(box: Path, last: str = "") -> None:
    """Move complete files to their final paths; a second call continues the first."""
    ready, folder = box / _READY, box.parent
    for name in sorted(_files(ready), key=lambda name: name == Path(last)):
        os.replace(ready / name, folder / name)
    for obsolete in (box / _OBSOLETE).read_text(encoding="utf-8").splitlines():
        (folder / obsolete).unlink(missing_ok=True)
    _remove(ready)


def _swap(box: Path, path: Path) -> None:
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
    return sorted(path.relative_to(folder) for path in folder.rglob("*") if path.is_file())


def _clear(box: Path, lock: int | None) -> None:
    """Empty a partial folder, its lock last, so that the next run can continue after a kill."""
    for path in box.iterdir():
        if path.name != _LOCK:
            _remove(path)
    _unlock(box / _LOCK, lock)


def _remove(path: Path) -> None:
    if path.is_dir() and not path.is_symlink():
        shutil.rmtree(path)
    else:
        path.unlink(missing_ok=True)
