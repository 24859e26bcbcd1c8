"""Term sets that hold up when they are trained on zigzags: compact, without free powers of the speed.

A full polynomial of a container ship has a hundred coefficients, of which a few zigzags determine a third. These sets
have about twenty: what a hull does in drift and yaw as squares (cross flow) or cubes, a rudder whose normal force grows
with the sine of its angle and more, and one even term, |r|, by which a single screw makes the sides differ. Where the
vessel states its propeller, forces scale with its loading g(u_a) and straight-line surge follows thrust and resistance,
so that a turning circle, in which the ship loses half its speed, stays within what physics allows.
"""

from __future__ import annotations

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

OWN = "own terms"
"""Name of the set that consists of the vessel file's own terms."""

_SQUARES = ("v|v|", "v|r|", "r|v|", "r|r|")
_CUBES = ("vvv", "vvr", "vrr", "rrr")


@dataclass(frozen=True)
class PartSet:
    """Parts that make all forces, and a sentence on what they stand for."""

    parts: tuple[str, ...]
    description: str


@dataclass(frozen=True)
class TermSet:
    """Terms of surge, the terms that sway and yaw share, and a sentence on what they stand for."""

    surge: tuple[str, ...]
    lateral: tuple[str, ...]
    propeller: bool
    description: str

    @property
    def coefficients(self) -> dict[str, list[str]]:
        """Names of the coefficients by degree of freedom."""
        rows = {"surge": self.surge, "sway": self.lateral, "yaw": self.lateral}
        return {dof: [f"{LETTER[dof]}{term}" for term in row] for dof, row in rows.items()}


def _loaded(hull: tuple[str, ...], description: str) -> TermSet:
    return TermSet(
        ("T", "vv", "vr", "rr", "gsinsin"), ("0", *hull, "g|r|", "gsincos", "gsincos|delta|"), True, description
    )


def _by_g(terms: tuple[str, ...]) -> tuple[str, ...]:
    return tuple(f"g{term}" for term in terms)


TERM_SETS = {
    "quadratic": TermSet(
        ("u", "vv", "vr", "rr", "sinsin"),
        ("0", "v", "r", *_SQUARES, "|r|", "sincos", "sincos|delta|", "sincosu"),
        False,
        "linear and quadratic in v and r, rudder by its sine and the speed loss",
    ),
    "cubic": TermSet(
        ("u", "vv", "vr", "rr", "sinsin"),
        ("0", "v", "r", *_CUBES, "|r|", "sincos", "sincos|delta|", "sincosu"),
        False,
        "linear and cubic in v and r, rudder by its sine and the speed loss",
    ),
    "loading": _loaded(
        _by_g(("v", "r", *_SQUARES)), "linear and quadratic in v and r, all of it by the propeller's loading"
    ),
    "hull and loading": _loaded(
        ("v", "r", *_by_g(("v", "r", *_SQUARES))), "as `loading`, with linear forces that the propeller leaves alone"
    ),
    "hull and loading, cubic": _loaded(
        ("v", "r", "gv", "gr", *_CUBES), "linear by the loading and beside it, cubic beside it"
    ),
    "hull beside loading": _loaded(
        ("v", "r", "gv", "gr", *_SQUARES), "linear by the loading and beside it, quadratic beside it"
    ),
}
"""Term sets by name."""

_BODY = (ADDED_MASS.name, PROPELLER.name, RUDDER.name)

AHEAD_SET, ANY_SPEED_SET, ROLL_SET = "modular", "modular at any speed", "modular with roll"
"""Sets for a ship that makes way ahead, for one that stops, goes astern or sails from rest, and for one that heels."""

PART_SETS = {
    AHEAD_SET: PartSet((*_BODY, MANOEUVRING.name), "MMG standard method, wake and flow straightening differ by side"),
    ANY_SPEED_SET: PartSet((*_BODY, LOW_SPEED.name), "cross-flow hull, wake and flow straightening differ by side"),
    ROLL_SET: PartSet(
        (*_BODY, MANOEUVRING.name, ROLL.name),
        "MMG standard method with roll, wake and flow straightening differ by side",
    ),
}
"""Sets of parts by name."""


def valid_at_any_speed(vessel: Vessel) -> bool:
    """Whether the forces of a vessel mean something at rest and astern, too."""
    return LOW_SPEED.name in vessel.parts


def supports_part_sets(vessel: Vessel) -> bool:
    """Whether sets of parts stand for a vessel: her draught is stated and she has no terms of roll."""
    return vessel.particulars.d > 0.0 and "roll" not in vessel.forces


def term_sets(vessel: VesselLike) -> tuple[str, ...]:
    """Names of the sets a vessel can have.

    Those of parts where it states its draught and has no terms of roll; those by the propeller's loading where it
    states its propeller, the plain ones else; before them its own terms where it has some of every degree of freedom
    and no set holds them all: then the file is a model of its own.

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
    wanted = vessel.propeller is not None
    modular = (AHEAD_SET,) if supports_part_sets(vessel) else ()
    names = (*modular, *(name for name, terms in TERM_SETS.items() if terms.propeller == wanted))
    own = {c.name for force in vessel.forces.values() for c in force}
    if vessel.modular:
        return (OWN, *names)
    if not all(vessel.forces.values()):
        return names
    held = any(own <= set().union(*TERM_SETS[name].coefficients.values()) for name in TERM_SETS)
    return names if held else (OWN, *names)


def with_terms(vessel: VesselLike, name: str) -> Vessel:
    """Vessel with the terms of a set in place of its own.

    Parameters
    ----------
    vessel : Vessel, str or Path
    name : str
        One of :data:`TERM_SETS`, or :data:`OWN` for the vessel as it is.

    Returns
    -------
    Vessel
        With the terms of surge, sway and yaw alone, or with the parts of the set beside those that stand for something
        else; a coefficient or parameter that the vessel has, too, keeps its value, its sd and its source, other
        coefficients are 0 and other parameters typical.

    Raises
    ------
    VesselError
        For an unknown set, one that needs a propeller the vessel does not state, or own terms that the file lacks.

    Examples
    --------
    >>> import pymc_ship as ps
    >>> vessel = ps.with_terms(ps.load_vessel("kvlcc2"), "loading")
    >>> print(*(coefficient.name for coefficient in vessel.forces["yaw"]))
    N0 Ngv Ngr Ngv|v| Ngv|r| Ngr|v| Ngr|r| Ng|r| Ngsincos Ngsincos|delta|
    """
    vessel = as_vessel(vessel)
    if name == OWN:
        lacking = [dof for dof, force in vessel.forces.items() if not force]
        if lacking and not vessel.modular:
            raise VesselError(
                f"The file of {vessel.name!r} has no terms of {' and '.join(lacking)}; add some, or choose another set."
            )
        return vessel
    check_choice("A term set", name, (OWN, *TERM_SETS, *PART_SETS), VesselError)
    if name in PART_SETS:
        return _with_part_set(vessel, PART_SETS[name])
    chosen = TERM_SETS[name]
    if chosen.propeller and vessel.propeller is None:
        raise VesselError(f"The terms {name!r} need the propeller of {vessel.name!r}; add the table [propeller].")
    held = {c.name: c for force in vessel.forces.values() for c in force}
    names = chosen.coefficients
    forces = {dof: tuple(held.get(name, Coefficient(name, 0.0)) for name in row) for dof, row in names.items()}
    return replace(vessel, forces=forces, parts=(), parameters=())


def _with_part_set(vessel: Vessel, chosen: PartSet) -> Vessel:
    """Vessel whose forces a set's parts make, with her own parts of other places and wind where she states areas."""
    roles = {PARTS[name].role for name in chosen.parts}
    around = [name for name in vessel.parts if PARTS[name].role not in roles]
    around += [WIND.name] if vessel.windage is not None and WIND.name not in around else []
    parts = (*chosen.parts, *around)
    bare = replace(vessel, forces=dict.fromkeys(vessel.forces, ()), parts=(), parameters=())
    known = {p.name for p in part_parameters(ship_dimensions(bare), parts)}
    return with_parts(bare, parts, {c.name: c for c in vessel.parameters if c.name in known})
