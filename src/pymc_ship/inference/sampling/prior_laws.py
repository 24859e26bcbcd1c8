"""Horseshoe and R2-D2 priors on the scaled columns as functions ``prior(data, given)`` for ``pymc_model``.

sigma2 of the scaled response ~ IG(2, 1). ``functools.partial`` sets hyperparameters.
"""

import numpy as np
import pymc as pm

from pymc_ship.inference.regression.priors import check_data
from pymc_ship.inference.rows.data import RegressionData
from pymc_ship.inference.sampling.linear_coordinates import coefficients_from_fit
from pymc_ship.machine.arguments import check_kind, number_or_nan, short_repr
from pymc_ship.machine.errors import InferenceError


def _check_use(data: object, given: object, **positive: object) -> None:
    check_data(data)
    check_kind("given", given, dict, "give the keyword arguments of the coefficients", InferenceError)
    for name, value in positive.items():
        if not 0.0 < number_or_nan(value) < np.inf:
            raise InferenceError(f"{name} must be a positive number, found {short_repr(value)}; correct it.")
    if pm.Model.get_context(error_if_none=False) is None:
        raise InferenceError("A prior of a model is made inside it, found no model; give it to ps.pymc_model as prior.")


def horseshoe(data: RegressionData, given: dict, *, effective: float | None = None, slab: float = 10.0) -> tuple:
    """Regularised horseshoe: shrinks most coefficients towards zero.

    b_j ~ N(0, tau^2 l_j^2), l_j^2 = c^2 lambda_j^2 / (c^2 + tau^2 lambda_j^2), lambda_j ~ C+(0, 1),
    tau ~ C+(0, tau_0), c^2 ~ IG(2, 2 slab^2 sigma2), tau_0 = p_0 / (p - p_0) sigma / sqrt(n).

    Parameters
    ----------
    data : RegressionData
    given : dict
        Keyword arguments of the variable of the coefficients.
    effective : float, optional
        p_0, prior guess of the number of nonzero coefficients, in (0, n_terms); default n_terms / 2.
    slab : float, optional
        Scale of large coefficients, in units of sigma.

    Returns
    -------
    tuple of pytensor variables
        Scaled coefficients and noise variance on the scaled response.

    Raises
    ------
    InferenceError
        For ``effective`` outside (0, n_terms).

    References
    ----------
    Piironen & Vehtari (2017), Electronic Journal of Statistics 11(2):5018, doi:10.1214/17-EJS1337SI, Eq. 2.8, 3.12.
    """
    _check_use(data, given, slab=slab)
    sigma2 = pm.InverseGamma("scaled_noise_variance", 2.0, 1.0)
    expected = 0.5 * data.n_terms if effective is None else effective
    if not 0.0 < number_or_nan(expected) < data.n_terms:
        raise InferenceError(
            f"The effective number of coefficients lies between 0 and {data.n_terms}, the number of terms, found "
            f"{short_repr(expected)}; give one in between."
        )
    size = expected / (data.n_terms - expected) / data.n_rows**0.5
    tau = pm.HalfCauchy("global_scale", 1.0)
    local = pm.HalfCauchy("local_scale", 1.0, dims="coefficient")
    width = pm.InverseGamma("slab_variance", 2.0, 2.0) * slab**2
    shrunk = (size * tau * local) ** 2
    variance = sigma2 * width * shrunk / (width + shrunk)
    return coefficients_from_fit(0.0, pm.math.sqrt(variance), given), sigma2


def r2d2(
    data: RegressionData, given: dict, *, mean: float = 0.5, precision: float = 2.0, concentration: float = 0.5
) -> tuple:
    """R2-D2: a beta prior of the coefficient of determination.

    R2 ~ Beta(mean precision, (1 - mean) precision), phi ~ Dirichlet(concentration, ...),
    b_j ~ N(0, sigma2 phi_j R2/(1 - R2)).

    Parameters
    ----------
    data, given
        As :func:`horseshoe`, with the same result.
    mean, precision : float, optional
        Of R2.
    concentration : float, optional
        Of the Dirichlet distribution; below 1 few coefficients have most of R2.

    References
    ----------
    Zhang, Naughton, Bondell & Reich (2022), JASA 117(538):862, doi:10.1080/01621459.2020.1825449.
    """
    _check_use(data, given, mean=mean, precision=precision, concentration=concentration)
    sigma2 = pm.InverseGamma("scaled_noise_variance", 2.0, 1.0)
    explained = pm.Beta("r2", mean * precision, (1.0 - mean) * precision)
    phi = pm.Dirichlet("phi", np.full(data.n_terms, concentration), dims="coefficient")
    variance = sigma2 * phi * explained / (1.0 - explained)
    return coefficients_from_fit(0.0, pm.math.sqrt(variance), given), sigma2
