"""SHA-256 checksums of result files (FIPS 180-4): readers of damaged NetCDF or HDF5 may return wrong numbers."""

import hashlib
import json
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

_MARK = b"pymc-ship sha256 "
_BLOCK = 1 << 20


def append_checksum(path: str | Path) -> None:
    """Append the checksum of a file to it: 81 bytes, which readers of NetCDF and HDF5 ignore."""
    digest = _digest(Path(path), Path(path).stat().st_size)
    with Path(path).open("ab") as file:
        file.write(_MARK + digest)


def has_valid_checksum(path: str | Path) -> bool:
    """Whether a file agrees with the checksum at its end; True for a file without one."""
    size = Path(path).stat().st_size - len(_MARK) - 2 * hashlib.sha256().digest_size
    if size < 0:
        return True
    with Path(path).open("rb") as file:
        file.seek(size)
        end = file.read()
    return not end.startswith(_MARK) or end == _MARK + _digest(Path(path), size)


def folder_checksum(folder: str | Path, names: Iterable[str | Path], index: Mapping[str, Any]) -> str:
    """Checksum of files of a folder and of their index (JSON types), which does not contain it."""
    digest = hashlib.sha256(json.dumps(index, sort_keys=True).encode())
    for name in sorted(Path(name).as_posix() for name in names):
        with (Path(folder) / name).open("rb") as file:
            digest.update(f"\n{name} {hashlib.file_digest(file, 'sha256').hexdigest()}".encode())
    return digest.hexdigest()


def _digest(path: Path, size: int) -> bytes:
    digest = hashlib.sha256()
    with path.open("rb") as file:
        while block := file.read(min(_BLOCK, size)):
            digest.update(block)
            size -= len(block)
    return digest.hexdigest().encode()
