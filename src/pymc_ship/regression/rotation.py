"""Coordinates in which the coefficients are independent given the noise variance, shared by every path to a posterior.

With W = X diag(kappa)^(1/2) = U S R' on the scaled columns, g = R' diag(kappa)^(-1/2) (b - mean) enters the likelihood
only through z - s g with z = U' (y - X mean), and the residual e = y - X mean - U z does not depend on g. It is formed
explicitly: y'y - z'z would lose the fit of a response with a large offset.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from pymc_ship.regression.data import RegressionData
from pymc_ship.regression.priors import ConjugatePrior, SemiConjugatePrior


@dataclass(frozen=True)
class Rotation:
    """Sufficient statistics of regression data under a prior.

    Attributes
    ----------
    singular_values : ndarray, shape (n_terms,)
        s of the scaled columns times the root of kappa; 0 for directions that no row sees.
    projection : ndarray, shape (n_terms,)
        z of the scaled response, 0 likewise.
    residual_square : float
        |e|^2 of the scaled response.
    center : ndarray, shape (n_terms,)
        Prior mean of the original coefficients.
    basis : ndarray, shape (n_terms, n_terms)
        original coefficients = center + g basis.
    """

    singular_values: np.ndarray
    projection: np.ndarray
    residual_square: float
    center: np.ndarray
    basis: np.ndarray


def rotate(data: RegressionData, prior: ConjugatePrior | SemiConjugatePrior) -> Rotation:
    """Rotate regression data; with a scalar kappa and a zero mean it costs no pass over the rows.

    Raises
    ------
    PriorError
        For hyperparameter vectors of the wrong length.
    """
    root, wide = np.sqrt(prior.kappas(data.n_terms)), data.n_terms > data.n_rows
    mean = prior.means(data.n_terms)
    own = np.ndim(prior.kappa) or wide
    if own:
        left, s, right = np.linalg.svd(data.scaled_design_matrix * root, full_matrices=wide)
    else:
        left, s, right = data.svd
        s = s * root
    if own or mean.any():
        error = data.scaled_response - data.scaled_design_matrix @ mean
        z = left.T @ error
        residual_square = float(np.sum((error - left @ z) ** 2))
    else:
        z, residual_square = data.projection
    unseen = (0, data.n_terms - len(s))
    basis = (right * root) @ data.transformation[1].T
    return Rotation(np.pad(s, unseen), np.pad(z, unseen), residual_square, data.to_original(mean), basis)
