"""What windows said, as a statement beside the prior of other windows."""

from dataclasses import replace

import numpy as np
import pytest

import pymc_ship as ps
from pymc_ship.inference.trajectory.prior import CoefficientPrior, Statement
from pymc_ship.inference.trajectory.statements import Earlier, joined, loosened, said_by_windows
from pymc_ship.inference.trajectory.windows import WindowFit

RNG = np.random.default_rng(4)
N = len(ps.load_vessel("kvlcc2").forces["surge"]) + 2 * len(ps.load_vessel("kvlcc2").forces["yaw"])


def linear_case(earlier=None):
    """A fit of a linear model: prior, windows' precision and their own estimate, and the fit that both make."""
    vessel = ps.load_vessel("kvlcc2")
    scale = 10.0 ** RNG.uniform(-5, -2, N)
    mean = scale * RNG.standard_normal(N)
    prior = CoefficientPrior(mean, scale, scale, np.zeros(N, dtype=bool), "stated", earlier)
    root = RNG.standard_normal((N + 5, N)) / scale
    windows, own = root.T @ root, mean + scale * RNG.standard_normal(N)
    rows = prior.stated.rows
    information = windows + np.diag(scale**-2.0) + rows.T @ rows
    right = windows @ own + mean / scale**2 + rows.T @ prior.stated.values
    size = np.sqrt(np.diag(information))
    found = np.linalg.solve(information / np.outer(size, size), right / size) / size
    zero = np.zeros((N, N))
    return WindowFit(vessel, found, zero, zero, information, {}, 1.0, 1), prior, windows, own


@pytest.mark.parametrize("earlier", [None, Statement(1e3 * np.eye(N)[:4], np.ones(4))])
def test_a_linear_fit_says_its_windows(earlier):
    fit, prior, windows, own = linear_case(earlier)
    said = said_by_windows(fit, prior)
    unit = np.outer(prior.scale, prior.scale)
    np.testing.assert_allclose(said.rows.T @ said.rows * unit, windows * unit, rtol=1e-6, atol=1e-6)
    assert np.abs(said.misfit(own)).max() < 1e-5 * np.abs(said.values).max()


def test_an_inflated_fit_says_less():
    fit, prior, *_ = linear_case()
    plain, wide = said_by_windows(fit, prior), said_by_windows(fit, prior, 2.0)
    np.testing.assert_allclose(2.0 * wide.rows, plain.rows)
    np.testing.assert_allclose(2.0 * wide.values, plain.values)


def test_constants_of_a_run_are_not_carried_on():
    vessel = ps.with_terms(ps.load_vessel("kvlcc2"), "modular")
    parameters = tuple(replace(c, per_run=k == 3) for k, c in enumerate(vessel.parameters))
    n = len(parameters)
    scale = np.full(n, 0.1)
    prior = CoefficientPrior(np.zeros(n), scale, scale, np.zeros(n, dtype=bool), "stated")
    zero = np.zeros((n, n))
    fit = WindowFit(replace(vessel, parameters=parameters), np.ones(n), zero, zero, 300.0 * np.eye(n), {}, 1.0, 1)
    said = said_by_windows(fit, prior)
    assert not said.rows[:, 3].any()
    assert len(said.rows) == n - 1


def test_statements_are_joined_in_order():
    one, other = Statement(np.eye(2), np.array([1.0, 2.0])), Statement(np.ones((1, 2)), np.array([3.0]))
    assert joined([None, None]) is None
    both = joined([one, None, other])
    np.testing.assert_array_equal(both.values, [1.0, 2.0, 3.0])
    assert both.rows.shape == (3, 2)


@pytest.mark.parametrize(("shift", "low", "high"), [(0.0, 0.0, 0.0), (0.5, 0.3, 0.8)])
def test_a_statement_is_loosened_as_far_as_coefficients_have_moved(shift, low, high):
    n = 40
    moved = shift * np.random.default_rng(2).standard_normal(n)
    prior = CoefficientPrior(np.zeros(n), np.ones(n), np.ones(n), np.zeros(n, dtype=bool), "stated")
    statement = Statement(100.0 * np.eye(n), np.zeros(n))
    found, (share,) = loosened(statement, prior, moved, 1e-4 * np.eye(n))
    assert low <= share <= high
    assert np.linalg.norm(found.rows) <= np.linalg.norm(statement.rows) * (1.0 + 1e-12)


def test_coefficients_of_a_facility_have_a_share_of_their_own():
    """Five of forty have moved by their prior sd; one share for all, the broken twin, lets the others go, too."""
    n, own = 40, [3, 7, 11, 20, 33]
    moved = np.zeros(n)
    moved[own] = (1.0, -1.2, 0.9, -0.8, 1.1)
    prior = CoefficientPrior(np.zeros(n), np.ones(n), np.ones(n), np.zeros(n, dtype=bool), "stated")
    statement = Statement(100.0 * np.eye(n), np.zeros(n))
    found, (shared, apart) = loosened(statement, prior, moved, 1e-4 * np.eye(n), own)
    assert shared == 0.0
    assert 0.7 < apart <= 1.0
    sizes = np.linalg.norm(found.rows, axis=0)
    others = np.setdiff1d(np.arange(n), own)
    assert sizes[own].max() < 2.0
    np.testing.assert_allclose(sizes[others], 100.0)
    alike, (share,) = loosened(statement, prior, moved, 1e-4 * np.eye(n))
    assert share > 0.2
    assert np.linalg.norm(alike.rows, axis=0).max() < 10.0


def test_at_another_draught_a_ship_is_as_far_from_what_is_typical():
    rng = np.random.default_rng(7)
    names, n = ("Yv", "Nr", "R0", "gone"), 4
    mean, scale = rng.normal(size=n), rng.uniform(0.5, 2.0, n)
    here = Earlier(names, Statement(rng.normal(size=(6, n)), rng.normal(size=6)), np.zeros(2), mean, scale)
    other = CoefficientPrior(
        rng.normal(size=3), rng.uniform(0.5, 2.0, 3), np.ones(3), np.zeros(3, dtype=bool), "stated"
    )
    there = here.at_loading(names[:3], other)
    away = rng.normal(size=n)
    moved = np.append(other.mean + other.scale * away[:3], mean[3] + scale[3] * away[3])
    np.testing.assert_allclose(there.statement.misfit(moved), here.statement.misfit(mean + scale * away))
    again = there.at_loading(names, CoefficientPrior(mean, scale, np.ones(n), np.zeros(n, dtype=bool), "stated"))
    np.testing.assert_allclose(again.statement.rows, here.statement.rows)
    np.testing.assert_allclose(again.statement.values, here.statement.values)
