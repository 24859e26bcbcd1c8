"""Trials and vessels shared by the tests; all are read only."""

from __future__ import annotations

import numpy as np
import pytest

import pymc_ship as ps
from pymc_ship.pages import drawing
from tests.inference.trajectory.cases import record, unmodelled_roll_text
from tests.physics.vessel.cases import small_vessel


@pytest.fixture(scope="session")
def container():
    return ps.load_vessel("container")


@pytest.fixture
def undrawn(monkeypatch):
    """Pages whose figures are made but not drawn, for tests of the text around them."""
    monkeypatch.setattr(drawing, "svg", lambda figure, name: "<svg></svg>")
    monkeypatch.setattr(drawing, "png", lambda figure, dpi: b"")


@pytest.fixture(scope="session")
def zigzag_trial(container):
    """Clean 20/20 zigzag as in the paper: 400 s, 0.02 s, Euler."""
    return ps.simulate(container, ps.zigzag(20.0, 20.0), duration=400.0)


@pytest.fixture(scope="session")
def circle_trial(container):
    """35 deg turn to port until it is steady."""
    return ps.simulate(container, ps.turning_circle(35.0), duration=1200.0)


@pytest.fixture(scope="session")
def small(container):
    """Ten of the container ship's coefficients, without roll."""
    return small_vessel(container)


@pytest.fixture(scope="session")
def ship(container):
    """The container ship's hull without roll, for fits of whole trajectories."""
    return unmodelled_roll_text(container)


@pytest.fixture(scope="session")
def zigzag(ship):
    """Clean 20/20 zigzag of that hull: 120 s, 0.1 s, Runge-Kutta."""
    return record(ship, ps.zigzag(20.0, 20.0))


@pytest.fixture(scope="session")
def clean(small):
    return ps.simulate(small, ps.zigzag(20.0, 20.0), duration=200.0, step=0.1)


@pytest.fixture(scope="session")
def noisy(clean):
    return ps.pollute(clean, level=0.01, rng=np.random.default_rng(1))


NAMES = {"surge": ("Xu", "Xuu", "Xvr"), "sway": ("Yv", "Yr", "Ydelta"), "yaw": ("Nv", "Nr", "Ndelta")}


@pytest.fixture(scope="session")
def nine(container):
    """Nine of the container ship's coefficients, without roll."""
    return small_vessel(container, NAMES)
