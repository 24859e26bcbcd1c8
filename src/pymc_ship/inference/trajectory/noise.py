"""Choice of the noise model by tests of the residuals under white noise, and the fit under that model."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.special import chdtrc, ndtr, stdtrit

from pymc_ship.inference.trajectory.fit import (
    Noise,
    Problem,
    TrajectoryFit,
    fit_trajectory,
    initial_problem,
    linearise,
    white_noise,
    whiten_channels,
)
from pymc_ship.inference.trajectory.prior import CoefficientPrior
from pymc_ship.inference.trajectory.runs import Run
from pymc_ship.inference.trajectory.scale_law import student_log_density
from pymc_ship.machine.arguments import check_choice, check_flags
from pymc_ship.machine.errors import FitError
from pymc_ship.physics.motion.replay import replay
from pymc_ship.physics.vessel.vessel import Vessel

NOISE_MODELS = ("auto", "white", "ar1", "student_t")  # ``auto`` chooses by the tests of the residuals
ALPHA = 1e-4  # significance level of each test, for all channels together
LAGS = 10  # lags of the Ljung-Box test, in blocks
_MOST_PASSES = 5
_CONVERGED = 0.02  # posterior standard deviations
_DEGREES_OF_FREEDOM = (2.5, 3.0, 4.0, 5.0, 7.0, 10.0, 20.0)


@dataclass(frozen=True)
class ResidualTests:
    """p-values for all runs and channels: Ljung-Box, score test of offsets, kurtosis, chi2 against the assumed sd."""

    serial: float
    offset: float
    tails: float
    size: float


@dataclass(frozen=True)
class NoiseChoice:
    """Fit under noise of a kind."""

    fit: TrajectoryFit
    kind: str
    offsets: bool  # whether each sensor of each run has a constant offset
    degrees_of_freedom: float  # of Student's t, or inf
    tests: ResidualTests  # under white noise
    sentence: str  # reason of the choice


def fit_with_noise(
    runs: Sequence[Run],
    vessel: Vessel,
    prior: CoefficientPrior,
    start: np.ndarray,
    *,
    noise: str = "auto",
    offsets: bool | None = None,
) -> NoiseChoice:
    """Fit from a start (n_coefficients,) under one of NOISE_MODELS; ``offsets`` None: by the score test.

    FitError for an unknown noise model, a start that diverges, a fit that does not converge. Ljung & Box (1978),
    doi:10.1093/biomet/65.2.297; Lange, Little & Taylor (1989), doi:10.1080/01621459.1989.10478852.
    """
    check_choice("The noise", noise, NOISE_MODELS, FitError)
    check_flags(FitError, offsets=offsets is not None and offsets)
    problem = initial_problem(runs, vessel, prior)
    white = _white_fit(problem, np.concatenate([start, *(run.initial_state[0] for run in runs)]))
    tests = residual_tests(white)
    if noise == "auto":
        noise = "ar1" if tests.serial < ALPHA else "student_t" if tests.tails < ALPHA else "white"
        if noise == "ar1" and (tests.offset < ALPHA if offsets is None else offsets):
            noise = _ar1_or_white(white)
    fit, degrees_of_freedom = _fit_under_noise(white, noise, bool(offsets), tests)
    has_offsets = offset_test(fit) < ALPHA if offsets is None else offsets
    if has_offsets and offsets is None:
        fit, degrees_of_freedom = _fit_under_noise(fit, noise, True, tests)
    sentence = _sentence(noise, has_offsets, degrees_of_freedom, tests, fit)
    return NoiseChoice(fit, noise, has_offsets, degrees_of_freedom, tests, sentence)


def _white_fit(problem: Problem, start: np.ndarray) -> TrajectoryFit:
    """Fit under white noise of the sd assumed or, if it does not converge, of the residuals, with a fixed prior."""
    try:
        return fit_trajectory(problem, start)
    except FitError:
        if not all(np.isfinite(values).all() for values in sample_residuals(problem, start)):
            raise
    prior, unknowns = problem.prior, start
    problem = replace(problem, prior=prior.fixed)
    for _ in range(_MOST_PASSES):
        noise = []
        for run, residuals in zip(problem.runs, sample_residuals(problem, unknowns), strict=True):
            assumed, estimated = white_noise(run), _normal_noise(run, residuals, offsets=False, correlated=False)
            noise.append(replace(assumed, sd=np.maximum(assumed.sd, estimated.sd)))
        fit = fit_trajectory(replace(problem, noise=tuple(noise)), unknowns)
        change, unknowns = np.max(np.abs(fit.unknowns - unknowns)[: prior.mean.size] / fit.sd), fit.unknowns
        if change < _CONVERGED:
            break
    return replace(fit, problem=replace(fit.problem, prior=prior))


def _ar1_or_white(white: TrajectoryFit) -> str:
    """Noise model of correlated residuals: ``white`` if constant offsets explain the correlation, else ``ar1``."""
    try:
        fit, _ = _fit_under_noise(white, "white", True, None)
    except FitError:
        return "ar1"
    return "ar1" if serial_test(fit) < ALPHA else "white"


def residual_tests(fit: TrajectoryFit) -> ResidualTests:
    """Tests of the residuals of a fit with white noise and without offsets."""
    p_size, p_tails, problem = [], [], fit.problem
    all_samples = sample_residuals(problem, fit.unknowns)
    for run, noise, white, samples in zip(problem.runs, problem.noise, fit.residuals, all_samples, strict=True):
        size = np.mean(white**2, axis=1) * (noise.sd / white_noise(run).sd) ** 2
        spread = np.sqrt(2.0 / white.shape[1] + 5.4 / run.inputs.shape[1])
        p_size += list(2.0 * ndtr(-np.abs(size - 1.0) / spread))
        p_tails += list(kurtosis_test(samples))
    return ResidualTests(serial_test(fit), offset_test(fit), _bonferroni(p_tails), _bonferroni(p_size))


def kurtosis_test(samples: np.ndarray) -> np.ndarray:
    """p-values of heavier tails than normal, (n_channels,), by the kurtosis of samples (n_channels, n_time).

    Anscombe & Glynn (1983), doi:10.1093/biomet/70.1.227; the test of scipy.stats, without its long import.
    """
    n, centred = float(samples.shape[1]), samples - samples.mean(axis=1, keepdims=True)
    kurtosis = np.mean(centred**4, axis=1) / np.mean(centred**2, axis=1) ** 2
    variance = 24.0 * n * (n - 2.0) * (n - 3.0) / ((n + 1.0) ** 2 * (n + 3.0) * (n + 5.0))  # Eq. 1
    x = (kurtosis - 3.0 * (n - 1.0) / (n + 1.0)) / np.sqrt(variance)  # Eq. 4
    skewness = 6.0 * (n**2 - 5.0 * n + 2.0) / ((n + 7.0) * (n + 9.0))
    skewness *= np.sqrt(6.0 * (n + 3.0) * (n + 5.0) / (n * (n - 2.0) * (n - 3.0)))  # Eq. 2
    A = 6.0 + 8.0 / skewness * (2.0 / skewness + np.sqrt(1.0 + 4.0 / skewness**2))  # Eq. 3
    cube_root = np.cbrt((1.0 - 2.0 / A) / (1.0 + x * np.sqrt(2.0 / (A - 4.0))))
    return ndtr((cube_root - 1.0 + 2.0 / (9.0 * A)) * np.sqrt(4.5 * A))  # Eq. 5


def _bonferroni(p: Sequence[float]) -> float:
    return float(min(1.0, len(p) * min(p)))


def serial_test(fit: TrajectoryFit) -> float:
    """p-value of the Ljung-Box test of the block residuals of each channel of each run."""
    p = []
    for white in fit.residuals:
        n = white.shape[1]
        lags = min(LAGS, n // 4)
        r = np.array([np.sum(white[:, k:] * white[:, : n - k], axis=1) for k in range(lags + 1)])
        r = r[1:] / r[0]
        box = n * (n + 2.0) * np.sum(r**2 / (n - np.arange(1, lags + 1))[:, None], axis=0)
        p += list(chdtrc(lags, box))
    return _bonferroni(p)


def offset_test(fit: TrajectoryFit) -> float:
    """p-value of the score test of a constant offset of each sensor: one Gauss-Newton step of all unknowns from 0."""
    problem = replace(fit.problem, noise=tuple(replace(noise, offsets=True) for noise in fit.problem.noise))
    ends = [nuisances.stop for nuisances in fit.problem.nuisances]
    positions = np.repeat(ends, [len(run.channels) for run in problem.runs])
    unknowns = np.insert(fit.unknowns, positions, 0.0)
    free = np.insert(np.zeros(fit.unknowns.size, dtype=bool), positions, True)
    point = linearise(problem, unknowns)
    if point is None:
        raise FitError(
            "The test of offsets simulates the fitted ship, found that it leaves the model's range; repeat the fit."
        )
    precision = np.where(free, 0.0, problem.precision)
    H = point.matrix + np.diag(precision)
    size = np.sqrt(np.diag(H))
    covariance = np.linalg.inv(H / np.outer(size, size))
    slope = point.gradient + precision * (unknowns - problem.center) / problem.unit
    step = (covariance @ (slope / size))[free]
    return float(chdtrc(free.sum(), step @ np.linalg.solve(covariance[np.ix_(free, free)], step)))


def sample_residuals(problem: Problem, unknowns: np.ndarray) -> list[np.ndarray]:
    """Raw samples minus simulated motion and offsets of each run, each (n_channels, n_time)."""
    residuals = []
    for run, nuisance_slice, noise in zip(problem.runs, problem.nuisances, problem.noise, strict=True):
        nuisances = unknowns[nuisance_slice]
        start, theta = nuisances[: run.n_states], unknowns[: problem.n_coefficients]
        motion = replay(problem.vessel, run.inputs, start, theta, **run.integration)[list(run.rows), 0]
        residuals.append(run.samples - motion - (nuisances[run.n_states :, None] if noise.offsets else 0.0))
    return residuals


def white_misfit(problem: Problem, k: int, unknowns: np.ndarray) -> np.ndarray:
    """Whitened misfit (n_channels, n_draws, n_blocks) of run k for draws of the unknowns; NaN where one diverges."""
    run, noise, nuisances = problem.runs[k], problem.noise[k], unknowns[:, problem.nuisances[k]]
    start, theta = nuisances[:, : run.n_states], unknowns[:, problem.columns[k]]
    motion = replay(problem.vessel, run.inputs, start, theta, block=run.block, **run.integration)
    offsets = nuisances[:, run.n_states :] if noise.offsets else np.zeros((len(unknowns), len(run.channels)))
    misfit = noise.values[:, None] - motion[list(run.rows)] - offsets.T[:, :, None]
    return whiten_channels(misfit.transpose(0, 2, 1), noise).transpose(0, 2, 1)


def _fit_under_noise(
    fit: TrajectoryFit, kind: str, offsets: bool, tests: ResidualTests | None
) -> tuple[TrajectoryFit, float]:
    """Fit under a noise model whose parameters come from the residuals, from the mode of another fit."""
    degrees_of_freedom = np.inf
    if kind == "white" and tests is not None and tests.size >= ALPHA:
        noise = [white_noise(run, offsets=True) for run in fit.problem.runs]
        return (_refit(fit, noise) if offsets else fit), degrees_of_freedom
    for _ in range(_MOST_PASSES):
        if kind == "student_t":
            degrees_of_freedom, noise = _student_noise(fit, offsets)
        else:
            runs = zip(fit.problem.runs, sample_residuals(fit.problem, fit.unknowns), strict=True)
            noise = [_normal_noise(run, residuals, offsets, correlated=kind == "ar1") for run, residuals in runs]
        previous, fit = fit, _refit(fit, noise)
        if np.max(np.abs(fit.coefficients - previous.coefficients) / fit.sd) < _CONVERGED:
            break
    return fit, degrees_of_freedom


def _refit(fit: TrajectoryFit, noise: Sequence[Noise]) -> TrajectoryFit:
    """Fit with other noise from the mode of a fit; offsets start from zero."""
    problem = replace(fit.problem, noise=tuple(noise))
    start = problem.center
    start[: problem.n_coefficients] = fit.coefficients
    for old, new in zip(fit.problem.nuisances, problem.nuisances, strict=True):
        size = min(old.stop - old.start, new.stop - new.start)
        start[new.start : new.start + size] = fit.unknowns[old.start : old.start + size]
    return fit_trajectory(problem, start)


def _normal_noise(run: Run, residuals: np.ndarray, offsets: bool, *, correlated: bool) -> Noise:
    """Normal noise with sd and lag-one correlation of the block residuals."""
    blocks = run.block_means(residuals)
    sd = np.sqrt(np.mean(blocks**2, axis=1))
    correlation = np.zeros(len(sd))
    if correlated:
        correlation = np.sum(blocks[:, 1:] * blocks[:, :-1], axis=1) / np.sum(blocks**2, axis=1)
        correlation = np.clip(correlation, -0.98, 0.995)
    return Noise(sd, correlation, offsets, run.means)


def _student_noise(fit: TrajectoryFit, offsets: bool) -> tuple[float, list[Noise]]:
    """Student-t noise as pseudo-data: blocks whose mean and sd have its score and Fisher information."""
    runs, residuals = fit.problem.runs, sample_residuals(fit.problem, fit.unknowns)
    rows = [values for run in residuals for values in run]
    scales = {nu: [_t_scale(values, nu) for values in rows] for nu in _DEGREES_OF_FREEDOM}

    def log_density(nu: float) -> float:
        pieces = zip(rows, scales[nu], strict=True)
        return sum((student_log_density(values / scale, nu) - np.log(scale)).sum() for values, scale in pieces)

    nu = max(_DEGREES_OF_FREEDOM, key=log_density)
    scale, begin, noise = np.array(scales[nu]), 0, []
    information = (nu + 1.0) / (nu + 3.0)
    for run, values in zip(runs, residuals, strict=True):
        sigma = scale[begin : begin + len(values), None]
        begin += len(values)
        score = values * (nu + 1.0) / (nu + (values / sigma) ** 2) / information
        pseudo = run.means - run.block_means(values) + run.block_means(score)
        sd = sigma[:, 0] / np.sqrt(information * run.block)
        noise.append(Noise(sd, np.zeros(len(values)), offsets, pseudo))
    return nu, noise


def _t_scale(values: np.ndarray, nu: float) -> float:
    """Maximum-likelihood scale of Student's t about 0, by EM."""
    scale = float(np.median(np.abs(values)) / stdtrit(nu, 0.75))
    for _ in range(50):
        weight = (nu + 1.0) / (nu + (values / scale) ** 2)
        scale, before = float(np.sqrt(np.mean(weight * values**2))), scale
        if abs(scale / before - 1.0) < 1e-4:
            break
    return scale


def _sentence(kind: str, offsets: bool, nu: float, tests: ResidualTests, fit: TrajectoryFit) -> str:
    law = {
        "white": "white normal noise",
        "ar1": "noise with a first-order autocorrelation of each channel",
        "student_t": f"Student's t noise with {nu:g} degrees of freedom",
    }[kind]
    extra = " and a constant offset of each sensor" if offsets else ""
    p_values = {
        "serial correlation": tests.serial,
        "sensor offsets": tests.offset,
        "heavy tails": tests.tails,
        "a size that differs from the sd assumed": tests.size,
    }
    failed_tests = ", ".join(f"{name} (p = {p:.2g})" for name, p in p_values.items() if p < ALPHA)
    reason = f"the residuals under plain white noise show {failed_tests}" if failed_tests else "the residuals are white"
    return f"Fitted with {law}{extra}: {reason}; chi2 per value {fit.chi2:.2f}."
