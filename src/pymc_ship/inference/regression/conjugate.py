"""The conjugate prior and its exact posterior, a normal inverse gamma distribution in closed form.

In the coordinates of :mod:`pymc_ship.inference.regression.priors` the g are independent given sigma2: a priori
N(0, sigma2), a posteriori N(s z / (1 + s^2), sigma2 / (1 + s^2)).
"""

import math
from dataclasses import dataclass
from functools import cached_property
from typing import ClassVar

import numpy as np
import scipy
from numba import njit
from numpy.typing import ArrayLike

from pymc_ship.inference.regression import priors
from pymc_ship.inference.rows.data import RegressionData
from pymc_ship.machine.arguments import probability_array
from pymc_ship.machine.errors import InferenceError

_LOG_2PI = math.log(2.0 * math.pi)


@njit(cache=True, fastmath={"reassoc", "contract"})
def _draw_given_noise(
    rng: np.random.Generator, noise_variance: np.ndarray, location: np.ndarray, spread: np.ndarray
) -> np.ndarray:
    """Draws of g given each noise variance, shape (draws, n_terms)."""
    g = np.empty((noise_variance.size, location.size))
    for k in range(noise_variance.size):
        for i in range(location.size):
            g[k, i] = location[i] + math.sqrt(noise_variance[k] * spread[i]) * rng.standard_normal()
    return g


@dataclass(frozen=True, eq=False, repr=False)
class ConjugatePrior(priors.Prior):
    """Normal inverse gamma prior: beta | sigma2 ~ N(mean, sigma2 V), sigma2 ~ IG(shape, scale).

    Parameters are those of :class:`~pymc_ship.inference.regression.priors.Prior`; the prior variance of scaled
    coefficients is kappa sigma2. The prior of sigma2 weighs as much as 2 shape rows. Xue et al. (2020), Eq. 12.
    """

    family = "conjugate"
    noise_power = 1
    box: ClassVar = {"shape": (0.1, 1e5), "noise_variance": (1e-8, 10.0), "kappa": (1e-4, 1e12)}
    colour = "#1f6fb2"
    citation = "Gelman et al. (2013), Bayesian Data Analysis, 3rd ed., ch. 14, doi:10.1201/b16018"

    def exact(self, data: RegressionData) -> "NormalInverseGamma":
        """Exact posterior, Eq. 12-17 of Xue et al. (2020)."""
        priors.check_data(data)
        priors.warn_of_rows(data, self)
        rotation, unit = priors.rotate(data, self), data.response_scale
        s, z = rotation.singular_values, unit * rotation.projection
        spread = 1.0 / (1.0 + s**2)
        # half of the data's part of the scale, |e|^2 + sum z_i^2 / (1 + s_i^2)
        fit = 0.5 * (unit**2 * rotation.residual_square + np.sum(z**2 * spread))
        prior_scale = self.scale * unit**2
        shape, scale = self.shape + 0.5 * data.n_rows, prior_scale + fit
        # multivariate t density of the response, its determinant prod(1 + s_i^2)
        log_evidence = math.lgamma(shape) - math.lgamma(self.shape) - self.shape * math.log1p(fit / prior_scale)
        log_evidence -= 0.5 * (data.n_rows * (_LOG_2PI + math.log(scale)) + np.sum(np.log1p(s**2)))
        return NormalInverseGamma(
            coefficients=data.coefficients,
            center=rotation.center,
            basis=rotation.basis / unit,
            location=s * z * spread,
            spread=spread,
            shape=shape,
            scale=scale,
            prior_shape=self.shape,
            prior_scale=prior_scale,
            formula=data.formula,
            log_evidence=float(log_evidence),
        )


@dataclass(frozen=True, eq=False, repr=False)
class NormalInverseGamma(priors.RotatedPosterior):
    """Exact posterior under a conjugate prior: coefficients = center + g basis on the original scale.

    g | sigma2 ~ N(location, sigma2 diag(spread)), marginally sigma2 ~ IG(shape, scale): Xue et al. (2020), Eq. 12-17.
    """

    location: np.ndarray
    spread: np.ndarray
    shape: float
    scale: float

    @cached_property
    def mean(self) -> np.ndarray:
        """Posterior mean of the coefficients, shape (n_terms,)."""
        return self.center + self.location @ self.basis

    @cached_property
    def covariance(self) -> np.ndarray:
        """Posterior covariance of the coefficients, shape (n_terms, n_terms)."""
        return (self.basis.T * self.spread) @ self.basis * self.noise_variance_mean

    @property
    def evidence_gradient(self) -> np.ndarray:
        """Derivative of the log evidence by the logs of shape, noise variance and kappa, shape (3,)."""
        by_scale = self.prior_shape - self.shape * self.prior_scale / self.scale
        by_shape = (
            scipy.special.digamma(self.shape)
            - scipy.special.digamma(self.prior_shape)
            - math.log(self.scale / self.prior_scale)
        )
        by_kappa = 0.5 * (self.shape / self.scale * np.sum(self.location**2) - np.sum(1.0 - self.spread))
        return np.array([self.prior_shape * by_shape + by_scale, by_scale, by_kappa])

    @property
    def degrees_of_freedom(self) -> float:
        """Degrees of freedom of the marginal t distribution of the coefficients and of new rows."""
        return 2.0 * self.shape

    @property
    def t_scale(self) -> np.ndarray:
        """Scale of the marginal t distribution of each coefficient, shape (n_terms,)."""
        return np.sqrt(self.spread @ self.basis**2 * self.scale / self.shape)

    @property
    def noise_variance_mean(self) -> float:
        """Posterior mean of the noise variance; infinite where the posterior shape is not above 1."""
        return self.scale / (self.shape - 1.0) if self.shape > 1.0 else math.inf

    @property
    def noise_variance_sd(self) -> float:
        """Posterior standard deviation of the noise variance; infinite where the posterior shape is not above 2."""
        return self.noise_variance_mean / math.sqrt(self.shape - 2.0) if self.shape > 2.0 else math.inf

    def quantiles(self, probabilities: ArrayLike) -> np.ndarray:
        """Marginal quantiles of the coefficients, shape (n, n_terms), at n probabilities."""
        p = probability_array(probabilities, InferenceError)
        t = np.where(p == 0.0, -np.inf, scipy.special.stdtrit(self.degrees_of_freedom, p))  # which has +inf at 0
        return self.mean + t[:, None] * self.t_scale

    def noise_variance_quantiles(self, probabilities: ArrayLike) -> np.ndarray:
        """Quantiles of the noise variance at n probabilities, shape (n,)."""
        with np.errstate(divide="ignore"):  # infinite at 1
            return self.scale / scipy.special.gammainccinv(self.shape, probability_array(probabilities, InferenceError))

    def noise_variance_density(self, noise_variance: np.ndarray) -> np.ndarray:
        """Posterior density of the noise variance at the given values, same shape."""
        return np.exp(priors.log_inverse_gamma(noise_variance, self.shape, self.scale))

    def _draw_rotated(self, draws: int, rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
        noise_variance = self.scale / rng.standard_gamma(self.shape, draws)
        return _draw_given_noise(rng, noise_variance, self.location, self.spread), noise_variance

    def _moments(self, rotated: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        return rotated @ self.location, (1.0 + rotated**2 @ self.spread) * self.noise_variance_mean

    def _log_each(self, rotated: np.ndarray, residual: np.ndarray) -> np.ndarray:
        variance = 1.0 + rotated**2 @ self.spread
        return self._log_t(1, np.log(variance), (residual - rotated @ self.location) ** 2 / variance)

    def _log_joint(self, rotated: np.ndarray, residual: np.ndarray) -> float:
        residual = residual - rotated @ self.location
        left, s, _ = np.linalg.svd(rotated * np.sqrt(self.spread), full_matrices=False)
        z = left.T @ residual
        distance = np.sum((residual - left @ z) ** 2) + np.sum(z**2 / (1.0 + s**2))
        return float(self._log_t(len(residual), np.sum(np.log1p(s**2)), distance))

    def _log_t(self, n_rows: int, log_determinant: np.ndarray, distance: np.ndarray) -> np.ndarray:
        shape = self.shape + 0.5 * n_rows
        constant = math.lgamma(shape) - math.lgamma(self.shape) - 0.5 * n_rows * (_LOG_2PI + math.log(self.scale))
        return constant - 0.5 * log_determinant - shape * np.log1p(0.5 * distance / self.scale)
