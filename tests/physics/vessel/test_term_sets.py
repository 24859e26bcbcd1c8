"""Term sets: names that can be read, a propeller where they need one, unchanged values where the vessel has them."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

import pymc_ship as ps
from pymc_ship.machine.errors import VesselError
from pymc_ship.physics.forces.terms import factors, needs_propeller
from pymc_ship.physics.vessel.term_sets import AHEAD_SET, OWN, TERM_SETS, term_sets, with_terms
from pymc_ship.physics.vessel.vessel import Coefficient, coefficient_names, reference_coefficients
from tests.sentences import refused
from tests.ships.identification.cases import TRUE_TERMS, tanker, trial

LOADED = tuple(name for name, terms in TERM_SETS.items() if terms.propeller)
PLAIN = tuple(name for name in TERM_SETS if name not in LOADED)


@pytest.mark.parametrize("name", TERM_SETS)
def test_every_term_can_be_read_and_is_there_once(name):
    chosen = TERM_SETS[name]
    for row in (chosen.surge, chosen.lateral):
        products = [tuple(sorted(factors(term))) for term in row]
        assert len(set(products)) == len(products)
    assert any(map(needs_propeller, chosen.surge + chosen.lateral)) == chosen.propeller
    assert chosen.description


def test_a_vessel_has_the_sets_by_the_loading_where_it_has_a_propeller_and_the_plain_ones_else(container):
    assert term_sets(tanker()) == (AHEAD_SET, *LOADED)
    unknown = replace(tanker(), particulars=replace(tanker().particulars, d=0.0))
    assert term_sets(unknown) == LOADED
    assert term_sets(container) == (OWN, *PLAIN)


def test_own_terms_are_tried_where_no_set_holds_them_all(container):
    """A file of particulars and one coefficient a force is no model of its own; one term more makes it one."""
    plain = with_terms(container, "quadratic")
    assert term_sets(plain) == PLAIN
    force = (*plain.forces["sway"], Coefficient("Yvphi", 0.0))
    assert term_sets(replace(plain, forces=plain.forces | {"sway": force})) == (OWN, *PLAIN)
    assert LOADED
    assert PLAIN


def test_the_own_terms_are_the_vessel():
    assert with_terms(tanker(), OWN) is tanker()


@pytest.mark.parametrize("name", LOADED)
def test_shared_coefficients_stay_and_others_are_zero(name):
    own = {c.name: c for force in tanker().forces.values() for c in force}
    vessel = with_terms(tanker(), name)
    assert vessel.terms("surge") == TERM_SETS[name].surge
    assert vessel.terms("sway") == vessel.terms("yaw") == TERM_SETS[name].lateral
    coefficients = {c.name: c for force in vessel.forces.values() for c in force}
    shared = own.keys() & coefficients.keys()
    assert len(shared) >= 9
    assert all(coefficients[coefficient] is own[coefficient] for coefficient in shared)
    others = [coefficients[coefficient] for coefficient in coefficients.keys() - shared]
    assert all(c.value == 0.0 and math.isnan(c.sd) and not c.source for c in others)
    assert bool(others) == (name != TRUE_TERMS)


def test_what_is_known_of_the_thrust_beforehand_stays():
    known = {c.name: (c.value, c.sd) for c in with_terms(tanker(), "loading").forces["surge"]}["XT"]
    assert known == (94.0e-5, 14.0e-5)


def test_a_vessel_of_its_own_terms_in_another_order_moves_alike():
    """The shipped model has the terms of one set."""
    vessel = with_terms(replace(tanker(), forces=_reversed(tanker().forces)), TRUE_TERMS)
    assert coefficient_names(vessel) == coefficient_names(tanker())
    np.testing.assert_array_equal(reference_coefficients(vessel), reference_coefficients(tanker()))
    run, own = (trial(ps.zigzag(20.0, 20.0), vessel=ship, duration=200.0) for ship in (vessel, tanker()))
    np.testing.assert_array_equal(run["psi"], own["psi"])


def _reversed(forces):
    return {dof: force[::-1] for dof, force in forces.items()}


@pytest.mark.parametrize(
    ("ship", "name"), [*(("kvlcc2", name) for name in TERM_SETS), *(("container", n) for n in PLAIN)]
)
def test_a_vessel_with_a_set_sails_in_three_degrees_of_freedom(ship, name):
    vessel = with_terms(ps.load_vessel(ship), name)
    assert vessel.dofs == ("surge", "sway", "yaw")
    run = trial(ps.zigzag(10.0, 10.0), vessel=vessel, duration=60.0)
    assert not run["diverged"]
    assert float(np.abs(run["r"]).max()) > 0.0
    assert (run["phi"] == 0.0).all()


@pytest.mark.parametrize("stated", [(), ("surge",)])
def test_a_ship_to_be_identified_has_the_sets_but_no_own_terms(container, stated):
    """Even if its file has coefficients of some forces."""
    forces = {dof: container.forces[dof] if dof in stated else () for dof in ("surge", "sway", "yaw")}
    vessel = replace(container, forces=forces)
    assert term_sets(vessel) == PLAIN
    assert with_terms(vessel, "cubic").terms("yaw") == TERM_SETS["cubic"].lateral
    with refused(VesselError, "container"):
        with_terms(vessel, OWN)
