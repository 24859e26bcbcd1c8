"""A small posterior of whole trajectories, two coarse runs of a hull that does not roll, and copies that are spoilt."""

from __future__ import annotations

from functools import cache

import numpy as np
import xarray as xr

import pymc_ship as ps
from pymc_ship.inference.trajectory.posterior import TrajectoryMode, laplace_posterior, trajectory_mode
from pymc_ship.inference.trajectory.prior import coefficient_prior
from pymc_ship.physics.vessel.vessel import Vessel
from tests.inference.trajectory.cases import record, rough, unmodelled_roll_text


@cache
def hull() -> Vessel:
    return unmodelled_roll_text(ps.load_vessel("container"))


@cache
def short_mode(prior: str = "order_damped", noise: str = "white") -> TrajectoryMode:
    """Mode from 120 s of a zigzag and 60 s of a turn, sampled twice a second; offsets where noise is correlated."""
    runs = [ps.zigzag(20.0, 20.0), 120.0, 1], [ps.turning_circle(35.0), 60.0, 2]
    trials = [rough(record(hull(), what, interval=0.5, duration=duration), seed) for what, duration, seed in runs]
    chosen = coefficient_prior(trials, hull()).fixed if prior == "fixed" else prior
    return trajectory_mode(trials, hull(), chosen, noise=noise, offsets=noise == "ar1")


@cache
def short_posterior(prior: str = "order_damped", noise: str = "white") -> xr.DataTree:
    """Read only; with a Pareto k-hat of 0.3, which so few data do not have."""
    tree = laplace_posterior(short_mode(prior, noise), draws=400, chains=4, rng=np.random.default_rng(1))
    return with_attrs(tree, pareto_khat=0.3)


def with_attrs(tree: xr.DataTree, **attrs) -> xr.DataTree:
    """Copy with other attrs; None takes one away."""
    copy = without(tree)
    copy.attrs = {key: value for key, value in (tree.attrs | attrs).items() if value is not None}
    return copy


def without(tree: xr.DataTree, *paths: str) -> xr.DataTree:
    """Copy that lacks groups, or variables given as ``"group/variable"``."""
    groups = {name: node.to_dataset() for name, node in tree.children.items() if name not in paths}
    for group, variable in (path.split("/") for path in paths if "/" in path):
        groups[group] = groups[group].drop_vars(variable)
    return xr.DataTree.from_dict({"/": tree.to_dataset(), **groups})


def changed(tree: xr.DataTree, path: str, change) -> xr.DataTree:
    """Copy in which a function has changed the values of one variable in place."""
    copy = without(tree)
    group, variable = path.split("/")
    dataset = copy[group].to_dataset().copy(deep=True)
    change(dataset[variable].values)
    return copy.assign({group: xr.DataTree(dataset)})


@cache
def sampled() -> xr.DataTree:
    """Read only; draws as a sampler leaves them: 4 chains of 500, divergences and energies, no Pareto k-hat."""
    rng = np.random.default_rng(4)
    tree = laplace_posterior(short_mode(), draws=2000, chains=4, rng=rng)
    stats = {"diverging": np.zeros((4, 500), dtype=bool), "energy": rng.standard_normal((4, 500))}
    stats = xr.Dataset({name: (("chain", "draw"), value) for name, value in stats.items()})
    return with_attrs(tree.assign({"sample_stats": xr.DataTree(stats)}), method="trajectory_nuts", pareto_khat=None)
