from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import pymc_ship as ps

RATE = np.deg2rad(2.3)


class TestRudder:
    def test_the_rudder_moves_at_its_rate_and_no_faster(self, zigzag_trial):
        moves = np.abs(np.diff(zigzag_trial["delta"].values)) / 0.02
        assert moves.max() == pytest.approx(RATE, rel=1e-9)
        moving = moves > 0.0
        assert np.mean(moves[moving] > 0.999 * RATE) > 0.99
        assert np.abs(zigzag_trial["delta"]).max() == pytest.approx(np.deg2rad(20.0), rel=1e-15)

    @pytest.mark.parametrize("method", ["euler", "rk4"])
    def test_a_record_of_a_rudder_is_followed_exactly(self, container, method):
        rng = np.random.default_rng(5)
        time, delta = np.arange(0.0, 30.5, 0.5), rng.uniform(-0.6, 0.6, 61)
        programme = ps.rudder_programme(time, delta, rate_limited=False)
        run = ps.simulate(container, programme, duration=40.0, method=method)
        np.testing.assert_allclose(run["delta"], np.interp(run["time"], time, delta), atol=1e-15)

    def test_commands_are_followed_at_the_rate(self, container):
        programme = ps.rudder_programme([0.0, 10.0, 10.001], [0.1, 0.1, -0.1])
        run = ps.simulate(container, programme, duration=30.0)
        delta = run["delta"].values
        t = run["time"].values
        before = t <= 10.0
        np.testing.assert_allclose(delta[before], np.minimum(RATE * t[before], 0.1), atol=1e-12)
        reached = t > 10.1 + 0.2 / RATE
        np.testing.assert_array_equal(delta[reached], -0.1)
        assert (np.abs(np.diff(delta)) <= RATE * 0.02 * (1.0 + 1e-12)).all()

    @pytest.mark.parametrize("delay", [0.0, 1.4])
    def test_the_rudder_is_reversed_a_delay_after_the_heading(self, container, delay):
        ship = replace(container, particulars=replace(container.particulars, rudder_delay=delay))
        run = ps.simulate(ship, ps.zigzag(15.0, 10.0), duration=120.0)
        delta, time = run["delta"].values, run["time"].values
        reached = time[np.argmax(run["psi"].values <= -np.deg2rad(10.0))]
        begins = time[np.flatnonzero((delta[1:] < delta[:-1]) & (delta[:-1] > 0.999 * np.deg2rad(15.0)))[0]]
        assert begins - reached == pytest.approx(delay, abs=0.021)

    @pytest.mark.parametrize(("side", "sign"), [("port", -1.0), ("starboard", 1.0)])
    def test_a_zigzag_turns_to_its_side_first_and_reverses_at_the_heading(self, container, side, sign):
        run = ps.simulate(container, ps.zigzag(15.0, 10.0, side=side), duration=250.0)
        psi, delta = sign * np.rad2deg(run["psi"].values), -sign * np.rad2deg(run["delta"].values)
        assert delta[1] > 0.0
        first = int(np.argmax(psi >= 10.0))
        assert delta[:first].max() == pytest.approx(15.0)
        assert (np.diff(delta[: first + 1]) >= 0.0).all()
        assert delta[first + 1] < delta[first]
        second = first + int(np.argmax(psi[first:] <= -10.0))
        assert delta[second] == pytest.approx(-15.0)
        assert delta[second + 1] > delta[second]
