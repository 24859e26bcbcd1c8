"""Parts of the force of a vessel, with typical parameters where the vessel file states none."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import asdict, replace
from typing import Any

import numpy as np

from pymc_ship.machine.errors import VesselError
from pymc_ship.physics.forces.expressions import Trace
from pymc_ship.physics.forces.hull import ROLL, nominal_resistance, thrust_deduction
from pymc_ship.physics.forces.modular import PARTS, UnknownPart, acceleration_program, order_parts, part_parameters
from pymc_ship.physics.forces.part import AddedMass, ShipDimensions
from pymc_ship.physics.forces.programs import Program
from pymc_ship.physics.forces.propeller import Propeller
from pymc_ship.physics.forces.surroundings import WIND
from pymc_ship.physics.vessel.inertia import with_stability
from pymc_ship.physics.vessel.vessel import Coefficient, Particulars, Vessel

FIXED_SD = 1e-9  # standard deviation of a parameter that is fixed at its value
_DIAMETER = 0.65  # of a propeller, over the draught
_OPEN_WATER = (0.33, -0.30, -0.13)  # of a four-bladed Wageningen propeller with a pitch of 0.75 diameters
_ETA = 0.65  # diameter of a propeller over the height of a rudder
_KAPPA = 0.55  # contraction of the slipstream
_ASPECT = 1.6  # of a rudder


def ship_dimensions(vessel: Vessel) -> ShipDimensions:
    """Dimensions that parts need, typical where the file leaves them out; VesselError without a draught."""
    s, windage = vessel.particulars, vessel.windage
    _check_draught(vessel)
    area, aspect = (vessel.rudder.area, vessel.rudder.aspect_ratio) if vessel.rudder else (_rudder_area(s), _ASPECT)
    wake = 0.5 * (s.volume / (s.L * s.B * s.d)) - 0.05
    propeller = vessel.propeller or Propeller(_DIAMETER * s.d, math.nan, wake, *_OPEN_WATER, _ETA, _KAPPA)
    ship = ShipDimensions(
        **_attributes(s, ("L", "B", "d", "volume", "nominal_speed", "GM", "BM")),
        **_attributes(propeller, ("D", "n", "k_0", "k_1", "k_2", "eta", "kappa")),
        **_attributes(vessel, ("m", "x_G", "z_G", "I_zz", "I_xx")),
        wake=propeller.wake_fraction,
        propeller_known=vessel.propeller is not None,
        rudder_area=area / s.L**2,
        rudder_known=vessel.rudder is not None,
        aspect_ratio=aspect,
        frontal=windage.frontal_area / s.L**2 if windage else 0.0,
        lateral=windage.lateral_area / s.L**2 if windage else 0.0,
        added_mass=AddedMass(**vessel.added_mass),
        GM_known="particulars.GM" not in vessel.derived,
        rolls="roll" in vessel.forces,
    )
    return ship if vessel.propeller else ship._replace(n=_revolutions(ship))


def _attributes(source: object, names: Sequence[str]) -> dict[str, Any]:
    return {name: getattr(source, name) for name in names}


def _check_draught(vessel: Vessel) -> None:
    if vessel.particulars.d <= 0.0:
        raise VesselError(f"A model of parts needs the draught d of {vessel.name!r}; add d [m] to [particulars].")


def with_parts(
    vessel: Vessel, names: Sequence[str], stated: Mapping[str, Coefficient] | None = None, fixed: Sequence[str] = ()
) -> Vessel:
    """Vessel whose forces are sums of parts; with roll, missing stability and inertia in roll are estimated.

    ``names`` are of :data:`pymc_ship.physics.forces.modular.PARTS`, ``stated`` parameters with a value of the vessel
    file (the others are typical), ``fixed`` those that are fixed at their values, if the parts have them. VesselError
    for an incomplete set of parts, wind without areas above the water, unknown parameters, or no draught.
    """
    polynomial = any(vessel.forces.values())
    try:
        names = order_parts(names, polynomial=polynomial)
    except UnknownPart as error:
        raise VesselError(f"{vessel.name!r}: {error}") from None
    if not polynomial:
        rolls = {"roll": ()} if ROLL.name in names else {}
        vessel = replace(vessel, forces={"surge": (), "sway": (), "yaw": (), **rolls})
        if rolls:
            _check_draught(vessel)
            vessel = with_stability(vessel)
    if WIND.name in names and vessel.windage is None:
        keys = "frontal_area and lateral_area [m2]"
        raise VesselError(f"The part wind needs the areas above the water of {vessel.name!r}; add {keys} to [windage].")
    typical = {p.name: Coefficient(**asdict(p)) for p in part_parameters(ship_dimensions(vessel), names)}
    stated = dict(stated or {})
    if unknown := ", ".join(name for name in stated if name not in typical):
        known = ", ".join(typical)
        raise VesselError(f"The parameters of {vessel.name!r} are {known}, found {unknown}; use these names.")
    for name, c in stated.items():
        sd = c.sd if c.sd > 0.0 else typical[name].sd
        typical[name] = replace(typical[name], value=c.value, sd=sd, source=c.source or "vessel file", note=c.note)
    for name in set(fixed) & set(typical):
        typical[name] = replace(typical[name], sd=FIXED_SD)
    return replace(vessel, parts=names, parameters=tuple(typical.values()))


_NO_PARTS = Trace((), ()).program(())


def part_program(vessel: Vessel) -> Program:
    """Program of the accelerations by the parts of a vessel; without results if it has no parts."""
    return _program(vessel, None if vessel.modular else np.linalg.inv(vessel.inertia_matrix))


def force_program(vessel: Vessel) -> Program:
    """Program of the forces X, Y, N, K of the parts, prime at the nominal speed; empty without parts."""
    return _program(vessel, np.eye(4))


def _program(vessel: Vessel, J_inverse: np.ndarray | None) -> Program:
    if not vessel.parts:
        return _NO_PARTS
    parts = tuple(PARTS[name] for name in vessel.parts)
    matrix = None if J_inverse is None else tuple(map(tuple, J_inverse.tolist()))
    return acceleration_program(ship_dimensions(vessel), parts, matrix)


def _rudder_area(s: Particulars) -> float:
    """Smallest rudder area [m2] by the rule of Det Norske Veritas, d L / 100 (1 + 25 (B / L)^2)."""
    return s.d * s.L / 100.0 * (1.0 + 25.0 * (s.B / s.L) ** 2)


def _revolutions(ship: ShipDimensions) -> float:
    """Revolutions [1/s] at which the thrust of a typical propeller equals the resistance at the nominal speed."""
    resistance, _, _ = nominal_resistance(ship)
    thrust = 0.5 * resistance * (ship.L * ship.nominal_speed) ** 2 / (1.0 - thrust_deduction(ship))
    inflow = (1.0 - ship.wake) * ship.nominal_speed
    a, b = ship.k_0 * ship.D**4, ship.k_1 * inflow * ship.D**3
    c = ship.k_2 * inflow**2 * ship.D**2 - thrust
    return (-b + math.sqrt(b * b - 4.0 * a * c)) / (2.0 * a)
