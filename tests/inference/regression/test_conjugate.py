from __future__ import annotations

import json
from dataclasses import replace
from fractions import Fraction

import numpy as np
import pytest
from scipy import stats
from scipy.integrate import quad

from pymc_ship.inference.regression.conjugate import ConjugatePrior
from pymc_ship.inference.regression.semiconjugate import SemiConjugatePrior
from pymc_ship.inference.regression.tree import exact_posterior, rng_state
from pymc_ship.inference.rows.data import RegressionData
from pymc_ship.machine.errors import InferenceError
from tests.inference.regression.cases import vector_prior
from tests.inference.regression.peers import exact_of, oracle, simulated, z_limit
from tests.sentences import refused

SHAPES = [(12, 3), (3, 7), (5, 5), (1, 2)]
"""Rows and terms: more rows, more terms, as many, and a single row."""


def dense_evidence(X, y, prior):
    """Log density of y: multivariate t with 2 A degrees of freedom and shape (b/A)(I + X V X')."""
    n_terms = X.shape[1]
    covariance = np.eye(len(y)) + (X * prior.kappas(n_terms)) @ X.T
    return stats.multivariate_t.logpdf(
        y, X @ prior.means(n_terms), prior.scale / prior.shape * covariance, df=2.0 * prior.shape
    )


class TestOracle:
    @pytest.mark.parametrize("name", ["ds1", "ds2"])
    def test_posterior_and_evidence(self, name):
        known = oracle(name)
        exact = ConjugatePrior(kappa=known.kappa, shape=known.shape, scale=known.scale).exact(known.data)
        np.testing.assert_allclose(exact.mean, known.conjugate["mean"], rtol=1e-9, atol=1e-9)
        np.testing.assert_allclose(exact.t_scale, known.conjugate["t_scale"], rtol=1e-9)
        assert exact.degrees_of_freedom == known.conjugate["df"]
        assert exact.log_evidence == pytest.approx(known.conjugate["logml"], abs=1e-9)
        assert exact.noise_variance_mean == pytest.approx(known.conjugate["sigma2_mean"], rel=1e-9)

    def test_least_squares_is_another_answer(self):
        """The broken twin: ds2 without its prior lies several posterior standard deviations off."""
        known = oracle("ds2")
        least_squares = np.linalg.lstsq(known.data.design_matrix, known.data.response, rcond=None)[0]
        assert np.abs((least_squares - known.conjugate["mean"]) / known.conjugate["t_scale"]).max() > 1.0


class TestEvidence:
    @pytest.mark.parametrize(("n_rows", "n_terms"), SHAPES)
    def test_it_is_the_multivariate_t_density_of_the_response(self, n_rows, n_terms):
        data, prior = simulated(n_rows, n_terms, seed=1), vector_prior(n_terms, ConjugatePrior)
        known = dense_evidence(data.design_matrix, data.response, prior)
        assert prior.exact(data).log_evidence == pytest.approx(known, abs=1e-10)

    def test_the_reciprocal_scale_of_the_paper_is_rejected(self):
        data, prior = simulated(12, 3, seed=1), vector_prior(3, ConjugatePrior)
        twin = replace(prior, scale=1.0 / prior.scale)
        assert abs(twin.exact(data).log_evidence - dense_evidence(data.design_matrix, data.response, prior)) > 0.1


class TestUpdating:
    def test_two_batches_give_the_posterior_of_one(self):
        """The posterior of the first rows, diagonal in rotated coordinates, is the prior of the rest."""
        data, prior = simulated(40, 6, seed=4), vector_prior(6, ConjugatePrior)
        first = prior.exact(data.rows(np.arange(15)))
        rest = data.rows(np.arange(15, 40))
        rotated = RegressionData.from_arrays(
            rest.design_matrix @ first.basis.T, rest.response - rest.design_matrix @ first.center, scaling="none"
        )
        update = ConjugatePrior(mean=first.location, kappa=first.spread, shape=first.shape, scale=first.scale)
        second, whole = update.exact(rotated), prior.exact(data)
        np.testing.assert_allclose(first.center + second.mean @ first.basis, whole.mean, rtol=0.0, atol=1e-10)
        np.testing.assert_allclose(
            first.basis.T @ second.covariance @ first.basis, whole.covariance, rtol=0.0, atol=1e-10
        )
        assert (second.shape, second.scale) == pytest.approx((whole.shape, whole.scale), rel=1e-10)


class TestScaling:
    def test_columns_a_million_times_larger_with_the_equivalent_prior(self):
        data, prior = simulated(30, 4, seed=7), vector_prior(4, ConjugatePrior)
        large = RegressionData.from_arrays(data.design_matrix * [1e6, 1.0, 1e6, 1.0], data.response, scaling="none")
        factor = np.array([1e6, 1.0, 1e6, 1.0])
        one = prior.exact(data)
        other = replace(prior, mean=prior.mean / factor, kappa=prior.kappa / factor**2).exact(large)
        np.testing.assert_allclose(other.mean * factor, one.mean, rtol=1e-10)
        assert other.log_evidence == pytest.approx(one.log_evidence, abs=1e-10)


def rational_posterior(X, y, kappa):
    """Posterior mean, and fit = b_n - b, in exact rational arithmetic (Gauss-Jordan on V^-1 + X'X)."""
    X = [[Fraction(value) for value in row] for row in X.tolist()]
    y = [Fraction(value) for value in y.tolist()]
    n_terms = len(X[0])
    rows = [
        [sum(r[i] * r[j] for r in X) + (Fraction(1) / Fraction(kappa) if i == j else 0) for j in range(n_terms)]
        + [sum(r[i] * v for r, v in zip(X, y, strict=True))]
        for i in range(n_terms)
    ]
    for i in range(n_terms):
        rows[i] = [value / rows[i][i] for value in rows[i]]
        for k in set(range(n_terms)) - {i}:
            rows[k] = [a - rows[k][i] * b for a, b in zip(rows[k], rows[i], strict=True)]
    mean = [row[-1] for row in rows]
    residual = [v - sum(b * x for b, x in zip(mean, r, strict=True)) for r, v in zip(X, y, strict=True)]
    square = sum(value**2 for value in residual) + sum(value**2 for value in mean) / Fraction(kappa)
    return np.array([float(value) for value in mean]), float(square / 2)


class TestNumerics:
    def offset_data(self):
        rng = np.random.default_rng(8)
        X = np.column_stack([np.ones(15), rng.standard_normal((15, 3))])
        return X, 1e6 + X[:, 1:] @ [1.0, -2.0, 0.5] + 0.1 * rng.standard_normal(15)

    def test_an_offset_of_a_million_is_harmless(self):
        X, y = self.offset_data()
        mean, fit = rational_posterior(X, y, 1e13)
        exact = ConjugatePrior(kappa=1e13, shape=2.0, scale=1e-3).exact(
            RegressionData.from_arrays(X, y, scaling="none")
        )
        np.testing.assert_allclose(exact.mean, mean, rtol=1e-8)
        assert exact.scale - 1e-3 == pytest.approx(fit, rel=1e-6)

    def test_the_textbook_sum_of_squares_would_not_do(self):
        """The broken twin: y'y - m'(V^-1 + X'X)m loses the fit to cancellation."""
        X, y = self.offset_data()
        mean, fit = rational_posterior(X, y, 1e13)
        assert 0.5 * (y @ y - mean @ (X.T @ X + 1e-13 * np.eye(4)) @ mean) != pytest.approx(fit, rel=1e-3)

    def test_a_prior_mean_at_the_offset_leaves_the_posterior_where_it_was(self):
        X, y = self.offset_data()
        low = ConjugatePrior(kappa=10.0).exact(RegressionData.from_arrays(X, y - 1e6, scaling="none"))
        high = ConjugatePrior(mean=[1e6, 0.0, 0.0, 0.0], kappa=10.0).exact(
            RegressionData.from_arrays(X, y, scaling="none")
        )
        np.testing.assert_allclose(high.mean - [1e6, 0.0, 0.0, 0.0], low.mean, atol=1e-8)
        assert high.log_evidence == pytest.approx(low.log_evidence, abs=1e-7)


class TestLimits:
    @pytest.mark.parametrize(("n_rows", "n_terms"), SHAPES[:3])
    def test_moments_are_those_of_the_normal_equations(self, n_rows, n_terms):
        data, prior = simulated(n_rows, n_terms, seed=11), vector_prior(n_terms, ConjugatePrior)
        X, y, exact = data.design_matrix, data.response, prior.exact(data)
        covariance = np.linalg.inv(np.diag(1.0 / prior.kappa) + X.T @ X)
        mean = covariance @ (prior.mean / prior.kappa + X.T @ y)
        np.testing.assert_allclose(exact.mean, mean, atol=1e-10)
        np.testing.assert_allclose(exact.covariance, exact.noise_variance_mean * covariance, atol=1e-10)
        square = np.sum((y - X @ mean) ** 2) + np.sum((mean - prior.mean) ** 2 / prior.kappa)
        assert exact.scale == pytest.approx(prior.scale + 0.5 * square, rel=1e-12)


@pytest.fixture(scope="module")
def exact():
    return vector_prior(3, ConjugatePrior).exact(simulated(20, 3, seed=12))


class TestDistributions:
    def test_quantiles_of_the_coefficients_are_those_of_a_t(self, exact):
        probabilities = [0.01, 0.3, 0.5, 0.99]
        found = exact.quantiles(probabilities)
        assert found.shape == (4, 3)
        t = stats.t(exact.degrees_of_freedom, exact.mean, exact.t_scale)
        np.testing.assert_allclose(t.cdf(found), np.repeat(np.c_[probabilities], 3, axis=1), rtol=1e-10)

    def test_quantiles_of_the_noise_variance_are_those_of_an_inverse_gamma(self, exact):
        found = exact.noise_variance_quantiles([0.01, 0.5, 0.99])
        known = stats.invgamma(exact.shape, scale=exact.scale)
        np.testing.assert_allclose(known.cdf(found), [0.01, 0.5, 0.99], rtol=1e-10)
        assert exact.noise_variance_mean == pytest.approx(known.mean(), rel=1e-12)
        assert exact.noise_variance_sd == pytest.approx(known.std(), rel=1e-12)

    @pytest.mark.parametrize("family", [ConjugatePrior, SemiConjugatePrior])
    def test_quantiles_reach_the_ends_of_the_line_and_no_further(self, family):
        exact = vector_prior(3, family).exact(simulated(20, 3, seed=12))
        np.testing.assert_array_equal(exact.quantiles([0.0, 1.0]), np.repeat([[-np.inf], [np.inf]], 3, axis=1))
        np.testing.assert_array_equal(exact.noise_variance_quantiles([0.0, 1.0]), [0.0, np.inf])
        for probability in (-0.5, 1.5, np.nan, "half"):
            for quantiles in (exact.quantiles, exact.noise_variance_quantiles):
                with refused(InferenceError):
                    quantiles([0.5, probability])

    @pytest.mark.parametrize("density", ["noise_variance_density", "prior_noise_variance_density"])
    def test_densities_integrate_to_one(self, exact, density):
        function = getattr(exact, density)
        assert quad(lambda t: function(np.exp(t)) * np.exp(t), -12.0, 12.0, epsabs=1e-12)[0] == pytest.approx(1.0)


def case():
    return simulated(20, 3, seed=14), vector_prior(3, ConjugatePrior)


class TestDraws:
    def test_coefficients_and_noise_variance_belong_together(self):
        """Given its sigma2, a standardised draw is standard normal: kurtosis 3, while marginally it is that of a t."""
        exact = exact_of(*case())
        coefficients, noise_variance = exact.draw(40_000, np.random.default_rng(3))
        scale = np.sqrt(exact.spread @ exact.basis**2)
        standard = (coefficients - exact.mean) / scale / np.sqrt(noise_variance)[:, None]
        fourth = standard**4
        error = fourth.std(axis=0) / np.sqrt(40_000)
        assert np.abs((fourth.mean(axis=0) - 3.0) / error).max() < z_limit(3)
        shuffled = standard * np.sqrt(noise_variance / np.roll(noise_variance, 1))[:, None]
        fourth = shuffled**4
        assert np.abs((fourth.mean(axis=0) - 3.0) / (fourth.std(axis=0) / np.sqrt(40_000))).max() > z_limit(3)


class TestTree:
    def test_the_recorded_state_repeats_the_draws(self):
        rng = np.random.default_rng(2)
        rng.standard_normal(7)
        state = rng_state(rng)
        one = exact_posterior(*case(), draws=40, rng=rng)
        other = exact_posterior(*case(), draws=40, rng=rng)
        assert one.attrs["rng_state"] == state != other.attrs["rng_state"]
        again = np.random.default_rng()
        again.bit_generator.state = json.loads(state)
        repeated = exact_posterior(*case(), draws=40, rng=again)
        assert repeated.identical(one)
        assert not one["posterior"].identical(other["posterior"])
