"""Exact posteriors from rows read a chunk at a time are those of all rows at once, in memory that does not grow."""

from __future__ import annotations

import gc
import tracemalloc
import weakref

import numpy as np
import pytest

import pymc_ship as ps
from tests.inference.regression.peers import largest_z, z_limit

PRIORS = {
    "conjugate": ps.ConjugatePrior(kappa=10.0, shape=3.0, scale=2.0),
    "semiconjugate": ps.SemiConjugatePrior(kappa=10.0, shape=3.0, scale=2.0),
}
CASES = [(kind, scaling) for kind in ("plain", "collinear", "constant") for scaling in ("none", "zscore")]
CASES += [("sizes", "zscore")]  # without scaling the condition number is 1e18, and an SVD of either is lost
EXACT = {"conjugate": ps.conjugate, "semiconjugate": ps.semiconjugate}


def in_chunks(X, y, size):
    for begin in range(0, len(y), size):
        yield X[begin : begin + size], y[begin : begin + size]


def design(kind, n_rows=3000, n_terms=7):
    """Plain columns; columns collinear to 1e-7; columns of sizes from 1e-9 to 1e9; columns of large mean with a one."""
    rng = np.random.default_rng(5)
    X = rng.standard_normal((n_rows, n_terms))
    if kind == "collinear":
        X[:, 1] = X[:, 0] + 1e-7 * X[:, 1]
        X[:, 4] = X[:, 2] - X[:, 3] + 1e-6 * X[:, 4]
    elif kind == "sizes":
        X *= np.logspace(-9, 9, n_terms)
    elif kind == "constant":
        X[:, 2] = 4.0
        X[:, :2] += 1e3
    y = (X / np.abs(X).max(axis=0)) @ rng.standard_normal(n_terms) + 0.1 * rng.standard_normal(n_rows)
    return X, y + (1e4 if kind == "constant" else 0.0)


def both(kind, scaling, size=700):
    X, y = design(kind)
    return ps.RegressionData.from_arrays(X, y, scaling=scaling), ps.stream_regression(
        in_chunks(X, y, size), scaling=scaling
    )


def assert_same(ours, expected, tolerance=1e-10):
    """Means within so many standard deviations; standard deviations and noise relatively; log evidence absolutely."""
    assert np.abs((ours.mean - expected.mean) / expected.sd).max() < tolerance
    np.testing.assert_allclose(ours.sd, expected.sd, rtol=tolerance)
    np.testing.assert_allclose(ours.noise_variance_mean, expected.noise_variance_mean, rtol=tolerance)
    np.testing.assert_allclose(ours.log_evidence, expected.log_evidence, rtol=tolerance, atol=1e-8)


class TestSameAsInMemory:
    @pytest.mark.parametrize("family", PRIORS)
    @pytest.mark.parametrize(("kind", "scaling"), CASES)
    def test_posterior(self, kind, scaling, family):
        data, streamed = both(kind, scaling)
        exact = EXACT[family]
        assert_same(exact(streamed, PRIORS[family]), exact(data, PRIORS[family]))

    def test_a_prior_with_vectors(self):
        data, streamed = both("constant", "zscore")
        prior = ps.ConjugatePrior(mean=np.linspace(-1.0, 1.0, 7), kappa=np.logspace(-1, 2, 7))
        assert_same(ps.conjugate(streamed, prior), ps.conjugate(data, prior))

    @pytest.mark.parametrize("kind", ["plain", "collinear", "constant"])
    def test_scaling_and_diagnostics(self, kind):
        data, streamed = both(kind, "zscore")
        for name in ("column_center", "column_scale", "response_center", "response_scale", "constant_level"):
            np.testing.assert_allclose(getattr(streamed, name), getattr(data, name), rtol=1e-12, atol=1e-12)
        assert (streamed.n_rows, streamed.n_terms, streamed.constant) == (data.n_rows, data.n_terms, data.constant)
        np.testing.assert_allclose(streamed.condition_number, data.condition_number, rtol=1e-6)
        np.testing.assert_allclose(streamed.variance_inflation_factors, data.variance_inflation_factors, rtol=1e-6)

    def test_evidence_maximum_and_gibbs(self):
        data, streamed = both("plain", "zscore")
        (prior, value), (expected, least) = (ps.maximise_evidence(each, "conjugate") for each in (streamed, data))
        best, least = value + prior.log_hyperprior(), least + expected.log_hyperprior()  # the maximum of this is flat
        np.testing.assert_allclose(best, least, rtol=1e-10)
        np.testing.assert_allclose(prior.kappa, expected.kappa, rtol=1e-3)
        prior = PRIORS["semiconjugate"]
        draws = ps.gibbs(streamed, prior, draws=1000, chains=4, rng=np.random.default_rng(1))
        z, comparisons = largest_z(*draws, ps.semiconjugate(data, prior))
        assert z < z_limit(comparisons)

    def test_the_cut_into_chunks_does_not_matter(self):
        X, y = design("plain")
        found = [ps.stream_regression(in_chunks(X, y, size)).least_squares for size in (1, 17, 2048, 10**6)]
        np.testing.assert_allclose(found, np.tile(np.linalg.lstsq(X, y, rcond=None)[0], (4, 1)), rtol=1e-10)

    def test_a_perfect_fit_has_no_residual_left_by_cancellation(self):
        """The broken twin, y'y - b'X'y, is off by 1e-16 times y'y = 3e21; the triangle's residual is explicit."""
        X, y = design("plain")
        y = 1e9 + 1e-3 * y
        X[:, 0] = 1.0
        _, residual = ps.stream_regression(in_chunks(X, y, 500), scaling="zscore").projection
        _, expected = ps.RegressionData.from_arrays(X, y, scaling="zscore").projection
        np.testing.assert_allclose(residual, expected, rtol=1e-6)


class TestMemory:
    def test_no_chunk_is_kept(self):
        alive = []

        def watched():
            rng = np.random.default_rng(0)
            for _ in range(20):
                gc.collect()
                assert sum(reference() is not None for reference in alive) <= 1  # the one that the loop still holds
                X = rng.standard_normal((5000, 4))
                alive.append(weakref.ref(X))
                yield X, X.sum(axis=1) + rng.standard_normal(5000)

        assert ps.stream_regression(watched()).n_rows == 100000

    @pytest.mark.parametrize("n_chunks", [4, 40])
    def test_the_peak_does_not_grow_with_the_rows(self, n_chunks):
        def made():
            rng = np.random.default_rng(0)
            for _ in range(n_chunks):
                yield rng.standard_normal((5000, 10)), rng.standard_normal(5000)

        tracemalloc.start()
        ps.stream_regression(made())
        peak = tracemalloc.get_traced_memory()[1]
        tracemalloc.stop()
        assert peak < 4 * 5000 * 11 * 8
