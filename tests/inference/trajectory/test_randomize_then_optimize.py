"""Randomize-then-optimize draws: their misfit in the windows, their forecasts, and the normal law they start from."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

import pymc_ship as ps
from pymc_ship.inference.trajectory import fit as trajectory_fit
from pymc_ship.inference.trajectory import randomize_then_optimize as room
from pymc_ship.inference.trajectory.prior import coefficient_prior
from pymc_ship.inference.trajectory.randomize_then_optimize import randomize_then_optimize
from pymc_ship.inference.trajectory.windows import WindowFit, fit_windows, normal_draws, prepared_windows, window_misfit
from pymc_ship.physics.motion.sensitivities import sensitivities
from pymc_ship.physics.vessel.term_sets import with_terms
from pymc_ship.physics.vessel.vessel import reference_coefficients
from tests.ships.identification.cases import RUNS, tanker, trial

N = 60
CIRCLE, ZIGZAG = ps.turning_circle(35.0), ps.zigzag(15.0, 15.0)


@pytest.fixture(scope="module")
def vessel():
    return with_terms(tanker(), "modular")


@pytest.fixture(scope="module")
def true(vessel):
    """Each parameter a third of its prior sd from what is typical."""
    sd = np.array([parameter.sd for parameter in vessel.parameters])
    return reference_coefficients(vessel) + sd * np.random.default_rng(5).choice([-0.3, 0.3], sd.size)


@pytest.fixture(scope="module")
def windows(vessel, true):
    runs = [trial(what, vessel=of(vessel, true)) for what in RUNS]
    return [window for run in runs for window in prepared_windows(run, vessel)]


@pytest.fixture(scope="module")
def fit(vessel, windows):
    start = reference_coefficients(vessel)
    return fit_windows(windows, vessel, coefficient_prior([trial(RUNS[0])], vessel), start)


@pytest.fixture(scope="module")
def drawn(fit):
    return randomize_then_optimize(fit, N, np.random.default_rng(1))


def test_no_run_is_simulated_twice_at_one_point(monkeypatch, vessel, windows):
    points = []

    def counted(vessel, inputs, start, coefficients, **settings):
        points.append((inputs.tobytes(), start.tobytes(), coefficients.tobytes()))
        return sensitivities(vessel, inputs, start, coefficients, **settings)

    monkeypatch.setattr(trajectory_fit, "sensitivities", counted)
    law = coefficient_prior([trial(RUNS[0])], vessel)
    fit = fit_windows(windows, vessel, law, reference_coefficients(vessel))
    randomize_then_optimize(fit, 2, np.random.default_rng(1))
    assert len(points) == len(set(points)) > len(windows)


def of(vessel, values):
    """The ship with these parameters."""
    at = zip(vessel.parameters, values.tolist(), strict=True)
    return replace(vessel, parameters=tuple(replace(parameter, value=value) for parameter, value in at))


def rms_residuals(windows, vessel, rows):
    """Root mean square residual of r in the windows for each row [rad/s], (n_rows,)."""
    misfit = [np.concatenate([window_misfit(window, vessel, row)[2] for window in windows]) for row in rows]
    return np.sqrt(np.mean(np.square(misfit), axis=1))


def misses(vessel, true, rows):
    """Error of the median of an index, and half the width of its central 68 %, by index."""
    errors = {}
    for what, names in ((CIRCLE, ("advance", "tactical_diameter")), (ZIGZAG, ("second_overshoot_angle", "period"))):
        settings = {"duration": 1000.0, "step": 0.2, "record_interval": 0.8, "method": "rk4"}
        ships = ps.indices(ps.simulate(vessel, what, coefficients=np.vstack([true, rows]), **settings))
        for name in names:
            values = ships[name].values
            low, middle, high = np.quantile(values[1:], [0.16, 0.5, 0.84])
            errors[name] = abs(middle - values[0]), 0.5 * (high - low)
    return errors


def test_they_fit_the_windows_as_well_as_the_estimate(fit, drawn, windows, vessel, monkeypatch):
    own = rms_residuals(windows, vessel, fit.coefficients[None])[0]
    assert np.quantile(rms_residuals(windows, vessel, drawn), 0.9) < 1.1 * own
    monkeypatch.setattr(room, "_MAX_STEPS", 1)
    assert (
        np.median(rms_residuals(windows, vessel, randomize_then_optimize(fit, N, np.random.default_rng(1)))) > 3.0 * own
    )


def test_their_forecasts_do_not_err_to_one_side(fit, drawn, vessel, true):
    """Normal draws err by half their own spread and more, although the record has no noise."""
    straight = misses(vessel, true, normal_draws(fit, N, np.random.default_rng(1)))
    for name, (error, _) in misses(vessel, true, drawn).items():
        wrong, spread = straight[name]
        assert error < 0.1 * wrong, name
        assert wrong > 0.4 * spread, name


def test_where_the_motion_is_linear_they_are_those_of_the_normal_law(fit):
    narrow = replace(fit, from_windows=1e-8 * fit.from_windows, from_prior=1e-8 * fit.from_prior)
    law = [
        make(narrow, N, np.random.default_rng(2)) - fit.coefficients for make in (randomize_then_optimize, normal_draws)
    ]
    sd = np.sqrt(np.diag(narrow.covariance))
    np.testing.assert_allclose(law[0] / sd, law[1] / sd, atol=0.02)


def test_they_differ_from_the_estimate_by_the_spread_of_its_law(fit, drawn):
    """Undetermined directions keep their variance: no draw is pulled to the estimate."""
    sd = np.sqrt(np.diag(fit.covariance))
    ratio = drawn.std(axis=0) / sd
    assert 0.7 < np.median(ratio) < 1.5


def test_they_are_finite_however_wide_the_law(fit, windows, vessel):
    wild = randomize_then_optimize(replace(fit, from_windows=1e6 * fit.from_windows), N, np.random.default_rng(3))
    assert np.isfinite(wild).all()
    straight = normal_draws(replace(fit, from_windows=1e6 * fit.from_windows), N, np.random.default_rng(3))
    assert np.isnan(rms_residuals(windows, vessel, straight)).mean() > 0.5
    assert np.isnan(rms_residuals(windows, vessel, wild)).mean() < 0.05


def test_a_law_without_windows_has_normal_draws():
    law = WindowFit(tanker(), np.array([1.0, -2.0]), np.eye(2), np.zeros((2, 2)), np.eye(2), {}, 1.0, 1)
    rows = [make(law, 5, np.random.default_rng(4)) for make in (randomize_then_optimize, normal_draws)]
    np.testing.assert_array_equal(*rows)


@pytest.fixture
def hardly_known():
    """A law of twelve coefficients of very different size, five of them alike and four combinations known exactly."""
    rng = np.random.default_rng(5)
    size = np.geomspace(1e-5, 1e2, 12)
    root = np.hstack([rng.standard_normal((12, 8)), np.zeros((12, 4))])
    root[:5, :8] = np.eye(12)[:5, :8]
    covariance = (root @ root.T) * np.outer(size, size)
    return WindowFit(tanker(), np.zeros(12), covariance, np.zeros((12, 12)), np.eye(12), {}, 1.0, 5)


def drawn_by(root, fit):
    return np.random.default_rng(6).standard_normal((10, 12)) @ root(fit.covariance).T


def by_eigenvectors(covariance):
    values, vectors = np.linalg.eigh(covariance)
    return vectors * np.sqrt(np.maximum(values, 0.0))


class TestDrawsDoNotDependOn:
    """Changes that do not change the law."""

    @staticmethod
    def far(one, other, fit):
        """Largest difference of two sets of draws [sd]."""
        return np.max(np.abs(one - other) / np.sqrt(np.diag(fit.covariance)))

    def rounded(self, fit):
        noise = np.random.default_rng(7).standard_normal((12, 12))
        return replace(fit, from_windows=fit.from_windows * (1.0 + 1e-15 * (noise + noise.T)))

    def test_the_last_digit_of_the_covariance(self, hardly_known):
        one, other = (
            normal_draws(fit, 10, np.random.default_rng(6)) for fit in (hardly_known, self.rounded(hardly_known))
        )
        assert self.far(one, other, hardly_known) < 1e-6

    def test_which_eigenvectors_do(self, hardly_known):
        """Broken twin."""
        one, other = (drawn_by(by_eigenvectors, fit) for fit in (hardly_known, self.rounded(hardly_known)))
        assert self.far(one, other, hardly_known) > 1e-3

    def test_the_order_of_the_coefficients(self, hardly_known):
        order, fit = np.random.default_rng(8).permutation(12), hardly_known
        turned = replace(fit, from_windows=fit.from_windows[np.ix_(order, order)])
        numbers = np.random.default_rng(6).standard_normal((10, 12))
        one = normal_draws(fit, 10, SimpleNamespace(standard_normal=lambda shape: numbers))
        other = normal_draws(turned, 10, SimpleNamespace(standard_normal=lambda shape: numbers[:, order]))
        assert self.far(one[:, order], other, turned) < 1e-6

    def test_the_units(self, hardly_known):
        size = np.geomspace(1e3, 1e-4, 12)
        other = replace(hardly_known, from_windows=hardly_known.from_windows * np.outer(size, size))
        one, other = (normal_draws(fit, 10, np.random.default_rng(6)) for fit in (hardly_known, other))
        assert self.far(one, other / size, hardly_known) < 1e-6
