"""Draws of a ship of parts at another draught."""

from dataclasses import replace

import numpy as np

import pymc_ship as ps
from pymc_ship.physics.vessel.parts import FIXED_SD
from pymc_ship.ships.sea_trials.loading import at_loading
from tests.ships.sea_trials.cases import tanker


def lighter():
    particulars = replace(tanker().particulars, d=15.0, volume=222000.0)
    bare = replace(tanker(), particulars=particulars, m=0.0136, parts=(), parameters=(), derived={})
    return ps.with_terms(bare, "modular at any speed")


def test_standardised_deviations_of_the_parameters_stay():
    light, full = lighter(), tanker()
    value, sd = np.array([[c.value, c.sd] for c in light.parameters]).T
    z = np.random.default_rng(3).standard_normal((5, value.size)) * (sd > FIXED_SD)
    vessel, moved = at_loading(light, value + z * sd, light, full)
    other, other_sd = np.array([[c.value, c.sd] for c in full.parameters]).T
    np.testing.assert_allclose(moved, other + z * other_sd, rtol=1e-9)
    assert np.abs(other - value).max() > 0.0
    assert vessel.particulars.d == full.particulars.d
    np.testing.assert_array_equal([c.value for c in vessel.parameters], other)


def test_the_steering_gear_is_that_of_the_trial():
    gear = replace(lighter(), particulars=replace(lighter().particulars, rudder_rate_deg=5.0, rudder_delay=3.0))
    rows = np.array([[c.value for c in gear.parameters]])
    vessel, _ = at_loading(gear, rows, lighter(), tanker())
    assert (vessel.particulars.rudder_rate_deg, vessel.particulars.rudder_delay) == (5.0, 3.0)
