"""Instruments: noise, resolution, missing samples and jitter of the clock, by type."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, Protocol

import numpy as np
import scipy
import xarray as xr

from pymc_ship.machine.arguments import check_choice
from pymc_ship.machine.errors import TrialError
from pymc_ship.trial.channels import CHANNELS
from pymc_ship.trial.record import check_trial

_DEG = math.radians(1.0)


class Noise(Protocol):
    """A kind of noise: a function of a clean trial and a generator that returns the measured trial."""

    def __call__(self, clean: xr.Dataset, rng: np.random.Generator) -> xr.Dataset:
        """Polluted copy of the clean trial."""
        ...


@dataclass(frozen=True)
class Instrument:
    """Readings of one instrument.

    Channels that a trial lacks are ignored. A reading is the clean channel at the true instant, plus white noise,
    rounded to the resolution; its time stamp is nominal. Missing samples come in runs of geometric length and are NaN
    in all channels of the instrument.

    Attributes
    ----------
    sd : dict of str to float
        Standard deviation of the noise of each measured channel, in SI units and rad.
    resolution : dict of str to float, optional
        Step of the readings; 0 where none is given.
    jitter : float, optional
        Standard deviation of the instants about their time stamps [s].
    missing : float, optional
        Fraction of samples that are missing, below 1.
    run : float, optional
        Mean length of a run of missing samples.

    Raises
    ------
    TrialError
        For an unknown channel, a resolution of a channel without noise, a number out of its range.

    Examples
    --------
    A log that reads the speed to a tenth of a knot:

    >>> import numpy as np
    >>> import pymc_ship as ps
    >>> trial = ps.simulate(ps.load_vessel("kvlcc2"), ps.turning_circle(35), duration=60, step=10)
    >>> log = ps.Instrument(sd={"u": 0.02}, resolution={"u": 0.1 * 1852 / 3600})
    >>> read = ps.pollute(trial, noise=log, rng=np.random.default_rng(1))
    >>> print((read["u"] * 3600 / 1852).values.round(2))
    [15.5 15.5 15.4 15.3 15.1 14.9]
    """

    sd: Mapping[str, float]
    resolution: Mapping[str, float] = field(default_factory=dict)
    jitter: float = 0.0
    missing: float = 0.0
    run: float = 1.0

    def __post_init__(self) -> None:
        unknown = [name for name in (*self.sd, *self.resolution) if name not in CHANNELS or name not in self.sd]
        if unknown or not self.sd:
            raise TrialError(
                f"An instrument has an sd of each channel that it measures, one of {', '.join(CHANNELS)}, found "
                f"{', '.join(unknown) or 'none'}; name its channels."
            )
        numbers = (*self.sd.values(), *self.resolution.values(), self.jitter, self.missing, self.run - 1.0)
        if not all(0.0 <= number < math.inf for number in numbers) or self.missing >= 1.0:
            raise TrialError(
                "An instrument has an sd, resolution and jitter from 0 up, a fraction of missing samples below 1 and "
                f"runs of 1 or more, found {self}; correct it."
            )

    def __call__(self, clean: xr.Dataset, rng: np.random.Generator) -> xr.Dataset:
        """Trial with the readings of this instrument."""
        names = [name for name in self.sd if name in clean]
        check_trial(clean, names, uniform=False)
        read, time = clean.copy(), clean["time"].values
        instants = time + self.jitter * rng.standard_normal(time.size)
        missing = _missing(time.size, self.missing, self.run, rng)
        for name in names:
            values = clean[name].values
            values = scipy.interpolate.CubicSpline(time, values)(instants) if self.jitter else values
            values = values + self.sd[name] * rng.standard_normal(time.size)
            if step := self.resolution.get(name, 0.0):
                values = step * np.round(values / step)
            read[name] = ("time", np.where(missing, np.nan, values), clean[name].attrs)
            read.attrs[f"noise_sd_{name}"] = float(self.sd[name])
        return read


INSTRUMENTS = {
    "gnss": Instrument(
        sd={"u": 0.05, "v": 0.05, "x": 2.5 / 1.1774, "y": 2.5 / 1.1774},
        resolution={"u": 0.001, "v": 0.001, "x": 0.011, "y": 0.011},
        missing=0.01,
        run=3.0,
    ),
    "mems_gyro": Instrument(sd={"r": 0.05 * _DEG, "p": 0.05 * _DEG}, resolution={"r": _DEG / 131.0, "p": _DEG / 131.0}),
    "mru": Instrument(sd={"phi": 0.03 * _DEG}, resolution={"phi": 0.01 * _DEG}),
    "fluxgate_compass": Instrument(sd={"psi": 0.2 * _DEG}, resolution={"psi": 0.1 * _DEG}, jitter=0.1 / math.sqrt(12)),
}
"""Instruments by type, each with the published numbers of one.

- ``gnss``: u-blox MAX-M8Q, velocity 0.05 m/s (taken as an sd), position 2.5 m CEP = 1.1774 sd of a coordinate; message
  UBX-NAV-PVT in mm/s and 1e-7 deg. Assumed: 1 % of the fixes are missing, 3 at a time.
- ``mems_gyro``: InvenSense MPU-6050 (PS-MPU-6000A-00 rev. 3.4, 6.1), 0.05 deg/s rms in 100 Hz, 131 steps for 1 deg/s.
- ``mru``: Kongsberg Seatex MRU 5, third generation, roll to 0.03 deg rms; two decimals in the sentence PSXN.
- ``fluxgate_compass``: Simrad RFC35NS (manual of the Robertson AP9 Mk3, 4.5), 0.2 deg rms, NMEA 0183 HDM with one
  decimal at 10 Hz: a reading is up to 0.1 s old, the jitter.
"""


def simulate_readings(
    clean: xr.Dataset, noise: str | Noise | Sequence[str | Noise], rng: np.random.Generator
) -> xr.Dataset:
    """Trial with noise, by names of :data:`INSTRUMENTS` or functions; TrialError for noise that cannot be used."""
    kinds: list[Any] = [noise]
    if isinstance(noise, Iterable) and not isinstance(noise, str | bytes | bytearray) and not callable(noise):
        kinds = list(noise)
    for kind in [kind for kind in kinds if not callable(kind)]:
        check_choice("An instrument", kind, INSTRUMENTS, TrialError)
    functions = [INSTRUMENTS[kind] if isinstance(kind, str) else kind for kind in kinds]
    channels = [name for one in functions if isinstance(one, Instrument) for name in one.sd]
    if twice := sorted({name for name in channels if channels.count(name) > 1}):
        raise TrialError(f"A channel has one instrument, found two for {', '.join(twice)}; leave one of them out.")
    trial = clean.copy(deep=True)  # a function may change its argument
    for function in functions:
        trial = function(trial, rng)
        if not (isinstance(trial, xr.Dataset) and "time" in trial.coords and trial["time"].equals(clean["time"])):
            raise TrialError(
                "A kind of noise returns the trial, a Dataset over the same times, found "
                f"{type(trial).__name__}; return the polluted copy."
            )
        wrong = [str(name) for name, values in clean.data_vars.items() if not _is_reading(trial.get(name), values)]
        if wrong:
            raise TrialError(
                "A kind of noise returns every channel as real numbers over the same times, NaN where a sample is "
                f"missing, found others in {', '.join(wrong)}; correct the function."
            )
    return trial


def _is_reading(read: xr.DataArray | None, clean: xr.DataArray) -> bool:
    """Whether a channel is as it was, or has the dims of a reading, numbers that are not infinite, and one sample."""
    if read is None or read.dims != clean.dims or read.dtype.kind not in "biuf":
        return read is not None and read.equals(clean)
    return read.equals(clean) or not (np.isinf(read.values).any() or np.isnan(read.values).all())


def _missing(n_time: int, fraction: float, run: float, rng: np.random.Generator) -> np.ndarray:
    """Mask of missing samples, from a two-state Markov chain."""
    missing = np.zeros(n_time, dtype=bool)
    if not fraction:
        return missing
    begins, ends = fraction / (run * (1.0 - fraction)), 1.0 / run
    draws = rng.random(n_time + 1)
    state = bool(draws[-1] < fraction)
    for k in range(n_time):
        missing[k] = state
        state = bool(draws[k] >= ends) if state else bool(draws[k] < begins)
    return missing
