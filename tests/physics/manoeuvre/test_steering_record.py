"""The rudder's execution below the helm of an approach, and zigzags that were steered by hand."""

from __future__ import annotations

import numpy as np
import pytest
import xarray as xr

import pymc_ship as ps
from pymc_ship.physics.manoeuvre.steering_record import (
    approach_speed,
    first_execute,
    fixed_rudder_intervals,
    manoeuvre_rudder_angle,
    rudder_reversals,
    steering_text,
    switching_headings,
    whole_heading,
)
from pymc_ship.records.steering.recognition import recognise
from tests.physics.manoeuvre.cases import measured, scaled, simulated, steered_by_hand

SHIP = scaled("kvlcc2", 160.0, 20.0)
SCATTERED = (22.0, 15.0, 26.0, 18.0, 21.0)  # deg, switching headings of a 20/20 by hand


def rudder(time, delta_deg):
    return xr.Dataset({"delta": ("time", np.deg2rad(np.interp(TIME, time, delta_deg)))}, {"time": TIME})


TIME = np.arange(0.0, 200.0, 0.5)


class TestExecution:
    @pytest.mark.parametrize("approach", [0.0, 60.0, 300.0])
    @pytest.mark.parametrize("manoeuvre", [ps.zigzag(10, 10), ps.turning_circle(35, side="starboard")], ids=str)
    def test_it_is_exact_after_any_approach_with_noise_and_helm(self, approach, manoeuvre):
        record = measured(simulated(SHIP, manoeuvre), approach, seed=1, helm=np.deg2rad(2.0))
        assert first_execute(record) == pytest.approx(approach, abs=1.0)
        assert approach_speed(record) == pytest.approx(8.0, abs=0.05)

    def test_helm_beyond_the_ordered_angle_does_not_count_where_it_is_not_held(self):
        """As in free-running tests, in which a man steers until the order."""
        time, helm = [0, 8, 12, 40, 60, 100, 110, 112], [0, 24, 20, -5, 12, 0, 0, -20]
        assert first_execute(rudder(time, helm)) == pytest.approx(110.0, abs=0.1)
        assert np.rad2deg(manoeuvre_rudder_angle(rudder(time, helm)["delta"].values)) == pytest.approx(20.0)

    def test_a_constant_helm_that_lasts_longer_than_the_turn_is_not_the_order(self):
        record = rudder([0, 140, 149], [4, 4, 20])
        assert np.rad2deg(manoeuvre_rudder_angle(record["delta"].values)) == pytest.approx(20.0)
        assert first_execute(record) == pytest.approx(140.0, abs=0.6)

    def test_the_same_rudder_over_another_time_has_another_execution(self):
        record = rudder([0, 140, 149], [0, 0, 20])
        late = record.assign_coords(time=2.0 * record["time"] + 7.0)
        assert first_execute(late) == pytest.approx(2.0 * first_execute(record) + 7.0)

    def test_a_speed_that_still_rises_is_that_at_the_execution(self):
        record = measured(simulated(SHIP, ps.turning_circle(35)), 200.0)
        rising = record.assign(u=record["u"] * np.minimum(1.0, 0.5 + record["time"] / 400.0))
        assert approach_speed(rising) == pytest.approx(8.0, rel=0.03)

    def test_a_rudder_that_is_never_put_over_or_over_from_the_start_begins_with_the_record(self):
        assert first_execute(rudder([0, 200], [0, 0])) == 0.0
        assert first_execute(rudder([0, 200], [-35, -35])) == 0.0

    def test_a_hold_is_flat_and_lasts(self):
        recognised = rudder(
            [0, 20, 22, 100, 104, 170, 171, 174, 175, 177, 178], [0, 0, 10, 10, -10, -10, 0, 0, 10, 10, 0]
        )
        (first, second) = fixed_rudder_intervals(recognised["delta"].values)
        assert [TIME[first[0]], TIME[second[0]]] == pytest.approx([21.5, 103.5], abs=0.6)


class TestByHand:
    @pytest.mark.parametrize("delay", [0.0, 1.5])
    def test_a_zigzag_whose_reversals_scatter_is_one_with_the_reversals_it_has(self, delay):
        vessel = scaled("kvlcc2", 160.0, 20.0, delay=delay)
        run, orders = steered_by_hand(vessel, ps.zigzag(20, 20, side="starboard"), SCATTERED)
        for record in (measured(run), measured(run, 120.0, seed=1)):
            (recognised,), _ = recognise([record], vessel)
            assert recognised.label == "zigzag 20/20 starboard"
            reversals = rudder_reversals(record)
            begin = np.array([reversal.time for reversal in reversals]) - first_execute(record)
            np.testing.assert_allclose(begin - delay, orders, atol=0.6)
            headings, middle = switching_headings(record, reversals, np.array([delay]))
            about = np.array([1.0, -1.0, 1.0, -1.0, 1.0]) * middle[0]
            np.testing.assert_allclose(headings[:, 0] + about, SCATTERED, atol=0.7)

    def test_reversals_at_no_one_heading_are_none_and_say_where_they_were(self):
        run, _ = steered_by_hand(SHIP, ps.zigzag(20, 20), (3.0, 40.0), ship_times=12.0)
        assert rudder_reversals(run) == []
        assert "reversed at heading changes of -3." in steering_text(run)

    @pytest.mark.parametrize(
        ("headings", "expected"),
        [([19.8, 20.3], 20), ([22.9, 23.1], 23), ([17.0, 26.0, 19.0, 25.0], 20), ([1.2, 1.1], 1), ([0.3], 1)],
    )
    def test_an_order_is_a_whole_degree_and_a_multiple_of_five_where_it_may_be(self, headings, expected):
        assert whole_heading(np.array(headings)) == expected


class TestReasons:
    @pytest.mark.parametrize(
        ("time", "delta_deg", "reason"),
        [
            ([0.0], [0.0], "never fixed at an angle"),
            ([0, 60, 61, 150, 151, 220, 221], [20, 20, 5, 5, 20, 20, 0], "not fixed at one angle or at two"),
            ([0, 100, 101, 200, 201, 300, 301], [10, 10, -10, -10, 20, 20, -5], "fixed at 20 deg while the heading"),
            ([0.0], [2.0], "fixed at 2 deg while the heading changes by"),
            ([0, 280, 281], [10, 10, -10], "reversed at heading changes of -"),
        ],
    )
    def test_each_says_what_the_rudder_did(self, time, delta_deg, reason):
        programme = ps.rudder_programme(np.array(time, dtype=float), np.deg2rad(delta_deg))
        run = ps.simulate(ps.load_vessel("kvlcc2"), programme, duration=600.0, step=0.5)
        assert reason in steering_text(run)
