"""Estimates from the particulars, compared with published values of a tanker."""

from __future__ import annotations

import pytest

import pymc_ship as ps
from pymc_ship.physics.vessel.inertia import displaced_mass, motora_added_mass, yaw_inertia
from tests.physics.vessel.test_ranges import SHIPS, particulars_toml
from tests.sentences import refused

PUBLISHED = {"Xudot": -0.022, "Yvdot": -0.223, "Nrdot": -0.011}
"""Of the KVLCC2 over L^2 d and L^4 d (Yasukawa & Yoshimura 2015)."""


def test_mass_and_radius_of_gyration_are_those_of_the_tanker():
    vessel = ps.load_vessel("kvlcc2")
    m = displaced_mass(vessel.particulars)
    assert m == pytest.approx(vessel.m, rel=1e-4)
    assert yaw_inertia(vessel.particulars, m) == pytest.approx(vessel.I_zz, rel=0.04)
    assert yaw_inertia(vessel.particulars, m) == pytest.approx((0.0625 + (11.136 / 320.0) ** 2) * m, rel=1e-12)


@pytest.mark.parametrize("name", PUBLISHED)
def test_added_masses_are_those_of_the_tanker(name):
    s = ps.load_vessel("kvlcc2").particulars
    estimates = motora_added_mass(s, displaced_mass(s))
    assert estimates[name] == pytest.approx(PUBLISHED[name] * s.d / s.L, rel=0.06)


def test_a_file_of_particulars_is_a_vessel_that_says_what_was_derived(tmp_path):
    path = tmp_path / "ship.toml"
    path.write_text(particulars_toml(*SHIPS["KVLCC2 tanker"]))
    vessel, added = ps.load_vessel(path), ("Xudot", "Yvdot", "Nrdot")
    assert list(vessel.derived) == ["inertia.m", "inertia.I_zz", *(f"added_mass.{name}" for name in added)]
    assert vessel.derived["inertia.m"] == "0.019081 (2 volume/L^3)"
    assert vessel.m == displaced_mass(vessel.particulars)
    assert {name: vessel.added_mass[name] for name in added} == motora_added_mass(vessel.particulars, vessel.m)
    assert {vessel.added_mass[name] for name in ("Yrdot", "Nvdot", "Kpdot")} == {0.0}
    assert vessel.dofs == ("surge", "sway", "yaw")


def test_what_is_stated_stays_and_the_rest_is_derived_from_it(tmp_path):
    path = tmp_path / "ship.toml"
    path.write_text(particulars_toml(*SHIPS["KVLCC2 tanker"]) + "[inertia]\nm = 0.0195\n[added_mass]\nYvdot = -0.015\n")
    vessel = ps.load_vessel(path)
    assert (vessel.m, vessel.added_mass["Yvdot"], vessel.I_zz) == (0.0195, -0.015, 0.0625 * 0.0195)
    assert list(vessel.derived) == ["inertia.I_zz", "added_mass.Xudot", "added_mass.Nrdot"]


@pytest.mark.parametrize(
    ("ship", "carried"),
    [((320.0, 58.0, 0.0, 312622.0, 7.97), ["Yvdot", "d"]), ((40.0, 4.0, 1.8, 130.0, 6.0), [10, 2.22, 0.451])],
)
def test_added_masses_that_cannot_be_estimated_are_required(tmp_path, ship, carried):
    path = tmp_path / "ship.toml"
    path.write_text(particulars_toml(*ship))
    with refused(ps.VesselError, str(path), *carried):
        ps.load_vessel(path)
    path.write_text(particulars_toml(*ship) + "[added_mass]\nXudot = -0.0001\nYvdot = -0.01\nNrdot = -0.0006\n")
    assert ps.load_vessel(path).added_mass["Yvdot"] == -0.01
