"""Properties that the exact posteriors of both families share."""

from __future__ import annotations

from dataclasses import replace

import arviz as az
import numpy as np
import pytest

from pymc_ship.inference.regression.conjugate import ConjugatePrior
from pymc_ship.inference.regression.semiconjugate import SemiConjugatePrior
from pymc_ship.inference.regression.tree import exact_posterior
from pymc_ship.inference.rows.data import RegressionData
from pymc_ship.machine.errors import InferenceError
from tests.inference.regression.cases import two_modes, vector_prior
from tests.inference.regression.peers import exact_of, largest_z, simulated, z_limit
from tests.sentences import refused


@pytest.fixture(params=[ConjugatePrior, SemiConjugatePrior], ids=lambda family: family.family)
def family(request):
    return request.param


class TestEvidence:
    @pytest.mark.parametrize(("n_rows", "n_terms"), [(12, 3), (4, 7)])
    @pytest.mark.parametrize("pointwise", [False, True])
    def test_it_is_the_product_of_one_step_ahead_predictives(self, family, n_rows, n_terms, pointwise):
        data, prior = simulated(n_rows, n_terms, seed=2), vector_prior(n_terms, family)
        total = prior.exact(data.rows(np.arange(1))).log_evidence
        for k in range(1, n_rows):
            step = data.rows(np.arange(k, k + 1))
            exact = prior.exact(data.rows(np.arange(k)))
            total += np.sum(exact.log_predictive_density(step.design_matrix, step.response, pointwise=pointwise))
        assert total == pytest.approx(prior.exact(data).log_evidence, abs=1e-10)

    @pytest.mark.parametrize(("n_rows", "n_terms"), [(12, 3), (6, 7), (6, 9)])
    def test_the_joint_predictive_is_a_ratio_of_evidences(self, family, n_rows, n_terms):
        data, prior = simulated(n_rows, n_terms, seed=3), vector_prior(n_terms, family)
        old, new = data.rows(np.arange(5)), data.rows(np.arange(5, n_rows))
        joint = prior.exact(old).log_predictive_density(new.design_matrix, new.response)
        assert joint == pytest.approx(prior.exact(data).log_evidence - prior.exact(old).log_evidence, abs=1e-10)


class TestScaling:
    def test_scaled_columns_with_the_equivalent_prior_give_the_same_posterior(self, family):
        rng = np.random.default_rng(5)
        X = rng.standard_normal((30, 4)) * [1.0, 1e-3, 50.0, 1e4]
        y = 1e-5 * (X @ [1.0, 2e3, 0.1, 1e-4] + rng.standard_normal(30))
        scaled = RegressionData.from_arrays(X, y, scaling="zscore")
        assert scaled.constant == -1
        prior, factor = vector_prior(4, family), scaled.response_scale / scaled.column_scale
        unit = scaled.response_scale ** (-2 * family.noise_power)  # kappa of the conjugate prior is over sigma2
        plain_prior = family(
            mean=prior.mean * factor,
            kappa=prior.kappa * factor**2 * unit,
            shape=prior.shape,
            scale=prior.scale * scaled.response_scale**2,
        )
        one, other = prior.exact(scaled), plain_prior.exact(RegressionData.from_arrays(X, y, scaling="none"))
        np.testing.assert_allclose(one.mean, other.mean, rtol=1e-10)
        np.testing.assert_allclose(one.sd, other.sd, rtol=1e-10)
        assert one.noise_variance_mean == pytest.approx(other.noise_variance_mean, rel=1e-10)
        assert one.log_evidence == pytest.approx(other.log_evidence, abs=1e-9)

    def test_centred_data_give_the_posterior_of_the_centred_arrays_and_its_jacobian(self, family):
        rng = np.random.default_rng(6)
        X = np.column_stack([rng.normal([3.0, -8.0], 1.0, (30, 2)), np.full(30, 2.0)])
        data = RegressionData.from_arrays(X, 1e-4 * (X @ [1.0, 2.0, 3.0] + rng.standard_normal(30)), scaling="zscore")
        plain = RegressionData.from_arrays(data.scaled_design_matrix, data.scaled_response, scaling="none")
        prior = vector_prior(3, family)
        one, other = prior.exact(data), prior.exact(plain)
        np.testing.assert_allclose(one.mean, data.to_original(other.mean), rtol=1e-10)
        T = data.transformation[1]
        np.testing.assert_allclose(one.covariance, T @ other.covariance @ T.T, rtol=1e-9, atol=1e-20)
        jacobian = 30 * np.log(data.response_scale)
        assert one.log_evidence == pytest.approx(other.log_evidence - jacobian, abs=1e-9)
        assert abs(jacobian) > 100.0


class TestLimits:
    def test_a_vague_prior_gives_least_squares(self, family):
        data = simulated(50, 4, seed=10)
        least_squares = np.linalg.lstsq(data.design_matrix, data.response, rcond=None)[0]
        np.testing.assert_allclose(family(kappa=1e12).exact(data).mean, least_squares, rtol=1e-8)

    def test_a_firm_prior_gives_its_mean(self, family):
        exact = family(mean=[1.0, 2.0, 3.0, 4.0], kappa=1e-12).exact(simulated(50, 4, seed=10))
        np.testing.assert_allclose(exact.mean, [1.0, 2.0, 3.0, 4.0], rtol=1e-8)

    def test_moments_that_do_not_exist_are_infinite(self, family):
        exact = family(shape=0.25).exact(simulated(1, 2, seed=1))
        assert exact.noise_variance_mean == exact.noise_variance_sd == np.inf


def case(family):
    return simulated(20, 3, seed=14), vector_prior(3, family)


CASES = {
    "conjugate": lambda: case(ConjugatePrior),
    "semiconjugate": lambda: case(SemiConjugatePrior),
    "two modes": two_modes,
    "more terms than rows": lambda: (simulated(3, 7, seed=1), vector_prior(7)),
}


CLOSED_FORM, QUADRATURE = 1e-12, 1e-10
"""Error of a prediction by a closed form, and of one by a quadrature over the noise variance."""


@pytest.mark.parametrize("name", CASES)
class TestPrediction:
    def test_the_pointwise_density_is_that_of_single_rows(self, name):
        exact = exact_of(*CASES[name]())
        new = simulated(4, len(exact.center), seed=13)
        densities = exact.log_predictive_density(new.design_matrix, new.response, pointwise=True)
        single = [exact.log_predictive_density(new.design_matrix[[k]], new.response[[k]]) for k in range(4)]
        np.testing.assert_allclose(densities, single, atol=CLOSED_FORM if name == "conjugate" else 1e-9)
        assert abs(densities.sum() - exact.log_predictive_density(new.design_matrix, new.response)) > 1e-3

    def test_it_adds_noise_to_the_spread_of_the_coefficients(self, name):
        exact = exact_of(*CASES[name]())
        X = simulated(4, len(exact.center), seed=13).design_matrix
        mean, sd = exact.predict(X)
        error = CLOSED_FORM if name == "conjugate" else QUADRATURE
        np.testing.assert_allclose(mean, X @ exact.mean, rtol=error)
        variance = exact.noise_variance_mean + np.einsum("ki,ij,kj->k", X, exact.covariance, X)
        np.testing.assert_allclose(sd, np.sqrt(variance), rtol=error)


class TestDraws:
    def z(self, exact, known):
        coefficients, noise_variance = exact.draw(40_000, np.random.default_rng(1))
        return largest_z(coefficients.reshape(4, -1, 3), noise_variance.reshape(4, -1), known)

    def test_their_moments_are_exact(self, family):
        z, comparisons = self.z(exact_of(*case(family)), exact_of(*case(family)))
        assert z < z_limit(comparisons)

    @pytest.mark.parametrize(
        "broken",
        [
            lambda data, prior: replace(prior, scale=1.0 / prior.scale).exact(data),
            lambda data, prior: replace(prior, shape=prior.shape + 1.5).exact(data),
            lambda data, prior: prior.exact(data.rows(np.arange(19))),
        ],
        ids=["reciprocal scale", "full conditional as marginal", "a row short"],
    )
    def test_wrong_posteriors_are_rejected(self, family, broken):
        z, comparisons = self.z(broken(*case(family)), exact_of(*case(family)))
        assert z > z_limit(comparisons)


def test_draws_are_dealt_to_chains_and_worth_their_number(family):
    tree = exact_posterior(*case(family), draws=4000, rng=np.random.default_rng(1))
    posterior = tree["posterior"]
    assert dict(posterior.sizes) == {"chain": 4, "draw": 1000, "coefficient": 3}
    ess = az.ess(posterior.dataset)
    assert 0.85 * 4000 < float(ess["coefficients"].min()) < 1.3 * 4000
    assert 0.85 * 4000 < float(ess["noise_variance"]) < 1.3 * 4000
    assert float(az.rhat(posterior.dataset)["noise_variance"]) < 1.01
    assert tree.attrs["method"] == family.family


@pytest.mark.parametrize(("name", "largest"), [("mean", 1e100), ("kappa", 1e200), ("shape", 1e15)])
def test_hyperparameters_of_any_size_have_a_posterior_or_are_refused(family, name, largest):
    data = simulated(20, 3, seed=14)
    assert np.isfinite(family(**{name: largest}).exact(data).log_evidence)
    for size in (1.1, 1e60):
        with refused(InferenceError, name, largest):
            family(**{name: size * largest})
