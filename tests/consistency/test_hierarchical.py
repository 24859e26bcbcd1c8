"""Simulation-based calibration of partial pooling, and what it gains on simulated sister ships."""

from functools import cache

import numpy as np
import pytest
from scipy import stats

from pymc_ship.inference.sampling.hierarchical_model import marginal_density, reduced_groups, standardised_draws
from pymc_ship.inference.sampling.regression_model import sample_density
from tests.inference.sampling.test_hierarchical_model import GROUPS, PRIOR, SPREAD, columns, data_of, truth

SETS, KEPT = 200, 99


@cache
def calibration(spread=SPREAD):
    """Ranks of truths among draws over sets from the prior, and squared errors of pooled and separate coefficients."""
    rng = np.random.default_rng(11)
    ranks, errors = [], []
    for k in range(SETS):
        tau, means, each, variance = truth(rng)
        data = data_of(rng, each, variance)
        reduced = reduced_groups(data, PRIOR, columns()[1])
        settings = {"draws": 5 * KEPT, "tune": 300, "chains": 1, "target_accept": 0.9}
        drawn = sample_density(marginal_density(reduced, PRIOR, spread), settings, k, progress=False)["posterior"]
        of_tau, of_variance = (
            drawn[name].values[0, ::5] for name in ("scaled_group_sd", "scaled_group_noise_variance")
        )
        standard = standardised_draws(reduced, PRIOR, of_tau, of_variance, rng)
        of_means = standard[:, 0]
        of_each = of_means[:, None] + of_tau[:, None] * standard[:, 1:]
        found = np.column_stack([of_tau, of_means, of_each.reshape(KEPT, -1), of_variance])
        ranks.append((found < np.concatenate([tau, means, each.ravel(), variance])).sum(axis=0))
        separate = [PRIOR.exact(data.rows(columns()[1] == g)).mean for g in range(GROUPS)]
        errors.append([np.mean((of_each.mean(axis=0) - each) ** 2), np.mean((np.array(separate) - each) ** 2)])
    return np.array(ranks), np.array(errors)


def least_p(ranks):
    """Least p-value of uniform ranks over the quantities, in ten bins, times their number."""
    counts = [np.bincount(column // 10, minlength=10) for column in ranks.T]
    return min(stats.chisquare(one).pvalue for one in counts) * len(counts)


@pytest.mark.consistency
def test_it_is_calibrated():
    """Simulation-based calibration over 200 sets; with a third of the spread it fails."""
    assert least_p(calibration()[0]) > 1e-3
    assert least_p(calibration(SPREAD / 3.0)[0]) < 1e-3


@pytest.mark.consistency
def test_pooled_sisters_are_nearer_the_truth_than_separate_ones():
    pooled, separate = calibration()[1].T
    gain = separate - pooled
    assert gain.mean() > 3.0 * gain.std(ddof=1) / np.sqrt(SETS)
