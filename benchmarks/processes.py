"""What a user waits for: the first run of a fresh installation, the pages of a report, the whole study."""

from __future__ import annotations

import json
import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path

import numpy as np

import pymc_ship as ps
from benchmarks.table import Row, median_seconds

_COMMANDS = {
    "simulate": "simulate container --zigzag 20/20 --duration 100 --noise 0.01 --seed 1 --quiet --out trial.csv",
    "fit": "fit trial.csv --vessel container --quiet --out fitted",
}
_RESULT = {"simulate": "trial.csv", "fit": "fitted/coefficients.csv"}

_STUDY = """
import json, resource, sys, time
from pathlib import Path
import pymc_ship as ps
from pymc_ship.replication.page import write_study
from pymc_ship.replication.study import run_study
begin = time.perf_counter()
result = run_study(ps.load_vessel("container"), level=0.01, seed=2020)
middle = time.perf_counter()
page = write_study(result, Path(sys.argv[1]))
peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024**2
print(json.dumps({"inference": middle - begin, "pages": time.perf_counter() - middle, "peak": peak}))
"""


def first_run() -> Iterator[Row]:
    """Commands of the first process of a fresh installation, which compiles, and of the second, from its cache.

    The limit of the check is zero: not one kernel may be compiled again, and the results are the same bytes.
    """
    with tempfile.TemporaryDirectory() as folder:
        place = Path(folder)
        cache = place / "cache"
        environment = os.environ | {"NUMBA_CACHE_DIR": str(cache)}
        runs = [_commands(place, environment, cache) for _ in range(2)]
    for name in _COMMANDS:
        (first, compiled, text), (second, again, same) = (run[name] for run in runs)
        note = f"{compiled} kernels compiled by the first process"
        peer, check = "the first run ever, which compiles", "kernels compiled again + other bytes"
        yield Row(
            f"pymc-ship {name}, kernels from the cache",
            second,
            peer,
            first,
            check,
            again + (text != same),
            0,
            note=note,
        )


def _commands(place: Path, environment: dict, cache: Path) -> dict[str, tuple[float, int, bytes]]:
    """Seconds, kernels added to the cache and result of each command."""
    found = {}
    program = Path(sys.executable).with_name("pymc-ship")
    for name, words in _COMMANDS.items():
        before = _kernels(cache)
        start = time.perf_counter()
        subprocess.run([program, *words.split()], cwd=place, env=environment, check=True, stdout=subprocess.DEVNULL)
        seconds = time.perf_counter() - start
        found[name] = seconds, len(_kernels(cache) - before), (place / _RESULT[name]).read_bytes()
    return found


def _kernels(cache: Path) -> set[tuple[str, int]]:
    """Compiled kernels of a cache with the time they were written."""
    return {(str(path), path.stat().st_mtime_ns) for path in cache.rglob("*.nbc")}


def trajectory_report(vessel, noisy) -> Iterator[Row]:
    """Diagnostic pages of a trajectory posterior beside the fit that drew it."""
    theirs, tree = median_seconds(lambda: ps.trajectory_posterior(noisy, vessel, rng=np.random.default_rng(3)), 3)
    with tempfile.TemporaryDirectory() as folder:
        ours, page = median_seconds(lambda: ps.diagnostic_report({"trajectory": tree}, folder, vessel), 3)
        missing = float(not page.is_file())
    yield Row("diagnostic page of a trajectory fit", ours, "the fit itself", theirs, "pages missing", missing, 0)


def whole_study() -> Iterator[Row]:
    """The whole study in a process of its own: pages beside inference, wall time and peak memory."""
    with tempfile.TemporaryDirectory() as folder:
        ran = subprocess.run([sys.executable, "-c", _STUDY, folder], check=True, stdout=subprocess.PIPE, text=True)
        missing = sum(not Path(folder, name).is_file() for name in ("index.html", "diagnostics.html"))
    found = json.loads(ran.stdout.splitlines()[-1])
    total = found["inference"] + found["pages"]
    note = f"{total:.0f} s in all, peak memory {found['peak']:.2f} GiB"
    row = ("the study's inference", found["inference"], "pages missing", missing, 0)
    yield Row("whole study: diagnostics, figures and pages", found["pages"], *row, note=note)
