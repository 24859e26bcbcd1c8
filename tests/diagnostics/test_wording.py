"""Sentences of the errors of this wing, each checked once."""

from __future__ import annotations

import numpy as np
import xarray as xr

import pymc_ship as ps
from pymc_ship.diagnostics.agreement import agreement
from pymc_ship.diagnostics.page import check_posteriors
from pymc_ship.diagnostics.posterior_statistics import whiteness
from pymc_ship.diagnostics.regression import check_posterior
from pymc_ship.diagnostics.trajectory import check_trajectory
from pymc_ship.inference.regression.tree import exact_posterior
from pymc_ship.inference.rows.data import RegressionData
from tests.diagnostics.cases import changed, short_posterior, with_attrs, without
from tests.diagnostics.test_agreement import PRIOR, regression, right
from tests.sentences import wording


def compared(other):
    agreement(PRIOR.exact(regression()), {"right": right(), "other": other})


def of_other_terms():
    X = np.random.default_rng(1).normal(size=(30, 3))
    return exact_posterior(RegressionData.from_arrays(X, X[:, 0], scaling="none"), PRIOR, rng=np.random.default_rng(1))


def with_posterior(tree, change):
    return tree.assign({"posterior": xr.DataTree(change(tree["posterior"].to_dataset()))})


test_value_errors = wording(
    ValueError,
    ("found x1, x2, x3 in 'other'", lambda: compared(of_other_terms())),
    ("at least one posterior", lambda: agreement(PRIOR.exact(regression()), {})),
    *(
        (
            f"which is of normal errors, found {errors} errors in 'other'; leave it out",
            lambda errors=errors: compared(with_attrs(right(), errors=errors)),
        )
        for errors in ["student_t", "ar1"]
    ),
    (
        "needs at least one posterior, found none; give trees by name",
        lambda tmp_path: ps.diagnostic_report({}, tmp_path / "out"),
    ),
    (
        r"^junk is no posterior of this package, it lacks coefficients",
        lambda tmp_path: ps.diagnostic_report({"junk": xr.DataTree()}, tmp_path / "out"),
    ),
    (
        "needs ten values or more, found 9; use a longer trial",
        lambda: whiteness(np.resize([1.0, -1.0], 9)),
    ),
    (
        r"^x is no posterior of this package, it lacks coefficients, attrs.*\.$",
        lambda: check_posterior(xr.DataTree(), "x"),
    ),
    (r"it lacks attrs\['prior'\]; give one", lambda good: check_posterior(with_attrs(good, prior=None))),
    (
        "its prior or scaling is broken: A prior family is one of conjugate",
        lambda good: check_posterior(with_attrs(good, prior='{"family": "flat"}')),
    ),
    (
        "found infinity, NaN or nothing in noise_variance in x",
        lambda good: check_posterior(
            with_posterior(good, lambda one: one.assign(noise_variance=np.nan * one["noise_variance"])), "x"
        ),
    ),
    (
        "found 2 draws a chain",
        lambda good: check_posterior(with_posterior(without(good), lambda one: one.isel(draw=[0, 1]))),
    ),
    *(
        (sentence, lambda spoil=spoil: check_trajectory(spoil(short_posterior()), "x"))
        for spoil, sentence in [
            (
                lambda tree: without(tree, "posterior"),
                r"^x is no posterior of this package, it lacks coefficients; give",
            ),
            (
                lambda tree: with_attrs(tree, vessel=None, starts=None),
                r"lacks attrs\['vessel'\], attrs\['starts'\]; give",
            ),
            (lambda tree: with_attrs(tree, pareto_khat=None), r"lacks attrs\['pareto_khat'\]"),
            (
                lambda tree: with_attrs(tree, prior="{}"),
                "its prior is to give family, factors, and mean and scale of every",
            ),
            (
                lambda tree: with_attrs(tree, prior='{"family": "flat", "factors": {}, "mean": [0], "scale": [1]}'),
                "its prior",
            ),
            (lambda tree: tree.isel(draw=slice(3)), "four finite draws a chain or more, found 3 draws a chain in x"),
            (lambda tree: changed(tree, "posterior/coefficients", lambda v: v.fill(np.nan)), "NaN or nothing in coeff"),
        ]
    ),
)

test_vessel_errors = wording(
    ps.VesselError,
    (
        "must be of the vessel 'container', found 'ferry' in x",
        lambda good, container, tmp_path: ps.diagnostic_report(
            {"x": with_attrs(good, vessel="ferry")}, tmp_path / "out", container
        ),
    ),
    (
        "coefficients of 'container' in order, found Yvv, Yv in x",
        lambda good, container, tmp_path: ps.diagnostic_report(
            {"x": with_posterior(without(good, "log_likelihood"), lambda one: one.isel(coefficient=[1, 0]))},
            tmp_path / "out",
            container,
        ),
    ),
    (
        "must be of the vessel 'container', found 'flat_bottomed' in x",
        lambda container: check_posteriors({"x": short_posterior()}, container),
    ),
    (
        "to hold the surge sway yaw coefficients of 'container' in order, found Xu",
        lambda container: check_posteriors({"x": with_attrs(short_posterior(), vessel="container")}, container),
    ),
)
