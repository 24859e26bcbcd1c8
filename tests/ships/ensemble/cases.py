"""Ships made of draws, as forecasts, replays, scores and designs take them, and forecasts of posteriors."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import xarray as xr

import pymc_ship as ps
from pymc_ship.inference.trajectory.prior import GaussianLikelihood
from pymc_ship.inference.trajectory.sequential_likelihood import EarlierLikelihood
from pymc_ship.machine.checksums import folder_checksum
from pymc_ship.physics.forces.terms import SYMBOLS
from pymc_ship.physics.motion.prime_record import motion_record, prime_record
from pymc_ship.physics.vessel.vessel import coefficient_names, reference_coefficients
from pymc_ship.replication.measurements import AS_PUBLISHED
from pymc_ship.ships.ensemble.ship import Member


def ship_of(*models, names=(), **known) -> ps.Ship:
    """Ship of some vessels, each with its draws, or with its own coefficients as the one draw of it.

    ``names`` are those of the members, numbers by default; ``known`` are the other attributes of the ship.
    """
    rows = [
        np.atleast_2d(model[1] if isinstance(model, tuple) else reference_coefficients(model)).astype(float)
        for model in models
    ]
    vessels = [model[0] if isinstance(model, tuple) else model for model in models]
    total, names = sum(map(len, rows)), names or [str(k + 1) for k in range(len(rows))]
    members = (
        Member(name, vessel, draws, draws.mean(axis=0), weight=len(draws) / total)
        for name, vessel, draws in zip(names, vessels, rows, strict=True)
    )
    return ps.Ship(tuple(members), **known)


def write_index(folder: Path, index: dict) -> None:
    """Write an index of a saved ship with the checksum that its writer would give it."""
    index = {key: value for key, value in index.items() if key != "sha256"}
    files = [f"{entry['file']}{ending}" for entry in index["terms"] for ending in (".toml", ".nc")]
    index["sha256"] = folder_checksum(folder, files, index)
    (folder / "ship.json").write_text(json.dumps(index), encoding="utf-8")


def with_likelihoods(ship: ps.Ship) -> ps.Ship:
    """Ship each of whose members has a likelihood of two runs, that of its estimate with a noise of one."""

    def likelihood(member):
        values, names = member.estimate, tuple(coefficient_names(member.vessel))
        return EarlierLikelihood(
            names, GaussianLikelihood(np.eye(values.size), values), np.ones(2), values, np.ones(values.size)
        )

    return replace(ship, members=tuple(replace(one, likelihood=likelihood(one)) for one in ship.members))


def motion_of(vessel, trials) -> xr.DataArray:
    """Prime motion of some trials, one after the other."""
    primes = [prime_record(vessel, motion_record(trial, vessel))[0] for trial in trials]
    rows = np.vstack([np.column_stack([prime[symbol] for symbol in SYMBOLS]) for prime in primes])
    return xr.DataArray(rows, {"symbol": list(SYMBOLS)}, ("row", "symbol"))


def posterior_forecast(vessel, posteriors, manoeuvre, *, draws, rng, noise_sd=None, **settings) -> xr.DataTree:
    """Forecast of a ship of a posterior by the steps of the study, with bands of 90 %; settings come first."""
    rng = np.random.default_rng(rng)
    ship = ps.Ship.from_posterior(vessel, posteriors, draws=draws, rng=rng, noise_sd=noise_sd)
    return ps.forecast(ship, manoeuvre, draws=draws, rng=rng, **{"duration": 400.0, **AS_PUBLISHED, **settings})
