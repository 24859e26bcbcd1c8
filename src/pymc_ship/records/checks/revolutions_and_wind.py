"""Checks of revolutions, against the propeller, and of the wind, true or relative."""

from collections.abc import Mapping

import numpy as np
import xarray as xr

from pymc_ship.physics.vessel.vessel import Vessel
from pymc_ship.records.checks.verdicts import SLOW, Check, missing_channels_text, not_checked
from pymc_ship.records.files.format import true_air
from pymc_ship.records.files.ship_scale import Blocks, ShipScale, ship_blocks
from pymc_ship.records.steering.stopping_tests import stopping_order
from pymc_ship.trial.units import KNOT

ADVANCE = (0.1, 1.6)  # advance numbers J = U / (n D) of ships that sail ahead, from a tug that tows to a fast craft
ADVANCE_OFF = 1.7  # ratio to the advance number of the vessel file from which n is doubted: a gear, or both shafts
STEADIER = 0.25  # ratio of variances of the wind below which another reading of it is more probable
_APPROACH = 0.05  # of the samples ahead, at the begin of a record, which show the sign of n
_TURNED = np.deg2rad(60.0)  # change of heading without which readings of the wind cannot be distinguished
_FIRST, _NORTH = 5, np.deg2rad(1.0)  # samples; first heading that is probably the zero of a heading from there
_BLOCK = 0.25  # L/U
_SAMPLES = 16  # of a block, at most, that show the wind
_TURN = 7.0  # rad; a larger angle is one in degrees
_RELATIVE = "wind_speed and wind_direction are of the relative wind, from the bow"
_READ_AS_RELATIVE = "read as relative"


def revolutions_check(trial: xr.Dataset, vessel: Vessel | None) -> Check:
    """Whether the propeller's advance number is that of a ship, and what unit of n explains it if not."""
    name = "revolutions"
    if reason := missing_channels_text(trial, ("n", "u", "v")):
        return not_checked(name, reason)
    if vessel is None or vessel.propeller is None:
        return not_checked(name, "it needs a vessel file with [propeller]")
    n, U = trial["n"].values, np.hypot(trial["u"].values, trial["v"].values)
    if not np.isfinite(n).all():
        percent = 100.0 * float(np.mean(~np.isfinite(n)))
        return Check(name, "doubtful", f"n is missing in {percent:.2g} % of the record and is left out; fill it in.")
    moving = SLOW * np.quantile(U, 0.95) < U
    ahead = n[moving & (trial["u"].values > 0.0)]
    first = ahead[: max(int(_APPROACH * ahead.size), 1)]  # before an astern order
    if ahead.size and np.mean(first < 0.0) > 0.5:
        return Check(name, "bad", "n is negative while the ship makes way ahead; state sign = -1 for n.")
    driven = (n > 0.0) & moving & ~(trial["time"].values > stopping_order(trial))
    if not driven.any():
        return not_checked(name, "the propeller never turns ahead")
    J = float(np.median(U[driven] / (n[driven] * vessel.propeller.D)))
    numbers = (("advance number", J, ""),)
    low, high = ADVANCE
    usual = vessel.particulars.nominal_speed / (vessel.propeller.n * vessel.propeller.D) if vessel.propeller.n else J
    fastest = float(np.quantile(U[driven] / (n[driven] * vessel.propeller.D), 0.95))
    if low <= J <= high and not 1.0 / ADVANCE_OFF < fastest / usual < ADVANCE_OFF:
        text = (
            f"The advance number reaches {fastest:.2g}, at the nominal speed and revolutions it is {usual:.2g}; check "
        )
        text += "that n is of the propeller and in 1/s, and n and D of the vessel file."
        return Check(name, "doubtful", text, numbers)
    if low <= J <= high:
        return Check(name, "good", f"The advance number U / (n D) is {J:.2g}.", numbers)
    fits = low <= 60.0 * J <= high
    why = "Probably n is in 1/min: state its unit" if fits else "Check the unit of n and D of the vessel file"
    return Check(name, "bad", f"The advance number U / (n D) is {J:.2g} (ships: {low:g} to {high:g}). {why}.", numbers)


def wind_check(trial: xr.Dataset, scale: ShipScale) -> Check:
    """Whether the true wind of a record is steady, or would be under another reading of its columns."""
    name = "wind"
    if reason := missing_channels_text(trial, ("wind_speed", "wind_direction", "u", "v", "psi")):
        return not_checked(name, reason)
    size = ship_blocks(trial, scale, _BLOCK).size
    if not all(np.isfinite(trial[key].values).all() for key in ("wind_speed", "wind_direction")):
        return Check(name, "doubtful", "The wind is missing in a part of the record; fill it in.")
    if np.ptp(trial["wind_direction"].values) == 0.0 < np.ptp(trial["wind_speed"].values):
        angle = np.rad2deg(trial["wind_direction"].values[0])
        text = (
            f"wind_direction stays at {angle:.3g} deg while wind_speed varies: a vane that is stuck or not connected; "
            "leave both columns out, or state the direction."
        )
        return Check(name, "doubtful", text)
    if np.ptp(trial["psi"].values) < _TURNED:
        return not_checked(name, "true and relative wind cannot be distinguished on one course")
    doubt = from_first_course_text({"this record": trial})
    trial = trial.isel(time=slice(None, None, max(1, size // _SAMPLES)))
    blocks = Blocks(min(size, _SAMPLES))
    rounding = 1e-9 * float(np.mean(trial["wind_speed"].values ** 2))
    unsteady = {
        words: rounding + float(np.var(blocks.means(flow.real)) + np.var(blocks.means(flow.imag)))
        for words, flow in _wind_readings(trial).items()
    }
    best = min(unsteady, key=lambda words: unsteady[words] / STEADIER ** len(words))
    ratio = unsteady[best] / max(unsteady[()], np.finfo(float).tiny)
    numbers = (("variance of the wind", unsteady[()], "m2/s2"), ("ratio under the best reading", ratio, ""))
    if not best:
        text = f"The variance of the wind as given is {unsteady[()]:.2g} m2/s2; no other interpretation of the columns "
        text += (
            "has less than a quarter of it. Knots, the opposite direction and anticlockwise angles cannot be excluded."
        )
        text += f" {doubt}" if doubt else ""
        return Check(name, "good", text, numbers)
    remedy = 'state wind = "relative" in the format' if best == (_RELATIVE,) else "correct the columns"
    sentence = f"Probably {', and '.join(best)}: the wind then keeps {100.0 * ratio:.2g} % of its variance; {remedy}."
    return Check(name, "bad", sentence, numbers)


def from_first_course_text(trials: Mapping[str, xr.Dataset]) -> str:
    """Sentence on a wind beside headings that all begin at 0, by the names of windy records; empty without one."""
    begins = [one["psi"].values[:_FIRST].mean() if "psi" in one else np.nan for one in trials.values()]
    if not begins or not (np.abs(np.angle(np.exp(1j * np.array(begins)))) < _NORTH).all():
        return ""
    return (
        f"The heading of {', '.join(trials)} begins at 0: if it counts from the first course and the wind from north, "
        "the wind acts from a wrong side; state the course as offset of psi."
    )


def _wind_readings(trial: xr.Dataset) -> dict[tuple[str, ...], np.ndarray]:
    """Velocity of the air [m/s], north + i east, by the mistakes of its columns that a reading takes back.

    A wind in knots is brought to its size as given, which its variance does not depend on.
    """
    speed, direction = trial["wind_speed"].values, trial["wind_direction"].values
    u, v, psi = (trial[key].values for key in ("u", "v", "psi"))
    apparent = (-speed * np.exp(1j * direction)) * np.exp(-1j * psi) - (u + 1j * v)  # if read as relative already
    columns = {(): (speed, direction), (_READ_AS_RELATIVE,): (np.abs(apparent), np.angle(-apparent))}
    readings: dict[tuple[str, ...], np.ndarray] = {}
    for before, (fast, came_from) in columns.items():
        directions = {
            (): came_from,
            ("wind_direction is where the wind blows to",): came_from + np.pi,
            ("wind_direction counts anticlockwise",): -came_from,
        }
        if np.abs(came_from).max() > _TURN:
            directions["wind_direction is in deg, read in rad",] = np.deg2rad(came_from)
        for knots, factor in {(): 1.0, ("wind_speed is in knots",): KNOT}.items():
            for turned, angle in directions.items():
                frames = {
                    (): -factor * fast * np.exp(1j * angle),
                    (_RELATIVE,): true_air(factor * fast, angle, u, v, psi),
                    ("wind_speed is of the relative wind, its direction from north",): true_air(
                        factor * fast, angle - psi, u, v, psi
                    ),
                    ("wind_direction counts from the bow",): -factor * fast * np.exp(1j * (angle + psi)),
                }
                if before:
                    readings[turned + knots] = min(
                        (readings[turned + knots], frames[_RELATIVE,] / factor), key=lambda flow: float(np.var(flow))
                    )
                else:
                    readings |= {frame + turned + knots: flow / factor for frame, flow in frames.items()}
    return readings
