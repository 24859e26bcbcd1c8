"""The page of an identified ship: its numbers are those of the model, its failures are told, its text is escaped."""

from __future__ import annotations

import csv
import re
from dataclasses import replace
from functools import cache
from html import unescape
from html.parser import HTMLParser

import numpy as np
import pytest

import pymc_ship as ps
from pymc_ship.inference.trajectory.prior import FREEDOM
from pymc_ship.machine.errors import OutputError
from pymc_ship.pages.tables import fixed_point
from pymc_ship.physics.forces.hull_database import typical_rudder
from pymc_ship.physics.vessel.hull_database import hull_coefficients
from pymc_ship.physics.vessel.vessel import coefficient_names
from pymc_ship.records.checks.verdicts import Check
from pymc_ship.ships.ensemble.index_error import TYPICAL, model_error
from pymc_ship.ships.ensemble.index_table import index_rows, index_table
from pymc_ship.ships.identification import page as ship_report
from pymc_ship.ships.identification.candidates import Refusal
from pymc_ship.ships.identification.figures import held_out_windows
from pymc_ship.ships.identification.held_out_errors import coverage, index_error_rows, overshoot_errors
from pymc_ship.ships.identification.model import identify_ship
from pymc_ship.ships.identification.page import coefficient_rows, correlation_rows, write_ship_report
from tests.sentences import refused
from tests.ships.identification.three_zigzags import TERMS, kvlcc2, model, runs

COMMAND = "pymc-ship identify 'my <ship>.csv' --seed 3"
NAMES = ("<b>a & b</b>", "$x$", "c")
LEFT_OUT = "The cubic terms were left out: no minimum <was> found."
REMARK = "Another remark & more."
DOUBT = "phi stands still for <22> s."


@cache
def checks():
    found = {name: ps.trial_checks(trial, kvlcc2()) for name, trial in runs().items()}
    return found | {"b": (*found["b"], Check("frozen channels", "doubtful", DOUBT))}


def written(out, *, ship=None, trials=None, made=None, **settings):
    page = write_ship_report(
        ship or model(),
        trials or runs(),
        checks() if made is None else made,
        out,
        command=COMMAND,
        seed=3,
        **settings,
    )
    assert page == out / "index.html"
    return page.read_text(encoding="utf-8")


@pytest.fixture(scope="module")
def out(tmp_path_factory):
    folder = tmp_path_factory.mktemp("ship")
    written(folder, given=kvlcc2())
    return folder


@pytest.fixture
def quick(monkeypatch):
    """Pages whose figures are empty."""
    images = dict.fromkeys(ship_report._FIGURES, "<svg></svg>")
    monkeypatch.setattr(ship_report, "_figures", lambda *_: images)


@pytest.fixture(scope="module")
def text(out):
    return without_figures((out / "index.html").read_text(encoding="utf-8"))


def without_figures(page):
    return re.sub(r"<svg.*?</svg>", "", page, flags=re.S)


def cells(page):
    """Rows of every table of a page, a list of cells each."""
    found = re.findall(r"<tr>(.*?)</tr>", page, re.S)
    return [[unescape(cell) for cell in re.findall(r"<t[hd][^>]*>(.*?)</t[hd]>", row, re.S)] for row in found]


def table_of(folder, name):
    return list(csv.DictReader((folder / "tables" / f"{name}.csv").read_text(encoding="utf-8").splitlines()))


def test_the_page_names_the_runs_and_their_steering(text):
    lines = {line[0]: line for line in cells(text)[:4]}
    unit = kvlcc2().particulars.L / kvlcc2().particulars.nominal_speed
    duration = float(np.ptp(runs()["a"]["time"].values))
    assert lines["a"][1:4] == ["zigzag 10/10 port", fixed_point(0)(duration), fixed_point(1)(duration / unit)]
    assert float(lines["a"][4]) == pytest.approx(kvlcc2().particulars.nominal_speed, abs=0.02)
    assert lines["a"][5:7] == ["1", "1"]
    made = sum(check.verdict != "not checked" for check in checks()["b"])
    assert lines["b"][-2:] == [str(made), "doubtful"]
    gear = model().ship.facilities[""]
    assert f"movements: {gear.rudder_rate_deg:.3g} deg/s; in the vessel file 2.35 deg/s." in text
    assert f"movements: {gear.rudder_delay:.3g} s; in the vessel file 2.5 s." in text


@pytest.mark.usefixtures("quick")
def test_doubtful_checks_stand_with_their_sentence(text, tmp_path):
    assert "b, frozen channels, doubtful: phi stands still for &lt;22&gt; s." in text
    assert "Runs with a doubtful check: b." in text
    good = {name: tuple(check for check in made if check.verdict == "good") for name, made in checks().items()}
    page = written(tmp_path, made=good)
    assert "No check is doubtful." in page
    assert "Not checked, for lack" not in page


@pytest.mark.usefixtures("quick")
def test_a_run_without_checks_says_so(tmp_path):
    line = next(line for line in cells(written(tmp_path, made={})) if line[0] == "a")
    assert line[-2:] == ["0", "not checked"]
    text = written(tmp_path, made={})
    assert "No check was made." in text
    assert "No check of a run was made." in text
    assert "is doubtful" not in text


@pytest.mark.usefixtures("quick")
def test_a_page_of_one_run_has_no_other_runs(tmp_path):
    best = replace(model().candidates[0], inflation=1.0)
    one = replace(model(), names=("a",), manoeuvres=model().manoeuvres[:1], candidates=(best,))
    page = written(tmp_path, ship=one, trials={"a": runs()["a"]}, made={"a": checks()["a"]})
    absent = (
        "by a fit to the other runs",
        "because single runs move",
        "” to the other runs",
        "Weights",
        "forecast only",
        "thin tracks",
        "shaded",
    )
    assert [words for words in absent if words in page] == []
    assert "No other run can predict this one" in page


@pytest.mark.usefixtures("quick")
def test_what_was_corrected_is_told(tmp_path):
    trials = runs() | {"b": runs()["b"].assign_attrs(corrections=["+0.01 deg/s subtracted from r."])}
    assert "Corrected in b: +0.01 deg/s subtracted from r." in unescape(written(tmp_path, trials=trials))


def test_the_term_sets_stand_by_weight_with_their_scores(text, out):
    lines = {line[0]: line for line in cells(text)}
    for candidate in model().candidates:
        line, score = lines[candidate.name], candidate.held_out.log_density.sum()
        assert line[1:4] == [
            str(candidate.fit.coefficients.size),
            fixed_point(1)(100.0 * candidate.weight),
            fixed_point(1)(score),
        ]
        assert float(line[7]) == pytest.approx(np.rad2deg(candidate.held_out.rms["r"]), rel=5e-3)
        assert line[8:10] == [fixed_point(2)(candidate.inflation), fixed_point(0)(candidate.fit.design_effect)]
        assert line[10] == str(len(candidate.draws))
    assert lines["loading"][11] == "–"
    found = table_of(out, "term_sets")
    assert [row["terms"] for row in found] == [candidate.name for candidate in model().candidates]
    assert [float(row["weight"]) for row in found] == [candidate.weight for candidate in model().candidates]


@pytest.mark.usefixtures("quick")
def test_draws_that_ran_away_are_told(text, tmp_path):
    assert "simulated in six standard manoeuvres; none diverged." in text
    best, other = model().candidates
    away = replace(model(), candidates=(replace(best, weight=0.5, infeasible_fraction=0.25), other))
    assert "manoeuvres; 12 % diverged and were replaced by new draws." in written(tmp_path, ship=away)


def test_held_out_indices_are_those_of_the_model(text, out):
    found = table_of(out, "held_out_indices")
    held_out = list(index_rows(model().held_out_indices))
    of_others = index_error_rows(model().held_out_indices, model().ship.motion_error)
    assert [float(row["leave_one_out_sd"]) for row in found] == [row["leave_one_out_sd"] for row in of_others]
    assert of_others != index_error_rows(model().held_out_indices)
    assert len(found) == len(held_out) == 21
    for row, expected in zip(found, held_out, strict=True):
        assert {key: row[key] for key in ("run", "manoeuvre", "index", "kind")}.items() <= expected.items()
        assert all(float(row[key]) == expected[key] for key in ("measured", "forecast", "sd", "model_sd", "scale"))
        assert float(row["error"]) == expected["forecast"] - expected["measured"]
        assert float(row["z"]) == pytest.approx(float(row["error"]) / expected["sd"])
        shown = [expected["run"], expected["manoeuvre"], expected["index"].replace("_", " ")]
        line = next(line for line in cells(text) if line[:3] == shown)
        assert line[4:8] == [fixed_point(2)(float(row[key])) for key in ("measured", "forecast", "error", "sd")]


def test_the_summary_counts_what_the_intervals_cover(text):
    lines = index_error_rows(model().held_out_indices, model().ship.motion_error)
    errors, covered = overshoot_errors(lines), coverage(lines)
    assert f"mean absolute error {errors['first_overshoot_angle_mean']:.2g} deg, largest" in text
    assert f"largest {errors['second_overshoot_angle_max']:.2g} deg." in text
    assert f"Intervals of 90 % cover {covered['90']} and of 95 % cover {covered['95']} of 21" in text
    assert (
        f"With the model error of the other runs alone, they cover {covered['90_leave_one_out']} and "
        f"{covered['95_leave_one_out']}." in text
    )
    shown = {line[0]: line[1:3] for line in cells(text) if line[0] in model().ship.index_error}
    expected = {
        kind: np.quantile(model().ship.index_error[kind], (0.5, 0.95)) for kind in ("angle", "time", "distance")
    }
    assert shown == {kind: [fixed_point(1)(100.0 * sd) for sd in law] for kind, law in expected.items()}


def test_coefficients_carry_the_widened_sandwich_and_what_was_known(text, out):
    best, found = model().candidates[0], table_of(out, "coefficients")
    assert [float(row["estimate"]) for row in found] == best.fit.coefficients.tolist()
    sd = np.sqrt(np.diag(best.fit.covariance))
    assert [float(row["sd"]) for row in found] == pytest.approx(sd.tolist(), rel=1e-12)
    for row in (row for row in found if row["known_sd"] != "nan"):
        away = (float(row["estimate"]) - float(row["known_value"])) / float(row["known_sd"])
        assert float(row["prior_sds_away"]) == pytest.approx(away, rel=1e-9)
    mode, prior = best.fit.mode, best.prior
    square = ((mode.coefficients - prior.mean) ** 2 + mode.sd**2) / prior.scale**2
    scale_inflation = np.sqrt((FREEDOM + square) / (FREEDOM + 1.0))
    assert [float(row["scale_inflation"]) for row in found] == pytest.approx(scale_inflation.tolist(), rel=0.04)
    assert scale_inflation.max() > 1.1 * scale_inflation.min()
    known = {row["coefficient"]: row["known_sd"] for row in found if row["known_sd"] != "nan"}
    hull = {name: str(sd) for name, (_, sd) in hull_coefficients(kvlcc2()).items()}
    rudder = {f"{name[0]}g{name[1:]}": str(sd) for name, (_, sd) in typical_rudder(320.0, 20.8).items()}
    assert known == hull | rudder | {"XT": "0.00014"}
    line = next(line for line in cells(text) if line[0] == "XT")
    assert line[1:5] == [fixed_point(1)(1e5 * best.fit.coefficients[0]), fixed_point(1)(1e5 * sd[0]), "94.0", "14.0"]


@pytest.mark.usefixtures("quick")
def test_a_prior_that_gave_way_is_told(tmp_path):
    best = model().candidates[0]
    assert "Records and prior disagree" not in written(tmp_path / "agreed", ship=shifted(best, "Xvv", 0.0))
    told = r"disagree by more than 2 sd of the prior in Xvv \(\+7.0 sd, counts with (.*) times its sd\)\."
    found = re.search(told, unescape(written(tmp_path / "apart", ship=shifted(best, "Xvv", 7.0))))
    k = list(coefficient_names(best.vessel)).index("Xvv")
    assert found[1] == f"{best.fit.mode.problem.prior.scale[k] / best.prior.scale[k]:.1f}"


def shifted(best, name, sd):
    """The ship with one coefficient so many prior sd from what was known of it, the others less than 2."""
    prior, coefficients = (
        best.prior,
        np.clip(best.fit.coefficients, *(best.prior.mean + k * best.prior.scale for k in (-1, 1))),
    )
    k = list(coefficient_names(best.vessel)).index(name)
    coefficients[k] = prior.mean[k] + sd * prior.scale[k]
    moved = replace(best, fit=replace(best.fit, coefficients=coefficients))
    return replace(model(), candidates=(moved, *model().candidates[1:]))


def test_correlated_coefficients_are_warned_of():
    best = model().candidates[0]
    covariance = np.diag(np.arange(1.0, best.fit.coefficients.size + 1.0))
    covariance[1, 3] = covariance[3, 1] = -0.97 * np.sqrt(8.0)
    covariance[5, 6] = covariance[6, 5] = 0.94 * np.sqrt(42.0)
    candidate = replace(best, fit=replace(best.fit, from_windows=covariance, from_prior=0.0 * covariance))
    assert correlation_rows(candidate) == [{"first": "Xvv", "second": "Xrr", "correlation": pytest.approx(-0.97)}]
    marked = {row["coefficient"]: row["correlated_with"] for row in coefficient_rows(candidate)}
    assert {name: partner for name, partner in marked.items() if partner} == {"Xvv": "Xrr", "Xrr": "Xvv"}


@pytest.mark.slow
def test_the_same_input_gives_the_same_bytes(out, tmp_path):
    written(tmp_path, given=kvlcc2())
    files = sorted(path.relative_to(out) for path in out.rglob("*") if path.is_file())
    assert len(files) == 14
    assert files == sorted(path.relative_to(tmp_path) for path in tmp_path.rglob("*") if path.is_file())
    assert all((out / name).read_bytes() == (tmp_path / name).read_bytes() for name in files)


class Tags(HTMLParser):
    """Open tags of a page."""

    def __init__(self):
        super().__init__()
        self.open, self.wrong = [], []

    def handle_starttag(self, tag, attrs):
        if tag not in ("meta", "br", "img", "link"):
            self.open.append(tag)

    def handle_startendtag(self, tag, attrs):
        pass

    def handle_endtag(self, tag):
        if not self.open or self.open.pop() != tag:
            self.wrong.append(tag)


def renamed():
    names = dict(zip(runs(), NAMES, strict=True))
    table = model().held_out_indices
    table = table.assign_coords(run=[names[run] for run in table["run"].values])
    ship = replace(model().ship, remarks=(LEFT_OUT, REMARK))
    refused = (Refusal("cubic", LEFT_OUT),)
    found = replace(model(), ship=ship, names=NAMES, held_out_indices=table, refusals=refused)
    return found, *({names[name]: found[name] for name in runs()} for found in (runs(), checks()))


@pytest.mark.usefixtures("undrawn")
def test_text_is_escaped_and_remarks_stand_where_they_belong(tmp_path):
    ship, trials, made = renamed()
    page = written(tmp_path, ship=ship, trials=trials, made=made)
    tags = Tags()
    tags.feed(page)
    assert (tags.open, tags.wrong) == ([], [])
    plain = without_figures(page)
    assert not any(found in plain for found in ("<b>", "<was>", "<22>", "<ship>"))
    assert all(found in unescape(plain) for found in (*NAMES, LEFT_OUT, REMARK, DOUBT, COMMAND))
    begin = [plain.index(f'<section id="{name}">') for name in ("refusals", "terms", "intervals", "repeat")]
    assert begin[0] < plain.index("The cubic terms were left out") < begin[1]
    assert begin[2] < plain.index("Another remark") < begin[3]


@pytest.mark.usefixtures("undrawn")
@pytest.mark.slow
def test_no_held_out_manoeuvre_no_table_of_it(tmp_path):
    """What an earlier page left in the folder goes, what is not the page's own stays."""
    written(tmp_path)
    own = tmp_path / "tables" / "forecast_verdict.csv"
    own.write_text("kept", encoding="utf-8")
    ship = replace(model().ship, index_error=model_error([]))
    page = written(tmp_path, ship=replace(model(), ship=ship, held_out_indices=index_table(())))
    assert "No standard manoeuvre was held out" in page
    assert "First overshoot" not in page
    left = {path.stem for folder in ("tables", "figures") for path in (tmp_path / folder).iterdir()}
    assert {"held_out_indices", "held_out_overshoots"}.isdisjoint(left)
    assert [float(row["median"]) for row in table_of(tmp_path, "model_error")] == pytest.approx(
        [TYPICAL[kind] for kind in ("angle", "time", "distance")], rel=0.02
    )
    assert own.read_text(encoding="utf-8") == "kept"


def test_a_folder_that_cannot_be_written_is_told(tmp_path):
    (tmp_path / "file").write_text("")
    with refused(OutputError, str(tmp_path / "file")):
        written(tmp_path / "file")


@pytest.mark.usefixtures("quick")
def test_term_sets_may_differ_in_their_channels(tmp_path):
    """Own terms of a ship that rolls beside sets that do not."""
    best, other = model().candidates
    rolls = replace(best, held_out=replace(best.held_out, rms=best.held_out.rms | {"p": np.deg2rad(0.25)}))
    lines = cells(written(tmp_path, ship=replace(model(), candidates=(rolls, other))))
    heads = next(line for line in lines if line[0] == "term set")
    shown = {line[0]: line[heads.index("rms p deg/s")] for line in lines if line[0] in TERMS}
    assert shown == {best.name: "0.250", other.name: "–"}


@pytest.mark.usefixtures("undrawn")
@pytest.mark.slow
def test_a_single_run_is_reported_by_its_windows(tmp_path):
    trials = {"a": runs()["a"]}
    rng = np.random.default_rng(4)
    ship = identify_ship(list(trials.values()), kvlcc2(), names=["a"], terms=TERMS[:1], draws=20, rng=rng)
    page = written(tmp_path, ship=ship, trials=trials, made={})
    assert "identified from 1 run<" in page
    assert "of a single run, neighbouring windows were held out together" in page
    assert not (tmp_path / "figures" / "term_set_scores.png").exists()
    best = ship.candidates[0]
    windows = held_out_windows(best, list(trials.values()), 0)
    square = [np.mean((window.means - forecast) ** 2, axis=1) for window, forecast in windows]
    assert np.sqrt(np.mean(square, axis=0)) == pytest.approx(list(best.held_out.rms.values()), rel=1e-12)


@pytest.mark.usefixtures("quick")
def test_another_kind_of_run_is_not_called_a_manoeuvre(tmp_path):
    """A run of random rudder steps: none recognised, and the page says so."""
    ship = replace(model(), manoeuvres=(None, *model().manoeuvres[1:]))
    line = next(line for line in cells(written(tmp_path, ship=ship)) if line[0] == "a")
    assert line[1] == "none recognised"
