"""Empirical-Bayes thresholding of noisy means, in units of the noise sd: Johnstone & Silverman (2004, 2005).

A mean is 0 with probability 1 - w, else Laplace, (a/2) exp(-a|u|), or quasi-Cauchy, for which the scale a is NaN; w and
a maximise the marginal likelihood. Ann. Statist. 32(4):1594, doi:10.1214/009053604000000030; J. Stat. Softw. 12(8),
doi:10.18637/jss.v012.i08.
"""

from __future__ import annotations

import math
from contextlib import nullcontext
from threading import Lock
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from pymc_ship.machine.arguments import finite_number
from pymc_ship.records.denoising.spike_and_slab import (
    draw_value,
    fit_cauchy,
    fit_laplace,
    mean_value,
    median_value,
    profile,
    threshold_value,
)

PRIORS = ("laplace", "cauchy")  # densities of the means that are not zero
RULES = ("median", "mean", "hard", "soft")  # posterior median, posterior mean, hard and soft thresholding

_COMPILING = Lock()


def mad(x: ArrayLike) -> float:
    """Noise standard deviation from the median absolute deviation about zero, 1.4826 median(abs(x))."""
    return 1.4826 * float(np.median(np.abs(x)))


def fit_prior(x: np.ndarray, prior: str, scale: float | None) -> tuple[float, float, float]:
    """Weight, scale and log likelihood, less that of weight 0, of maximum marginal likelihood.

    The posterior median is zero up to sqrt(2 log n) at most. A scale of None is estimated within :data:`SCALE_BOX`;
    ValueError for one that is not positive.
    """
    size = np.abs(x).ravel()
    bound = math.sqrt(2.0 * math.log(size.size))
    if prior == "cauchy":
        return fit_cauchy(size, bound)
    if scale is None:
        return fit_laplace(size, bound)
    scale = finite_number("The scale", scale)
    if scale <= 0.0:
        raise ValueError(
            f"The scale must be positive and finite, found {scale}; give such a number, or None to fit it."
        )
    weight, log_likelihood, _ = profile(size, scale, bound, 0.5, np.empty((3, size.size)))
    return weight, scale, log_likelihood


def shrink(x: np.ndarray, weight: Any, scale: Any, rule: str) -> np.ndarray:
    """Estimate of each mean under a known prior, by one of :data:`RULES`; x, weight and scale are broadcast."""
    if rule in ("median", "mean"):
        return _evaluate(median_value if rule == "median" else mean_value, x, weight, scale)
    limit = threshold_value(weight, scale)
    size = np.abs(x)
    return np.where(size > limit, x, 0.0) if rule == "hard" else np.sign(x) * np.maximum(size - limit, 0.0)


def posterior_draw(x: np.ndarray, weight: float, scale: float, rng: np.random.Generator) -> np.ndarray:
    """One posterior draw of the mean behind each x: zero or from the slab."""
    uniform = rng.random(x.shape)
    normal = rng.standard_normal(x.shape) if math.isnan(scale) else 0.0
    return _evaluate(draw_value, x, weight, scale, uniform, normal)


def _evaluate(kernel: np.ufunc, *arguments: ArrayLike) -> np.ndarray:
    """Call a ufunc of numba; a lock guards its compilation at the first call."""
    with np.errstate(over="ignore"), nullcontext() if kernel.ntypes else _COMPILING:
        return kernel(*(np.asarray(argument, dtype=float) for argument in arguments))
