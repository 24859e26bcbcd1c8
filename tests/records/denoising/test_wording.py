"""Sentences of the errors of this wing, each checked once."""

from __future__ import annotations

import re
from functools import partial

import numpy as np
import pywt

import pymc_ship as ps
from pymc_ship.records.denoising.denoise import denoise, denoise_signal
from pymc_ship.records.denoising.derivative import derivative
from pymc_ship.records.denoising.ebayes import ebayes_threshold, posterior_mean, threshold_from_weight
from tests.records.denoising.test_denoise import zigzag
from tests.records.denoising.test_draws import record
from tests.records.denoising.test_smoothers import observed
from tests.sentences import wording


def with_a_gap():
    trial = zigzag(100)
    trial["r"][7] = np.nan
    return trial


def uneven():
    return zigzag(100).assign_coords(time=zigzag(100)["time"].to_numpy() ** 1.1)


test_value_errors = wording(
    ValueError,
    *(
        (
            re.escape(sentence),
            lambda arguments=arguments: denoise_signal(**{"y": np.random.default_rng(4).normal(size=100), **arguments}),
        )
        for arguments, sentence in [
            ({"wavelet": "sym99"}, "orthogonal wavelet, found 'sym99'"),
            ({"wavelet": "bior4.4"}, "orthogonal wavelet, found 'bior4.4'"),
            ({"wavelet": "dmey"}, "orthogonal wavelet, found 'dmey'"),
            ({"wavelet": pywt.Wavelet("dmey")}, "orthogonal wavelet, found pywt._extensions._pywt.Wavel"),
            ({"translation_invariant": "no"}, "translation_invariant is True or False, found 'no'; choose one of them"),
            ({"translation_invariant": np.ones(2)}, "translation_invariant is True or False, found array([1., 1.])"),
            ({"wavelet": "morl"}, "orthogonal wavelet, found 'morl'"),
            ({"prior": "gauss"}, "prior is one of laplace, cauchy; found 'gauss'"),
            ({"rule": "sure"}, "rule is one of median, mean, hard, soft; found 'sure'"),
            ({"boundary": "zero"}, "boundary is one of reflect, periodic; found 'zero'"),
            ({"levels": 0}, "has 1 to 6 levels, found 0"),
            ({"levels": 7}, "has 1 to 6 levels, found 7"),
            ({"boundary": "periodic", "levels": 4}, "multiple of 2**levels = 16 samples, found 100"),
            ({"scale": 0.0}, "scale must be positive and finite, found 0.0"),
            ({"y": np.zeros(15)}, "at least 16 samples over time alone, found shape (15,)"),
            ({"y": np.zeros((20, 20))}, "at least 16 samples over time alone, found shape (20, 20)"),
            ({"y": np.full(20, np.nan)}, "finite values, found NaN or infinity in signal"),
        ]
    ),
    ("Channel r", lambda: denoise(with_a_gap())),
    ("must be uniform", lambda: denoise(uneven())),
    ("found none", lambda: denoise(zigzag(100)[["delta"]])),
    ("p missing", lambda: denoise(zigzag(100), channels=["p"])),
    ("in channel u", lambda: denoise(zigzag(100).isel(time=slice(10)))),
    *(
        (
            re.escape(sentence),
            lambda arguments=arguments: derivative(**{"values": np.zeros(50), "step": 1.0, **arguments}),
        )
        for arguments, sentence in [
            ({"method": "spline"}, "method is one of euler, central, savgol; found 'spline'"),
            ({"step": 0.0}, "must be positive"),
            ({"step": 1.0, "window": -1.0}, "must be positive"),
            ({"order": 0}, "order at least 1"),
            ({"values": [1.0], "method": "euler"}, "euler needs 2 samples, found 1"),
            ({"values": 1.0, "method": "central"}, "central needs 3 samples, found 1"),
            ({"values": [1.0, np.nan, 2.0], "method": "central"}, "finite values"),
        ]
    ),
    *(
        (
            re.escape(sentence),
            lambda arguments=arguments: ps.denoise_signal_draws(
                **{"y": np.random.default_rng(4).normal(size=100), "rng": np.random.default_rng(0), **arguments}
            ),
        )
        for arguments, sentence in [
            ({"draws": 0}, "draws must be a whole number from 1 up, found 0"),
            ({"prior": "gauss"}, "prior is one of laplace, cauchy; found 'gauss'"),
            ({"y": np.full(20, np.nan)}, "finite values, found NaN or infinity in signal"),
        ]
    ),
    ("p missing", lambda: ps.denoise_draws(record(), draws=2, rng=np.random.default_rng(1), channels=["p"])),
    ("savgol needs 251 samples, found 250;", lambda: derivative(np.zeros(250), 0.02)),
    ("A weight is a probability", lambda: threshold_from_weight(1.1)),
    ("A weight is a probability", lambda: posterior_mean(1.0, -0.1)),
    *(
        (re.escape(sentence), lambda arguments=arguments: ebayes_threshold(**arguments))
        for arguments, sentence in [
            ({"x": [1.0], "prior": "gauss"}, "prior is one of laplace, cauchy; found 'gauss'"),
            ({"x": [1.0], "rule": "none"}, "rule is one of median, mean, hard, soft; found 'none'"),
            ({"x": [1.0], "threshold": "sure"}, "threshold is one of posterior_median, bayes_factor; found 'sure'"),
            ({"x": []}, "finite observations, found none"),
            ({"x": [1.0, np.nan, np.inf]}, "finite observations, found 2 that are not"),
            ({"x": [1.0], "sdev": 0.0}, "noise standard deviation must be positive and finite, found 0.0"),
            ({"x": [1.0], "scale": -1.0}, "scale must be positive and finite, found -1.0"),
        ]
    ),
    *(
        (re.escape(sentence), call)
        for arguments, sentence in [
            ({"method": "kalman"}, "method is one of wavelet, savitzky_golay, low_pass, rts; found 'kalman'"),
            ({"method": "rts", "wavelet": "db4", "levels": 3}, "rts chooses its q itself, found wavelet, levels of"),
            ({"method": "low_pass", "rule": "mean"}, "low_pass chooses its cutoff itself, found rule of the wavelets"),
        ]
        for call in [
            partial(ps.denoise_signal, observed(100), **arguments),
            partial(ps.denoise, zigzag(100), **arguments),
        ]
    ),
    ("at least 16 samples", lambda: ps.denoise_signal(np.zeros(15), method="rts")),
)

test_warnings = wording(
    UserWarning,
    *(
        (
            f"^The noise of the signal may be estimated too small, found {share}% of its samples equal to the one "
            "before; export more digits, or each reading of the sensor once.$",
            partial(denoise_signal, np.repeat(np.random.default_rng(5).normal(size=400), times)),
        )
        for share, times in [(50, 2), (90, 10)]
    ),
)
