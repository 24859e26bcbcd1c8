"""The kinds of manoeuvres that the package knows, by name; a new one is registered here."""

from collections.abc import Iterable

from pymc_ship.machine.errors import SimulationError
from pymc_ship.physics.manoeuvre.kinds import ManoeuvreKind
from pymc_ship.physics.manoeuvre.turning_circles import PULL_OUT, TURNING_CIRCLE
from pymc_ship.physics.manoeuvre.zigzags import ZIGZAG

RUDDER_PROGRAMME = ManoeuvreKind("rudder_programme")
"""Rudder angles at breakpoints of time; a manoeuvre without indices."""

KINDS = {kind.name: kind for kind in (ZIGZAG, TURNING_CIRCLE, PULL_OUT, RUDDER_PROGRAMME)}
"""Kinds by name, in the order of the options of the command line and in which records are recognised."""


def register_manoeuvre(kind: ManoeuvreKind) -> None:
    """Register a kind of manoeuvre.

    SimulationError for anything else, and if another kind has its name or option.
    ``del KINDS[kind.name]`` removes it again.
    """
    from pymc_ship.machine.arguments import check_kind  # with NumPy, which --help does without

    check_kind("A kind of manoeuvre", kind, ManoeuvreKind, "make one by ps.ManoeuvreKind", SimulationError)
    for known in KINDS.values():
        if kind.name == known.name or (kind.option and kind.option == known.option):
            pair = " and ".join(f"{one.name!r} with {one.option!r}" for one in (kind, known))
            raise SimulationError(f"Each kind of manoeuvre has its own name and option, found {pair}; rename one.")
    KINDS[kind.name] = kind


def kind_named(name: str) -> ManoeuvreKind:
    """The kind of this name; SimulationError where it is not registered."""
    if name not in KINDS:
        raise SimulationError(f"A manoeuvre is {either(KINDS)}; found {name!r}; register this kind.")
    return KINDS[name]


def either(names: Iterable[str]) -> str:
    """Names as alternatives: ``a zigzag, a turning circle or a pull out``."""
    *others, last = (f"{'an' if name[0] in 'aeiou' else 'a'} {name}" for name in names)
    return f"{', '.join(others)} or {last}" if others else last
