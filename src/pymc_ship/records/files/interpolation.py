"""Channels of a table on one time base: each is interpolated on its own stamps, angles and ordered angles as such."""

from __future__ import annotations

from collections.abc import Iterable, Mapping

import numpy as np

from pymc_ship.trial.record import second_difference_sd

FILLED_SAMPLES, FILLED_SECONDS = 5, 2.0  # longest run of missing samples that is interpolated, the longer of the two
_HELD = 0.8  # fraction of equal neighbours from which a rudder is a sequence of orders; of readings held alike
_UNEVEN = 0.15  # error of the rows of one held reading, over these
_FEWEST_READINGS = 10
_ORDERED = ("delta", "delta_command", "n", "thrust", "torque")  # channels that may stand still while the ship moves
_SIGNAL = 5.0  # standard deviations of the noise from which the change of a channel dates its rows
_COVERED = 0.9  # fraction of a record from which a channel sets its ends
_REPEATED = 1.5  # rows with the same stamp, in the mean, from which they are compared

Channels = dict[str, np.ndarray]
Rows = tuple[np.ndarray, np.ndarray, Channels]


def typical_step(time: np.ndarray) -> float:
    """Sampling interval [s] of stamps with repetitions and gaps."""
    steps = np.diff(time)
    if (steps > 0.0).all():
        return float(np.median(steps))
    width = min(time.size - 1, max(50, time.size // 20))
    return float(np.median(time[width:] - time[:-width]) / width)


def longest_fill(time: np.ndarray) -> float:
    """Longest gap [s] in stamps that is interpolated."""
    return 1.001 * max((FILLED_SAMPLES + 1) * typical_step(time), FILLED_SECONDS)


def interpolated(name: str, at: np.ndarray, stamps: np.ndarray, values: np.ndarray) -> np.ndarray:
    """Channel at other stamps: linear; an ordered rudder keeps its last value, the wind turns the short way."""
    if name in ("delta", "delta_command") and _is_ordered(values):
        last = np.searchsorted(stamps, at + 1e-9 * np.ptp(stamps), side="right") - 1
        return values[np.clip(last, 0, None)]
    if name == "wind_direction":
        return np.interp(at, stamps, np.unwrap(values)) % (2.0 * np.pi)
    return np.interp(at, stamps, values)


def _is_ordered(values: np.ndarray) -> bool:
    """Whether a rudder record changes in single steps with a rest on both sides, as orders do."""
    moves = np.diff(values) != 0.0
    return bool(moves.any() and moves.mean() < 1.0 - _HELD and not (moves[1:] & moves[:-1]).any())


def on_one_base(time: np.ndarray, quantum: np.ndarray, channels: Channels) -> tuple[*Rows, list[str]]:
    """Rows of the fastest channel if others have fewer cells; with one sensor a row, a uniform base of its interval.

    Cells in gaps of a channel that are too long to be interpolated are NaN.
    """
    known = {name: np.flatnonzero(np.isfinite(values)) for name, values in channels.items()}
    spacing = {name: float(np.median(np.diff(rows))) for name, rows in known.items() if rows.size > 1}
    slow = [name for name, rows in spacing.items() if rows > 1.0]
    if not slow:
        return time, quantum, channels, []
    steps = {name: typical_step(time[known[name]]) for name in spacing}
    fastest = max(spacing, key=lambda name: known[name].size)
    step, one_sensor = steps[fastest], spacing[fastest] > 1.0
    begin, end = _common_span(time, [rows[[0, -1]] for rows in known.values() if rows.size > 1])
    if not 0.0 < step < end - begin:
        return time, quantum, channels, []
    if one_sensor:
        base = begin + step * np.arange(int((end - begin) / step + 1e-6) + 1)
        base_quantum, note = (
            np.zeros(base.size),
            f"The rows have one sensor each: channels interpolated to {step:.4g} s",
        )
    else:
        rows = known[fastest]
        rows = rows[(time[rows] >= begin) & (time[rows] <= end)]
        base, base_quantum = time[rows], quantum[rows]
        note = f"{', '.join(slow)} interpolated to the stamps of {fastest}"
    based = {}
    for name, values in channels.items():
        if known[name].size < 2:
            based[name] = np.full(base.size, np.nan)
        elif name in slow:
            based[name] = _without_long_gaps(name, base, time[known[name]], values[known[name]])
        else:
            based[name] = values[rows]
    late = [f"{name} every {steps[name]:.3g} s" for name in slow if steps[name] > 1.5 * step]
    return base, base_quantum, based, ["; ".join([note, *late]) + "."]


def brought_together(
    time: np.ndarray, channels: Channels, pairs: Iterable[tuple[str, str]]
) -> tuple[Channels, list[str]]:
    """Channels of which no row has both of a pair, at the stamps of the one with more cells; a sentence on each pair.

    Angles of a pair are in rad, with jumps of a full turn.
    """
    based, notes = dict(channels), []
    for pair in pairs:
        known = {name: np.isfinite(channels[name] + time) for name in pair if name in channels}
        counts = sorted(int(rows.sum()) for rows in known.values())
        if len(counts) < 2 or counts[0] < 2 or 2 * (known[pair[0]] & known[pair[1]]).sum() >= counts[0]:
            continue
        base = max(known, key=lambda name: known[name].sum())
        for name, rows in known.items():
            order = np.flatnonzero(rows)[np.argsort(time[rows], kind="stable")]
            stamps, values = time[order], channels[name][order]
            values = values if name == "sog" else np.unwrap(values)
            based[name] = np.full(time.size, np.nan)
            based[name][known[base]] = _without_long_gaps(name, time[known[base]], stamps, values)
        notes.append(f"{', '.join(pair)} of rows of their own: interpolated to the stamps of {base}.")
    return based, notes


def without_held_readings(time: np.ndarray, quantum: np.ndarray, channels: Channels) -> tuple[*Rows, list[str]]:
    """Rows where only the first of the cells that hold one reading is left, beside a channel of every row."""
    holds = {name: _held_rows(values) for name, values in channels.items() if name not in _ORDERED}
    held = [name for name, rows in holds.items() if rows > 1]
    if not held or not any(np.mean(np.diff(channels[name]) != 0.0) > 0.5 for name in holds if name not in held):
        return time, quantum, channels, []
    first = {name: np.append(True, np.diff(channels[name]) != 0.0) for name in held}
    rows = ", ".join(f"{name} for {holds[name]} rows" for name in held)
    based = channels | {name: np.where(first[name], channels[name], np.nan) for name in held}
    return time, quantum, based, [f"A reading is held: {rows}; the first row of each counts."]


def _held_rows(values: np.ndarray) -> int:
    """Rows of one reading of a channel that a slow sensor holds; 1 for other channels, and for a rounded one."""
    moves = np.diff(values)
    at = np.flatnonzero(moves != 0.0)
    if at.size < _FEWEST_READINGS or not np.isfinite(values).all():
        return 1
    gaps, sizes = np.diff(at), np.abs(moves[at])
    rows = int(np.median(gaps))
    even = np.abs(gaps / rows - np.rint(gaps / rows)) <= _UNEVEN
    rounded = np.mean(np.abs(sizes - np.median(sizes)) < 1e-3 * np.median(sizes)) > _HELD
    return rows if np.mean(even & (gaps >= (1.0 - _UNEVEN) * rows)) >= _HELD and not rounded else 1


def _common_span(time: np.ndarray, ends: list[np.ndarray]) -> tuple[float, float]:
    """First and last time of all channels that cover most of the record, by the rows of the ends of each."""
    edge = (1.0 - _COVERED) * (time[-1] - time[0])
    firsts, lasts = (time[[pair[k] for pair in ends]] for k in (0, 1))
    covers = (firsts <= time[0] + edge) & (lasts >= time[-1] - edge)
    if not covers.any():
        return float(time[0]), float(time[-1])
    return float(firsts[covers].max()), float(lasts[covers].min())


def _without_long_gaps(name: str, at: np.ndarray, stamps: np.ndarray, values: np.ndarray) -> np.ndarray:
    """Channel at other stamps; NaN outside its own and in gaps that are too long."""
    after = np.clip(np.searchsorted(stamps, at), 1, stamps.size - 1)
    outside = (at < stamps[0]) | (at > stamps[-1])
    gap = (stamps[after] - stamps[after - 1] > longest_fill(stamps)) & (at > stamps[after - 1]) & (at < stamps[after])
    return np.where(outside | gap, np.nan, interpolated(name, at, stamps, values))


def without_repeated_rows(time: np.ndarray, quantum: np.ndarray, channels: Channels) -> tuple[*Rows, list[str]]:
    """One row for each stamp where rows of the same stamp show the same instant.

    Between such rows the channels do not advance; between samples of a coarse clock they advance evenly.
    """
    begins = np.flatnonzero(np.diff(time, prepend=-np.inf) > 0.0)
    if time.size < _REPEATED * begins.size or begins.size < 10:
        return time, quantum, channels, []
    advances = [_advance(values, begins) for values in channels.values() if np.isfinite(values).all()]
    told = [advance for advance in advances if np.isfinite(advance)]
    if not told or max(told) > 0.5:
        return time, quantum, channels, []
    note = f"{time.size - begins.size} of {time.size} rows repeat stamp and motion of the row before: left out."
    return time[begins], quantum[begins], {name: values[begins] for name, values in channels.items()}, [note]


def _advance(values: np.ndarray, begins: np.ndarray) -> float:
    """Change from the first to the last row of a stamp over that of even samples; NaN if noise hides it."""
    counts = np.diff(np.append(begins, values.size))
    means = np.add.reduceat(values, begins) / counts
    even = 0.5 * (means[2:] - means[:-2]) * (1.0 - 1.0 / counts[1:-1])
    within = (values[begins + counts - 1] - values[begins])[1:-1]
    if not np.std(even) > _SIGNAL * second_difference_sd(means[None])[0]:
        return np.nan
    return float(within @ even / (even @ even))


def undelayed(raw: dict[str, np.ndarray], time: np.ndarray, delays: Mapping[str, float]) -> dict[str, np.ndarray]:
    """Channels with those of a delay [s] as they were at their stamps; NaN where that is later than their last."""
    channels = dict(raw)
    for name, delay in delays.items():
        known = np.flatnonzero(np.isfinite(raw[name] + time))
        known = known[np.argsort(time[known], kind="stable")]
        stamps, values = time[known], raw[name][known]
        values = np.unwrap(values) if name in ("psi", "cog") else values
        at = stamps + delay
        inside = (at >= stamps[0]) & (at <= stamps[-1]) if known.size else np.zeros(0, dtype=bool)
        channels[name] = np.full(time.size, np.nan)
        channels[name][known[inside]] = interpolated(name, at[inside], stamps, values)
    return channels
