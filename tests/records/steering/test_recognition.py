"""Standard manoeuvres recognised in records, and the steering gear measured from them."""

from __future__ import annotations

import re
from dataclasses import astuple, replace

import numpy as np
import pytest

import pymc_ship as ps
from pymc_ship.physics.manoeuvre import steering_record
from pymc_ship.physics.manoeuvre.steering_record import approach_speed, first_execute, rudder_reversals
from pymc_ship.records.steering import recognition
from pymc_ship.records.steering.measured import align_to_first_execute
from pymc_ship.records.steering.recognition import Steering, recognise, reversals_text, unrecognised_text, with_steering
from pymc_ship.ships.identification.held_out import recorded_indices
from pymc_ship.trial.record import check_trial
from tests.physics.manoeuvre.cases import measured, scaled, simulated
from tests.records.checks.cases import through_backlash
from tests.ships.identification.cases import tanker, trial, with_delay

ZIGZAGS = (
    ps.zigzag(10.0, 10.0),
    ps.zigzag(20.0, 20.0, side="starboard"),
    ps.zigzag(15.0, 5.0, approach_speed=7.0),
    ps.zigzag(20.0, 10.0, side="starboard"),
    ps.zigzag(35.0, 20.0),
    ps.zigzag(5.0, 5.0),
)
DELAYS = (0.0, 1.0, 2.5, 4.0, 7.5)
DELAY_ERROR = 0.1
"""The delay is sought on a grid, among samples 1 s apart."""

STRAIGHT = 30.0  # s


@pytest.fixture(scope="module")
def records():
    """Records of all zigzags by rudder delay."""
    return {delay: [trial(what, vessel=with_delay(delay)) for what in ZIGZAGS] for delay in DELAYS}


def moved(run, course_deg=250.0, begin=(1e4, -3e3), straight=STRAIGHT):
    """The same trial on another course, elsewhere, after a straight run; heading within (-180, 180] deg."""
    n, speed, step = round(straight), float(run["u"][0]), 1.0
    before = {name: np.zeros(n) for name in ("v", "r", "p", "phi", "psi", "y", "delta")}
    before |= {"u": np.full(n, speed), "x": speed * step * np.arange(-n, 0)}
    values = {name: np.concatenate([before[name], run[name].values]) for name in before}
    course, x, y = np.deg2rad(course_deg), values["x"], values["y"]
    values["x"] = begin[0] + np.cos(course) * x - np.sin(course) * y
    values["y"] = begin[1] + np.sin(course) * x + np.cos(course) * y
    values["psi"] = np.angle(np.exp(1j * (values["psi"] + course)))
    time = np.arange(n + run.sizes["time"]) * step + 500.0
    return check_trial(
        run.drop_dims("time").assign_coords(time=time).assign({name: ("time", row) for name, row in values.items()}),
        values,
    )


def programme(time, delta_deg, **settings):
    return trial(ps.rudder_programme(time, np.deg2rad(delta_deg)), **settings)


class TestZigzags:
    @pytest.mark.parametrize("delay", DELAYS)
    def test_many_runs_are_recognised_with_the_gear_that_steered_them(self, records, delay):
        recognised, steering = recognise(records[delay], tanker())
        for manoeuvre, expected in zip(recognised, ZIGZAGS, strict=True):
            assert manoeuvre.label == expected.label
            assert manoeuvre.approach_speed == pytest.approx(expected.approach_speed or 7.974, rel=1e-3)
        assert steering.rudder_rate_deg == pytest.approx(2.35, rel=1e-6)
        assert steering.rudder_delay == pytest.approx(delay, abs=DELAY_ERROR)
        assert steering.n_reversals > 12

    @pytest.mark.parametrize("delay", DELAYS)
    def test_so_is_each_run_alone(self, records, delay):
        for run, expected in zip(records[delay], ZIGZAGS, strict=True):
            (manoeuvre,), steering = recognise([run], tanker())
            assert manoeuvre.label == expected.label
            assert steering.rudder_delay == pytest.approx(delay, abs=DELAY_ERROR)

    def test_a_heading_that_forgets_the_delay_takes_one_zigzag_for_another(self, records, monkeypatch):
        """Broken twin: the heading at which the rudder began to move, for that at which it was ordered to."""
        run = records[4.0][1]
        assert recognise([run], tanker())[0][0].label == "zigzag 20/20 starboard"
        at_the_order = steering_record.switching_headings
        for room in (steering_record, recognition):
            monkeypatch.setattr(room, "switching_headings", lambda *run: at_the_order(*run[:2], 0.0 * run[2]))
        assert recognise([run], tanker())[0][0].label != "zigzag 20/20 starboard"

    @pytest.mark.parametrize("course_deg", [-1.2, 0.7, 179.5, 250.0])
    def test_the_base_course_does_not_matter(self, records, course_deg):
        turned = [moved(run, course_deg) for run in records[2.5]]
        recognised, steering = recognise(turned, tanker())
        assert [manoeuvre.label for manoeuvre in recognised] == [manoeuvre.label for manoeuvre in ZIGZAGS]
        assert steering.rudder_delay == recognise(records[2.5], tanker())[1].rudder_delay

    def test_nor_does_a_first_course_beside_that_of_the_swings(self, records):
        runs = [run.assign(psi=run["psi"] + np.deg2rad(1.0)) for run in records[2.5]]
        recognised, steering = recognise(runs, tanker())
        assert [manoeuvre.label for manoeuvre in recognised] == [manoeuvre.label for manoeuvre in ZIGZAGS]
        assert steering.rudder_delay == pytest.approx(2.5, abs=DELAY_ERROR)

    @pytest.mark.parametrize("delay", [0.0, 2.5, 7.5])
    def test_noise_does_little(self, delay):
        runs = [trial(what, vessel=with_delay(delay), seed=k) for k, what in enumerate(ZIGZAGS)]
        recognised, steering = recognise(runs, tanker())
        assert [manoeuvre.label for manoeuvre in recognised] == [manoeuvre.label for manoeuvre in ZIGZAGS]
        assert steering.rudder_delay == pytest.approx(delay, abs=2.0 * DELAY_ERROR)

    def test_a_run_with_one_reversal_is_known_on_any_course(self):
        run = trial(ps.zigzag(20.0, 10.0, side="starboard"), duration=130.0)
        assert len(rudder_reversals(run)) == 1
        for record in (run, moved(run)):
            assert recognise([record], tanker())[0][0].label == "zigzag 20/10 starboard"

    @pytest.mark.parametrize(("shown", "rudder"), [(1.0, 10), (0.95, 10), (0.8, 8), (1.12, 11)])
    def test_an_indicator_that_is_a_little_off_does_not_change_the_order(self, records, shown, rudder):
        run = records[2.5][0]
        (recognised,), _ = recognise([run.assign(delta=shown * run["delta"])], tanker())
        assert (recognised.rudder_deg, recognised.heading_deg) == (rudder, 10.0)

    @pytest.mark.parametrize("step", [0.0, 1.0])
    @pytest.mark.parametrize("ship", ["container", "kvlcc2"])
    def test_an_indicator_with_backlash_does_not_change_the_order(self, ship, step):
        vessel = ps.load_vessel(ship)
        for manoeuvre in (ps.zigzag(20, 20), ps.zigzag(10, 10, side="starboard"), ps.zigzag(15, 5)):
            run = ps.simulate(vessel, manoeuvre, duration=400.0, record_interval=0.5)
            delta = through_backlash(np.rad2deg(run["delta"].values), 2.0)
            read = run.assign(delta=("time", np.deg2rad(step * np.round(delta / step) if step else delta)))
            assert recognise([read], vessel)[0][0].label == manoeuvre.label

    @pytest.mark.parametrize("eased", [(0.0, 120.0, 180.0), (-10.0, 60.0, 140.0)])
    def test_a_turn_that_is_interrupted_before_180_deg_is_no_circle(self, container, eased):
        """The indices count from the order of a rudder that stays; an easing after 180 deg changes none of them."""
        angle, begin, end = eased
        for later, kind in ((0.0, None), (300.0, "turning_circle")):
            lasts = 900.0 + 2.0 * later
            when = [0.0, begin + later, begin + later + 15.0, end + later, end + later + 15.0, lasts]
            programme = ps.rudder_programme(when, np.deg2rad([-35.0, -35.0, angle, angle, -35.0, -35.0]))
            run = ps.simulate(container, programme, duration=lasts, step=0.5)
            (recognised,), _ = recognise([run], container)
            assert (recognised and recognised.kind) == kind
            if kind is None:  # else the first angle lasts too short to be the first execute
                reason = unrecognised_text(run, container.particulars.ship_time)
                assert ("leaves -35 deg" in reason) == (begin > 0.1 * (lasts - end)) != ("begins while" in reason)

    def test_the_steering_goes_to_the_vessel(self):
        steering = Steering(3.0, 1.5, 4)
        particulars = with_steering(tanker(), steering).particulars
        assert (particulars.rudder_rate_deg, particulars.rudder_delay) == (3.0, 1.5)
        assert with_steering(tanker(), Steering(np.nan, np.nan, 0)) is tanker()


class TestQuickShips:
    """L/U of 6 to 20 s, a straight approach, sensor noise: an order is then followed while the heading runs on."""

    @pytest.mark.parametrize("ship_time", [6.0, 10.0, 20.0])
    @pytest.mark.parametrize(("approach", "seed"), [(0.0, None), (60.0, 1), (300.0, 2)])
    def test_zigzags_and_circles_are_known(self, ship_time, approach, seed):
        delay = 0.1 * ship_time
        vessel = scaled("kvlcc2", 9.0 * ship_time, ship_time, rate=4.0, delay=delay)
        for manoeuvre in (ps.zigzag(10, 10), ps.zigzag(20, 20, side="starboard"), ps.turning_circle(35)):
            run = simulated(vessel, manoeuvre, ship_times=20.0, interval=0.3)
            once_round = np.abs(run["psi"].values) < 2.0 * np.pi
            record = measured(run.isel(time=once_round), approach, seed=seed)
            (recognised,), steering = recognise([record], vessel)
            assert recognised.label == manoeuvre.label
            assert recognised.approach_speed == pytest.approx(9.0, abs=0.1)
            if manoeuvre.kind == "zigzag":
                assert steering.rudder_delay == pytest.approx(delay, abs=0.4)


class TestOthers:
    @pytest.mark.parametrize(("rudder", "side", "speed"), [(35.0, "port", 7.0), (20.0, "starboard", 8.0)])
    def test_a_turning_circle(self, rudder, side, speed):
        circle = ps.turning_circle(rudder, side=side, approach_speed=speed)
        run = trial(circle)
        for record in (run, moved(run)):
            (recognised,), steering = recognise([record], tanker())
            assert recognised.label == circle.label
            assert recognised.approach_speed == pytest.approx(speed, rel=1e-3)
        assert steering.n_reversals == 0
        assert np.isnan([steering.rudder_delay, steering.rudder_rate_deg]).all()

    @pytest.mark.parametrize(("turned", "label"), [(110.0, None), (130.0, "turning circle 35")])
    def test_a_third_of_a_turn_makes_a_circle(self, turned, label):
        run = trial(ps.turning_circle(35.0, side="starboard"))
        reached = int(np.argmax(run["psi"].values > np.deg2rad(turned)))
        (recognised,), _ = recognise([run.isel(time=slice(0, reached))], tanker())
        assert (recognised and recognised.label.removesuffix(" starboard")) == label

    @pytest.mark.parametrize(
        ("time", "delta_deg"),
        [
            ([0.0], [0.0]),
            ([0.0], [2.0]),
            (np.arange(0.0, 600.0, 10.0), 10.0 * np.sin(np.arange(0.0, 600.0, 10.0) / 40.0)),
            (np.arange(0.0, 600.0, 50.0), [20, 15, 10, 5, 0, -5, -10, -15, -20, -15, -10, -5]),
            ([0, 50, 51, 100, 101], [0, 0, 10, 10, 0]),
            ([0, 100, 101, 200, 201, 300, 301], [10, 10, -10, -10, 20, 20, -5]),
            ([0, 100, 101, 250, 251, 300, 301], [10, 10, -10, -10, 10, 10, -10]),
            ([0, 280, 281], [10, 10, -10]),
        ],
        ids=["straight", "weak helm", "sine", "stairs", "pulse", "steps", "by the clock", "late"],
    )
    def test_any_other_rudder_is_none(self, time, delta_deg):
        run = programme(time, np.asarray(delta_deg, dtype=float))
        (recognised,), steering = recognise([run], tanker())
        assert recognised is None
        assert steering.n_reversals == 0

    @pytest.mark.parametrize(
        ("time", "delta_deg", "duration"),
        [([0.0], [2.0], 1800.0), ([0, 150, 151, 300, 301, 450, 451], [30, 30, 10, 10, 20, 20, 5], 600.0)],
        ids=["weak helm", "stairs to one side"],
    )
    def test_not_every_full_turn_is_a_turning_circle(self, time, delta_deg, duration):
        run = programme(time, np.asarray(delta_deg, dtype=float), duration=duration)
        assert abs(run["psi"].values[-1]) > np.deg2rad(150.0)
        assert recognise([run], tanker())[0] == [None]

    def test_they_do_not_spoil_the_gear_of_the_zigzags_beside_them(self, records):
        clock = programme([0, 100, 101, 250, 251, 300, 301], [10, 10, -10, -10, 10, 10, -10])
        recognised, steering = recognise([*records[2.5], clock], tanker())
        assert recognised[-1] is None
        np.testing.assert_equal(astuple(steering), astuple(recognise(records[2.5], tanker())[1]))


class TestExecution:
    def test_it_is_where_the_rudder_leaves_its_first_angle(self, records):
        assert first_execute(records[0.0][0]) == 0.0
        assert first_execute(moved(records[0.0][0])) == pytest.approx(500.0 + STRAIGHT, abs=1e-9)
        assert approach_speed(moved(records[0.0][2])) == pytest.approx(7.0, rel=1e-12)

    @pytest.mark.parametrize(
        "manoeuvre", [*ZIGZAGS[:2], ps.turning_circle(35.0), ps.turning_circle(20.0, side="starboard")]
    )
    def test_a_trial_elsewhere_and_later_has_the_same_indices(self, manoeuvre):
        original = trial(manoeuvre)
        later, sooner = moved(original), moved(original, 0.0, (0.0, 0.0), straight=5.0)
        delay = tanker().particulars.rudder_delay
        indices, expected = (recorded_indices(run, manoeuvre, delay) for run in (later, sooner))
        assert np.isfinite(list(expected.values())).all()
        assert indices == pytest.approx(expected, rel=1e-6)
        first = "initial_turning_time" if manoeuvre.kind == "zigzag" else "advance"
        assert indices[first] == pytest.approx(float(ps.indices(original)[first]), rel=3e-3)
        course = float(later["psi"][0])
        uncut = ps.indices(later.assign_attrs(original.attrs, base_course=course))
        assert not np.isclose(float(uncut[first]), indices[first], rtol=0.01)

    def test_time_course_and_place_count_from_it(self, records):
        cut, original = align_to_first_execute(moved(records[0.0][1])), records[0.0][1]
        assert cut["time"].values[0] == cut["x"].values[0] == cut["y"].values[0] == 0.0
        assert cut.sizes["time"] == original.sizes["time"]
        base = np.rad2deg(cut["psi"].values[0])
        assert abs(base) < 2.0
        turned = np.deg2rad(base)
        x, y = (original[name].values for name in ("x", "y"))
        np.testing.assert_allclose(cut["x"], np.cos(turned) * x - np.sin(turned) * y, atol=1e-6)
        np.testing.assert_allclose(cut["psi"], original["psi"].values + turned, atol=1e-9)

    def test_a_course_that_is_far_from_the_middle_of_the_swings_stays(self, records):
        """Else a ship that had not settled would be turned about a course it never had."""
        run = records[0.0][0]
        for offset_deg, moves in ((1.0, True), (2.5, False)):
            late = run.assign(psi=run["psi"] + np.deg2rad(offset_deg) * (run["time"] > 20.0))
            base = align_to_first_execute(late)["psi"].values[0]
            assert (abs(base) > np.deg2rad(0.5)) == moves

    def test_a_record_without_a_track_has_no_distances(self, records):
        run = records[2.5][0].drop_vars(["x", "y", "phi"])
        indices = recorded_indices(run, ZIGZAGS[0])
        assert np.isnan([indices.pop(name) for name in ("initial_turning_distance", "maximum_roll_angle")]).all()
        whole = recorded_indices(records[2.5][0], ZIGZAGS[0])
        assert indices == {name: whole[name] for name in indices}
        assert set(run) == set(records[2.5][0].drop_vars(["x", "y", "phi"]))


def test_the_rate_of_an_order_is_not_that_of_the_gear():
    """397 deg/s is an order of 40 deg within one sample; a gear of 5 deg/s is measured."""
    file = tanker().particulars.rudder_rate_deg
    assert with_steering(tanker(), Steering(397.0, 1.0, 3)).particulars.rudder_rate_deg == file
    assert with_steering(tanker(), Steering(397.0, 1.0, 3)).particulars.rudder_delay == 1.0
    assert with_steering(tanker(), Steering(5.0, 1.0, 3)).particulars.rudder_rate_deg == 5.0


def uneven(headings):
    """A zigzag of the tanker without a delay, reversed at these heading changes [deg], by an interpolated record."""
    run = ps.simulate(tanker(), ps.zigzag(10, 10), duration=500, step=0.5)
    psi = np.rad2deg(run["psi"].values)
    side = np.sign(psi)
    return run.assign(psi=("time", np.deg2rad(np.where(side < 0.0, headings[0], headings[1]) / 10.0 * psi)))


def test_the_reversals_of_a_zigzag_show_the_error_of_the_delay():
    """An uneven zigzag has its headings stated, and a larger error; a circle alone has no sentence."""
    texts = []
    for headings in ((10.0, 10.0), (10.0, 14.0)):
        run = uneven(headings)
        _, steering = ps.recognise([run], tanker())
        steering = replace(steering, rudder_delay=max(steering.rudder_delay, 0.1))
        texts.append(reversals_text([run], steering))
    errors = [float(re.search(r"standard error of ([\d.e+-]+) s", text).group(1)) for text in texts]
    assert errors[1] > 3.0 * errors[0]
    assert ["not at one to both sides" in text for text in texts] == [False, True]
    circle = ps.simulate(tanker(), ps.turning_circle(35), duration=900, step=0.5)
    assert reversals_text([circle], ps.recognise([circle], tanker())[1]) == ""
