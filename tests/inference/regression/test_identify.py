from types import SimpleNamespace

import numpy as np
import pytest
import xarray as xr

import pymc_ship as ps
from pymc_ship.inference.regression import identify as identification
from pymc_ship.inference.regression.families import FAMILIES
from pymc_ship.inference.regression.identify import identify
from pymc_ship.records.denoising.derivative import DERIVATIVES
from tests.physics.vessel.cases import TERMS


@pytest.fixture(scope="module")
def noisy(trial):
    return ps.pollute(trial, level=1e-3, rng=np.random.default_rng(1))


@pytest.fixture(scope="module")
def found(noisy, small):
    return identify(noisy, small, families=("conjugate",))


def test_a_perfect_record_gives_back_the_vessel(trial, small):
    """Euler differences undo an Euler simulation, so only rounding and the prior's pull are left."""
    found = identify(trial, small, families=("conjugate",), interval=2.0)
    for dof, mean in found.coefficients("conjugate").items():
        np.testing.assert_allclose(mean, small.coefficients(dof), rtol=1e-9)


def test_every_dof_and_family_has_data_prior_and_posterior(found, small):
    assert tuple(found.data) == tuple(found.exact["conjugate"]) == tuple(found.priors["conjugate"]) == small.dofs
    assert small.dofs == ("surge", "sway", "yaw")
    assert found.tuned == {"conjugate": {}}
    for dof, data in found.data.items():
        assert data.coefficients == TERMS[dof]
        assert data.n_rows == 200


def test_evidence_selects_the_evidence_maximum_and_the_posterior_is_exact(found):
    prior, log_evidence = ps.maximise_evidence(found.data["yaw"], "conjugate")
    assert found.priors["conjugate"]["yaw"] == prior
    assert found.exact["conjugate"]["yaw"].log_evidence == pytest.approx(log_evidence, rel=1e-12)
    for dof, data in found.data.items():
        expected = found.priors["conjugate"][dof].exact(data).mean
        np.testing.assert_array_equal(found.exact["conjugate"][dof].mean, expected)
        np.testing.assert_array_equal(found.coefficients("conjugate")[dof], expected)


def test_draws_scatter_around_the_exact_mean(found):
    """Tolerance: five Monte-Carlo standard errors, ten coefficients."""
    n_draws = 4000
    for dof, tree in found.posteriors("conjugate", draws=n_draws, rng=np.random.default_rng(2)).items():
        exact = found.exact["conjugate"][dof]
        draws = tree["posterior"]["coefficients"].stack(sample=("chain", "draw"))
        assert draws.sizes["sample"] == n_draws
        z = (draws.mean("sample") - exact.mean) / (exact.sd / np.sqrt(n_draws))
        assert float(np.abs(z).max()) < 5.0
        assert tree.attrs["dof"] == dof


def test_draws_repeat_with_the_generator_and_differ_between_dofs(found):
    one, two = (found.posteriors("conjugate", draws=8, rng=np.random.default_rng(3)) for _ in range(2))
    for dof in found.data:
        xr.testing.assert_identical(one[dof]["posterior"].to_dataset(), two[dof]["posterior"].to_dataset())
    noise = [
        tree["posterior"]["noise_variance"].values / tree["posterior"]["noise_variance"].values.mean()
        for tree in one.values()
    ]
    assert not np.allclose(noise[0], noise[1], rtol=1e-3)


@pytest.mark.parametrize("family", FAMILIES)
def test_bayesian_optimisation_takes_the_tuned_prior(noisy, small, monkeypatch, family):
    priors, calls = iter(FAMILIES[family](kappa=kappa) for kappa in (10.0, 20.0, 30.0)), []

    def tune_prior(data, *, family, rng):
        calls.append((data.dof, family, rng))
        return SimpleNamespace(prior=next(priors))

    monkeypatch.setattr(identification, "tune_prior", tune_prior)
    rng = np.random.default_rng(4)
    found = identify(noisy, small, families=(family,), selection="bayesian_optimisation", rng=rng)
    assert calls == [(dof, family, rng) for dof in small.dofs]
    assert [prior.kappa for prior in found.priors[family].values()] == [10.0, 20.0, 30.0]
    for dof, data in found.data.items():
        assert found.tuned[family][dof].prior is found.priors[family][dof]
        np.testing.assert_array_equal(found.exact[family][dof].mean, found.priors[family][dof].exact(data).mean)


@pytest.mark.slow
def test_both_families_agree_on_a_good_record(noisy, small):
    found = identify(noisy, small)
    assert tuple(found.exact) == tuple(FAMILIES)
    for dof in small.dofs:
        one, other = (found.exact[family][dof] for family in FAMILIES)
        assert np.abs((one.mean - other.mean) / one.sd).max() < 0.1


def test_interval_and_derivative_reach_the_rows(trial, small, monkeypatch):
    """One row each two seconds; a central difference is not exact for an Euler record, an Euler one is."""
    vague = FAMILIES["conjugate"](kappa=1e10, shape=0.1, scale=1e-9)
    monkeypatch.setattr(identification, "maximise_evidence", lambda rows, family: (vague, 0.0))
    settings = {"families": ("conjugate",), "interval": 2.0}
    euler, central = (identify(trial, small, derivative=name, **settings) for name in ("euler", "central"))
    reference = small.coefficients("yaw").values
    errors = [np.abs(found.coefficients("conjugate")["yaw"] / reference - 1.0).max() for found in (euler, central)]
    assert euler.data["yaw"].n_rows == 100
    assert {found.data["yaw"].derivative for found in (euler, central)} == {"euler", "central"} <= set(DERIVATIVES)
    assert errors[0] < 1e-9 < 1e-4 < errors[1]


@pytest.mark.parametrize("family", FAMILIES)
def test_the_weak_form_goes_the_same_way(trial, noisy, small, family):
    """On the clean record only the prior's pull is left; under noise the posterior is narrower than that of Euler."""
    settings = {"families": (family,), "interval": 4.0}
    clean, rough = (identify(run, small, derivative="weak_euler", **settings) for run in (trial, noisy))
    euler = identify(noisy, small, derivative="euler", **settings)
    for dof in small.dofs:
        np.testing.assert_allclose(clean.coefficients(family)[dof], small.coefficients(dof), rtol=1e-6)
        assert rough.data[dof].n_rows == 47
        assert (rough.exact[family][dof].sd < 0.5 * euler.exact[family][dof].sd).all()


def test_progress_names_every_step(trial, small, monkeypatch):
    monkeypatch.setattr(identification, "maximise_evidence", lambda rows, family: (FAMILIES[family](), 0.0))
    messages = []
    identify(trial, small, progress=messages.append)
    assert messages == [f"prior of {dof}, {family}" for family in FAMILIES for dof in small.dofs]
