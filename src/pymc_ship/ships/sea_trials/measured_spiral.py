"""The spiral test in a record: turns that have become steady, at rudder angles or at rates that are held.

A direct spiral holds one rudder angle after the other, from one side to the other and back, a reverse spiral holds
rates of turn (IMO MSC/Circ.1053). Either is a sequence of steady turns that sweeps the rudder angles; a loop shows
in turns to the side that the rudder is not put to.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import xarray as xr

from pymc_ship.records.steering.measured import denoise_motion
from pymc_ship.ships.sea_trials.uncertainty import PARTS

LABEL = "spiral test"
"""What a run is called in which steady turns are sailed at one rudder angle after the other."""

INDICES = {"loop_width": "deg", "residual_rate_starboard": "deg/s", "residual_rate_port": "deg/s"}
"""Indices of the test and their units, those of :func:`pymc_ship.ships.forecasting.steady_turns.spiral_indices`."""

_CHANNELS = ("u", "v", "r", "psi", "delta")
_LASTS = 2.0  # L/U for which a turn is steady
_STEADY = 0.02  # of the largest rate, that a steady one leaves its middle by
_HELD = 0.3  # deg, that a rudder which is held leaves its middle by
_SHARE_HELD = 0.6  # of the record, in which the rudder of a direct spiral does not move
_LEAST_ANGLES, _MOST_SWEEPS = 5, 4
_OPEN = 201  # values of the loop that a record leaves open, all as probable


def measured_spiral(trial: xr.Dataset, ship_time: float) -> xr.Dataset | None:
    """Steady turns of a spiral test; None for another record.

    Parameters
    ----------
    trial : Dataset, dims (time,)
        With u, v, r, psi and delta; its motion is denoised first.
    ship_time : float
        L/U [s], in which it is measured how long a turn is steady.

    Returns
    -------
    Dataset or None, dims (turn,)
        ``delta`` [deg] and ``r`` [deg/s], means over each steady turn, in the order of ``time`` [s], its end.
        A spiral has five rudder angles or more, turns to both sides and sweeps the rates to and fro. Its attrs tell
        whether the rudder was ``held`` (a direct spiral), and ``straight``, the rate up to which a ship goes straight.
    """
    if any(name not in trial or not np.isfinite(trial[name].values).all() for name in _CHANNELS):
        return None
    smooth = denoise_motion(trial)
    time, r, delta = smooth["time"].values, np.rad2deg(smooth["r"].values), np.rad2deg(trial["delta"].values)
    straight, held = _STEADY * float(np.abs(r).max()), _rudder_held(time, delta, ship_time)
    if straight == 0.0:
        return None
    motion = np.array([r / straight, delta / _HELD] if held else [r / straight])
    rows: list[tuple[float, float, float]] = []
    for begin, end in _steady(time, motion, _LASTS * ship_time):
        angle, rate = float(delta[begin:end].mean()), float(r[begin:end].mean())
        if held and rows and abs(angle - rows[-1][1]) < _HELD:
            rows.pop()  # one angle, at which the rate still crept
        rows.append((float(time[end - 1]), angle, rate))
    when, angles, rates = np.array(rows).reshape(-1, 3).T
    changes = np.sign(np.diff(rates)[np.abs(np.diff(rates)) > straight])
    swept = np.count_nonzero(np.diff(changes)) < _MOST_SWEEPS
    if len(_apart(angles)) < _LEAST_ANGLES or not swept or rates.min() > -straight or rates.max() < straight:
        return None
    values = {"time": when, "delta": angles, "r": rates}
    units = {"time": "s", "delta": "deg", "r": "deg/s"}
    channels = {name: ("turn", row, {"units": units[name]}) for name, row in values.items()}
    return xr.Dataset(channels, attrs={"held": held, "straight": straight})


def spiral_rows(turns: xr.Dataset, limit: float) -> list[dict]:
    """Indices of a spiral test with the part of their uncertainty that the rudder angles leave.

    A fold of the curve lies between the held angles next to the last one at which a ship turns to the old side: there
    she may turn steadily, or creep towards the other side. The middle of what this leaves open counts, or no loop where
    she never turns to the wrong side, and all of it is as probable. Where rates were held, the angles tell nothing of
    it, and no uncertainty is stated.

    Parameters
    ----------
    turns : Dataset, dims (turn,)
        From :func:`measured_spiral`.
    limit : float
        Width of the loop that is acceptable [deg].

    Returns
    -------
    list of dict
        Rows as :func:`pymc_ship.ships.sea_trials.uncertainty.stated` takes them. A residual rate is that of the branch
        at the middle of the loop, NaN where no turn of its side was sailed on both sides of it.
    """
    delta, r, straight = turns["delta"].values, turns["r"].values, turns.attrs["straight"]
    starboard, port = r > straight, r < -straight
    last, first = float(delta[starboard].max()), float(delta[port].min())
    width = last - first
    if width >= 0.0:
        narrow = max(0.0, -_following(-delta, -last) - _following(delta, first))
        wide = _following(delta, last) + _following(-delta, -first)
    else:
        narrow, wide = 0.0, 0.0 if np.any((delta > last) & (delta < first)) else -width
    known = turns.attrs["held"] and np.isfinite(wide - narrow)
    found = {"loop_width": 0.5 * (narrow + wide) if known and width >= 0.0 else max(width, 0.0)}
    middle = 0.5 * (last + first)
    for side, name in ((starboard, "residual_rate_starboard"), (port, "residual_rate_port")):
        order = np.argsort(delta[side])
        outer = np.interp(middle, delta[side][order], np.abs(r[side][order]), left=np.nan, right=np.nan)
        found[name] = float(outer) if width >= 0.0 else 0.0
    left = np.linspace(narrow, wide, _OPEN) - found["loop_width"] if known else np.full(1, np.nan)
    rows = []
    for name, units in INDICES.items():
        row = {"manoeuvre": LABEL, "side": "", "index": name, "units": units, "ratio": 1.0, "limit": np.nan}
        row |= dict.fromkeys(("raw", "without_current", "corrected"), found[name]) | dict.fromkeys(
            PARTS, np.full(1, np.nan)
        )
        if name == "loop_width":
            row |= dict.fromkeys(PARTS, np.zeros(1)) | {"u_record": left, "limit": limit}
        rows.append(row)
    return rows


def _rudder_held(time: np.ndarray, delta: np.ndarray, ship_time: float) -> bool:
    """Whether the rudder stays where it is for half an L/U, most of the time."""
    later = np.interp(time + 0.5 * ship_time, time, delta)
    return float(np.mean(np.abs(later - delta) < _HELD)) > _SHARE_HELD


def _steady(time: np.ndarray, motion: np.ndarray, least: float) -> Iterator[tuple[int, int]]:
    """Begins and ends of the stretches of ``least`` s or more in which no row spans more than 2."""
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


def _apart(angles: np.ndarray) -> list[float]:
    """Angles that differ by more than a held one varies."""
    found: list[float] = []
    for angle in sorted(angles.tolist()):
        if not found or angle - found[-1] > _HELD:
            found.append(angle)
    return found


def _following(angles: np.ndarray, angle: float) -> float:
    """The smallest of some angles beyond another one; NaN without any."""
    beyond = angles[angles > angle + _HELD]
    return float(beyond.min()) if beyond.size else np.nan
