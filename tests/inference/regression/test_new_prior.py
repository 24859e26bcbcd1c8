"""A prior family from outside the package goes every way that the families of the package go."""

import json
import re
from dataclasses import dataclass
from typing import ClassVar

import numpy as np
import pytest
from scipy import stats

import pymc_ship as ps
from pymc_ship.diagnostics.regression import contraction, prior_of
from pymc_ship.inference.regression.calibration import simulation_based_calibration
from pymc_ship.inference.regression.conjugate import ConjugatePrior
from pymc_ship.inference.regression.cross_validation import cross_validation
from pymc_ship.inference.regression.families import FAMILIES
from pymc_ship.inference.regression.semiconjugate import SemiConjugatePrior
from pymc_ship.inference.regression.tree import exact_posterior, read_posterior, write_posterior
from pymc_ship.inference.regression.tune import BoundWarning, tune_prior
from pymc_ship.inference.rows.data import RegressionData
from pymc_ship.inference.sampling.predictive import prior_draws
from pymc_ship.replication.figures import noise_variance
from tests.inference.regression.own_priors import RidgePrior, RootPrior, by_summation
from tests.inference.regression.peers import simulated
from tests.sentences import refused

PAPER = (ConjugatePrior, SemiConjugatePrior)


@pytest.fixture(autouse=True)
def registered():
    """Both families for the time of a test; the table of families is that of the process."""
    before = dict(FAMILIES)
    ps.register_family(RidgePrior)
    ps.register_family(RootPrior)
    yield
    FAMILIES.clear()
    FAMILIES.update(before)


def scaled(n_rows=60):
    plain = simulated(n_rows, 4, seed=1)
    return RegressionData.from_arrays(plain.design_matrix, plain.response, scaling="zscore", dof="sway", vessel="own")


def ridge(**changes):
    return RidgePrior(**({"mean": [0.1, 0.0, -0.2, 0.3], "kappa": [1.0, 2.0, 3.0, 4.0], "scale": 0.8} | changes))


def root(**changes):
    return RootPrior(**({"kappa": [1.0, 2.0, 3.0, 4.0], "shape": 4.0, "scale": 0.8} | changes))


def drawn(prior, draws=400):
    data = scaled()
    return exact_posterior(data, prior, draws=draws, rng=np.random.default_rng(2))


# the exact posterior --------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("family", PAPER)
def test_the_summation_of_the_outside_family_is_right(family):
    """With the power of a family of the package it gives that family's exact posterior."""
    data, prior = scaled(), family(kappa=[1.0, 2.0, 3.0, 4.0], shape=4.0, scale=0.8)
    own, known = by_summation(data, prior), prior.exact(data)
    np.testing.assert_allclose(own.mean, known.mean, rtol=1e-8)
    np.testing.assert_allclose(own.covariance, known.covariance, rtol=1e-6, atol=1e-12)
    assert own.log_evidence == pytest.approx(known.log_evidence, rel=1e-9)


def test_the_posterior_of_another_power_is_another():
    data = scaled()
    means = [family(kappa=1.0, shape=4.0, scale=0.8).exact(data).mean for family in (RootPrior, *PAPER)]
    assert all(np.abs(means[0] - other).max() > 1e-4 for other in (means[1], means[2]))


@pytest.mark.parametrize("prior", [ridge(), root()])
def test_cross_validation_asks_the_prior(prior):
    """One held-out row at a time: its predictive density is the evidence of all rows over that of the others."""
    plain = scaled(12)
    data = RegressionData.from_arrays(plain.design_matrix, plain.response, scaling="none")
    score = cross_validation(data, 12).score(prior)
    rest = [data.rows(np.arange(12) != k) for k in range(12)]
    gained = [prior.exact(data).log_evidence - prior.exact(rows).log_evidence for rows in rest]
    np.testing.assert_allclose(score.folds, gained, atol=1e-6)


def test_the_evidence_maximum_is_sought_in_the_familys_own_box():
    """A box of two names, neither of which is the shape."""
    data, rng = scaled(), np.random.default_rng(3)
    prior, log_evidence = ps.maximise_evidence(data, "ridge")
    assert (type(prior), prior.shape) == (RidgePrior, 3.0)
    others = [RidgePrior.from_box(noise_variance=v, kappa=k) for v, k in np.exp(rng.uniform(-8.0, 2.0, (200, 2)))]
    assert max(other.exact(data).log_evidence for other in others) <= log_evidence + 1e-6
    with pytest.warns(BoundWarning) as caught:
        narrow, less = ps.maximise_evidence(data, "ridge", box={"noise_variance": (5.0, 6.0), "kappa": (1e-3, 1e-2)})
    assert {"ridge", "sway", "noise_variance", "kappa"} <= set(re.findall(r"\w+", str(caught[0].message)))
    assert 14.9 < narrow.scale < 18.1
    assert less < log_evidence - 1.0


def test_bayesian_optimisation_seeks_there_too():
    found = tune_prior(scaled(), "ridge", evaluations=8, rng=np.random.default_rng(4))
    assert found.prior.family == "ridge"
    assert (found.points[:, 0] == 3.0).all()
    assert np.ptp(np.log(found.points[:, 2])) > 1.0
    assert repr(found).startswith("TunedPrior of the ridge family, 8 evaluations\n  prior       shape 3, scale ")


def test_a_trial_is_identified_under_it(small):
    trial = ps.simulate(small, ps.zigzag(20.0, 20.0), duration=200.0, step=0.1)
    noisy = ps.pollute(trial, level=1e-3, rng=np.random.default_rng(1))
    found = ps.identify(noisy, small, families=("ridge", "root"), interval=2.0)
    assert list(found.exact) == ["ridge", "root"]
    for family in ("ridge", "root"):
        trees = found.posteriors(family, draws=400, rng=np.random.default_rng(5))
        for dof, tree in trees.items():
            exact = found.exact[family][dof]
            error = tree["posterior"]["coefficients"].mean(("chain", "draw")).values - exact.mean
            assert np.abs(error / exact.sd).max() < 5.0 / np.sqrt(400)
            assert prior_of(tree) == found.priors[family][dof]


# draws ----------------------------------------------------------------------------------------------------------------


def test_draws_of_the_prior_have_its_power():
    """The coefficients over the fourth root of their noise variance are standard normal; over another root not."""
    data, prior = RegressionData.from_arrays(np.eye(4), np.arange(4.0), scaling="none"), root(shape=1.0)
    draws = prior_draws(data, prior, 4000, rng=np.random.default_rng(6))
    b, sigma2 = draws["coefficients"].values[0] / np.sqrt(prior.kappa), draws["noise_variance"].values[0]
    p_value = {power: stats.kstest((b / sigma2[:, None] ** power).ravel(), "norm").pvalue for power in (0, 0.25, 0.5)}
    assert p_value[0.25] > 1e-3
    assert max(p_value[0], p_value[0.5]) < 1e-6


@pytest.mark.parametrize("prior", [ridge(), root()])
def test_its_exact_posterior_is_calibrated(prior):
    found = simulation_based_calibration(scaled(8), prior, simulations=150, rng=np.random.default_rng(7))
    assert found.attrs["calibrated"]


def test_the_posterior_of_the_next_family_is_not():
    """The broken twin."""

    def wrong(data, prior, draws, rng):
        return ConjugatePrior(kappa=prior.kappa, shape=prior.shape, scale=prior.scale).exact(data).draw(draws, rng)

    data, prior = scaled(8), root(scale=0.01)
    found = simulation_based_calibration(data, prior, wrong, simulations=150, rng=np.random.default_rng(7))
    assert not found.attrs["calibrated"]


def test_gibbs_serves_a_family_of_power_one_and_refuses_one_of_a_half():
    data = scaled()
    tree = ps.gibbs_posterior(data, ridge(), draws=500, rng=np.random.default_rng(8))
    assert bool(ps.agreement(ridge().exact(data), {"gibbs": tree})["agrees"].all())
    assert not bool(ps.agreement(ridge(kappa=0.1).exact(data), {"gibbs": tree})["agrees"].any())
    with refused(ps.InferenceError, 0.5, "nuts_posterior"):
        ps.gibbs_posterior(data, root(), rng=np.random.default_rng(8))


@pytest.mark.slow
@pytest.mark.parametrize(
    "settings",
    [
        {},
        pytest.param({"sampler": "pymc"}, marks=pytest.mark.consistency),
        pytest.param({"errors": "student_t"}, marks=pytest.mark.consistency),
    ],
)
def test_nuts_agrees_with_it(settings):
    data = scaled()
    tree = ps.nuts_posterior(data, root(), rng=np.random.default_rng(9), **settings)
    if "errors" in settings:
        z = tree["posterior"]["coefficients"].mean(("chain", "draw")).values - root().exact(data).mean
        assert np.abs(z / root().exact(data).sd).max() < 0.5
        return
    assert bool(ps.agreement(root().exact(data), {"nuts": tree})["agrees"].all())
    assert not bool(ps.agreement(root(kappa=0.1).exact(data), {"nuts": tree})["agrees"].any())


# files and pages ------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("prior", [ridge(), root()])
def test_a_file_gives_the_prior_back(prior, tmp_path):
    tree = read_posterior(write_posterior(drawn(prior), tmp_path / "own.nc"))
    assert tree.attrs["method"] == prior.family
    assert prior_of(tree) == prior
    assert any("Hoerl" in work for work in json.loads(tree.attrs["citations"])) == (prior.family == "ridge")


def test_the_contraction_is_from_its_own_prior_variance():
    tree, data = drawn(root()), scaled()
    sigma2 = float(tree["posterior"]["noise_variance"].mean()) / data.response_scale**2
    expected = np.sqrt(np.array([1.0, 2.0, 3.0, 4.0]) * np.sqrt(sigma2)) * data.response_scale / data.column_scale
    np.testing.assert_allclose(contraction(tree)["prior_sd"], expected, rtol=1e-12)


@pytest.mark.usefixtures("undrawn")
def test_a_page_has_a_section_of_it(tmp_path):
    chains = ps.gibbs_posterior(scaled(), ridge(), draws=500, rng=np.random.default_rng(8))
    page = ps.diagnostic_report({"exact": drawn(ridge(), 2000), "gibbs": chains, "own": drawn(root())}, tmp_path)
    text = page.read_text(encoding="utf-8")
    assert "ridge prior on the scaled columns: mean −0.2 to 0.3, kappa 1 to 4, scale 0.8." in text
    assert "root prior on the scaled columns: mean 0, kappa 1 to 4, shape 4, scale 0.8." in text
    assert text.count("gibbs agrees") == 1


def test_a_figure_has_its_colour():
    figure = noise_variance({"ridge": ridge().exact(scaled())}, "sway")
    assert {line.get_color() for line in figure.axes[0].lines} == {"#3a8f4d"}


# the table of families ------------------------------------------------------------------------------------------------


def test_a_family_lacks_nothing_and_has_its_own_name():
    @dataclass(frozen=True, eq=False)
    class Vague(ps.Prior):
        box: ClassVar = {"kappa": (1.0, 2.0)}

    with refused(ps.InferenceError, "noise_power"):
        ps.register_family(Vague)

    @dataclass(frozen=True, eq=False)
    class Second(RidgePrior):
        pass

    with refused(ps.InferenceError, "ridge"):
        ps.register_family(Second)
    assert ps.register_family(RidgePrior) is FAMILIES["ridge"]
