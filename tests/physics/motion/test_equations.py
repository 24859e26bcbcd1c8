from __future__ import annotations

import math

import numpy as np
import pytest
from numba import njit

import pymc_ship as ps
from pymc_ship.physics.forces.programs import sin_cos
from pymc_ship.physics.motion.equations import STATE, scheme, state_derivative, workspace
from pymc_ship.physics.motion.inputs import completed_inputs
from pymc_ship.physics.motion.prime_record import prime_record
from pymc_ship.physics.vessel.vessel import reference_coefficients
from tests.physics.motion import plain_hull


def rate(vessel, state, delta):
    """Time derivative of many states at once, shape (8, n)."""
    state = np.ascontiguousarray(state, dtype=float)
    n = state.shape[1]
    coefficients = np.repeat(reference_coefficients(vessel)[:, None], n, axis=1)
    equations, out = scheme(vessel), np.empty_like(state)
    state_derivative(state, completed_inputs(delta), coefficients, equations, workspace(n, equations), out)
    return out


@pytest.fixture(scope="module")
def motions():
    """Random states and rudder angles over the range of hard manoeuvres."""
    rng = np.random.default_rng(2)
    size = np.array([2.0, 2.0, 0.02, 0.05, 0.4, 4.0, 500.0, 500.0])
    state = rng.uniform(-1.0, 1.0, (200, 8)) * size + [9.0, 0, 0, 0, 0, 0, 0, 0]
    return np.ascontiguousarray(state.T), rng.uniform(-0.6, 0.6, 200)


@njit
def _sin_cos_of_each(angles, sine, cosine):
    for k in range(angles.size):
        sine[k], cosine[k] = sin_cos(angles[k])


@pytest.mark.parametrize("reach", [1.0, 10.0, 1e3, 1e6])
def test_sine_and_cosine_are_good_to_two_ulp(reach):
    """Over a range of angles and at their hardest: the floats nearest to multiples of 90 deg."""
    near_zeros = np.pi / 2.0 * np.unique(np.round(np.linspace(-reach, reach, 5001)))
    angles = np.concatenate([np.random.default_rng(3).uniform(-reach, reach, 50_000), near_zeros])
    computed = np.empty((2, angles.size))
    _sin_cos_of_each(angles, *computed)
    exact = np.array([[math.sin(a) for a in angles], [math.cos(a) for a in angles]])
    assert np.max(np.abs(computed - exact) / np.spacing(np.abs(exact))) <= 2.0


def test_sine_and_cosine_of_what_is_not_finite():
    computed = np.empty((2, 3))
    _sin_cos_of_each(np.array([np.nan, np.inf, -np.inf]), *computed)
    assert np.isnan(computed).all()


def test_accelerations_and_kinematics_are_those_of_the_plain_equations(container, motions):
    state, delta = motions
    expected = np.array([plain_hull.rate(row, d) for row, d in zip(state.T, delta, strict=True)]).T
    scale = np.abs(expected).max(axis=1, keepdims=True)
    np.testing.assert_allclose(rate(container, state, delta) / scale, expected / scale, atol=1e-13)


def test_the_equations_close_along_a_run(container, zigzag_trial):
    """J nu_dot' equals hydrodynamic and known forces, with the accelerations that the run itself shows."""
    run = zigzag_trial.isel(time=slice(0, 19_999, 97))
    after = zigzag_trial.isel(time=slice(1, 20_000, 97))
    motion = [run[name].values for name in ("u", "v", "r", "p", "phi", "delta")]
    U, L = np.hypot(run.u, run.v).values, container.particulars.L
    accelerations = np.array([(after[name].values - run[name].values) / 0.02 for name in "uvrp"])
    prime = accelerations * np.array([L / U**2, L / U**2, L**2 / U**2, L**2 / U**2])
    force = np.array([plain_hull.force(*instant) for instant in zip(*motion, strict=True)]).T
    scale = np.abs(force).max(axis=1, keepdims=True)
    np.testing.assert_allclose((plain_hull.J @ prime) / scale, force / scale, atol=1e-9)


def test_the_track_turns_with_the_heading_and_the_motion_does_not(container, motions):
    state, delta = motions
    turned = state.copy()
    turned[5] += 0.7
    before, after = rate(container, state, delta), rate(container, turned, delta)
    np.testing.assert_array_equal(before[:6], after[:6])
    c, s = np.cos(0.7), np.sin(0.7)
    np.testing.assert_allclose(after[6:], np.array([[c, -s], [s, c]]) @ before[6:], atol=1e-13)


def test_the_place_does_not_matter(container, motions):
    state, delta = motions
    moved = state.copy()
    moved[6:] += 1e4
    np.testing.assert_array_equal(rate(container, state, delta), rate(container, moved, delta))


def test_the_track_runs_at_the_horizontal_part_of_the_speed(container, motions):
    state, delta = motions
    u, v, phi = state[0], state[1], state[4]
    x_dot, y_dot = rate(container, state, delta)[6:]
    np.testing.assert_allclose(np.hypot(x_dot, y_dot), np.hypot(u, v * np.cos(phi)), rtol=1e-14)


def test_a_ship_at_rest_in_roll_rights_herself(container):
    """Heeled to starboard and not moving sideways, the known moment rolls the ship back to port, odd in the heel."""
    heel = np.array([-0.3, -0.1, 0.0, 0.1, 0.3])
    still = dict.fromkeys(("v", "r", "p", "delta"), np.zeros(5)) | {"u": np.full(5, 12.7), "phi": heel}
    moment = prime_record(container, still)[2][3]
    assert (np.diff(moment) < 0.0).all()
    np.testing.assert_allclose(moment, -moment[::-1], atol=1e-20)
    expected = 2.0 * 9.81 * 46070.0 * (0.83 + 4.5 * np.tan(0.3) ** 2) * np.sin(0.3) / (12.7**2 * 230.66**3)
    assert moment[0] == pytest.approx(expected, rel=1e-13)


def test_states_are_named_in_order():
    assert STATE == ("u", "v", "r", "p", "phi", "psi", "x", "y")


def test_the_scheme_of_a_vessel_is_made_once():
    vessel = ps.load_vessel("container")
    assert scheme(vessel) is scheme(vessel)
    double = vessel.with_coefficients({"sway": 2.0 * vessel.coefficients("sway").values})
    assert scheme(double) is not scheme(vessel)
