"""Threads: one for each core, one inside a worker process."""

import os
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from contextvars import ContextVar
from typing import Any

_ONE_THREAD: ContextVar[bool] = ContextVar("one_thread", default=False)


def map_in_threads[Result](function: Callable[..., Result], *arguments: Iterable[Any]) -> list[Result]:
    """Results of a function that releases the interpreter's lock, in the order of its arguments.

    One thread a task, at most one a core; a task inside another, or alone, has no thread of its own.
    """
    tasks = list(zip(*arguments, strict=True))
    threads = 1 if _ONE_THREAD.get() else min(len(tasks), os.cpu_count() or 1)
    if threads <= 1:
        return [function(*task) for task in tasks]
    with ThreadPoolExecutor(threads, initializer=_ONE_THREAD.set, initargs=(True,)) as pool:
        return list(pool.map(lambda task: function(*task), tasks))


@contextmanager
def one_thread() -> Iterator[None]:
    """Limit linear algebra and :func:`map_in_threads` of this context to one thread."""
    from threadpoolctl import threadpool_limits

    before = _ONE_THREAD.set(True)
    try:
        with threadpool_limits(1):
            yield
    finally:
        _ONE_THREAD.reset(before)
