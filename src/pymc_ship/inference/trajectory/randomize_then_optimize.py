"""Draws from a fit to windows by randomize-then-optimize (Bardsley et al. 2014, doi:10.1137/140964023).

Few runs leave some directions of the coefficients open. Coefficients of equal likelihood lie on a curve there, and
draws of the normal approximation leave it. Each draw is moved to where the windows would have their estimate.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import NamedTuple

import numpy as np

from pymc_ship.inference.trajectory.fit import TrajectoryFit, run_rows
from pymc_ship.inference.trajectory.noise import white_misfits
from pymc_ship.inference.trajectory.windows import WindowFit, normal_draws

_TOLERANCE = 0.5  # sd of the unknowns: a draw is not carried further than that
_MAX_STEPS = 8


class _LinearisedWindow(NamedTuple):
    """A window at the mode.

    Places of its unknowns, whitened misfit (n_channels, n_blocks) and design (n_channels, n_blocks, n_places).
    """

    which: np.ndarray
    misfit: np.ndarray
    design: np.ndarray


def randomize_then_optimize(fit: WindowFit, count: int, rng: np.random.Generator) -> np.ndarray:
    """Draws of the coefficients of a fit, carried to where they fit its windows.

    Parameters
    ----------
    fit : WindowFit
        One that stands for no windows has draws of its normal law.
    count : int
    rng : Generator

    Returns
    -------
    ndarray, shape (count, n_coefficients)
        A draw that does not settle is where it came nearest, at worst the estimate itself.
    """
    drawn = normal_draws(fit, count, rng)
    return drawn if fit.mode is None else fit.coefficients + _moved_draws(fit.mode, drawn - fit.coefficients)


def _moved_draws(mode: TrajectoryFit, drawn: np.ndarray) -> np.ndarray:
    """Changes of the coefficients (n_draws, n_coefficients) for which the linearised estimate changes by ``drawn``.

    With y the unknowns in standard deviations from the mode, z = mode + R y, and d the estimate that is drawn (with the
    most probable initial states), the equation is y + R' J' (f(z) - f(mode) - J R y) = d, f the whitened motion.
    """
    n, root = mode.problem.n_coefficients, mode.square_root
    target = np.linalg.lstsq(root[:n], drawn.T, rcond=None)[0].T
    windows = list(_linearised_windows(mode))
    at, left = np.zeros_like(target), target.copy()
    size, share = np.full(len(target), np.inf), np.ones(len(target))
    for _ in range(_MAX_STEPS):
        open_ = np.flatnonzero(size > _TOLERANCE)
        if not open_.size:
            break
        trial = at[open_] + share[open_, None] * left[open_]
        remainder = target[open_] - trial - _nonlinear_change(mode, windows, trial)
        length = np.linalg.norm(remainder, axis=1)
        closer = length < size[open_]
        better, worse = open_[closer], open_[~closer]
        at[better], left[better], size[better] = trial[closer], remainder[closer], length[closer]
        share[better], share[worse] = 1.0, 0.5 * share[worse]
    return at @ root[:n].T


def _linearised_windows(mode: TrajectoryFit) -> Iterator[_LinearisedWindow]:
    """Windows at the mode."""
    problem = mode.problem
    for run, noise, columns, place in zip(problem.runs, problem.noise, problem.columns, problem.nuisances, strict=True):
        rows = run_rows(problem.vessel, run, noise, mode.unknowns[columns], mode.unknowns[place])
        misfit, design = (np.array(values) for values in zip(*rows, strict=True))
        yield _LinearisedWindow(np.r_[columns, place], misfit, design)


def _nonlinear_change(mode: TrajectoryFit, windows: Sequence[_LinearisedWindow], at: np.ndarray) -> np.ndarray:
    """What the motion changes beyond its linearisation, as the estimate sees it, (n_draws, n_unknowns); NaN if lost."""
    change, pull = at @ mode.square_root.T, np.zeros_like(at)
    misfits = white_misfits(mode.problem, mode.unknowns + change)
    for window, misfit in zip(windows, misfits, strict=True):
        linear = change[:, window.which] @ window.design.transpose(0, 2, 1)
        beyond = window.misfit[:, None] - misfit - linear
        pull[:, window.which] += np.sum(beyond @ window.design, axis=0)
    return pull @ mode.square_root
