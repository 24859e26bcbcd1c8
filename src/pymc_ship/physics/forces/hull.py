"""Forces of the water on the hull as parts: MMG polynomials ahead, lift and cross-flow drag at any speed, roll.

Equation numbers are those of docs/reference/equations.md.
"""

from numpy.polynomial.legendre import leggauss

from pymc_ship.physics.forces.expressions import Expression, cos, sin, step
from pymc_ship.physics.forces.hull_database import CROSS_FLOW, SOURCE, bare_hull
from pymc_ship.physics.forces.part import Expressions, Force, Motion, Parameter, Part, ShipDimensions, speed
from pymc_ship.physics.forces.prime_system import GRAVITY

MMG = "MMG standard method, Yasukawa & Yoshimura (2015), doi:10.1007/s00773-014-0293-y"
"""Source of the modular formulae."""

_FRICTION = 3.5e-3  # resistance over rho/2 U^2 times wetted surface, of merchant ships at service speed
_NODES, _WEIGHTS = leggauss(10)  # of the integral of the cross flow over the length


def nominal_resistance(ship: ShipDimensions) -> tuple[float, float, str]:
    """Resistance at the nominal speed, equal to the thrust (1 - t) T: value, sd and source."""
    if ship.propeller_known:
        t, J = thrust_deduction(ship), (1.0 - ship.wake) * ship.J
        K_T = ship.k_0 + ship.k_1 * J + ship.k_2 * J * J
        value = 2.0 * (1.0 - t) * ship.n**2 * ship.D**4 * K_T / (ship.L * ship.nominal_speed) ** 2
        return value, 0.15 * value, "thrust of the propeller at the nominal speed"
    surface = 1.7 * ship.L * ship.d + ship.volume / ship.d
    value = _FRICTION * surface / ship.L**2
    return value, 0.3 * value, "wetted surface of Denny and Mumford, C_T = 3.5e-3"


def thrust_deduction(ship: ShipDimensions) -> float:
    """Thrust deduction t = 0.5 C_B - 0.12 (Kijima et al. 1990) of a single screw."""
    return max(0.5 * ship.block - 0.12, 0.1)


def _ahead_parameters(ship: ShipDimensions) -> tuple[Parameter, ...]:
    known, draught_ratio = bare_hull(ship.L, ship.B, ship.d, ship.volume), ship.d / ship.L
    rows = [Parameter("R0", *nominal_resistance(ship))]
    rows += [Parameter(name, *known[name], SOURCE) for name in ("Xvv", "Xvr", "Xrr")]
    rows += [Parameter("Xvvvv", 0.12 * draught_ratio, 0.6 * draught_ratio, f"{MMG}, of several tankers")]
    return tuple(rows + [Parameter(name, *row, SOURCE) for name, row in known.items() if name[0] in "YN"])


def _hull_ahead(ship: ShipDimensions, motion: Motion, p: Expressions, shared: dict[str, Expression]) -> Force:
    u, v, r = motion.u, motion.v, motion.r
    U = speed(u, v)
    per_U = 1.0 / U
    vv, vr, rr = v * v, v * r, r * r

    def side(linear_v: str, linear_r: str, cubes: tuple[str, ...]) -> Expression:
        cubic = v * (p[cubes[0]] * vv + p[cubes[1]] * vr + p[cubes[2]] * rr) + p[cubes[3]] * r * rr
        return U * (p[linear_v] * v + p[linear_r] * r) + cubic * per_U  # Eq. 22

    Y = side("Yv", "Yr", ("Yvvv", "Yvvr", "Yvrr", "Yrrr"))
    N = side("Nv", "Nr", ("Nvvv", "Nvvr", "Nvrr", "Nrrr"))
    # Eq. 21
    X = p["Xvv"] * vv + p["Xvr"] * vr + p["Xrr"] * rr + p["Xvvvv"] * (vv * per_U) * (vv * per_U) - p["R0"] * U * U
    shared["Y_hull"] = Y
    return Force(X, Y, N)


def _any_speed_parameters(ship: ShipDimensions) -> tuple[Parameter, ...]:
    known = bare_hull(ship.L, ship.B, ship.d, ship.volume)
    R0, R0_sd, source = nominal_resistance(ship)
    linear = [Parameter(name, *known[name], SOURCE) for name in ("Xvr", "Xrr", "Yv", "Yr", "Nv", "Nr")]
    cross = "cross-flow drag of ship sections, Faltinsen (1990), Sea Loads on Ships, chapter 6"
    return (
        Parameter("R0", R0, R0_sd, source),
        Parameter("R_astern", 1.3, 0.4, "a stern is blunter than a bow; by judgement", "over R0"),
        Parameter("Xvv", *known["Xvv"], SOURCE),
        *linear,
        Parameter("C_D", CROSS_FLOW, 0.15, cross, "drag coefficient"),
        Parameter("c_N", 1.0, 0.3, f"{cross}; by judgement", "moment of the cross flow over that of a flat plate"),
        Parameter("x_C", 0.0, 0.05, f"{cross}; by judgement", "L, centre of the cross flow"),
    )


def _hull_any_speed(ship: ShipDimensions, motion: Motion, p: Expressions, shared: dict[str, Expression]) -> Force:
    u, v, r = motion.u, motion.v, motion.r
    force: Expression | float = 0.0
    moment: Expression | float = 0.0
    for x, weight in zip(_NODES.tolist(), _WEIGHTS.tolist(), strict=True):
        flow = v + 0.5 * x * r
        drag = 0.5 * weight * flow * abs(flow)  # Eq. 23 and 24
        force, moment = force + drag, moment + 0.5 * x * drag
    cross = -(ship.d / ship.L) * p["C_D"]
    Y_cross = cross * force
    ahead = step(u)
    X = p["Xvv"] * v * v + p["Xvr"] * v * r + p["Xrr"] * r * r
    X = X - p["R0"] * u * abs(u) * (ahead + (1.0 - ahead) * p["R_astern"])  # Eq. 25
    Y = abs(u) * p["Yv"] * v + u * p["Yr"] * r + Y_cross  # Eq. 26
    N = u * p["Nv"] * v + abs(u) * p["Nr"] * r + cross * p["c_N"] * moment + p["x_C"] * Y_cross
    shared["Y_hull"] = Y
    return Force(X, Y, N)


SWAY_CENTRE = "z_Y"  # parameter of roll: depth of the centre of added mass in sway below the origin


def _roll_parameters(ship: ShipDimensions) -> tuple[Parameter, ...]:
    draught_ratio = ship.d / ship.L
    damping = 2.0 * 0.05 * (_stiffness(ship) * ship.GM * (ship.I_xx - ship.added_mass.Kpdot)) ** 0.5
    judged, half = "by judgement", "half the draught below the origin, by judgement"
    spread = (0.1 * ship.GM, "vessel file") if ship.GM_known else (0.5 * ship.GM, "usual ships")
    depth, source = 0.6 * draught_ratio, f"0.6 of the draught below the origin, {judged}"
    if ship.added_mass.Ypdot:
        depth, source = -ship.added_mass.Ypdot / ship.added_mass.Yvdot, "Ypdot of the vessel file"
    return (
        Parameter("GM", ship.GM, *spread, "m"),
        Parameter("BM", ship.BM, 0.5 * ship.BM, f"vertical sides, {judged}", "m"),
        Parameter("Kp", -damping, 0.5 * damping, f"5 % of the critical damping, {judged}"),
        Parameter("Kp|p|", -damping, damping, f"as large at a rate of U/L, {judged}"),
        Parameter(SWAY_CENTRE, depth, 0.2 * draught_ratio, source, "L"),
        Parameter("z_H", 0.5 * draught_ratio, 0.3 * draught_ratio, half, "L"),
        Parameter("z_R", 0.5 * draught_ratio, 0.3 * draught_ratio, half, "L"),
        Parameter("Yphi", 0.0, 2e-4, f"none, {judged}"),
        Parameter("Nphi", 0.0, 1e-4, f"none, {judged}"),
    )


def _stiffness(ship: ShipDimensions) -> float:
    """Prime restoring moment of a righting arm of 1 m."""
    return 2.0 * GRAVITY * ship.volume / (ship.nominal_speed**2 * ship.L**3)


def _roll(ship: ShipDimensions, motion: Motion, p: Expressions, shared: dict[str, Expression]) -> Force:
    sine, cosine = sin(motion.phi), cos(motion.phi)
    slope = sine / cosine
    GZ = (p["GM"] + 0.5 * p["BM"] * slope * slope) * sine  # Eq. 7
    damping = p["Kp"] * motion.p + p["Kp|p|"] * motion.p * abs(motion.p)
    K = damping - _stiffness(ship) * GZ - p["z_H"] * shared["Y_hull"]  # Eq. 40
    if "Y_rudder" in shared:
        K = K - p["z_R"] * shared["Y_rudder"]
    U2 = motion.u * motion.u + motion.v * motion.v
    return Force(0.0, p["Yphi"] * U2 * motion.phi, p["Nphi"] * U2 * motion.phi, K)  # Eq. 41


MANOEUVRING = Part("hull", "polynomials of drift and yaw (MMG standard method)", _ahead_parameters, _hull_ahead, "hull")
LOW_SPEED = Part(
    "low-speed hull", "lift and cross-flow drag, at any speed", _any_speed_parameters, _hull_any_speed, "hull"
)
ROLL = Part("roll", "righting arm, damping, heights of the side forces", _roll_parameters, _roll, "roll")
