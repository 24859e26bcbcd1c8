"""Fit of the coefficients to captive tests: a Gaussian likelihood with its own noise and design effect.

Forces are compared at the scale of the nominal speed. The noise is the residual of X, Y and N, mostly model error that
tests at one speed and side share; the design effect corrects for that. Coefficients may differ between carriage and
ship under way by a discrepancy scale, in prior sd, that the trials determine by empirical Bayes.
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
_NOMINAL = 0.05  # share by which revolutions may be off the nominal ones for terms, which know no others
_PASSES, _SETTLED = 20, 0.01
_LEAST = 1e-3  # of the largest force: the noise of exact ones
_SAME_SPEED = 0.05
_REVOLUTIONS = 0.1  # sd of the nominal revolutions on a carriage over those of the vessel


@dataclass(frozen=True, repr=False)
class CaptiveFit:
    """Coefficients fitted to captive tests and their prior.

    Attributes
    ----------
    coefficients : ndarray, shape (n_coefficients,)
        Most probable ones.
    covariance : ndarray, shape (n_coefficients, n_coefficients)
    likelihood : GaussianLikelihood
        Of the tests, without the prior.
    noise_sd : dict of str to float
        Root mean square residual of each force, prime at the nominal speed.
    design_effect : float
        Variance of the estimate over that of independent rows.
    revolutions : float
        Nominal revolutions of the model on the carriage over those of the vessel.
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


def held_motion(tests: xr.Dataset, vessel: Vessel, revolutions: float = 1.0) -> dict[str, np.ndarray]:
    """Motion of captive tests as :func:`pymc_ship.physics.motion.captive.captive_test_forces` takes it.

    ``revolutions`` are the nominal ones on the carriage over those of the vessel.
    """
    motion = {name: tests[name].values for name in ("u", "v", "r", "delta")}
    if vessel.modular and "n" in tests:
        motion["n"] = tests["n"].values / ship_dimensions(vessel).n / revolutions
    return motion


def known_tests(tests: xr.Dataset, vessel: Vessel) -> xr.Dataset:
    """Tests that a vessel's forces stand for: terms know the nominal revolutions alone."""
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
        With a finite scale of every coefficient. Nominal revolutions are free on the carriage.

    Returns
    -------
    CaptiveFit

    Raises
    ------
    InferenceError
        For a prior without a scale of some coefficient, or of another vessel.
    TrialError
        If no test is at the nominal revolutions, for terms that need them.

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
    tests = known_tests(tests, vessel)
    if not tests.sizes["test"]:
        raise TrialError(
            f"Terms stand for the nominal revolutions alone, found none of the captive tests of {vessel.name!r} within "
            f"{_NOMINAL:.0%} of them; choose sets of parts, or state the propeller's own n."
        )
    own = [k for k, name in enumerate(coefficient_names(vessel)) if name == NOMINAL_REVOLUTIONS and "n" in tests]
    held = prior.scale[own] < _REVOLUTIONS
    free = np.where(np.isin(np.arange(prior.scale.size), own), _REVOLUTIONS, 0.0)
    prior = replace(prior, scale=np.maximum(prior.scale, free))
    rows, weight = _rows(tests, vessel), _weight(tests, vessel)
    measured = [place for place, name in enumerate(FORCES) if name in tests]
    least = np.array([_LEAST * np.abs(tests[name] * weight).max() if name in tests else np.nan for name in FORCES])
    at, scale, sd = prior.mean, prior.scale, np.ones(len(FORCES))
    for _ in range(_PASSES):
        at = _mode(rows, prior, at, sd, measured)
        misfit, slopes = rows(at)
        noise = np.maximum(np.sqrt(np.mean(misfit**2, axis=1)), least)
        settled = np.allclose(noise[measured], sd[measured], rtol=_SETTLED)
        sd = noise
        if settled:
            break
    white = np.concatenate([slopes[place] / sd[place] for place in measured])
    left = np.concatenate([misfit[place] / sd[place] for place in measured])
    groups = np.tile(_groups(tests), len(measured))
    design_effect = _design_effect(white, left, groups, scale)
    white, left = white / np.sqrt(design_effect), left / np.sqrt(design_effect)
    orthogonal, triangle = np.linalg.qr(white)
    values = triangle @ at + orthogonal.T @ left
    precision = triangle.T @ triangle + np.diag(scale**-2.0)
    size = np.sqrt(np.diag(precision))
    covariance = np.linalg.inv(precision / np.outer(size, size)) / np.outer(size, size)
    found = CaptiveFit(at, covariance, GaussianLikelihood(triangle, values), _by_force(sd, measured), design_effect)
    return _at_own_revolutions(found, own[0]) if own and held.all() else found


def _by_force(sd: np.ndarray, measured: list[int]) -> dict[str, float]:
    return {FORCES[place]: float(sd[place]) for place in measured}


def _at_own_revolutions(fit: CaptiveFit, column: int) -> CaptiveFit:
    """Fit whose likelihood takes the nominal revolutions of the carriage, in this column, as found."""
    rows, n_0 = fit.likelihood.design.copy(), float(fit.coefficients[column])
    values = fit.likelihood.response - rows[:, column] * (n_0 - 1.0)
    return replace(fit, likelihood=GaussianLikelihood(rows, values), revolutions=n_0)


def shared_with_trials(
    fit: CaptiveFit, prior: CoefficientPrior, coefficients: np.ndarray, covariance: np.ndarray
) -> CaptiveFit:
    """Fit whose likelihood is of the coefficients under way, with the discrepancy scale between carriage and ship.

    Parameters
    ----------
    fit : CaptiveFit
        Of the coefficients on the carriage.
    prior : CoefficientPrior
    coefficients, covariance : ndarray, shape (n_coefficients,), (n_coefficients, n_coefficients)
        Of the ship by her trials and the prior alone.
    """
    likelihood, (share,) = commensurate_likelihood(fit.likelihood, prior, coefficients, covariance)
    return replace(fit, likelihood=likelihood, discrepancy_scale=share)


Rows = Callable[[np.ndarray], tuple[np.ndarray, np.ndarray]]


def _rows(tests: xr.Dataset, vessel: Vessel) -> Rows:
    """Function from coefficients to what they leave of the forces, (3, n_tests), and the slopes of theirs.

    NaN where a force was not measured.
    """
    motion, weight = held_motion(tests, vessel), _weight(tests, vessel)
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
        return np.concatenate([step, *(misfit[place] / sd[place] for place in measured)])

    def jacobian(step: np.ndarray) -> np.ndarray:
        slopes = rows(prior.mean + prior.scale * step)[1]
        return np.vstack([np.eye(step.size), *(-slopes[place] * prior.scale / sd[place] for place in measured)])

    found = least_squares(residuals, (start - prior.mean) / prior.scale, jacobian)
    return prior.mean + prior.scale * found.x


def _groups(tests: xr.Dataset) -> np.ndarray:
    """Number of the group of each test: those on the same side in drift, yaw and rudder at the same speed."""
    speed = np.round(np.log(np.hypot(tests["u"].values, tests["v"].values)) / _SAME_SPEED)
    sides = [np.sign(np.round(tests[name].values, 9)) for name in ("v", "r", "delta")]
    return np.unique(np.column_stack([speed, *sides]), axis=0, return_inverse=True)[1]


def _design_effect(white: np.ndarray, left: np.ndarray, groups: np.ndarray, scale: np.ndarray) -> float:
    """Variance of the gradients of groups over that of rows independent of each other, 1 or more.

    As of windows, :mod:`pymc_ship.inference.trajectory.windows`: tr(C G) / tr(C H) in the directions that the rows
    determine.
    """
    design = white * scale
    H = design.T @ design
    gradients = np.array([design[groups == k].T @ left[groups == k] for k in np.unique(groups)])
    C, n = np.linalg.inv(H + np.eye(scale.size)), len(gradients)
    G = gradients.T @ gradients * (n / max(n - 1, 1))
    return float(max(np.trace(C @ G) / np.trace(C @ H), 1.0))
