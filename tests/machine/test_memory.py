import sys

import numpy as np
import psutil

from pymc_ship.machine.memory import address_space, peak_memory


def test_the_largest_memory_grows_with_what_is_taken():
    before, more = peak_memory(), 2**26
    taken = np.ones((before - psutil.Process().memory_info().rss + more) // 8)
    assert before + more // 2 < peak_memory() < before + 2 * more
    assert taken.all()


def test_a_system_that_does_not_say_gives_none_and_no_limit(monkeypatch):
    monkeypatch.setitem(sys.modules, "resource", None)
    assert peak_memory() is None
    assert address_space() == float("inf")
