"""Propeller as a part: thrust, wake by drift, slipstream at the rudder, side force and moment.

Yasukawa & Yoshimura (2015), Eq. 10 to 16, with a wake that differs by side. Thrust is relative to the resistance R_0 of
the straight course; astern it is quadratic in n and u, the rudder has no slipstream, and the stern goes to port.
Equation numbers are those of docs/reference/equations.md.
"""

import math

from pymc_ship.physics.forces.expressions import Expression, arctan2, exp, ramp, root, step
from pymc_ship.physics.forces.hull import MMG
from pymc_ship.physics.forces.part import Expressions, Force, Motion, Parameter, Part, ShipDimensions

X_P = -0.48  # longitudinal position of the propeller [L]
NOMINAL_REVOLUTIONS = "n_0"  # parameter that corrects the nominal revolutions of the vessel file
SIDE_FORCE = {"Y": 1e-3, "N": 5e-4}  # sd of the force and moment of a propeller ahead, over rho/2 L d U^2
_TURNING = "right-handed screw, by judgement"
_B_SERIES = "ten propellers of the Wageningen B-series (Roddy, Hess & Faller 2006, NSWCCD-50-TR-2006/004)"


def _parameters(ship: ShipDimensions) -> tuple[Parameter, ...]:
    side_force = {name: sd * ship.d / ship.L for name, sd in SIDE_FORCE.items()}
    n_sd, wake_sd, n_source, wake_source = 0.1, 0.04, "vessel file", "vessel file"
    if not ship.propeller_known:
        n_sd, wake_sd, n_source, wake_source = 0.3, 0.08, "thrust of a typical propeller", "Taylor, w = 0.5 C_B - 0.05"
    n_unit, astern = "over the nominal revolutions stated", f"thrust astern at rest over that ahead, {_B_SERIES}"
    return (
        Parameter(NOMINAL_REVOLUTIONS, 1.0, n_sd, n_source, n_unit, per_facility=True),
        Parameter("w0", ship.wake, wake_sd, wake_source, "wake fraction", per_facility=True),
        Parameter("C2", 1.4, 0.25, f"{MMG}, 1.6 and 1.1", "wake by drift"),
        Parameter("dC2", 0.0, 0.15, "half the difference between the sides", "wake by drift", per_facility=True),
        Parameter("Y_P", 0.0, side_force["Y"], "none on average", "at nominal thrust", per_facility=True),
        Parameter("N_P", 0.0, side_force["N"], "none on average", "at nominal thrust", per_facility=True),
        Parameter("T_nn", 0.6, 0.2, astern, "over k_0"),
        Parameter("T_nu", 0.6, 0.4, f"how way ahead adds to thrust astern, {_B_SERIES}", "over k_0 / J"),
        Parameter("Y_nn", 0.15, 0.15, f"side force astern, {_TURNING}", "over thrust astern"),
        Parameter("N_nn", -0.06, 0.06, f"moment astern, {_TURNING}", "over thrust astern"),
    )


def _propeller(ship: ShipDimensions, motion: Motion, p: Expressions, shared: dict[str, Expression]) -> Force:
    J, n = ship.J / p[NOMINAL_REVOLUTIONS], motion.n / p[NOMINAL_REVOLUTIONS]  # Eq. 27
    drift = arctan2(-1.0 * motion.v - X_P * motion.r, root(motion.u * motion.u + 1e-6))  # Eq. 28
    C_2 = p["C2"] + p["dC2"] * (2.0 * step(drift) - 1.0)
    u_P = (1.0 - p["w0"]) * (1.0 + (1.0 - exp(-2.0 * abs(drift))) * (C_2 - 1.0)) * motion.u  # Eq. 29
    u_0 = (1.0 - p["w0"]) * J

    def thrust_coefficient(n: Expression | float, advance: Expression) -> Expression:
        """K_T (n / n_0)^2 at the advance u_P / (n_0 D)."""
        return ship.k_0 * n * n + ship.k_1 * n * advance + ship.k_2 * advance * advance  # Eq. 30

    nominal = thrust_coefficient(1.0, u_0)
    advance = u_P * J
    ahead = step(n)
    thrust_ahead = thrust_coefficient(n, advance)
    thrust_astern = ship.k_0 * p["T_nn"] * n * n - p["T_nu"] * n * advance * ship.k_0
    thrust = (ahead * thrust_ahead - (1.0 - ahead) * thrust_astern) / nominal  # Eq. 31
    u_jet = root(ramp(u_P * u_P + (8.0 / math.pi) / (J * J) * ahead * thrust_ahead) + 1e-12)  # Eq. 32
    shared["u_P"], shared["u_jet"] = u_P, u_jet
    X = p["R0"] * thrust  # Eq. 33
    Y = ahead * thrust * p["Y_P"] + (1.0 - ahead) * X * p["Y_nn"]
    N = ahead * thrust * p["N_P"] + (1.0 - ahead) * X * p["N_nn"]
    return Force(X, Y, N)


PROPELLER = Part("propeller", "thrust by revolutions and wake, race, side force", _parameters, _propeller, "propeller")
