"""What a Monte-Carlo study costs beside its tasks: ``python -m tests.experiments.scale memory``, or one of the others.

``memory [--scheduler ADDRESS]``: 100, 1000 and 10000 tasks that do nothing, each in a process of its own on 2 workers:
resident memory of the parent, tasks per second, processor time of the parent (tables and page included).
``scaling [SEEDS]``: the container grid of so many seeds (1) by 1 worker, then by 2: wall time until the last result,
sum of the parts of the tasks, overhead and the ratio of the wall times, and whether the tables are the same bytes.
``sleep [SEEDS]``: the same with tasks that sleep for 50 ms, for a machine that others are using.
"""

from __future__ import annotations

import json
import resource
import subprocess
import sys
import tempfile
import time
import tomllib
from pathlib import Path

import pyarrow.parquet as pq

from pymc_ship.experiments.run import reported_montecarlo
from pymc_ship.experiments.task import STAGES, measure_task
from tests.experiments.cases import slow, trivial

STUDY = Path(__file__).parents[2] / "studies" / "container.toml"


def memory(tasks, scheduler=None):
    """One study of so many trivial tasks, 100 a cell."""
    levels = [0.001 * (k + 1) for k in range(tasks // 100)]
    grid = {"ships": ["container"], "manoeuvres": ["zigzag 20/20"], "methods": ["weak form"], "seeds": 100}
    grid |= {"root_seed": 1, "noise": {"white": levels}}
    with tempfile.TemporaryDirectory() as folder:
        start, cpu = time.perf_counter(), time.process_time()
        workers = None if scheduler else 2
        reported_montecarlo(grid, folder, workers=workers, scheduler=scheduler, work=trivial)
        whole, cpu = time.perf_counter() - start, time.process_time() - cpu
        disk = sum(path.stat().st_size for path in Path(folder).rglob("*.parquet"))
        timings = pq.read_table(Path(folder, "timings.parquet"), columns=["wall", "parent"]).to_pydict()
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
    wall = max(timings["wall"]) - min(timings["wall"])
    return {
        "tasks": tasks,
        "peak_memory_MiB": round(peak, 1),
        "tasks_per_second": round(tasks / wall, 1),
        "parent_ms_per_task": round(1e3 * timings["parent"][0], 3),
        "parent_processor_s": round(cpu, 2),
        "whole_run_s": round(whole, 1),
        "bytes_per_task": round(disk / tasks),
    }


def scaling(seeds, work):
    """The container grid by 1 worker and by 2."""
    with STUDY.open("rb") as file:
        grid = tomllib.load(file) | {"seeds": seeds}
    walls, tables = [], []
    for workers in (1, 2):
        with tempfile.TemporaryDirectory() as folder:
            reported_montecarlo(grid, folder, workers=workers, work=work)
            timings = pq.read_table(Path(folder, "timings.parquet")).to_pydict()
            tables.append(Path(folder, "results.parquet").read_bytes())
        parts, wall = sum(sum(timings[name]) for name in STAGES), max(timings["wall"])
        walls.append(wall)
        row = {"workers": workers, "tasks": len(timings["wall"]), "wall_s": wall, "parts_s": parts}
        row |= {"cpu_s": sum(timings["cpu"]), "overhead_percent": 100.0 * (1.0 - parts / (workers * wall))}
        print(json.dumps({key: round(value, 3) for key, value in row.items()}), flush=True)
    print(json.dumps({"speedup_1_to_2": round(walls[0] / walls[1], 3), "same_bytes": tables[0] == tables[1]}))


def main(words):
    """Run what the words ask for."""
    if words[:1] in (["scaling"], ["sleep"]):
        scaling(int(words[1]) if words[1:] else 1, measure_task if words[0] == "scaling" else slow)
    elif words[:1] == ["one"]:
        print(json.dumps(memory(int(words[1]), *words[2:])))
    elif words[:1] == ["memory"]:
        scheduler = words[2:] if words[1:2] == ["--scheduler"] else []
        for tasks in (100, 1000, 10_000):
            subprocess.run([sys.executable, "-m", "tests.experiments.scale", "one", str(tasks), *scheduler], check=True)
    else:
        sys.exit(__doc__)


if __name__ == "__main__":
    main(sys.argv[1:])
