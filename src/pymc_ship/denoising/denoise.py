"""Wavelet denoising of a signal and of a trial by empirical-Bayes thresholding; derivatives of sampled signals."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import xarray as xr
from numpy.typing import ArrayLike

from pymc_ship.denoising import wavelets
from pymc_ship.denoising.ebayes import PRIORS, RULES, fit_prior, mad, shrink
from pymc_ship.machine.arguments import check_choice
from pymc_ship.machine.threads import thread_pool
from pymc_ship.trial.channels import channel_names
from pymc_ship.trial.record import check_trial, one_trial

MIN_LENGTH = 16
"""Fewest samples that can be denoised: one level of wavelets and eight coefficients above it."""


def denoise(
    trial: xr.Dataset,
    wavelet: str = "sym8",
    prior: str = "laplace",
    translation_invariant: bool = True,
    *,
    channels: Sequence[str] | None = None,
    **options: Any,
) -> xr.Dataset:
    """Denoise the motion channels of a trial; everything else stays as it is.

    Parameters
    ----------
    trial : Dataset
        Record over ``time`` [s] with a uniform step; channels in SI units.
    wavelet, prior, translation_invariant
        As for :func:`denoise_signal`.
    channels : sequence of str, optional
        Variables to denoise; by default the motion channels that the trial has, without its track.
    **options
        ``scale``, ``rule``, ``levels``, ``boundary`` of :func:`denoise_signal`.

    Returns
    -------
    Dataset
        The trial with smooth channels; ``noise_sdev`` in the attrs of each, and ``denoised`` (names of the channels),
        ``denoise_wavelet``, ``denoise_transform``, ``denoise_prior`` and the options given in the attrs of the trial.

    Raises
    ------
    ValueError
        For a channel that is missing, not finite or not a function of time alone, for times that are not uniform (as
        :func:`pymc_ship.trial.record.check_trial`), and as :func:`denoise_signal`.

    Examples
    --------
    Error of the sway velocity before and after:

    >>> import numpy as np
    >>> import pymc_ship as ps
    >>> trial = ps.simulate(ps.load_vessel("kvlcc2"), ps.zigzag(20, 20), duration=300, step=0.5)
    >>> noisy = ps.pollute(trial, level=0.01, rng=np.random.default_rng(1))
    >>> for record in (noisy, ps.denoise(noisy)):
    ...     print(f"{1e3 * (record['v'] - trial['v']).std():.0f} mm/s")
    14 mm/s
    3 mm/s
    """
    trial = one_trial(trial)
    known = channel_names(lambda channel: channel.denoised)
    chosen = [name for name in known if name in trial] if channels is None else list(channels)
    if not chosen:
        raise ValueError(f"Denoising needs one of the channels {', '.join(known)}, found none; name the channels.")
    check_trial(trial, chosen)

    def smoothed(name: str) -> tuple[np.ndarray, float]:
        return _denoise(trial[name].to_numpy(), f"channel {name}", wavelet, prior, translation_invariant, **options)

    with thread_pool(2) as pool:
        results = list(pool.map(smoothed, chosen))
    smooth = trial.copy()
    for name, (estimate, sdev) in zip(chosen, results, strict=True):
        smooth[name] = trial[name].copy(data=estimate).assign_attrs(noise_sdev=sdev)
    transform = "translation invariant" if translation_invariant else "decimated"
    record = {"wavelet": wavelet, "transform": transform, "prior": prior, **options}
    record = {f"denoise_{key}": value for key, value in record.items() if value is not None}
    return smooth.assign_attrs(denoised=" ".join(chosen), **record)


def denoise_signal(
    y: ArrayLike,
    wavelet: str = "sym4",
    prior: str = "laplace",
    translation_invariant: bool = True,
    *,
    scale: float | None = None,
    rule: str = "median",
    levels: int | None = None,
    boundary: str = "reflect",
) -> np.ndarray:
    """Denoise a uniformly sampled signal by empirical-Bayes thresholding of its wavelet coefficients.

    Every level of detail is thresholded with its own weight and scale by :mod:`pymc_ship.denoising.ebayes`; the noise
    standard deviation is 1.4826 times the median absolute deviation, about the median, of the finest level; the
    coarsest approximation is left alone. A signal whose noise is zero or within the accuracy of the filters comes back
    as it is.

    Parameters
    ----------
    y : array_like, shape (n_time,)
        Signal, at least :data:`MIN_LENGTH` samples.
    wavelet : str, optional
        An orthogonal wavelet of PyWavelets.
    prior : {"laplace", "cauchy"}, optional
    translation_invariant : bool, optional
        Whether to average over all shifts (stationary transform) or to use the decimated transform.
    scale : float or None, optional
        Scale of the Laplace density; None estimates it.
    rule : {"median", "mean", "hard", "soft"}, optional
    levels : int or None, optional
        Levels of detail; by default floor(log2(n_time)) - 3.
    boundary : {"reflect", "periodic"}, optional
        How the signal goes on beyond its ends, see :data:`~pymc_ship.denoising.wavelets.BOUNDARIES`. "periodic" asks
        for a length that is a multiple of 2**levels.

    Returns
    -------
    ndarray, shape (n_time,)

    Raises
    ------
    ValueError
        For an unknown wavelet, prior, rule or boundary, levels out of range, a signal that is too short, not
        one-dimensional or not finite.

    References
    ----------
    Johnstone & Silverman (2005), Ann. Statist. 33(4):1700, doi:10.1214/009053605000000345.

    Examples
    --------
    Error of a noisy sine before and after:

    >>> import numpy as np
    >>> import pymc_ship as ps
    >>> signal = np.sin(np.linspace(0, 10, 512))
    >>> noisy = signal + 0.1 * np.random.default_rng(1).standard_normal(512)
    >>> print(f"{np.std(noisy - signal):.2f}, {np.std(ps.denoise_signal(noisy) - signal):.2f}")
    0.09, 0.02
    """
    settings = {"scale": scale, "rule": rule, "levels": levels, "boundary": boundary}
    return _denoise(y, "signal", wavelet, prior, translation_invariant, **settings)[0]


def _denoise(
    y: ArrayLike,
    what: str,
    wavelet: str,
    prior: str,
    translation_invariant: bool,
    *,
    scale: float | None = None,
    rule: str = "median",
    levels: int | None = None,
    boundary: str = "reflect",
) -> tuple[np.ndarray, float]:
    """Smooth signal and noise standard deviation; ``what`` names the signal in errors."""
    signal = np.asarray(y, dtype=float)
    for kind, choice, choices in (
        ("prior", prior, PRIORS),
        ("rule", rule, RULES),
        ("boundary", boundary, wavelets.BOUNDARIES),
    ):
        check_choice(f"The {kind}", choice, choices)
    filters = wavelets.orthogonal_wavelet(wavelet)
    _check_signal(signal, what)
    levels = wavelets.whole_levels(signal.size, levels, what)
    before, after = wavelets.margins(signal.size, filters.dec_len, levels, boundary, what)
    trend = wavelets.end_trend(signal) if boundary == "reflect" else np.zeros(signal.size)
    padded = np.pad(signal - trend, (before, after), "symmetric")
    approximation, details = wavelets.transform(padded, filters, levels, translation_invariant)
    inside = [wavelets.inside(detail.size, padded.size, before, after) for detail in details]
    finest = details[-1][inside[-1]]
    sdev = mad(finest - np.median(finest))
    if sdev <= wavelets.ACCURACY * np.abs(signal).max():
        return signal.copy(), 0.0
    smooth = []
    for detail, part in zip(details, inside, strict=True):
        weight, fitted, _ = fit_prior(detail[part] / sdev, prior, scale)
        smooth.append(sdev * shrink(detail / sdev, weight, prior, fitted, rule))
    estimate = wavelets.inverse(approximation, smooth, filters, translation_invariant)
    return estimate[before : before + signal.size] + trend, sdev


def _check_signal(signal: np.ndarray, what: str) -> None:
    if signal.ndim != 1 or signal.size < MIN_LENGTH:
        raise ValueError(
            f"Denoising needs at least {MIN_LENGTH} samples over time alone, found shape {signal.shape} in {what}; "
            "leave it out or take a longer record."
        )
    if not np.isfinite(signal).all():
        raise ValueError(f"Denoising needs finite values, found NaN or infinity in {what}; fill or cut the gaps first.")
