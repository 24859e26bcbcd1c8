"""Rudder behind a propeller as a part: normal force, flow straightening and hull interaction.

Yasukawa & Yoshimura (2015), with gamma_R by side and F_N ~ sin(alpha) (1 + f_2 |sin(alpha)|).
Equation numbers are those of docs/reference/equations.md.
"""

from pymc_ship.physics.forces.expressions import Expression, cos, root, sin
from pymc_ship.physics.forces.hull import MMG
from pymc_ship.physics.forces.hull_database import CONVEXITY
from pymc_ship.physics.forces.part import Expressions, Force, Motion, Parameter, Part, ShipDimensions, speed

SLOWEST = 1e-12  # fourth power of a speed [U_nom] that keeps the inflow smooth at its reversal
X_R = -0.5  # longitudinal position of the rudder [L]


def _parameters(ship: ShipDimensions) -> tuple[Parameter, ...]:
    slope = 6.13 * ship.aspect_ratio / (2.25 + ship.aspect_ratio)
    how = "Fujii's 6.13 A / (2.25 + A)"
    sd = 0.1 * slope
    if not ship.rudder_known:
        how, sd = f"{how} of an area by the rule of Det Norske Veritas", 0.25 * slope
    kijima = "Kijima et al. (1990)"
    return (
        Parameter("f_alpha", slope, sd, how, "lift slope of the rudder"),
        Parameter("f2", *CONVEXITY, "stall delayed in the slipstream, by judgement", "convexity"),
        Parameter("epsilon", 1.05, 0.15, MMG, "ratio of wake fractions, rudder to propeller"),
        Parameter(
            "kappa", ship.kappa, 0.08 if ship.propeller_known else 0.12, MMG, "slipstream acceleration at the rudder"
        ),
        Parameter("gamma_R", 0.44, 0.13, f"{MMG}, 0.40 and 0.64", "flow straightening"),
        Parameter(
            "dgamma_R", 0.0, 0.1, "half the difference between the sides", "flow straightening", per_facility=True
        ),
        Parameter("l_R", -0.9, 0.2, f"{MMG}, -0.71; twice the position of the rudder, {kijima}", "L"),
        Parameter("t_R", 0.45 - 0.28 * ship.block, 0.12, kijima, "steering resistance deduction"),
        Parameter("a_H", 0.4, 0.2, f"{MMG}, 0.31; {kijima}", "rudder force increase factor"),
        Parameter("x_H", -0.44, 0.06, f"{MMG}, -0.464; {kijima}", "L"),
    )


def _rudder(ship: ShipDimensions, motion: Motion, p: Expressions, shared: dict[str, Expression]) -> Force:
    u_P, angle = shared["u_P"], -motion.delta
    u_kappa = u_P + p["kappa"] * (shared["u_jet"] - abs(u_P))  # Eq. 34, in the slipstream
    q = ship.eta * u_kappa * abs(u_kappa) + (1.0 - ship.eta) * u_P * abs(u_P)
    u_R = p["epsilon"] * q / root(root(q * q + SLOWEST))  # Eq. 35
    drift = -1.0 * motion.v - p["l_R"] * motion.r
    v_R = p["gamma_R"] * drift + p["dgamma_R"] * abs(drift)  # Eq. 36
    sine, cosine = sin(angle), cos(angle)
    across = u_R * sine - v_R * cosine  # Eq. 37, normal to the rudder
    U_R = speed(u_R, v_R)
    F_N = ship.rudder_area * p["f_alpha"] * across * (U_R + p["f2"] * abs(across))  # Eq. 38
    Y = -(1.0 + p["a_H"]) * F_N * cosine
    shared["Y_rudder"] = Y
    N = -(X_R + p["a_H"] * p["x_H"]) * F_N * cosine
    return Force(-(1.0 - p["t_R"]) * F_N * sine, Y, N)  # Eq. 39


RUDDER = Part("rudder", "normal force in the race, flow straightening, action on hull", _parameters, _rudder, "rudder")
