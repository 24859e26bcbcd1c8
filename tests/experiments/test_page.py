"""The page of a study."""

from __future__ import annotations

import shutil

import pandas as pd
import pytest

from pymc_ship.experiments import page as report
from tests.experiments.cases import failing, trivial
from tests.experiments.folders import changed, run


def test_a_large_page_says_what_it_leaves_out(study, plain, tmp_path, monkeypatch):
    monkeypatch.setattr(report, "MOST_ROWS", 3)
    monkeypatch.setattr(report, "MOST_FIGURES", 0)
    shutil.copytree(plain, tmp_path / "out")
    run(study, tmp_path / "out")
    text = (tmp_path / "out" / "index.html").read_text(encoding="utf-8")
    assert "1 more cells are in" in text
    assert "1 more combinations of ship, manoeuvre and noise are in" in text


@pytest.mark.parametrize("seeds", [1, 4])
def test_a_study_whose_tasks_all_fail_has_its_page(study, tmp_path, seeds):
    run(changed(study, ("seeds = 4", f"seeds = {seeds}")), tmp_path, failing)
    cells = pd.read_csv(tmp_path / "cells.csv")
    assert cells["failed"].eq(seeds).all()
    assert cells["coverage"].eq(0.0).all()
    text = (tmp_path / "index.html").read_text(encoding="utf-8")
    assert text.count("no finite value") == 2


def test_a_study_of_one_method_that_fails_and_one_that_does_not_has_its_page(study, tmp_path):
    run(study, tmp_path, lambda task: (failing if task.method == "weak form" else trivial)(task))
    assert pd.read_csv(tmp_path / "cells.csv").groupby("method")["failed"].sum().tolist() == [0, 8]
