"""Small Monte-Carlo studies, and work that is no work, for tests and measurements in processes of their own."""

from __future__ import annotations

import math
import os
import signal
import time
from functools import partial
from pathlib import Path

from pymc_ship.experiments.task import SCORES, STAGES

TOML = """
title = "small"
ships = ["small.toml"]
manoeuvres = ["zigzag 20/20"]
methods = ["weak form", "paper's pipeline"]
seeds = 4
root_seed = 7
duration = 60.0
[noise]
white = [0.01, 0.05]
"""


def trivial(task):
    """Result that depends on the task alone and takes no time."""
    scores = {name: math.fmod(100.0 * task.rng().random() + k, 100.0) for k, name in enumerate(SCORES)}
    ended = {"block": task.block, "seed": task.seed, "status": "ok", "sentence": ""}
    return ended | scores | dict.fromkeys(STAGES, 1e-6) | {"cpu": 1e-6}


def failing(task):
    """Result of a method that fails."""
    ended = {"block": task.block, "seed": task.seed, "status": "failed", "sentence": "ValueError: no use"}
    return ended | dict.fromkeys(SCORES, math.nan) | dict.fromkeys(STAGES, 1e-6) | {"cpu": 1e-6}


def slow(task):
    """The same after 50 ms of sleep, which count as its fit."""
    start = time.perf_counter()
    time.sleep(0.05)
    return trivial(task) | {"fit": time.perf_counter() - start}


def deadly(task):
    """The same, but the process that first meets seed 2 is killed; MC_MARK names the file that remembers it."""
    mark = Path(os.environ["MC_MARK"])
    if task.seed == 2 and not mark.exists():
        mark.touch()
        os.kill(os.getpid(), signal.SIGKILL)
    return trivial(task)


def out_of_memory_once(task):
    """The same, but the process that first meets seed 2 has no memory for it."""
    mark = Path(os.environ["MC_MARK"])
    if task.seed == 2 and not mark.exists():
        mark.touch()
        raise MemoryError("much")
    return trivial(task)


def always_full(task):
    """Work for which there is no room."""
    raise OSError(28, "No space left on device")


def always_deadly(task):
    """Kills its process."""
    os.kill(os.getpid(), signal.SIGKILL)


def deadly_on_cluster(mark):
    """:func:`deadly` with the name of the file that remembers, for processes that are there already."""
    return partial(_deadly_once, mark=str(mark))


def _deadly_once(task, mark):
    os.environ["MC_MARK"] = mark
    return deadly(task)
