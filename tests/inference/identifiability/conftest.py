"""Fixtures of this wing; all are read only."""

from __future__ import annotations

import pytest

import pymc_ship as ps
from tests.inference.identifiability.test_information import coarse, level_sd


@pytest.fixture(scope="module")
def zigzag(small):
    return coarse(small, ps.zigzag(20.0, 20.0))


@pytest.fixture(scope="module")
def sd(zigzag):
    return level_sd(zigzag, 0.01, ("u", "v", "r"))
