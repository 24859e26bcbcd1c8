from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

import pymc_ship as ps
from pymc_ship.forces.propeller import Propeller, loading

SCREW = Propeller(D=9.326, n=1.513, wake_fraction=0.4, k_0=0.335, k_1=-0.27, k_2=-0.05, eta=0.59, kappa=0.5)
NOMINAL = 7.974


def inflow_and_thrust(U):
    """u_R^2 over (1-w)^2 and thrust over rho D^4 n^2, both over U^2, as Yasukawa & Yoshimura (2015) write them."""
    J = (1.0 - SCREW.wake_fraction) * U / (SCREW.n * SCREW.D)
    K_T = SCREW.k_0 + SCREW.k_1 * J + SCREW.k_2 * J**2
    jet = 1.0 + SCREW.kappa * (math.sqrt(1.0 + 8.0 * K_T / (math.pi * J**2)) - 1.0)
    return SCREW.eta * jet**2 + 1.0 - SCREW.eta, K_T / U**2


@pytest.mark.parametrize("U", [3.0, 5.5, NOMINAL, 9.0, 30.0])
def test_it_is_the_inflow_and_the_thrust_of_the_standard_model_over_their_nominal_values(U):
    g, T, _, _ = loading(1.0 - NOMINAL / U, SCREW.constants(NOMINAL))
    (inflow, thrust), (inflow_0, thrust_0) = inflow_and_thrust(U), inflow_and_thrust(NOMINAL)
    assert g == pytest.approx(inflow / inflow_0, rel=1e-13)
    assert pytest.approx(thrust / thrust_0, rel=1e-13) == T + 1.0
    assert (g > 1.0) == (U < NOMINAL) or NOMINAL == U


@pytest.mark.parametrize("u_a", [-1.5, -0.3, 0.0, 0.2])
def test_the_slopes_are_those_of_differences(u_a):
    constants, h = SCREW.constants(NOMINAL), 1e-5
    ahead, behind = loading(u_a + h, constants), loading(u_a - h, constants)
    slopes = loading(u_a, constants)[2:]
    np.testing.assert_allclose(slopes, [(a - b) / (2.0 * h) for a, b in zip(ahead[:2], behind[:2], strict=True)], 1e-8)


def test_a_propeller_that_brakes_has_a_finite_inflow():
    assert np.isfinite(loading(0.9, SCREW.constants(NOMINAL))).all()


def test_the_thrust_in_excess_drives_a_slow_ship_back_to_its_nominal_speed(container):
    """With the sign of the force reversed the ship does not come back; v is that of the rudderless course."""
    force = (ps.load_vessel("container").forces["surge"][0],)
    ends = {}
    for value in (0.002, -0.002):
        forces = container.forces | {"surge": tuple(replace(c, name="XT", value=value) for c in force)}
        ship = replace(container, forces=forces, propeller=SCREW)
        course = ps.rudder_programme([0.0], [0.0], approach_speed=8.0)
        end = ps.simulate(ship, course, duration=2000.0, step=0.1, method="rk4").isel(time=-1)
        ends[value] = float(np.hypot(end["u"], end["v"]))
    assert ends[0.002] == pytest.approx(container.particulars.nominal_speed, rel=1e-3)
    assert not ends[-0.002] > 7.9
