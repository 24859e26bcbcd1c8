"""What the hull database says of a ship, against captive tests of the KVLCC2 and by its own rules."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from benchmarks import kvlcc2
from pymc_ship.physics.forces.hull_database import SOURCE, cross_flow_terms
from pymc_ship.physics.vessel.hull_database import (
    STRIPS,
    TYPICAL_RUDDER,
    hull_coefficients,
    with_hull_database,
    with_typical_rudder,
)
from pymc_ship.physics.vessel.term_sets import TERM_SETS, with_terms
from pymc_ship.physics.vessel.vessel import LETTER, Coefficient
from tests.ships.identification.cases import tanker

CAPTIVE = {LETTER[dof] + term: value for dof, row in kvlcc2.HULL.items() for term, value in row.items()}
CAPTIVE |= {"Xvr": CAPTIVE["Xvr"] + kvlcc2.ADDED["y"], "Yr": CAPTIVE["Yr"] - kvlcc2.ADDED["x"]}
del CAPTIVE["X0"], CAPTIVE["Xvvvv"]
"""Yasukawa & Yoshimura (2015) over rho/2 L d U^2, with m_y' v r and m_x' u r, which they list separately."""

BY_DRAUGHT = 20.8 / 320.0


def distances(known, captive=CAPTIVE):
    """Of the captive tests from the formulae, in standard deviations."""
    return {name: (value * BY_DRAUGHT - known[name][0]) / known[name][1] for name, value in captive.items()}


def coefficients(vessel):
    return {c.name: c for force in vessel.forces.values() for c in force}


class TestFormulae:
    def test_captive_tests_of_a_tanker_are_as_far_away_as_stated(self):
        sd_distances = distances(hull_coefficients(tanker()))
        assert sd_distances.keys() == hull_coefficients(tanker()).keys()
        assert sd_distances.pop("Yvvr") == pytest.approx(1.9, abs=0.05)
        assert max(map(abs, sd_distances.values())) < 1.2
        assert np.mean(np.square(list(sd_distances.values()))) > 0.15

    @pytest.mark.parametrize("name", ["Xvr", "Yv", "Yr", "Yvvv", "Yvrr", "Nv", "Nr", "Nvvr"])
    def test_a_wrong_sign_would_be_seen(self, name):
        """Broken twin."""
        known = hull_coefficients(tanker())
        assert abs(distances(known | {name: (-known[name][0], known[name][1])})[name]) > 2.0

    def test_those_of_a_fine_hull_worked_by_hand(self):
        """C_B = 0.5, L/B = 5, d/L = 0.05; over rho/2 L d U^2."""
        fine = replace(tanker().particulars, L=100.0, B=20.0, d=5.0, volume=5000.0)
        known = hull_coefficients(replace(tanker(), particulars=fine))
        means = [known[name][0] / 0.05 for name in CAPTIVE]
        surge, sway = [-0.065, 0.111, -0.0005], [-0.29708, 0.05, -1.405, -0.75, -0.76, -0.051]
        assert means == pytest.approx([*surge, *sway, -0.1, -0.044, -0.315, -0.605, 0.0, -0.031], abs=1e-6)

    def test_ships_of_one_form_have_the_same_prime_values(self):
        s = tanker().particulars
        model = replace(s, L=s.L / 50, B=s.B / 50, d=s.d / 50, x_G=s.x_G / 50, volume=s.volume / 50**3)
        small, large = hull_coefficients(replace(tanker(), particulars=model)), hull_coefficients(tanker())
        for name, moments in large.items():
            assert small[name] == pytest.approx(moments, rel=1e-12)


class TestInformedVessel:
    @pytest.mark.parametrize("name", [name for name, terms in TERM_SETS.items() if terms.propeller])
    def test_what_the_hull_alone_bears_is_known(self, name):
        plain, known = with_terms(tanker(), name), hull_coefficients(tanker())
        with_prior = coefficients(with_hull_database(plain))
        for key, c in coefficients(plain).items():
            if key in known:
                assert (with_prior[key].value, with_prior[key].sd, with_prior[key].source) == (*known[key], SOURCE)
            elif with_prior[key].source not in (STRIPS, TYPICAL_RUDDER):
                assert with_prior[key] is c
        count = 15 if "Yvvv" in with_prior else 7 if "Yv" in with_prior else 3
        assert sum(c.source == SOURCE for c in with_prior.values()) == count
        assert sum(c.source == STRIPS for c in with_prior.values()) == (0 if "Yvvv" in with_prior else 8)
        assert sum(c.source == TYPICAL_RUDDER for c in with_prior.values()) == 4

    def test_squares_damp_to_two_sd_with_and_without_the_loading(self):
        inside, separate = (
            coefficients(with_hull_database(with_terms(tanker(), name))) for name in ("loading", "hull beside loading")
        )
        for name in ("Yv|v|", "Yv|r|", "Nr|v|", "Nr|r|"):
            c = separate[name]
            assert c.value < -1.8 * c.sd < 0.0
            assert inside[f"{name[0]}g{name[1:]}"] == replace(c, name=f"{name[0]}g{name[1:]}")

    def test_squares_are_those_of_strips_of_a_hull(self):
        """(v + x r)|v + x r| over the length, and its slope by the smaller of v and r."""
        L, d = tanker().particulars.L, tanker().particulars.d
        x = (np.arange(20000) + 0.5) / 20000 - 0.5

        def forces(v, r):
            drag = -0.8 * d / L * (v + x * r) * np.abs(v + x * r)
            return {"Y": drag.mean(), "N": (x * drag).mean()}

        h, terms = 1e-4, cross_flow_terms(L, d)
        for letter in "YN":
            assert terms[f"{letter}v|v|"][0] == pytest.approx(forces(1.0, 0.0)[letter], abs=1e-9)
            assert terms[f"{letter}r|r|"][0] == pytest.approx(forces(0.0, 1.0)[letter], abs=1e-9)
            by_r = (forces(1.0, h)[letter] - forces(1.0, -h)[letter]) / (2.0 * h)
            by_v = (forces(h, 1.0)[letter] - forces(-h, 1.0)[letter]) / (2.0 * h)
            assert terms[f"{letter}r|v|"][0] == pytest.approx(by_r, abs=1e-6)
            assert terms[f"{letter}v|r|"][0] == pytest.approx(by_v, abs=1e-6)

    def test_a_typical_rudder_is_known_without_a_draught(self):
        """Of even terms and of those that are convex: those of a ship with a draught of a twentieth of its length."""
        name = "hull and loading, cubic"
        bare = replace(with_terms(tanker(), name), particulars=replace(tanker().particulars, d=0.0))
        usual = replace(bare, particulars=replace(bare.particulars, d=bare.particulars.L / 20.0))
        of_bare, of_usual = coefficients(with_typical_rudder(bare)), coefficients(with_typical_rudder(usual))
        assert of_bare == of_usual
        known = {key: c for key, c in of_bare.items() if c.source == TYPICAL_RUDDER}
        assert set(known) == {"Yg|r|", "Ygsincos|delta|", "Ng|r|", "Ngsincos|delta|"}
        assert known["Ygsincos|delta|"].value == pytest.approx(0.3 * 0.066 / 20.0)
        assert known["Ngsincos|delta|"].value == pytest.approx(-0.3 * 0.033 / 20.0)

    def test_what_the_file_knows_stays(self):
        stated = replace(
            tanker(), forces=tanker().forces | {"yaw": (Coefficient("Nr", -0.003, sd=1e-4), Coefficient("Ngr", 0.0))}
        )
        with_prior = coefficients(with_hull_database(stated))
        assert with_prior["Nr"].value == -0.003
        assert with_prior["XT"] == coefficients(tanker())["XT"]

    def test_a_linear_force_that_holds_the_rudder_s_share_stays_unknown(self):
        with_prior = coefficients(with_hull_database(with_terms(tanker(), "cubic")))
        assert {key for key, c in with_prior.items() if c.source == SOURCE} == {
            *("Xvv", "Xvr", "Xrr"),
            *(f"{letter}{term}" for letter in "YN" for term in ("vvv", "vvr", "vrr", "rrr")),
        }

    def test_once_more_changes_nothing(self):
        once = with_hull_database(tanker())
        assert with_hull_database(once) == once
