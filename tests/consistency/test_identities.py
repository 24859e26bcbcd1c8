"""Identities of the exact posteriors that tests of one module leave out."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import stats

from pymc_ship.inference.regression.conjugate import ConjugatePrior
from pymc_ship.inference.regression.semiconjugate import SemiConjugatePrior
from tests.inference.regression.peers import oracle, simulated

CHIB = {"ds1": -735.118649021482, "ds2": -547.715057153241}
"""Log evidence under the semi-conjugate prior by Chib (1995), doi:10.1080/01621459.1995.10476635, from Gibbs draws."""


def one_step_ahead(data, prior, first=1):
    total = prior.exact(data.rows(np.arange(first))).log_evidence
    for k in range(first, data.n_rows):
        new = data.rows(np.arange(k, k + 1))
        exact = prior.exact(data.rows(np.arange(k)))
        total += exact.log_predictive_density(new.design_matrix, new.response, pointwise=True)[0]
    return total


@pytest.mark.parametrize("name", [pytest.param("ds1"), pytest.param("ds2", marks=pytest.mark.consistency)])
def test_one_step_ahead_predictives_multiply_to_the_evidence_of_chib(name):
    known = oracle(name)
    prior = SemiConjugatePrior(kappa=known.kappa, shape=known.shape, scale=known.scale)
    assert one_step_ahead(known.data, prior) == pytest.approx(CHIB[name], abs=1e-4)
    twin = SemiConjugatePrior(kappa=known.kappa, shape=known.shape, scale=1.0 / known.scale + (known.scale == 1.0))
    assert abs(twin.exact(known.data).log_evidence - CHIB[name]) > 1e-2
    off_by_a_row = known.data.rows(np.arange(1, known.data.n_rows))
    assert abs(prior.exact(off_by_a_row).log_evidence - CHIB[name]) > 1e-2


def normal_equations(X, y, mean, precision, shape, scale):
    """Textbook update with a full prior precision, in units of 1 / sigma2."""
    updated = precision + X.T @ X
    location = np.linalg.solve(updated, precision @ mean + X.T @ y)
    square = y @ y + mean @ precision @ mean - location @ updated @ location
    return location, updated, shape + 0.5 * len(y), scale + 0.5 * square


@pytest.mark.parametrize("batches", [2, 5])
def test_batches_by_the_normal_equations_give_the_conjugate_posterior_of_the_whole(batches):
    data = simulated(40, 4, seed=41)
    prior = ConjugatePrior(mean=[0.5, -1.0, 0.0, 2.0], kappa=[0.5, 1.0, 2.0, 3.0], shape=5.0, scale=2.0)
    state = prior.means(4), np.diag(1.0 / prior.kappas(4)), prior.shape, prior.scale
    for rows in np.array_split(np.arange(40), batches):
        state = normal_equations(data.design_matrix[rows], data.response[rows], *state)
    location, precision, shape, scale = state
    exact = prior.exact(data)
    np.testing.assert_allclose(exact.mean, location, rtol=0.0, atol=1e-10)
    np.testing.assert_allclose(exact.covariance, np.linalg.inv(precision) * scale / (shape - 1.0), rtol=0.0, atol=1e-10)
    assert (exact.shape, exact.scale) == pytest.approx((shape, scale), abs=1e-10)
    short = prior.exact(data.rows(np.arange(1, 40)))
    assert np.abs(short.mean - location).max() > 1e-4


def test_batches_give_the_semiconjugate_density_of_the_whole():
    """Posterior density of sigma2 after a batch times the evidence of the next given sigma2, by dense matrices."""
    data = simulated(24, 3, seed=42)
    prior = SemiConjugatePrior(mean=[0.5, -1.0, 0.0], kappa=[0.5, 1.0, 2.0], shape=5.0, scale=2.0)
    first, rest, whole = (data.rows(rows) for rows in (np.arange(12), np.arange(12, 24), np.arange(24)))
    X, y = first.design_matrix, first.response
    before, after = prior.exact(first), prior.exact(whole)
    for sigma2 in (0.3, 0.8, 1.5):
        precision = np.diag(1.0 / prior.kappas(3)) + X.T @ X / sigma2
        mean = np.linalg.solve(precision, prior.means(3) / prior.kappas(3) + X.T @ y / sigma2)
        covariance = rest.design_matrix @ np.linalg.solve(precision, rest.design_matrix.T) + sigma2 * np.eye(12)
        step = stats.multivariate_normal.logpdf(rest.response, rest.design_matrix @ mean, covariance)
        sequential = np.log(before.noise_variance_density(sigma2)) + step
        sequential -= after.log_evidence - before.log_evidence
        assert sequential == pytest.approx(float(np.log(after.noise_variance_density(sigma2))), abs=1e-10)
