"""What is known of a hull before she is tried: the hull database as prior of polynomial terms.

A few zigzags tell linear from cubic forces poorly, since v follows r in all of them; the formulae of
:mod:`pymc_ship.physics.forces.hull_database` tell them apart.
"""

from __future__ import annotations

from dataclasses import replace

from pymc_ship.machine.errors import VesselError
from pymc_ship.physics.forces.hull_database import (
    SOURCE,
    STRIPS,
    TYPICAL_RUDDER,
    bare_hull,
    cross_flow_terms,
    typical_rudder,
)
from pymc_ship.physics.vessel.reading import VesselLike, as_vessel
from pymc_ship.physics.vessel.vessel import Coefficient, Vessel


def hull_coefficients(vessel: VesselLike) -> dict[str, tuple[float, float]]:
    """Mean and standard deviation of the hull's coefficients by name, prime values.

    Parameters
    ----------
    vessel : Vessel, str or Path
        L, B, draught d and volume of its particulars.

    Returns
    -------
    dict of str to (float, float)
        Of Xvv, Xvr, Xrr, and the linear and cubic coefficients in v and r of Y and N, about midship. The added mass of
        the steady turn (m_y v r, m_x u r), which the equations of motion leave to the coefficients, is in them. The
        formulae have a term in v^4 for surge that no term set has: the sd of Xvv covers it up to v' of 0.3.

    Raises
    ------
    VesselError
        When the draught is not stated.

    Examples
    --------
    What captive tests of other hulls say of a tanker's yaw damping:

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
            f"The prior from the hull database needs the draught of {vessel.name!r}; add d to [particulars], or choose "
            "the prior order_damped."
        )
    return bare_hull(s.L, s.B, s.d, s.volume)


def with_hull_database(vessel: Vessel) -> Vessel:
    """Vessel whose coefficients are known to what database, cross-flow drag and a typical rudder say.

    A coefficient of which the vessel file states an sd stays as it is; so does a linear one of sway and yaw without a
    partner by the propeller's loading (``gv`` of ``v``), since it holds the share of the rudder, too. Beside squares of
    v and r, where the formulae have cubes, a linear force is another by less than its sd.

    Raises
    ------
    VesselError
        When the draught is not stated.
    """
    names = {c.name for force in vessel.forces.values() for c in force}
    shared = {f"{letter}{term}" for letter in "YN" for term in "vr" if f"{letter}g{term}" not in names}
    hull = {name: law for name, law in hull_coefficients(vessel).items() if name not in shared}
    strips = cross_flow_terms(vessel.particulars.L, vessel.particulars.d)
    return with_typical_rudder(_informed(_informed(vessel, hull, SOURCE), _loaded(strips), STRIPS))


def with_typical_rudder(vessel: Vessel) -> Vessel:
    """Vessel whose even terms, and those by which a rudder is convex, are those of a typical rudder.

    No two zigzags tell them; coefficients of which the vessel file states an sd stay as they are. Without a draught it
    is a twentieth of the length.
    """
    s = vessel.particulars
    return _informed(vessel, _loaded(typical_rudder(s.L, s.d or s.L / 20.0)), TYPICAL_RUDDER)


def _loaded(known: dict[str, tuple[float, float]]) -> dict[str, tuple[float, float]]:
    """The same laws with and without the propeller's loading, which is 1 at the nominal speed."""
    return known | {f"{name[0]}g{name[1:]}": law for name, law in known.items()}


def _informed(vessel: Vessel, known: dict[str, tuple[float, float]], source: str) -> Vessel:
    """Vessel with value, sd and source of what is known, where she states no sd herself."""

    def informed(c: Coefficient) -> Coefficient:
        if c.name not in known or c.sd > 0.0:
            return c
        value, sd = known[c.name]
        return replace(c, value=value, sd=sd, source=source)

    return replace(vessel, forces={dof: tuple(informed(c) for c in force) for dof, force in vessel.forces.items()})
