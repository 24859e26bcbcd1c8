"""Which posteriors share a section: draws of one posterior by several methods."""

import numpy as np
import pytest
import xarray as xr

import pymc_ship as ps
from pymc_ship.diagnostics.agreement import comparisons
from tests.diagnostics.cases import without
from tests.diagnostics.regressions import regression, three_ways
from tests.inference.regression.peers import exact_of

pytestmark = pytest.mark.filterwarnings("error")


def test_draws_of_one_posterior_share_a_section_and_others_do_not():
    """Exact draws first, wherever they stand; other data, another prior and other errors stand alone."""
    data, prior = regression()
    trees = three_ways()
    others = {
        "prior": ps.gibbs_posterior(data, ps.ConjugatePrior(kappa=9.0), draws=100, rng=np.random.default_rng(0)),
        "data": ps.gibbs_posterior(regression(12)[0], prior, draws=100, rng=np.random.default_rng(0)),
        "errors": three_ways(errors="student_t")["c"],
        "bare": without(trees["b"], "constant_data"),
        "other exact": three_ways()["a"],
    }
    found = comparisons({"c": trees["c"], **others, "a": trees["a"], "b": trees["b"]})
    assert [one.name for one in found] == ["other exact, c, b", "prior", "data", "errors", "bare", "a"]
    assert [one.agreement is None for one in found] == [False, True, True, True, True, True]
    together = found[0]
    assert list(together.trees) == ["exact", "nuts", "gibbs"]
    assert together.posterior is others["other exact"]
    assert together.sampler == "nuts"


def test_saved_draws_are_compared_with_the_exact_posterior_itself():
    """Data and prior read from the exact draws give the agreement of the posterior they were drawn from."""
    trees, exact = three_ways(), exact_of(*regression())
    (found,) = comparisons(trees)
    xr.testing.assert_allclose(found.agreement, ps.agreement(exact, {"gibbs": trees["b"], "nuts": trees["c"]}))
    assert found.agreement["agrees"].all()
    assert (found.failed_diagnostics, found.disagreements) == ([], [])


def test_draws_of_one_method_twice_are_told_apart_by_their_names():
    trees = three_ways()
    (found,) = comparisons({**trees, "d": trees["b"]})
    assert list(found.trees) == ["a", "b", "c", "d"]
    assert found.agreement["method"].values.tolist() == ["b", "c", "d"]
