"""Hierarchical prior of the scales of coefficients: its most probable scales, and draws with all scales integrated out.

theta_j = mean_j + scale_j exp(E_j eta) t_j with t_j Student's t: row j of the exponents E picks the log factor of its
group and, for each order above the first, the log damping of its DOF. The elements of eta are normal.
"""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import scipy
from numba import njit

FREEDOM = 4.0  # degrees of freedom of Student's t, here and in fits to windows
FACTOR_SD = float(np.log(2.0))  # prior sd of each log factor and log damping: a factor of two
_LARGEST_MIXING = 1e4  # of the variance of a coefficient over that of its factors: bounds the condition number
_BURN_IN = 300
_THINNING = 25
_STEP = 0.6  # of the random walk of eta, in posterior sd of a group of about ten coefficients
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
        student = scipy.stats.t.logpdf(z * np.exp(-log_factor), FREEDOM) - log_factor
        return np.where(self.is_scaled, student, scipy.stats.norm.logpdf(z)).sum(axis=-1)


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


def probable_scales(problem: LinearProblem, eta: np.ndarray) -> Scales:
    """Most probable eta and the normal laws equivalent to Student's t, by expectation-maximisation from a start."""
    E, scaled = problem.law.exponents, problem.law.is_scaled
    sd = problem.factor(eta)
    for _ in range(_MOST_UPDATES):
        total = problem.information + np.diag(sd**-2)
        size = np.sqrt(np.diag(total))
        covariance = np.linalg.inv(total / np.outer(size, size)) / np.outer(size, size)
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

    One element of eta at a time moves with the deviations integrated out (Liu 1994,
    doi:10.1080/01621459.1994.10476829), then all given them, in turns with the scale mixture of Student's t (Lange,
    Little & Taylor 1989, doi:10.1080/01621459.1989.10478852).
    """
    law, begin = problem.law, FACTOR_SD * 0.5 * rng.standard_normal((chains, problem.law.center.size)) + start.eta
    deviations = np.empty((chains, draws, problem.scale.size))
    factors = np.empty((chains, draws, law.center.size))
    mixing = (start.sd / problem.factor(start.eta)) ** 2
    arrays = (*problem[1:], law.exponents, law.is_scaled, law.center)
    kernel = _Kernel(*map(np.ascontiguousarray, arrays))
    for chain in range(chains):
        _gibbs(kernel, begin[chain], mixing.copy(), rng, deviations[chain], factors[chain])
    return deviations, factors


class _Kernel(NamedTuple):
    """Arrays of a linear problem and its law."""

    scale: np.ndarray
    information: np.ndarray
    score: np.ndarray
    mode: np.ndarray
    exponents: np.ndarray
    is_scaled: np.ndarray
    center: np.ndarray


@njit(cache=True, nogil=True)
def _gibbs(
    kernel: _Kernel,
    eta: np.ndarray,
    mixing: np.ndarray,
    rng: np.random.Generator,
    deviations: np.ndarray,
    factors: np.ndarray,
) -> None:
    """Fill draws of one chain; see :func:`gibbs_draws`."""
    scale, exponents, center = kernel.scale, kernel.exponents, kernel.center
    n, m = exponents.shape
    sd, whitened, deviation = scale * np.exp(exponents @ eta) * np.sqrt(mixing), np.empty(n), np.empty(n)
    value, root = _evidence(kernel, sd, whitened)
    new_whitened = np.empty(n)
    for step in range(-_BURN_IN, deviations.shape[0] * _THINNING):
        k = (step + _BURN_IN) % m
        change = _STEP * rng.standard_normal()
        new_sd = sd * np.exp(change * exponents[:, k])
        new_value, new_root = _evidence(kernel, new_sd, new_whitened)
        gain = new_value - value - change * (eta[k] - center[k] + 0.5 * change) / FACTOR_SD**2
        if np.log(rng.random()) < gain:
            eta[k] += change
            sd, root = new_sd, new_root
            whitened, new_whitened = new_whitened, whitened
        for i in range(n - 1, -1, -1):
            total = whitened[i] + rng.standard_normal()
            for j in range(i + 1, n):
                total -= root[j, i] * deviation[j]
            deviation[i] = total / root[i, i]
        deviation = kernel.mode + sd * deviation
        factor = scale * np.exp(exponents @ eta)
        for i in range(n):
            if kernel.is_scaled[i]:
                standard = (deviation[i] / factor[i]) ** 2
                mixing[i] = min((FREEDOM + standard) / 2.0 / rng.gamma((FREEDOM + 1.0) / 2.0, 1.0), _LARGEST_MIXING)
        for k in range(m):
            change, gain = _STEP * rng.standard_normal(), 0.0
            for i in range(n):
                if exponents[i, k] != 0.0:
                    square = (deviation[i] / factor[i]) ** 2 / mixing[i]
                    power = change * exponents[i, k]
                    gain -= power + 0.5 * square * (np.exp(-2.0 * power) - 1.0)
            gain -= change * (eta[k] - center[k] + 0.5 * change) / FACTOR_SD**2
            if np.log(rng.random()) < gain:
                eta[k] += change
                factor = factor * np.exp(change * exponents[:, k])
        sd = factor * np.sqrt(mixing)
        value, root = _evidence(kernel, sd, whitened)
        if step >= 0 and step % _THINNING == 0:
            deviations[step // _THINNING], factors[step // _THINNING] = deviation, eta


@njit(cache=True, nogil=True)
def _evidence(kernel: _Kernel, sd: np.ndarray, whitened: np.ndarray) -> tuple[float, np.ndarray]:
    """Log evidence of prior sds and the Cholesky factor; fills the whitened mean of the changes from the mode."""
    n = sd.size
    total = np.empty((n, n))
    for i in range(n):
        for j in range(n):
            total[i, j] = sd[i] * kernel.information[i, j] * sd[j]
        total[i, i] += 1.0
    root, value = np.linalg.cholesky(total), 0.0
    for i in range(n):
        rest = sd[i] * kernel.score[i] - kernel.mode[i] / sd[i]
        for j in range(i):
            rest -= root[i, j] * whitened[j]
        whitened[i] = rest / root[i, i]
        value += 0.5 * whitened[i] ** 2 - 0.5 * (kernel.mode[i] / sd[i]) ** 2 - np.log(root[i, i])
    return value, root
