"""Every calibration number in the docs is that of the constants or of the table in ``reports`` it comes from."""

from __future__ import annotations

import csv
import re
from functools import cache
from pathlib import Path

import pytest

from pymc_ship.ships.ensemble.calibration import constants

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


def ratios(words):
    """Smallest and largest of what each half would choose over what is used, as the docs say it."""
    found = [row for name, row in rows("model_error", "of").items() if name in words]
    assert len(found) == len(words)
    over = [float(row[half]) / float(row["used"]) for row in found for half in ("first", "second")]
    return f"{min(over):.1f} to {max(over):.1f} times"


def chosen(name, row, digits):
    """What the halves would choose in a table: smaller and larger."""
    found = rows(name, "of")[row]
    return sorted(round(float(found[half]), digits) for half in ("first", "second"))


def number(row, name, digits=0):
    """A number of a row, rounded."""
    return f"{float(row[name]):.{digits}f}"


def simulators():
    """Indices inside and their share [%], error and half width of a tactical diameter [%] of ``make foreign``."""
    words = r"(\d+ of \d+) indices inside \((\d+) %.*?\|error\| (\S+) %, median half width (\S+) %"
    return re.search(words, plain(ROOT / "reports" / "foreign" / "foreign.md")).groups()


def of_what_to_expect():
    """Sentences of the page on what to expect."""
    every, small, diameter = rows("trials")["all"], rows("trials")[SMALL], rows("indices")[DIAMETER]
    inside, _, median, _ = simulators()
    return [
        f"diameter {number(diameter, 'median_error', 2)} L | {number(every, 'hold_95', 1)} % of {every['indices']} |",
        f"({number(small, 'half_width', 2)} in the median of all indices) and hold {number(small, 'hold_95')} % of",
        f"diameter {median} % | {inside} |",
    ]


def of_foreign_ships():
    """Sentences of the page on foreign ships."""
    every, growth, hulls, index = rows("trials")["all"], rows("growth", "of")["index"], rows("hulls"), rows("indices")
    flow, roll, weight = hulls["cross flow"], index["turning circle, maximum roll angle"], chosen(*OF_WEIGHT)
    inside, percent, median, width = simulators()
    half_rate = share(index["pull out, time to half rate"], 95)
    return [
        f"{inside} indices ({percent} %) lie inside intervals of 95 %; the error of a tactical diameter is {median} % "
        f"in the median and its half width {width} %.",
        f"Intervals of 95 % hold {share(every, 95, 1)} % of {every['indices']} indices, those of 50 % hold "
        f"{share(every, 50, 1)} %",
        f"{number(flow, 'hold_95')} and {number(flow, 'hold_50')} %: that is",
        f"So are those for Mariners, {number(hulls['mariner'], 'hold_95')} %",
        f"angles of roll in circles, {share(roll, 95)} % of {roll['indices']}",
        f"loses half its rate, {half_rate} %",
        f"growth beyond the runs of {number(growth, 'first', 3)}, the first half, or {number(growth, 'second', 3)}, "
        f"the second, in place of the {value('index_growth')} that is used",
        f"would be {weight[0]:.2f} to {weight[1]:.2f} in place of {value('index_together')}.",
        f'Of {MADE} statements "at most" or "at least" that were made with 99 % beyond the motion of the runs, {HELD} '
        f"held, {statement('0.99'):.1f} %",
        f"Those of 75 % held in {statement('0.75'):.0f} %, those of 90 % in {statement('0.9'):.0f} %.",
        f"{share(every, 95, 1)} and {share(every, 50, 1)} %; bands",
    ]


def of_model_error():
    """Sentences of the page on the model error."""
    low, high = chosen("growth", "index", 3)
    near, far = rows("distances")["1 to 3 ranges beyond"], rows("distances")["further"]
    angle, time, distance = (value("index_typical", kind) for kind in ("angle", "time", "distance"))
    u, v, r, psi, x = (value("motion_typical", name) for name in ("u", "v", "r", "psi", "x"))
    more = {name: value("motion_growth", name) for name in ("u", "v", "r", "psi", "x")}
    of_velocity, of_track = ([f"typical error of the motion, {name}" for name in names] for names in ("uvr", PLACES))
    return [
        f"The typical errors are {angle} of the swing, {time} L/U, {distance} L and "
        f"{constants()['index_typical'].value['roll']:.3f} of an angle of roll",
        f"{ratios(['typical error, angle', 'typical error, distance'])} as much of an angle or a distance",
        f"an error with an sd of {value('index_growth')} more",
        f"{share(near, 95)} % of the indices that lie 1 to 3 ranges beyond the runs and {share(far, 95)} % of those "
        f"further on: these ships would choose {low} to {high}.",
        f'Of {MADE} statements "at most" or "at least"',
        f"{HELD} held: no forecast states more than {SUREST}",
        f"are {u} of the nominal speed for u, {v} for v, {r} U/L of the yaw rate, {psi} rad and {x} L",
        f"would choose {ratios(of_velocity)} as much of the velocities, and {ratios(of_track)} of heading and track",
        f"u gets an error with an sd of {more['u']} of the nominal speed more, v of {more['v']}, the yaw rate of "
        f"{more['r']} U/L",
        f"of {more['psi']} rad and {more['x']} L",
        f"those of 95 % hold {share(rows('trials')['one 20/20'], 95)} %.",
    ]


def of_your_ship():
    """Sentences of the tutorial."""
    return [f"of {MADE} statements of 99 %", f"{HELD} held. No probability is stated above {SUREST}."]


OF_WEIGHT, SMALL = ("model_error", "weight of an index", 2), "10/10 to both sides"
DIAMETER, PLACES = "turning circle, tactical diameter", ("psi", "x", "y")
HELD, MADE = (constants()[f"statements_{word}"].value for word in ("held", "made"))
SUREST = f"{(HELD + 1) / (MADE + 2):.3f}"
PAGES = {
    "what_to_expect": of_what_to_expect,
    "case_studies/foreign_ships": of_foreign_ships,
    "explanation/model_error": of_model_error,
    "tutorials/your_ship": of_your_ship,
}
SENTENCES = [(page, sentence) for page, sentences in PAGES.items() for sentence in sentences()]


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


@pytest.mark.parametrize("name", ["trials", "distances", "hulls"])
def test_a_table_in_the_docs_is_that_of_the_report(name):
    expected = {
        group: [share(row, 95), share(row, 50), f"{float(row['median_error']):.3f}", f"{float(row['half_width']):.2f}"]
        for group, row in rows(name).items()
        if group != "all"
    }
    assert shown(name) == expected


def test_other_intervals_in_the_docs_are_those_of_the_report():
    text = plain(CASES / "foreign_ships.md")
    for name, row in rows("alternatives", "intervals").items():
        score = f"{float(row['score']):.2f} ± {float(row['score_se']):.2f}"
        cells = [share(row, 95), f"{float(row['hold_50']):.0f}", f"{float(row['half_width']):.3f}", score]
        assert f"| {name} | {' | '.join(cells)} |" in text
