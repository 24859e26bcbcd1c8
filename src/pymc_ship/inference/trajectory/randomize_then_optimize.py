"""Draws from a fit to windows that fit the windows, too.

A ship has more coefficients than a few runs determine. Along what they leave open the normal law of an estimate reaches
as far as the prior, on straight lines, while the coefficients that give one and the same motion lie on a curve: far
from the estimate such draws fit nothing, and as the misfit is of one sign their forecasts err to one side. Each draw is
therefore carried to where the windows, linearised at the mode, would have given it as their estimate. That is
randomize-then-optimize (Bardsley et al. 2014, doi:10.1137/140964023) with the law of the sandwich; its equation is
solved by steps of the fixed Jacobian, which take replays and no sensitivities.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import NamedTuple

import numpy as np

from pymc_ship.inference.trajectory.fit import TrajectoryFit, run_rows
from pymc_ship.inference.trajectory.noise import white_misfits
from pymc_ship.inference.trajectory.windows import WindowFit, normal_draws

_NEAR = 0.5  # sd of the unknowns: a draw is not carried further than that
_MOST_STEPS = 8


class _Piece(NamedTuple):
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
    return drawn if fit.mode is None else fit.coefficients + _carried(fit.mode, drawn - fit.coefficients)


def _carried(mode: TrajectoryFit, drawn: np.ndarray) -> np.ndarray:
    """Changes of the coefficients (n_draws, n_coefficients) for which the linearised estimate changes by ``drawn``.

    With y the unknowns in standard deviations from the mode, z = mode + R y, and d the estimate that is drawn (with the
    most probable initial states), the equation is y + R' J' (f(z) - f(mode) - J R y) = d, f the whitened motion.
    """
    n, root = mode.problem.n_coefficients, mode.square_root
    wanted = np.linalg.lstsq(root[:n], drawn.T, rcond=None)[0].T
    pieces = list(_pieces(mode))
    at, left = np.zeros_like(wanted), wanted.copy()
    size, share = np.full(len(wanted), np.inf), np.ones(len(wanted))
    for _ in range(_MOST_STEPS):
        open_ = np.flatnonzero(size > _NEAR)
        if not open_.size:
            break
        tried = at[open_] + share[open_, None] * left[open_]
        ahead = wanted[open_] - tried - _bent(mode, pieces, tried)
        length = np.linalg.norm(ahead, axis=1)
        nearer = length < size[open_]
        better, worse = open_[nearer], open_[~nearer]
        at[better], left[better], size[better] = tried[nearer], ahead[nearer], length[nearer]
        share[better], share[worse] = 1.0, 0.5 * share[worse]
    return at @ root[:n].T


def _pieces(mode: TrajectoryFit) -> Iterator[_Piece]:
    """Windows at the mode."""
    problem = mode.problem
    for run, noise, columns, place in zip(problem.runs, problem.noise, problem.columns, problem.nuisances, strict=True):
        rows = run_rows(problem.vessel, run, noise, mode.unknowns[columns], mode.unknowns[place])
        misfit, design = (np.array(values) for values in zip(*rows, strict=True))
        yield _Piece(np.r_[columns, place], misfit, design)


def _bent(mode: TrajectoryFit, pieces: Sequence[_Piece], at: np.ndarray) -> np.ndarray:
    """What the motion changes beyond its linearisation, as the estimate sees it, (n_draws, n_unknowns); NaN if lost."""
    change, pull = at @ mode.square_root.T, np.zeros_like(at)
    misfits = white_misfits(mode.problem, mode.unknowns + change)
    for piece, misfit in zip(pieces, misfits, strict=True):
        linear = change[:, piece.which] @ piece.design.transpose(0, 2, 1)
        beyond = piece.misfit[:, None] - misfit - linear
        pull[:, piece.which] += np.sum(beyond @ piece.design, axis=0)
    return pull @ mode.square_root
