"""Quadrature over t = log sigma2 of the semi-conjugate posterior, whose coefficients have been integrated out.

The density is analytic for |Im t| < pi/2, so the trapezoid rule converges exponentially: the step is halved until the
evidence changes by less than 1e-11 of itself.
"""

import math

import numpy as np
from numba import njit

_FALL = 60.0  # log density below the maximum at which the integral ends

Kernel = tuple[np.ndarray, np.ndarray, float, float]
"""s^2, z^2, power and rate: p(y, t) ~ exp(-power t - rate / sigma2) prod N(z; 0, sigma2 + s^2)."""


@njit(cache=True)
def _log_kernel(t: float, kernel: Kernel) -> float:
    squares, energies, power, rate = kernel
    variance = math.exp(t)
    total = -power * t - rate / variance
    for i in range(squares.size):
        total_variance = variance + squares[i]
        total -= 0.5 * (math.log(total_variance) + energies[i] / total_variance)
    return total


@njit(cache=True)
def log_kernels(t: np.ndarray, kernel: Kernel) -> np.ndarray:
    """Log kernel at each of an array of t."""
    return np.array([_log_kernel(value, kernel) for value in t])


@njit(cache=True)
def _slope(t: float, kernel: Kernel) -> tuple[float, float]:
    """First and second derivative of the log kernel."""
    squares, energies, power, rate = kernel
    variance = math.exp(t)
    first, second = rate / variance - power, -rate / variance
    for i in range(squares.size):
        part, energy = variance / (variance + squares[i]), energies[i] / (variance + squares[i])
        first -= 0.5 * part * (1.0 - energy)
        second -= 0.5 * part * (1.0 - part - energy * (1.0 - 2.0 * part))
    return first, second


@njit(cache=True)
def _modes(low: float, high: float, kernel: Kernel) -> np.ndarray:
    """All local modes between ``low`` and ``high``, which lie about 1 apart or more."""
    grid = np.linspace(low - 0.5, high + 0.5, 8 + int(4.0 * (high - low)))
    rising = np.array([_slope(t, kernel)[0] > 0.0 for t in grid])
    modes = grid[:-1][rising[:-1] & ~rising[1:]]
    for k in range(modes.size):
        width = grid[1] - grid[0]
        while width > 1e-12:
            width *= 0.5
            if _slope(modes[k] + width, kernel)[0] > 0.0:
                modes[k] += width
    return modes


@njit(cache=True)
def quadrature(low: float, high: float, kernel: Kernel) -> tuple[np.ndarray, np.ndarray]:
    """Equidistant nodes t over which the density exceeds e^-60 of its maximum, and the log kernel there."""
    modes = _modes(low, high, kernel)
    tops = log_kernels(modes, kernel)
    top = tops.max()
    high_modes = modes[tops > top - _FALL]
    curvature = max([-_slope(mode, kernel)[1] for mode in high_modes])
    step = 0.4 / math.sqrt(max(curvature, 4.0))
    first, last = high_modes[0], high_modes[-1]
    while _log_kernel(first, kernel) > top - _FALL:
        first -= 2.0 * step
    while _log_kernel(last, kernel) > top - _FALL:
        last += 2.0 * step
    for _ in range(8):
        t = first + step * np.arange(2 + int((last - first) / step))
        values = log_kernels(t, kernel)
        weights = np.exp(values - top)
        if abs(2.0 * weights[::2].sum() - weights.sum()) < 1e-11 * weights.sum():
            break
        step *= 0.5
    return t, values
