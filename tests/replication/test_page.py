"""Writing the page of a study: nothing is left half-written, and an earlier page stays."""

from __future__ import annotations

import re
from pathlib import Path
from types import SimpleNamespace

import pytest

from pymc_ship.machine import files
from pymc_ship.machine.files import OutputError
from pymc_ship.replication import page as report
from tests.replication.cases import SEED, Page, names


def test_the_checks_of_a_page_can_fail():
    bad = Page('<p><b>nan</p><img src="https://a.b/c.png"><figure id="x"></figure><a href="#gone">')
    assert bad.faults
    assert bad.fetched == ["https://a.b/c.png"]
    assert bad.captions == {}
    assert "gone" not in bad.ids
    assert re.search(r"\bnan\b", bad.text)


@pytest.fixture
def earlier(tmp_path, monkeypatch):
    """Folder with an earlier report, and a report that takes no time."""
    monkeypatch.setattr(report, "_figures", lambda result: {})
    monkeypatch.setattr(report, "render", lambda result, drawn: "new")
    monkeypatch.setattr(report, "diagnostic_page", lambda *arguments, **settings: "diagnosed")
    monkeypatch.setattr(report, "csv_tables", lambda result: {"errors": [{"dof": "surge", "median": 1.0}]})
    (tmp_path / "index.html").write_text("earlier")
    return tmp_path


NOTHING = SimpleNamespace(draws={}, comparisons=[], vessel=None, seed=SEED)


def test_a_complete_write_replaces_the_earlier_page(earlier):
    report.write_study(NOTHING, earlier)
    assert (earlier / "index.html").read_text() == "new"
    assert (earlier / "tables" / "errors.csv").read_text() == "dof,median\nsurge,1.0\n"
    assert (earlier / "diagnostics.html").read_text() == "diagnosed"
    assert names(earlier) == ["diagnostics.html", "figures", "index.html", "posteriors", "tables"]


@pytest.mark.parametrize("stop", [KeyboardInterrupt, RuntimeError])
@pytest.mark.parametrize("page", ["render", "diagnostic_page"])
def test_a_page_that_cannot_be_rendered_leaves_everything_as_it_was(earlier, monkeypatch, page, stop):
    def fail(*arguments, **settings):
        raise stop("stopped")

    monkeypatch.setattr(report, page, fail)
    with pytest.raises(stop, match="stopped"):
        report.write_study(NOTHING, earlier)
    assert names(earlier) == ["index.html"]
    assert (earlier / "index.html").read_text() == "earlier"


@pytest.mark.parametrize("step", ["figures", "posteriors", "tables", "diagnostics.html", "index.html"])
@pytest.mark.parametrize(("stop", "raised"), [(KeyboardInterrupt, KeyboardInterrupt), (OSError, OutputError)])
def test_an_interrupted_write_keeps_the_earlier_page_and_no_partial(earlier, monkeypatch, step, stop, raised):
    moved = []

    def move(source, target, replace=files.os.replace):
        moved.append(Path(target).name)
        if moved[-1] == step:
            raise stop("stopped")
        replace(source, target)

    monkeypatch.setattr(files.os, "replace", move)
    with pytest.raises(raised):
        report.write_study(NOTHING, earlier)
    assert moved[-1] == step
    assert (earlier / "index.html").read_text() == "earlier"
    assert [name for name in names(earlier) if name.startswith(".")] == []


def test_the_page_is_moved_into_place_last(earlier, monkeypatch):
    moved = []

    def move(source, target, replace=files.os.replace):
        moved.append(Path(target).name)
        replace(source, target)

    monkeypatch.setattr(files.os, "replace", move)
    report.write_study(NOTHING, earlier)
    assert moved[-2:] == ["diagnostics.html", "index.html"]
