from __future__ import annotations

import warnings

import numpy as np
import pytest
from scipy import stats
from scipy.special import logsumexp

from pymc_ship.inference.regression.conjugate import ConjugatePrior
from pymc_ship.inference.regression.cross_validation import cross_validation, fold_rows
from pymc_ship.inference.regression.prior_table import hold_fixed, informed_prior
from pymc_ship.inference.regression.semiconjugate import SemiConjugatePrior
from pymc_ship.inference.rows.data import RegressionData
from pymc_ship.machine.errors import InferenceError
from tests.inference.regression.peers import oracle, simulated
from tests.sentences import refused

PRIORS = [
    ConjugatePrior(kappa=2.0, shape=3.0, scale=1.5),
    SemiConjugatePrior(kappa=2.0, shape=3.0, scale=1.5),
    SemiConjugatePrior(mean=[0.1, 0.2, 0.3], kappa=[1.0, 2.0, 3.0], shape=3.0, scale=1.5),
]


def dense_density(X, y, x, value, prior):
    """Log density of one new row given training rows, by dense matrices (and brute quadrature over sigma2)."""
    mean, V = prior.means(3), np.diag(prior.kappas(3))
    if isinstance(prior, ConjugatePrior):
        S = np.linalg.inv(np.linalg.inv(V) + X.T @ X)
        b = S @ (np.linalg.inv(V) @ mean + X.T @ y)
        shape = prior.shape + 0.5 * len(y)
        fit = np.sum((y - X @ b) ** 2) + (b - mean) @ np.linalg.inv(V) @ (b - mean)
        spread = np.sqrt((prior.scale + 0.5 * fit) / shape * (1.0 + x @ S @ x))
        return stats.t.logpdf(value, 2.0 * shape, x @ b, spread)
    log_weight, log_density = [], []
    for t in np.linspace(-6.0, 6.0, 121):
        log_prior = stats.invgamma.logpdf(np.exp(t), prior.shape, scale=prior.scale) + t
        marginal = stats.multivariate_normal(X @ mean, X @ V @ X.T + np.exp(t) * np.eye(len(y)))
        S = np.linalg.inv(np.linalg.inv(V) + X.T @ X / np.exp(t))
        b = S @ (np.linalg.inv(V) @ mean + X.T @ y / np.exp(t))
        log_weight.append(log_prior + marginal.logpdf(y))
        log_density.append(stats.norm.logpdf(value, x @ b, np.sqrt(np.exp(t) + x @ S @ x)))
    return logsumexp(np.add(log_weight, log_density)) - logsumexp(log_weight)


class TestFolds:
    @pytest.mark.parametrize("split", ["blocks", "random"])
    @pytest.mark.parametrize(("n_rows", "folds"), [(10, 5), (23, 4), (7, 7)])
    def test_every_row_is_held_out_once_and_sizes_differ_by_one_at_most(self, split, n_rows, folds):
        held_out = fold_rows(n_rows, folds, split=split, rng=np.random.default_rng(1))
        assert len(held_out) == folds
        assert sorted(np.concatenate(held_out).tolist()) == list(range(n_rows))
        sizes = [len(rows) for rows in held_out]
        assert max(sizes) - min(sizes) <= 1

    def test_blocks_are_contiguous_and_random_ones_are_not(self):
        assert all((np.diff(rows) == 1).all() for rows in fold_rows(23, 4))
        random = fold_rows(23, 4, split="random", rng=np.random.default_rng(1))
        assert not any((np.diff(rows) == 1).all() for rows in random)

    def test_the_generator_decides_the_random_folds(self):
        one, same, other = (fold_rows(23, 4, split="random", rng=np.random.default_rng(seed)) for seed in (1, 1, 2))
        assert np.array_equal(np.concatenate(one), np.concatenate(same))
        assert not np.array_equal(np.concatenate(one), np.concatenate(other))

    def test_training_rows_are_the_others(self):
        data = simulated(13, 3, seed=1)
        validation = cross_validation(data, 4)
        for training, held_out in zip(validation.training, validation.held_out, strict=True):
            assert set(training.time) | set(held_out.time) == set(range(13))
            assert not set(training.time) & set(held_out.time)


class TestScore:
    @pytest.mark.parametrize("prior", PRIORS, ids=["conjugate", "semiconjugate", "vectors"])
    @pytest.mark.parametrize("split", ["blocks", "random"])
    def test_it_is_the_mean_over_held_out_rows(self, prior, split):
        data = simulated(9, 3, seed=2)
        X, y = data.design_matrix, data.response
        folds = []
        for rows in fold_rows(9, 3, split=split, rng=np.random.default_rng(5)):
            rest = np.setdiff1d(np.arange(9), rows)
            folds.append(np.mean([dense_density(X[rest], y[rest], X[i], y[i], prior) for i in rows]))
        score = cross_validation(data, 3, split=split, rng=np.random.default_rng(5)).score(prior)
        np.testing.assert_allclose(score.folds, folds, atol=1e-9)
        assert score.mean == pytest.approx(np.mean(folds), abs=1e-9)
        assert score.se == pytest.approx(stats.sem(folds), abs=1e-9)

    @pytest.mark.parametrize("prior", PRIORS, ids=["conjugate", "semiconjugate", "vectors"])
    def test_leaving_one_out_is_a_ratio_of_evidences(self, prior):
        data = simulated(8, 3, seed=3)
        whole = prior.exact(data).log_evidence
        ratios = [whole - prior.exact(data.rows(np.delete(np.arange(8), i))).log_evidence for i in range(8)]
        np.testing.assert_allclose(cross_validation(data, 8).score(prior).folds, ratios, atol=1e-10)

    def test_rows_that_were_fitted_are_predicted_better(self):
        """The broken twin: training on all rows, held-out ones included, flatters the score."""
        data = simulated(12, 3, seed=4)
        validation = cross_validation(data, 3)
        honest = validation.score(PRIORS[0]).mean
        exact = PRIORS[0].exact(data)
        leaking = np.mean(exact.log_predictive_density(data.design_matrix, data.response, pointwise=True))
        assert leaking > honest + 0.05

    @pytest.mark.parametrize("prior", PRIORS[:2], ids=["conjugate", "semiconjugate"])
    def test_it_is_a_density_on_the_original_response(self, prior):
        """A response in units a thousand times smaller has a density a thousand times lower, if priors scale along."""
        rng = np.random.default_rng(6)
        X = np.column_stack([rng.normal([3.0, -8.0], 1.0, (30, 2)), np.ones(30)])
        y = X @ [1.0, 2.0, 3.0] + rng.standard_normal(30)
        one, other = (
            cross_validation(RegressionData.from_arrays(X, factor * y, scaling="zscore")).score(prior)
            for factor in (1.0, 1000.0)
        )
        assert one.mean - other.mean == pytest.approx(np.log(1000.0), abs=1e-9)
        assert one.se == pytest.approx(other.se, rel=1e-9)

    def test_it_tells_good_priors_from_bad(self):
        validation = cross_validation(oracle("ds2").data)
        good, deaf, certain = (
            validation.score(ConjugatePrior(kappa=kappa, shape=shape, scale=0.64 * shape)).mean
            for kappa, shape in ((100.0, 2.0), (1e-6, 2.0), (100.0, 1e5))
        )
        assert good > deaf + 0.5
        assert validation.score(ConjugatePrior(kappa=100.0, shape=1e5, scale=1e3)).mean < certain - 1.0

    @pytest.mark.parametrize("prior", PRIORS[:2], ids=["conjugate", "semiconjugate"])
    def test_scoring_decomposes_no_matrix(self, prior, monkeypatch):
        """One decomposition for each fold, when the rows are split; none for each prior."""
        validation = cross_validation(oracle("ds2").data)
        before = validation.score(prior).mean

        def refuse(*arguments, **options):
            raise AssertionError("a matrix was decomposed")

        for name in ("svd", "solve", "inv", "cholesky", "eigh"):
            monkeypatch.setattr(np.linalg, name, refuse)
        assert validation.score(prior).mean == before


class TestScaling:
    """The training rows are scaled by themselves: no held-out value reaches the fit."""

    @staticmethod
    def data(y, constant=True, **options):
        x = np.random.default_rng(11).normal(size=40)
        columns = np.column_stack([np.ones(40), x]) if constant else x[:, None]
        return RegressionData.from_arrays(columns, y, **options)

    @pytest.mark.parametrize("constant", [True, False])
    @pytest.mark.parametrize("prior", PRIORS[:2], ids=["conjugate", "semiconjugate"])
    def test_the_prediction_of_a_fold_does_not_depend_on_its_response(self, prior, constant):
        x = np.random.default_rng(11).normal(size=40)
        y = 3.0 + x + 0.2 * np.random.default_rng(10).normal(size=40)
        moved = y + np.where(np.arange(40) < 20, 0.0, 5.0)
        means = []
        for response in (y, moved):
            folds = cross_validation(self.data(response, constant), 2)
            means.append(prior.exact(folds.training[0]).predict(folds.held_out[0].design_matrix)[0])
        honest = cross_validation(self.data(moved, constant), 2)
        np.testing.assert_array_equal(honest.held_out[1].response, moved[20:])
        for response, mean in zip((y, moved), means, strict=True):
            again = prior.exact(self.data(response, constant).rescaled_rows(np.arange(20, 40)))
            np.testing.assert_allclose(again.predict(honest.held_out[0].design_matrix)[0], mean, rtol=1e-12)
        first = [cross_validation(self.data(response, constant), 2).training[1] for response in (y, moved)]
        np.testing.assert_allclose(*(one.scaled_response for one in first), atol=1e-12)
        leaking = [self.data(response, constant).rows(np.arange(20)).scaled_response for response in (y, moved)]
        assert np.abs(leaking[0] - leaking[1]).max() > 0.1  # the broken twin: the scaling of the whole

    def test_training_rows_are_z_scored(self):
        y = np.random.default_rng(10).normal(size=40)
        for training in cross_validation(self.data(y), 4).training:
            np.testing.assert_allclose(training.scaled_response, stats.zscore(training.response), atol=1e-12)
            np.testing.assert_allclose(
                training.scaled_design_matrix[:, 1], stats.zscore(training.design_matrix[:, 1]), atol=1e-12
            )

    def test_rows_without_scaling_stay_as_they_are(self):
        y = 7.0 + np.random.default_rng(10).normal(size=40)
        for training in cross_validation(self.data(y, scaling="none"), 4).training:
            np.testing.assert_array_equal(training.scaled_response, training.response)

    def test_an_informed_prior_keeps_its_units(self):
        """Rows of other scales, with the constant or without."""
        x = np.random.default_rng(1).normal(size=40) * np.repeat([6.0, 1.0], 20)
        for X in (np.column_stack([np.ones(40), x]), x[:, None]):
            data = RegressionData.from_arrays(X, X.sum(axis=1) + np.random.default_rng(2).normal(size=40))
            prior = informed_prior(data, SemiConjugatePrior(), {data.coefficients[-1]: (3.0, 1e-5)})
            validation = cross_validation(data, 2)
            expected = []
            for rows, held_out in zip(validation.training, validation.held_out, strict=True):
                own = informed_prior(rows, SemiConjugatePrior(), {data.coefficients[-1]: (3.0, 1e-5)})
                assert own.exact(rows).mean[-1] == pytest.approx(3.0, abs=1e-3)
                new = held_out.design_matrix, held_out.response
                expected.append(own.exact(rows).log_predictive_density(*new, pointwise=True).mean())
            np.testing.assert_allclose(validation.score(prior).folds, expected)

    def test_a_fixed_coefficient_changes_no_scale(self):
        """The scales that are kept for the other coefficients follow the training rows in proportion."""
        x = np.random.default_rng(1).normal(size=(40, 2))
        data = RegressionData.from_arrays(x, x @ [10.0, 1.0])
        fixed = hold_fixed(data, {"x1": 10.0})
        some = np.arange(30)
        ratio = np.sqrt(np.mean(x[:30, 1] ** 2) / np.mean(x[:, 1] ** 2))
        part = fixed.rescaled_rows(some)
        assert part.column_scale[0] == pytest.approx(data.column_scale[1] * ratio, rel=1e-12)
        assert part.response_scale == pytest.approx(data.response_scale * ratio, rel=1e-12)

    def test_a_column_without_variation_in_a_training_set_keeps_its_scale(self):
        x = np.random.default_rng(1).normal(size=40)
        late = np.where(np.arange(40) < 30, 0.5, x)
        data = RegressionData.from_arrays(np.column_stack([np.ones(40), x, late]), x + late)
        part = cross_validation(data, 4).training[3]
        assert part.column_scale[2] == data.column_scale[2]
        np.testing.assert_array_equal(part.scaled_design_matrix[:, 2], np.zeros(30))

    def test_blocks_follow_time_within_each_run(self):
        rng = np.random.default_rng(2)
        X, y = rng.normal(size=(24, 2)), rng.normal(size=24)
        run, time = np.repeat(["b", "a"], 12), np.tile(np.arange(12.0), 2)
        shuffled = rng.permutation(24)
        shuffled = shuffled[np.argsort(run[shuffled] == "a", kind="stable")]
        sorted_rows = RegressionData.from_arrays(X, y, time=time, run=run)
        mixed = RegressionData.from_arrays(X[shuffled], y[shuffled], time=time[shuffled], run=run[shuffled])
        for one, other in zip(
            cross_validation(sorted_rows, 4).held_out, cross_validation(mixed, 4).held_out, strict=True
        ):
            assert set(zip(one.run, one.time, strict=True)) == set(zip(other.run, other.time, strict=True))

    def test_a_response_that_is_constant_over_training_rows_is_refused(self):
        with refused(InferenceError, "response"):
            cross_validation(self.data(np.where(np.arange(40) < 30, 1.0, 2.0 + np.arange(40.0))), 4)


class TestErrors:
    def test_they_are_value_errors(self):
        assert issubclass(InferenceError, ValueError)


@pytest.mark.parametrize("split", ["blocks", "random"])
def test_rows_that_are_held_out_and_fitted_are_named(split):
    """Rows that stand twice; not a steady course, nor equal rows of rounded values."""
    rng = np.random.default_rng(3)
    X, y = rng.normal(size=(60, 2)), rng.normal(size=60)
    again = np.append(np.arange(60), np.arange(8))
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        cross_validation(RegressionData.from_arrays(X[again], y[again]), split=split, rng=rng)
    assert [str(one.message) for one in caught] == [
        "Rows held out must not be rows of the fit, found 8 of 68 that repeat another; give each once."
    ]
    steady = np.append(np.zeros(8, dtype=int), np.arange(60))
    cross_validation(RegressionData.from_arrays(X[steady], y[steady]), split=split, rng=rng)
    cross_validation(RegressionData.from_arrays(np.round(X), np.round(y)), split=split, rng=rng)
