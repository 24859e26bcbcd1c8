"""Threads: one for each core, one inside a worker process."""

from __future__ import annotations

import os
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from contextvars import ContextVar

_ALONE: ContextVar[bool] = ContextVar("one_thread", default=False)


def thread_pool(tasks: int) -> ThreadPoolExecutor:
    """Thread pool for tasks that release the interpreter's lock: one thread a task, at most one a core."""
    return ThreadPoolExecutor(1 if _ALONE.get() else max(min(tasks, os.cpu_count() or 1), 1))


@contextmanager
def one_thread() -> Iterator[None]:
    """Limit linear algebra and thread pools of this context to one thread."""
    from threadpoolctl import threadpool_limits

    before = _ALONE.set(True)
    try:
        with threadpool_limits(1):
            yield
    finally:
        _ALONE.reset(before)
