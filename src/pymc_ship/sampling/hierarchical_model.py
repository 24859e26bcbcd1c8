"""Coefficients partially pooled over groups of runs: sides, ships or facilities; pymc is imported only when called.

With b_g the scaled coefficients of group g, m their mean over all groups that could be, and tau_j the spread of
coefficient j between groups:

    m_j ~ N(mean_j, kappa_j),  tau_j ~ HalfNormal(spread),  b_gj ~ N(m_j, tau_j^2),
    sigma2_g ~ IG(shape, scale),  y ~ N(X b_g, sigma2_g) in each row of group g.

The model is not centred: m and b are linear in standard normal variables (Papaspiliopoulos, Roberts & Skoeld 2007). At
given tau and sigma2 these are jointly normal a posteriori; NUTS moves in coordinates that make them independent at a
plug-in estimate of tau and sigma2, found by expectation maximisation (Laird & Ware 1982, Biometrics 38(4):963,
doi:10.2307/2529876).
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING

import numpy as np
import xarray as xr

from pymc_ship.machine.arguments import finite_number
from pymc_ship.machine.seeds import Seed, random_generator
from pymc_ship.regression.priors import PriorError
from pymc_ship.regression.semiconjugate import SemiConjugatePrior
from pymc_ship.rows.data import RegressionData
from pymc_ship.rows.scaling import RegressionDataError
from pymc_ship.sampling.own_tree import posterior_tree
from pymc_ship.sampling.regression_model import sample_model

if TYPE_CHECKING:
    import pymc as pm

_STEPS = 50
_LEAST = 1e-3  # smallest spread of the plug-in estimate, over that of the prior


def hierarchical_model(
    data: RegressionData,
    prior: SemiConjugatePrior | None = None,
    groups: Mapping[str, str] | None = None,
    *,
    spread: float = 1.0,
) -> pm.Model:
    """PyMC model of coefficients that are partially pooled over groups of runs.

    Parameters
    ----------
    data : RegressionData
        Of several trials, from :func:`pymc_ship.regression_data`.
    prior : SemiConjugatePrior, optional
        Of the means over groups on the scaled columns, and of the noise variance of each group.
    groups : mapping of str to str, optional
        Group of each run, such as its side or facility; by default each run is a group.
    spread : float, optional
        Scale of the half-normal prior of the standard deviation between groups, on the scaled columns: 1 is a
        difference that moves the response by as much as it varies.

    Returns
    -------
    pymc.Model
        Free variables ``standardised`` (dims level, coefficient), ``scaled_group_sd`` (coefficient) and
        ``scaled_noise_variance`` (group); deterministic, on the original scale, ``coefficients`` (the means over
        groups), ``group_coefficients`` (group, coefficient), ``group_sd`` (coefficient) and ``group_noise_variance``
        (group); observed ``response`` (row).

    Raises
    ------
    RegressionDataError
        For fewer than two groups, or a run without one.
    PriorError
        For a prior whose coefficients depend on the noise variance, or vectors of the wrong length.

    References
    ----------
    Gelman & Hill (2007), Data Analysis Using Regression and Multilevel/Hierarchical Models, ch. 12-13;
    Papaspiliopoulos, Roberts & Skoeld (2007), doi:10.1214/088342307000000014.
    """
    import pymc as pm
    import pytensor.tensor as pt

    from pymc_ship.sampling.linear_transform import LinearTransform

    prior = SemiConjugatePrior() if prior is None else prior
    if prior.noise_power != 0:
        raise PriorError(
            f"The groups of a hierarchical model have noise variances of their own, which a {prior.family} prior of "
            "the means cannot depend on; give a SemiConjugatePrior."
        )
    spread = finite_number("The spread between groups", spread, PriorError, least=1e-12)
    labels, group = group_of_rows(data, groups)
    offset, transformation = data.transformation
    mean, root = prior.means(data.n_terms), np.sqrt(prior.kappas(data.n_terms))
    coords = {"coefficient": list(data.coefficients), "row": np.arange(data.n_rows), "group": labels}
    with pm.Model(coords=coords | {"level": ["mean", *labels]}) as model:
        design = pm.Data("design_matrix", data.design_matrix, dims=("row", "coefficient"))
        response = pm.Data("observed_response", data.response, dims="row")
        group_sd = pm.HalfNormal("scaled_group_sd", spread, dims="coefficient")
        variance = pm.InverseGamma("scaled_noise_variance", prior.shape, prior.scale, dims="group")
        transform = LinearTransform(*_coordinates(data, prior, group, spread))
        standard = pm.Normal("standardised", 0.0, 1.0, dims=("level", "coefficient"), transform=transform)
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
    prior: SemiConjugatePrior | None = None,
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
    """Draws of NUTS from the posterior of :func:`hierarchical_model`, laid out as a DataTree.

    Parameters
    ----------
    data, prior, groups, spread
        As :func:`hierarchical_model`.
    draws, chains, tune, target_accept, progress : optional
        As :func:`~pymc_ship.sampling.regression_model.nuts_posterior`.
    rng : int, SeedSequence or Generator

    Returns
    -------
    DataTree
        As :func:`~pymc_ship.sampling.own_tree.posterior_tree`. ``coefficients`` are the means over groups;
        ``group_coefficients``, ``group_sd`` and ``group_noise_variance`` stand beside them.

    Raises
    ------
    RegressionDataError, PriorError
        As :func:`hierarchical_model`.
    ValueError
        For counts that are not positive.

    Examples
    --------
    Zigzags that begin to starboard and to port:

    >>> import numpy as np
    >>> import pymc_ship as ps
    >>> vessel, rng, sides = ps.load_vessel("kvlcc2"), np.random.default_rng(1), ("starboard", "port")
    >>> zigzags = {side: ps.zigzag(20, 20, side=side) for side in sides}
    >>> trials = {side: ps.simulate(vessel, zigzags[side], duration=600, step=0.5) for side in sides}
    >>> noisy = {side: ps.pollute(trial, level=0.01, rng=rng) for side, trial in trials.items()}
    >>> data = ps.regression_data(noisy, vessel, "yaw", derivative="weak")
    >>> tree = ps.hierarchical_posterior(data, draws=100, tune=200, chains=2, rng=rng)
    >>> dict(tree["posterior"]["group_coefficients"].sizes)
    {'chain': 2, 'draw': 100, 'group': 2, 'coefficient': 10}
    """
    model = hierarchical_model(data, prior, groups, spread=spread)
    settings = {"draws": draws, "chains": chains, "tune": tune, "target_accept": target_accept}
    seed = int(random_generator(rng).integers(2**31))
    sampled = sample_model(model, settings, seed, progress)
    return posterior_tree(sampled, data, model, rng=np.random.default_rng([seed, 1]))


def group_of_rows(data: RegressionData, groups: Mapping[str, str] | None) -> tuple[list[str], np.ndarray]:
    """Labels of the groups in the order of their first rows, and the number of the group of each row.

    Raises
    ------
    RegressionDataError
        For fewer than two groups, or a run without one.
    """
    runs = list(dict.fromkeys(data.run.tolist()))
    groups = {run: run for run in runs} if groups is None else groups
    lacking = [run for run in runs if run not in groups]
    if lacking:
        raise RegressionDataError(f"Every run is of a group, found none for {', '.join(lacking)}; name its group.")
    labels = list(dict.fromkeys(str(groups[run]) for run in runs))
    if len(labels) < 2:
        raise RegressionDataError(
            f"A hierarchical model compares two groups of runs or more, found {labels[0]} alone; give the trials of "
            "several, as ps.regression_data([first, second], ...)."
        )
    return labels, np.array([labels.index(str(groups[run])) for run in data.run])


def _coordinates(
    data: RegressionData, prior: SemiConjugatePrior, group: np.ndarray, spread: float
) -> tuple[np.ndarray, np.ndarray]:
    """Posterior mean, shape (1 + n_groups, n_terms), and a root of the covariance of the standard normal variables."""
    n_groups, p = group.max() + 1, data.n_terms
    X, y = data.scaled_design_matrix, data.scaled_response - data.scaled_design_matrix @ prior.means(p)
    tau, variance = np.full(p, 0.5 * spread), np.ones(n_groups)
    for _ in range(_STEPS):
        rows = np.zeros((data.n_rows, 1 + n_groups, p))
        rows[:, 0] = X * np.sqrt(prior.kappas(p))
        rows[np.arange(data.n_rows), 1 + group] = X * tau
        rows = rows.reshape(data.n_rows, -1)
        weight = 1.0 / np.sqrt(variance[group])
        # stacked on the identity, the rows have the triangle of the posterior precision, without forming X'X
        triangle = np.linalg.qr(np.vstack([rows * weight[:, None], np.eye(rows.shape[1])]), mode="r")
        root = np.linalg.inv(triangle)
        center = root @ (root.T @ (rows.T @ (weight**2 * y)))
        moment = (center**2 + np.sum(root**2, axis=1)).reshape(1 + n_groups, p)[1:]
        tau = np.maximum(tau * np.sqrt(moment.mean(axis=0)), _LEAST * spread)
        error = np.bincount(group, (y - rows @ center) ** 2) + 2.0 * prior.scale
        variance = error / (np.bincount(group) + 2.0 * prior.shape)
    return center.reshape(1 + n_groups, p), root
