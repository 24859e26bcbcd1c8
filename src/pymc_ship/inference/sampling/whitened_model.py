"""Coordinates for NUTS in which a regression is nearly standard normal, and its model of normal errors in them.

X diag(kappa)^(1/2) = U S R'; coordinates (g - center) / spread of g = R' diag(kappa)^(-1/2) (b - mean), with center and
spread of g given sigma2. Sufficient statistics: z = U' (y - X mean) and the residual sum of squares.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from functools import lru_cache
from typing import Any, NamedTuple

import numpy as np
import nutpie
import pymc as pm
import pytensor.tensor as pt
import scipy
from pymc.distributions.transforms import Transform
from pytensor.tensor.variable import TensorVariable

from pymc_ship.inference.regression.conjugate import ConjugatePrior
from pymc_ship.inference.regression.priors import Prior, Rotation, rotate
from pymc_ship.inference.rows.data import RegressionData
from pymc_ship.inference.sampling.error_laws import ERRORS

_PLUG_IN_STEPS = 10


@lru_cache(maxsize=16)
def compiled_model(n_terms: int) -> Any:
    """Compiled whitened model with placeholder data; ``with_data`` sets :func:`statistics`."""
    placeholder = RegressionData.from_arrays(np.eye(n_terms), np.ones(n_terms), scaling="none")
    return nutpie.compile_pymc_model(whitened_model(placeholder, ConjugatePrior()))


def _noise_coordinate(shape: Any, scale: Any, level: Any, width: Any, size: Any) -> Any:
    """Standardised log of an inverse gamma variable; PyMC derives its density."""
    return (pt.log(pm.InverseGamma.dist(shape, scale, size=size)) - level) / width


class Summary(NamedTuple):
    """Scalars of the model; ``power`` of sigma2 in the prior variance of g; ``level``, ``width`` of log sigma2."""

    shape: float
    scale: float
    power: float
    level: float
    width: float
    n_rows: float
    residual_square: float
    response_scale: float


def whitened_model(data: RegressionData, prior: Prior) -> pm.Model:
    """PyMC model of prior and likelihood in whitened coordinates."""
    n_terms = data.n_terms
    coords = {"coefficient": list(data.coefficients), "row": np.arange(data.n_rows)}
    coords |= {"direction": np.arange(n_terms), "quantity": list(Summary._fields)}
    with pm.Model(coords=coords) as model:
        dims: dict[str, Any] = {"summary": "quantity", "basis": ("coefficient", "basis_column")}
        given = statistics(data, prior)
        values = {name: pm.Data(name, value, dims=dims.get(name, "direction")) for name, value in given.items()}
        summary, basis = Summary(*(values["summary"][k] for k in range(len(Summary._fields)))), values["basis"]
        singular_values, projection = values["singular_values"], values["projection"]
        noise = (summary.shape, summary.scale, summary.level, summary.width)
        coordinate = pm.CustomDist("noise_coordinate", *noise, dist=_noise_coordinate, initval=0.0)
        variance = pt.exp(summary.level + summary.width * coordinate)
        prior_variance = variance**summary.power
        spread = 1.0 / pt.sqrt(1.0 / prior_variance + singular_values**2 / variance)
        center = spread**2 * singular_values * projection / variance
        direction_coordinate = pm.Normal(
            "direction_coordinate",
            mu=-center / spread,
            sigma=pt.sqrt(prior_variance) / spread,
            dims="direction",
            initval=np.zeros(n_terms),
        )
        rotated = center + spread * direction_coordinate
        # Directions that no row sees have singular value and projection 0; they are taken off again by the rest, whose
        # count of rows may be negative. So one model serves more rows than terms and fewer.
        pm.Normal("projection_density", mu=singular_values * rotated, sigma=pt.sqrt(variance), observed=projection)
        rest = (summary.n_rows - n_terms) * pt.log(2.0 * math.pi * variance) + summary.residual_square / variance
        pm.Potential("rest_density", -0.5 * rest - summary.n_rows * pt.log(summary.response_scale))
        # a product summed by row: the same as a matrix product here, and 2 s faster to compile
        pm.Deterministic("coefficients", basis[:, -1] + (basis[:, :-1] * rotated).sum(axis=1), dims="coefficient")
        pm.Deterministic("noise_variance", summary.response_scale**2 * variance)
    return model


def statistics(data: RegressionData, prior: Prior) -> dict[str, np.ndarray]:
    """Data of the model by name of its pm.Data; the last column of ``basis`` is the prior mean."""
    rotation = rotate(data, prior)
    level, width = _noise_level(prior, rotation, data.n_rows)
    summary = Summary(
        shape=prior.shape,
        scale=prior.scale,
        power=prior.noise_power,
        level=level,
        width=width,
        n_rows=data.n_rows,
        residual_square=rotation.residual_square,
        response_scale=data.response_scale,
    )
    return {
        "summary": np.array(summary, dtype=float),
        "singular_values": rotation.singular_values,
        "projection": rotation.projection,
        "basis": np.column_stack([rotation.basis.T, rotation.center]),
    }


def _noise_level(prior: Prior, rotation: Rotation, n_rows: int) -> tuple[float, float]:
    s, z = rotation.singular_values, rotation.projection
    rate, excess = prior.scale + 0.5 * rotation.residual_square, 0.5 * (n_rows - len(s))
    power = prior.noise_power

    def slope(level: float) -> float:
        variance = math.exp(level)
        factor = prior.variance_factor(variance)
        ratio = variance / factor
        marginal = factor * (ratio + s**2)
        weight = power + (1.0 - power) * ratio / (ratio + s**2)
        return prior.shape + excess - rate / variance + 0.5 * np.sum(weight * (1.0 - z**2 / marginal))

    low = math.log(rate / (prior.shape + 0.5 * n_rows)) - 1.0
    high = math.log((rate + 0.5 * np.sum(z**2)) / (prior.shape + max(excess, 0.0))) + 1.0
    return scipy.optimize.brentq(slope, low, high), 1.0 / math.sqrt(prior.shape + 0.5 * n_rows)


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
