from __future__ import annotations

import numpy as np
import pytest
from scipy.special import logsumexp

from pymc_ship.inference.regression.semiconjugate import SemiConjugatePrior
from pymc_ship.inference.rows.data import RegressionData
from tests.inference.regression.cases import case, dense, two_modes, vector_prior
from tests.inference.regression.peers import oracle, simulated

SHAPES = [(12, 3), (3, 7), (5, 5), (1, 2)]
"""Rows and terms: more rows, more terms, as many, and a single row."""


def dense_evidence(X, y, prior):
    """Log evidence from a brute number of nodes."""
    t = np.linspace(-30.0, 40.0, 140_001)
    return logsumexp(dense(X, y, prior, t)) + np.log(t[1] - t[0])


class TestQuadrature:
    @pytest.mark.parametrize(("n_rows", "n_terms"), SHAPES)
    def test_the_evidence_is_that_of_dense_matrices(self, n_rows, n_terms):
        data, prior = simulated(n_rows, n_terms, seed=1), vector_prior(n_terms)
        known = dense_evidence(data.design_matrix, data.response, prior)
        assert prior.exact(data).log_evidence == pytest.approx(known, abs=1e-9)

    @pytest.mark.parametrize("shape", [0.05, 1.0, 1e5])
    @pytest.mark.parametrize("scale", [1e-6, 1.0, 1e4])
    def test_skewed_and_sharp_marginals(self, shape, scale):
        data, prior = simulated(4, 6, seed=2), SemiConjugatePrior(kappa=3.0, shape=shape, scale=scale)
        exact = prior.exact(data)
        t = np.linspace(exact.log_noise_variance[0] - 5.0, exact.log_noise_variance[-1] + 5.0, 400_001)
        log_density = dense(data.design_matrix, data.response, prior, t)
        known = logsumexp(log_density) + np.log(t[1] - t[0])
        assert exact.log_evidence == pytest.approx(known, abs=1e-8)

    def test_two_modes_are_both_covered(self):
        data, prior = two_modes()
        t = np.linspace(-20.0, 20.0, 2001)
        log_density = dense(data.design_matrix, data.response, prior, t)
        peaks = np.flatnonzero(np.diff(np.sign(np.diff(log_density))) < 0)
        exact = prior.exact(data)
        assert peaks.size == 2
        assert exact.log_noise_variance[0] < t[peaks[0]] < t[peaks[1]] < exact.log_noise_variance[-1]
        known = dense_evidence(data.design_matrix, data.response, prior)
        assert exact.log_evidence == pytest.approx(known, abs=1e-9)

    def test_modes_with_nothing_between_them_are_both_covered(self):
        """The density falls by e^-100 between them, further than the grid reaches beyond either."""
        rng = np.random.default_rng(1)
        X = rng.standard_normal((40, 8))
        y = 300.0 * X.sum(axis=1) + rng.standard_normal(40)
        prior = SemiConjugatePrior(kappa=1445.0, shape=2.0, scale=1.0)
        log_density = dense(X, y, prior, np.linspace(-0.3, 12.6, 500))
        assert min(log_density[0], log_density[-1]) - log_density.min() > 100.0
        exact = prior.exact(RegressionData.from_arrays(X, y, scaling="none"))
        share = exact.weights[exact.log_noise_variance > 6.0].sum()
        assert 0.01 < share < 0.99
        assert exact.log_evidence == pytest.approx(dense_evidence(X, y, prior), abs=1e-9)

    def test_half_the_nodes_give_the_same(self):
        """The weights of every second node add up to one half, as they do once the trapezoid rule has converged."""
        for data, prior in (case(), two_modes(), (simulated(2, 9, seed=3), vector_prior(9))):
            weights = prior.exact(data).weights
            assert weights[::2].sum() == pytest.approx(0.5, abs=1e-11)
            assert abs(weights[::16].sum() - 1.0 / 16.0) > 1e-5

    def test_a_handful_of_nodes_usually_suffices(self):
        known = oracle("ds2")
        assert SemiConjugatePrior(kappa=100.0).exact(known.data).weights.size < 80
