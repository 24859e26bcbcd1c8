"""Runs that are killed without a word at any time: what they wrote before stands, and the next run gives the same."""

from __future__ import annotations

import hashlib
import signal
import subprocess
import time

import numpy as np
import pytest

from pymc_ship.machine.files import finish_killed_runs
from tests.journeys.cases import program

NAMED = ("*.nc", "*.csv", "*.html", "*.png")


def marks(out):
    """Digest of each file of a result, whatever is partial left out."""
    paths = [path for pattern in NAMED for path in out.rglob(pattern) if ".partial" not in str(path)]
    return {str(path.relative_to(out)): hashlib.sha256(path.read_bytes()).hexdigest() for path in paths}


def killed(words, after):
    """Run a command line and kill it after a time [s]; whether it was alive then."""
    with subprocess.Popen(words, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL) as process:
        try:
            process.wait(after)
        except subprocess.TimeoutExpired:
            process.send_signal(signal.SIGKILL)
    return process.returncode == -signal.SIGKILL


def kill_at_random(commands, out, kills, seed):
    """Kill two command lines in turn that write to one folder, at random times of a run.

    Returns the number of kills that met a live run, and of those after which the folder held neither the one result nor
    the other.
    """
    rng, results, lasts = np.random.default_rng(seed), [], 0.0
    for words in commands:
        start = time.monotonic()
        subprocess.run(words, check=False, capture_output=True)
        lasts, results = time.monotonic() - start, [*results, marks(out)]
    assert all(results)
    met = mixed = 0
    for k in range(5 * kills):  # a machine with other work may end a run before its kill: more are tried then
        if k >= kills and met > 1:
            break
        # half of the kills at the end, when files are written
        after = lasts * (rng.uniform(0.0, 1.0) if k % 2 else rng.uniform(0.8, 1.05))
        met += killed(commands[k % 2], after)
        finish_killed_runs(out)  # as every reader of the package does first
        mixed += marks(out) not in results
    subprocess.run(commands[0], check=False, capture_output=True)
    assert marks(out) == results[0]
    assert not list(out.rglob(".partial*"))
    return met, mixed


@pytest.mark.slow
def test_killed_runs_leave_one_result_or_the_other(made, tmp_path):
    common = ("regress", made / "trial.csv", "--vessel", made / "small.toml", "--family", "conjugate", "--quiet")
    commands = [program(*common, "--draws", n, "--out", tmp_path / "out") for n in (40, 80)]
    met, mixed = kill_at_random(commands, tmp_path / "out", 4, 1)
    assert met > 1
    assert mixed == 0
