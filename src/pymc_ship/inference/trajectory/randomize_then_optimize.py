"""Draws from a fit to windows by randomize-then-optimize (Bardsley et al. 2014, doi:10.1137/140964023)."""

import numpy as np

from pymc_ship.inference.trajectory.fit import TrajectoryFit
from pymc_ship.inference.trajectory.noise import white_misfit
from pymc_ship.inference.trajectory.windows import WindowFit, normal_draws
from pymc_ship.machine.threads import map_in_threads

_TOLERANCE = 0.5  # convergence, in sd of the unknowns
_MAX_STEPS = 8


def randomize_then_optimize(fit: WindowFit, count: int, rng: np.random.Generator) -> np.ndarray:
    """Draws of the coefficients (count, n_coefficients) of a fit; normal draws for a fit without windows.

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
    changes, remaining = np.zeros_like(target), target.copy()
    distance, step_fraction = np.full(len(target), np.inf), np.ones(len(target))
    for _ in range(_MAX_STEPS):
        unconverged = np.flatnonzero(distance > _TOLERANCE)
        if not unconverged.size:
            break
        trial = changes[unconverged] + step_fraction[unconverged, None] * remaining[unconverged]
        remainder = target[unconverged] - trial - _nonlinear_change(mode, trial)
        length = np.linalg.norm(remainder, axis=1)
        closer = length < distance[unconverged]
        better, worse = unconverged[closer], unconverged[~closer]
        changes[better], remaining[better], distance[better] = trial[closer], remainder[closer], length[closer]
        step_fraction[better], step_fraction[worse] = 1.0, 0.5 * step_fraction[worse]
    return changes @ root[:n].T


def _nonlinear_change(mode: TrajectoryFit, changes: np.ndarray) -> np.ndarray:
    """Nonlinear part of the change of the motion, projected on the estimate, (n_draws, n_unknowns); NaN if diverged."""
    change, projection = changes @ mode.square_root.T, np.zeros_like(changes)
    unknowns = mode.unknowns + change

    def project(k: int) -> np.ndarray:
        indices, misfit, design = mode.point.runs[k]
        nonlinear = misfit[:, None] - white_misfit(mode.problem, k, unknowns)
        nonlinear -= change[:, indices] @ design.transpose(0, 2, 1)
        return np.sum(nonlinear @ design, axis=0)

    runs = range(len(mode.point.runs))
    for k, of_run in zip(runs, map_in_threads(project, runs), strict=True):
        projection[:, mode.point.runs[k].indices] += of_run
    return projection @ mode.square_root
