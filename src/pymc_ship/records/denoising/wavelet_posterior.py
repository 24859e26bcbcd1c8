"""Spike-and-slab posterior of the wavelet coefficients of a signal: point estimates and draws."""

import warnings
from dataclasses import dataclass

import numpy as np
import pywt

from pymc_ship.machine.arguments import check_choice, check_flags
from pymc_ship.records.denoising import wavelets
from pymc_ship.records.denoising.ebayes import PRIORS, fit_prior, mad, posterior_draw, shrink

REPEATS = 0.25  # fraction of samples equal to the one before, from which repeated values hide the noise


@dataclass(frozen=True)
class WaveletPosterior:
    """A signal with its extension past the ends, and the prior of its wavelet coefficients at every level.

    ``padded`` is ``signal`` minus ``trend``, with ``before`` samples in front, a multiple of 2**levels; its transform
    are ``approximation`` and ``details``.
    ``level_priors``: weight and scale of each level of detail, coarsest first, in units of the noise ``sdev``; empty if
    that is 0, within the accuracy of the filters. Translation invariant, the posterior is a mixture over all shifts.
    """

    signal: np.ndarray
    trend: np.ndarray
    padded: np.ndarray
    before: int
    approximation: np.ndarray
    details: list[np.ndarray]
    filters: pywt.Wavelet
    translation_invariant: bool
    prior: str
    level_priors: tuple[tuple[float, float], ...]
    sdev: float

    def estimate(self, rule: str) -> np.ndarray:
        """Point estimate by one of :data:`pymc_ship.records.denoising.ebayes.RULES`, shape (n_time,)."""
        if not self.sdev:
            return self.signal.copy()
        smooth = [
            self.sdev * shrink(detail / self.sdev, weight, self.prior, scale, rule)
            for detail, (weight, scale) in zip(self.details, self.level_priors, strict=True)
        ]
        padded = wavelets.inverse(self.approximation, smooth, self.filters, self.translation_invariant)
        return self._without_margins(padded)

    def draw(self, rng: np.random.Generator) -> np.ndarray:
        """One posterior draw, shape (n_time,), at a random shift if translation invariant."""
        if not self.sdev:
            return self.signal.copy()
        levels = len(self.details)
        shift = int(rng.integers(2**levels)) if self.translation_invariant else 0
        approximation, details = wavelets.transform(np.roll(self.padded, -shift), self.filters, levels, False)
        # the coarsest approximation has a flat prior
        approximation = approximation + self.sdev * rng.standard_normal(approximation.size)
        detail_draws = [
            self.sdev * posterior_draw(detail / self.sdev, weight, self.prior, scale, rng=rng)
            for detail, (weight, scale) in zip(details, self.level_priors, strict=True)
        ]
        padded = np.roll(wavelets.inverse(approximation, detail_draws, self.filters, False), shift)
        return self._without_margins(padded)

    def _without_margins(self, padded: np.ndarray) -> np.ndarray:
        return padded[self.before : self.before + self.signal.size] + self.trend


def wavelet_posterior(
    signal: np.ndarray,
    name: str,
    wavelet: str,
    prior: str,
    translation_invariant: bool,
    *,
    scale: float | None = None,
    levels: int | None = None,
    boundary: str = "reflect",
) -> WaveletPosterior:
    """Posterior of a finite signal; parameters as :func:`pymc_ship.denoise_signal`, ``name`` is that in errors."""
    check_flags(translation_invariant=translation_invariant)
    check_choice("The prior", prior, PRIORS)
    check_choice("The boundary", boundary, wavelets.BOUNDARIES)
    filters = wavelets.orthogonal_wavelet(wavelet)
    levels = wavelets.whole_levels(signal.size, levels, name)
    before, after = wavelets.margins(signal.size, filters.dec_len, levels, boundary, name)
    trend = wavelets.end_trend(signal) if boundary == "reflect" else np.zeros(signal.size)
    padded = np.pad(signal - trend, (before, after), "symmetric")
    approximation, details = wavelets.transform(padded, filters, levels, translation_invariant)
    inside = [detail[wavelets.inside(detail.size, padded.size, before, after)] for detail in details]
    sdev = _noise_sdev(signal, inside[-1], name)
    level_priors = tuple(fit_prior(detail / sdev, prior, scale)[:2] for detail in inside) if sdev else ()
    return WaveletPosterior(
        signal=signal,
        trend=trend,
        padded=padded,
        before=before,
        approximation=approximation,
        details=details,
        filters=filters,
        translation_invariant=translation_invariant,
        prior=prior,
        level_priors=level_priors,
        sdev=sdev,
    )


def _noise_sdev(signal: np.ndarray, detail: np.ndarray, name: str) -> float:
    """Noise standard deviation from the finest detail where the signal moves, at least that of its rounding.

    0 within the accuracy of the filters; a UserWarning where repeated values hide the noise.
    """
    mask, rounding = wavelets.moving(signal), wavelets.rounding_sdev(signal)
    finest = detail[mask[np.arange(detail.size) * signal.size // detail.size]]
    repeats = float(np.mean(np.diff(signal[mask]) == 0.0)) if np.ptp(signal) else 0.0
    if repeats > REPEATS and not rounding:
        warnings.warn(
            f"The noise of the {name} may be estimated too small, found {repeats:.0%} of its samples equal to the one "
            "before; export more digits, or each reading of the sensor once.",
            UserWarning,
            stacklevel=5,
        )
    sdev = max(mad(finest - np.median(finest)), rounding)
    return sdev if sdev > wavelets.ACCURACY * np.abs(signal).max() else 0.0
