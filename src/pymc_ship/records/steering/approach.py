"""Whether a manoeuvre begins at a steady speed and course, as a standard one must."""

import numpy as np
import xarray as xr

from pymc_ship.physics.manoeuvre.steering_record import first_execute
from pymc_ship.records.files.ship_scale import SIGNIFICANT, least_squares
from pymc_ship.trial.record import second_difference_sd

WHOLE_APPROACH = "approach_fault"  # attribute of a piece of a record: what the record has for :func:`approach_fault`
TOO_EARLY = "it begins before the ship makes way ahead"
UNSTEADY = 0.05  # change of speed in L/U, over the speed, from which a manoeuvre is no standard one
TURNING = 0.15  # rms yaw rate before the first execute, over the largest one, from which a manoeuvre is no standard one
_LAST, _SHORTEST = 2.0, 0.5  # L/U before the first execute that are judged, and the least of them
_JUST_BEFORE, _LARGEST = 1.0, 0.95  # L/U before it with this yaw rate; quantile of the largest yaw rate


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
    """Reason for which a manoeuvre of a record is no standard one; empty if it begins at a steady speed and course.

    ``unit`` is L/U [s] of the ship.
    """
    if WHOLE_APPROACH in trial.attrs:
        return str(trial.attrs[WHOLE_APPROACH])
    time, execute = trial["time"].values, first_execute(trial)
    before = time <= execute
    change, error = speed_trend(time[before], trial["u"].values[before], unit)
    if abs(change) > max(UNSTEADY, SIGNIFICANT * error):
        return (
            f"it begins while the speed changes by {change:+.0%} in L/U, of a standard one by at most {UNSTEADY:.0%}; "
            "wait for a steady speed"
        )
    r = trial["r"].values
    last = r[before & (time >= execute - _JUST_BEFORE * unit)]
    largest = float(np.quantile(np.abs(r[time >= execute]), _LARGEST))
    noise, rate = second_difference_sd(r), float(np.sqrt(np.mean(last**2)))
    if not rate > max(TURNING * largest, noise * (1.0 + SIGNIFICANT / np.sqrt(last.size))):
        return ""
    remedy = "wait for a steady course" if before.sum() > 1 else "add the approach, which the record lacks"
    return (
        f"it begins while the ship turns at {rate / largest:.0%} of its largest rate, a standard one below "
        f"{TURNING:.0%}; {remedy}"
    )
