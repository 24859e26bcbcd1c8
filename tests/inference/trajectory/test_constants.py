"""Constants that every trial has its own of: currents, estimated with the coefficients that all trials share."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import pymc_ship as ps
from pymc_ship.inference.trajectory.posterior import log_likelihood_rows
from pymc_ship.inference.trajectory.prior import coefficient_prior
from pymc_ship.inference.trajectory.windows import HEADING, fit_windows, prepared_windows, thin_record, with_constants
from pymc_ship.physics.vessel.parts import FIXED_SD, with_parts
from pymc_ship.physics.vessel.vessel import coefficient_names, reference_coefficients
from pymc_ship.trial.record import OVER_GROUND
from tests.physics.forces.test_parts import AHEAD, tanker

CURRENTS = ((0.5, 60.0), (0.5, 200.0))
FREE = ("Nr", "gamma_R", "c_north", "c_east")


@pytest.fixture(scope="module")
def drifting():
    """A tanker of parts in a current, of which few parameters are unknown."""
    plain = tanker(AHEAD)
    vessel = with_parts(plain, (*AHEAD, "current"), {c.name: c for c in plain.parameters})
    known = [name for name in coefficient_names(vessel) if name not in FREE]
    return with_parts(vessel, vessel.parts, {c.name: c for c in vessel.parameters}, fixed=known)


def over_ground(current, seed):
    """A zigzag of the same tanker with speeds over ground and a little noise."""
    run = ps.simulate(tanker(AHEAD), ps.zigzag(20, 20), duration=500, step=0.5, method="rk4")
    speed, direction = current[0], np.deg2rad(current[1])
    ahead, side = (speed * f(direction - run["psi"]) for f in (np.cos, np.sin))
    run = run.assign(u=run["u"] + ahead, v=run["v"] + side).assign_attrs(speeds=OVER_GROUND)
    rng = np.random.default_rng(seed)
    sd = {"u": 0.01, "v": 0.01, "r": 2e-5, "psi": 1e-4}
    return run.assign({name: run[name] + sd[name] * rng.standard_normal(run["u"].size) for name in sd})


@pytest.fixture(scope="module")
def fitted(drifting):
    trials = [thin_record(over_ground(current, k), drifting) for k, current in enumerate(CURRENTS)]
    windows = [prepared_windows(trial, drifting, k) for k, trial in enumerate(trials)]
    prior = coefficient_prior(trials, drifting)
    start = reference_coefficients(drifting)
    start[coefficient_names(drifting).index("Nr")] *= 1.2
    return windows, fit_windows([w for run in windows for w in run], drifting, prior, start)


def test_the_current_of_each_trial_is_estimated(drifting, fitted):
    windows, fit = fitted
    U = drifting.particulars.nominal_speed
    for run, (speed, direction) in zip(windows, CURRENTS, strict=True):
        fitted_current = U * with_constants(run, fit)[-2:]
        truth = speed * np.array([np.cos(np.deg2rad(direction)), np.sin(np.deg2rad(direction))])
        np.testing.assert_allclose(fitted_current, truth, atol=0.1)


def test_coefficients_are_those_of_calm_water(drifting, fitted):
    _, fit = fitted
    names, sd = coefficient_names(drifting), np.sqrt(np.diag(fit.covariance))
    for name in ("Nr", "gamma_R"):
        k = names.index(name)
        truth = reference_coefficients(drifting)[k]
        assert abs(fit.coefficients[k] - truth) < 4.0 * sd[k] + 0.01 * abs(truth)


def test_forecasts_are_in_calm_water(drifting, fitted):
    """Constants of a trial are neither in the coefficients nor in their covariance."""
    _, fit = fitted
    np.testing.assert_array_equal(fit.coefficients[-2:], 0.0)
    np.testing.assert_allclose(fit.from_prior[-2:], 0.0)
    assert np.abs(fit.covariance[-2:]).max() < 1e-12


def test_without_the_current_the_coefficients_are_wrong(drifting, fitted):
    """Broken twin: the same records, taken as speeds through the water."""
    windows, fit = fitted
    plain = with_parts(drifting, AHEAD, {c.name: c for c in drifting.parameters[:-2]})
    trials = [thin_record(over_ground(current, k), plain) for k, current in enumerate(CURRENTS)]
    runs = [window for k, trial in enumerate(trials) for window in prepared_windows(trial, plain, k)]
    blind = fit_windows(runs, plain, coefficient_prior(trials, plain), reference_coefficients(plain))
    assert blind.channel_sd["v"] > 5.0 * fit.channel_sd["v"]
    assert FIXED_SD < 1e-6
    assert replace(fit).n_windows == blind.n_windows == sum(map(len, windows))


def test_the_heading_of_a_ship_in_wind_is_the_measured_one():
    """A record that begins on another heading, with the wind turned alike, leads to the same coefficients."""
    calm = tanker((*AHEAD, "wind"))
    free = ("C_X", "C_Y", "Nr")
    known = [name for name in coefficient_names(calm) if name not in free]
    vessel = with_parts(calm, calm.parts, {c.name: c for c in calm.parameters}, fixed=known)
    run = ps.simulate(vessel, ps.zigzag(20, 20), duration=500, step=0.5, method="rk4", wind=(12.0, 40.0))
    fits = []
    for turned in (0.0, 9.0):
        around = {"wind_speed": np.full(1000, 12.0), "wind_direction": np.full(1000, np.deg2rad(40.0) + turned)}
        trial = thin_record(
            run.assign(psi=run["psi"] + turned).assign({k: ("time", w) for k, w in around.items()}), vessel
        )
        prior, windows = coefficient_prior([trial], vessel), prepared_windows(trial, vessel)
        start, sd = (values[HEADING] for values in windows[1].run.initial_state)
        assert start == pytest.approx(float(trial["psi"].sel(time=windows[1].run.start)))
        assert sd == 0.01
        fits.append(fit_windows(windows, vessel, prior, reference_coefficients(vessel)))
    one, other = (fit.coefficients for fit in fits)
    np.testing.assert_allclose(other, one, rtol=1e-4, atol=1e-9)
    indices = [coefficient_names(vessel).index(name) for name in free]
    np.testing.assert_allclose(one[indices], reference_coefficients(vessel)[indices], rtol=0.02)


def test_the_likelihood_of_draws_uses_the_current_of_each_trial(fitted):
    mode = fitted[1].mode
    calm = mode.unknowns.copy()
    calm[mode.problem.n_coefficients : mode.problem.n_shared] = 0.0
    moving, still = log_likelihood_rows(mode, np.array([mode.unknowns, calm])).sum(axis=1)
    assert moving == pytest.approx(mode.point.log_likelihood, rel=1e-9)
    assert still < moving - 100.0
