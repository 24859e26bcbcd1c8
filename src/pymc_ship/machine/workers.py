"""Workers that do many tasks: processes on the local cores (joblib) or on a cluster (dask.distributed).

Both kinds take tasks one by one from an iterator, so that memory does not grow with the number of tasks, and yield
results in the order in which the tasks are done.
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
from dataclasses import dataclass
from itertools import islice, takewhile

AHEAD = 4
"""Tasks handed out at a time for each worker."""

RESTARTS = 5
"""Number of times that workers may be lost without a result in between."""

_CONNECT, _LOOK, _WATCH = 10.0, 2.0, 0.5


MACHINE = (MemoryError, OSError)
"""What a task raises where the machine fails and not the work: it is done again."""


class WorkersLostError(Exception):
    """Some workers died, or failed as machines, before they returned their tasks.

    Attributes
    ----------
    reason : str
        What they failed of.
    times : int
        Without a result in between.
    """

    def __init__(self, reason: str = "too little memory perhaps", times: int = 1):
        super().__init__(f"workers were lost {times} times without a result in between")
        self.reason, self.times = reason, times


def run_tasks[Task, Result](
    executor: LocalCores | Cluster, work: Callable[[Task], Result], remaining: Callable[[], Iterable[Task] | None]
) -> Iterator[Result]:
    """Yield the result of every task; tasks of workers that died are handed out again.

    Parameters
    ----------
    executor : LocalCores or Cluster
        Entered, as the context manager that it is.
    work : callable
        Takes a task and returns its result.
    remaining : callable
        Gives the tasks that have no result yet, None where every task has one. It is called again after workers were
        lost, so that the caller must note each result before it takes the next.

    Raises
    ------
    WorkersLostError
        When workers are lost more than :data:`RESTARTS` times without a result in between.
    """
    lost = 0
    while (tasks := remaining()) is not None:
        try:
            for result in executor.run(work, tasks):
                lost = 0
                yield result
        except WorkersLostError as error:
            lost += 1
            if lost > RESTARTS:
                raise WorkersLostError(error.reason, lost) from None


class LocalCores:
    """Processes on this machine; a single one is this process itself.

    Parameters
    ----------
    workers : int, optional
        One for each core by default.
    error : type of ValueError
        Raised for a number of workers below one.

    Attributes
    ----------
    label : str
    workers : int
    """

    label = "joblib"

    def __init__(self, workers: int | None = None, *, error: type[ValueError]):
        import joblib

        if workers is not None and workers < 1:
            raise error(f"Tasks need at least one worker, found {workers}; raise the number of workers.")
        self.workers = workers or joblib.cpu_count()

    def run[Task, Result](self, work: Callable[[Task], Result], tasks: Iterable[Task]) -> Iterator[Result]:
        """Yield the result of each task; no other is begun after one that raised an error.

        Raises
        ------
        WorkersLostError
            When a process was killed, or a task raised one of :data:`MACHINE`.
        Exception
            Any other error of a task, when the tasks begun are done: raised in a worker process, joblib may wait for
            ever.
        """
        import joblib

        failures: list[_Failure] = []
        tasks = takewhile(lambda _: not failures, tasks)

        settings = {"return_as": "generator_unordered", "pre_dispatch": f"{AHEAD}*n_jobs", "batch_size": 1}
        settings |= {"max_nbytes": None}
        if self.workers > 1:
            settings |= {"backend": "loky", "initializer": _belong_to, "initargs": (os.getpid(),)}
        try:
            for result in joblib.Parallel(self.workers, **settings)(
                joblib.delayed(_tried)(work, task) for task in tasks
            ):
                if isinstance(result, _Failure):
                    failures.append(result)
                else:
                    yield result
        except BrokenProcessPool:
            raise WorkersLostError from None
        for failure in failures:
            if isinstance(failure.error, MACHINE):
                raise WorkersLostError(error_text(failure.error))
            raise failure.error

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


@dataclass(frozen=True)
class _Failure:
    """What a worker returns of a task that raised an error."""

    error: Exception


def _tried[Task, Result](work: Callable[[Task], Result], task: Task) -> Result | _Failure:
    try:
        return work(task)
    except Exception as error:  # the parent raises it
        return _Failure(error)


def _belong_to(parent: int) -> None:
    """Ignore interrupts, which the parent process handles by ending its workers, and end when the parent is gone.

    On Windows a process does not see that its parent is gone; joblib ends workers without tasks after some minutes.
    """
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    threading.Thread(target=_end_with, args=(parent,), daemon=True).start()


def _end_with(parent: int) -> None:
    while os.getppid() == parent:
        time.sleep(_WATCH)
    os._exit(1)


class Cluster:
    """Workers of a Dask scheduler.

    Parameters
    ----------
    address : str
    error : type of ValueError
        Raised where dask.distributed is not installed, no scheduler answers or the workers cannot do a task.

    Attributes
    ----------
    label : str
    workers : int
        Threads of all its workers when it was last looked at.
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

    def run[Task, Result](self, work: Callable[[Task], Result], tasks: Iterable[Task]) -> Iterator[Result]:
        """Yield the result of each task; some for each worker, whose number is looked at, are at the scheduler.

        Raises
        ------
        WorkersLostError
            When a task lost several workers or the scheduler its tasks, or a task raised one of :data:`MACHINE`.
        ValueError
            When the workers cannot do a task, of the type that was asked for.
        """
        from distributed import KilledWorker, as_completed

        tasks, client = iter(tasks), self._client
        running, n_running, looked = as_completed(loop=client.loop), 0, float("-inf")
        while True:
            if time.monotonic() - looked > _LOOK:
                self.workers, looked = max(1, sum(client.nthreads().values())), time.monotonic()
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
                raise self.error(f"The workers of {self.address} cannot do a task: {text}; see to them.") from None
            yield result


def error_text(error: Exception) -> str:
    """Kind and text of an error in one line."""
    return " ".join(f"{type(error).__name__}: {error}".split())


def progress_bar(done: int, total: int, width: int = 30) -> str:
    """Draw how many tasks are done as a bar."""
    filled = width * done // total
    return f"{'█' * filled}{'░' * (width - filled)}"
