"""Whether a manoeuvre begins at a steady speed, as a standard one must."""

from __future__ import annotations

import numpy as np
import xarray as xr

from pymc_ship.physics.manoeuvre.steering_record import first_execute
from pymc_ship.records.files.ship_scale import SIGNIFICANT, least_squares

WHOLE_APPROACH = "approach_fault"  # attribute of a piece of a record: what the record has for :func:`approach_fault`
TOO_EARLY = "it begins before the ship makes way ahead"
UNSTEADY = 0.05  # change of speed in L/U, over the speed, from which a manoeuvre is no standard one
_LAST, _SHORTEST = 2.0, 0.5  # L/U before the first execute that are judged, and the least of them


def speed_trend(time: np.ndarray, u: np.ndarray, unit: float) -> tuple[float, float]:
    """Change of the speed in L/U over the speed, and its standard error; NaN for less than half of L/U.

    ``unit`` is L/U [s]; of a longer approach the last two L/U count.
    """
    last = time >= time[-1] - _LAST * unit if time.size else np.zeros(0, dtype=bool)
    time, u = time[last], u[last]
    if time.size < 3 or time[-1] - time[0] < _SHORTEST * unit:
        return np.nan, np.nan
    from_middle = (time - time.mean()) / unit
    (slope, *_), (error, *_), _ = least_squares([from_middle, from_middle**2, np.ones(time.size)], u)
    relative = 1.0 / max(abs(float(u.mean())), np.finfo(float).tiny)
    return float(slope) * relative, float(error) * relative


def approach_fault(trial: xr.Dataset, unit: float) -> str:
    """Reason for which a manoeuvre of a record is no standard one; empty for one that begins at a steady speed.

    ``unit`` is L/U [s] of the ship.
    """
    if WHOLE_APPROACH in trial.attrs:
        return str(trial.attrs[WHOLE_APPROACH])
    before = trial["time"].values <= first_execute(trial)
    change, error = speed_trend(trial["time"].values[before], trial["u"].values[before], unit)
    if not abs(change) > max(UNSTEADY, SIGNIFICANT * error):
        return ""
    return (
        f"it begins while the speed changes by {change:+.0%} in L/U, of a standard one by at most {UNSTEADY:.0%}; "
        "wait for a steady speed"
    )
