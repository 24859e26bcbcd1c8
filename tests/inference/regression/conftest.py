"""Fixtures of this wing; all are read only."""

from __future__ import annotations

import numpy as np
import pytest

import pymc_ship as ps


@pytest.fixture(scope="module")
def trial(small):
    return ps.simulate(small, ps.zigzag(20.0, 20.0), duration=200.0, step=0.1)


@pytest.fixture(scope="module")
def drawn(container):
    trial = ps.simulate(container, ps.zigzag(20, 20), duration=120.0, step=0.02, record_interval=0.2)
    noisy = ps.pollute(trial, level=0.01, rng=np.random.default_rng(1))
    return ps.denoise_draws(noisy, draws=3, rng=np.random.default_rng(2))
