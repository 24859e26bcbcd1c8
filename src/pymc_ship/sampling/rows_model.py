"""PyMC models of the regression that keep every row, for any law of the errors; pymc is imported only when called."""

from __future__ import annotations

import math
from functools import lru_cache
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from pymc_ship.regression.conjugate import ConjugatePrior
from pymc_ship.regression.priors import Prior
from pymc_ship.rows.data import RegressionData
from pymc_ship.sampling.error_laws import ERRORS, NU_RATE, NU_SHAPE, plug_in_autocorrelation

if TYPE_CHECKING:
    import pymc as pm

_PLUG_IN_STEPS = 10


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


def direct_model(data: RegressionData, prior: Prior, errors: str) -> pm.Model:
    """Model as the paper writes it: coefficients with their prior, and one density for each row."""
    import pymc as pm
    import pytensor.tensor as pt

    offset, transformation = data.transformation
    with pm.Model(coords={"coefficient": list(data.coefficients), "row": np.arange(data.n_rows)}) as model:
        design = pm.Data("scaled_design_matrix", data.scaled_design_matrix, dims=("row", "coefficient"))
        variance = pm.InverseGamma("scaled_noise_variance", alpha=prior.shape, beta=prior.scale)
        prior_variance = prior.coefficient_variance(variance, data.n_terms)
        scaled = pm.Normal(
            "scaled_coefficients", mu=prior.means(data.n_terms), sigma=pt.sqrt(prior_variance), dims="coefficient"
        )
        pm.Deterministic("coefficients", offset + pt.dot(transformation, scaled), dims="coefficient")
        noise_variance = pm.Deterministic("noise_variance", data.response_scale**2 * variance)
        fit = data.response_center + data.response_scale * pt.dot(design, scaled)
        _rows("response", errors, _parameter(errors), (fit, noise_variance), observed=data.response, dims="row")
    return model


def _parameter(errors: str):
    import pymc as pm

    if errors == "student_t":
        return pm.Gamma("degrees_of_freedom", alpha=NU_SHAPE, beta=NU_RATE)
    return pm.Uniform("autocorrelation", -1.0, 1.0) if errors == "ar1" else None


def _rows(name: str, errors: str, parameter, moments: tuple, **given) -> None:
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


def whitened_rows_model(data: RegressionData, prior: Prior, errors: str) -> pm.Model:
    """Model of the rows whose coefficients are whitened at plug-in values: location + spread times the coordinate."""
    import pymc as pm
    import pytensor.tensor as pt

    n_terms = data.n_terms
    coords = {"coefficient": list(data.coefficients), "row": np.arange(data.n_rows), "direction": np.arange(n_terms)}
    with pm.Model(coords=coords) as model:
        values = {name: pm.Data(name, value) for name, value in row_statistics(data, prior, errors).items()}
        known = RowSummary._make(values["summary"][k] for k in range(len(RowSummary._fields)))
        location, spread, level = values["location"], values["spread"], known.level
        if errors == "ar1":
            # artanh of a uniform variable is logistic; the rows fix the variance of the innovations, whatever rho
            middle, reach = known.middle, known.reach
            turn = pm.Logistic("autocorrelation_coordinate", mu=-middle / reach, s=0.5 / reach, initval=0.0)
            parameter = pm.Deterministic("autocorrelation", pt.tanh(middle + reach * turn))
            level = level - pt.log1p(-(parameter**2))
        else:
            parameter = _parameter(errors)
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
        _rows("row_density", errors, parameter, (fit, noise_variance), observed=values["rotated_response"])
    return model


@lru_cache(maxsize=16)
def compiled_rows(n_terms: int, errors: str):
    """Whitened model of the rows compiled by nutpie for placeholder data; the rest enters by ``with_data``."""
    import nutpie

    placeholder = RegressionData.from_arrays(np.eye(n_terms), np.ones(n_terms))
    return nutpie.compile_pymc_model(whitened_rows_model(placeholder, ConjugatePrior(), errors))


def row_statistics(data: RegressionData, prior: Prior, errors: str) -> dict[str, np.ndarray]:
    """All that the whitened model of the rows knows of data and prior, by the names of its pm.Data.

    The rows are made nearly normal and independent at a plug-in estimate (weights of a t with 4 degrees of freedom;
    Prais-Winsten) and rotated by their SVD. That gives the posterior ``location`` and ``spread`` of the rotated
    coefficients, level and width of the log noise variance, and middle and reach of the artanh of the autocorrelation.
    They are coordinates only: were they poor, NUTS would be slower, not biased.
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
    level, width = math.log(variance), 1.0 / math.sqrt(prior.shape + 0.5 * data.n_rows)
    rho = plug_in_autocorrelation(residual) if errors == "ar1" else 0.0
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
    basis = np.column_stack([((right * root) @ data.transformation[1].T).T, data.to_original(mean)])
    rows = {"rotated_design": unit * design @ right.T, "rotated_response": unit * target}
    return {"summary": np.array(summary, dtype=float), "location": location, "spread": spread, "basis": basis, **rows}
