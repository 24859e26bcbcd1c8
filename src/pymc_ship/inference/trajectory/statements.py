"""What data said of coefficients, carried on as a statement beside the prior of other data.

The windows of a fit are summed up by the quadratic that their log likelihood is about its mode. A posterior that takes
this statement in place of the windows is the posterior of all windows, as far as the model is linear between them.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import product

import numpy as np

from pymc_ship.inference.trajectory.prior import CoefficientPrior, Statement
from pymc_ship.inference.trajectory.windows import WindowFit
from pymc_ship.machine.errors import InferenceError
from pymc_ship.physics.vessel.vessel import Vessel, coefficient_names, per_run_indices

_SHARES = {1: 101, 2: 31}  # of the prior sd that are tried, by the number of groups
_TOLD = 1e-9  # of the largest eigenvalue, from which windows tell of a direction


@dataclass(frozen=True)
class Earlier:
    """What earlier runs have said of a term set.

    Attributes
    ----------
    names : tuple of str
        Of its coefficients.
    statement : Statement
        Of them, beside the prior.
    log_density : ndarray, shape (n_runs,)
        Log predictive density of each of these runs, held out.
    mean, scale : ndarray, shape (n_coefficients,)
        Of the prior that stood beside these runs.
    """

    names: tuple[str, ...]
    statement: Statement
    log_density: np.ndarray
    mean: np.ndarray
    scale: np.ndarray

    def __repr__(self) -> str:
        """Number of coefficients and of runs."""
        return f"Earlier({len(self.names)} coefficients, {len(self.log_density)} runs)"

    def of(self, vessel: Vessel) -> Statement:
        """Statement of the coefficients of a vessel with these terms; InferenceError where one is lacking."""
        mine = coefficient_names(vessel)
        lacking = [name for k, name in enumerate(self.names) if name not in mine and self.statement.rows[:, k].any()]
        if lacking:
            raise InferenceError(
                f"What earlier runs said of {', '.join(lacking)} has no place in {vessel.name!r}; state the "
                "vessel file of these runs."
            )
        rows = np.zeros((len(self.statement.rows), len(mine)))
        for k, name in enumerate(self.names):
            if name in mine:
                rows[:, mine.index(name)] = self.statement.rows[:, k]
        return Statement(rows, self.statement.values)

    def at_loading(self, names: Sequence[str], prior: CoefficientPrior) -> Earlier:
        """The same of the ship at another draught: as many prior sd from the prior's mean there as here.

        Parameters
        ----------
        names : sequence of str
            Of the coefficients of the prior.
        prior : CoefficientPrior
            At the other draught.
        """
        mean, scale = self.mean.copy(), self.scale.copy()
        for k, name in enumerate(self.names):
            if name in names:
                mean[k], scale[k] = (values[list(names).index(name)] for values in (prior.mean, prior.scale))
        share = self.scale / scale
        rows, values = self.statement
        moved = Statement(rows * share, values - rows @ (self.mean - share * mean))
        return Earlier(self.names, moved, self.log_density, mean, scale)


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
    free[per_run_indices(fit.vessel)] = 0.0
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
    statement: Statement,
    prior: CoefficientPrior,
    coefficients: np.ndarray,
    covariance: np.ndarray,
    own: Sequence[int] = (),
) -> tuple[Statement, tuple[float, ...]]:
    """Statement of coefficients that differ from those it was made of, by a share of the prior's sd each.

    Parameters
    ----------
    statement : Statement
    prior : CoefficientPrior
    coefficients, covariance : ndarray, shape (n_coefficients,), (n_coefficients, n_coefficients)
        By other data and the prior alone.
    own : sequence of int, optional
        Places of coefficients with a share of their own.

    Returns
    -------
    Statement
    tuple of float
        The share, and that of ``own`` where there are any, at which the statement is most probable for these
        coefficients (empirical Bayes), from 0 to 1; 0 where they say little.
    """
    rows, left = statement.rows, statement.misfit(coefficients)
    scaled, identity = rows * prior.scale, np.eye(len(rows))
    known = identity + rows @ covariance @ rows.T
    apart = np.isin(np.arange(prior.scale.size), own)
    spreads = [scaled[:, mine] @ scaled[:, mine].T for mine in (~apart, apart) if mine.any()]

    def moved(shares: Sequence[float]) -> np.ndarray:
        return sum(share**2 * spread for share, spread in zip(shares, spreads, strict=True))

    def surprise(shares: Sequence[float]) -> float:
        root = np.linalg.cholesky(known + moved(shares))
        white = np.linalg.solve(root, left)
        return float(0.5 * white @ white + np.sum(np.log(np.diag(root))))

    tried = np.linspace(0.0, 1.0, _SHARES[len(spreads)]).tolist()
    shares = min(product(tried, repeat=len(spreads)), key=surprise)
    root = np.linalg.cholesky(identity + moved(shares))
    return Statement(np.linalg.solve(root, rows), np.linalg.solve(root, statement.values)), shares
