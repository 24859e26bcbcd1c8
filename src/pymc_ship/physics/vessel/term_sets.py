"""Term sets for an identification from a few zigzags: about twenty terms, without free powers of the speed.

Hull forces are linear and quadratic or cubic in v and r; the even term |r| is the asymmetry of a single screw. With a
propeller, forces scale with its loading g(u_a), so that the model extrapolates to the speed loss of a turn.
"""

from dataclasses import dataclass, replace

from pymc_ship.machine.arguments import check_choice
from pymc_ship.machine.errors import VesselError
from pymc_ship.physics.forces.hull import LOW_SPEED, MANOEUVRING, ROLL
from pymc_ship.physics.forces.modular import ADDED_MASS, PARTS, part_parameters
from pymc_ship.physics.forces.rudder import RUDDER
from pymc_ship.physics.forces.screw import PROPELLER
from pymc_ship.physics.forces.surroundings import WIND
from pymc_ship.physics.vessel.parts import ship_dimensions, with_parts
from pymc_ship.physics.vessel.reading import VesselLike, as_vessel
from pymc_ship.physics.vessel.vessel import LETTER, Coefficient, Vessel

OWN = "own terms"  # name of the set of the terms in the vessel file
_SQUARES = ("v|v|", "v|r|", "r|v|", "r|r|")
_CUBES = ("vvv", "vvr", "vrr", "rrr")


@dataclass(frozen=True)
class PartSet:
    """Parts of all forces, with a description."""

    parts: tuple[str, ...]
    description: str


@dataclass(frozen=True)
class TermSet:
    """Terms of surge, common terms of sway and yaw, and a description."""

    surge: tuple[str, ...]
    lateral: tuple[str, ...]
    propeller: bool
    description: str

    @property
    def coefficients(self) -> dict[str, list[str]]:
        """Names of the coefficients by degree of freedom."""
        rows = {"surge": self.surge, "sway": self.lateral, "yaw": self.lateral}
        return {dof: [f"{LETTER[dof]}{term}" for term in row] for dof, row in rows.items()}


def _without_propeller(hull: tuple[str, ...], description: str) -> TermSet:
    lateral = ("0", "v", "r", *hull, "|r|", "sincos", "sincos|delta|", "sincosu")
    description = f"{description}, rudder by its sine and the speed loss"
    return TermSet(("u", "vv", "vr", "rr", "sinsin"), lateral, False, description)


def _with_loading(hull: tuple[str, ...], description: str) -> TermSet:
    lateral = ("0", *hull, "g|r|", "gsincos", "gsincos|delta|")
    return TermSet(("T", "vv", "vr", "rr", "gsinsin"), lateral, True, description)


_LINEAR = ("v", "r", "gv", "gr")
_LOADED = ("gv", "gr", *(f"g{term}" for term in _SQUARES))

TERM_SETS = {
    "quadratic": _without_propeller(_SQUARES, "linear and quadratic in v and r"),
    "cubic": _without_propeller(_CUBES, "linear and cubic in v and r"),
    "loading": _with_loading(_LOADED, "linear and quadratic in v and r, all of it by the propeller's loading"),
    "hull and loading": _with_loading(("v", "r", *_LOADED), "as `loading`, and linear without loading"),
    "hull and loading, cubic": _with_loading((*_LINEAR, *_CUBES), "linear with and without loading, cubic without"),
    "hull beside loading": _with_loading((*_LINEAR, *_SQUARES), "linear with and without loading, quadratic without"),
}

_BODY = (ADDED_MASS.name, PROPELLER.name, RUDDER.name)

AHEAD_SET, ANY_SPEED_SET, ROLL_SET = "modular", "modular at any speed", "modular with roll"
"""Sets for ahead speeds, for all speeds (stopping, astern, from rest), and for ahead speeds with roll."""

_ROLL_TEXT = "MMG standard method with roll, wake and flow straightening differ by side"

PART_SETS = {
    AHEAD_SET: PartSet((*_BODY, MANOEUVRING.name), "MMG standard method, wake and flow straightening differ by side"),
    ANY_SPEED_SET: PartSet((*_BODY, LOW_SPEED.name), "cross-flow hull, wake and flow straightening differ by side"),
    ROLL_SET: PartSet((*_BODY, MANOEUVRING.name, ROLL.name), _ROLL_TEXT),
}


def valid_at_any_speed(vessel: Vessel) -> bool:
    """Whether the forces of a vessel are valid at rest and astern, too."""
    return LOW_SPEED.name in vessel.parts


def supports_part_sets(vessel: Vessel) -> bool:
    """Whether part sets suit a vessel: it has a draught and no terms of roll."""
    return vessel.particulars.d > 0.0 and "roll" not in vessel.forces


def term_sets(vessel: VesselLike) -> tuple[str, ...]:
    """Names of the term sets that suit a vessel.

    Own terms come first if no set contains them all. Part sets need a draught and no terms of roll; sets with loading
    need a propeller, the others have none.

    Examples
    --------
    >>> import pymc_ship as ps
    >>> for name in ps.term_sets(ps.load_vessel("kvlcc2")):
    ...     print(name)
    modular
    loading
    hull and loading
    hull and loading, cubic
    hull beside loading
    """
    vessel = as_vessel(vessel)
    propelled = vessel.propeller is not None
    names = tuple(name for name, terms in TERM_SETS.items() if terms.propeller == propelled)
    names = (AHEAD_SET, *names) if supports_part_sets(vessel) else names
    own = {c.name for force in vessel.forces.values() for c in force}
    if vessel.modular:
        return (OWN, *names)
    if not all(vessel.forces.values()):
        return names
    covered = any(own <= set().union(*TERM_SETS[name].coefficients.values()) for name in TERM_SETS)
    return names if covered else (OWN, *names)


def with_terms(vessel: VesselLike, name: str) -> Vessel:
    """Vessel with the terms of a set.

    Parameters
    ----------
    vessel : Vessel, str or Path
    name : str
        One of :data:`TERM_SETS` or :data:`PART_SETS`, or :data:`OWN` for the unchanged vessel.

    Returns
    -------
    Vessel
        With terms of surge, sway and yaw only, or the parts of the set and own parts of other roles. Coefficients and
        parameters of the vessel keep value, sd and source; other coefficients are 0, other parameters typical.

    Raises
    ------
    VesselError
        For an unknown set, a set that needs a missing propeller, or missing own terms.

    Examples
    --------
    >>> import pymc_ship as ps
    >>> vessel = ps.with_terms(ps.load_vessel("kvlcc2"), "loading")
    >>> print(*(coefficient.name for coefficient in vessel.forces["yaw"]))
    N0 Ngv Ngr Ngv|v| Ngv|r| Ngr|v| Ngr|r| Ng|r| Ngsincos Ngsincos|delta|
    """
    vessel = as_vessel(vessel)
    check_choice("A term set", name, (OWN, *TERM_SETS, *PART_SETS), VesselError)
    if name == OWN:
        missing = [dof for dof, force in vessel.forces.items() if not force]
        if missing and not vessel.modular:
            raise VesselError(
                f"The set {OWN!r} needs terms of {' and '.join(missing)} of {vessel.name!r}, found none; add "
                "them, or choose another set."
            )
        return vessel
    if name in PART_SETS:
        return _with_part_set(vessel, PART_SETS[name])
    chosen = TERM_SETS[name]
    if chosen.propeller and vessel.propeller is None:
        raise VesselError(f"The terms {name!r} need a propeller of {vessel.name!r}, found none; add [propeller].")
    own = {c.name: c for force in vessel.forces.values() for c in force}
    rows = chosen.coefficients.items()
    forces = {dof: tuple(own.get(name, Coefficient(name, 0.0)) for name in row) for dof, row in rows}
    return replace(vessel, forces=forces, parts=(), parameters=())


def _with_part_set(vessel: Vessel, chosen: PartSet) -> Vessel:
    """Vessel with the parts of a set, its own parts of other roles, and wind if it states areas."""
    roles = {PARTS[name].role for name in chosen.parts}
    others = [name for name in vessel.parts if PARTS[name].role not in roles]
    others += [WIND.name] if vessel.windage is not None and WIND.name not in others else []
    parts = (*chosen.parts, *others)
    bare = replace(vessel, forces=dict.fromkeys(vessel.forces, ()), parts=(), parameters=())
    known = {p.name for p in part_parameters(ship_dimensions(bare), parts)}
    return with_parts(bare, parts, {c.name: c for c in vessel.parameters if c.name in known})
