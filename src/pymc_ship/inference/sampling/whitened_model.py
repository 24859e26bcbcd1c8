"""A regression of normal errors for NUTS, in coordinates in which its coefficients are exactly standard normal.

X diag(kappa)^(1/2) = U S R'; coordinates (g - center) / spread of g = R' diag(kappa)^(-1/2) (b - mean), with center and
spread of g given sigma2. Sufficient statistics: z = U' (y - X mean) and the residual sum of squares.
"""

import math
from collections.abc import Callable
from typing import NamedTuple

import numpy as np
import scipy
from numba import njit

from pymc_ship.inference.regression.priors import Prior, Rotation, rotate
from pymc_ship.inference.rows.data import RegressionData


class Density(NamedTuple):
    """A log density for NUTS that needs no compilation."""

    start: np.ndarray  # (n_coordinates,); chains start within 1 of it
    log_density: Callable[[np.ndarray], tuple[float, np.ndarray]]  # coordinates -> log density and its gradient
    parameters: Callable[[np.ndarray], dict[str, np.ndarray]]  # coordinates -> values to keep, by name


class Regression(NamedTuple):
    """Prior and rows in the coordinates of NUTS."""

    level: float  # with the width, standardises log sigma2
    width: float
    shape: float
    power: float  # of sigma2 in the prior variance of g
    excess: float  # half of the rows less the terms
    rate: float  # of the posterior of sigma2
    singular_values: np.ndarray  # 0 for directions that no row sees, and so the projection
    projection: np.ndarray


def whitened_density(data: RegressionData, prior: Prior) -> Density:
    """Prior times likelihood of the original response; the first coordinate is the standardised log of sigma2."""
    rotation = rotate(data, prior)
    given = _standardised(prior, rotation, data.n_rows)
    constant = prior.shape * math.log(prior.scale) - math.lgamma(prior.shape) + math.log(given.width)
    constant -= 0.5 * (data.n_rows + data.n_terms) * math.log(2.0 * math.pi)
    constant -= data.n_rows * math.log(data.response_scale)

    def log_density(coordinates: np.ndarray) -> tuple[float, np.ndarray]:
        value, gradient = whitened(coordinates, given)
        return constant + value, gradient

    def parameters(coordinates: np.ndarray) -> dict[str, np.ndarray]:
        variance = np.exp(given.level + given.width * coordinates[0])
        precision = given.singular_values / variance
        spread = 1.0 / np.sqrt(variance**-given.power + given.singular_values * precision)
        rotated = spread * (spread * precision * given.projection + coordinates[1:])
        noise_variance = np.array(data.response_scale**2 * variance)
        return {"coefficients": rotation.center + rotated @ rotation.basis, "noise_variance": noise_variance}

    return Density(np.zeros(data.n_terms + 1), log_density, parameters)


@njit(cache=True, nogil=True, error_model="numpy")
def whitened(coordinates: np.ndarray, given: Regression) -> tuple[float, np.ndarray]:
    """Log density up to a constant, and its gradient: standard normal but for the first coordinate."""
    level = given.level + given.width * coordinates[0]
    variance, power = np.exp(level), given.shape + given.excess
    value, slope = -power * level - given.rate / variance, given.rate / variance - power
    for j, s in enumerate(given.singular_values):
        seen = s**2 * variance**given.power
        marginal = variance + seen
        square = given.projection[j] ** 2 / marginal
        value -= 0.5 * (np.log(marginal) + square + coordinates[j + 1] ** 2)
        slope -= 0.5 * (variance + given.power * seen) / marginal * (1.0 - square)
    gradient = -coordinates
    gradient[0] = given.width * slope
    return value, gradient


def _standardised(prior: Prior, rotation: Rotation, n_rows: int) -> Regression:
    """The first coordinate is 0 at the mode of log sigma2."""
    s, z = rotation.singular_values, rotation.projection
    excess, rate = 0.5 * (n_rows - len(s)), prior.scale + 0.5 * rotation.residual_square
    start = Regression(0.0, 1.0, prior.shape, prior.noise_power, excess, rate, singular_values=s, projection=z)

    def slope(level: float) -> float:
        return whitened(np.append(level, np.zeros(len(s))), start)[1][0]

    low = math.log(rate / (prior.shape + 0.5 * n_rows)) - 1.0
    high = math.log((rate + 0.5 * float(z @ z)) / (prior.shape + max(excess, 0.0))) + 1.0
    width = 1.0 / math.sqrt(prior.shape + 0.5 * n_rows)
    return start._replace(level=scipy.optimize.brentq(slope, low, high), width=width)
