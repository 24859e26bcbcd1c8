"""Denoising of a signal and of a trial: wavelets with empirical-Bayes thresholding, and the smoothers beside them."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from inspect import signature
from typing import Any

import numpy as np
import xarray as xr
from numpy.typing import ArrayLike

from pymc_ship.machine.arguments import check_choice
from pymc_ship.machine.threads import thread_pool
from pymc_ship.records.denoising.ebayes import RULES
from pymc_ship.records.denoising.shrinkage import shrinkage
from pymc_ship.records.denoising.smoothers import SMOOTHERS, smooth_signal
from pymc_ship.trial.channels import channel_names
from pymc_ship.trial.record import as_trial, check_trial

METHODS = ("wavelet", *SMOOTHERS)
"""Methods of :func:`denoise`."""

MIN_LENGTH = 16
"""Fewest samples that can be denoised: one level of wavelets and eight coefficients above it."""


def denoise(
    trial: xr.Dataset,
    wavelet: str = "sym8",
    prior: str = "laplace",
    translation_invariant: bool = True,
    *,
    method: str = "wavelet",
    channels: Sequence[str] | None = None,
    **options: Any,
) -> xr.Dataset:
    """Denoise the motion channels of a trial; everything else stays as it is.

    Parameters
    ----------
    trial : Dataset
        Record over ``time`` [s] with a uniform step; channels in SI units.
    wavelet, prior, translation_invariant, method
        As for :func:`denoise_signal`.
    channels : sequence of str, optional
        Variables to denoise; by default the motion channels that the trial has, without its track.
    **options
        ``scale``, ``rule``, ``levels``, ``boundary`` of :func:`denoise_signal`.

    Returns
    -------
    Dataset
        The trial with smooth channels; ``noise_sdev`` in the attrs of each, and ``denoised`` (names of the channels),
        ``denoise_wavelet``, ``denoise_transform``, ``denoise_prior`` and the options given in the attrs of the trial;
        for the other methods ``denoise_method`` there and the parameter chosen, such as ``denoise_window``, in the
        attrs of each channel.

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
    trial = as_trial(trial)
    choice = {"wavelet": wavelet, "prior": prior, "translation_invariant": translation_invariant}
    _check_method(method, denoise, choice | options)
    chosen = denoised_channels(trial, channels)

    def smooth(name: str) -> tuple[np.ndarray, dict[str, Any]]:
        return _denoised(trial[name].to_numpy(), f"channel {name}", method, choice | options)

    with thread_pool(2) as pool:
        results = list(pool.map(smooth, chosen))
    found = trial.copy()
    for name, (estimate, said) in zip(chosen, results, strict=True):
        found[name] = trial[name].copy(data=estimate).assign_attrs(said)
    transform = "translation invariant" if translation_invariant else "decimated"
    record = {"wavelet": wavelet, "transform": transform, "prior": prior, **options}
    record = {"method": method} if method in SMOOTHERS else record
    record = {f"denoise_{key}": value for key, value in record.items() if value is not None}
    return found.assign_attrs(denoised=" ".join(chosen), **record)


def denoised_channels(trial: xr.Dataset, channels: Sequence[str] | None) -> list[str]:
    """Names of the channels to denoise, by default the motion that a trial has; each is finite over uniform time."""
    known = channel_names(lambda channel: channel.denoised)
    chosen = [name for name in known if name in trial] if channels is None else list(channels)
    if not chosen:
        raise ValueError(f"Denoising needs one of the channels {', '.join(known)}, found none; name the channels.")
    check_trial(trial, chosen)
    return chosen


def denoise_signal(
    y: ArrayLike,
    wavelet: str = "sym4",
    prior: str = "laplace",
    translation_invariant: bool = True,
    *,
    method: str = "wavelet",
    scale: float | None = None,
    rule: str = "median",
    levels: int | None = None,
    boundary: str = "reflect",
) -> np.ndarray:
    """Denoise a uniformly sampled signal, by empirical-Bayes thresholding of its wavelet coefficients or a smoother.

    Every level of detail is thresholded with its own weight and scale by :mod:`pymc_ship.records.denoising.ebayes`; the
    noise standard deviation is 1.4826 times the median absolute deviation, about the median, of the finest level; the
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
    method : {"wavelet", "savitzky_golay", "low_pass", "rts"}, optional
        The smoothers beside the wavelets choose their one parameter from the signal, by generalised cross-validation
        (the window of local cubics; the cut-off of a Butterworth filter run forward and backward) or by marginal
        likelihood (the variance of a slope that is a random walk), and take no other option.
    scale : float or None, optional
        Scale of the Laplace density; None estimates it.
    rule : {"median", "mean", "hard", "soft"}, optional
    levels : int or None, optional
        Levels of detail; by default floor(log2(n_time)) - 3.
    boundary : {"reflect", "periodic"}, optional
        How the signal goes on beyond its ends, see :data:`~pymc_ship.records.denoising.wavelets.BOUNDARIES`. "periodic"
        asks for a length that is a multiple of 2**levels.

    Returns
    -------
    ndarray, shape (n_time,)

    Raises
    ------
    ValueError
        For an unknown method, wavelet, prior, rule or boundary, levels out of range, options that the method does not
        have, a signal that is too short, not one-dimensional or not finite.

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
    settings = {"wavelet": wavelet, "prior": prior, "translation_invariant": translation_invariant, "scale": scale}
    settings |= {"rule": rule, "levels": levels, "boundary": boundary}
    _check_method(method, denoise_signal, settings)
    return _denoised(y, "signal", method, settings)[0]


def _denoised(y: ArrayLike, what: str, method: str, settings: dict[str, Any]) -> tuple[np.ndarray, dict[str, Any]]:
    """Smooth signal and what its record says of it; ``what`` names the signal in errors."""
    signal = finite_signal(y, what)
    if method in SMOOTHERS:
        found = smooth_signal(signal, method)
        return found.estimate, {"noise_sdev": found.sdev, f"denoise_{SMOOTHERS[method].parameter}": found.parameter}
    rule = settings.get("rule", "median")
    check_choice("The rule", rule, RULES)
    shrunk = shrinkage(signal, what, **{name: value for name, value in settings.items() if name != "rule"})
    return shrunk.estimate(rule), {"noise_sdev": shrunk.sdev}


def _check_method(method: str, function: Callable[..., object], settings: dict[str, Any]) -> None:
    """Refuse an unknown method, and settings of the wavelets for a method that has none."""
    check_choice("The method", method, METHODS)
    defaults = {name: argument.default for name, argument in signature(function).parameters.items()}
    changed = [name for name, value in settings.items() if value != defaults.get(name)]
    if method in SMOOTHERS and changed:
        raise ValueError(
            f"The method {method} chooses its {SMOOTHERS[method].parameter} itself, found {', '.join(changed)} of the "
            "wavelets; leave it out."
        )


def finite_signal(y: ArrayLike, what: str) -> np.ndarray:
    """Signal as an array of finite numbers that is long enough."""
    signal = np.asarray(y, dtype=float)
    if signal.ndim != 1 or signal.size < MIN_LENGTH:
        raise ValueError(
            f"Denoising needs at least {MIN_LENGTH} samples over time alone, found shape {signal.shape} in {what}; "
            "leave it out or take a longer record."
        )
    if not np.isfinite(signal).all():
        raise ValueError(f"Denoising needs finite values, found NaN or infinity in {what}; fill or cut the gaps first.")
    return signal
