"""The page of a study."""

from __future__ import annotations

import shutil

from pymc_ship.experiments import page as report
from tests.experiments.folders import run


def test_a_large_page_says_what_it_leaves_out(study, plain, tmp_path, monkeypatch):
    monkeypatch.setattr(report, "MOST_ROWS", 3)
    monkeypatch.setattr(report, "MOST_FIGURES", 0)
    shutil.copytree(plain, tmp_path / "out")
    run(study, tmp_path / "out")
    text = (tmp_path / "out" / "index.html").read_text(encoding="utf-8")
    assert "1 more cells are in" in text
    assert "1 more combinations of ship, manoeuvre and noise are in" in text
