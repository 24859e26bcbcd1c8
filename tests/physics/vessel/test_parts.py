"""Parts in a vessel file: what is read, what is typical, what is refused."""

from __future__ import annotations

import math

import pytest

import pymc_ship as ps
from pymc_ship.physics.vessel.parts import FIXED_SD, ship_dimensions
from pymc_ship.physics.vessel.term_sets import ANY_SPEED_SET, OWN, PART_SETS, term_sets, with_terms
from pymc_ship.physics.vessel.vessel import coefficient_names

PARTICULARS = """
[particulars]
L = 320.0
B = 58.0
d = 20.8
volume = 312622.0
nominal_speed = 7.974
rudder_rate_deg = 2.35
x_G = 11.136
"""
PROPELLER = """
[propeller]
D = 9.326
n = 1.513
wake_fraction = 0.4
k_0 = 0.335
k_1 = -0.27
k_2 = 0.0
eta = 0.59
kappa = 0.5
"""
PARTS = 'parts = ["added mass", "hull", "propeller", "rudder"]\n'


def vessel(tmp_path, head=PARTS, tail=PROPELLER, particulars=PARTICULARS):
    path = tmp_path / "ship.toml"
    path.write_text(f'name = "tanker"\n{head}{particulars}{tail}', encoding="utf-8")
    return ps.load_vessel(path)


def test_parts_make_a_ship_without_coefficients(tmp_path):
    ship = vessel(tmp_path)
    assert ship.modular
    assert ship.parts == ("added mass", "hull", "propeller", "rudder")
    assert ship.terms("sway") == ()
    assert len(coefficient_names(ship)) == len(ship.parameters) > 30
    assert all(c.sd > 0.0 and c.source and c.unit for c in ship.parameters)
    assert "parts: added mass, hull, propeller, rudder" in repr(ship)


def test_a_stated_parameter_goes_before_what_is_typical(tmp_path):
    tail = f'{PROPELLER}[parameters]\ngamma_R = {{ value = 0.5, sd = 0.01, source = "captive test" }}\nl_R = -0.7\n'
    by_name = {c.name: c for c in vessel(tmp_path, tail=tail).parameters}
    assert (by_name["gamma_R"].value, by_name["gamma_R"].sd, by_name["gamma_R"].source) == (0.5, 0.01, "captive test")
    assert (by_name["l_R"].value, by_name["l_R"].sd, by_name["l_R"].source) == (-0.7, 0.2, "vessel file")


def test_without_a_propeller_a_typical_one_holds_the_resistance_in_balance(tmp_path):
    ship = ship_dimensions(vessel(tmp_path, tail=""))
    J = (1.0 - ship.wake) * ship.nominal_speed / (ship.n * ship.D)
    K_T = ship.k_0 + ship.k_1 * J + ship.k_2 * J * J
    thrust = 2.0 * ship.n**2 * ship.D**4 * K_T / (ship.L * ship.nominal_speed) ** 2
    known = {c.name: c for c in vessel(tmp_path, tail="").parameters}
    assert (1.0 - (0.5 * ship.block - 0.12)) * thrust == pytest.approx(known["R0"].value, rel=1e-9)
    assert not ship.propeller_known
    stated = {c.name: c for c in vessel(tmp_path).parameters}
    assert known["w0"].sd > stated["w0"].sd
    assert known["R0"].sd / known["R0"].value > stated["R0"].sd / stated["R0"].value


def test_an_unknown_rudder_is_known_less_well(tmp_path):
    stated = vessel(tmp_path, tail=f"{PROPELLER}[rudder]\narea = 112.5\naspect_ratio = 1.827\n")
    slope, typical = (next(c for c in ship.parameters if c.name == "f_alpha") for ship in (stated, vessel(tmp_path)))
    assert slope.value == pytest.approx(6.13 * 1.827 / (2.25 + 1.827))
    assert slope.sd / slope.value < 0.5 * typical.sd / typical.value


@pytest.mark.parametrize("name", PART_SETS)
def test_a_set_of_parts_leaves_open_what_the_records_cannot_tell(tmp_path, name):
    """One run does not tell a wake by side from a flow straightening by side: both are open, as far as priors go."""
    ship = with_terms(vessel(tmp_path, head=""), name)
    assert min(ship.parameters, key=lambda c: c.sd).sd > FIXED_SD
    assert {"dC2", "dgamma_R"} < {c.name for c in ship.parameters}
    assert ("low-speed hull" in ship.parts) == (name == ANY_SPEED_SET)


def test_windage_brings_the_wind(tmp_path):
    tail = f"{PROPELLER}[windage]\nfrontal_area = 1200.0\nlateral_area = 3600.0\n"
    assert "wind" in with_terms(vessel(tmp_path, head="", tail=tail), "modular").parts


def test_numbers_of_a_typical_ship_are_finite(tmp_path):
    assert all(math.isfinite(c.value) and math.isfinite(c.sd) for c in vessel(tmp_path, tail="").parameters)


def test_a_set_of_terms_has_no_parts_beside_it(tmp_path):
    """The forces of a hull by terms and by parts would count twice."""
    ship = with_terms(vessel(tmp_path), "loading")
    assert (ship.parts, ship.parameters) == ((), ())
    assert ship.terms("yaw")


@pytest.mark.parametrize("name", PART_SETS)
@pytest.mark.parametrize("hull", ["hull", "low-speed hull"])
def test_a_set_of_parts_takes_the_place_of_those_of_the_file(tmp_path, hull, name):
    """Parameters of the parts in both sets keep the values of the file; those of the other hull are dropped."""
    tail = f"{PROPELLER}[parameters]\ngamma_R = {{ value = 0.5, sd = 0.01 }}\n"
    stated = vessel(tmp_path, head=PARTS.replace('"hull"', f'"{hull}"').replace("]", ', "constant force"]'), tail=tail)
    ship = with_terms(stated, name)
    assert {c.name: c.value for c in ship.parameters}["gamma_R"] == 0.5
    assert "constant force" in ship.parts
    assert len([part for part in ship.parts if "hull" in part]) == 1


def test_a_ship_of_parts_is_also_identified_with_its_own_parts(tmp_path):
    ship = vessel(tmp_path)
    assert term_sets(ship)[0] == OWN
    assert with_terms(ship, OWN) is ship
