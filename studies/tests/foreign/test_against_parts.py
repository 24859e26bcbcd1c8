"""The package's parts against the independent MMG simulator, at the same published coefficients."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import pymc_ship as ps
from pymc_ship.physics.motion.equations import scheme, set_parts, state_derivative, workspace
from pymc_ship.physics.vessel.parts import with_parts
from pymc_ship.physics.vessel.vessel import Rudder, Vessel, coefficient_names
from studies.foreign.mmg import kvlcc2

BODY = ("added mass", "hull", "propeller", "rudder")


def published(tmp_path) -> tuple[Vessel, dict[str, float]]:
    """The tanker as a vessel of parts, and its published coefficients as parameters."""
    from studies.foreign.sailing import vessel_file

    ship = kvlcc2()
    path = tmp_path / "tanker.toml"
    path.write_text(vessel_file(ship), encoding="utf-8")
    vessel = ps.load_vessel(path)
    papers, r, hull = ship.papers, ship.rudder, ship.hull
    rudder = Rudder(papers.rudder_area, papers.rudder_height**2 / papers.rudder_area)
    vessel = with_parts(replace(vessel, rudder=rudder), BODY)
    slender = papers.d / papers.L
    found = {"m_x": ship.m_x * slender, "m_y": ship.m_y * slender, "J_zz": ship.J_zz * slender, "R0": hull.R0 * slender}
    for letter, rows in (("X", hull.X), ("Y", hull.Y), ("N", hull.N)):
        found |= {letter + term: value * slender for term, value in rows}
    found["Xvr"] += ship.m_y * slender
    found["Yr"] -= ship.m_x * slender
    found |= {"n_0": 1.0, "w0": 0.35, "C2": 1.35, "dC2": 0.25, "f2": 0.0, "f_alpha": r.f_alpha, "epsilon": r.epsilon}
    found |= {"kappa": r.kappa, "gamma_R": 0.5 * (r.gamma_port + r.gamma_starboard)}
    found |= {"dgamma_R": 0.5 * (r.gamma_starboard - r.gamma_port), "l_R": r.l_R, "t_R": r.t_R}
    return vessel, found | {"a_H": r.a_H, "x_H": r.x_H}


@pytest.mark.parametrize(("largest", "tolerance"), [(0.05, 1e-4), (0.3, 5e-3)])
def test_accelerations_are_those_of_the_published_equations(tmp_path, largest, tolerance):
    """Up to the angle of drift in place of its sine, which is of third order in v / U."""
    vessel, given = published(tmp_path)
    ship, rng, n_lanes = kvlcc2(), np.random.default_rng(3), 40
    names = coefficient_names(vessel)
    theta = np.array([given.get(name, 0.0) for name in names])
    U, L = ship.papers.speed, ship.papers.L
    state = np.zeros((8, n_lanes))
    state[0] = U * rng.uniform(0.4, 1.1, n_lanes)
    state[1] = state[0] * rng.uniform(-largest, largest, n_lanes)
    state[2] = U / L * rng.uniform(-2.0, 2.0, n_lanes) * largest
    inputs = np.zeros((4, n_lanes))
    inputs[0], inputs[1] = rng.uniform(-0.6, 0.6, n_lanes), rng.uniform(0.7, 1.1, n_lanes)
    constants, rate = scheme(vessel), np.empty((8, n_lanes))
    work, columns = workspace(n_lanes, constants), np.repeat(theta[:, None], n_lanes, axis=1)
    set_parts(columns, constants, work)
    state_derivative(state, inputs, columns, constants, work, rate)
    truth = np.array(
        [
            ship.accelerations(state[:5, k], inputs[0, k], inputs[1, k] * ship.papers.propeller["n"], np.zeros(4))
            for k in range(n_lanes)
        ]
    ).T
    unit = np.array([U * U / L, U * U / L, (U / L) ** 2])[:, None]
    np.testing.assert_allclose(rate[:3] / unit, truth[:3] / unit, rtol=0.0, atol=tolerance)
    assert np.abs(truth[:3] / unit).max(axis=1).min() > 0.05
