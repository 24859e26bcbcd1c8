"""Esso Osaka: three sets of runs forecast the others, and what measured wind and revolutions are worth.

Usage: python -m studies.esso_osaka DATA --out reports/esso_osaka

DATA is the folder of the records (docs/case_studies/esso_osaka.md). Each set of runs identifies the ship and forecasts
the other runs. One set does so again without the measured wind, the revolutions, and both.
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

import numpy as np
import pandas as pd
import xarray as xr

import pymc_ship as ps
from pymc_ship.cli.files import Outcome, Progress
from pymc_ship.cli.main import run_command
from pymc_ship.machine.files import staged_path, writable_folder
from pymc_ship.ships.identification.replay import index_errors
from studies.command_line import study_parser

CASE = Path(__file__).parents[1] / "docs" / "case_studies" / "esso_osaka"
RANDOM = ("random/*_25_4", "random/*_25_5", "random/*_25_6")
ZIGZAGS = ("zigzag/*13_22_52", "zigzag/*13_29_19", "zigzag/*13_50_28", "zigzag/*13_57_45", "zigzag/*14_03_39")
SETS = {
    "TRZ": ("random tests, circle, two zigzags", (*RANDOM, "turning/*16_09_02", ZIGZAGS[0], ZIGZAGS[2])),
    "TR": ("random tests, two circles", (*RANDOM, "turning/*15_58_08", "turning/*16_09_02")),
    "Z": ("five zigzags", ZIGZAGS),
}
"""Runs of each identification, by the authors of the records, and the zigzags alone."""

WITHOUT = {
    "revolutions": ("wind_speed", "wind_direction"),
    "wind": ("n",),
    "neither": ("wind_speed", "wind_direction", "n"),
}
"""Inputs that are left, and the channels that are dropped."""

WINDOW, EVERY = 100.0, 20.0  # s, of the protocol
STATES = {"u": "u", "v": "v", "r": "r", "heading": "psi", "position": "position"}


def records(folder: Path, vessel: ps.Vessel) -> dict[str, xr.Dataset]:
    """Checked and corrected records, by path below the folder."""
    paths = sorted(folder.glob("*/*.csv.gz"))
    trials = [ps.read_trial(path, format=CASE / "records.toml") for path in paths]
    names = [str(path.relative_to(folder)) for path in paths]
    return {name: ps.validated_trial(trial, vessel, any_speed=True) for name, trial in zip(names, trials, strict=True)}


def score_row(ship: ps.Ship, trials: dict[str, xr.Dataset], trained_on: str, inputs: str) -> dict[str, object]:
    """Score by state and the coverage of the bands of 90 %, over runs weighted alike."""
    scores = ps.score(ship, [*trials.values()], names=[*trials], length=WINDOW, every=EVERY)
    relative = {name: float(scores["relative"].sel(channel=channel).mean()) for name, channel in STATES.items()}
    row = {"trained_on": trained_on, "inputs": inputs, "score": f"{scores.attrs['score']:.3f}"}
    row |= {name: f"{value:.2f}" for name, value in relative.items()}
    return row | {
        "bands_90": f"{100.0 * float(scores['coverage'].mean()):.0f}",
        "diverged": int(scores["diverged"].sum()),
    }


def index_row(ship: ps.Ship, trials: dict[str, xr.Dataset], trained_on: str) -> dict[str, object]:
    """Mean errors of the indices of circles [%], and how many of all indices lie in their intervals of 95 %."""
    rows = index_errors(ps.score_indices(ship, [*trials.values()], names=[*trials], rng=2020))
    judged = [row for row in rows if row["inside"]]
    circles = {row["run"] for row in rows if row["manoeuvre"].startswith("turning circle")}
    kinds = {"circles" if row["run"] in circles else "zigzags" for row in rows}
    row: dict[str, object] = {
        "trained_on": trained_on,
        "trials": SETS[trained_on][0],
        "forecast": ", ".join(sorted(kinds)),
    }
    row["circles"] = len(circles)
    for index in ("advance", "tactical diameter", "transfer"):
        errors = [abs(line["error"] / line["measured"]) for line in rows if line["index"] == index]
        row[f"{index.replace(' ', '_')}_error"] = f"{100.0 * np.mean(errors):.3g}"
    return row | {"inside": sum(line["inside"] == "yes" for line in judged), "indices": len(judged)}


def tables(folder: Path, progress: Progress) -> tuple[list[dict], list[dict]]:
    """Rows of the scores and of the indices."""
    vessel = ps.load_vessel(CASE / "esso_osaka.toml")
    trials = records(folder, vessel)
    scores, indices, without = [], [], []
    for name, (_, patterns) in SETS.items():
        used = {path for path in trials if any(Path(path).match(f"{pattern}.csv.gz") for pattern in patterns)}
        others = {path: trial for path, trial in trials.items() if path not in used}
        cases = {"revolutions and wind": ()} | (WITHOUT if name == "TRZ" else {})
        for inputs, dropped in cases.items():
            progress(f"identifying from {name} by {inputs}")
            runs = [trials[path].drop_vars(dropped) for path in sorted(used)]
            ship = ps.identify_ship(runs, vessel, names=sorted(used), rng=np.random.default_rng(2020)).ship
            row = score_row(ship, {path: trial.drop_vars(dropped) for path, trial in others.items()}, name, inputs)
            (without if dropped else scores).append(row)
            if not dropped:
                indices.append(index_row(ship, others, name))
    return [*scores, *without], indices


def parser() -> argparse.ArgumentParser:
    """Words of the command line of the study."""
    words = study_parser("esso_osaka", "forecast runs of the Esso Osaka from others, with and without measured inputs")
    words.add_argument("data", type=Path, help="folder of the records")
    words.add_argument("--out", type=Path, required=True, help="folder of the tables")
    return words


def esso_osaka(args: argparse.Namespace, progress: Progress) -> Outcome:
    """Identify, score and write both tables."""
    folder = writable_folder(args.out)
    files = [folder / f"{name}.csv" for name in ("scores", "indices")]
    for file, rows in zip(files, tables(args.data, progress), strict=True):
        with staged_path(file) as path:
            pd.DataFrame(rows).to_csv(path, index=False, lineterminator="\n")
    return "\n".join(file.read_text(encoding="utf-8") for file in files), folder


if __name__ == "__main__":
    sys.exit(run_command(parser(), esso_osaka))
