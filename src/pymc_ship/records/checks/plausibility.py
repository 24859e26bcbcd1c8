"""Whether the motion of a record is plausible for the ship, and which piece of it the models cover.

Ranges have no dimension. Where a quantity leaves its range, the known mistake that brings all back is named.
"""

from collections.abc import Iterable
from dataclasses import dataclass, replace

import numpy as np
import xarray as xr

from pymc_ship.physics.forces.prime_system import GRAVITY
from pymc_ship.physics.manoeuvre.steering_record import first_execute
from pymc_ship.physics.vessel.vessel import Vessel
from pymc_ship.records.checks.mistakes import BETTER, EXPLAINED, UNEXPLAINED, corrected_by
from pymc_ship.records.checks.track import track_misfit
from pymc_ship.records.checks.verdicts import SLOW, Check, longest_piece, missing_channels_text, not_checked, pieces
from pymc_ship.records.files.ship_scale import SIGNIFICANT, ShipScale, least_squares, ship_blocks
from pymc_ship.records.files.sides import MIRROR_IMAGE, with_yaw_rate
from pymc_ship.records.steering.approach import TOO_EARLY, WHOLE_APPROACH, approach_fault
from pymc_ship.trial.record import AXES, Channels, sampling_interval
from pymc_ship.trial.units import KNOT

DRIFT = 0.6  # largest v/U of a ship that makes way ahead: a drift angle of 37 deg, beyond that of the tightest turns
TURNING = 2.0  # largest rL/U of a ship that makes way ahead: a circle of one ship length in diameter
SHORTEST_PIECE = 2.5  # shortest piece of a record [L/U] that can be fitted: half a window of inference.trajectory
BRIDGED = 0.5  # longest time [L/U] below the least speed that does not end a piece: gathering way, it is crossed twice
_BLOCK = 0.25  # L/U
_SUSPICIOUS = 3.0  # standard errors beyond a range from which a quantity is doubted


@dataclass(frozen=True)
class Range:
    """Possible and usual values of a quantity, a typical one, and the factor by which ships scatter about it."""

    possible: tuple[float, float]
    usual: tuple[float, float]
    typical: float
    scatter: float
    words: str
    unit: str = ""


RANGES = {
    "fraction ahead": Range(
        (0.25, 1.0), (0.25, 1.0), 1.0, 2.0, "the ship makes way ahead with |v|/U below 0.6 for {:.0%} of the time"
    ),
    "rL/U": Range((0.0, TURNING), (0.0, 1.2), 0.4, 2.0, "rL/U reaches {:.2g} (ships: up to 1)"),
    "rU/g": Range((0.0, 0.2), (0.0, 0.1), 0.01, 3.0, "r U reaches {:.2g} of gravity (ships: up to 0.05)"),
    "pivot point": Range(
        (-0.2, 1.2), (0.1, 0.9), 0.45, 1.3, "v over r puts the pivot point {:.2g} L forward (ships: 0.3 to 0.7)", "L"
    ),
    "speed": Range((0.25, 2.5), (1.0 / 1.5, 1.5), 1.0, 1.2, "the speed is {:.3g} times the nominal one"),
    "Froude number": Range((0.01, 1.0), (0.02, 0.45), 0.18, 1.6, "the Froude number is {:.2g}"),
    "heel": Range((-np.inf, 0.0), (-np.inf, 0.0), -1.0, 10.0, "it heels into the turn ({:+.2g} rad for r U/g)", "rad"),
    "list": Range(
        (-0.35, 0.35), (-0.035, 0.035), 0.0, 1.0, "its heel without a turn is {:+.2g} rad (list, or zero of phi)", "rad"
    ),
}
"""Ranges of the quantities, from geometry and from merchant ships, tugs and naval ships.

The pivot point lies 0.3 to 0.7 L forward of midship (Tzeng 1998, J. Mar. Sci. Tech. 6:39-44), a sensor within 0.5 L.
rU/g is rL/U times the square of the Froude number. A ship heels out of its turn.
"""


@dataclass(frozen=True)
class _Motion:
    """Block means of a motion: speeds [m/s], yaw rate [rad/s], heel [rad] or None; length and nominal speed or None."""

    u: np.ndarray
    v: np.ndarray
    r: np.ndarray
    phi: np.ndarray | None
    interval: float
    L: float | None
    nominal: float | None

    @property
    def U(self) -> np.ndarray:
        """Speed [m/s] of each block."""
        return np.hypot(self.u, self.v)

    @property
    def fast(self) -> float:
        """Speed [m/s] that 5 % of the blocks exceed."""
        return float(np.quantile(self.U, 0.95))

    @property
    def fastest(self) -> float:
        """Speed [m/s] that 5 % of the blocks exceed up to one round: the approach is a small part of two rounds."""
        turned = np.abs(np.cumsum(self.r)) * self.interval
        return float(np.quantile(self.U[turned <= max(2.0 * np.pi, turned[0])], 0.95))

    @property
    def ahead(self) -> np.ndarray:
        """Whether the ship makes way ahead in a block, with a drift and a speed that models cover."""
        return (self.u > SLOW * self.fast) & (np.abs(self.v) <= DRIFT * self.U)


def _motion(trial: Channels, scale: ShipScale, vessel: Vessel | None) -> tuple[_Motion, int]:
    """Motion of a record and the samples of a block."""
    blocks = ship_blocks(trial, scale, _BLOCK)
    means = {name: blocks.means(trial[name].values) for name in ("u", "v", "r", "phi") if name in trial}
    given = (vessel.particulars.L, vessel.particulars.nominal_speed) if vessel else (None, None)
    interval = blocks.size * sampling_interval(trial)
    return _Motion(means["u"], means["v"], means["r"], means.get("phi"), interval, *given), blocks.size


def _quantities(motion: _Motion) -> dict[str, tuple[float, float]]:
    """Value and standard error of each quantity that the motion shows."""
    moving = SLOW * motion.fast < motion.U
    ahead = motion.ahead
    fraction_ahead = float(ahead.sum() / max(moving.sum(), 1))
    motion_ahead = replace(motion, **{name: getattr(motion, name)[ahead] for name in ("u", "v", "r")})
    quantities = {"fraction ahead": (fraction_ahead, 0.0)}
    if ahead.sum() < 10:
        return quantities
    quantities["rU/g"] = (float(np.quantile(np.abs(motion_ahead.r) * motion_ahead.U, 0.99)) / GRAVITY, 0.0)
    constant, lag = np.ones(motion_ahead.r.size), np.gradient(motion.r, motion.interval)[ahead]
    if motion.L and motion.nominal:
        quantities["rL/U"] = (float(np.quantile(np.abs(motion_ahead.r) / motion_ahead.U, 0.99)) * motion.L, 0.0)
        quantities["Froude number"] = (motion.fastest / np.sqrt(GRAVITY * motion.L), 0.0)
        quantities["speed"] = (motion.fastest / motion.nominal, 0.0)
        (slope, *_), (error, *_), _ = least_squares([motion_ahead.r, lag, constant], motion_ahead.v)
        quantities["pivot point"] = (-float(slope) / motion.L, float(error) / motion.L)
    if motion.phi is not None:
        lateral_acceleration = motion.r * motion.u / GRAVITY
        columns = [lateral_acceleration[ahead], np.gradient(lateral_acceleration, motion.interval)[ahead], constant]
        (slope, _, upright), (error, _, list_error), _ = least_squares(columns, motion.phi[ahead])
        quantities["heel"] = float(slope), float(error)
        quantities["list"] = float(upright), float(list_error)
    return quantities


def _beyond(value: float, error: float, limits: tuple[float, float], standard_errors: float) -> bool:
    """Whether a value lies beyond its limits by more than so many ``standard_errors``."""
    low, high = limits
    return value + standard_errors * error < low or value - standard_errors * error > high


def _faults(quantities: dict[str, tuple[float, float]]) -> dict[str, str]:
    """Verdict on each quantity that leaves its usual range."""
    faults = {}
    for name, (value, error) in quantities.items():
        if _beyond(value, error, RANGES[name].possible, SIGNIFICANT):
            faults[name] = "bad"
        elif _beyond(value, error, RANGES[name].usual, _SUSPICIOUS):
            faults[name] = "doubtful"
    return faults


def _squared_deviation(quantities: dict[str, tuple[float, float]]) -> float:
    """Sum of squared deviations from typical values, in units of the scatter of ships."""
    total = 0.0
    for name in ("rL/U", "pivot point", "speed", "Froude number"):
        if name in quantities:
            ratio = max(quantities[name][0] / RANGES[name].typical, 1e-9)
            total += (np.log(ratio) / np.log(RANGES[name].scatter)) ** 2
    return total


def _corrected_vessel_files(motion: _Motion) -> dict[str, _Motion]:
    """The motion with each possible mistake of the vessel file corrected, by the mistake."""
    if not (motion.L and motion.nominal):
        return {}
    root = motion.nominal / motion.fastest
    scaled = replace(motion, u=root * motion.u, v=root * motion.v, r=motion.r / root, interval=motion.interval * root)
    corrected = {
        f"the record is at a scale of 1:{root**2:.3g} to the vessel file (Froude)": scaled,
        _nominal(motion.fastest, motion.nominal): replace(motion, nominal=motion.fastest),
    }
    pivot = _quantities(motion).get("pivot point", (0.0, 0.0))[0]
    if pivot > 0.0:
        L = motion.L * pivot / RANGES["pivot point"].typical
        corrected[f"the vessel file has the wrong L (about {L:.3g} m would fit)"] = replace(motion, L=L)
    return corrected


def _nominal(fastest: float, nominal: float) -> str:
    """Description of a wrong nominal speed in the vessel file."""
    text, metres = f"the speed in the record is {fastest:.3g} m/s", nominal * KNOT
    if 0.9 < metres / fastest < 1.1:
        return f"the vessel file has its nominal speed in knots ({text}; {nominal:.3g} knots are {metres:.3g} m/s)"
    return f"the vessel file has the wrong nominal speed ({text})"


def _explanation(trial: xr.Dataset, scale: ShipScale, vessel: Vessel | None, motion: _Motion) -> str:
    """Sentence on the mistake, or pair, that explains the quantities best and leads to a track of the record."""
    channels, most = ("u", "v", "r", "phi"), max(EXPLAINED, track_misfit(trial, scale) / BETTER)
    for number in (1, 2):
        mended = _corrected_vessel_files(motion) if number == 1 else {}
        for chosen, changed in corrected_by(trial, channels, number):
            if track_misfit(changed, scale) < most:
                mended[" and ".join(one.words for one in chosen)] = _motion(changed, scale, vessel)[0]
        quantities = {mistake: _quantities(changed) for mistake, changed in mended.items()}
        plausible = {mistake: values for mistake, values in quantities.items() if not _faults(values)}
        if plausible:
            best = min(plausible, key=lambda mistake: _squared_deviation(plausible[mistake]))
            text = _words(("rL/U", "pivot point", "speed"), plausible[best])
            return f"The most probable cause is that {best}" + (f": then {text}." if text else ".")
    return f"{UNEXPLAINED[0].upper()}{UNEXPLAINED[1:]}."


def _words(names: Iterable[str], quantities: dict[str, tuple[float, float]], separator: str = ", ") -> str:
    """Words on those of some quantities that the motion shows."""
    return separator.join(RANGES[name].words.format(quantities[name][0]) for name in names if name in quantities)


def plausibility_check(trial: xr.Dataset, scale: ShipScale, vessel: Vessel | None) -> Check:
    """Whether drift, turning, pivot point, speed, Froude number, heel and list are plausible for the ship.

    Without a vessel only drift, lateral acceleration, heel and list are checked.
    """
    name = "plausibility"
    trial = with_yaw_rate(trial)
    if reason := missing_channels_text(trial, ("u", "v", "r")):
        return not_checked(name, reason)
    motion, _ = _motion(trial, scale, vessel)
    if not motion.fast > 0.0:
        return Check(name, "bad", "The ship does not move; check u and v.")
    quantities = _quantities(motion)
    numbers = tuple((label, value, RANGES[label].unit) for label, (value, _) in quantities.items())
    faults = _faults(quantities)
    if not faults:
        text = _words(("rL/U", "pivot point", "speed"), quantities)
        return Check(name, "good", f"The motion is plausible for a ship{f': {text}' if text else ''}.", numbers)
    verdict = "bad" if "bad" in faults.values() else "doubtful"
    text = f"The motion is unusual for a ship: {_words(faults, quantities, '; ')}. "
    if faults.keys() == {"list"}:
        return Check(name, verdict, f"{text}For a zero of phi, state its offset; a fit takes it for forces.", numbers)
    text += _explanation(trial, scale, vessel, motion)
    if faults.keys() == {"heel"} and trial.attrs.get(AXES):
        text += f" Or the record is {MIRROR_IMAGE}."
    return Check(name, verdict, text, numbers)


def piece_check(trial: xr.Dataset, scale: ShipScale, *, any_speed: bool = False) -> Check:
    """The longest piece with the ship ahead, at a speed, drift and rate of turn that the models cover.

    With ``any_speed`` the models cover the rest of the record, too; otherwise a trial is cut to the piece.
    """
    name = "motion ahead"
    if reason := missing_channels_text(trial, ("u", "v", "r")):
        return not_checked(name, reason)
    ahead, size = _blocks_ahead(trial, scale)
    time = trial["time"].values
    if ahead.all():
        return Check(name, "good", "The ship makes way ahead all the time.", _piece(time[0], time[-1], scale))
    longest = longest_piece(ahead)
    samples = _samples(longest, ahead.size, size, time.size)
    numbers = _piece(time[samples.start], time[max(samples.stop - 1, samples.start)], scale)
    if any_speed:
        text = f"The ship makes way ahead, above {SLOW:.0%} of its speed, for {ahead.mean():.0%} of the time"
        return Check(name, "good", f"{text}; force models for any speed cover the rest.", numbers)
    piece = numbers[1][1] - numbers[0][1]
    text = f"The ship makes way ahead, above {SLOW:.0%} of its speed and with |v|/U below {DRIFT:g},"
    if piece < SHORTEST_PIECE * scale.time:
        most = f"for {piece:.3g} s at most" if ahead.any() else "at no time"
        text = f"{text} {most}; the models cover nothing else, and a fit needs {SHORTEST_PIECE * scale.time:.3g} s."
        return Check(name, "bad", text, numbers)
    text = (
        f"{text} {spans_text(pieces_ahead(trial, scale))} ({ahead.mean():.0%} of the time). A ship is identified from "
    )
    text += f"every such piece; other fits use the longest, {piece:.4g} s."
    return Check(name, "doubtful", text, numbers, mendable=True)


def spans_text(pieces: list[xr.Dataset]) -> str:
    """Words on the times of pieces."""
    ends = [piece["time"].values[[0, -1]] for piece in pieces]
    return " and ".join(f"from {begin:.4g} to {end:.4g} s" for begin, end in ends)


def pieces_ahead(trial: xr.Dataset, scale: ShipScale) -> list[xr.Dataset]:
    """Pieces with the ship ahead, long enough for a fit; the whole record if it is ahead throughout."""
    ahead, size = _blocks_ahead(trial, scale)
    if ahead.all():
        return [trial]
    samples = [_samples(piece, ahead.size, size, trial.sizes["time"]) for piece in pieces(ahead)]
    long = SHORTEST_PIECE * scale.time
    return [piece for piece in (trial.isel(time=k) for k in samples) if np.ptp(piece["time"].values) >= long]


def _blocks_ahead(trial: xr.Dataset, scale: ShipScale) -> tuple[np.ndarray, int]:
    """Mask of the blocks that models for a ship ahead cover, and the samples per block."""
    motion, size = _motion(trial, scale, None)
    steady = (np.abs(motion.v) <= DRIFT * motion.U) & (motion.u > 0.0)
    steady &= np.abs(motion.r) * scale.L <= TURNING * motion.U if scale.known else True
    ahead = steady & (motion.u > SLOW * motion.fast)
    for gap in pieces(~ahead):
        short = (gap.stop - gap.start) * motion.interval <= BRIDGED * scale.time
        if short and gap.start > 0 and gap.stop < ahead.size and steady[gap].all():
            ahead[gap] = True
    return ahead, size


def _samples(piece: slice, blocks: int, size: int, samples: int) -> slice:
    """Samples of a piece of blocks; the last block extends to the end of the record."""
    return slice(piece.start * size, samples if piece.stop == blocks else piece.stop * size)


def _piece(begin: float, end: float, scale: ShipScale) -> tuple[tuple[str, float, str], ...]:
    return ("from", float(begin), "s"), ("until", float(end), "s"), ("L/U", scale.nominal_time, "s")


def cut_to_piece(trial: xr.Dataset, check: Check) -> xr.Dataset:
    """Trial cut to the piece of :func:`piece_check`; what its whole approach shows goes along."""
    piece = trial.sel(time=slice(check.value("from"), check.value("until")))
    if "delta" not in trial:
        return piece
    fault = approach_fault(trial, check.value("L/U"))
    late = first_execute(trial) < piece["time"].values[0]
    return piece.assign_attrs({WHOLE_APPROACH: fault or (TOO_EARLY if late else "")})
