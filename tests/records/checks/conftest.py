"""Noisy trials of the container ship, and a ship that does not roll; all are read only."""

from __future__ import annotations

from dataclasses import replace

import pytest

import pymc_ship as ps
from tests.records.checks.cases import noisy, simulated, steered

TERMS = ("Xu", "Xrr", "Xdeltadelta", "Yv", "Yv|v|", "Yr", "Ydelta", "Nv", "Nr", "Ndelta")
"""Ten coefficients of the container ship, without roll."""


@pytest.fixture(scope="module")
def flat(container):
    """A ship that does not roll."""
    forces = {
        dof: tuple(c for c in force if c.name in TERMS) for dof, force in container.forces.items() if dof != "roll"
    }
    return replace(container, name="flat", forces=forces)


@pytest.fixture(scope="module")
def approached(container):
    """Noisy trial with a straight approach."""
    return noisy(steered(container))


@pytest.fixture(scope="module")
def zigzag(container):
    """Noisy 20/20 zigzag."""
    return noisy(simulated(container, ps.zigzag(20.0, 20.0)))


@pytest.fixture(scope="module")
def circle(container):
    """Noisy 35 deg turn."""
    return noisy(simulated(container, ps.turning_circle(35.0), 600.0))
