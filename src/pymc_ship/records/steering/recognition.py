"""Which standard manoeuvre a record is, and how the steering gear carried it out.

A zigzag's rudder is reversed a delay after the heading has changed by a whole number of degrees. Each reversal gives
one equation, |heading when the rudder begins to move| = H + delay |r|; the delay is the same in all runs of a ship.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import xarray as xr

from pymc_ship.physics.manoeuvre.registry import KINDS, either
from pymc_ship.physics.manoeuvre.standard import Manoeuvre, standard_manoeuvre
from pymc_ship.physics.manoeuvre.steering_record import (
    SteeringRecord,
    Swings,
    approach_speed,
    rudder_reversals,
    steering_text,
    swings,
    whole_heading,
)
from pymc_ship.physics.vessel.reading import VesselLike, as_vessel
from pymc_ship.physics.vessel.vessel import Vessel
from pymc_ship.trial.record import check_trial, facility_of, trial_list

STEERED = ("u", "r", "psi", "delta")
"""Channels that tell how a ship was steered."""

_LONGEST_DELAY = 0.2  # L/U
_USUAL_DELAY = 0.5  # of the longest; mean of the exponential law of a delay before it is measured
_DELAYS = 201
_UNUSUAL = np.log(20.0)  # of a switching heading that is no multiple of 5 deg: one zigzag in 20
_ONE_SPEED = 1.1  # quickest over slowest approach of runs at one speed
_RESOLVED = 0.1  # deg, to which the heading of an order is known


@dataclass(frozen=True)
class Steering:
    """How the ship was steered in some runs, NaN where none shows it.

    ``rudder_rate_deg`` [deg/s] and ``rudder_delay`` [s] of the steering gear over ``n_reversals`` movements;
    ``approach_speed`` [m/s] of recognised manoeuvres, where they have one within a tenth: the revolutions of the runs
    hold it.
    """

    rudder_rate_deg: float
    rudder_delay: float
    n_reversals: int
    approach_speed: float = np.nan


def recognise(trials: Sequence[xr.Dataset], vessel: VesselLike) -> tuple[list[Manoeuvre | None], Steering]:
    """Recognise the standard manoeuvres among trials and measure how the rudder was steered.

    Parameters
    ----------
    trials : sequence of Dataset, dims (time,)
        With u, r, psi and delta.
    vessel : Vessel, str or Path
        Gives L and the nominal speed, in which the longest delay is measured.

    Returns
    -------
    manoeuvres : list of Manoeuvre or None
        Of the first of :data:`pymc_ship.physics.manoeuvre.registry.KINDS` that recognises the record, such as a zigzag
        or a turning circle, at the speed and side of the record; None for any other rudder record.
    steering : Steering
        Medians over all reversals, and over all approaches.

    Raises
    ------
    TrialError
        For a trial that lacks a channel.

    Examples
    --------
    >>> import pymc_ship as ps
    >>> vessel = ps.load_vessel("kvlcc2")
    >>> trial = ps.simulate(vessel, ps.zigzag(20, 20), duration=600, step=0.5)
    >>> (manoeuvre,), steering = ps.recognise([trial], vessel)
    >>> manoeuvre.kind, manoeuvre.rudder_deg, manoeuvre.heading_deg, manoeuvre.side
    ('zigzag', 20.0, 20.0, 'port')
    >>> print(f"{steering.rudder_rate_deg:.2f} deg/s")
    2.35 deg/s
    """
    vessel, trials = as_vessel(vessel), trial_list(trials)
    for trial in trials:
        check_trial(trial, STEERED, uniform=False)
    found = [rudder_reversals(trial) for trial in trials]
    every = [reversal for reversals in found for reversal in reversals]
    unit = vessel.particulars.ship_time
    swung = [swings(trial, reversals) for trial, reversals in zip(trials, found, strict=True) if reversals]
    delay = _common_delay(swung, _LONGEST_DELAY * unit) if every else np.nan
    rate = float(np.rad2deg(np.median([reversal.rudder_rate for reversal in every]))) if every else np.nan
    helms = [SteeringRecord(trial, reversals, delay) for trial, reversals in zip(trials, found, strict=True)]
    manoeuvres = [_manoeuvre(helm) for helm in helms]
    return manoeuvres, Steering(rate, delay, len(every), _common_speed(manoeuvres))


def recognise_by_facility(
    trials: Sequence[xr.Dataset], vessel: VesselLike
) -> tuple[list[Manoeuvre | None], dict[str, Steering]]:
    """Manoeuvres of all trials, and how the rudder was steered at each facility.

    Parameters and errors as :func:`recognise`.

    Returns
    -------
    manoeuvres : list of Manoeuvre or None
    facilities : dict of str to Steering
        By name, that with the most trials first; the name is empty where the trials state none.
    """
    names = [facility_of(trial) for trial in trials]
    manoeuvres: list[Manoeuvre | None] = [None] * len(names)
    facilities = {}
    for name in sorted(dict.fromkeys(names), key=names.count, reverse=True):
        mine = [k for k, one in enumerate(names) if one == name]
        found, facilities[name] = recognise([trials[k] for k in mine], vessel)
        for k, manoeuvre in zip(mine, found, strict=True):
            manoeuvres[k] = manoeuvre
    return manoeuvres, facilities


def unrecognised_text(trial: xr.Dataset) -> str:
    """Sentence on a record in which :func:`recognise` finds no manoeuvre, with the reason."""
    known = [kind.words for kind in KINDS.values() if kind.recognise]
    return f"It is not recognised as {either(known)}: {steering_text(trial)}."


def with_steering(vessel: Vessel, steering: Steering) -> Vessel:
    """Vessel whose rudder moves as it was measured to; unchanged where nothing was measured."""
    if not steering.n_reversals:
        return vessel
    measured = {"rudder_rate_deg": steering.rudder_rate_deg, "rudder_delay": steering.rudder_delay}
    return replace(vessel, particulars=replace(vessel.particulars, **measured))


def _common_speed(manoeuvres: Sequence[Manoeuvre | None]) -> float:
    """Median speed [m/s] of the approaches; NaN where they differ, or there are none."""
    speeds = [one.approach_speed for one in manoeuvres if one is not None and one.approach_speed is not None]
    return float(np.median(speeds)) if speeds and max(speeds) <= _ONE_SPEED * min(speeds) else np.nan


def _common_delay(runs: Sequence[Swings], longest: float) -> float:
    """Delay [s] of the steering gear.

    With this delay the switching headings of a run are equal and nearest to whole degrees, if possible to multiples of
    five: the mode of a posterior in which each run has a scatter of its own, so that runs steered by hand say little.
    """
    delays = np.linspace(0.0, longest, _DELAYS)
    cost = delays / (_USUAL_DELAY * longest)
    for run in runs:
        switch, _ = run.switching_headings(delays)
        whole = np.array([whole_heading(headings) for headings in switch.T])
        square = np.mean((switch - whole) ** 2, axis=0)
        cost += 0.5 * len(switch) * np.log(square + _RESOLVED**2) + _UNUSUAL * (whole % 5 > 0)
    return float(delays[np.argmin(cost)])


def _manoeuvre(helm: SteeringRecord) -> Manoeuvre | None:
    for kind in KINDS.values():
        found = kind.recognise(helm) if kind.recognise else None
        if found is not None:
            angles, side = found
            return standard_manoeuvre(kind.name, *angles, side=side, approach_speed=approach_speed(helm.trial))
    return None
