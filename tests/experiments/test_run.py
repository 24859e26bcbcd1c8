"""Monte-Carlo studies: the same bytes whatever runs where and is killed when; one sentence where nothing can run."""

from __future__ import annotations

import inspect
import json
import os
import re
import resource
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
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from joblib.externals.loky import process_executor
from threadpoolctl import threadpool_info

import pymc_ship as ps
from pymc_ship.cli.main import main
from pymc_ship.experiments import page as report
from pymc_ship.experiments import run as engine
from pymc_ship.experiments import task as task_module
from pymc_ship.experiments.grid import Cell, difference, read_grid
from pymc_ship.experiments.store import opened
from pymc_ship.experiments.tables import Costs, Sizes, bottleneck, cell_row, method_rows, plan_rows
from pymc_ship.experiments.task import METHODS, PARTS, Task, measure, turn_error
from pymc_ship.machine import workers as workers_module
from pymc_ship.machine.threads import one_thread, thread_pool
from pymc_ship.machine.workers import MonteCarloError
from pymc_ship.vessel.vessel import reference_coefficients
from tests.experiments import cases
from tests.journeys.test_cli import toml

ROOT = Path(__file__).parents[2]
PATH = os.pathsep.join(filter(None, [str(ROOT), os.environ.get("PYTHONPATH")]))
TABLES = ("results.parquet", "cells.csv")


@pytest.fixture(scope="module")
def study(small, tmp_path_factory):
    """Study of a small ship: two methods, two levels, four seeds."""
    folder = tmp_path_factory.mktemp("study")
    (folder / "small.toml").write_text(toml(small))
    (folder / "study.toml").write_text(cases.TOML)
    return folder / "study.toml"


def changed(study, *pairs):
    """Another study beside one, with parts of its text replaced."""
    text = study.read_text()
    for old, new in pairs:
        assert old in text
        text = text.replace(old, new)
    path = study.with_name(f"{abs(hash(text))}.toml")
    path.write_text(text)
    return path


def run(study, out, work=cases.trivial, **settings):
    return engine.reported_montecarlo(study, out, work=work, **({"workers": 1} | settings))


def tables(out):
    return {name: (out / name).read_bytes() for name in TABLES}


def timings(out):
    return pd.read_parquet(out / "timings.parquet")


@pytest.fixture(scope="module")
def plain(study, tmp_path_factory):
    """Folder of the study of trivial tasks, never interrupted."""
    out = tmp_path_factory.mktemp("plain")
    run(study, out)
    return out


@pytest.fixture(scope="module")
def measured(study, tmp_path_factory):
    """Folder of the true study by one worker."""
    out = tmp_path_factory.mktemp("measured")
    ps.montecarlo(study, out, workers=1)
    return out


# the same bytes


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


def test_cells_have_their_scores_and_monte_carlo_errors(measured):
    found, cells = pd.read_parquet(measured / "results.parquet"), pd.read_csv(measured / "cells.csv")
    assert len(cells) == 4
    for _, cell in cells.iterrows():
        mine = found[(found["level"] == cell["level"]) & (found["method"] == cell["method"])]
        assert cell["median_error"] == pytest.approx(mine["median_error"].median(), rel=1e-5)
        assert cell["coverage"] == pytest.approx(mine["coverage"].mean(), rel=1e-5)
        assert cell["seeds"] == len(mine) == 4
        assert cell["median_error_se"] > 0.0


def test_a_killed_worker_is_replaced_and_nothing_is_lost(study, plain, tmp_path, monkeypatch):
    mark = tmp_path / "mark"
    monkeypatch.setenv("MC_MARK", str(mark))
    run(study, tmp_path / "out", cases.deadly, workers=2)
    assert mark.exists()
    assert tables(tmp_path / "out") == tables(plain)


@pytest.mark.parametrize("text", ["A worker stopped while some jobs were given to the executor.", "another"])
def test_a_worker_that_joblib_renews_is_no_remark(study, tmp_path, text):
    """Here any other warning is an error."""
    assert "A worker stopped while some jobs were given to the " in inspect.getsource(process_executor)

    def warning(task):
        warnings.warn(text, UserWarning, stacklevel=1)
        return cases.trivial(task)

    with pytest.raises(UserWarning, match="another") if text == "another" else nullcontext():
        run(study, tmp_path, warning)
    assert (tmp_path / "results.parquet").exists() == (text != "another")


def test_workers_that_die_again_and_again_end_the_study_in_a_sentence(study, plain, tmp_path, monkeypatch):
    monkeypatch.setattr(engine, "RESTARTS", 1)
    with pytest.raises(MonteCarloError, match="Workers died 2 times without a result in between"):
        run(study, tmp_path, cases.always_deadly, workers=2)
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


def kept(out):
    """Method, level and seed of every result in parts and journals."""
    parts = out / "parts"
    found = set()
    for path in parts.rglob("[!.]*.parquet"):  # not what is being written
        found |= {(path.parent.name, path.parent.parent.name, k) for k in pq.read_table(path)["seed"].to_pylist()}
    for path in parts.rglob("_*.jsonl"):
        lines = path.read_bytes().split(b"\n")[:-1] if path.exists() else []
        found |= {(path.parent.name, path.parent.parent.name, json.loads(line)["seed"]) for line in lines}
    return found


def test_a_killed_parent_leaves_results_that_are_neither_lost_nor_done_again(study, plain, tmp_path):
    before = killed_parent(study, tmp_path, 5)
    assert 5 <= len(before) < 16
    assert not (tmp_path / "results.parquet").exists()
    run(study, tmp_path)
    assert tables(tmp_path) == tables(plain)
    sessions = timings(tmp_path).groupby("session").size().tolist()
    assert sessions == [len(before), 16 - len(before)]


def test_a_complete_study_does_no_task_again(study, plain, tmp_path):
    shutil.copytree(plain, tmp_path / "out")
    run(study, tmp_path / "out", cases.always_deadly)
    assert tables(tmp_path / "out") == tables(plain)


def journalled(study, out):
    """Store of a study with three results in the journal of its first part, and the journal."""
    with opened(out, read_grid(study)) as store:
        (cell, part, seeds), *_ = store.missing()
        for seed in seeds[:3]:
            clock = {"session": 1, "executor": "joblib", "workers": 1, "wall": 1.0, "parent": 1.0}
            store.add(cases.trivial(store.grid.task(cell, seed, part)) | clock)
    (journal,) = out.rglob("_*.jsonl")
    return journal


def test_a_line_that_was_cut_off_is_dropped(study, plain, tmp_path):
    journal = journalled(study, tmp_path)
    journal.write_bytes(journal.read_bytes()[:-30])
    with opened(tmp_path, read_grid(study)) as store:
        assert store.missing()[0][2] == [2, 3]
    run(study, tmp_path)
    assert tables(tmp_path) == tables(plain)
    assert timings(tmp_path)["session"].eq(1).sum() == 2


def test_a_journal_whose_part_is_written_counts_once(study, plain, tmp_path):
    """The run was killed after the part was moved into place and before its journal went."""
    shutil.copytree(plain, tmp_path / "out")
    journal = journalled(study, tmp_path / "other")
    target = tmp_path / "out" / journal.relative_to(tmp_path / "other")
    shutil.copy(journal, target)
    run(study, tmp_path / "out")
    assert tables(tmp_path / "out") == tables(plain)


def test_a_damaged_journal_is_named(study, tmp_path):
    journal = journalled(study, tmp_path)
    journal.write_bytes(b"\0\0\0\n" + journal.read_bytes())
    with pytest.raises(MonteCarloError, match=r"The journal .*jsonl is damaged; delete it"):
        run(study, tmp_path)


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
    run(killing, tmp_path, cases.deadly_on_cluster(tmp_path / "mark"), workers=None, scheduler=cluster)
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


# the grid


def test_the_shipped_grid_is_five_levels_four_methods_and_a_hundred_seeds():
    grid = read_grid(ROOT / "studies" / "container.toml")
    assert (len(grid.noise["white"]), len(grid.methods), grid.seeds, grid.n_tasks) == (5, 4, 100, 2000)


@pytest.mark.parametrize(
    ("old", "new", "sentence"),
    [
        ("seeds = 4", "sedes = 4", "unknown key sedes; known are title, ships"),
        ("seeds = 4", "", "seeds is missing; add it."),
        ("seeds = 4", "seeds = 0", "seeds must be a whole number from 1 up, found 0; correct it."),
        ("seeds = 4", "seeds = true", "seeds must be a whole number from 1 up, found True; correct it."),
        ("root_seed = 7", "root_seed = 1.5", "root_seed must be a whole number from 0 up, found 1.5; correct it."),
        ("duration = 60.0", "duration = 0", "duration must be a number from 0.02 up, found 0; correct it."),
        ("duration = 60.0", "duration = inf", "duration must be a number from 0.02 up, found inf; correct it."),
        ('title = "small"', "title = 3", "title must be a text, found 3; put it in quotes."),
        ('["small.toml"]', "[]", "ships must be a list of at least one text, found []; correct it."),
        (
            '["small.toml"]',
            '"small.toml"',
            "ships must be a list of at least one text, found 'small.toml'; correct it.",
        ),
        ('["small.toml"]', '["small"]', "ships cannot have 'small': A vessel is one of container"),
        ('["small.toml"]', '["none.toml"]', "ships cannot have 'none.toml': The vessel file"),
        ('["small.toml"]', '["small.toml", "./small.toml"]', "different names, found 'small' twice; rename one."),
        ('"weak form"', '"weak"', "methods must be of paper's pipeline, central difference at 1 s"),
        ('"weak form"', '"paper\'s pipeline"', 'methods must name everything once, found "paper\'s pipeline" twice'),
        ('"zigzag 20/20"', '"zigzag 20"', "a manoeuvre is 'zigzag 20/20', 'turning circle 35' or one of them with"),
        ('"zigzag 20/20"', '"zig 20/20"', "found 'zig 20/20'; write it so."),
        ('"zigzag 20/20"', '""', "found ''; write it so."),
        ('"zigzag 20/20"', '"zigzag 20/-20"', "manoeuvres cannot have 'zigzag 20/-20': heading_deg is a magnitude"),
        ('"zigzag 20/20"', '"zigzag 20/20", "zigzag 20/20 port"', "manoeuvres must name everything once"),
        ("[noise]", "[[noise]]", "noise must be a table such as white = [0.01]"),
        ("white = [0.01, 0.05]", "", "noise must be a table such as white = [0.01], found {}; correct it."),
        ("white =", "pink =", "the kinds of noise must be of white, correlated 0.2 s"),
        ("[0.01, 0.05]", "0.01", "noise.white must be a list of levels, found 0.01; write [0.01]."),
        ("[0.01, 0.05]", "[-0.01]", "noise.white must be a number from 0 up, found -0.01; correct it."),
        ("[0.01, 0.05]", '["0.01"]', "noise.white must be a number from 0 up, found '0.01'; correct it."),
        ("[0.01, 0.05]", "[0.01, 0.01]", "noise.white must name everything once, found 0.01 twice; leave one out."),
        ("[0.01, 0.05]", "[0.01", "is not valid TOML"),
    ],
)
def test_a_study_that_cannot_be_read_is_one_sentence(study, tmp_path, capsys, old, new, sentence):
    assert main(["montecarlo", str(changed(study, (old, new))), "--out", str(tmp_path / "out")]) == 2
    printed = capsys.readouterr()
    assert printed.out == ""
    assert printed.err.count("\n") == 1
    assert sentence in printed.err
    assert not (tmp_path / "out").exists()


def test_a_study_that_is_not_there_is_named(tmp_path):
    with pytest.raises(MonteCarloError, match=r"none\.toml cannot be read: No such file or directory; check the path"):
        read_grid(tmp_path / "none.toml")


def test_a_study_may_be_a_table(study, plain, tmp_path):
    table = {"ships": [str(study.with_name("small.toml"))], "manoeuvres": ["zigzag 20/20 port"], "seeds": 4}
    table |= {"methods": ["weak form", "paper's pipeline"], "root_seed": 7, "noise": {"white": [0.01, 0.05]}}
    run(table | {"duration": 60}, tmp_path)
    assert tables(tmp_path) == tables(plain)


# seeds


def test_methods_have_the_same_noise_and_everything_else_its_own(small):
    def first(manoeuvre="zigzag", noise="white", level=0.01, method="weak form", seed=0, root=7):
        runs = {"zigzag": ps.zigzag(20, 20), "turn": ps.turning_circle(35)}
        return Task(small, runs[manoeuvre], noise, level, method, seed, root, 60.0).rng().random()

    assert len({first(method=method) for method in METHODS}) == 1
    others = [first(seed=1), first(level=0.02), first(noise="offsets"), first(manoeuvre="turn"), first(root=8)]
    assert len({first(), *others}) == 6


def test_a_grid_that_grows_keeps_its_results_and_gets_those_of_the_grown_one(study, plain, tmp_path):
    grown = changed(study, ("seeds = 4", "seeds = 6"), ("[0.01, 0.05]", "[0.001, 0.01, 0.05]"))
    run(grown, tmp_path / "whole")
    shutil.copytree(plain, tmp_path / "out")
    run(grown, tmp_path / "out", workers=2)
    assert tables(tmp_path / "out") == tables(tmp_path / "whole")
    assert timings(tmp_path / "out").groupby("session").size().tolist() == [16, 20]


@pytest.mark.parametrize(
    ("old", "new", "sentence"),
    [
        ("seeds = 4", "seeds = 3", "seeds was 4, found 3"),
        ("root_seed = 7", "root_seed = 8", "root_seed was 7, found 8"),
        ("duration = 60.0", "duration = 61", "duration was 60.0, found 61.0"),
        ("[0.01, 0.05]", "[0.01, 0.04]", "noise.white had 0.05, which is gone"),
        ("white =", "offsets =", "noise had 'white', which is gone"),
        ('"weak form", ', "", "methods had 'weak form', which is gone"),
        ('"zigzag 20/20"', '"zigzag 10/10"', "manoeuvres had 'zigzag 20/20 port', which is gone"),
        ('["small.toml"]', '["container"]', "ships had 'small', which is gone"),
    ],
)
def test_a_study_that_changes_is_refused(study, plain, tmp_path, capsys, old, new, sentence):
    shutil.copytree(plain, tmp_path / "out")
    words = ["montecarlo", str(changed(study, (old, new))), "--workers", "1", "--out", str(tmp_path / "out")]
    assert main(words) == 2
    assert capsys.readouterr().err == (
        f"pymc-ship: {tmp_path / 'out'} holds another study, which can only be extended: {sentence}; "
        "choose another folder.\n"
    )
    assert tables(tmp_path / "out") == tables(plain)


def test_a_ship_that_changes_is_seen(study, small):
    old, new = (read_grid(study).record() for _ in range(2))
    assert difference(old, new) == ""
    other = small.with_coefficients({"yaw": small.coefficients("yaw").values * 1.01})
    new["ships"]["small"] = read_grid(study).__class__("", {"small": other}, {}, {}, (), 1, 1, 1.0).record()["ships"]
    assert difference(old, new) == "'small' of ships is not what it was"


def test_two_runs_do_not_share_a_folder(study, tmp_path):
    with (
        opened(tmp_path, read_grid(study)),
        pytest.raises(MonteCarloError, match="Another run is at work in"),
        opened(tmp_path, read_grid(study)),
    ):
        pass


# what fails


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


def test_coefficients_that_are_not_finite_fail(small, monkeypatch):
    nothing = np.full(reference_coefficients(small).size, np.nan)
    monkeypatch.setitem(METHODS, "weak form", lambda *_: task_module.Estimate(nothing, nothing, nothing))
    found = measure(Task(small, ps.zigzag(20, 20), "white", 0.01, "weak form", 0, 1, 30.0))
    assert (found["status"], np.isnan(found["median_error"])) == ("failed", True)


def test_a_record_that_diverges_fails(small):
    wild = small.with_coefficients({"surge": np.array([5.0, *small.coefficients("surge").values[1:]])})
    found = measure(Task(wild, ps.zigzag(20, 20), "white", 0.01, "weak form", 0, 1, 400.0))
    assert found["status"] == "failed"
    assert "the record diverged at t = " in found["sentence"]


def test_a_ship_that_diverges_in_the_turn_has_coefficients_and_no_diameter(container, monkeypatch):
    wild = reference_coefficients(container)
    wild[0] = 5.0
    monkeypatch.setitem(METHODS, "weak form", lambda *_: task_module.Estimate(wild, wild - 9.0, wild + 9.0))
    found = measure(Task(container, ps.zigzag(20, 20), "white", 0.01, "weak form", 0, 1, 30.0))
    assert found["status"] == "diverged"
    assert "diverged in the turning circle 35 port at t = " in found["sentence"]
    assert np.isnan(found["tactical_diameter_error"])
    assert found["median_error"] == pytest.approx(0.0, abs=1e-9)
    assert found["coverage"] == 100.0


def test_the_error_of_the_turn_is_that_of_the_tactical_diameter(container):
    truth = reference_coefficients(container)
    assert turn_error(container, truth)[0] == 0.0
    ships = np.stack([truth, 1.01 * truth])
    turned = ps.simulate(container, ps.turning_circle(35), duration=400.0, coefficients=ships, record_interval=0.5)
    true, other = ps.indices(turned)["tactical_diameter"].values
    error, diverged_at = turn_error(container, ships[1])
    assert error == pytest.approx(100.0 * abs(other - true) / true)
    assert error > 0.1
    assert np.isnan(diverged_at)


def test_a_place_that_cannot_be_written_is_one_sentence(study, tmp_path, capsys):
    (tmp_path / "file").write_text("kept")
    assert main(["montecarlo", str(study), "--workers", "1", "--out", str(tmp_path / "file" / "below")]) == 2
    assert re.fullmatch(r"pymc-ship: .*below cannot be written: .*\n", capsys.readouterr().err)
    assert (tmp_path / "file").read_text() == "kept"


def test_a_full_disk_ends_in_a_sentence_and_loses_nothing(study, plain, tmp_path):
    """Files of a child process may not grow over 1000 bytes: the third line of a journal is cut off."""
    code = "import sys, tests.experiments.cases as c\n"
    code += "from pymc_ship.experiments import run as e\n"
    code += "e.reported_montecarlo.__kwdefaults__['work'] = c.trivial\n"
    code += "e._rehearsed = lambda *_: 0.001\n"
    code += "from pymc_ship.cli.main import main; sys.exit(main(sys.argv[1:]))"
    words = ["montecarlo", str(study), "--workers", "1", "--quiet", "--out", str(tmp_path)]

    def limited():
        resource.setrlimit(resource.RLIMIT_FSIZE, (1000, 1000))

    environment = os.environ | {"PYTHONPATH": PATH, "PYTHONDONTWRITEBYTECODE": "1"}
    done = subprocess.run(
        [sys.executable, "-c", code, *words], env=environment, preexec_fn=limited, capture_output=True, text=True
    )
    assert (done.returncode, done.stdout) == (2, "")
    sentence = r"pymc-ship: .*jsonl cannot be written: .*; what was measured is kept: make room and run again\.\n"
    assert re.fullmatch(sentence, done.stderr)
    before = kept(tmp_path)
    assert 1 <= len(before) < 4
    run(study, tmp_path)
    assert tables(tmp_path) == tables(plain)
    assert timings(tmp_path).groupby("session").size().tolist() == [len(before), 16 - len(before)]


def full(*args, **settings):
    raise OSError(28, "No space left on device")


def test_a_disk_that_is_full_when_a_part_is_written_keeps_its_journal(study, plain, tmp_path, monkeypatch):
    monkeypatch.setattr(engine, "_rehearsed", lambda *_: 0.001)
    with monkeypatch.context() as patch:
        patch.setattr(pq.ParquetWriter, "write_table", full)
        with pytest.raises(ps.OutputError, match="No space left on device"):
            run(study, tmp_path)
    assert len(kept(tmp_path)) == 4
    run(study, tmp_path)
    assert tables(tmp_path) == tables(plain)


def test_a_disk_that_is_full_when_the_tables_are_written_keeps_the_results(study, plain, tmp_path, monkeypatch):
    shutil.copytree(plain, tmp_path / "out")
    before = tables(tmp_path / "out")
    with monkeypatch.context() as patch:
        patch.setattr(pq.ParquetWriter, "write_table", full)
        with pytest.raises(ps.OutputError, match="No space left on device"):
            run(study, tmp_path / "out")
    assert tables(tmp_path / "out") == before
    assert len(kept(tmp_path / "out")) == 16


# threads, imports, the command


def test_a_task_keeps_to_one_thread(small, monkeypatch):
    monkeypatch.setattr("os.cpu_count", lambda: 2)
    noisy = ps.pollute(ps.simulate(small, ps.zigzag(20, 20), duration=30.0), level=0.01, rng=np.random.default_rng(1))
    with one_thread():
        assert thread_pool(2)._max_workers == 1
        assert {pool["num_threads"] for pool in threadpool_info()} == {1}
        alone = ps.denoise(noisy)
    assert thread_pool(2)._max_workers == 2
    assert ps.denoise(noisy).identical(alone)


def test_nothing_of_a_study_is_loaded_before_it_is_run():
    code = "import sys, pymc_ship\nfrom pymc_ship.cli import main\ntry:\n    main(['montecarlo', '--help'])\n"
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


# the page


def test_the_page_has_scores_costs_and_the_step_beyond(measured):
    text = (measured / "index.html").read_text(encoding="utf-8")
    assert "<svg" in text
    assert "weak form" in text
    assert "The step beyond: 1e6 tasks" in text
    assert "processor time of" not in text
    assert all(name in text for name in ("overhead %", "parent ms/task", "time on 64 cores", "storage"))


def test_a_large_page_says_what_it_leaves_out(study, plain, tmp_path, monkeypatch):
    monkeypatch.setattr(report, "MOST_ROWS", 3)
    monkeypatch.setattr(report, "MOST_FIGURES", 0)
    shutil.copytree(plain, tmp_path / "out")
    run(study, tmp_path / "out")
    text = (tmp_path / "out" / "index.html").read_text(encoding="utf-8")
    assert "1 more cells are in" in text
    assert "1 more combinations of ship, manoeuvre and noise are in" in text


def test_what_could_not_be_computed_counts_as_wrong():
    cell, nan = Cell("s", "m", "white", 0.01, "x"), float("nan")
    scores = {
        "median_error": [1.0, 2.0, nan],
        "coverage": [90.0, 90.0, nan],
        "tactical_diameter_error": [1.0, nan, nan],
    }
    rows = {name: np.array(values) for name, values in scores.items()}
    row = cell_row(cell, rows | {"status": np.array(["ok", "diverged", "failed"])})
    assert (row["median_error"], row["coverage"], row["tactical_diameter_error"]) == (2.0, 60.0, np.inf)
    assert (row["ok"], row["diverged"], row["failed"]) == (1, 1, 1)
    assert np.isnan(row["tactical_diameter_error_se"])
    assert row["coverage_se"] == pytest.approx(np.std([90.0, 90.0, 0.0]) / np.sqrt(3), rel=0.15)


def made_up(n, workers=2, seconds=1.0, parent=0.002, wall=None):
    """Costs of n tasks of so many seconds each."""
    parts = dict.fromkeys(PARTS, seconds / len(PARTS)) | {"cpu": 0.9 * seconds}
    clock = {"session": 1, "executor": "dask", "workers": workers}
    step = seconds / workers / 0.8 if wall is None else wall
    rows = [parts | clock | {"wall": (k + 1) * step, "parent": parent} for k in range(n)]
    costs = Costs()
    costs.add(Cell("s", "m", "white", 0.01, "x"), pa.Table.from_pylist(rows))
    return costs


def test_the_plan_is_computed_from_the_costs():
    costs = made_up(50)
    (session,) = costs.sessions.values()
    assert session.overhead == pytest.approx(20.0)
    rows = {row["quantity"]: row["value"] for row in plan_rows(costs, Sizes(1, 5000, 20_000, 3 * 10**8, 0.5))}
    assert rows["processor time"] == pytest.approx(0.9e6 / 3600)
    assert rows["time on 64 cores"] == pytest.approx(1e6 / 0.8 / 64 / 3600)
    assert rows["time on 1024 cores"] == pytest.approx(1e6 * 0.002 / 3600)
    assert rows["workers that one parent can feed"] == pytest.approx(500.0)
    assert rows["storage"] == pytest.approx(100.0)
    assert rows["files"] == pytest.approx(20_000)
    assert rows["tables from the parts"] == pytest.approx(10_000.0)
    assert "Up to about 5e+02 workers the cores are the bottleneck" in bottleneck(costs)
    assert method_rows(costs)[0]["sum"] == pytest.approx(1.0)
