"""Regression on draws of a denoised trial: what its uncertainty adds to the intervals of the coefficients."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import xarray as xr

from pymc_ship.regression.data import RegressionData, RegressionDataError, regression_data
from pymc_ship.regression.priors import Prior
from pymc_ship.vessel.vessel import Vessel

CI_PROB = 0.9
"""Probability of the pooled intervals."""


def regression_draws(
    drawn: xr.Dataset, vessel: Vessel, dof: str, *, interval: float | None = None, derivative: str = "euler"
) -> list[RegressionData]:
    """Design matrix and response of one degree of freedom for each draw of a denoised trial.

    Parameters
    ----------
    drawn : Dataset, dims (draw, time)
        From :func:`pymc_ship.denoise_draws`.
    vessel, dof, interval, derivative
        As for :func:`pymc_ship.regression_data`.

    Returns
    -------
    list of RegressionData
        One for each draw, scaled by itself.

    Raises
    ------
    RegressionDataError
        For a trial without draws, and as :func:`pymc_ship.regression_data`.
    """
    if "draw" not in drawn.dims:
        raise RegressionDataError(
            "Regression draws need a trial with the dimension draw, found none; make it by `denoise_draws`."
        )
    settings = {"interval": interval, "derivative": derivative}
    return [regression_data(drawn.isel(draw=k, drop=True), vessel, dof, **settings) for k in range(drawn.sizes["draw"])]


def pooled_coefficients(
    rows: Sequence[RegressionData], prior: Prior, *, draws: int = 4000, rng: np.random.Generator
) -> xr.Dataset:
    """Coefficients under the mixture of the posteriors of every draw of the rows, as in multiple imputation.

    Parameters
    ----------
    rows : sequence of RegressionData
        The same regression on draws of its data, from :func:`regression_draws`; at least two.
    prior : Prior
        Of the scaled coefficients, the same for all.
    draws : int, optional
        From the mixture, for its quantiles; shared evenly.
    rng : numpy.random.Generator

    Returns
    -------
    Dataset, dims (coefficient,)
        ``mean``; ``within_sd``, the posterior's where the rows are taken as known, ``between_sd`` of the means over the
        draws, and ``sd`` of both by Rubin's rule, within^2 + (1 + 1/m) between^2 for m draws; ``lower`` and ``upper``,
        the equal-tailed interval of 90 % of the mixture. Original scale.

    Raises
    ------
    RegressionDataError
        For fewer than two draws, or rows of different coefficients.

    References
    ----------
    Rubin (1987), Multiple Imputation for Nonresponse in Surveys, doi:10.1002/9780470316696.

    Examples
    --------
    The rudder coefficients of yaw, with the rows taken as known and as drawn:

    >>> import numpy as np
    >>> import pymc_ship as ps
    >>> vessel, rng = ps.load_vessel("kvlcc2"), np.random.default_rng(1)
    >>> trial = ps.simulate(vessel, ps.zigzag(20, 20), duration=600, step=0.5)
    >>> drawn = ps.denoise_draws(ps.pollute(trial, level=0.01, rng=rng), draws=20, rng=rng)
    >>> rows = ps.regression_draws(drawn, vessel, "yaw", interval=2.0)
    >>> prior, _ = ps.maximise_evidence(rows[0])
    >>> found = ps.pooled_coefficients(rows, prior, rng=rng).sel(coefficient="Ngdelta")
    >>> print(f"{1e5 * found['mean']:.0f}, sd {1e5 * found['within_sd']:.1f} and {1e5 * found['sd']:.1f}")
    -197, sd 4.9 and 6.7
    """
    names = {data.coefficients for data in rows}
    if len(rows) < 2 or len(names) > 1:
        raise RegressionDataError(
            f"Pooling needs two or more draws of one regression, found {len(rows)} with {len(names)} sets of "
            "coefficients; draw again."
        )
    exact = [prior.exact(data) for data in rows]
    mean = np.mean([one.mean for one in exact], axis=0)
    within = np.mean([one.sd**2 for one in exact], axis=0)
    between = np.var([one.mean for one in exact], axis=0, ddof=1)
    sample = np.concatenate([one.draw(-(-draws // len(exact)), rng)[0] for one in exact])
    lower, upper = np.quantile(sample, [0.5 - 0.5 * CI_PROB, 0.5 + 0.5 * CI_PROB], axis=0)
    found = {
        "mean": mean,
        "within_sd": np.sqrt(within),
        "between_sd": np.sqrt(between),
        "sd": np.sqrt(within + (1.0 + 1.0 / len(exact)) * between),
        "lower": lower,
        "upper": upper,
    }
    coefficients = {"coefficient": list(rows[0].coefficients)}
    return xr.Dataset({name: ("coefficient", values) for name, values in found.items()}, coefficients)
