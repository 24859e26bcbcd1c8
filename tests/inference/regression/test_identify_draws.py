"""Rows of draws and the posterior pooled over them: the law of total variance, and intervals that hold."""

from __future__ import annotations

import numpy as np
import pytest

import pymc_ship as ps

PRIOR = ps.ConjugatePrior(kappa=100.0, shape=2.0, scale=1.0)


def rows(X, y):
    return [ps.RegressionData.from_arrays(x[:, None], y, ["slope"], scaling="none") for x in X]


def test_moments_are_those_of_the_mixture():
    rng = np.random.default_rng(1)
    data = rows(rng.standard_normal((30, 50)), rng.standard_normal(50))
    found = ps.pooled_coefficients(data, PRIOR, draws=30_000, rng=rng)
    exact = [PRIOR.exact(one) for one in data]
    means, sds = (np.array([getattr(one, name)[0] for one in exact]) for name in ("mean", "sd"))
    assert float(found["mean"][0]) == pytest.approx(means.mean())
    assert float(found["within_sd"][0]) == pytest.approx(np.sqrt(np.mean(sds**2)))
    assert float(found["between_sd"][0]) == pytest.approx(means.std(ddof=1))
    assert float(found["sd"][0]) ** 2 == pytest.approx(np.mean(sds**2) + 31.0 / 30.0 * means.var(ddof=1))
    pooled = np.concatenate([one.draw(20_000, rng)[0][:, 0] for one in exact])
    spread = 5.0 * pooled.std() / np.sqrt(30_000) * 3.0  # of a quantile in the tail: sqrt(p q) / density is about 3 sd
    assert float(found["lower"][0]) == pytest.approx(np.quantile(pooled, 0.05), abs=spread)
    assert float(found["upper"][0]) == pytest.approx(np.quantile(pooled, 0.95), abs=spread)


def test_equal_draws_pool_to_their_own_posterior():
    rng = np.random.default_rng(2)
    x, y = rng.standard_normal(60), rng.standard_normal(60)
    found = ps.pooled_coefficients(rows([x, x, x], y), PRIOR, rng=rng)
    exact = PRIOR.exact(rows([x], y)[0])
    assert float(found["sd"][0]) == pytest.approx(exact.sd[0])
    assert float(found["between_sd"][0]) == pytest.approx(0.0, abs=1e-15)


def test_pooled_intervals_hold_a_mean_of_missing_values_and_known_ones_do_not():
    """Rubin's case: half of the responses are missing and drawn given the others; 90 % of 200 sets, the twin fewer."""
    held, known = [], []
    ones = np.ones((100, 1))
    for seed in range(200):
        rng = np.random.default_rng(seed)
        observed = rng.standard_normal(50)
        drawn = []
        for _ in range(20):
            variance = 49.0 * observed.var(ddof=1) / rng.chisquare(49)
            mean = observed.mean() + np.sqrt(variance / 50.0) * rng.standard_normal()
            full = np.concatenate([observed, mean + np.sqrt(variance) * rng.standard_normal(50)])
            drawn.append(ps.RegressionData.from_arrays(ones, full, ["mean"], scaling="none"))
        found = ps.pooled_coefficients(drawn, PRIOR, draws=2000, rng=rng)
        held.append(float(found["lower"][0]) < 0.0 < float(found["upper"][0]))
        low, high = PRIOR.exact(drawn[0]).quantiles([0.05, 0.95])[:, 0]
        known.append(low < 0.0 < high)
    error = np.sqrt(0.9 * 0.1 / 200)
    assert abs(np.mean(held) - 0.9) < 4.0 * error
    assert np.mean(known) < 0.9 - 4.0 * error


def test_each_draw_has_its_rows(container, drawn):
    found = ps.regression_draws(drawn, container, "yaw", interval=1.0, derivative="savgol")
    assert len(found) == 3
    for k, data in enumerate(found):
        alone = ps.regression_data(drawn.isel(draw=k), container, "yaw", interval=1.0, derivative="savgol")
        np.testing.assert_array_equal(data.design_matrix, alone.design_matrix)
        np.testing.assert_array_equal(data.response, alone.response)
    assert not np.array_equal(found[0].response, found[1].response)


def test_an_informed_prior_keeps_its_units_over_rows_of_other_scale():
    rng = np.random.default_rng(3)
    X = [scale * rng.standard_normal((20, 1)) for scale in (1.0, 6.0)]
    data = [ps.RegressionData.from_arrays(x, x[:, 0] + rng.standard_normal(20), ["slope"]) for x in X]
    prior = ps.informed_prior(data[0], ps.SemiConjugatePrior(), {"slope": (3.0, 1e-5)})
    assert float(ps.pooled_coefficients(data, prior, rng=rng)["mean"][0]) == pytest.approx(3.0, abs=1e-3)
