"""Two prior families as a user writes them: one of a known form, one with an exact posterior of its own."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import ClassVar

import numpy as np
from scipy import stats
from scipy.special import logsumexp

import pymc_ship as ps
from pymc_ship.inference.regression.priors import ExactPosterior, rotate


@dataclass(frozen=True, eq=False)
class RidgePrior(ps.Prior):
    """Conjugate with a fixed shape, so that noise variance and kappa are all that is sought."""

    shape: float = field(default=3.0, init=False)

    family = "ridge"
    noise_power = 1
    box: ClassVar = {"noise_variance": (1e-8, 10.0), "kappa": (1e-4, 1e8)}
    colour = "#3a8f4d"
    citation = "Hoerl & Kennard (1970), Technometrics 12(1):55, doi:10.1080/00401706.1970.10488634"

    @classmethod
    def from_box(cls, *, noise_variance: float, kappa: float) -> RidgePrior:
        return cls(scale=3.0 * noise_variance, kappa=kappa)

    def exact(self, data: ps.RegressionData) -> ExactPosterior:
        return ps.ConjugatePrior(mean=self.mean, kappa=self.kappa, shape=self.shape, scale=self.scale).exact(data)


@dataclass(frozen=True, repr=False)
class Mixture(ExactPosterior):
    """Mixture over many values of the noise variance: normals of means m and covariances B' diag(v) B."""

    coefficients: tuple[str, ...]
    noise_variances: np.ndarray
    weights: np.ndarray
    means: np.ndarray
    basis: np.ndarray
    variances: np.ndarray
    log_evidence: float

    @property
    def mean(self):
        return self.weights @ self.means

    @property
    def covariance(self):
        deviation = self.means - self.mean
        return (self.basis.T * (self.weights @ self.variances)) @ self.basis + (deviation.T * self.weights) @ deviation

    @property
    def noise_variance_mean(self):
        return float(self.weights @ self.noise_variances)

    @property
    def noise_variance_sd(self):
        return float(np.sqrt(self.weights @ (self.noise_variances - self.noise_variance_mean) ** 2))

    def draw(self, draws, rng):
        k = rng.choice(self.weights.size, size=draws, p=self.weights)
        rotated = np.sqrt(self.variances[k]) * rng.standard_normal((draws, len(self.coefficients)))
        return self.means[k] + rotated @ self.basis, self.noise_variances[k]

    def quantiles(self, probabilities):
        sd = np.sqrt(self.variances @ self.basis**2)
        grid = self.mean + np.linspace(-9.0, 9.0, 3001)[:, None] * self.sd
        below = np.array([self.weights @ stats.norm.cdf(row, self.means, sd) for row in grid])
        return np.column_stack([np.interp(probabilities, p, x) for p, x in zip(below.T, grid.T, strict=True)])

    def noise_variance_quantiles(self, probabilities):
        middle = np.cumsum(self.weights) - 0.5 * self.weights
        return np.exp(np.interp(probabilities, middle, np.log(self.noise_variances)))

    def log_predictive_density(self, design_matrix, response, *, pointwise=False):
        assert pointwise
        sd = np.sqrt(self.noise_variances + (design_matrix @ self.basis.T) ** 2 @ self.variances.T)
        return logsumexp(stats.norm.logpdf(response[:, None], design_matrix @ self.means.T, sd), b=self.weights, axis=1)


@dataclass(frozen=True, eq=False)
class RootPrior(ps.Prior):
    """The prior sd of the coefficients is proportional to the fourth root of the noise variance."""

    family = "root"
    noise_power = 0.5
    box: ClassVar = {"shape": (0.5, 1e3), "noise_variance": (1e-6, 10.0), "kappa": (1e-3, 1e6)}
    colour = "#7d4fa3"

    def exact(self, data: ps.RegressionData) -> Mixture:
        return by_summation(data, self)


def by_summation(data: ps.RegressionData, prior: ps.Prior) -> Mixture:
    """Exact posterior under a prior of any power: a sum over the log noise variance, coefficients integrated out."""
    rotation, unit = rotate(data, prior), data.response_scale
    s, z = rotation.singular_values, rotation.projection

    def log_density(t):
        variance = np.exp(t)
        marginal = variance[:, None] + s**2 * prior.variance_factor(variance)[:, None]
        rest = (data.n_rows - len(s)) * np.log(2.0 * np.pi * variance) + rotation.residual_square / variance
        likelihood = stats.norm.logpdf(z, 0.0, np.sqrt(marginal)).sum(axis=1) - 0.5 * rest
        return likelihood + prior.log_noise_variance(variance) + t - data.n_rows * np.log(unit)

    coarse = np.linspace(-20.0, 12.0, 4001)
    density = log_density(coarse)
    support = coarse[density > density.max() - 40.0]
    t = np.linspace(support[0], support[-1], 1500)
    density, variance = log_density(t), np.exp(t)[:, None]
    spread = variance * prior.variance_factor(variance) / (variance + s**2 * prior.variance_factor(variance))
    return Mixture(
        coefficients=data.coefficients,
        noise_variances=unit**2 * variance[:, 0],
        weights=np.exp(density - logsumexp(density)),
        means=rotation.center + (spread * s * z / variance) @ rotation.basis,
        basis=rotation.basis,
        variances=spread,
        log_evidence=float(logsumexp(density) + np.log(t[1] - t[0])),
    )
