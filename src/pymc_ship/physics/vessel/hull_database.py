"""Prior of polynomial hull coefficients from :mod:`pymc_ship.physics.forces.hull_database`."""

from __future__ import annotations

from dataclasses import replace

from pymc_ship.machine.errors import VesselError
from pymc_ship.physics.forces.hull_database import SOURCE, bare_hull, cross_flow_terms, typical_rudder
from pymc_ship.physics.vessel.reading import VesselLike, as_vessel
from pymc_ship.physics.vessel.vessel import Coefficient, Vessel

STRIPS = "cross-flow drag of strips, C_D 0.8"  # source of the quadratic terms
TYPICAL_RUDDER = "typical rudder behind a single screw"  # source of convex rudder terms and even terms in the yaw rate


def hull_coefficients(vessel: VesselLike) -> dict[str, tuple[float, float]]:
    """Mean and standard deviation of the hull's coefficients by name, prime values.

    Parameters
    ----------
    vessel : Vessel, str or Path
        With a draught, else VesselError.

    Returns
    -------
    dict of str to (float, float)
        Xvv, Xvr, Xrr, and the linear and cubic coefficients in v and r of Y and N, about midship. They include the
        added mass of the steady turn (m_y v r, m_x u r). The sd of Xvv covers the term in v^4 up to v' = 0.3.

    Examples
    --------
    >>> import pymc_ship as ps
    >>> from pymc_ship.physics.vessel.hull_database import hull_coefficients
    >>> mean, sd = hull_coefficients(ps.load_vessel("kvlcc2"))["Nr"]
    >>> print(f"Nr = {mean:.4f}, sd {sd:.4f}")
    Nr = -0.0035, sd 0.0010
    """
    vessel = as_vessel(vessel)
    s = vessel.particulars
    if s.d <= 0.0:
        raise VesselError(
            f"The prior hull_database needs the draught d of {vessel.name!r}, found none; add d [m] to [particulars], "
            "or choose the prior order_damped."
        )
    return bare_hull(s.L, s.B, s.d, s.volume)


def with_hull_database(vessel: Vessel) -> Vessel:
    """Vessel with values and sds from hull database, cross-flow drag and typical rudder; VesselError without a draught.

    A coefficient with an sd in the vessel file stays unchanged. So does a linear one of sway and yaw without a partner
    by propeller loading (``gv`` of ``v``), since it contains the force of the rudder, too.
    """
    names = {c.name for force in vessel.forces.values() for c in force}
    with_rudder = {f"{letter}{term}" for letter in "YN" for term in "vr" if f"{letter}g{term}" not in names}
    hull = {name: law for name, law in hull_coefficients(vessel).items() if name not in with_rudder}
    strips = cross_flow_terms(vessel.particulars.L, vessel.particulars.d)
    return with_typical_rudder(_with_prior(_with_prior(vessel, hull, SOURCE), _with_loading(strips), STRIPS))


def with_typical_rudder(vessel: Vessel) -> Vessel:
    """Vessel with the even and convex terms of a typical rudder where it has no sd; a missing draught is L/20."""
    s = vessel.particulars
    return _with_prior(vessel, _with_loading(typical_rudder(s.L, s.d or s.L / 20.0)), TYPICAL_RUDDER)


def _with_loading(known: dict[str, tuple[float, float]]) -> dict[str, tuple[float, float]]:
    """The same laws with and without the factor g of propeller loading, which is 1 at the nominal speed."""
    return known | {f"{name[0]}g{name[1:]}": law for name, law in known.items()}


def _with_prior(vessel: Vessel, known: dict[str, tuple[float, float]], source: str) -> Vessel:
    """Vessel with values, sds and source of the known coefficients that have no sd."""

    def with_law(c: Coefficient) -> Coefficient:
        value, sd = known.get(c.name, (c.value, c.sd))
        return c if c.name not in known or c.sd > 0.0 else replace(c, value=value, sd=sd, source=source)

    return replace(vessel, forces={dof: tuple(with_law(c) for c in force) for dof, force in vessel.forces.items()})
