"""Gibbs, NUTS and the exact posterior on the study's own data, and twins that must disagree."""

from __future__ import annotations

import importlib
from dataclasses import replace

import arviz as az
import numpy as np
import pytest
import xarray as xr

from pymc_ship.diagnostics.agreement import agreement
from pymc_ship.inference.regression.tree import draws_tree
from pymc_ship.inference.sampling.gibbs import gibbs_posterior
from pymc_ship.inference.sampling.regression_model import nuts_posterior

module = importlib.import_module("pymc_ship.inference.sampling.gibbs")

FAMILIES = ("conjugate", "semiconjugate")
SAMPLERS = {"gibbs": gibbs_posterior, "nuts": nuts_posterior}
ESS_LIMIT, BFMI_LIMIT = 400.0, 0.3


def compare(case, name, tree):
    return agreement(case.exact, {name: tree}).isel(method=0)


def mixed(table, tree):
    """Gates on the chains themselves."""
    stats = tree["sample_stats"].dataset if "sample_stats" in tree.children else None
    return bool(
        table["r_hat"].max() < 1.01
        and min(table["ess_bulk"].min(), table["ess_tail"].min()) > ESS_LIMIT
        and (stats is None or (not stats["diverging"].any() and float(np.min(az.bfmi(stats["energy"]))) > BFMI_LIMIT))
    )


def note(compared, what, table):
    compared(what, table.attrs["comparisons"], table["largest_z"], table.attrs["z_limit"])


LONG = pytest.mark.consistency
CASES = [
    pytest.param(
        sampler,
        dof,
        family,
        prior,
        marks=() if (sampler, dof, prior) == ("gibbs", "yaw", "moderate") else LONG,
        id=f"{sampler}-{dof}-{family}-{prior}",
    )
    for sampler in SAMPLERS
    for dof in ("surge", "sway", "yaw", "roll")
    for family in FAMILIES
    for prior in ("evidence", "moderate")
]


@pytest.mark.parametrize(("sampler", "dof", "family", "prior"), CASES)
def test_samplers_agree_with_the_exact_posterior(study, compared, sampler, dof, family, prior):
    case = study(dof, family, prior)
    tree = SAMPLERS[sampler](case.data, case.prior, draws=2000, chains=4, rng=np.random.default_rng(11))
    table = compare(case, sampler, tree)
    note(compared, f"{sampler}, {dof}, {family}, {prior} prior", table)
    assert table["largest_z"] <= table.attrs["z_limit"]
    assert table["agrees"]
    assert mixed(table, tree)


TWINS = {
    "B as the scale": lambda case: replace(case.prior, scale=1.0 / case.prior.scale),
    "prior variance squared": lambda case: replace(case.prior, kappa=case.prior.kappa**2),
}


@pytest.mark.consistency
@pytest.mark.parametrize("family", FAMILIES)
@pytest.mark.parametrize("sampler", SAMPLERS)
@pytest.mark.parametrize("twin", TWINS)
def test_a_wrong_prior_disagrees(study, compared, twin, sampler, family):
    case = study("sway", family, "moderate")
    tree = SAMPLERS[sampler](case.data, TWINS[twin](case), draws=2000, chains=4, rng=np.random.default_rng(12))
    table = compare(case, sampler, tree)
    note(compared, f"twin: {twin}, {sampler}, {family}", table)
    assert table["largest_z"] > table.attrs["z_limit"]


@pytest.mark.consistency
@pytest.mark.parametrize("family", FAMILIES)
def test_a_sum_of_squares_short_of_a_row_disagrees(study, compared, monkeypatch, family):
    """The row farthest from the fit is left out of the sum, not of the count of rows."""
    case, rotate = study("sway", family, "moderate"), module.rotate
    residual = case.data.response - case.data.design_matrix @ case.exact.mean
    missing = float(np.max(residual**2)) / case.data.response_scale**2

    def short(data, prior):
        rotation = rotate(data, prior)
        return replace(rotation, residual_square=rotation.residual_square - missing)

    monkeypatch.setattr(module, "rotate", short)
    tree = gibbs_posterior(case.data, case.prior, draws=5000, chains=4, rng=np.random.default_rng(13))
    table = compare(case, "gibbs", tree)
    note(compared, f"twin: SSR short of a row, gibbs, {family}", table)
    assert table["largest_z"] > table.attrs["z_limit"]


@pytest.mark.consistency
@pytest.mark.parametrize("dof", ["surge", "yaw"])
def test_the_shape_of_the_full_conditional_is_not_that_of_the_marginal(study, compared, dof):
    """A + (n + c)/2 of Eq. 15 used for the marginal of sigma2, whose shape is A + n/2."""
    case, rng = study(dof, "conjugate", "moderate"), np.random.default_rng(14)
    largest = {}
    for name, extra in (("right", 0.0), ("twin", 0.5 * case.data.n_terms)):
        drawn = replace(case.exact, shape=case.exact.shape + extra).draw(8000, rng)
        laid_out = drawn[0].reshape(4, 2000, -1), drawn[1].reshape(4, 2000)
        tree = draws_tree(case.data, case.prior, *laid_out, method="conjugate", rng_state="")
        table = compare(case, "exact", tree)
        label = f"twin: shape A + (n + c)/2 as the marginal, {dof}" if extra else f"exact draws, {dof}, conjugate"
        note(compared, label, table)
        largest[name] = float(table["largest_z"])
    assert largest["right"] <= table.attrs["z_limit"] < largest["twin"]


@pytest.mark.parametrize("family", FAMILIES)
def test_a_chain_that_does_not_mix_fails_the_gates(study, family):
    """The right draws in an order that creeps: sorted by the noise variance."""
    case = study("yaw", family, "moderate")
    tree = gibbs_posterior(case.data, case.prior, draws=1000, chains=4, rng=np.random.default_rng(15))
    assert mixed(compare(case, "gibbs", tree), tree)
    posterior = tree["posterior"].dataset
    order = np.argsort(posterior["noise_variance"].to_numpy(), axis=1)
    rows = (np.arange(4)[:, None], order)
    values = {
        "coefficients": (("chain", "draw", "coefficient"), posterior["coefficients"].to_numpy()[rows]),
        "noise_variance": (("chain", "draw"), posterior["noise_variance"].to_numpy()[rows]),
    }
    creeping = xr.DataTree.from_dict({"posterior": xr.Dataset(values, posterior.coords)})
    table = compare(case, "creeping", creeping)
    assert not table["agrees"]
    assert not mixed(table, creeping)
    assert table["ess_bulk"].min() < ESS_LIMIT
