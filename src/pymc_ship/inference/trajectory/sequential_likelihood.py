"""Gaussian likelihood of earlier runs (quadratic about the mode of a fit to windows), for fits to later runs."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import product

import numpy as np

from pymc_ship.inference.trajectory.prior import CoefficientPrior, GaussianLikelihood
from pymc_ship.inference.trajectory.windows import WindowFit
from pymc_ship.machine.errors import InferenceError
from pymc_ship.physics.vessel.vessel import Vessel, coefficient_names, per_run_indices

_GRID_SIZES = {1: 101, 2: 31}  # discrepancy scales tried per group, by the number of groups
_RELATIVE_RANK = 1e-9  # eigenvalues below this fraction of the largest count as zero


@dataclass(frozen=True)
class EarlierLikelihood:
    """Likelihood of coefficients by earlier runs, and the prior of that fit."""

    names: tuple[str, ...]  # of the coefficients
    gaussian: GaussianLikelihood
    log_density: np.ndarray  # (n_runs,); log predictive density of each run, held out
    prior_mean: np.ndarray
    prior_scale: np.ndarray

    def __repr__(self) -> str:
        return f"EarlierLikelihood({len(self.names)} coefficients, {len(self.log_density)} runs)"

    def for_vessel(self, vessel: Vessel) -> GaussianLikelihood:
        """Likelihood with the coefficients in the order of a vessel; InferenceError where the vessel lacks one."""
        names, design = coefficient_names(vessel), self.gaussian.design
        lacking = [name for k, name in enumerate(self.names) if name not in names and design[:, k].any()]
        if lacking:
            raise InferenceError(
                f"The likelihood of earlier runs needs every coefficient of their vessel, found none of "
                f"{', '.join(lacking)} in {vessel.name!r}; give the vessel file of the earlier runs."
            )
        reordered, common = np.zeros((len(design), len(names))), [name for name in self.names if name in names]
        reordered[:, list(map(names.index, common))] = design[:, list(map(self.names.index, common))]
        return GaussianLikelihood(reordered, self.gaussian.response)

    def at_draught(self, names: Sequence[str], prior: CoefficientPrior) -> EarlierLikelihood:
        """Likelihood at another draught with this prior of ``names``: equal standardised distances from the prior."""
        mean, scale = self.prior_mean.copy(), self.prior_scale.copy()
        for k, name in enumerate(self.names):
            if name in names:
                mean[k], scale[k] = (values[list(names).index(name)] for values in (prior.mean, prior.scale))
        ratio = self.prior_scale / scale
        design, response = self.gaussian
        moved = GaussianLikelihood(design * ratio, response - design @ (self.prior_mean - ratio * mean))
        return EarlierLikelihood(self.names, moved, self.log_density, mean, scale)


def window_likelihood(fit: WindowFit, prior: CoefficientPrior, inflation: float = 1.0) -> GaussianLikelihood:
    """Gaussian likelihood by the windows of a fit without the constants of runs; ``inflation`` multiplies its sd."""
    scale, other = prior.scale, prior.likelihood_or_flat
    prior_information = np.diag(scale**-2.0) + other.design.T @ other.design
    gradient = (fit.coefficients - prior.mean) / scale**2 - other.design.T @ other.residuals(fit.coefficients)
    free = np.ones(scale.size)
    free[per_run_indices(fit.vessel)] = 0.0
    unit = scale * free
    information = unit[:, None] * (fit.information - prior_information) * unit
    eigenvalues, vectors = np.linalg.eigh(0.5 * (information + information.T))
    determined = eigenvalues > _RELATIVE_RANK * max(eigenvalues[-1], 0.0)
    root, directions = np.sqrt(eigenvalues[determined]), vectors[:, determined].T
    design = root[:, None] * directions * (free / scale)
    shift = directions @ (unit * gradient) / root
    return GaussianLikelihood(design / inflation, (design @ fit.coefficients + shift) / inflation)


def joint_likelihood(likelihoods: Sequence[GaussianLikelihood | None]) -> GaussianLikelihood | None:
    """Product of independent likelihoods; None without any."""
    independent = [one for one in likelihoods if one is not None]
    if not independent:
        return None
    return GaussianLikelihood(*(np.concatenate(parts) for parts in zip(*independent, strict=True)))


def commensurate_likelihood(
    likelihood: GaussianLikelihood,
    prior: CoefficientPrior,
    coefficients: np.ndarray,
    covariance: np.ndarray,
    separate: Sequence[int] = (),
) -> tuple[GaussianLikelihood, tuple[float, ...]]:
    """Likelihood by other data under a commensurate prior (Hobbs et al. 2011, doi:10.1111/j.1541-0420.2011.01564.x).

    Each coefficient differs from that of the present data by N(0, (discrepancy scale times prior sd)^2), the scale of
    largest marginal likelihood on a grid from 0 to 1. ``coefficients`` and ``covariance`` are posterior mean and
    covariance by the present data and the prior alone; those ``separate`` have another scale. Scales are
    of the others, then of ``separate``; a group without coefficients has none.
    """
    design, residuals = likelihood.design, likelihood.residuals(coefficients)
    scaled, identity = design * prior.scale, np.eye(len(design))
    covariance_of_residuals = identity + design @ covariance @ design.T
    is_separate = np.isin(np.arange(prior.scale.size), separate)
    covariances = [scaled[:, group] @ scaled[:, group].T for group in (~is_separate, is_separate) if group.any()]

    def discrepancy(scales: Sequence[float]) -> np.ndarray:
        return sum(scale**2 * one for scale, one in zip(scales, covariances, strict=True))

    def negative_log_evidence(scales: Sequence[float]) -> float:
        root = np.linalg.cholesky(covariance_of_residuals + discrepancy(scales))
        white = np.linalg.solve(root, residuals)
        return float(0.5 * white @ white + np.sum(np.log(np.diag(root))))

    grid = np.linspace(0.0, 1.0, _GRID_SIZES[len(covariances)]).tolist()
    scales = min(product(grid, repeat=len(covariances)), key=negative_log_evidence)
    root = np.linalg.cholesky(identity + discrepancy(scales))
    return GaussianLikelihood(np.linalg.solve(root, design), np.linalg.solve(root, likelihood.response)), scales
