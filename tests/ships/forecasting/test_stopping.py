"""The stopping test: indices of draws, sentence and table."""

import re

import numpy as np
import pytest
from scipy.integrate import solve_ivp

import pymc_ship as ps
from pymc_ship.cli.parser import parser
from pymc_ship.inference.trajectory.prior import wide_prior
from pymc_ship.physics.motion.captive import captive_test_forces
from pymc_ship.physics.vessel.vessel import coefficient_names, reference_coefficients
from pymc_ship.records.steering.stopping_tests import INDICES
from pymc_ship.ships.forecasting.stopping import (
    stopping,
    stopping_advice,
    stopping_rows,
    stopping_sentence,
    stopping_tracks,
)
from tests.sentences import refused
from tests.ships.ensemble.cases import ship_of

ANY_SPEED = "modular at any speed"


@pytest.fixture(scope="module")
def tanker():
    return ps.with_terms(ps.load_vessel("kvlcc2"), ANY_SPEED)


@pytest.fixture(scope="module")
def drawn(tanker):
    draws = wide_prior([], tanker).draw(60, np.random.default_rng(1))
    return stopping(ship_of((tanker, draws)), astern=1.0)


def without_push(tanker):
    """Typical coefficients, the propeller astern without side force and moment."""
    at = reference_coefficients(tanker)
    at[[coefficient_names(tanker).index(name) for name in ("Y_nn", "N_nn")]] = 0.0
    return at


def test_a_ship_on_a_straight_line_stops_by_thrust_and_resistance(tanker):
    at, s = without_push(tanker), tanker.particulars
    stop = stopping(ship_of((tanker, at)), astern=1.0, reversal=30.0)
    m = tanker.m + at[coefficient_names(tanker).index("m_x")]

    def slowed(t, state):
        n = np.interp(t, [0.0, 30.0], [1.0, -1.0 / tanker.propeller.n])
        u = max(state[1], 1e-6)
        motion = {
            name: np.array([value]) for name, value in (("u", u), ("v", 0.0), ("r", 0.0), ("delta", 0.0), ("n", n))
        }
        X = captive_test_forces(tanker, motion, at[None])[0, 0, 0]
        return [state[1], X * u * u / s.L / m]

    def still(t, state):
        return state[1] - 1e-3

    still.terminal = True
    run = solve_ivp(slowed, (0.0, 5000.0), [0.0, s.nominal_speed], events=still, max_step=10.0, rtol=1e-8)
    assert stop["stopping_time"].item() == pytest.approx(run.t[-1], rel=2e-3)
    assert stop["track_reach"].item() == pytest.approx(run.y[0, -1], rel=1e-3)
    assert stop["head_reach"].item() == pytest.approx(stop["track_reach"].item(), rel=1e-3)


def test_more_revolutions_astern_stop_sooner_and_a_late_engine_later(tanker):
    reach = [stopping(tanker, astern=n)["track_reach"].item() for n in (0.7, 1.0, 1.3)]
    assert reach[0] > reach[1] > reach[2]
    late = stopping(tanker, astern=1.0, reversal=180.0)["track_reach"].item()
    assert late > reach[1] + 100.0


def test_the_track_ends_where_the_ship_stops(drawn):
    for k, when in enumerate(drawn["stopping_time"].values):
        u = drawn["u"].isel(draw=k).values
        running = np.isfinite(u)
        assert (u[running] > 0.0).all()
        assert drawn["time"].values[running][-1] <= when
    assert (drawn["track_reach"] >= drawn["head_reach"] - 1e-6).all()


def test_ships_that_push_to_port_end_on_different_sides(drawn):
    side = drawn["lateral_deviation"].values
    assert side.min() < 0.0 < side.max()


def test_a_right_handed_screw_swings_the_bow_to_starboard(tanker, drawn):
    """Nearly every draw; without side force and moment astern the ship keeps its course."""
    swung = drawn["heading_change"].values
    assert np.median(swung) > 20.0
    assert 0.7 < np.mean(swung > 0.0) < 1.0
    typical, straight = (
        stopping(ship_of((tanker, at)), astern=1.0)["heading_change"].item()
        for at in (reference_coefficients(tanker), without_push(tanker))
    )
    assert typical > 20.0
    assert abs(straight) < 1e-6


def test_the_sentence_agrees_with_the_table(drawn):
    rows = {row["index"]: row for row in stopping_rows(drawn)}
    assert set(rows) == {name.replace("_", " ") for name in INDICES}
    reach = rows["track reach"]
    assert reach["units"] == "L"
    assert 5.0 < reach["lower"] < reach["median"] < reach["upper"] < 40.0
    text = stopping_sentence(drawn)
    assert f"track reach {reach['median']:.1f} L ({reach['lower']:.1f} to {reach['upper']:.1f})" in text
    fraction = np.mean(drawn["track_reach"].values / 320.0 <= 15.0)
    assert f"within the 15 L of IMO MSC.137(76) with probability {fraction:.2f}" in text


def test_a_draw_that_does_not_stop_does_not_conform(tanker):
    at = np.tile(reference_coefficients(tanker), (40, 1))
    at[1::2, coefficient_names(tanker).index("T_nn")] = -0.5
    stop = stopping(ship_of((tanker, at)), astern=1.0)
    assert np.isfinite(stop["track_reach"].values).tolist() == [True, False] * 20
    assert "with probability 0.50" in stopping_sentence(stop)
    assert stopping_sentence(stop).endswith("50 % of the draws do not stop.")
    assert stopping_sentence(stop.isel(draw=[1])) == "No draw stops with 1 1/s astern."


def test_few_draws_give_no_interval_and_no_probability(tanker, drawn):
    """A term set of small weight has one draw of a thousand."""
    one = drawn.isel(draw=[0])
    text = stopping_sentence(one)
    reach = f"{one['track_reach'].item() / 320.0:.1f}"
    assert f"track reach {reach} L by 1 draw with forces astern, too few for an interval and a probability." in text
    assert "(" not in text
    rows = stopping_rows(one)
    assert np.isnan([row[key] for row in rows for key in ("lower", "upper")]).all()
    assert np.isfinite([row["median"] for row in rows]).all()
    assert "by 39 draws" in stopping_sentence(drawn.isel(draw=slice(39)))
    assert "with probability" in stopping_sentence(drawn.isel(draw=slice(40)))


def test_the_advice_is_a_command_that_runs_or_says_what_lacks(tanker):
    draws = np.tile(reference_coefficients(tanker), (40, 1))
    command = re.search(r"pymc-ship (forecast FOLDER --stop (\S+)) ", stopping_advice(ship_of((tanker, draws))))
    asked = parser().parse_args(command[1].split()).stop
    assert asked == float(command[2])
    assert np.isfinite(stopping(tanker, astern=asked)["track_reach"].item())
    for few in (ship_of((tanker, draws[:39])), ship_of(ps.load_vessel("kvlcc2"))):
        assert "Stopping is not forecast" in stopping_advice(few)
        assert '--terms "modular at any speed"' in stopping_advice(few)


def test_the_figure_has_tracks_and_speeds(drawn):
    track, speed = stopping_tracks(drawn).axes
    assert track.get_xlabel() == "transfer to starboard [L]"
    assert speed.get_ylabel() == "surge velocity u [m/s]"
    assert len(track.lines) == len(speed.lines) > 10


@pytest.mark.parametrize("speed", [-3.0, 0.0, np.nan, 100.0])
def test_a_stopping_test_begins_with_way_ahead(speed):
    vessel = ps.with_terms(ps.load_vessel("kvlcc2"), "modular at any speed")
    with refused(ps.SimulationError, "approach_speed"):
        ps.stopping(vessel, astern=1.0, approach_speed=speed)
