"""UTF-8 text of user files; an error names the encoding of another file."""

from __future__ import annotations

import codecs

_MARKS = {codecs.BOM_UTF32_LE: "UTF-32", codecs.BOM_UTF16_LE: "UTF-16", codecs.BOM_UTF16_BE: "UTF-16"}


class EncodingError(ValueError):
    """A file that is no UTF-8 text; the message is the end of a sentence, with the remedy."""


def utf8(raw: bytes) -> str:
    """Text of a UTF-8 file, with or without byte order mark; EncodingError for UTF-16, UTF-32, other bytes or a NUL."""
    for mark, name in _MARKS.items():
        if raw.startswith(mark):
            raise EncodingError(f"it is {name} text; save it as UTF-8")
    position = raw.find(b"\0")
    if position >= 0:
        line = raw[:position].count(b"\n") + 1
        raise EncodingError(f"it is UTF-16 text or no text, line {line} has a zero byte; save it as UTF-8")
    try:
        return raw.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        line = raw[: error.start].count(b"\n") + 1
        raise EncodingError(f"it is not UTF-8 text, line {line}; save it as UTF-8") from None
