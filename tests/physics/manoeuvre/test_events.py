"""Events that noise of the sensors does not move: crossings, peaks and the distance run."""

from __future__ import annotations

import numpy as np
import pytest

import pymc_ship as ps
from pymc_ship.physics.manoeuvre.events import Record, first_root
from tests.physics.manoeuvre.test_indices import SPEED, SWITCH, sine

SEEDS = 40
MEAN = 4.0 / np.sqrt(SEEDS)  # standard errors of a mean over the seeds, in standard deviations


def records(interval=0.2, **noise):
    """Records of one sine with noise [SI] on some channels, one for each seed."""
    clean = sine(interval, duration=120.0)
    time, channels = clean["time"].values, {name: values.values for name, values in clean.data_vars.items()}
    for seed in range(SEEDS):
        rng = np.random.default_rng(seed)
        noisy = {name: channels[name] + sd * rng.standard_normal(time.size) for name, sd in noise.items()}
        yield Record(time, channels | noisy)


def unbiased(values, exact):
    values = np.array(values)
    return abs(values.mean() - exact) <= MEAN * values.std()


class TestDistance:
    def test_it_does_not_grow_with_the_noise_of_positions(self):
        """1 m of GNSS noise at 5 Hz makes the sum of lengths half as long again."""
        distances, summed = [], []
        for record in records(x=1.0, y=1.0, u=0.05, v=0.05, psi=2e-3):
            distances.append(record.distance(SWITCH))
            until = record.time < SWITCH
            summed.append(np.hypot(np.diff(record.motion["x"][until]), np.diff(record.motion["y"][until])).sum())
        assert np.mean(summed) > 1.3 * SPEED * SWITCH
        assert unbiased(distances, SPEED * SWITCH)
        assert np.std(distances) < 3.0

    def test_nor_does_it_depend_on_the_axes_of_the_track(self):
        run = sine(0.5)
        turned = run.assign(x=-run["y"], y=run["x"])
        name = "initial_turning_distance"
        assert float(ps.indices(turned)[name]) == pytest.approx(float(ps.indices(run)[name]), rel=5e-3)


class TestCrossing:
    def test_a_noisy_heading_does_not_reach_it_early(self):
        crossings, first = [], []
        for record in records(psi=1e-2):
            crossings.append(record.crossing(np.deg2rad(20.0), 1.0))
            first.append(record.time[np.argmax(record.motion["psi"] >= np.deg2rad(20.0))])
        assert not unbiased(first, SWITCH)
        assert unbiased(crossings, SWITCH)

    def test_a_record_that_ends_as_noise_takes_the_heading_back_still_rose_through_it(self):
        """Above the heading at 4 s, below again at 5 s: the rise before 4 s counts, not the fall after it."""
        time, psi, zero = np.arange(6.0), np.array([0.0, 0.02, 0.04, 0.06, 0.11, 0.09]), np.zeros(6)
        channels = {"psi": psi, "r": np.full(6, 0.02)} | dict.fromkeys(("u", "v", "phi", "x", "y"), zero)
        assert 3.0 < Record(time, channels).crossing(0.1, 1.0) < 4.0


class TestPeak:
    def test_a_noisy_yaw_rate_does_not_turn_back_early(self):
        peaks, first = [], []
        for record in records(r=1e-3):
            peaks.append(record.peak(SWITCH))
            later = record.time > SWITCH
            first.append(record.time[later][np.argmax(record.psi_dot[later] <= 0.0)])
        assert not unbiased(first, 50.0)
        assert unbiased(peaks, 50.0)
        assert np.std(peaks) < 2.0

    def test_a_record_that_ends_before_has_none(self):
        clean = sine(0.2, duration=45.0)
        record = Record(clean["time"].values, {name: values.values for name, values in clean.data_vars.items()})
        assert np.isnan(record.peak(SWITCH))


class TestRoot:
    def test_it_is_the_first_of_the_roots_within_the_bounds(self):
        rng, missed = np.random.default_rng(3), 0
        for degree in np.tile([1, 2, 3], 200):
            roots, end = np.sort(rng.uniform(-1.0, 3.0, degree)), rng.uniform(0.5, 2.5)
            start = rng.uniform(0.0, end)
            inside = roots[(roots >= start) & (roots <= end)]
            root = first_root((10.0 ** rng.uniform(-6, 6) * np.poly(roots)[::-1]).tolist(), start, end)
            missed += inside.size == 0
            assert np.isnan(root) if inside.size == 0 else root == pytest.approx(inside[0], abs=1e-7)
        assert 100 < missed < 500

    @pytest.mark.parametrize("coefficients", [(1.0, 0.0, 1.0), (0.5, 0.0, 0.0, 0.0), (-1.0, 0.0, 0.0, 1e-3)])
    def test_there_is_none(self, coefficients):
        assert np.isnan(first_root(coefficients, 0.0, 2.0))

    def test_one_at_a_bound_counts(self):
        assert first_root((0.0, 1.0), 0.0, 1.0) == 0.0
        assert first_root((-1.0, 1.0), 0.0, 1.0) == 1.0
