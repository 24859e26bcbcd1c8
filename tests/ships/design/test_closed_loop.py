"""Sensitivities of whole manoeuvres against differences of whole simulations."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import pymc_ship as ps
from pymc_ship.physics.motion.sensitivities import sensitivities
from pymc_ship.physics.vessel.vessel import coefficient_names, reference_coefficients
from pymc_ship.ships.design.closed_loop import STEP, closed_loop_sensitivities, straight_course

PSI = 5


def differences(vessel, manoeuvre, column, change, duration):
    """Central difference of the heading, the rudder reversed by each ship for herself."""
    theta = reference_coefficients(vessel)
    change = change * (np.arange(theta.size) == column)
    settings = {"duration": duration, "step": 0.005, "method": "rk4", "record_interval": STEP}
    ships = ps.simulate(vessel, manoeuvre, coefficients=np.array([theta + change, theta - change]), **settings)
    return (ships["psi"].values[0] - ships["psi"].values[1]) / (2.0 * change.sum())


@pytest.mark.parametrize("name", ["Yv|v|", "Nr", "Ndelta"])
@pytest.mark.parametrize(
    ("manoeuvre", "tolerance"), [(ps.zigzag(20, 20, side="starboard"), 0.05), (ps.turning_circle(35), 0.01)]
)
@pytest.mark.parametrize("delay", [0.0, 2.0])
def test_derivatives_are_those_of_the_whole_manoeuvre(container, manoeuvre, tolerance, name, delay):
    """A degree of heading is far more than a reversal at whole steps can hide; the twin has a fixed rudder."""
    container = replace(container, particulars=replace(container.particulars, rudder_delay=delay))
    theta, column = reference_coefficients(container), coefficient_names(container).index(name)
    ship, jacobian = closed_loop_sensitivities(container, manoeuvre, theta, duration=150.0)
    assert jacobian.shape == (6, ship.sizes["time"], theta.size)
    found = jacobian[PSI, :, column]
    expected = differences(container, manoeuvre, column, np.deg2rad(0.5) / np.abs(found).max(), 150.0)
    error = np.sqrt(np.mean((found - expected) ** 2) / np.mean(expected**2))
    assert error < tolerance
    start = straight_course(container, manoeuvre, 6)
    fixed = sensitivities(container, ship["delta"].values, start, theta, interval=STEP)[1][PSI, :, column]
    error = np.sqrt(np.mean((fixed - expected) ** 2) / np.mean(expected**2))
    assert (error > 0.15) == (manoeuvre.kind == "zigzag")


def test_a_ship_that_diverges_has_no_derivatives(container):
    theta = reference_coefficients(container)
    theta[coefficient_names(container).index("Xu")] = 1.0
    ship, jacobian = closed_loop_sensitivities(container, ps.turning_circle(35), theta, duration=150.0)
    assert ship["diverged"]
    assert np.isnan(jacobian).all()
