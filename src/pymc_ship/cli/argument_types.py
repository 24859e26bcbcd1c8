"""Values of command line arguments; an ArgumentTypeError has the rule, the argument and the remedy."""

import argparse
from collections.abc import Callable, Iterable
from glob import glob
from pathlib import Path

from pymc_ship.physics.manoeuvre.kinds import ManoeuvreKind

INSTRUMENTS = ("gnss", "mems_gyro", "mru", "fluxgate_compass")
"""Names of instruments, as in :data:`pymc_ship.records.files.instruments.INSTRUMENTS`, without its import."""


def expand_patterns(words: Iterable[str]) -> list[str]:
    """Arguments with each pattern such as ``trials/*.csv`` as its sorted files; ValueError if it has none."""
    arguments = []
    for word in words:
        pattern = not word.startswith("-") and ("*" in word or "?" in word) and not Path(word).exists()
        files = sorted(glob(word)) if pattern else [word]
        if not files:
            raise ValueError(f"A pattern must match at least one file, found none for {word}; correct it.")
        arguments += files
    return arguments


def seed(text: str) -> int:
    """Seed of the random numbers."""
    if not text.isdecimal():
        raise argparse.ArgumentTypeError(f"a seed must be a whole number from 0 up, found {text!r}")
    return int(text)


def draws(text: str) -> int:
    """Number of draws of four chains together."""
    if not text.isdecimal() or int(text) == 0 or int(text) % 4:
        raise argparse.ArgumentTypeError(f"draws must be a positive multiple of 4, found {text!r}")
    return int(text)


def angles(kind: ManoeuvreKind) -> Callable[[str], float | tuple[float, ...]]:
    """Parser of the angles of a kind of manoeuvre [deg]: one number, or several with slashes between."""

    def parse(text: str) -> tuple[float, ...]:
        try:
            values = tuple(float(angle) for angle in text.split("/"))
        except ValueError:
            values = ()
        if len(values) != len(kind.angles):
            raise argparse.ArgumentTypeError(
                f"a {kind.words} must be {kind.metavar} [deg] such as {kind.example}, found {text!r}"
            )
        return values

    return float if len(kind.angles) == 1 else parse


def names(text: str) -> tuple[str, ...]:
    """Names with commas between."""
    return tuple(name.strip() for name in text.split(",") if name.strip())


def noise(text: str) -> float | str | tuple[str, ...]:
    """Noise level, or names of instruments with commas between."""
    instruments = names(text)
    if instruments and set(instruments) <= set(INSTRUMENTS):
        return instruments
    try:
        return text if text == "literal" else float(text)
    except ValueError:
        raise argparse.ArgumentTypeError(
            f"noise must be a level, 'literal' or instruments of {', '.join(INSTRUMENTS)}, found {text!r}"
        ) from None


def interval(text: str) -> float | str:
    """Interval of rows [s], "all" or "auto"."""
    try:
        return text if text in ("all", "auto") else float(text)
    except ValueError:
        words = "an interval must be a number of seconds, 'all' or 'auto'"
        raise argparse.ArgumentTypeError(f"{words}, found {text!r}") from None


def flow(text: str) -> tuple[float, float]:
    """Speed [m/s] and direction [deg] of wind or current, with a slash between."""
    try:
        speed, direction = (float(word) for word in text.split("/"))
    except ValueError:
        raise argparse.ArgumentTypeError(
            f"wind and current must be SPEED/DIRECTION [m/s, deg] such as 10/270, found {text!r}"
        ) from None
    return speed, direction
