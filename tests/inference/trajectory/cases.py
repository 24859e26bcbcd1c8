"""Short records along known rudders, and noise of any kind on them, for the tests of whole-trajectory fits."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import xarray as xr
from scipy.signal import lfilter

import pymc_ship as ps
from pymc_ship.inference.trajectory.fit import Problem, initial_problem
from pymc_ship.physics.motion.equations import STATE
from pymc_ship.physics.motion.replay import replay
from pymc_ship.physics.vessel.vessel import reference_coefficients

SD = {"u": 0.04, "v": 0.015, "r": 3e-5, "p": 4e-5, "phi": 5e-4, "psi": 1e-3, "x": 0.5, "y": 0.5}
"""Noise of single samples."""


def unmodelled_roll_text(vessel):
    """The same hull, moving in the horizontal plane: 3 DOFs, a third of the coefficients."""
    forces = {dof: tuple(c for c in vessel.forces[dof] if "p" not in c.term) for dof in ("surge", "sway", "yaw")}
    return replace(vessel, name="flat_bottomed", forces=forces)


def record(vessel, manoeuvre, *, duration=120.0, interval=0.1, initial_state=None, begin=0.0) -> xr.Dataset:
    """Clean record that a fit can follow to the last digit: Runge-Kutta steps of at most 0.1 s along its rudder."""
    run = ps.simulate(vessel, manoeuvre, duration=duration, step=0.05, record_interval=interval, method="rk4")
    delta, start = run["delta"].values, np.zeros(8)
    start[0] = run.attrs["approach_speed"]
    motion = replay(
        vessel,
        delta,
        start if initial_state is None else initial_state,
        reference_coefficients(vessel),
        interval=interval,
        substeps=int(np.ceil(interval / 0.1 - 1e-9)),
    )[:, 0]
    channels = {name: ("time", values) for name, values in zip(STATE, motion, strict=True)}
    return xr.Dataset(channels | {"delta": ("time", delta)}, {"time": begin + interval * np.arange(delta.size)})


def white(rng, n):
    return rng.standard_normal(n)


def heavy_tailed(rng, n):
    """Student's t with 3 degrees of freedom, of unit variance."""
    return rng.standard_t(3.0, n) / np.sqrt(3.0)


def correlated(rng, n, *, at_lag_one=0.9):
    """First-order autoregression of unit variance."""
    shocks = rng.standard_normal(n) * np.sqrt(1.0 - at_lag_one**2)
    shocks[0] /= np.sqrt(1.0 - at_lag_one**2)
    return lfilter([1.0], [1.0, -at_lag_one], shocks)


def shifted(rng, n):
    """White noise about a constant offset of one standard deviation."""
    return rng.standard_normal(n) + rng.choice([-1.0, 1.0])


def rough(trial, seed, law=white, factor=1.0):
    """Trial with noise of a law on every channel but the rudder, ``factor`` times the standard deviations above."""
    rng = np.random.default_rng(seed)
    size = trial.sizes["time"]
    return trial.assign({name: trial[name] + factor * SD[name] * law(rng, size) for name in STATE})


def truth(vessel, trials) -> np.ndarray:
    """Reference coefficients, then the initial u, v, r, p, phi of each run."""
    return np.concatenate(
        [reference_coefficients(vessel), *([trial[c].values[0] for c in STATE[:5]] for trial in trials)]
    )


def problem_of(vessel, trials, prior="order_damped", **settings) -> Problem:
    """Problem of fitting u, v, r, p, phi of some trials under white noise."""
    from pymc_ship.inference.trajectory.runs import trajectory_run

    runs = [trajectory_run(trial, vessel, **settings) for trial in trials]
    chosen = ps.coefficient_prior(trials, vessel, prior) if isinstance(prior, str) else prior
    return initial_problem(runs, vessel, chosen)
