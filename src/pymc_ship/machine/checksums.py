"""Checksums that results carry (SHA-256, FIPS 180-4), so that damage is found before a number of them is used.

Libraries that read damaged NetCDF or HDF5 files may give other numbers without a word, raise anything or end the whole
process; a checksum is asked first.
"""

from __future__ import annotations

import hashlib
import json
import os
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any, BinaryIO

_MARK = b"pymc-ship sha256 "
_BLOCK = 1 << 20


def append_checksum(path: str | Path) -> None:
    """Append the checksum of a file to it: its last 81 bytes then, which readers of NetCDF and HDF5 pass over."""
    with Path(path).open("r+b") as file:
        found = _digest(file, file.seek(0, os.SEEK_END))
        file.seek(0, os.SEEK_END)
        file.write(_MARK + found.encode())


def has_valid_checksum(path: str | Path) -> bool:
    """Whether a file that ends with a checksum is what it was; a file that carries none passes.

    Raises
    ------
    OSError
        When the file cannot be read.
    """
    with Path(path).open("rb") as file:
        size = file.seek(0, os.SEEK_END) - len(_MARK) - 2 * hashlib.sha256().digest_size
        if size < 0:
            return True
        file.seek(size)
        end = file.read()
        return not end.startswith(_MARK) or end == _MARK + _digest(file, size).encode()


def folder_checksum(folder: str | Path, names: Iterable[str | Path], said: Mapping[str, Any]) -> str:
    """Checksum of files of a folder, by their names, and of what an index of them says.

    Parameters
    ----------
    folder : str or Path
    names : iterable of str or Path
        Places of the files in the folder, in any order.
    said : mapping
        Content of the index, of JSON types; the checksum itself is not in it.

    Raises
    ------
    OSError
        When a file cannot be read.
    """
    whole = hashlib.sha256(json.dumps(said, sort_keys=True).encode())
    for name in sorted(Path(name).as_posix() for name in names):
        with (Path(folder) / name).open("rb") as file:
            whole.update(f"\n{name} {hashlib.file_digest(file, 'sha256').hexdigest()}".encode())
    return whole.hexdigest()


def _digest(file: BinaryIO, size: int) -> str:
    """Digest of the first bytes of an open file; its position is kept where it was."""
    place, found = file.tell(), hashlib.sha256()
    file.seek(0)
    while size > 0 and (block := file.read(min(_BLOCK, size))):
        found.update(block)
        size -= len(block)
    file.seek(place)
    return found.hexdigest()
