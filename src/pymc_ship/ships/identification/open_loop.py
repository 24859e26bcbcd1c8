"""Open-loop simulation along the measured inputs of a record."""

import numpy as np
import xarray as xr

from pymc_ship.inference.trajectory.windows import smoothed_channel, substeps_of
from pymc_ship.physics.motion.equations import STATE
from pymc_ship.physics.motion.inputs import recorded_inputs
from pymc_ship.physics.motion.replay import replay
from pymc_ship.physics.vessel.vessel import Vessel
from pymc_ship.trial.channels import CHANNELS
from pymc_ship.trial.record import sampling_interval, second_difference_sd


def simulate_open_loop(vessel: Vessel, coefficients: np.ndarray, trial: xr.Dataset, samples: slice) -> np.ndarray:
    """Simulate draws (n_draws, n_coefficients) along the measured inputs of a piece of a record.

    The initial state is the first of the samples, smoothed. Returns shape (8, n_draws, n_time), SI units and rad; NaN
    throughout for a diverged draw. Track and heading start at 0 where not measured.
    """
    piece, inputs = trial.isel(time=samples), recorded_inputs(trial, vessel)[:, samples]
    interval, unit = sampling_interval(piece), vessel.particulars.ship_time
    initial = np.zeros((len(coefficients), len(STATE)))
    rolls = "roll" in vessel.dofs
    for k, name in enumerate(STATE):
        if name in piece and (rolls or not CHANNELS[name].rolling):
            values = piece[name].values
            initial[:, k] = smoothed_channel(values, unit / interval)[0] if name in ("u", "v", "r", "p") else values[0]
    return replay(vessel, inputs, initial, coefficients, interval=interval, substeps=substeps_of(interval, vessel))


def reading_noise_sd(trial: xr.Dataset) -> np.ndarray:
    """Sd of the readings of each state of a trial, (8,) [SI, rad]; 0 for unmeasured channels."""
    sd = np.zeros(len(STATE))
    for k, name in enumerate(STATE):
        values = trial[name].dropna("time").values if name in trial else np.empty(0)
        if values.size > 2:
            sd[k] = float(second_difference_sd(values))
    return sd


def replay_noise_sd(noise_sd: np.ndarray, piece: xr.Dataset) -> np.ndarray:
    """Sd of the measured states of a piece about a replay of the true ship, (8, n_time), by that of the readings (8,).

    The variance of heading, roll and track counts twice: the initial state of a replay has their noise, too. The noise
    of the initial heading turns the whole track.
    """
    twice = np.isin(STATE, ("psi", "x", "y", "phi"))
    sd = np.repeat((noise_sd * np.where(twice, np.sqrt(2.0), 1.0))[:, None], piece.sizes["time"], axis=1)
    for name, across in (("x", "y"), ("y", "x")):
        if across in piece:
            turned = noise_sd[STATE.index("psi")] * (piece[across].values - piece[across].values[0])
            sd[STATE.index(name)] = np.hypot(sd[STATE.index(name)], turned)
    return sd


def measured_states(trial: xr.Dataset, samples: slice) -> np.ndarray:
    """States (8, n_time) of a piece of a record in SI units and rad; NaN for unmeasured channels."""
    piece = trial.isel(time=samples)
    missing = np.full(piece.sizes["time"], np.nan)
    return np.array([piece[name].values if name in piece else missing for name in STATE])
