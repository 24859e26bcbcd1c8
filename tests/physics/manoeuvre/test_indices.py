from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest
import xarray as xr
from scipy.special import jv

import pymc_ship as ps

AMPLITUDE, HEADING, PERIOD, SPEED = np.deg2rad(28.0), 20.0, 200.0, 8.0
OMEGA = 2.0 * np.pi / PERIOD
SWITCH = np.arcsin(np.deg2rad(HEADING) / AMPLITUDE) / OMEGA
SIDES = {"starboard": 1.0, "port": -1.0}


def trial(time, attrs, **channels):
    filled = {name: np.zeros_like(time) for name in ("u", "v", "r", "phi", "psi", "x", "y")} | channels
    return xr.Dataset({name: ("time", values) for name, values in filled.items()}, {"time": time}, attrs)


def sine(interval, *, side="starboard", offset=0.0, duration=450.0):
    """Ship whose heading is a sine, which also rolls; track by Jacobi's expansion of cos(A sin) and sin(A sin)."""
    t = np.arange(offset, duration, interval)
    angle, sign, k = OMEGA * t, SIDES[side], np.arange(1, 12)[:, None]
    x = jv(0, AMPLITUDE) * angle + np.sum(jv(2 * k, AMPLITUDE) * np.sin(2 * k * angle) / k, axis=0)
    odd = 2 * k - 1
    y = np.sum(2.0 * jv(odd, AMPLITUDE) * (1.0 - np.cos(odd * angle)) / odd, axis=0)
    phi = 0.15 * np.sin(2.0 * angle)
    return trial(
        t,
        {"manoeuvre": "zigzag", "heading_deg": HEADING, "rudder_deg": 20.0, "side": side},
        u=np.full(t.size, SPEED),
        r=sign * AMPLITUDE * OMEGA * np.cos(angle) / np.cos(phi),
        phi=sign * phi,
        psi=sign * AMPLITUDE * np.sin(angle),
        x=SPEED / OMEGA * x,
        y=sign * SPEED / OMEGA * y,
    )


def circle(interval, *, side="port", offset=0.0, course=0.0, rate=0.012, drift=0.15, duration=800.0):
    """Ship on a perfect circle, bow inwards by the drift angle, from any course."""
    t = np.arange(0.0, duration, interval) + offset
    sign = SIDES[side]
    u, v = SPEED * np.cos(drift), -sign * SPEED * np.sin(drift)
    psi = sign * rate * (t - offset)
    path = psi - sign * drift  # direction of the track
    x = sign * SPEED / rate * (np.sin(path) - np.sin(-sign * drift))
    y = -sign * SPEED / rate * (np.cos(path) - np.cos(-sign * drift))
    c, s = np.cos(course), np.sin(course)
    return trial(
        t,
        {"manoeuvre": "turning_circle", "rudder_deg": 35.0, "side": side},
        u=np.full(t.size, u),
        v=np.full(t.size, v),
        r=np.full(t.size, sign * rate),
        psi=course + psi,
        x=1000.0 + c * x - s * y,
        y=-500.0 + s * x + c * y,
    )


EXACT_ZIGZAG = {
    "first_overshoot_angle": 8.0,
    "second_overshoot_angle": 8.0,
    "third_overshoot_angle": 8.0,
    "first_overshoot_time": PERIOD / 4.0 - SWITCH,
    "second_overshoot_time": PERIOD / 4.0 - SWITCH,
    "initial_turning_time": SWITCH,
    "initial_turning_distance": SPEED * SWITCH,
    "period": PERIOD,
    "reach": PERIOD / 2.0,
}
EXACT_CIRCLE = {
    "time_to_90": 0.5 * np.pi / 0.012,
    "time_to_180": np.pi / 0.012,
    "advance": SPEED / 0.012 * (np.cos(0.15) + np.sin(0.15)),
    "transfer": SPEED / 0.012 * (np.cos(0.15) - np.sin(0.15)),
    "tactical_diameter": 2.0 * SPEED / 0.012 * np.cos(0.15),
    "steady_turning_diameter": 2.0 * SPEED / 0.012,
    "steady_yaw_rate": np.rad2deg(0.012),
    "steady_speed": SPEED,
    "steady_drift_angle": np.rad2deg(0.15),
    "maximum_roll_angle": 0.0,
}


FIRST_SWING = ("initial_turning_time", "initial_turning_distance", "first_overshoot_angle", "first_overshoot_time")


def worst_error(name, exact, interval):
    """Largest error of an index over records whose samples fall differently between the events."""
    offsets = interval * np.arange(7) / 7.0
    return max(abs(float(ps.indices(sine(interval, offset=offset))[name]) - exact(offset)) for offset in offsets)


def delayed(run, delay):
    """The same motion, whose rudder moves this long [s] after its order."""
    return run.assign_attrs(rudder_delay=delay)


class TestOrder:
    """Times and distances count from the order of the first execute, before the rudder moves."""

    @pytest.mark.parametrize("side", SIDES)
    def test_of_a_zigzag(self, side):
        late, at_once = (ps.indices(delayed(sine(0.05, side=side), delay)) for delay in (4.0, 0.0))
        shift = {"initial_turning_time": 4.0, "initial_turning_distance": 4.0 * SPEED, "reach": 4.0}
        for name in late:
            assert float(late[name] - at_once[name]) == pytest.approx(shift.get(name, 0.0), abs=1e-9), name

    @pytest.mark.parametrize("side", SIDES)
    def test_of_a_circle_on_any_course(self, side):
        late, at_once = (ps.indices(delayed(circle(0.5, side=side, course=2.0), delay)) for delay in (4.0, 0.0))
        shift = {"time_to_90": 4.0, "time_to_180": 4.0, "advance": 4.0 * SPEED * np.cos(0.15)}
        shift |= dict.fromkeys(("transfer", "tactical_diameter"), -4.0 * SPEED * np.sin(0.15))
        for name in late:
            assert float(late[name] - at_once[name]) == pytest.approx(shift.get(name, 0.0), abs=1e-9), name

    def test_of_an_unknown_delay_is_the_first_movement(self):
        assert ps.indices(delayed(sine(0.5), np.nan)).equals(ps.indices(sine(0.5)))


class TestZigzag:
    @pytest.mark.parametrize("side", SIDES)
    def test_a_sine_sampled_finely_has_its_exact_indices(self, side):
        measured = ps.indices(sine(0.05, side=side))
        for name, exact in EXACT_ZIGZAG.items():
            assert float(measured[name]) == pytest.approx(exact, rel=1e-7), name
        assert float(measured["maximum_roll_angle"]) == pytest.approx(np.rad2deg(0.15), rel=1e-6)

    @pytest.mark.parametrize(
        ("name", "order"),
        [
            ("first_overshoot_angle", 4),
            ("second_overshoot_angle", 4),
            ("first_overshoot_time", 3),
            ("initial_turning_time", 4),
            ("initial_turning_distance", 2),
            ("period", 4),
        ],
    )
    def test_the_error_shrinks_with_the_sampling_interval(self, name, order):
        """Heights of peaks and crossings by the fourth power of the interval, as a Hermite cubic has it."""

        def exact(offset):
            moved = {"initial_turning_time": offset, "initial_turning_distance": SPEED * offset}
            return EXACT_ZIGZAG[name] - moved.get(name, 0.0)

        errors = [worst_error(name, exact, interval) for interval in (6.0, 3.0, 1.5)]
        slopes = [np.log2(coarse / fine) for coarse, fine in pairwise(errors)]
        assert min(slopes) > order - 0.2
        assert errors[-1] < {4: 1e-5, 3: 1e-3, 2: 1e-2}[order]

    def test_an_event_between_samples_far_apart_is_still_found(self):
        """Crossing and peak in one interval: 20 deg at 25.3 s and the peak at 50 s, sampled every 30 s from 24 s."""
        sparse = sine(30.0, offset=24.0, duration=600.0)
        measured = ps.indices(sparse)
        assert float(measured["initial_turning_time"]) + 24.0 == pytest.approx(SWITCH, abs=0.2)
        assert float(measured["first_overshoot_angle"]) == pytest.approx(8.0, abs=0.1)
        assert float(measured["first_overshoot_time"]) == pytest.approx(50.0 - SWITCH, abs=0.5)

    @pytest.mark.parametrize("heading", [10.0, 20.0])
    def test_indices_hardly_depend_on_the_record_interval(self, container, heading):
        fine, coarse = (
            ps.indices(ps.simulate(container, ps.zigzag(heading, heading), duration=400.0, record_interval=interval))
            for interval in (0.02, 2.0)
        )
        bounds = {"overshoot_angle": 2e-3, "overshoot_time": 0.05, "turning_time": 1e-3, "distance": 0.02, "roll": 0.05}
        for name in fine.data_vars:
            bound = next((value for key, value in bounds.items() if key in name), 0.01)
            assert float(coarse[name]) == pytest.approx(float(fine[name]), abs=bound), name

    @pytest.mark.parametrize(
        ("end", "missing"),
        [
            (SWITCH - 1.0, set(EXACT_ZIGZAG)),
            (49.0, set(EXACT_ZIGZAG) - {"initial_turning_time", "initial_turning_distance"}),
            (99.0, set(EXACT_ZIGZAG) - set(FIRST_SWING)),
            (149.0, {"second_overshoot_angle", "second_overshoot_time", "third_overshoot_angle", "period"}),
            (200.0 + SWITCH - 1.0, {"third_overshoot_angle", "period"}),
            (249.0, {"third_overshoot_angle"}),
            (252.0, set()),
        ],
    )
    def test_events_after_the_end_of_the_record_are_nan(self, end, missing):
        measured = ps.indices(sine(0.5, duration=end))
        assert {name for name in measured.data_vars if np.isnan(measured[name])} == missing

    @pytest.mark.parametrize(("ordered", "reached"), [(19.5, True), (20.5, True), (18.5, False)])
    def test_a_helmsman_is_at_the_heading_within_a_degree(self, ordered, reached):
        """Then the initial turn ends where the ship passes the heading; it is open where he reverses before."""
        first = np.arcsin(np.deg2rad(ordered) / AMPLITUDE) / OMEGA
        by_hand = [first + 0.5 * k * PERIOD for k in range(3)]
        measured = ps.indices(sine(0.5).assign_attrs(reversal_times=by_hand))
        expected = SWITCH if reached else np.nan
        assert float(measured["initial_turning_time"]) == pytest.approx(expected, abs=1e-4, nan_ok=True)
        assert float(measured["first_overshoot_angle"]) == pytest.approx(28.0 - ordered, abs=1e-4)

    def test_a_heading_that_is_never_reached(self):
        straight = sine(1.0)
        straight.attrs["heading_deg"] = 30.0
        measured = ps.indices(straight)
        assert {name for name in measured.data_vars if np.isfinite(measured[name])} == {"maximum_roll_angle"}


class TestTurningCircle:
    @pytest.mark.parametrize("side", SIDES)
    @pytest.mark.parametrize("course", [0.0, 1.1, -2.5, 7.0])
    def test_a_perfect_circle_has_its_exact_indices_from_any_course(self, side, course):
        measured = ps.indices(circle(0.5, side=side, course=course))
        assert set(EXACT_CIRCLE) == set(measured.data_vars)
        for name, exact in EXACT_CIRCLE.items():
            assert float(measured[name]) == pytest.approx(exact, rel=1e-7, abs=1e-12), name

    def test_times_count_from_the_first_instant_whatever_the_clock(self):
        measured = ps.indices(circle(0.5, offset=37.0))
        for name, exact in EXACT_CIRCLE.items():
            assert float(measured[name]) == pytest.approx(exact, rel=1e-7, abs=1e-12), name

    def test_the_steady_values_are_means_over_the_last_90_deg(self):
        """A turn that fades: 90 deg over the time they take; speed and drift, linear in time, in the middle of it."""
        step, t = 0.1, np.arange(0.0, 1500.0, 0.1)
        r, speed, drift = 0.012 - 2e-6 * t, 8.0 - 2e-3 * t, 0.1 + 1e-4 * t
        psi = 0.012 * t - 1e-6 * t**2
        channels = {"u": speed * np.cos(drift), "v": -speed * np.sin(drift), "r": r, "psi": psi}
        measured = ps.indices(trial(t, {"manoeuvre": "turning_circle", "side": "starboard"}, **channels))
        begin = float(np.interp(psi[-1] - 0.5 * np.pi, psi, t))
        middle, rate = 0.5 * (begin + t[-1]), 0.5 * np.pi / (t[-1] - begin)
        mean_speed = 8.0 - 2e-3 * middle
        near = {"abs": 2.0 * step / (t[-1] - begin), "rel": 2.0 * step / (t[-1] - begin)}  # the samples at both ends
        assert float(measured["steady_yaw_rate"]) == pytest.approx(np.rad2deg(rate), **near)
        assert float(measured["steady_speed"]) == pytest.approx(mean_speed, **near)
        assert float(measured["steady_drift_angle"]) == pytest.approx(np.rad2deg(0.1 + 1e-4 * middle), **near)
        assert float(measured["steady_turning_diameter"]) == pytest.approx(2.0 * mean_speed / rate, **near)

    @pytest.mark.parametrize("name", ["advance", "transfer", "tactical_diameter"])
    def test_the_error_shrinks_with_the_fourth_power_of_the_sampling_interval(self, name):
        parts = np.linspace(0.8, 1.0, 21)
        errors = [
            max(abs(float(ps.indices(circle(h * part))[name]) - EXACT_CIRCLE[name]) for part in parts)
            for h in (20.0, 10.0, 5.0)
        ]
        slopes = [np.log2(coarse / fine) for coarse, fine in pairwise(errors)]
        assert min(slopes) > 3.7
        assert errors[-1] < 1e-2

    @pytest.mark.parametrize("side", SIDES)
    def test_steady_diameter_is_the_width_of_the_track(self, container, side):
        run = ps.simulate(container, ps.turning_circle(35.0, side=side), duration=1500.0, record_interval=0.5)
        last = np.abs(run["psi"] - run["psi"][-1]).values < 2.05 * np.pi
        for name in ("x", "y"):
            width = float(np.ptp(run[name].values[last]))
            assert float(ps.indices(run)["steady_turning_diameter"]) == pytest.approx(width, rel=1e-4)

    def test_indices_hardly_depend_on_the_record_interval(self, container, circle_trial):
        fine = ps.indices(circle_trial)
        coarse = ps.indices(circle_trial.isel(time=slice(None, None, 100)))
        for name in fine.data_vars:
            bound = {"maximum_roll_angle": 2e-3, "steady_turning_diameter": 1e-5}.get(name, 2e-6)
            assert float(coarse[name]) == pytest.approx(float(fine[name]), rel=bound), name

    def test_both_sides_are_mirrored(self, circle_trial):
        odd = ("v", "r", "p", "phi", "psi", "y", "delta")
        mirrored = circle_trial.assign({name: -circle_trial[name] for name in odd}).assign_attrs(side="starboard")
        assert ps.indices(mirrored).drop_attrs().identical(ps.indices(circle_trial).drop_attrs())

    @pytest.mark.parametrize(
        ("turned", "missing"),
        [
            (80.0, set(EXACT_CIRCLE) - {"maximum_roll_angle"}),
            (100.0, set(EXACT_CIRCLE) - {"maximum_roll_angle", "advance", "transfer", "time_to_90"}),
            (400.0, {name for name in EXACT_CIRCLE if name.startswith("steady")}),
            (460.0, set()),
        ],
    )
    def test_events_after_the_end_of_the_record_are_nan(self, turned, missing):
        measured = ps.indices(circle(0.5, duration=np.deg2rad(turned) / 0.012))
        assert {name for name in measured.data_vars if np.isnan(measured[name])} == missing


class TestBatches:
    def test_each_draw_has_the_indices_of_its_own_run(self, container):
        reference = np.concatenate([container.coefficients(dof) for dof in container.dofs])
        draws = reference * (1.0 + 0.03 * np.random.default_rng(14).standard_normal((4, reference.size)))
        batch = ps.simulate(container, ps.zigzag(20, 20), duration=300.0, record_interval=0.5, coefficients=draws)
        measured = ps.indices(batch)
        assert measured.sizes == {"draw": 4}
        for draw in range(4):
            alone = ps.indices(batch.isel(draw=draw, drop=True))
            for name in measured.data_vars:
                assert float(measured[name][draw]) == float(alone[name])

    def test_a_run_that_diverged_keeps_the_indices_it_reached(self):
        whole = sine(0.5)
        broken = whole.where(whole["time"] < 100.0)
        batch = xr.concat([whole, broken, whole * np.nan], "draw", combine_attrs="override")
        measured = ps.indices(batch.assign_attrs(whole.attrs))
        assert float(measured["first_overshoot_angle"][1]) == float(measured["first_overshoot_angle"][0])
        assert np.isnan(measured["second_overshoot_angle"][1:]).all()
        assert all(np.isnan(measured[name][2]) for name in measured.data_vars)

    def test_a_single_run_that_never_was_in_range(self, container):
        run = ps.simulate(container, ps.turning_circle(35.0, approach_speed=100.0), duration=10.0)
        assert float(run["diverged_at"]) == 0.0
        assert all(np.isnan(value) for value in ps.indices(run).data_vars.values())


class TestErrors:
    def test_a_manoeuvre_can_be_named(self):
        record = sine(0.5)
        del record.attrs["manoeuvre"]
        assert float(ps.indices(record, manoeuvre="zigzag")["first_overshoot_angle"]) == pytest.approx(8.0, abs=1e-4)


@pytest.mark.parametrize("current", [(2.0, 0.0), (1.0, 180.0)])
def test_the_advance_in_a_current_counts_from_the_order_over_ground(current):
    """The water moves from the order on, during the delay of the gear, too."""
    vessel = ps.load_vessel("kvlcc2")
    settings = {"duration": 600.0, "step": 0.1, "method": "rk4"}
    calm, drifting = (
        ps.indices(ps.simulate(vessel, ps.turning_circle(35.0), current=flow, **settings)) for flow in (None, current)
    )
    assert vessel.particulars.rudder_delay > 1.0
    drift = current[0] * np.cos(np.deg2rad(current[1])) * float(calm["time_to_90"])
    assert float(drifting["advance"]) == pytest.approx(float(calm["advance"]) + drift, abs=0.02)
    assert float(drifting["time_to_90"]) == pytest.approx(float(calm["time_to_90"]), rel=1e-9)


@pytest.mark.parametrize("method", ["euler", "rk4", "dop853"])
@pytest.mark.parametrize("manoeuvre", [ps.zigzag(10, 10), ps.pull_out(20, 60, side="starboard")], ids=str)
def test_headings_count_from_the_base_course(manoeuvre, method):
    """The rudder is reversed at the same changes of heading, and the indices are the same, on any course."""
    run = {"duration": 400.0, "step": 0.5, "method": method}
    start = [8.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0]
    north, other = (
        ps.simulate("kvlcc2", manoeuvre, initial_state=[*start[:5], course, 0.0, 0.0], **run) for course in (0.0, 2.5)
    )
    np.testing.assert_allclose(other["psi"] - 2.5, north["psi"], atol=2e-5)
    wrapped = other.assign(psi=("time", (other["psi"].values + np.pi) % (2.0 * np.pi) - np.pi))
    stated = other.assign(psi=other["psi"] - 0.01).assign_attrs(base_course=2.49)
    assert np.ptp(wrapped["psi"].values) > 6.0 or manoeuvre.side == "port"
    for record in (other, wrapped, stated):
        for name, expected in ps.indices(north).items():
            np.testing.assert_allclose(ps.indices(record)[name], expected, rtol=1e-4, err_msg=name)
