"""Prior draws, and prior and posterior predictive draws of the rows, for ArviZ's checks."""

import json
from typing import Any

import numpy as np
import xarray as xr

from pymc_ship.inference.regression.prior_table import hold_fixed
from pymc_ship.inference.regression.priors import Prior, check_data, check_prior
from pymc_ship.inference.regression.tree import SAMPLE, drawn_coefficients, posterior_group, warn_of_chains
from pymc_ship.inference.rows.data import RegressionData
from pymc_ship.inference.rows.frames import new_design
from pymc_ship.inference.sampling.error_laws import OWN, draw_errors, error_law, known_errors_of, log_likelihood_group
from pymc_ship.machine.arguments import check_counts
from pymc_ship.machine.errors import ShipError
from pymc_ship.machine.seeds import Seed, random_generator

PREDICTIVE_DRAWS = 500  # default number of prior draws


def prior_draws(
    data: RegressionData, prior: Prior, draws: int, *, rng: np.random.Generator, errors: str = "normal"
) -> xr.Dataset:
    """Independent draws of the variables of a posterior from the prior, one chain, on the original scale."""
    law = error_law(errors)
    scaled, scaled_variance = prior.draw(data.n_terms, rng, (1, draws))
    values = {
        "coefficients": ((*SAMPLE, "coefficient"), data.to_original(scaled)),
        "noise_variance": (SAMPLE, data.response_scale**2 * scaled_variance),
    }
    if law.parameter:
        values[law.parameter] = (SAMPLE, law.draw_parameter(rng, (1, draws)))
    return xr.Dataset(values, {"chain": [0], "draw": np.arange(draws), "coefficient": list(data.coefficients)})


def predictive(
    data: RegressionData, parameters: xr.Dataset, *, rng: np.random.Generator, errors: str = "normal"
) -> xr.Dataset:
    """``response`` (chain, draw, row) of the rows of the data, one for each draw of a group prior or posterior."""
    law, parameters = error_law(errors), parameters.transpose("chain", "draw", ...)
    sd = np.sqrt(parameters["noise_variance"].to_numpy())
    parameter = parameters[law.parameter].to_numpy() if law.parameter else np.zeros_like(sd)
    response = draw_errors(data, errors, rng, sd, parameter)
    response += parameters["coefficients"].to_numpy() @ data.design_matrix.T
    coords = {"chain": parameters["chain"].values, "draw": parameters["draw"].values, "row": np.arange(data.n_rows)}
    return xr.Dataset({"response": (("chain", "draw", "row"), response)}, coords)


def predict(tree: xr.DataTree, new_rows: Any, *, data: RegressionData | None = None, rng: Seed) -> xr.Dataset:
    """Posterior predictive distribution of new rows.

    Parameters
    ----------
    tree : DataTree
        Posterior of a regression.
    new_rows : array_like, shape (n_new, n_terms), or DataFrame
        The columns of the fitted data in their order, or a table with these or the variables of the formula; other
        columns are ignored.
    data : RegressionData, optional
        Data of the fit; needed for the variables of a formula.
    rng : int, SeedSequence or Generator

    Returns
    -------
    Dataset
        ``expected`` (dims chain, draw, row), the response without error; ``response`` (likewise), with errors;
        ``mean`` and ``sd`` (dims row) of the response over the draws.

    Raises
    ------
    InferenceError
        For new rows of another shape, missing columns, values that are not finite.
    ValueError
        For a posterior that is no regression of one response or whose errors follow no law of the package, or other
        data.

    Examples
    --------
    Yaw moment in rows that were not fitted, and the coverage of intervals of 90 %:

    >>> import numpy as np
    >>> import pymc_ship as ps
    >>> trial = ps.simulate("kvlcc2", ps.zigzag(20, 20), duration=600, step=0.5)
    >>> data = ps.regression_data(ps.pollute(trial, level=0.01, rng=1), "kvlcc2", "yaw", derivative="weak")
    >>> old, new = data.rows(np.arange(40)), data.rows(np.arange(40, data.n_rows))
    >>> prior, _ = ps.maximise_evidence(old)
    >>> tree = ps.exact_posterior(old, prior, rng=1)
    >>> predicted = ps.predict(tree, new.design_matrix, rng=1)
    >>> lower, upper = predicted["response"].quantile([0.05, 0.95], ("chain", "draw"))
    >>> print(f"{np.mean((lower < new.response) & (new.response < upper)):.2f}")
    1.00
    """
    rng = random_generator(rng)
    posterior = _regression_draws(tree)
    names = [str(name) for name in posterior["coefficient"].values]
    if data is not None:
        _check_fitted(tree, data)
    design_matrix = new_design(new_rows, names, None if data is None else data.formula)
    rows = RegressionData.from_arrays(design_matrix, np.zeros(len(design_matrix)), names, scaling="none")
    predicted = predictive(rows, posterior, rng=rng, errors=known_errors_of(tree))
    expected = predicted["response"].copy(data=posterior["coefficients"].to_numpy() @ design_matrix.T)
    return predicted.assign(expected=expected, mean=expected.mean(SAMPLE), sd=predicted["response"].std(SAMPLE))


def with_predictive(
    tree: xr.DataTree, data: RegressionData, prior: Prior, *, rng: Seed, draws: int = PREDICTIVE_DRAWS
) -> xr.DataTree:
    """Posterior with prior and posterior predictive groups.

    Parameters
    ----------
    tree : DataTree
        Posterior as of :func:`~pymc_ship.inference.regression.tree.draws_tree`; not changed.
    data : RegressionData
        Data of the fit.
    prior : Prior
        Prior of the fit.
    rng : int, SeedSequence or Generator
    draws : int, optional
        Draws of the prior; each draw of the posterior has one prediction.

    Returns
    -------
    DataTree
        With the groups prior (the variables of the posterior; one chain), prior_predictive and posterior_predictive
        (``response`` with dims chain, draw, row, of the ``observed_data``: without the part of coefficients that
        :func:`~pymc_ship.inference.regression.prior_table.restore_fixed` added), and log_likelihood if it has none.

    Raises
    ------
    ValueError
        When draws is not positive, data or prior are not those of the tree, or its errors follow no law of the package.
    """
    check_counts(draws=draws)
    rng = random_generator(rng)
    check_prior(prior, data)
    data = _check_fitted(tree, data)
    _check_prior_of(tree, prior)
    whole = _regression_draws(tree)
    posterior = whole.sel(coefficient=list(data.coefficients))
    errors = known_errors_of(tree)
    from_prior = prior_draws(data, prior, draws, rng=rng, errors=errors)
    fixed = json.loads(tree.attrs.get("fixed", "{}"))
    coefficients = from_prior["coefficients"].reindex(coefficient=whole["coefficient"].values)
    for name, value in fixed.items():
        coefficients.loc[{"coefficient": name}] = value
    groups = {
        "prior": from_prior.drop_dims("coefficient").assign(coefficients=coefficients) if fixed else from_prior,
        "prior_predictive": predictive(data, from_prior, rng=rng, errors=errors),
        "posterior_predictive": predictive(data, posterior, rng=rng, errors=errors),
    }
    own = {name: group.to_dataset() for name, group in tree.children.items()}
    if "log_likelihood" not in own:
        own["log_likelihood"] = log_likelihood_group(data, errors, posterior)
    return xr.DataTree.from_dict({"/": xr.Dataset(attrs=tree.attrs), **own, **groups})


def _regression_draws(tree: xr.DataTree) -> xr.Dataset:
    posterior = drawn_coefficients(tree, "A prediction")
    warn_of_chains("A prediction", posterior)
    if "noise_variance" not in posterior:
        raise ShipError(
            "A prediction needs coefficients and a noise_variance in the posterior, found "
            f"{', '.join(map(str, posterior.data_vars))}; give the posterior of a regression."
        )
    return posterior


def _check_fitted(tree: xr.DataTree, data: RegressionData) -> RegressionData:
    """Data without the fixed coefficients; ValueError unless a posterior is theirs: names, rows, scaling."""
    check_data(data)
    names = [str(name) for name in posterior_group(tree)["coefficient"].to_numpy()]
    if list(data.coefficients) != names:
        raise ShipError(
            f"The data must be those of the posterior, of {', '.join(names)}, found {', '.join(data.coefficients)}; "
            "give the data that it was fitted to."
        )
    fixed = json.loads(tree.attrs.get("fixed", "{}"))
    free = hold_fixed(data, fixed) if fixed else data
    stored = {
        name: tree[group][name].to_numpy()
        for group, name in (("observed_data", "response"), ("constant_data", "design_matrix"))
        if group in tree.children and name in tree[group]
    }
    if stored:
        stored |= {name: np.asarray(value) for name, value in json.loads(tree.attrs.get("scaling", "{}")).items()}
    others = [name for name, values in stored.items() if not is_equal(np.asarray(getattr(free, name)), values)]
    if others or not stored:
        fault = f"another {' and '.join(others)}".replace("_", " ") if stored else "no observed_data"
        raise ShipError(
            f"The data must be those of the posterior, found {fault} in its tree; give the data that it was fitted to."
        )
    return free


def _check_prior_of(tree: xr.DataTree, prior: Prior) -> None:
    """Raise ValueError for another prior than that in the attrs of a posterior; one of the user's own is not known."""
    stored, given = json.loads(tree.attrs.get("prior", "{}")), prior.hyperparameters()
    others = [name for name, value in stored.items() if given.get(name) != value]
    if others and stored["family"] != OWN:
        raise ShipError(
            f"The prior must be that of the posterior, found another {', '.join(others)}; give the prior of the fit."
        )


def is_equal(values: np.ndarray, others: np.ndarray) -> bool:
    """Whether two arrays agree to rounding, relative to the largest value."""
    if values.shape != others.shape:
        return False
    return bool(np.abs(values - others).max(initial=0.0) <= 1e-9 * np.abs(values).max(initial=0.0))
