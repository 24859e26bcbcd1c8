"""Threads of the package: as many as there are cores, or one where other processes have the rest."""

from __future__ import annotations

import os
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from contextvars import ContextVar

_ALONE: ContextVar[bool] = ContextVar("one_thread", default=False)


def thread_pool(tasks: int) -> ThreadPoolExecutor:
    """Pool for so many tasks that release the interpreter's lock: a thread for each, at most one for each core."""
    return ThreadPoolExecutor(1 if _ALONE.get() else max(min(tasks, os.cpu_count() or 1), 1))


@contextmanager
def one_thread() -> Iterator[None]:
    """Keep linear algebra and the pools of this context on one thread: the cores belong to other processes."""
    from threadpoolctl import threadpool_limits

    before = _ALONE.set(True)
    try:
        with threadpool_limits(1):
            yield
    finally:
        _ALONE.reset(before)
