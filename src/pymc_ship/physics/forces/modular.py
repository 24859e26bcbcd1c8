"""The table of parts, to which :func:`register_part` adds, and the accelerations of a set of parts as one program."""

from collections.abc import Iterable, Sequence
from functools import lru_cache

from pymc_ship.machine.arguments import check_kind
from pymc_ship.machine.errors import VesselError
from pymc_ship.physics.forces.expressions import Expression, Trace, cos, sin
from pymc_ship.physics.forces.hull import LOW_SPEED, MANOEUVRING, ROLL, SWAY_CENTRE
from pymc_ship.physics.forces.part import INPUTS, STATES, Expressions, Motion, Parameter, Part, ShipDimensions, no_force
from pymc_ship.physics.forces.programs import Program
from pymc_ship.physics.forces.rudder import RUDDER
from pymc_ship.physics.forces.screw import PROPELLER
from pymc_ship.physics.forces.surroundings import CONSTANT, CURRENT, CURRENT_COMPONENTS, WIND

_SOURCE = "vessel file or Motora's charts"
_SPREAD = {"m_x": 0.3, "m_y": 0.15, "J_zz": 0.25}  # of added masses, over their values
_ROLL_SPREAD = 0.2  # of the total moment of inertia in roll: 10 % of the radius of gyration


def _added_mass(ship: ShipDimensions) -> tuple[Parameter, ...]:
    """Added masses, with relative sds from a comparison of Motora's charts with captive tests."""
    mass = ship.added_mass
    values = [("m_x", -mass.Xudot), ("m_y", -mass.Yvdot), ("J_zz", -mass.Nrdot)]
    parameters = [Parameter(name, value, _SPREAD[name] * value, _SOURCE) for name, value in values]
    if ship.rolls:
        spread = _ROLL_SPREAD * (ship.I_xx - mass.Kpdot)
        parameters.append(Parameter("J_xx", -mass.Kpdot, spread, "vessel file, or a fifth of I_xx"))
    return tuple(parameters)


ADDED_MASS = Part("added mass", "added masses and moments of inertia", _added_mass, no_force, "added mass")

_PARTS = (ADDED_MASS, MANOEUVRING, LOW_SPEED, PROPELLER, RUDDER, ROLL, WIND, CURRENT, CONSTANT)

PARTS = {part.name: part for part in _PARTS}
"""Parts by name, in the order of evaluation: the rudder needs the slipstream of the propeller."""

MODULAR = ("added mass", "propeller", "rudder")  # roles that a model without polynomial terms needs besides a hull
Matrix = tuple[tuple[float, ...], ...]


def register_part(part: Part) -> None:
    """Register a part of the force.

    VesselError for anything else, and if its name is taken.
    """
    check_kind("A part", part, Part, "make one by ps.Part", VesselError)
    if part.name in PARTS:
        raise VesselError(f"The name of a part must be new, found {part.name!r} among {', '.join(PARTS)}; rename it.")
    PARTS[part.name] = part


class UnknownPart(ValueError):
    """A list of parts that is unknown or incomplete."""


def order_parts(names: Sequence[str], *, polynomial: bool) -> tuple[str, ...]:
    """Names of parts in the order of evaluation; UnknownPart for unknown, repeated or missing parts."""
    unknown = [name for name in names if name not in PARTS]
    if unknown or len(set(names)) < len(names):
        given = ", ".join(map(str, unknown or names))
        raise UnknownPart(f"parts must be some of {', '.join(PARTS)}, each once, found {given}; correct them.")
    roles = [PARTS[name].role for name in names]
    twice = sorted({role for role in roles if roles.count(role) > 1})
    missing = [role for role in ("hull", *MODULAR) if role not in roles]
    if polynomial:
        others = [name for name in names if PARTS[name].role in ("hull", *MODULAR, "roll", "current")]
        if others:
            raise UnknownPart(
                f"parts with [coefficients] must be wind or constant force, found {', '.join(others)}; leave out the "
                "coefficients or these parts."
            )
    elif twice or missing:
        raise UnknownPart(
            f"parts must have one hull, added mass, one propeller and one rudder, found "
            f"{', '.join(names) or 'none'}; add {' and '.join(missing) or 'one only for ' + ' and '.join(twice)}."
        )
    return tuple(name for name in PARTS if name in names)


def part_parameters(ship: ShipDimensions, names: Sequence[str]) -> tuple[Parameter, ...]:
    """Parameters of parts, part after part, with typical values."""
    return tuple(parameter for name in names for parameter in PARTS[name].parameters(ship))


@lru_cache(maxsize=64)
def acceleration_program(ship: ShipDimensions, parts: tuple[Part, ...], J_inverse: Matrix | None = None) -> Program:
    """Program of the rates of u, v (over U_nom^2 / L), r and p (over U_nom^2 / L^2), for parts in order of evaluation.

    With ``J_inverse`` (4, 4), the inverse of the inertia matrix, the accelerations are those by the parts, which add to
    polynomial terms; by default inertia is that of the ship and of the part "added mass".
    """
    trace = Trace((*STATES, *INPUTS), [parameter.name for part in parts for parameter in part.parameters(ship)])
    at, p = trace.inputs, trace.parameters
    cosine, sine = cos(at["psi"]), sin(at["psi"])

    def to_ship(north: Expression | float, east: Expression | float) -> tuple[Expression, Expression]:
        return north * cosine + east * sine, east * cosine - north * sine

    drift = p.get("k_drift", 0.0)
    c_north, c_east = (p.get(name, 0.0) for name in CURRENT_COMPONENTS)
    # Eq. 15 to 17: velocities of water and air in the axes of the ship
    u_c, v_c = to_ship(c_north + drift * at["wind_x"], c_east + drift * at["wind_y"])
    u_w, v_w = to_ship(at["wind_x"], at["wind_y"])
    water = {"u": at["u"] - u_c, "v": at["v"] - v_c}
    others = {name: at[name] for name in ("r", "p", "phi", "delta", "n")}
    motion = Motion(**water, **others, u_air=at["u"] - u_w, v_air=at["v"] - v_w)
    shared: dict[str, Expression] = {}
    forces = [part.force(ship, motion, p, shared) for part in parts]
    total = [_sum(trace, (force[k] for force in forces)) for k in range(4)]
    if J_inverse is not None:
        return trace.program([_sum(trace, (J_inverse[k][j] * total[j] for j in range(4))) for k in range(4)])
    surge, sway, *rest = _accelerations(ship, motion, p, total)
    return trace.program([surge + at["r"] * v_c, sway - at["r"] * u_c, *rest])


def _sum(trace: Trace, values: Iterable[Expression | float]) -> Expression:
    total = trace.constant(0.0)
    for value in values:
        total = total + value
    return total


def _accelerations(
    ship: ShipDimensions, motion: Motion, p: Expressions, total: list[Expression]
) -> list[Expression | float]:
    m, x_G, z_G, r = ship.m, ship.x_G, ship.z_G, motion.r
    X = total[0] + m * (motion.v * r + x_G * r * r - z_G * r * motion.p)  # Eq. 18
    centripetal = m * motion.u * r
    right = [total[1] - centripetal, total[2] - x_G * centripetal]  # Eq. 19
    rows: list[list[Expression | float]] = [[m + p["m_y"], m * x_G - ship.added_mass.Yrdot]]
    rows += [[m * x_G - ship.added_mass.Nvdot, ship.I_zz + p["J_zz"]]]
    if ship.rolls:
        right.append(total[3] + z_G * centripetal)
        coupling = -m * z_G - p["m_y"] * p[SWAY_CENTRE]  # Eq. 20
        rows[0].append(coupling)
        rows[1].append(-ship.added_mass.Npdot)
        rows.append([coupling, -ship.added_mass.Krdot, ship.I_xx + p["J_xx"]])
    solution = _solve(rows, right)
    return [X / (m + p["m_x"]), *solution, *([] if ship.rolls else [0.0])]


def _solve(matrix: list[list[Expression | float]], values: list[Expression]) -> list[Expression]:
    """Solution of a small linear system by elimination, with masses and moments of inertia as pivots."""
    rows, right = [list(row) for row in matrix], list(values)
    n = len(rows)
    for k in range(n):
        for j in range(k + 1, n):
            factor = rows[j][k] / rows[k][k]
            rows[j] = [a - factor * b for a, b in zip(rows[j], rows[k], strict=True)]
            right[j] = right[j] - factor * right[k]
    solution = list(right)
    for k in range(n - 1, -1, -1):
        rest = right[k]
        for j in range(k + 1, n):
            rest = rest - rows[k][j] * solution[j]
        solution[k] = rest / rows[k][k]
    return solution
