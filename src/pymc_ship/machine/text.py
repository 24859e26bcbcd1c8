"""UTF-8 text of user files, plain or gzip; an error names what the file is instead."""

import codecs
import gzip
import io
import stat
import zlib
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

MOST_BYTES = 2**27
"""Largest size of a text, decompressed: a day of 20 channels at 10 Hz. It bounds the memory of a reader to 2 GB."""

MOST_BLOCKS = 2**32
"""Largest size of a text that is read in blocks, decompressed: an hour of 100 columns at 1 kHz, minutes to read."""

_BLOCK = 2**23  # bytes that are text at a time

LONGEST_LINE = 2**20  # bytes in which the first line of a text ends

SPECIAL_FILES = {stat.S_IFCHR: "a device", stat.S_IFBLK: "a device", stat.S_IFIFO: "a pipe", stat.S_IFSOCK: "a socket"}
"""Paths that are neither a file nor a folder, by the type of their mode."""

_MARKS = {codecs.BOM_UTF32_LE: "UTF-32", codecs.BOM_UTF16_LE: "UTF-16", codecs.BOM_UTF16_BE: "UTF-16"}


class TextError(ValueError):
    """A file whose text cannot be read; the message is the end of a sentence, with the remedy."""


def file_text(path: str | Path) -> str:
    """UTF-8 text of a file, plain or gzip; TextError for any other file, or for more than :data:`MOST_BYTES`."""
    with _opened(path) as stream:
        raw = _begin(stream)
        raw += stream.read(MOST_BYTES + 1 - len(raw))
        if len(raw) > MOST_BYTES:
            raise _too_large(MOST_BYTES)
        return utf8(raw)


def text_size(path: str | Path) -> tuple[int, int]:
    """Bytes of the text of a file, plain or gzip, and its number of line ends; TextError as by :func:`text_blocks`."""
    n_bytes = n_lines = n_returns = 0
    with _opened(path) as stream:
        for raw in _raw_blocks(stream):
            n_bytes, n_lines, n_returns = n_bytes + len(raw), n_lines + raw.count(b"\n"), n_returns + raw.count(b"\r")
    return n_bytes, max(n_lines, n_returns)


def text_blocks(path: str | Path) -> Iterator[str]:
    """UTF-8 text of a file, plain or gzip, in blocks of whole lines.

    TextError for any other file, for one of more than :data:`MOST_BLOCKS` bytes, and for a line without end.
    """
    with _opened(path) as stream:
        yield from map(utf8, _raw_blocks(stream))


@contextmanager
def _opened(path: str | Path) -> Iterator[io.BufferedIOBase]:
    """Bytes of a file, decompressed; TextError for what is no file, or is damaged."""
    path = Path(path)
    if "\0" in str(path):
        raise TextError("its name has a zero byte; check the path")
    try:
        kind = SPECIAL_FILES.get(stat.S_IFMT(path.stat().st_mode))
        if kind:
            raise TextError(f"it is {kind}, which may never end; copy its text to a file")
        with path.open("rb") as file:
            packed = file.peek(2)[:2] == b"\x1f\x8b"
            yield gzip.GzipFile(fileobj=file) if packed else file
    except (EOFError, zlib.error, gzip.BadGzipFile) as error:
        raise TextError(f"its gzip data are damaged ({error}); copy it again") from None
    except OSError as error:
        raise TextError(f"{error.strerror or error}; check the path") from None


def _too_large(most: int) -> TextError:
    return TextError(f"its text has more than {most / 1e6:.0f} MB; split it, or leave out columns or rows")


def _begin(stream: io.BufferedIOBase) -> bytes:
    """First bytes of a text, whose first line ends among them."""
    raw = stream.read(LONGEST_LINE + 1)
    if len(raw) > LONGEST_LINE and b"\n" not in raw and b"\r" not in raw and b"\0" not in raw:
        raise TextError(f"its first line has more than {LONGEST_LINE} bytes; give a text with line ends")
    return raw


def _raw_blocks(stream: io.BufferedIOBase) -> Iterator[bytes]:
    """Bytes of whole lines, some at a time."""
    raw = _begin(stream)
    size = len(raw)
    while more := stream.read(_BLOCK):
        raw, size = raw + more, size + len(more)
        if size > MOST_BLOCKS:
            raise _too_large(MOST_BLOCKS)
        end = max(raw.rfind(b"\n"), -1 if b"\n" in raw else raw.rfind(b"\r", 0, -1)) + 1
        if len(raw) - end > _BLOCK:
            utf8(raw)  # says what a file without lines is, if it is no text
            raise TextError(f"one of its lines has more than {_BLOCK} bytes; give a text with line ends")
        if end:
            yield raw[:end]
        raw = raw[end:]
    if raw:
        yield raw


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
