from __future__ import annotations

import numpy as np
import pytest
from scipy import stats
from scipy.special import logsumexp

from pymc_ship.inference.regression.conjugate import ConjugatePrior
from pymc_ship.inference.regression.cross_validation import cross_validation, fold_rows
from pymc_ship.inference.regression.semiconjugate import SemiConjugatePrior
from pymc_ship.inference.rows.data import RegressionData
from pymc_ship.machine.errors import InferenceError
from tests.inference.regression.peers import oracle, simulated

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


class TestErrors:
    def test_they_are_value_errors(self):
        assert issubclass(InferenceError, ValueError)
