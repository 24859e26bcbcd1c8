"""The Mariner class cargo ship, 160.93 m, in surge, sway and yaw about midship.

Chislett, M. S. & Strøm-Tejsen, J. (1965), Planar motion mechanism tests and full-scale steering and manoeuvring
predictions for a Mariner class vessel, Hydro- and Aerodynamics Laboratory, Lyngby, report Hy-5: prime coefficients and
equations as in Fossen's MSS toolbox (VESSELS/mariner.m), 15 kn. u' stands for (u - U0)/U.

The model has no propeller; the one in its papers is the ship's own as far as it is stated in textbooks (D = 22 ft, P/D
= .964, four blades), with K_T by the Wageningen polynomials (Oosterveld & van Oossanen 1975) of B4-56.5 for J from .1
to .9 and typical wake, revolutions and rudder.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

from studies.foreign.sailing import Papers

WATER = 1025.0
SPEED, LENGTH = 7.7175, 160.93
M, I_Z, X_G = 798e-5, 39.2e-5, -0.023
ADDED = {"Xudot": -42e-5, "Yvdot": -748e-5, "Yrdot": -9.354e-5, "Nvdot": 4.646e-5, "Nrdot": -43.8e-5}
SURGE = {"u": -184, "uu": -110, "uuu": -215, "vv": -899, "rr": 18, "dd": -95, "udd": -190, "rv": 798, "vd": 93}
SURGE |= {"uvd": 93}
SWAY = {"v": -1160, "r": -499, "vvv": -8078, "vvr": 15356, "vu": -1160, "ru": -499, "d": 278, "ddd": -90}
SWAY |= {"ud": 556, "uud": 278, "vdd": -4, "vvd": 1190, "": -4, "u": -8, "uu": -4}
YAW = {"v": -264, "r": -166, "vvv": 1636, "vvr": -5483, "vu": -264, "ru": -166, "d": -139, "ddd": 45}
YAW |= {"ud": -278, "uud": -139, "vdd": 13, "vvd": -489, "": 3, "u": 6, "uu": 3}

PAPERS = Papers(
    name="foreign_mariner",
    title="Mariner class cargo ship of Chislett and Strom-Tejsen",
    L=LENGTH,
    B=23.17,
    d=7.47,
    volume=0.5 * M * LENGTH**3,
    speed=SPEED,
    rudder_area=30.0,
    rudder_height=7.3,
    frontal_area=420.0,
    lateral_area=1600.0,
    rudder_rate_deg=2.7,
    rudder_delay=1.0,
    propeller={
        **{"D": 6.706, "n": 1.1, "wake_fraction": 0.22, "k_0": 0.4176, "k_1": -0.2731, "k_2": -0.1275},
        **{"eta": 6.706 / 7.3, "kappa": 0.5},
    },
    x_G=X_G * LENGTH,
)


def force(terms: dict[str, float], values: dict[str, float]) -> float:
    """Sum of terms such as ``vvr`` with coefficients times 1e5."""
    total = 0.0
    for name, coefficient in terms.items():
        for letter in name:
            coefficient *= values[letter]
        total += coefficient
    return 1e-5 * total


@dataclass(frozen=True)
class Mariner:
    """The ship; ``asymmetric`` keeps the side force and moment of its single screw, ``rows`` are its forces."""

    papers: Papers = PAPERS
    asymmetric: bool = True
    rows: tuple[dict[str, float], ...] = (SURGE, SWAY, YAW)

    def accelerations(self, motion, delta, n, push):
        """Rates of u, v, r and p, the last 0."""
        u, v, r, _, _ = motion
        U = math.hypot(u, v)
        values = {"u": (u - SPEED) / U, "v": v / U, "r": r * LENGTH / U, "d": delta}
        surge, *sides = self.rows
        sides = sides if self.asymmetric else [symmetric(row) for row in sides]
        scale = 0.5 * WATER * LENGTH**2 * U * U
        X = force(surge, values) + push[0] / scale
        Y = force(sides[0], values) + push[1] / scale
        N = force(sides[1], values) + push[3] / (scale * LENGTH)
        m22, m23 = M - ADDED["Yvdot"], M * X_G - ADDED["Yrdot"]
        m32, m33 = M * X_G - ADDED["Nvdot"], I_Z - ADDED["Nrdot"]
        determinant = m22 * m33 - m23 * m32
        rate = U * U / LENGTH
        du = X * rate / (M - ADDED["Xudot"])
        dv = (m33 * Y - m23 * N) * rate / determinant
        return du, dv, (m22 * N - m32 * Y) * rate / LENGTH / determinant, 0.0


def symmetric(terms: dict[str, float]) -> dict[str, float]:
    """Terms without those that act on a straight course with the rudder amidships."""
    return {name: value for name, value in terms.items() if set(name) - {"u"}}
