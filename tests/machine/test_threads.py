"""A task keeps to one thread."""

from __future__ import annotations

import threading

import numpy as np
from threadpoolctl import threadpool_info

import pymc_ship as ps
from pymc_ship.machine.threads import map_in_threads, one_thread


def test_a_task_keeps_to_one_thread(small, monkeypatch):
    monkeypatch.setattr("os.cpu_count", lambda: 2)
    noisy = ps.pollute(ps.simulate(small, ps.zigzag(20, 20), duration=30.0), level=0.01, rng=np.random.default_rng(1))

    def identity(_: int) -> int:
        meet.wait()
        return threading.get_ident()

    with one_thread():
        meet = threading.Barrier(1)
        assert set(map_in_threads(identity, range(3))) == {threading.get_ident()}
        assert {pool["num_threads"] for pool in threadpool_info()} == {1}
        alone = ps.denoise(noisy)
    meet = threading.Barrier(2)  # two tasks at the same time
    assert len(set(map_in_threads(identity, range(2)))) == 2
    assert ps.denoise(noisy).identical(alone)


def test_a_task_inside_another_has_no_thread_of_its_own(monkeypatch):
    monkeypatch.setattr("os.cpu_count", lambda: 2)

    def inner(_: int) -> set[int]:
        return {threading.get_ident(), *map_in_threads(lambda _: threading.get_ident(), range(4))}

    assert [len(of_task) for of_task in map_in_threads(inner, range(2))] == [1, 1]
