"""Posterior tree of a custom PyMC model."""

from __future__ import annotations

import logging
from typing import TYPE_CHECKING

import numpy as np
import xarray as xr

from pymc_ship.inference.regression.priors import Prior, check_prior
from pymc_ship.inference.regression.tree import data_groups, rng_state, tree_attrs
from pymc_ship.inference.rows.data import RegressionData
from pymc_ship.inference.sampling.predictive import PREDICTIVE_DRAWS
from pymc_ship.machine.seeds import Seed, random_generator

if TYPE_CHECKING:
    import pymc as pm

OWN = "own"  # family of a prior that the package does not know
_SAMPLE = ("chain", "draw")
_BY_ROW = ("log_likelihood", "prior_predictive", "posterior_predictive")
_COPIED_GROUPS = ("posterior", "sample_stats", "log_prior", "prior", *_BY_ROW)


def posterior_tree(
    sampled: xr.DataTree,
    data: RegressionData,
    model: pm.Model | None = None,
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
        Give it if the model has exactly this prior (not checked), to compare draws with the exact posterior.
    rng : int, SeedSequence or Generator, optional
        Required with a model, for predictive draws.

    Returns
    -------
    DataTree
        As :func:`~pymc_ship.inference.regression.tree.draws_tree`, with the groups of ``sampled`` or the model;
        attr ``method`` is ``nuts`` for any sampler.

    Raises
    ------
    ValueError
        For a tree without the coefficients, rows or response of the data, a model with several observed variables, or
        a model without ``rng``.
    """
    rng = None if rng is None else random_generator(rng)
    if prior is not None:
        check_prior(prior)
    groups = {name: node.to_dataset() for name, node in sampled.children.items() if name in _COPIED_GROUPS}
    groups["posterior"] = _posterior(groups.get("posterior", xr.Dataset()), data)
    _check_response(sampled, data)
    state = "" if rng is None else rng_state(rng)
    if model is not None:
        if rng is None:
            raise ValueError("Predictive draws of a model need a generator, found none; give rng.")
        groups = _from_model(groups, model, int(rng.integers(2**31))) | groups
        groups = {name: _posterior(group, data) if name == "prior" else group for name, group in groups.items()}
    groups = {name: _named_rows(group, name, data) for name, group in groups.items()}
    hyperparameters = {"family": OWN} if prior is None else prior.hyperparameters()
    root = xr.Dataset(attrs=tree_attrs(data, hyperparameters, "nuts", state))
    return xr.DataTree.from_dict({"/": root, **groups, **data_groups(data)})


def _posterior(group: xr.Dataset, data: RegressionData) -> xr.Dataset:
    """Group with ``coefficients`` and, if there, ``noise_variance`` on the original scale."""
    variable = next((name for name in ("coefficients", "scaled_coefficients") if name in group), None)
    if variable is None or group[variable].ndim != 3 or group[variable].shape[-1] != data.n_terms:
        raise ValueError(
            f"The posterior must have 'coefficients' with dims chain, draw and {data.n_terms} terms, found "
            f"{', '.join(map(str, group.data_vars)) or 'no variable'}; add pm.Deterministic('coefficients', ...)."
        )
    names, dim = list(data.coefficients), group[variable].transpose(*_SAMPLE, ...).dims[-1]
    labels = [str(name) for name in group[dim].values]
    if labels != [str(k) for k in range(data.n_terms)]:
        if sorted(labels) != sorted(names):
            raise ValueError(
                f"The posterior must have the coefficients of the data, {', '.join(names)}, found {', '.join(labels)}; "
                "give the data that the model was fitted to, or its names to the model."
            )
        group = group.isel({dim: [labels.index(name) for name in names]})
    draws = group[variable].transpose(*_SAMPLE, dim).to_numpy()
    values = draws if variable == "coefficients" else data.to_original(draws)
    renamed = group.rename({} if dim == "coefficient" else {dim: "coefficient"}).assign_coords(coefficient=names)
    if "noise_variance" not in renamed and "scaled_noise_variance" in renamed:
        renamed = renamed.assign(noise_variance=data.response_scale**2 * renamed["scaled_noise_variance"])
    return renamed.assign(coefficients=((*_SAMPLE, "coefficient"), values))


def _check_response(sampled: xr.DataTree, data: RegressionData) -> None:
    """Raise ValueError unless the one observed variable is the response, on a scale of any unit and centre."""
    observed = sampled["observed_data"].dataset if "observed_data" in sampled.children else xr.Dataset()
    for name, values in observed.items() if len(observed.data_vars) == 1 else ():
        y = values.to_numpy().ravel().astype(float)
        if y.size == data.n_rows:
            line = np.column_stack([np.ones(y.size), data.response])
            residual = y - line @ np.linalg.lstsq(line, y)[0]
            if np.abs(residual).max() <= 1e-6 * np.abs(y).max():
                continue
        raise ValueError(
            f"The observed variable {name} must be the response of the data, found {y.size} other values; give the "
            "data that the model was fitted to."
        )


def _from_model(groups: dict[str, xr.Dataset], model: pm.Model, seed: int) -> dict[str, xr.Dataset]:
    """Groups computed by PyMC from a model and its draws."""
    import pymc as pm

    observed = [variable.name for variable in model.observed_RVs]
    if len(observed) != 1:
        raise ValueError(
            f"A regression has one observed variable, found {', '.join(observed) or 'none'}; give the groups of such a "
            "model in the tree and omit the model."
        )
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


def _named_rows(group: xr.Dataset, name: str, data: RegressionData) -> xr.Dataset:
    """Group of values by row, in the order of the data, with its one variable renamed ``response``."""
    if name not in _BY_ROW or len(group.data_vars) != 1:
        return group
    values = next(iter(group.data_vars.values())).transpose(*_SAMPLE, ...)
    if values.ndim != 3 or values.shape[-1] != data.n_rows:
        raise ValueError(
            f"The group {name} has one value for each chain, draw and row, found shape {values.shape} for "
            f"{data.n_rows} rows; give the data that the model was fitted to."
        )
    rows, dim = np.arange(data.n_rows), values.dims[-1]
    if np.array_equal(np.sort(values[dim].values), rows):  # else the labels are those of the user's table
        values = values.sortby(dim)
    coords = {dim: group[dim].values for dim in _SAMPLE} | {"row": rows}
    return xr.Dataset({"response": ((*_SAMPLE, "row"), values.to_numpy())}, coords)
