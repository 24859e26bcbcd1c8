"""Simulated trials of the KVLCC2 tanker at full scale, as a ship is identified from them: L / U is 40 s."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import xarray as xr

import pymc_ship as ps
from pymc_ship.inference.trajectory.prior import CoefficientPrior
from pymc_ship.physics.vessel.vessel import Vessel

TRUE_TERMS = "hull and loading, cubic"
"""Term set that the shipped model has."""

STEP = 0.25
"""Integration step [s]."""

RUNS = (ps.zigzag(10.0, 10.0), ps.zigzag(20.0, 20.0, side="starboard"), ps.zigzag(15.0, 5.0))

ROLL = "maximum_roll_angle"


def scored_upright(manoeuvre) -> list[str]:
    """Scored indices of a manoeuvre that a ship without roll has."""
    return [name for name in manoeuvre.traits.scored if name != ROLL]


@cache
def tanker() -> Vessel:
    return ps.load_vessel("kvlcc2")


def with_delay(delay: float) -> Vessel:
    return replace(tanker(), particulars=replace(tanker().particulars, rudder_delay=delay))


def trial(manoeuvre, *, vessel=None, duration=660.0, interval=1.0, seed=None, level=0.02) -> xr.Dataset:
    """Record by Runge-Kutta, with noise where a seed is given."""
    settings = {"step": STEP, "record_interval": interval, "method": "rk4"}
    run = ps.simulate(vessel or tanker(), manoeuvre, duration=duration, **settings)
    return run if seed is None else ps.pollute(run, level=level, rng=np.random.default_rng(seed))


def trials(seed: int = 0, manoeuvres=RUNS, **settings) -> list[xr.Dataset]:
    """Noisy records of several runs."""
    return [trial(what, seed=100 * seed + k, **settings) for k, what in enumerate(manoeuvres)]


def with_values(vessel: Vessel, row: np.ndarray) -> Vessel:
    """Vessel with all its coefficients, DOF after DOF."""
    cuts = np.cumsum([len(vessel.terms(dof)) for dof in vessel.dofs])[:-1]
    return vessel.with_coefficients(dict(zip(vessel.dofs, np.split(row, cuts), strict=True)))


def wide_prior(center: np.ndarray, times: float = 10.0) -> CoefficientPrior:
    """Prior about some coefficients, of so many times their size."""
    scale = times * np.abs(center)
    return CoefficientPrior(center, scale, scale, "wide")
