"""Sensor noise for simulated trials (Xue et al. 2020, Eq. 22)."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
import xarray as xr

from pymc_ship.trial.record import CHANNELS, TrialError, check_trial

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
