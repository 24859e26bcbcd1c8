"""Four-degree-of-freedom equations of motion in the prime system: J nu_dot' = hydrodynamic + known forces.

Xue et al. (2020), Eq. 1 to 5 and 9 (doi:10.1016/j.oceaneng.2019.106612), with axes forward, starboard, down. Arrays
inside the kernels have shape (rows, n_lanes): one lane is one instant of one ship, so the simulator runs many ships
side by side and the regression evaluates all instants of a trial at once, with the same code.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit

from pymc_ship.forces.prime_system import (
    acceleration_scale,
    angular_acceleration_scale,
    rate_scale,
    relative_speed,
    righting_moment,
)
from pymc_ship.forces.propeller import PropellerConstants, loading
from pymc_ship.forces.terms import ROW_LOADING, ROW_SYMBOL, fill_products, plan
from pymc_ship.trial.channels import channel_names
from pymc_ship.vessel.vessel import DOFS, Vessel

KERNEL = {"cache": True, "nogil": True, "error_model": "numpy", "fastmath": {"contract", "arcp", "nsz"}}
"""Compiler settings of the kernels; without numpy's error model no loop with a division vectorises."""

INLINED = KERNEL | {"forceinline": True}
"""The same for the parts of a kernel: one that makes its own arrays knows the number of lanes when it is compiled."""

STATE = channel_names(lambda channel: channel.part == "motion")
"""Rows of a state array, SI units and rad: u, v, r, p, phi, psi, x, y."""

VELOCITIES = STATE[:4]
"""Those whose rates are accelerations, one a row of the inertia matrix."""


@njit(**INLINED)
def sin_cos(angle):
    """Sine and cosine by the kernels of fdlibm after a three-part reduction; vectorises over lanes, good to 2 ulp."""
    turns = np.rint(angle * (2.0 / math.pi))
    x = (angle - turns * 1.57079632673412561417) - turns * 6.07710050630396597660e-11
    x -= turns * 2.02226624879595063154e-21
    z = x * x
    s = 2.75573137070700676789e-06 + z * (-2.50507602534068634195e-08 + z * 1.58969099521155010221e-10)
    s = 8.33333333332248946124e-03 + z * (-1.98412698298579493134e-04 + z * s)
    s = x + x * z * (-1.66666666666666324348e-01 + z * s)
    c = -2.75573143513906633035e-07 + z * (2.08757232129817482790e-09 - z * 1.13596475577881948265e-11)
    c = 4.16666666666666019037e-02 + z * (-1.38888888888741095749e-03 + z * (2.48015872894767294178e-05 + z * c))
    c = 1.0 - 0.5 * z + z * z * c
    quadrant = turns - 4.0 * np.floor(turns * 0.25)
    odd = (quadrant == 1.0) | (quadrant == 3.0)
    sine, cosine = (c if odd else s), (s if odd else c)
    return (-sine if quadrant >= 2.0 else sine), (-cosine if (quadrant == 1.0) | (quadrant == 2.0) else cosine)


@njit(**INLINED)
def prime_motion(state, delta, hull, work, speed):
    """Fill the symbol and loading rows of ``work`` and the speed U (n_lanes,)."""
    L, nominal_speed = hull[0], hull[1]
    for lane in range(state.shape[1]):
        u, v = state[0, lane], state[1, lane]
        U = math.sqrt(u * u + v * v)
        speed[lane] = U
        work[ROW_SYMBOL, lane] = relative_speed(U, nominal_speed)
        work[ROW_SYMBOL + 1, lane] = v / U
        work[ROW_SYMBOL + 2, lane] = state[2, lane] / rate_scale(U, L)
        work[ROW_SYMBOL + 3, lane] = state[3, lane] / rate_scale(U, L)
    for lane in range(state.shape[1]):
        work[ROW_SYMBOL + 4, lane] = state[4, lane]
        work[ROW_SYMBOL + 5, lane] = delta[lane]
    propelled, constants = hull[8] > 0.0, propeller_constants(hull)
    for lane in range(state.shape[1]):
        g, T, _, _ = loading(work[ROW_SYMBOL, lane], constants) if propelled else (0.0, 0.0, 0.0, 0.0)
        work[ROW_LOADING, lane], work[ROW_LOADING + 1, lane] = g, T


@njit(**INLINED)
def propeller_constants(hull):
    """Constants of the propeller among those of the hull."""
    return PropellerConstants(hull[8], hull[9], hull[10], hull[11], hull[12], hull[13])


@njit(**INLINED)
def known_forces(state, hull, work, speed, force):
    """Prime forces that hold no hydrodynamic coefficient: F1, F2, M1, M2, written to ``force`` (4, n_lanes)."""
    L, m, x_G, z_G, volume, GM, BM = hull[0], hull[2], hull[3], hull[4], hull[5], hull[6], hull[7]
    for lane in range(state.shape[1]):
        v, r, p = work[ROW_SYMBOL + 1, lane], work[ROW_SYMBOL + 2, lane], work[ROW_SYMBOL + 3, lane]
        force[0, lane] = m * (v * r + x_G * r * r - z_G * r * p)
    for lane in range(state.shape[1]):
        centripetal = m * (state[0, lane] / speed[lane]) * work[ROW_SYMBOL + 2, lane]
        force[1, lane] = -centripetal
        force[2, lane] = -x_G * centripetal
        force[3, lane] = z_G * centripetal
    for lane in range(state.shape[1]):
        sin_phi, cos_phi = sin_cos(state[4, lane])
        force[3, lane] -= righting_moment(sin_phi, sin_phi / cos_phi, speed[lane], L, volume, GM, BM)


@njit(**INLINED)
def add_hydrodynamic_forces(coefficients, rows, dof, work, force):
    """Add coefficient times term to ``force`` (4, n_lanes), four terms of one DOF at a time where there are four."""
    n_lanes = force.shape[1]
    k = 0
    while k < rows.size:
        target = dof[k]
        if k + 3 < rows.size and dof[k + 3] == target:
            a, b, c, d = rows[k], rows[k + 1], rows[k + 2], rows[k + 3]
            for lane in range(n_lanes):
                force[target, lane] += (
                    coefficients[k, lane] * work[a, lane]
                    + coefficients[k + 1, lane] * work[b, lane]
                    + coefficients[k + 2, lane] * work[c, lane]
                    + coefficients[k + 3, lane] * work[d, lane]
                )
            k += 4
        else:
            row = rows[k]
            for lane in range(n_lanes):
                force[target, lane] += coefficients[k, lane] * work[row, lane]
            k += 1


@njit(**INLINED)
def state_derivative(state, delta, coefficients, scheme, hull, buffers, rate):
    """Time derivative of the states, written to ``rate`` (8, n_lanes).

    ``scheme`` is (left, right, rows, dof, J_inverse): multiplication plan, workspace row and DOF of each coefficient,
    inverse inertia matrix; ``buffers`` is (work, speed, force); ``coefficients`` has a row for each coefficient.
    """
    left, right, rows, dof, J_inverse = scheme
    work, speed, force = buffers
    prime_motion(state, delta, hull, work, speed)
    known_forces(state, hull, work, speed, force)
    fill_products(work, left, right)
    add_hydrodynamic_forces(coefficients, rows, dof, work, force)
    for row in range(4):
        a, b, c, d = J_inverse[row, 0], J_inverse[row, 1], J_inverse[row, 2], J_inverse[row, 3]
        for lane in range(state.shape[1]):
            acceleration = a * force[0, lane] + b * force[1, lane] + c * force[2, lane] + d * force[3, lane]
            linear, angular = acceleration_scale(speed[lane], hull[0]), angular_acceleration_scale(speed[lane], hull[0])
            rate[row, lane] = acceleration * (linear if row < 2 else angular)
    for lane in range(state.shape[1]):
        _, cos_phi = sin_cos(state[4, lane])
        rate[4, lane] = state[3, lane]
        rate[5, lane] = state[2, lane] * cos_phi
        speed[lane] = state[1, lane] * cos_phi
    for lane in range(state.shape[1]):
        sin_psi, cos_psi = sin_cos(state[5, lane])
        rate[6, lane] = state[0, lane] * cos_psi - speed[lane] * sin_psi
        rate[7, lane] = state[0, lane] * sin_psi + speed[lane] * cos_psi


def scheme(vessel: Vessel) -> tuple[np.ndarray, ...]:
    """What :func:`state_derivative` needs of a vessel besides its coefficients: (left, right, rows, dof, J_inverse)."""
    terms = tuple(term for dof in vessel.dofs for term in vessel.terms(dof))
    dof = np.concatenate([np.full(len(vessel.terms(name)), DOFS.index(name)) for name in vessel.dofs])
    products = plan(terms)
    J_inverse = np.linalg.inv(vessel.inertia_matrix)
    if "roll" not in vessel.dofs:
        J_inverse[3] = 0.0
    return products.left, products.right, products.rows, dof.astype(np.int64), np.ascontiguousarray(J_inverse)


def work_rows(vessel: Vessel) -> int:
    """Rows of the workspace that :func:`state_derivative` needs."""
    return plan(tuple(term for dof in vessel.dofs for term in vessel.terms(dof))).n_rows
