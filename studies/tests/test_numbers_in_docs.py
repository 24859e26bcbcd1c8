"""Every calibration number in the docs is that of the constants or of the table in ``reports`` it comes from."""

from __future__ import annotations

import csv
import re
from functools import cache
from pathlib import Path

import numpy as np
import pytest

from pymc_ship.ships.ensemble.calibration import constants
from studies.documentation.figures import FIGURES, NORMAL_95, known_sd
from studies.documentation.tables import foreign_summary, interval_summary, left_out_rows, table
from studies.documentation.what_to_expect import what_to_expect

ROOT = Path(__file__).parents[2]
CASES = ROOT / "docs" / "case_studies"


@cache
def rows(name, key="group"):
    """Rows of a table of the population by group, or by other columns."""
    with (ROOT / "reports" / "ships" / "tables" / f"{name}.csv").open(encoding="utf-8", newline="") as file:
        return {tuple(row[k] for k in key.split(",")) if "," in key else row[key]: row for row in csv.DictReader(file)}


@cache
def plain(path):
    """A page without bold, links and line ends."""
    text = re.sub(r"\[([^\]]*)\]\([^)]*\)", r"\1", path.read_text(encoding="utf-8")).replace("**", "")
    return " ".join(text.split())


def value(name, key=None):
    """Number of a constant as it is written."""
    found = constants()[name].value
    return f"{found if key is None else found[key]:.6f}".rstrip("0")


def share(row, level, digits=0):
    """Share [%] and its standard error."""
    return f"{float(row[f'hold_{level}']):.{digits}f} ± {float(row[f'hold_{level}_se']):.{digits}f}"


def statement(probability):
    """Share of the statements [%] beyond the runs that held."""
    row = rows("statements", "forecasts,stated")["beyond the motion of the runs", probability]
    return 100.0 * float(row["share"])


def number(row, name, digits=0):
    """A number of a row, rounded."""
    return f"{float(row[name]):.{digits}f}"


def of_paper():
    """Sentences of the page on the paper."""
    bound, prior = table("container/tables/published_bound"), table("container/tables/prior_ships")
    conjugate, semi = (
        f"{float(line['median']):.2f}" for line in table("container/tables/published") if line["dof"] == "all"
    )
    at_level = [line for line in table("container/tables/errors") if (line["level"], line["dof"]) == ("0.01", "all")]
    ours = " | ".join(number(line, "median") for line in at_level)
    below, errors = (sum(int(line[name]) for line in bound) for name in ("below", "errors"))
    flat, damped, cramer_rao = (
        number(line, "median")
        for name in ("trajectory fit, flat prior", "trajectory fit, order-damped prior", "Cramer-Rao bound")
        for line in table("container/tables/methods")
        if (line["level"], line["method"]) == ("0.01", name)
    )
    agreement = table("container/tables/agreement")
    return [
        f"published | {conjugate} | {semi} |",
        f"noise level 0.01 | {ours} |",
        f"repeated pipeline has a median error of {ours.partition(' ')[0]} %",
        f"Of {errors} published errors {below} lie below",
        f"noise levels of {float(bound[0]['level']):.4f} or less",
        f"a median error of {flat} % with a flat prior, beside {cramer_rao} % of the bound. With the order-damped "
        f"prior it is {damped} %",
        f"At most {max(float(line['complete']) for line in prior if line['choice'] != 'posterior'):.1f} % of its draws",
        f"in {sum(line['agrees'] == 'yes' for line in agreement)} of {len(agreement)} comparisons",
    ]


def of_readme():
    """Sentences of README on the study of the paper."""
    (row,) = (
        line
        for line in table("container/tables/errors")
        if (line["level"], line["family"], line["dof"]) == ("0.01", "conjugate", "all")
    )
    return [f"At noise level 0.01 the median coefficient error of the paper's pipeline is {number(row, 'median')} %"]


def of_intervals():
    """Sentences of the page on intervals of coefficients."""
    cells = table("montecarlo/cells")
    ends = {}
    for method in ("trajectory fit", "weak form", "paper's pipeline", "central difference"):
        values = [float(line["coverage"]) for line in cells if line["method"] == method]
        ends[method] = f"{min(values):.0f} to {max(values):.0f} %"
    return [
        f"With the paper's pipeline it does so in {ends[PIPELINE]}, and with central differences in "
        f"{ends['central difference']}. The trajectory fit reaches {ends['trajectory fit']}, the weak form "
        f"{ends['weak form']}.",
        interval_summary(),
    ]


def of_the_bound():
    """Rows of the page on the Cramer-Rao bound."""
    names = {"Cramér-Rao bound": "Cramer-Rao bound", "best differencing": "best differencing, chosen with hindsight"}
    rows_of = {}
    for line in table("frontier/tables/from_the_bound_down"):
        rows_of.setdefault(line["method"], []).append(
            f"{float(line['median_error']):.2g}" if float(line["median_error"]) < 100 else number(line, "median_error")
        )
    return [f"| {names.get(m, m)} | {' | '.join(v)} |" for m, v in rows_of.items() if "least squares" not in m]


AIMS = {
    "RMSE over the bound, flat prior": ("RMSE / Cramér-Rao bound, flat prior", 2),
    "90 % intervals cover, flat prior [%]": ("90 % intervals cover, flat prior", 1),
    "90 % intervals cover [%]": ("90 % intervals cover, default prior", 1),
    "90 % bands cover, 10/10 zigzag [%]": ("90 % bands cover, 10/10 zigzag", 1),
}
"""Row of the page on the Cramer-Rao bound -> measure in the table of aims, and its decimals."""


@pytest.mark.parametrize("row", AIMS)
def test_an_aim_in_the_docs_is_that_of_its_table_and_bold_where_missed(row):
    measure, digits = AIMS[row]
    lines = [line for line in table("frontier/tables/aims") if line["measure"] == measure]
    values = [(f"{float(line['value']):.{digits}f}", line["met"]) for line in lines]
    text = (ROOT / "docs" / "explanation" / "how_close_to_the_bound.md").read_text(encoding="utf-8")
    shown = next(line for line in text.splitlines() if line.startswith(f"| {row} |")).split("|")[2:5]
    assert [(cell.strip(" *"), "no" if "**" in cell else "yes") for cell in shown] == values


def harder_of_kvlcc2():
    """Indices of the harder runs inside their intervals, of all."""
    z = [abs(float(line["z"])) for line in table("kvlcc2/tables/harder_indices")]
    return f"{sum(value < NORMAL_95 for value in z)} of {len(z)} indices of the harder runs"


def of_kvlcc2():
    """Sentences of the page on the KVLCC2."""
    held_out, paths = table("kvlcc2/tables/held_out_indices"), table("kvlcc2_paths/paths")
    inside = sum(abs(float(line["z"])) < NORMAL_95 for line in held_out)
    sentences = [f"Of {len(held_out)} indices {inside} lie in their intervals of 95 %", harder_of_kvlcc2()]
    for word in ("first", "second"):
        errors = [abs(float(line["error"])) for line in held_out if line["index"] == f"{word}_overshoot_angle"]
        sentences.append(f"error of the {word} overshoot [deg] | {np.mean(errors):.2f} | {max(errors):.2f} |")
    for line in paths:
        name = {"trajectory": "trajectory fit"}.get(line["path"], line["path"].replace("^2", "²"))
        cells = " | ".join(number(line, f"{word}_overshoot_angle_mean", 2) for word in ("first", "second"))
        sentences.append(f"| {name} | {cells} |")
    for side in ("port", "starboard"):
        circle = table(f"kvlcc2/tables/forecast_turning_circle_35_{side}")
        cells = (
            f"{number(line, 'median', 2)} ({number(line, 'lower', 2)} to {number(line, 'upper', 2)})"
            for line in circle
            if line["index"] in ("advance", "tactical diameter")
        )
        sentences.append(f"| {side} | {' | '.join(cells)} |")
    return sentences


def of_esso_osaka():
    """Sentences of the page on the Esso Osaka."""
    (
        best,
        *_,
    ) = scores = table("esso_osaka/scores")
    without = {line["inputs"]: line["score"] for line in scores}
    return [
        f"error is {best['score']} of the size of the motion. Without the wind it is {without['revolutions']}, and "
        f"without the revolutions {without['wind']}.",
        *(
            f"| {line['trained_on']} | {line['tactical_diameter_error']} | {line['inside']} of {line['indices']} |"
            for line in table("esso_osaka/indices")
        ),
    ]


def of_speed():
    """Rows of the page on speed."""
    ratios = {line["what"]: float(line["ratio"]) for line in table("benchmarks/benchmarks") if line["ratio"]}
    return [
        f"| NumPy loop | {ratios['20/20 zigzag, 20000 Euler steps']:.0f} |",
        f"| shipmmg | {ratios['KVLCC2 model in 3 DOF, 200 s']:.1f} |",
        f"| scipy `least_squares` | {ratios['trajectory fit, 102 coefficients']:.0f} |",
        f"| one ship at a time | {ratios['1000 forecasts of a 35 deg turn, bands, indices']:.1f} |",
        f"| 45 polynomial terms | {ratios['one ship by 40 parameters of parts']:.2f} |",
        f"| BayesianRidge | {ratios['prior by evidence, then the posterior']:.3f} |",
    ]


def of_foreign_ships():
    """Sentences of the page on foreign ships."""
    trials, index, cases = rows("trials"), rows("indices"), foreign_summary()
    every = trials["all"]
    ends = {}
    for level in (95, 50):
        values = [float(row[f"hold_{level}"]) for name, row in trials.items() if name != "all"]
        ends[level] = f"{min(values):.0f} to {max(values):.0f} %"
    period = index["zigzag, period"]
    return [
        f"{cases['inside']} indices ({cases['share']} %) lie inside intervals of 95 %; the error of a tactical "
        f"diameter is {cases['error']} % in the median and its half width {cases['half_width']} %.",
        f"Intervals of 95 % hold {share(every, 95, 1)} % of {every['indices']} indices, those of 50 % hold "
        f"{share(every, 50, 1)} %",
        f"By trials, intervals of 95 % hold {ends[95]}, those of 50 % hold {ends[50]}.",
        f"the period of a zigzag is worst, {share(period, 95)} % of {period['indices']}",
        f"Of {TRIALS} statements of 99 % beyond the motion of the runs, {HITS} held, {statement('0.99'):.1f} %",
        f"a median error of {number(rows('stops')['track reach'], 'median_error', 1)} L and a half width of "
        f"{number(rows('stops')['track reach'], 'half_width', 1)} L",
        *left_out_rows(),
    ]


def of_model_error():
    """Sentences of the page on the model error."""
    angle, time, distance = (value("index_typical", kind) for kind in ("angle", "time", "distance"))
    held_out = table("kvlcc2/tables/held_out_indices")
    errors = np.array([float(line["error"]) for line in held_out])
    without = int(np.sum(np.abs(errors) < NORMAL_95 * known_sd(held_out)))
    return [
        f"shows the {len(held_out)} held-out indices of the KVLCC2. Without the model error {without} of them",
        f"| overshoot angle | peak heading: switching heading plus overshoot | {angle} |",
        f"| time | L/U | {time} |",
        f"| distance | L | {distance} |",
        f"| angle of roll | itself | {constants()['index_typical'].value['roll']:.3f} |",
        f"whose median adds an sd of {value('index_extrapolation_sd')} for each range",
        f"beyond the runs it is at most {SUREST}",
        f"is {float(table('kvlcc2/tables/model_error')[0]['median']):.3f} of the peak heading",
        f"intervals of 95 % hold {share(rows('trials')['one 20/20'], 95)} %.",
    ]


PIPELINE = "paper's pipeline"
HITS, TRIALS = (constants()[f"calibration_{word}"].value for word in ("hits", "trials"))
SUREST = f"{(HITS + 1) / (TRIALS + 2):.3f}"
PAGES = {
    "../README": of_readme,
    "case_studies/esso_osaka": of_esso_osaka,
    "case_studies/foreign_ships": of_foreign_ships,
    "case_studies/kvlcc2": of_kvlcc2,
    "case_studies/paper": of_paper,
    "explanation/how_close_to_the_bound": of_the_bound,
    "explanation/speed": of_speed,
    "explanation/why_intervals_fail": of_intervals,
    "explanation/model_error": of_model_error,
}
SENTENCES = [(page, sentence) for page, sentences in PAGES.items() for sentence in sentences()]


def test_the_page_on_what_to_expect_is_what_its_script_writes():
    """Else: python -m studies.documentation."""
    assert (ROOT / "docs" / "what_to_expect.md").read_text(encoding="utf-8") == what_to_expect()


@pytest.mark.parametrize("name", FIGURES)
def test_a_figure_of_the_docs_is_drawn_from_its_tables_and_shown(name):
    assert FIGURES[name]().axes
    assert (ROOT / "docs" / "figures" / f"{name}.png").is_file()
    assert any(f"figures/{name}.png" in path.read_text(encoding="utf-8") for path in (ROOT / "docs").rglob("*.md"))


@pytest.mark.parametrize(("page", "sentence"), SENTENCES)
def test_a_number_in_the_docs_is_that_of_its_table(page, sentence):
    assert sentence in plain(ROOT / "docs" / f"{page}.md")


def shown(link):
    """Cells of the table of foreign_ships.md whose head leads to a table of the report, by the first cell."""
    lines = (CASES / "foreign_ships.md").read_text(encoding="utf-8").splitlines()
    begin = next(k for k, line in enumerate(lines) if line.startswith("|") and f"/{link}.csv" in line)
    end = next(k for k in range(begin, len(lines)) if not lines[k].startswith("|"))
    cells = ([cell.strip().replace("**", "") for cell in line.strip("|").split("|")] for line in lines[begin + 2 : end])
    return {name: numbers for name, *numbers in cells}


@pytest.mark.parametrize("name", ["distances", "hulls"])
def test_a_table_in_the_docs_is_that_of_the_report(name):
    expected = {
        group: [share(row, 95), share(row, 50), f"{float(row['median_error']):.3f}", f"{float(row['half_width']):.2f}"]
        for group, row in rows(name).items()
        if group != "all"
    }
    assert shown(name) == expected


def test_no_other_interval_has_a_clearly_better_score_as_the_docs_state():
    ours, *others = rows("alternatives", "intervals").values()
    better = [float(ours["score"]) - float(row["score"]) > float(row["score_se"]) for row in others]
    words = "have no interval score that is better by more than its error"
    assert (not any(better)) == (words in plain(CASES / "foreign_ships.md"))
