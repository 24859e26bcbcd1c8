"""What is said of the turning circle of an identified ship, and of the run that would tell most next."""

import re

import numpy as np
import pytest
import xarray as xr

import pymc_ship as ps
from pymc_ship.forces.terms import SYMBOLS
from pymc_ship.motion.prime_record import motion_record, prime_record
from pymc_ship.ship.soundness import outlook
from pymc_ship.vessel.vessel import reference_coefficients
from tests.ship.cases import RUNS, tanker, trial


def motion_of(manoeuvres):
    """Prime motion of exact runs, as that of trials."""
    rows = [prime_record(tanker(), motion_record(trial(one), tanker()))[0] for one in manoeuvres]
    values = np.vstack([np.column_stack([row[symbol] for symbol in SYMBOLS]) for row in rows])
    return xr.DataArray(values, {"symbol": list(SYMBOLS)}, ("row", "symbol"))


@pytest.fixture(scope="module")
def models():
    values = reference_coefficients(tanker())
    return [(tanker(), values * (1.0 + 0.005 * np.random.default_rng(2).standard_normal((40, values.size))))]


@pytest.fixture(scope="module")
def zigzags():
    return motion_of(RUNS)


def test_zigzags_leave_the_circle_least_known(models, zigzags):
    turns, widest = outlook(models, zigzags, {"angle": 0.005}, np.random.default_rng(1))
    assert "least is known of the turning circle 35" in widest
    assert "the widest interval, ± " in widest
    truth = float(ps.indices(ps.simulate(tanker(), ps.turning_circle(35), duration=900, step=0.5))["tactical_diameter"])
    median, lower, upper = map(float, re.search(r"(\S+) L \((\S+) to (\S+)\) to port", turns).groups())
    assert lower < truth / tanker().particulars.L < upper
    assert lower < median < upper


def test_once_the_circle_was_sailed_it_is_known_and_what_errs_is_told(models):
    sailed = motion_of((*RUNS, ps.turning_circle(35), ps.turning_circle(35, side="starboard")))
    wide = outlook(models, sailed, {"angle": 0.2}, np.random.default_rng(1))[1]
    assert re.search(r"least is known of the zigzag .* of the ship's swing", wide)


def test_the_same_seed_gives_the_same_sentences(models, zigzags):
    first, again = (outlook(models, zigzags, {}, np.random.default_rng(3)) for _ in range(2))
    assert first == again
