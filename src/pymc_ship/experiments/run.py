"""Monte-Carlo studies: many tasks by many workers, which can be stopped and continued."""

import shutil
import time
from collections.abc import Callable, Iterator, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

from pymc_ship.experiments.grid import grid_of
from pymc_ship.experiments.methods import import_function, import_path
from pymc_ship.experiments.store import Store, locked_store
from pymc_ship.experiments.study import Study, StudyKind
from pymc_ship.experiments.task import Method
from pymc_ship.machine.arguments import as_path, check_callables, check_kind, short_repr
from pymc_ship.machine.errors import StudyError
from pymc_ship.machine.toml import Entry, toml_file
from pymc_ship.machine.workers import Cluster, LocalCores, WorkersLostError, progress_bar, run_tasks

EMPTY_TASKS = 200  # number of empty tasks with which a run begins, to measure what the keeping of a result costs

_SHOWN_EVERY = 1.0


def montecarlo(
    study: str | Path | Mapping,
    out: str | Path,
    *,
    workers: int | None = None,
    scheduler: str | None = None,
    methods: Mapping[str, Method] | None = None,
    progress: Callable[[str], None] = lambda _: None,
) -> Path:
    """Run or continue a Monte-Carlo study.

    Every result is saved at once and not computed again. Seeds, levels, methods, manoeuvres and ships may be added. The
    tables of results do not depend on workers and interruptions.

    Parameters
    ----------
    study : str, Path or mapping
        TOML file, or a table of the same form: a grid of experiments, see ``studies/container.toml``, or a kind that
        the key ``study`` names by its import path, see ``studies/ships.toml``; in a table, or the class itself.
    out : str or Path
        Folder of the study; created where it is missing.
    workers : int, optional
        Processes on this machine, one for each core by default; 1 works in this process.
    scheduler : str, optional
        Address of a Dask scheduler, whose workers do the tasks instead.
    methods : mapping of str to callable, optional
        Your own methods by name. Each is called with a noisy record, a Dataset with dims (time,), and the vessel, and
        returns a :class:`pymc_ship.Estimate`. A study can also name one by its import path, ``module:function``.
    progress : callable, optional
        Called now and then with a short text.

    Returns
    -------
    Path
        The page, ``out/index.html``, in one folder with ``results.parquet``, ``timings.parquet`` and, for a grid,
        ``cells.csv``.

    Raises
    ------
    StudyError
        For a study that cannot be read or does not extend the one in the folder, a method that cannot be called or
        returns no Estimate, a scheduler that does not answer, and workers that die repeatedly.
    OutputError
        For a folder that cannot be written; earlier results stay.
    """
    _, page = reported_montecarlo(study, out, workers=workers, scheduler=scheduler, methods=methods, progress=progress)
    return page


def reported_montecarlo(
    study: str | Path | Mapping,
    out: str | Path,
    *,
    workers: int | None = None,
    scheduler: str | None = None,
    methods: Mapping[str, Method] | None = None,
    progress: Callable[[str], None] = lambda _: None,
    work: Callable[[Any], dict] | None = None,
) -> tuple[list[dict], Path]:
    """Main table and page of :func:`montecarlo`; ``work`` replaces the study's own work on a task."""
    check_callables(progress=progress)
    if scheduler is not None and workers is not None:
        raise StudyError("The workers of a cluster are started beside its scheduler, found --workers; leave it out.")
    if methods is not None:
        check_kind("methods", methods, Mapping, "give a dict of functions by name", StudyError)
    settings = read_study(study, methods)
    error = StudyError
    executor = Cluster(scheduler, error=error) if scheduler is not None else LocalCores(workers, error=error)
    with locked_store(out, settings) as store:
        if store.missing():
            with executor:
                _complete_tasks(store, executor, work or settings.work, progress)
        progress("tables and page")
        return settings.report(store)


def read_study(study: str | Path | Mapping, methods: Mapping[str, Method] | None = None) -> Study:
    """Study of the kind that its table names, by default a grid; parameters and errors as :func:`montecarlo`."""
    folder = Path()
    if isinstance(study, Mapping):
        file = Entry(study, "The study", StudyError)
    else:
        study = as_path("study", study, StudyError)
        file, folder = toml_file(study, "The study", StudyError), study.parent
    file.check_table()
    if "study" not in file:
        return grid_of(file, folder, methods or {})
    if methods:
        file.fail("is no grid, and takes no methods; leave them out.")
    return _kind(file.at("study")).read(file, folder)


def _kind(entry: Entry) -> type[StudyKind]:
    kind = entry.value
    if isinstance(kind, str) and import_path(kind):
        kind = import_function(kind, f"{entry.file}: {entry.key}")
    if not isinstance(kind, type) or not hasattr(kind, "read"):
        entry.fail(f"must be the import path module:class of a kind of study, found {short_repr(kind)}; correct it.")
    return kind


def _complete_tasks(
    store: Store, executor: LocalCores | Cluster, work: Callable[[Any], dict], progress: Callable[[str], None]
) -> None:
    session, start = {"session": time.time_ns(), "executor": executor.label}, time.perf_counter()
    bar = _Progress(store.study.n_tasks, progress)

    def remaining() -> Iterator | None:
        missing = store.missing()
        bar.begin(store.study.n_tasks - sum(len(seeds) for *_, seeds in missing))
        return _tasks(store, missing) if missing else None

    try:
        session["parent"] = _parent_seconds(store, executor)
        for result in run_tasks(executor, work, remaining):
            clock = {"wall": time.perf_counter() - start, "workers": executor.workers}
            store.add(result | session | clock)
            bar.one_more()
    except WorkersLostError as error:
        raise StudyError(
            f"Workers died {error.times} times without a result in between, of {error.reason}; what was measured so "
            "far is kept: run again with fewer workers."
        ) from None


def _parent_seconds(store: Store, executor: LocalCores | Cluster) -> float:
    """Seconds in which the parent sends a task and saves its result, measured with empty tasks."""
    none = {"session": 0, "executor": "", "workers": 0, "wall": 0.0, "parent": 0.0}
    folder, arrivals = store.out / ".rehearsal", []
    shutil.rmtree(folder, ignore_errors=True)  # of a run that was killed
    empty_store = Store(folder, replace(store.study, seeds=EMPTY_TASKS))
    first = empty_store.missing()[0]

    def remaining() -> Iterator | None:
        missing = [one for one in empty_store.missing() if one[:2] == first[:2]]
        return _tasks(empty_store, missing) if missing else None

    try:
        for result in run_tasks(executor, store.study.empty, remaining):
            empty_store.add(result | none)
            arrivals.append(time.perf_counter())
    finally:
        shutil.rmtree(folder, ignore_errors=True)
    late = arrivals[len(arrivals) // 2 :]  # all workers are there
    return (late[-1] - late[0]) / (len(late) - 1)


def _tasks(store: Store, missing: list) -> Iterator:
    for cell, part, seeds in missing:
        for seed in seeds:
            yield store.study.task(cell, seed, part)


class _Progress:
    """Progress bar with number of tasks, rate and time left, at most once a second."""

    def __init__(self, total: int, show: Callable[[str], None]):
        self.total, self.show = total, show
        self.done = self.fresh = 0
        self.start = self.last_shown = time.perf_counter()

    def begin(self, done: int) -> None:
        """Print how many tasks are done already."""
        self.done = done
        self.show(f"{progress_bar(done, self.total)} {done} of {self.total} tasks")

    def one_more(self) -> None:
        """Count a task."""
        self.done, self.fresh, now = self.done + 1, self.fresh + 1, time.perf_counter()
        if now - self.last_shown < _SHOWN_EVERY and self.done < self.total:
            return
        self.last_shown, rate = now, self.fresh / (now - self.start)
        left = _duration((self.total - self.done) / rate)
        self.show(
            f"{progress_bar(self.done, self.total)} {self.done} of {self.total} tasks, {rate:.3g} a second, {left} left"
        )


def _duration(seconds: float) -> str:
    if seconds < 120.0:
        return f"{seconds:.0f} s"
    return f"{seconds / 60.0:.0f} min" if seconds < 7200.0 else f"{seconds / 3600.0:.1f} h"
