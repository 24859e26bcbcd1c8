"""Sentences of the errors of this wing, each checked once."""

from __future__ import annotations

from dataclasses import replace
from functools import partial

import numpy as np
import pytest
import xarray as xr

import pymc_ship as ps
from pymc_ship.inference.regression.conjugate import ConjugatePrior
from pymc_ship.inference.regression.semiconjugate import SemiConjugatePrior
from pymc_ship.inference.regression.tree import exact_posterior
from pymc_ship.inference.rows.data import RegressionData
from pymc_ship.inference.sampling.from_pymc import posterior_tree
from pymc_ship.inference.sampling.gibbs import gibbs, gibbs_posterior
from pymc_ship.inference.sampling.hierarchical_model import group_of_rows, hierarchical_model, hierarchical_posterior
from pymc_ship.inference.sampling.predictive import predict, prior_draws, with_predictive
from pymc_ship.inference.sampling.regression_model import nuts_posterior, pymc_model
from pymc_ship.inference.sampling.trajectory_model import (
    mode_model,
    mode_nuts_posterior,
    trajectory_model,
    trajectory_nuts_posterior,
)
from pymc_ship.machine.errors import FitError, InferenceError
from tests.inference.rows.frames import motion
from tests.inference.sampling.cases import regression
from tests.inference.sampling.test_from_pymc import DATA, ROWS, plain_model, sampled, tree_of_law, tree_of_rows
from tests.inference.sampling.test_gibbs import case
from tests.inference.sampling.test_hierarchical_model import PRIOR, data_of
from tests.inference.sampling.test_predictive import tree_of
from tests.inference.sampling.test_trajectory_model import mode, trial
from tests.sentences import wording


def ships():
    """Rows of three ships, with two coefficients."""
    return data_of(np.random.default_rng(1), np.zeros((3, 2)), np.ones(3))


def tree_that_lacks(change):
    tree = sampled().copy()
    tree["posterior"] = change(tree["posterior"].to_dataset())
    posterior_tree(tree, DATA)


def rows_of_the_model(n_rows):
    return xr.Dataset({"y": (("chain", "draw", "row"), np.zeros((4, 500, n_rows)))})


def tree_with(**groups):
    posterior_tree(xr.DataTree.from_dict({"posterior": sampled()["posterior"].to_dataset(), **groups}), DATA)


def predicted(change=lambda group: group, data=None):
    posterior = change(tree_of(ConjugatePrior, draws=40)[2]["posterior"].to_dataset())
    predict(xr.DataTree.from_dict({"/posterior": posterior}), np.ones((1, 5)), data=data, rng=2)


def predictive(rows=slice(None), lacks=(), scale=1.0, **settings):
    data, prior, tree = tree_of(ConjugatePrior)
    tree = tree.filter(lambda group: group.name not in lacks)
    data = replace(data.rows(np.arange(60)[rows]), response_scale=scale * data.response_scale)
    with_predictive(tree, data, prior, rng=np.random.default_rng(1), **settings)


def predicted_by_a_formula():
    pytest.importorskip("formulae", reason="installed by pymc-ship[formula]")
    frame = pytest.importorskip("pandas").DataFrame(motion())
    data = RegressionData.from_formula("Y ~ v + v:r + I(delta**2)", frame, scaling="none")
    predict(exact_posterior(data, ConjugatePrior(), draws=40, rng=1), frame, rng=2)


def modelled(rows=slice(None), **settings):
    pymc_model(regression("tall").rows(np.arange(60)[rows]), ConjugatePrior(), **settings)


def sampled_by_nuts(rows=slice(None), kappa=1.0, **settings):
    data = regression("tall").rows(np.arange(60)[rows])
    nuts_posterior(data, ConjugatePrior(kappa=kappa), rng=np.random.default_rng(1), **settings)


def far_mode():
    choice = mode().choice
    return replace(mode(), choice=replace(choice, fit=replace(choice.fit, unknowns=1e3 * choice.fit.unknowns)))


GAP = np.r_[0:20, 30:60]

test_value_errors = wording(
    ValueError,
    *(
        (
            "must be a whole number from [01] up, found",
            lambda numbers=numbers: gibbs_posterior(*case(), rng=np.random.default_rng(1), **numbers),
        )
        for numbers in [{"draws": 0}, {"chains": 0}, {"tune": -1}]
    ),
    *(
        (
            sentence,
            lambda bad=bad: hierarchical_posterior(ships(), PRIOR, rng=1, **bad),
        )
        for bad, sentence in [
            ({"target_accept": 1.5}, r"target_accept must lie between 0 and 1, found 1\.5; correct it\."),
            ({"chains": 0}, "chains must be a whole number from 1 up, found 0; correct"),
        ]
    ),
    *(
        (sentence, partial(tree_that_lacks, change=change))
        for change, sentence in [
            (lambda group: group.drop_vars("scaled_coefficients"), "must have 'coefficients' with dims chain, draw"),
            (lambda group: group.isel(coefficient=slice(1, None)), "must have 'coefficients' with dims chain, draw"),
            (lambda group: group.assign_coords(coefficient=list("abcde")), "must have the coefficients of the data"),
        ]
    ),
    (
        "^A prediction needs errors of a known law, normal, student_t, ar1, found another one or no log_likelihood",
        lambda: predict(tree_of_law("normal", with_model=False), DATA.design_matrix, rng=1),
    ),
    ("need a generator", lambda: posterior_tree(sampled(), DATA, plain_model())),
    (
        r"The NUTS sampler is one of nutpie, pymc, numpyro, blackjax; found 'stan'",
        lambda: sampled_by_nuts(sampler="stan"),
    ),
    ("draws must be a whole number from 1 up, found 0", lambda: predictive(draws=0)),
    *(
        (f"^The data must be those of the posterior, found {fault} in its tree; give the", partial(predictive, **given))
        for fault, given in [
            ("another response and design matrix", {"rows": slice(30)}),
            ("another response scale", {"scale": 2.0}),
            ("another response and design matrix", {"rows": slice(None, None, -1)}),
            ("no observed_data", {"lacks": ("observed_data", "constant_data")}),
        ]
    ),
    (
        r"^The group log_likelihood has one value for each chain, draw and row, found shape \(4, 500, 3\) for 60 rows",
        lambda: tree_with(log_likelihood=rows_of_the_model(3)),
    ),
    (
        "^The observed variable y must be the response of the data, found 60 other values; give the data",
        lambda: tree_with(observed_data=xr.Dataset({"y": ("row", DATA.response[::-1])})),
    ),
    (
        "^The design_matrix must be that of the data, .*, found another one; give",
        lambda: tree_with(constant_data=xr.Dataset({"design_matrix": (("row", "term"), np.zeros((60, 5)))})),
    ),
    (
        "^Rows in the order of the data are numbered from 0 up, found another order in log_likelihood and no obs",
        lambda: posterior_tree(tree_of_rows(ROWS[::-1]), DATA),
    ),
    (
        "found 'cauchy'",
        lambda: prior_draws(*tree_of(ConjugatePrior)[:2], 10, rng=np.random.default_rng(1), errors="cauchy"),
    ),
    (
        r"^A prediction needs coefficients .*, found coefficients; give the",
        lambda: predicted(lambda group: group.drop_vars("noise_variance")),
    ),
    (
        r"^The data must be those of the posterior, of x1, .*, found x1, x2; give",
        lambda: predicted(data=RegressionData.from_arrays(np.eye(5)[:, :2], np.ones(5), scaling="none")),
    ),
    ("tune must be a whole number from 1 up, found 0", lambda: sampled_by_nuts(tune=0)),
    (
        "tune must be a whole number from 1 up, found 0",
        lambda container: trajectory_nuts_posterior(trial(1), container, tune=0, rng=np.random.default_rng(1)),
    ),
    ("normal, student_t, ar1; found 'cauchy'", lambda: modelled(errors="cauchy")),
    ("normal, student_t, ar1; found 'cauchy'", lambda: sampled_by_nuts(errors="cauchy")),
)

test_errors_of_priors = wording(
    InferenceError,
    (
        "The prior's kappa is one value or 3, one for each term; found 2",
        lambda: gibbs(case()[0], SemiConjugatePrior(kappa=[1.0, 2.0]), rng=np.random.default_rng(1)),
    ),
    (
        "a conjugate prior of the means cannot depend on; give a SemiConjugate",
        lambda: hierarchical_model(ships(), ConjugatePrior()),
    ),
    *(
        (
            rf"lies between 0 and {DATA.n_terms}, the number of terms, found ",
            lambda effective=effective: pymc_model(DATA, partial(ps.horseshoe, effective=effective)),
        )
        for effective in [0.0, DATA.n_terms, float("nan")]
    ),
    ("5, one for each term", lambda: sampled_by_nuts(kappa=[1.0, 2.0])),
)

test_errors_of_rows = wording(
    ps.InferenceError,
    (
        "Every run needs a group, found none for ship 2",
        lambda: group_of_rows(ships(), {"ship 0": "port", "ship 1": "starboard"}),
    ),
    (
        "two groups of runs or more, found all alone",
        lambda: group_of_rows(ships(), dict.fromkeys(["ship 0", "ship 1", "ship 2"], "all")),
    ),
    ("one trial or several, found none", lambda container: ps.regression_data([], container, "yaw")),
    (r"^New rows need the columns Intercept, v, v:r, I", predicted_by_a_formula),
    ("uniform times, found steps from 1 to 11 s", lambda: modelled(GAP, errors="ar1")),
    (
        "contiguous rows at uniform times, found rows of one run apart; use every row of each trial",
        lambda: pymc_model(
            replace(regression("tall"), run=np.array(["a", "b", "a"]).repeat(20)), ConjugatePrior(), "ar1"
        ),
    ),
    ("uniform times", lambda: sampled_by_nuts(GAP, errors="ar1")),
    ("uniform times", lambda: modelled(slice(None, None, -1), errors="ar1")),
)

test_trial_errors = wording(
    ps.TrialError,
    ("A trial must be one xarray Dataset", lambda container: ps.regression_data(["trial.csv"], container, "yaw")),
)

test_fit_errors = wording(
    FitError,
    (r"leaves the model's range at the mode; repeat the fit", lambda: mode_model(far_mode())),
    (
        r"leaves the model's range at the mode",
        lambda: mode_nuts_posterior(far_mode(), draws=1, chains=1, tune=1, rng=np.random.default_rng(1)),
    ),
    ("found none", lambda container: trajectory_model([], container)),
)
