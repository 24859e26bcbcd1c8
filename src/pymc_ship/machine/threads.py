"""Threads of the package: one thread per core.

A single thread inside a worker process, because the other workers use the other cores.
"""

from __future__ import annotations

import os
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from contextvars import ContextVar

_ALONE: ContextVar[bool] = ContextVar("one_thread", default=False)


def thread_pool(tasks: int) -> ThreadPoolExecutor:
    """Pool of threads for tasks that release the interpreter's lock: one thread per task, but at most one per core."""
    return ThreadPoolExecutor(1 if _ALONE.get() else max(min(tasks, os.cpu_count() or 1), 1))


@contextmanager
def one_thread() -> Iterator[None]:
    """Keep linear algebra and thread pools of this context on one thread; other processes use the other cores."""
    from threadpoolctl import threadpool_limits

    before = _ALONE.set(True)
    try:
        with threadpool_limits(1):
            yield
    finally:
        _ALONE.reset(before)
