"""First screen of the page of a ship: what was measured, what was missed, what no run supports."""

from __future__ import annotations

import re
from dataclasses import replace
from functools import cache
from html import unescape

import numpy as np
import pytest

from pymc_ship.ships.design.outlook import manoeuvring_summary
from pymc_ship.ships.forecasting.page import index_rows, verdict_rows
from pymc_ship.ships.identification import opening
from pymc_ship.ships.identification import page as ship_report
from pymc_ship.ships.identification.held_out_errors import index_error_rows
from pymc_ship.ships.identification.opening import measured_sentences, opening_sentences
from tests.ships.identification.test_page import without_figures, written
from tests.ships.identification.three_zigzags import kvlcc2, model


@cache
def forecasts():
    return manoeuvring_summary(model().ship, np.random.default_rng(2))[0]


@cache
def held_out():
    return index_error_rows(model().held_out_indices, model().ship.motion_error)


def verdicts():
    return [row for label, tree in forecasts().items() for row in verdict_rows(label, tree, model().vessel)]


def test_coverage_names_the_manoeuvres_that_it_covers():
    measured, *_ = measured_sentences(model(), held_out(), forecasts())
    assert measured == "Measured: zigzag 10/10 port, zigzag 20/20 starboard, zigzag 15/5 starboard."
    text = " ".join(measured_sentences(model(), held_out(), forecasts()))
    assert "of 21 measured indices lie inside the intervals of 95 %" in text
    assert "This covers zigzag 10/10 and zigzag 20/20 and zigzag 15/5 only." in text


def test_harder_runs_have_their_own_count(monkeypatch):
    rows = [{"manoeuvre": "zigzag 20/20 port", "z": z} for z in (0.1, -2.5, 1.9)]
    monkeypatch.setattr(opening, "harder_index_rows", lambda ship: rows)
    text = " ".join(measured_sentences(model(), held_out(), {}))
    assert "Harder runs (zigzag 20/20 port), forecast by the milder ones alone: 2 of 3 measured indices" in text


def test_manoeuvres_without_a_run_are_named_with_their_extrapolation():
    last = measured_sentences(model(), held_out(), forecasts())[-1]
    named = re.fullmatch(r"Not measured, forecast only: (.*)\. Extrapolated intervals can be too narrow; .*", last)[1]
    assert [part.split(" (")[0] for part in named.split("; ")] == [
        label for label in forecasts() if label not in ("zigzag 10/10 port", "zigzag 20/20 starboard")
    ]
    assert not any("forecast only" in line for line in measured_sentences(model(), held_out(), {}))
    circle = forecasts()["turning circle 35 port"].attrs["extrapolated_fraction"]
    assert f"turning circle 35 port ({100.0 * circle:.3g} % extrapolated)" in named


def test_a_missed_index_is_named_with_its_interval():
    rows = [dict(row) | {"z": 0.0} for row in held_out()]
    rows[3] |= {"measured": 80.0, "forecast": 90.0, "sd": 2.0, "z": 5.0}
    sentence = next(line for line in measured_sentences(model(), rows, {}) if line.startswith("Measured and missed"))
    name = rows[3]["index"].replace("_", " ")
    assert sentence.startswith(f"Measured and missed: {name} of {rows[3]['run']} 80.0 ")
    assert ", forecast 90.0 ± 3.9 " in sentence
    many = [dict(row) | {"z": 3.0} for row in held_out()]
    assert "; and 16 more." in " ".join(measured_sentences(model(), many, {}))


def test_without_held_out_manoeuvres_intervals_are_not_tested():
    alone = replace(model(), manoeuvres=(None, *model().manoeuvres[1:]))
    text = " ".join(measured_sentences(alone, [], {}))
    assert "1 of no standard manoeuvre" in text
    assert "the intervals are not tested" in text


def test_criteria_count_once_for_both_sides_and_stopping_is_one_of_them():
    rows = verdicts()
    assert len(rows) == 12
    text = " ".join(opening_sentences(model(), rows, forecasts()))
    assert "of 7 criteria the forecasts pass 6 to both sides (" in text
    assert "and stopping is not assessed." in text
    rows[0] = rows[0] | {"conformity": "fails"}
    rows[1] = rows[1] | {"conformity": "open"}
    text = " ".join(opening_sentences(model(), rows, forecasts()))
    assert re.search(r"pass 4 to both sides .* and fail 1; 1 are open", text)


def test_the_summary_names_indices_as_the_field_does_and_the_less_favourable_side():
    turn, small, large, *_ = opening_sentences(model(), verdicts(), forecasts())
    sides = [forecasts()[f"turning circle 35 {side}"] for side in ("port", "starboard")]
    found = [next(r for r in index_rows(tree, kvlcc2()) if r["index"] == "tactical diameter") for tree in sides]
    worst = max(found, key=lambda row: row["median"])
    assert f"tactical diameter {worst['median']:.2f} L ({worst['lower']:.2f} to {worst['upper']:.2f} extrap" in turn
    assert re.match(r"Turning circle 35: advance .*; transfer .*; tactical diameter ", turn)
    assert "second overshoot angle" in small
    assert "second overshoot angle" in large
    assert opening_sentences(model(), [], {}) == []


@pytest.fixture
def _quick(monkeypatch):
    images = dict.fromkeys(ship_report._FIGURES, "<svg></svg>")
    monkeypatch.setattr(ship_report, "_figures", lambda *_: images)
    monkeypatch.setattr(ship_report, "overview", lambda *_: "<svg></svg>")


@pytest.mark.usefixtures("_quick")
def test_what_was_measured_stands_before_what_is_forecast(tmp_path):
    text = unescape(without_figures(written(tmp_path, forecasts=forecasts())))
    places = [text.index(f'<section id="{name}">') for name in ("evidence", "short", "fit", "runs")]
    assert places == sorted(places)
    assert places[0] < text.index("Not measured, forecast only") < places[1] < text.index("IMO MSC.137(76): of 7")
    assert not re.search(r"0\.\d\d ± 0\.0", text[places[1] : places[2]])
