"""Checks of the revolutions and of the wind of a record."""

from __future__ import annotations

import numpy as np
import pytest

import pymc_ship as ps
from pymc_ship.records.files.format import true_air
from tests.records.checks.cases import checks_by_name
from tests.sentences import refused

WIND = 8.0
"""Speed of the true wind, which blows from the south-east [m/s]."""

FROM = np.deg2rad(135.0)


@pytest.fixture(scope="module")
def tanker():
    return ps.load_vessel("kvlcc2")


@pytest.fixture(scope="module")
def circle(tanker):
    return ps.simulate(tanker, ps.turning_circle(20), duration=900, step=0.5)


def with_n(trial, n):
    return trial.assign(n=("time", np.broadcast_to(n, trial["time"].shape).astype(float)))


def blown(trial, reading, rng=None):
    """Trial with the wind as an instrument of this kind gives it; a gusty one where ``rng`` is given."""
    u, v, psi = (trial[name].values for name in ("u", "v", "psi"))
    size = trial.sizes["time"]
    gust = 0.0 if rng is None else 0.3 * (rng.standard_normal(size) + 1j * rng.standard_normal(size))
    true, moving = -WIND * np.exp(1j * FROM) + gust, (u + 1j * v) * np.exp(1j * psi)
    flow = {
        "true": true,
        "relative": (true - moving) * np.exp(-1j * psi),
        "relative, from north": true - moving,
        "from the bow": true * np.exp(-1j * psi),
    }[reading]
    return trial.assign(wind_speed=("time", np.abs(flow)), wind_direction=("time", np.angle(-flow)))


def test_revolutions_of_the_propeller_are_good(tanker, circle):
    check = checks_by_name(with_n(circle, tanker.propeller.n), tanker)["revolutions"]
    assert check.verdict == "good"
    assert 0.1 < check.value("advance number") < 0.6


def test_revolutions_in_one_over_minutes_are_named(tanker, circle):
    check = checks_by_name(with_n(circle, 60.0 * tanker.propeller.n), tanker)["revolutions"]
    assert check.verdict == "bad"
    assert "Probably n is in 1/min: state its unit." in check.sentence


def test_revolutions_of_another_propeller_are_bad(tanker, circle):
    check = checks_by_name(with_n(circle, 0.01 * tanker.propeller.n), tanker)["revolutions"]
    assert (check.verdict, "Check the unit of n and D of the vessel file." in check.sentence) == ("bad", True)


def test_missing_revolutions_are_doubtful(tanker, circle):
    n = np.full(circle.sizes["time"], tanker.propeller.n)
    n[:180] = np.nan
    check = checks_by_name(with_n(circle, n), tanker)["revolutions"]
    assert check.verdict == "doubtful"
    assert "missing in 10 % of the record" in check.sentence


@pytest.mark.parametrize("factor", [2.0, 0.5])
def test_revolutions_of_the_engine_are_doubtful(tanker, circle, factor):
    check = checks_by_name(with_n(circle, factor * tanker.propeller.n), tanker)["revolutions"]
    assert (check.verdict, "check that n is of the propeller" in check.sentence) == ("doubtful", True)


def test_negative_revolutions_of_a_ship_ahead_are_bad(tanker, circle):
    check = checks_by_name(with_n(circle, -tanker.propeller.n), tanker)["revolutions"]
    assert (check.verdict, "state sign = -1 for n" in check.sentence) == ("bad", True)


@pytest.mark.parametrize("n", [None, 0.0])
def test_revolutions_that_tell_nothing_are_not_checked(tanker, circle, n):
    check = checks_by_name(circle if n is None else with_n(circle, n), tanker)["revolutions"]
    assert check.verdict == "not checked"


@pytest.mark.parametrize("seed", range(5))
def test_a_true_wind_is_good(tanker, circle, seed):
    check = checks_by_name(blown(circle, "true", np.random.default_rng(seed)), tanker)["wind"]
    assert check.verdict == "good"


def test_a_wind_that_one_number_states_is_good(tanker, circle):
    """It does not vary at all, and no reading of it varies less."""
    steady = circle.assign(wind_speed=("time", np.full(circle.sizes["time"], 10.0)))
    steady = steady.assign(wind_direction=("time", np.full(circle.sizes["time"], 1.0)))
    assert checks_by_name(steady, tanker)["wind"].verdict == "good"


@pytest.mark.parametrize("reading", ["relative", "relative, from north", "from the bow"])
def test_another_wind_that_is_declared_true_is_bad(tanker, circle, reading):
    trial = blown(circle, reading, np.random.default_rng(1))
    check = checks_by_name(trial, tanker)["wind"]
    assert check.verdict == "bad"
    with refused(ps.TrialError, "wind"):
        ps.validated_trial(trial, tanker)


def test_on_one_course_the_wind_is_not_checked(tanker):
    straight = ps.simulate(tanker, ps.zigzag(5, 5), duration=300, step=0.5)
    assert checks_by_name(blown(straight, "relative"), tanker)["wind"].verdict == "not checked"


def test_a_wind_with_gaps_is_doubtful(tanker, circle):
    trial = blown(circle, "true", np.random.default_rng(1))
    trial["wind_speed"].values[5] = np.nan
    assert checks_by_name(trial, tanker)["wind"].verdict == "doubtful"


def scaled(trial, factor):
    return trial.assign(wind_speed=factor * trial["wind_speed"])


def directed(trial, law):
    return trial.assign(wind_direction=("time", law(trial["wind_direction"].values)))


MISTAKEN = {
    "anticlockwise": ("true", lambda trial: directed(trial, lambda angle: -angle), "good"),
    "to": ("relative", lambda trial: directed(trial, lambda angle: angle + np.pi), "where the wind blows to"),
    "knots": ("relative", lambda trial: scaled(trial, 1.0 / 0.514444), "wind_speed is in knots"),
    "degrees": ("relative", lambda trial: directed(trial, np.rad2deg), "wind_direction is in deg, read in rad"),
    "anticlockwise from the bow": ("relative", lambda trial: directed(trial, np.negative), "counts anticlockwise"),
    "gusty degrees": ("true", lambda trial: directed(trial, np.rad2deg), "wind_direction is in deg, read in rad"),
}


@pytest.mark.parametrize(("reading", "mistake", "words"), MISTAKEN.values(), ids=MISTAKEN)
def test_a_mistaken_column_of_the_wind_is_named(tanker, circle, reading, mistake, words):
    check = checks_by_name(mistake(blown(circle, reading, np.random.default_rng(1))), tanker)["wind"]
    assert (check.verdict == "good") if words == "good" else words in check.sentence


@pytest.mark.parametrize("mistake", ["to", "knots", "anticlockwise from the bow"])
def test_a_mistaken_column_of_a_wind_read_as_relative_is_named(tanker, circle, mistake):
    _, mistaken, words = MISTAKEN[mistake]
    trial = mistaken(blown(circle, "relative", np.random.default_rng(1)))
    u, v, psi = (trial[name].values for name in ("u", "v", "psi"))
    air = true_air(trial["wind_speed"].values, trial["wind_direction"].values, u, v, psi)
    read = trial.assign(wind_speed=("time", np.abs(air)), wind_direction=("time", np.angle(-air)))
    check = checks_by_name(read, tanker)["wind"]
    assert (check.verdict, words in check.sentence) == ("bad", True)


def test_an_unsteady_wind_is_not_called_steadier_than_its_readings(tanker, circle):
    """Its best reading has 0.56 of the variance, say, which the sentence must not deny."""
    trial = blown(circle, "true", np.random.default_rng(1))
    varied = directed(trial, lambda angle: angle + 1.5 * np.sin(trial["time"].values / 60.0))
    check = checks_by_name(varied, tanker)["wind"]
    assert check.verdict == "good"
    assert "no other interpretation of the columns has less" in check.sentence
    assert check.value("ratio under the best reading") == 1.0


def test_a_wind_beside_a_heading_that_begins_at_0_is_told(tanker, circle):
    """The heading may count from the first course; the one of another course counts from north."""
    turned = circle.assign(psi=circle["psi"] + 0.5)
    for trial, told in ((circle, True), (turned, False)):
        check = checks_by_name(blown(trial, "true", np.random.default_rng(1)), tanker)["wind"]
        assert (check.verdict, "begins at 0" in check.sentence) == ("good", told)


def test_a_fit_states_a_wind_beside_a_heading_that_begins_at_0(tanker, circle):
    """In the remarks that every command prints; not without a wind."""
    blowing = blown(circle, "true", np.random.default_rng(1))
    cosine, sine = np.cos(0.5), np.sin(0.5)
    turned = blowing.assign(
        psi=circle["psi"] + 0.5,
        x=cosine * circle["x"] - sine * circle["y"],
        y=sine * circle["x"] + cosine * circle["y"],
    )
    for trial, told in ((blowing, True), (circle, False), (turned, False)):
        remarks = ps.validated_trial(trial, tanker).attrs["record_remarks"]
        assert ("wind: The heading of this record begins at 0" in remarks) == told


def test_a_vane_that_stands_still_in_a_gusty_wind_is_doubtful(tanker, circle):
    """At 0, as without a sensor, or at another angle."""
    gusts = 8.0 + np.random.default_rng(1).standard_normal(circle.sizes["time"])
    for angle in (0.0, 1.0):
        still = circle.assign(wind_speed=("time", gusts), wind_direction=("time", np.full(gusts.size, angle)))
        check = checks_by_name(still, tanker)["wind"]
        assert (check.verdict, "a vane that is stuck" in check.sentence) == ("doubtful", True)
