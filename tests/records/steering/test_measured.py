"""Measured manoeuvres: brought to the start of their forecast, and their indices."""

from __future__ import annotations

import numpy as np
import pytest
import xarray as xr

import pymc_ship as ps
from pymc_ship.records.steering.measured import align_to_first_execute, measured_indices, order_delay, order_sentence
from tests.physics.manoeuvre.cases import measured as noisy_record
from tests.physics.manoeuvre.cases import scaled, simulated, steered_by_hand
from tests.ships.forecasting.cases import MANOEUVRES, case, trial


class TestAligned:
    @pytest.mark.parametrize("kind", MANOEUVRES)
    def test_a_trial_begins_where_its_forecast_does(self, kind):
        """Another clock, course and place, a heading that jumps by 360 deg, and a minute of approach are undone."""
        _, _, run, measured = case(kind)
        aligned = align_to_first_execute(measured)
        assert aligned["time"].values[0] == 0.0
        assert all(float(aligned[name][0]) == 0.0 for name in ("x", "y"))
        assert abs(float(aligned["psi"][0])) < 2e-3
        again = aligned.interp(time=run["time"].values[2:-2])
        for name, bound in {"x": 0.5, "y": 2.0, "psi": 2e-3, "u": 0.02, "delta": 0.01}.items():
            assert np.abs(again[name].values - run[name].values[2:-2]).max() < bound, name

    def test_the_execution_is_found_below_noise_and_small_helm(self):
        time = np.arange(0.0, 60.0, 0.1)
        rng = np.random.default_rng(4)
        delta = np.deg2rad(np.clip(2.3 * (time - 20.0), 0.0, 10.0)) + 0.002 * rng.standard_normal(time.size)
        helm = np.where(time < 15.0, np.deg2rad(1.5) * np.sin(time), 0.0)
        record = xr.Dataset({"delta": ("time", delta + helm)}, {"time": time})
        assert time[-1] - float(align_to_first_execute(record)["time"][-1]) == pytest.approx(20.0, abs=0.3)

    @pytest.mark.parametrize("delta", [np.full(5, -0.6), np.zeros(5)])
    def test_a_rudder_that_never_leaves_its_angle_keeps_the_record_whole(self, delta):
        record = xr.Dataset({"delta": ("time", delta), "psi": ("time", np.arange(5.0))}, {"time": np.arange(3.0, 8.0)})
        aligned = align_to_first_execute(record)
        np.testing.assert_allclose(aligned["time"], np.arange(5.0))
        np.testing.assert_allclose(aligned["psi"], np.arange(5.0))

    def test_missing_channels_stay_missing_and_a_track_needs_a_heading(self):
        measured = case("zigzag")[3]
        assert set(align_to_first_execute(measured[["r", "delta"]]).data_vars) == {"r", "delta"}
        assert "x" not in align_to_first_execute(measured.drop_vars("psi"))
        assert align_to_first_execute(measured.drop_vars("delta"))["time"].size == measured["time"].size

    def test_gaps_stay_gaps(self):
        measured = case("zigzag")[3].copy(deep=True)
        measured["psi"][200:210] = np.nan
        assert int(np.isnan(align_to_first_execute(measured)["psi"]).sum()) == 10


class TestMeasuredIndices:
    @pytest.mark.parametrize("kind", MANOEUVRES)
    def test_indices_are_those_of_the_run(self, kind):
        _, tree, run, measured = case(kind)
        indices, exact = measured_indices(measured, tree.attrs), ps.indices(run)
        assert set(indices) == set(exact.data_vars)
        for name, value in indices.items():
            assert value == pytest.approx(float(exact[name]), rel=0.01, abs=0.05, nan_ok=True), name

    @pytest.mark.parametrize("seed", [2, 4])
    def test_a_noisy_yaw_rate_does_not_end_the_overshoot_early(self, seed):
        """Left as it is, this noise takes 6 of the 20 s."""
        run, measured = trial(ps.load_vessel("container"), ps.zigzag(10.0, 10.0), 250.0)
        noise = np.deg2rad(0.05) * np.random.default_rng(seed).standard_normal(measured["time"].size)
        indices = measured_indices(measured.assign(r=measured["r"] + noise), run.attrs)
        exact = float(ps.indices(run)["first_overshoot_time"])
        assert indices["first_overshoot_time"] == pytest.approx(exact, abs=0.5)

    def test_what_a_channel_is_needed_for_is_left_open(self):
        _, tree, run, measured = case("zigzag")
        indices = measured_indices(measured[["psi", "delta"]], tree.attrs)
        known = {name for name, value in indices.items() if np.isfinite(value)}
        exact = {name for name, value in ps.indices(run).items() if np.isfinite(value)}
        assert known == exact - {"initial_turning_distance", "maximum_roll_angle"}
        assert indices["first_overshoot_angle"] == pytest.approx(
            float(ps.indices(run)["first_overshoot_angle"]), abs=0.05
        )
        assert measured_indices(measured[["u", "delta"]], tree.attrs) == {}

    def test_velocities_are_those_of_the_track_where_none_are_measured(self):
        _, tree, run, measured = case("port")
        indices = measured_indices(measured[["x", "y", "psi", "delta"]], tree.attrs)
        for name in ("steady_speed", "tactical_diameter"):
            assert indices[name] == pytest.approx(float(ps.indices(run)[name]), rel=0.01), name

    def test_their_sway_is_that_of_the_run(self):
        """The distance is run along the course, which a sway to the wrong side turns away from the track."""
        _, tree, run, measured = case("zigzag")
        indices = measured_indices(measured[["x", "y", "psi", "delta"]], tree.attrs)
        exact = float(ps.indices(run)["initial_turning_distance"])
        assert indices["initial_turning_distance"] == pytest.approx(exact, rel=1e-3)

    def test_an_event_between_the_last_two_samples_is_reached(self):
        run = simulated(ps.load_vessel("container"), ps.turning_circle(35, side="starboard"), interval=1.0)
        beyond = int(np.argmax(run["psi"].values > np.deg2rad(90.0)))
        indices = measured_indices(run.isel(time=slice(0, beyond + 1)), run.attrs)
        assert indices["time_to_90"] == pytest.approx(float(ps.indices(run)["time_to_90"]), abs=1.0)

    def test_noise_of_the_sensors_does_not_shift_them(self):
        """Means over noisy records are those of the record without noise, within 1 % and a tenth of a degree."""
        for manoeuvre in (ps.zigzag(10, 10), ps.turning_circle(35, side="starboard")):
            run = simulated(ps.load_vessel("container"), manoeuvre, ship_times=15.0, interval=0.2)
            indices = [measured_indices(noisy_record(run, 60.0, seed=seed), manoeuvre.attrs) for seed in range(6)]
            exact = ps.indices(run)
            for name in indices[0]:
                mean = np.mean([values[name] for values in indices])
                assert mean == pytest.approx(float(exact[name]), rel=0.01, abs=0.1, nan_ok=True), name

    @pytest.mark.parametrize("delay", [0.0, 1.5])
    def test_overshoots_count_from_the_reversals_that_a_helmsman_made(self, delay):
        vessel, manoeuvre = scaled("kvlcc2", 160.0, 20.0, delay=delay), ps.zigzag(20, 20, side="starboard")
        headings = (23.0, 16.0, 25.0, 18.0)
        run, orders = steered_by_hand(vessel, manoeuvre, headings)
        indices = measured_indices(noisy_record(run, 60.0), manoeuvre.attrs | {"rudder_delay": delay})
        psi, time = np.rad2deg(run["psi"].values), run["time"].values
        for k, name in enumerate(("first", "second", "third")):
            swing = (time > orders[k]) & (time < (orders[k + 1]))
            peak = np.argmax((-1.0) ** k * psi * swing)
            overshoot = (-1.0) ** k * (psi[peak] - np.interp(orders[k], time, psi))
            assert indices[f"{name}_overshoot_angle"] == pytest.approx(overshoot, abs=0.5), name
            if k < 2:
                assert indices[f"{name}_overshoot_time"] == pytest.approx(time[peak] - orders[k], abs=1.0), name
        assert indices["period"] == pytest.approx(orders[2] - orders[0], abs=0.6)
        assert indices["initial_turning_time"] == pytest.approx(time[np.argmax(psi >= 20.0)] + delay, abs=0.6)

    def test_reversals_within_a_degree_of_their_mean_are_those_of_an_autopilot(self):
        """They scatter by more than a degree in all; overshoots count from the heading that was ordered."""
        vessel, manoeuvre = scaled("kvlcc2", 160.0, 20.0), ps.zigzag(20, 20, side="starboard")
        run, orders = steered_by_hand(vessel, manoeuvre, (20.6, 19.4, 19.4, 20.6))
        indices = measured_indices(noisy_record(run, 60.0), manoeuvre.attrs)
        psi, first = np.rad2deg(run["psi"].values), run["time"].values < orders[1]
        assert indices["first_overshoot_angle"] == pytest.approx(psi[first].max() - 20.0, abs=0.3)

    def test_a_first_reversal_before_the_heading_leaves_the_initial_turn_open(self):
        vessel, manoeuvre = scaled("kvlcc2", 160.0, 20.0), ps.zigzag(20, 20)
        run, _ = steered_by_hand(vessel, manoeuvre, (15.0, 24.0, 17.0, 23.0))
        indices = measured_indices(noisy_record(run, 60.0), manoeuvre.attrs)
        assert "initial_turning_time" not in indices or np.isnan(indices["initial_turning_time"])
        assert np.isfinite(indices["first_overshoot_angle"])

    def test_the_steady_turn_ends_where_the_rudder_is_put_back(self):
        vessel, (time, angle) = scaled("container", 160.0, 15.0), ([0.0, 600.0, 601.0], [35.0, 35.0, 0.0])
        circle, cut = ps.turning_circle(35), ps.rudder_programme(time, np.deg2rad(angle))
        whole = measured_indices(noisy_record(simulated(vessel, circle, ship_times=50.0)), circle.attrs)
        indices = measured_indices(noisy_record(simulated(vessel, cut, ship_times=50.0)), circle.attrs)
        for name in ("steady_yaw_rate", "steady_turning_diameter", "steady_speed"):
            assert indices[name] == pytest.approx(whole[name], rel=0.03), name


class TestOrderOfTheFirstExecute:
    def record(self, lag, seed=None):
        """A turn after an approach of 60 s, with the ordered rudder ``lag`` [s] before its first movement."""
        run = simulated(scaled("kvlcc2", 160.0, 20.0), ps.turning_circle(35), ship_times=24.0)
        record = noisy_record(run, 60.0, seed=seed)
        ordered = np.where(record["time"].values >= 60.0 - lag, np.deg2rad(35.0), 0.0)
        return run, record.assign(delta_command=("time", ordered))

    @pytest.mark.parametrize("lag", [0.0, 3.0])
    @pytest.mark.parametrize("seed", [None, 3])
    def test_a_recorded_order_is_used_and_overrules_what_is_stated(self, lag, seed):
        run, record = self.record(lag, seed)
        assert order_delay(record, 9.0) == pytest.approx(lag, abs=0.5)
        times = measured_indices(record, ps.turning_circle(35).attrs | {"rudder_delay": 9.0})
        exact = ps.indices(run.assign_attrs(rudder_delay=lag))
        for name, bound in {"time_to_90": 1.0, "time_to_180": 1.5, "advance": 6.0}.items():
            assert times[name] == pytest.approx(float(exact[name]), abs=bound), name

    def test_without_a_recorded_order_it_is_as_stated(self):
        record = self.record(3.0)[1].drop_vars("delta_command")
        assert (order_delay(record, 2.0), order_delay(record, np.nan)) == (2.0, 0.0)

    def test_a_command_that_never_steps_is_no_order(self):
        _, record = self.record(3.0)
        assert order_delay(record.assign(delta_command=0.0 * record["delta"]), 2.0) == 2.0

    def test_the_sentence_gives_both_definitions(self):
        assert "2.5 s (20 m)" in order_sentence(2.5, 8.0)
        assert "first movement" in order_sentence(0.0, 8.0)
