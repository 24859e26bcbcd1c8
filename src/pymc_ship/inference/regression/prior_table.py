"""Priors of single coefficients: a table of means and sds, fixed values, scales that fall with the order of the term.

On the scaled columns, b = offset + T b*, the prior b_j ~ N(m, sd^2) is b*_j ~ N(m / T_jj, (sd / T_jj)^2).
"""

import json
from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
import xarray as xr

from pymc_ship.inference.regression.priors import Prior, check_data, check_prior
from pymc_ship.inference.regression.tree import posterior_group
from pymc_ship.inference.rows.data import RegressionData
from pymc_ship.machine.arguments import check_kind, finite_number, name_list
from pymc_ship.machine.errors import InferenceError
from pymc_ship.physics.forces.terms import UnknownTerm, order
from pymc_ship.physics.vessel.reading import VesselLike, as_vessel

_BY_NAME = "give a dict by name of coefficient"


def informed_prior(data: RegressionData, prior: Prior, table: Mapping[str, tuple[float, float]]) -> Prior:
    """Prior with given means and sds of some coefficients.

    Means and sds are in the units of the original columns. Under a conjugate prior the sd is the marginal one,
    (E[sigma2] V)^(1/2), and scales with the noise of the data: set shape and scale to the expected noise, or use a
    semi-conjugate prior, whose sd does not depend on it.

    Parameters
    ----------
    data : RegressionData
    prior : Prior
        Of the noise variance, and of the coefficients that are not in the table.
    table : mapping of str to (float, float)
        Mean and standard deviation by name of coefficient.

    Raises
    ------
    InferenceError
        For unknown names, values that are not finite, an sd that is not positive, the constant of centred columns, or
        a conjugate prior whose noise variance has no mean (shape <= 1).
    """
    check_prior(prior, data)
    check_kind("The table of a prior", table, Mapping, _BY_NAME, InferenceError)
    _check_names(table, data.coefficients)
    mean, kappa = prior.means(data.n_terms).copy(), prior.kappas(data.n_terms).copy()
    unit = prior.variance_factor(prior.noise_variance_mean)
    if table and not np.isfinite(unit):
        raise InferenceError(
            f"Under a {prior.family} prior an sd is met at the mean of the noise variance, which needs a shape above "
            f"1, found {prior.shape}; raise the shape or use a SemiConjugatePrior."
        )
    for name, entry in table.items():
        j = data.coefficients.index(name)
        center, sd = _mean_and_sd(name, entry)
        if j == data.constant and data.column_center.any():
            raise InferenceError(
                f"The constant {name} of centred columns depends on the other coefficients and cannot have its own "
                "prior; leave it out of the table, to the base prior."
            )
        slope = data.response_scale / data.column_scale[j]
        offset = data.response_center / data.design_matrix[0, j] if j == data.constant else 0.0
        mean[j], kappa[j] = (center - offset) / slope, (sd / slope) ** 2 / unit
    return replace(prior, mean=mean, kappa=kappa)


def hold_fixed(data: RegressionData, values: Mapping[str, float]) -> RegressionData:
    """Regression data without coefficients that are fixed at known values.

    Their part of the response is subtracted. The other columns keep their scale; they lose their centres if the
    constant is fixed. A prior with vectors must be made for the new data. Predictions are without the fixed part;
    :func:`restore_fixed` adds the coefficients to a posterior, and their part to its predictions.

    Parameters
    ----------
    data : RegressionData
    values : mapping of str to float
        Value in the units of the original columns by name of coefficient.

    Raises
    ------
    InferenceError
        For unknown names, values that are not finite, or when no coefficient is left.
    """
    check_data(data)
    check_kind("The fixed values", values, Mapping, _BY_NAME, InferenceError)
    _check_names(values, data.coefficients)
    fixed = {name: _number(name, value) for name, value in values.items()}
    free = np.array([name not in fixed for name in data.coefficients])
    if not free.any():
        raise InferenceError("At least one coefficient must stay free, found all of them fixed; free one.")
    offset = np.array([fixed.get(name, 0.0) for name in data.coefficients])
    centred = data.constant >= 0 and bool(free[data.constant])
    return replace(
        data,
        design_matrix=np.ascontiguousarray(data.design_matrix[:, free]),
        response=data.response - data.design_matrix @ offset,
        coefficients=tuple(name for name in data.coefficients if name not in fixed),
        column_center=data.column_center[free] if centred else np.zeros(free.sum()),
        column_scale=data.column_scale[free],
        response_center=float(data.response_center - data.column_center @ offset) if centred else 0.0,
        constant=int(free[: data.constant].sum()) if centred else -1,
        fixed={**data.fixed, **fixed},
    )


def restore_fixed(
    tree: xr.DataTree, values: Mapping[str, float], coefficients: Sequence[str] | None = None
) -> xr.DataTree:
    """Posterior of :func:`hold_fixed` data with the fixed coefficients added.

    A diagnostic report is of the free ones: the r-hat of a constant is not defined.

    Parameters
    ----------
    tree : DataTree
    values : mapping of str to float
        As given to :func:`hold_fixed`.
    coefficients : sequence of str, optional
        Order of all coefficients; by default the free ones, then the fixed ones.

    Returns
    -------
    DataTree
        A copy; its attr ``fixed`` has the values, with those restored before, as JSON.

    Raises
    ------
    InferenceError
        For values that are not finite or not those of the fit, coefficients that the posterior has already, or an
        incomplete order.
    """
    posterior = posterior_group(tree)
    check_kind("The fixed values", values, Mapping, _BY_NAME, InferenceError)
    free = [str(name) for name in posterior["coefficient"].values]
    fixed = {name: _number(name, value) for name, value in values.items()}
    twice = [name for name in fixed if name in free]
    if twice:
        raise InferenceError(f"A fixed coefficient is not drawn, found draws of {', '.join(twice)}; leave it out.")
    held = json.loads(tree.attrs.get("held_fixed", "{}"))
    others = [
        f"{name} = {value:g} for {held[name]:g}" for name, value in fixed.items() if held.get(name, value) != value
    ]
    if others:
        raise InferenceError(f"The fixed values are those of the fit, found {', '.join(others)}; correct them.")
    ordered = name_list("The coefficients", [*free, *fixed] if coefficients is None else coefficients, InferenceError)
    if sorted(ordered) != sorted([*free, *fixed]):
        odd = sorted({*ordered} ^ {*free, *fixed})
        raise InferenceError(
            f"The order names each free and fixed coefficient once, found a mismatch in {', '.join(odd)}; correct it."
        )
    whole = posterior["coefficients"].reindex(coefficient=ordered)
    for name, value in fixed.items():
        whole.loc[{"coefficient": name}] = value
    rest = posterior.drop_vars(("coefficients", "coefficient"))
    restored = tree.copy()
    restored["posterior"] = xr.DataTree(rest.assign(coefficients=whole))
    restored.attrs["fixed"] = json.dumps(json.loads(tree.attrs.get("fixed", "{}")) | fixed)
    return restored


def order_damped_prior(data: RegressionData, prior: Prior, *, damping: float = 0.3) -> Prior:
    """Prior whose scale falls with the order of the term.

    Parameters
    ----------
    data : RegressionData
    prior : Prior
        Its kappa is that of the terms of order 0 and 1; ``Yv|v|`` is of order 2.
    damping : float, optional
        Factor of the prior sd (on the scaled columns) for each order; in (0, 1].

    Raises
    ------
    InferenceError
        For damping outside (0, 1] or names that are not a letter and a term.
    """
    check_prior(prior, data)
    factor = _number("damping", damping)
    if not 0.0 < factor <= 1.0:
        raise InferenceError(f"The damping lies in (0, 1], found {damping}; 1 leaves the prior as it is.")
    try:
        orders = np.array([order(name[1:]) for name in data.coefficients])
    except UnknownTerm as error:
        raise InferenceError(f"Order damping needs names of a letter and a term such as Yv|v|. {error}") from None
    return replace(prior, kappa=prior.kappas(data.n_terms) * factor ** (2 * np.maximum(orders - 1, 0)))


def sister_ship_table(
    vessel: VesselLike,
    dof: str,
    *,
    relative_sd: float = 0.3,
    floor: float | None = None,
    names: Collection[str] | None = None,
) -> dict[str, tuple[float, float]]:
    """Table for :func:`informed_prior` from the reference coefficients of another vessel.

    Parameters
    ----------
    vessel : Vessel, str or Path
        The sister ship; its size and speed may differ, since values are prime.
    dof : {"surge", "sway", "yaw", "roll"}
    relative_sd : float, optional
        sd = ((relative_sd value)^2 + floor^2)^(1/2).
    floor : float, optional
        Least sd, a prime value; by default ``relative_sd`` times the median magnitude of the DOF's coefficients.
    names : collection of str, optional
        Coefficients of the table; all by default.

    Returns
    -------
    dict of str to (float, float)
        Mean and sd by name, with the constant (``Y0``) if the sister has one; drop it for centred columns.

    Raises
    ------
    VesselError, InferenceError
        When the vessel has no such DOF; for unknown names, numbers negative or not finite, or an sd of 0.
    """
    vessel = as_vessel(vessel)
    reference = vessel.coefficients(dof)
    values = reference.values
    relative = _number("relative_sd", relative_sd)
    least = relative * float(np.median(np.abs(values))) if floor is None else _number("floor", floor)
    if relative < 0.0 or least < 0.0:
        raise InferenceError(
            f"relative_sd and floor must not be negative, found {relative_sd} and {floor}; raise them."
        )
    names = (
        reference["coefficient"].values.tolist()
        if names is None
        else name_list("The coefficients of a table", names, InferenceError)
    )
    _check_names(names, reference["coefficient"].values.tolist())
    sd = np.hypot(relative * values, least)
    triples = zip(reference["coefficient"].values.tolist(), values.tolist(), sd.tolist(), strict=True)
    table = {name: (mean, spread) for name, mean, spread in triples if name in names}
    certain = [name for name, (_, spread) in table.items() if spread == 0.0]
    if certain:
        raise InferenceError(f"An sd must be positive, found 0 for {', '.join(certain)}; give a floor above 0.")
    return table


def _check_names(names: Iterable[str], coefficients: Sequence[str]) -> None:
    unknown = [str(name) for name in names if name not in coefficients]
    if unknown:
        raise InferenceError(
            f"The coefficients are {', '.join(coefficients)}; found {', '.join(unknown)}; correct the names."
        )


def _mean_and_sd(name: str, entry: Any) -> tuple[float, float]:
    try:
        mean, sd = entry
    except (TypeError, ValueError):
        raise InferenceError(f"A table gives (mean, sd) for each coefficient, found {entry!r} for {name}.") from None
    mean, sd = (_number(name, value) for value in (mean, sd))
    if sd <= 0.0:
        raise InferenceError(f"The sd of {name} must be positive, found {sd}; use hold_fixed for a known value.")
    return mean, sd


def _number(name: str, value: object) -> float:
    return finite_number(f"The value given for {name}", value, InferenceError)
