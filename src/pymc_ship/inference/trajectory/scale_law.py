"""Hierarchical prior of the scales of coefficients: its most probable scales, and draws with all scales integrated out.

theta_j = mean_j + scale_j exp(E_j eta) t_j with t_j Student's t: row j of the exponents E picks the log factor of its
group and, for each order above the first, the log damping of its DOF. The elements of eta are normal.
"""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numba import njit
from scipy.special import gammaln

from pymc_ship.machine.threads import map_in_threads

FREEDOM = 4.0  # degrees of freedom of Student's t, here and in fits to windows
FACTOR_SD = float(np.log(2.0))  # prior sd of each log factor and log damping: a factor of two
_LARGEST_MIXING = 1e4  # of the variance of a coefficient over that of its factors: bounds the condition number
_BURN_IN = 50
_THINNING = 2
_LEAPFROGS = 3  # of Hamiltonian Monte Carlo
_STEP = 0.8  # mean length of a leapfrog of eta, in posterior sd
_WALK = 0.6  # step of the random walk of eta, in posterior sd of a group of about ten coefficients
_LARGEST_LEAPFROG = 3.0  # change of the log of a scale beyond which a proposal is refused
_MOST_UPDATES = 200
_CONVERGED = 1e-3


@dataclass(frozen=True, eq=False)
class ScaleLaw:
    """Law of the scales of all coefficients."""

    exponents: np.ndarray  # (n_coefficients, n_factors); E, zero in the rows of coefficients with a fixed normal law
    center: np.ndarray  # (n_factors,); prior mean of eta
    names: tuple[str, ...]  # of the factors

    @property
    def is_scaled(self) -> np.ndarray:
        """Whether each coefficient has Student's t and factors, (n_coefficients,)."""
        return self.exponents.any(axis=1)

    def log_density(self, z: np.ndarray, eta: np.ndarray) -> np.ndarray:
        """Log density of z = (theta - mean) / scale (..., n_coefficients) given eta (..., n_factors)."""
        log_factor = eta @ self.exponents.T
        student = student_log_density(z * np.exp(-log_factor), FREEDOM) - log_factor
        return np.where(self.is_scaled, student, -0.5 * (z**2 + np.log(2.0 * np.pi))).sum(axis=-1)


def student_log_density(z: np.ndarray, freedom: float) -> np.ndarray:
    """Log density of Student's t; scipy.stats, which has it, takes half a second to import."""
    constant = gammaln(0.5 * (freedom + 1.0)) - gammaln(0.5 * freedom) - 0.5 * np.log(np.pi * freedom)
    return constant - 0.5 * (freedom + 1.0) * np.log1p(z**2 / freedom)


class Scales(NamedTuple):
    """Elements of eta (n_factors,), and the sd (n_coefficients,) of the normal laws equivalent to Student's t."""

    eta: np.ndarray
    sd: np.ndarray


class LinearProblem(NamedTuple):
    """Log likelihood -0.5 c' information c + score' c of the deviations mode + c; law and scale of these."""

    law: ScaleLaw
    scale: np.ndarray
    information: np.ndarray
    score: np.ndarray
    mode: np.ndarray

    def factor(self, eta: np.ndarray) -> np.ndarray:
        """Scale of Student's t, (..., n_coefficients)."""
        return self.scale * np.exp(eta @ self.law.exponents.T)

    def covariance(self, sd: np.ndarray) -> np.ndarray:
        """Covariance of the deviations under normal priors of these sds, (n_coefficients, n_coefficients)."""
        total = self.information + np.diag(sd**-2)
        size = np.sqrt(np.diag(total))
        return np.linalg.inv(total / np.outer(size, size)) / np.outer(size, size)


def probable_scales(problem: LinearProblem, eta: np.ndarray) -> Scales:
    """Most probable eta and the normal laws equivalent to Student's t, by expectation-maximisation from a start."""
    E, scaled = problem.law.exponents, problem.law.is_scaled
    sd = problem.factor(eta)
    for _ in range(_MOST_UPDATES):
        covariance = problem.covariance(sd)
        deviation = problem.mode + covariance @ (problem.score - problem.mode / sd**2)
        square = (deviation**2 + np.diag(covariance)) / problem.factor(eta) ** 2
        mixing = np.where(scaled, np.minimum((FREEDOM + square) / (FREEDOM + 1.0), _LARGEST_MIXING), 1.0)
        ratio = square / mixing
        gradient = E.T @ (ratio - 1.0) - (eta - problem.law.center) / FACTOR_SD**2
        curvature = 2.0 * (E.T * ratio) @ E + np.eye(eta.size) / FACTOR_SD**2
        step = np.clip(np.linalg.solve(curvature, gradient), -1.0, 1.0)
        eta = eta + step
        sd = problem.factor(eta) * np.sqrt(mixing)
        if np.max(np.abs(step)) < _CONVERGED:
            break
    return Scales(eta, sd)


def gibbs_draws(
    problem: LinearProblem, start: Scales, chains: int, draws: int, rng: np.random.Generator
) -> tuple[np.ndarray, np.ndarray]:
    """Draws of deviations and eta, (chains, draws, n_coefficients) and (chains, draws, n_factors).

    eta moves by Hamiltonian Monte Carlo (Neal 2011, doi:10.1201/b10905-6) with the deviations integrated out (Liu 1994,
    doi:10.1080/01621459.1994.10476829), then given them, in turns with the scale mixture of Student's t (Lange,
    Little & Taylor 1989, doi:10.1080/01621459.1989.10478852).
    """
    law, begin = problem.law, FACTOR_SD * 0.5 * rng.standard_normal((chains, problem.law.center.size)) + start.eta
    deviations = np.empty((chains, draws, problem.scale.size))
    factors = np.empty((chains, draws, law.center.size))
    mixing = (start.sd / problem.factor(start.eta)) ** 2
    arrays = (*problem[1:], law.exponents, law.is_scaled, law.center, _root_of_metric(problem, start))
    kernel = _Kernel(*map(np.ascontiguousarray, arrays))

    def fill(seed: int, eta: np.ndarray, deviations: np.ndarray, factors: np.ndarray) -> None:
        _gibbs(kernel, eta, mixing.copy(), np.random.default_rng(seed), deviations, factors)

    map_in_threads(fill, rng.integers(2**63, size=chains), begin, deviations, factors)
    return deviations, factors


def _root_of_metric(problem: LinearProblem, start: Scales) -> np.ndarray:
    """R with R R' the inverse of the expected curvature of the log evidence in eta, (n_factors, n_factors)."""
    E = problem.law.exponents
    of_data = np.eye(start.sd.size) - problem.covariance(start.sd) / np.outer(start.sd, start.sd)
    curvature = 2.0 * E.T @ of_data**2 @ E + np.eye(start.eta.size) / FACTOR_SD**2
    return np.linalg.inv(np.linalg.cholesky(curvature)).T


class _Kernel(NamedTuple):
    """Arrays of a linear problem, its law, and the root of the metric of eta."""

    scale: np.ndarray
    information: np.ndarray
    score: np.ndarray
    mode: np.ndarray
    exponents: np.ndarray
    is_scaled: np.ndarray
    center: np.ndarray
    root: np.ndarray


@njit(cache=True, nogil=True, error_model="numpy")
def _gibbs(
    kernel: _Kernel,
    eta: np.ndarray,
    mixing: np.ndarray,
    rng: np.random.Generator,
    deviations: np.ndarray,
    factors: np.ndarray,
) -> None:
    """Fill draws of one chain; see :func:`gibbs_draws`."""
    exponents, root = kernel.exponents, kernel.root
    n, m = exponents.shape
    sd = kernel.scale * np.exp(exponents @ eta) * np.sqrt(mixing)
    inverse, mean = np.empty((2, n, n)), np.empty((2, n))
    for step in range(-_BURN_IN, deviations.shape[0] * _THINNING):
        value, slope = _evidence(kernel, eta, sd, inverse[0], mean[0])
        momentum = rng.standard_normal(m)
        loss, length = value - 0.5 * np.sum(momentum**2), _STEP * rng.uniform(0.7, 1.3)
        new_eta, new_sd, new_slope = eta, sd, slope
        for _ in range(_LEAPFROGS):
            momentum = momentum + 0.5 * length * new_slope
            change = length * (root @ momentum)
            log_ratio = exponents @ change
            if np.max(np.abs(log_ratio)) > _LARGEST_LEAPFROG:
                value = -np.inf
                break
            new_eta, new_sd = new_eta + change, new_sd * np.exp(log_ratio)
            value, new_slope = _evidence(kernel, new_eta, new_sd, inverse[1], mean[1])
            momentum = momentum + 0.5 * length * new_slope
        accepted = int(np.log(rng.random()) < value - 0.5 * np.sum(momentum**2) - loss)
        if accepted:
            eta, sd = new_eta, new_sd
        deviation = kernel.mode + sd * (mean[accepted] + inverse[accepted].T @ rng.standard_normal(n))
        factor = sd / np.sqrt(mixing)
        for i in range(n):
            if kernel.is_scaled[i]:
                standard = (deviation[i] / factor[i]) ** 2
                mixing[i] = min((FREEDOM + standard) / 2.0 / rng.gamma((FREEDOM + 1.0) / 2.0, 1.0), _LARGEST_MIXING)
        eta = _walk(kernel, eta, (deviation / factor) ** 2 / mixing, rng)
        sd = kernel.scale * np.exp(exponents @ eta) * np.sqrt(mixing)
        if step >= 0 and step % _THINNING == 0:
            deviations[step // _THINNING], factors[step // _THINNING] = deviation, eta


@njit(cache=True, nogil=True)
def _walk(kernel: _Kernel, eta: np.ndarray, square: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """Random walk of each factor given the deviations, (n_factors,); it leaves scales too narrow for a leapfrog.

    ``square`` is that of the deviations over their sds, (n_coefficients,).
    """
    eta, square = eta.copy(), square.copy()
    for k in range(eta.size):
        change = _WALK * rng.standard_normal()
        power = change * kernel.exponents[:, k]
        ratio = np.exp(-2.0 * power)
        gain = -np.sum(power + 0.5 * square * (ratio - 1.0))
        gain -= change * (eta[k] - kernel.center[k] + 0.5 * change) / FACTOR_SD**2
        if np.log(rng.random()) < gain:
            eta[k] += change
            square *= ratio
    return eta


@njit(cache=True, nogil=True, error_model="numpy")
def _evidence(
    kernel: _Kernel, eta: np.ndarray, sd: np.ndarray, inverse: np.ndarray, mean: np.ndarray
) -> tuple[float, np.ndarray]:
    """Log evidence of prior sds with the log prior of eta, and its slope along the metric.

    Fills the inverse of the Cholesky factor and the mean of the changes from the mode, both in prior sds.
    """
    n, distance, center = sd.size, eta - kernel.center, kernel.mode / sd
    factor = _cholesky_factor(kernel.information, sd)
    for i in range(n):
        inverse[i] = 0.0
        for k in range(i):
            ratio = factor[i, k] / factor[i, i]
            for j in range(k + 1):
                inverse[i, j] -= ratio * inverse[k, j]
        inverse[i, i] = 1.0 / factor[i, i]
    whitened = inverse @ (sd * kernel.score - center)
    mean[:] = inverse.T @ whitened
    value = 0.5 * np.sum(whitened**2 - center**2) + np.sum(np.log(np.diag(inverse)))
    slope = (center + mean) ** 2 - 1.0
    for i in range(n):
        for j in range(i + 1):
            slope[j] += inverse[i, j] ** 2
    slope = kernel.exponents.T @ slope - distance / FACTOR_SD**2
    return value - 0.5 * np.sum(distance**2) / FACTOR_SD**2, kernel.root.T @ slope


@njit(cache=True, nogil=True, error_model="numpy", fastmath={"reassoc", "contract"})
def _cholesky_factor(information: np.ndarray, sd: np.ndarray) -> np.ndarray:
    """Cholesky factor of the precision in prior sds, I + sd information sd; NaN where rounding makes it indefinite."""
    n = sd.size
    factor = np.empty((n, n))
    for i in range(n):
        for j in range(i + 1):
            rest = sd[i] * information[i, j] * sd[j]
            for k in range(j):
                rest -= factor[i, k] * factor[j, k]
            factor[i, j] = np.sqrt(1.0 + rest) if i == j else rest / factor[j, j]
    return factor
