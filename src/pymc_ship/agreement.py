"""Do draws agree with the exact posterior? z-scores of their means, spreads and quantiles, with one limit for all."""

from __future__ import annotations

from collections.abc import Mapping
from statistics import NormalDist
from typing import Protocol

import numpy as np
import xarray as xr

PROBABILITIES = (0.05, 0.5, 0.95)
"""Probabilities of the quantiles compared."""

LEVEL = 1e-3
"""Chance that one of all the comparisons of a table exceeds its limit when every chain is right."""

R_HAT_LIMIT = 1.01
"""Largest R-hat of chains that have mixed (Vehtari et al. 2021)."""

_SAMPLE = ("chain", "draw")


class ExactPosterior(Protocol):
    """What an exact posterior offers on the original scale; quantiles where it has them."""

    mean: np.ndarray
    sd: np.ndarray
    noise_variance_mean: float
    noise_variance_sd: float


def agreement(exact: ExactPosterior, posteriors: Mapping[str, xr.DataTree]) -> xr.Dataset:
    """Compare draws with the exact posterior of the same data and prior.

    A z-score is the error of an estimate over its Monte Carlo standard error, estimated from the chains. For a
    quantile it is the share of draws below the exact one against its probability, which needs no density. The limit
    on every |z| is the two-sided normal quantile at ``LEVEL`` over the number of comparisons; the normal law behind
    it asks for some hundred effective draws.

    Parameters
    ----------
    exact : NormalInverseGamma or NormalMixture
        From :func:`~pymc_ship.conjugate.conjugate` or :func:`~pymc_ship.semiconjugate.semiconjugate`; anything with
        ``mean`` and ``sd``, shape (n_terms,), ``noise_variance_mean`` and ``noise_variance_sd``. Quantiles are
        compared where it has ``quantiles`` and ``noise_variance_quantiles``.
    posteriors : mapping of str to DataTree
        Posteriors by the name of their method, laid out by :func:`~pymc_ship.posterior.posterior_tree`.

    Returns
    -------
    Dataset
        Dims method, quantity (every coefficient and ``"noise_variance"``) and probability; as ``sel`` of xarray has an
        argument of that name, one method is ``table.sel({"method": "nuts"})``. ``exact_mean``,
        ``exact_sd``, ``exact_quantile``; ``mean``, ``sd``, ``mcse_mean``, ``mcse_sd``, ``share_below``; ``z_mean``,
        ``z_sd``, ``z_quantile``; ``r_hat``, ``ess_bulk``, ``ess_tail``; per method ``divergences`` (NaN for a sampler
        that knows none), ``largest_z`` and ``agrees``: every z within ``attrs["z_limit"]``, R-hat at most 1.01 and no
        divergence. ``attrs["verdict"]`` says it in words.

    Raises
    ------
    ValueError
        When there is no posterior, or one holds other coefficients than the rest or the exact posterior.

    References
    ----------
    Vehtari, Gelman, Simpson, Carpenter & Buerkner (2021), Bayesian Analysis 16(2):667, doi:10.1214/20-BA1221.
    """
    names = _coefficient_names(exact, posteriors)
    exact_values = _exact_values(exact, [*names, "noise_variance"])
    rows = [_compare(tree, exact_values) for tree in posteriors.values()]
    table = xr.concat(rows, xr.DataArray(list(posteriors), dims="method", name="method"))
    return _judge(xr.merge([exact_values, table]))


def _coefficient_names(exact: ExactPosterior, posteriors: Mapping[str, xr.DataTree]) -> list[str]:
    if not posteriors:
        raise ValueError("An agreement needs at least one posterior, found none; give draws by the name of the method.")
    found = {method: list(tree["posterior"]["coefficient"].values) for method, tree in posteriors.items()}
    names = list(getattr(exact, "coefficients", next(iter(found.values()))))
    for method, given in found.items():
        if given != names or len(given) != len(exact.mean):
            raise ValueError(
                f"All posteriors must hold the {len(exact.mean)} coefficients of the exact one in its order, found "
                f"{', '.join(given)} in {method!r}; compare posteriors of the same data."
            )
    return names


def _exact_values(exact: ExactPosterior, quantities: list[str]) -> xr.Dataset:
    values = {
        "exact_mean": ("quantity", np.append(exact.mean, exact.noise_variance_mean)),
        "exact_sd": ("quantity", np.append(exact.sd, exact.noise_variance_sd)),
    }
    coords = {"quantity": quantities}
    if hasattr(exact, "quantiles") and hasattr(exact, "noise_variance_quantiles"):
        probabilities = np.array(PROBABILITIES)
        of_noise = exact.noise_variance_quantiles(probabilities)
        quantiles = np.column_stack([exact.quantiles(probabilities), of_noise])
        values["exact_quantile"] = (("probability", "quantity"), quantiles)
        coords["probability"] = probabilities
    return xr.Dataset(values, coords)


@np.errstate(divide="ignore", invalid="ignore")
def _compare(tree: xr.DataTree, exact: xr.Dataset) -> xr.Dataset:
    """Estimates, z-scores and diagnostics of one posterior; a chain that stands still has z-scores infinite or NaN."""
    import arviz as az

    posterior = tree["posterior"].dataset
    noise_variance = posterior["noise_variance"].expand_dims(coefficient=["noise_variance"])
    draws = xr.concat([posterior["coefficients"], noise_variance], "coefficient").rename(coefficient="quantity")
    values = {
        "mean": draws.mean(_SAMPLE),
        "sd": draws.std(_SAMPLE, ddof=1),
        "mcse_mean": az.mcse(draws, method="mean"),
        "mcse_sd": az.mcse(draws, method="sd"),
        "r_hat": az.rhat(draws),
        "ess_bulk": az.ess(draws, method="bulk"),
        "ess_tail": az.ess(draws, method="tail"),
    }
    values["z_mean"] = (values["mean"] - exact["exact_mean"]) / values["mcse_mean"]
    values["z_sd"] = (values["sd"] - exact["exact_sd"]) / values["mcse_sd"]
    if "exact_quantile" in exact:
        below = (draws < exact["exact_quantile"]).astype(float)
        values["share_below"] = below.mean(_SAMPLE)
        probability = exact["probability"]
        error = np.sqrt(probability * (1.0 - probability) / az.ess(below, method="mean"))
        values["z_quantile"] = (values["share_below"] - probability) / error
    stats = tree["sample_stats"].dataset if "sample_stats" in tree.children else {}
    values["divergences"] = float(stats["diverging"].sum()) if "diverging" in stats else np.nan
    return xr.Dataset(values)


def _judge(table: xr.Dataset) -> xr.Dataset:
    """Limit and verdict over all the comparisons of a table; a z-score that is NaN fails."""
    scores = [table[name].stack(comparison=["quantity"]) for name in ("z_mean", "z_sd")]
    if "z_quantile" in table:
        scores.append(table["z_quantile"].stack(comparison=["quantity", "probability"]))
    z = np.concatenate([np.abs(score.transpose("method", "comparison").to_numpy()) for score in scores], axis=1)
    limit = NormalDist().inv_cdf(1.0 - 0.5 * LEVEL / z.size)
    largest = np.where(np.isnan(z).any(axis=1), np.nan, z.max(axis=1))
    r_hat = table["r_hat"].max("quantity", skipna=False)
    agrees = (largest <= limit) & (r_hat <= R_HAT_LIMIT) & ~(table["divergences"] > 0)
    table = table.assign(largest_z=("method", largest), agrees=agrees)
    verdict = "; ".join(
        f"{method} {'agrees' if table['agrees'].values[k] else 'DISAGREES'} (largest |z| {largest[k]:.1f}, "
        f"largest R-hat {r_hat.values[k]:.4f}, divergences {table['divergences'].values[k]:.0f})"
        for k, method in enumerate(table["method"].values)
    )
    return table.assign_attrs(
        z_limit=limit, level=LEVEL, comparisons=z.size, r_hat_limit=R_HAT_LIMIT, verdict=f"{verdict}; limit {limit:.2f}"
    )
