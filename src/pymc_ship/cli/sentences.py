"""The line on standard error by which a command line says why it cannot run."""

from __future__ import annotations

LONGEST = 600
"""Characters of a line at most: seven or eight lines of a terminal."""

_END = 200


def sentence(text: str) -> str:
    """One printable line that ends with a full stop.

    What is too long loses its middle: the begin says what is wrong, the end what to do.
    """
    line = "".join(letter if letter.isprintable() else "?" for letter in " ".join(text.split()))
    line = f"pymc-ship: {line.removesuffix('.')}."
    if len(line) <= LONGEST:
        return line
    return f"{line[: LONGEST - _END - 5]} ... {line[-_END:]}"
