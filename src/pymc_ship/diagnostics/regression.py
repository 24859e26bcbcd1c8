"""Contraction, directions, residuals and predictive draws of the posterior of a regression."""

import json
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
import xarray as xr

from pymc_ship.diagnostics import posterior_statistics
from pymc_ship.diagnostics.posterior_statistics import CI_PROB, SD_LIMIT, TAILS, check_draws, has
from pymc_ship.inference.regression.families import prior_family
from pymc_ship.inference.regression.priors import Prior
from pymc_ship.inference.regression.tree import SAMPLE, drawn_coefficients
from pymc_ship.inference.rows.data import RegressionData
from pymc_ship.inference.sampling.error_laws import OWN, errors_of, known_errors_of, log_likelihood_group
from pymc_ship.inference.sampling.predictive import predictive, prior_draws
from pymc_ship.machine.errors import ShipError

if TYPE_CHECKING:
    from arviz_stats.utils import ELPDData

REQUIRED = {"coefficients": ("chain", "draw", "coefficient")}
_PREDICTIVE = ("prior", "prior_predictive", "posterior_predictive")  # groups of with_predictive
_NOISE = {"noise_variance": ("chain", "draw")}  # checked where a tree has it
_ATTRS = ("method", "dof", "vessel", "prior", "scaling")
_ROUNDING = 1e-6  # largest relative difference of equal log densities
_WIDTH_DRAWS, _RATIO_DRAWS = 20000, 400  # draws of the prior for the widths of sigma2, and for the predicted rms


def check_posterior(tree: xr.DataTree, name: str = "The tree") -> None:
    """Raise a ValueError that names what a tree lacks to be a posterior of a regression."""
    check_draws(tree, name, REQUIRED | (_NOISE if has(tree, "posterior/noise_variance") else {}), _ATTRS)
    drawn = drawn_coefficients(tree, name)
    for group in ("log_likelihood", "log_prior", "posterior_predictive", "sample_stats"):
        if group in tree.children and not _has_draws_of(drawn, tree[group].to_dataset()):
            raise ShipError(
                f"The groups of a posterior have one value a draw, found other chains or draws in {group} of {name}; "
                "select from or join the whole tree."
            )
    try:
        prior_of(tree)
        json.loads(tree.attrs["scaling"])["response_scale"]
    except (ValueError, KeyError, TypeError) as error:
        raise ShipError(f"{name} is no posterior of this package, its prior or scaling is broken: {error}.") from None
    wanted = ("log_likelihood/response", "observed_data/response", "constant_data/design_matrix")
    if all(has(tree, path) for path in (*wanted, "posterior/noise_variance")) and errors_of(tree) != OWN:
        _check_log_likelihood(tree, name)


def _check_log_likelihood(tree: xr.DataTree, name: str) -> None:
    """Raise ValueError for log densities that are not those of draws, response and design by the law of the errors."""
    tree = free_posterior(tree)
    few = tree["posterior"].to_dataset().isel(draw=slice(4))
    found = tree["log_likelihood"]["response"].isel(draw=slice(4)).transpose(*SAMPLE, "row").to_numpy()
    difference = found - log_likelihood_group(data_of(tree), errors_of(tree), few)["response"].to_numpy()
    if np.ptp(difference) > _ROUNDING * (1.0 + np.abs(found).max()):
        raise ShipError(
            f"The log_likelihood must be that of the draws, response and design_matrix of {name}, found other values "
            f"for {errors_of(tree)} errors; compute it anew, or leave the group out."
        )


def _has_draws_of(drawn: xr.Dataset, group: xr.Dataset) -> bool:
    """Whether a group has the chains and draws of another, which number from 0 where they have no coordinates."""
    return all(dim in group.dims and group.get_index(dim).equals(drawn.get_index(dim)) for dim in SAMPLE)


def fixed_of(tree: xr.DataTree) -> dict[str, float]:
    """Coefficients that :func:`pymc_ship.restore_fixed` added, with their values."""
    return json.loads(tree.attrs.get("fixed", "{}"))


def free_posterior(tree: xr.DataTree) -> xr.DataTree:
    """Posterior of the coefficients of the design in its order, without predictions that depend on fixed ones.

    The data of the tree are those of the free ones; a constant has neither convergence nor contraction.
    """
    fixed, names = fixed_of(tree), _design_names(tree)
    drawn = tree["posterior"].dataset["coefficient"].to_numpy().astype(str).tolist()
    if not fixed and names == drawn:
        return tree
    if others := {*names, *fixed} ^ {*drawn}:
        raise ShipError(
            f"A posterior has the coefficients of its design_matrix, found {', '.join(sorted(others))} in one of them; "
            "rename both."
        )
    groups = {name: node.to_dataset() for name, node in tree.children.items()}
    groups["posterior"] = groups["posterior"].sel(coefficient=names)
    if "prior" in groups and groups["prior"].sizes.get("coefficient") != groups["posterior"].sizes["coefficient"]:
        groups = {name: group for name, group in groups.items() if name not in _PREDICTIVE}
    return xr.DataTree.from_dict({"/": tree.to_dataset(), **groups})


def _design_names(tree: xr.DataTree) -> list[str]:
    """Names of the columns of a tree; those of the free coefficients where it has no design."""
    if has(tree, DESIGN[0]):
        return tree[DESIGN[0]]["coefficient"].to_numpy().astype(str).tolist()
    return [str(name) for name in tree["posterior"]["coefficient"].to_numpy() if name not in fixed_of(tree)]


DESIGN = ("constant_data/design_matrix", "observed_data/response")
"""Variables of a tree that its regression data are made from."""


def required_variables(tree: xr.DataTree, *wanted: str) -> tuple[str, ...]:
    """Variables of a subsection: regression data, noise variance and, for a model with its own prior, prior draws."""
    drawn = ("prior/coefficients", "prior/noise_variance") if prior_of(tree) is None else ()
    return (*DESIGN, "posterior/noise_variance", *drawn, *wanted)


def required_to_predict(tree: xr.DataTree) -> tuple[str, ...]:
    """Variables for predictions; of a model with its own prior or errors the predictions themselves."""
    if prior_of(tree) is None or errors_of(tree) == OWN:
        return (*DESIGN, "prior_predictive/response", "posterior_predictive/response")
    return required_variables(tree)


def required_for_likelihood(tree: xr.DataTree) -> tuple[str, ...]:
    """Variables for the log likelihood of the rows; of a model with its own errors the log likelihood itself."""
    if has(tree, "log_likelihood/response") or errors_of(tree) == OWN:
        return ("log_likelihood/response",)
    return (*DESIGN, "posterior/noise_variance")


def prior_of(tree: xr.DataTree) -> Prior | None:
    """Prior recorded in a posterior; None for a model with its own prior."""
    hyperparameters = json.loads(tree.attrs["prior"])
    if hyperparameters["family"] == OWN:
        return None
    return prior_family(hyperparameters.pop("family"))(**hyperparameters)


def data_of(tree: xr.DataTree) -> RegressionData:
    """Regression data of a posterior, from its constant_data, observed_data and scaling."""
    constant, scaling = tree["constant_data"].dataset, json.loads(tree.attrs["scaling"])
    names = [str(name) for name in tree["posterior"].dataset["coefficient"].values]
    data = RegressionData.from_arrays(
        constant["design_matrix"].transpose("row", "coefficient").values,
        tree["observed_data"].dataset["response"].values,
        names,
        scaling="none",
        time=constant["time"].values if "time" in constant else None,
        run=constant["run"].values if "run" in constant else None,
        dof=tree.attrs["dof"],
        vessel=tree.attrs["vessel"],
        **{name: tree.attrs[name] for name in ("record_verdict", "record_remarks") if name in tree.attrs},
    )
    return replace(
        data,
        column_center=np.array(scaling["column_center"], dtype=float),
        column_scale=np.array(scaling["column_scale"], dtype=float),
        response_center=float(scaling["response_center"]),
        response_scale=float(scaling["response_scale"]),
    )


def contraction(tree: xr.DataTree) -> xr.Dataset:
    """Contraction of each coefficient of a regression, on the original scale.

    A prior variance proportional to sigma2 is taken at the posterior mean of sigma2. For a model with its own prior it
    is the variance of a normal prior with the same central 95 %.
    """
    data, draws = data_of(tree), tree["posterior"].dataset["coefficients"]
    _, T = data.transformation
    variance = np.sum(T**2 * _prior_variance(tree, data), axis=1)
    prior_sd = xr.DataArray(np.sqrt(variance), {"coefficient": draws["coefficient"]}, ("coefficient",))
    return posterior_statistics.contraction(draws, prior_sd)


def _scaled_noise_variance(tree: xr.DataTree, data: RegressionData) -> float:
    return float(tree["posterior"].dataset["noise_variance"].mean()) / data.response_scale**2


def _prior_variance(tree: xr.DataTree, data: RegressionData) -> np.ndarray:
    """Prior variance of the scaled coefficients at the posterior mean of sigma2, shape (n_terms,)."""
    prior = prior_of(tree)
    if prior is not None:
        return prior.coefficient_variance(_scaled_noise_variance(tree, data), data.n_terms)
    draws = data.to_scaled(tree["prior"].dataset["coefficients"].values.reshape(-1, data.n_terms))
    return np.square(0.5 / SD_LIMIT * np.diff(np.quantile(draws, TAILS, axis=0), axis=0)[0])


def singular_directions(tree: xr.DataTree) -> list[dict]:
    """Directions of the scaled design from the weakest: ``singular_value``, ``data_precision``, ``direction``.

    The columns are multiplied by the prior sd. The data's share of the posterior precision along a direction of
    singular value s (of that design over sigma) is s^2/(s^2 + 1), at the posterior mean of sigma2.
    """
    data = data_of(tree)
    sigma2 = _scaled_noise_variance(tree, data)
    weighted = data.scaled_design_matrix * np.sqrt(_prior_variance(tree, data) / sigma2)
    _, s, right = np.linalg.svd(weighted, full_matrices=True)
    s = np.append(s, np.zeros(data.n_terms - s.size))
    rows = []
    for value, vector in zip(s[::-1], right[::-1], strict=True):
        text = posterior_statistics.loadings(vector, data.coefficients)
        rows.append(
            {"singular_value": float(value), "data_precision": float(value**2 / (value**2 + 1.0)), "direction": text}
        )
    return rows


def residuals(tree: xr.DataTree) -> xr.DataArray:
    """Response minus design times posterior mean, dims (row,), in order of time [s], run after run."""
    data = data_of(tree)
    fitted = data.design_matrix @ tree["posterior"].dataset["coefficients"].mean(("chain", "draw")).values
    return xr.DataArray(data.response - fitted, {"time": ("row", data.time)}, ("row",)).isel(row=data.order)


def loo_pit(tree: xr.DataTree, loo: "ELPDData") -> xr.Dataset:
    """Leave-one-out probability integral transform of the ``response`` (row); needs posterior_predictive.

    ``loo`` is the cross-validation of the same posterior.
    """
    import arviz as az

    smoothed = {name: xr.Dataset({"response": getattr(loo, name)}) for name in ("log_weights", "pareto_k")}
    return az.loo_pit(tree, var_names="response", pareto_pit=True, **smoothed)


def loo_pit_coverage(pit: xr.Dataset) -> list[float]:
    """Fraction of the rows inside the central leave-one-out intervals of 50 and 95 %."""
    distance = np.abs(pit["response"].values - 0.5)
    return [float(np.mean(distance <= 0.5 * probability)) for probability in (0.5, CI_PROB)]


def with_posterior_predictive(tree: xr.DataTree, rng: np.random.Generator) -> xr.DataTree:
    """The posterior with posterior_predictive, drawn from its draws and design where it has none."""
    if has(tree, "posterior_predictive/response"):
        return tree
    drawn = predictive(data_of(tree), tree["posterior"].to_dataset(), rng=rng, errors=known_errors_of(tree))
    return tree.assign(posterior_predictive=xr.DataTree(drawn))


def with_log_likelihood(tree: xr.DataTree) -> xr.DataTree:
    """The posterior with log_likelihood, from its draws and data where it has none."""
    if has(tree, "log_likelihood/response"):
        return tree
    group = log_likelihood_group(data_of(tree), known_errors_of(tree), tree["posterior"].to_dataset())
    return tree.assign(log_likelihood=xr.DataTree(group))


def prior_noise_variance(tree: xr.DataTree, draws: int, rng: np.random.Generator) -> np.ndarray:
    """Draws of sigma2 from the prior, on the scale of the original response; the stored ones of a model's own prior."""
    prior = prior_of(tree)
    if prior is None:
        return tree["prior"].dataset["noise_variance"].values.ravel()
    return json.loads(tree.attrs["scaling"])["response_scale"] ** 2 * prior.draw_noise_variance(rng, (draws,))


def noise_variance_widths(tree: xr.DataTree, rng: np.random.Generator) -> tuple[float, float]:
    """Widths of the central 95 % of log10 sigma2 under the prior and under the posterior."""
    both = prior_noise_variance(tree, _WIDTH_DRAWS, rng), tree["posterior"].dataset["noise_variance"].values
    prior, posterior = (float(np.diff(np.log10(np.quantile(values, TAILS)))[0]) for values in both)
    return prior, posterior


def prior_predictive_ratio(tree: xr.DataTree, rng: np.random.Generator) -> np.ndarray:
    """Root mean square of the response under prior draws over that of the record, 5, 50 and 95 %, shape (3,)."""
    data, errors, prior = data_of(tree), errors_of(tree), prior_of(tree)
    if prior is None or errors == OWN:
        response = tree["prior_predictive"].dataset["response"].values[0]
    else:
        parameters = prior_draws(data, prior, _RATIO_DRAWS, rng=rng, errors=errors)
        response = predictive(data, parameters, rng=rng, errors=errors)["response"].values[0]
    scaled = (response - data.response_center) / data.response_scale
    observed = np.sqrt(np.mean(data.scaled_response**2))
    return np.quantile(np.sqrt(np.mean(scaled**2, axis=1)) / observed, [0.05, 0.5, 0.95])
