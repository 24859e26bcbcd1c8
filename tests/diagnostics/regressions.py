"""Posteriors of regressions: a good one, one of which a chain stands elsewhere, and one by three methods."""

from __future__ import annotations

import numpy as np
import xarray as xr

import pymc_ship as ps
from pymc_ship.diagnostics.agreement import Comparison
from pymc_ship.diagnostics.regression_subsections import REGRESSION


def posterior(container, wave=0.0, draws=800):
    """Posterior of the container ship's first sway coefficients, as a vessel of that name would have them."""
    rng = np.random.default_rng(7)
    names = [str(name) for name in container.coefficients("sway")["coefficient"].values]
    X = rng.standard_normal((120, len(names)))
    noise = 1e-4 * rng.standard_normal(120)
    for k in range(1, 120):
        noise[k] += wave * noise[k - 1]
    response = X @ container.coefficients("sway").values + noise
    labels = {"dof": "sway", "vessel": "container", "derivative": "euler"}
    data = ps.RegressionData.from_arrays(X, response, names, scaling="zscore", time=np.arange(120.0), **labels)
    return ps.exact_posterior(data, ps.ConjugatePrior(kappa=1e4), draws=draws, chains=4, rng=rng)


def torn(tree):
    """Posterior of which one chain stands elsewhere."""
    draws = tree["posterior"].to_dataset().copy(deep=True)
    draws["coefficients"][3, :, 0] += 1.0
    return xr.DataTree.from_dict({"/": tree.to_dataset(), "posterior": draws})


def verdict_on(tree):
    return REGRESSION.verdict(Comparison("x", {"x": tree}))


def regression(seed=11):
    """Data of a raft with two coefficients, and the prior of its posteriors."""
    rng = np.random.default_rng(seed)
    X = rng.standard_normal((60, 2))
    labels = {"dof": "sway", "vessel": "raft"}
    data = ps.RegressionData.from_arrays(X, X.sum(axis=1) + 0.1 * rng.standard_normal(60), ("Yv", "Yr"), **labels)
    return data, ps.ConjugatePrior(kappa=10.0)


def three_ways(**changes):
    """Exact, Gibbs and NUTS draws of one posterior, those of NUTS (independent ones with its groups) last."""
    data, prior = regression()
    exact = ps.exact_posterior(data, prior, draws=4000, rng=np.random.default_rng(1))
    gibbs = ps.gibbs_posterior(data, prior, draws=1000, rng=np.random.default_rng(2))
    nuts = ps.exact_posterior(data, prior, draws=4000, rng=np.random.default_rng(3))
    energy = np.random.default_rng(4).standard_normal((4, 1000))
    stats = {"diverging": np.zeros((4, 1000), dtype=bool), "energy": energy}
    stats = xr.Dataset({name: (("chain", "draw"), value) for name, value in stats.items()})
    nuts = nuts.assign({"sample_stats": xr.DataTree(stats)})
    nuts.attrs |= {"method": "nuts"} | changes
    return {"a": exact, "b": gibbs, "c": nuts}


def shifted(tree, by=0.1):
    """Draws whose first coefficient sits so many standard deviations from where it belongs, without log likelihood."""
    draws = tree["posterior"].to_dataset().copy(deep=True)
    draws["coefficients"][..., 0] += by * draws["coefficients"][..., 0].std()
    return tree.assign({"posterior": xr.DataTree(draws)}).drop_nodes("log_likelihood")
