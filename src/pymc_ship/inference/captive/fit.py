"""Fit of the coefficients to captive tests: a Gaussian likelihood with its own noise and design effect.

The noise is the residual of each force, prime at the nominal speed: mostly model error, which tests at one speed and
side share. The design effect corrects for that.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
import xarray as xr
from scipy.optimize import least_squares

from pymc_ship.inference.captive.table import FORCES
from pymc_ship.inference.trajectory.prior import CoefficientPrior, GaussianLikelihood
from pymc_ship.inference.trajectory.sequential_likelihood import commensurate_likelihood
from pymc_ship.machine.errors import InferenceError, TrialError
from pymc_ship.machine.fields import field_text
from pymc_ship.physics.forces.screw import NOMINAL_REVOLUTIONS
from pymc_ship.physics.motion.captive import captive_test_derivatives
from pymc_ship.physics.vessel.parts import ship_dimensions
from pymc_ship.physics.vessel.reading import VesselLike, as_vessel
from pymc_ship.physics.vessel.vessel import DOFS, Vessel, coefficient_names

_ROWS = [DOFS.index(dof) for dof in ("surge", "sway", "yaw")]
_NOMINAL = 0.05  # largest relative deviation from the nominal revolutions for a polynomial model
_PASSES, _SETTLED = 20, 0.01  # iterations of the noise, and its relative tolerance
_LEAST = 1e-3  # least noise over the largest force, for exact forces
_SAME_SPEED = 0.05  # width of the groups of tests in the logarithm of the speed
_REVOLUTIONS = 0.1  # sd of the nominal revolutions on a carriage over those of the vessel


@dataclass(frozen=True, repr=False)
class CaptiveFit:
    """Coefficients fitted to captive tests and their prior.

    Attributes
    ----------
    coefficients, covariance : ndarray, shape (n_coefficients,), (n_coefficients, n_coefficients)
        Posterior mode and its Gaussian covariance.
    likelihood : GaussianLikelihood
        Of the tests, without the prior.
    noise_sd : dict of str to float
        Root mean square residual of each force, prime at the nominal speed.
    design_effect : float
        Variance of the estimate over that of independent rows.
    revolutions : float
        Nominal revolutions on the carriage over those of the vessel.
    discrepancy_scale : float
        Sd of the difference of coefficients between carriage and ship, over the prior sd.
    """

    coefficients: np.ndarray
    covariance: np.ndarray
    likelihood: GaussianLikelihood
    noise_sd: dict[str, float]
    design_effect: float
    revolutions: float = 1.0
    discrepancy_scale: float = 0.0

    __repr__ = field_text


def captive_motion(tests: xr.Dataset, vessel: Vessel, revolutions: float = 1.0) -> dict[str, np.ndarray]:
    """Motion of captive tests for :func:`~pymc_ship.physics.motion.captive.captive_test_forces`."""
    motion = {name: tests[name].values for name in ("u", "v", "r", "delta")}
    if vessel.modular and "n" in tests:
        motion["n"] = tests["n"].values / ship_dimensions(vessel).n / revolutions
    return motion


def nominal_revolution_tests(tests: xr.Dataset, vessel: Vessel) -> xr.Dataset:
    """Tests that the model can describe: for polynomial terms, those at the nominal revolutions alone."""
    if vessel.modular or "n" not in tests or vessel.propeller is None:
        return tests
    return tests.isel(test=np.abs(tests["n"].values / vessel.propeller.n - 1.0) < _NOMINAL)


def fit_captive(tests: xr.Dataset, vessel: VesselLike, prior: CoefficientPrior) -> CaptiveFit:
    """Fit coefficients to captive tests under a prior.

    Parameters
    ----------
    tests : Dataset, dims (test,)
        From :func:`pymc_ship.read_captive`.
    vessel : Vessel, str or Path
    prior : CoefficientPrior
        With a finite scale of every coefficient. The nominal revolutions on the carriage are estimated.

    Returns
    -------
    CaptiveFit

    Raises
    ------
    InferenceError
        For a prior without a scale of some coefficient, or of another vessel.
    TrialError
        If a polynomial model has no test at the nominal revolutions.

    Examples
    --------
    A rudder test of a tanker, with priors of its parts from formulae:

    >>> import numpy as np
    >>> import pymc_ship as ps
    >>> rows = [f"{d},15.5,{-2e-6 * d * d - 8e-5},{5.6e-5 * d},{-3e-5 * d}" for d in range(-20, 25, 5)]
    >>> np.savetxt("rudder.csv", ["delta [deg],speed [kn],X',Y',N'", *rows], fmt="%s")
    >>> vessel = ps.with_terms(ps.load_vessel("kvlcc2"), "modular")
    >>> prior = ps.coefficient_prior([], vessel, damping=1.0)
    >>> fit = ps.fit_captive(ps.read_captive("rudder.csv", vessel), vessel, prior)
    >>> names = [parameter.name for parameter in vessel.parameters]
    >>> k = names.index("f_alpha")
    >>> print(f"f_alpha {prior.mean[k]:.2f} ± {prior.scale[k]:.2f} beforehand, "
    ...       f"{fit.coefficients[k]:.2f} ± {fit.covariance[k, k] ** 0.5:.2f} now")
    f_alpha 2.55 ± 0.64 beforehand, 2.28 ± 0.50 now
    """
    vessel = as_vessel(vessel)
    if prior.scale.size != len(coefficient_names(vessel)) or not np.isfinite(prior.scale).all():
        raise InferenceError(
            f"A fit to captive tests takes a prior with a finite scale of the {len(coefficient_names(vessel))} "
            f"coefficients of {vessel.name!r}, found {int(np.isfinite(prior.scale).sum())} of {prior.scale.size}; use "
            "coefficient_prior with order_damped."
        )
    tests = nominal_revolution_tests(tests, vessel)
    if not tests.sizes["test"]:
        raise TrialError(
            f"A polynomial model needs captive tests within {_NOMINAL:.0%} of the nominal revolutions, found none for "
            f"{vessel.name!r}; choose a modular model, or correct n of the propeller."
        )
    revolution_index = [
        k for k, name in enumerate(coefficient_names(vessel)) if name == NOMINAL_REVOLUTIONS and "n" in tests
    ]
    fixed_revolutions = prior.scale[revolution_index] < _REVOLUTIONS
    least_scale = np.where(np.isin(np.arange(prior.scale.size), revolution_index), _REVOLUTIONS, 0.0)
    prior = replace(prior, scale=np.maximum(prior.scale, least_scale))
    rows, weight = _rows(tests, vessel), _weight(tests, vessel)
    measured = [row for row, name in enumerate(FORCES) if name in tests]
    least_noise = np.array(
        [_LEAST * np.abs(tests[name] * weight).max() if name in tests else np.nan for name in FORCES]
    )
    coefficients, scale, sd = prior.mean, prior.scale, np.ones(len(FORCES))
    for _ in range(_PASSES):
        coefficients = _mode(rows, prior, coefficients, sd, measured)
        misfit, slopes = rows(coefficients)
        noise = np.maximum(np.sqrt(np.mean(misfit**2, axis=1)), least_noise)
        settled = np.allclose(noise[measured], sd[measured], rtol=_SETTLED)
        sd = noise
        if settled:
            break
    design = np.concatenate([slopes[row] / sd[row] for row in measured])
    residuals = np.concatenate([misfit[row] / sd[row] for row in measured])
    groups = np.tile(_groups(tests), len(measured))
    design_effect = _design_effect(design, residuals, groups, scale)
    design, residuals = design / np.sqrt(design_effect), residuals / np.sqrt(design_effect)
    orthogonal, triangle = np.linalg.qr(design)
    response = triangle @ coefficients + orthogonal.T @ residuals
    precision = triangle.T @ triangle + np.diag(scale**-2.0)
    size = np.sqrt(np.diag(precision))
    covariance = np.linalg.inv(precision / np.outer(size, size)) / np.outer(size, size)
    fit = CaptiveFit(
        coefficients, covariance, GaussianLikelihood(triangle, response), _by_force(sd, measured), design_effect
    )
    return _at_own_revolutions(fit, revolution_index[0]) if revolution_index and fixed_revolutions.all() else fit


def _by_force(sd: np.ndarray, measured: list[int]) -> dict[str, float]:
    return {FORCES[row]: float(sd[row]) for row in measured}


def _at_own_revolutions(fit: CaptiveFit, column: int) -> CaptiveFit:
    """Fit whose likelihood has the nominal revolutions of the carriage, in this column, at their estimate."""
    rows, n_0 = fit.likelihood.design.copy(), float(fit.coefficients[column])
    response = fit.likelihood.response - rows[:, column] * (n_0 - 1.0)
    return replace(fit, likelihood=GaussianLikelihood(rows, response), revolutions=n_0)


def with_discrepancy(
    fit: CaptiveFit, prior: CoefficientPrior, coefficients: np.ndarray, covariance: np.ndarray
) -> CaptiveFit:
    """Fit whose likelihood is of the coefficients under way, by a commensurate prior between carriage and ship.

    ``coefficients`` and ``covariance`` are those of the ship from its trials and the prior alone.
    """
    likelihood, (discrepancy_scale,) = commensurate_likelihood(fit.likelihood, prior, coefficients, covariance)
    return replace(fit, likelihood=likelihood, discrepancy_scale=discrepancy_scale)


Rows = Callable[[np.ndarray], tuple[np.ndarray, np.ndarray]]


def _rows(tests: xr.Dataset, vessel: Vessel) -> Rows:
    """Function from coefficients to residual forces and their slopes, (3, n_tests, ...), NaN where not measured."""
    motion, weight = captive_motion(tests, vessel), _weight(tests, vessel)
    missing = np.full(weight.size, np.nan)
    measured = np.array([tests[name].values if name in tests else missing for name in FORCES]) * weight

    def rows(coefficients: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        forces, slopes = captive_test_derivatives(vessel, motion, coefficients)
        return measured - forces[_ROWS] * weight, slopes[_ROWS] * weight[:, None]

    return rows


def _weight(tests: xr.Dataset, vessel: Vessel) -> np.ndarray:
    """Square of the speed over the nominal one, (n_tests,)."""
    return (tests["u"].values ** 2 + tests["v"].values ** 2) / vessel.particulars.nominal_speed**2


def _mode(rows: Rows, prior: CoefficientPrior, start: np.ndarray, sd: np.ndarray, measured: list[int]) -> np.ndarray:
    """Most probable coefficients at a noise, in units of the prior."""

    def residuals(step: np.ndarray) -> np.ndarray:
        misfit = rows(prior.mean + prior.scale * step)[0]
        return np.concatenate([step, *(misfit[row] / sd[row] for row in measured)])

    def jacobian(step: np.ndarray) -> np.ndarray:
        slopes = rows(prior.mean + prior.scale * step)[1]
        return np.vstack([np.eye(step.size), *(-slopes[row] * prior.scale / sd[row] for row in measured)])

    solution = least_squares(residuals, (start - prior.mean) / prior.scale, jacobian)
    return prior.mean + prior.scale * solution.x


def _groups(tests: xr.Dataset) -> np.ndarray:
    """Number of the group of each test: those on the same side in drift, yaw and rudder at the same speed."""
    speed = np.round(np.log(np.hypot(tests["u"].values, tests["v"].values)) / _SAME_SPEED)
    sides = [np.sign(np.round(tests[name].values, 9)) for name in ("v", "r", "delta")]
    return np.unique(np.column_stack([speed, *sides]), axis=0, return_inverse=True)[1]


def _design_effect(design: np.ndarray, residuals: np.ndarray, groups: np.ndarray, scale: np.ndarray) -> float:
    """Design effect tr(C G) / tr(C H), 1 or more, as of windows (:mod:`pymc_ship.inference.trajectory.windows`)."""
    scaled = design * scale
    H = scaled.T @ scaled
    gradients = np.array([scaled[groups == k].T @ residuals[groups == k] for k in np.unique(groups)])
    C, n = np.linalg.inv(H + np.eye(scale.size)), len(gradients)
    G = gradients.T @ gradients * (n / max(n - 1, 1))
    return float(max(np.trace(C @ G) / np.trace(C @ H), 1.0))
