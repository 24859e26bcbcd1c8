"""Turns words of the command line into values. An ArgumentTypeError says what a word should have been."""

from __future__ import annotations

import argparse
from collections.abc import Callable, Iterable
from glob import glob
from pathlib import Path

from pymc_ship.physics.manoeuvre.kinds import ManoeuvreKind

INSTRUMENTS = ("gnss", "mems_gyro", "mru", "fluxgate_compass")
"""Names of instruments, a copy of the API's, which a test holds beside them."""


def expanded(words: Iterable[str]) -> list[str]:
    """Words of a command line, with the files that a pattern such as ``trials/*.csv`` names in its place, sorted.

    Shells of Unix do so before a program starts, those of Windows do not.

    Raises
    ------
    ValueError
        When no file has such a name.
    """
    found = []
    for word in words:
        pattern = not word.startswith("-") and ("*" in word or "?" in word) and not Path(word).exists()
        files = sorted(glob(word)) if pattern else [word]
        if not files:
            raise ValueError(f"A pattern stands for the names of files, found none like {word}; mend it.")
        found += files
    return found


def seed(text: str) -> int:
    """Root of random numbers."""
    if not text.isdecimal():
        raise argparse.ArgumentTypeError(f"a seed is a whole number from 0 up, found {text!r}")
    return int(text)


def draws(text: str) -> int:
    """Number of draws, which four chains share."""
    if not text.isdecimal() or int(text) == 0 or int(text) % 4:
        raise argparse.ArgumentTypeError(f"draws come as a multiple of 4, found {text!r}")
    return int(text)


def angles(kind: ManoeuvreKind) -> Callable[[str], float | tuple[float, ...]]:
    """Reader of the angles of a kind of manoeuvre [deg]: one number, or several between slashes."""

    def read(text: str) -> tuple[float, ...]:
        try:
            values = tuple(float(angle) for angle in text.split("/"))
        except ValueError:
            values = ()
        if len(values) != len(kind.angles):
            raise argparse.ArgumentTypeError(
                f"a {kind.words} is {kind.metavar} in deg such as {kind.example}, found {text!r}"
            )
        return values

    return float if len(kind.angles) == 1 else read


def names(text: str) -> tuple[str, ...]:
    """Names between commas."""
    return tuple(name.strip() for name in text.split(",") if name.strip())


def noise(text: str) -> float | str | tuple[str, ...]:
    """Noise level, or instruments between commas."""
    given = names(text)
    if given and set(given) <= set(INSTRUMENTS):
        return given
    try:
        return text if text == "literal" else float(text)
    except ValueError:
        raise argparse.ArgumentTypeError(
            f"a noise level is a number or 'literal', or instruments of {', '.join(INSTRUMENTS)}, found {text!r}"
        ) from None


def interval(text: str) -> float | None:
    """Interval [s], None for all samples."""
    try:
        return None if text == "all" else float(text)
    except ValueError:
        raise argparse.ArgumentTypeError(f"an interval is a number of seconds or 'all', found {text!r}") from None


def flow(text: str) -> tuple[float, float]:
    """Speed [m/s] and direction [deg] of wind or current, between a slash."""
    try:
        speed, direction = (float(word) for word in text.split("/"))
    except ValueError:
        raise argparse.ArgumentTypeError(
            f"wind and current are SPEED/DIRECTION in m/s and deg such as 10/270, found {text!r}"
        ) from None
    return speed, direction
