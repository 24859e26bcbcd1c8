"""Parts and verdicts of the diagnostics: what they say of posteriors right, wrong or incomplete."""

import re

import numpy as np
import pytest
import xarray as xr

from pymc_ship.diagnostics import regression_subsections
from pymc_ship.diagnostics.agreement import Comparison, comparisons
from pymc_ship.diagnostics.regression import contraction
from pymc_ship.diagnostics.regression_subsections import REGRESSION
from pymc_ship.inference.regression.tree import read_posterior, write_posterior
from tests.diagnostics.cases import without
from tests.diagnostics.regressions import posterior, three_ways, verdict_on

pytestmark = pytest.mark.filterwarnings("error")


def test_the_verdict_counts_what_the_data_determine(good):
    convergence_diagnostics, determined, white = verdict_on(good)
    assert convergence_diagnostics == "All convergence diagnostics pass."
    count, total = map(int, re.match(r"(\d+) of (\d+) coefficients are determined by the data", determined).groups())
    assert 10 <= count < total == 28
    assert white.startswith("Residuals pass for white noise (r1 = ")


def test_the_verdict_on_correlated_residuals(container):
    white = verdict_on(posterior(container, wave=0.97))[2]
    assert re.match(
        r"Residuals are autocorrelated \(r1 = 0\.[4-9]\d*, Ljung-Box p = .*\): intervals are too narrow", white
    )
    assert white.endswith("leave-future-out or block folds are the right tool for serially correlated rows.")


def test_the_verdict_without_a_design_says_so(good):
    lines = verdict_on(without(good, "observed_data"))
    assert lines[1:] == [
        "What the data determine and the residuals are not known: the tree has no observed_data/response."
    ]


def test_a_prior_that_shrinks_is_measured_by_its_tails():
    """Four fifths of its draws are near zero: 5 % lie beyond 1.15, as of a normal prior of sd 0.587."""
    tree, rng = three_ways()["c"].copy(), np.random.default_rng(5)
    draws = np.where(rng.random((1, 20000, 2)) < 0.8, 0.01, 1.0) * rng.standard_normal((1, 20000, 2))
    tree["prior"] = xr.DataTree(xr.Dataset({"coefficients": (("chain", "draw", "coefficient"), draws)}))
    tree.attrs["prior"] = '{"family": "own"}'
    assert contraction(tree)["prior_sd"].values == pytest.approx(0.587, rel=0.05)


@pytest.mark.slow
def test_a_part_for_every_group_of_nuts(good):
    """sample_stats bring the energy; posterior_predictive is shown as the tree holds it."""
    rng = np.random.default_rng(0)
    shape = (4, 200)
    names = {"diverging": np.zeros(shape, dtype=bool), "energy": rng.standard_normal(shape)}
    stats = xr.Dataset({name: (("chain", "draw"), value) for name, value in names.items()})
    response = good["observed_data"]["response"].values + 1e-4 * rng.standard_normal((*shape, 120))
    drawn = xr.Dataset({"response": (("chain", "draw", "row"), response)})
    groups = {"sample_stats": xr.DataTree(stats), "posterior_predictive": xr.DataTree(drawn)}
    tree = without(good, "log_likelihood").assign(groups)
    found = {part.title: part for part in REGRESSION.subsections(Comparison("x", {"x": tree}), None, rng)}
    assert [image[0] for image in found["Energy"].images] == ["energy"]
    assert "as the tree holds them" in found["Prior and posterior predictive check"].text
    assert found["Convergence diagnostics"].text == ""
    assert "no vessel was given" in found["Coefficients"].images[0][2]


@pytest.mark.parametrize(
    ("trees", "sentence"),
    [
        (lambda three: {"c": three["c"]}, "no exact posterior of the same data and prior is given"),
        (lambda three: {"a": three["a"]}, "no draws of the same data and prior by another method are given"),
        (lambda three: {"c": three_ways(errors="ar1")["c"]}, "the exact posterior is of normal errors, these are ar1"),
    ],
)
def test_why_there_is_no_agreement_is_said(monkeypatch, trees, sentence):
    (one,) = comparisons(trees(three_ways()))
    part = regression_subsections._agreement(one)
    assert (part.text, part.tables) == (f"Not shown: {sentence}.", [])


def test_a_zarr_posterior_is_read_as_well(good, tmp_path):
    tree = read_posterior(write_posterior(without(good, "log_likelihood"), tmp_path / "x.zarr"))
    assert verdict_on(tree) == verdict_on(good)
