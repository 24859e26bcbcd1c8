"""Linear smoothers beside the wavelets, each of which chooses its one parameter from the signal by a stated principle.

Savitzky-Golay and low-pass filters take the parameter of least generalised cross-validation, n RSS / (n - tr H)^2, in
which RSS is the sum of squared residuals and H the matrix of the smoother: Craven & Wahba (1979), Numer. Math. 31:377,
doi:10.1007/BF01404567. The Rauch-Tung-Striebel smoother takes that of largest marginal likelihood.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from pymc_ship.records.denoising import wavelets

POLYNOMIAL_ORDER = 3
"""Order of the polynomial of the Savitzky-Golay filter, that of the derivative."""

BUTTERWORTH_ORDER = 4
"""Order of the low-pass filter, run forward and backward."""

SMALLEST_Q, LARGEST_Q = 1e-13, 1e4
"""Range of the variance of the second differences over that of the noise; below it the matrices lose their rank."""

_RATIO = 1.15
"""Ratio from one window or cut-off to the next that is tried."""


class Smooth(NamedTuple):
    """Smooth signal (n_time,), standard deviation of the noise, and the parameter chosen, in samples."""

    estimate: np.ndarray
    sdev: float
    parameter: float


class Smoother(NamedTuple):
    """A smoother and the name of its parameter."""

    smooth: Callable[[np.ndarray], Smooth]
    parameter: str


def savitzky_golay(signal: np.ndarray) -> Smooth:
    """Local cubic through a window of so many samples; the ends by the cubic of the outermost window."""
    from scipy.signal import oaconvolve

    n_time = signal.size
    best = (np.inf, signal, 0.0, 0)
    for half in _tried((POLYNOMIAL_ORDER + 2) // 2, (n_time - 1) // 2):
        window, offsets = 2 * half + 1, np.arange(-half, half + 1)
        norm = (2.0 * half - 1.0) * (2.0 * half + 1.0) * (2.0 * half + 3.0) / 3.0
        weights = (3.0 * half * half + 3.0 * half - 1.0 - 5.0 * offsets**2) / norm
        begin, end = (np.polynomial.Polynomial.fit(offsets, part, 3)(offsets) for part in _ends(signal, window))
        middle = oaconvolve(signal, weights, "valid")
        estimate = np.concatenate([begin[:half], middle, end[half + 1 :]])
        trace = (n_time - window) * weights[half] + POLYNOMIAL_ORDER + 1
        best = min(best, (*_scored(signal, estimate, trace), window), key=lambda found: found[0])
    _, estimate, sdev, window = best
    return Smooth(estimate, sdev, float(window))


def low_pass(signal: np.ndarray) -> Smooth:
    """Butterworth filter without phase: its gain on the cosine transform, below a cut-off [cycles per sample].

    The transform continues the signal as its mirror image, once the parabola with its end slopes is subtracted.
    """
    from scipy.fft import dct, idct

    n_time, trend = signal.size, wavelets.end_trend(signal)
    spectrum = dct(signal - trend, norm="ortho")
    best = (np.inf, 0.0, np.zeros(0), 0)
    for cutoff in _tried(1, n_time):
        gain = 1.0 / (1.0 + (np.arange(n_time) / cutoff) ** (2.0 * BUTTERWORTH_ORDER))
        score, smooth, sdev = _scored(spectrum, gain * spectrum, gain.sum())
        best = min(best, (score, sdev, smooth, cutoff), key=lambda found: found[0])
    _, sdev, smooth, cutoff = best
    return Smooth(idct(smooth, norm="ortho") + trend, sdev, 0.5 * cutoff / n_time)


def rts(signal: np.ndarray) -> Smooth:
    """Smoother of a signal whose slope is a random walk, with the walk's variance q of largest marginal likelihood.

    The state-space model is x_{k+1} = x_k + s_k, s_{k+1} = s_k + w_k, y_k = x_k + e_k with a flat prior of x_0 and s_0
    and var(w) = q var(e). The second differences D y have the covariance var(e) (q I + D D'), a matrix of five
    diagonals; its Cholesky factor gives the likelihood of q, with var(e) at its own maximum, and the mean that the
    smoother of Rauch, Tung & Striebel (1965), doi:10.2514/3.3166, finds by recursion: x = y - D' (q I + D D')^-1 D y.
    """
    from scipy.linalg import cho_solve_banded, cholesky_banded
    from scipy.optimize import minimize_scalar

    bends = np.diff(signal, 2)
    n_bends = bends.size
    bands = np.repeat([[1.0], [-4.0], [6.0]], n_bends, axis=1)

    def solved(log_q: float) -> tuple[float, np.ndarray, float]:
        """Twice the negative log likelihood but for a constant, (q I + D D')^-1 D y and the variance of the noise."""
        factor = cholesky_banded(bands + np.array([[0.0], [0.0], [np.exp(log_q)]]))
        weights = cho_solve_banded((factor, False), bends)
        variance = float(bends @ weights) / n_bends
        return n_bends * np.log(variance) + 2.0 * float(np.log(factor[-1]).sum()), weights, variance

    tried = np.arange(np.log(SMALLEST_Q), np.log(LARGEST_Q), 1.0)
    best = tried[int(np.argmin([solved(log_q)[0] for log_q in tried]))]
    found = minimize_scalar(lambda log_q: solved(log_q)[0], bounds=(best - 1.0, best + 1.0), method="bounded")
    log_q = float(np.clip(found.x, np.log(SMALLEST_Q), np.log(LARGEST_Q)))
    _, weights, variance = solved(log_q)
    padded = np.pad(weights, 2)
    return Smooth(signal - np.diff(padded, 2), float(np.sqrt(variance)), float(np.exp(log_q)))


SMOOTHERS = {
    "savitzky_golay": Smoother(savitzky_golay, "window"),
    "low_pass": Smoother(low_pass, "cutoff"),
    "rts": Smoother(rts, "q"),
}
"""Smoothers by name."""


def smooth_signal(signal: np.ndarray, method: str) -> Smooth:
    """Signal smoothed by one of :data:`SMOOTHERS`; as it is where its second differences vanish."""
    if np.abs(np.diff(signal, 2)).max() <= wavelets.ACCURACY * np.abs(signal).max():
        return Smooth(signal.copy(), 0.0, np.nan)
    return SMOOTHERS[method].smooth(signal)


def _tried(first: int, last: int) -> list[int]:
    """Whole numbers from the first to the last, each about the same ratio above the one before."""
    count = int(np.log(last / first) / np.log(_RATIO)) + 2
    return np.unique(np.geomspace(first, last, count).round().astype(int)).tolist()


def _ends(signal: np.ndarray, window: int) -> tuple[np.ndarray, np.ndarray]:
    return signal[:window], signal[-window:]


def _scored(signal: np.ndarray, estimate: np.ndarray, trace: float) -> tuple[float, np.ndarray, float]:
    """Generalised cross-validation of a linear smoother, its estimate and the standard deviation of the noise."""
    residual, left = float(np.sum((signal - estimate) ** 2)), signal.size - trace
    return signal.size * residual / left**2, estimate, float(np.sqrt(residual / left))
