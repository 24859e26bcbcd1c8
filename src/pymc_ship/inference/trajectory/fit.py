"""Fit of the simulated trajectory to raw records by Levenberg-Marquardt (output-error method).

Unknowns: coefficients, initial state of each run and, optionally, sensor offsets; divided by ``Problem.unit``.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from pymc_ship.inference.trajectory.prior import CoefficientPrior
from pymc_ship.inference.trajectory.runs import Run, whiten
from pymc_ship.inference.trajectory.scale_law import LinearProblem, ScaleLaw, Scales, probable_scales
from pymc_ship.machine.errors import FitError
from pymc_ship.physics.motion.equations import STATE
from pymc_ship.physics.motion.sensitivities import sensitivities
from pymc_ship.physics.vessel.vessel import Vessel, coefficient_names, per_run_indices

TOLERANCE = 1e-4  # convergence: the next step would lower the negative log posterior by less
_LOG_2PI = np.log(2.0 * np.pi)
_MOST_STEPS, _MOST_REFITS = 400, 6
_SCALES_CONVERGED = 0.05  # change of the log sd of a coefficient
_LEAST_SINGULAR_VALUE = 1e-12


class RunRows(NamedTuple):
    """Rows of the likelihood of a run."""

    indices: np.ndarray  # (n_local,); of its unknowns, coefficients first
    misfit: np.ndarray  # (n_channels, n_blocks); whitened
    design: np.ndarray  # (n_channels, n_blocks, n_local); whitened, of physical units

    @property
    def gradient(self) -> np.ndarray:
        """Gradient of the log likelihood of the run, (n_local,)."""
        return self.design.reshape(-1, self.indices.size).T @ self.misfit.ravel()

    def with_noise_times(self, ratio: np.ndarray) -> RunRows:
        """Rows under white noise with the sd of each channel times a ratio, (n_channels,)."""
        return RunRows(self.indices, self.misfit / ratio[:, None], self.design / ratio[:, None, None])


@dataclass(frozen=True)
class Noise:
    """Noise of the block means of one run; ``values``: the means or, under Student's t, pseudo-data with its score."""

    sd: np.ndarray
    correlation: np.ndarray
    offsets: bool
    values: np.ndarray


def white_noise(run: Run, *, offsets: bool = False) -> Noise:
    """White normal noise with the sample sd of the run."""
    return Noise(run.sample_sd / np.sqrt(run.block), np.zeros(len(run.channels)), offsets, run.means)


@dataclass(frozen=True)
class Problem:
    """Runs, vessel, prior, noise of each run, scales of the prior, and the trial of each run (if empty: the same)."""

    runs: tuple[Run, ...]
    vessel: Vessel
    prior: CoefficientPrior
    noise: tuple[Noise, ...]
    scales: Scales | None = None
    trial_indices: tuple[int, ...] = ()

    def with_noise_sd(self, sd: np.ndarray) -> Problem:
        """Problem with white noise of an sd (n_channels,) of the block means, without offsets."""
        return replace(self, noise=tuple(Noise(sd, np.zeros(sd.size), False, run.means) for run in self.runs))

    @property
    def current_scales(self) -> Scales:
        """Scales of the prior; before a fit, those at the prior means of its factors."""
        law = self.prior.law
        return self.scales or Scales(np.empty(0) if law is None else law.center, self.prior.fixed.scale)

    @property
    def per_run(self) -> np.ndarray:
        """Indices of the coefficients of which each trial has its own."""
        return np.array(per_run_indices(self.vessel) if self.trial_indices else [], dtype=int)

    @property
    def n_shared(self) -> int:
        """Number of unknowns that runs share: coefficients and the constants of all trials."""
        return self.n_coefficients + self.per_run.size * len(set(self.trial_indices))

    @property
    def columns(self) -> list[np.ndarray]:
        """Indices of the coefficients of each run among the unknowns, each (n_coefficients,)."""
        own, indices = self.per_run, []
        for trial in self.trial_indices or [0] * len(self.runs):
            indices.append(np.arange(self.n_coefficients))
            indices[-1][own] = self.n_coefficients + own.size * trial + np.arange(own.size)
        return indices

    @property
    def n_coefficients(self) -> int:
        """Number of coefficients of all DOFs."""
        return self.prior.mean.size

    @property
    def channels(self) -> list[str]:
        """Channels of all runs."""
        return list(dict.fromkeys(name for run in self.runs for name in run.channels))

    @property
    def labels(self) -> dict:
        """Coordinates of coefficients, initial states and, if any, factors of the prior and sensor offsets."""
        labels = {
            "coefficient": coefficient_names(self.vessel),
            "run": np.arange(len(self.runs)),
            "state": list(STATE[: max(run.n_states for run in self.runs)]),
        }
        if self.prior.law is not None:
            labels["factor"] = list(self.prior.law.names)
        return labels | ({"channel": self.channels} if any(noise.offsets for noise in self.noise) else {})

    @property
    def nuisances(self) -> list[slice]:
        """Slice of each run's initial state and offsets among the unknowns."""
        slices, begin = [], self.n_shared
        for run, noise in zip(self.runs, self.noise, strict=True):
            size = run.n_states + (len(run.channels) if noise.offsets else 0)
            slices.append(slice(begin, begin + size))
            begin += size
        return slices

    @property
    def center(self) -> np.ndarray:
        """Prior mean of every unknown, physical units."""
        parts = [self.prior.mean, np.tile(self.prior.mean[self.per_run], len(set(self.trial_indices)))]
        for run, noise in zip(self.runs, self.noise, strict=True):
            parts += [run.initial_state[0], np.zeros(len(run.channels) if noise.offsets else 0)]
        return np.concatenate(parts)

    @property
    def unit(self) -> np.ndarray:
        """Unit of every unknown: prior sd or, for a flat prior, typical size; physical units."""
        parts = [self.prior.unit, np.tile(self.prior.unit[self.per_run], len(set(self.trial_indices)))]
        for run, noise in zip(self.runs, self.noise, strict=True):
            parts += [run.initial_state[1], 0.1 * np.ptp(run.means, axis=1) if noise.offsets else np.empty(0)]
        return np.concatenate(parts)

    @property
    def precision(self) -> np.ndarray:
        """Prior precision of every unknown in its unit; 0 where the prior is flat."""
        precision = np.ones(self.unit.size)
        precision[: self.n_coefficients] = (self.prior.unit / self.current_scales.sd) ** 2
        own = (self.prior.unit[self.per_run] / self.prior.scale[self.per_run]) ** 2
        precision[self.n_coefficients : self.n_shared] = np.tile(own, len(set(self.trial_indices)))
        return precision

    @property
    def likelihood_design(self) -> np.ndarray:
        """Design of the likelihood of other data over all unknowns, (n_rows, n_unknowns)."""
        rows = self.prior.likelihood_or_flat.design
        return np.pad(rows, ((0, 0), (0, self.unit.size - rows.shape[1])))


@dataclass(frozen=True)
class Linearisation:
    """Log likelihood, gradient and Gauss-Newton matrix of its negative in the problem's units, rows of each run."""

    log_likelihood: float
    gradient: np.ndarray
    matrix: np.ndarray
    runs: list[RunRows]


@dataclass(frozen=True)
class TrajectoryFit:
    """Posterior mode and its normal (Laplace) approximation, given the scales of the prior."""

    problem: Problem
    point: Linearisation  # at the mode
    unknowns: np.ndarray  # (n_unknowns,); coefficients, then initial state and offsets of each run, physical units
    square_root: np.ndarray  # (n_unknowns, n_unknowns); R with R R' the posterior covariance, physical units
    residuals: tuple[np.ndarray, ...]  # (n_channels, n_blocks); whitened misfit of each run
    gradients: np.ndarray  # (n_runs, n_shared); of the log likelihood of each run, physical units
    log_evidence: float  # up to a constant for a partly flat prior

    @property
    def coefficients(self) -> np.ndarray:
        """Posterior mode of the coefficients, (n_coefficients,)."""
        return self.unknowns[: self.problem.n_coefficients]

    @property
    def covariance(self) -> np.ndarray:
        """Posterior covariance of the coefficients, shape (n_coefficients, n_coefficients)."""
        root = self.square_root[: self.problem.n_coefficients]
        return root @ root.T

    @property
    def sd(self) -> np.ndarray:
        """Posterior standard deviation of the coefficients, shape (n_coefficients,)."""
        return np.sqrt(np.sum(self.square_root[: self.problem.n_coefficients] ** 2, axis=1))

    @property
    def chi2(self) -> float:
        """Reduced chi-square: mean square of the whitened misfit, expected value 1."""
        return float(np.mean(np.concatenate([values.ravel() for values in self.residuals]) ** 2))


def linearise(problem: Problem, unknowns: np.ndarray, rows: Sequence[RunRows] | None = None) -> Linearisation | None:
    """Linearisation of all runs at the unknowns, by their ``rows`` if known; None where a simulation diverges."""
    unit, design = problem.unit, problem.likelihood_design
    misfit = problem.prior.likelihood_or_flat.residuals(unknowns[: problem.n_coefficients])
    gradient, matrix = -design.T @ misfit, design.T @ design
    log_likelihood = -0.5 * float(misfit @ misfit)
    runs = []
    for noise, run in zip(problem.noise, rows or linearised_runs(problem, unknowns), strict=True):
        if run is None:
            return None
        indices, white, design = run
        flat = design.reshape(-1, indices.size)
        gradient[indices] -= run.gradient
        matrix[np.ix_(indices, indices)] += flat.T @ flat
        n_blocks = white.shape[1]
        log_sd = n_blocks * np.log(noise.sd) + 0.5 * (n_blocks - 1) * np.log1p(-(noise.correlation**2))
        log_likelihood += float(-0.5 * (np.sum(white**2) + white.size * _LOG_2PI) - np.sum(log_sd))
        runs.append(run)
    return Linearisation(log_likelihood, gradient * unit, matrix * np.outer(unit, unit), runs)


def linearised_runs(problem: Problem, unknowns: np.ndarray) -> Iterator[RunRows | None]:
    """Rows of each run in turn; None where its simulation diverges."""
    pieces = zip(problem.runs, problem.noise, problem.columns, problem.nuisances, strict=True)
    for run, noise, columns, nuisances in pieces:
        rows = run_rows(problem.vessel, run, noise, unknowns[columns], unknowns[nuisances])
        yield None if rows is None else RunRows(np.r_[columns, nuisances], *rows)


def run_rows(
    vessel: Vessel, run: Run, noise: Noise, coefficients: np.ndarray, nuisances: np.ndarray
) -> tuple[np.ndarray, np.ndarray] | None:
    """Whitened misfit and design of a run, as in :class:`RunRows`; None if it diverges."""
    start = nuisances[: run.n_states]
    motion, jacobian = sensitivities(vessel, run.inputs, start, coefficients, block=run.block, **run.integration)
    if not np.isfinite(motion).all():
        return None
    rows, n_channels = list(run.rows), len(run.channels)
    misfit, design = noise.values - motion[rows], jacobian[rows]
    if noise.offsets:
        misfit -= nuisances[run.n_states :, None]
        own = np.broadcast_to(np.eye(n_channels)[:, None], (n_channels, run.n_blocks, n_channels))
        design = np.concatenate([design, own], axis=2)
    return whiten_channels(misfit, noise), whiten_channels(design, noise)


def whiten_channels(values: np.ndarray, noise: Noise) -> np.ndarray:
    """Values (n_channels, n_blocks, ...) whitened by the noise of each channel."""
    return np.array([whiten(*channel) for channel in zip(values, noise.sd, noise.correlation, strict=True)])


def _cost(problem: Problem, unknowns: np.ndarray, point: Linearisation | None) -> float:
    if point is None:
        return np.inf
    distance = (unknowns - problem.center) / problem.unit
    return -point.log_likelihood + 0.5 * float(np.sum(problem.precision * distance**2))


def _descend(
    problem: Problem, start: np.ndarray, tolerance: float, rows: Sequence[RunRows] | None
) -> tuple[np.ndarray, Linearisation]:
    """Minimum and its linearisation by Levenberg-Marquardt with the damping of Nielsen (1999)."""
    unknowns, unit, center, precision = start.copy(), problem.unit, problem.center, problem.precision
    point = linearise(problem, unknowns, rows)
    cost = _cost(problem, unknowns, point)
    if point is None or not np.isfinite(cost):
        raise FitError(
            "A fit needs a start whose simulation does not diverge, found one that leaves the model's range at the "
            "start of the fit; add a run with smaller rudder angles, or a prior nearer to the ship."
        )
    damping, growth = 1e-3, 2.0
    for _ in range(_MOST_STEPS):
        slope = point.gradient + precision * (unknowns - center) / unit
        damped = point.matrix + np.diag(precision + damping)
        size = np.sqrt(np.diag(damped))
        step = -np.linalg.solve(damped / np.outer(size, size), slope / size) / size
        expected = 0.5 * step @ (damping * step - slope)
        if growth == 2.0 and expected < tolerance:
            return unknowns, point
        proposal = unknowns + unit * step
        ahead = linearise(problem, proposal)
        gain = cost - _cost(problem, proposal, ahead)
        if ahead is not None and gain > 0.0:
            damping *= max(1.0 / 8.0, 1.0 - (2.0 * gain / expected - 1.0) ** 3)
            unknowns, point, cost, growth = proposal, ahead, cost - gain, 2.0
        else:
            damping, growth = damping * growth, 2.0 * growth
        if damping > 1e12:
            return unknowns, point
    raise FitError(
        f"A fit needs a minimum within {_MOST_STEPS} steps of Levenberg-Marquardt, found none; give more runs or a "
        "prior nearer to the ship."
    )


def fit_trajectory(
    problem: Problem, start: np.ndarray, tolerance: float = TOLERANCE, rows: Sequence[RunRows] | None = None
) -> TrajectoryFit:
    """Posterior mode from a start (n_unknowns,), most probable scales of the prior, and the normal approximation.

    Descents alternate with :func:`.probable_scales` of the linearised problem until the scales converge; ``rows`` of
    the runs at the start are simulated unless known. FitError when
    the start diverges, no minimum is reached or, under a flat prior, it is not unique. Marquardt (1963),
    doi:10.1137/0111030; Nielsen (1999), IMM-REP-1999-05; Maine & Iliff (1986), NASA RP-1168.
    """
    unknowns, point = _descend(problem, start, tolerance, rows)
    law = problem.prior.law
    for _ in range(_MOST_REFITS):
        if law is None:
            break
        before = problem.current_scales
        scales = probable_scales(linear_problem(problem, law, unknowns, point)[0], before.eta)
        converged = np.max(np.abs(np.log(scales.sd / before.sd))) < _SCALES_CONVERGED
        problem = replace(problem, scales=scales)
        unknowns, point = _descend(problem, unknowns, tolerance, point.runs)
        if converged:
            break
    square_root, log_evidence = _normal_approximation(problem, unknowns, point)
    residuals, gradients = tuple(run.misfit for run in point.runs), np.zeros((len(point.runs), problem.n_shared))
    for row, run in zip(gradients, point.runs, strict=True):
        shared = run.indices[: problem.n_coefficients]
        row[shared] = run.gradient[: shared.size]
    return TrajectoryFit(
        problem=problem,
        point=point,
        unknowns=unknowns,
        square_root=square_root,
        residuals=residuals,
        gradients=gradients,
        log_evidence=log_evidence,
    )


@dataclass(frozen=True)
class NuisanceLaw:
    """Normal law of the other unknowns, in units about the center, given changes of the coefficients from the mode."""

    mean: np.ndarray
    slope: np.ndarray
    root: np.ndarray


def linear_problem(
    problem: Problem, law: ScaleLaw, unknowns: np.ndarray, point: Linearisation
) -> tuple[LinearProblem, NuisanceLaw]:
    """Linear problem of the coefficients with the other unknowns integrated out, and the law of these."""
    n, unit, at = problem.n_coefficients, problem.unit, (unknowns - problem.center) / problem.unit
    precision, cross = problem.precision[n:], point.matrix[n:, :n]
    root = np.linalg.cholesky(point.matrix[n:, n:] + np.diag(precision))
    whitened = np.linalg.solve(root, np.column_stack([point.gradient[n:] + precision * at[n:], cross]))
    step, slope = whitened[:, 0], whitened[:, 1:]
    information = (point.matrix[:n, :n] - slope.T @ slope) / np.outer(unit[:n], unit[:n])
    score = (slope.T @ step - point.gradient[:n]) / unit[:n]
    given = np.linalg.solve(root.T, whitened)
    nuisances = NuisanceLaw(at[n:] - given[:, 0], -given[:, 1:] / unit[:n], np.linalg.inv(root).T)
    return LinearProblem(law, problem.prior.scale, information, score, at[:n] * unit[:n]), nuisances


def _normal_approximation(problem: Problem, unknowns: np.ndarray, point: Linearisation) -> tuple[np.ndarray, float]:
    """Square root of the covariance and log evidence, by the SVD of the whitened design with the rows of the prior."""
    unit, precision = problem.unit, problem.precision
    blocks = [np.diag(np.sqrt(precision)), problem.likelihood_design * unit]
    for indices, _, design in point.runs:
        triangle = np.linalg.qr(design.reshape(-1, indices.size) * unit[indices], mode="r")
        blocks.append(np.zeros((len(triangle), unit.size)))
        blocks[-1][:, indices] = triangle
    _, s, right = np.linalg.svd(np.linalg.qr(np.vstack(blocks), mode="r"))
    if s[-1] < _LEAST_SINGULAR_VALUE * s[0]:
        raise FitError(
            "A flat prior needs records that determine every coefficient, found undetermined combinations; give them a "
            "prior."
        )
    distance = (unknowns - problem.center) / unit
    log_precision = np.log(np.where(precision > 0.0, precision, 1.0))
    log_prior = 0.5 * np.sum(log_precision - _LOG_2PI - precision * distance**2)
    log_evidence = point.log_likelihood + log_prior + 0.5 * unit.size * _LOG_2PI - np.sum(np.log(s))
    return unit[:, None] * right.T / s, float(log_evidence)


def initial_problem(runs: Sequence[Run], vessel: Vessel, prior: CoefficientPrior) -> Problem:
    """Problem with white noise."""
    return Problem(tuple(runs), vessel, prior, tuple(map(white_noise, runs)))
