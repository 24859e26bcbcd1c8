"""Checks of revolutions, against the propeller, and of the wind, true or relative."""

from __future__ import annotations

import numpy as np
import xarray as xr

from pymc_ship.physics.vessel.vessel import Vessel
from pymc_ship.records.checks.verdicts import SLOW, Check, missing_channels_text, not_checked
from pymc_ship.records.files.format import true_air
from pymc_ship.records.files.ship_scale import ShipScale, ship_blocks

ADVANCE = (0.1, 1.6)  # advance numbers J = U / (n D) of ships that sail ahead, from a tug that tows to a fast craft
STEADIER = 0.25  # ratio of variances of the wind below which another reading of it is more probable
_TURNED = np.deg2rad(60.0)  # change of heading without which readings of the wind cannot be distinguished
_BLOCK = 0.25  # L/U


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
    driven = (n > 0.0) & (SLOW * np.quantile(U, 0.95) < U)
    if not driven.any():
        return not_checked(name, "the propeller never turns ahead")
    J = float(np.median(U[driven] / (n[driven] * vessel.propeller.D)))
    numbers = (("advance number", J, ""),)
    low, high = ADVANCE
    if low <= J <= high:
        return Check(name, "good", f"The advance number U / (n D) is {J:.2g}.", numbers)
    fits = low <= 60.0 * J <= high
    why = "Probably n is in 1/min: state its unit" if fits else "Check the unit of n and D of the vessel file"
    return Check(name, "bad", f"The advance number U / (n D) is {J:.2g} (ships: {low:g} to {high:g}). {why}.", numbers)


def wind_check(trial: xr.Dataset, scale: ShipScale) -> Check:
    """Whether the true wind of a record is steady, or would be if it were a relative one."""
    name = "wind"
    if reason := missing_channels_text(trial, ("wind_speed", "wind_direction", "u", "v", "psi")):
        return not_checked(name, reason)
    blocks = ship_blocks(trial, scale, _BLOCK)
    speed, direction, psi = (trial[key].values for key in ("wind_speed", "wind_direction", "psi"))
    if not (np.isfinite(speed).all() and np.isfinite(direction).all()):
        return Check(name, "doubtful", "The wind is missing in a part of the record; fill it in.")
    if np.ptp(psi) < _TURNED:
        return not_checked(name, "true and relative wind cannot be distinguished on one course")
    u, v, bow = trial["u"].values, trial["v"].values, np.exp(1j * psi)
    air = -speed * np.exp(1j * direction)
    readings = {
        "": air,
        "wind_speed and wind_direction are of the relative wind, from the bow": true_air(speed, direction, u, v, psi),
        "wind_speed is of the relative wind, its direction from north": true_air(speed, direction - psi, u, v, psi),
        "wind_direction counts from the bow": air * bow,
    }
    unsteady = {
        words: float(np.var(blocks.means(flow.real)) + np.var(blocks.means(flow.imag)))
        for words, flow in readings.items()
    }
    best = min(unsteady, key=lambda words: unsteady[words])
    ratio = unsteady[best] / max(unsteady[""], np.finfo(float).tiny)
    numbers = (("variance of the wind", unsteady[""], "m2/s2"), ("ratio under the best reading", ratio, ""))
    if not best or ratio > STEADIER:
        return Check(name, "good", "The true wind is steadier than any reading of it as a relative one.", numbers)
    remedy = 'state wind = "relative" in the format' if "relative wind, from the bow" in best else "correct the columns"
    sentence = f"Probably {best}: the wind then keeps {100.0 * ratio:.2g} % of its variance; {remedy}."
    return Check(name, "bad", sentence, numbers)
