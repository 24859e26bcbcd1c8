from __future__ import annotations

import sys
from dataclasses import replace

import numpy as np
import pytest

import pymc_ship as ps
from pymc_ship.physics.forces.propeller import Propeller
from pymc_ship.physics.motion.equations import STATE
from pymc_ship.physics.motion.replay import replay
from pymc_ship.physics.motion.sensitivities import sensitivities
from pymc_ship.physics.vessel.vessel import reference_coefficients

SETTINGS = {"interval": 0.5, "substeps": 2, "block": 5}
START = np.array([12.0, -0.3, 0.004, 0.002, 0.03, 0.2, 50.0, -20.0])
DELTA = -0.2 - 0.1 * np.sin(0.11 * np.arange(100))
"""A turn to starboard, in which v and r keep their signs: |v| and |r| have kinks that no difference gets across."""
_DISTANCES, _WEIGHTS = np.arange(1.0, 5.0), np.array([4 / 5, -1 / 5, 4 / 105, -1 / 280])
"""The central difference of order eight."""


@pytest.fixture(scope="module")
def upright(container):
    """The container ship without roll: surge, sway and yaw, only terms without p and phi."""
    forces = {
        dof: tuple(c for c in container.forces[dof] if "phi" not in c.term and "p" not in c.term)
        for dof in ("surge", "sway", "yaw")
    }
    return replace(container, forces=forces)


@pytest.fixture(scope="module")
def propelled(upright):
    """The same with a propeller, on which thrust, rudder and some hull forces depend."""
    screw = Propeller(D=7.0, n=1.8, wake_fraction=0.3, k_0=0.5, k_1=-0.35, k_2=-0.1, eta=0.8, kappa=0.5)
    names = {"Xu": "XT", "Xdeltadelta": "Xgsinsin", "Yv": "Ygv", "Ydelta": "Ygsincos", "Ndelta": "Ngsincos"}
    forces = {
        dof: tuple(
            replace(c, name=names.get(c.name, c.name), value=abs(c.value) if c.name == "Xu" else c.value) for c in row
        )
        for dof, row in upright.forces.items()
    }
    return replace(upright, forces=forces, propeller=screw)


@pytest.fixture(params=["container", "upright", "propelled"])
def ship(request):
    return request.getfixturevalue(request.param)


def start_of(vessel, n_states):
    """The first states of a moving ship; one without roll neither rolls nor heels."""
    start = START[:n_states].copy()
    if "roll" not in vessel.dofs:
        start[3:5] = 0.0
    return start


def largest_error(column, derivatives, vessel, start, method):
    """Largest error of a column against central differences of the replayed motion, relative for each state.

    What rounding of the motion can make of the differences is no error.
    """
    point = np.concatenate([reference_coefficients(vessel), start])
    width = max(1e-3 * abs(point[column]), 2e-5)
    shifts, weights = width * np.append(_DISTANCES, -_DISTANCES), np.append(_WEIGHTS, -_WEIGHTS) / width
    points = np.tile(point, (len(shifts), 1))
    points[:, column] += shifts
    n = point.size - start.size
    motion = replay(vessel, DELTA, points[:, n:], points[:, :n], method=method, **SETTINGS)
    expected = np.einsum("ijk,j->ik", motion, weights)
    rounding = 1e-14 * np.abs(motion).max(axis=(1, 2)) / width
    error = np.abs(derivatives - expected).max(axis=1) - rounding
    return (error / np.maximum(np.abs(expected).max(axis=1), 1e-12)).max()


def errors_of(jacobian, vessel, start, method):
    """Errors of every eleventh coefficient's column and of all initial states'."""
    n = reference_coefficients(vessel).size
    columns = [*range(0, n, 11), *range(n, n + start.size)]
    return [largest_error(column, jacobian[:, :, column], vessel, start, method) for column in columns]


class TestDerivatives:
    @pytest.mark.parametrize("n_states", [5, 6, 8])
    @pytest.mark.parametrize("method", ["euler", "rk4"])
    def test_they_are_those_of_the_replayed_motion(self, ship, method, n_states):
        start = start_of(ship, n_states)
        _, jacobian = sensitivities(ship, DELTA, start, method=method, **SETTINGS)
        assert jacobian.shape == (n_states, 20, reference_coefficients(ship).size + n_states)
        assert max(errors_of(jacobian, ship, start, method)) < 1e-6

    def test_those_of_one_integrator_are_not_those_of_the_other(self, container):
        """The check above can fail: here the equations are right and only the integrator is not the motion's."""
        _, jacobian = sensitivities(container, DELTA, START, method="euler", **SETTINGS)
        assert max(errors_of(jacobian, container, START, "rk4")) > 1e-3

    def test_a_slight_error_of_any_one_column_shows(self, container):
        _, jacobian = sensitivities(container, DELTA, START, method="rk4", **SETTINGS)
        assert min(errors_of(jacobian * (1.0 + 1e-5), container, START, "rk4")) > 5e-6

    def test_a_tangent_of_the_wrong_sign_shows(self, container, monkeypatch):
        """The kernels as plain Python: as they are, then with the slope of the known forces turned round."""
        module, user = (sys.modules[f"pymc_ship.physics.motion.{room}"] for room in ("linearisation", "sensitivities"))
        monkeypatch.setattr(sys.modules[__name__], "DELTA", DELTA[:6])
        for room in (module, user):
            for name, kernel in vars(room).copy().items():
                if hasattr(kernel, "py_func") and kernel.__module__ in (module.__name__, user.__name__):
                    monkeypatch.setattr(room, name, kernel.py_func)
        known_force_tangents = module._known_force_tangents

        def reversed_tangents(*arguments):
            known_force_tangents(*arguments)
            arguments[-1].force[:] *= -1.0

        _, right = sensitivities(container, DELTA, START[:5], method="euler", **SETTINGS)
        monkeypatch.setattr(module, "_known_force_tangents", reversed_tangents)
        _, wrong = sensitivities(container, DELTA, START[:5], method="euler", **SETTINGS)
        assert max(errors_of(right, container, START[:5], "euler")) < 1e-6
        assert max(errors_of(wrong, container, START[:5], "euler")) > 0.1

    def test_other_coefficients_than_the_reference(self, container):
        """Small steps in a random direction move the ship by the derivatives, with an error of second order."""
        rng = np.random.default_rng(6)
        theta = reference_coefficients(container) * (1.0 + 0.05 * rng.standard_normal(102))
        step = np.concatenate([0.1 * theta * rng.standard_normal(102), 0.01 * rng.standard_normal(8)])
        motion, jacobian = sensitivities(container, DELTA, START, theta, **SETTINGS)
        errors = []
        for size in (1e-3, 1e-4):
            moved = replay(container, DELTA, START + size * step[102:], theta + size * step[:102], **SETTINGS)[:, 0]
            errors.append(np.abs(moved - motion - size * jacobian @ step).max(axis=1) / np.ptp(motion, axis=1))
        np.testing.assert_allclose(np.log10(errors[0] / errors[1]), 2.0, atol=0.1)

    def test_the_place_moves_with_its_initial_value_and_nothing_else_does(self, container):
        jacobian = sensitivities(container, DELTA, START, **SETTINGS)[1]
        np.testing.assert_allclose(jacobian[6:, :, -2:], np.broadcast_to(np.eye(2)[:, None], (2, 20, 2)), rtol=1e-14)
        assert (jacobian[:6, :, -2:] == 0.0).all()
        assert (jacobian[:5, :, -3] == 0.0).all()

    def test_fewer_states_have_the_same_derivatives(self, container):
        whole = sensitivities(container, DELTA, START, **SETTINGS)
        part = sensitivities(container, DELTA, START[:5], **SETTINGS)
        np.testing.assert_allclose(part[0], whole[0][:5], rtol=1e-13)
        np.testing.assert_allclose(part[1], whole[1][:5, :, :107], rtol=1e-12, atol=1e-12)


class TestMotion:
    @pytest.mark.parametrize(("method", "step"), [("euler", 0.02), ("rk4", 0.1)])
    def test_it_is_the_simulated_one(self, container, method, step):
        """Along a rudder record that is linear between the samples."""
        programme = ps.rudder_programme([0.0, 20.0, 45.0, 60.0], [0.0, 0.4, -0.3, 0.1], rate_limited=False)
        manoeuvre = ps.zigzag(20.0, 20.0) if method == "euler" else programme
        run = ps.simulate(container, manoeuvre, duration=100.0, step=step, method=method)
        recorded = np.array([run[name].values for name in STATE])
        motion, _ = sensitivities(container, run["delta"].values, recorded[:, 0], interval=step, method=method)
        scale = np.abs(recorded).max(axis=1, keepdims=True)
        np.testing.assert_allclose(motion / scale, recorded / scale, atol=1e-12)

    def test_blocks_are_means(self, ship):
        start = start_of(ship, 8)
        fine = sensitivities(ship, DELTA, start, interval=0.2)
        coarse = sensitivities(ship, DELTA, start, interval=0.2, block=7)
        for whole, mean in zip(fine, coarse, strict=True):
            expected = whole[:, :98].reshape(8, 14, 7, *whole.shape[2:]).mean(axis=2)
            np.testing.assert_allclose(mean, expected, rtol=1e-12, atol=1e-12)

    def test_samples_follow_substeps(self, container):
        """Two steps an interval are the steps of a record with twice the samples."""
        coarse = sensitivities(container, DELTA, START, interval=0.4, substeps=2)
        middle = np.interp(np.arange(199) / 2.0, np.arange(100), DELTA)
        fine = sensitivities(container, middle, START, interval=0.2)
        for a, b in zip(coarse, fine, strict=True):
            np.testing.assert_allclose(a, b[:, ::2], rtol=1e-11, atol=1e-11)

    @pytest.mark.parametrize("start", [[12.7, 0.0, 0.0, 0.0, 1.6], [0.1, 0.0, 0.0, 0.0, 0.0], [np.nan, 0, 0, 0, 0]])
    def test_a_ship_that_leaves_the_range_of_the_model_is_nan(self, container, start):
        motion, jacobian = sensitivities(container, DELTA, start, **SETTINGS)
        assert np.isnan(motion).all()
        assert np.isnan(jacobian).all()

    def test_a_ship_that_diverges_under_way_is_nan(self, container):
        unstable = -reference_coefficients(container)
        motion, jacobian = sensitivities(container, DELTA, START, unstable, interval=2.0)
        assert np.isnan(motion).all()
        assert np.isnan(jacobian).all()
