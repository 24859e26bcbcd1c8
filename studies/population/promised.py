"""The width ratio of a next run, promised and achieved, on ships of a population identified with and without it.

    python3 -m studies.population.promised

Each ship is one of ``studies/ships.toml`` with two 10/10 zigzags. The third run has weather of its own.
"""

from __future__ import annotations

import numpy as np

import pymc_ship as ps
from pymc_ship.experiments.run import read_study
from studies.population import DrawnShip
from studies.population.study import TrialsCell

STUDY, TRIALS, SEEDS = "studies/ships.toml", "10/10 to both sides", range(6)
THIRD = (ps.zigzag(10, 10), ps.zigzag(20, 20), ps.turning_circle(35))


def main() -> None:
    """Identify every ship without and with each run, and print the width ratio of the intervals."""
    study = read_study(STUDY)
    print(f"{'ship':14s}" + "".join(f"{third.label:>24s}" for third in THIRD) + "   promised, kept")
    ratios = []
    for seed in SEEDS:
        task = study.task(TrialsCell(TRIALS), seed)
        drawn = task.draw(task.rng("ship of a population"))
        runs = [drawn.record(manoeuvre, k) for k, manoeuvre in enumerate(task.sailed())]
        before = identified(drawn, runs)
        plan = ps.design(before, THIRD)
        row = []
        for third in THIRD:
            after = identified(drawn, [*runs, drawn.record(third, len(runs))])
            widths = plan["half_width"][0], ps.design(after, [third])["half_width"][0]
            promised = float(plan["width_ratio"].sel(step=1, candidate=third.label))
            row.append((promised, float(np.exp(np.log(widths[1] / widths[0]).mean()))))
        ratios.append(row)
        print_row(drawn.hull, row)
    print_row("geometric mean", np.exp(np.mean(np.log(ratios), axis=0)))


def print_row(ship: str, ratios: list | np.ndarray) -> None:
    """One ship's width ratios, promised and kept, a pair for each third run."""
    print(f"{ship:14s}" + "".join(f"{promised:18.2f}, {kept:4.2f}" for promised, kept in ratios), flush=True)


def identified(drawn: DrawnShip, runs: list) -> ps.Ship:
    """The ship from its records."""
    trials = [ps.validated_trial(run, drawn.vessel) for run in runs]
    return ps.identify_ship(trials, drawn.vessel, draws=400, rng=1).ship


if __name__ == "__main__":
    main()
