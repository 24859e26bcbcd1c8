"""Signals on which denoisers are compared (Donoho & Johnstone 1994, Biometrika 81:425, Table 1); tabulated ratios."""

from __future__ import annotations

import numpy as np

from pymc_ship.records.denoising.spike_and_slab import _densities

_JUMPS = np.array([0.1, 0.13, 0.15, 0.23, 0.25, 0.4, 0.44, 0.65, 0.76, 0.78, 0.81])
_STEPS = np.array([4.0, -5.0, 3.0, -4.0, 5.0, -4.2, 2.1, 4.3, -3.1, 2.1, -4.2])
_PEAKS = np.array([4.0, 5.0, 3.0, 4.0, 5.0, 4.2, 2.1, 4.3, 3.1, 5.1, 4.2])
_WIDTHS = np.array([0.005, 0.005, 0.006, 0.01, 0.01, 0.03, 0.01, 0.01, 0.005, 0.008, 0.005])

SHAPES = {
    "blocks": lambda t: 0.5 * (1.0 + np.sign(t[:, None] - _JUMPS)) @ _STEPS,
    "bumps": lambda t: (1.0 + np.abs((t[:, None] - _JUMPS) / _WIDTHS)) ** -4 @ _PEAKS,
    "heavisine": lambda t: 4.0 * np.sin(4.0 * np.pi * t) - np.sign(t - 0.3) - np.sign(0.72 - t),
    "doppler": lambda t: np.sqrt(t * (1.0 - t)) * np.sin(2.1 * np.pi / (t + 0.05)),
}


def classic(name: str, n_time: int = 1024) -> np.ndarray:
    """Signal with a standard deviation of 7, that of the noise in the paper being 1."""
    shape = SHAPES[name](np.arange(1, n_time + 1) / n_time)
    return 7.0 * shape / shape.std()


# What Johnstone & Silverman tabulate, from the densities that the library uses; quasi-Cauchy without a scale.


@np.errstate(over="ignore")
@np.vectorize
def beta(x, scale=np.nan):
    """Ratio of the marginal densities of x under the slab and under zero means, minus 1: beta(x) of the papers."""
    slab, _, _, s = _densities(abs(x), scale)
    return slab * np.exp(s) - 1.0 if s < 700.0 else slab * np.exp(s - 700.0) * np.exp(700.0)


@np.vectorize
def posterior_weight(x, weight, prior, scale=0.5):
    """Posterior probability that the mean behind x is not zero."""
    slab, _, null, _ = _densities(abs(x), scale if prior == "laplace" else np.nan)
    return weight * slab / (weight * slab + (1.0 - weight) * null)


@np.vectorize
def weight_from_threshold(threshold, prior, scale=0.5):
    """Weight whose posterior median is zero up to the threshold."""
    _, odds, null, _ = _densities(threshold, scale if prior == "laplace" else np.nan)
    return null / (null + odds)
