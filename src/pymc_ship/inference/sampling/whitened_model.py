"""Quick path of NUTS for normal errors: the density of the paper in whitened coordinates; pymc is imported when called.

NUTS finds the coordinates isotropic, and an evaluation costs O(n_terms), whatever the rows. With
X diag(kappa)^(1/2) = U S R' the data speak of the rotated coefficients g = R' diag(kappa)^(-1/2) (b - mean) only
through z = U' (y - X mean), and of the noise also through the square of y - X mean - U z. Given the noise variance,
prior times likelihood gives g a centre and a spread; the coordinates are (g - centre) / spread. They are no more than
coordinates: were centre and spread wrong, NUTS would be slower, not biased. Errors that are not normal have no such
summary; NUTS draws them from the model that users change (:mod:`pymc_ship.inference.sampling.regression_model`).
"""

from __future__ import annotations

import math
from functools import lru_cache
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from pymc_ship.inference.regression.conjugate import ConjugatePrior
from pymc_ship.inference.regression.priors import Prior, Rotation, rotate
from pymc_ship.inference.rows.data import RegressionData

if TYPE_CHECKING:
    import pymc as pm


@lru_cache(maxsize=16)
def compiled(n_terms: int) -> Any:
    """Whitened model compiled by nutpie for placeholder data; :func:`statistics` enter by ``with_data``."""
    import nutpie

    placeholder = RegressionData.from_arrays(np.eye(n_terms), np.ones(n_terms))
    return nutpie.compile_pymc_model(whitened_model(placeholder, ConjugatePrior()))


def _noise_coordinate(shape: Any, scale: Any, level: Any, width: Any, size: Any) -> Any:
    """Standardised log of an inverse gamma variable; PyMC derives its density."""
    import pymc as pm
    import pytensor.tensor as pt

    return (pt.log(pm.InverseGamma.dist(shape, scale, size=size)) - level) / width


class Summary(NamedTuple):
    """Scalars that the whitened model knows of data and prior.

    The noise variance is a priori inverse gamma of ``shape`` and ``scale``, and its power ``power`` is the prior
    variance of the rotated coefficients; ``level`` and ``width`` standardise its logarithm.
    """

    shape: float
    scale: float
    power: float
    level: float
    width: float
    n_rows: float
    residual_square: float
    response_scale: float


def whitened_model(data: RegressionData, prior: Prior) -> pm.Model:
    """Model of prior and likelihood, which knows the rows by their projections and the square of the rest."""
    import pymc as pm
    import pytensor.tensor as pt

    n_terms = data.n_terms
    coords = {"coefficient": list(data.coefficients), "row": np.arange(data.n_rows)}
    coords |= {"direction": np.arange(n_terms), "quantity": list(Summary._fields)}
    with pm.Model(coords=coords) as model:
        dims: dict[str, str | tuple[str, str]] = {
            "summary": "quantity",
            "singular_values": "direction",
            "projection": "direction",
        }
        dims["basis"] = ("coefficient", "basis_column")
        values = statistics(data, prior)
        values = {name: pm.Data(name, value, dims=dims[name]) for name, value in values.items()}
        known, basis = Summary(*(values["summary"][k] for k in range(len(Summary._fields)))), values["basis"]
        singular_values, projection = values["singular_values"], values["projection"]

        noise = (known.shape, known.scale, known.level, known.width)
        coordinate = pm.CustomDist("noise_coordinate", *noise, dist=_noise_coordinate, initval=0.0)
        variance = pt.exp(known.level + known.width * coordinate)
        prior_variance = variance**known.power
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
        rest = (known.n_rows - n_terms) * pt.log(2.0 * math.pi * variance) + known.residual_square / variance
        pm.Potential("rest_density", -0.5 * rest - known.n_rows * pt.log(known.response_scale))
        # a product summed by row: the same as a matrix product here, and 2 s faster to compile
        pm.Deterministic("coefficients", basis[:, -1] + (basis[:, :-1] * rotated).sum(axis=1), dims="coefficient")
        pm.Deterministic("noise_variance", known.response_scale**2 * variance)
    return model


def statistics(data: RegressionData, prior: Prior) -> dict[str, np.ndarray]:
    """What the model knows of data and prior, by the names of its pm.Data; ``basis`` ends with the prior mean of b."""
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
    basis = np.column_stack([rotation.basis.T, rotation.center])
    return {
        "summary": np.array(summary, dtype=float),
        "singular_values": rotation.singular_values,
        "projection": rotation.projection,
        "basis": basis,
    }


def _noise_level(prior: Prior, rotation: Rotation, n_rows: int) -> tuple[float, float]:
    """Mode of the log noise variance, coefficients integrated out, and about its standard deviation."""
    from scipy.optimize import brentq

    s, z = rotation.singular_values, rotation.projection
    rate, excess = prior.scale + 0.5 * rotation.residual_square, 0.5 * (n_rows - len(s))
    power = prior.noise_power

    def slope(level: float) -> float:
        variance = math.exp(level)
        factor = prior.variance_factor(variance)
        ratio = variance / factor
        marginal = factor * (ratio + s**2)
        share = power + (1.0 - power) * ratio / (ratio + s**2)
        return prior.shape + excess - rate / variance + 0.5 * np.sum(share * (1.0 - z**2 / marginal))

    low = math.log(rate / (prior.shape + 0.5 * n_rows)) - 1.0
    high = math.log((rate + 0.5 * np.sum(z**2)) / (prior.shape + max(excess, 0.0))) + 1.0
    return brentq(slope, low, high), 1.0 / math.sqrt(prior.shape + 0.5 * n_rows)
