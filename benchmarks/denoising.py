"""The denoiser beside wavelet thresholding of PyWavelets and scikit-image, and EbayesThresh in R."""

from __future__ import annotations

import warnings
from collections.abc import Iterator

import numpy as np
import pywt

import pymc_ship as ps
from benchmarks import r_peers
from benchmarks.table import Row, imported, median_seconds
from pymc_ship.records.denoising.ebayes import ebayes_threshold

CHANNELS = ("u", "v", "r", "p", "phi")


def universal_soft(y: np.ndarray, wavelet: str = "sym8", levels: int = 6) -> np.ndarray:
    """Translation-invariant universal soft thresholding with PyWavelets, as its documentation shows."""
    size = -len(y) % 2**levels
    approximation, *details = pywt.swt(np.pad(y, (0, size), "symmetric"), wavelet, levels, trim_approx=True, norm=True)
    sd = np.median(np.abs(details[-1])) / 0.6745
    kept = [pywt.threshold(d, sd * np.sqrt(2.0 * np.log(d.size)), "soft") for d in details]
    return pywt.iswt([approximation, *kept], wavelet, norm=True)[: len(y)]


def _bayes_shrink(y: np.ndarray, restoration) -> np.ndarray:
    """Sixteen shifts of BayesShrink with scikit-image, as its documentation shows."""
    settings = {"wavelet": "sym8", "method": "BayesShrink", "mode": "soft", "rescale_sigma": True}
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # it would say that dask is missing
        return restoration.cycle_spin(y, restoration.denoise_wavelet, 15, func_kw=settings, workers=1)


def _errors(found: dict, trial) -> np.ndarray:
    """Root mean square error of each channel."""
    return np.array([np.sqrt(np.mean((np.asarray(found[c]) - trial[c].values) ** 2)) for c in CHANNELS])


def denoising(trial, noisy) -> Iterator[Row]:
    """Five channels of 20000 samples; the check is the error of ours over the peer's, mean over the channels."""
    what, check = "denoise 5 x 20000, translation invariant", "mean RMSE ours / its"
    ps.denoise(noisy, channels=CHANNELS)
    ours, smooth = median_seconds(lambda: ps.denoise(noisy, channels=CHANNELS), 3)
    error = _errors({c: smooth[c].values for c in CHANNELS}, trial)

    def row(peer, work, repeats):
        theirs, found = median_seconds(lambda: {c: work(noisy[c].values) for c in CHANNELS}, repeats)
        its = _errors(found, trial)
        note = f"RMSE of v {error[1]:.2e} against {its[1]:.2e} m/s"
        return Row(what, ours, peer, theirs, check, float(np.mean(error / its)), 1.0, note=note)

    yield row("PyWavelets swt, universal soft", universal_soft, 3)
    peer = "scikit-image BayesShrink, 16 shifts"
    restoration = imported("skimage.restoration", what, peer)
    yield row(peer, lambda y: _bayes_shrink(y, restoration), 1)


def ebayes_thresh() -> Iterator[Row]:
    """Thresholding of the same 20000 coefficients by EbayesThresh in R."""
    what, peer = "EB threshold of 20000 coefficients", "R EbayesThresh"
    rng = np.random.default_rng(0)
    x = rng.standard_normal(20000) + np.where(rng.random(20000) < 0.05, 4.0 * rng.standard_normal(20000), 0.0)
    theirs, found = r_peers.seconds(r_peers.EBAYES_THRESH, x[:, None], {}, what, peer)
    ebayes_threshold(x[:100])
    ours, own = median_seconds(lambda: ebayes_threshold(x), 5)
    yield Row(what, ours, peer, theirs, "max |d| [noise sd]", float(np.abs(own.estimate - found[:, 0]).max()), 1e-3)
