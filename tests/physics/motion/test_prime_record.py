from __future__ import annotations

import numpy as np

import pymc_ship as ps
from pymc_ship.physics.motion.prime_record import motion_record, prime_record
from tests.physics.motion import plain_hull


def test_known_forces_are_the_forces_of_a_hull_without_coefficients(container, zigzag_trial):
    run = zigzag_trial.isel(time=slice(None, None, 500))
    record = {name: run[name].values for name in ("u", "v", "r", "p", "phi", "delta")}
    motion, speed, known = prime_record(container, record)
    U, L, mass = np.hypot(run.u, run.v).values, container.particulars.L, container.m
    np.testing.assert_allclose(speed, U, rtol=1e-15)
    np.testing.assert_allclose(motion["u"], 1.0 - 12.7 / U, atol=1e-15)
    np.testing.assert_allclose(motion["v"], run.v / U, rtol=1e-14)
    np.testing.assert_allclose(motion["r"], run.r * L / U, rtol=1e-14)
    hydrodynamic = np.array(
        [
            ps.regression_data(zigzag_trial, container, dof, interval=10.0).design_matrix
            @ container.coefficients(dof).values
            for dof in container.dofs
        ]
    )
    total = np.array([plain_hull.force(*instant) for instant in zip(*record.values(), strict=True)]).T
    np.testing.assert_allclose(known + hydrodynamic, total, atol=1e-14)
    np.testing.assert_allclose(known[1], -mass * (run.u / U) * run.r * L / U, rtol=1e-13)


def test_the_record_of_a_trial_is_what_the_vessel_needs(container, zigzag_trial, ship):
    assert set(motion_record(zigzag_trial, container)) == {"u", "v", "r", "p", "phi", "delta"}
    assert set(motion_record(zigzag_trial, ship)) == {"u", "v", "r", "delta"}
