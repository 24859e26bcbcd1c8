"""Text files of the user: UTF-8, and a word on what else a file is."""

from __future__ import annotations

import codecs

_MARKS = {codecs.BOM_UTF32_LE: "UTF-32", codecs.BOM_UTF16_LE: "UTF-16", codecs.BOM_UTF16_BE: "UTF-16"}


class EncodingError(ValueError):
    """What a file is instead of UTF-8 text, as the end of a sentence, with the remedy."""


def utf8(raw: bytes) -> str:
    """Text of a file of UTF-8, with or without a byte order mark.

    Raises
    ------
    EncodingError
        For UTF-16 and UTF-32 by their byte order mark, bytes that are no UTF-8, and a NUL, which no text has.
    """
    for mark, name in _MARKS.items():
        if raw.startswith(mark):
            raise EncodingError(f"it is {name} text; save it as UTF-8")
    place = raw.find(b"\0")
    if place >= 0:
        line = raw[:place].count(b"\n") + 1
        raise EncodingError(f"it is UTF-16 text or no text, line {line} has a zero byte; save it as UTF-8")
    try:
        return raw.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        line = raw[: error.start].count(b"\n") + 1
        raise EncodingError(f"it is not UTF-8 text, line {line}; save it as UTF-8") from None
