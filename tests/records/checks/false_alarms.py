"""False alarms of the checks on clean records: ``python -m tests.records.checks.false_alarms [SEEDS]``.

Every shipped vessel, two integrators, six manoeuvres and five kinds of noise, and two noises in a current; a finding
on any of these records is a false alarm. In a current, the checks that name one may do so.
"""

from __future__ import annotations

import sys
from collections import Counter
from itertools import count, product
from pathlib import Path

import numpy as np

import pymc_ship as ps
from tests.records.checks.cases import alarms, checks_by_name

ROOT = Path(__file__).parents[3]
VESSELS = sorted([*ROOT.glob("models/*.toml"), *ROOT.glob("studies/vessels/*.toml")])
MANOEUVRES = {
    "zigzag 10/10": ps.zigzag(10.0, 10.0),
    "zigzag 20/20": ps.zigzag(20.0, 20.0, side="starboard"),
    "zigzag 10/5": ps.zigzag(10.0, 5.0),
    "turn 35": ps.turning_circle(35.0, side="starboard"),
    "turn 20": ps.turning_circle(20.0),
    "steps": None,
}
NOISE = {"none": None, "0.2 %": 0.002, "1 %": 0.01, "3 %": 0.03, "instruments": ("gnss", "mems_gyro", "mru")}
CURRENTS = {"": None, "current along": 0.0, "current abeam": 90.0, "current from ahead": 200.0}  # direction [deg]
OF_A_CURRENT = {"heading offset", "speed", "track closure"}
IGNORED = {"sampling", "noise", "resolution", "approach", "ranges"}  # of the trial, not of an error in the record


def steps(L_over_U: float):
    """Straight, then the rudder to random angles for two L/U each, after Araki et al. (2012)."""
    angles = np.deg2rad([0.0, *np.random.default_rng(5).uniform(-25.0, 25.0, 12)])
    time = 2.0 * L_over_U * np.arange(13.0)
    return ps.rudder_programme(np.ravel([time, time + 2.0 * L_over_U - 0.01], "F"), np.repeat(angles, 2))


def clean_records(seeds: int, every: int = 1):
    """Name, vessel and record, 14 L/U or more with 30 samples each; of every so many records the first."""
    turn = count()
    for path in VESSELS:
        vessel = ps.load_vessel(path)
        ship_time = vessel.particulars.L / vessel.particulars.nominal_speed
        for (name, manoeuvre), method in product(MANOEUVRES.items(), ("rk4", "euler")):
            interval = max(0.1, round(ship_time / 30.0, 1))
            duration = interval * round((26.0 if name == "steps" else 15.0) * ship_time / interval)
            made = {"step": interval} if method == "euler" else {"record_interval": interval}
            sailed, runs = manoeuvre or steps(ship_time), {}
            for (water, direction), (label, noise), seed in product(CURRENTS.items(), NOISE.items(), range(seeds)):
                if water and (label not in ("none", "1 %") or method == "euler"):
                    continue
                variants = ((), ("v",), ("r",))[: 1 + 2 * (seed % 2)]
                chosen = [dropped for dropped in variants if next(turn) % every == 0]
                if chosen and water not in runs:
                    flow = (0.06 * vessel.particulars.nominal_speed, direction) if water else None
                    runs[water] = ps.simulate(vessel, sailed, duration=duration, method=method, current=flow, **made)
                if not chosen or runs[water]["diverged"]:
                    continue
                run = runs[water]
                rng = np.random.default_rng(seed)
                kind = {"level": noise} if isinstance(noise, float) else {"noise": noise}
                trial = ps.pollute(run, **kind, rng=rng) if noise else run
                trial = trial.interpolate_na("time", fill_value="extrapolate")
                for dropped in chosen:
                    title = f"{path.stem}, {name}, {method}, {f'{label} {water}'.strip()}, without {dropped}"
                    yield title, vessel, trial.drop_vars(dropped)


def main(seeds: int) -> None:
    """Print the share of records with a false alarm, and each alarm."""
    count, alarmed, by_check = 0, 0, Counter()
    for name, vessel, trial in clean_records(seeds):
        checks = checks_by_name(trial, vessel)
        found = alarms(checks) - IGNORED - (OF_A_CURRENT if "current" in name else set())
        count, alarmed = count + 1, alarmed + bool(found)
        by_check.update(found)
        for check in sorted(found):
            print(f"{name}: {check}: {checks[check].sentence}")
    print(f"{alarmed} of {count} clean records have a false alarm: {dict(by_check)}")


if __name__ == "__main__":
    main(int((sys.argv[1:] or ["4"])[0]))
