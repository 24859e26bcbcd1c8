"""The probability of passing a criterion is the fraction of draws that do, and its sentence states it."""

from __future__ import annotations

import numpy as np
import pytest
import xarray as xr

import pymc_ship as ps
from pymc_ship.physics.manoeuvre.criteria import imo_criteria, imo_limits, probability_text
from pymc_ship.ships.ensemble.scores import quantile_bands
from tests.sentences import refused

LENGTH = 230.66
UNITS = {"initial_turning_distance": "m", "advance": "m", "tactical_diameter": "m"}
ZIGZAG = {"manoeuvre": "zigzag", "rudder_deg": 10.0, "heading_deg": 10.0, "approach_speed": LENGTH / 20.0}
CIRCLE = {"manoeuvre": "turning_circle", "rudder_deg": 35.0, "heading_deg": 0.0, "approach_speed": 12.7}


def forecast_of(attrs, diverged=None, duration=1000.0, **values):
    """Forecast with these indices of its draws; 40 L/U of the container ship are 726 s."""
    n = len(next(iter(values.values())))
    table = {
        name: ("draw", np.array(column, dtype=float), {"units": UNITS.get(name, "deg")})
        for name, column in values.items()
    }
    index_draws = xr.Dataset(table, {"draw": np.arange(n)}, attrs)
    ships = xr.Dataset({"diverged": ("draw", np.zeros(n, dtype=bool) if diverged is None else np.array(diverged))})
    ships = ships.assign_coords(time=[0.0, duration])
    groups = {"trajectories": ships, "indices": index_draws, "index_bands": quantile_bands(index_draws, 0.9)}
    return xr.DataTree.from_dict({"/": xr.Dataset(attrs=attrs | {"ci_prob": 0.9}), **groups})


def zigzag(first, diverged=None):
    n = len(first)
    others = {"second_overshoot_angle": np.full(n, 20.0), "initial_turning_distance": np.full(n, 2.0 * LENGTH)}
    return forecast_of(ZIGZAG, diverged, first_overshoot_angle=first, **others)


def test_the_probability_is_the_share_of_ships_that_keep_the_limit(container):
    """The limit of the first overshoot is 15 deg at L/U = 20; a value on the limit passes."""
    first, second, distance = ps.imo_probabilities(zigzag([12.0, 14.0, 15.0, 15.1, 30.0]), container)
    assert (first["limit"], first["units"], first["criterion"]) == (15.0, "deg", "first overshoot angle")
    assert first["probability"] == 0.6
    assert first["standard_error"] == pytest.approx(np.sqrt(0.6 * 0.4 / 5))
    assert first["median"] == 15.0
    assert (first["lower"], first["upper"]) == pytest.approx((12.4, 27.02))
    assert (second["probability"], distance["probability"]) == (6 / 7, 6 / 7)
    assert distance["median"] == pytest.approx(2.0)
    assert (second["standard_error"], second["not_reached"]) == (pytest.approx(np.sqrt(6 / 7 / 7 / 5)), 0.0)


def test_ships_that_diverge_or_do_not_arrive_do_not_pass(container):
    """One of four is not there, one diverged after the event."""
    tree = zigzag([12.0, np.nan, 12.0, 13.0], diverged=[False, False, True, False])
    first, second, _ = ps.imo_probabilities(tree, container)
    assert (first["probability"], first["not_reached"]) == (0.5, 0.5)
    assert (second["probability"], second["not_reached"]) == (0.75, 0.25)
    assert "50 % of the draws diverge or do not reach it, which does not count as passing" in first["verdict"]


def test_a_probability_is_bounded_by_what_is_known_of_statements_like_it(container):
    tree = zigzag([12.0, 14.0, 15.0, 15.1, 30.0] * 20)
    tree.attrs["calibration_cap"] = 0.98
    first, second, _ = ps.imo_probabilities(tree, container)
    assert (first["probability"], second["probability"]) == (0.6, 0.98)
    assert (second["conformity"], "with probability 0.98." in second["verdict"]) == ("passes", True)


def test_the_verdict_says_value_interval_limit_and_probability(container):
    first, _, distance = ps.imo_probabilities(zigzag([10.0, 12.0, 14.0, 16.0]), container)
    assert first["verdict"] == (
        "first overshoot angle 13.0 deg (10.3 to 15.7): passes the limit of 15.0 deg with probability 0.75."
    )
    assert distance["verdict"] == (
        "initial turning distance 2.00 L (2.00 to 2.00): passes the limit of 2.50 L with probability 0.83."
    )


@pytest.mark.parametrize(
    ("passing", "conformity"), [(20, "passes"), (19, "passes"), (18, "open"), (2, "open"), (1, "fails"), (0, "fails")]
)
def test_a_verdict_is_open_between_5_and_95_percent(container, passing, conformity):
    values = np.where(np.arange(20) < passing, 10.0, 20.0)
    first, *_ = ps.imo_probabilities(zigzag(values), container)
    assert first["conformity"] == conformity
    assert first["probability"] == np.clip(passing / 20, 1 / 22, 21 / 22)


@pytest.mark.parametrize(
    ("draws", "probability", "conformity"), [(2, 0.75, "open"), (3, 0.8, "open"), (18, 0.95, "passes")]
)
def test_few_draws_support_no_certain_statement(container, draws, probability, conformity):
    """Laplace's rule: n draws that all pass leave a probability of (n + 1)/(n + 2)."""
    (first, *_), (failing, *_) = (ps.imo_probabilities(zigzag([angle] * draws), container) for angle in (10.0, 30.0))
    assert (first["probability"], first["conformity"]) == (pytest.approx(probability), conformity)
    assert f"with probability {probability:.2f}." in first["verdict"]
    assert failing["probability"] == pytest.approx(1.0 - probability)
    assert (failing["conformity"] == "fails") == (conformity == "passes")


def test_a_forecast_is_judged_by_the_limits_of_its_own_vessel(container):
    tree = zigzag([12.0, 14.0])
    tree.attrs["vessel"] = "kvlcc2"
    with refused(ps.VesselError, "container", "kvlcc2"):
        ps.imo_probabilities(tree, container)
    with refused(ps.SimulationError, "NoneType"):
        ps.imo_probabilities(None, container)


def test_distances_are_compared_in_ship_lengths(container):
    values = np.array([4.0, 4.4, 4.6]) * LENGTH
    tree = forecast_of(CIRCLE, advance=values, tactical_diameter=values + 0.5 * LENGTH)
    advance, diameter = ps.imo_probabilities(tree, container)
    assert (advance["units"], diameter["units"]) == ("L", "L")
    assert advance["median"] == pytest.approx(4.4)
    assert (advance["probability"], diameter["probability"]) == pytest.approx((2 / 3, 2 / 3))


def test_an_event_that_no_ship_reaches_is_said(container):
    nowhere = np.full(30, np.nan)
    advance, _ = ps.imo_probabilities(forecast_of(CIRCLE, advance=nowhere, tactical_diameter=nowhere), container)
    assert (advance["probability"], advance["not_reached"], advance["conformity"]) == (1 / 32, 1.0, "fails")
    assert advance["verdict"] == "advance: no draw of the forecast reaches it, which does not count as passing."


def test_a_forecast_that_ends_before_the_event_does_not_fail_the_ship(container):
    """One draw of four reaches the event; the others may keep the limit later, but for the one that diverges."""
    values, diverged = np.array([4.0, np.nan, np.nan, np.nan] * 8) * LENGTH, [False, False, False, True] * 8
    short = forecast_of(CIRCLE, diverged, duration=300.0, advance=values, tactical_diameter=np.full(32, np.nan))
    advance, diameter = ps.imo_probabilities(short, container)
    assert (advance["probability"], advance["unfinished"], advance["conformity"]) == (0.25, 0.5, "open")
    assert (diameter["probability"], diameter["unfinished"], diameter["conformity"]) == (1 / 34, 0.75, "open")
    assert (
        "with probability at least 0.25 (75 % of the draws diverge or do not reach it within 300 s, fore"
        in (advance["verdict"])
    )
    assert diameter["verdict"] == (
        "tactical diameter: no draw of the forecast reaches it within 300 s, forecast for 726.5 s."
    )
    whole = forecast_of(CIRCLE, diverged, advance=values, tactical_diameter=np.full(32, np.nan))
    assert [row["conformity"] for row in ps.imo_probabilities(whole, container)] == ["open", "fails"]


def test_limits_are_those_of_the_criteria_of_a_trial(container):
    for attrs in (ZIGZAG, ZIGZAG | {"approach_speed": 5.0}, ZIGZAG | {"rudder_deg": 20.0, "heading_deg": 20.0}, CIRCLE):
        limits = imo_limits(attrs, container)
        tree = forecast_of(attrs, **{name: [limit * unit, 2.0 * limit * unit] for name, limit, unit, _ in limits})
        trial = imo_criteria(tree["indices"].to_dataset().isel(draw=0), container)
        rows = ps.imo_probabilities(tree, container)
        assert [(r["criterion"], r["limit"], r["units"]) for r in rows] == [
            (r["criterion"], r["limit"], r["units"]) for r in trial
        ]
        assert [r["probability"] for r in rows] == [0.5] * len(limits)
        assert all(r["passed"] for r in trial)


def test_manoeuvres_without_a_criterion_have_no_verdict(container):
    assert ps.imo_probabilities(forecast_of(CIRCLE | {"rudder_deg": 20.0}, advance=[1.0, 2.0]), container) == []
    tree = xr.DataTree.from_dict({"/": xr.Dataset(attrs={"manoeuvre": "rudder_programme"})})
    assert ps.imo_probabilities(tree, container) == []


@pytest.mark.parametrize(
    ("probability", "words"),
    [
        (1.0, "more than 0.99"),
        (0.999, "more than 0.99"),
        (0.99, "0.99"),
        (0.5, "0.50"),
        (0.001, "less than 0.01"),
        (0.0, "less than 0.01"),
    ],
)
def test_only_certainty_is_shown_as_certain(probability, words):
    assert probability_text(probability) == words


CONTAINER_LENGTH = 230.66


class TestCriteria:
    """Limits of IMO resolution MSC.137(76), 5.3."""

    @staticmethod
    def zigzag(angle, speed, **values):
        table = {"first_overshoot_angle": 1.0, "second_overshoot_angle": 1.0, "initial_turning_distance": 1.0} | values
        units = {"initial_turning_distance": "m"}
        attrs = {"manoeuvre": "zigzag", "rudder_deg": angle, "heading_deg": angle, "approach_speed": speed}
        data = {name: ((), value, {"units": units.get(name, "deg")}) for name, value in table.items()}
        return xr.Dataset(data, attrs=attrs)

    @pytest.mark.parametrize(
        ("ratio", "first", "second"),
        [
            (9.0, 10.0, 25.0),
            (10.0, 10.0, 25.0),
            (20.0, 5.0 + 0.5 * 20.0, 17.5 + 0.75 * 20.0),
            (29.0, 5.0 + 0.5 * 29.0, 17.5 + 0.75 * 29.0),
            (30.0, 20.0, 40.0),
            (45.0, 20.0, 40.0),
        ],
    )
    def test_zigzag_10_10_limits_grow_with_length_over_speed(self, container, ratio, first, second):
        for scale in (0.999, 1.001):
            values = {"first_overshoot_angle": scale * first, "second_overshoot_angle": scale * second}
            values["initial_turning_distance"] = scale * 2.5 * CONTAINER_LENGTH
            rows = imo_criteria(self.zigzag(10.0, CONTAINER_LENGTH / ratio, **values), container)
            assert [row["criterion"] for row in rows] == [name.replace("_", " ") for name in values]
            np.testing.assert_allclose([row["limit"] for row in rows], [first, second, 2.5], rtol=1e-14)
            np.testing.assert_allclose([row["value"] for row in rows], scale * np.array([first, second, 2.5]))
            assert [row["units"] for row in rows] == ["deg", "deg", "L"]
            assert [row["passed"] for row in rows] == [scale < 1.0] * 3

    @pytest.mark.parametrize(("rudder_deg", "criteria"), [(35.0, 2), (15.0, 0)])
    def test_turning_limits_apply_to_hard_over_rudder_only(self, rudder_deg, criteria, container):
        run = ps.simulate(container, ps.turning_circle(rudder_deg), duration=100.0, record_interval=1.0)
        assert len(imo_criteria(ps.indices(run), container)) == criteria

    def test_zigzag_20_20_first_overshoot_is_limited_to_25_deg(self, container):
        for value, passed in ((24.9, True), (25.0, True), (25.1, False)):
            (row,) = imo_criteria(self.zigzag(20.0, 12.7, first_overshoot_angle=value), container)
            assert (row["criterion"], row["limit"], row["passed"]) == ("first overshoot angle", 25.0, passed)

    def test_turning_circle_limits_are_lengths(self, container, circle_trial):
        rows = imo_criteria(ps.indices(circle_trial), container)
        assert [(row["criterion"], row["limit"], row["units"]) for row in rows] == [
            ("advance", 4.5, "L"),
            ("tactical diameter", 5.0, "L"),
        ]
        np.testing.assert_allclose([row["value"] for row in rows], [5.0, 6.7], atol=0.05)
        assert [row["passed"] for row in rows] == [False, False]

    def test_an_event_that_was_not_reached_neither_passes_nor_fails(self, container):
        short = ps.indices(ps.simulate(container, ps.turning_circle(35.0), duration=150.0))
        assert [row["passed"] for row in imo_criteria(short, container)] == [False, None]

    def test_other_zigzags_have_no_limits(self, container):
        assert imo_criteria(self.zigzag(15.0, 12.7), container) == []


@pytest.mark.parametrize(
    ("around", "words"),
    [
        ({"current": (1.0, 90.0)}, "a current of 1 m/s"),
        ({"n": 1.2, "current": (0.5, 0.0)}, "a current of 0.5 m/s and n = 1.2 1/s"),
        ({}, ""),
    ],
)
def test_a_verdict_names_the_surroundings_that_no_criterion_has(around, words):
    vessel = ps.with_terms(ps.load_vessel("kvlcc2"), "modular")
    tree = ps.forecast(vessel, ps.turning_circle(35), duration=900, rng=1, **around)
    for row in ps.imo_probabilities(tree, vessel):
        assert ("not as in the criteria" in row["verdict"]) == bool(words)
        assert words in row["verdict"]
        assert words in row["surroundings"]


@pytest.mark.parametrize(("angle", "words"), [(10.0, "meets"), (30.0, "does not meet")])
def test_one_ship_meets_a_limit_or_not_without_a_probability(container, angle, words):
    first, *_ = ps.imo_probabilities(zigzag([angle]), container)
    assert first["verdict"] == (
        f"first overshoot angle {angle:.1f} deg: one ship, without uncertainty, {words} the limit of 15.0 deg."
    )
    assert (first["probability"], first["conformity"]) == ((1.0, "passes") if angle < 15.0 else (0.0, "fails"))
