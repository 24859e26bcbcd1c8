"""Three noisy zigzags of the KVLCC2, and the ship identified from them."""

from __future__ import annotations

from functools import cache

import numpy as np

import pymc_ship as ps
from pymc_ship.ships.identification.model import identify_ship

TERMS = ("hull and loading, cubic", "loading")
"""Those of the ship that made the runs, and others."""
_NOISE = {"u": 0.01, "v": 0.01, "r": 2e-5}
_MANOEUVRES = {"a": ((10, 10), "port"), "b": ((20, 20), "starboard"), "c": ((15, 5), "starboard")}


@cache
def kvlcc2():
    return ps.load_vessel("kvlcc2")


@cache
def clean(name):
    """Zigzag of the KVLCC2 of 700 s at 1 s."""
    angles, side = _MANOEUVRES[name]
    settings = {"duration": 700.0, "step": 0.25, "method": "rk4", "record_interval": 1.0}
    return ps.simulate(kvlcc2(), ps.zigzag(*angles, side=side), **settings)


@cache
def runs():
    """Three zigzags with the noise of sensors, by name."""
    found, rng = {}, np.random.default_rng(7)
    for name in _MANOEUVRES:
        run = clean(name)
        noisy = {key: run[key].values + sd * rng.standard_normal(run.sizes["time"]) for key, sd in _NOISE.items()}
        found[name] = run.assign({key: ("time", values) for key, values in noisy.items()})
    return found


@cache
def model():
    rng = np.random.default_rng(1)
    return identify_ship(list(runs().values()), kvlcc2(), names=list(runs()), terms=TERMS, draws=40, rng=rng)
