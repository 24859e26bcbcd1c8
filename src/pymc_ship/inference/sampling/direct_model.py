"""The PyMC model that users change: the paper's density, its coefficients by name, one likelihood for each row.

NUTS moves in coordinates that a plug-in fit makes nearly independent
(:class:`~pymc_ship.inference.sampling.linear_transform.LinearTransform`), so that nearly collinear columns cost
nothing; what the model states is free of them.

A prior of one's own is a function ``prior(data, given)``, called inside the model. It returns two variables, the scaled
coefficients and the noise variance on the scaled response, and passes ``**given`` (``dims`` and ``transform``) to the
variable of the coefficients. A likelihood of one's own is a function
``errors(name, mu, sigma, given)`` that makes the observed variable ``name`` with ``**given`` (``observed``, ``dims``);
``mu`` and ``sigma`` are on the scale of the original response.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING

import numpy as np

from pymc_ship.inference.regression.conjugate import ConjugatePrior
from pymc_ship.inference.regression.priors import Prior
from pymc_ship.inference.rows.data import RegressionData
from pymc_ship.inference.sampling.whitened_model import law_parameter, plug_in, row_density

if TYPE_CHECKING:
    import pymc as pm


def direct_model(data: RegressionData, prior: Prior | Callable, errors: str | Callable) -> pm.Model:
    """Model as the paper writes it: coefficients with their prior, and one density for each row.

    Parameters
    ----------
    data : RegressionData
    prior : Prior or callable
    errors : {"normal", "student_t", "ar1"} or callable

    Returns
    -------
    pymc.Model
        With the data ``design_matrix`` (dims row, coefficient), which ``pm.set_data`` exchanges for new rows.
    """
    import pymc as pm
    import pytensor.tensor as pt

    offset, transformation = data.transformation
    coords = {"coefficient": list(data.coefficients), "row": np.arange(data.n_rows)}
    with pm.Model(coords=coords) as model:
        design = pm.Data("design_matrix", data.design_matrix, dims=("row", "coefficient"))
        response = pm.Data("observed_response", data.response, dims="row")
        given = {"dims": "coefficient", "transform": _coordinates(data, prior, errors)}
        scaled, variance = prior(data, given) if callable(prior) else _stated(data, prior, given)
        coefficients = pm.Deterministic("coefficients", offset + pt.dot(transformation, scaled), dims="coefficient")
        noise_variance = pm.Deterministic("noise_variance", data.response_scale**2 * variance)
        fit, given = pt.dot(design, coefficients), {"observed": response, "dims": "row"}
        if callable(errors):
            errors("response", fit, pt.sqrt(noise_variance), given)
        else:
            row_density("response", errors, law_parameter(errors), (fit, noise_variance), **given)
    return model


def _stated(data: RegressionData, prior: Prior, given: dict) -> tuple:
    """Scaled coefficients and noise variance under a prior of the package."""
    import pymc as pm
    import pytensor.tensor as pt

    variance = pm.InverseGamma("scaled_noise_variance", alpha=prior.shape, beta=prior.scale)
    spread = pt.sqrt(prior.coefficient_variance(variance, data.n_terms))
    return pm.Normal("scaled_coefficients", mu=prior.means(data.n_terms), sigma=spread, **given), variance


def _coordinates(data: RegressionData, prior: Prior | Callable, errors: str | Callable):
    """Coordinates of the scaled coefficients; for what is one's own those of the default prior and normal errors."""
    from pymc_ship.inference.sampling.linear_transform import LinearTransform

    known = ConjugatePrior() if callable(prior) else prior
    fit = plug_in(data, known, "normal" if callable(errors) else errors)
    return LinearTransform(fit.mean + fit.location @ fit.basis, (fit.spread[:, None] * fit.basis).T)
