"""Trial as arrays of the trajectory likelihood: inputs, block means of raw channels and sample noise."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import xarray as xr

from pymc_ship.machine.arguments import check_kind, name_list, number_or_nan
from pymc_ship.machine.errors import TrialError
from pymc_ship.physics.forces.surroundings import CURRENT, WIND
from pymc_ship.physics.motion.equations import STATE
from pymc_ship.physics.motion.inputs import recorded_inputs
from pymc_ship.physics.motion.stepping import METHODS
from pymc_ship.physics.vessel.vessel import Vessel
from pymc_ship.trial.channels import CHANNELS, channel_names, default_channels
from pymc_ship.trial.record import as_trial, check_trial, sampling_interval, second_difference_sd

BLOCK = 0.2  # length of a block [s]; faster samples are averaged over it
FEWEST_STEPS = {"rk4": 60, "euler": 240}  # integration steps in L/U_nom
FEWEST_BLOCKS = 20  # least number of blocks of a record


@dataclass(frozen=True)
class Run:
    """One trial prepared for the trajectory likelihood."""

    channels: tuple[str, ...]  # measured channels, of u, v, r, p, phi, psi, x, y
    samples: np.ndarray  # (n_channels, n_time); raw values, SI units and rad
    inputs: np.ndarray  # (4, n_time); rudder, revolutions and wind of the equations of motion, without error
    start: float  # time of the first sample [s]
    interval: float  # sampling interval [s]
    block: int  # samples in a block
    method: str
    substeps: int  # integration steps in a sampling interval
    sample_sd: np.ndarray  # (n_channels,); noise sd of one sample
    nominal_speed: float  # first guess of u where it is not measured [m/s]
    rolls: bool  # whether the vessel rolls
    heads: bool  # whether forces depend on the heading, which is then a state
    restart: tuple[np.ndarray, np.ndarray] | None = None  # (n_states,) each; mean and sd of the prior initial state

    @property
    def n_states(self) -> int:
        """Number of states: 5, or 6 with heading, or 8 with track."""
        last = max(self.rows)
        return 8 if last > 5 else 6 if last == 5 or self.heads else 5

    @property
    def rows(self) -> tuple[int, ...]:
        """Row of each channel among the states."""
        return tuple(STATE.index(name) for name in self.channels)

    @property
    def integration(self) -> dict:
        """Arguments of ``replay`` and ``sensitivities``."""
        return {"interval": self.interval, "method": self.method, "substeps": self.substeps}

    @property
    def n_blocks(self) -> int:
        """Number of whole blocks."""
        return self.inputs.shape[1] // self.block

    @cached_property
    def means(self) -> np.ndarray:
        """Block means of the channels, shape (n_channels, n_blocks)."""
        return self.block_means(self.samples)

    @cached_property
    def time(self) -> np.ndarray:
        """Mean time of each block [s], shape (n_blocks,)."""
        return self.start + self.interval * (np.arange(self.n_blocks) * self.block + 0.5 * (self.block - 1))

    def block_means(self, values: np.ndarray) -> np.ndarray:
        """Means over whole blocks of samples, shape (..., n_blocks) from (..., n_time)."""
        whole = values[..., : self.n_blocks * self.block]
        return whole.reshape(*values.shape[:-1], self.n_blocks, self.block).mean(axis=-1)

    @cached_property
    def initial_state(self) -> tuple[np.ndarray, np.ndarray]:
        """Mean and sd of the weak prior of the initial state: a line through two seconds, or 0 where not measured."""
        if self.restart is not None:
            return self.restart
        guess, sd = np.zeros(self.n_states), np.array([CHANNELS[name].size for name in STATE[: self.n_states]])
        guess[0] = self.nominal_speed
        if not self.rolls:
            sd[3:5] = 1e-9
        count = min(max(round(2.0 / self.interval), 2), self.inputs.shape[1])
        for row, values, noise in zip(self.rows, self.samples, self.sample_sd, strict=True):
            guess[row] = np.polynomial.Polynomial.fit(np.arange(count), values[:count], 1)(0)
            sd[row] = np.ptp(values) + 10.0 * noise
        return guess, sd


def trajectory_run(
    trial: xr.Dataset,
    vessel: Vessel,
    *,
    channels: Sequence[str] | None = None,
    noise_sd: Mapping[str, float] | None = None,
    method: str = "rk4",
) -> Run:
    """Run of a raw record with uniform sampling; ``noise_sd`` of single samples, by default from second differences."""
    trial = as_trial(trial)
    noise_sd = {} if noise_sd is None else noise_sd
    check_kind("noise_sd", noise_sd, Mapping, "give a dict by channel", TrialError)
    given = [name for name in default_channels() if name in trial] if channels is None else channels
    names = name_list("The channels", given, TrialError)
    if "roll" not in vessel.dofs:
        rolling = channel_names(lambda channel: channel.rolling)
        names = tuple(name for name in names if name not in rolling)
    unknown = [name for name in (*names, *noise_sd) if name not in STATE]
    if unknown or not names or method not in METHODS:
        raise TrialError(
            f"A trajectory is fitted to some of {', '.join(STATE)}, each once, with {' or '.join(METHODS)}, found "
            f"{', '.join(unknown or names) or 'no channel'} with {method}; correct them."
        )
    check_trial(trial, (*names, "delta"))
    interval = sampling_interval(trial)
    block = max(1, round(BLOCK / interval))
    if trial["time"].size < FEWEST_BLOCKS * block:
        raise TrialError(
            f"A trajectory is fitted to {FEWEST_BLOCKS * block} samples or more at {interval:g} s, found "
            f"{trial['time'].size}; use a longer record."
        )
    samples = np.array([np.unwrap(trial[name]) if name == "psi" else trial[name] for name in names], dtype=float)
    return Run(
        channels=names,
        samples=samples,
        inputs=recorded_inputs(trial, vessel),
        start=float(trial["time"].values[0]),
        interval=interval,
        block=block,
        method=method,
        substeps=int(np.ceil(FEWEST_STEPS[method] * interval / vessel.particulars.ship_time - 1e-9)),
        sample_sd=_sample_sd(names, samples, noise_sd),
        nominal_speed=vessel.particulars.nominal_speed,
        rolls="roll" in vessel.dofs,
        heads=bool({WIND.name, CURRENT.name} & set(vessel.parts)),
    )


def _sample_sd(channels: tuple[str, ...], samples: np.ndarray, given: Mapping[str, float]) -> np.ndarray:
    sd = second_difference_sd(samples)
    for row, name in enumerate(channels):
        sd[row] = number_or_nan(given.get(name, sd[row]))
        if not 0.0 < sd[row] < np.inf:
            raise TrialError(
                f"The noise of channel {name} needs a positive standard deviation, found {sd[row]:g}; give it in "
                "noise_sd (a channel without noise has no sd to estimate)."
            )
    return sd


def whiten(values: np.ndarray, sd: float, correlation: float) -> np.ndarray:
    """Values divided by their sd, without first-order autocorrelation along the first axis."""
    if correlation == 0.0:
        return values / sd
    white = values.copy()
    white[1:] -= correlation * values[:-1]
    white[1:] /= np.sqrt(1.0 - correlation**2)
    return white / sd
