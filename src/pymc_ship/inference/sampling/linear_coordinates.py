"""Linear coordinates for NUTS in the PyMC model of a regression, in which its posterior is nearly standard normal."""

from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
import pymc as pm
import pytensor.tensor as pt
from pymc.distributions.transforms import Transform
from pytensor.tensor.variable import TensorVariable

from pymc_ship.inference.regression.conjugate import ConjugatePrior
from pymc_ship.inference.regression.priors import Prior
from pymc_ship.inference.rows.data import RegressionData
from pymc_ship.inference.sampling.error_laws import ERRORS

_PLUG_IN_STEPS = 10


class LinearTransform(Transform):
    """Coordinates c of a vector x = center + basis c; they change the path of NUTS, not the posterior."""

    name = "linear"

    def __init__(self, center: np.ndarray, basis: np.ndarray):
        self.center, self.basis = center, basis
        self.inverse, self.log_volume = np.linalg.inv(basis), float(np.linalg.slogdet(basis)[1])

    def forward(self, value: TensorVariable, *_: object) -> TensorVariable:
        """Coordinates of a vector."""
        return pt.dot(self.inverse, value - self.center)

    def backward(self, value: TensorVariable, *_: object) -> TensorVariable:
        """Vector of coordinates."""
        return self.center + pt.dot(self.basis, value)

    def log_jac_det(self, value: TensorVariable, *_: object) -> TensorVariable:
        """Log determinant of the basis."""
        return pt.as_tensor(self.log_volume)


def coefficients_from_fit(mean: Any, sd: Any, given: Mapping[str, Any]) -> TensorVariable:
    """Normal ``scaled_coefficients`` that start at the fit, not at their mean, from which ADVI does not arrive.

    ``given``: dims and transform. An initial value of the model would rule out ``pm.compute_log_likelihood``.
    """
    center = given["transform"].center

    def normal(mean: TensorVariable, sd: TensorVariable, size: TensorVariable) -> TensorVariable:
        return pm.Normal.dist(mean, sd, size=size)

    parts = {"dist": normal, "support_point": lambda *_: pt.as_tensor(center), "class_name": "Normal"}
    return pm.CustomDist("scaled_coefficients", mean, sd, **parts, **given)


def linear_coordinates(data: RegressionData, prior: Prior | Callable, errors: str | Callable) -> LinearTransform:
    """Linear coordinates in which the scaled coefficients are nearly standard normal, by a plug-in fit.

    Non-normal errors are whitened at a plug-in estimate (t weights with 4 degrees of freedom; Prais-Winsten).
    """
    prior = ConjugatePrior() if callable(prior) else prior
    whiten_at = ERRORS["normal" if callable(errors) else errors].whiten
    root, mean = np.sqrt(prior.kappas(data.n_terms)), prior.means(data.n_terms)
    design = data.scaled_design_matrix * root
    target = data.scaled_response - data.scaled_design_matrix @ mean
    wide, n_missing = data.n_terms > data.n_rows, max(0, data.n_terms - data.n_rows)
    variance = (target @ target + 2.0 * prior.scale) / (data.n_rows + 2.0 * prior.shape)
    whiten = ERRORS["normal"].whiten(target, 1.0)
    for _ in range(_PLUG_IN_STEPS):
        left, s, right = np.linalg.svd(whiten(design), full_matrices=wide)
        z, s = np.pad(left.T @ whiten(target), (0, n_missing)), np.pad(s, (0, n_missing))
        ratio = variance / prior.variance_factor(variance)
        location = s * z / (ratio + s**2)
        residual = target - design @ (location @ right)
        error = whiten(residual)
        variance = (error @ error + 2.0 * prior.scale) / (data.n_rows + 2.0 * prior.shape)
        spread = np.sqrt(variance / (ratio + s**2))
        whiten = whiten_at(residual, float(variance))
    basis = right * root
    return LinearTransform(mean + location @ basis, (spread[:, None] * basis).T)
