"""A clean and a noisy record of a small ship, and a still smaller ship; all are read only."""

from __future__ import annotations

import numpy as np
import pytest

import pymc_ship as ps
from tests.physics.vessel.cases import small_vessel


@pytest.fixture(scope="module")
def clean(small):
    return ps.simulate(small, ps.zigzag(20.0, 20.0), duration=200.0, step=0.1)


@pytest.fixture(scope="module")
def noisy(clean):
    return ps.pollute(clean, level=0.01, rng=np.random.default_rng(1))


NAMES = {"surge": ("Xu", "Xuu", "Xvr"), "sway": ("Yv", "Yr", "Ydelta"), "yaw": ("Nv", "Nr", "Ndelta")}


@pytest.fixture(scope="module")
def nine(container):
    """Nine of the container ship's coefficients, without roll."""
    return small_vessel(container, NAMES)
