"""Which noise the residuals of a trajectory fit show, and the fit under it.

White normal noise of the sd given (or of second differences) is tried first. What it leaves is tested: for serial
correlation (Ljung and Box), for constant sensor offsets (score test), for heavy tails (kurtosis) and for its size.
Where a test fails, the noise model that mends it is fitted: to ignore it would leave intervals that cover 20 to 50 % in
place of 90 %.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy import stats

from pymc_ship.simulate import replay
from pymc_ship.trajectory_data import Run
from pymc_ship.trajectory_fit import (
    Noise,
    TrajectoryError,
    TrajectoryFit,
    fit_trajectory,
    initial_problem,
    linearise,
    white_noise,
)
from pymc_ship.trajectory_prior import CoefficientPrior
from pymc_ship.vessel import Vessel

NOISE_MODELS = ("auto", "white", "ar1", "student_t")
"""Noise models to ask for; ``auto`` tests the residuals and chooses."""

ALPHA = 1e-4
"""Probability at which a test of the residuals calls for another noise model, for all channels together."""

LAGS = 10
"""Lags of the Ljung-Box test, in blocks."""

_MOST_PASSES = 5
_DEGREES_OF_FREEDOM = (2.5, 3.0, 4.0, 5.0, 7.0, 10.0, 20.0)


@dataclass(frozen=True)
class ResidualTests:
    """Tests of white normal noise: p-values, each for all runs and channels together.

    ``serial`` (Ljung-Box), ``offset`` (score test of constant offsets), ``tails`` (kurtosis of the samples), ``size``
    (mean square against the sd assumed).
    """

    serial: float
    offset: float
    tails: float
    size: float


@dataclass(frozen=True)
class NoiseChoice:
    """Fit under the chosen noise model and how it was chosen.

    Attributes
    ----------
    fit : TrajectoryFit
    kind : {"white", "ar1", "student_t"}
    offsets : bool
        Whether each sensor of each run has a constant offset among the unknowns.
    degrees_of_freedom : float
        Of Student's t; infinite otherwise.
    tests : ResidualTests
        Of the fit with white noise and without offsets.
    sentence : str
    """

    fit: TrajectoryFit
    kind: str
    offsets: bool
    degrees_of_freedom: float
    tests: ResidualTests
    sentence: str


def fit_with_noise(
    runs: Sequence[Run],
    vessel: Vessel,
    prior: CoefficientPrior,
    start: np.ndarray,
    *,
    noise: str = "auto",
    offsets: bool | None = None,
) -> NoiseChoice:
    """Fit trajectories under the noise model asked for, or the one that their residuals call for.

    Parameters
    ----------
    runs : sequence of Run
    vessel : Vessel
    prior : CoefficientPrior
    start : ndarray, shape (n_coefficients,)
        Coefficients to start from.
    noise : {"auto", "white", "ar1", "student_t"}, optional
    offsets : bool, optional
        Constant sensor offsets as unknowns; by default where a score test finds them.

    Returns
    -------
    NoiseChoice

    Raises
    ------
    TrajectoryError
        For an unknown noise model, a start that diverges, a fit that does not converge.

    References
    ----------
    Ljung & Box (1978), doi:10.1093/biomet/65.2.297; Lange, Little & Taylor (1989), doi:10.1080/01621459.1989.10478852.
    """
    if noise not in NOISE_MODELS:
        raise TrajectoryError(f"The noise is one of {', '.join(NOISE_MODELS)}, found {noise!r}; choose one of these.")
    problem = initial_problem(runs, vessel, prior)
    white = fit_trajectory(problem, np.concatenate([start, *(run.initial_state[0] for run in runs)]))
    tests = residual_tests(white)
    if noise == "auto":
        noise = "ar1" if tests.serial < ALPHA else "student_t" if tests.tails < ALPHA else "white"
        shifted = tests.offset < ALPHA if offsets is None else offsets
        if noise == "ar1" and shifted:
            noise = _correlated_or_shifted(white)
    fit, degrees_of_freedom = _fitted(white, noise, bool(offsets), tests)
    shifted = offset_test(fit) < ALPHA if offsets is None else offsets
    if shifted and offsets is None:
        fit, degrees_of_freedom = _fitted(fit, noise, True, tests)
    sentence = _sentence(noise, shifted, degrees_of_freedom, tests, fit)
    return NoiseChoice(fit, noise, shifted, degrees_of_freedom, tests, sentence)


def _correlated_or_shifted(white: TrajectoryFit) -> str:
    """Law of the noise where residuals are correlated: white if constant offsets alone explain it."""
    shifted, _ = _fitted(white, "white", True, None)
    return "ar1" if residual_tests(shifted).serial < ALPHA else "white"


def residual_tests(fit: TrajectoryFit) -> ResidualTests:
    """Test the residuals of a fit with white noise and without offsets."""
    p_serial, p_size, p_tails = [], [], []
    runs = fit.problem.runs
    for run, white, samples in zip(runs, fit.residuals, sample_residuals(fit), strict=True):
        n = white.shape[1]
        lags = min(LAGS, n // 4)
        r = np.array([np.sum(white[:, k:] * white[:, : n - k], axis=1) for k in range(lags + 1)])
        r = r[1:] / r[0]
        box = n * (n + 2.0) * np.sum(r**2 / (n - np.arange(1, lags + 1))[:, None], axis=0)
        p_serial += list(stats.chi2.sf(box, lags))
        spread = np.sqrt(2.0 / n + 5.4 / run.delta.size)
        p_size += list(2.0 * stats.norm.sf(np.abs(np.mean(white**2, axis=1) - 1.0) / spread))
        p_tails += list(stats.norm.sf(stats.kurtosis(samples, axis=1) / np.sqrt(24.0 / samples.shape[1])))
    count = len(p_serial)
    together = (min(1.0, count * min(p)) for p in (p_serial, p_tails, p_size))
    serial, tails, size = (float(p) for p in together)
    return ResidualTests(serial, offset_test(fit), tails, size)


def offset_test(fit: TrajectoryFit) -> float:
    """Score test of one constant offset for each sensor of each run."""
    noise = tuple(replace(noise, offsets=True) for noise in fit.problem.noise)
    problem = replace(fit.problem, noise=noise)
    unknowns, is_offset = [fit.coefficients], [np.zeros(fit.coefficients.size, dtype=bool)]
    for run, place in zip(problem.runs, fit.problem.nuisances, strict=True):
        unknowns += [fit.unknowns[place], np.zeros(len(run.channels))]
        is_offset += [np.zeros(run.n_states, dtype=bool), np.ones(len(run.channels), dtype=bool)]
    free = np.concatenate(is_offset)
    point = linearise(problem, np.concatenate(unknowns))
    H = point.matrix + np.diag(np.where(free, 0.0, problem.precision))
    size = np.sqrt(np.diag(H))
    covariance = np.linalg.inv(H / np.outer(size, size))[np.ix_(free, free)]
    score = (point.gradient / size)[free]
    return float(stats.chi2.sf(score @ covariance @ score, free.sum()))


def sample_residuals(fit: TrajectoryFit) -> list[np.ndarray]:
    """Raw samples minus the fitted motion and offsets of each run, each of shape (n_channels, n_time)."""
    residuals = []
    for run, place, noise in zip(fit.problem.runs, fit.problem.nuisances, fit.problem.noise, strict=True):
        nuisances = fit.unknowns[place]
        motion = replay(
            fit.problem.vessel,
            run.delta,
            nuisances[None, : run.n_states],
            fit.coefficients[None],
            interval=run.interval,
            method=run.method,
            substeps=run.substeps,
        )
        offsets = nuisances[run.n_states :, None] if noise.offsets else 0.0
        residuals.append(run.samples - motion[list(run.rows), 0] - offsets)
    return residuals


def _fitted(fit: TrajectoryFit, kind: str, offsets: bool, tests: ResidualTests | None) -> tuple[TrajectoryFit, float]:
    """Fit under a noise model, warm from another, its parameters from its own residuals."""
    degrees_of_freedom = np.inf
    if kind == "white" and tests is not None and tests.size >= ALPHA:
        noise = [white_noise(run, offsets=offsets) for run in fit.problem.runs]
        return (_refitted(fit, noise) if offsets else fit), degrees_of_freedom
    for _ in range(_MOST_PASSES):
        if kind == "student_t":
            degrees_of_freedom, noise = _student_noise(fit, offsets)
        else:
            noise = [
                _normal_noise(run, residuals, offsets, correlated=kind == "ar1")
                for run, residuals, old in zip(fit.problem.runs, sample_residuals(fit), fit.problem.noise, strict=True)
            ]
        before, fit = fit, _refitted(fit, noise)
        if np.max(np.abs(fit.coefficients - before.coefficients) / fit.sd) < 0.02:
            break
    return fit, degrees_of_freedom


def _refitted(fit: TrajectoryFit, noise: Sequence[Noise]) -> TrajectoryFit:
    """Fit with other noise, from the mode of a fit; offsets start from zero."""
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
    """Student's t for the samples: blocks whose mean and sd carry its score and its Fisher information."""
    runs, residuals = fit.problem.runs, sample_residuals(fit)
    scales = [[_t_scale(values, nu) for values in np.vstack(residuals)] for nu in _DEGREES_OF_FREEDOM]
    total = [
        sum(
            stats.t.logpdf(values / scale, nu).sum() - values.size * np.log(scale)
            for values, scale in zip(np.vstack(residuals), row, strict=True)
        )
        for nu, row in zip(_DEGREES_OF_FREEDOM, scales, strict=True)
    ]
    best = int(np.argmax(total))
    nu, scale, begin, noise = _DEGREES_OF_FREEDOM[best], np.array(scales[best]), 0, []
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
    """Scale of Student's t about 0 of greatest likelihood, by expectation and maximisation."""
    scale = float(np.median(np.abs(values)) / stats.t.ppf(0.75, nu))
    for _ in range(50):
        weight = (nu + 1.0) / (nu + (values / scale) ** 2)
        scale, before = float(np.sqrt(np.mean(weight * values**2))), scale
        if abs(scale / before - 1.0) < 1e-4:
            break
    return scale


def _sentence(kind: str, offsets: bool, nu: float, tests: ResidualTests, fit: TrajectoryFit) -> str:
    """What was found in the residuals and what was done about it."""
    law = {
        "white": "white normal noise",
        "ar1": "noise with a first-order autocorrelation of each channel",
        "student_t": f"Student's t noise with {nu:g} degrees of freedom",
    }[kind]
    extra = " and a constant offset of each sensor" if offsets else ""
    found = [
        f"{name} (p = {p:.2g})"
        for name, p in (
            ("serial correlation", tests.serial),
            ("sensor offsets", tests.offset),
            ("heavy tails", tests.tails),
            ("a size that differs from the sd assumed", tests.size),
        )
        if p < ALPHA
    ]
    reason = f"the residuals under plain white noise show {', '.join(found)}" if found else "the residuals are white"
    return f"Fitted with {law}{extra}: {reason}; chi2 per value {fit.chi2:.2f}."
