"""Fisher information and its bounds: exact where known, additive, the sd of a fit without a prior."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import pymc_ship as ps
from pymc_ship.inference.identifiability.information import UNKNOWN, _without
from pymc_ship.inference.trajectory.fit import fit_trajectory, initial_problem, white_noise
from pymc_ship.inference.trajectory.prior import CoefficientPrior
from pymc_ship.inference.trajectory.runs import trajectory_run
from pymc_ship.inference.trajectory.scale_law import ScaleLaw
from pymc_ship.physics.motion.sensitivities import sensitivities
from pymc_ship.physics.vessel.vessel import coefficient_names, reference_coefficients
from pymc_ship.records.files.noise import noise_factors
from pymc_ship.trial.channels import default_channels
from tests.inference.identifiability.information import fisher_information, fitted_identifiability

STEP = 0.5


def coarse(vessel, manoeuvre, duration=100.0):
    return ps.simulate(vessel, manoeuvre, duration=duration, step=STEP, method="rk4")


def level_sd(trial, level, channels=None):
    """Noise of a level by channel."""
    return {
        name: level * noise_factors()[name] * float(np.abs(trial[name]).max())
        for name in channels or default_channels()
    }


@pytest.fixture(scope="module")
def circle(small):
    return coarse(small, ps.turning_circle(35.0))


def flat(vessel):
    typical = np.abs(reference_coefficients(vessel))
    free = np.full(typical.size, np.inf)
    return CoefficientPrior(0.0 * typical, free, typical, "flat")


def normal(vessel, scale):
    """Prior of zero mean with the scales given."""
    return replace(flat(vessel), scale=np.asarray(scale, dtype=float), kind="order_damped")


def plain_information(vessel, trial, sd, n_states=5):
    """Information of coefficients and initial state by the normal equations, straight from the sensitivities."""
    initial = np.append(trial["u"].values[0], np.zeros(n_states - 1))
    _, jacobian = sensitivities(vessel, trial["delta"].values, initial, interval=STEP, substeps=2)
    rows = [jacobian[("u", "v", "r", "p", "phi", "psi").index(name)] / value for name, value in sd.items()]
    return sum(row.T @ row for row in rows)


def test_the_initial_state_is_eliminated_by_the_schur_complement(small, zigzag, sd):
    whole, n = plain_information(small, zigzag, sd), 10
    idle = np.diag(whole) == 0.0
    assert idle[n:].sum() == 2
    excited = np.flatnonzero(~idle[n:]) + n
    cross = whole[:n, excited]
    expected = whole[:n, :n] - cross @ np.linalg.solve(whole[np.ix_(excited, excited)], cross.T)
    start = np.append(zigzag["u"].values[0], np.zeros(4))
    found = fisher_information(zigzag, small, noise_sd=sd, initial_states=[start])
    size = np.sqrt(np.diag(expected))
    np.testing.assert_allclose(found / np.outer(size, size), expected / np.outer(size, size), atol=1e-9)
    assert np.linalg.norm(found / np.outer(size, size) - whole[:n, :n] / np.outer(size, size)) > 1e-3


def test_without_nuisances_columns_are_left_as_they_are():
    columns = np.random.default_rng(1).standard_normal((50, 4))
    np.testing.assert_allclose(_without(columns, np.zeros((50, 3))), columns)
    projected = _without(columns, columns[:, :1])
    np.testing.assert_allclose(projected.T @ columns[:, :1], 0.0, atol=1e-12)


def test_runs_add(small, zigzag, circle, sd):
    one, other = (fisher_information(run, small, noise_sd=sd) for run in (zigzag, circle))
    both = fisher_information([zigzag, circle], small, noise_sd=sd)
    np.testing.assert_allclose(both, one + other, rtol=1e-8, atol=1e-12 * np.abs(both).max())
    bounds = [ps.identifiability(runs, small, noise_sd=sd)["bound"].values for runs in ([zigzag], [zigzag, zigzag])]
    np.testing.assert_allclose(bounds[0] / bounds[1], np.sqrt(2.0), rtol=1e-6)


def test_the_bound_is_proportional_to_the_noise(small, zigzag, sd):
    quiet, loud = (
        ps.identifiability(zigzag, small, noise_sd={name: factor * value for name, value in sd.items()})
        for factor in (1.0, 7.0)
    )
    np.testing.assert_allclose(loud["bound"] / quiet["bound"], 7.0, rtol=1e-6)
    np.testing.assert_allclose(loud.attrs["condition_number"], quiet.attrs["condition_number"], rtol=1e-6)


def test_the_bound_is_the_sd_of_a_fit_without_a_prior(small, zigzag, sd):
    run = trajectory_run(zigzag, small, noise_sd={name: 0.01 * value for name, value in sd.items()})
    problem = initial_problem([run], small, flat(small))
    fit = fit_trajectory(problem, np.concatenate([reference_coefficients(small), run.initial_state[0]]))
    found = fitted_identifiability(fit)
    np.testing.assert_allclose(found["bound"], fit.sd, rtol=1e-4)
    np.testing.assert_allclose(ps.identifiability(run, small)["bound"], fit.sd, rtol=1e-2)
    wrong = replace(problem, noise=(replace(problem.noise[0], sd=2.0 * problem.noise[0].sd),))
    assert np.all(fitted_identifiability(replace(fit, problem=wrong))["bound"].values > 1.9 * fit.sd)


def test_the_bound_of_van_trees_is_the_sd_of_a_fit_with_the_scales_of_its_prior(small, zigzag, sd):
    law = ScaleLaw(np.ones((10, 1)), np.zeros(1), ("tau",))
    prior = replace(normal(small, np.abs(reference_coefficients(small))), law=law)
    run = trajectory_run(zigzag, small, noise_sd={name: 10.0 * value for name, value in sd.items()})
    start = np.concatenate([reference_coefficients(small), run.initial_state[0]])
    fit = fit_trajectory(initial_problem([run], small, prior), start)
    found = fitted_identifiability(fit)
    assert np.abs(fit.problem.scales.eta[0]) > 0.05
    np.testing.assert_allclose(found["bayesian_bound"], fit.sd, rtol=0.01)
    assert np.max(np.abs(ps.identifiability(run, small, prior)["bayesian_bound"].values / fit.sd - 1.0)) > 0.05


def test_contraction_and_unknown_directions_with_a_prior(small, zigzag, sd):
    bound = ps.identifiability(zigzag, small, noise_sd=sd)["bound"].values
    vague, sharp = (
        ps.identifiability(zigzag, small, normal(small, factor * bound), noise_sd=sd) for factor in (1e4, 1e-4)
    )
    assert vague.attrs["n_determined"] == 10
    assert sharp.attrs["n_determined"] == 0
    np.testing.assert_allclose(vague["bayesian_bound"], bound, rtol=1e-6)
    np.testing.assert_allclose(vague["contraction"], 1.0, atol=1e-6)
    np.testing.assert_allclose(sharp["contraction"], 0.0, atol=1e-3)
    np.testing.assert_allclose(sharp["weight"].values @ sharp["weight"].values.T, np.eye(10), atol=1e-9)
    between = ps.identifiability(zigzag, small, normal(small, bound), noise_sd=sd)
    ratio = between["variance_ratio"].values
    assert 0 < ratio.size < 10
    assert np.all(ratio > UNKNOWN)
    assert np.all(np.diff(ratio) <= 0.0)
    F = fisher_information(zigzag, small, noise_sd=sd)
    w = between["weight"].values * bound
    np.testing.assert_allclose(1.0 / (1.0 + np.sum(w @ F * w, axis=1)), ratio, rtol=1e-6)


def test_a_partly_flat_prior_counts_what_the_free_coefficients_leave(small, zigzag, sd):
    bound = ps.identifiability(zigzag, small, noise_sd=sd)["bound"].values
    scale = np.where(np.arange(10) < 4, np.inf, 1e4 * bound)
    assert ps.identifiability(zigzag, small, normal(small, scale), noise_sd=sd).attrs["n_determined"] == 10
    found = ps.identifiability(zigzag, small, normal(small, np.where(scale < np.inf, 1e-4 * bound, scale)), noise_sd=sd)
    assert found.attrs["n_determined"] == 4
    assert np.all(found["weight"].values[:, :4] == 0.0)


def test_what_no_sensor_sees_has_no_bound(small):
    """Straight ahead nothing but the resistance acts; the other coefficients and their directions stay unknown."""
    start = coarse(small, ps.rudder_programme([0.0], [0.0], approach_speed=8.0), duration=60.0)
    sd = {"u": 0.01, "v": 0.01, "r": 1e-4}
    found = ps.identifiability(start, small, noise_sd=sd)
    excited = np.isin(coefficient_names(small), ("Xu", "Xuu"))
    assert np.isfinite(found["bound"].values[excited]).all()
    assert np.isinf(found["bound"].values[~excited]).all()
    assert np.isinf(found.attrs["condition_number"])
    assert found.attrs["n_determined"] == 2
    np.testing.assert_allclose(found["variance_ratio"], 1.0)
    typical = np.abs(reference_coefficients(small))
    known = ps.identifiability(start, small, normal(small, typical), noise_sd=sd)
    np.testing.assert_allclose(known["bayesian_bound"].values[~excited], typical[~excited])
    np.testing.assert_allclose(known["contraction"].values[~excited], 0.0, atol=1e-12)


def test_offsets_and_correlated_noise_cost_accuracy(small, zigzag, sd):
    run = trajectory_run(zigzag, small, noise_sd=sd)
    white = white_noise(run)
    slow = replace(white, correlation=np.full(3, 0.9))
    bound, offset, correlated = (
        ps.identifiability(run, small, noise=[noise])["bound"].values
        for noise in (white, replace(white, offsets=True), slow)
    )
    assert np.all(offset >= bound * (1.0 - 1e-9))
    assert np.max(offset / bound) > 1.2
    assert np.median(correlated / bound) > 1.5


def test_the_zigzag_of_the_paper_at_one_percent(container, zigzag_trial):
    """A quarter of the coefficient's size at the median, and a noise 28 times lower for one percent."""
    trial = zigzag_trial.isel(time=slice(None, None, 5))
    sd = {name: value / np.sqrt(5.0) for name, value in level_sd(zigzag_trial, 0.01).items()}
    relative = ps.identifiability(trial, container, noise_sd=sd)["relative_bound"].values
    assert np.isfinite(relative).sum() == 93
    assert np.isnan(relative).sum() == 9
    assert 24.0 < np.nanmedian(relative) < 29.0
    assert 37 <= (relative < 20.0).sum() <= 45
