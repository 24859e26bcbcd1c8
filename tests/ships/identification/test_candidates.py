"""How far the covariance of a candidate is widened: how far its fit moves with each run."""

from __future__ import annotations

import numpy as np
import pytest

from pymc_ship.inference.trajectory.windows import WindowFit
from pymc_ship.ships.identification.candidates import LARGEST_INFLATION, _inflation
from pymc_ship.ships.identification.held_out import CrossValidation
from tests.ships.identification.cases import tanker

RNG = np.random.default_rng


def fit_of(coefficients, from_windows, from_prior, information):
    return WindowFit(tanker(), coefficients, from_windows, from_prior, information, {"u": 1.0}, 1.0, 1)


def means(runs, covariance, prior=None):
    """Fit that is the mean of what each run says, to a covariance, and the means without one of them.

    ``prior`` is the precision that a prior adds about that mean.
    """
    count, size = len(runs), runs.shape[1]
    known = np.zeros((size, size)) if prior is None else prior

    def law(share):
        precision = share * np.linalg.inv(covariance)
        posterior = np.linalg.inv(precision + known)
        return posterior @ precision @ posterior, posterior @ known @ posterior, precision + known

    less = law((count - 1) / count)
    others = tuple(fit_of((runs.sum(axis=0) - run) / (count - 1), *less) for run in runs)
    return fit_of(runs.mean(axis=0), *law(1.0)), CrossValidation(others, (), np.zeros(count), {})


def unlike_runs(rng, noise=1.0):
    """Two runs that tell different coefficients of a ship of the prior, with noise of so many times the stated sd."""
    designs = [np.diag([30.0, 30.0, 0.3, 0.3]), np.diag([0.3, 30.0, 30.0, 0.3])]
    truth = rng.standard_normal(4)
    read = [design @ truth + noise * rng.standard_normal(4) for design in designs]

    def fit(runs):
        windows = sum((designs[k].T @ designs[k] for k in runs), np.zeros((4, 4)))
        covariance = np.linalg.inv(windows + np.eye(4))
        at = covariance @ sum(designs[k].T @ read[k] for k in runs)
        return fit_of(at, covariance @ windows @ covariance, covariance @ covariance, windows + np.eye(4))

    return fit([0, 1]), CrossValidation((fit([1]), fit([0])), (), np.zeros(2), {})


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
        """The windows know the first coefficient, the prior the second."""
        runs = RNG(6).standard_normal((5, 2))
        error = runs[:, 0].var(ddof=1) / 5
        covariance, prior = np.diag([error / 1.5**2, 1e12]), np.diag([0.0, 1.0])
        assert _inflation(*means(runs, covariance, prior)) == pytest.approx(1.5, rel=1e-6)

    def test_runs_of_different_kinds_do_not_widen_a_model_that_is_right(self):
        """A run that is left out gives its coefficients back to the prior, which is no scatter of the others."""
        rng = RNG(8)
        found = [_inflation(*unlike_runs(rng)) for _ in range(200)]
        assert np.mean(found) < 1.4
        scatter = []
        for _ in range(200):  # broken twin: the jackknife, which takes it for scatter
            whole, judged = unlike_runs(rng)
            apart = 0.5 * np.subtract(*(fit.coefficients for fit in judged.fits))
            own = whole.information - np.eye(4)
            scatter.append(np.sqrt(apart @ own @ apart / np.trace(own @ whole.from_windows)))
        assert np.median(scatter) > 5.0

    def test_windows_that_scatter_more_than_they_say_are_widened(self):
        rng = RNG(9)
        runs = rng.standard_normal((400, 3))
        covariance = np.eye(3) / 400 / 2.5**2
        assert _inflation(*means(runs, covariance)) == pytest.approx(2.5, rel=4.0 / np.sqrt(2.0 * 1200))

    @pytest.mark.parametrize(("factor", "expected"), [(0.5, 1.0), (100.0, LARGEST_INFLATION)])
    def test_it_never_narrows_and_is_bounded(self, factor, expected):
        runs = RNG(7).standard_normal((4, 1))
        error = runs.var(axis=0, ddof=1) / 4
        assert _inflation(*means(runs, np.diag(error) / factor**2)) == expected
