"""Stationary and decimated wavelet transforms of a finite signal, and its extension past its ends."""

import math

import numpy as np
import pywt
from numba import njit

from pymc_ship.machine.arguments import short_repr
from pymc_ship.machine.errors import ShipError
from pymc_ship.records.denoising.ebayes import mad

BOUNDARIES = ("reflect", "periodic")
"""Extension past the ends. `reflect`: mirror image of the signal minus a parabola with its end slopes. `periodic`:
repetition of the signal."""

ACCURACY = 1e-11  # relative, of the filters of PyWavelets
REST = 16  # equal samples, from which a sensor is at rest
FEWEST_STEPS = 10  # values of a rounded signal; fewer are the steps of an order
ORTHOGONAL = 1e-9  # largest inner product of a low-pass filter and its shifts by two; less 1 without a shift


def transform(
    padded: np.ndarray, filters: pywt.Wavelet, levels: int, translation_invariant: bool
) -> tuple[np.ndarray, list[np.ndarray]]:
    """Approximation and details, coarsest first, of the periodic transform; white noise keeps its variance in all."""
    approximation = padded
    details: list[np.ndarray] = []
    for level in range(levels):
        if translation_invariant:
            extended = _extended(approximation, filters.dec_len // 2 - 1, filters.dec_len // 2, 2**level)
            approximation, detail = np.zeros(padded.size), np.zeros(padded.size)
            _add_filtered(extended, np.array(filters.rec_lo), 2**level, approximation)
            _add_filtered(extended, np.array(filters.rec_hi), 2**level, detail)
        else:
            approximation, detail = pywt.dwt(approximation, filters, "periodization")
        details.insert(0, detail)
    return approximation, details


def inverse(
    approximation: np.ndarray, details: list[np.ndarray], filters: pywt.Wavelet, translation_invariant: bool
) -> np.ndarray:
    """Signal from its :func:`transform`; the stationary one is averaged over all shifts."""
    if not translation_invariant:
        return pywt.waverec([approximation, *details], filters, "periodization")
    for level, detail in zip(range(len(details) - 1, -1, -1), details, strict=True):
        total = np.zeros(detail.size)
        for part, taps in ((approximation, filters.dec_lo), (detail, filters.dec_hi)):
            extended = _extended(part, filters.dec_len // 2, filters.dec_len // 2 - 1, 2**level)
            _add_filtered(extended, 0.5 * np.array(taps), 2**level, total)
        approximation = total
    return approximation


def _extended(signal: np.ndarray, before: int, after: int, step: int) -> np.ndarray:
    return np.pad(signal, (before * step, after * step), "wrap")


@njit(cache=True, nogil=True, fastmath={"contract"})
def _add_filtered(extended: np.ndarray, taps: np.ndarray, step: int, total: np.ndarray) -> None:
    """Add to the total the sum of taps[k] extended[i + k step], two taps at a time."""
    for k in range(0, taps.size, 2):
        first, second = extended[k * step :], extended[(k + 1) * step :]
        for i in range(total.size):
            total[i] += taps[k] * first[i] + taps[k + 1] * second[i]


def end_trend(signal: np.ndarray) -> np.ndarray:
    """Parabola with the slopes of the signal at its two ends."""
    n_time = signal.size
    sdev = mad(np.diff(signal, 2)[moving(signal)[1:-1]]) / math.sqrt(6.0)
    first, last = _end_slope(signal, sdev), -_end_slope(signal[::-1], sdev)
    time = np.arange(n_time) + 0.5
    return first * time + (last - first) * time**2 / (2.0 * n_time)


def moving(signal: np.ndarray) -> np.ndarray:
    """Mask of the samples outside runs of :data:`REST` equal values; all, if less than a tenth of the signal moves."""
    edges = np.flatnonzero(np.diff(signal, prepend=np.nan, append=np.nan))
    lengths = np.diff(edges)
    mask = np.repeat(lengths < REST, lengths)
    return mask if mask.mean() > 0.1 else np.ones(signal.size, dtype=bool)


def is_straight(signal: np.ndarray) -> bool:
    """Whether a signal consists of straight lines, at least where it moves: it has no noise."""
    bends = np.abs(np.diff(signal, 2))[moving(signal)[1:-1]]
    return bool(bends.max(initial=0.0) <= ACCURACY * np.abs(signal).max())


def rounding_sdev(signal: np.ndarray) -> float:
    """Standard deviation of the error of rounding, step / 12^(1/2).

    0 for values that are no multiples of a step, and for the even steps of straight lines.
    """
    if is_straight(signal):
        return 0.0
    values = np.unique(signal)
    steps = np.diff(values)
    steps = steps[steps > 1e-9 * np.abs(signal).max()]
    if steps.size < FEWEST_STEPS:
        return 0.0
    multiples = (values - values[0]) / steps.min()
    return float(steps.min()) / math.sqrt(12.0) if np.abs(multiples - multiples.round()).max() < 0.01 else 0.0


def _end_slope(signal: np.ndarray, sdev: float) -> float:
    """Slope per sample at the start, by a parabola over the longest run whose cubic is below 2.5 standard errors."""
    slope, n_run = 0.0, 16
    while 2 * n_run <= signal.size:
        time = (np.arange(n_run) + 0.5) / n_run - 0.5
        line, parabola = time, time**2 - (1.0 - n_run**-2) / 12.0  # orthogonal to each other, to 1 and to the cubic
        cubic = time * (time**2 - (3.0 - 7.0 * n_run**-2) / 20.0)
        if abs(cubic @ signal[:n_run]) > 2.5 * sdev * np.linalg.norm(cubic):
            break
        to_slope = line / (line @ line) - parabola / (parabola @ parabola)
        start = to_slope @ signal[:n_run]
        slope = start / n_run if abs(start) > 5.0 * sdev * np.linalg.norm(to_slope) else 0.0
        n_run *= 2
    return slope


def margins(n_time: int, support: int, levels: int, boundary: str, what: str) -> tuple[int, int]:
    """Samples to add before and after: half the coarsest filter or half the signal, to a multiple of 2**levels."""
    block = 2**levels
    if boundary == "periodic":
        if n_time % block:
            raise ShipError(
                f"A periodic {what} must have a multiple of 2**levels = {block} samples, found {n_time}; use the "
                "boundary 'reflect' or fewer levels."
            )
        return 0, 0
    margin = min((support - 1) * block // 2, n_time // 2)
    added = -(-(n_time + 2 * margin) // block) * block - n_time
    return added // 2, added - added // 2


def inside(n_detail: int, n_padded: int, before: int, after: int) -> slice:
    """Coefficients of a level without those of the margins."""
    return slice(before * n_detail // n_padded, n_detail - after * n_detail // n_padded)


def orthogonal_wavelet(name: str) -> pywt.Wavelet:
    """Wavelet of PyWavelets whose filters are orthogonal to their shifts by two; ValueError for another name."""
    filters, deviation = None, math.inf
    if isinstance(name, str) and name in pywt.wavelist(kind="discrete"):
        filters = pywt.Wavelet(name)
        low_pass = np.array(filters.dec_lo)
        products = np.correlate(low_pass, low_pass, "full")[low_pass.size - 1 :: 2]  # of the filter and its shifts
        products[0] -= 1.0
        deviation = max(np.abs(products).max(), np.abs(low_pass - filters.rec_lo[::-1]).max())
    if filters is None or deviation > ORTHOGONAL:
        raise ShipError(
            f"Denoising needs an orthogonal wavelet, found {short_repr(name)}; take one such as haar, db4 or sym8."
        )
    return filters


def whole_levels(n_time: int, levels: int | None, what: str) -> int:
    """Levels of a transform, by default as many as leave eight coefficients; ValueError out of range."""
    largest = int(math.log2(n_time))
    if levels is None:
        return largest - 3
    if isinstance(levels, bool) or not isinstance(levels, int | np.integer) or not 1 <= levels <= largest:
        raise ShipError(f"The {what} ({n_time} samples) has 1 to {largest} levels, found {levels}; choose among them.")
    return levels
