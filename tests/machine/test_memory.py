import sys

import numpy as np

from pymc_ship.machine.memory import address_space, peak_memory


def test_the_largest_memory_grows_with_what_is_taken():
    before = peak_memory()
    taken = np.ones(before // 4)  # twice what was taken before
    assert peak_memory() > before + taken.nbytes // 2


def test_a_system_that_does_not_say_gives_none_and_no_limit(monkeypatch):
    monkeypatch.setitem(sys.modules, "resource", None)
    assert peak_memory() is None
    assert address_space() == float("inf")
