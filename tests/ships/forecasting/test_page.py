"""The page of forecasts: its numbers are those of the forecasts, its text is escaped, its files are complete."""

from __future__ import annotations

import csv
import re
from functools import cache
from html import unescape
from html.parser import HTMLParser

import numpy as np
import pytest
import xarray as xr
from matplotlib.figure import Figure

import pymc_ship as ps
from pymc_ship.machine.errors import OutputError
from pymc_ship.physics.forces.terms import SYMBOLS
from pymc_ship.ships.forecasting import page as forecast_report
from pymc_ship.ships.forecasting.figures import overview
from pymc_ship.ships.forecasting.page import (
    index_rows,
    index_table,
    interval_remarks,
    measured_sentences,
    unreached_sentence,
    verdict_rows,
    verdict_table,
    write_forecast_page,
)
from tests.inference.trajectory.cases import unmodelled_roll_text
from tests.sentences import refused
from tests.ships.ensemble.cases import ship_of
from tests.ships.forecasting.cases import MANOEUVRES, forecast, scattered, trial

L = 230.66
REMARK, COMMAND = "Errors of held-out runs <b>& more</b>", "pymc-ship forecast 'my <ship>' --turn 35"


@cache
def vessel():
    return ps.load_vessel("container")


@cache
def forecasts():
    runs = {
        "zigzag 10/10 port": forecast(vessel(), ps.zigzag(10.0, 10.0), 250.0),
        "turning circle 35 port": forecast(vessel(), *MANOEUVRES["port"]),
    }
    runs["turning circle 35 port"].attrs |= {
        "extrapolation": "60 % of the instants lie outside.",
        "diverged_fraction": 0.25,
    }
    return runs


@cache
def steps():
    """Manoeuvre without indices."""
    return forecast(vessel(), ps.rudder_programme([0.0, 20.0, 60.0], [0.0, 0.3, -0.3]), 80.0)


@cache
def measured():
    """Port turn in full, zigzag without its track."""
    port, zigzag = (trial(vessel(), *run)[1] for run in (MANOEUVRES["port"], (ps.zigzag(10.0, 10.0), 250.0)))
    return {"turning circle 35 port": port, "zigzag 10/10 port": zigzag[["psi", "r", "delta"]]}


@pytest.fixture(scope="module")
def page(tmp_path_factory):
    out = tmp_path_factory.mktemp("page")
    record = xr.DataArray(np.zeros((3, 6)), dims=("row", "symbol"), coords={"symbol": list(SYMBOLS)})
    messages = []
    path = write_forecast_page(
        ship_of((vessel(), scattered(vessel(), 6)), motion=record, remarks=(REMARK,)),
        forecasts(),
        out,
        measured=measured(),
        command=COMMAND,
        progress=messages.append,
    )
    assert path == out / "forecast.html"
    assert messages[0] == "drawing zigzag 10/10 port"
    return path


def without_figures(path):
    return re.sub(r"<svg.*?</svg>", "", path.read_text(encoding="utf-8"), flags=re.S)


def cells(text):
    """Rows of every table of a page, a list of cells each."""
    rows = re.findall(r"<tr>(.*?)</tr>", text, re.S)
    return [[unescape(cell) for cell in re.findall(r"<t[hd][^>]*>(.*?)</t[hd]>", row, re.S)] for row in rows]


def test_a_sentence_names_the_indices_that_not_all_draws_reach():
    """Of a forecast of 80 s; a rudder programme has no indices."""
    short = forecast(vessel(), ps.turning_circle(35.0), 80.0)
    sentence = unreached_sentence(short)
    assert sentence.startswith("Within 79.5 s no draw reaches: advance, transfer, tactical diameter, time to 90, ")
    assert "maximum roll angle" not in sentence
    short["indices"]["advance"][0] = 700.0
    assert "Within 79.5 s not all draws reach: advance (" in (unreached_sentence(short))
    assert unreached_sentence(steps()) == ""


def test_the_verdict_of_every_manoeuvre_heads_the_page(page):
    text = without_figures(page)
    rows = cells(text[text.index('id="verdict"') : text.index("<nav")])
    head, *lines = rows
    assert head[0] == "manoeuvre"
    assert "probability of passing" in head
    assert [line[0] for line in lines] == ["zigzag 10/10 port"] * 3 + ["turning circle 35 port"] * 2
    expected = [row for name in forecasts() for row in ps.imo_probabilities(forecasts()[name], vessel())]
    for line, row in zip(lines, expected, strict=True):
        decimals = 1 if row["units"] == "deg" else 2
        values = dict(zip(head, line, strict=True))
        assert values["criterion"] == row["criterion"]
        assert values["limit"] == f"{row['limit']:.{decimals}f} {row['units']}"
        median, lower, upper = (f"{row[key]:.{decimals}f}" for key in ("median", "lower", "upper"))
        assert values["forecast (interval)"] == f"{median} ({lower} to {upper})"
        shown = values["probability of passing"]
        if shown.startswith(("less than 0.01", "more than 0.99")):
            assert (row["probability"] < 0.005, row["probability"] > 0.995) == (shown[0] == "l", shown[0] == "m")
        else:
            assert float(shown) == pytest.approx(row["probability"], abs=0.0051)
        assert values["verdict"] == row["conformity"]
        assert values["extrapolated"] == "–"
        assert (row["verdict"][0].upper() + row["verdict"][1:]) in unescape(text)


def test_every_manoeuvre_has_its_numbers_and_figures(page):
    text = page.read_text(encoding="utf-8")
    sections = dict(re.findall(r'<section id="(forecast_[^"]+)">(.*?)</section>', text, re.S))
    assert list(sections) == ["forecast_zigzag_10_10_port", "forecast_turning_circle_35_port"]
    assert '<figure id="forecast_overview"><svg' in text[: text.index('id="evidence"')]
    for name, section in sections.items():
        for kind in ("track", "heading_and_rudder", "motion"):
            figure = f'<figure id="{name}_{kind}"><svg'
            assert text.count(figure) == 1
            assert figure in section
    assert "24 draws, 25 % diverged. 60 % of the instants lie outside." in sections["forecast_turning_circle_35_port"]
    assert "24 draws, 0 % diverged. Extrapolation is not assessed" in sections["forecast_zigzag_10_10_port"]
    tree = forecasts()["turning circle 35 port"]
    lower, median, upper = (f"{float(value) / L:.2f}" for value in tree["index_bands"]["tactical_diameter"])
    rows = {row[0]: row for row in cells(sections["forecast_turning_circle_35_port"])}
    assert rows["tactical diameter"][:4] == ["tactical diameter", "L", median, f"{lower} to {upper}"]
    assert '<figure id="forecast_forces"><svg' in text
    assert "Intervals and bands are of 95 % with equal tails" in text


def test_foreign_text_is_escaped(page):
    text = without_figures(page)
    assert "Errors of held-out runs &lt;b&gt;&amp; more&lt;/b&gt;" in text
    assert "<b>" not in text
    assert "my &lt;ship&gt;" in text
    assert COMMAND in unescape(text)


def test_the_page_is_whole_and_fetches_nothing(page):
    text, opened = page.read_text(encoding="utf-8"), []

    class Reader(HTMLParser):
        def handle_starttag(self, tag, attrs):
            if tag not in ("meta", "br", "img", "path", "use", "stop"):
                opened.append(tag)
            for key, value in attrs:
                assert key not in ("src", "href", "xlink:href") or value.startswith("#"), value

        def handle_startendtag(self, tag, attrs):
            pass

        def handle_endtag(self, tag):
            if tag not in ("path", "use", "stop"):
                assert opened.pop() == tag

    Reader().feed(text)
    assert opened == []
    ids = re.findall(r'\bid="([^"]+)"', text)
    assert len(ids) == len(set(ids))


def test_tables_and_figures_are_in_the_folder_of_the_page(page):
    names = ["zigzag_10_10_port", "turning_circle_35_port"]
    drawn = {f"forecast_{n}_{kind}.png" for n in names for kind in ("track", "heading_and_rudder", "motion")}
    drawn |= {"forecast_forces.png", "forecast_overview.png"}
    assert {path.name for path in (page.parent / "figures").iterdir()} == drawn
    assert all(path.read_bytes().startswith(b"\x89PNG") for path in (page.parent / "figures").iterdir())
    tables = {p.name: list(csv.DictReader(p.read_text().splitlines())) for p in (page.parent / "tables").iterdir()}
    bands = {f"forecast_{name}_bands.csv" for name in names}
    assert set(tables) == {f"forecast_{name}.csv" for name in (*names, "verdict")} | bands
    assert len(tables["forecast_verdict.csv"]) == 5
    tree = forecasts()["turning circle 35 port"]
    row = tables["forecast_turning_circle_35_port.csv"][0]
    assert row["index"] == "advance"
    assert float(row["median"]) == pytest.approx(float(tree["index_bands"]["advance"].sel(band="median")) / L, rel=1e-5)


def test_measured_indices_have_error_and_coverage():
    name = "turning circle 35 port"
    tree, run = forecasts()[name], trial(vessel(), *MANOEUVRES["port"])[0]
    exact = ps.indices(run)
    rows = {row["index"]: row for row in index_rows(tree, vessel(), measured()[name])}
    for index, row in rows.items():
        value = float(exact[index.replace(" ", "_")]) / (L if row["units"] == "L" else 1.0)
        assert row["measured"] == pytest.approx(value, rel=0.01, abs=0.02), index
        assert row["covered"] == ("yes" if row["lower"] <= row["measured"] <= row["upper"] else "no")
    advance, drift = rows["advance"], rows["steady drift angle"]
    assert advance["error_units"] == "%"
    assert advance["error"] == pytest.approx(100.0 * (advance["median"] / advance["measured"] - 1.0))
    assert drift["error_units"] == "deg"
    assert drift["error"] == pytest.approx(drift["median"] - drift["measured"])


@pytest.mark.parametrize("aside", [-L, L])
def test_an_interval_that_misses_the_measurement_does_not_cover_it(aside):
    tree = forecasts()["turning circle 35 port"].copy(deep=True)
    tree["index_bands"]["advance"].values[:] += aside
    rows = {row["index"]: row for row in index_rows(tree, vessel(), measured()["turning circle 35 port"])}
    assert rows["advance"]["covered"] == "no"
    assert rows["transfer"]["covered"] == "yes"


def test_what_was_not_measured_has_a_dash():
    name = "zigzag 10/10 port"
    rows = index_rows(forecasts()[name], vessel(), measured()[name])
    shown = index_table(rows, 0.95)
    by_index = {line[0]: dict(zip(shown.heads, line, strict=True)) for line in shown.cells}
    assert by_index["initial turning distance"]["measured"] == "–"
    assert by_index["initial turning distance"]["covered"] == ""
    first = by_index["first overshoot angle"]
    assert re.fullmatch(r"[+−]\d+\.\d\d deg", first["error of the median"])
    assert first["covered"] == "yes"
    assert re.fullmatch(r"[+−]\d+\.\d %", by_index["first overshoot time"]["error of the median"])
    verdict = verdict_table(verdict_rows(name, forecasts()[name], vessel(), measured()[name]))
    shown = [line[verdict.heads.index("measured")] for line in verdict.cells]
    assert shown[2] == "–"
    assert shown[0].endswith(" deg")


@pytest.mark.usefixtures("undrawn")
def test_a_measured_value_outside_its_interval_is_named_before_and_within_the_verdict(tmp_path):
    """The forecast is so much off that advance and tactical diameter lie outside; the probability stays as it was."""
    name = "turning circle 35 port"
    trees = {key: tree.copy(deep=True) for key, tree in forecasts().items()}
    for index in ("advance", "tactical_diameter"):
        trees[name]["index_bands"][index].values[:] -= 0.5 * L
    runs = {name: measured()[name]}
    text = unescape(without_figures(write_forecast_page(vessel(), trees, tmp_path, measured=runs)))
    first = text[text.index('id="evidence"') : text.index('id="verdict"')]
    value = index_rows(trees[name], vessel(), runs[name])[0]["measured"]
    assert re.search(
        rf"Turning circle 35 port: 2 of \d+ measured indices .* 95 %: advance {value:.2f} L against", first
    )
    assert "The intervals and probabilities of this manoeuvre are too certain." in first
    assert "Without a measurement: zigzag 10/10 port (extrapolation not assessed)." in first
    rows = {row[1]: row for row in cells(text[text.index('id="verdict"') : text.index("<nav")])}
    assert rows["advance"][4] == f"{value:.2f} L, outside"
    assert rows["advance"][6] == "fails, interval missed"
    section = text[text.index('<section id="forecast_turning') :]
    assert f"Measured {value:.2f} L, outside the interval: the probability is too certain." in section
    for index in trees[name]["index_bands"].data_vars:
        trees[name]["index_bands"][index].values[[0, -1]] = -1e4, 1e4
    covered = unescape(without_figures(write_forecast_page(vessel(), trees, tmp_path, measured=runs)))
    assert "Turning circle 35 port: all 10 measured indices lie inside the intervals of 95 %." in covered
    assert "outside the interval" not in covered


@pytest.mark.usefixtures("undrawn")
def test_draws_and_prior_stand_before_the_first_section(tmp_path):
    ship = ship_of((vessel(), scattered(vessel(), 6)), index_error={}, prior="order_damped")
    text = without_figures(write_forecast_page(ship, forecasts(), tmp_path))
    head = text[: text.index("<section")]
    assert "24 draws of 1 term set" in head
    assert "prior: wide about 0" in head
    alone = without_figures(write_forecast_page(vessel(), forecasts(), tmp_path))
    assert "24 draws of 1 term set, without model error" in alone[: alone.index("<section")]


@pytest.mark.usefixtures("undrawn")
def test_a_page_claims_nothing_that_its_run_does_not_have(tmp_path):
    """One ship in a zigzag, without a measurement: no black line, no thin track, no interval, no range of runs."""
    one = ps.forecast(vessel(), ps.zigzag(10.0, 10.0), duration=250.0, rng=1)
    text = unescape(without_figures(write_forecast_page(vessel(), {"zigzag 10/10 port": one}, tmp_path)))
    absent = (
        "black",
        "thin",
        "are draws",
        "shaded",
        "standard error",
        "weighted",
        "Intervals and bands",
        "outside the",
    )
    assert [word for word in absent if word in text] == []
    assert "One ship, without uncertainty" in text
    assert "no interval includes an uncertainty" in text


@pytest.mark.usefixtures("undrawn")
@pytest.mark.parametrize(
    ("manoeuvre", "drawn"),
    [(ps.zigzag(10.0, 10.0), "headings"), (ps.turning_circle(35.0), "turning circles")],
    ids=["zigzag", "circle"],
)
def test_the_first_caption_names_what_is_drawn(tmp_path, manoeuvre, drawn):
    one = ps.forecast(vessel(), manoeuvre, duration=250.0, rng=1)
    text = write_forecast_page(vessel(), {"one": one}, tmp_path).read_text(encoding="utf-8")
    assert f"Forecasts: {drawn}; bold lines are medians." in text


def test_legends_name_draws_and_measured_trials_where_they_are_drawn():
    def labels(trees, runs):
        (legend,) = overview(trees, vessel(), runs).legends
        return {text.get_text() for text in legend.get_texts()} & {"draws", "measured"}

    assert labels(forecasts(), measured()) == {"draws", "measured"}
    assert labels(forecasts(), None) == {"draws"}
    assert labels({"zigzag 10/10 port": forecasts()["zigzag 10/10 port"]}, None) == set()


def test_a_measured_trial_without_a_known_index_is_named():
    sentences = measured_sentences(forecasts(), {"zigzag 10/10 port": [{"covered": ""}]})
    assert sentences == ["Zigzag 10/10 port: measured, but no index of the record and of the forecast is known."]


def test_a_page_of_steady_turns_alone_has_no_model_error():
    ship = ship_of((vessel(), scattered(vessel(), 6)), index_error={})
    remarks = interval_remarks(ship, {})
    assert remarks[-1] == "The intervals do not include a model error."
    assert not any("also include" in remark for remark in remarks)


def test_one_term_set_has_no_weights():
    ship = ship_of((vessel(), scattered(vessel(), 6)), index_error={})
    assert "weighted" not in interval_remarks(ship, {})[0]
    assert "weighted" in interval_remarks(ship_of(*ship.models, *ship.models, index_error={}), {})[0]


def test_a_ship_without_roll_has_no_roll_angle():
    flat = unmodelled_roll_text(vessel())
    rows = index_rows(forecast(flat, ps.zigzag(10.0, 10.0), 60.0), flat)
    assert "maximum roll angle" not in [row["index"] for row in rows]
    assert "maximum roll angle" in [row["index"] for row in index_rows(forecasts()["zigzag 10/10 port"], vessel())]


def test_events_that_some_ships_do_not_reach_are_counted():
    tree = forecast(vessel(), MANOEUVRES["port"][0], 150.0)
    shown = index_table(index_rows(tree, vessel()), 0.95)
    assert shown.heads[-1] == "reached by % of the draws"
    by_index = {line[0]: line for line in shown.cells}
    assert by_index["tactical diameter"][2:] == ["–", "–", "0"]
    assert by_index["advance"][-1] == "100"
    assert "measured" not in shown.heads


@pytest.fixture
def _plain(monkeypatch):
    """Small figures instead of the real ones."""

    def plain(*_):
        return {name: Figure(figsize=(1.0, 1.0)) for name in ("track", "heading_and_rudder", "motion")}

    monkeypatch.setattr(forecast_report, "manoeuvre_figures", plain)


@pytest.mark.usefixtures("_plain")
def test_the_same_page_twice_and_files_of_an_earlier_page_go(tmp_path):
    only = {"steps": steps()}
    first = write_forecast_page(vessel(), only, tmp_path, command="a").read_bytes()
    (tmp_path / "figures" / "forecast_old_track.png").write_bytes(b"")
    (tmp_path / "figures" / "identification.png").write_bytes(b"kept")
    assert write_forecast_page(vessel(), only, tmp_path, command="a").read_bytes() == first
    assert not (tmp_path / "figures" / "forecast_old_track.png").exists()
    assert (tmp_path / "figures" / "identification.png").read_bytes() == b"kept"
    text = first.decode()
    assert "No criterion of IMO MSC.137(76) applies" in text
    assert "the uncertainty of the coefficients, not that of the model" in text
    assert '<figure id="forecast_forces"><svg' in text
    assert "<table>" not in text


@pytest.mark.usefixtures("_plain")
def test_names_with_the_same_file_name_get_numbers(tmp_path):
    same = dict.fromkeys(("a b", "a/b", "<i>Ü", "forces"), steps())
    write_forecast_page(vessel(), same, tmp_path, command="")
    tracks = {path.name for path in (tmp_path / "figures").glob("*_track.png")}
    assert tracks == {f"forecast_{name}_track.png" for name in ("a_b", "a_b_2", "i", "forces_2")}
    assert "&lt;i&gt;Ü" in (tmp_path / "forecast.html").read_text(encoding="utf-8")


def test_errors_come_before_any_file_is_written(tmp_path):
    out = tmp_path / "new"
    with refused(ValueError, "stops"):
        write_forecast_page(vessel(), {"steps": steps()}, out, measured={"stops": None}, command="")
    assert not out.exists()
    (tmp_path / "file").write_text("")
    with pytest.raises(OutputError):
        write_forecast_page(vessel(), {"steps": steps()}, tmp_path / "file", command="")
