"""Sensor noise for simulated trials (Xue et al. 2020, Eq. 22)."""

from __future__ import annotations

from collections.abc import Mapping
from functools import partial

import numpy as np
import xarray as xr

from pymc_ship.trial.record import CHANNELS, SENSORS, TrialError, check_trial

FACTORS = {"u": 0.3, "v": 1.0, "r": 0.3, "p": 0.3, "phi": 0.3, "psi": 0.3}
"""Factor k of each channel: 1.0 for sway, 0.3 for the others; the rudder and the track carry no noise."""

LITERAL_LEVEL = 0.2**0.5
"""The paper's literal level: xi has variance 0.2, that is a standard deviation of 0.447."""


def noise_sd(level: float | str) -> float:
    """Standard deviation of xi that a level names; TrialError for anything but a number from 0 up or "literal"."""
    size = LITERAL_LEVEL if level == "literal" else level
    if isinstance(size, str) or not 0.0 <= size < np.inf:
        raise TrialError(f"The noise level is a number from 0 up or 'literal', found {level!r}; correct it.")
    return size


def pollute(
    trial: xr.Dataset,
    *,
    level: float | str,
    rng: np.random.Generator,
    factors: Mapping[str, float] = FACTORS,
) -> xr.Dataset:
    """Add white Gaussian noise of standard deviation level * k * max|channel| to each channel.

    Parameters
    ----------
    trial : Dataset, dims (time,)
    level : float or "literal"
        Standard deviation of xi; ``"literal"`` is sqrt(0.2) = 0.447, as the paper prints it.
    rng : numpy.random.Generator
    factors : mapping of str to float, optional
        k of each channel that carries noise; channels the trial does not have are left out.

    Returns
    -------
    Dataset, dims (time,)
        Copy with noise on the channels; attrs ``noise_level`` and ``noise_sd_<channel>`` in the channel's unit.

    Raises
    ------
    TrialError
        For a negative level, an unknown level name or an unknown channel.

    References
    ----------
    Xue et al. (2020), Eq. 22, doi:10.1016/j.oceaneng.2019.106612.

    Examples
    --------
    The noise of the heading has the standard deviation that the attrs state:

    >>> import numpy as np
    >>> import pymc_ship as ps
    >>> trial = ps.simulate(ps.load_vessel("kvlcc2"), ps.zigzag(20, 20), duration=300, step=0.5)
    >>> noisy = ps.pollute(trial, level=0.01, rng=np.random.default_rng(1))
    >>> noise = noisy["psi"] - trial["psi"]
    >>> print(f"{noise.std():.4f} rad; {noisy.attrs['noise_sd_psi']:.4f} rad")
    0.0019 rad; 0.0019 rad
    """
    size = noise_sd(level)
    unknown = [name for name in factors if name not in CHANNELS]
    if unknown:
        raise TrialError(f"Noise goes on the channels {', '.join(CHANNELS)}; found {', '.join(unknown)}; rename them.")
    names = [name for name in factors if name in trial]
    check_trial(trial, names, uniform=False)
    polluted = trial.copy()
    polluted.attrs["noise_level"] = float(size)
    for name in names:
        clean = trial[name].values
        sd = size * factors[name] * np.abs(clean).max()
        polluted[name] = ("time", clean + sd * rng.standard_normal(clean.size), trial[name].attrs)
        polluted.attrs[f"noise_sd_{name}"] = float(sd)
    return polluted


_SECOND_DIFFERENCE = 0.6744897501960817 * np.sqrt(6.0)


def second_difference_sd(values: np.ndarray) -> np.ndarray:
    """Standard deviation of white noise on smooth channels, shape (n_channels,) from (n_channels, n_time).

    The median magnitude of y_{k+1} - 2 y_k + y_{k-1} over 0.6745 sqrt(6): blind to a smooth signal and to outliers, too
    small for noise that is correlated in time.
    """
    return np.median(np.abs(np.diff(values, 2, axis=-1)), axis=-1) / _SECOND_DIFFERENCE


RECORD_STEP = 0.02
"""Sampling interval [s] of the simulated records that the kinds of noise below are made for."""


def _white(size: int, rng: np.random.Generator) -> np.ndarray:
    return rng.standard_normal(size)


def _student(size: int, rng: np.random.Generator) -> np.ndarray:
    return rng.standard_t(3.0, size) / np.sqrt(3.0)


def _correlated(size: int, rng: np.random.Generator, *, time_constant: float) -> np.ndarray:
    """First-order autoregression of unit variance from its stationary state."""
    from scipy.signal import lfilter

    correlation = np.exp(-RECORD_STEP / time_constant)
    shocks = rng.standard_normal(size)
    shocks[1:] *= np.sqrt(1.0 - correlation**2)
    return lfilter([1.0], [1.0, -correlation], shocks)


NOISES = {
    "white": _white,
    "correlated 0.2 s": partial(_correlated, time_constant=0.2),
    "correlated 1 s": partial(_correlated, time_constant=1.0),
    "offsets": _white,
    "Student-t3": _student,
}
"""Sensor noise of unit variance: (size, generator) -> (size,). Under ``offsets`` a constant of either sign, half to
all of the level times the peak of the channel, comes on top of the white noise."""


def noisy_trial(clean: xr.Dataset, level: float, noise: str, rng: np.random.Generator) -> xr.Dataset:
    """Trial with noise of the size that :func:`pymc_ship.pollute` gives, of any kind of :data:`NOISES`."""
    trial = clean.copy()
    for name in SENSORS:
        values = clean[name].values
        peak = level * np.abs(values).max()
        seen = values + FACTORS[name] * peak * NOISES[noise](values.size, rng)
        if noise == "offsets":
            seen = seen + peak * rng.uniform(0.5, 1.0) * rng.choice((-1.0, 1.0))
        trial[name] = ("time", seen, clean[name].attrs)
        trial.attrs[f"noise_sd_{name}"] = float(FACTORS[name] * peak)
    return trial
