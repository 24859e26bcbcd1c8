"""Propeller loading: slipstream and thrust as functions of u_a = (U - U_nom) / U at constant revolutions.

Yasukawa & Yoshimura (2015), Eq. 13 to 22, doi:10.1007/s00773-014-0293-y, with J = J_nom / (1 - u_a):

    g = (u_R / U)^2 over its value at u_a = 0, u_R^2 ~ U^2 {eta [1 + kappa (sqrt(1 + 8 K_T/(pi J^2)) - 1)]^2 + 1 - eta}
    T = (K_T / J^2) over its value at u_a = 0, minus 1, K_T = k_0 + k_1 J + k_2 J^2; X' = R'_0 T on a straight course
"""

import math
from dataclasses import dataclass
from typing import NamedTuple

from numba import njit

from pymc_ship.physics.forces.programs import KERNEL


class PropellerConstants(NamedTuple):
    """Constants of :func:`loading`, as of :class:`Propeller`; zeros without a propeller."""

    J: float = 0.0  # advance ratio at the nominal speed
    k_0: float = 0.0
    k_1: float = 0.0
    k_2: float = 0.0
    eta: float = 0.0
    kappa: float = 0.0


@dataclass(frozen=True)
class Propeller:
    """Propeller and the rudder behind it.

    ``D`` diameter [m], ``n`` revolutions [1/s] at the nominal speed, ``wake_fraction``, ``k_0``, ``k_1``, ``k_2`` of
    the open-water polynomial, ``eta`` diameter over the rudder's height, ``kappa`` contraction of the slipstream.
    """

    D: float
    n: float
    wake_fraction: float
    k_0: float
    k_1: float
    k_2: float
    eta: float
    kappa: float

    def constants(self, nominal_speed: float) -> PropellerConstants:
        """Constants of :func:`loading` for a nominal speed [m/s]."""
        J = (1.0 - self.wake_fraction) * nominal_speed / (self.n * self.D)
        return PropellerConstants(J, self.k_0, self.k_1, self.k_2, self.eta, self.kappa)


@njit(**KERNEL)
def _inflow(load: float, eta: float, kappa: float) -> tuple[float, float]:
    """Square of the rudder inflow over that without slipstream, and its derivative by ``load`` = 8 K_T / (pi J^2)."""
    root = math.sqrt(max(1.0 + load, 0.0))
    jet = 1.0 + kappa * (root - 1.0)
    slope = eta * jet * kappa / root if root > 0.0 else 0.0
    return eta * jet * jet + 1.0 - eta, slope  # Eq. 13 of docs/reference/equations.md


@njit(**KERNEL)
def loading(u_a: float, constants: PropellerConstants) -> tuple[float, float, float, float]:
    """Propeller loading at a relative speed: g, T and their derivatives by u_a; see :class:`PropellerConstants`."""
    J_nom, k_0, k_1, k_2 = constants.J, constants.k_0, constants.k_1, constants.k_2
    a = 1.0 - u_a
    thrust = k_0 * a * a / (J_nom * J_nom) + k_1 * a / J_nom + k_2  # Eq. 12
    slope = -(2.0 * k_0 * a / (J_nom * J_nom) + k_1 / J_nom)
    nominal = k_0 / (J_nom * J_nom) + k_1 / J_nom + k_2
    inflow, inflow_slope = _inflow(8.0 / math.pi * thrust, constants.eta, constants.kappa)
    unit, _ = _inflow(8.0 / math.pi * nominal, constants.eta, constants.kappa)
    return inflow / unit, thrust / nominal - 1.0, inflow_slope * 8.0 / math.pi * slope / unit, slope / nominal
