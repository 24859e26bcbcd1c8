"""Runs of one ship against each other: the same motion given twice."""

from __future__ import annotations

from collections.abc import Mapping
from itertools import combinations

import numpy as np
import xarray as xr
from scipy.signal import correlate

from pymc_ship.trial.record import sampling_interval, second_difference_sd

SAME = 0.02  # rms difference over the standard deviation of a channel below which, beside noise, motions are the same
_CHANNELS = ("r", "delta")  # two runs of one manoeuvre differ in the times of the rudder
_FRACTIONS = np.linspace(-1.0, 1.0, 21)  # of a sample, of the shift


def repeated_runs(trials: Mapping[str, xr.Dataset]) -> list[str]:
    """Sentences on pairs of runs, by name, whose motion is the same but for noise and a shift of the clock."""
    sentences = []
    for (one, first), (other, second) in combinations(trials.items(), 2):
        shift = _shift_of_same_motion(first, second)
        if shift is not None:
            apart = f", {abs(shift):.3g} s apart" if abs(shift) > max(map(sampling_interval, (first, second))) else ""
            sentences.append(
                f"Runs {one} and {other} are the same motion but for noise{apart}: one run, or one by two loggers, "
                "counts twice and the intervals are too narrow; leave one out."
            )
    return sentences


def _shift_of_same_motion(first: xr.Dataset, second: xr.Dataset) -> float | None:
    """Time [s] by which the second run is later, if half of the shorter run or more is of one motion; else None."""
    if not set(_CHANNELS) <= {*first} & {*second}:
        return None
    step = max(sampling_interval(first), sampling_interval(second))
    one, other = (_resampled(trial, step) for trial in (first, second))
    lag = _closest_lag(one[0], other[0])
    sd = np.maximum(one.std(axis=1), other.std(axis=1))
    noise = np.hypot(second_difference_sd(one), second_difference_sd(other))
    for shift in lag + _FRACTIONS:
        at = np.arange(one.shape[1]) + shift
        inside = (at >= 0.0) & (at <= other.shape[1] - 1.0)
        moved = np.array([np.interp(at[inside], np.arange(other.shape[1]), values) for values in other])
        difference = np.sqrt(np.mean((moved - one[:, inside]) ** 2, axis=1))
        if (difference <= 1.5 * noise + SAME * sd).all():
            return float(shift * step + second["time"].values[0] - first["time"].values[0])
    return None


def _closest_lag(one: np.ndarray, other: np.ndarray) -> int:
    """Lag in samples at which other[k + lag] is nearest to one[k] in the mean square, of overlaps of half a run."""
    lags = np.arange(1 - one.size, other.size)
    begin, end = np.maximum(0, -lags), np.minimum(one.size, other.size - lags)  # of the overlap, in the first
    energy = [np.append(0.0, np.cumsum(values**2)) for values in (one, other)]
    square = energy[0][end] - energy[0][begin] + energy[1][end + lags] - energy[1][begin + lags]
    square -= 2.0 * correlate(other, one, mode="full", method="fft")
    enough = end - begin >= 0.5 * min(one.size, other.size)
    return int(lags[np.argmin(np.where(enough, square / np.maximum(end - begin, 1), np.inf))])


def _resampled(trial: xr.Dataset, step: float) -> np.ndarray:
    """Channels at even steps, shape (n_channels, n_time)."""
    time = trial["time"].values
    at = np.arange(time[0], time[-1] + 0.5 * step, step)
    return np.array([np.interp(at, time, trial[name].values) for name in _CHANNELS])
