"""Manoeuvres that may be worth running next: standard tests and rudder programmes drawn at random, by label."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from pymc_ship.machine.seeds import Seed, random_generator
from pymc_ship.physics.manoeuvre.standard import (
    Manoeuvre,
    direct_spiral,
    held_angles,
    pull_out,
    turning_circle,
    zigzag,
)
from pymc_ship.physics.vessel.parts import ship_of
from pymc_ship.physics.vessel.reading import VesselLike, as_vessel
from pymc_ship.ships.forecasting.stopping import StoppingTest, knows_astern

NextRun = Manoeuvre | StoppingTest
"""What may be sailed next."""


def candidate_trials(vessel: VesselLike, *, duration: float = 400.0, rng: Seed) -> dict[str, NextRun]:
    """Manoeuvres worth considering for a next run, by label.

    Parameters
    ----------
    vessel : Vessel, str or Path
        Its nominal speed, and half of it, are the approach speeds.
    duration : float, optional
        Of the rudder programmes [s]; a spiral holds each of its 13 angles for about a thirteenth.
    rng : int, SeedSequence or Generator
        Draws the programmes: angles of up to 35 deg held for 8 to 30 s, and 20 deg to either side held for multiples
        of 10 s, in whole degrees and seconds.

    Returns
    -------
    dict of str to Manoeuvre or StoppingTest
        A stopping test at the nominal revolutions astern where the vessel's forces hold there.

    Examples
    --------
    >>> import numpy as np
    >>> import pymc_ship as ps
    >>> candidates = ps.candidate_trials(ps.load_vessel("kvlcc2"), rng=np.random.default_rng(1))
    >>> candidates["zigzag 35/20 port"].heading_deg, len(candidates)
    (20.0, 11)
    """
    rng = random_generator(rng)
    vessel = as_vessel(vessel)
    half = 0.5 * vessel.particulars.nominal_speed
    manoeuvres = [
        *(zigzag(*angles) for angles in ((35, 35), (35, 20), (20, 20), (10, 10))),
        zigzag(20, 20, approach_speed=half),
        turning_circle(35),
        pull_out(20, 90),
    ]
    largest, step = 15, 5
    spiral = direct_spiral(largest, step, hold=float(round(duration / (4 * largest // step + 1))))
    steps, binary = (lambda: (rng.integers(8, 31), rng.integers(-35, 36))), (lambda: (10, 20 * rng.choice((-1, 1))))
    stops = [StoppingTest(ship_of(vessel).n)] if knows_astern(vessel) else []
    return {
        "random steps 35": _programme(steps, duration, None),
        f"random steps 35 from {half:g} m/s": _programme(steps, duration, half),
        "random binary 20": _programme(binary, duration, None),
        f"direct spiral {largest}/{step}": spiral,
    } | labelled_trials([*manoeuvres, *stops])


def _programme(draw, duration: float, approach_speed: float | None) -> Manoeuvre:
    """Rudder programme of (dwell [s], angle [deg]) drawn until the duration is filled."""
    dwells, angles = [], []
    while sum(dwells) < duration:
        dwell, angle = draw()
        dwells.append(float(dwell))
        angles.append(angle)
    return held_angles(angles, dwells, approach_speed=approach_speed)


def labelled_trials(manoeuvres: Mapping[str, NextRun] | Sequence[NextRun]) -> dict[str, NextRun]:
    """Manoeuvres by label.

    A manoeuvre without a label is named by kind, angles and speed, and by a number where a name repeats.
    """
    if isinstance(manoeuvres, Mapping):
        return dict(manoeuvres)
    labelled: dict[str, NextRun] = {}
    for one in manoeuvres:
        label = one.label + (f" from {one.approach_speed:g} m/s" if one.approach_speed else "")
        same = sum(name.split(" #")[0] == label for name in labelled)
        labelled[f"{label} #{same + 1}" if same else label] = one
    return labelled
