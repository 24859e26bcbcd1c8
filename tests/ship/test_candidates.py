"""How far the covariance of a candidate is widened: the scatter of the fits to all runs but one."""

from __future__ import annotations

import numpy as np
import pytest

from pymc_ship.ship.candidates import LARGEST_INFLATION, _inflation
from pymc_ship.ship.held_out import HeldOut
from pymc_ship.trajectory.windows import WindowFit
from tests.ship.cases import tanker

RNG = np.random.default_rng


def fit_of(coefficients, from_windows, from_prior, information):
    return WindowFit(tanker(), coefficients, from_windows, from_prior, information, {}, 1.0, 1)


def means(runs, from_windows, from_prior=None, information=None):
    """Fit that is the mean of what each run says, and the means without one of them."""
    size = runs.shape[1]
    none, own = np.zeros((size, size)), np.linalg.inv(from_windows) if information is None else information
    law = from_windows, none if from_prior is None else from_prior, own
    count = len(runs)
    others = tuple(fit_of((runs.sum(axis=0) - run) / (count - 1), *law) for run in runs)
    return fit_of(runs.mean(axis=0), *law), HeldOut(others, (), np.zeros(count), {})


class TestInflation:
    @pytest.mark.parametrize("count", [2, 3, 8])
    @pytest.mark.parametrize("factor", [1.3, 2.0])
    def test_the_jackknife_of_a_mean_is_its_standard_error(self, count, factor):
        """The covariance of the mean of n runs is their sample covariance over n (Quenouille, Tukey)."""
        runs = RNG(count).standard_normal((count, 1))
        error = runs.var(axis=0, ddof=1) / count
        assert _inflation(*means(runs, np.diag(error) / factor**2)) == pytest.approx(factor, rel=1e-9)

    def test_it_is_the_same_in_any_units(self):
        runs = RNG(5).standard_normal((6, 3))
        covariance = np.cov(runs.T) / 6
        assert _inflation(*means(runs, covariance / 1.7**2)) == pytest.approx(1.7, rel=1e-9)
        units = np.array([1.0, 1e3, 1e-4])
        assert _inflation(*means(runs * units, covariance * np.outer(units, units) / 1.7**2)) == pytest.approx(1.7)

    def test_what_the_prior_alone_determines_does_not_count(self):
        """The windows know the first coefficient; the second has the curvature of its prior and scatters a little."""
        runs = RNG(6).standard_normal((5, 2))
        error = runs[:, 0].var(ddof=1) / 5
        windows, prior = np.diag([error / 1.5**2, 1e-12]), np.diag([0.0, 1.0])
        information = np.diag([1.5**2 / error, 1.0])
        assert _inflation(*means(runs, windows, prior, information)) == pytest.approx(1.5, rel=1e-9)

    @pytest.mark.parametrize(("factor", "expected"), [(0.5, 1.0), (100.0, LARGEST_INFLATION)])
    def test_it_never_narrows_and_is_bounded(self, factor, expected):
        runs = RNG(7).standard_normal((4, 1))
        error = runs.var(axis=0, ddof=1) / 4
        assert _inflation(*means(runs, np.diag(error) / factor**2)) == expected
