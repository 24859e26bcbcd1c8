"""Sides of the rudder that noisy records show: ``python -m tests.records.files.rudder_sides [SEEDS]``.

The records of :mod:`tests.records.checks.false_alarms`; manoeuvres of the ships of other simulators in calm water, wind
and current, with the noise of their sensors and of ten per cent; and a random third of each record. A positive rudder
turns all of them to port.
"""

from __future__ import annotations

import sys
from collections import Counter
from collections.abc import Iterator
from dataclasses import replace

import numpy as np
import xarray as xr

from pymc_ship.records.files import sides
from tests.records.checks.false_alarms import clean_records


def shown_side(trial: xr.Dataset) -> str:
    """Side that a record shows; empty without one."""
    effect = sides.shown_effect(trial)
    return effect.side if effect else ""


def noisy_records(seeds: int, every: int = 1) -> Iterator[tuple[tuple[str, str], xr.Dataset]]:
    """Manoeuvre and noise, and the record, of every shipped vessel; of every so many records the first."""
    for name, _, trial in clean_records(seeds, every):
        _, manoeuvre, _, noise, _ = name.split(", ")
        yield (manoeuvre, noise), trial


def foreign_records(seeds: int) -> Iterator[tuple[tuple[str, str], xr.Dataset]]:
    """As :func:`noisy_records`, of the ships of other simulators."""
    from studies.foreign.cases import named_cases
    from studies.foreign.sailing import Trial

    sailed = (
        Trial("zigzag", 10.0, 10.0, "port"),
        Trial("zigzag", 20.0, 20.0, "starboard"),
        Trial("circle", 35.0, side="starboard"),
        Trial("pull-out", 20.0, 90.0, "port"),
    )
    cases = [case for name, case in named_cases().items() if not name.endswith(("two", "no-propeller"))]
    for case in cases:
        for seed in range(1, seeds + 1):
            for trial, record in zip(sailed, replace(case, trials=sailed).records(seed), strict=True):
                manoeuvre = " ".join(trial.label.split()[:2]).replace("circle", "turn")
                yield (manoeuvre, "none" if case.sensors is None else "sensors"), record
                yield (manoeuvre, "10 %"), _louder(record, np.random.default_rng(seed))


def _louder(record: xr.Dataset, rng: np.random.Generator) -> xr.Dataset:
    """Record with noise of a tenth of the standard deviation of each channel."""
    names = [name for name in ("u", "v", "r", "psi", "delta") if name in record]
    noise = {name: 0.1 * float(record[name].std()) * rng.standard_normal(record.sizes["time"]) for name in names}
    return record.assign({name: ("time", record[name].values + noise[name]) for name in names})


def with_thirds(records: Iterator[tuple[tuple[str, str], xr.Dataset]]) -> Iterator[tuple[tuple[str, str], xr.Dataset]]:
    """Records, and a third of each from a random instant on."""
    rng = np.random.default_rng(39)
    for (manoeuvre, noise), trial in records:
        yield (manoeuvre, noise), trial
        third = trial.sizes["time"] // 3
        begin = int(rng.integers(0, trial.sizes["time"] - third))
        yield (f"a third of {manoeuvre}", noise), trial.isel(time=slice(begin, begin + third))


def main(seeds: int) -> None:
    """Print the records, those that show no side and those that show the wrong one, by manoeuvre and noise."""
    counts: dict[tuple[str, str], Counter] = {}
    for records in (noisy_records, foreign_records):
        for key, trial in with_thirds(records(seeds)):
            if not trial["delta"].values.any():
                continue
            counts.setdefault(key, Counter())[shown_side(trial)] += 1
    for key, by_side in sorted(counts.items()):
        print(
            f"{', '.join(key)}: {by_side.total()} records, {by_side['']} without a side, {by_side['starboard']} wrong"
        )
    total = sum(counts.values(), Counter())
    print(f"{total.total()} records, {total['']} without a side, {total['starboard']} wrong")


if __name__ == "__main__":
    main(int((sys.argv[1:] or ["2"])[0]))
