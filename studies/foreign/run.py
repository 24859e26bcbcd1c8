"""Identify every foreign ship from its trials and score forecasts against its own motion: ``make foreign``.

The judged manoeuvres are circles of 35 deg and 15/15 zigzags to both sides in calm water. An index hits where the
interval of 95 % holds it. A case that is refused counts as not identified, and all of its indices as missed.
"""

from __future__ import annotations

import argparse
import tempfile
import time
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import Path

import numpy as np

import pymc_ship as ps
from pymc_ship.machine.files import staged_path, writable_folder
from studies.foreign import sailing
from studies.foreign.cases import SHIPS, Case, named_cases

ROOT = Path(__file__).resolve().parents[2]
GOALS = (
    "Goals: every case identified, 93 % of indices inside, median error of the tactical diameter 4 %, median half "
    "width 12 %."
)
_HEADER = ("case", "manoeuvre", "index", "truth", "median", "lower", "upper", "error %", "half width %", "inside")


@dataclass(frozen=True)
class Score:
    """An index of a judged manoeuvre: the truth beside the forecast; distances [L], overshoots [deg]."""

    manoeuvre: str
    index: str
    truth: float
    median: float
    lower: float
    upper: float

    @property
    def inside(self) -> bool:
        """Whether the interval holds the truth."""
        return self.lower <= self.truth <= self.upper

    @property
    def error(self) -> float:
        """Relative."""
        return self.median / self.truth - 1.0

    @property
    def half_width(self) -> float:
        """Over the truth."""
        return 0.5 * (self.upper - self.lower) / abs(self.truth)


@dataclass(frozen=True)
class Result:
    """What became of a case: its scores, or the sentence of its refusal."""

    case: str
    scores: tuple[Score, ...] = ()
    refusal: str = ""
    seconds: float = 0.0


@cache
def truths(ship: str) -> dict[str, dict[str, float]]:
    """Indices of the judged manoeuvres of a ship by label."""
    return sailing.truth(SHIPS[ship]())


def judged(case: Case, *, seed: int, draws: int) -> Result:
    """Identify a case and score it."""
    begin = time.perf_counter()
    try:
        with tempfile.TemporaryDirectory() as folder:
            path = Path(folder) / "vessel.toml"
            path.write_text(case.vessel_file(), encoding="utf-8")
            trials = [ps.validated_trial(record, path) for record in case.records(seed)]
            ship = ps.identify_ship(trials, path, rng=seed, draws=draws).ship
        scores = tuple(score for trial in sailing.JUDGED for score in scored(case, ship, trial, seed))
    except ValueError as error:
        return Result(case.name, refusal=str(error), seconds=time.perf_counter() - begin)
    return Result(case.name, scores, seconds=time.perf_counter() - begin)


def scored(case: Case, ship: ps.Ship, trial: sailing.Trial, seed: int) -> list[Score]:
    """Forecast a judged manoeuvre and compare it with the truth."""
    if trial.kind == "circle":
        manoeuvre, unit = ps.turning_circle(trial.rudder, side=trial.side), ship.vessel.particulars.L
    else:
        manoeuvre, unit = ps.zigzag(trial.rudder, trial.heading, side=trial.side), 1.0
    bands = ps.forecast(ship, manoeuvre, rng=seed)["index_bands"]
    found = []
    for name, truth in truths(case.ship)[trial.label].items():
        ends = {band: float(bands[name].sel(band=band)) / unit for band in ("median", "lower", "upper")}
        found.append(Score(trial.label, name, truth / unit, **ends))
    return found


def table(header: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    """A table in Markdown."""
    lines = [header, ["---"] * len(header), *rows]
    return "\n".join(f"| {' | '.join(row)} |" for row in lines)


def rows_of(result: Result) -> list[list[str]]:
    """Rows of the table of a case."""
    rows = []
    for score in result.scores:
        numbers = [f"{value:.3g}" for value in (score.truth, score.median, score.lower, score.upper)]
        numbers += [f"{100.0 * score.error:+.1f}", f"{100.0 * score.half_width:.1f}", "yes" if score.inside else "NO"]
        rows.append([result.case, score.manoeuvre, score.index.replace("_", " "), *numbers])
    return rows


def of_diameters(results: Sequence[Result]) -> tuple[float, float]:
    """Median |error| and median half width of the tactical diameters [%], NaN where there is none."""
    scores = [score for result in results for score in result.scores if score.index == "tactical_diameter"]
    if not scores:
        return np.nan, np.nan
    pairs = np.array([(abs(score.error), score.half_width) for score in scores])
    error, width = 100.0 * np.median(pairs, axis=0)
    return float(error), float(width)


def line_of(result: Result) -> list[str]:
    """Row of a case in the summary."""
    if result.refusal:
        return [result.case, "no", "0", "", "", "", f"{result.seconds:.0f}", result.refusal.replace("|", "\\|")]
    error, width = of_diameters([result])
    every = 100.0 * np.median([score.half_width for score in result.scores])
    inside = f"{sum(score.inside for score in result.scores)} of {len(result.scores)}"
    return [result.case, "yes", inside, f"{error:.1f}", f"{width:.1f}", f"{every:.1f}", f"{result.seconds:.0f}", ""]


def summary(results: Sequence[Result]) -> str:
    """Cases identified, share of indices inside, error and width of the tactical diameter."""
    scores = [score for result in results for score in result.scores]
    identified = sum(not result.refusal for result in results)
    total = sum(len(indices) for indices in truths("kvlcc2").values()) * len(results)
    inside = sum(score.inside for score in scores)
    error, width = of_diameters(results)
    share = 100.0 * inside / len(scores) if scores else np.nan
    return (
        f"{identified} of {len(results)} cases identified; {inside} of {len(scores)} indices inside ({share:.0f} %; "
        f"{100.0 * inside / total:.0f} % with those of refused cases); tactical diameter: median |error| {error:.1f} "
        f"%, median half width {width:.1f} %."
    )


def page(results: Sequence[Result], seed: int) -> str:
    """All results as a page in Markdown."""
    heads = ("case", "identified", "inside", "error of TD, size %", "half width of TD %", "of all %", "s", "refusal")
    parts = [
        "# Foreign ships",
        f"`make foreign`, seed {seed}. {' '.join((__doc__ or '').split('``make foreign``.')[1].split())}",
        f"{summary(results)}\n\n{GOALS}",
        table(heads, map(line_of, results)),
        "## Every index\n\nDistances in lengths of the ship, overshoots in degrees.",
        table(_HEADER, [row for result in results for row in rows_of(result)]),
    ]
    return "\n\n".join(parts) + "\n"


def main(words: Sequence[str] | None = None) -> int:
    """Run the cases one after the other; the page is written where all of them ran."""
    cases = named_cases()
    parser = argparse.ArgumentParser(prog="python -m studies.foreign.run", description=__doc__)
    parser.add_argument("--case", action="append", choices=cases, metavar="NAME", help=f"one of {', '.join(cases)}")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--draws", type=int, default=1000, help="of each identified ship")
    parser.add_argument("--out", type=Path, default=ROOT / "reports" / "foreign", help="folder of the page")
    arguments = parser.parse_args(words)
    results = []
    for name in arguments.case or cases:
        results.append(judged(cases[name], seed=arguments.seed, draws=arguments.draws))
        print(f"{name}, {results[-1].seconds:.0f} s")
        print(results[-1].refusal or table(_HEADER, rows_of(results[-1])), flush=True)
    print(summary(results))
    if not arguments.case:
        with staged_path(writable_folder(arguments.out) / "foreign.md") as path:
            path.write_text(page(results, arguments.seed), encoding="utf-8")
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
