"""Wavelet denoising of a signal and of a trial by empirical-Bayes thresholding; derivatives of sampled signals."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np
import pywt
import xarray as xr
from numpy.typing import ArrayLike

from pymc_ship.denoising.ebayes import PRIORS, RULES, check_choice, fit_prior, mad, shrink
from pymc_ship.machine.threads import thread_pool
from pymc_ship.trial.record import check_trial

CHANNELS = ("u", "v", "r", "p", "phi", "psi")
"""Motion channels that :func:`denoise` denoises where a trial has them."""

BOUNDARIES = ("reflect", "periodic")
"""The signal, less a parabola with its end slopes, goes on as its mirror image; or it starts again."""

MIN_LENGTH = 16
"""Fewest samples that can be denoised: one level of wavelets and eight coefficients above it."""

_ACCURACY = 1e-11  # of the filters of PyWavelets

DERIVATIVES = ("euler", "central", "savgol")
"""Methods of :func:`derivative`."""


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
        Variables to denoise; by default those of :data:`CHANNELS` that the trial has.
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
    """
    names = [name for name in CHANNELS if name in trial] if channels is None else list(channels)
    if not names:
        raise ValueError(f"Denoising needs one of the channels {', '.join(CHANNELS)}, found none; name the channels.")
    check_trial(trial, names)

    def smoothed(name: str) -> tuple[np.ndarray, float]:
        return _denoise(trial[name].to_numpy(), f"channel {name}", wavelet, prior, translation_invariant, **options)

    with thread_pool(2) as pool:
        results = list(pool.map(smoothed, names))
    smooth = trial.copy()
    for name, (estimate, sdev) in zip(names, results, strict=True):
        smooth[name] = trial[name].copy(data=estimate).assign_attrs(noise_sdev=sdev)
    transform = "translation invariant" if translation_invariant else "decimated"
    record = {"wavelet": wavelet, "transform": transform, "prior": prior, **options}
    record = {f"denoise_{key}": value for key, value in record.items() if value is not None}
    return smooth.assign_attrs(denoised=" ".join(names), **record)


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
        How the signal goes on beyond its ends: see :data:`BOUNDARIES`. "periodic" asks for a length that is a multiple
        of 2**levels.

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
    """
    settings = {"scale": scale, "rule": rule, "levels": levels, "boundary": boundary}
    return _denoise(y, "signal", wavelet, prior, translation_invariant, **settings)[0]


def derivative(
    values: ArrayLike, step: float, method: str = "savgol", *, window: float = 5.0, order: int = 3
) -> np.ndarray:
    """Derivative of a uniformly sampled signal along its last axis.

    Parameters
    ----------
    values : array_like, shape (..., n_time)
    step : float
        Sampling step [s].
    method : {"euler", "central", "savgol"}, optional
        "euler": forward difference over one step, exact for records made by explicit Euler with that step; the last
        sample repeats the last difference. "central": second-order differences, one-sided at the ends. "savgol":
        derivative of the local least-squares polynomial (Savitzky & Golay, Anal. Chem. 36:1627, 1964).
    window : float, optional
        Length of the Savitzky-Golay window [s]; an odd number of samples is taken, at least order + 2.
    order : int, optional
        Order of its polynomial.

    Returns
    -------
    ndarray, shape (..., n_time)
        In units of the signal per second.

    Raises
    ------
    ValueError
        For an unknown method, a step or window that is not positive, an order below 1, values that are not finite and
        a signal shorter than the method needs.
    """
    signal = np.asarray(values, dtype=float)
    check_choice("method", method, DERIVATIVES)
    if not (0.0 < step < math.inf and 0.0 < window < math.inf and order >= 1):
        found = f"{step:g} s, {window:g} s and {order}"
        raise ValueError(f"Step and window must be positive and the order at least 1, found {found}; mend them.")
    length = 2 * max(round(0.5 * window / step), (order + 2) // 2) + 1
    needed = {"euler": 2, "central": 3, "savgol": length}[method]
    n_time = signal.shape[-1] if signal.ndim else 1
    if n_time < needed:
        raise ValueError(f"The method {method} needs {needed} samples, found {n_time}; give more or another window.")
    if not np.isfinite(signal).all():
        raise ValueError("A derivative needs finite values, found NaN or infinity; fill or cut the gaps first.")
    if method == "euler":
        return np.diff(signal, axis=-1, append=2.0 * signal[..., -1:] - signal[..., -2:-1]) / step
    if method == "central":
        return np.gradient(signal, step, axis=-1, edge_order=2)
    from scipy.signal import savgol_filter  # 0.5 s to import

    return savgol_filter(signal, length, order, deriv=1, delta=step, axis=-1)


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
    for kind, choice, choices in (("prior", prior, PRIORS), ("rule", rule, RULES), ("boundary", boundary, BOUNDARIES)):
        check_choice(kind, choice, choices)
    filters = _wavelet(wavelet)
    _check_signal(signal, what)
    levels = _levels(signal.size, levels, what)
    before, after = _margins(signal.size, filters.dec_len, levels, boundary, what)
    trend = _end_trend(signal) if boundary == "reflect" else np.zeros(signal.size)
    padded = np.pad(signal - trend, (before, after), "symmetric")
    approximation, details = _transform(padded, filters, levels, translation_invariant)
    inside = [_inside(detail.size, padded.size, before, after) for detail in details]
    finest = details[-1][inside[-1]]
    sdev = mad(finest - np.median(finest))
    if sdev <= _ACCURACY * np.abs(signal).max():
        return signal.copy(), 0.0
    smooth = []
    for detail, part in zip(details, inside, strict=True):
        weight, fitted, _ = fit_prior(detail[part] / sdev, prior, scale)
        smooth.append(sdev * shrink(detail / sdev, weight, prior, fitted, rule))
    estimate = _inverse(approximation, smooth, filters, translation_invariant)
    return estimate[before : before + signal.size] + trend, sdev


def _transform(
    padded: np.ndarray, filters: pywt.Wavelet, levels: int, translation_invariant: bool
) -> tuple[np.ndarray, list[np.ndarray]]:
    """Approximation and details, coarsest first, of the periodic transform; white noise keeps its variance in all.

    The stationary transform is taken a level at a time over the 2**level interleaved parts of the signal: the same
    numbers as ``pywt.swt``, whose filters stuffed with zeros cost 2**level times as much.
    """
    approximation, details = padded, []
    for level in range(levels):
        if translation_invariant:
            parts = approximation.reshape(-1, 2**level)
            approximation, detail = (part.ravel() for part in pywt.swt(parts, filters, level=1, axis=0)[0])
        else:
            approximation, detail = pywt.dwt(approximation, filters, "periodization")
        details.insert(0, detail)
    return approximation, details


def _inverse(
    approximation: np.ndarray, details: list[np.ndarray], filters: pywt.Wavelet, translation_invariant: bool
) -> np.ndarray:
    """Signal from :func:`_transform`; the stationary one averages over all shifts (the average-basis inverse)."""
    for level, detail in zip(range(len(details) - 1, -1, -1), details, strict=True):
        if translation_invariant:
            parts = approximation.reshape(-1, 2**level), detail.reshape(-1, 2**level)
            approximation = pywt.iswt([parts], filters, axis=0).ravel()
        else:
            approximation = pywt.idwt(approximation, detail, filters, "periodization")
    return approximation


def _end_trend(signal: np.ndarray) -> np.ndarray:
    """Parabola that has the slopes of the signal at its two ends, so that the mirror image of the rest has no kink."""
    n_time = signal.size
    sdev = mad(np.diff(signal, 2)) / math.sqrt(6.0)
    first, last = _end_slope(signal, sdev), -_end_slope(signal[::-1], sdev)
    time = np.arange(n_time) + 0.5
    return first * time + (last - first) * time**2 / (2.0 * n_time)


def _end_slope(signal: np.ndarray, sdev: float) -> float:
    """Slope per sample at the start, of the parabola fitted to the longest run that asks for no cubic.

    Runs grow by doubling until the cubic coefficient exceeds 2.5 standard errors; a slope within five is taken as zero.
    """
    slope, n_run = 0.0, 16
    while 2 * n_run <= signal.size:
        time = (np.arange(n_run) + 0.5) / n_run
        basis, triangle = np.linalg.qr(np.vander(time, 4, increasing=True))
        scores = basis.T @ signal[:n_run]
        if abs(scores[3]) > 2.5 * sdev:
            break
        to_slope = np.linalg.inv(triangle[:3, :3])[1]
        steep = abs(to_slope @ scores[:3]) > 5.0 * sdev * np.linalg.norm(to_slope)
        slope = to_slope @ scores[:3] / n_run if steep else 0.0
        n_run *= 2
    return slope


def _margins(n_time: int, support: int, levels: int, boundary: str, what: str) -> tuple[int, int]:
    """Samples added before and after so that the length is a multiple of 2**levels.

    Mirrored margins reach half the coarsest filter, or half the record, where the two mirror images meet again.
    """
    block = 2**levels
    if boundary == "periodic":
        if n_time % block:
            raise ValueError(
                f"A periodic {what} must have a multiple of 2**levels = {block} samples, found {n_time}; use the "
                "boundary 'reflect' or fewer levels."
            )
        return 0, 0
    margin = min((support - 1) * block // 2, n_time // 2)
    added = -(-(n_time + 2 * margin) // block) * block - n_time
    return added // 2, added - added // 2


def _inside(n_detail: int, n_padded: int, before: int, after: int) -> slice:
    """Coefficients of a level that belong to the record and not to its margins."""
    return slice(before * n_detail // n_padded, n_detail - after * n_detail // n_padded)


def _wavelet(name: str) -> pywt.Wavelet:
    if name not in pywt.wavelist(kind="discrete") or not pywt.Wavelet(name).orthogonal:
        raise ValueError(f"Denoising needs an orthogonal wavelet, found {name!r}; take one such as haar, db4 or sym8.")
    return pywt.Wavelet(name)


def _check_signal(signal: np.ndarray, what: str) -> None:
    if signal.ndim != 1 or signal.size < MIN_LENGTH:
        raise ValueError(
            f"Denoising needs at least {MIN_LENGTH} samples over time alone, found shape {signal.shape} in {what}; "
            "leave it out or take a longer record."
        )
    if not np.isfinite(signal).all():
        raise ValueError(f"Denoising needs finite values, found NaN or infinity in {what}; fill or cut the gaps first.")


def _levels(n_time: int, levels: int | None, what: str) -> int:
    largest = int(math.log2(n_time))
    if levels is None:
        return largest - 3
    if not 1 <= levels <= largest:
        raise ValueError(f"The {what} ({n_time} samples) has 1 to {largest} levels, found {levels}; choose among them.")
    return levels
