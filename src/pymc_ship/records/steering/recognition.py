"""Recognition of standard manoeuvres in records; rate and delay of the steering gear.

Each reversal of a zigzag: |heading at the begin| = H + delay |r|, a whole number H [deg] per run, one delay per ship.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import xarray as xr

from pymc_ship.physics.manoeuvre.registry import KINDS, either
from pymc_ship.physics.manoeuvre.standard import Manoeuvre, standard_manoeuvre
from pymc_ship.physics.manoeuvre.steering_record import (
    Reversal,
    SteeringRecord,
    approach_speed,
    rudder_reversals,
    steering_text,
    switching_headings,
    whole_heading,
)
from pymc_ship.physics.vessel.reading import VesselLike, as_vessel
from pymc_ship.physics.vessel.vessel import Vessel
from pymc_ship.records.steering.approach import approach_fault
from pymc_ship.trial.record import check_trial, facility_of, trial_list

STEERED = ("u", "r", "psi", "delta")  # channels that recognition needs
_LONGEST_DELAY = 0.2  # L/U
_USUAL_DELAY = 0.5  # of the longest; mean of the exponential prior of the delay
_DELAYS = 201
_AT_ONCE = 1000.0  # deg in L/U, quicker than any gear
_UNUSUAL = np.log(20.0)  # prior odds against a switching heading that is not a multiple of 5 deg
_ONE_SPEED = 1.1  # largest ratio of approach speeds of runs at one speed
_UNEVEN = 1.0  # deg, range of the headings at which a zigzag is reversed, beyond which they are no one order
_RESOLVED = 0.1  # deg, resolution of the heading of an order


@dataclass(frozen=True)
class Steering:
    """Rudder rate [deg/s] and delay [s] over ``n_reversals`` reversals, common approach speed [m/s]; NaN if unknown."""

    rudder_rate_deg: float
    rudder_delay: float
    n_reversals: int
    approach_speed: float = np.nan


def recognise(trials: Sequence[xr.Dataset], vessel: VesselLike) -> tuple[list[Manoeuvre | None], Steering]:
    """Recognise standard manoeuvres in trials, with rate and delay of the rudder.

    Parameters
    ----------
    trials : sequence of Dataset, dims (time,)
        With u, r, psi and delta; otherwise TrialError.
    vessel : Vessel, str or Path
        Gives L and the nominal speed, in which the longest delay is measured.

    Returns
    -------
    manoeuvres : list of Manoeuvre or None
        Of the first registered kind that recognises the record, such as a zigzag or a turning circle; None for any
        other, and for one that begins while the speed changes by more than 5 % in L/U or the ship turns.
    steering : Steering
        Medians over all reversals, and over all approaches.

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
    return _recognised(trial_list(trials), as_vessel(vessel).particulars.ship_time)


def recognised_manoeuvre(trial: xr.Dataset, unit: float) -> tuple[Manoeuvre | None, Steering]:
    """Manoeuvre and gear of one trial, as by :func:`recognise`, of a ship that covers its length in ``unit`` [s]."""
    (manoeuvre,), steering = _recognised([trial], unit)
    return manoeuvre, steering


def _recognised(trials: Sequence[xr.Dataset], unit: float) -> tuple[list[Manoeuvre | None], Steering]:
    """Manoeuvres and steering gear, as by :func:`recognise`, with L/U [s]."""
    for trial in trials:
        check_trial(trial, STEERED, uniform=False)
    by_trial = [rudder_reversals(trial) for trial in trials]
    every = [reversal for reversals in by_trial for reversal in reversals]
    zigzags = [run for run in zip(trials, by_trial, strict=True) if run[1]]
    delay = _common_delay(zigzags, _LONGEST_DELAY * unit) if every else np.nan
    rate = float(np.rad2deg(np.median([reversal.rudder_rate for reversal in every]))) if every else np.nan
    records = [SteeringRecord(trial, reversals, delay) for trial, reversals in zip(trials, by_trial, strict=True)]
    manoeuvres = [_manoeuvre(record, unit) for record in records]
    speeds = [one.approach_speed for one in manoeuvres if one is not None and one.approach_speed is not None]
    is_common = bool(speeds) and max(speeds) <= _ONE_SPEED * min(speeds)
    return manoeuvres, Steering(rate, delay, len(every), float(np.median(speeds)) if is_common else np.nan)


def recognise_by_facility(
    trials: Sequence[xr.Dataset], vessel: VesselLike
) -> tuple[list[Manoeuvre | None], dict[str, Steering]]:
    """Manoeuvres of all trials, and the steering gear by name of the facility (may be empty), most trials first."""
    names = [facility_of(trial) for trial in trials]
    manoeuvres: list[Manoeuvre | None] = [None] * len(names)
    facilities = {}
    for name in sorted(dict.fromkeys(names), key=names.count, reverse=True):
        mine = [k for k, one in enumerate(names) if one == name]
        recognised, facilities[name] = recognise([trials[k] for k in mine], vessel)
        for k, manoeuvre in zip(mine, recognised, strict=True):
            manoeuvres[k] = manoeuvre
    return manoeuvres, facilities


def unrecognised_text(trial: xr.Dataset, unit: float) -> str:
    """Sentence with the reason for which a record of a ship with L/U ``unit`` [s] is no standard manoeuvre."""
    fault = approach_fault(trial, unit)
    if fault and _kind_of(SteeringRecord(trial, rudder_reversals(trial), 0.0)):
        return f"It is no standard manoeuvre: {fault}."
    known = [kind.words for kind in KINDS.values() if kind.recognise]
    return f"It is not recognised as {either(known)}: {steering_text(trial)}."


def reversals_text(trials: Sequence[xr.Dataset], steering: Steering) -> str:
    """Sentences on the reversals behind a measured delay: its error, and those at uneven headings; empty without any.

    ``trials`` are those of the facility; a circle takes the delay over from its zigzags. The error is the rms of single
    reversals, as those of one helmsman are alike.
    """
    errors: list[float] = []
    sentences = []
    for trial in trials:
        if not (reversals := rudder_reversals(trial)):
            continue
        switch, middle = (
            one[..., 0] for one in switching_headings(trial, reversals, np.array([steering.rudder_delay]))
        )
        side = np.sign(reversals[0].heading) * (-1.0) ** np.arange(switch.size)
        changes = switch + side * middle
        rates = np.interp([one.time for one in reversals], trial["time"].values, np.abs(trial["r"].values))
        errors.extend((changes - whole_heading(switch)) / np.rad2deg(rates))
        if np.ptp(changes) > _UNEVEN:
            listed = ", ".join(f"{change:.1f}" for change in side * changes)
            sentences.append(
                f"The rudder of a zigzag is reversed at heading changes of {listed} deg from the approach, not at one "
                "to both sides: its overshoots and the delay are uncertain."
            )
    if errors and steering.rudder_delay > 0.0:
        sentences.insert(
            0,
            "The delay from order to movement, also of circles, is estimated from reversals of zigzags "
            f"({len(errors)}), with a standard error of {np.sqrt(np.mean(np.square(errors))):.2g} s.",
        )
    return " ".join(sentences)


def with_steering(vessel: Vessel, steering: Steering) -> Vessel:
    """Vessel with the measured rudder rate and delay; unchanged without a measurement.

    The rate of a rudder that moves at once is that of an order: the vessel keeps its own.
    """
    if not steering.n_reversals:
        return vessel
    measured = {"rudder_rate_deg": steering.rudder_rate_deg, "rudder_delay": steering.rudder_delay}
    if steering.rudder_rate_deg * vessel.particulars.ship_time > _AT_ONCE:
        del measured["rudder_rate_deg"]
    return replace(vessel, particulars=replace(vessel.particulars, **measured))


def _common_delay(runs: Sequence[tuple[xr.Dataset, list[Reversal]]], longest: float) -> float:
    """Posterior mode of the delay [s], for switching headings near whole numbers of degrees, rather multiples of 5."""
    delays = np.linspace(0.0, longest, _DELAYS)
    cost = delays / (_USUAL_DELAY * longest)
    for trial, reversals in runs:
        switch, _ = switching_headings(trial, reversals, delays)
        whole = np.array([whole_heading(headings) for headings in switch.T])
        square = np.mean((switch - whole) ** 2, axis=0)
        cost += 0.5 * len(switch) * np.log(square + _RESOLVED**2) + _UNUSUAL * (whole % 5 > 0)
    return float(delays[np.argmin(cost)])


def _kind_of(record: SteeringRecord) -> tuple[str, tuple[float, ...], str] | None:
    """Name, angles and side of the first kind that recognises a record."""
    for kind in KINDS.values():
        if kind.recognise and (angles_and_side := kind.recognise(record)) is not None:
            return kind.name, *angles_and_side
    return None


def _manoeuvre(record: SteeringRecord, unit: float) -> Manoeuvre | None:
    """Standard manoeuvre of a record; ``unit`` is L/U [s]."""
    recognised = _kind_of(record)
    if recognised is None or approach_fault(record.trial, unit):
        return None
    name, angles, side = recognised
    return standard_manoeuvre(name, *angles, side=side, approach_speed=approach_speed(record.trial))
