"""Sentences of the errors of this wing, each checked once."""

from __future__ import annotations

from dataclasses import replace
from functools import partial

import numpy as np

import pymc_ship as ps
from pymc_ship.machine.errors import VesselError
from pymc_ship.physics.vessel.hull_database import with_hull_database
from pymc_ship.physics.vessel.reading import SHIPPED
from pymc_ship.physics.vessel.term_sets import OWN, with_terms
from pymc_ship.physics.vessel.vessel import check_same_vessel
from tests.physics.vessel.test_parts import PARTICULARS, PARTS, PROPELLER, vessel
from tests.physics.vessel.test_ranges import SHIPS, particulars_toml
from tests.physics.vessel.test_term_sets import LOADED
from tests.sentences import wording
from tests.ships.identification.cases import tanker

TANKER = (SHIPPED / "kvlcc2.toml").read_text()


def loaded(tmp_path, text):
    path = tmp_path / "ship.toml"
    path.write_text(text)
    return ps.load_vessel(path)


test_vessel_errors = wording(
    VesselError,
    (
        "^The forecast must be of the vessel 'kvlcc2', found 'container' in x; give its own vessel",
        lambda: check_same_vessel("The forecast", {"vessel": "container"}, tanker(), " in x"),
    ),
    (
        r"coefficients\.yaw must have each term once, found Nv[rv]+, which is the term of Nv[rv]+; write one of them",
        lambda tmp_path: loaded(tmp_path, TANKER.replace("[coefficients.yaw]", "[coefficients.yaw]\nNvrv = 0.0")),
    ),
    (
        r"^The prior hull_database needs the draught d of 'kvlcc2', found none; add d",
        lambda: with_hull_database(replace(tanker(), particulars=replace(tanker().particulars, d=0.0))),
    ),
    *(
        (sentence, partial(loaded, text=particulars_toml(*ship)))
        for ship, sentence in [
            ((320.0, 58.0, 0.0, 312622.0, 7.97), "lacks Xudot, Yvdot, Nrdot. .* need the draught d, found none; add d"),
            ((40.0, 4.0, 1.8, 130.0, 6.0), "no hull with L/B = 10, B/d = 2.22 and a block coefficient of 0.451"),
        ]
    ),
    *(
        (
            r"particulars\.L = .*, which must lie between 0\.1 and 1000",
            partial(loaded, text=particulars_toml(length, *SHIPS["KVLCC2 tanker"][1:])),
        )
        for length in [0.0, 1e-200, 1e308]
    ),
    *(
        (message, lambda tmp_path, head=head, tail=tail: vessel(tmp_path, head=head, tail=tail))
        for head, tail, message in [
            ('parts = ["hull"]\n', PROPELLER, "add added mass and propeller and rudder"),
            ('parts = ["keel"]\n', PROPELLER, "found keel"),
            ('parts = "hull"\n', PROPELLER, "must be a list of texts"),
            (PARTS[:-2] + ', "wind"]\n', PROPELLER, "needs the areas above the water"),
            (PARTS, f"{PROPELLER}[parameters]\nK_T = 1.0\n", "The parameters of .* are .*, found K_T; use"),
            (PARTS, f"{PROPELLER}[parameters]\nw0 = {{ value = 0.3, sd = -1.0 }}\n", "must be positive"),
            (PARTS, f"{PROPELLER}[rudder]\narea = -3.0\naspect_ratio = 1.8\n", "must be positive, found -3"),
            (PARTS, f"{PROPELLER}[rudder]\narea = 100.0\n", "aspect_ratio is missing"),
        ]
    ),
    (r"needs the draught|Motora", lambda tmp_path: vessel(tmp_path, particulars=PARTICULARS.replace("d = 20.8\n", ""))),
    ("surge, sway, yaw, found 'roll'", lambda: ps.load_vessel("kvlcc2").coefficients("roll")),
    (r"container.*found 'tanker'", lambda: ps.load_vessel("tanker")),
    *(
        (
            rf"^The terms '{name}' need a propeller of 'container', found none; add .*\.$",
            lambda container, name=name: with_terms(container, name),
        )
        for name in LOADED
    ),
    (
        r"^A term set is one of own terms, quadratic, .*; found 'quartic' \(did you mean quadratic\?\); choose",
        lambda: with_terms(tanker(), "quartic"),
    ),
    (
        r"The set 'own terms' needs terms of .*sway and yaw of 'container', found none; add them",
        lambda container: with_terms(replace(container, forces=dict.fromkeys(("surge", "sway", "yaw"), ())), OWN),
    ),
    (
        "yaw of 'container' has 28 coefficients, found 3 values",
        lambda container: container.with_coefficients({"yaw": np.zeros(3)}),
    ),
    (
        "The model of 'container' needs coefficients of sway, found none; identify them with ",
        lambda container: replace(container, forces=container.forces | {"sway": ()}).terms("sway"),
    ),
)
