"""Monte-Carlo studies: the same bytes whatever runs where and is killed when, the methods behind them, the command."""

from __future__ import annotations

import inspect
import json
import os
import re
import shutil
import signal
import subprocess
import sys
import time
import warnings
from contextlib import nullcontext
from pathlib import Path

import numpy as np
import pandas as pd
import psutil
import pytest
from joblib.externals.loky import process_executor

import pymc_ship as ps
from pymc_ship.cli.main import main
from pymc_ship.experiments import task as task_module
from pymc_ship.experiments.task import METHODS, Task
from pymc_ship.machine import workers as workers_module
from pymc_ship.machine.errors import StudyError
from pymc_ship.physics.vessel.plausibility import remarks
from pymc_ship.physics.vessel.reading import load_vessel
from tests.experiments.cases import always_deadly, always_full, deadly, deadly_on_cluster, out_of_memory_once, trivial
from tests.experiments.folders import PATH, changed, kept, run, tables, timings
from tests.sentences import refused

TWO = pytest.param(2, marks=pytest.mark.consistency)  # processes


@pytest.fixture(scope="module")
def measured(study, tmp_path_factory):
    """Folder of the true study by one worker."""
    out = tmp_path_factory.mktemp("measured")
    ps.montecarlo(study, out, workers=1)
    return out


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


def test_what_is_derived_or_doubtful_in_a_vessel_is_told(study, tmp_path, capsys):
    odd = (study.parent / "small.toml").read_text().replace("m = 0.0075081\n", "").replace("L = 230.66", "L = 170.0")
    (tmp_path / "small.toml").write_text(odd)
    (tmp_path / "study.toml").write_text(study.read_text())
    (tmp_path / "file").write_text("")
    words = ["--workers", "1", "--out", str(tmp_path / "file" / "below")]  # cannot be written: no task is done
    assert main(["montecarlo", str(tmp_path / "study.toml"), *words]) == 2
    vessel = load_vessel(tmp_path / "small.toml")
    assert len(remarks(vessel)) > 1
    assert capsys.readouterr().err.splitlines()[:-1] == [f"small: {sentence}" for sentence in remarks(vessel)]


def test_quiet_is_quiet(study, plain, tmp_path, capsys):
    shutil.copytree(plain, tmp_path / "out")
    assert main(["montecarlo", str(study), "--quiet", "--workers", "1", "--out", str(tmp_path / "out")]) == 0
    assert capsys.readouterr().err == ""


def test_a_killed_worker_is_replaced_and_nothing_is_lost(study, plain, tmp_path, monkeypatch):
    mark = tmp_path / "mark"
    monkeypatch.setenv("MC_MARK", str(mark))
    run(study, tmp_path / "out", deadly, workers=2)
    assert mark.exists()
    assert tables(tmp_path / "out") == tables(plain)


@pytest.mark.parametrize("text", ["A worker stopped while some jobs were given to the executor.", "another"])
def test_a_worker_that_joblib_renews_is_no_remark(study, tmp_path, text):
    """Here any other warning is an error."""
    assert "A worker stopped while some jobs were given to the " in inspect.getsource(process_executor)

    def warning(task):
        warnings.warn(text, UserWarning, stacklevel=1)
        return trivial(task)

    with pytest.raises(UserWarning) if text == "another" else nullcontext():
        run(study, tmp_path, warning)
    assert (tmp_path / "results.parquet").exists() == (text != "another")


def test_workers_that_die_again_and_again_end_the_study_in_a_sentence(study, plain, tmp_path, monkeypatch):
    monkeypatch.setattr(workers_module, "RESTARTS", 1)
    with refused(StudyError, 2):
        run(study, tmp_path, always_deadly, workers=2)
    run(study, tmp_path)
    assert tables(tmp_path) == tables(plain)


@pytest.mark.parametrize("workers", [1, TWO])
def test_a_task_that_the_machine_fails_is_done_again(study, plain, tmp_path, monkeypatch, workers):
    mark = tmp_path / "mark"
    monkeypatch.setenv("MC_MARK", str(mark))
    run(study, tmp_path / "out", out_of_memory_once, workers=workers)
    assert mark.exists()
    assert tables(tmp_path / "out") == tables(plain)


@pytest.mark.parametrize("workers", [1, TWO])
def test_a_machine_that_fails_every_task_ends_the_study_in_a_sentence(study, plain, tmp_path, workers):
    with refused(StudyError, 6, "OSError"):
        run(study, tmp_path, always_full, workers=workers)
    assert kept(tmp_path) == set()
    run(study, tmp_path)
    assert tables(tmp_path) == tables(plain)


def killed_parent(study, out, least):
    """Start a study of slow tasks, kill its parent with SIGKILL after so many results; return the results kept."""
    code = (
        "import sys, tests.experiments.cases as c; from pymc_ship.experiments.run import reported_montecarlo as run\n"
    )
    code += "run(sys.argv[1], sys.argv[2], workers=2, work=c.slow)"
    environment = os.environ | {"PYTHONPATH": PATH}
    process = subprocess.Popen([sys.executable, "-c", code, str(study), str(out)], env=environment)
    deadline = time.monotonic() + 60.0
    while len(kept(out)) < least and time.monotonic() < deadline:
        time.sleep(0.01)
    children = psutil.Process(process.pid).children(recursive=True)
    process.send_signal(signal.SIGKILL)
    process.wait()
    found = kept(out)
    assert len(children) >= 2
    assert psutil.wait_procs(children, timeout=20.0)[1] == []  # none is left behind
    return found


def test_a_killed_parent_leaves_results_that_are_neither_lost_nor_done_again(study, plain, tmp_path):
    before = killed_parent(study, tmp_path, 5)
    assert 5 <= len(before) < 16
    assert not (tmp_path / "results.parquet").exists()
    run(study, tmp_path)
    assert tables(tmp_path) == tables(plain)
    sessions = timings(tmp_path).groupby("session").size().tolist()
    assert sessions == [len(before), 16 - len(before)]


# a cluster


@pytest.fixture(scope="module")
def cluster(tmp_path_factory):
    """Address of a Dask scheduler on the loopback with two workers of one thread, all processes of their own."""
    folder = tmp_path_factory.mktemp("dask")
    environment = os.environ | {"PYTHONPATH": PATH, "PYTHONWARNINGS": "ignore"}
    contact, quiet = folder / "scheduler.json", {"stdout": subprocess.DEVNULL, "stderr": subprocess.DEVNULL}
    program = [str(Path(sys.executable).with_name("dask"))]
    no_page = ["--no-dashboard", "--dashboard-address", ":0"]  # the default port may be another test's
    scheduler = [*program, "scheduler", "--host", "127.0.0.1", "--port", "0", *no_page]
    worker = [*program, "worker", "--nworkers", "1", "--nthreads", "1", *no_page, "--local-directory"]
    ending = ["--scheduler-file", str(contact)]
    started = [subprocess.Popen([*scheduler, *ending], env=environment, cwd=folder, **quiet)]
    try:
        deadline = time.monotonic() + 60.0
        while not contact.exists() and time.monotonic() < deadline:
            time.sleep(0.1)
        for k in range(2):
            words = [*worker, str(folder / f"worker{k}"), *ending]
            started.append(subprocess.Popen(words, env=environment, cwd=folder, **quiet))
        yield json.loads(contact.read_text())["address"]
    finally:
        for process in reversed(started):  # a worker takes its leave of the scheduler
            process.terminate()
            process.wait(60.0)


@pytest.mark.slow
@pytest.mark.consistency
def test_a_dask_cluster_gives_the_same_bytes(cluster, study, measured, tmp_path, capsys):
    assert main(["montecarlo", str(study), "--scheduler", cluster, "--quiet", "--out", str(tmp_path)]) == 0
    assert tables(tmp_path) == tables(measured)
    assert set(timings(tmp_path)["executor"]) == {"dask"}
    assert timings(tmp_path)["workers"].max() == 2
    assert capsys.readouterr().err == ""


@pytest.mark.slow
@pytest.mark.consistency
def test_a_study_is_begun_here_and_ended_on_a_cluster(cluster, study, plain, tmp_path):
    before = killed_parent(study, tmp_path, 3)
    run(study, tmp_path, workers=None, scheduler=cluster)
    assert tables(tmp_path) == tables(plain)
    assert timings(tmp_path)["executor"].eq("joblib").sum() == len(before) < 16


@pytest.mark.slow
def test_a_cluster_that_loses_a_worker_goes_on(cluster, study, plain, tmp_path):
    """The nanny starts the worker again; the scheduler hands its tasks out once more."""
    killing = changed(study, ("root_seed = 7", "root_seed = 7\n# here"))
    run(killing, tmp_path, deadly_on_cluster(tmp_path / "mark"), workers=None, scheduler=cluster)
    assert (tmp_path / "mark").exists()
    assert tables(tmp_path) == tables(plain)


def test_without_distributed_a_cluster_is_refused_in_a_sentence(study, tmp_path, monkeypatch, capsys):
    monkeypatch.setitem(sys.modules, "distributed", None)
    assert main(["montecarlo", str(study), "--scheduler", "tcp://127.0.0.1:1", "--out", str(tmp_path / "out")]) == 2
    assert capsys.readouterr().err == (
        "pymc-ship: Tasks on a cluster need dask.distributed, which is not installed; install pymc-ship[cluster].\n"
    )
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize("address", ["tcp://127.0.0.1:1", "nonsense://x"])
def test_a_scheduler_that_does_not_answer_is_named(study, tmp_path, monkeypatch, address):
    monkeypatch.setattr(workers_module, "_CONNECT", 0.3)
    with refused(StudyError, address):
        ps.montecarlo(study, tmp_path, scheduler=address)


def test_cells_have_their_scores_and_monte_carlo_errors(measured):
    found, cells = pd.read_parquet(measured / "results.parquet"), pd.read_csv(measured / "cells.csv")
    assert len(cells) == 4
    for _, cell in cells.iterrows():
        mine = found[(found["level"] == cell["level"]) & (found["method"] == cell["method"])]
        assert cell["median_error"] == pytest.approx(mine["median_error"].median(), rel=1e-5)
        assert cell["coverage"] == pytest.approx(mine["coverage"].mean(), rel=1e-5)
        assert cell["seeds"] == len(mine) == 4
        assert cell["median_error_se"] > 0.0


def test_the_page_has_scores_costs_and_the_step_beyond(measured):
    text = (measured / "index.html").read_text(encoding="utf-8")
    assert "<svg" in text
    assert "weak form" in text
    assert "The step beyond: 1e6 tasks" in text
    assert "processor time of" not in text
    assert all(name in text for name in ("overhead %", "parent ms/task", "time on 64 cores", "storage"))
