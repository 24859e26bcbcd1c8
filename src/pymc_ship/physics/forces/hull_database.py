"""Priors of hull and rudder coefficients from captive tests of other ships and from cross-flow drag.

Yoshimura & Masumoto (2012), Proc. MARSIM: bare hulls about midship, over rho/2 L d U^2, from C_B, L/B and d/L.
Faltinsen (1990), Sea Loads on Ships and Offshore Structures, section 6: strips, -rho/2 d C_D (v + x r)|v + x r|.
"""

import math

SOURCE = "hull database of Yoshimura & Masumoto (2012)"  # source of the coefficients of bare_hull


CROSS_FLOW = 0.8  # cross-flow drag coefficient of a section
CONVEXITY = 0.3, 0.4
"""Mean and standard deviation of f_2 in a rudder's normal force, F_N ~ sin(alpha) (1 + f_2 |sin(alpha)|)."""

_SQUARES = {
    "Yv|v|": (-CROSS_FLOW, 0.4),
    "Yv|r|": (-CROSS_FLOW / 2.0, 0.2),
    "Yr|v|": (0.0, 0.2),
    "Yr|r|": (0.0, 0.05),
    "Nv|v|": (0.0, 0.1),
    "Nv|r|": (0.0, 0.1),
    "Nr|v|": (-CROSS_FLOW / 6.0, 0.07),
    "Nr|r|": (-CROSS_FLOW / 32.0, 0.0125),
}
"""Mean and standard deviation over rho/2 L d U^2; damping terms are negative within two sd."""

_RUDDER = {"Y": 0.066, "N": -0.033}
"""Force by rudder angle over rho/2 L d U^2: an area of 1/55 of L d, a slope of 2.7, and a hull that adds a third."""

_BY_RUDDER = {"|r|": (0.0, 0.2), "sincos|delta|": CONVEXITY}
"""Mean and standard deviation over :data:`_RUDDER`; the convexity is that of the part rudder."""


def bare_hull(L: float, B: float, d: float, volume: float) -> dict[str, tuple[float, float]]:
    """Mean and sd of the hull's coefficients by name, prime values, from L, B, d [m] and volume [m3].

    Xvv, Xvr, Xrr, and the linear and cubic coefficients in v and r of Y and N, about midship. They include the added
    mass of the steady turn (m_y v r, m_x u r); the sds are by judgement.
    """
    fullness, slender, by_draught = volume / (L**2 * d), L / B, d / L
    block, aspect = fullness * slender, 2.0 * by_draught
    # mean and sd over rho/2 L d U^2; the mean of Nvrr is 0, since codes differ in its sign
    laws = {
        "Xvv": (1.15 * fullness - 0.18, 0.06),  # the sd covers the term in v^4 up to v' = 0.3
        "Xvr": (1.91 * fullness - 0.08, 0.10),
        "Xrr": (-0.085 * fullness + 0.008, 0.03),
        "Yv": (-(0.5 * math.pi * aspect + 1.4 * fullness), 0.12),
        "Yr": (0.5 * fullness, 0.04),
        "Yvvv": (-(0.185 * slender + 0.48), 0.7),
        "Yvvr": (-0.75, 0.6),
        "Yvrr": (-(0.26 * (1.0 - block) * slender + 0.11), 0.3),
        "Yrrr": (-0.051, 0.05),
        "Nv": (-aspect, 0.03),
        "Nr": (-0.54 * aspect + aspect**2, 0.015),
        "Nvvv": (-(0.66 - 0.69 * block), 0.15),
        "Nvvr": (1.55 * fullness - 0.76, 0.25),
        "Nvrr": (0.0, 0.2),
        "Nrrr": (0.25 * fullness - 0.056, 0.02),
    }
    return {name: (mean * by_draught, sd * by_draught) for name, (mean, sd) in laws.items()}


def cross_flow_terms(L: float, d: float) -> dict[str, tuple[float, float]]:
    """Mean and standard deviation of quadratic terms in v and r by name, prime values, for L and draught d [m]."""
    return {name: (value * d / L, sd * d / L) for name, (value, sd) in _SQUARES.items()}


def typical_rudder(L: float, d: float) -> dict[str, tuple[float, float]]:
    """Mean and standard deviation of even and convex rudder terms by name, prime values, for L and draught d [m]."""
    return {
        f"{letter}{term}": (force * value * d / L, abs(force) * sd * d / L)
        for letter, force in _RUDDER.items()
        for term, (value, sd) in _BY_RUDDER.items()
    }
