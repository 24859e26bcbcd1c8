"""Denoising of a signal and of a trial, by empirical-Bayes thresholding of wavelets or by a smoother."""

from collections.abc import Callable, Sequence
from inspect import signature
from typing import Any

import numpy as np
import xarray as xr
from numpy.typing import ArrayLike

from pymc_ship.machine.arguments import check_choice, name_list, real_array
from pymc_ship.machine.errors import ShipError
from pymc_ship.machine.threads import map_in_threads
from pymc_ship.records.denoising.ebayes import RULES
from pymc_ship.records.denoising.smoothers import SMOOTHERS, smooth_signal
from pymc_ship.records.denoising.wavelet_posterior import wavelet_posterior
from pymc_ship.trial.channels import CHANNELS, channel_names
from pymc_ship.trial.record import as_trial, check_trial
from pymc_ship.trial.units import RADIAN

METHODS = ("wavelet", *SMOOTHERS)
MIN_LENGTH = 16  # samples: one level of wavelets and eight coefficients of the approximation


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
    """Denoise the motion channels of a trial.

    Parameters
    ----------
    trial : Dataset
        Record over ``time`` [s] with a uniform step; channels in SI units.
    wavelet, prior, translation_invariant, method
        As for :func:`denoise_signal`.
    channels : sequence of str, optional
        Variables to denoise; by default the motion channels of the trial, without its track.
    **options
        ``scale``, ``rule``, ``levels``, ``boundary`` of :func:`denoise_signal`.

    Returns
    -------
    Dataset
        Trial with denoised channels; angles keep their jumps of whole turns. Its attrs: ``denoised`` (names of the
        channels), ``denoise_wavelet``, ``denoise_transform``, ``denoise_prior`` and the options, or ``denoise_method``
        of a smoother. Attrs of each channel: ``noise_sdev`` and the parameter of a smoother, such as
        ``denoise_window``.

    Raises
    ------
    ValueError
        For channels that are missing, repeated, not finite or not over time alone, for uneven times and the time
        itself, and as :func:`denoise_signal`.

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
    choice: dict[str, Any] = {
        "wavelet": wavelet,
        "prior": prior,
        "translation_invariant": translation_invariant,
    } | options
    _check_method(method, denoise, choice)
    names = channels_to_denoise(trial, channels)

    def smooth(name: str) -> tuple[np.ndarray, dict[str, Any]]:
        values, turns = without_turns(trial, name)
        estimate, attrs = _denoise(values, f"channel {name}", method, choice)
        return estimate + turns, attrs

    results = map_in_threads(smooth, names)
    denoised = trial.copy()
    for name, (estimate, attrs) in zip(names, results, strict=True):
        denoised[name] = trial[name].copy(data=estimate).assign_attrs(attrs)
    transform = "translation invariant" if translation_invariant else "decimated"
    record = {"wavelet": wavelet, "transform": transform, "prior": prior, **options}
    record = {"method": method} if method in SMOOTHERS else record
    attrs = {f"denoise_{key}": value for key, value in record.items() if value is not None}
    return denoised.assign_attrs(attrs, denoised=" ".join(names))


def channels_to_denoise(trial: xr.Dataset, channels: Sequence[str] | None) -> list[str]:
    """Names of the channels to denoise, checked; by default the motion channels of the trial."""
    motion_names = channel_names(lambda channel: channel.denoised)
    given = [name for name in motion_names if name in trial] if channels is None else channels
    names = list(name_list("The channels", given))
    if not names:
        raise ShipError(
            f"Denoising needs one of the channels {', '.join(motion_names)}, found none; name the channels."
        )
    if "time" in names:
        raise ShipError("Denoising needs channels over time, found the time itself; leave it out.")
    check_trial(trial, names)
    return names


def without_turns(trial: xr.Dataset, name: str) -> tuple[np.ndarray, np.ndarray]:
    """Channel, unwrapped if it is an angle, and the whole turns that this takes off each sample."""
    values = trial[name].to_numpy()
    if name not in CHANNELS or CHANNELS[name].unit != RADIAN:
        return values, np.zeros(values.shape)
    unwrapped = np.unwrap(values)
    return unwrapped, values - unwrapped


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
    """Denoise a uniformly sampled signal.

    Every level of detail has its own weight and scale; the noise sd is 1.4826 times the median absolute deviation,
    about the median, of the finest level where the signal moves, and at least step / 12^(1/2) for rounded values. A
    signal without noise is returned unchanged. A UserWarning where repeated values hide the noise.

    Parameters
    ----------
    y : array_like, shape (n_time,)
        At least :data:`MIN_LENGTH` samples.
    wavelet : str, optional
        An orthogonal wavelet of PyWavelets.
    prior : {"laplace", "cauchy"}, optional
    translation_invariant : bool, optional
        Whether to average over all shifts (stationary transform) or to use the decimated transform.
    method : {"wavelet", "savitzky_golay", "low_pass", "rts"}, optional
        The smoothers take no option: generalised cross-validation or marginal likelihood chooses their parameter.
    scale : float or None, optional
        Scale of the Laplace density; None estimates it.
    rule : {"median", "mean", "hard", "soft"}, optional
    levels : int or None, optional
        Levels of detail; by default floor(log2(n_time)) - 3.
    boundary : {"reflect", "periodic"}, optional
        See :data:`~pymc_ship.records.denoising.wavelets.BOUNDARIES`. "periodic" needs a multiple of 2**levels samples.

    Returns
    -------
    ndarray, shape (n_time,)

    Raises
    ------
    ValueError
        For an unknown method, wavelet, prior, rule or boundary, levels out of range, options of another method, or a
        signal that is too short, not one-dimensional or not finite.

    References
    ----------
    Johnstone & Silverman (2005), Ann. Statist. 33(4):1700, doi:10.1214/009053605000000345.

    Examples
    --------
    >>> import numpy as np
    >>> import pymc_ship as ps
    >>> signal = np.sin(np.linspace(0.0, 12.0, 1024))
    >>> noisy = signal + 0.1 * np.random.default_rng(1).standard_normal(signal.size)
    >>> print(f"{np.std(ps.denoise_signal(noisy) - signal):.3f}")
    0.013
    """
    settings = {"wavelet": wavelet, "prior": prior, "translation_invariant": translation_invariant, "scale": scale}
    settings |= {"rule": rule, "levels": levels, "boundary": boundary}
    _check_method(method, denoise_signal, settings)
    return _denoise(y, "signal", method, settings)[0]


def _denoise(y: ArrayLike, what: str, method: str, settings: dict[str, Any]) -> tuple[np.ndarray, dict[str, Any]]:
    """Denoised signal and its attrs; ``what`` names the signal in errors."""
    signal = finite_signal(y, what)
    if method in SMOOTHERS:
        smooth = smooth_signal(signal, method)
        return smooth.estimate, {"noise_sdev": smooth.sdev, f"denoise_{SMOOTHERS[method].parameter}": smooth.parameter}
    rule = settings.get("rule", "median")
    check_choice("The rule", rule, RULES)
    posterior = wavelet_posterior(signal, what, **{name: value for name, value in settings.items() if name != "rule"})
    return posterior.estimate(rule), {"noise_sdev": posterior.sdev}


def _check_method(method: str, function: Callable[..., object], settings: dict[str, Any]) -> None:
    check_choice("The method", method, METHODS)
    defaults = {name: argument.default for name, argument in signature(function).parameters.items()}
    plain = (str, bool, int, float, type(None))
    changed = [name for name, value in settings.items() if not isinstance(value, plain) or value != defaults.get(name)]
    if method in SMOOTHERS and changed:
        raise ShipError(
            f"The method {method} chooses its {SMOOTHERS[method].parameter} itself, found {', '.join(changed)} of the "
            "wavelets; leave it out."
        )


def finite_signal(y: ArrayLike, what: str) -> np.ndarray:
    """Signal as an array, checked for length and finite values."""
    signal = real_array(f"The {what}", y)
    if signal.ndim != 1 or signal.size < MIN_LENGTH:
        raise ShipError(
            f"Denoising needs at least {MIN_LENGTH} samples over time alone, found shape {signal.shape} in {what}; "
            "leave it out or take a longer record."
        )
    if not np.isfinite(signal).all():
        raise ShipError(f"Denoising needs finite values, found NaN or infinity in {what}; fill or cut the gaps first.")
    return signal
