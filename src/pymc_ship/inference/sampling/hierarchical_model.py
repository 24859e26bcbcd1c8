"""Coefficients partially pooled over groups of runs, such as ships or facilities.

m_j ~ N(mean_j, kappa_j), tau_j ~ HalfNormal(spread), scaled coefficients b_gj ~ N(m_j, tau_j^2) of group g,
sigma2_g ~ IG(shape, scale), y ~ N(X b_g, sigma2_g). NUTS draws tau and sigma2 from their marginal posterior (Lindley &
Smith 1972, doi:10.1111/j.2517-6161.1972.tb00885.x); m and b are exact draws.
"""

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np
import pymc as pm
import pytensor.tensor as pt
import xarray as xr

from pymc_ship.inference.regression.priors import check_prior
from pymc_ship.inference.regression.semiconjugate import SemiConjugatePrior
from pymc_ship.inference.rows.data import RegressionData
from pymc_ship.inference.sampling.from_pymc import posterior_tree
from pymc_ship.inference.sampling.operations import pooled_density
from pymc_ship.inference.sampling.regression_model import check_settings, sample_density
from pymc_ship.inference.sampling.whitened_model import Density
from pymc_ship.machine.arguments import check_kind, finite_number
from pymc_ship.machine.errors import InferenceError
from pymc_ship.machine.seeds import Seed, random_generator


def hierarchical_model(
    data: RegressionData, prior: SemiConjugatePrior, groups: Mapping[str, str] | None = None, *, spread: float = 1.0
) -> pm.Model:
    """PyMC model of coefficients that are partially pooled over groups of runs.

    InferenceError as :func:`hierarchical_posterior`. Gelman & Hill (2007), Data Analysis Using Regression and
    Multilevel/Hierarchical Models, ch. 12-13; Papaspiliopoulos, Roberts & Skoeld (2007),
    doi:10.1214/088342307000000014.

    Parameters
    ----------
    data : RegressionData
        Rows of several trials.
    prior : SemiConjugatePrior
        Of the means over groups on the scaled columns, and of the noise variance of each group.
    groups : mapping of str to str, optional
        Group of each run; default: each run.
    spread : float, optional
        Scale of the half-normal prior of the sd between groups, on the scaled columns.

    Returns
    -------
    pymc.Model
        Non-centred: free variables ``standardised`` (dims level, coefficient), ``scaled_group_sd`` (coefficient) and
        ``scaled_group_noise_variance`` (group); deterministic, on the original scale, ``coefficients`` (the means over
        groups), ``group_coefficients`` (group, coefficient), ``group_sd`` (coefficient) and ``group_noise_variance``
        (group); observed ``response`` (row).
    """
    check_prior(prior, data)
    if prior.noise_power != 0:
        raise InferenceError(
            f"The groups of a hierarchical model have noise variances of their own, which a {prior.family} prior of "
            "the means cannot depend on; give a SemiConjugatePrior."
        )
    spread = finite_number("The spread between groups", spread, InferenceError, least=1e-12)
    labels, group = group_of_rows(data, groups)
    offset, transformation = data.transformation
    mean, root = prior.means(data.n_terms), np.sqrt(prior.kappas(data.n_terms))
    coords = {"coefficient": list(data.coefficients), "row": np.arange(data.n_rows), "group": labels}
    with pm.Model(coords=coords | {"level": ["mean", *labels]}) as model:
        design = pm.Data("design_matrix", data.design_matrix, dims=("row", "coefficient"))
        response = pm.Data("observed_response", data.response, dims="row")
        group_sd = pm.HalfNormal("scaled_group_sd", spread, dims="coefficient")
        variance = pm.InverseGamma("scaled_group_noise_variance", prior.shape, prior.scale, dims="group")
        standard = pm.Normal("standardised", 0.0, 1.0, dims=("level", "coefficient"))
        means = mean + root * standard[0]
        scaled = means + group_sd * standard[1:]
        pm.Deterministic("coefficients", offset + pt.dot(transformation, means), dims="coefficient")
        dims = ("group", "coefficient")
        each = pm.Deterministic("group_coefficients", offset + pt.dot(scaled, transformation.T), dims=dims)
        pm.Deterministic("group_sd", pt.sqrt(pt.dot(transformation**2, group_sd**2)), dims="coefficient")
        noise = pm.Deterministic("group_noise_variance", data.response_scale**2 * variance, dims="group")
        fit = (design * each[group]).sum(axis=1)
        pm.Normal("response", fit, pt.sqrt(noise)[group], observed=response, dims="row")
    return model


def hierarchical_posterior(
    data: RegressionData,
    prior: SemiConjugatePrior,
    groups: Mapping[str, str] | None = None,
    *,
    spread: float = 1.0,
    draws: int = 1000,
    chains: int = 4,
    tune: int = 1000,
    target_accept: float = 0.9,
    rng: Seed,
    progress: bool = False,
) -> xr.DataTree:
    """Posterior of :func:`hierarchical_model` by NUTS.

    Parameters
    ----------
    data, prior, groups, spread
        As :func:`hierarchical_model`.
    draws, chains, tune, target_accept, progress : optional
        As :func:`~pymc_ship.inference.sampling.regression_model.nuts_posterior`.
    rng : int, SeedSequence or Generator

    Returns
    -------
    DataTree
        As :func:`~pymc_ship.inference.sampling.from_pymc.posterior_tree`. ``coefficients`` are the means over groups,
        with ``group_coefficients``, ``group_sd`` and ``group_noise_variance``.

    Raises
    ------
    InferenceError
        For fewer than two groups, a run without one, a prior whose coefficients depend on the noise variance, or
        vectors of the wrong length.
    ValueError
        For counts that are not positive, or an acceptance rate outside 0 to 1.

    Examples
    --------
    Zigzags with first execute to starboard and to port:

    >>> import numpy as np
    >>> import pymc_ship as ps
    >>> vessel, rng, sides = ps.load_vessel("kvlcc2"), np.random.default_rng(1), ("starboard", "port")
    >>> zigzags = {side: ps.zigzag(20, 20, side=side) for side in sides}
    >>> trials = {side: ps.simulate(vessel, zigzags[side], duration=600, step=0.5) for side in sides}
    >>> noisy = {side: ps.pollute(trial, level=0.01, rng=rng) for side, trial in trials.items()}
    >>> data = ps.regression_data(noisy, vessel, "yaw", derivative="weak")
    >>> tree = ps.hierarchical_posterior(data, ps.SemiConjugatePrior(), draws=100, tune=200, chains=2, rng=rng)
    >>> dict(tree["posterior"]["group_coefficients"].sizes)
    {'chain': 2, 'draw': 100, 'group': 2, 'coefficient': 12}
    """
    settings = {"draws": draws, "chains": chains, "tune": tune, "target_accept": target_accept}
    check_settings(settings)
    rng, model = random_generator(rng), hierarchical_model(data, prior, groups, spread=spread)
    labels, group = group_of_rows(data, groups)
    reduced, seed = reduced_groups(data, prior, group), int(rng.integers(2**31))
    sampled = sample_density(marginal_density(reduced, prior, float(spread)), settings, seed, progress)
    rng = np.random.default_rng([seed, 1])
    names, p, sample = ("scaled_group_sd", "scaled_group_noise_variance"), data.n_terms, ("chain", "draw")
    tau, variance = (sampled["posterior"][name].to_numpy() for name in names)
    flat = standardised_draws(reduced, prior, tau.reshape(-1, p), variance.reshape(-1, len(labels)), rng)
    standard = flat.reshape(*tau.shape[:2], *flat.shape[1:])
    means = prior.means(p) + np.sqrt(prior.kappas(p)) * standard[:, :, 0]
    scaled = means[:, :, None] + tau[:, :, None] * standard[:, :, 1:]
    values = {
        "standardised": ((*sample, "level", "coefficient"), standard),
        "scaled_group_sd": ((*sample, "coefficient"), tau),
        "scaled_group_noise_variance": ((*sample, "group"), variance),
        "coefficients": ((*sample, "coefficient"), data.to_original(means)),
        "group_coefficients": ((*sample, "group", "coefficient"), data.to_original(scaled)),
        "group_sd": ((*sample, "coefficient"), np.sqrt(tau**2 @ (data.transformation[1] ** 2).T)),
        "group_noise_variance": ((*sample, "group"), data.response_scale**2 * variance),
    }
    coords = {"chain": np.arange(tau.shape[0]), "draw": np.arange(tau.shape[1]), "group": labels}
    coords |= {"level": ["mean", *labels], "coefficient": list(data.coefficients)}
    drawn = {"posterior": xr.Dataset(values, coords), "sample_stats": sampled["sample_stats"].to_dataset()}
    return posterior_tree(xr.DataTree.from_dict(drawn), data, model, rng=rng)


def group_of_rows(data: RegressionData, groups: Mapping[str, str] | None) -> tuple[list[str], np.ndarray]:
    """Labels of the groups, and group index of each row; InferenceError for one group only or a run without a group."""
    runs = list(dict.fromkeys(data.run.tolist()))
    if groups is not None:
        check_kind("groups", groups, Mapping, "give the group of each run by its label", InferenceError)
    groups = {run: run for run in runs} if groups is None else {str(run): group for run, group in groups.items()}
    lacking = [run for run in runs if run not in groups]
    if lacking:
        raise InferenceError(f"Every run needs a group, found none for {', '.join(lacking)}; give its group.")
    labels = list(dict.fromkeys(str(groups[run]) for run in runs))
    if len(labels) < 2:
        raise InferenceError(
            f"A hierarchical model compares two groups of runs or more, found {labels[0]} alone; give the trials of "
            "several, as ps.regression_data([first, second], ...)."
        )
    return labels, np.array([labels.index(str(groups[run])) for run in data.run])


class ReducedGroups(NamedTuple):
    """QR reduction of the rows of all groups about the prior mean, as the inputs of the density."""

    rows: np.ndarray  # [R z], shape (n_groups, n_terms, n_terms + 1)
    residual_squares: np.ndarray
    spare_rows: np.ndarray


def reduced_groups(data: RegressionData, prior: SemiConjugatePrior, group: np.ndarray) -> ReducedGroups:
    """QR reduction of the rows of each group, padded to n_terms rows."""
    X, p, n_groups = data.scaled_design_matrix, data.n_terms, group.max() + 1
    y = data.scaled_response - X @ prior.means(p)
    reduced = ReducedGroups(np.zeros((n_groups, p, p + 1)), *np.zeros((2, n_groups)))
    for g in range(n_groups):
        target = y[group == g]
        left, triangle = np.linalg.qr(X[group == g])
        projection = left.T @ target
        residual = target - left @ projection
        reduced.rows[g, : len(triangle)] = np.column_stack([triangle, projection])
        reduced.residual_squares[g], reduced.spare_rows[g] = residual @ residual, len(target) - p
    return reduced


def marginal_density(reduced: ReducedGroups, prior: SemiConjugatePrior, spread: float) -> Density:
    """Density of log tau and log sigma2 up to a constant, with the coefficients integrated out."""
    (n_groups, p), names = reduced.rows.shape[:2], ("scaled_group_sd", "scaled_group_noise_variance")
    precision = 1.0 / prior.kappas(p)

    def log_density(coordinates: np.ndarray) -> tuple[float, np.ndarray]:
        with np.errstate(over="ignore", divide="ignore", invalid="ignore"):
            values = np.exp(coordinates)
            tau, variance = values[:p], values[p:]
            density, of_tau, of_variance = pooled_density(tau, variance, *reduced, precision=precision)
            density -= 0.5 * np.sum((tau / spread) ** 2) - coordinates[:p].sum()
            density -= np.sum(prior.scale / variance) + prior.shape * coordinates[p:].sum()
            gradient = values * np.concatenate([of_tau, of_variance])
            gradient[:p] += 1.0 - (tau / spread) ** 2
            gradient[p:] += prior.scale / variance - prior.shape
        return float(density), gradient

    def parameters(coordinates: np.ndarray) -> dict[str, np.ndarray]:
        return dict(zip(names, np.split(np.exp(coordinates), [p]), strict=True))

    start = np.log(np.repeat([spread, prior.scale / (prior.shape + 1.0)], [p, n_groups]))
    return Density(start, log_density, parameters)


def standardised_draws(
    reduced: ReducedGroups, prior: SemiConjugatePrior, tau: np.ndarray, variance: np.ndarray, rng: np.random.Generator
) -> np.ndarray:
    """Exact draws of the standardised variables (n_draws, 1 + n_groups, n_terms), given tau and sigma2."""
    n_draws, p = tau.shape
    eye = np.eye(p)
    precision, shift = np.tile(np.diag(1.0 / prior.kappas(p)), (n_draws, 1, 1)), np.zeros((n_draws, p))
    for g, rows_of_group in enumerate(reduced.rows):
        own = rows_of_group[:, :-1] * tau[:, None, :]
        root = np.linalg.cholesky(variance[:, g, None, None] * eye + own @ own.transpose(0, 2, 1))
        whitened = np.linalg.solve(root, rows_of_group)
        rows, target = whitened[..., :-1], whitened[..., -1]
        precision += rows.transpose(0, 2, 1) @ rows
        shift += np.einsum("nij,ni->nj", rows, target)
    out = np.empty((n_draws, 1 + len(reduced.rows), p))
    means = _normal(precision, shift, rng)
    out[:, 0] = means / np.sqrt(prior.kappas(p))
    for g, rows_of_group in enumerate(reduced.rows):
        triangle, projection = rows_of_group[:, :-1], rows_of_group[:, -1]
        own = triangle * tau[:, None, :] / np.sqrt(variance[:, g, None, None])
        error = (projection - means @ triangle.T) / np.sqrt(variance[:, g, None])
        out[:, 1 + g] = _normal(eye + own.transpose(0, 2, 1) @ own, np.einsum("nij,ni->nj", own, error), rng)
    return out


def _normal(precision: np.ndarray, shift: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """One draw of each N(precision^-1 shift, precision^-1)."""
    root = np.linalg.cholesky(precision)
    half = np.linalg.solve(root, shift[..., None]) + rng.standard_normal((*shift.shape, 1))
    return np.linalg.solve(root.transpose(0, 2, 1), half)[..., 0]
