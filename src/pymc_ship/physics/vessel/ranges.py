"""Possible and usual ranges of the numbers of a vessel file.

A number outside the possible range is an error: it breaks a law of physics or has another unit. One outside the usual
range, which holds for tugs, tankers, container ships, naval ships and their models, is doubtful.

- Froude number, block coefficient: Faltinsen (2005), Hydrodynamics of High-Speed Marine Vehicles; Ayre's line
  C_B = 1.08 - 1.68 Fn (Schneekluth & Bertram 1998, Ship Design for Efficiency and Economy).
- Steering gear: 65 deg in 28 s (SOLAS II-1/29). Radii of gyration: ITTC Recommended Procedure 7.5-02-07-02.1.
- BM = I/volume, I at most L B^3/12. Added masses: positive (Newman 1977, Marine Hydrodynamics); Motora's charts.
- Propeller: Carlton (2018), Marine Propellers and Propulsion; kappa: doi:10.1007/s00773-014-0293-y.
"""

import math
from collections.abc import Callable, Iterator
from typing import NamedTuple

from pymc_ship.machine.errors import VesselError
from pymc_ship.physics.forces.prime_system import GRAVITY
from pymc_ship.physics.forces.terms import order
from pymc_ship.physics.vessel.inertia import displaced_mass, motora_added_mass
from pymc_ship.physics.vessel.vessel import Particulars, Vessel

Range = tuple[float, float]


class Rule(NamedTuple):
    """Ranges of a number of a vessel."""

    key: str  # of the number in the vessel file
    what: str  # the number that has the ranges
    number: Callable[..., float | None] | None  # of the ship, None if undefined; None: the value of the key
    possible: Range
    usual: Range
    hint: str  # likely explanation of a wrong value


def _over(a: float, b: float) -> float:
    return a / b if b else math.inf


def _block(s: Particulars) -> float | None:
    return s.volume / (s.L * s.B * s.d) if s.d else None


def _froude(s: Particulars) -> float:
    return s.nominal_speed / math.sqrt(GRAVITY * s.L)


def _by_fullness(s: Particulars) -> float | None:
    """Speed over that of Ayre's line, with C_B at most 0.9; None for fast craft and without a draught."""
    block, froude = _block(s), _froude(s)
    return None if block is None or froude > _FASTEST else froude * 1.68 / (1.08 - min(block, 0.9))


def _rudder_travel(s: Particulars) -> float:
    return s.rudder_rate_deg * s.ship_time


def _delay(s: Particulars) -> float:
    return s.rudder_delay / s.ship_time


def _mass_ratio(v: Vessel) -> float:
    return v.m / displaced_mass(v.particulars)


def rolls(v: Vessel) -> bool:
    """Whether a vessel has the degree of freedom of roll."""
    return "roll" in v.forces


def _radius(square: float) -> float:
    return math.copysign(math.sqrt(abs(square)), square)


def _yaw_radius(v: Vessel) -> float:
    return _radius(v.I_zz / v.m - v.x_G**2)


def _roll_radius(v: Vessel) -> float | None:
    s = v.particulars
    return _radius(v.I_xx / v.m - v.z_G**2) * s.L / s.B if rolls(v) or v.I_xx else None


def _metacentre(v: Vessel) -> float | None:
    s = v.particulars
    return s.GM / s.B if rolls(v) or s.GM else None


def _waterplane(v: Vessel) -> float | None:
    s = v.particulars
    return s.BM * s.volume / (s.L * s.B * s.B * s.B) if rolls(v) or s.BM else None


def _roll_mass(v: Vessel) -> float | None:
    return -v.added_mass["Kpdot"] / v.I_xx if rolls(v) else None


def _of_motora(name: str) -> Callable[[Vessel], float | None]:
    """Added mass over that of Motora's charts; None for a hull outside the charts."""

    def number(v: Vessel) -> float | None:
        try:
            return v.added_mass[name] / motora_added_mass(v.particulars, v.m)[name]
        except VesselError:
            return None

    return number


def _coupling(name: str, rows: tuple[str, str]) -> Rule:
    """Rule of a coupling added mass: Schwarz's inequality of a positive kinetic energy."""

    def number(v: Vessel) -> float | None:
        size, mass = abs(v.added_mass[name]), {"Yvdot": v.m, "Nrdot": v.I_zz, "Kpdot": v.I_xx}
        first, second = (mass[row] - v.added_mass[row] for row in rows)
        return _over(size, math.sqrt(max(first * second, 0.0))) if size else None

    what = "its size over the root of both inertias"
    return Rule(f"added_mass.{name}", what, number, (0.0, 1.0), (0.0, 0.6), "perhaps it is over L^2 d, or in kg m")


def _advance(v: Vessel) -> float | None:
    p = v.propeller
    return None if p is None else _over((1.0 - p.wake_fraction) * v.particulars.nominal_speed, p.n * p.D)


def _thrust(v: Vessel) -> float | None:
    p, J = v.propeller, _advance(v)
    return None if p is None or J is None else p.k_0 + p.k_1 * J + p.k_2 * J * J


def _immersion(v: Vessel) -> float | None:
    return v.propeller.D / v.particulars.d if v.propeller and v.particulars.d else None


_FASTEST = 0.5  # Froude number of displacement ships
_KNOTS = math.sqrt(3600.0 / 1852.0)  # speed ratio at which a speed in knots is as likely as one in m/s

_METRES = "perhaps it is in mm, cm or feet; lengths are in m"
_PRIME = "perhaps a factor such as 1e-5 is missing, or it is in N; coefficients are prime values"
_SIGN = "perhaps it is m_x, m_y or J_z, of the other sign and over L^2 d, or in kg"
_VOLUME = "perhaps d is in cm or feet, or volume in litres; it is in m3"
_LITRE = "perhaps it is in litres or ft3; it is in m3"
_SPEED = "perhaps it is in knots, in km/h or of another scale; speeds are in m/s"
_BY_FULLNESS = "the speed over that of ships of this block coefficient"
_IN_KNOTS = "perhaps it is in knots; speeds are in m/s"
_RUDDER = "the rudder angle moved in L/U [deg]"
_RATE = "perhaps it is in rad/s, in deg/min or of another scale; it is in deg/s"
_IN_MS = "perhaps it is in ms; times are in s"
_FROM_MIDSHIP = "perhaps it is in mm, in % of L or from a perpendicular; it is in m from midship"
_MASS = "perhaps it is in kg or over L^2 d; a prime mass is 2 volume/L^3, and is derived where it is left out"
_YAW = "perhaps it is in kg m2 or over L^4 d; it is (k_zz/L)^2 m + m x_G'^2, and is derived where it is left out"
_ROLL = "perhaps it is in kg m2 or over L^4 d; it is (k_xx/L)^2 m + m z_G'^2"
_HEIGHT = "perhaps it is in mm, or its sign is wrong; it is in m"
_BM = "perhaps it is KM or GM, or in mm; BM is the waterplane's inertia over the volume, in m"
_REVOLUTIONS = "perhaps it is in revolutions a minute or of another speed; it is in 1/s"
_OPEN_WATER = "perhaps k_0, k_1, k_2, n, D and the wake are of another speed"

PARTICULARS = (
    Rule("particulars.L", "", None, (0.1, 1000.0), (0.5, 500.0), "perhaps it is in mm or km; lengths are in m"),
    Rule("particulars.B", "L/B", lambda s: _over(s.L, s.B), (1.0, 40.0), (2.0, 14.0), _METRES),
    Rule("particulars.d", "B/d", lambda s: s.B / s.d if s.d else None, (0.3, 50.0), (1.0, 12.0), _METRES),
    Rule("particulars.volume", "the block coefficient volume/(L B d)", _block, (0.1, 1.0), (0.35, 0.98), _VOLUME),
    Rule(
        "particulars.volume", "volume/(L B^2)", lambda s: s.volume / (s.L * s.B * s.B), (0.01, 2.0), (0.03, 0.7), _LITRE
    ),
    Rule("particulars.nominal_speed", "the Froude number U/sqrt(g L)", _froude, (1e-3, 3.0), (0.02, _FASTEST), _SPEED),
    Rule("particulars.nominal_speed", _BY_FULLNESS, _by_fullness, (0.0, math.inf), (0.0, _KNOTS), _IN_KNOTS),
    Rule("particulars.rudder_rate_deg", _RUDDER, _rudder_travel, (0.05, 1e5), (3.0, 1000.0), _RATE),
    Rule("particulars.rudder_delay", "the delay over L/U", _delay, (0.0, 10.0), (0.0, 1.0), _IN_MS),
    Rule("particulars.x_G", "x_G/L", lambda s: s.x_G / s.L, (-0.5, 0.5), (-0.1, 0.1), _FROM_MIDSHIP),
    Rule("particulars.z_G", "z_G/B", lambda s: s.z_G / s.B, (-1.0, 1.0), (-0.5, 0.5), _METRES),
)
"""Rules of :class:`Particulars`, each of which relies on those before it; the other rules take a :class:`Vessel`."""

INERTIA = (
    Rule("inertia.m", "m L^3/(2 volume)", _mass_ratio, (2.0 / 3.0, 1.5), (0.95, 1.05), _MASS),
    Rule("inertia.I_zz", "the radius of gyration over L", _yaw_radius, (0.1, 0.5), (0.18, 0.33), _YAW),
    Rule("inertia.I_xx", "the radius of gyration over B", _roll_radius, (0.1, 1.0), (0.25, 0.55), _ROLL),
    Rule("particulars.GM", "GM/B", _metacentre, (-1.0, 1.0), (1e-4, 0.4), _HEIGHT),
    Rule("particulars.BM", "BM volume/(L B^3)", _waterplane, (0.005, 0.1), (0.03, 1.0 / 12.0), _BM),
    Rule("added_mass.Xudot", "-Xudot/m", lambda v: -v.added_mass["Xudot"] / v.m, (1e-4, 1.0), (0.01, 0.3), _SIGN),
    Rule("added_mass.Yvdot", "-Yvdot/m", lambda v: -v.added_mass["Yvdot"] / v.m, (0.01, 8.0), (0.15, 2.5), _SIGN),
    Rule("added_mass.Nrdot", "-Nrdot/I_zz", lambda v: -v.added_mass["Nrdot"] / v.I_zz, (0.01, 8.0), (0.1, 2.5), _SIGN),
    Rule("added_mass.Yvdot", "Yvdot over that of Motora's charts", _of_motora("Yvdot"), (0.0, 20.0), (0.5, 2.0), _SIGN),
    Rule("added_mass.Nrdot", "Nrdot over that of Motora's charts", _of_motora("Nrdot"), (0.0, 20.0), (0.5, 2.0), _SIGN),
    Rule("added_mass.Kpdot", "-Kpdot/I_xx", _roll_mass, (0.0, 8.0), (0.02, 1.5), _SIGN),
    *(_coupling(name, ("Yvdot", "Nrdot")) for name in ("Yrdot", "Nvdot")),
)

ROLL_COUPLINGS = (
    *(_coupling(name, ("Yvdot", "Kpdot")) for name in ("Ypdot", "Kvdot")),
    *(_coupling(name, ("Nrdot", "Kpdot")) for name in ("Npdot", "Krdot")),
)

PROPELLER = (
    Rule("propeller.D", "D/L", lambda v: v.propeller.D / v.particulars.L, (3e-3, 0.3), (0.01, 0.12), _METRES),
    Rule("propeller.D", "D/d", _immersion, (0.0, 2.0), (0.0, 1.0), _METRES),
    Rule("propeller.wake_fraction", "", None, (-0.5, 0.95), (-0.1, 0.7), "perhaps it is in %"),
    Rule("propeller.n", "the advance ratio (1 - w) U/(n D)", _advance, (0.03, 4.0), (0.15, 1.6), _REVOLUTIONS),
    Rule("propeller.k_0", "", None, (1e-3, 3.0), (0.1, 1.2), "perhaps it is 10 K_Q or in %"),
    Rule("propeller.k_1", "", None, (-10.0, 10.0), (-1.5, 0.2), "perhaps it has lost its minus"),
    Rule("propeller.k_2", "", None, (-10.0, 10.0), (-1.0, 0.5), "perhaps it is not that of J^2"),
    Rule("propeller.k_0", "K_T at the nominal speed", _thrust, (1e-6, 3.0), (0.02, 1.0), _OPEN_WATER),
    Rule("propeller.eta", "", None, (1e-3, 1.0), (0.3, 1.0), "perhaps it is the height over the diameter"),
    Rule("propeller.kappa", "", None, (0.0, 3.0), (0.0, 1.2), "perhaps it is in %"),
)


def coefficient_rules(vessel: Vessel) -> Iterator[Rule]:
    """Rules of the coefficients: forces over rho/2 L^2 U^2 are a few hundredths for a motion of order 1."""
    for dof, force in vessel.forces.items():
        for c in force:
            usual = 1.0 if order(c.term) <= 1 else 100.0
            key = f"coefficients.{dof}.{c.name}"
            yield Rule(key, "", None, (-1e6, 1e6), (-usual, usual), _PRIME)
            if c.sd > 0.0:
                yield Rule(f"{key}.sd", "", None, (1e-15, 1e6), (1e-15, 100.0), _PRIME)
