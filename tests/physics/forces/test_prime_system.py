from __future__ import annotations

import numpy as np
import pytest

from pymc_ship.physics.forces.prime_system import (
    QUANTITIES,
    relative_speed,
    righting_arm,
    righting_moment,
    scale,
    to_prime,
)
from tests.sentences import refused

LENGTH, TIME, MASS = np.eye(3)
UNIT = {"m": LENGTH, "s": TIME, "kg": MASS}
DIMENSION = {
    "x": LENGTH,
    "y": LENGTH,
    "time": TIME,
    "u": LENGTH - TIME,
    "v": LENGTH - TIME,
    "r": -TIME,
    "p": -TIME,
    "udot": LENGTH - 2 * TIME,
    "vdot": LENGTH - 2 * TIME,
    "rdot": -2 * TIME,
    "pdot": -2 * TIME,
    "X": MASS + LENGTH - 2 * TIME,
    "Y": MASS + LENGTH - 2 * TIME,
    "N": MASS + 2 * LENGTH - 2 * TIME,
    "K": MASS + 2 * LENGTH - 2 * TIME,
    "phi": 0 * LENGTH,
    "psi": 0 * LENGTH,
    "delta": 0 * LENGTH,
}
"""Exponents of metre, second and kilogram."""

L, RHO = 230.66, 1025.0
U = np.array([0.3, 6.1, 12.7])


def test_every_quantity_has_a_dimension_here():
    assert set(QUANTITIES) == set(DIMENSION)


@pytest.mark.parametrize("quantity", QUANTITIES)
def test_prime_to_si_to_prime(quantity):
    value = np.array([-3.7, 1e-9, 0.4])
    divisor = scale(quantity, U, L)
    np.testing.assert_allclose(to_prime(quantity, value * divisor, U, L), value, rtol=4e-16)
    np.testing.assert_allclose(to_prime(quantity, value, U, L) * divisor, value, rtol=4e-16)


@pytest.mark.parametrize("quantity", QUANTITIES)
def test_a_scale_has_the_dimension_of_its_quantity(quantity):
    """A change of units (metres to feet, seconds to minutes, kilograms to pounds) changes a scale by its dimension."""
    metre, second, kilogram = 3.2808, 1.0 / 60.0, 2.2046
    changed = scale(quantity, U * metre / second, L * metre, RHO * kilogram / metre**3)
    length, time, mass = DIMENSION[quantity]
    np.testing.assert_allclose(changed, scale(quantity, U, L, RHO) * metre**length * second**time * kilogram**mass)


def test_scales_are_those_of_sname():
    assert float(scale("X", 2.0, 3.0, 10.0)) == 0.5 * 10.0 * 4.0 * 9.0
    assert float(scale("N", 2.0, 3.0, 10.0)) == 0.5 * 10.0 * 4.0 * 27.0
    assert float(scale("r", 2.0, 4.0)) == 0.5
    assert float(scale("udot", 2.0, 5.0)) == 0.8
    assert float(scale("pdot", 2.0, 4.0)) == 0.25
    assert float(scale("time", 2.0, 5.0)) == 2.5
    assert scale("delta", U, L).tolist() == [1.0, 1.0, 1.0]


def test_only_forces_and_moments_depend_on_the_water():
    depends = {
        quantity for quantity in QUANTITIES if scale(quantity, 3.0, L, 1000.0) != scale(quantity, 3.0, L, 1025.0)
    }
    assert depends == {"X", "Y", "N", "K"}


def test_relative_speed_is_zero_at_the_nominal_speed():
    assert relative_speed(12.7, 12.7) == 0.0
    assert relative_speed(10.0, 12.5) == -0.25


def test_righting_moment_is_the_weight_times_the_arm():
    """2 g V GZ / (U^2 L^3) is rho g V GZ over 1/2 rho U^2 L^3."""
    phi, volume, GM, BM = 0.2, 46070.0, 0.83, 9.0
    arm = (GM + 0.5 * BM * np.tan(phi) ** 2) * np.sin(phi)
    prime = righting_moment(righting_arm(np.sin(phi), np.tan(phi), GM, BM), 9.0, L, volume)
    np.testing.assert_allclose(prime * scale("K", 9.0, L, RHO), RHO * 9.81 * volume * arm, rtol=1e-14)


def test_an_unknown_quantity_is_an_error_that_lists_the_known_ones():
    with refused(ValueError, "w") as error:
        scale("w", 1.0, 1.0)
    assert all(quantity in str(error.value) for quantity in QUANTITIES)
