"""A page from outside the package: one template, one function that makes its content, one call that writes it."""

from __future__ import annotations

import csv
import os
from importlib.metadata import version
from pathlib import Path

import numpy as np
import pytest
from jinja2 import TemplateNotFound, UndefinedError
from matplotlib.figure import Figure

from pymc_ship.machine.errors import OutputError
from pymc_ship.pages import drawing
from pymc_ship.pages.page import Content, Page, render_page, write_page
from pymc_ship.pages.tables import number, table
from tests.sentences import refused

TEMPLATE = """{% extends "_layout.html.j2" %}
{% from "_page.html.j2" import table, fig, bullets, credits with context %}
{% block style %}
<style>td { color: red; }</style>
{% endblock %}
{% block body %}
<h1>{{ title }}</h1>
{{ bullets(said) }}
{{ table(errors, "Errors of <one> run.") }}
{% for name in figures %}
{{ fig(name, "Curve of " ~ name ~ ".") }}
{% endfor %}
{{ credits() }}
{% endblock %}
"""

FILES = ["figures/a.png", "figures/b.png", "mine.html", "tables/errors.csv"]


@pytest.fixture
def mine(tmp_path):
    """Page whose template lies outside the package."""
    template = tmp_path / "templates" / "mine.html.j2"
    template.parent.mkdir()
    template.write_text(TEMPLATE, encoding="utf-8")
    own = ("figures/*.png", "tables/errors*.csv")
    return Page("mine.html", template, own=own, packages=("pymc-ship", "numpy"), digits=3)


def curve(slope):
    fig, axes = drawing.subplots(2.0, 1.5)
    axes[0, 0].plot([0.0, 1.0], [0.0, slope])
    return fig


def content(*names, rows=None, **others):
    """Content of the page: curves of these names, a table, and what else it is given."""
    rows = [{"run": "a & b", "error": 0.123456}, {"run": "c", "error": 7.0}] if rows is None else rows
    values = {
        "title": "a < b",
        "said": ["first", "<second>"],
        "errors": table(rows, {"run": ("run", str), "error": ("error %", number(2))}),
    }
    figures = {name: curve(slope) for slope, name in enumerate(names or ("a", "b"))}
    return Content(values, figures | others.pop("images", {}), {"errors": rows}, **others)


def broken():
    """Figure whose drawing fails."""
    fig = Figure(figsize=(1.0, 1.0))
    fig.text(0.5, 0.5, r"$\no$")
    return fig


def written(folder):
    """Bytes of every file below a folder."""
    return {str(p.relative_to(folder)): p.read_bytes() for p in sorted(folder.rglob("*")) if p.is_file()}


# what is written ------------------------------------------------------------------------------------------------------


def test_a_new_page_is_a_template_and_one_function(mine, tmp_path):
    out = tmp_path / "new" / "report"
    assert write_page(mine, out, content(sources=("Euler (1768) & sons",))) == out / "mine.html"
    assert list(written(out)) == FILES
    text = (out / "mine.html").read_text(encoding="utf-8")
    assert text.startswith("<!doctype html>\n<html")
    assert text.endswith("</body>\n</html>")
    assert "<title>a &lt; b</title>" in text
    assert "<style>td { color: red; }</style>\n</head>" in text
    assert '<ul class="short"><li>first</li><li>&lt;second&gt;</li></ul>' in text
    assert "<caption>Errors of &lt;one&gt; run.</caption>" in text
    assert '<td>a &amp; b</td><td class="n">0.12</td>' in text
    assert [f'<figure id="{name}"><svg' in text for name in "ab"] == [True, True]
    assert f"Versions: pymc-ship {version('pymc-ship')}, numpy {version('numpy')}." in text
    assert '<ul class="soft"><li>Euler (1768) &amp; sons</li></ul>' in text


def test_numbers_in_tables_have_the_digits_of_the_page(mine, tmp_path):
    rows = [{"run": 12345, "error": 0.123456}, {"error": np.float64(98765.4), "run": "x", "more": "y"}]
    write_page(mine, tmp_path / "out", content(rows=rows))
    found = list(csv.reader((tmp_path / "out" / "tables" / "errors.csv").read_text().splitlines()))
    assert found == [["run", "error", "more"], ["12345", "0.123", ""], ["x", "98800.0", "y"]]
    full = Page(mine.file, mine.template)
    write_page(full, tmp_path / "out", content(rows=rows))
    assert "12345,0.123456,\n" in (tmp_path / "out" / "tables" / "errors.csv").read_text()


def test_figures_beside_the_page_have_its_resolution(mine, tmp_path):
    write_page(mine, tmp_path / "out", content())
    data = (tmp_path / "out" / "figures" / "a.png").read_bytes()
    width, height = (int.from_bytes(data[k : k + 4], "big") for k in (16, 20))
    assert (width, height) == (2 * drawing.BESIDE_DPI, 1.5 * drawing.BESIDE_DPI)


def test_an_image_given_as_text_stands_in_the_page_alone(mine, tmp_path):
    image = drawing.html_image(curve(1.0), "a <curve>")
    write_page(mine, tmp_path / "out", content("a", images={"c": image}))
    assert [name for name in written(tmp_path / "out") if name.startswith("figures")] == ["figures/a.png"]
    text = (tmp_path / "out" / "mine.html").read_text(encoding="utf-8")
    assert '<figure id="c"><img alt="a &lt;curve&gt;" src="data:image/png;base64,' in text


def test_tables_may_stand_elsewhere_and_other_files_beside_them(mine, tmp_path):
    page = Page(mine.file, mine.template, tables=".")
    others = {"more/notes.txt": lambda path: path.write_text("noted")}
    write_page(page, tmp_path / "out", content(files=others))
    assert list(written(tmp_path / "out")) == ["errors.csv", *FILES[:2], "mine.html", "more/notes.txt"]
    assert (tmp_path / "out" / "more" / "notes.txt").read_text() == "noted"


def test_the_same_content_gives_the_same_bytes(mine, tmp_path):
    for name in ("one", "two"):
        write_page(mine, tmp_path / name, content())
    assert written(tmp_path / "one") == written(tmp_path / "two")
    write_page(mine, tmp_path / "two", content("b", "a"))
    assert written(tmp_path / "one") != written(tmp_path / "two")


# an earlier page ------------------------------------------------------------------------------------------------------


def test_own_files_of_an_earlier_page_go_and_others_stay(mine, tmp_path):
    write_page(mine, tmp_path / "out", content("a", "b", "old"))
    for name in ("figures/note.txt", "tables/others.csv", "errors.csv"):
        (tmp_path / "out" / name).write_text("kept")
    write_page(mine, tmp_path / "out", content())
    kept = ["errors.csv", "figures/note.txt", "tables/others.csv"]
    assert list(written(tmp_path / "out")) == sorted([*FILES, *kept])
    write_page(mine, tmp_path / "out", content(rows=[]))
    assert list(written(tmp_path / "out")) == sorted([*FILES[:-1], *kept])


def test_a_page_that_owns_nothing_removes_nothing(mine, tmp_path):
    page = Page(mine.file, mine.template)
    write_page(page, tmp_path / "out", content("old"))
    write_page(page, tmp_path / "out", content())
    assert "figures/old.png" in written(tmp_path / "out")


def failing(stop):
    def fail(*_):
        raise stop("stopped")

    return fail


FAULTS = {
    "a figure cannot be drawn": (lambda: content(images={"bad": broken()}), ValueError),
    "a file cannot be made": (lambda: content(files={"x.txt": failing(RuntimeError)}), RuntimeError),
    "it is interrupted": (lambda: content(files={"x.txt": failing(KeyboardInterrupt)}), KeyboardInterrupt),
    "the disk is full": (lambda: content(files={"x.txt": failing(OSError)}), OutputError),
}


@pytest.mark.parametrize("fault", FAULTS)
def test_a_page_is_complete_or_absent(mine, tmp_path, fault):
    make, raised = FAULTS[fault]
    with pytest.raises(raised):
        write_page(mine, tmp_path / "out", make())
    assert written(tmp_path / "out") == {}
    write_page(mine, tmp_path / "out", content("a", "b", "old"))
    before = written(tmp_path / "out")
    with pytest.raises(raised):
        write_page(mine, tmp_path / "out", make())
    assert written(tmp_path / "out") == before


def test_the_page_is_moved_into_place_last(mine, tmp_path, monkeypatch):
    moved, replace = [], os.replace

    def noted(source, target):
        moved.append(Path(target).name)
        replace(source, target)

    monkeypatch.setattr(os, "replace", noted)
    write_page(mine, tmp_path / "out", content())
    assert moved[1:] == ["a.png", "b.png", "errors.csv", "mine.html"]


def test_a_folder_that_cannot_be_written_is_told(mine, tmp_path):
    (tmp_path / "file").write_text("kept")
    with refused(OutputError, "file"):
        write_page(mine, tmp_path / "file", content())
    assert (tmp_path / "file").read_text() == "kept"


# templates ------------------------------------------------------------------------------------------------------------


def test_a_page_misses_no_name(mine):
    whole = content()
    assert "<h1>a &lt; b</h1>" in render_page(mine, whole)
    bare = {name: value for name, value in whole.values.items() if name != "title"}
    with refused(UndefinedError, "title"):
        render_page(mine, Content(bare))


def test_a_template_may_use_those_beside_it(mine):
    (mine.template.parent / "_lines.html.j2").write_text("{% macro line(text) %}-{{ text }}-{% endmacro %}")
    mine.template.write_text('{% from "_lines.html.j2" import line %}{{ line(title) }}{{ versions }}')
    assert render_page(Page("x.html", mine.template), Content({"title": "<x>"})) == "-&lt;x&gt;-"


def test_a_template_that_is_not_there_is_named(mine):
    with refused(TemplateNotFound, "none.html.j2"):
        render_page(Page("x.html", mine.template.with_name("none.html.j2")), Content({}))
