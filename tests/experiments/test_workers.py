"""Workers that are killed, their parent, and workers of a cluster: the same bytes all the same."""

from __future__ import annotations

import inspect
import json
import os
import signal
import subprocess
import sys
import time
import warnings
from contextlib import nullcontext
from pathlib import Path

import psutil
import pytest
from joblib.externals.loky import process_executor

import pymc_ship as ps
from pymc_ship.cli.main import main
from pymc_ship.experiments import run as engine
from pymc_ship.machine import workers as workers_module
from pymc_ship.machine.workers import MonteCarloError
from tests.experiments.cases import always_deadly, deadly, deadly_on_cluster, trivial
from tests.experiments.folders import PATH, changed, kept, run, tables, timings


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

    with pytest.raises(UserWarning, match="another") if text == "another" else nullcontext():
        run(study, tmp_path, warning)
    assert (tmp_path / "results.parquet").exists() == (text != "another")


def test_workers_that_die_again_and_again_end_the_study_in_a_sentence(study, plain, tmp_path, monkeypatch):
    monkeypatch.setattr(engine, "RESTARTS", 1)
    with pytest.raises(MonteCarloError, match="Workers died 2 times without a result in between"):
        run(study, tmp_path, always_deadly, workers=2)
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
    scheduler = [*program, "scheduler", "--host", "127.0.0.1", "--port", "0", "--no-dashboard"]
    worker = [*program, "worker", "--nworkers", "1", "--nthreads", "1", "--no-dashboard", "--local-directory"]
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
        for process in reversed(started):
            process.terminate()
        for process in started:
            process.wait(20.0)


@pytest.mark.slow
def test_a_dask_cluster_gives_the_same_bytes(cluster, study, measured, tmp_path, capsys):
    assert main(["montecarlo", str(study), "--scheduler", cluster, "--quiet", "--out", str(tmp_path)]) == 0
    assert tables(tmp_path) == tables(measured)
    assert set(timings(tmp_path)["executor"]) == {"dask"}
    assert timings(tmp_path)["workers"].max() == 2
    assert capsys.readouterr().err == ""


@pytest.mark.slow
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
        "pymc-ship: A study on a cluster needs dask.distributed, which is not installed; install pymc-ship[cluster].\n"
    )
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize("address", ["tcp://127.0.0.1:1", "nonsense://x"])
def test_a_scheduler_that_does_not_answer_is_named(study, tmp_path, monkeypatch, address):
    monkeypatch.setattr(workers_module, "_CONNECT", 0.3)
    with pytest.raises(MonteCarloError, match=f"No Dask scheduler answers at {address}"):
        ps.montecarlo(study, tmp_path, scheduler=address)


def test_workers_are_of_this_machine_or_of_a_cluster(study, tmp_path):
    with pytest.raises(MonteCarloError, match="found --workers; leave it out"):
        ps.montecarlo(study, tmp_path, workers=2, scheduler="tcp://127.0.0.1:1")
    with pytest.raises(MonteCarloError, match="at least one worker, found 0"):
        ps.montecarlo(study, tmp_path, workers=0)
