"""A modular tanker of known coefficients, draws as of an identification, and records of a trial."""

from dataclasses import replace
from functools import cache

import numpy as np
import xarray as xr

import pymc_ship as ps
from pymc_ship.physics.vessel.parts import FIXED_SD
from pymc_ship.physics.vessel.vessel import Windage, reference_coefficients
from tests.ships.ensemble.cases import ship_of

WIND, CURRENT = (9.0, 200.0), (0.4, 90.0)
STEP = 1.0


@cache
def tanker():
    """The tanker of the package with windage, modular at any speed."""
    vessel = replace(ps.load_vessel("kvlcc2"), windage=Windage(frontal_area=1160.0, lateral_area=4260.0))
    return ps.with_terms(vessel, "modular at any speed")


@cache
def draws(n=60, seed=3):
    """Draws about the true coefficients, as of a ship that is identified well: by a tenth of the prior sd."""
    vessel = tanker()
    sd = np.array([c.sd if c.sd > FIXED_SD else 0.0 for c in vessel.parameters])
    rng = np.random.default_rng(seed)
    return reference_coefficients(vessel) + 0.1 * sd * rng.standard_normal((n, sd.size))


@cache
def ship():
    """The ship of these draws, without index error."""
    motion = xr.DataArray(np.zeros((2, 1)), {"symbol": ["u"]}, ("row", "symbol"))
    return ship_of((tanker(), draws()), motion=motion, index_error={})


def run_record(manoeuvre, duration, *, wind=WIND, current=CURRENT, vessel=None, step=STEP):
    """Record of a run at a base course of 0, with the wind measured where there is any."""
    run = ps.simulate(vessel or tanker(), manoeuvre, duration=duration, step=step, wind=wind, current=current)
    measured = {}
    if wind is not None:
        measured = {"wind_speed": np.full(run.sizes["time"], wind[0])}
        measured["wind_direction"] = np.full(run.sizes["time"], np.deg2rad(wind[1]))
    return run.assign({name: ("time", values) for name, values in measured.items()})
