"""A task keeps to one thread."""

from __future__ import annotations

import numpy as np
from threadpoolctl import threadpool_info

import pymc_ship as ps
from pymc_ship.machine.threads import one_thread, thread_pool


def test_a_task_keeps_to_one_thread(small, monkeypatch):
    monkeypatch.setattr("os.cpu_count", lambda: 2)
    noisy = ps.pollute(ps.simulate(small, ps.zigzag(20, 20), duration=30.0), level=0.01, rng=np.random.default_rng(1))
    with one_thread():
        assert thread_pool(2)._max_workers == 1
        assert {pool["num_threads"] for pool in threadpool_info()} == {1}
        alone = ps.denoise(noisy)
    assert thread_pool(2)._max_workers == 2
    assert ps.denoise(noisy).identical(alone)
