"""Who does the tasks of a Monte-Carlo study: processes on the local cores (joblib) or a cluster (dask.distributed).

Both take tasks one by one from an iterator, so that memory does not grow with their number, and yield results in the
order in which they are done.
"""

from __future__ import annotations

import os
import signal
import threading
import time
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import CancelledError
from concurrent.futures.process import BrokenProcessPool
from itertools import islice

AHEAD = 4
"""Tasks handed out at a time for each worker."""

_CONNECT, _LOOK, _WATCH = 10.0, 2.0, 0.5


class WorkersLostError(Exception):
    """Workers died with tasks in their hands, which are to be handed out again."""


class LocalCores:
    """Processes on this machine; a single one is this process itself.

    Attributes
    ----------
    label : str
    workers : int
    """

    label = "joblib"

    def __init__(self, workers: int | None = None):
        import joblib

        if workers is not None and workers < 1:
            raise MonteCarloError(f"A study needs at least one worker, found {workers}; raise --workers.")
        self.workers = workers or joblib.cpu_count()

    def run(self, work: Callable, tasks: Iterable) -> Iterator:
        """Yield the result of each task.

        Raises
        ------
        WorkersLostError
            When a process was killed.
        """
        import joblib

        settings = {"return_as": "generator_unordered", "pre_dispatch": f"{AHEAD}*n_jobs", "batch_size": 1}
        settings |= {"max_nbytes": None}
        if self.workers > 1:
            settings |= {"backend": "loky", "initializer": _belong_to, "initargs": (os.getpid(),)}
        try:
            yield from joblib.Parallel(self.workers, **settings)(joblib.delayed(work)(task) for task in tasks)
        except BrokenProcessPool:
            raise WorkersLostError from None

    def __enter__(self) -> LocalCores:
        return self

    def __exit__(self, *error: object) -> None:
        if self.workers > 1:
            from joblib.externals.loky import get_reusable_executor

            get_reusable_executor().shutdown(wait=True, kill_workers=True)


def _belong_to(parent: int) -> None:
    """Leave an interrupt to the parent process, which ends its workers, and end when it is gone."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    threading.Thread(target=_end_with, args=(parent,), daemon=True).start()


def _end_with(parent: int) -> None:
    while os.getppid() == parent:
        time.sleep(_WATCH)
    os._exit(1)


class Cluster:
    """Workers of a Dask scheduler.

    Attributes
    ----------
    label : str
    workers : int
        Threads of all its workers when it was last looked at.
    """

    label = "dask"

    def __init__(self, address: str):
        try:
            import distributed  # noqa: F401
        except ImportError:
            raise MonteCarloError(
                "A study on a cluster needs dask.distributed, which is not installed; install pymc-ship[cluster]."
            ) from None
        self.address, self.workers = address, 0

    def __enter__(self) -> Cluster:
        from distributed import Client

        try:
            self._client = Client(self.address, timeout=_CONNECT, set_as_default=False)
        except (OSError, ValueError) as error:
            raise MonteCarloError(
                f"No Dask scheduler answers at {self.address}: {' '.join(str(error).split())}; start one, see README."
            ) from None
        return self

    def __exit__(self, *error: object) -> None:
        self._client.close()

    def run(self, work: Callable, tasks: Iterable) -> Iterator:
        """Yield the result of each task; some for each worker, whose number is looked at, are at the scheduler.

        Raises
        ------
        WorkersLostError
            When a task lost several workers or the scheduler its tasks.
        MonteCarloError
            When the workers cannot do a task.
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
            except Exception as error:
                text = " ".join(f"{type(error).__name__}: {error}".split())
                raise MonteCarloError(f"The workers of {self.address} cannot do a task: {text}; see to them.") from None
            yield result


class MonteCarloError(ValueError):
    """A study that cannot be run; the sentence says why."""
