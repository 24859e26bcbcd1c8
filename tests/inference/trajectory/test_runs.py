"""Trials as arrays of the trajectory likelihood: averages, estimates and errors."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import pymc_ship as ps
from pymc_ship.inference.trajectory.runs import trajectory_run
from tests.inference.trajectory.cases import SD, record, rough, unmodelled_roll_text
from tests.sentences import refused


@pytest.fixture(scope="module")
def trial(container):
    """A zigzag that is recorded from 30 s on, with heading and track."""
    return record(container, ps.zigzag(20.0, 20.0), duration=60.0, begin=30.0)


@pytest.fixture(scope="module")
def noisy(trial):
    return rough(trial, 0)


class TestRun:
    def test_a_run_has_the_noise_of_its_channels_or_what_is_given(self, container, noisy):
        run = trajectory_run(noisy, container, noise_sd={"v": 0.1, "x": 3.0})
        expected = [SD["u"], 0.1, SD["r"], SD["p"], SD["phi"]]
        np.testing.assert_allclose(run.sample_sd, expected, rtol=0.25)
        assert run.sample_sd[1] == 0.1

    def test_blocks_are_means_of_a_fifth_of_a_second(self, container, noisy):
        run = trajectory_run(noisy.isel(time=slice(0, -1)), container)
        assert (run.block, run.substeps, run.n_blocks, run.n_states) == (2, 1, 299, 5)
        u = noisy["u"].values
        np.testing.assert_allclose(run.means[0], 0.5 * (u[:598:2] + u[1:598:2]), rtol=1e-14)
        np.testing.assert_allclose(run.time, 30.05 + 0.2 * np.arange(299), rtol=1e-12)
        assert run.inputs.shape[1] == 599

    @pytest.mark.parametrize(("stride", "block"), [(1, 2), (2, 1), (5, 1), (10, 1)])
    @pytest.mark.parametrize(("method", "steps"), [("rk4", 60), ("euler", 240)])
    @pytest.mark.parametrize("ship_time", [1.0, 22.0, 60.0])
    def test_steps_are_fractions_of_a_ship_length(self, container, noisy, stride, block, method, steps, ship_time):
        s = container.particulars
        ship = replace(container, particulars=replace(s, nominal_speed=s.L / ship_time))
        run = trajectory_run(noisy.isel(time=slice(None, None, stride)), ship, method=method)
        assert run.block == block
        assert run.interval == pytest.approx(0.1 * stride)
        step, longest = run.interval / run.substeps, ship_time / steps
        assert step <= longest * (1.0 + 1e-9)
        assert run.substeps == 1 or run.interval / (run.substeps - 1) > longest

    def test_channels_are_those_there_are(self, container, noisy):
        assert trajectory_run(noisy, container).channels == ("u", "v", "r", "p", "phi")
        assert trajectory_run(noisy.drop_vars(["v", "p"]), container).channels == ("u", "r", "phi")
        assert trajectory_run(noisy, unmodelled_roll_text(container)).channels == ("u", "v", "r")

    @pytest.mark.parametrize(
        ("channels", "n_states"), [(("r", "u"), 5), (("u", "psi"), 6), (("x",), 8), (("y", "psi", "u"), 8)]
    )
    def test_heading_and_track_add_states(self, container, noisy, channels, n_states):
        run = trajectory_run(noisy, container, channels=channels)
        assert run.channels == channels
        assert run.n_states == n_states
        np.testing.assert_array_equal(run.samples, [noisy[name] for name in channels])

    def test_a_heading_that_jumps_by_a_circle_is_made_continuous(self, container):
        trial = record(container, ps.turning_circle(35.0), duration=300.0, interval=0.5)
        wrapped = trial.assign(psi=(trial["psi"] + np.pi) % (2.0 * np.pi) - np.pi)
        assert np.abs(np.diff(wrapped["psi"])).max() > 6.0
        run = trajectory_run(wrapped, container, channels=["psi"])
        np.testing.assert_allclose(run.samples[0], trial["psi"], atol=1e-9)


class TestInitialState:
    def test_it_is_estimated_from_the_first_seconds_also_in_a_turn(self, container, noisy):
        """A line through 20 samples errs at its end by 0.4 sd; the sd is the range of the channel."""
        turning = noisy.isel(time=slice(250, None))
        run = trajectory_run(turning, container, channels=["u", "v", "r", "p", "phi", "psi", "x", "y"])
        guess, sd = run.initial_state
        clean = record(container, ps.zigzag(20.0, 20.0), duration=60.0).isel(time=250)
        assert abs(float(clean["r"])) > 0.005
        for name, value, spread in zip(run.channels, guess, sd, strict=True):
            assert value == pytest.approx(float(clean[name]), abs=2.0 * SD[name] + 0.03 * np.ptp(turning[name].values))
            assert spread == pytest.approx(np.ptp(turning[name].values) + 10.0 * SD[name], rel=0.25)

    def test_what_is_not_measured_starts_from_a_straight_course(self, container, noisy):
        guess, sd = trajectory_run(noisy, container, channels=["r", "psi"]).initial_state
        assert guess[0] == container.particulars.nominal_speed
        assert (guess[[1, 3, 4]] == 0.0).all()
        np.testing.assert_array_equal(sd[[0, 1, 3, 4]], [5.0, 0.5, 0.005, 0.05])

    def test_a_ship_without_roll_stays_upright(self, container, noisy):
        """Without the fixed heel its unknown rate would capsize the ship."""
        guess, sd = trajectory_run(noisy, unmodelled_roll_text(container)).initial_state
        assert (guess[3:5] == 0.0).all()
        assert sd[3:5].max() < 1e-6


class TestErrors:
    def test_a_clean_channel_needs_its_noise_given(self, container, noisy):
        still = noisy.assign(p=0.0 * noisy["p"])
        with refused(ps.TrialError, "p", 0, "noise_sd"):
            trajectory_run(still, container)
        assert trajectory_run(still, container, noise_sd={"p": 1e-4}).sample_sd[3] == 1e-4

    def test_incomplete_records_are_errors(self, container, noisy):
        with refused(ps.TrialError, "psi"):
            trajectory_run(noisy.drop_vars("psi"), container, channels=["u", "psi"])
        with refused(ps.TrialError, 40, 0.1, 39):
            trajectory_run(noisy.isel(time=slice(0, 39)), container)
        with refused(ps.TrialError, "delta", 600):
            trajectory_run(noisy.assign(delta=np.nan * noisy["delta"]), container)
        assert trajectory_run(noisy.isel(time=slice(0, 40)), container).n_blocks == 20
