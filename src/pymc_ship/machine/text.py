"""UTF-8 text of user files, plain or gzip; an error names what the file is instead."""

import codecs
import gzip
import io
import stat
import zlib
from pathlib import Path

MOST_BYTES = 2**27
"""Largest size of a text, decompressed: a day of 20 channels at 10 Hz. It bounds the memory of a reader to 2 GB."""

LONGEST_LINE = 2**20  # bytes in which the first line of a text ends

SPECIAL_FILES = {
    stat.S_IFCHR: "a device",
    stat.S_IFBLK: "a device",
    stat.S_IFIFO: "a pipe",
    stat.S_IFSOCK: "a socket",
}
"""Paths that are neither a file nor a folder, by the type of their mode."""

_MARKS = {codecs.BOM_UTF32_LE: "UTF-32", codecs.BOM_UTF16_LE: "UTF-16", codecs.BOM_UTF16_BE: "UTF-16"}


class TextError(ValueError):
    """A file whose text cannot be read; the message is the end of a sentence, with the remedy."""


def file_text(path: str | Path) -> str:
    """UTF-8 text of a file, plain or gzip; TextError for any other file, or for more than :data:`MOST_BYTES`."""
    path = Path(path)
    if "\0" in str(path):
        raise TextError("its name has a zero byte; check the path")
    try:
        kind = SPECIAL_FILES.get(stat.S_IFMT(path.stat().st_mode))
        if kind:
            raise TextError(f"it is {kind}, which may never end; copy its text to a file")
        with path.open("rb") as file:
            return utf8(_text_bytes(file))
    except (EOFError, zlib.error, gzip.BadGzipFile) as error:
        raise TextError(f"its gzip data are damaged ({error}); copy it again") from None
    except OSError as error:
        raise TextError(f"{error.strerror or error}; check the path") from None


def _text_bytes(file: io.BufferedReader) -> bytes:
    packed = file.peek(2)[:2] == b"\x1f\x8b"
    stream = gzip.GzipFile(fileobj=file) if packed else file
    raw = stream.read(LONGEST_LINE + 1)
    if len(raw) > LONGEST_LINE and b"\n" not in raw and b"\r" not in raw and b"\0" not in raw:
        raise TextError(f"its first line has more than {LONGEST_LINE} bytes; give a text with line ends")
    raw += stream.read(MOST_BYTES + 1 - len(raw))
    if len(raw) > MOST_BYTES:
        raise TextError(f"its text has more than {MOST_BYTES / 1e6:.0f} MB; split it, or leave out columns or rows")
    return raw


def utf8(raw: bytes) -> str:
    """Text of a UTF-8 file, with or without byte order mark; TextError for UTF-16, UTF-32, other bytes or a NUL."""
    for mark, name in _MARKS.items():
        if raw.startswith(mark):
            raise TextError(f"it is {name} text; save it as UTF-8")
    position = raw.find(b"\0")
    if position >= 0:
        line = raw[:position].count(b"\n") + 1
        raise TextError(f"it is UTF-16 text or no text, line {line} has a zero byte; save it as UTF-8")
    try:
        return raw.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        line = raw[: error.start].count(b"\n") + 1
        raise TextError(f"it is not UTF-8 text, line {line}; save it as UTF-8") from None
