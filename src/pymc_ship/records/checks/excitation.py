"""Checks of excitation: straight and steady approach, ranges of the motion, terms above the noise."""

import numpy as np
import xarray as xr

from pymc_ship.machine.errors import TrialError
from pymc_ship.physics.forces.terms import evaluate
from pymc_ship.physics.motion.prime_record import motion_record, prime_record
from pymc_ship.physics.vessel.vessel import LETTER, Vessel
from pymc_ship.records.checks.verdicts import Check, missing_channels_text, not_checked, straight_approach
from pymc_ship.records.files.ship_scale import SIGNIFICANT, Blocks, ShipScale
from pymc_ship.records.steering.approach import speed_trend
from pymc_ship.trial.record import sampling_interval

STRAIGHT = 0.1  # mean of r, v or phi on the approach over the channel's largest magnitude; IMO asks for a steady course
UPRIGHT = 0.5  # heel [deg] up to which an approach is upright, however little the ship rolls later
STEADY = 0.01  # change of speed in L/U over the speed on the approach; IMO asks for a steady speed
DRIFT_RANGE, TURN_RANGE, RUDDER_RANGE = 0.05, 0.15, 5.0  # least v/U, rL/U, rudder [deg]; a 10/10 zigzag has twice them
ABOVE_NOISE = 2.0  # signal over noise of a direction of the design from which it counts as excited
_BLOCK = 0.1  # L/U
_IDLE = 1e-12
_STOPPED = 0.01  # fraction of the nominal speed


def approach_check(trial: xr.Dataset, scale: ShipScale) -> Check:
    """Whether course and speed are steady before the rudder moves."""
    n = straight_approach(trial)
    interval = sampling_interval(trial)
    if n < 3 or n == trial.sizes["time"]:
        return not_checked("approach", "the rudder moves from the first sample on, or never")
    numbers, faults = [("duration", (n - 1) * interval, "s")], []
    for name in ("r", "v", "phi"):
        values = trial[name].values if name in trial else np.zeros(n)
        largest = np.quantile(np.abs(values), 0.99)
        if largest > 0.0:
            ratio = float(values[:n].mean() / largest)
            numbers.append((f"{name} over its largest", ratio, ""))
            sd = float(np.median(np.abs(np.diff(values))) / 0.954)
            least = max(STRAIGHT, SIGNIFICANT * sd / np.sqrt(n) / largest)
            if abs(ratio) > least and (name != "phi" or abs(ratio) * largest > np.deg2rad(UPRIGHT)):
                faults.append(f"{name} is {ratio:+.0%} of its largest")
    if "u" in trial:
        change, error = speed_trend(trial["time"].values[:n], trial["u"].values[:n], scale.nominal_time)
        numbers += [("change of speed in L/U", change, "")] if np.isfinite(change) else []
        if abs(change) > max(STEADY, SIGNIFICANT * error):
            faults.append(f"the speed changes by {change:+.1%} in L/U")
    if faults:
        text = f"On the approach {', '.join(faults)}; indices need a straight approach, a fit does not."
        return Check("approach", "doubtful", text, tuple(numbers))
    return Check("approach", "good", f"Straight and steady for {(n - 1) * interval:.3g} s.", tuple(numbers))


def range_check(trial: xr.Dataset, scale: ShipScale) -> Check:
    """Ranges of v/U, rL/U, rudder and speed."""
    if reason := missing_channels_text(trial, ("u", "v", "r", "delta")):
        return not_checked("ranges", reason)
    U = np.maximum(np.hypot(trial["u"].values, trial["v"].values), 1e-3 * scale.U)
    ratios = trial["v"].values / U, trial["r"].values * scale.L / U
    drift, turn = (float(np.quantile(np.abs(values), 0.99)) for values in ratios)
    rudder = float(np.rad2deg(np.abs(trial["delta"].values).max()))
    loss = float(np.ptp(np.quantile(U, [0.01, 0.99])) / scale.U)
    numbers = (("v/U", drift, ""), ("rL/U", turn, ""), ("delta", rudder, "deg"), ("range of U", loss, "U"))
    text = f"v/U reaches {drift:.2g}, rL/U {turn:.2g}, the rudder {rudder:.3g} deg; U ranges over {loss:.0%}."
    if (scale.known and turn < 0.1 * TURN_RANGE) or rudder < 0.1 * RUDDER_RANGE:
        return Check("ranges", "bad", f"{text} The ship hardly turns; use a zigzag or a turning circle.", numbers)
    if (scale.known and turn < TURN_RANGE) or drift < DRIFT_RANGE or rudder < RUDDER_RANGE:
        return Check("ranges", "doubtful", f"{text} Steer harder to identify more than linear terms.", numbers)
    return Check("ranges", "good", text, numbers)


def excitation_checks(trial: xr.Dataset, vessel: Vessel | None) -> tuple[Check, ...]:
    """Condition number of the design of each degree of freedom, and its directions above the noise.

    Terms are means over a tenth of L/U, scaled to unit mean square; their noise is that of second differences in time.
    """
    if vessel is None:
        return (not_checked("excitation", "no vessel whose terms could be tried"),)
    try:
        record = motion_record(trial, vessel)
    except TrialError as error:
        return (not_checked("excitation", str(error).removesuffix(".")),)
    nominal_speed = vessel.particulars.nominal_speed
    if np.hypot(record["u"], record["v"]).min() < _STOPPED * nominal_speed:
        return (not_checked("excitation", "the ship stops, and prime values have no scale"),)
    motion, speed, _ = prime_record(vessel, record)
    weight = (speed / nominal_speed)[:, None] ** 2
    ship_time = vessel.particulars.L / float(np.median(speed))
    size = int(np.clip(round(_BLOCK * ship_time / sampling_interval(trial)), 1, max(1, speed.size // 20)))
    return tuple(
        _excitation(dof, vessel.terms(dof), evaluate(vessel.terms(dof), motion) * weight, size)
        if vessel.forces[dof]
        else not_checked(f"excitation {dof}", "the vessel file has no terms of it")
        for dof in vessel.dofs
    )


def _excitation(dof: str, terms: tuple[str, ...], columns: np.ndarray, size: int) -> Check:
    """Check of the design of one degree of freedom from its terms at every sample, shape (n_time, n_terms)."""
    name = f"excitation {dof}"
    design = np.apply_along_axis(Blocks(size).means, 0, columns)
    scale = np.sqrt(np.mean(design**2, axis=0))
    idle = [LETTER[dof] + term for term, value in zip(terms, scale, strict=True) if value < _IDLE]
    if idle:
        text = f"{', '.join(idle)} stay 0 all the time; leave them out or use a trial that excites them."
        return Check(name, "bad", text, (("idle terms", float(len(idle)), ""),))
    noise = np.diff(columns / scale, 2, axis=0) / np.sqrt(6.0)
    _, s, directions = np.linalg.svd(design / scale, full_matrices=False)
    spread = np.sqrt(np.mean((noise @ directions.T) ** 2, axis=0) / size)
    above_noise = s / np.sqrt(len(design)) > ABOVE_NOISE * spread
    condition = float(s[0] / max(s[-1], np.finfo(float).tiny))
    count = int(np.count_nonzero(above_noise))
    numbers = (("condition number", condition, ""), ("directions above noise", float(count), f"of {len(terms)}"))
    if above_noise.all():
        text = f"All {len(terms)} directions are above the noise; condition number {condition:.3g}."
        return Check(name, "good", text, numbers)
    lost = np.sqrt(np.sum(directions[~above_noise] ** 2, axis=0))
    weak = ", ".join(LETTER[dof] + terms[j] for j in np.argsort(-lost)[:3])
    text = (
        f"{count} of {len(terms)} directions are above the noise, {weak} least; use a prior, fewer terms, harder runs."
    )
    return Check(name, "bad" if count < 0.25 * len(terms) else "doubtful", text, numbers)
