"""Linear smoothers with automatic choice of their parameter.

Filters: least n RSS / (n - tr H)^2, H the smoother matrix (Craven & Wahba 1979, doi:10.1007/BF01404567).
"""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
import scipy

from pymc_ship.records.denoising import wavelets

POLYNOMIAL_ORDER = 3  # of the Savitzky-Golay filter
BUTTERWORTH_ORDER = 4
SMALLEST_Q, LARGEST_Q = 1e-13, 1e4  # var(w) / var(e) of :func:`rts`; below it the matrices become singular
_RATIO = 1.15  # of successive windows or cut-offs in the search


class Smooth(NamedTuple):
    """Smooth signal (n_time,), noise standard deviation, and parameter in samples."""

    estimate: np.ndarray
    sdev: float
    parameter: float


class Smoother(NamedTuple):
    """A smoother and the name of its parameter."""

    smooth: Callable[[np.ndarray], Smooth]
    parameter: str


def savitzky_golay(signal: np.ndarray) -> Smooth:
    """Local cubic over a window of samples; the ends by the cubic of the outermost window."""
    n_time = signal.size
    best = (np.inf, signal, 0.0, 0)
    for half in _grid((POLYNOMIAL_ORDER + 2) // 2, (n_time - 1) // 2):
        window, offsets = 2 * half + 1, np.arange(-half, half + 1)
        norm = (2.0 * half - 1.0) * (2.0 * half + 1.0) * (2.0 * half + 3.0) / 3.0
        weights = (3.0 * half * half + 3.0 * half - 1.0 - 5.0 * offsets**2) / norm
        ends = signal[:window], signal[-window:]
        begin, end = (np.polynomial.Polynomial.fit(offsets, part, 3)(offsets) for part in ends)
        middle = scipy.signal.oaconvolve(signal, weights, "valid")
        estimate = np.concatenate([begin[:half], middle, end[half + 1 :]])
        trace = (n_time - window) * weights[half] + POLYNOMIAL_ORDER + 1
        best = min(best, (*_cross_validation(signal, estimate, trace), window), key=lambda result: result[0])
    _, estimate, sdev, window = best
    return Smooth(estimate, sdev, float(window))


def low_pass(signal: np.ndarray) -> Smooth:
    """Zero-phase Butterworth filter with a cut-off [cycles per sample], by the cosine transform less a trend."""
    n_time, trend = signal.size, wavelets.end_trend(signal)
    spectrum = scipy.fft.dct(signal - trend, norm="ortho")
    best = (np.inf, 0.0, np.zeros(0), 0)
    for cutoff in _grid(1, n_time):
        gain = 1.0 / (1.0 + (np.arange(n_time) / cutoff) ** (2.0 * BUTTERWORTH_ORDER))
        score, smooth, sdev = _cross_validation(spectrum, gain * spectrum, gain.sum())
        best = min(best, (score, sdev, smooth, cutoff), key=lambda result: result[0])
    _, sdev, smooth, cutoff = best
    return Smooth(scipy.fft.idct(smooth, norm="ortho") + trend, sdev, 0.5 * cutoff / n_time)


def rts(signal: np.ndarray) -> Smooth:
    """Smoother of Rauch, Tung & Striebel (1965), doi:10.2514/3.3166, for a random-walk slope, q of maximum likelihood.

    x_{k+1} = x_k + s_k, s_{k+1} = s_k + w_k, y_k = x_k + e_k, var(w) = q var(e), flat priors of x_0 and s_0: D y, the
    second differences, have covariance var(e) (q I + D D'), and x = y - D' (q I + D D')^-1 D y.
    """
    bends = np.diff(signal, 2)
    n_bends = bends.size
    bands = np.repeat([[1.0], [-4.0], [6.0]], n_bends, axis=1)

    def solve(log_q: float) -> tuple[float, np.ndarray, float]:
        """-2 log likelihood up to a constant, (q I + D D')^-1 D y, and noise variance of maximum likelihood."""
        factor = scipy.linalg.cholesky_banded(bands + np.array([[0.0], [0.0], [np.exp(log_q)]]))
        weights = scipy.linalg.cho_solve_banded((factor, False), bends)
        variance = float(bends @ weights) / n_bends
        return n_bends * np.log(variance) + 2.0 * float(np.log(factor[-1]).sum()), weights, variance

    grid = np.arange(np.log(SMALLEST_Q), np.log(LARGEST_Q), 1.0)
    best = grid[int(np.argmin([solve(log_q)[0] for log_q in grid]))]
    optimum = scipy.optimize.minimize_scalar(
        lambda log_q: solve(log_q)[0], bounds=(best - 1.0, best + 1.0), method="bounded"
    )
    log_q = float(np.clip(optimum.x, np.log(SMALLEST_Q), np.log(LARGEST_Q)))
    _, weights, variance = solve(log_q)
    return Smooth(signal - np.diff(np.pad(weights, 2), 2), float(np.sqrt(variance)), float(np.exp(log_q)))


SMOOTHERS = {
    "savitzky_golay": Smoother(savitzky_golay, "window"),
    "low_pass": Smoother(low_pass, "cutoff"),
    "rts": Smoother(rts, "q"),
}


def smooth_signal(signal: np.ndarray, method: str) -> Smooth:
    """Signal smoothed by one of :data:`SMOOTHERS`; unchanged if it consists of straight lines."""
    if wavelets.is_straight(signal):
        return Smooth(signal.copy(), 0.0, np.nan)
    return SMOOTHERS[method].smooth(signal)


def _grid(first: int, last: int) -> list[int]:
    count = int(np.log(last / first) / np.log(_RATIO)) + 2
    return np.unique(np.geomspace(first, last, count).round().astype(int)).tolist()


def _cross_validation(signal: np.ndarray, estimate: np.ndarray, trace: float) -> tuple[float, np.ndarray, float]:
    """Generalised cross-validation of a linear smoother, its estimate and the noise standard deviation."""
    residual, freedom = float(np.sum((signal - estimate) ** 2)), signal.size - trace
    return signal.size * residual / freedom**2, estimate, float(np.sqrt(residual / freedom))
