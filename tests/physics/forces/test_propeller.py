from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

import pymc_ship as ps
from pymc_ship.physics.forces.propeller import Propeller, loading

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


THRUST_ASTERN = {
    "B3-65, P/D 1.0": (0.96, 0.92, 0.73, 0.84, 1.33),
    "B4-40, P/D 1.0": (0.66, 0.60, 0.54, 0.76, 1.12),
    "B4-55, P/D 1.0": (0.70, 0.74, 0.69, 0.85, 1.22),
    "B4-70, P/D 0.5": (0.56, 0.47, 0.53, 1.09, 1.79),
    "B4-70, P/D 0.6": (0.69, 0.59, 0.59, 1.04, 1.63),
    "B4-70, P/D 0.8": (0.74, 0.68, 0.64, 0.95, 1.46),
    "B4-70, P/D 1.0": (0.76, 0.73, 0.65, 0.82, 1.26),
    "B4-70, P/D 1.2": (0.80, 0.77, 0.69, 0.79, 1.21),
    "B5-75, P/D 1.0": (0.75, 0.77, 0.60, 0.80, 1.29),
    "B6-80, P/D 1.0": (0.73, 0.76, 0.65, 0.69, 1.06),
}
"""Thrust astern over that ahead at rest, at u_P / (|n| D) of 0, 0.2, 0.4, 0.6 and 0.8: from the Fourier series of C_T*
of Roddy, Hess & Faller (2006), NSWCCD-50-TR-2006/004."""


def test_thrust_astern_is_beforehand_that_of_published_propellers():
    """Straight lines through the thrust of each: their mean and sd are the prior's, as far as ten propellers tell."""
    known = {c.name: c for c in ps.with_terms(ps.load_vessel("kvlcc2"), "modular").parameters}
    advance = np.column_stack([np.ones(5), [0.0, 0.2, 0.4, 0.6, 0.8]])
    lines = np.array([np.linalg.lstsq(advance, thrust)[0] for thrust in THRUST_ASTERN.values()])
    for name, ratios in zip(("T_nn", "T_nu"), lines.T, strict=True):
        mean, sd, n = ratios.mean(), ratios.std(ddof=1), len(ratios)
        assert abs(known[name].value - mean) < 2.0 * sd / np.sqrt(n)
        assert 1.0 / 1.5 < known[name].sd / sd < 1.5
        assert abs(0.3 * known[name].value - mean) > 2.0 * sd / np.sqrt(n)
