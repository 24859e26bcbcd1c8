"""Writing the page of a study: nothing is left half-written, and an earlier page stays."""

from __future__ import annotations

import re
from pathlib import Path
from types import SimpleNamespace

import pytest

from pymc_ship.machine import files
from pymc_ship.machine.errors import OutputError
from pymc_ship.replication import page as report
from tests.replication.cases import SEED, Page, names, quick_report
from tests.sentences import refused


def test_the_checks_of_a_page_can_fail():
    bad = Page('<p><b>nan</p><img src="https://a.b/c.png"><figure id="x"></figure><a href="#gone">')
    assert bad.faults
    assert bad.fetched == ["https://a.b/c.png"]
    assert bad.captions == {}
    assert "gone" not in bad.ids
    assert re.search(r"\bnan\b", bad.text)


DRAWS = {"conjugate": {"exact": {"sway": None}}}
QUICK = SimpleNamespace(draws=DRAWS, comparisons=[], vessel=None, seed=SEED)
FILES = ["diagnostics.html", "sweep.png", "sway-conjugate-exact.nc", "errors.csv", "index.html"]
"""Files of the quick report in the order in which they are moved into place."""


@pytest.fixture
def earlier(tmp_path, monkeypatch):
    """Folder with an earlier report, and a report that takes no time."""
    quick_report(monkeypatch, tmp_path / "page.html.j2")
    folder = tmp_path / "report"
    folder.mkdir()
    (folder / "index.html").write_text("earlier")
    return folder


def test_a_complete_write_replaces_the_earlier_page(earlier):
    report.write_study(QUICK, earlier)
    assert (earlier / "index.html").read_text() == "new"
    assert (earlier / "tables" / "errors.csv").read_text() == "dof,median\nsurge,1.0\n"
    assert (earlier / "diagnostics.html").read_text() == "diagnosed"
    assert (earlier / "posteriors" / "sway-conjugate-exact.nc").read_text() == "posterior"
    assert names(earlier) == ["diagnostics.html", "figures", "index.html", "posteriors", "tables"]


def test_posteriors_and_figures_of_an_earlier_study_go(earlier):
    for name in ("posteriors/roll-conjugate-exact.nc", "figures/old.png", "tables/old.csv"):
        (earlier / name).parent.mkdir()
        (earlier / name).write_text("old")
    report.write_study(QUICK, earlier)
    kept = {folder: names(earlier / folder) for folder in ("figures", "posteriors", "tables")}
    assert kept == {"figures": ["sweep.png"], "posteriors": ["sway-conjugate-exact.nc"], "tables": ["errors.csv"]}


@pytest.mark.parametrize("stop", [KeyboardInterrupt, RuntimeError])
@pytest.mark.parametrize("page", ["study_content", "diagnostic_content", "render_page"])
def test_a_page_that_cannot_be_rendered_leaves_everything_as_it_was(earlier, monkeypatch, page, stop):
    def fail(*arguments, **settings):
        raise stop("stopped")

    monkeypatch.setattr(report, page, fail)
    with refused(stop, "stopped"):
        report.write_study(QUICK, earlier)
    assert names(earlier) == ["index.html"]
    assert (earlier / "index.html").read_text() == "earlier"


@pytest.mark.parametrize("step", FILES)
@pytest.mark.parametrize(("stop", "raised"), [(KeyboardInterrupt, KeyboardInterrupt), (OSError, OutputError)])
def test_a_move_that_is_stopped_is_brought_to_its_end_by_the_next_run(earlier, monkeypatch, step, stop, raised):
    moved = []

    def move(source, target, replace=files.os.replace):
        moved.append(Path(target).name)
        if moved[-1] == step:
            raise stop("stopped")
        replace(source, target)

    with monkeypatch.context() as patch:
        patch.setattr(files.os, "replace", move)
        with pytest.raises(raised):
            report.write_study(QUICK, earlier)
    assert moved[-1] == step
    assert (earlier / "index.html").read_text() == "earlier"
    files.finish_killed_runs(earlier)
    assert (earlier / "index.html").read_text() != "earlier"
    assert [name for name in names(earlier) if name.startswith(".")] == []
    assert [name for name in FILES if not list(earlier.rglob(name))] == []


def test_the_page_is_moved_into_place_last(earlier, monkeypatch):
    moved = []

    def move(source, target, replace=files.os.replace):
        moved.append(Path(target).name)
        replace(source, target)

    monkeypatch.setattr(files.os, "replace", move)
    report.write_study(QUICK, earlier)
    assert moved[-len(FILES) :] == FILES
