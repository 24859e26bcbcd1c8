"""Kinds of manoeuvres and their indices, as values; without numerical imports, as the command line reads them."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

from pymc_ship.machine.errors import SimulationError
from pymc_ship.machine.fields import field_text

if TYPE_CHECKING:
    from pymc_ship.physics.manoeuvre.events import Record
    from pymc_ship.physics.manoeuvre.steering_record import SteeringRecord

SIDES = {"starboard": 1.0, "port": -1.0}  # sign of the heading change towards each side
UNITS = {"angle": "deg", "drift": "deg", "roll": "deg", "time": "s", "distance": "m", "diameter": "m"}
UNITS |= {"speed": "m/s", "rate": "deg/s"}
"""Unit of each quantity that an index can be; `angle` is a change of heading, `diameter` that of a steady turn."""

TRACK_QUANTITIES = ("angle", "time", "distance", "diameter")  # quantities of heading and track
SCORED_QUANTITIES = ("angle", "time", "distance", "roll")
"""Quantities whose model error is estimated on held-out manoeuvres."""

OVERSHOOTS = ("first_overshoot_angle", "second_overshoot_angle", "third_overshoot_angle")
"""Indices that are marked in the figures of a manoeuvre that swings."""

DIMENSIONS = ("advance", "transfer", "tactical_diameter")
"""Indices that are drawn as dimension lines on the track of a manoeuvre that circles."""

TRACK = ("psi", "x", "y")  # channels that an index of the track needs
Limit = tuple[str, float, str]  # index, largest value that IMO MSC.137(76) allows, and its unit: deg or L


@dataclass(frozen=True)
class Index:
    """One index of a kind of manoeuvre.

    ``quantity`` is a key of :data:`UNITS`, ``needs`` are the channels. A ``scored`` index, of
    :data:`SCORED_QUANTITIES`, is compared on held-out runs; a ``signed`` one can be negative.
    """

    quantity: str
    needs: tuple[str, ...] = ("psi",)
    scored: bool = False
    signed: bool = False

    def __post_init__(self) -> None:
        known = SCORED_QUANTITIES if self.scored else tuple(UNITS)
        if self.quantity not in known:
            what = "A scored index" if self.scored else "An index"
            raise SimulationError(f"{what} is of {', '.join(known)}; found {self.quantity!r}; choose one of them.")

    @property
    def units(self) -> str:
        """Unit of the values."""
        return UNITS[self.quantity]


def _no_indices(record: Record, attrs: Mapping[str, Any]) -> dict[str, float]:
    return {}


def _no_limits(attrs: Mapping[str, Any], ratio: float) -> Sequence[Limit]:
    return ()


@dataclass(frozen=True)
class ManoeuvreKind:
    """A kind of manoeuvre: options, indices, limits and recognition.

    Attributes
    ----------
    name, example : str
        As in ``attrs["manoeuvre"]`` of a record, ``turning_circle``; its angles as they are written, ``20/20``.
    angles : tuple of str
        Angles of a :class:`pymc_ship.Manoeuvre` that are written with it: ``rudder_deg``, ``heading_deg`` or both.
    option, title : str
        Option of the command line, ``turn`` for ``--turn``, empty for none; title in its help.
    second_execute_factor : float or None
        Factor on the rudder angle at a change of heading by ``heading_deg``: -1 reverses, 0 puts amidships, None: none.
    indices : mapping of str to Index
    measure : callable
        Indices by name, from a :class:`pymc_ship.physics.manoeuvre.events.Record` and its attrs.
    limits : callable
        Limits of IMO MSC.137(76) that apply, from the attrs and L over the approach speed [s].
    recognise : callable or None
        Angles and side from a :class:`pymc_ship.physics.manoeuvre.steering_record.SteeringRecord`, or None; without
        this function, the kind is not recognised in records.
    reach : float
        How long a forecast simulates the manoeuvre by default [L/U].
    swings, circles : bool
        Whether figures show :data:`OVERSHOOTS` on an axis of heading and rudder, or :data:`DIMENSIONS` on the track.
    """

    name: str
    angles: tuple[str, ...] = ()
    example: str = ""
    option: str = ""
    title: str = ""
    second_execute_factor: float | None = None
    indices: Mapping[str, Index] = field(default_factory=dict)
    measure: Callable[[Record, Mapping[str, Any]], dict[str, float]] = _no_indices
    limits: Callable[[Mapping[str, Any], float], Sequence[Limit]] = _no_limits
    recognise: Callable[[SteeringRecord], tuple[tuple[float, ...], str] | None] | None = None
    reach: float = 40.0
    swings: bool = False
    circles: bool = False

    def __post_init__(self) -> None:
        drawn = (OVERSHOOTS if self.swings else ()) + (DIMENSIONS if self.circles else ())
        lacking = [name for name in drawn if name not in self.indices]
        if lacking:
            raise SimulationError(f"The figures of a {self.words} show its {lacking[0]}; add this index.")
        if self.option and not (self.angles and self.example and self.title):
            raise SimulationError(f"The option --{self.option} needs angles, an example and a title; give all of them.")
        if self.recognise and not self.indices:
            raise SimulationError(f"A {self.words} that is recognised is compared by its indices, found none; add one.")
        if self.second_execute_factor is not None and "heading_deg" not in self.angles:
            raise SimulationError(f"The rudder of a {self.words} is moved at a heading; add heading_deg to its angles.")

    def __repr__(self) -> str:
        return field_text(self)

    @property
    def words(self) -> str:
        """Name in words: ``turning circle``."""
        return self.name.replace("_", " ")

    @property
    def metavar(self) -> str:
        """Names of the angles in help: ``RUDDER/HEADING``."""
        return "/".join(angle.removesuffix("_deg").upper() for angle in self.angles)

    @property
    def scored(self) -> tuple[str, ...]:
        """Names of the indices that are compared on held-out runs."""
        return tuple(name for name, index in self.indices.items() if index.scored)
