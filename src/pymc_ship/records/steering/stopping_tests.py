"""The stopping test in a record: the propeller goes astern until the ship is dead in the water (IMO MSC.137(76))."""

import numpy as np
import xarray as xr

from pymc_ship.physics.manoeuvre.events import Record

LABEL = "stopping test"  # in tables
LIMIT, LARGE = 15.0, 20.0  # largest track reach [L] of IMO MSC.137(76): in general, and for large displacement
INDICES = dict.fromkeys(("track_reach", "head_reach", "lateral_deviation"), "m")  # with their units
INDICES |= {"stopping_time": "s", "heading_change": "deg"}

_CHANNELS = ("u", "v", "r", "psi", "x", "y", "n")
_FALLEN = 0.95  # of the approach revolutions; the order was given at the last sample above


def stopping_order(trial: xr.Dataset) -> float:
    """Time [s] of the astern order: last sample above 95 % of the approach revolutions; NaN without a stopping test."""
    if any(name not in trial or not np.isfinite(trial[name].values).all() for name in _CHANNELS):
        return np.nan
    n, time = trial["n"].values, trial["time"].values
    astern = np.flatnonzero(n < 0.0)
    if not astern.size or not (n[: astern[0]] > 0.0).any():
        return np.nan
    approach = float(np.median(n[: astern[0]][n[: astern[0]] > 0.0]))
    full = np.flatnonzero(n[: astern[0]] >= _FALLEN * approach)
    return float(time[full[-1]])


def stopping_of_denoised(smooth: xr.Dataset, begin: float) -> dict[str, float]:
    """Indices of a denoised stopping test from the astern order at ``begin`` [s], NaN if the ship does not stop."""
    smooth = smooth.sel(time=slice(begin, None))
    time = smooth["time"].values
    motion = {name: smooth[name].values for name in _CHANNELS[:-1]} | {"phi": np.zeros(time.size)}
    still = np.flatnonzero(motion["u"] <= 0.0)
    if not still.size or time.size < 2:
        return dict.fromkeys(INDICES, np.nan)
    end = max(int(still[0]), 1)
    record, before, after = Record(time, motion), motion["u"][end - 1], motion["u"][end]
    until = float(time[end - 1] + (time[end] - time[end - 1]) * before / max(before - after, np.finfo(float).tiny))
    ahead, aside = record.displacement(until)
    turned = np.rad2deg(record.at("psi", until) - motion["psi"][0])
    values = (record.distance(until), float(ahead), float(aside), until - begin, float(turned))
    return dict(zip(INDICES, values, strict=True))
