"""Fit of the coefficients to captive tests: a Gaussian likelihood with its own noise and design effect.

The noise is mostly model error, which tests at one speed and side share; the design effect corrects for that.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import scipy
import xarray as xr

from pymc_ship.inference.captive.plausibility import captive_doubts
from pymc_ship.inference.captive.table import FORCE_DOFS, FORCES
from pymc_ship.inference.trajectory.prior import CoefficientPrior, GaussianLikelihood
from pymc_ship.inference.trajectory.sequential_likelihood import commensurate_likelihood
from pymc_ship.machine.arguments import check_kind
from pymc_ship.machine.errors import InferenceError, TrialError
from pymc_ship.machine.fields import field_text
from pymc_ship.physics.forces.screw import NOMINAL_REVOLUTIONS
from pymc_ship.physics.motion.captive import captive_test_derivatives
from pymc_ship.physics.vessel.parts import ship_dimensions
from pymc_ship.physics.vessel.reading import VesselLike, as_vessel
from pymc_ship.physics.vessel.vessel import DOFS, Vessel, coefficient_names
from pymc_ship.records.denoising.ebayes import mad

_NOMINAL = 0.05  # largest relative deviation from the nominal revolutions for a polynomial model
_PASSES, _SETTLED = 20, 0.01  # iterations of the noise, and its relative tolerance
_LEAST = 1e-3  # least noise over the largest force, for exact forces
_SAME_SPEED = 0.05  # width of the groups of tests in the logarithm of the speed
_ODD, _SEEN, _MOST = 5.0, 0.05, 0.05  # misfit of an odd test: robust sd, fraction of the largest force, and of tests
_BESIDE = 0.4  # misfit of an odd test over the largest
_FAR = 5.0  # prior sd between prior and estimate that are doubted
_REVOLUTIONS = 0.1  # sd of the nominal revolutions on a carriage over those of the vessel


@dataclass(frozen=True, eq=False, repr=False)
class CaptiveFit:
    """Coefficients fitted to captive tests and their prior.

    Attributes
    ----------
    coefficients, covariance : ndarray, shape (n_coefficients,), (n_coefficients, n_coefficients)
        Posterior mode and its Gaussian covariance; ``likelihood`` is of the tests, without the prior.
    noise_sd, design_effect : dict of str to float, float
        Rms residual by force, prime at the nominal speed; variance of the estimate over that of independent rows.
    revolutions, discrepancy_scale : float
        Nominal revolutions, carriage over vessel; sd of coefficients between carriage and ship, over the prior sd.
    remarks : tuple of str
        Sentences on tests that contradict the others or repeat a force, and on forces of an unusual size.
    """

    coefficients: np.ndarray
    covariance: np.ndarray
    likelihood: GaussianLikelihood
    noise_sd: dict[str, float]
    design_effect: float
    revolutions: float = 1.0
    discrepancy_scale: float = 0.0
    remarks: tuple[str, ...] = ()

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

    Raises
    ------
    InferenceError, TrialError
        For a prior without a scale of some coefficient; for tests that are not finite; if a polynomial model has no
        test at the nominal revolutions.

    Examples
    --------
    >>> import numpy as np
    >>> import pymc_ship as ps
    >>> rows = [f"{d},15.5,{-2e-6 * d * d - 8e-5},{5.6e-5 * d},{-3e-5 * d}" for d in range(-20, 25, 5)]
    >>> np.savetxt("rudder.csv", ["delta [deg],speed [kn],X',Y',N'", *rows], fmt="%s")
    >>> vessel = ps.with_terms(ps.load_vessel("kvlcc2"), "modular")
    >>> prior = ps.coefficient_prior([], vessel)
    >>> fit = ps.fit_captive(ps.read_captive("rudder.csv", vessel), vessel, prior)
    >>> names = [parameter.name for parameter in vessel.parameters]
    >>> k = names.index("f_alpha")
    >>> print(f"f_alpha {prior.mean[k]:.2f} ± {prior.scale[k]:.2f} beforehand, "
    ...       f"{fit.coefficients[k]:.2f} ± {fit.covariance[k, k] ** 0.5:.2f} now")
    f_alpha 2.55 ± 0.64 beforehand, 2.28 ± 0.50 now
    """
    vessel = as_vessel(vessel)
    tests = _usable_tests(tests, vessel, prior)
    names = coefficient_names(vessel)
    column = names.index(NOMINAL_REVOLUTIONS) if NOMINAL_REVOLUTIONS in names and "n" in tests else None
    scale = prior.scale.copy()
    if column is not None:
        scale[column] = max(scale[column], _REVOLUTIONS)
    coefficients, sd, design, residuals = _mode(tests, vessel, replace(prior, scale=scale))
    remarks = (*captive_doubts(tests, vessel), *_odd_tests(tests, vessel, sd, residuals))
    remarks += _far_from_prior(names, (coefficients - prior.mean) / scale)
    design_effect = _design_effect(design, residuals, np.tile(_groups(tests), len(sd)), scale)
    design, residuals = design / np.sqrt(design_effect), residuals / np.sqrt(design_effect)
    # design = Q R: the tests are equivalent to the rows R with response R b + Q' residuals
    orthogonal, triangle = np.linalg.qr(design)
    response = triangle @ coefficients + orthogonal.T @ residuals
    precision = triangle.T @ triangle + np.diag(scale**-2.0)
    size = np.sqrt(np.diag(precision))
    covariance = np.linalg.inv(precision / np.outer(size, size)) / np.outer(size, size)
    revolutions = 1.0
    if column is not None and prior.scale[column] < _REVOLUTIONS:  # fixed for the ship, not on the carriage
        revolutions = float(coefficients[column])
        response = response - triangle[:, column] * (revolutions - 1.0)
    likelihood = GaussianLikelihood(triangle, response)
    return CaptiveFit(coefficients, covariance, likelihood, sd, design_effect, revolutions, remarks=remarks)


def _odd_tests(tests: xr.Dataset, vessel: Vessel, sd: dict[str, float], residuals: np.ndarray) -> tuple[str, ...]:
    """Sentences on forces that the others contradict; none if there are many, which is a misfit of the model."""
    sentences = []
    u, v = tests["u"].values, tests["v"].values
    weight = (u**2 + v**2) / vessel.particulars.nominal_speed**2
    for (name, unit), z in zip(sd.items(), residuals.reshape(len(sd), -1), strict=True):
        measured, off = tests[name].values, unit * z / weight
        odd = (np.abs(z) > _ODD * mad(z)) & (np.abs(off * weight) > _SEEN * np.abs(measured * weight).max())
        odd &= np.abs(z) > _BESIDE * np.abs(z).max()  # the fit to an odd test is off beside it, too
        for k in np.flatnonzero(odd) if odd.sum() <= max(1.0, _MOST * odd.size) else ():
            beta, rudder = np.rad2deg([np.arctan2(-v[k], u[k]) + 0.0, float(tests["delta"][k])])
            turn = float(tests["r"][k]) * vessel.particulars.L / np.hypot(u[k], v[k])
            sentences.append(
                f"The captive test at beta = {beta:.3g} deg, r' = {turn:.3g} and delta = {rudder:.3g} deg contradicts "
                f"the others: {name}' is {measured[k]:.3g}, the fit has {measured[k] - off[k]:.3g}; correct its row."
            )
    return tuple(sentences)


def _far_from_prior(names: Sequence[str], away: np.ndarray) -> tuple[str, ...]:
    """Sentence on coefficients that the tests move by many sd of their prior."""
    far = [f"{names[k]} by {away[k]:+.2g}" for k in np.argsort(-np.abs(away)) if abs(away[k]) > _FAR]
    sentence = f"The captive tests move {', '.join(far)} sd of the prior: check units, columns and the vessel file."
    return (sentence,) if far else ()


def _usable_tests(tests: xr.Dataset, vessel: Vessel, prior: CoefficientPrior) -> xr.Dataset:
    """Tests that the model can describe; TrialError or InferenceError for tests or a prior that no fit can use."""
    check_kind("Captive tests", tests, xr.Dataset, "read them by read_captive", TrialError)
    check_kind("The prior", prior, CoefficientPrior, "make one by coefficient_prior", InferenceError)
    size = len(coefficient_names(vessel))
    if prior.scale.size != size or not np.isfinite(prior.scale).all():
        raise InferenceError(
            f"A fit to captive tests takes a prior with a finite scale of the {size} "
            f"coefficients of {vessel.name!r}, found {int(np.isfinite(prior.scale).sum())} of {prior.scale.size}; use "
            "coefficient_prior with order_damped."
        )
    bad = [str(name) for name, values in tests.items() if not np.isfinite(values.values).all()]
    if bad:
        raise TrialError(f"Captive tests must be finite, found NaN or infinity in {', '.join(bad)}; drop such tests.")
    if set(tests.dims) != {"test"} or not {"u", "v", "r", "delta"} <= set(tests):
        found = ", ".join(map(str, (*tests.dims, *tests))) or "none"
        raise TrialError(f"Captive tests have u, v, r and delta over the dim test, found {found}; use read_captive.")
    tests = nominal_revolution_tests(tests, vessel)
    if not tests.sizes["test"]:
        raise TrialError(
            f"A polynomial model needs captive tests within {_NOMINAL:.0%} of the nominal revolutions, found none for "
            f"{vessel.name!r}; choose a modular model, or correct n of the propeller."
        )
    return tests


def _groups(tests: xr.Dataset) -> np.ndarray:
    """Group of each test, in which model errors are shared: one speed, and one side of v, r and delta."""
    speed = np.round(np.log(np.hypot(tests["u"].values, tests["v"].values)) / _SAME_SPEED)
    sides = [np.sign(np.round(tests[name].values, 9)) for name in ("v", "r", "delta")]
    return np.unique(np.column_stack([speed, *sides]), axis=0, return_inverse=True)[1]


def with_discrepancy(
    fit: CaptiveFit, prior: CoefficientPrior, coefficients: np.ndarray, covariance: np.ndarray
) -> CaptiveFit:
    """Fit with a commensurate prior between carriage and ship, from the ship's posterior without captive tests."""
    likelihood, (discrepancy_scale,) = commensurate_likelihood(fit.likelihood, prior, coefficients, covariance)
    return replace(fit, likelihood=likelihood, discrepancy_scale=discrepancy_scale)


def _mode(
    tests: xr.Dataset, vessel: Vessel, prior: CoefficientPrior
) -> tuple[np.ndarray, dict[str, float], np.ndarray, np.ndarray]:
    """Posterior mode, noise sd by force, and slopes and residuals of all measured forces over their noise sd."""
    names = [name for name in FORCES if name in tests]
    motion, rows = captive_motion(tests, vessel), [DOFS.index(FORCE_DOFS[name]) for name in names]
    weight = (tests["u"].values ** 2 + tests["v"].values ** 2) / vessel.particulars.nominal_speed**2
    measured = np.array([tests[name].values for name in names]) * weight

    def forces(coefficients: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        modelled, slopes = captive_test_derivatives(vessel, motion, coefficients)
        return measured - modelled[rows] * weight, slopes[rows] * weight[:, None]

    def residuals(step: np.ndarray) -> np.ndarray:
        return np.concatenate([step, (forces(prior.mean + prior.scale * step)[0] / sd[:, None]).ravel()])

    def jacobian(step: np.ndarray) -> np.ndarray:
        slopes = -forces(prior.mean + prior.scale * step)[1] * prior.scale / sd[:, None, None]
        return np.vstack([np.eye(step.size), slopes.reshape(-1, step.size)])

    coefficients, sd = prior.mean, np.ones(len(names))
    for _ in range(_PASSES):
        step = scipy.optimize.least_squares(residuals, (coefficients - prior.mean) / prior.scale, jacobian).x
        coefficients, previous = prior.mean + prior.scale * step, sd
        misfit, slopes = forces(coefficients)
        sd = np.maximum(np.sqrt(np.mean(misfit**2, axis=1)), _LEAST * np.abs(measured).max(axis=1))
        if np.allclose(sd, previous, rtol=_SETTLED):
            break
    design = (slopes / sd[:, None, None]).reshape(-1, coefficients.size)
    return coefficients, dict(zip(names, sd.tolist(), strict=True)), design, (misfit / sd[:, None]).ravel()


def _design_effect(design: np.ndarray, residuals: np.ndarray, groups: np.ndarray, scale: np.ndarray) -> float:
    """Design effect tr(C G) / tr(C H), 1 or more, as of windows (:mod:`pymc_ship.inference.trajectory.windows`)."""
    scaled = design * scale
    H = scaled.T @ scaled
    gradients = np.array([scaled[groups == k].T @ residuals[groups == k] for k in np.unique(groups)])
    C, n = np.linalg.inv(H + np.eye(scale.size)), len(gradients)
    G = gradients.T @ gradients * (n / max(n - 1, 1))  # sandwich: H^-1 G H^-1, G the scatter of group scores
    return float(max(np.trace(C @ G) / np.trace(C @ H), 1.0))
