"""What is said of the population: coverage, reliability and bands, by half, as a page in Markdown."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from matplotlib.figure import Figure
from scipy.optimize import minimize_scalar

from pymc_ship.forecasting.index_error import BEYOND
from pymc_ship.forecasting.motion_error import GROWTH
from pymc_ship.pages.drawing import BLUE, REFERENCE, RUST, styled, subplots
from tests.foreign.run import table

CHOSEN_ON = 30
"""Number of ships that :data:`pymc_ship.forecasting.index_error.BEYOND` was chosen on."""

LEADS = (1.0, 5.0, 15.0)
"""Lengths of restarted windows [L/U]."""

SUMMED = ("psi", "x", "y")
"""States whose error grows with the time that a ship stays beyond the motion of her runs."""

_NINETY = 1.6449  # sd, of an interval of 90 %

STATED = (0.75, 0.9, 0.95, 0.99)
"""Probabilities of statements "at most" and "at least" that are counted."""


@dataclass(frozen=True)
class Row:
    """An index of a forecast beside the truth, in swings of heading or L; ``beyond`` in ranges of the runs' motion.

    ``sd`` is half the width of the central 68 % of the forecast, ``pit`` the share of its draws below the truth,
    ``crps`` its continuous ranked probability score.
    """

    number: int
    hull: str
    trials: str
    manoeuvre: str
    index: str
    error: float
    lower: float
    upper: float
    sd: float
    beyond: float
    pit: float
    crps: float

    @property
    def inside(self) -> bool:
        return self.lower <= 0.0 <= self.upper

    @property
    def half(self) -> bool:
        """Whether an interval of 50 % of the normal law of this sd holds the truth."""
        return abs(self.error) < 0.6745 * self.sd


@dataclass(frozen=True)
class Bands:
    """Shares of the instants inside bands of 90 % of a ship that is restarted in a run she has not seen, by lead.

    ``motion`` is of the motion itself, ``readings`` of noisy readings in bands that hold their noise.
    """

    number: int
    lead: float
    motion: float
    readings: float


@dataclass(frozen=True)
class Moved:
    """Prime error of a state of the median ship, and its sd in the bands, some time after a restart.

    ``far`` is the distance from the motion of the runs [ranges], of heading and track its sum over time [ranges L/U];
    ``beyond`` is the distance at the instant.
    """

    number: int
    state: str
    error: float
    sd: float
    far: float
    beyond: float


def fitted_growth(moved: Sequence[Moved]) -> dict[str, float]:
    """The values of the growth of the motion's error, by state, at which the errors are most probable."""
    return {
        name: _most_probable(
            *np.array([(row.error, row.sd, row.far) for row in moved if row.state == name]).T, GROWTH[name]
        )
        for name in GROWTH
    }


def _most_probable(error: np.ndarray, sd: np.ndarray, far: np.ndarray, counted: float) -> float:
    """Growth by which errors are most probable whose sd holds a growth that was counted already."""
    known = np.maximum(sd**2 - (counted * far) ** 2, 1e-8)

    def surprise(share: float) -> float:
        variance = known + (share * far) ** 2
        return float(np.sum(0.5 * np.log(variance) + 0.5 * error**2 / variance))

    return float(minimize_scalar(surprise, bounds=(0.0, 0.1), method="bounded").x)


def moved_rows(moved: Sequence[Moved]) -> list[list[str]]:
    """Share of instants at which the motion lies in bands of 90 %, within the runs and beyond them, by state."""
    found = []
    for name in GROWTH:
        mine = [row for row in moved if row.state == name]
        cells = []
        for low, high in ((-1.0, 0.0), (0.0, 1.0), (1.0, math.inf)):
            held = [abs(row.error) <= _NINETY * row.sd for row in mine if low < row.beyond <= high]
            cells += [f"{100 * np.mean(held):.0f} of {len(held)}" if held else ""]
        far = [
            (abs(row.error), math.sqrt(max(row.sd**2 - (GROWTH[name] * row.far) ** 2, 0.0)))
            for row in mine
            if row.beyond > 1.0
        ]
        without = f"{100 * np.mean([error <= _NINETY * sd for error, sd in far]):.0f}" if far else ""
        found.append([name, *cells, without])
    return found


def fitted_beyond(rows: Sequence[Row]) -> float:
    """The value of BEYOND at which the errors are most probable."""
    return _most_probable(*np.array([(row.error, row.sd, row.beyond) for row in rows]).T, BEYOND)


_RESTARTED = (
    "Ships restarted every two L/U in a circle of 35 deg and a 15/15 zigzag that they were not given. Counted are "
    "instants of the motion in bands of the motion, and readings of noisy sensors in bands that hold their noise:"
)

_MOVED = (
    "Errors of the motion 1 to 15 L/U after a restart, every four L/U. Instants in bands of 90 %, by the distance from "
    "the runs at that instant [% of instants]."
)

_GROUPS: Mapping[str, Callable[[Row], str]] = {
    "all": lambda row: "all",
    "trials": lambda row: row.trials,
    "hull": lambda row: row.hull,
    "index": lambda row: f"{row.manoeuvre.split()[0]}, {row.index.replace('_', ' ')}",
    "beyond": lambda row: "within one range of the runs" if row.beyond < 1.0 else "one range beyond them or more",
}


def coverage_rows(rows: Sequence[Row]) -> list[list[str]]:
    """Coverage of 95 and 50 % with its standard error over ships, errors and widths, by group."""
    found = []
    for key in _GROUPS.values():
        for name in sorted({key(row) for row in rows}):
            mine = [row for row in rows if key(row) == name]
            ships = [[row for row in mine if row.number == number] for number in sorted({row.number for row in mine})]
            shares = [np.mean([row.inside for row in ship]) for ship in ships]
            error = np.std(shares, ddof=1) / math.sqrt(len(shares)) if len(shares) > 1 else math.nan
            inside, half = (np.mean([getattr(row, of) for row in mine]) for of in ("inside", "half"))
            z = math.sqrt(np.mean([(row.error / row.sd) ** 2 for row in mine]))
            size, width = np.median([(abs(row.error), 1.96 * row.sd) for row in mine], axis=0)
            crps = np.mean([row.crps for row in mine])
            line = [
                name,
                str(len(ships)),
                str(len(mine)),
                f"{100 * inside:.0f}{f' ± {100 * error:.0f}' if error > 0.0 else ''}",
            ]
            found.append([*line, f"{100 * half:.0f}", f"{z:.2f}", f"{size:.3f}", f"{width:.3f}", f"{crps:.4f}"])
    return found


def reliability_rows(rows: Sequence[Row]) -> list[list[str]]:
    """Statements "at most" and "at least" by the probability they were made with, and the share of them that held.

    A share has its standard error over ships.
    """
    found = []
    for head, key in (("within one range", False), ("one range beyond or more", True), ("all", None)):
        mine = [row for row in rows if key is None or (row.beyond >= 1.0) == key]
        if mine:
            held = _by_ship(mine, STATED)
            error = held.std(axis=0, ddof=1) / math.sqrt(len(held)) if len(held) > 1 else np.full(len(STATED), math.nan)
            shares = zip(100 * _held(mine, STATED), 100 * error, strict=True)
            found.append([head, str(2 * len(mine)), *(f"{share:.1f} ± {off:.1f}" for share, off in shares)])
    return found


def borne_out(rows: Sequence[Row]) -> tuple[int, int]:
    """Statements of 99 % on indices beyond the motion of the runs: those that held, and all."""
    beyond = [row for row in rows if row.beyond > 0.0]
    return sum((row.pit <= 0.99) + (row.pit >= 0.01) for row in beyond), 2 * len(beyond)


@styled
def reliability_figure(rows: Sequence[Row]) -> Figure:
    """Share of the statements "at most" and "at least" that held, by the probability they were made with."""
    fig, axes = subplots(4.4, 3.8)
    ax, stated = axes[0, 0], np.linspace(0.5, 0.995, 100)
    ax.plot(stated, stated, color=REFERENCE, ls="--", lw=0.9, label="as stated")
    for label, colour, key in (("within one range of the runs", BLUE, False), ("beyond", RUST, True)):
        mine = [row for row in rows if (row.beyond >= 1.0) == key]
        held = _by_ship(mine, stated)
        mean, error = held.mean(axis=0), held.std(axis=0, ddof=1) / math.sqrt(len(held))
        ax.plot(stated, mean, color=colour, label=label)
        ax.fill_between(stated, mean - error, np.minimum(mean + error, 1.0), color=colour, alpha=0.2, lw=0.0)
    ax.set_xlabel("probability stated")
    ax.set_ylabel("share that held, ± standard error over ships")
    ax.legend(loc="upper left")
    return fig


def _held(rows: Sequence[Row], stated: Sequence[float]) -> np.ndarray:
    """Share of the statements to both sides that held, by probability."""
    pit, stated = np.array([[row.pit] for row in rows]), np.asarray(stated)
    return 0.5 * (np.mean(pit <= stated, axis=0) + np.mean(pit >= 1.0 - stated, axis=0))


def _by_ship(rows: Sequence[Row], stated: Sequence[float]) -> np.ndarray:
    """The same of each ship, shape (n_ships, n_stated)."""
    ships = sorted({row.number for row in rows})
    return np.array([_held([row for row in rows if row.number == number], stated) for number in ships])


def band_rows(bands: Sequence[Bands]) -> list[list[str]]:
    """Shares of instants inside bands of 90 % by lead, of motion and readings, with standard errors over ships."""
    found = []
    for lead in LEADS:
        held = np.array([(one.motion, one.readings) for one in bands if one.lead == lead])
        if not held.size:
            continue
        error = held.std(axis=0, ddof=1) / math.sqrt(len(held)) if len(held) > 1 else np.full(2, math.nan)
        shares = [f"{100 * mean:.0f} ± {100 * off:.0f}" for mean, off in zip(held.mean(axis=0), error, strict=True)]
        worst = [f"{100 * share:.0f}" for share in held.min(axis=0)]
        found.append([f"{lead:g}", str(len(held)), shares[0], worst[0], shares[1], worst[1]])
    return found


def page(
    rows: Sequence[Row],
    bands: Sequence[Bands],
    moved: Sequence[Moved],
    refusals: Mapping[int, str],
    command: str,
    about: str,
) -> str:
    """Both halves of the population as a page in Markdown."""
    heads = (
        "",
        "ships",
        "indices",
        "95 % hold %",
        "50 % hold %",
        "rms of error / sd",
        "median error",
        "half width",
        "CRPS",
    )
    halves = {
        f"Ships that BEYOND was chosen on, numbers below {CHOSEN_ON}": range(CHOSEN_ON),
        f"Ships that show it, from number {CHOSEN_ON} on": range(CHOSEN_ON, 10**6),
    }
    stated = ("forecast", "statements", *(f"{100 * one:g} %" for one in STATED))
    lead = ("window [L/U]", "ships", "motion in 90 % bands [%]", "the worst ship", "readings [%]", "the worst ship")
    parts = [
        "# A population of foreign ships",
        f"`{command}`. {' '.join(about.split())}",
        "Errors and half widths are in L for distances and in swings of the heading for overshoots; ± is the standard "
        "error over ships.",
    ]
    for head, numbers in halves.items():
        mine, held, went = ([one for one in every if one.number in numbers] for every in (rows, bands, moved))
        if mine:
            best = f"Of these ships alone BEYOND would be {fitted_beyond(mine):.4f}; it is {BEYOND:g}."
            parts += [f"## {head}", best, table(heads, coverage_rows(mine))]
            parts += ['Statements "at most" and "at least", with the probability they were made with, that held [%]:']
            parts += [table(stated, reliability_rows(mine))]
            parts += [_RESTARTED]
            parts += [table(lead, band_rows(held))]
        if went:
            grown = ", ".join(f"{name} {value:.4f} ({GROWTH[name]:g})" for name, value in fitted_growth(went).items())
            parts += [f"{_MOVED} Of these ships alone the growth would be (and is): {grown}."]
            parts += [
                table(("state", "within", "up to one range beyond", "further", "without the growth"), moved_rows(went))
            ]
    held, made = borne_out([row for row in rows if row.number >= CHOSEN_ON])
    if made:
        parts += [f"Of {made} statements of 99 % on indices beyond the motion of the runs {held} held."]
    parts += [f"Ship {number} was refused: {text}" for number, text in refusals.items()]
    return "\n\n".join(parts) + "\n"
