"""A record of no ship, or of another ship, is refused without a track; the longest piece that models cover."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import pymc_ship as ps
from pymc_ship.records.checks.plausibility import DRIFT, _faults, piece_check, pieces_ahead, spans_text
from pymc_ship.records.checks.verdicts import SLOW
from pymc_ship.records.files.ship_scale import ship_blocks, ship_scale
from tests.records.checks.cases import alarms, changed, checks_by_name, noisy, simulated


def trackless(trial):
    return trial.drop_vars(["x", "y"])


def scaled(trial, **factors):
    return changed(trial, **{name: factor * trial[name].values for name, factor in factors.items()})


def at_scale(trial, factor):
    """Record of a Froude model, 1:factor."""
    root = np.sqrt(factor)
    model = scaled(trial, u=1.0 / root, v=1.0 / root, r=root, p=root)
    return model.assign_coords(time=trial["time"].values / root)


def swapped(trial, one, other):
    return changed(trial, **{one: trial[other].values, other: trial[one].values})


def of_file(**particulars):
    return lambda vessel: replace(vessel, particulars=replace(vessel.particulars, **particulars))


RECORDS = {
    "u and v swapped": (lambda trial: swapped(trial, "u", "v"), "bad", "u and v are swapped"),
    "r and psi in degrees": (lambda trial: scaled(trial, r=57.3, psi=57.3), "bad", "r is in deg/s"),
    "r in degrees per minute": (lambda trial: scaled(trial, r=57.3 * 60.0, psi=57.3), "bad", "r is in deg/min"),
    "a model's record": (lambda trial: at_scale(trial, 45.0), "bad", "scale of 1:4"),
    "v flipped": (lambda trial: scaled(trial, v=-1.0), "bad", "v has the opposite sign"),
    "heel flipped": (lambda trial: scaled(trial, phi=-1.0, p=-1.0), "bad", "phi has the opposite sign"),
    "speeds in knots": (lambda trial: scaled(trial, u=1.944, v=1.944), "doubtful", "knots taken for m/s"),
}

FILES = {
    "L too large": ({"L": 175.0 * 7.6}, "doubtful", "wrong L"),
    "L too small": ({"L": 175.0 / 7.6}, "bad", "wrong L"),
    "a slow ship": ({"nominal_speed": 3.5}, "bad", "wrong nominal speed"),
    "knots": (
        {"nominal_speed": 24.7},
        "doubtful",
        "speed in knots (the speed in the record is 12.6 m/s; 24.7 knots are 12.7 m/s)",
    ),
    "a misprint": ({"nominal_speed": 700.0}, "bad", "wrong nominal speed"),
}


@pytest.fixture(scope="module")
def record(container):
    return trackless(noisy(simulated(container, ps.zigzag(20.0, 20.0))))


@pytest.mark.parametrize("ship", ["container", "kvlcc2"])
@pytest.mark.parametrize("manoeuvre", [ps.zigzag(10.0, 10.0), ps.zigzag(20.0, 20.0), ps.turning_circle(35.0)])
def test_a_sound_record_of_a_ship_is_plausible(ship, manoeuvre):
    vessel = ps.load_vessel(ship)
    trial = noisy(simulated(vessel, manoeuvre, duration=600.0))
    for known in (vessel, None):
        checks = checks_by_name(trackless(trial), known)
        assert checks["plausibility"].verdict == "good"
        assert checks["motion ahead"].verdict == "good"


@pytest.mark.parametrize(("wrong", "verdict", "words"), RECORDS.values(), ids=RECORDS)
def test_a_wrong_record_is_told_and_explained_without_a_track(record, container, wrong, verdict, words):
    check = checks_by_name(wrong(record), container)["plausibility"]
    assert check.verdict == verdict
    assert words in check.sentence


@pytest.mark.parametrize(("particulars", "verdict", "words"), FILES.values(), ids=FILES)
def test_a_wrong_vessel_file_is_told_and_explained(record, container, particulars, verdict, words):
    check = checks_by_name(record, of_file(**particulars)(container))["plausibility"]
    assert check.verdict == verdict
    assert words in check.sentence


def test_the_explanation_says_how_far_it_fits(record, container):
    sound = checks_by_name(record, container)["plausibility"]
    sentence = checks_by_name(scaled(record, u=1.944, v=1.944), container)["plausibility"].sentence
    after = float(sentence.split("the speed is ")[-1].split()[0])
    assert after == pytest.approx(1.944 * 0.514444 * sound.value("speed"), rel=2e-3)


def test_what_no_mistake_explains_is_said_to_be_so(record, container):
    pair = scaled(swapped(record, "u", "v"), r=57.3)
    sentence = checks_by_name(pair, container)["plausibility"].sentence
    assert "r is in deg/s and u and v are swapped" in sentence
    noise = np.random.default_rng(1).standard_normal(record.sizes["time"])
    sentence = checks_by_name(changed(record, v=5.0 * noise, u=5.0 * noise[::-1]), container)["plausibility"].sentence
    assert sentence.endswith("No known mistake, or pair, explains it.")


@pytest.mark.parametrize(("degrees", "verdict"), [(0.0, "good"), (0.7, "good"), (-5.0, "doubtful"), (30.0, "bad")])
def test_a_list_is_named(record, container, degrees, verdict):
    check = checks_by_name(changed(record, phi=record["phi"].values + np.deg2rad(degrees)), container)["plausibility"]
    assert check.verdict == verdict
    assert check.value("list") == pytest.approx(np.deg2rad(degrees), abs=0.01)
    assert ("state its offset" in check.sentence) == (verdict != "good")


def test_swapped_roll_columns_are_told(record, container):
    check = checks_by_name(swapped(record, "p", "phi"), container)["roll rate"]
    assert check.verdict == "bad"
    assert "swapped" in check.sentence


def test_a_record_of_another_scale_is_judged_by_the_vessel_alone(container, record):
    model = at_scale(record, 45.0)
    assert checks_by_name(model, container)["rudder rate"].verdict == "doubtful"
    assert "plausibility" not in alarms(checks_by_name(model))


def from_rest(trial, seconds):
    """Record whose ship gathers way over its first seconds, with the drift of a ship at rest in a breeze."""
    time = trial["time"].values
    way = np.clip(time / seconds, 0.0, 1.0)
    return changed(trial, u=way * trial["u"].values, v=way * trial["v"].values + 0.1 * (1.0 - way))


def test_a_record_from_rest_is_cut_to_the_piece_that_models_hold(container):
    trial = from_rest(trackless(simulated(container, ps.zigzag(20.0, 20.0))), 60.0)
    check = checks_by_name(trial, container)["motion ahead"]
    assert (check.verdict, check.mendable) == ("doubtful", True)
    piece = ps.validated_trial(trial, container)
    U = np.hypot(piece["u"], piece["v"])
    assert float(piece["time"][0]) == pytest.approx(60.0 * SLOW, abs=5.0)
    assert float(piece["time"][-1]) == float(trial["time"][-1])
    assert bool((0.9 * SLOW * U.max() < U).all())
    assert bool((np.abs(piece["v"]) <= DRIFT * U).all())
    assert "from" in piece.attrs["record_remarks"]


@pytest.mark.parametrize(("ship_times", "count"), [(0.4, 1), (1.5, 2)])
def test_check_and_identification_have_the_same_pieces(container, ship_times, count):
    """A zigzag begins while the ship gathers way: its speed falls below the limit once more."""
    trial = trackless(simulated(container, ps.zigzag(20.0, 20.0)))
    scale = ship_scale(trial, container)
    time, begin = trial["time"].values, 4.0 * scale.time
    slow = (time >= begin) & (time < begin + ship_times * scale.time)
    trial = changed(trial, **{name: np.where(slow, 0.28, 1.0) * trial[name].values for name in ("u", "v")})
    pieces = pieces_ahead(trial, scale)
    assert len(pieces) == count
    check = piece_check(trial, scale)
    assert check.verdict == ("good" if count == 1 else "doubtful")
    if count == 2:
        longest = max(pieces, key=lambda piece: piece.sizes["time"])["time"].values
        assert (check.value("from"), check.value("until")) == (longest[0], longest[-1])
        assert spans_text(pieces) in check.sentence


@pytest.mark.parametrize(("ship_times", "verdict"), [(1.8, "bad"), (3.0, "doubtful")])
@pytest.mark.parametrize("fault", ["astern", "spinning"])
def test_the_piece_is_that_of_whole_blocks_and_half_a_window_at_least(container, fault, ship_times, verdict):
    trial = trackless(simulated(container, ps.zigzag(20.0, 20.0)))
    scale = ship_scale(trial, container)
    size = ship_blocks(trial, scale, 0.25).size
    begin, end = 20 * size, (20 + round(4.0 * ship_times)) * size
    out = np.ones(trial.sizes["time"], dtype=bool)
    out[begin:end] = False
    wrong = {"astern": ("u", -trial["u"].values), "spinning": ("r", np.full(out.size, 3.0 * scale.U / scale.L))}
    name, values = wrong[fault]
    check = piece_check(changed(trial, **{name: np.where(out, values, trial[name].values)}), scale)
    assert check.verdict == verdict
    time = trial["time"].values
    assert (check.value("from"), check.value("until")) == (time[begin], time[end - 1])


@pytest.mark.parametrize(("error", "verdict"), [(1e-3, "bad"), (0.1, "doubtful"), (0.3, None)])
def test_a_quantity_is_impossible_only_beyond_what_the_record_can_tell(error, verdict):
    """A pivot point 1.3 L forward of midship."""
    assert _faults({"pivot point": (1.3, error)}).get("pivot point") == verdict
