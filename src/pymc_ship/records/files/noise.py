"""Sensor noise of simulated records (Xue et al. 2020, Eq. 22)."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence

import numpy as np
import scipy
import xarray as xr

from pymc_ship.machine.arguments import finite_number, number_or_nan, short_repr
from pymc_ship.machine.errors import TrialError
from pymc_ship.machine.seeds import Seed, random_generator
from pymc_ship.records.files.instruments import Noise, simulate_readings
from pymc_ship.trial.channels import CHANNELS, SIMULATED, default_channels
from pymc_ship.trial.record import as_trial, check_trial

LITERAL_LEVEL = 0.2**0.5  # the paper's literal level: xi has variance 0.2
RECORD_STEP = 0.02  # sampling interval [s] of the records that the correlated noise is for


def _white(values: np.ndarray, sd: float, peak: float, rng: np.random.Generator) -> np.ndarray:
    return values + sd * rng.standard_normal(values.size)


def _offset(values: np.ndarray, sd: float, peak: float, rng: np.random.Generator) -> np.ndarray:
    """White noise and a constant of either sign, half to all of the peak."""
    return _white(values, sd, peak, rng) + peak * rng.uniform(0.5, 1.0) * rng.choice((-1.0, 1.0))


def _student(values: np.ndarray, sd: float, peak: float, rng: np.random.Generator) -> np.ndarray:
    return values + sd * (rng.standard_t(3.0, values.size) / np.sqrt(3.0))


def _autoregression(time_constant: float) -> Callable[..., np.ndarray]:
    """First-order autoregression from its stationary state; the time constant in s."""
    correlation = np.exp(-RECORD_STEP / time_constant)

    def noisy(values: np.ndarray, sd: float, peak: float, rng: np.random.Generator) -> np.ndarray:
        shocks = rng.standard_normal(values.size)
        shocks[1:] *= np.sqrt(1.0 - correlation**2)
        return values + sd * scipy.signal.lfilter([1.0], [1.0, -correlation], shocks)

    return noisy


NOISES = {
    "white": _white,
    "correlated 0.2 s": _autoregression(0.2),
    "correlated 1 s": _autoregression(1.0),
    "offsets": _offset,
    "Student-t3": _student,
}
"""Kinds of sensor noise: functions of clean values, noise sd, level times peak of the channel, and a generator."""


def noise_sd(level: float | str) -> float:
    """Standard deviation of xi that a level names; TrialError for anything but a number from 0 up or "literal"."""
    size = LITERAL_LEVEL if isinstance(level, str) and level == "literal" else number_or_nan(level)
    if not 0.0 <= size < np.inf:
        raise TrialError(f"The noise level is a number from 0 up or 'literal', found {short_repr(level)}; correct it.")
    return size


def noise_factors() -> dict[str, float]:
    """Factor k of each channel that carries noise: 1.0 for sway, 0.3 for the others; not the rudder and the track."""
    return {name: one.noise_factor for name, one in CHANNELS.items() if one.noise_factor is not None}


def pollute(
    trial: xr.Dataset,
    *,
    level: float | str | None = None,
    noise: str | Noise | Sequence[str | Noise] | None = None,
    rng: Seed,
    factors: Mapping[str, float] | None = None,
) -> xr.Dataset:
    """Add noise to the channels of a trial.

    A level means white Gaussian noise of sd level * k * max|channel|.

    Parameters
    ----------
    trial : Dataset, dims (time,)
    level : float or "literal", optional
        Standard deviation of xi; ``"literal"`` is sqrt(0.2) = 0.447, as the paper prints it.
    noise : str, callable or sequence of them, optional
        In place of a level: names in :data:`pymc_ship.records.files.instruments.INSTRUMENTS`, a
        :class:`pymc_ship.Instrument` or any function ``(clean trial, rng) -> trial``, one after the other.
    rng : int, SeedSequence or Generator
    factors : mapping of str to float, optional
        k of each noisy channel, by default those of :func:`pymc_ship.records.files.noise.noise_factors`.

    Returns
    -------
    Dataset, dims (time,)
        Copy with noise; attrs ``noise_level`` and ``noise_sd_<channel>`` in the channel's unit. Samples that an
        instrument misses are NaN; :func:`pymc_ship.read_trial` fills short runs.

    Raises
    ------
    TrialError
        For a negative or unknown level, a negative factor, an unknown channel or instrument, both or neither of level
        and noise, two instruments for a channel, a function that does not return a trial.

    References
    ----------
    Xue et al. (2020), Eq. 22, doi:10.1016/j.oceaneng.2019.106612.

    Examples
    --------
    >>> import numpy as np
    >>> import pymc_ship as ps
    >>> trial = ps.simulate(ps.load_vessel("kvlcc2"), ps.zigzag(20, 20), duration=300, step=0.5)
    >>> noisy = ps.pollute(trial, level=0.01, rng=np.random.default_rng(1))
    >>> noise = noisy["psi"] - trial["psi"]
    >>> print(f"{noise.std():.4f} rad; {noisy.attrs['noise_sd_psi']:.4f} rad")
    0.0019 rad; 0.0019 rad
    """
    rng, trial = random_generator(rng), as_trial(trial)
    if noise is not None and level is None and factors is None:
        return simulate_readings(trial, noise, rng)
    if noise is not None or level is None:
        raise TrialError("A trial is polluted by a level (with factors) or by kinds of noise; give one of the two.")
    size, known = noise_sd(level), noise_factors()
    factors = known if factors is None else factors
    noisy = dict.fromkeys((*SIMULATED, *known))
    unknown = [name for name in factors if name not in noisy]
    if unknown:
        raise TrialError(f"Noise goes on the channels {', '.join(noisy)}; found {', '.join(unknown)}; rename them.")
    for name, factor in factors.items():
        finite_number(f"The noise factor of {name}", factor, TrialError, least=0.0)
    names = [name for name in factors if name in trial]
    check_trial(trial, names, uniform=False)
    polluted = trial.copy()
    polluted.attrs["noise_level"] = float(size)
    for name in names:
        peak = np.abs(trial[name].values).max()
        _add_noise(polluted, name, "white", size * factors[name] * peak, size * peak, rng)
    return polluted


def noisy_trial(clean: xr.Dataset, level: float, noise: str, rng: np.random.Generator) -> xr.Dataset:
    """Trial with noise of a kind of :data:`NOISES` on its sensors, of the size that :func:`pymc_ship.pollute` gives."""
    trial, factors = clean.copy(), noise_factors()
    for name in default_channels():
        peak = level * np.abs(clean[name].values).max()
        _add_noise(trial, name, noise, factors[name] * peak, peak, rng)
    return trial


def _add_noise(trial: xr.Dataset, name: str, kind: str, sd: float, peak: float, rng: np.random.Generator) -> None:
    """Put noise of a kind on a channel, and its standard deviation into the attrs."""
    noisy = NOISES[kind](trial[name].values, sd, peak, rng)
    trial[name] = ("time", noisy, trial[name].attrs)
    trial.attrs[f"noise_sd_{name}"] = float(sd)
