"""Populations for tests: ships that are the KVLCC2 of the package, and work that is no work."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import xarray as xr
from scipy.stats import norm

import pymc_ship as ps
from pymc_ship.physics.motion.equations import STATE
from pymc_ship.physics.vessel.term_sets import ANY_SPEED_SET
from pymc_ship.physics.vessel.vessel import coefficient_names, reference_coefficients
from studies.population.judged_ship import STAGES, DrawnShip

STUDY = {
    "study": "studies.population:Population",
    "population": "studies.tests.population.ships:tanker",
    "trials": {"two": ["zigzag 20/20", "zigzag 10/10"], "some": {"most": 2, "of": ["zigzag 10/10", "zigzag 20/20"]}},
    "forecasts": ["turning circle 35 port", "zigzag 15/15 port"],
    "ships": 6,
    "root_seed": 3,
    "astern": 0.7,
}
SD = {"advance": 0.05, "tactical_diameter": 0.1}


def tanker(rng):
    """A KVLCC2 whose sensors have noise."""
    vessel = ps.load_vessel("kvlcc2")

    def sail(manoeuvre, duration):
        return ps.simulate(vessel, manoeuvre, duration=duration, step=0.25)

    def record(manoeuvre, run):
        noisy = ps.pollute(sail(manoeuvre, 500.0), level=0.01, rng=rng)
        return noisy.drop_vars(["p", "phi"])

    return DrawnShip("tanker", vessel, sail, record)


def stranger(rng):
    """A ship whose records are those of the KVLCC2, and who sails otherwise: every force a fifth larger."""
    vessel = ps.load_vessel("kvlcc2")
    other = 1.2 * reference_coefficients(vessel)[None]

    def sail(manoeuvre, duration):
        return ps.simulate(vessel, manoeuvre, duration=duration, step=0.25, coefficients=other).isel(draw=0)

    return replace(tanker(rng), sail=sail)


def of_parts(rng, astern=1.0):
    """A KVLCC2 of the parts that hold at any speed; its propeller pulls ``astern`` times as much as is typical."""
    vessel = ps.with_terms(ps.load_vessel("kvlcc2"), ANY_SPEED_SET)
    own = reference_coefficients(vessel)
    own[coefficient_names(vessel).index("T_nn")] *= astern

    def sail(manoeuvre, duration):
        return ps.simulate(vessel, manoeuvre, duration=duration, step=0.5, coefficients=own[None]).isel(draw=0)

    def record(manoeuvre, run):
        return ps.pollute(sail(manoeuvre, 500.0), level=0.01, rng=rng).drop_vars(["p", "phi"])

    def stop(test, duration):
        time = np.arange(0.0, duration, 2.0)
        n, states = test.simulate(vessel, own[None], time)
        motion = {name: ("time", row[0]) for name, row in zip(STATE, states, strict=True)}
        return xr.Dataset(motion | {"n": ("time", n)}, {"time": time})

    return DrawnShip("tanker", "kvlcc2", sail, record, stop)


def pulled_hard(rng):
    """The same with a propeller that pulls three times as hard astern as is typical."""
    return of_parts(rng, 3.0)


def sunk(rng):
    """No ship."""
    raise RuntimeError("no such\nship")


def made_up(task, share=1.0):
    """A result whose draws are normal; errors are ``share`` times as large as they say, and its sd is known."""
    rng = task.rng("made up")
    indices = []
    for name, sd in SD.items():
        beyond = float(rng.uniform(0.0, 4.0))
        error = float(share * sd * rng.standard_normal())
        pit = float(norm.cdf(-error / sd))
        row = {"manoeuvre": "turning circle", "index": name, "error": error, "half_width": 1.96 * sd, "sd": sd}
        indices.append(row | {"draws_sd": 0.5 * sd, "pit": pit, "beyond": beyond, "crps": 0.2 * sd})
    instants = []
    for name in ("u", "v", "r", "psi", "x", "y"):
        for lead in (1.0, 5.0):
            error = float(0.01 * rng.standard_normal())
            row = {"state": name, "lead": lead, "error": error, "sd": 0.01, "pit": float(norm.cdf(-error / 0.01))}
            instants.append(row | {"draws_sd": 0.005, "beyond": float(lead > 2.0), "far": lead})
    ended = {"block": task.block, "seed": task.seed, "status": "ok", "sentence": ""}
    held = [{"kind": "distance", "error": float(0.1 * rng.standard_normal()), "known": 0.01}]
    error = float(2.0 * rng.standard_normal())
    stop = {"error": error, "half_width": 3.92, "sd": 2.0, "pit": float(norm.cdf(-0.5 * error)), "crps": 0.4}
    found = {
        "hull": "tanker",
        "runs": float(len(task.sailed())),
        "indices": indices,
        "instants": instants,
        "held": held,
        "stops": [{"index": "track_reach"} | stop] if task.seed % 2 else [],
    }
    return ended | found | dict.fromkeys(STAGES, 1e-6) | {"cpu": 1e-6}


def refused(task):
    """A ship that is not identified."""
    ended = {"block": task.block, "seed": task.seed, "status": "refused", "sentence": "No term set can be fitted."}
    none = {"hull": "tanker", "runs": 1.0, "indices": [], "instants": [], "held": [], "stops": []}
    return ended | none | dict.fromkeys(STAGES, 1e-6) | {"cpu": 1e-6}


def columns(n=4000, share=1.0, growth=0.0, ships=200, seed=4):
    """Columns of indices whose errors have ``share`` times the stated sd, and ``growth`` a range on top of it."""
    rng = np.random.default_rng(seed)
    ship = np.arange(n) % ships
    beyond, sd = rng.uniform(0.0, 4.0, n), np.full(n, 0.05)
    error = np.hypot(share * sd, growth * beyond) * rng.standard_normal(n)
    found = {"error": error, "sd": sd, "draws_sd": 0.5 * sd, "half_width": 1.96 * sd, "beyond": beyond}
    found |= {"pit": norm.cdf(-error / sd), "crps": 0.2 * sd, "ship": ship, "first": ship % 2 == 0}
    found |= {"manoeuvre": np.full(n, "turning circle"), "index": np.where(ship % 3, "advance", "transfer")}
    return found | {"trials": np.full(n, "two"), "seed": ship, "hull": np.full(n, "tanker")}
