"""Workers for many tasks: processes on the local cores (joblib) or on a cluster (dask.distributed).

Both take tasks from an iterator, so that memory does not grow with their number.
"""

from __future__ import annotations

import os
import signal
import threading
import time
import warnings
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import CancelledError
from concurrent.futures.process import BrokenProcessPool
from itertools import islice, takewhile

from pymc_ship.machine.arguments import check_counts

AHEAD = 4  # tasks queued for each worker
RESTARTS = 5  # largest number of losses of workers without a result in between
MACHINE = (MemoryError, OSError)  # errors of the machine, after which a task is tried again
# seconds: wait for a scheduler; between two counts of its workers; between two looks at the parent process
_CONNECT, _LOOK, _WATCH = 10.0, 2.0, 0.5
_BAR = 30  # characters of a progress bar


class WorkersLostError(Exception):
    """Workers died or raised one of :data:`MACHINE`, ``times`` times without a result in between."""

    def __init__(self, reason: str = "too little memory perhaps", times: int = 1):
        super().__init__(f"workers were lost {times} times without a result in between")
        self.reason, self.times = reason, times


def run_tasks[Task, Result](
    executor: LocalCores | Cluster, work: Callable[[Task], Result], remaining: Callable[[], Iterable[Task] | None]
) -> Iterator[Result]:
    """Yield the result of every task; the tasks of lost workers are tried again.

    The executor is inside its ``with`` block; ``work`` returns the result of a task, ``remaining`` the tasks without a
    result, None if there are none. It is called again after a loss of workers: the caller stores each result before it
    takes the next. WorkersLostError when workers are lost more than :data:`RESTARTS` times without a result in between.
    """
    lost = 0
    while (tasks := remaining()) is not None:
        try:
            for result in executor.map_unordered(work, tasks):
                lost = 0
                yield result
        except WorkersLostError as error:
            lost += 1
            if lost > RESTARTS:
                raise WorkersLostError(error.reason, lost) from None


class LocalCores:
    """Processes on this machine, by default one for each core; a single worker is this process itself.

    ``error`` is raised for a number of workers below one.
    """

    label = "joblib"

    def __init__(self, workers: int | None = None, *, error: type[ValueError]):
        import joblib

        if workers is not None:
            check_counts(error, workers=workers)
        self.workers = workers or joblib.cpu_count()

    def map_unordered[Task, Result](self, work: Callable[[Task], Result], tasks: Iterable[Task]) -> Iterator[Result]:
        """Yield the result of each task; after an error no further task starts.

        WorkersLostError when a process was killed or a task raised one of :data:`MACHINE`; any other error of a task is
        raised after the started tasks are complete.
        """
        import joblib

        failures: list[Exception] = []  # an error raised in a worker process may block joblib
        tasks = takewhile(lambda _: not failures, tasks)

        settings = {"return_as": "generator_unordered", "pre_dispatch": f"{AHEAD}*n_jobs", "batch_size": 1}
        settings["max_nbytes"] = None
        if self.workers > 1:
            settings |= {"backend": "loky", "initializer": _end_with_parent, "initargs": (os.getpid(),)}
        try:
            for result in joblib.Parallel(self.workers, **settings)(
                joblib.delayed(_result_or_error)(work, task) for task in tasks
            ):
                if isinstance(result, Exception):
                    failures.append(result)
                else:
                    yield result
        except BrokenProcessPool:
            raise WorkersLostError from None
        for failure in failures:
            if isinstance(failure, MACHINE):
                raise WorkersLostError(error_text(failure))
            raise failure

    def __enter__(self) -> LocalCores:
        self._warnings = warnings.catch_warnings()
        self._warnings.__enter__()
        # joblib renews a worker that has grown; no task is lost
        warnings.filterwarnings("ignore", "A worker stopped while some jobs", UserWarning)
        return self

    def __exit__(self, *error: object) -> None:
        self._warnings.__exit__(None, None, None)
        if self.workers > 1:
            from joblib.externals.loky import get_reusable_executor

            get_reusable_executor().shutdown(wait=True, kill_workers=True)


def _result_or_error[Task, Result](work: Callable[[Task], Result], task: Task) -> Result | Exception:
    try:
        return work(task)
    except Exception as error:  # the parent raises it
        return error


def _end_with_parent(parent: int) -> None:
    """Ignore interrupts, which the parent handles, and end after the parent (not on Windows, which hides its end)."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    threading.Thread(target=_watch_parent, args=(parent,), daemon=True).start()


def _watch_parent(parent: int) -> None:
    while os.getppid() == parent:
        time.sleep(_WATCH)
    os._exit(1)


class Cluster:
    """Workers of a Dask scheduler; ``workers`` is the number of their threads at the last count.

    ``error`` is raised if dask.distributed is missing, no scheduler answers or the workers cannot run a task.
    """

    label = "dask"

    def __init__(self, address: str, *, error: type[ValueError]):
        try:
            import distributed  # noqa: F401
        except ImportError:
            raise error(
                "Tasks on a cluster need dask.distributed, which is not installed; install pymc-ship[cluster]."
            ) from None
        self.address, self.error, self.workers = address, error, 0

    def __enter__(self) -> Cluster:
        from distributed import Client

        try:
            self._client = Client(self.address, timeout=_CONNECT, set_as_default=False)
        except (OSError, ValueError) as error:
            raise self.error(
                f"No Dask scheduler answers at {self.address}: {' '.join(str(error).split())}; start one, see README."
            ) from None
        return self

    def __exit__(self, *error: object) -> None:
        self._client.close()

    def map_unordered[Task, Result](self, work: Callable[[Task], Result], tasks: Iterable[Task]) -> Iterator[Result]:
        """Yield the result of each task; :data:`AHEAD` tasks for each worker are queued at the scheduler.

        WorkersLostError when workers or queued tasks were lost or a task raised one of :data:`MACHINE`.
        """
        from distributed import KilledWorker, as_completed

        tasks, client = iter(tasks), self._client
        running, n_running, counted_at = as_completed(loop=client.loop), 0, float("-inf")
        while True:
            if time.monotonic() - counted_at > _LOOK:
                self.workers, counted_at = max(1, sum(client.nthreads().values())), time.monotonic()
            for task in islice(tasks, max(0, AHEAD * self.workers - n_running)):
                running.add(client.submit(work, task, pure=False))
                n_running += 1
            if not n_running:
                return
            future = next(running)
            n_running -= 1
            try:
                result = future.result()
            except (KilledWorker, CancelledError):
                raise WorkersLostError from None
            except MACHINE as error:
                raise WorkersLostError(error_text(error)) from None
            except Exception as error:
                text = error_text(error)
                raise self.error(f"The workers of {self.address} cannot run a task: {text}; mend them.") from None
            yield result


def error_text(error: Exception) -> str:
    """Class and message of an error on one line."""
    return " ".join(f"{type(error).__name__}: {error}".split())


def progress_bar(done: int, total: int) -> str:
    """Bar of the fraction of tasks that are done."""
    filled = _BAR * done // total
    return f"{'█' * filled}{'░' * (_BAR - filled)}"
