"""What data said of coefficients, carried on as a statement beside the prior of other data.

The windows of a fit are summed up by the quadratic that their log likelihood is about its mode. A posterior that takes
this statement in place of the windows is the posterior of all windows, as far as the model is linear between them.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from pymc_ship.trajectory.prior import CoefficientPrior, Statement
from pymc_ship.trajectory.windows import WindowFit
from pymc_ship.vessel.vessel import places_of_run

_SHARES = 101  # of the prior sd that are tried
_TOLD = 1e-9  # of the largest eigenvalue, from which windows tell of a direction


def said_by_windows(fit: WindowFit, prior: CoefficientPrior, inflation: float = 1.0) -> Statement:
    """Statement of the windows of a fit.

    Parameters
    ----------
    fit : WindowFit
    prior : CoefficientPrior
        Under which it was made, with a finite scale of every coefficient.
    inflation : float, optional
        Factor on the standard deviations, 1 or more.

    Returns
    -------
    Statement
        Without the constants of runs, which other runs do not share.
    """
    scale, stated = prior.scale, prior.stated
    known = np.diag(scale**-2.0) + stated.rows.T @ stated.rows
    pull = (fit.coefficients - prior.mean) / scale**2 - stated.rows.T @ stated.misfit(fit.coefficients)
    free = np.ones(scale.size)
    free[places_of_run(fit.vessel)] = 0.0
    unit = scale * free
    windows = unit[:, None] * (fit.information - known) * unit
    values, vectors = np.linalg.eigh(0.5 * (windows + windows.T))
    told = values > _TOLD * max(values[-1], 0.0)
    root, directions = np.sqrt(values[told]), vectors[:, told].T
    rows = root[:, None] * directions * (free / scale)
    shift = directions @ (unit * pull) / root
    return Statement(rows / inflation, (rows @ fit.coefficients + shift) / inflation)


def joined(statements: Sequence[Statement | None]) -> Statement | None:
    """All of some statements as one; None without any."""
    found = [one for one in statements if one is not None]
    if not found:
        return None
    return Statement(np.vstack([one.rows for one in found]), np.concatenate([one.values for one in found]))


def loosened(
    statement: Statement, prior: CoefficientPrior, coefficients: np.ndarray, covariance: np.ndarray
) -> tuple[Statement, float]:
    """Statement of coefficients that differ from those it was made of, by a share of the prior's sd each.

    Parameters
    ----------
    statement : Statement
    prior : CoefficientPrior
    coefficients, covariance : ndarray, shape (n_coefficients,), (n_coefficients, n_coefficients)
        By other data and the prior alone.

    Returns
    -------
    Statement
    float
        The share at which the statement is most probable for these coefficients (empirical Bayes), from 0 to 1; 0 where
        they say little.
    """
    rows, left = statement.rows, statement.misfit(coefficients)
    scaled, identity = rows * prior.scale, np.eye(len(rows))
    known = identity + rows @ covariance @ rows.T

    def surprise(share: float) -> float:
        root = np.linalg.cholesky(known + share**2 * scaled @ scaled.T)
        white = np.linalg.solve(root, left)
        return float(0.5 * white @ white + np.sum(np.log(np.diag(root))))

    shares = np.linspace(0.0, 1.0, _SHARES)
    share = float(shares[np.argmin([surprise(one) for one in shares])])
    root = np.linalg.cholesky(identity + share**2 * scaled @ scaled.T)
    return Statement(np.linalg.solve(root, rows), np.linalg.solve(root, statement.values)), share
