"""Draws from a fit to windows by randomize-then-optimize (Bardsley et al. 2014, doi:10.1137/140964023)."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import NamedTuple

import numpy as np

from pymc_ship.inference.trajectory.fit import TrajectoryFit, run_rows
from pymc_ship.inference.trajectory.noise import white_misfits
from pymc_ship.inference.trajectory.windows import WindowFit, normal_draws

_TOLERANCE = 0.5  # convergence, in sd of the unknowns
_MAX_STEPS = 8


class _LinearisedWindow(NamedTuple):
    """Indices of the unknowns of a window, its whitened misfit (n_channels, n_blocks) and design at the mode."""

    indices: np.ndarray
    misfit: np.ndarray
    design: np.ndarray


def randomize_then_optimize(fit: WindowFit, count: int, rng: np.random.Generator) -> np.ndarray:
    """Randomize-then-optimize draws of the coefficients of a fit.

    Parameters
    ----------
    fit : WindowFit
        Without windows the draws are normal.
    count : int
    rng : Generator

    Returns
    -------
    ndarray, shape (count, n_coefficients)
        A draw that does not converge is the closest iterate, at worst the estimate.
    """
    normal = normal_draws(fit, count, rng)
    return normal if fit.mode is None else fit.coefficients + _optimized_changes(fit.mode, normal - fit.coefficients)


def _optimized_changes(mode: TrajectoryFit, normal: np.ndarray) -> np.ndarray:
    """Changes of the coefficients (n_draws, n_coefficients) whose linearised estimate is the normal draw.

    Solves y + R' J' (f(z) - f(mode) - J R y) = d for z = mode + R y; f the whitened motion, d the draw in sd.
    """
    n, root = mode.problem.n_coefficients, mode.square_root
    target = np.linalg.lstsq(root[:n], normal.T, rcond=None)[0].T
    windows = list(_linearised_windows(mode))
    changes, remaining = np.zeros_like(target), target.copy()
    distance, step_fraction = np.full(len(target), np.inf), np.ones(len(target))
    for _ in range(_MAX_STEPS):
        unconverged = np.flatnonzero(distance > _TOLERANCE)
        if not unconverged.size:
            break
        trial = changes[unconverged] + step_fraction[unconverged, None] * remaining[unconverged]
        remainder = target[unconverged] - trial - _nonlinear_change(mode, windows, trial)
        length = np.linalg.norm(remainder, axis=1)
        closer = length < distance[unconverged]
        better, worse = unconverged[closer], unconverged[~closer]
        changes[better], remaining[better], distance[better] = trial[closer], remainder[closer], length[closer]
        step_fraction[better], step_fraction[worse] = 1.0, 0.5 * step_fraction[worse]
    return changes @ root[:n].T


def _linearised_windows(mode: TrajectoryFit) -> Iterator[_LinearisedWindow]:
    """Linearisation of each window at the mode."""
    problem = mode.problem
    for run, noise, columns, nuisance_slice in zip(
        problem.runs, problem.noise, problem.columns, problem.nuisances, strict=True
    ):
        rows = run_rows(problem.vessel, run, noise, mode.unknowns[columns], mode.unknowns[nuisance_slice])
        misfit, design = (np.array(values) for values in zip(*rows, strict=True))
        yield _LinearisedWindow(np.r_[columns, nuisance_slice], misfit, design)


def _nonlinear_change(mode: TrajectoryFit, windows: Sequence[_LinearisedWindow], changes: np.ndarray) -> np.ndarray:
    """Nonlinear part of the change of the motion, projected on the estimate, (n_draws, n_unknowns); NaN if diverged."""
    change, projection = changes @ mode.square_root.T, np.zeros_like(changes)
    misfits = white_misfits(mode.problem, mode.unknowns + change)
    for window, misfit in zip(windows, misfits, strict=True):
        linear = change[:, window.indices] @ window.design.transpose(0, 2, 1)
        nonlinear = window.misfit[:, None] - misfit - linear
        projection[:, window.indices] += np.sum(nonlinear @ window.design, axis=0)
    return projection @ mode.square_root
