"""Ships whose prior is wrong: identified with Student's t and with the normal law as the prior of each coefficient.

    python -m studies.population.wrong_prior

Four ships of the second half of the population have sailed a 20/20 and a 10/10 zigzag. The prior of N_v, the moment by
which drift turns a ship, is moved by some of its standard deviations in every term set.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import replace
from unittest.mock import patch

import numpy as np

from pymc_ship.experiments.run import read_study
from pymc_ship.inference.trajectory import prior
from pymc_ship.inference.trajectory.prior import CoefficientPrior
from pymc_ship.physics.vessel.vessel import coefficient_names
from pymc_ship.ships.identification import candidates
from studies.population.coverage import columns_of, coverage_row
from studies.population.judged_ship import INDEX, judge
from studies.population.study import TrialsCell

STUDY = "studies/ships.toml"
TRIALS = "20/20 and 10/10"
SEEDS = range(5, 9)
NORMAL = 1e9  # degrees of freedom
CASES = ((0.0, prior.FREEDOM), (20.0, prior.FREEDOM), (20.0, NORMAL))  # prior sd by which the prior is off
YAW_BY_DRIFT = "Nv"


def main() -> None:
    """Judge every ship by every law and print what holds."""
    study, whose = read_study(STUDY), {"trials": TRIALS, "first": False}
    print("prior of N_v   law          95 % hold  50 % hold   CRPS  half width  identified in s")
    for sd, freedom in CASES:
        with patch.object(prior, "FREEDOM", freedom), wrong_by(sd):
            ships = [judge(replace(study.task(TrialsCell(TRIALS), seed), astern=0.0)) for seed in SEEDS]
        found = coverage_row(columns_of([ship | whose for ship in ships], "indices", INDEX))
        where, law = f"{sd:g} sd off" if sd else "as it is", "normal" if freedom == NORMAL else "Student's t"
        shares, seconds = f"{found['hold_95']:9.0f} {found['hold_50']:10.0f}", np.mean([s["identify"] for s in ships])
        width = f"{found['crps']:6.3f} {found['half_width']:11.3f}"
        print(f"{where:14s} {law:12s} {shares} {width} {seconds:16.0f}", flush=True)


@contextmanager
def wrong_by(sd: float) -> Iterator[None]:
    """Every term set has its prior of N_v moved by so many of its standard deviations."""
    stated: Callable[..., CoefficientPrior] = candidates.window_prior

    def moved(trials, vessel, kind):
        known, names = stated(trials, vessel, kind), coefficient_names(vessel)
        shift = np.array([-sd if name == YAW_BY_DRIFT else 0.0 for name in names])
        return replace(known, mean=known.mean + shift * known.scale)

    with patch.object(candidates, "stated_prior", moved):
        yield


if __name__ == "__main__":
    main()
