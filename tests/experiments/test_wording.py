"""Sentences of the errors of this district, each checked once."""

from __future__ import annotations

import shutil
import threading

import numpy as np

import pymc_ship as ps
from pymc_ship.experiments.run import read_study
from pymc_ship.experiments.store import locked_store
from pymc_ship.machine import workers
from tests.experiments.cases import always_full
from tests.experiments.folders import run
from tests.experiments.test_methods import only, shifted
from tests.experiments.test_store import journalled
from tests.sentences import wording


def after_a_line(line, study, out):
    journal = journalled(study, out)
    journal.write_bytes(line + journal.read_bytes())
    run(study, out)


def with_a_damaged_part(plain, study, tmp_path):
    out = shutil.copytree(plain, tmp_path / "out")
    next((out / "parts").rglob("*.parquet")).write_bytes(b"no table")
    run(study, out)


def while_another_is_at_work(study, tmp_path):
    with locked_store(tmp_path, read_study(study)), locked_store(tmp_path, read_study(study)):
        pass


def with_another_method(study, tmp_path):
    for method in (shifted(0.1), lambda *_: None):
        with locked_store(tmp_path, read_study(only(study), {"mine": method})):
            pass


def without_a_scheduler(study, tmp_path, monkeypatch):
    monkeypatch.setattr(workers, "_CONNECT", 0.3)
    ps.montecarlo(study, tmp_path, scheduler="nonsense://x")


test_study_errors = wording(
    ps.StudyError,
    (
        r"none\.toml cannot be read: No such file or directory; check the path",
        lambda tmp_path: read_study(tmp_path / "none.toml"),
    ),
    *(
        (
            r"The journal .*jsonl is damaged; delete it",
            lambda study, tmp_path, line=line: after_a_line(line, study, tmp_path),
        )
        for line in [b"\0\0\0\n", b'{"seed": 0}\n']
    ),
    (r"The results .*\.parquet are damaged: .*; delete the file", with_a_damaged_part),
    ("Another run is at work in", while_another_is_at_work),
    (r"methods had 'mine \(own, [0-9a-f]{12}\)', which is gone", with_another_method),
    *(
        (
            "^The method 'mine' must return an Estimate whose coefficients, lower and upper have shape .10,. for "
            rf"'small', {found}; correct it\.$",
            lambda study, tmp_path, returned=returned: ps.montecarlo(
                only(study), tmp_path, methods={"mine": lambda *_: returned}, workers=1
            ),
        )
        for returned, found in [
            (None, "found a NoneType"),
            (np.zeros(10), "found a ndarray"),
            (ps.Estimate(np.zeros(10), np.zeros(10), np.zeros(3)), r"found shapes \(10,\), \(10,\), \(3,\)"),
            (ps.Estimate(np.zeros(9), np.zeros(9), np.zeros(9)), r"found shapes \(9,\), \(9,\), \(9,\)"),
        ]
    ),
    *(
        (message, lambda study, tmp_path, methods=methods: ps.montecarlo(only(study), tmp_path, methods=methods))
        for methods, message in [
            (
                {"weak form": shifted(0.1)},
                "a name that the package does not have, found 'weak form'; rename it.",
            ),
            ({"": shifted(0.1)}, "found ''; rename it."),
            ({"mine": "shifted"}, "'mine' must be a function of a noisy record and a vessel, found 'shifted'"),
            ({"mine": threading.Lock().acquire}, "'mine' cannot be handed to the workers: TypeError: .*lock"),
        ]
    ),
    (
        r"died 6 times without a result in between, of OSError: \[Errno 28\] No space left on device; what was",
        lambda study, tmp_path: run(study, tmp_path, always_full),
    ),
    ("No Dask scheduler answers at nonsense://x", without_a_scheduler),
    (
        "found --workers; leave it out",
        lambda study, tmp_path: ps.montecarlo(study, tmp_path, workers=2, scheduler="tcp://127.0.0.1:1"),
    ),
    (
        "workers must be a whole number from 1 up, found 0",
        lambda study, tmp_path: ps.montecarlo(study, tmp_path, workers=0),
    ),
)
