"""Partial pooling: the collapsed sampler against the full model, and the page of groups."""

from dataclasses import replace
from functools import cache

import arviz as az
import numpy as np
import pytest
from scipy import stats

import pymc_ship as ps
from pymc_ship.inference.sampling.hierarchical_model import group_of_rows, hierarchical_model, hierarchical_posterior
from pymc_ship.inference.sampling.regression_model import sample_model
from tests.sentences import refused

PRIOR, SPREAD, GROUPS = ps.SemiConjugatePrior(kappa=1.0, shape=4.0, scale=1.0), 0.5, 3


def truth(rng, p=2):
    """Coefficients of each group and noise variances from the prior, with their spreads and means."""
    tau = np.abs(SPREAD * rng.standard_normal(p))
    means = rng.standard_normal(p)
    variance = stats.invgamma(PRIOR.shape, scale=PRIOR.scale).rvs(GROUPS, random_state=rng)
    return tau, means, means + tau * rng.standard_normal((GROUPS, p)), variance


@cache
def columns():
    """Rows of three groups, of 4 to 20."""
    group = np.repeat(np.arange(GROUPS), (4, 12, 20))
    return np.random.default_rng(5).standard_normal((group.size, 2)), group


def data_of(rng, coefficients, variance):
    X, group = columns()
    response = np.sum(X * coefficients[group], axis=1) + np.sqrt(variance[group]) * rng.standard_normal(group.size)
    return ps.RegressionData.from_arrays(X, response, run=[f"ship {g}" for g in group], scaling="none")


@pytest.mark.consistency
def test_the_collapsed_sampler_draws_from_the_full_model():
    rng = np.random.default_rng(3)
    _, _, each, variance = truth(rng)
    data = data_of(rng, each, variance)
    tree = hierarchical_posterior(data, PRIOR, spread=SPREAD, draws=1000, rng=1)
    settings = {"draws": 1000, "chains": 4, "tune": 1000, "target_accept": 0.95}
    plain = sample_model(hierarchical_model(data, PRIOR, spread=SPREAD), settings, 2, progress=False)
    names = ["coefficients", "group_coefficients", "group_sd", "group_noise_variance"]
    one, other = (tree_or_plain["posterior"].dataset[names] for tree_or_plain in (tree, plain))
    error = {name: np.hypot(az.mcse(one)[name], az.mcse(other)[name]) for name in names}
    difference = {name: one[name].mean(("chain", "draw")) - other[name].mean(("chain", "draw")) for name in names}
    z = np.concatenate([(np.abs(difference[name]) / error[name]).values.ravel() for name in names])
    assert z.max() < stats.norm.ppf(1.0 - 0.5e-3 / z.size)
    assert int(tree["sample_stats"]["diverging"].sum()) == 0
    shapes = {name: dict(tree["posterior"][name].sizes) for name in names}
    assert shapes["group_coefficients"] == {"chain": 4, "draw": 1000, "group": 3, "coefficient": 2}
    wrong = replace(data, response=data.response + 0.3 * data.design_matrix[:, 0])
    moved = hierarchical_posterior(wrong, PRIOR, spread=SPREAD, draws=1000, rng=1)["posterior"]["coefficients"]
    shift = abs(float((moved - one["coefficients"]).mean(("chain", "draw"))[0]))
    assert shift > 5.0 * float(error["coefficients"].max())


@pytest.mark.consistency
def test_the_page_names_the_coefficients_that_differ(tmp_path):
    """Groups 1 and 2 differ in the first coefficient alone."""
    rng = np.random.default_rng(4)
    each = np.array([[1.0, 0.5], [1.0, 0.5], [-1.0, 0.5]])
    tree = hierarchical_posterior(data_of(rng, each, np.full(3, 0.01)), PRIOR, spread=1.0, draws=500, rng=1)
    text = ps.diagnostic_report({"ships": tree}, tmp_path).read_text(encoding="utf-8")
    assert "ship 1 - ship 2: x1 differs" in text
    assert "x2 differ" not in text
    assert "Drawn are the coefficient of largest R-hat and the most correlated pair." in text
    assert "rows have a Pareto k above" in text
    assert "Posterior predictive responses, as the tree holds them" in text
    assert "Not shown: power-scaling the priors of groups" in text


def test_runs_are_grouped():
    X, group = columns()
    data = data_of(np.random.default_rng(1), np.zeros((3, 2)), np.ones(3))
    labels, rows = group_of_rows(data, {"ship 0": "port", "ship 1": "starboard", "ship 2": "port"})
    assert labels == ["port", "starboard"]
    assert rows.tolist() == [int(g == 1) for g in group]
    assert X.shape == data.design_matrix.shape
    with refused(ps.InferenceError, "ship", 2):
        group_of_rows(data, {"ship 0": "port", "ship 1": "starboard"})
    with refused(ps.InferenceError, "all"):
        group_of_rows(data, dict.fromkeys(["ship 0", "ship 1", "ship 2"], "all"))
    with refused(ps.InferenceError, "SemiConjugatePrior"):
        hierarchical_model(data, ps.ConjugatePrior())


def test_several_trials_have_one_scaling_and_their_runs():
    vessel = ps.load_vessel("kvlcc2")
    zigzags = {side: ps.zigzag(20, 20, side=side) for side in ("port", "starboard")}
    trials = {side: ps.simulate(vessel, zigzag, duration=300, step=0.5) for side, zigzag in zigzags.items()}
    trials["port"] = trials["port"].assign_attrs(record_verdict="doubtful", record_remarks="Doubtful: spikes.")
    both = ps.regression_data(trials, vessel, "yaw", interval=2.0)
    assert (both.record_verdict, both.record_remarks) == ("doubtful", "port: Doubtful: spikes.")
    alone = [ps.regression_data(trial, vessel, "yaw", interval=2.0) for trial in trials.values()]
    np.testing.assert_array_equal(both.design_matrix, np.vstack([one.design_matrix for one in alone]))
    assert both.run.tolist() == ["port"] * alone[0].n_rows + ["starboard"] * alone[1].n_rows
    np.testing.assert_allclose(np.sqrt(np.mean(both.scaled_design_matrix**2, axis=0)), 1.0)
    assert list(dict.fromkeys(ps.regression_data(list(trials.values()), vessel, "yaw", interval=2.0).run)) == ["1", "2"]
    with refused(ps.TrialError, "xarray"):
        ps.regression_data(["trial.csv"], vessel, "yaw")
    with refused(ps.InferenceError, "none"):
        ps.regression_data([], vessel, "yaw")


def test_runs_may_be_numbers():
    data = ps.RegressionData.from_arrays(np.eye(4), np.arange(4.0), run=[1, 1, 2, 2], scaling="none")
    labels, group = group_of_rows(data, {1: "port", 2: "starboard"})
    assert (labels, group.tolist()) == (["port", "starboard"], [0, 0, 1, 1])
