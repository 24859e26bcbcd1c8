"""The line on standard error that explains why a command cannot run."""

from __future__ import annotations

LONGEST = 600
"""Largest number of characters of an error line."""

_END = 200


def sentence(text: str) -> str:
    """One printable line with a full stop; a long text loses its middle, since its end has the remedy."""
    line = "".join(character if character.isprintable() else "?" for character in " ".join(text.split()))
    line = f"pymc-ship: {line.removesuffix('.')}."
    if len(line) <= LONGEST:
        return line
    return f"{line[: LONGEST - _END - 5]} ... {line[-_END:]}"
