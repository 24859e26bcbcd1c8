"""Check a trial before it is fitted, and correct what is certain; each check builds on the corrections before it."""

from collections.abc import Callable, Collection, Iterable, Mapping
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np
import xarray as xr

from pymc_ship.machine.arguments import check_choice, check_flags, check_kind, name_list
from pymc_ship.machine.errors import TrialError
from pymc_ship.physics.vessel.reading import VesselLike, as_vessel
from pymc_ship.physics.vessel.vessel import Vessel
from pymc_ship.records.checks import excitation, kinematics, plausibility, record_quality, rudder, track
from pymc_ship.records.checks.lag import (
    VelocityLag,
    lag_check,
    lag_correction,
    lag_of,
    late_misfit,
    rival_of_lever,
    without_lag,
)
from pymc_ship.records.checks.mistakes import COURSE, changed
from pymc_ship.records.checks.revolutions_and_wind import from_first_course_text, revolutions_check, wind_check
from pymc_ship.records.checks.verdicts import Check, not_checked
from pymc_ship.records.files.ship_scale import ship_scale
from pymc_ship.records.steering.stopping_tests import stopping_order
from pymc_ship.trial.channels import SIMULATED, channel_names
from pymc_ship.trial.quality_flags import with_quality_flags, worst_verdict
from pymc_ship.trial.record import as_trial, check_trial

_LARGEST = 1e12
_OF_THE_TRIAL = ("sampling", "noise", "resolution", "approach", "ranges")  # checks of a trial, not of an error in it
_FIRST = ("yaw rate", "heading", "speed")  # checks without which the velocities are not compared with the track


def trial_checks(
    trial: xr.Dataset, vessel: VesselLike | None = None, *, lag: VelocityLag | None = None, any_speed: bool = False
) -> tuple[Check, ...]:
    """Check a trial.

    Parameters
    ----------
    trial : Dataset, dims (time,)
        Any of u, v [m/s], r, p [rad/s], phi, psi, delta [rad], x, y [m], n [1/s], ``wind_speed`` [m/s],
        ``wind_direction`` [rad] and ``delta_command`` [rad]; uniform time [s]. p and phi of 0 throughout count as
        missing.
    vessel : Vessel, str or Path, optional
        Gives L, speed, rudder rate and terms. Without it, L/U is taken from the tightest turn.
    lag : VelocityLag, optional
        Lag of the velocities in all runs of the facility, see :func:`.common_lag`; by default that of this record.
    any_speed : bool, optional
        Whether the model to be fitted covers rest and astern, too; the record is then not cut to a piece ahead.

    Returns
    -------
    tuple of Check
        ``name``, ``verdict`` ("good", "not checked", "doubtful" or "bad"), ``sentence``, ``numbers`` (name, value,
        unit) and ``mendable``. A check is made of the trial as the mendable ones before it leave it.

    Raises
    ------
    TrialError
        For NaN, time not uniform, fewer than 20 samples, none of the channels or values beyond 1e12.

    Examples
    --------
    A rate gyro that is off by 1e-3 rad/s:

    >>> import pymc_ship as ps
    >>> vessel = ps.load_vessel("kvlcc2")
    >>> trial = ps.simulate(vessel, ps.zigzag(20, 20), duration=600, step=0.5)
    >>> for check in ps.trial_checks(trial.assign(r=trial["r"] + 1e-3), vessel):
    ...     if check.verdict == "doubtful":
    ...         print(f"{check.name}: {check.sentence}")
    gyro offset: r has an offset of +0.0573 deg/s against psi, 16 deg in 5 L/U; subtract it.
    """
    vessel = None if vessel is None else as_vessel(vessel)
    if lag is not None:
        check_kind("lag", lag, VelocityLag, "give one of common_lag, or leave it out", TrialError)
    check_flags(TrialError, any_speed=any_speed)
    _check_record(as_trial(trial))
    recorded = record_quality.recorded(trial)
    trial = trial.drop_vars([name for name in SIMULATED if name in trial and name not in recorded])
    stops = bool(np.isfinite(stopping_order(trial)))
    if stops and rudder.is_amidships(trial):
        trial = trial.drop_vars("delta")
    checks: list[Check] = []
    for check in (record_quality.stand_in_check, record_quality.spike_check, record_quality.wrap_check):
        checks.append(check(trial))
        trial = _apply_corrections(trial, checks[-1:])
    scale = ship_scale(trial, vessel)
    checks += [record_quality.jump_check(trial, scale), record_quality.sign_check(trial)]
    checks += [record_quality.sampling_check(trial, scale), record_quality.gap_check(trial)]
    unused = channel_names(lambda channel: vessel is not None and "roll" not in vessel.dofs and channel.rolling)
    used = trial[["u"]] if stops else trial.drop_vars(unused, errors="ignore")  # the ship that stops need not turn
    checks += [record_quality.noise_check(used), record_quality.resolution_check(used)]
    frozen = record_quality.frozen_check(trial, scale)
    checks.append(frozen)
    trial = record_quality.without_still_channels(trial, frozen)
    scale = ship_scale(trial, vessel)
    trial, closure = _closure_checks(trial, vessel, lag)
    yaw = next(check.verdict for check in closure if check.name == "yaw rate")
    checks += closure
    plausible = plausibility.plausibility_check(trial, scale, vessel)
    if plausible.verdict == "bad":
        piece = not_checked("motion ahead", "the motion must be that of a ship first")
    else:
        piece = plausibility.piece_check(trial, scale, any_speed=any_speed)
    checks += [plausible, piece]
    trial = _apply_corrections(trial, [piece])
    checks += _rudder_checks(trial, vessel, yaw)
    scale = ship_scale(trial, vessel)
    checks += [revolutions_check(trial, vessel), wind_check(trial, scale)]
    checks += [excitation.approach_check(trial, scale), excitation.range_check(trial, scale)]
    checks += excitation.excitation_checks(trial, vessel)
    return tuple(checks)


def _check_record(trial: xr.Dataset) -> None:
    """Raise TrialError for a record that no check can be made of."""
    names = [name for name in SIMULATED if name in trial]
    check_trial(trial, names or ("u",))
    if trial["time"].size < 20:
        raise TrialError(f"A trial is checked from 20 samples up, found {trial['time'].size}; use a longer record.")
    for name in names:
        largest = float(np.abs(trial[name].values).max())
        if largest > _LARGEST:
            raise TrialError(
                f"Channel {name} must be that of a ship, found {largest:.3g}; correct it, or state it as missing."
            )


def _closure_checks(
    trial: xr.Dataset, vessel: Vessel | None, lag: VelocityLag | None
) -> tuple[xr.Dataset, list[Check]]:
    """Trial with what the closure mends, and the checks."""
    scale = ship_scale(trial, vessel)
    checks = [*kinematics.rate_checks(trial, scale, "r", "psi"), *kinematics.rate_checks(trial, scale, "p", "phi")]
    checks[0], speed = kinematics.clock_checks(checks[0], kinematics.speed_check(trial, scale))
    heading = kinematics.heading_check(trial, scale)
    checks += [heading, speed, kinematics.heading_offset_check(trial, scale)]
    trial = _apply_corrections(trial, checks)
    wrong = [check.name for check in checks if check.verdict == "bad" and check.name in _FIRST]
    if wrong:
        reason = f"{' and '.join(wrong)} must be right first"
        names = ("velocity axes", "sway sign", "velocity lag", "lever arm", "track closure")
        return trial, checks + [not_checked(name, reason) for name in names]
    axes = track.axes_checks(trial, scale, partial(late_misfit, scale))
    trial = _apply_corrections(trial, axes)
    if "bad" in (axes[0].verdict, axes[1].verdict):
        reason = "the signs of u and v must be right first"
        rest = [not_checked(name, reason) for name in ("velocity lag", "lever arm", "track closure")]
        return trial, [*checks, *axes, *rest]
    late = lag_check(trial, scale, lag)
    trial = _apply_corrections(trial, [late])
    lever = track.lever_check(trial, scale)
    no_drift = COURSE if heading.verdict == "doubtful" else ""
    if lever.mendable and (rival := no_drift or rival_of_lever(late)):
        finding = lever.sentence.rpartition(";")[0]
        text = f"{finding}, or {rival}: the record cannot tell, and nothing is moved; state reference or delay."
        lever = replace(lever, sentence=text, mendable=False)
    trial = _apply_corrections(trial, [lever])
    return trial, [*checks, *axes, late, lever, track.drift_check(trial, scale)]


def _rudder_checks(trial: xr.Dataset, vessel: Vessel | None, yaw: str) -> list[Check]:
    """Checks of the rudder, given the verdict on the yaw rate."""
    unit = rudder.rudder_unit_check(trial)
    names = ("rudder sign", "rudder zero", "rudder angle", "rudder rate", "rudder delay", "rudder timing")
    if unit.verdict != "good":
        reason = "the unit of delta must be right first" if unit.verdict == "bad" else "no delta in the record"
        return [unit, *(not_checked(name, reason) for name in names)]
    scale = ship_scale(trial, vessel)
    sign = rudder.rudder_sign_check(trial, scale)
    if yaw == "bad":
        sign = not_checked("rudder sign", "r must be right first")
    timing = not_checked("rudder timing", "r and the sign of delta must be right first")
    return [
        unit,
        sign,
        rudder.rudder_zero_check(trial),
        rudder.rudder_angle_check(trial),
        rudder.rudder_rate_check(trial, vessel),
        rudder.rudder_delay_check(trial),
        rudder.rudder_timing_check(trial, scale) if sign.verdict == "good" and yaw != "doubtful" else timing,
    ]


def check_table(checks: Iterable[Check]) -> xr.Dataset:
    """Checks from :func:`trial_checks` as a Dataset, dims (check,) and (number,).

    ``verdict``, ``sentence`` and ``mendable`` are over the names of the checks; ``value`` and ``unit`` over the
    numbers, with the coordinates ``of`` (name of the check) and ``quantity``.
    """
    checks = list(checks)
    rows = [(check.name, *number) for check in checks for number in check.numbers]
    columns: dict[str, tuple[str, Any]] = {
        name: ("check", [getattr(check, name) for check in checks]) for name in ("verdict", "sentence", "mendable")
    }
    columns["value"] = ("number", np.array([row[2] for row in rows], dtype=float))
    columns["unit"] = ("number", [row[3] for row in rows])
    coords = {
        "check": [check.name for check in checks],
        "of": ("number", [row[0] for row in rows]),
        "quantity": ("number", [row[1] for row in rows]),
    }
    return xr.Dataset(columns, coords, {"verdict": worst_verdict(check.verdict for check in checks)})


def failed_checks(checks: Iterable[Check], overrule: Collection[str] = ()) -> str:
    """Sentence on the bad checks that are not overruled; empty without any."""
    bad = [check for check in checks if check.verdict == "bad" and check.name not in overrule]
    return "The trial cannot be fitted: " + " ".join(f"{one.name}: {one.sentence}" for one in bad) if bad else ""


def doubtful_checks(checks: Iterable[Check]) -> str:
    """Sentence on the checks that correct or doubt the record, not the choice of the trial; empty without any."""
    names = [check.name for check in checks if check.verdict == "doubtful"]
    names = [name for name in names if name not in _OF_THE_TRIAL and not name.startswith("excitation")]
    return f"The record is corrected or doubtful: {', '.join(names)}; inspect it before a fit." if names else ""


def finding_text(check: Check) -> str:
    """Sentence of a check, in which the correction takes the place of the remedy."""
    if not check.mendable or check.verdict == "bad":
        return check.sentence
    finding = check.sentence.rpartition(";")[0] or check.sentence.removesuffix(".")
    return f"{finding}; mended: {_CORRECTION_TEXT[check.name](check)}"


def validated_trial(
    trial: xr.Dataset,
    vessel: VesselLike,
    overrule: Collection[str] = (),
    *,
    lag: VelocityLag | None = None,
    any_speed: bool = False,
) -> xr.Dataset:
    """Validated trial: checked, corrected, with quality flags.

    Parameters
    ----------
    trial : Dataset, dims (time,)
        As for :func:`trial_checks`.
    vessel : Vessel, str or Path
    overrule : collection of str, optional
        Names of checks whose verdict "bad" does not refuse the trial.
    lag, any_speed
        As for :func:`trial_checks`.

    Returns
    -------
    Dataset, dims (time,)
        Corrected as by :func:`corrected_trial`, with its attrs; every posterior fitted to it keeps the last two.

    Raises
    ------
    TrialError
        For a bad check that is not overruled (the error has the ``checks``), a record that cannot be checked, an
        unknown name of a check.

    Examples
    --------
    A rudder of the wrong sign is refused:

    >>> import pymc_ship as ps
    >>> vessel = ps.load_vessel("kvlcc2")
    >>> trial = ps.simulate(vessel, ps.zigzag(20, 20), duration=600, step=0.5)
    >>> ps.validated_trial(trial, vessel).attrs["record_verdict"]
    'good'
    >>> ps.validated_trial(trial.assign(delta=-trial["delta"]), vessel)
    Traceback (most recent call last):
        ...
    pymc_ship.machine.errors.TrialError: The trial cannot be fitted: rudder sign: A positive delta turns \
the ship to starboard, it should turn the ship to port; flip the sign of delta. Or the record is a mirror image \
(ROS: x east, y north, psi counterclockwise, v to port): for that, state convention = "enu-flu".
    """
    vessel = as_vessel(vessel)
    return corrected_trial(trial, trial_checks(trial, vessel, lag=lag, any_speed=any_speed), overrule)


def corrected_trial(trial: xr.Dataset, checks: Iterable[Check], overrule: Collection[str] = ()) -> xr.Dataset:
    """Corrected trial: certain findings of the checks are mended.

    Spikes are interpolated, the heading is unwrapped, earth-fixed velocities are turned to body axes, offsets of r and
    p subtracted, v is moved to the point whose track is recorded, and a rudder zero that approach and zigzag agree on
    is subtracted.

    Parameters
    ----------
    trial : Dataset, dims (time,)
        The one that was checked.
    checks : iterable of Check
        From :func:`trial_checks`.
    overrule : collection of str, optional
        Names of checks whose verdict "bad" does not refuse the trial.

    Returns
    -------
    Dataset, dims (time,)
        Copy; attrs ``corrections`` (a sentence for each), ``record_verdict`` and ``record_remarks`` (a line for each
        doubtful or overruled check, and for a wind beside a heading that begins at 0).

    Raises
    ------
    TrialError
        For a bad check that is not overruled (the error has the ``checks``), an unknown name of a check.

    Examples
    --------
    >>> import pymc_ship as ps
    >>> vessel = ps.load_vessel("kvlcc2")
    >>> trial = ps.simulate(vessel, ps.zigzag(20, 20), duration=600, step=0.5)
    >>> measured = trial.assign(r=trial["r"] + 1e-3)
    >>> corrected = ps.corrected_trial(measured, ps.trial_checks(measured, vessel))
    >>> print(f"{(measured['r'] - corrected['r']).mean():.5f} rad/s")
    0.00100 rad/s
    """
    trial, checks = as_trial(trial), _check_list(checks)
    for name in name_list("The overruled checks", overrule, TrialError):
        check_choice("A check to overrule", name, [check.name for check in checks], TrialError)
    if sentence := failed_checks(checks, overrule):
        raise TrialError(sentence, checks=[one for one in checks if one.verdict == "bad" and one.name not in overrule])
    verdicts = [check.verdict for check in checks if check.verdict != "not checked"]
    remarks = _remarks(checks)
    if "wind_direction" in trial and (text := from_first_course_text({"this record": trial})):
        remarks.append(f"wind: {text}")
    mended = with_quality_flags(_apply_corrections(trial, checks), worst_verdict(verdicts), remarks)
    corrections = [
        *trial.attrs.get("corrections", []),
        *(_CORRECTION_TEXT[check.name](check) for check in checks if check.mendable),
    ]
    return mended.assign_attrs(corrections=corrections)


def _check_list(checks: Any) -> list[Check]:
    """Checks as a list; TrialError for anything else."""
    given = list(checks) if isinstance(checks, Iterable) and not isinstance(checks, Mapping) else [checks]
    for one in given:
        check_kind("Each of checks", one, Check, "give those of trial_checks", TrialError)
    return given


def _remarks(checks: Iterable[Check]) -> list[str]:
    """A sentence for each doubtful check, with its correction if it has one, and each overruled bad check."""
    words = {"doubtful": "Doubtful", "bad": "Overruled, though bad"}
    return [f"{words[one.verdict]}: {one.name}: {finding_text(one)}" for one in checks if one.verdict in words]


def _apply_corrections(trial: xr.Dataset, checks: Iterable[Check]) -> xr.Dataset:
    for check in checks:
        if check.mendable:
            trial = _MEND[check.name](trial, check)
    return trial


def _subtract(trial: xr.Dataset, name: str, shift: float | np.ndarray) -> xr.Dataset:
    return changed(trial, **{name: trial[name].values - shift})


def _zero(check: Check) -> float:
    return check.value("between the sides of the zigzag")


_MEND: dict[str, Callable[[xr.Dataset, Check], xr.Dataset]] = {
    "stand-ins": lambda trial, _: record_quality.without_stand_ins(trial),
    "spikes": lambda trial, _: record_quality.without_spikes(trial),
    "heading wraps": lambda trial, _: changed(trial, psi=record_quality.unwrapped_heading(trial)),
    "gyro offset": lambda trial, check: _subtract(trial, "r", np.deg2rad(check.value("offset"))),
    "roll rate offset": lambda trial, check: _subtract(trial, "p", np.deg2rad(check.value("offset"))),
    "velocity axes": lambda trial, _: changed(trial, **dict(zip("uv", track.body_velocity(trial), strict=True))),
    "motion ahead": plausibility.cut_to_piece,
    "velocity lag": lambda trial, check: without_lag(trial, lag_of(check)),
    "lever arm": lambda trial, check: _subtract(trial, "v", -check.value("lever arm") * trial["r"].values),
    "rudder zero": lambda trial, check: _subtract(trial, "delta", np.deg2rad(_zero(check))),
}
"""Correction of each mendable check, in the order of the checks."""

_CORRECTION_TEXT: dict[str, Callable[[Check], str]] = {
    "stand-ins": lambda check: f"Cells of stand-ins interpolated: {sum(value for _, value, _ in check.numbers):.0f}.",
    "spikes": lambda check: f"Samples replaced by interpolation: {sum(value for _, value, _ in check.numbers):.0f}.",
    "heading wraps": lambda check: f"Jumps of psi by a whole turn taken out: {check.value('jumps'):.0f}.",
    "gyro offset": lambda check: f"{check.value('offset'):+.5f} deg/s subtracted from r.",
    "roll rate offset": lambda check: f"{check.value('offset'):+.5f} deg/s subtracted from p.",
    "velocity axes": lambda check: "Earth-fixed velocities turned to u, v in body axes.",
    "velocity lag": lag_correction,
    "motion ahead": lambda check: f"Cut to the piece from {check.value('from'):.4g} to {check.value('until'):.4g} s.",
    "lever arm": lambda check: f"{check.value('lever arm'):+.3f} m times r added to v.",
    "rudder zero": lambda check: f"{_zero(check):+.2f} deg subtracted from delta.",
}
