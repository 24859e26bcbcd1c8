"""The stationary wavelet transform against PyWavelets, and its inverse."""

from __future__ import annotations

from contextlib import suppress

import numpy as np
import pytest
import pywt

from pymc_ship.records.denoising.wavelets import inverse, orthogonal_wavelet, transform


@pytest.mark.parametrize("wavelet", ["haar", "sym8"])
def test_stationary_transform_is_that_of_pywavelets(wavelet):
    signal = np.random.default_rng(0).normal(size=192)
    approximation, details = transform(signal, pywt.Wavelet(wavelet), 6, True)
    for ours, theirs in zip([approximation, *details], pywt.swt(signal, wavelet, 6, trim_approx=True), strict=True):
        assert np.abs(ours - theirs).max() < 1e-13
    details[2] *= 0.5  # no longer the transform of a signal: the inverse has to average
    ours = inverse(approximation, details, pywt.Wavelet(wavelet), True)
    assert np.abs(ours - pywt.iswt([approximation, *details], wavelet)).max() < 1e-12


@pytest.mark.parametrize("translation_invariant", [True, False])
def test_transform_is_reversed_and_keeps_the_variance_of_noise(translation_invariant):
    signal = np.random.default_rng(1).normal(size=2**14)
    filters = pywt.Wavelet("sym8")
    approximation, details = transform(signal, filters, 4, translation_invariant)
    for detail in details:
        assert np.var(detail) == pytest.approx(1.0, abs=5.0 * np.sqrt(2.0 * 2**4 / signal.size))
    assert np.abs(inverse(approximation, details, filters, translation_invariant) - signal).max() < 1e-11


def test_wavelets_are_orthogonal_by_their_filters():
    """The flag of PyWavelets also marks one whose filters lose a part of the signal."""
    signal = np.random.default_rng(2).normal(size=256)
    accepted = set()
    for name in pywt.wavelist(kind="discrete"):
        with suppress(ValueError):
            filters = orthogonal_wavelet(name)
            accepted.add(name)
            assert (
                np.abs(pywt.idwt(*pywt.dwt(signal, filters, "periodization"), filters, "periodization") - signal).max()
                < 1e-9
            )
    flagged = {name for name in pywt.wavelist(kind="discrete") if pywt.Wavelet(name).orthogonal}
    assert accepted ^ flagged == {"dmey", "bior1.1", "rbio1.1"}  # the last two are the Haar wavelet
