"""Forces from coefficients in each system, by the formulae of its papers, are those of the prime system."""

from __future__ import annotations

import numpy as np
import pytest

import pymc_ship as ps
from pymc_ship.physics.forces.prime_system import GRAVITY, WATER_DENSITY
from tests.sentences import refused

V, R, DELTA = 0.8, 0.006, 0.3  # m/s, rad/s, rad


@pytest.fixture(scope="module")
def kvlcc2():
    return ps.load_vessel("kvlcc2")


def value(vessel, name, system):
    prime = vessel.coefficients({"Y": "sway", "N": "yaw"}[name[0]])
    return float(ps.rescale(prime, vessel, system).sel(coefficient=name))


@pytest.mark.parametrize(("name", "v", "r", "delta"), [("Yv", 1, 0, 0), ("Yvvr", 2, 1, 0), ("Nrrr", 0, 3, 0)])
def test_a_force_is_the_same_in_each_system(kvlcc2, name, v, r, delta):
    s = kvlcc2.particulars
    L, U, d, arm = s.L, s.nominal_speed, s.d, s.L if name[0] == "N" else 1.0
    dof = "yaw" if name[0] == "N" else "sway"
    motion = (V / U) ** v * (R * L / U) ** r * DELTA**delta
    prime = float(kvlcc2.coefficients(dof).sel(coefficient=name))
    force = 0.5 * WATER_DENSITY * L**2 * U**2 * arm * prime * motion
    mmg = 0.5 * WATER_DENSITY * L * d * U**2 * arm * value(kvlcc2, name, "mmg") * motion
    bis_motion = (V / np.sqrt(GRAVITY * L)) ** v * (R * np.sqrt(L / GRAVITY)) ** r * DELTA**delta
    bis = WATER_DENSITY * s.volume * GRAVITY * arm * value(kvlcc2, name, "bis") * bis_motion
    assert mmg == pytest.approx(force, rel=1e-12)
    assert bis == pytest.approx(force, rel=1e-12)


def test_terms_odd_in_the_rudder_change_their_sign(kvlcc2):
    prime = kvlcc2.coefficients("yaw")
    signs = np.sign(ps.rescale(prime, kvlcc2, "mmg") / prime).sel(coefficient=["Nv", "N0", "Ngsincos"])
    assert signs.values.tolist() == [1.0, 1.0, -1.0]


def test_draws_have_their_dims_and_other_input_is_refused(kvlcc2):
    prime = kvlcc2.coefficients("sway").expand_dims(chain=2, draw=3)
    assert ps.rescale(prime, "kvlcc2", "bis").sizes == prime.sizes
    for word, given, ship, system in (
        ("prime", prime, "kvlcc2", "prime"),
        ("Nx", prime.isel(coefficient=[0]).assign_coords(coefficient=["Nx"]), "kvlcc2", "bis"),
        ("'coefficient'", prime.drop_vars("coefficient"), "kvlcc2", "bis"),
        ("particulars.d", ps.load_vessel("container").coefficients("yaw"), "container", "mmg"),
    ):
        with refused(ps.VesselError, word):
            ps.rescale(given, ship, system)
