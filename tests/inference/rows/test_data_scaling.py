from __future__ import annotations

import numpy as np
import pytest
from scipy import stats

from pymc_ship.inference.regression.conjugate import ConjugatePrior
from pymc_ship.inference.regression.families import FAMILIES, prior_family
from pymc_ship.inference.regression.semiconjugate import SemiConjugatePrior
from pymc_ship.inference.rows.data import RegressionData
from pymc_ship.machine.errors import InferenceError
from tests.inference.regression.peers import simulated
from tests.sentences import refused


def plain_arrays(n_rows=40, seed=1):
    """Columns of very different size, away from zero, and a constant one."""
    rng = np.random.default_rng(seed)
    X = np.column_stack([rng.normal([3.0, -8e4, 2e-5], [1.0, 1e4, 1e-5], (n_rows, 3)), np.full(n_rows, 2.0)])
    return X, 7.0 + X @ [1.0, 2e-4, 3e4, 4.0] + rng.standard_normal(n_rows)


class TestScaling:
    def test_without_it_nothing_changes(self):
        X, y = plain_arrays()
        data = RegressionData.from_arrays(X, y, scaling="none")
        np.testing.assert_array_equal(data.scaled_design_matrix, X)
        np.testing.assert_array_equal(data.scaled_response, y)
        np.testing.assert_array_equal(data.to_original(np.arange(4.0)), np.arange(4.0))

    def test_with_a_constant_column_the_others_are_z_scores(self):
        X, y = plain_arrays()
        data = RegressionData.from_arrays(X, y, scaling="zscore")
        assert data.constant == 3
        np.testing.assert_allclose(data.scaled_design_matrix[:, :3], stats.zscore(X[:, :3]), atol=1e-12)
        np.testing.assert_array_equal(data.scaled_design_matrix[:, 3], np.ones(40))
        np.testing.assert_allclose(data.scaled_response, stats.zscore(y), atol=1e-12)

    def test_without_a_constant_column_only_the_mean_square_is_one(self):
        X, y = plain_arrays()
        data = RegressionData.from_arrays(X[:, :3], y, scaling="zscore")
        assert data.constant == -1
        np.testing.assert_allclose(data.scaled_design_matrix * np.sqrt(np.mean(X[:, :3] ** 2, axis=0)), X[:, :3])
        np.testing.assert_allclose(np.mean(data.scaled_response**2), 1.0)

    def test_a_constant_that_is_not_one_and_negative(self):
        X, y = plain_arrays()
        X[:, 3] = -0.5
        data = RegressionData.from_arrays(X, y, scaling="zscore")
        np.testing.assert_array_equal(data.scaled_design_matrix[:, 3], -np.ones(40))
        b = np.random.default_rng(2).standard_normal(4)
        fitted = data.response_center + data.response_scale * data.scaled_design_matrix @ b
        np.testing.assert_allclose(X @ data.to_original(b), fitted, atol=1e-9)

    @pytest.mark.parametrize("columns", [4, 3])
    def test_scaled_and_original_coefficients_predict_the_same(self, columns):
        X, y = plain_arrays()
        data = RegressionData.from_arrays(X[:, :columns], y, scaling="zscore")
        b = np.random.default_rng(2).standard_normal((2, 3, columns))
        fitted = data.response_center + data.response_scale * (b @ data.scaled_design_matrix.T)
        np.testing.assert_allclose(data.to_original(b) @ X[:, :columns].T, fitted, atol=1e-9)
        np.testing.assert_allclose(data.to_scaled(data.to_original(b)), b, atol=1e-10)

    def test_the_transformation_is_the_map(self):
        data = RegressionData.from_arrays(*plain_arrays(), scaling="zscore")
        offset, T = data.transformation
        b = np.random.default_rng(2).standard_normal(4)
        np.testing.assert_allclose(data.to_original(b), offset + T @ b, rtol=1e-12)

    def test_rows_keep_the_scaling_of_the_whole(self):
        data = RegressionData.from_arrays(*plain_arrays(), scaling="zscore")
        some = data.rows(np.arange(5, 9))
        np.testing.assert_array_equal(some.scaled_design_matrix, data.scaled_design_matrix[5:9])
        np.testing.assert_array_equal(some.scaled_response, data.scaled_response[5:9])
        np.testing.assert_array_equal(some.time, [5.0, 6.0, 7.0, 8.0])
        assert some.n_rows == 4


class TestConditioning:
    def test_the_condition_number_is_that_of_numpy(self):
        data = RegressionData.from_arrays(*plain_arrays(), scaling="zscore")
        assert data.condition_number == pytest.approx(np.linalg.cond(data.scaled_design_matrix), rel=1e-10)
        assert (
            RegressionData.from_arrays(*plain_arrays(), scaling="none").condition_number > 1e4 * data.condition_number
        )

    def test_variance_inflation_is_one_over_one_less_r_squared(self):
        X = simulated(50, 4, seed=3).design_matrix.copy()
        X[:, 3] = X[:, 0] + 0.1 * X[:, 3]
        data = RegressionData.from_arrays(X, X[:, 0], scaling="none")
        for j in range(4):
            others = np.delete(X, j, axis=1)
            residual = X[:, j] - others @ np.linalg.lstsq(others, X[:, j], rcond=None)[0]
            known = np.sum(X[:, j] ** 2) / np.sum(residual**2)
            assert data.variance_inflation_factors[j] == pytest.approx(known, rel=1e-9)

    def test_more_terms_than_rows_are_infinitely_ill_conditioned(self):
        data = simulated(3, 5, seed=3)
        assert data.condition_number == np.inf
        assert (data.variance_inflation_factors == np.inf).all()


class TestDataErrors:
    @pytest.mark.parametrize("level", [0.1, 1.0 / 3.0, 1e6 / 7.0])
    def test_a_constant_response_is_refused_whatever_its_rounding(self, level):
        for n_rows in range(5, 40):
            with refused(InferenceError, "response"):
                RegressionData.from_arrays(plain_arrays(n_rows)[0], np.full(n_rows, level), scaling="zscore")


class TestPriors:
    values = np.geomspace(0.01, 10.0, 5)

    @pytest.mark.parametrize("family", FAMILIES)
    def test_the_noise_variance_is_a_standard_inverse_gamma(self, family):
        prior = prior_family(family)(shape=3.0, scale=0.4)
        known = stats.invgamma.logpdf(self.values, 3.0, scale=0.4)
        np.testing.assert_allclose(prior.log_noise_variance(self.values), known, rtol=1e-12)
        twin = stats.invgamma.logpdf(self.values, 3.0, scale=1.0 / 0.4)
        assert np.abs(prior.log_noise_variance(self.values) - twin).max() > 0.1

    @pytest.mark.parametrize(("prior_type", "ties"), [(ConjugatePrior, True), (SemiConjugatePrior, False)])
    @pytest.mark.parametrize("kappa", [2.0, [1.0, 2.0, 3.0]])
    def test_the_coefficients_are_normal_and_tied_to_the_noise_in_one_family(self, prior_type, ties, kappa):
        prior = prior_type(mean=[0.1, 0.2, 0.3], kappa=kappa)
        b = np.random.default_rng(1).standard_normal((5, 3))
        sd = np.sqrt(prior.kappas(3) * (self.values[:, None] if ties else 1.0))
        known = stats.norm.logpdf(b, prior.mean, sd).sum(axis=1)
        np.testing.assert_allclose(prior.log_coefficients(b, self.values), known, rtol=1e-12)

    def test_one_value_serves_every_term(self):
        prior = ConjugatePrior(mean=0.5, kappa=2.0)
        assert prior.means(3).tolist() == [0.5] * 3
        assert prior.kappas(3).tolist() == [2.0] * 3

    def test_hyperparameters_are_plain(self):
        prior = SemiConjugatePrior(mean=np.array([0.0, 1.0]), kappa=4, shape=2, scale=np.float64(3.0))
        assert prior.hyperparameters() == {
            "family": "semiconjugate",
            "mean": [0.0, 1.0],
            "kappa": 4.0,
            "shape": 2.0,
            "scale": 3.0,
        }

    def test_families_have_names(self):
        assert {name: prior_family(name).family for name in FAMILIES} == {name: name for name in FAMILIES}
        with refused(InferenceError, "flat"):
            prior_family("flat")
