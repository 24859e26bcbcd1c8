from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy import stats
from scipy.integrate import quad
from scipy.optimize import brentq
from scipy.special import logsumexp

from pymc_ship.inference.regression.semiconjugate import SemiConjugatePrior
from pymc_ship.inference.rows.data import RegressionData
from tests.inference.regression.cases import case, dense, two_modes, vector_prior
from tests.inference.regression.peers import exact_of, largest_z, oracle, simulated, z_limit


def more_terms():
    return simulated(3, 7, seed=1), vector_prior(7)


@pytest.fixture(scope="module", params=["ds1", "ds2"])
def known(request):
    return oracle(request.param)


@pytest.fixture(scope="module", params=[case, two_modes, more_terms], ids=lambda function: function.__name__)
def exact(request):
    return exact_of(*request.param())


class TestOracle:
    def posterior(self, known):
        prior = SemiConjugatePrior(kappa=known.kappa, shape=known.shape, scale=known.scale)
        return prior.exact(known.data)

    def test_moments(self, known):
        exact = self.posterior(known)
        np.testing.assert_allclose(exact.mean, known.mean, rtol=1e-9, atol=1e-9)
        np.testing.assert_allclose(exact.sd, known.sd, rtol=1e-9)
        np.testing.assert_allclose(exact.covariance, known.covariance, rtol=1e-8, atol=1e-8)
        assert exact.noise_variance_mean == pytest.approx(known.noise_variance[0], rel=1e-9)
        assert exact.noise_variance_sd == pytest.approx(known.noise_variance[1], rel=1e-9)

    def test_evidence(self, known):
        exact = self.posterior(known)
        assert exact.log_evidence == pytest.approx(known.log_evidence, abs=1e-9)

    def test_quantiles(self, known):
        exact = self.posterior(known)
        np.testing.assert_allclose(exact.quantiles(known.probabilities), known.quantiles, rtol=1e-9, atol=1e-9)
        noise_variance = exact.noise_variance_quantiles(known.probabilities)
        np.testing.assert_allclose(noise_variance, known.noise_variance[2:], rtol=1e-7)

    def test_the_conjugate_prior_is_another_answer(self, known):
        """The broken twin: the other family lies within a posterior sd, yet a million times the tolerance off."""
        assert np.abs(np.array(known.conjugate["mean"]) - known.mean).max() > 1e-5


class TestEvidence:
    def test_a_known_noise_variance_leaves_a_normal_density(self):
        data = simulated(12, 3, seed=4)
        X, y = data.design_matrix, data.response
        known = stats.multivariate_normal.logpdf(y, np.zeros(12), 2.0 * X @ X.T + 0.8 * np.eye(12))
        exact = SemiConjugatePrior(kappa=2.0, shape=1e9, scale=0.8e9).exact(data)
        assert exact.log_evidence == pytest.approx(known, abs=1e-5)
        ridge = np.linalg.solve(X.T @ X / 0.8 + np.eye(3) / 2.0, X.T @ y / 0.8)
        np.testing.assert_allclose(exact.mean, ridge, rtol=1e-7)


class TestScaling:
    def test_an_offset_and_columns_of_a_million_are_harmless(self):
        rng = np.random.default_rng(8)
        X = np.column_stack([np.ones(15), rng.standard_normal((15, 3))])
        y = X[:, 1:] @ [1.0, -2.0, 0.5] + 0.1 * rng.standard_normal(15)
        offset, factor = np.array([1e6, 0.0, 0.0, 0.0]), np.array([1.0, 1e6, 1e6, 1.0])
        one = SemiConjugatePrior(kappa=4.0).exact(RegressionData.from_arrays(X, y, scaling="none"))
        prior = SemiConjugatePrior(mean=offset, kappa=4.0 / factor**2)
        other = prior.exact(RegressionData.from_arrays(X * factor, y + 1e6, scaling="none"))
        np.testing.assert_allclose(other.mean * factor - offset, one.mean, atol=1e-8)
        np.testing.assert_allclose(other.sd * factor, one.sd, rtol=1e-8)
        assert other.log_evidence == pytest.approx(one.log_evidence, abs=1e-6)

    def test_a_vague_intercept_takes_up_an_offset_of_a_million(self):
        rng = np.random.default_rng(8)
        X = np.column_stack([np.ones(15), rng.standard_normal((15, 3))])
        y = X[:, 1:] @ [1.0, -2.0, 0.5] + 0.1 * rng.standard_normal(15)
        prior = SemiConjugatePrior(kappa=[1e22, 4.0, 4.0, 4.0])
        one = prior.exact(RegressionData.from_arrays(X, y, scaling="none"))
        other = prior.exact(RegressionData.from_arrays(X, y + 1e6, scaling="none"))
        np.testing.assert_allclose(other.mean - [1e6, 0.0, 0.0, 0.0], one.mean, atol=1e-6)
        np.testing.assert_allclose(other.sd, one.sd, rtol=1e-6)
        assert other.noise_variance_mean == pytest.approx(one.noise_variance_mean, rel=1e-6)


class TestLimits:
    def test_a_firm_prior_gives_its_mean_and_an_inverse_gamma(self):
        data = simulated(50, 4, seed=10)
        exact = SemiConjugatePrior(mean=[1.0, 2.0, 3.0, 4.0], kappa=1e-14, shape=2.0, scale=1.0).exact(data)
        np.testing.assert_allclose(exact.mean, [1.0, 2.0, 3.0, 4.0], rtol=1e-8)
        square = np.sum((data.response - data.design_matrix @ [1.0, 2.0, 3.0, 4.0]) ** 2)
        known = stats.invgamma(27.0, scale=1.0 + 0.5 * square)
        assert exact.noise_variance_mean == pytest.approx(known.mean(), rel=1e-9)
        assert exact.noise_variance_sd == pytest.approx(known.std(), rel=1e-9)
        probabilities = [1e-6, 0.01, 0.5, 0.99, 1.0 - 1e-6]
        np.testing.assert_allclose(known.cdf(exact.noise_variance_quantiles(probabilities)), probabilities, rtol=1e-8)

    def test_moments_with_more_terms_than_rows(self):
        """Mean and covariance by dense conditionals over a fine grid of sigma2."""
        data, prior = simulated(3, 5, seed=11), vector_prior(5)
        X, y, exact = data.design_matrix, data.response, prior.exact(data)
        t = np.linspace(-12.0, 14.0, 4001)
        log_density = dense(X, y, prior, t)
        weights = np.exp(log_density - logsumexp(log_density))
        S = np.linalg.inv(np.diag(1.0 / prior.kappa) + np.exp(-t)[:, None, None] * (X.T @ X))
        means = np.einsum("kij,kj->ki", S, prior.mean / prior.kappa + np.exp(-t)[:, None] * (X.T @ y))
        mean = weights @ means
        np.testing.assert_allclose(exact.mean, mean, atol=1e-9)
        covariance = np.einsum("k,kij->ij", weights, S) + (means - mean).T @ (weights[:, None] * (means - mean))
        np.testing.assert_allclose(exact.covariance, covariance, atol=1e-9)


class TestDistributions:
    def test_the_density_of_the_noise_variance_integrates_to_one(self, exact):
        t = np.linspace(exact.log_noise_variance[0], exact.log_noise_variance[-1], 20_001)
        total = np.sum(exact.noise_variance_density(np.exp(t)) * np.exp(t)) * (t[1] - t[0])
        assert total == pytest.approx(1.0, abs=1e-10)

    def test_the_prior_density_is_that_of_scipy(self, exact):
        values = np.geomspace(1e-3, 1e3, 7)
        known = stats.invgamma.pdf(values, exact.prior_shape, scale=exact.prior_scale)
        np.testing.assert_allclose(exact.prior_noise_variance_density(values), known, rtol=1e-10)

    def test_quantiles_of_the_noise_variance_invert_the_integrated_density(self, exact):
        probabilities = [0.001, 0.3, 0.5, 0.999]
        found = np.log(exact.noise_variance_quantiles(probabilities))
        nodes = exact.log_noise_variance
        inside = nodes[exact.weights > 1e-12]
        for t, probability in zip(found, probabilities, strict=True):
            points = np.append(inside[inside < t], t)
            pieces = [
                quad(lambda x: exact.noise_variance_density(np.exp(x)) * np.exp(x), a, b, epsabs=1e-14)[0]
                for a, b in zip(np.append(nodes[0], points[:-1]), points, strict=True)
            ]
            assert sum(pieces) == pytest.approx(probability, abs=1e-9)

    def test_quantiles_of_the_coefficients_invert_the_mixture(self, exact):
        found = exact.quantiles([0.01, 0.5, 0.99])
        variances = exact.noise_variances[:, None]
        total = variances + exact.singular_values**2
        middle = exact.center + (exact.singular_values * exact.projections / total) @ exact.basis
        sd = np.sqrt((variances / total) @ exact.basis**2)
        for j in range(len(exact.center)):
            root = brentq(lambda x, j=j: exact.weights @ stats.norm.cdf(x, middle[:, j], sd[:, j]) - 0.99, -1e3, 1e3)
            assert found[2, j] == pytest.approx(root, abs=1e-8)
        assert (np.diff(found, axis=0) > 0.0).all()


class TestDraws:
    def test_a_posterior_without_residual_is_rejected(self):
        exact = exact_of(*case())
        coefficients, noise_variance = replace(exact, residual_square=0.0).draw(40_000, np.random.default_rng(1))
        z, comparisons = largest_z(coefficients.reshape(4, -1, 3), noise_variance.reshape(4, -1), exact)
        assert z > z_limit(comparisons)

    @pytest.mark.parametrize("made", [case, two_modes])
    def test_the_noise_variance_falls_evenly_between_its_quantiles(self, made):
        exact, draws, probabilities = exact_of(*made()), 100_000, np.array([0.001, 0.05, 0.5, 0.95, 0.999])
        noise_variance = exact.draw(draws, np.random.default_rng(2))[1]
        below = np.mean(noise_variance[:, None] < exact.noise_variance_quantiles(probabilities), axis=0)
        z = (below - probabilities) / np.sqrt(probabilities * (1.0 - probabilities) / draws)
        assert np.abs(z).max() < z_limit(z.size)
        twin = np.mean(1.01 * noise_variance[:, None] < exact.noise_variance_quantiles(probabilities), axis=0)
        assert (twin[2] - 0.5) / np.sqrt(0.25 / draws) < -z_limit(1) or made is two_modes

    def test_coefficients_and_noise_variance_belong_together(self):
        """Given its sigma2 a draw is normal with the conditional's moments, so its standardised square averages 1."""
        exact = exact_of(*case())
        coefficients, noise_variance = exact.draw(40_000, np.random.default_rng(3))
        total = noise_variance[:, None] + exact.singular_values**2
        middle = exact.center + (exact.singular_values * exact.projections / total) @ exact.basis
        sd = np.sqrt((noise_variance[:, None] / total) @ exact.basis**2)
        square = ((coefficients - middle) / sd) ** 2
        assert np.abs((square.mean(axis=0) - 1.0) / (square.std(axis=0) / 200.0)).max() < z_limit(3)
        twin = ((coefficients - middle) / np.roll(sd, 1, axis=0)) ** 2
        assert np.abs((twin.mean(axis=0) - 1.0) / (twin.std(axis=0) / 200.0)).max() > z_limit(3)
