"""Uniform time base of a recorded trial, from rounded, repeated and uneven stamps; each change is reported."""

from __future__ import annotations

from bisect import bisect_right
from collections.abc import Iterator, Mapping, Sequence
from decimal import Decimal
from typing import NamedTuple

import numpy as np
import scipy

from pymc_ship.machine.errors import TrialError
from pymc_ship.records.files.interpolation import (
    Channels,
    Rows,
    interpolated,
    longest_fill,
    on_one_base,
    typical_step,
    without_held_readings,
    without_repeated_rows,
)
from pymc_ship.trial.channels import SIMULATED
from pymc_ship.trial.record import is_uniform

_STRAY_FRACTION = 0.01  # largest fraction of rows out of order that are dropped one by one; more are a new run
_NEIGHBOURS = 20  # rows before and after a step back that show whether the clock runs on from there
_REPEATED_FRACTION = 0.1  # of stamps, from which the clock is coarse
_USUAL = 1.5  # steps of a thinned record, at their 99 % quantile, from which one has a gap
_FEWEST_DIGITS = 3  # significant digits of a stamp
_MOST_DECIMALS, _EXACT = 9, 1e15  # of a number that a logger prints, and integers that print as they are
_FEWEST_STAMPS = 5  # different ones, of as many rows each, that show the interval of the samples
_MOST_SAMPLES = 10  # largest ratio of samples after and before resampling

_DEAREST = {"x": 0.1, "y": 0.1}  # fraction of rows that a channel may cost before it is left out; 0.5 for others


class Regular(NamedTuple):
    """Uniform time [s], finite channels, a sentence on each change, and the fraction of the rows that are lost."""

    time: np.ndarray
    channels: Channels
    notes: list[str]
    lost: float


def rounding(cells: np.ndarray) -> np.ndarray:
    """Resolution of time stamps as printed: the coarser of last decimal and last significant digit of all stamps."""
    known = np.isfinite(cells)
    decimals, digits = _decimals_and_digits(cells[known]) if known.any() else (0, 0)
    magnitude = np.floor(np.log10(np.maximum(np.abs(cells[known]), 1e-300)))
    quantum = np.zeros_like(cells)
    quantum[known] = np.maximum(10.0 ** -float(decimals), 10.0 ** (magnitude + 1 - max(digits, _FEWEST_DIGITS)))
    return quantum


def _decimals_and_digits(values: np.ndarray) -> tuple[int, int]:
    """Most decimals of numbers as printed, negative for tens, and most significant digits.

    A double prints as the decimal of at most 15 digits that it is nearest to, if there is one.
    """
    printed = []
    for decimals in range(_MOST_DECIMALS + 1):
        with np.errstate(over="ignore"):
            scaled = np.rint(values * 10.0**decimals)
        fits = (np.abs(scaled) < _EXACT) & (scaled / 10.0**decimals == values)
        printed += [_printed(decimals, scaled[fits].astype(np.int64))] if fits.any() else []
        values = values[~fits]
    for value in values.tolist():
        number = Decimal(repr(value)).normalize().as_tuple()
        printed.append((-int(number.exponent), len(number.digits)))
    most_decimals, most_digits = np.max(printed, axis=0).tolist()
    return most_decimals, most_digits


def _printed(decimals: int, scaled: np.ndarray) -> tuple[int, int]:
    """Most decimals and digits of integers over a power of ten, without the zeros at their end."""
    zeros = np.zeros_like(scaled)
    while (ends := (scaled % 10 == 0) & (scaled != 0)).any():
        scaled, zeros = np.where(ends, scaled // 10, scaled), zeros + ends
    return decimals - int(zeros.min()), len(str(np.abs(scaled).max()))


def without_mixed_medians(
    time: np.ndarray, quantum: np.ndarray, begins: Sequence[int] = ()
) -> tuple[np.ndarray, list[str]]:
    """Stamps [s] of a thinned record, NaN on both sides of each gap, where medians may be of both; a sentence.

    ``begins``: the first row of each file, for stamps of several.
    """
    known, mixed = np.flatnonzero(np.isfinite(time)), []
    for rows in np.split(known, np.searchsorted(known, [*begins][1:])):
        steps = np.diff(time[rows])
        if steps.size:
            steps *= np.sign(np.median(steps)) or 1.0  # the newest row may be first
            usual = _USUAL * np.quantile(steps, 0.99)
            longest = longest_fill(np.sort(time[rows])) + quantum[rows[1:]]
            gaps = np.flatnonzero((steps < 0.0) | (steps > np.minimum(usual, longest)))
            mixed += [rows[gaps], rows[gaps + 1]]
    at = np.unique(np.concatenate(mixed)) if mixed else known[:0]
    if not at.size:
        return time, []
    stamps = time.copy()
    stamps[at] = np.nan
    return stamps, [f"{_count(at.size, 'median')} beside gaps left out, which may be of rows on both sides."]


def in_order(
    time: np.ndarray, quantum: np.ndarray, channels: dict[str, np.ndarray], begins: Mapping[str, int]
) -> tuple[np.ndarray, np.ndarray, dict[str, np.ndarray]]:
    """Rows of several files in the order of time; TrialError where one goes back, or ends before another begins."""
    bounds = [*begins.values(), time.size]
    spans: dict[str, tuple[float, float]] = {}
    for name, begin, end in zip(begins, bounds[:-1], bounds[1:], strict=True):
        steps = np.diff(time[begin:end][np.isfinite(time[begin:end])])
        if (steps < 0.0).any():
            raise TrialError(
                f"{name}: the time of a file that is joined to others must not go back, found a step of "
                f"{steps.min():.4g} s; mend its clock, or take the file out of the folder."
            )
        if np.isfinite(time[begin:end]).any():
            spans[name] = float(np.nanmin(time[begin:end])), float(np.nanmax(time[begin:end]))
    _check_overlap(spans)
    order = np.argsort(time, kind="stable")
    return time[order], quantum[order], {name: values[order] for name, values in channels.items()}


def _check_overlap(spans: Mapping[str, tuple[float, float]]) -> None:
    """Raise TrialError if a file begins [s] after another ends."""
    late = max(spans, key=lambda name: spans[name][0], default="")
    early = min(spans, key=lambda name: spans[name][1], default="")
    if late and spans[late][0] > spans[early][1]:
        apart = spans[late][0] - spans[early][0]
        raise TrialError(
            f"{late}: the clocks of the files of a run overlap, found its first row {apart:.4g} s after "
            f"that of {early}, which ends before; set both to one clock, such as one time zone."
        )


def regular(time: np.ndarray, quantum: np.ndarray, channels: Channels, where: str) -> Regular:
    """Channels over uniform time, each interpolated on its own stamps.

    ``time`` are the stamps [s] and ``quantum`` their resolution [s]; NaN marks missing stamps and cells. TrialError for
    fewer than two complete samples or very uneven sampling; ``where`` names the file.
    """
    notes: list[str] = []
    keep, rows = np.isfinite(time), time.size
    if not keep.all():
        notes.append(f"{_count((~keep).sum(), 'row')} without a time left out.")
        time, quantum, channels = _rows(keep, time, quantum, channels)
    left = 1.0
    resampling = (without_repeated_rows, without_held_readings, on_one_base)
    for step in (_newest_last, _increasing, *resampling, _fill_short_gaps, _longest_piece):
        if time.size < 2:
            break
        time, quantum, channels, note = step(time, quantum, channels)
        notes += note
        if step not in resampling:
            left *= time.size / rows
        rows = time.size
    if time.size < 2 or not channels:
        raise TrialError(f"{where}: a trial has at least two complete rows, found {time.size}; check its cells.")
    stamps = np.unique(time).size
    if 1 < stamps < _FEWEST_STAMPS and time.size > _FEWEST_STAMPS * stamps:
        raise TrialError(
            f"{where}: the time tells the rows of a trial apart, found {stamps} different stamps in {time.size} rows; "
            "write the time with more digits, or name another column of it, [columns] time."
        )
    if not is_uniform(time):
        time, channels, change = _uniform(time, quantum, channels, where)
        notes.append(change)
    return Regular(time, channels, notes, 1.0 - left)


def _count(number: int, noun: str) -> str:
    return f"{number} {noun}{'s' if number != 1 else ''}"


def _rows(keep: np.ndarray | slice, time: np.ndarray, quantum: np.ndarray, channels: Channels) -> Rows:
    return time[keep], quantum[keep], {name: values[keep] for name, values in channels.items()}


def _newest_last(time: np.ndarray, quantum: np.ndarray, channels: Channels) -> tuple[*Rows, list[str]]:
    """Rows in reverse order where most stamps are before the stamp of the row above."""
    if not (np.diff(time) < 0.0).mean() > 0.5:
        return time, quantum, channels, []
    return *_rows(slice(None, None, -1), time, quantum, channels), ["The newest row is first: rows taken in reverse."]


def _increasing(time: np.ndarray, quantum: np.ndarray, channels: Channels) -> tuple[*Rows, list[str]]:
    """Rows with non-decreasing stamps: without stray rows, or the longest run between two jumps back."""
    back = np.flatnonzero(np.diff(time) < 0.0)
    if not back.size:
        return time, quantum, channels, []
    keep = _longest_increasing(time.tolist())
    if keep.size >= (1.0 - _STRAY_FRACTION) * time.size - 1.0 and not _is_set_back(time, channels):
        stray = _count(time.size - keep.size, "row")
        note = f"{stray} out of the order of time left out, the first near t = {time[back[0]]:g} s."
    else:
        bounds = np.concatenate([[0], back + 1, [time.size]])
        longest = int(np.argmax(np.diff(bounds)))
        keep = np.arange(bounds[longest], bounds[longest + 1])
        note = (
            f"Time goes back {_count(back.size, 'time')}, the first at t = {time[back[0]]:g} s: the longest run "
            f"is used, {keep.size} of {time.size} rows, t = {time[keep[0]]:g} to {time[keep[-1]]:g} s; split the file "
            "for the rest."
        )
    return *_rows(keep, time, quantum, channels), [note]


def _is_set_back(time: np.ndarray, channels: Channels) -> bool:
    """Whether the clock runs on after a step back by two rows or more, which are not a copy of earlier rows."""
    step = typical_step(np.sort(time))
    table = np.column_stack([time, *channels.values()])
    ahead = time - step * np.arange(time.size)
    for k in np.flatnonzero(np.diff(time) < 0.0) + 1:
        before, after = ahead[max(k - _NEIGHBOURS, 0) : k], ahead[k : k + _NEIGHBOURS]
        shift = np.median(after) - np.median(before)
        copied = (np.nan_to_num(table[:k]) == np.nan_to_num(table[k])).all(axis=1).any()
        if shift < -1.5 * step and not copied and min(before.size, after.size) == _NEIGHBOURS:
            return True
    return False


def _longest_increasing(stamps: list[float]) -> np.ndarray:
    """Indices of the longest non-decreasing subsequence (patience sorting)."""
    ends: list[float] = []
    positions: list[int] = []
    before = []
    for index, stamp in enumerate(stamps):
        pile = bisect_right(ends, stamp)
        before.append(positions[pile - 1] if pile else -1)
        if pile == len(ends):
            ends.append(stamp)
            positions.append(index)
        else:
            ends[pile], positions[pile] = stamp, index
    chain = [positions[-1]]
    while before[chain[-1]] >= 0:
        chain.append(before[chain[-1]])
    return np.array(chain[::-1])


def _fill_short_gaps(time: np.ndarray, quantum: np.ndarray, channels: Channels) -> tuple[*Rows, list[str]]:
    """Short runs of missing cells interpolated; rows of long runs and channels that miss most cells dropped."""
    keep, filled, notes = np.ones(time.size, dtype=bool), {}, []
    for name, values in channels.items():
        missing = ~np.isfinite(values)
        if not missing.any():
            filled[name] = values
            continue
        short = _short_runs(missing, time, longest_fill(time))
        long = missing & ~short
        dearest = _DEAREST.get(name, 0.5 if name in SIMULATED else 0.0)
        if long.sum() > dearest * time.size or missing.all():
            notes.append(f"{name} left out: {missing.sum()} of {time.size} cells are missing.")
            continue
        index = np.arange(time.size)
        filled[name] = np.where(short, interpolated(name, index, index[~missing], values[~missing]), values)
        if short.any():
            notes.append(f"{name}: {short.sum()} of {time.size} cells missing, filled by interpolation.")
        if long.any():
            notes.append(f"{name}: {long.sum()} cells missing in longer runs or at an end, their rows left out.")
        keep &= ~long
    return *_rows(keep, time, quantum, filled), notes


def _short_runs(missing: np.ndarray, time: np.ndarray, longest: float) -> np.ndarray:
    """Mask of missing samples in runs short enough to be interpolated."""
    there = np.flatnonzero(~missing)
    if there.size < 2:
        return np.zeros_like(missing)
    after = np.searchsorted(there, np.arange(missing.size))
    inside = (after > 0) & (after < there.size)
    last, following = there[np.clip(after - 1, 0, None)], there[np.clip(after, None, there.size - 1)]
    return missing & inside & (time[following] - time[last] <= longest)


def _longest_piece(time: np.ndarray, quantum: np.ndarray, channels: Channels) -> tuple[*Rows, list[str]]:
    """Longest piece between two gaps too long to be interpolated."""
    limit = longest_fill(time)
    cuts = np.flatnonzero(np.diff(time) > limit + quantum[1:]) + 1
    if not cuts.size:
        return time, quantum, channels, []
    bounds = np.concatenate([[0], cuts, [time.size]])
    first, last = max(zip(bounds[:-1], bounds[1:] - 1, strict=True), key=lambda piece: time[piece[1]] - time[piece[0]])
    gap = cuts[np.argmax(time[cuts] - time[cuts - 1])]
    note = (
        f"{_count(cuts.size, 'gap')} of more than {limit:.3g} s, the longest from {time[gap - 1]:g} "
        f"to {time[gap]:g} s: the longest piece is used, {last - first + 1} of {time.size} rows, t = {time[first]:g} "
        f"to {time[last]:g} s; split the file for the rest."
    )
    return *_rows(slice(first, last + 1), time, quantum, channels), [note]


def _uniform(time: np.ndarray, quantum: np.ndarray, channels: Channels, where: str) -> tuple[np.ndarray, Channels, str]:
    """Channels on a uniform grid: that of the rounded stamps if it exists, or of the mean step."""
    steps, n = np.diff(time), time.size
    step_range = f"steps from {steps.min():.4g} to {steps.max():.4g} s"
    repeated = int((steps == 0.0).sum())
    for positions, tolerance in _explanations(time, quantum):
        line = _line(positions, time, tolerance)
        if line is None:
            continue
        begin, step = line
        grid, jumps = np.arange(positions[-1] + 1), np.diff(positions)
        resampled = {name: interpolated(name, grid, positions, values) for name, values in channels.items()}
        change = np.abs(begin + step * positions - time).max()
        note = []
        if change > 1e-3 * step:
            again = f"{repeated} of {n} time stamps repeated, " if repeated else ""
            uniform = f"replaced by a uniform step of {step:.7g} s (largest change {change:.2g} s)"
            note.append(f"{again}{step_range}, probably rounded by the logger: {uniform}")
        if grid.size > n:
            gaps = f"{_count(int((jumps > 1).sum()), 'gap')} of up to {_count(int(jumps.max()) - 1, 'sample')}"
            note.append(f"{gaps}: {grid.size - n} filled by interpolation")
        return begin + step * grid, resampled, "; ".join(note or [f"{step_range} made uniform"]) + "."
    return _resample(time, channels, where, step_range)


def _resample(time: np.ndarray, channels: Channels, where: str, step_range: str) -> tuple[np.ndarray, Channels, str]:
    """Channels interpolated to the mean step of the intervals without gaps."""
    first = np.concatenate([[True], np.diff(time) > 0.0])
    time, repeated = time[first], int((~first).sum())
    if time.size < 2:
        raise TrialError(f"{where}: the time of a trial must increase, found {time[0]:g} s in every row; correct it.")
    steps = np.diff(time)
    step = float(steps[steps < 1.5 * np.median(steps)].mean())
    count = (time[-1] - time[0]) / step
    if not count < _MOST_SAMPLES * first.size:
        raise TrialError(f"{where}: the sampling is too uneven to be resampled, found {step_range}; correct its time.")
    grid = time[0] + step * np.arange(int(count + 1e-6) + 1)
    resampled = {name: interpolated(name, grid, time, values[first]) for name, values in channels.items()}
    note = f"{_count(repeated, 'row')} with repeated time stamps left out; " if repeated else ""
    return grid, resampled, f"{note}{step_range}: resampled to the mean step of {step:.7g} s by interpolation."


def _explanations(time: np.ndarray, quantum: np.ndarray) -> Iterator[tuple[np.ndarray, np.ndarray]]:
    """Positions of the samples on a uniform grid and tolerances of the stamps, the most probable first."""
    every, steps = np.arange(time.size), np.diff(time)
    positive = steps[steps > 0.0]
    if not positive.size:
        return
    tolerance, step = 0.5 * quantum, float(np.median(positive))
    multiples = np.maximum(np.round(steps / step), 1.0)
    with_gaps = np.concatenate([[0], np.cumsum(np.where(steps > 1.5 * step + 0.5 * quantum[1:], multiples, 1.0))])
    whole = (np.abs(steps / step - multiples) < 1e-3).all() and (multiples > 1.0).mean() < 0.05
    if whole:
        yield np.concatenate([[0], np.cumsum(multiples)]).astype(int), tolerance
    yield every, tolerance
    if with_gaps[-1] > every[-1] and with_gaps[-1] < _MOST_SAMPLES * time.size:
        yield with_gaps.astype(int), tolerance
    if positive.size < (1.0 - _REPEATED_FRACTION) * steps.size:
        yield every, np.maximum(tolerance, step)


def _line(positions: np.ndarray, time: np.ndarray, tolerance: np.ndarray) -> tuple[float, float] | None:
    """Begin and step of a line within the tolerance of every stamp; None without one."""
    step = (time[-1] - time[0]) / positions[-1]
    tolerance = tolerance + 1e-6 * step
    if step > 0.0 and (np.abs(time[0] + step * positions - time) <= tolerance).all():
        return float(time[0]), float(step)
    table, elapsed = np.column_stack([np.ones(time.size), positions, -tolerance]), time - time[0]
    solution = scipy.optimize.linprog(
        [0.0, 0.0, 1.0],
        A_ub=np.vstack([table, table * [-1.0, -1.0, 1.0]]),
        b_ub=np.concatenate([elapsed, -elapsed]),
        bounds=[(None, None), (None, None), (0.0, None)],
    )
    if solution.status != 0 or solution.x[2] > 1.0 + 1e-6 or solution.x[1] <= 0.0:
        return None
    return float(time[0] + solution.x[0]), float(solution.x[1])
