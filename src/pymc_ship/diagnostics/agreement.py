"""z-scores of draws against the exact posterior, with one limit for all comparisons."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from statistics import NormalDist
from typing import Any

import numpy as np
import xarray as xr

from pymc_ship.diagnostics import posterior_statistics
from pymc_ship.diagnostics.posterior_statistics import R_HAT_LIMIT, convergence_diagnostics, missing, quantities
from pymc_ship.diagnostics.regression import DESIGN, data_of, free_posterior, prior_of
from pymc_ship.inference.regression.calibration import LEVEL
from pymc_ship.inference.regression.families import FAMILIES
from pymc_ship.inference.regression.priors import ExactPosterior
from pymc_ship.inference.regression.tree import SAMPLE, drawn_coefficients
from pymc_ship.inference.sampling.error_laws import errors_of
from pymc_ship.machine.arguments import short_repr
from pymc_ship.machine.errors import ShipError

PROBABILITIES = (0.05, 0.5, 0.95)  # probabilities of the quantiles compared


def agreement(exact: ExactPosterior, posteriors: Mapping[str, xr.DataTree]) -> xr.Dataset:
    """Compare draws with the exact posterior.

    A z-score is the error of an estimate over its Monte Carlo standard error; for a quantile, of the fraction of draws
    below it. The limit on every ``|z|`` is the two-sided normal quantile at ``LEVEL`` over the number of comparisons.

    Parameters
    ----------
    exact : NormalInverseGamma or NormalMixture
        From a prior's ``exact``, or anything with ``mean`` and ``sd``, shape (n_terms,), ``noise_variance_mean`` and
        ``noise_variance_sd``; quantiles are compared where it has ``quantiles`` and ``noise_variance_quantiles``.
    posteriors : mapping of str to DataTree
        Posteriors by the name of their method, from :func:`~pymc_ship.inference.regression.tree.draws_tree` or
        :func:`~pymc_ship.inference.sampling.from_pymc.posterior_tree`. The noise variance is compared where all
        have it.

    Returns
    -------
    Dataset
        Dims method, quantity (every coefficient and ``"noise_variance"``) and probability; select one method with
        ``table.sel({"method": "nuts"})``. ``exact_mean``, ``exact_sd``, ``exact_quantile``; ``mean``, ``sd``,
        ``mcse_mean``, ``mcse_sd``, ``ecdf``; ``z_mean``, ``z_sd``, ``z_quantile``; ``r_hat``, ``ess_bulk``,
        ``ess_tail``; per method ``divergences`` (NaN where unknown), ``largest_z`` and ``agrees``: every z within
        ``attrs["z_limit"]``, R-hat at most 1.01 and no divergence. ``attrs["verdict"]`` is the sentence on them; a
        single chain, whose R-hat is NaN, is not judged.

    Raises
    ------
    ValueError
        Without a posterior, for other coefficients than those of the exact posterior, or for errors that are not
        normal.

    References
    ----------
    Vehtari, Gelman, Simpson, Carpenter & Buerkner (2021), Bayesian Analysis 16(2):667, doi:10.1214/20-BA1221.

    Examples
    --------
    A Gibbs sampler against the exact posterior:

    >>> import numpy as np
    >>> import pymc_ship as ps
    >>> vessel, prior = ps.load_vessel("kvlcc2"), ps.SemiConjugatePrior()
    >>> trial = ps.simulate(vessel, ps.zigzag(20, 20), duration=600, step=0.5)
    >>> data = ps.regression_data(trial, vessel, "yaw", interval=2.0)
    >>> draws = ps.gibbs_posterior(data, prior, draws=500, rng=np.random.default_rng(1))
    >>> table = ps.agreement(prior.exact(data), {"gibbs": draws})
    >>> table["agrees"].sel({"method": "gibbs"}).item()
    True
    """
    if not (hasattr(exact, "mean") and hasattr(exact, "sd")):
        raise ShipError(f"exact must have mean and sd, found {short_repr(type(exact))}; take prior.exact(data).")
    names = _coefficient_names(exact, posteriors)
    has_noise = all("noise_variance" in tree["posterior"].dataset for tree in posteriors.values())
    exact_values = _exact_values(exact, [*names, *(["noise_variance"] if has_noise else [])])
    rows = [_compare(tree, exact_values) for tree in posteriors.values()]
    table = xr.concat(rows, xr.DataArray(list(posteriors), dims="method", name="method"))
    return _with_verdict(xr.merge([exact_values, table]))


def check_trees(what: str, trees: Mapping[str, xr.DataTree]) -> None:
    """Raise ValueError for anything else than a mapping of one posterior or more."""
    by_name = isinstance(trees, Mapping) and not isinstance(trees, xr.DataTree)
    if not by_name or not trees or not all(isinstance(tree, xr.DataTree) for tree in trees.values()):
        found = "none" if by_name and not trees else short_repr(trees)
        raise ShipError(f"{what} needs at least one posterior, found {found}; give trees by name.")


def _coefficient_names(exact: ExactPosterior, posteriors: Mapping[str, xr.DataTree]) -> list[str]:
    check_trees("An agreement", posteriors)
    drawn = {method: drawn_coefficients(tree, f"The posterior {method}") for method, tree in posteriors.items()}
    names_by_method = {method: list(one["coefficient"].values) for method, one in drawn.items()}
    names = list(getattr(exact, "coefficients", next(iter(names_by_method.values()))))
    for method, coefficients in names_by_method.items():
        if errors_of(posteriors[method]) != "normal":
            raise ShipError(
                "An agreement compares with the exact posterior, which is of normal errors, found "
                f"{errors_of(posteriors[method])} errors in "
                f"{method!r}; leave it out."
            )
        if coefficients != names or len(coefficients) != len(exact.mean):
            raise ShipError(
                f"All posteriors must hold the {len(exact.mean)} coefficients of the exact one in its order, found "
                f"{', '.join(coefficients)} in {method!r}; compare posteriors of the same data."
            )
    return names


def _exact_values(exact: ExactPosterior, quantities: list[str]) -> xr.Dataset:
    values: dict[str, tuple[Any, np.ndarray]] = {
        "exact_mean": ("quantity", np.append(exact.mean, exact.noise_variance_mean)[: len(quantities)]),
        "exact_sd": ("quantity", np.append(exact.sd, exact.noise_variance_sd)[: len(quantities)]),
    }
    coords: dict[str, Any] = {"quantity": quantities}
    if hasattr(exact, "quantiles") and hasattr(exact, "noise_variance_quantiles"):
        probabilities = np.array(PROBABILITIES)
        noise_quantiles = exact.noise_variance_quantiles(probabilities)
        quantiles = np.column_stack([exact.quantiles(probabilities), noise_quantiles])[:, : len(quantities)]
        values["exact_quantile"] = (("probability", "quantity"), quantiles)
        coords["probability"] = probabilities
    return xr.Dataset(values, coords)


@np.errstate(divide="ignore", invalid="ignore")
def _compare(tree: xr.DataTree, exact: xr.Dataset) -> xr.Dataset:
    """Estimates, z-scores and diagnostics of one posterior; z-scores are infinite or NaN for constant chains."""
    import arviz as az

    draws = quantities(tree).sel(quantity=exact["quantity"])
    moments = posterior_statistics.summary(tree).sel(quantity=exact["quantity"])
    values = dict(moments.drop_vars(("lower", "upper")).data_vars)
    values["z_mean"] = (values["mean"] - exact["exact_mean"]) / values["mcse_mean"]
    values["z_sd"] = (values["sd"] - exact["exact_sd"]) / values["mcse_sd"]
    if "exact_quantile" in exact:
        below = (draws < exact["exact_quantile"]).astype(float)
        values["ecdf"] = below.mean(SAMPLE)
        probability = exact["probability"]
        error = np.sqrt(probability * (1.0 - probability) / az.ess(below, method="mean"))
        values["z_quantile"] = (values["ecdf"] - probability) / error
    stats = tree["sample_stats"].dataset if "sample_stats" in tree.children else {}
    divergences = float(stats["diverging"].sum()) if "diverging" in stats else np.nan
    return xr.Dataset(values).assign(divergences=divergences)


def _with_verdict(table: xr.Dataset) -> xr.Dataset:
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
    table.attrs |= {"z_limit": limit, "level": LEVEL, "comparisons": z.size, "r_hat_limit": R_HAT_LIMIT}
    verdict = "; ".join(_verdict_text(table.isel(method=k)) for k in range(table.sizes["method"]))
    return table.assign_attrs(verdict=f"{verdict}; limit {limit:.2f}")


def _judgement(one: xr.Dataset) -> str:
    """``DISAGREES`` of a method, unless it agrees or nothing but the missing R-hat of a single chain is against it."""
    if one["agrees"]:
        return "agrees"
    sound = one["largest_z"] <= one.attrs["z_limit"] and not one["divergences"] > 0
    return "is not judged" if sound and one["r_hat"].isnull().all() else "DISAGREES"


def _verdict_text(one: xr.Dataset) -> str:
    r_hat, count = float(one["r_hat"].max(skipna=False)), float(one["divergences"])
    mixing = "R-hat needs two chains that vary" if np.isnan(r_hat) else f"largest R-hat {r_hat:.4f}"
    counted = "" if np.isnan(count) else f", divergences {count:.0f}"
    numbers = f"largest |z| {float(one['largest_z']):.1f}, {mixing}{counted}"
    return f"{one['method'].item()} {_judgement(one)} ({numbers})"


@dataclass(frozen=True)
class Comparison:
    """One posterior by one or more methods, ``trees`` by method; the first is reported (the exact one, if given).

    ``agreement`` of the other methods with it is from :func:`agreement`.
    """

    name: str
    trees: Mapping[str, xr.DataTree]
    agreement: xr.Dataset | None = None

    @property
    def posterior(self) -> xr.DataTree:
        """The draws whose posterior is reported."""
        return next(iter(self.trees.values()))

    @property
    def sampler(self) -> str:
        """Method whose chains are reported: the last with ``sample_stats``, otherwise the last."""
        return max(reversed([*self.trees]), key=lambda method: "sample_stats" in self.trees[method].children)

    @cached_property
    def convergence_diagnostics(self) -> dict[str, list[dict]]:
        """Convergence diagnostics of every method."""
        return {method: convergence_diagnostics(tree) for method, tree in self.trees.items()}

    @property
    def failed_diagnostics(self) -> list[str]:
        """Sentences on the convergence diagnostics that fail."""
        return [
            f"{f'{method}: ' if len(self.trees) > 1 else ''}{row['diagnostic']} {_value(row['value'])} "
            f"({row['where']}), to be {row['limit']}"
            for method, rows in self.convergence_diagnostics.items()
            for row in rows
            if not row["passes"]
        ]

    @property
    def disagreements(self) -> list[str]:
        """Sentences on the methods that disagree with the exact posterior."""
        if self.agreement is None:
            return []
        methods = (self.agreement.isel(method=k) for k in range(self.agreement.sizes["method"]))
        return [_verdict_text(one) for one in methods if _judgement(one) == "DISAGREES"]


def _value(value: float) -> str:
    return f"{value:.4g}" if np.isfinite(value) else "not finite"


def comparisons(trees: Mapping[str, xr.DataTree]) -> list[Comparison]:
    """Posteriors by name, grouped with the exact posterior of the same data and prior where it is given.

    Without the coefficients that were fixed, see :func:`.free_posterior`.
    """
    trees = {name: free_posterior(tree) for name, tree in trees.items()}
    exact = [name for name, tree in trees.items() if tree.attrs["method"] in FAMILIES]
    groups: dict[str, list[str]] = {}
    for name, tree in trees.items():
        same = (other for other in exact if name not in exact and _same_posterior(trees[other], tree))
        groups.setdefault(next(same, name), []).append(name)
    return [
        _comparison({name: trees[name] for name in dict.fromkeys([first, *rest])}) for first, rest in groups.items()
    ]


def _same_posterior(exact: xr.DataTree, other: xr.DataTree) -> bool:
    if errors_of(other) != "normal" or missing(exact, *DESIGN) or missing(other, *DESIGN):
        return False
    labels = all(exact.attrs[key] == other.attrs[key] for key in ("vessel", "dof", "prior", "scaling"))
    names = [tree["posterior"].dataset["coefficient"].values.tolist() for tree in (exact, other)]
    data = all(exact[group].dataset.equals(other[group].dataset) for group in ("constant_data", "observed_data"))
    return labels and names[0] == names[1] and data


def _comparison(trees: Mapping[str, xr.DataTree]) -> Comparison:
    name = ", ".join(trees)
    if len(trees) == 1:
        return Comparison(name, trees)
    first, *rest = trees.values()
    methods = ["exact", *(tree.attrs["method"] for tree in rest)]
    labels = methods if len(set(methods)) == len(methods) else list(trees)
    prior = prior_of(first)
    others = dict(zip(labels[1:], rest, strict=True))
    compared = None if prior is None else agreement(prior.exact(data_of(first)), others)
    return Comparison(name, dict(zip(labels, trees.values(), strict=True)), compared)


def failure_sentence(compared: Sequence[Comparison]) -> str:
    """Sentence on the first convergence diagnostic or agreement that fails; empty where none does."""
    faults = [(one.name, [*one.failed_diagnostics, *one.disagreements]) for one in compared]
    failed = [f"{name}: {'; '.join(faults)}" for name, faults in faults if faults]
    if not failed:
        return ""
    return (
        f"A convergence diagnostic or the agreement with the exact posterior fails in {len(failed)} of {len(compared)} "
        f"posteriors, first in {failed[0]}; the page is written and names them all."
    )
