"""Captive tests beside trials: the identification keeps them, and their comparison is made when a page asks for it."""

from __future__ import annotations

import numpy as np
import pytest

import pymc_ship as ps
from pymc_ship.inference.captive.comparison import comparison_rows
from pymc_ship.physics.vessel.vessel import reference_coefficients
from pymc_ship.ships.identification.model import captive_comparison
from tests.inference.captive.test_fit import PARTS, program
from tests.ships.identification.cases import tanker, trials


@pytest.fixture(scope="module")
def tests():
    vessel = ps.with_terms(tanker(), PARTS)
    return program(vessel, np.random.default_rng(3), reference_coefficients(vessel))


@pytest.fixture(scope="module")
def found(tests):
    return ps.identify_ship(trials(0)[:1], tanker(), terms=[PARTS], captive=tests, draws=40, rng=1)


def test_the_ship_has_used_them_and_the_identification_has_them(found, tests):
    assert found.ship.uses_captive_tests
    assert found.captive is tests
    assert any("41 captive tests are part of the likelihood of every term set" in line for line in found.ship.remarks)


def test_what_was_identified_is_nearer_to_them_than_the_prior_alone(found):
    rows = {(row["force"], row["drawn"]): row for row in comparison_rows(captive_comparison(found, 1))}
    assert set(rows) == {(force, drawn) for force in ("X'", "Y'", "N'") for drawn in ("prior alone", "identified")}
    for force in ("Y'", "N'"):
        prior, identified = (rows[force, drawn] for drawn in ("prior alone", "identified"))
        assert identified["half_width"] < 0.5 * prior["half_width"]
        assert identified["R2"] > 0.9


def test_the_seed_draws_the_prior_alone(found):
    one, same, other = (captive_comparison(found, seed) for seed in (1, 1, 2))
    assert one.identical(same)
    assert not one["Y_band"].sel(drawn="prior alone").equals(other["Y_band"].sel(drawn="prior alone"))
    assert one["Y_band"].sel(drawn="identified").equals(other["Y_band"].sel(drawn="identified"))


def test_without_captive_tests_there_is_none():
    lone = ps.identify_ship(trials(0)[:1], tanker(), terms=["hull and loading"], draws=8, rng=1)
    assert captive_comparison(lone, 1) is None
    assert not lone.ship.uses_captive_tests
