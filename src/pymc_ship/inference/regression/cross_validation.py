"""How well a prior predicts rows that were held out: K-fold log predictive density, in closed form or by quadrature."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from pymc_ship.inference.regression.priors import Prior
from pymc_ship.inference.rows.data import RegressionData
from pymc_ship.machine.arguments import check_choice
from pymc_ship.machine.errors import InferenceError


@dataclass(frozen=True)
class Score:
    """Log predictive density of held-out rows, per row, on the scale of the original response.

    Attributes
    ----------
    mean : float
        Mean over the folds.
    se : float
        Standard error of that mean, from the spread of the folds.
    folds : ndarray, shape (n_folds,)
        Mean over the rows of each fold.
    """

    mean: float
    se: float
    folds: np.ndarray


@dataclass(frozen=True)
class CrossValidation:
    """Rows split for cross-validation, with one decomposition for each fold.

    Attributes
    ----------
    training, held_out : tuple of RegressionData
        For each fold, the rows to fit and those to predict; both keep the scaling of the whole, which the prior lives
        on.
    """

    training: tuple[RegressionData, ...]
    held_out: tuple[RegressionData, ...]

    def score(self, prior: Prior) -> Score:
        """Score of a prior: log p(y_i | training rows) of each held-out row by itself, averaged.

        Rows are scored one at a time, as in ArviZ; a joint density would let the first rows of a fold stand in for the
        training rows, and so judge the prior less.

        Parameters
        ----------
        prior : Prior

        Returns
        -------
        Score
            Exact given the folds, as far as the prior's exact posterior is: closed form for the conjugate prior,
            quadrature for the semi-conjugate.

        References
        ----------
        Vehtari, Gelman & Gabry (2017), Statistics and Computing 27:1413, doi:10.1007/s11222-016-9696-4.
        """
        densities = [
            prior.exact(training).log_predictive_density(rows.design_matrix, rows.response, pointwise=True)
            for training, rows in zip(self.training, self.held_out, strict=True)
        ]
        folds = np.array([np.mean(density) for density in densities])
        return Score(float(folds.mean()), float(folds.std(ddof=1) / np.sqrt(folds.size)), folds)


def fold_rows(
    n_rows: int, folds: int = 5, *, split: str = "blocks", rng: np.random.Generator | None = None
) -> list[np.ndarray]:
    """Rows that each fold holds out.

    Parameters
    ----------
    n_rows : int
    folds : int, optional
        Number of folds; their sizes differ by one row at most.
    split : {"blocks", "random"}, optional
        Contiguous blocks, since neighbouring rows of a trial resemble each other, or rows at random.
    rng : numpy.random.Generator, optional
        Needed by ``"random"`` only.

    Returns
    -------
    list of ndarray
        Sorted row numbers; every row is in exactly one fold.

    Raises
    ------
    InferenceError
        For fewer than two folds or more than rows, an unknown split, or a random one without ``rng``.
    """
    if not 2 <= folds <= n_rows:
        raise InferenceError(f"The {n_rows} rows make 2 to {n_rows} folds, found {folds}; change the number.")
    check_choice("A split", split, ("blocks", "random"), InferenceError)
    if split == "blocks":
        return np.array_split(np.arange(n_rows), folds)
    if rng is None:
        raise InferenceError("A random split needs a generator, found none; give rng.")
    return [np.sort(rows) for rows in np.array_split(rng.permutation(n_rows), folds)]


def cross_validation(
    data: RegressionData, folds: int = 5, *, split: str = "blocks", rng: np.random.Generator | None = None
) -> CrossValidation:
    """Split the rows for cross-validation and decompose the training rows of each fold once.

    Parameters
    ----------
    data : RegressionData
    folds, split, rng
        As :func:`fold_rows`.

    Returns
    -------
    CrossValidation
        Scores any number of priors, a prior with scalar kappa in O(n_rows n_terms).

    Raises
    ------
    InferenceError
        As :func:`fold_rows`.
    """
    held_out = fold_rows(data.n_rows, folds, split=split, rng=rng)
    training = tuple(data.rows(np.setdiff1d(np.arange(data.n_rows), rows)) for rows in held_out)
    for rows in training:
        _ = rows.svd
    return CrossValidation(training, tuple(data.rows(rows) for rows in held_out))
