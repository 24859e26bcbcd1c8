"""Linear smoothers: each agrees with the textbook, and its parameter is optimal by its criterion."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.signal import butter, savgol_filter, sosfiltfilt
from scipy.stats import multivariate_normal

import pymc_ship as ps
from pymc_ship.records.denoising.smoothers import BUTTERWORTH_ORDER, SMOOTHERS, low_pass, rts, savitzky_golay
from tests.records.denoising.cases import SHAPES, classic
from tests.records.denoising.test_denoise import SMOOTHED, noisy, rms, zigzag


def observed(n_time=600, sd=0.1, seed=1):
    return np.sin(np.arange(n_time) / 25.0) + sd * np.random.default_rng(seed).normal(size=n_time)


def gcv(signal, smoother, n_time):
    """Generalised cross-validation of a linear smoother, its trace from the smoother applied to unit impulses."""
    trace = sum(smoother(row)[k] for k, row in enumerate(np.eye(n_time)))
    return n_time * np.sum((signal - smoother(signal)) ** 2) / (n_time - trace) ** 2


def test_savitzky_golay_is_that_of_scipy_at_the_window_of_least_gcv():
    signal = observed(150)
    result = savitzky_golay(signal)
    window = int(result.parameter)
    assert np.abs(result.estimate - savgol_filter(signal, window, 3)).max() < 1e-12
    scores = {
        w: gcv(signal, lambda y, w=w: savgol_filter(y, w, 3), 150) for w in (window // 2 | 1, window, 2 * window + 1)
    }
    assert min(scores, key=scores.get) == window
    residual = np.sum((signal - result.estimate) ** 2)
    assert scores[window] == pytest.approx(150 * result.sdev**4 / residual, rel=1e-9)  # the trace of the closed form


def filtered(signal, cutoff):
    """Butterworth filter of scipy, run forward and backward over the mirrored signal."""
    n_time = signal.size
    sos = butter(BUTTERWORTH_ORDER, 2.0 * cutoff, output="sos")
    return sosfiltfilt(sos, np.pad(signal, n_time, "symmetric"), padtype=None)[n_time:-n_time]


def test_low_pass_is_the_butterworth_filter_of_scipy_at_the_cutoff_of_least_gcv():
    signal = 3.0 + np.cos(np.linspace(0.0, 12.0 * np.pi, 400)) + 0.1 * np.random.default_rng(2).normal(size=400)
    result = low_pass(signal)
    assert np.abs(result.estimate - filtered(signal, result.parameter)).max() < 1e-3  # the frequency of scipy is warped
    assert np.abs(result.estimate - filtered(signal, 1.15 * result.parameter)).max() > 3e-3
    scores = [gcv(signal, lambda y, f=f: filtered(y, f), 400) for f in result.parameter * np.array([0.6, 1.0, 1.8])]
    assert np.argmin(scores) == 1
    residual = np.sum((signal - result.estimate) ** 2)
    assert scores[1] == pytest.approx(400 * result.sdev**4 / residual, rel=1e-3)


def kalman_smoothed(signal, q):
    """Smoother of Rauch, Tung & Striebel by its recursion, from a nearly flat prior."""
    A, H = np.array([[1.0, 1.0], [0.0, 1.0]]), np.array([1.0, 0.0])
    W = np.diag([0.0, q])
    mean, P, before, after = np.zeros(2), 1e7 * np.eye(2), [], []
    for y in signal:
        before.append((mean, P))
        gain = P @ H / (H @ P @ H + 1.0)
        mean, P = mean + gain * (y - mean[0]), P - np.outer(gain, H @ P)
        after.append((mean, P))
        mean, P = A @ mean, A @ P @ A.T + W
    smooth = [after[-1][0]]
    for k in range(len(signal) - 2, -1, -1):
        G = after[k][1] @ A.T @ np.linalg.inv(before[k + 1][1])
        smooth.insert(0, after[k][0] + G @ (smooth[0] - before[k + 1][0]))
    return np.array(smooth)[:, 0]


def test_the_rts_smoother_is_that_of_the_recursion():
    signal = observed(200)
    result = rts(signal)
    assert np.abs(result.estimate - kalman_smoothed(signal, result.parameter)).max() < 1e-6
    assert np.abs(result.estimate - kalman_smoothed(signal, 2.0 * result.parameter)).max() > 1e-4


def test_q_is_that_of_the_largest_marginal_likelihood():
    """Of the second differences as one normal vector, with the variance at its own maximum."""
    signal = observed(200)
    bends, result = np.diff(signal, 2), rts(signal)
    D = np.diff(np.eye(200), 2, axis=0)

    def log_likelihood(factor, wrong=1.0):
        correlation = result.parameter * factor * np.eye(198) + D @ D.T
        variance = wrong * bends @ np.linalg.solve(correlation, bends) / 198
        return multivariate_normal(cov=variance * correlation).logpdf(bends)

    best = log_likelihood(1.0)
    assert all(log_likelihood(factor) < best for factor in (0.9, 1.1, 0.1, 10.0))
    assert log_likelihood(1.0, wrong=1.3) < best
    assert result.sdev**2 == pytest.approx(
        bends @ np.linalg.solve(result.parameter * np.eye(198) + D @ D.T, bends) / 198, rel=1e-9
    )


def test_q_of_a_random_walk_in_slope_is_found():
    """Of a record made by the model itself: 30 records, within four standard errors of their mean log q."""
    q, result = 1e-4, []
    for seed in range(30):
        rng = np.random.default_rng(seed)
        slope = np.cumsum(np.sqrt(q) * rng.normal(size=2000))
        signal = np.cumsum(slope) + rng.normal(size=2000)
        smooth = rts(signal)
        result.append([np.log(smooth.parameter), np.log(smooth.sdev)])
    mean, error = np.mean(result, axis=0), np.std(result, axis=0, ddof=1) / np.sqrt(30)
    assert np.all(np.abs(mean - [np.log(q), 0.0]) < 4.0 * error)
    assert np.all(np.abs(mean - [np.log(2.0 * q), 0.1]) > 4.0 * error)


@pytest.mark.parametrize("method", SMOOTHERS)
@pytest.mark.parametrize("name", SHAPES)
def test_every_method_comes_nearer_to_the_classic_signals(method, name):
    truth = classic(name)
    records = [truth + np.random.default_rng(seed).normal(size=truth.size) for seed in range(3)]
    left = np.mean([rms(ps.denoise_signal(record, method=method) - truth) for record in records])
    wavelet = np.mean([rms(ps.denoise_signal(record) - truth) for record in records])
    assert wavelet < left < 1.05  # no linear smoother follows a jump


@pytest.mark.parametrize("method", SMOOTHERS)
def test_scale_and_offset_commute(method):
    signal = observed()
    smooth = ps.denoise_signal(signal, method=method)
    other = ps.denoise_signal(3.0 - 1e-3 * signal, method=method)
    assert np.abs(other - (3.0 - 1e-3 * smooth)).max() < 1e-3 * 1e-5


@pytest.mark.parametrize("method", SMOOTHERS)
def test_short_and_smooth_signals_are_taken(method):
    assert ps.denoise_signal(observed(16), method=method).shape == (16,)
    line = 3.0 + 0.1 * np.arange(50)
    assert np.array_equal(ps.denoise_signal(line, method=method), line)
    parabola = np.arange(2000.0) ** 2
    assert np.abs(ps.denoise_signal(parabola, method=method) - parabola).max() < 1e-3 * parabola.max()


@pytest.mark.parametrize("method", SMOOTHERS)
def test_a_trial_says_how_it_was_smoothed(method):
    clean = zigzag()
    result = ps.denoise(noisy(clean, 0.01), method=method)
    parameter = SMOOTHERS[method].parameter
    assert result.attrs == {"vessel": "somebody", "denoised": "u v r psi", "denoise_method": method}
    for name in SMOOTHED:
        sdev = 0.01 * float(abs(clean[name]).max())
        assert result[name].attrs["noise_sdev"] == pytest.approx(sdev, rel=0.1)
        assert result[name].attrs[f"denoise_{parameter}"] > 0.0
        assert rms((result[name] - clean[name]).to_numpy()) < 0.3 * sdev
