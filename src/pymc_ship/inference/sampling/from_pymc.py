"""Posterior tree of a custom PyMC model."""

import logging
from typing import TYPE_CHECKING

import numpy as np
import xarray as xr

from pymc_ship.inference.regression.priors import Prior, check_data, check_prior
from pymc_ship.inference.regression.tree import SAMPLE, data_groups, rng_state, tree_attrs
from pymc_ship.inference.rows.data import RegressionData
from pymc_ship.inference.sampling.error_laws import OWN, law_of_draws
from pymc_ship.inference.sampling.predictive import PREDICTIVE_DRAWS, is_equal, prior_draws
from pymc_ship.machine.arguments import check_kind
from pymc_ship.machine.errors import InferenceError, ShipError
from pymc_ship.machine.seeds import Seed, random_generator

if TYPE_CHECKING:
    import pymc as pm

_DATA = ("observed_data", "constant_data")
_BY_ROW = ("log_likelihood", "prior_predictive", "posterior_predictive")
_FEWEST, _COMPARED, _OTHER_WIDTH = 200, 4000, 1.5  # least draws of a model, those of a prior, ratio of other widths
_COPIED_GROUPS = ("posterior", "sample_stats", "log_prior", "prior", *_BY_ROW)


def posterior_tree(
    sampled: xr.DataTree,
    data: RegressionData,
    model: "pm.Model | None" = None,
    *,
    prior: Prior | None = None,
    rng: Seed | None = None,
) -> xr.DataTree:
    """Posterior tree of the draws of a custom PyMC model.

    Parameters
    ----------
    sampled : DataTree
        As ``pm.sample`` returns it. Its posterior has ``coefficients`` on the original scale or
        ``scaled_coefficients``, with dims chain, draw and one more, with the names of the data or in their order; and
        ``noise_variance`` or ``scaled_noise_variance``, if the model has one. Other variables and the groups of ArviZ
        are copied.
    data : RegressionData
        Data of the fit.
    model : pymc.Model, optional
        Computes missing log densities and predictive groups. Its one observed variable becomes ``response``.
    prior : Prior, optional
        Give it if the model has exactly this prior, to compare draws with the exact posterior. The widths of the group
        prior are compared with it, if there is one.
    rng : int, SeedSequence or Generator, optional
        Required with a model, for predictive draws.

    Returns
    -------
    DataTree
        As :func:`~pymc_ship.inference.regression.tree.draws_tree`, with the groups of ``sampled`` or the model;
        attr ``method`` is ``nuts`` for any sampler, attr ``errors`` the law of the errors by the log likelihood, "own"
        if it is none of the package or there is none.

    Raises
    ------
    ValueError
        For a tree or a model without the coefficients, rows, response or ``design_matrix`` of the data, a model with
        several observed variables, or a model without ``rng``; for a prior of other widths than that of the model.
    """
    rng = None if rng is None else random_generator(rng)
    check_data(data)
    if prior is not None:
        check_prior(prior, data)
    check_kind("The draws", sampled, xr.DataTree, "give what pm.sample returns", InferenceError)
    groups = {name: node.to_dataset() for name, node in sampled.children.items() if name in _COPIED_GROUPS}
    groups["posterior"] = _posterior(groups.get("posterior", xr.Dataset()), data)
    labels = _row_labels(sampled, data)
    if labels is None:
        _check_order(groups, data)
    groups = {name: _named_rows(group, name, data, labels) for name, group in groups.items()}
    state = "" if rng is None else rng_state(rng)
    if model is not None:
        if rng is None:
            raise ShipError("Predictive draws of a model need a generator, found none; give rng.")
        computed = _from_model(groups, model, data, int(rng.integers(2**31)))
        groups = {name: _named_rows(group, name, data, None) for name, group in computed.items()} | groups
        groups = {name: _posterior(group, data) if name == "prior" else group for name, group in groups.items()}
    if prior is not None and "coefficients" in groups.get("prior", ()):
        _check_prior_draws(groups["prior"]["coefficients"], prior, data)
    hyperparameters = {"family": OWN} if prior is None else prior.hyperparameters()
    root = xr.Dataset(attrs=tree_attrs(data, hyperparameters, "nuts", state))
    if "noise_variance" in groups["posterior"]:
        root.attrs["errors"] = law_of_draws(data, groups["posterior"], groups.get("log_likelihood", xr.Dataset()))
    return xr.DataTree.from_dict({"/": root, **groups, **data_groups(data)})


def _check_prior_draws(drawn: xr.DataArray, prior: Prior, data: RegressionData) -> None:
    """Raise ValueError for prior draws of a model that are wider or narrower than the prior."""
    given = prior_draws(data, prior, _COMPARED, rng=np.random.default_rng(0))["coefficients"].to_numpy()
    found = drawn.transpose(*SAMPLE, ...).to_numpy().reshape(-1, drawn.shape[-1])
    if len(found) < _FEWEST or found.shape[1] != data.n_terms:
        return
    widths = [np.subtract(*np.quantile(draws, [0.75, 0.25], axis=0)) for draws in (found, given[0])]
    ratio = widths[0] / widths[1]
    k = int(np.argmax(np.abs(np.log(np.maximum(ratio, 1e-300)))))
    if not 1.0 / _OTHER_WIDTH < ratio[k] < _OTHER_WIDTH:
        raise ShipError(
            f"The prior must be that of the model, found draws of {data.coefficients[k]} {ratio[k]:.2g} times as wide; "
            "sigma of PyMC is a standard deviation, no variance or precision, and of scaled_coefficients: correct the "
            "model, or give its prior."
        )


def _posterior(group: xr.Dataset, data: RegressionData) -> xr.Dataset:
    """Group with ``coefficients`` and, if there, ``noise_variance`` on the original scale."""
    variable = next((name for name in ("coefficients", "scaled_coefficients") if name in group), None)
    if variable is None or group[variable].ndim != 3 or group[variable].shape[-1] != data.n_terms:
        raise ShipError(
            f"The posterior must have 'coefficients' with dims chain, draw and {data.n_terms} terms, found "
            f"{', '.join(map(str, group.data_vars)) or 'no variable'}; add pm.Deterministic('coefficients', ...)."
        )
    names, dim = list(data.coefficients), group[variable].transpose(*SAMPLE, ...).dims[-1]
    labels, positions = [str(name) for name in group[dim].values], [str(k) for k in range(data.n_terms)]
    counted = labels == positions and group[dim].dtype.kind in "iu"  # PyMC counts terms without names
    if sorted(labels) == sorted(names) and (names == labels or not counted):
        group = group.isel({dim: [labels.index(name) for name in names]})
    elif labels != positions or sorted(labels) == sorted(names):
        raise ShipError(
            f"The posterior must have the coefficients of the data, {', '.join(names)}, found {', '.join(labels)}; "
            "give the data that the model was fitted to, or its names to the model."
        )
    draws = group[variable].transpose(*SAMPLE, dim).to_numpy()
    values = draws if variable == "coefficients" else data.to_original(draws)
    renamed = group.rename({} if dim == "coefficient" else {dim: "coefficient"}).assign_coords(coefficient=names)
    if "noise_variance" not in renamed and "scaled_noise_variance" in renamed:
        renamed = renamed.assign(noise_variance=data.response_scale**2 * renamed["scaled_noise_variance"])
    return renamed.assign(coefficients=((*SAMPLE, "coefficient"), values))


def _row_labels(sampled: xr.DataTree, data: RegressionData) -> np.ndarray | None:
    """Labels of the rows of the data by the observed_data; ValueError unless a tree is of these data."""
    groups = {name: sampled[name].dataset if name in sampled.children else xr.Dataset() for name in _DATA}
    observed, constants = groups.values()
    if "design_matrix" in constants:
        _check_design(constants["design_matrix"].to_numpy(), data)
    if len(observed.data_vars) != 1:
        return None
    name, values = next(iter(observed.items()))
    _check_response(str(name), values.to_numpy(), data)
    return values[values.dims[0]].to_numpy() if values.ndim == 1 else None


def _check_order(groups: dict[str, xr.Dataset], data: RegressionData) -> None:
    """Raise ValueError for rows numbered in another order, which may be numbers of the data or of a user's table."""
    for name in set(_BY_ROW) & set(groups):
        for dim in set(groups[name].dims) - set(SAMPLE):
            found, rows = groups[name][dim].to_numpy(), np.arange(data.n_rows)
            if not np.array_equal(found, rows) and np.array_equal(np.sort(found), rows):
                raise ShipError(
                    f"Rows in the order of the data are numbered from 0 up, found another order in {name} and no "
                    "observed_data that shows it; give the observed_data of pm.sample, or sort the rows."
                )


def _check_response(name: str, observed: np.ndarray, data: RegressionData) -> None:
    """Raise ValueError unless observed values are the response, on a scale of any unit and centre."""
    y = observed.ravel().astype(float)
    if y.size == data.n_rows:
        line, response = np.column_stack([np.ones(y.size), y]), data.response
        residual = response - line @ np.linalg.lstsq(line, response)[0]
        if np.abs(residual).max() <= 1e-6 * np.ptp(response) + 1e-12 * np.abs(response).max():
            return
    raise ShipError(
        f"The observed variable {name} must be the response of the data, found {y.size} other values; give the "
        "data that the model was fitted to."
    )


def _check_design(found: np.ndarray, data: RegressionData) -> None:
    if not any(is_equal(design, found) for design in (data.design_matrix, data.scaled_design_matrix)):
        raise ShipError(
            "The design_matrix must be that of the data, as given or scaled, found another one; give the data that "
            "the model was fitted to."
        )


def _from_model(
    groups: dict[str, xr.Dataset], model: "pm.Model", data: RegressionData, seed: int
) -> dict[str, xr.Dataset]:
    import pymc as pm

    observed = [variable.name for variable in model.observed_RVs]
    if len(observed) != 1:
        raise ShipError(
            f"A regression has one observed variable, found {', '.join(observed) or 'none'}; give the groups of such a "
            "model in the tree and omit the model."
        )
    _check_response(observed[0], model.rvs_to_values[model.observed_RVs[0]].eval(mode="FAST_COMPILE"), data)
    if "design_matrix" in {variable.name for variable in model.data_vars}:
        _check_design(model["design_matrix"].get_value(), data)
    draws = xr.DataTree.from_dict({"posterior": groups["posterior"]})
    fast_compile = {"compile_kwargs": {"mode": "FAST_COMPILE"}}  # compiling takes a minute and saves seconds
    options, log = fast_compile | {"progressbar": False}, logging.getLogger("pymc")
    level = log.level
    log.setLevel(logging.WARNING)  # without the messages of sampling
    try:
        with model:
            likelihood = pm.stats.compute_log_likelihood(draws, extend_inferencedata=False, **options)
            prior = pm.stats.compute_log_prior(draws, extend_inferencedata=False, **options)
            predictive = pm.sample_posterior_predictive(draws, var_names=observed, random_seed=seed, **options)
            from_prior = pm.sample_prior_predictive(PREDICTIVE_DRAWS, random_seed=seed + 1, **fast_compile)
    finally:
        log.setLevel(level)
    drawn = {"posterior_predictive": predictive, "prior": from_prior, "prior_predictive": from_prior}
    groups_of_draws = {name: tree[name].to_dataset() for name, tree in drawn.items()}
    return {"log_likelihood": likelihood, "log_prior": prior, **groups_of_draws}


def _named_rows(group: xr.Dataset, name: str, data: RegressionData, labels: np.ndarray | None) -> xr.Dataset:
    """Group of values by row, in the order of the data, with its one variable renamed ``response``.

    ``labels`` are those of the rows of the data, if other than the order of the group is known.
    """
    if name not in _BY_ROW or len(group.data_vars) != 1:
        return group
    values = next(iter(group.data_vars.values())).transpose(*SAMPLE, ...)
    if values.ndim != 3 or values.shape[-1] != data.n_rows:
        raise ShipError(
            f"The group {name} has one value for each chain, draw and row, found shape {values.shape} for "
            f"{data.n_rows} rows; give the data that the model was fitted to."
        )
    rows, dim = np.arange(data.n_rows), values.dims[-1]
    found = values[dim].to_numpy()
    if labels is not None and not np.array_equal(found, labels) and sorted(found) == sorted(labels):
        values = values.isel({dim: np.argsort(found)[np.argsort(np.argsort(labels))]})
    coords = {dim: group[dim].values for dim in SAMPLE} | {"row": rows}
    return xr.Dataset({"response": ((*SAMPLE, "row"), values.to_numpy())}, coords)
