"""Weak form: the equations of motion integrated against test functions w, so that no record is differentiated.

-sum_k w'_k (J L nu_k) = sum_k w_k U_k^2 (Phi_k theta + known_k), L = (L, L, L^2, L^2); Bortz, Messenger & Dukic
(2023), doi:10.1007/s11538-023-01208-6. The motion in the terms is denoised.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import scipy
import xarray as xr

from pymc_ship.machine.arguments import check_choice
from pymc_ship.machine.errors import ShipError, TrialError
from pymc_ship.physics.forces.terms import evaluate
from pymc_ship.physics.motion.equations import VELOCITIES
from pymc_ship.physics.motion.prime_record import motion_record, prime_record
from pymc_ship.physics.motion.stepping import METHODS
from pymc_ship.physics.vessel.reading import VesselLike, as_vessel
from pymc_ship.physics.vessel.vessel import DOFS, Vessel
from pymc_ship.records.checks.record_quality import SAMPLES_BAD
from pymc_ship.records.files.ship_scale import ship_scale
from pymc_ship.trial.record import sampling_interval, trial_list

RADIUS = 0.275  # half the support of a test function [L/U_nom], at least :data:`_FEWEST` samples
INTERVAL = 0.2  # interval of the centres of the test functions for the start of a fit, over the radius
INDEPENDENT = 0.8  # interval of the centres at which rows count as independent, over the radius
TAU = (0.05, 20.0)  # bounds of the factor tau on the prior scales of a degree of freedom
_POWER = 6
_FEWEST = 4  # samples in a radius
_ITERATIONS = 200
_NOISE_RATIO = 0.01  # noise variance over mean square response if no rows are left to estimate it


@dataclass(frozen=True)
class WeakForm:
    """Rows of the weak form by DOF: means under each test function."""

    time: np.ndarray  # (n_rows,) [s]; centres of the test functions
    design_matrices: dict[str, np.ndarray]  # of the terms times (U/U_nom)^2
    responses: dict[str, np.ndarray]  # of the prime force at the nominal speed


def radius_samples(trial: xr.Dataset, vessel: Vessel) -> int:
    """Samples in a radius; TrialError where the check of the sampling is bad, too."""
    step, ship_time = sampling_interval(trial), ship_scale(trial, vessel).time
    if ship_time < SAMPLES_BAD * step:
        raise TrialError(
            f"The weak form needs {SAMPLES_BAD:g} samples in L/U, at most {ship_time / SAMPLES_BAD:.3g} s apart, found "
            f"{step:g} s; sample faster."
        )
    return max(round(RADIUS * vessel.particulars.ship_time / step), _FEWEST)


def row_stride(n_radius: int, interval: float = INDEPENDENT) -> int:
    """Samples from one centre to the next, for an interval over the radius."""
    return max(round(interval * n_radius), 1)


def bump(n_radius: int, step: float, method: str = "euler") -> tuple[np.ndarray, np.ndarray]:
    """Test function (1 - s^2)^6 over [-1, 1] radii, of unit sum, and its derivative [1/s], shape (2 n_radius + 1,).

    The derivative is a difference for a record of Euler steps of the sampling interval ``step`` [s], "euler", and exact
    for all other motion, "rk4".
    """
    check_choice("The method of a record", method, METHODS)
    s = np.arange(-n_radius, n_radius + 1) / n_radius
    weights = (1.0 - s**2) ** _POWER
    slope = -2.0 * _POWER * s * (1.0 - s**2) ** (_POWER - 1) / (n_radius * step)
    slope = np.diff(weights, prepend=0.0) / step if method == "euler" else slope
    return weights / weights.sum(), slope / weights.sum()


def weak_form(trial: xr.Dataset, vessel: Vessel, *, stride: int | None = None, method: str = "euler") -> WeakForm:
    """Rows of the weak form of every DOF of a vessel, from a trial as measured, dims (time,).

    ``stride`` is the number of samples from one centre to the next, :data:`INTERVAL` by default; ``method`` that of
    :func:`bump`. TrialError for missing channels, NaN, time that is not uniform, a record too short or too coarse;
    ValueError for an unknown method.
    """
    from pymc_ship.records.denoising.denoise import denoise

    record, step = motion_record(trial, vessel), sampling_interval(trial)
    n_time, n_radius = record["u"].size, radius_samples(trial, vessel)
    kernels = bump(n_radius, step, method)  # the test function and its slope
    stride = row_stride(n_radius, INTERVAL) if stride is None else stride
    centres = np.arange(-(-n_radius // stride) * stride, n_time - n_radius, stride)
    if centres.size == 0:
        raise TrialError(
            f"The weak form needs a record longer than its test function of {2.0 * n_radius * step:.3g} s, found "
            f"{n_time} samples over {(n_time - 1) * step:g} s; use a longer trial."
        )
    average, differentiate = (_kernel_matrix(kernel, centres - n_radius, n_time) for kernel in kernels)
    names = [name for name in record if name != "delta"]
    smooth = denoise(trial, translation_invariant=False, channels=names)  # decimated wavelet transform: fast
    denoised = record | {name: np.ascontiguousarray(smooth[name].values) for name in names}
    motion, speed, known_forces = prime_record(vessel, denoised)
    weight = (speed / vessel.particulars.nominal_speed) ** 2
    terms = tuple(dict.fromkeys(term for dof in vessel.dofs for term in vessel.terms(dof)))
    # sum w U^2 Phi, and -sum w' J L nu - sum w U^2 known
    columns = average @ (evaluate(terms, motion) * weight[:, None])
    force = -(differentiate @ _momentum(vessel, record).T) - average @ (known_forces * weight).T
    design = {dof: columns[:, [terms.index(term) for term in vessel.terms(dof)]] for dof in vessel.dofs}
    responses = {dof: np.ascontiguousarray(force[:, DOFS.index(dof)]) for dof in vessel.dofs}
    return WeakForm(trial["time"].values[centres], design, responses)


def weak_form_start(
    trials: xr.Dataset | Sequence[xr.Dataset],
    vessel: VesselLike,
    mean: np.ndarray,
    scale: np.ndarray,
    *,
    method: str = "euler",
) -> np.ndarray:
    """Posterior mean of the weak form under the prior N(mean_j, (tau scale_j)^2): the start of a trajectory fit.

    tau and the noise variance of each DOF maximise the evidence; parameters of parts stay at their means. ``mean`` and
    ``scale`` have shape (n_coefficients,), DOF after DOF; a scale of infinity is a flat prior, 0 fixes a coefficient.
    """
    vessel = as_vessel(vessel)
    n_terms = [len(vessel.terms(dof)) for dof in vessel.dofs]
    mean, scale = np.asarray(mean, dtype=float), np.asarray(scale, dtype=float)
    size = sum(n_terms) + len(vessel.parameters)
    if not mean.shape == scale.shape == (size,) or not np.isfinite(mean).all() or not (scale >= 0.0).all():
        raise ShipError(
            f"The prior has a finite mean and a scale from 0 up for each of {size} coefficients, found shapes "
            f"{mean.shape} and {scale.shape}, or values that are not so; correct them."
        )
    if not sum(n_terms):
        return mean.copy()
    cuts = np.cumsum(n_terms)
    rows = _stack_rows(trials, vessel, method).values()
    *means, parameters = np.split(mean, cuts)
    parts = zip(rows, means, np.split(scale, cuts)[:-1], strict=True)
    return np.concatenate([*(empirical_bayes_mean(*data, *prior) for data, *prior in parts), parameters])


def coefficient_scales(trials: xr.Dataset | Sequence[xr.Dataset], vessel: VesselLike) -> np.ndarray:
    """Scale of each coefficient: rms(force) / rms(term) over the rows of the weak form, the force that of a first fit.

    Positive prime values. TrialError as :func:`weak_form`, and for terms that stay 0.
    """
    vessel = as_vessel(vessel)
    scales = []
    for dof, (X, y) in _stack_rows(trials, vessel, "euler").items():
        size = _rms(X)
        idle = [term for term, value in zip(vessel.terms(dof), size, strict=True) if value == 0.0]
        if idle:
            raise TrialError(
                f"A trial must excite every term; {', '.join(idle)} of the {dof} stay 0: leave them out or use a trial "
                "that excites them."
            )
        scales.append(_rms(X @ empirical_bayes_mean(X, y, np.zeros(size.size), _rms(y) / size)) / size)
    return np.concatenate(scales)


def _rms(values: np.ndarray) -> np.ndarray:
    return np.sqrt(np.mean(values**2, axis=0))


def _momentum(vessel: Vessel, record: dict[str, np.ndarray]) -> np.ndarray:
    """Momentum J L nu over the square of the nominal speed, shape (4, n_time)."""
    L, nominal_speed = vessel.particulars.L, vessel.particulars.nominal_speed
    motion = np.array([record[name] if name in record else np.zeros_like(record["u"]) for name in VELOCITIES])
    motion *= np.array([[L], [L], [L**2], [L**2]]) / nominal_speed**2
    return vessel.inertia_matrix @ motion


def _kernel_matrix(kernel: np.ndarray, starts: np.ndarray, n_time: int) -> scipy.sparse.csr_array:
    columns = (starts[:, None] + np.arange(kernel.size)).ravel()
    ends = np.arange(starts.size + 1) * kernel.size
    return scipy.sparse.csr_array((np.tile(kernel, starts.size), columns, ends), shape=(starts.size, n_time))


def _stack_rows(
    trials: xr.Dataset | Sequence[xr.Dataset], vessel: Vessel, method: str
) -> dict[str, tuple[np.ndarray, np.ndarray]]:
    """Design matrix and response of each DOF over the rows of all trials."""
    runs = trial_list(trials)
    if not runs:
        raise TrialError("The weak form needs at least one trial, found none; give one.")
    forms = [weak_form(run, vessel, method=method) for run in runs]
    return {
        dof: (
            np.concatenate([form.design_matrices[dof] for form in forms]),
            np.concatenate([form.responses[dof] for form in forms]),
        )
        for dof in vessel.dofs
    }


def empirical_bayes_mean(X: np.ndarray, y: np.ndarray, mean: np.ndarray, scale: np.ndarray) -> np.ndarray:
    """Posterior mean under N(mean_j, (tau scale_j)^2), tau and noise variance of maximum evidence, shape (n_terms,)."""
    free = np.isinf(scale)
    coefficients, residual = mean.copy(), y - X @ mean
    size = _rms(X[:, free])
    size[size == 0.0] = 1.0
    left, s, right = np.linalg.svd(X[:, free] / size, full_matrices=False)
    full = s > s.max(initial=0.0) * max(X.shape) * np.finfo(float).eps
    left, s, right = left[:, full], s[full], right[full]
    # the coefficients with a flat prior are projected out, so that tau is that of the others
    informed = X[:, ~free] * scale[~free]
    step = _evidence_ridge(
        informed - left @ (left.T @ informed), residual - left @ (left.T @ residual), len(y) - s.size
    )
    coefficients[~free] += scale[~free] * step
    coefficients[free] += (left.T @ (residual - informed @ step) / s) @ right / size
    return coefficients


def _evidence_ridge(X: np.ndarray, y: np.ndarray, n_rows: int) -> np.ndarray:
    """Ridge coefficients by the fixed point of MacKay (1992), Neural Comput. 4(3):415; ``n_rows``: free rows."""
    left, s, right = np.linalg.svd(X, full_matrices=False)
    z = left.T @ y
    outside = np.sum((y - left @ z) ** 2)
    least = np.finfo(float).eps ** 2 * np.mean(y**2) + np.finfo(float).tiny
    residual_dof = n_rows - s.size
    by_residuals = outside / residual_dof if residual_dof > 0 else _NOISE_RATIO * np.mean(y**2)
    prior_variance, noise_variance = 1.0, max(by_residuals, least)
    for _ in range(_ITERATIONS):
        # lambda_i = s_i^2 / (s_i^2 + sigma^2 / tau^2); tau^2 = |b|^2 / sum lambda
        shrinkage = s**2 / (s**2 + noise_variance / prior_variance)
        n_effective = max(shrinkage.sum(), np.finfo(float).tiny)
        step = z * s / (s**2 + noise_variance / prior_variance)
        before = prior_variance, noise_variance
        prior_variance = np.clip(np.sum(step**2) / n_effective, TAU[0] ** 2, TAU[1] ** 2)
        misfit = outside + np.sum(((1.0 - shrinkage) * z) ** 2)
        noise_variance = max(misfit / max(n_rows - n_effective, 1.0), least)
        if np.allclose((prior_variance, noise_variance), before, rtol=1e-6, atol=0.0):
            break
    return step @ right
