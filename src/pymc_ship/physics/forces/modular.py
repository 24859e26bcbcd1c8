"""Parts put together: a ship's accelerations as one program, from her parts, their parameters and her inertia.

A part made elsewhere is made known by :func:`register_part`: its parameters are then read from vessel files, estimated,
drawn and shown, and its force is simulated, differentiated and forecast like any other.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from functools import lru_cache

from pymc_ship.machine.errors import VesselError
from pymc_ship.physics.forces.expressions import Expression, Trace, cos, sin
from pymc_ship.physics.forces.hull import LOW_SPEED, MANOEUVRING, ROLL, SWAY_CENTRE
from pymc_ship.physics.forces.part import INPUTS, STATES, Force, Motion, Parameter, Part, Ship
from pymc_ship.physics.forces.programs import Program
from pymc_ship.physics.forces.rudder import RUDDER
from pymc_ship.physics.forces.screw import PROPELLER
from pymc_ship.physics.forces.surroundings import CONSTANT, CURRENT, CURRENT_COMPONENTS, WIND

_SOURCE = "vessel file or Motora's charts"
_SPREAD = {"m_x": 0.3, "m_y": 0.15, "J_zz": 0.25}  # of added masses, over their values
_ROLL_SPREAD = 0.2  # of the whole moment of inertia in roll: a radius of gyration is known to one part in ten


def _added_mass(ship: Ship) -> tuple[Parameter, ...]:
    """Added masses of a ship; those of a surface ship in two steps come within these shares of captive tests."""
    mass = ship.added_mass
    found = [("m_x", -mass.Xudot), ("m_y", -mass.Yvdot), ("J_zz", -mass.Nrdot)]
    parameters = [Parameter(name, value, _SPREAD[name] * value, _SOURCE) for name, value in found]
    if ship.rolls:
        spread = _ROLL_SPREAD * (ship.I_xx - mass.Kpdot)
        parameters.append(Parameter("J_xx", -mass.Kpdot, spread, "vessel file, or a fifth of I_xx"))
    return tuple(parameters)


def _no_force(ship: Ship, motion: Motion, p: Mapping[str, Expression], shared: dict[str, Expression]) -> Force:
    return Force()


ADDED_MASS = Part("added mass", "added masses and moments of inertia", _added_mass, _no_force, "added mass")

PARTS = {
    part.name: part for part in (ADDED_MASS, MANOEUVRING, LOW_SPEED, PROPELLER, RUDDER, ROLL, WIND, CURRENT, CONSTANT)
}
"""Parts by name, in the order in which their forces are formed: a rudder stands in the race of the propeller."""

MODULAR = ("added mass", "propeller", "rudder")
"""Parts that a ship without polynomial terms must have, besides a hull."""


Matrix = tuple[tuple[float, ...], ...]


def register_part(part: Part) -> None:
    """Make a part of a ship's force known to vessel files, the simulator, fits and forecasts, for this process.

    Parameters
    ----------
    part : Part
        Its force is formed after those of the parts that are known already.

    Raises
    ------
    VesselError
        When another part has its name.
    """
    if part.name in PARTS:
        raise VesselError(
            f"Each part has its own name, found another {part.name!r} beside {', '.join(PARTS)}; rename it."
        )
    PARTS[part.name] = part


class UnknownPart(ValueError):
    """A list of parts that makes no ship."""


def order_parts(names: Sequence[str], *, polynomial: bool) -> tuple[str, ...]:
    """Names of parts in the order in which their forces are formed.

    Raises
    ------
    UnknownPart
        For a part that is unknown or named twice, two of one place, or a set that makes no ship.
    """
    unknown = [name for name in names if name not in PARTS]
    if unknown or len(set(names)) < len(names):
        found = ", ".join(map(str, unknown or names))
        raise UnknownPart(
            f"The parts of a ship are some of {', '.join(PARTS)}, each once, found {found}; correct them."
        )
    roles = [PARTS[name].role for name in names]
    twice = sorted({role for role in roles if roles.count(role) > 1})
    lacking = [role for role in ("hull", *MODULAR) if role not in roles]
    if polynomial:
        of_waters = [name for name in names if PARTS[name].role in ("hull", *MODULAR, "roll", "current")]
        if of_waters:
            raise UnknownPart(
                f"Beside coefficients of terms stand wind and constant force alone, found {', '.join(of_waters)}; "
                "leave out the coefficients or these parts."
            )
    elif twice or lacking:
        raise UnknownPart(
            f"A ship of parts has one hull, added mass, one propeller and one rudder, found "
            f"{', '.join(names) or 'none'}; add {' and '.join(lacking) or 'one only for ' + ' and '.join(twice)}."
        )
    return tuple(name for name in PARTS if name in names)


def part_parameters(ship: Ship, names: Sequence[str]) -> tuple[Parameter, ...]:
    """Parameters of parts, part after part, with what is typical of such a ship."""
    return tuple(parameter for name in names for parameter in PARTS[name].parameters(ship))


@lru_cache(maxsize=64)
def acceleration_program(ship: Ship, parts: tuple[Part, ...], J_inverse: Matrix | None = None) -> Program:
    """Accelerations of a ship as a program.

    Parameters
    ----------
    ship : Ship
    parts : tuple of Part
        In order.
    J_inverse : tuple of four tuples of four floats, optional
        Inverse of the inertia matrix where terms make forces, too; the accelerations are then those by the parts alone.
        Without it inertia is that of the ship and of the part "added mass".

    Returns
    -------
    Program
        Rates of u, v, r and p over U_nom^2 / L (u, v) and U_nom^2 / L^2 (r, p).
    """
    trace = Trace((*STATES, *INPUTS), [parameter.name for part in parts for parameter in part.parameters(ship)])
    at, p = trace.inputs, trace.parameters
    cosine, sine = cos(at["psi"]), sin(at["psi"])

    def to_ship(north: Expression | float, east: Expression | float) -> tuple[Expression, Expression]:
        return north * cosine + east * sine, east * cosine - north * sine

    drift = p.get("k_drift", 0.0)
    current = [
        p.get(name, 0.0) + drift * at[wind] for name, wind in zip(CURRENT_COMPONENTS, ("wind_x", "wind_y"), strict=True)
    ]
    u_c, v_c = to_ship(*current)
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
    ship: Ship, motion: Motion, p: Mapping[str, Expression], total: list[Expression]
) -> list[Expression | float]:
    """Rates of the velocities through the water by forces and the motion of the body's axes."""
    m, x_G, z_G, r = ship.m, ship.x_G, ship.z_G, motion.r
    X = total[0] + m * (motion.v * r + x_G * r * r - z_G * r * motion.p)
    centripetal = m * motion.u * r
    sideways = [total[1] - centripetal, total[2] - x_G * centripetal]
    rows: list[list[Expression | float]] = [[m + p["m_y"], m * x_G - ship.added_mass.Yrdot]]
    rows += [[m * x_G - ship.added_mass.Nvdot, ship.I_zz + p["J_zz"]]]
    if ship.rolls:
        sideways.append(total[3] + z_G * centripetal)
        coupling = -m * z_G - p["m_y"] * p[SWAY_CENTRE]
        rows[0].append(coupling)
        rows[1].append(-ship.added_mass.Npdot)
        rows.append([coupling, -ship.added_mass.Krdot, ship.I_xx + p["J_xx"]])
    solved = _solved(rows, sideways)
    return [X / (m + p["m_x"]), *solved, *([] if ship.rolls else [0.0])]


def _solved(matrix: list[list[Expression | float]], values: list[Expression]) -> list[Expression]:
    """Solution of a small linear system by elimination; its pivots are masses and moments of inertia."""
    rows, right = [list(row) for row in matrix], list(values)
    n = len(rows)
    for k in range(n):
        for j in range(k + 1, n):
            factor = rows[j][k] / rows[k][k]
            rows[j] = [a - factor * b for a, b in zip(rows[j], rows[k], strict=True)]
            right[j] = right[j] - factor * right[k]
    found = list(right)
    for k in range(n - 1, -1, -1):
        rest = right[k]
        for j in range(k + 1, n):
            rest = rest - rows[k][j] * found[j]
        found[k] = rest / rows[k][k]
    return found
