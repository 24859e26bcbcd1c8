"""Sides of the rudder that noisy records show: ``python -m tests.records.files.rudder_sides [SEEDS]``.

The records of :mod:`tests.records.checks.false_alarms`, and those of the ships of other simulators with the noise of
their sensors and of ten times that; a positive rudder turns all of them to port.
"""

from __future__ import annotations

import sys
from collections import Counter
from collections.abc import Iterator

import numpy as np
import xarray as xr

from pymc_ship.records.files import rudder_side
from tests.records.checks.false_alarms import clean_records


def shown_side(trial: xr.Dataset) -> str:
    """Side that a record shows; empty without one."""
    effect = rudder_side.shown_effect(trial)
    return effect.side if effect else ""


def noisy_records(seeds: int) -> Iterator[tuple[tuple[str, str], xr.Dataset]]:
    """Manoeuvre and noise, and the record, of every shipped vessel."""
    for name, _, trial in clean_records(seeds):
        _, manoeuvre, _, noise, _ = name.split(", ")
        yield (manoeuvre, noise), trial


def foreign_records(seeds: int) -> Iterator[tuple[tuple[str, str], xr.Dataset]]:
    """As :func:`noisy_records`, of the ships of other simulators."""
    from studies.foreign.cases import named_cases

    for name, case in named_cases().items():
        for seed in range(1, seeds + 1):
            for trial in case.records(seed):
                yield (name, "sensors"), trial
                rng = np.random.default_rng(seed)
                louder = {
                    key: (
                        "time",
                        trial[key].values + 0.1 * trial[key].values.std() * rng.standard_normal(trial.sizes["time"]),
                    )
                    for key in ("u", "v", "r", "psi", "delta")
                    if key in trial
                }
                yield (name, "10 % of the sd"), trial.assign(louder)


def main(seeds: int) -> None:
    """Print the records, those that show no side and those that show the wrong one, by manoeuvre and noise."""
    counts: dict[tuple[str, str], Counter] = {}
    for records in (noisy_records, foreign_records):
        for key, trial in records(seeds):
            counts.setdefault(key, Counter())[shown_side(trial)] += 1
    for key, sides in sorted(counts.items()):
        print(f"{', '.join(key)}: {sides.total()} records, {sides['']} without a side, {sides['starboard']} wrong")
    total = sum(counts.values(), Counter())
    print(f"{total.total()} records, {total['']} without a side, {total['starboard']} wrong")


if __name__ == "__main__":
    main(int((sys.argv[1:] or ["2"])[0]))
