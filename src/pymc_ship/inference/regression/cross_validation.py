"""K-fold cross-validation of a prior: expected log predictive density (elpd) of held-out rows."""

import warnings
from dataclasses import dataclass

import numpy as np

from pymc_ship.inference.regression.priors import Prior, check_data, rescaled_prior
from pymc_ship.inference.rows.data import RegressionData
from pymc_ship.machine.arguments import check_choice, short_repr
from pymc_ship.machine.errors import InferenceError


@dataclass(frozen=True)
class Score:
    """Elpd per held-out row on the original response: mean over the folds, its standard error, and each fold's."""

    mean: float
    se: float
    folds: np.ndarray


@dataclass(frozen=True)
class CrossValidation:
    """Rows to fit, scaled by themselves and decomposed once, and rows to predict, by fold."""

    training: tuple[RegressionData, ...]
    held_out: tuple[RegressionData, ...]

    def score(self, prior: Prior) -> Score:
        """Elpd of a prior: mean of log p(y_i | training rows) over the held-out rows, each by itself as in ArviZ.

        A prior with vectors is on the scales of the whole; those of the training rows change its numbers alone.

        Vehtari, Gelman & Gabry (2017), Statistics and Computing 27:1413, doi:10.1007/s11222-016-9696-4.
        """
        densities = [
            rescaled_prior(prior, rows, training)
            .exact(training)
            .log_predictive_density(rows.design_matrix, rows.response, pointwise=True)
            for training, rows in zip(self.training, self.held_out, strict=True)
        ]
        folds = np.array([np.mean(density) for density in densities])
        return Score(float(folds.mean()), float(folds.std(ddof=1) / np.sqrt(folds.size)), folds)


def fold_rows(
    n_rows: int, folds: int = 5, *, split: str = "blocks", rng: np.random.Generator | None = None
) -> list[np.ndarray]:
    """Sorted row numbers of each fold, whose sizes differ by one row at most.

    ``split`` "blocks" are contiguous (neighbouring rows of a trial are correlated), "random" needs ``rng``.
    InferenceError for fewer than two folds or more than rows, an unknown split, or a random one without ``rng``.
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
    """Split the rows into folds as :func:`fold_rows`, and decompose the training rows of each, to score any priors.

    Blocks are of rows in order of time, run after run. The training rows of a fold are scaled by themselves: no value
    of the rows held out reaches the fit. InferenceError also if a response does not vary over training rows, or
    depends on all rows by its formula.
    """
    check_data(data)
    if data.formula is not None and data.formula.pools_response:
        raise InferenceError(
            "Rows held out must not reach a fit, found a response that depends on all rows in "
            f"{short_repr(data.formula.text)}; take a response of each row by itself, and scaling='zscore'."
        )
    if shared := _repeated_rows(data):
        warnings.warn(
            f"Rows held out must not be rows of the fit, found {shared} of {data.n_rows} that repeat another; give "
            "each once.",
            UserWarning,
            stacklevel=2,
        )
    held_out = [np.sort(data.order[rows]) for rows in fold_rows(data.n_rows, folds, split=split, rng=rng)]
    training = tuple(data.rescaled_rows(np.setdiff1d(np.arange(data.n_rows), rows)) for rows in held_out)
    for rows in training:
        _ = rows.svd
    return CrossValidation(training, tuple(data.rows(rows) for rows in held_out))


def _repeated_rows(data: RegressionData) -> int:
    """Number of rows that repeat another; 0 if responses of other columns are as often equal, as if rounded."""
    rows = np.column_stack([data.design_matrix, data.response])[data.order]
    rows = rows[np.append(True, np.any(np.diff(rows, axis=0) != 0.0, axis=1))]  # a steady course repeats its row
    responses = len(np.unique(rows[:, -1]))
    if responses == len(rows):  # without a sort of whole rows
        return 0
    different = len(np.unique(rows, axis=0))
    return len(rows) - different if len(rows) - different > different - responses else 0
