"""Monte-Carlo studies: the same bytes by one worker and two, the methods behind them, and the command."""

from __future__ import annotations

import re
import shutil
import subprocess
import sys

import numpy as np
import pandas as pd
import pytest

import pymc_ship as ps
from pymc_ship.cli.main import main
from pymc_ship.experiments import task as task_module
from pymc_ship.experiments.task import METHODS, Task
from tests.experiments.cases import always_deadly
from tests.experiments.folders import run, tables, timings


def test_two_workers_give_the_bytes_of_one(study, measured, tmp_path):
    ps.montecarlo(study, tmp_path, workers=2)
    assert tables(tmp_path) == tables(measured)
    assert set(timings(tmp_path)["workers"]) == {2}
    assert set(timings(measured)["workers"]) == {1}


def test_results_are_those_of_the_methods(measured, small):
    found = pd.read_parquet(measured / "results.parquet")
    assert found.columns.tolist()[:6] == ["ship", "manoeuvre", "noise", "level", "method", "seed"]
    assert len(found) == len(found.drop_duplicates(["level", "method", "seed"])) == 16
    assert set(found["status"]) <= {"ok", "diverged"}
    parts = pd.read_parquet(measured / "parts")
    assert set(found.columns) <= set(parts.columns)
    assert sorted(parts["median_error"]) == sorted(found["median_error"])
    task = Task(small, ps.zigzag(20, 20), "white", 0.05, "weak form", 3, 7, 60.0)
    noisy = task_module.noisy_trial(ps.simulate(small, ps.zigzag(20, 20), duration=60.0), 0.05, "white", task.rng())
    estimate = METHODS["weak form"](noisy, small)
    row = found[(found["level"] == 0.05) & (found["method"] == "weak form") & (found["seed"] == 3)].iloc[0]
    assert row["median_error"] == pytest.approx(estimate.scores(small)["median"], rel=1e-9)
    assert row["coverage"] == pytest.approx(estimate.scores(small)["coverage"])


def test_a_complete_study_does_no_task_again(study, plain, tmp_path):
    shutil.copytree(plain, tmp_path / "out")
    run(study, tmp_path / "out", always_deadly)
    assert tables(tmp_path / "out") == tables(plain)


def test_a_method_that_fails_is_a_result(study, tmp_path, monkeypatch):
    def fails(noisy, vessel):
        raise ZeroDivisionError("of\nno use")

    monkeypatch.setitem(METHODS, "weak form", fails)
    ps.montecarlo(study, tmp_path, workers=1)
    found = pd.read_parquet(tmp_path / "results.parquet")
    failed = found[found["method"] == "weak form"]
    assert set(failed["status"]) == {"failed"}
    assert set(failed["sentence"]) == {"ZeroDivisionError: of no use"}
    assert failed["median_error"].isna().all()
    cells = pd.read_csv(tmp_path / "cells.csv").set_index("method").loc["weak form"]
    assert np.isinf(cells["median_error"]).all()
    assert cells["coverage"].eq(0.0).all()
    assert cells["failed"].eq(4).all()


def test_a_place_that_cannot_be_written_is_one_sentence(study, tmp_path, capsys):
    (tmp_path / "file").write_text("kept")
    assert main(["montecarlo", str(study), "--workers", "1", "--out", str(tmp_path / "file" / "below")]) == 2
    assert re.fullmatch(r"pymc-ship: .*below cannot be written: .*\n", capsys.readouterr().err)
    assert (tmp_path / "file").read_text() == "kept"


def test_nothing_of_a_study_is_loaded_before_it_is_run():
    code = "import sys, pymc_ship\nfrom pymc_ship.cli.main import main\ntry:\n    main(['montecarlo', '--help'])\n"
    code += "except SystemExit:\n    print('|', [n for n in sys.argv[1:] if n in sys.modules])"
    names = ("joblib", "dask", "distributed", "pandas", "pyarrow", "matplotlib", "numba", "numpy")
    printed = subprocess.run([sys.executable, "-c", code, *names], check=True, capture_output=True, text=True).stdout
    assert printed.rsplit("|", 1)[1].strip() == "[]"


def test_the_command_prints_the_cells_and_tells_how_far_it_is(study, tmp_path, capsys):
    assert main(["montecarlo", str(study), "--workers", "1", "--out", str(tmp_path)]) == 0
    printed = capsys.readouterr()
    lines = [line.split() for line in printed.out.splitlines()]
    assert lines[0][:2] == ["level", "method"]
    assert len(lines) == 5
    assert lines[1][:3] == ["0.01", "weak", "form"]
    assert "16 of 16 tasks, " in printed.err
    assert re.search(r"[\d.]+ a second, \d+ s left", printed.err)
    assert f"Written to {tmp_path / 'index.html'}." in printed.err


def test_quiet_is_quiet(study, plain, tmp_path, capsys):
    shutil.copytree(plain, tmp_path / "out")
    assert main(["montecarlo", str(study), "--quiet", "--workers", "1", "--out", str(tmp_path / "out")]) == 0
    assert capsys.readouterr().err == ""
