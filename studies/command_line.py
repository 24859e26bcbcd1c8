"""Command lines of the studies: words, errors and exit status as those of ``pymc-ship``."""

from __future__ import annotations

from pymc_ship.cli.parser import Parser


def study_parser(name: str, description: str) -> Parser:
    """Parser of ``python -m studies.NAME``."""
    words = Parser(prog=f"python -m studies.{name}", description=description)
    words.add_argument("--quiet", action="store_true", help="no progress and no remarks; results and errors only")
    return words
