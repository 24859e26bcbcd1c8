"""Forces in captive tests: equal to those of the simulator, with exact derivatives."""

import numpy as np
import pytest

import pymc_ship as ps
from pymc_ship.physics.motion.captive import captive_test_derivatives, captive_test_forces
from pymc_ship.physics.vessel.vessel import coefficient_names, reference_coefficients

VESSELS = {"terms": "own terms", "parts": "modular", "cross flow": "modular at any speed"}
U = 7.5


def vessel_of(kind):
    return ps.with_terms(ps.load_vessel("kvlcc2"), VESSELS[kind])


def motion(**changes):
    base = {"u": [U, 6.0], "v": [0.4, -0.8], "r": [0.002, -0.004], "delta": [0.1, -0.3]}
    return {name: np.array(values, dtype=float) for name, values in (base | changes).items()}


@pytest.mark.parametrize("kind", VESSELS)
def test_slopes_are_differences_of_forces(kind):
    vessel = vessel_of(kind)
    at = reference_coefficients(vessel)
    forces, slopes = captive_test_derivatives(vessel, motion(), at)
    steps = 1e-6 * np.maximum(np.abs(at), 1e-4)
    up, down = (captive_test_forces(vessel, motion(), at + sign * np.diag(steps)) for sign in (1.0, -1.0))
    np.testing.assert_allclose(captive_test_forces(vessel, motion(), at[None])[0], forces, rtol=1e-12)
    differences = np.moveaxis((up - down) / (2.0 * steps[:, None, None]), 0, -1)
    np.testing.assert_allclose(slopes, differences, rtol=2e-5, atol=1e-6 * np.abs(slopes).max())


@pytest.mark.parametrize("kind", VESSELS)
def test_a_ship_on_a_straight_course_is_slowed_by_the_force_on_the_held_one(kind):
    vessel = vessel_of(kind)
    at, s = reference_coefficients(vessel), vessel.particulars
    still = {"u": np.array([U]), "v": np.zeros(1), "r": np.zeros(1), "delta": np.zeros(1)}
    if vessel.modular:  # revolutions of the simulation hold the approach speed
        still["n"] = np.array([U / s.nominal_speed])
    X = captive_test_forces(vessel, still, at[None])[0, 0, 0]
    ahead = ps.rudder_programme([0.0], [0.0], approach_speed=U)
    first = ps.simulate(vessel, ahead, duration=0.2, step=0.01)
    slowed = (first["u"].values[1] - first["u"].values[0]) / 0.01
    names = coefficient_names(vessel)
    m_x = at[names.index("m_x")] if "m_x" in names else -vessel.added_mass["Xudot"]
    assert slowed == pytest.approx(X * U**2 / s.L / (vessel.m + m_x), rel=1e-3, abs=1e-9)


def test_more_revolutions_push_more():
    vessel = vessel_of("parts")
    at = reference_coefficients(vessel)[None]
    slow, fast = (captive_test_forces(vessel, motion(n=[n, n]), at)[0, 0] for n in (1.0, 1.2))
    assert (fast > slow + 1e-4).all()
