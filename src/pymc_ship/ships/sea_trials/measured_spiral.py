"""Steady turns of a recorded spiral test: direct (fixed rudder angles) or reverse (fixed rates), IMO MSC/Circ.1053."""

from collections.abc import Iterator

import numpy as np
import xarray as xr

from pymc_ship.records.steering.measured import denoise_motion
from pymc_ship.ships.forecasting.steady_turns import SPIRAL_INDICES
from pymc_ship.ships.sea_trials.uncertainty import COMPONENTS

LABEL = "spiral test"  # name of the manoeuvre
_CHANNELS = ("u", "v", "r", "psi", "delta")
_SHORTEST_TURN = 2.0  # least duration of a steady turn [L/U]
_STEADY = 0.02  # largest deviation of a steady rate, over the largest rate
_RUDDER_TOLERANCE = 0.3  # largest deviation of a fixed rudder [deg]
_FIXED_FRACTION = 0.6  # least fraction of a direct spiral with fixed rudder
_LEAST_ANGLES, _MOST_REVERSALS = 5, 4
_N_WIDTHS = 201  # equally probable loop widths


def measured_spiral(trial: xr.Dataset, ship_time: float) -> xr.Dataset | None:
    """Steady turns of a spiral test, dims (turn,); None for another record.

    ``ship_time`` is L/U [s]. ``delta`` [deg] and ``r`` [deg/s] are means over each steady turn, ``time`` [s] is its
    end. A spiral has five rudder angles or more and turns to both sides. Attrs: ``direct`` (fixed rudder angles) and
    ``straight``, the largest rate of a straight course.
    """
    if any(name not in trial or not np.isfinite(trial[name].values).all() for name in _CHANNELS):
        return None
    smooth = denoise_motion(trial)
    time, r, delta = smooth["time"].values, np.rad2deg(smooth["r"].values), np.rad2deg(trial["delta"].values)
    straight, later = _STEADY * float(np.abs(r).max()), np.interp(time + 0.5 * ship_time, time, delta)
    is_direct = float(np.mean(np.abs(later - delta) < _RUDDER_TOLERANCE)) > _FIXED_FRACTION
    if straight == 0.0:
        return None
    motion = np.array([r / straight, delta / _RUDDER_TOLERANCE] if is_direct else [r / straight])
    rows: list[tuple[float, float, float]] = []
    for begin, end in _steady_intervals(time, motion, _SHORTEST_TURN * ship_time):
        angle, rate = float(delta[begin:end].mean()), float(r[begin:end].mean())
        if is_direct and rows and abs(angle - rows[-1][1]) < _RUDDER_TOLERANCE:
            rows.pop()  # same angle: keep the later, steadier turn
        rows.append((float(time[end - 1]), angle, rate))
    when, angles, rates = np.array(rows).reshape(-1, 3).T
    changes = np.sign(np.diff(rates)[np.abs(np.diff(rates)) > straight])
    reversals = np.count_nonzero(np.diff(changes))
    is_spiral = len(_distinct_angles(angles)) >= _LEAST_ANGLES and reversals < _MOST_REVERSALS
    if not is_spiral or rates.min() > -straight or rates.max() < straight:
        return None
    values = (("time", when, "s"), ("delta", angles, "deg"), ("r", rates, "deg/s"))
    channels = {name: ("turn", row, {"units": unit}) for name, row, unit in values}
    return xr.Dataset(channels, attrs={"direct": is_direct, "straight": straight})


def spiral_rows(turns: xr.Dataset, limit_deg: float) -> list[dict]:
    """Indices of :func:`measured_spiral`, rows for :func:`.uncertainty_budget`; ``limit_deg`` of the loop's width.

    A fold of the curve is between two neighbouring rudder angles of a direct spiral: the loop's width is the middle of
    the possible ones, all equally probable. A reverse spiral has no such uncertainty. A residual rate is that of the
    branch at the middle of the loop, NaN without turns on both sides of it.
    """
    delta, r, straight = turns["delta"].values, turns["r"].values, turns.attrs["straight"]
    starboard, port = r > straight, r < -straight
    last, first = float(delta[starboard].max()), float(delta[port].min())
    width = last - first
    if width >= 0.0:
        narrow = max(0.0, -_next_angle(-delta, -last) - _next_angle(delta, first))
        wide = _next_angle(delta, last) + _next_angle(-delta, -first)
    else:
        narrow, wide = 0.0, 0.0 if np.any((delta > last) & (delta < first)) else -width
    is_bounded = turns.attrs["direct"] and np.isfinite(wide - narrow)
    values = {"loop_width": 0.5 * (narrow + wide) if is_bounded and width >= 0.0 else max(width, 0.0)}
    middle = 0.5 * (last + first)
    for side, name in ((starboard, "residual_rate_starboard"), (port, "residual_rate_port")):
        order = np.argsort(delta[side])
        outer = np.interp(middle, delta[side][order], np.abs(r[side][order]), left=np.nan, right=np.nan)
        values[name] = float(outer) if width >= 0.0 else 0.0
    deviations = np.linspace(narrow, wide, _N_WIDTHS) - values["loop_width"] if is_bounded else np.full(1, np.nan)
    rows = []
    for name, units in SPIRAL_INDICES.items():
        row = {"manoeuvre": LABEL, "side": "", "index": name, "units": units, "ratio": 1.0, "limit": np.nan}
        row["corrected_for"] = "nothing"
        row |= dict.fromkeys(("raw", "without_current", "corrected"), values[name])
        row |= dict.fromkeys(COMPONENTS, np.full(1, np.nan))
        if name == "loop_width":
            row |= dict.fromkeys(COMPONENTS, np.zeros(1)) | {"u_record": deviations, "limit": limit_deg}
        rows.append(row)
    return rows


def _steady_intervals(time: np.ndarray, motion: np.ndarray, least: float) -> Iterator[tuple[int, int]]:
    """Begins and ends of intervals of ``least`` s or more in which no row spans more than 2."""
    begin, size = 0, time.size
    while begin < size:
        shortest = int(np.searchsorted(time, time[begin] + least)) + 1
        if shortest > size:
            return
        if np.ptp(motion[:, begin:shortest], axis=1).max() > 2.0:
            begin += max((shortest - begin) // 20, 1)
            continue
        ahead = motion[:, begin:]
        spans = np.maximum.accumulate(ahead, axis=1) - np.minimum.accumulate(ahead, axis=1)
        past = np.flatnonzero(spans.max(axis=0) > 2.0)
        end = begin + int(past[0]) if past.size else size
        yield begin, end
        begin = end


def _distinct_angles(angles: np.ndarray) -> list[float]:
    distinct: list[float] = []
    for angle in sorted(angles.tolist()):
        if not distinct or angle - distinct[-1] > _RUDDER_TOLERANCE:
            distinct.append(angle)
    return distinct


def _next_angle(angles: np.ndarray, angle: float) -> float:
    beyond = angles[angles > angle + _RUDDER_TOLERANCE]
    return float(beyond.min()) if beyond.size else np.nan
