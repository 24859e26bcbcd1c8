"""New rows, predicted by the draws of a posterior."""

from __future__ import annotations

import numpy as np
import pytest
import xarray as xr
from scipy import stats

from pymc_ship.inference.regression.conjugate import ConjugatePrior
from pymc_ship.inference.regression.tree import exact_posterior
from pymc_ship.inference.rows.data import RegressionData
from pymc_ship.inference.sampling.predictive import predict
from pymc_ship.machine.errors import InferenceError
from tests.inference.rows.frames import motion
from tests.inference.sampling.test_predictive import FAMILIES, LIMIT, tree_of, z_of_moments
from tests.sentences import refused


@pytest.mark.parametrize("case", ["tall", "zscored", "wide"])
@pytest.mark.parametrize("family", FAMILIES)
def test_predictions_of_new_rows_have_the_exact_mean_and_variance(family, case):
    data, prior, tree = tree_of(family, case)
    new = np.random.default_rng(3).normal(size=(6, 5))
    mean, sd = prior.exact(data).predict(new)
    predicted = predict(tree, new, rng=2)
    z_mean, z_variance = z_of_moments(predicted["response"].values.reshape(4000, -1), mean, sd)
    assert max(z_mean.max(), z_variance.max()) < LIMIT
    np.testing.assert_allclose(predicted["expected"].values, tree["posterior"]["coefficients"].values @ new.T)
    np.testing.assert_allclose(predicted["sd"], predicted["response"].values.std((0, 1)))
    assert np.abs(predicted["mean"] - mean).max() < LIMIT * sd.max() / np.sqrt(4000)
    assert {name: value.dims for name, value in predicted.items()} == {
        "response": ("chain", "draw", "row"),
        "expected": ("chain", "draw", "row"),
        "mean": ("row",),
        "sd": ("row",),
    }


def test_predictions_without_noise_or_of_other_rows_fail():
    data, prior, tree = tree_of(ConjugatePrior)
    new = np.random.default_rng(3).normal(size=(6, 5))
    mean, sd = prior.exact(data).predict(new)
    predicted = predict(tree, new, rng=2)
    assert z_of_moments(predicted["expected"].values.reshape(4000, -1), mean, sd)[1].max() > LIMIT
    predicted = predict(tree, new[::-1], rng=2)
    assert z_of_moments(predicted["response"].values.reshape(4000, -1), mean, sd)[0].max() > LIMIT


def test_predictions_follow_from_the_seed():
    _, _, tree = tree_of(ConjugatePrior, draws=40)
    assert predict(tree, np.ones((1, 5)), rng=2).identical(predict(tree, np.ones((1, 5)), rng=np.random.default_rng(2)))
    assert not predict(tree, np.ones((1, 5)), rng=2).identical(predict(tree, np.ones((1, 5)), rng=3))


def test_predictions_have_the_errors_of_the_posterior():
    _, _, tree = tree_of(ConjugatePrior)
    posterior = tree["posterior"].to_dataset()
    nu = xr.full_like(posterior["noise_variance"], 2.5)
    heavy = xr.DataTree.from_dict({"/posterior": posterior.assign(degrees_of_freedom=nu)})
    heavy.attrs["errors"] = "student_t"
    kurtosis = [
        stats.kurtosis((predicted["response"] - predicted["expected"]).values, axis=None)
        for predicted in (predict(one, np.ones((1, 5)), rng=2) for one in (tree, heavy))
    ]
    assert kurtosis[0] < 1.0 < 10.0 < kurtosis[1]


def test_a_formula_is_evaluated_for_a_tree():
    pytest.importorskip("formulae", reason="installed by pymc-ship[formula]")
    frame = pytest.importorskip("pandas").DataFrame(motion())
    data = RegressionData.from_formula("Y ~ v + v:r + I(delta**2)", frame, scaling="none")
    tree = exact_posterior(data, ConjugatePrior(), draws=40, rng=1)
    predicted = predict(tree, frame[["delta", "v", "r"]].iloc[:3], data=data, rng=2)
    assert predicted.identical(predict(tree, data.design_matrix[:3], rng=2))
    with refused(InferenceError, "Intercept", "v:r"):
        predict(tree, frame, rng=2)
