"""Fixtures of this wing; all are read only."""

from __future__ import annotations

import pytest

import pymc_ship as ps
from tests.inference.captive.test_table import HEADER, ROWS


@pytest.fixture
def read(tmp_path):
    def read(*rows, header=HEADER, **settings):
        path = tmp_path / "captive.csv"
        path.write_text("\n".join([header, *(rows or ROWS)]))
        return ps.read_captive(path, "kvlcc2", **settings)

    return read
