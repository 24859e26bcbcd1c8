"""Spiral tests in records: direct and reverse, of ships with and without a loop."""

from functools import cache

import numpy as np
import pytest
import xarray as xr

import pymc_ship as ps
from pymc_ship.ships.forecasting.steady_turns import spiral_indices
from pymc_ship.ships.sea_trials.measured_spiral import measured_spiral, spiral_rows
from tests.ships.sea_trials.cases import ship

LIMIT = 10.0


@cache
def vessel(name):
    return ps.load_vessel(name)


@cache
def spiral(name, largest=6.0, step=1.0, hold=12.0):
    """Noisy record of a direct spiral, each rudder angle for some L/U."""
    one = vessel(name)
    manoeuvre = ps.direct_spiral(largest, step, hold=hold * one.particulars.ship_time)
    run = ps.simulate(one, manoeuvre, duration=manoeuvre.time[-1], step=0.5, record_interval=1.0)
    return ps.pollute(run, level=0.01, rng=5)


@cache
def true_turns(name):
    return ps.steady_turns(vessel(name))


def rows_of(turns):
    return {row["index"]: row for row in spiral_rows(turns, LIMIT)}


def interval(row):
    return row["corrected"] + np.array([row["u_record"].min(), row["u_record"].max()])


def test_a_direct_spiral_has_the_loop_between_its_rudder_angles():
    turns = measured_spiral(spiral("kvlcc2"), vessel("kvlcc2").particulars.ship_time)
    rows, true = rows_of(turns), spiral_indices(true_turns("kvlcc2"))
    low, high = interval(rows["loop_width"])
    assert low <= true["loop_width"].item() <= high
    assert high - low == pytest.approx(4.0, abs=0.1)  # a step to either side of both folds
    assert rows["loop_width"]["limit"] == LIMIT
    for name in ("residual_rate_starboard", "residual_rate_port"):
        assert rows[name]["corrected"] == pytest.approx(true[name].item(), rel=0.15)


def test_the_steady_rates_are_those_of_the_ship():
    turns = measured_spiral(spiral("kvlcc2"), vessel("kvlcc2").particulars.ship_time)
    true = true_turns("kvlcc2")
    far = np.abs(turns["delta"].values) > 3.5
    port = true["delta"].values[0] > 3.0
    order = np.argsort(true["delta"].values[0][port])
    curve = [true[name].values[0][port][order] for name in ("delta", "r")]
    expected = -np.interp(np.abs(turns["delta"].values[far]), *curve)
    settled = np.abs(turns["r"].values[far])[2:]  # the first two stand for the approach at full speed
    np.testing.assert_allclose(settled, expected[2:], rtol=0.05)


def test_a_stable_ship_has_no_loop():
    turns = measured_spiral(spiral("container", 15.0, 5.0), vessel("container").particulars.ship_time)
    rows = rows_of(turns)
    assert len(turns["delta"]) >= 11
    assert {name: row["corrected"] for name, row in rows.items()} == dict.fromkeys(rows, 0.0)
    np.testing.assert_allclose(interval(rows["loop_width"]), [0.0, 5.0], atol=0.01)  # at 0 deg it still turns


def test_a_straight_course_between_turns_to_both_sides_leaves_no_room_for_a_loop():
    rows = rows_of(turns_of([10, 5, 0, -5, -10], [-0.4, -0.3, 0.0, 0.3, 0.4]))
    assert (interval(rows["loop_width"]) == 0.0).all()


def turns_of(delta, r, *, direct=True):
    channels = {"delta": ("turn", np.array(delta, dtype=float)), "r": ("turn", np.array(r, dtype=float))}
    return xr.Dataset(channels, attrs={"direct": direct, "straight": 0.01})


def test_a_loop_between_two_angles_is_open_up_to_their_distance():
    rows = rows_of(turns_of([10, 5, 0, -5, -10], [-0.4, -0.3, 0.1, 0.3, 0.4]))
    np.testing.assert_allclose(interval(rows["loop_width"]), [0.0, 5.0])
    assert rows["residual_rate_port"]["corrected"] == 0.0


def test_a_fold_beyond_the_last_angle_leaves_the_loop_without_an_uncertainty():
    rows = rows_of(turns_of([2, 0, -2, -4, -2, 0, 2], [-0.3, -0.2, -0.1, 0.4, 0.3, 0.2, 0.1]))
    assert rows["loop_width"]["corrected"] == 4.0
    assert np.isnan(rows["loop_width"]["u_record"]).all()


def reverse_spiral(hold=10.0):
    """Constant rates of turn one after the other; the rudder moves about the angle of the steady turn."""
    one, true = vessel("kvlcc2"), true_turns("kvlcc2")
    unit = one.particulars.ship_time
    rates = np.r_[np.linspace(-0.25, 0.25, 11)]
    delta, r = true["delta"].values[0], true["r"].values[0]
    known = np.isfinite(delta)
    time = np.arange(0.0, rates.size * hold * unit, 1.0)
    level = np.minimum((time / (hold * unit)).astype(int), rates.size - 1)
    rate = rates[level] + 0.002 * np.sin(time / 7.0)
    angle = np.interp(rates[level], r[known], delta[known]) + 1.5 * np.sin(2.0 * np.pi * time / (0.3 * unit))
    motion = {"u": np.full(time.size, 4.0), "v": 2.0 * rate, "r": np.deg2rad(rate), "delta": np.deg2rad(angle)}
    motion["psi"] = np.cumsum(motion["r"])
    return xr.Dataset({name: ("time", values) for name, values in motion.items()}, {"time": time})


def test_a_reverse_spiral_shows_the_loop_without_an_uncertainty():
    turns = measured_spiral(reverse_spiral(), vessel("kvlcc2").particulars.ship_time)
    assert not turns.attrs["direct"]
    row, true = rows_of(turns)["loop_width"], spiral_indices(true_turns("kvlcc2"))
    assert row["corrected"] == pytest.approx(true["loop_width"].item(), abs=0.5)
    assert np.isnan(row["u_record"]).all()


@pytest.mark.parametrize(
    "manoeuvre", [ps.zigzag(20, 20), ps.zigzag(5, 5), ps.turning_circle(35), ps.pull_out(20, 90)], ids=lambda m: m.label
)
def test_other_manoeuvres_are_no_spiral(manoeuvre):
    run = ps.simulate(vessel("kvlcc2"), manoeuvre, duration=2400, step=0.5)
    assert measured_spiral(run, vessel("kvlcc2").particulars.ship_time) is None


def test_steps_at_random_are_no_spiral():
    rng, unit = np.random.default_rng(2), vessel("kvlcc2").particulars.ship_time
    angles = np.deg2rad(rng.integers(-20, 21, 14)).repeat(2)
    time = (np.arange(14)[:, None] * 8.0 * unit + np.array([0.1, 8.0 * unit])).ravel()
    run = ps.simulate(vessel("kvlcc2"), ps.rudder_programme(time, angles), duration=time[-1], step=0.5)
    assert measured_spiral(run, unit) is None


def test_a_straight_course_is_no_spiral():
    still = spiral("kvlcc2")
    assert measured_spiral(still.assign({name: 0.0 * still[name] for name in ("r", "v")}), 40.0) is None


def test_a_record_without_a_rudder_is_no_spiral():
    assert measured_spiral(spiral("kvlcc2").drop_vars("delta"), 40.0) is None


def test_a_sea_trial_has_the_loop_and_the_curve_of_the_ship(tmp_path):
    result = ps.sea_trial({"spiral": spiral("kvlcc2")}, "kvlcc2", ship=ship(), rng=1)
    (line,) = [row for row in result.form if row["item"].startswith("spiral")]
    assert line["conformity"] == "met"
    assert line["port"].endswith("deg in one run")
    assert result.turns is not None
    page = ps.trial_report(result, tmp_path).read_text(encoding="utf-8")
    assert "Spiral test: steady rate of turn" in page
    assert (tmp_path / "figures" / "sea_trial_spirals.png").exists()
