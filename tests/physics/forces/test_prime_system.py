from __future__ import annotations

import numpy as np

from pymc_ship.physics.forces.prime_system import rate_scale, righting_arm, righting_moment, row_scale


def test_scales_are_those_of_sname():
    assert rate_scale(2.0, 4.0) == 0.5
    assert [row_scale(row, 2.0, 5.0) for row in range(4)] == [0.8, 0.8, 0.16, 0.16]


def test_righting_moment_is_the_weight_times_the_arm():
    """2 g V GZ / (U^2 L^3) is rho g V GZ over 1/2 rho U^2 L^3."""
    phi, volume, GM, BM, rho, U, L = 0.2, 46070.0, 0.83, 9.0, 1025.0, 9.0, 230.66
    arm = (GM + 0.5 * BM * np.tan(phi) ** 2) * np.sin(phi)
    prime = righting_moment(righting_arm(np.sin(phi), np.tan(phi), GM, BM), U, L, volume)
    np.testing.assert_allclose(prime * 0.5 * rho * U**2 * L**3, rho * 9.81 * volume * arm, rtol=1e-14)
