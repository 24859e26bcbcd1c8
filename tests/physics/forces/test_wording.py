"""Sentences of the errors of this wing, each checked once."""

from __future__ import annotations

import pymc_ship as ps
from pymc_ship.physics.forces.modular import PARTS, UnknownPart, order_parts
from pymc_ship.physics.forces.prime_system import scale
from tests.physics.forces.test_parts import AHEAD
from tests.sentences import wording

test_unknown_part = wording(
    UnknownPart,
    *(
        (message, lambda names=names: order_parts(names, polynomial=False))
        for names, message in [
            (["hull", "sail"], "found sail"),
            (["hull", "hull"], "each once"),
            (["hull"], "add added mass and propeller and rudder"),
            ([*AHEAD, "low-speed hull"], "one only for hull"),
        ]
    ),
    ("must be wind or constant force, found hull", lambda: order_parts(["hull", "wind"], polynomial=True)),
)

test_value_errors = wording(ValueError, ("found 'w'", lambda: scale("w", 1.0, 1.0)))

test_vessel_errors = wording(
    ps.VesselError,
    ("The name of a part must be new, found 'hull' among added mass", lambda: ps.register_part(PARTS["hull"])),
)
