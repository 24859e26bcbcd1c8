from dataclasses import dataclass

import numpy as np
import xarray as xr

from pymc_ship.machine.fields import LONGEST, field_text


@dataclass(repr=False)
class Pair:
    one: object
    other: object = None

    __repr__ = field_text


def test_numbers_and_words_are_shown_and_larger_things_by_their_size():
    assert repr(Pair(0.5, "conjugate")) == "Pair(one=0.5, other='conjugate')"
    assert repr(Pair(np.zeros((4, 2)), [1, 2, 3])) == "Pair(one=<4 x 2>, other=<3>)"
    assert repr(Pair({"a": 1}, Pair(1))) == "Pair(one=<1>, other=<Pair>)"
    assert repr(Pair(xr.Dataset({"u": ("time", [1.0, 2.0])}))) == "Pair(one=<2 time>, other=None)"


def test_long_words_are_cut():
    assert repr(Pair("a" * 500)) == f"Pair(one='{'a' * 36}..., other=None)"
    assert len(repr(Pair("a" * 500, "b c " * 500))) < LONGEST
