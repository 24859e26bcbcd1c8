"""The prime system of SNAME (Technical and Research Bulletin 1-5, 1950).

Units are L, the instantaneous speed U, L / U, 1/2 rho U^2 L^2 and 1/2 rho U^2 L^3; terms have u_a = (U - U_nom) / U.
"""

import numpy as np
from numba import njit

from pymc_ship.machine.errors import ShipError
from pymc_ship.physics.forces.programs import KERNEL

WATER_DENSITY = 1025.0  # density of sea water [kg/m3], for forces in N and moments in N m
GRAVITY = 9.81  # acceleration of gravity [m/s2]


@njit(**KERNEL)
def rate_scale(U: float, L: float) -> float:
    """Unit of angular rates r, p [rad/s]."""
    return U / L


@njit(**KERNEL)
def acceleration_scale(U: float, L: float) -> float:
    """Unit of linear accelerations udot, vdot [m/s2]."""
    return U * U / L


@njit(**KERNEL)
def angular_acceleration_scale(U: float, L: float) -> float:
    """Unit of angular accelerations rdot, pdot [rad/s2]."""
    return U * U / (L * L)


@njit(**KERNEL)
def row_scale(row: int, U: float, L: float) -> float:
    """Unit of the acceleration in a row of the equations of motion: u, v linear, r, p angular."""
    return acceleration_scale(U, L) if row < 2 else angular_acceleration_scale(U, L)


@njit(**KERNEL)
def relative_speed(U: float, nominal_speed: float) -> float:
    """u_a = (U - U_nom) / U."""
    return (U - nominal_speed) / U


@njit(**KERNEL)
def righting_arm(sin_phi: float, tan_phi: float, GM: float, BM: float) -> float:
    """GZ = (GM + 1/2 BM tan^2 phi) sin phi [m]."""
    return (GM + 0.5 * BM * tan_phi * tan_phi) * sin_phi


@njit(**KERNEL)
def righting_moment(GZ: float, U: float, L: float, volume: float) -> float:
    """Prime restoring moment 2 g V GZ / (U^2 L^3) of the righting arm GZ [m]."""
    return 2.0 * GRAVITY * volume * GZ / (U * U * L * L * L)


_SCALES = {
    ("x", "y"): lambda U, L, rho: L + 0.0 * U,
    ("time",): lambda U, L, rho: L / U,
    ("u", "v"): lambda U, L, rho: U,
    ("r", "p"): lambda U, L, rho: rate_scale(U, L),
    ("udot", "vdot"): lambda U, L, rho: acceleration_scale(U, L),
    ("rdot", "pdot"): lambda U, L, rho: angular_acceleration_scale(U, L),
    ("X", "Y"): lambda U, L, rho: 0.5 * rho * U**2 * L**2,
    ("N", "K"): lambda U, L, rho: 0.5 * rho * U**2 * L**3,
    ("phi", "psi", "delta"): lambda U, L, rho: 1.0 + 0.0 * U,
}
_SCALE = {quantity: divisor for quantities, divisor in _SCALES.items() for quantity in quantities}

QUANTITIES = tuple(_SCALE)  # quantities that have a prime value


def scale(quantity: str, U: float | np.ndarray, L: float, water_density: float = WATER_DENSITY) -> np.ndarray:
    """Divisor of a quantity of :data:`QUANTITIES`, SI units, shape of ``U``; ValueError for an unknown quantity.

    ``U`` is the instantaneous speed [m/s], ``L`` the length between perpendiculars [m], the density is in kg/m3.
    """
    if quantity not in _SCALE:
        raise ShipError(f"Prime values exist for {', '.join(QUANTITIES)}, found {quantity!r}; use one of these.")
    return _SCALE[quantity](np.asarray(U, dtype=float), L, water_density)


def to_prime(quantity: str, value: float | np.ndarray, U: float | np.ndarray, L: float) -> np.ndarray:
    """SI value -> prime value; arguments and errors as :func:`scale`."""
    return value / scale(quantity, U, L)
