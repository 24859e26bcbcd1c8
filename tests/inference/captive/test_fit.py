"""What captive tests say of the coefficients: beside the prior, and of the ship under way."""

from dataclasses import replace

import numpy as np
import pytest
import xarray as xr

import pymc_ship as ps
from pymc_ship.inference.captive.fit import (
    CaptiveFit,
    _mode,
    captive_motion,
    fit_captive,
    nominal_revolution_tests,
    with_discrepancy,
)
from pymc_ship.inference.trajectory.prior import CoefficientPrior, GaussianLikelihood, wide_prior
from pymc_ship.physics.motion.captive import captive_test_derivatives, captive_test_forces
from pymc_ship.physics.vessel.parts import FIXED_SD
from pymc_ship.physics.vessel.vessel import coefficient_names, reference_coefficients
from tests.sentences import refused

NOISE = {"X": 2e-5, "Y": 1e-4, "N": 4e-5}
PARTS = "modular"


def program(vessel, rng, at):
    """Tests of a ship with these coefficients: drift, yaw and rudder, with noise."""
    rows = [(b, 0.0, 0.0) for b in np.linspace(-20, 20, 9)] + [(0.0, r, 0.0) for r in np.linspace(-0.5, 0.5, 8)]
    rows += [(b, 0.0, d) for b in (-8.0, 0.0, 8.0) for d in np.linspace(-30, 30, 8)]
    beta, r, delta = np.array(rows).T
    U = vessel.particulars.nominal_speed
    motion = {"u": U * np.cos(np.deg2rad(beta)), "v": -U * np.sin(np.deg2rad(beta))}
    motion |= {"r": r * U / vessel.particulars.L, "delta": np.deg2rad(delta)}
    forces = captive_test_forces(vessel, motion, at[None])[0]
    measured = {name: forces[k] + NOISE[name] * rng.standard_normal(beta.size) for k, name in enumerate("XYN")}
    return xr.Dataset({name: ("test", values) for name, values in (motion | measured).items()})


@pytest.fixture(scope="module")
def tanker():
    vessel = ps.with_terms(ps.load_vessel("kvlcc2"), PARTS)
    return vessel, wide_prior([], vessel)


def test_tests_that_are_not_finite_are_refused(tanker):
    vessel, prior = tanker
    tests = program(vessel, np.random.default_rng(1), prior.mean)
    tests["Y"][3] = np.nan
    with refused(ps.TrialError, "Y"):
        fit_captive(tests, vessel, prior)


@pytest.mark.parametrize(("force", "factor"), [("Y", 10.0), ("Y", -1.0), ("N", -1.0)])
def test_a_test_that_the_others_contradict_is_named(tanker, force, factor):
    """Not in the clean table."""
    vessel, prior = tanker
    tests = program(vessel, np.random.default_rng(1), prior.mean)
    assert fit_captive(tests, vessel, prior).remarks == ()
    tests[force][2] *= factor
    (remark,) = fit_captive(tests, vessel, prior).remarks
    assert "at beta = -10 deg, r' = 0 and delta = 0 deg" in remark
    assert f"{force}' is {float(tests[force][2]):.3g}" in remark


def test_a_force_that_no_test_fits_is_no_odd_test(tanker):
    vessel, prior = tanker
    rng = np.random.default_rng(1)
    tests = program(vessel, rng, prior.mean)
    tests["Y"] += 0.3 * float(np.abs(tests["Y"]).max()) * (rng.random(tests.sizes["test"]) < 0.3)
    assert fit_captive(tests, vessel, prior).remarks == ()


def test_a_fit_finds_ships_of_the_prior_with_the_scatter_it_states(tanker):
    vessel, prior = tanker
    z = []
    for seed in range(6):
        rng = np.random.default_rng(seed)
        truth = prior.mean + 0.5 * prior.scale * np.clip(rng.standard_normal(prior.mean.size), -1.5, 1.5)
        half = CoefficientPrior(prior.mean, 0.5 * prior.scale, prior.unit, prior.kind)
        fit = fit_captive(program(vessel, rng, truth), vessel, half)
        sd = np.sqrt(np.diag(fit.covariance))
        known = sd < 0.5 * half.scale
        z.append(((fit.coefficients - truth) / sd)[known])
        assert known.sum() > 12
    z = np.concatenate(z)
    assert np.mean(np.abs(z) < 1.96) > 0.85
    assert np.mean(np.abs(3.0 * z) < 1.96) < 0.7  # broken twin: sd a third as large


def test_beside_the_prior_the_likelihood_is_the_fit(tanker):
    vessel, prior = tanker
    fit = fit_captive(program(vessel, np.random.default_rng(1), prior.mean), vessel, prior)
    rows, values = fit.likelihood
    precision = np.diag(prior.scale**-2) + rows.T @ rows
    at = prior.mean + np.linalg.solve(precision, rows.T @ (values - rows @ prior.mean))
    sd = np.sqrt(np.diag(fit.covariance))
    assert np.max(np.abs(at - fit.coefficients) / sd) < 0.1
    np.testing.assert_allclose(np.linalg.inv(precision), fit.covariance, rtol=1e-5, atol=1e-18)


def test_terms_take_the_tests_at_nominal_revolutions_alone():
    vessel = ps.load_vessel("kvlcc2")
    tests = xr.Dataset({"n": ("test", vessel.propeller.n * np.array([1.0, 0.97, 0.8]))})
    assert nominal_revolution_tests(tests, vessel).sizes["test"] == 2
    assert nominal_revolution_tests(tests, ps.with_terms(vessel, PARTS)).sizes["test"] == 3


def test_motion_takes_revolutions_where_parts_do(tanker):
    zeros = dict.fromkeys(("u", "v", "r", "delta"), ("test", np.zeros(1)))
    tests = xr.Dataset(zeros | {"n": ("test", np.array([1.513]))})
    assert captive_motion(tests, tanker[0])["n"] == pytest.approx(1.0)
    assert "n" not in captive_motion(tests, ps.load_vessel("kvlcc2"))


class TestSharedWithTrials:
    prior = CoefficientPrior(np.zeros(4), np.ones(4), np.ones(4), "stated")
    covariance = 1e-4 * np.eye(4)

    def shared(self, discrepancy_scale):
        likelihood = GaussianLikelihood(100.0 * np.eye(4), 100.0 * discrepancy_scale * np.array([1.0, -1.0, 1.0, -1.0]))
        fit = CaptiveFit(np.zeros(4), self.covariance, likelihood, {}, 1.0)
        found = with_discrepancy(fit, self.prior, np.zeros(4), self.covariance)
        return found.likelihood, found.discrepancy_scale

    def test_where_both_agree_the_tests_count_in_full(self):
        likelihood, share = self.shared(0.01)
        assert share == 0.0
        np.testing.assert_array_equal(likelihood.design, 100.0 * np.eye(4))

    def test_where_they_do_not_the_share_is_their_distance(self):
        likelihood, share = self.shared(0.5)
        assert share == pytest.approx(0.5, abs=0.02)
        assert np.linalg.inv(likelihood.design.T @ likelihood.design)[0, 0] == pytest.approx(share**2 + 1e-4)
        np.testing.assert_allclose(np.linalg.solve(likelihood.design, likelihood.response), [0.5, -0.5, 0.5, -0.5])


def test_slopes_and_likelihood_are_of_the_same_coefficients(tanker):
    vessel, prior = tanker
    tests = program(vessel, np.random.default_rng(2), prior.mean)
    _, slopes = captive_test_derivatives(vessel, captive_motion(tests, vessel), prior.mean)
    blind = np.all(slopes == 0.0, axis=(0, 1))
    fit = fit_captive(tests, vessel, prior)
    np.testing.assert_allclose(fit.likelihood.design[:, blind], 0.0, atol=1e-12)
    assert reference_coefficients(vessel).size == fit.likelihood.design.shape[1]


def test_revolutions_of_the_carriage_are_its_own(tanker):
    """Tests at revolutions that are off by 6 %: the ship's own nominal ones stay, and so does its resistance."""
    vessel, prior = tanker
    column = coefficient_names(vessel).index("n_0")
    held = replace(prior, scale=np.where(np.arange(prior.scale.size) == column, FIXED_SD, prior.scale))
    tests = program(vessel, np.random.default_rng(5), prior.mean)
    n = vessel.propeller.n * np.ones(tests.sizes["test"])
    right, off = (fit_captive(tests.assign(n=("test", n * share)), vessel, held) for share in (1.0, 1.06))
    sd = np.sqrt(right.covariance[column, column])
    assert off.revolutions / right.revolutions == pytest.approx(1.06, abs=4.0 * sd)
    rows, values = off.likelihood
    precision = np.diag(held.scale**-2) + rows.T @ rows
    at = held.mean + np.linalg.solve(precision, rows.T @ (values - rows @ held.mean))
    own = coefficient_names(vessel).index("R0")
    assert abs(at[own] - prior.mean[own]) < 3.0 * np.sqrt(right.covariance[own, own])
    assert at[column] == pytest.approx(1.0, abs=1e-6)
    blind = fit_captive(tests.assign(n=("test", n * 1.06)), vessel, replace(held, scale=held.scale)).coefficients
    assert abs(blind[column] - 1.0) > 0.04  # what would have gone into the resistance


def test_tests_count_by_the_force_that_their_sensor_measured():
    """At half the speed the same prime force is a quarter of the force in N, and so is what a row of Yv counts."""
    vessel = ps.load_vessel("container")
    full = program(vessel, np.random.default_rng(7), reference_coefficients(vessel))
    slow = full.assign({name: 0.5 * full[name] for name in ("u", "v", "r")})
    tests = xr.concat([full, slow], "test")
    scale = np.maximum(0.1 * np.abs(reference_coefficients(vessel)), 1e-6)
    _, _, design, _ = _mode(tests, vessel, CoefficientPrior(reference_coefficients(vessel), scale, scale, "own"))
    rows = design.reshape(3, 2, -1, design.shape[1])[..., coefficient_names(vessel).index("Yv")][1]
    np.testing.assert_allclose(rows[1], 0.25 * rows[0], atol=1e-12 * np.abs(rows).max())
    assert np.abs(rows[0]).max() > 0.0
