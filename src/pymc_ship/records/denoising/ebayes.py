"""Empirical-Bayes thresholding of noisy means, in units of the noise sd: Johnstone & Silverman (2004, 2005).

A mean is 0 with probability 1 - w, else Laplace, (a/2) exp(-a|u|), or quasi-Cauchy; w and a maximise the marginal
likelihood. Ann. Statist. 32(4):1594, doi:10.1214/009053604000000030; J. Stat. Softw. 12(8), doi:10.18637/jss.v012.i08.
"""

import math
from contextlib import nullcontext
from dataclasses import dataclass
from threading import Lock
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from pymc_ship.machine.arguments import check_choice, finite_number, real_array
from pymc_ship.machine.errors import ShipError
from pymc_ship.records.denoising import spike_and_slab

PRIORS = ("laplace", "cauchy")  # densities of the means that are not zero
RULES = ("median", "mean", "hard", "soft")  # posterior median, posterior mean, hard and soft thresholding

THRESHOLDS = ("posterior_median", "bayes_factor")
"""`posterior_median`: the smallest |x| with a non-zero posterior median. `bayes_factor`: the |x| at which P(mean = 0 |
x) = 1/2."""

_COMPILING = Lock()


@dataclass(frozen=True)
class EbayesEstimate:
    """Result of :func:`ebayes_threshold`: means, noise ``sdev`` and ``threshold`` in the units of the data.

    ``weight`` is the probability that a mean is not zero, ``scale`` a in units of 1 / sdev (nan if quasi-Cauchy),
    ``log_likelihood`` the marginal one, less that of weight 0.
    """

    estimate: np.ndarray
    weight: float
    scale: float
    sdev: float
    threshold: float
    log_likelihood: float


def ebayes_threshold(
    x: ArrayLike,
    prior: str = "laplace",
    scale: float | None = 0.5,
    sdev: float | None = 1.0,
    rule: str = "median",
    *,
    universal_bound: bool = True,
    threshold: str = "posterior_median",
) -> EbayesEstimate:
    """Estimate the means of independent normal observations, of any shape, of which many may be zero.

    ``scale`` is a in units of 1 / sdev, None estimates it within :data:`SCALE_BOX`; ``sdev`` is that of the noise, None
    takes 1.4826 times the median of abs(x) (if that is zero, the data return, with weight 1). ``universal_bound``: the
    posterior-median threshold may not exceed sdev sqrt(2 log n). ``threshold`` is reported, and applied by the hard and
    soft rules. ValueError for an unknown choice, data empty or not finite, a scale or sdev not positive.
    """
    values = _observations(x)
    check_choice("The prior", prior, PRIORS)
    check_choice("The rule", rule, RULES)
    check_choice("The threshold", threshold, THRESHOLDS)
    if sdev is None:
        sdev = mad(values)
        if sdev == 0.0:
            return EbayesEstimate(values.copy(), 1.0, math.nan if scale is None else _code(prior, scale), 0.0, 0.0, 0.0)
    sdev = _positive_number("noise standard deviation", sdev)
    standard = values / sdev
    weight, fitted, log_likelihood = fit_prior(standard, prior, scale, universal_bound=universal_bound)
    limit = sdev * threshold_from_weight(weight, prior, fitted, threshold)
    estimate = sdev * shrink(standard, weight, prior, fitted, rule, threshold=threshold)
    return EbayesEstimate(estimate, weight, fitted, sdev, limit, log_likelihood)


def mad(x: ArrayLike) -> float:
    """Noise standard deviation from the median absolute deviation about zero, 1.4826 median(abs(x))."""
    return 1.4826 * float(np.median(np.abs(x)))


def fit_prior(
    x: ArrayLike, prior: str = "laplace", scale: float | None = 0.5, *, universal_bound: bool = True
) -> tuple[float, float, float]:
    """Weight, scale and log likelihood of maximum marginal likelihood, as in :class:`EbayesEstimate` with sdev 1."""
    check_choice("The prior", prior, PRIORS)
    size = np.abs(_observations(x)).ravel()
    bound = math.sqrt(2.0 * math.log(size.size)) if universal_bound else math.inf
    # without the bound the weight may be so small that the densities have poles near the axis
    points = spike_and_slab.condensed(size) if universal_bound else np.array([size, np.ones(size.size)])
    if prior == "cauchy":
        return spike_and_slab.fit_cauchy(points, bound)
    if scale is not None:
        scale = _positive_number("scale", scale)
        weight, log_likelihood, _ = spike_and_slab.profile(points, scale, bound, 0.5, np.empty((3, points.shape[1])))
        return weight, scale, log_likelihood
    return spike_and_slab.fit_laplace(points, bound)


def shrink(
    x: ArrayLike,
    weight: float,
    prior: str = "laplace",
    scale: float = 0.5,
    rule: str = "median",
    *,
    threshold: str = "posterior_median",
) -> np.ndarray:
    """Estimate of each mean under a known prior, by one of :data:`RULES`, in units of the noise."""
    check_choice("The rule", rule, RULES)
    if rule == "mean":
        return posterior_mean(x, weight, prior, scale)
    limit = threshold_from_weight(weight, prior, scale, "posterior_median" if rule == "median" else threshold)
    if rule == "median":
        return _evaluate(spike_and_slab.median_value, x, weight, _code(prior, scale), limit)
    values = real_array("The observations", x)
    size = np.abs(values)
    return np.where(size > limit, values, 0.0) if rule == "hard" else np.sign(values) * np.maximum(size - limit, 0.0)


def posterior_mean(x: ArrayLike, weight: ArrayLike, prior: str = "laplace", scale: ArrayLike = 0.5) -> np.ndarray:
    """Posterior mean of the mean behind x; x, weight and scale are broadcast."""
    return _evaluate(spike_and_slab.mean_value, x, _probability(weight), _code(prior, scale))


def posterior_median(x: ArrayLike, weight: ArrayLike, prior: str = "laplace", scale: ArrayLike = 0.5) -> np.ndarray:
    """Posterior median of the mean behind x, zero within the threshold; x, weight and scale are broadcast."""
    return _evaluate(spike_and_slab.median_value, x, _probability(weight), _code(prior, scale), 0.0)


def posterior_draw(
    x: ArrayLike, weight: float, prior: str = "laplace", scale: float = 0.5, *, rng: np.random.Generator
) -> np.ndarray:
    """One posterior draw of the mean behind each x, in units of the noise: zero or from the slab."""
    uniform = rng.random(np.shape(x))
    normal = rng.standard_normal(np.shape(x)) if prior == "cauchy" else 0.0
    return _evaluate(spike_and_slab.draw_value, x, _probability(weight), _code(prior, scale), uniform, normal)


def threshold_from_weight(
    weight: float, prior: str = "laplace", scale: float = 0.5, threshold: str = "posterior_median"
) -> float:
    """Threshold of a weight in [0, 1], one of :data:`THRESHOLDS`, in units of the noise; infinite for weight 0."""
    check_choice("The threshold", threshold, THRESHOLDS)
    code = _code(prior, scale)
    return spike_and_slab.threshold_value(float(_probability(weight)), float(code), threshold == "bayes_factor")


def _observations(x: ArrayLike) -> np.ndarray:
    values = real_array("The observations", x)
    if values.size == 0 or not np.isfinite(values).all():
        fault = "none" if values.size == 0 else f"{np.count_nonzero(~np.isfinite(values))} that are not"
        raise ShipError(f"Thresholding needs finite observations, found {fault}; leave out or fill the gaps first.")
    return values


def _positive_number(what: str, value: Any) -> float:
    number = finite_number(f"The {what}", value)
    _check_positive(what, number)
    return number


def _check_positive(what: str, value: Any) -> None:
    if not np.all((np.asarray(value) > 0.0) & np.isfinite(value)):
        raise ShipError(
            f"The {what} must be positive and finite, found {value}; give such a number, or None to fit it."
        )


def _probability(weight: Any) -> Any:
    if not np.all((np.asarray(weight) >= 0.0) & (np.asarray(weight) <= 1.0)):
        raise ShipError(f"A weight is a probability, found {weight}; give numbers in [0, 1].")
    return weight


def _code(prior: str, scale: Any) -> Any:
    """Scale argument of the kernels: nan for the quasi-Cauchy density."""
    check_choice("The prior", prior, PRIORS)
    if prior == "cauchy":
        return math.nan
    _check_positive("scale", scale)
    return scale


def _evaluate(kernel: np.ufunc, *arguments: ArrayLike) -> np.ndarray:
    """Call a ufunc of numba; a lock guards its compilation at the first call."""
    with np.errstate(over="ignore"), nullcontext() if kernel.ntypes else _COMPILING:
        return kernel(*(np.asarray(argument, dtype=float) for argument in arguments))
