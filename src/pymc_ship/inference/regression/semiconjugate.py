"""The semi-conjugate prior and its exact posterior, a mixture of normals over the noise variance.

Given sigma2 the rotated coefficients g (:mod:`~pymc_ship.inference.regression.priors`) are independent: a priori
N(0, 1), a posteriori N(s z / (sigma2 + s^2), sigma2 / (sigma2 + s^2)).
"""

import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import ClassVar

import numpy as np
import scipy
from numba import njit
from numpy.typing import ArrayLike

from pymc_ship.inference.regression.priors import Prior, RotatedPosterior, check_data, rotate, warn_of_rows
from pymc_ship.inference.regression.quadrature import Kernel, log_kernels, quadrature
from pymc_ship.inference.rows.data import RegressionData
from pymc_ship.machine.arguments import probability_array
from pymc_ship.machine.errors import InferenceError

_LOG_2PI = math.log(2.0 * math.pi)


@njit(cache=True, fastmath={"reassoc", "contract"})
def _draw_given_noise(rng: np.random.Generator, noise_variance: np.ndarray, s: np.ndarray, z: np.ndarray) -> np.ndarray:
    """Draws of g given each noise variance, shape (draws, n_terms)."""
    g = np.empty((noise_variance.size, s.size))
    for k in range(noise_variance.size):
        for i in range(s.size):
            precision = noise_variance[k] + s[i] * s[i]
            g[k, i] = (s[i] * z[i] + math.sqrt(noise_variance[k] * precision) * rng.standard_normal()) / precision
    return g


@dataclass(frozen=True, eq=False, repr=False)
class SemiConjugatePrior(Prior):
    """Semi-conjugate prior: beta ~ N(mean, V), sigma2 ~ IG(shape, scale), independent.

    Xue et al. (2020), Eq. 18. Parameters are those of :class:`~pymc_ship.inference.regression.priors.Prior`; the prior
    variance of scaled coefficients is kappa.
    """

    family = "semiconjugate"
    noise_power = 0
    box: ClassVar = {"shape": (0.1, 1e5), "noise_variance": (1e-8, 10.0), "kappa": (1e-6, 1e8)}
    colour = "#c8551b"

    def exact(self, data: RegressionData) -> "NormalMixture":
        """Exact posterior of the model of Xue et al. (2020), Eq. 18-20, by quadrature over the noise variance."""
        check_data(data)
        warn_of_rows(data, self)
        rotation, unit = rotate(data, self), data.response_scale
        s, z = unit * rotation.singular_values, unit * rotation.projection
        residual_square, scale = unit**2 * rotation.residual_square, self.scale * unit**2
        log_noise_variance, weights, log_evidence = _integrate(s, z, residual_square, data.n_rows, (self.shape, scale))
        return NormalMixture(
            coefficients=data.coefficients,
            center=rotation.center,
            basis=rotation.basis,
            singular_values=s,
            projections=z,
            residual_square=residual_square,
            n_rows=data.n_rows,
            prior_shape=self.shape,
            prior_scale=scale,
            log_noise_variance=log_noise_variance,
            weights=weights,
            formula=data.formula,
            log_evidence=log_evidence,
        )


@dataclass(frozen=True, eq=False, repr=False)
class NormalMixture(RotatedPosterior):
    """Exact posterior under a semi-conjugate prior: coefficients = center + g basis on the original scale."""

    singular_values: np.ndarray  # s, in units of the response as z and |e|^2
    projections: np.ndarray  # z
    residual_square: float  # |e|^2
    n_rows: int
    log_noise_variance: np.ndarray  # (n_nodes,); equidistant nodes
    weights: np.ndarray  # (n_nodes,); of the nodes, with the sum 1

    @cached_property
    def noise_variances(self) -> np.ndarray:
        """Noise variance of each component of the mixture, shape (n_nodes,)."""
        return np.exp(self.log_noise_variance)

    @cached_property
    def _components(self) -> tuple[np.ndarray, np.ndarray]:
        """Mean and variance of g at each node, shape (n_nodes, n_terms)."""
        total = self.noise_variances[:, None] + self.singular_values**2
        return self.singular_values * self.projections / total, self.noise_variances[:, None] / total

    @cached_property
    def mean(self) -> np.ndarray:
        """Posterior mean of the coefficients, shape (n_terms,)."""
        return self.center + (self.weights @ self._components[0]) @ self.basis

    @cached_property
    def covariance(self) -> np.ndarray:
        """Posterior covariance of the coefficients, shape (n_terms, n_terms)."""
        locations, variances = self._components
        deviation = (locations - self.weights @ locations) @ self.basis
        # E[cov(b | sigma2)] + cov(E[b | sigma2])
        return (self.basis.T * (self.weights @ variances)) @ self.basis + (deviation.T * self.weights) @ deviation

    @property
    def evidence_gradient(self) -> np.ndarray:
        """Derivative of the log evidence by the logs of shape, noise variance and kappa, shape (3,)."""
        by_scale = self.prior_shape - self.prior_scale * float(self.weights @ np.exp(-self.log_noise_variance))
        by_shape = (
            math.log(self.prior_scale)
            - scipy.special.digamma(self.prior_shape)
            - self.weights @ self.log_noise_variance
        )
        locations, variances = self._components
        by_kappa = 0.5 * self.weights @ np.sum(locations**2 - (1.0 - variances), axis=1)
        return np.array([self.prior_shape * by_shape + by_scale, by_scale, by_kappa])

    @property
    def noise_variance_mean(self) -> float:
        """Posterior mean of the noise variance; infinite where shape + n_rows / 2 is not above 1."""
        return self._expectation(self.noise_variances, 1)

    @property
    def noise_variance_sd(self) -> float:
        """Posterior standard deviation of the noise variance; infinite where shape + n_rows / 2 is not above 2."""
        return math.sqrt(self._expectation((self.noise_variances - self.noise_variance_mean) ** 2, 2))

    def _expectation(self, values: np.ndarray, order: int) -> float:
        return float(self.weights @ values) if self.prior_shape + 0.5 * self.n_rows > order else math.inf

    def quantiles(self, probabilities: ArrayLike) -> np.ndarray:
        """Marginal quantiles of the coefficients, shape (n, n_terms), at n probabilities."""
        locations, variances = self._components
        middle, sd = locations @ self.basis, np.sqrt(variances @ self.basis**2)
        probability = probability_array(probabilities, InferenceError)[:, None]
        components = middle + scipy.special.ndtri(probability)[:, :, None] * sd

        def distribution(value: np.ndarray) -> np.ndarray:
            return np.einsum("k,qkj->qj", self.weights, scipy.special.ndtr((value[:, None] - middle) / sd))

        return self.center + _bisect(distribution, probability, components.min(axis=1), components.max(axis=1))

    def noise_variance_quantiles(self, probabilities: ArrayLike) -> np.ndarray:
        """Quantiles of the noise variance at n probabilities, shape (n,), from the sinc interpolant of the density."""
        t, probability = self.log_noise_variance, probability_array(probabilities, InferenceError)

        def distribution(value: np.ndarray) -> np.ndarray:
            return (
                0.5 + scipy.special.sici(math.pi * (value[:, None] - t) / (t[1] - t[0]))[0] / math.pi
            ) @ self.weights

        inside = np.exp(_bisect(distribution, probability, t[0], t[-1]))
        return np.where(probability == 0.0, 0.0, np.where(probability == 1.0, np.inf, inside))

    def noise_variance_density(self, noise_variance: np.ndarray) -> np.ndarray:
        """Posterior density of the noise variance at the given values, same shape."""
        value = np.asarray(noise_variance, dtype=float)
        return np.exp(self._log_density(np.log(value).ravel())).reshape(value.shape) / value

    def _log_density(self, t: np.ndarray) -> np.ndarray:
        s, z, prior = self.singular_values, self.projections, (self.prior_shape, self.prior_scale)
        kernel, constant = _kernel(s, z, self.residual_square, self.n_rows, prior)
        return log_kernels(t, kernel) + constant - self.log_evidence

    def _draw_rotated(self, draws: int, rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
        inside = self.log_noise_variance[self.weights > 1e-16 * self.weights.max()]
        t = np.linspace(inside[0], inside[-1], 2049)
        density = np.exp(self._log_density(t))
        distribution = np.concatenate([[0.0], np.cumsum(density[1:] + density[:-1])])  # right to 1e-6
        noise_variance = np.exp(np.interp(rng.random(draws), distribution / distribution[-1], t))
        return _draw_given_noise(rng, noise_variance, self.singular_values, self.projections), noise_variance

    def _moments(self, rotated: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        locations, variances = self._components
        location = self.weights @ locations
        # E[var(y | sigma2)] + var(E[y | sigma2])
        variance = rotated**2 @ (self.weights @ variances) + self.weights @ ((locations - location) @ rotated.T) ** 2
        return rotated @ location, self.noise_variance_mean + variance

    def _log_each(self, rotated: np.ndarray, residual: np.ndarray) -> np.ndarray:
        locations, variances = self._components
        variance = variances @ rotated.T**2 + self.noise_variances[:, None]
        exponent = -0.5 * (np.log(variance) + (residual - locations @ rotated.T) ** 2 / variance)
        exponent += np.log(self.weights)[:, None]
        top = exponent.max(axis=0)
        return top + np.log(np.sum(np.exp(exponent - top), axis=0)) - 0.5 * _LOG_2PI

    def _log_joint(self, rotated: np.ndarray, residual: np.ndarray) -> float:
        """Log evidence of data and new rows together, less that of the data."""
        left, s, _ = np.linalg.svd(np.vstack([np.diag(self.singular_values), rotated]), full_matrices=False)
        response = np.concatenate([self.projections, residual])
        z = left.T @ response
        residual_square = self.residual_square + float(np.sum((response - left @ z) ** 2))
        n_rows = self.n_rows + len(residual)
        return _integrate(s, z, residual_square, n_rows, (self.prior_shape, self.prior_scale))[2] - self.log_evidence


def _kernel(
    s: np.ndarray, z: np.ndarray, residual_square: float, n_rows: int, prior: tuple[float, float]
) -> tuple[Kernel, float]:
    """Arguments of the log kernel, and the constant that makes it log p(y, t)."""
    shape, scale = prior
    constant = shape * math.log(scale) - math.lgamma(shape) - 0.5 * n_rows * _LOG_2PI
    return (s**2, z**2, shape + 0.5 * (n_rows - len(s)), scale + 0.5 * residual_square), constant


def _integrate(
    s: np.ndarray, z: np.ndarray, residual_square: float, n_rows: int, prior: tuple[float, float]
) -> tuple[np.ndarray, np.ndarray, float]:
    """Nodes and normalised weights of log sigma2, and the log evidence."""
    kernel, constant = _kernel(s, z, residual_square, n_rows, prior)
    _, energies, _, rate = kernel
    low = math.log(rate / (prior[0] + 0.5 * n_rows))
    high = math.log((rate + 0.5 * energies.sum()) / (prior[0] + 0.5 * max(n_rows - len(s), 0)))
    t, values = quadrature(low, high, kernel)
    weights = np.exp(values - values.max())
    log_evidence = values.max() + math.log(weights.sum() * (t[1] - t[0])) + constant
    return t, weights / weights.sum(), float(log_evidence)


def _bisect(
    function: Callable[[np.ndarray], np.ndarray], target: np.ndarray, low: np.ndarray | float, high: np.ndarray | float
) -> np.ndarray:
    """Root of an increasing function less its target between ``low`` and ``high``, by bisection."""
    low, high = low + 0.0 * target, high + 0.0 * target
    for _ in range(60):
        middle = 0.5 * (low + high)
        below = function(middle) < target
        low, high = np.where(below, middle, low), np.where(below, high, middle)
    return 0.5 * (low + high)
