"""Whitened PyMC models of a regression, the quick path of NUTS, and the fit that whitens; pymc is imported when called.

With normal errors the model states the density of the paper in coordinates that NUTS finds isotropic, at O(n_terms) an
evaluation. With X diag(kappa)^(1/2) = U S R' the data speak of the rotated coefficients
g = R' diag(kappa)^(-1/2) (b - mean) only through z = U' (y - X mean), and of the noise also through the square of
y - X mean - U z. Given the noise variance, prior times likelihood gives g a centre and a spread; the coordinates are
(g - centre) / spread. They are no more than coordinates: were centre and spread wrong, NUTS would be slower, not
biased. Errors that are not normal have no such summary; their model keeps every row.
"""

from __future__ import annotations

import math
from functools import lru_cache
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from pymc_ship.inference.regression.conjugate import ConjugatePrior
from pymc_ship.inference.regression.priors import Prior, Rotation, rotate
from pymc_ship.inference.rows.data import RegressionData
from pymc_ship.inference.sampling.error_laws import ERRORS, NU_RATE, NU_SHAPE, plug_in_autocorrelation

if TYPE_CHECKING:
    import pymc as pm

_PLUG_IN_STEPS = 10


def whitened_model(data: RegressionData, prior: Prior, errors: str) -> pm.Model:
    """Model of prior and likelihood in whitened coordinates."""
    return _projections_model(data, prior) if errors == "normal" else _rows_model(data, prior, errors)


def statistics(data: RegressionData, prior: Prior, errors: str) -> dict[str, np.ndarray]:
    """All that the whitened model knows of data and prior, by the names of its pm.Data."""
    return _projection_statistics(data, prior) if errors == "normal" else _row_statistics(data, prior, errors)


@lru_cache(maxsize=16)
def compiled(n_terms: int, errors: str):
    """Whitened model compiled by nutpie for placeholder data; :func:`statistics` enter by ``with_data``."""
    import nutpie

    placeholder = RegressionData.from_arrays(np.eye(n_terms), np.ones(n_terms))
    return nutpie.compile_pymc_model(whitened_model(placeholder, ConjugatePrior(), errors))


def _named(summary, kind):
    """Scalars of a model's data ``summary`` by the names of their kind."""
    return kind._make(summary[k] for k in range(len(kind._fields)))


class RowSummary(NamedTuple):
    """Scalars that the whitened model of the rows knows of data and prior.

    The noise variance is a priori inverse gamma of ``shape`` and ``scale``, and its power ``power`` is the prior
    variance of the rotated coefficients; ``level`` and ``width`` standardise its logarithm, ``middle`` and ``reach``
    the artanh of the autocorrelation.
    """

    shape: float
    scale: float
    power: float
    level: float
    width: float
    response_scale: float
    middle: float
    reach: float


def law_parameter(errors: str):
    """Free variable of an error law beside the noise variance; None for normal errors."""
    import pymc as pm

    if errors == "student_t":
        return pm.Gamma("degrees_of_freedom", alpha=NU_SHAPE, beta=NU_RATE)
    return pm.Uniform("autocorrelation", -1.0, 1.0) if errors == "ar1" else None


def row_density(name: str, errors: str, parameter, moments: tuple, **given) -> None:
    """Likelihood of the rows; that of AR(1) is a product of densities given the row before."""
    import pymc as pm
    import pytensor.tensor as pt

    fit, sd = moments[0], pt.sqrt(moments[1])
    if errors == "student_t":
        pm.StudentT(name, nu=parameter, mu=fit, sigma=sd, **given)
        return
    if errors == "ar1":
        before = pt.as_tensor(given["observed"])[:-1] - fit[:-1]
        first = pt.arange(fit.shape[0]) < 1
        fit = pt.inc_subtensor(fit[1:], parameter * before)
        sd = sd * pt.switch(first, 1.0, pt.sqrt(1.0 - parameter**2))
    pm.Normal(name, mu=fit, sigma=sd, **given)


def noise_coordinate(shape, scale, level, width, size):
    """Standardised log of an inverse gamma variable; PyMC derives its density."""
    import pymc as pm
    import pytensor.tensor as pt

    return (pt.log(pm.InverseGamma.dist(shape, scale, size=size)) - level) / width


def _rows_model(data: RegressionData, prior: Prior, errors: str) -> pm.Model:
    """Model of the rows whose coefficients are whitened at plug-in values: location + spread times the coordinate."""
    import pymc as pm
    import pytensor.tensor as pt

    n_terms = data.n_terms
    coords = {"coefficient": list(data.coefficients), "row": np.arange(data.n_rows), "direction": np.arange(n_terms)}
    with pm.Model(coords=coords) as model:
        values = {name: pm.Data(name, value) for name, value in _row_statistics(data, prior, errors).items()}
        known = _named(values["summary"], RowSummary)
        location, spread, level = values["location"], values["spread"], known.level
        if errors == "ar1":
            # artanh of a uniform variable is logistic; the rows fix the variance of the innovations, whatever rho
            middle, reach = known.middle, known.reach
            turn = pm.Logistic("autocorrelation_coordinate", mu=-middle / reach, s=0.5 / reach, initval=0.0)
            parameter = pm.Deterministic("autocorrelation", pt.tanh(middle + reach * turn))
            level = level - pt.log1p(-(parameter**2))
        else:
            parameter = law_parameter(errors)
        noise = (known.shape, known.scale, level, known.width)
        coordinate = pm.CustomDist("noise_coordinate", *noise, dist=noise_coordinate, initval=0.0)
        variance = pt.exp(level + known.width * coordinate)
        direction_coordinate = pm.Normal(
            "direction_coordinate",
            mu=-location / spread,
            sigma=pt.sqrt(variance**known.power) / spread,
            dims="direction",
            initval=np.zeros(n_terms),
        )
        rotated = location + spread * direction_coordinate
        basis = values["basis"]
        pm.Deterministic("coefficients", basis[:, -1] + (basis[:, :-1] * rotated).sum(axis=1), dims="coefficient")
        noise_variance = pm.Deterministic("noise_variance", known.response_scale**2 * variance)
        fit = pt.dot(values["rotated_design"], rotated)
        row_density("row_density", errors, parameter, (fit, noise_variance), observed=values["rotated_response"])
    return model


class PlugIn(NamedTuple):
    """Coordinates in which the coefficients are nearly normal and independent, from a plug-in fit.

    The scaled coefficients are ``mean + g basis``. Were the fit poor, NUTS would be slower, not biased.

    Attributes
    ----------
    mean : ndarray, shape (n_terms,)
    basis : ndarray, shape (n_terms, n_terms)
    location, spread : ndarray, shape (n_terms,)
        Of the rotated coefficients g a posteriori.
    variance : float
        Of the noise on the scaled response.
    residual : ndarray, shape (n_rows,)
    """

    mean: np.ndarray
    basis: np.ndarray
    location: np.ndarray
    spread: np.ndarray
    variance: float
    residual: np.ndarray


def plug_in(data: RegressionData, prior: Prior, errors: str) -> PlugIn:
    """Fit of scaled coefficients and noise variance that is exact for normal errors of a known variance.

    The rows are made nearly normal and independent at a plug-in estimate (weights of a t with 4 degrees of freedom;
    Prais-Winsten) and rotated by their SVD.
    """
    whiten_at = ERRORS[errors].whiten
    root, mean = np.sqrt(prior.kappas(data.n_terms)), prior.means(data.n_terms)
    design = data.scaled_design_matrix * root
    target = data.scaled_response - data.scaled_design_matrix @ mean
    wide, unseen = data.n_terms > data.n_rows, max(0, data.n_terms - data.n_rows)
    residual, variance = target, (target @ target + 2.0 * prior.scale) / (data.n_rows + 2.0 * prior.shape)

    def whiten(rows):
        return rows

    for _ in range(_PLUG_IN_STEPS):
        left, s, right = np.linalg.svd(whiten(design), full_matrices=wide)
        z, s = np.pad(left.T @ whiten(target), (0, unseen)), np.pad(s, (0, unseen))
        ratio = variance / prior.variance_factor(variance)
        location = s * z / (ratio + s**2)
        residual = target - design @ (location @ right)
        error = whiten(residual)
        variance = (error @ error + 2.0 * prior.scale) / (data.n_rows + 2.0 * prior.shape)
        spread = np.sqrt(variance / (ratio + s**2))
        whiten = whiten_at(residual, variance)
    return PlugIn(mean, right * root, location, spread, variance, residual)


def _row_statistics(data: RegressionData, prior: Prior, errors: str) -> dict[str, np.ndarray]:
    """Rotated rows and how they are whitened.

    Beside the rotated rows these are the posterior ``location`` and ``spread`` of the rotated coefficients, level and
    width of the log noise variance, and middle and reach of the artanh of the autocorrelation.
    """
    fit = plug_in(data, prior, errors)
    level, width = math.log(fit.variance), 1.0 / math.sqrt(prior.shape + 0.5 * data.n_rows)
    rho = plug_in_autocorrelation(fit.residual) if errors == "ar1" else 0.0
    level += math.log1p(-(rho**2))
    reach = 1.0 / math.sqrt(1.0 + data.n_rows * (1.0 - rho**2))
    unit = data.response_scale
    summary = RowSummary(
        shape=prior.shape,
        scale=prior.scale,
        power=prior.noise_power,
        level=level,
        width=width,
        response_scale=unit,
        middle=math.atanh(rho),
        reach=reach,
    )
    basis = np.column_stack([(fit.basis @ data.transformation[1].T).T, data.to_original(fit.mean)])
    rows = {
        "rotated_design": unit * data.scaled_design_matrix @ fit.basis.T,
        "rotated_response": unit * (data.scaled_response - data.scaled_design_matrix @ fit.mean),
    }
    summary = np.array(summary, dtype=float)
    return {"summary": summary, "location": fit.location, "spread": fit.spread, "basis": basis, **rows}


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


def _projections_model(data: RegressionData, prior: Prior) -> pm.Model:
    """Model of normal errors, which knows the rows by their projections and the square of the rest."""
    import pymc as pm
    import pytensor.tensor as pt

    n_terms = data.n_terms
    coords = {"coefficient": list(data.coefficients), "row": np.arange(data.n_rows)}
    coords |= {"direction": np.arange(n_terms), "quantity": list(Summary._fields)}
    with pm.Model(coords=coords) as model:
        dims = {"summary": "quantity", "singular_values": "direction", "projection": "direction"}
        dims["basis"] = ("coefficient", "basis_column")
        values = _projection_statistics(data, prior)
        values = {name: pm.Data(name, value, dims=dims[name]) for name, value in values.items()}
        known, basis = _named(values["summary"], Summary), values["basis"]
        singular_values, projection = values["singular_values"], values["projection"]

        noise = (known.shape, known.scale, known.level, known.width)
        coordinate = pm.CustomDist("noise_coordinate", *noise, dist=noise_coordinate, initval=0.0)
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


def _projection_statistics(data: RegressionData, prior: Prior) -> dict[str, np.ndarray]:
    """Summary of the data in the directions of :func:`rotate`; ``basis`` ends with the prior mean of b."""
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
