"""The prime system of SNAME (Technical and Research Bulletin 1-5, 1950).

Units are L, the instantaneous speed U, L / U, 1/2 rho U^2 L^2 and 1/2 rho U^2 L^3; terms have u_a = (U - U_nom) / U.
"""

from __future__ import annotations

from numba import njit

GRAVITY = 9.81  # acceleration of gravity [m/s2]


@njit(cache=True, nogil=True, error_model="numpy")
def rate_scale(U: float, L: float) -> float:
    """Unit of angular rates r, p [rad/s]."""
    return U / L


@njit(cache=True, nogil=True, error_model="numpy")
def row_scale(row: int, U: float, L: float) -> float:
    """Unit of the acceleration in a row of the equations of motion: udot, vdot [m/s2], rdot, pdot [rad/s2]."""
    return U * U / L if row < 2 else U * U / (L * L)


@njit(cache=True, nogil=True, error_model="numpy")
def relative_speed(U: float, nominal_speed: float) -> float:
    """u_a = (U - U_nom) / U."""
    return (U - nominal_speed) / U


@njit(cache=True, nogil=True, error_model="numpy")
def righting_arm(sin_phi: float, tan_phi: float, GM: float, BM: float) -> float:
    """GZ = (GM + 1/2 BM tan^2 phi) sin phi [m]."""
    return (GM + 0.5 * BM * tan_phi * tan_phi) * sin_phi


@njit(cache=True, nogil=True, error_model="numpy")
def righting_moment(GZ: float, U: float, L: float, volume: float) -> float:
    """Prime restoring moment 2 g V GZ / (U^2 L^3) of the righting arm GZ [m]."""
    return 2.0 * GRAVITY * volume * GZ / (U * U * L * L * L)
