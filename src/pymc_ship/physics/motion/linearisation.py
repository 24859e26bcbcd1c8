"""Derivatives of the rates by states, coefficients and parameters: forward mode for terms, reverse mode for parts."""

from typing import NamedTuple

import numpy as np
from numba import njit

from pymc_ship.physics.forces.prime_system import rate_scale, righting_arm, righting_moment, row_scale
from pymc_ship.physics.forces.programs import sin_cos, sweep
from pymc_ship.physics.forces.propeller import loading
from pymc_ship.physics.forces.terms import ROW_LOADING, ROW_SYMBOL, fill_product_tangents
from pymc_ship.physics.motion.equations import (
    KERNEL,
    PART,
    Scheme,
    Work,
    add_hydrodynamic_forces,
    propeller_constants,
    state_derivative,
)
from pymc_ship.physics.motion.stepping import N_INPUTS, STATE_ROWS

INSTANTS = 32  # evaluations of the equations of motion that are linearised side by side


class Change(NamedTuple):
    """Change of one of the states on which the forces depend: 1 for that state, 0 for the others."""

    u: float
    v: float
    r: float
    p: float
    phi: float


class Instants(NamedTuple):
    """Evaluations of the equations of motion in the order of the integration, and the linearisation at each of them."""

    state: np.ndarray
    inputs: np.ndarray
    rate: np.ndarray
    f_x: np.ndarray  # (n_states, n_states, n_instants); derivatives by the states
    features: np.ndarray  # (n_instants, n_columns); products U^2 term
    gain: np.ndarray  # (4, n_columns); accelerations by a feature of 1
    by_parts: np.ndarray  # (4, n_instants, n_columns); derivatives by the parameters of parts


@njit(**PART)
def _symbol_tangents(change: Change, state: np.ndarray, scheme: Scheme, work: Work, tangent: Work) -> None:
    """Derivatives of the speed and of symbol and loading rows along a change of one state."""
    hull = scheme.hull
    L, nominal_speed, propeller = hull.L, hull.nominal_speed, propeller_constants(hull)
    for lane in range(state.shape[1]):
        U = work.speed[lane]
        dU = (state[0, lane] * change.u + state[1, lane] * change.v) / U
        tangent.speed[lane] = dU
        tangent.terms[ROW_SYMBOL, lane] = nominal_speed * dU / (U * U)
        tangent.terms[ROW_SYMBOL + 1, lane] = (change.v - work.terms[ROW_SYMBOL + 1, lane] * dU) / U
        rate, turning = change.r / rate_scale(U, L), work.terms[ROW_SYMBOL + 2, lane]
        tangent.terms[ROW_SYMBOL + 2, lane] = rate - turning * dU / U
        rate, rolling = change.p / rate_scale(U, L), work.terms[ROW_SYMBOL + 3, lane]
        tangent.terms[ROW_SYMBOL + 3, lane] = rate - rolling * dU / U
    tangent.terms[ROW_SYMBOL + 4] = change.phi
    tangent.terms[ROW_SYMBOL + 5] = 0.0
    propelled = propeller.J > 0.0
    for lane in range(state.shape[1]):
        _, _, dg, dT = loading(work.terms[ROW_SYMBOL, lane], propeller) if propelled else (0.0, 0.0, 0.0, 0.0)
        tangent.terms[ROW_LOADING, lane] = dg * tangent.terms[ROW_SYMBOL, lane]
        tangent.terms[ROW_LOADING + 1, lane] = dT * tangent.terms[ROW_SYMBOL, lane]


@njit(**PART)
def _known_force_tangents(change: Change, state: np.ndarray, scheme: Scheme, work: Work, tangent: Work) -> None:
    """Derivatives of the known forces along the same change."""
    hull, terms, speed, force = scheme.hull, work.terms, work.speed, tangent.force
    m, x_G, z_G = hull.m, hull.x_G, hull.z_G
    L, volume, GM, BM = hull.L, hull.volume, hull.GM, hull.BM
    for lane in range(state.shape[1]):
        v, r, p = terms[ROW_SYMBOL + 1, lane], terms[ROW_SYMBOL + 2, lane], terms[ROW_SYMBOL + 3, lane]
        dv, dr = tangent.terms[ROW_SYMBOL + 1, lane], tangent.terms[ROW_SYMBOL + 2, lane]
        dp = tangent.terms[ROW_SYMBOL + 3, lane]
        force[0, lane] = m * (dv * r + v * dr + 2.0 * x_G * r * dr - z_G * (dr * p + r * dp))
    for lane in range(state.shape[1]):
        U, r, dr = speed[lane], terms[ROW_SYMBOL + 2, lane], tangent.terms[ROW_SYMBOL + 2, lane]
        cosine = state[0, lane] / U
        centripetal = m * (cosine * dr + (change.u - cosine * tangent.speed[lane]) / U * r)
        force[1, lane] = -centripetal
        force[2, lane] = -x_G * centripetal
        force[3, lane] = z_G * centripetal
    for lane in range(state.shape[1]):
        U = speed[lane]
        sin_phi, cos_phi = sin_cos(state[4, lane])
        tan2 = (sin_phi / cos_phi) ** 2
        arm_slope = (GM + 0.5 * BM * tan2) * cos_phi + BM * tan2 / cos_phi
        GZ = righting_arm(sin_phi, sin_phi / cos_phi, GM, BM)
        moment = righting_moment(GZ, U, L, volume)
        by_heel = righting_moment(arm_slope, U, L, volume)
        force[3, lane] -= by_heel * change.phi - 2.0 * moment * tangent.speed[lane] / U


@njit(**PART)
def _terms_jacobian(instants: Instants, coefficients: np.ndarray, scheme: Scheme, work: Work, tangent: Work) -> None:
    """Derivatives of the rates of u, v, r, p by u, v, r, p, phi."""
    hull, J_inverse, force = scheme.hull, scheme.J_inverse, tangent.force
    for i in range(5):
        change = Change(1.0 * (i == 0), 1.0 * (i == 1), 1.0 * (i == 2), 1.0 * (i == 3), 1.0 * (i == 4))
        _symbol_tangents(change, instants.state, scheme, work, tangent)
        _known_force_tangents(change, instants.state, scheme, work, tangent)
        fill_product_tangents(work.terms, scheme.left, scheme.right, tangent.terms)
        add_hydrodynamic_forces(coefficients, scheme, tangent)
        for k in range(4):
            a, b, c, d = J_inverse[k, 0], J_inverse[k, 1], J_inverse[k, 2], J_inverse[k, 3]
            for lane in range(instants.state.shape[1]):
                U = work.speed[lane]
                acceleration = a * force[0, lane] + b * force[1, lane]
                acceleration += c * force[2, lane] + d * force[3, lane]
                stretch = 2.0 * instants.rate[k, lane] * tangent.speed[lane] / U
                instants.f_x[k, i, lane] = row_scale(k, U, hull.L) * acceleration + stretch


@njit(**PART)
def _kinematic_jacobian(state: np.ndarray, f_x: np.ndarray) -> None:
    """Derivatives of the rates of phi, psi, x, y by the states, as far as ``f_x`` has rows for them."""
    n_states = f_x.shape[0]
    for lane in range(state.shape[1]):
        u, v, r = state[0, lane], state[1, lane], state[2, lane]
        f_x[4, 3, lane] = 1.0
        sin_phi, cos_phi = sin_cos(state[4, lane])
        if n_states > 5:
            f_x[5, 2, lane], f_x[5, 4, lane] = cos_phi, -r * sin_phi
        if n_states > 6:
            sin_psi, cos_psi = sin_cos(state[5, lane])
            f_x[6, 0, lane], f_x[6, 1, lane], f_x[6, 4, lane] = cos_psi, -cos_phi * sin_psi, v * sin_phi * sin_psi
            f_x[6, 5, lane] = -u * sin_psi - v * cos_phi * cos_psi
            f_x[7, 0, lane], f_x[7, 1, lane], f_x[7, 4, lane] = sin_psi, cos_phi * cos_psi, -v * sin_phi * cos_psi
            f_x[7, 5, lane] = u * cos_psi - v * cos_phi * sin_psi


@njit(**PART)
def linearise(instants: Instants, coefficients: np.ndarray, scheme: Scheme, work: Work, tangent: Work) -> None:
    """Fill f_x and, row by row, the products U^2 term of all coefficients at the states and rudder angles."""
    state, rate, speed, program = instants.state, instants.rate, work.speed, scheme.program
    state_derivative(state, instants.inputs, coefficients, scheme, work, rate)
    for k in range(4):
        instants.f_x[k] = 0.0
    if scheme.rows.size > 0:
        for k in range(program.results.size):  # subtract the accelerations by parts
            result, scale = program.results[k], row_scale(k, scheme.hull.nominal_speed, scheme.hull.L)
            for lane in range(state.shape[1]):
                rate[k, lane] -= scale * work.parts[result, lane]
        for lane in range(state.shape[1]):
            speed[lane] = np.sqrt(state[0, lane] ** 2 + state[1, lane] ** 2)
        for j in range(scheme.rows.size):
            for lane in range(state.shape[1]):
                instants.features[lane, j] = work.terms[scheme.rows[j], lane] * speed[lane] ** 2
        _terms_jacobian(instants, coefficients, scheme, work, tangent)
    if program.results.size > 0:
        _add_parts(instants, scheme, work, tangent)
    _kinematic_jacobian(state, instants.f_x)


@njit(**PART)
def _add_parts(instants: Instants, scheme: Scheme, work: Work, tangent: Work) -> None:
    """Add the derivatives of the accelerations by parts to f_x, and fill those by their parameters."""
    program, slope, f_x = scheme.program, tangent.parts, instants.f_x
    U, turn = scheme.hull.nominal_speed, rate_scale(scheme.hull.nominal_speed, scheme.hull.L)
    first, n_states = scheme.rows.size, min(f_x.shape[0], 6)
    for k in range(4):
        if not program.needed[k].any():
            continue
        sweep(program, work.parts, k, slope)
        scale = row_scale(k, U, scheme.hull.L)
        for i in range(n_states):
            unit = scale / (U if i < 2 else turn if i < 4 else 1.0)
            for lane in range(f_x.shape[2]):
                f_x[k, i, lane] += unit * slope[i, lane]
        for j in range(program.n_parameters):
            row = program.n_inputs + j
            for lane in range(f_x.shape[2]):
                instants.by_parts[k, lane, first + j] = scale * slope[row, lane]


@njit(**KERNEL)
def forcing_gain(scheme: Scheme, n_columns: int) -> np.ndarray:
    """Accelerations at unit speed by a unit prime force of each column, (4, n_columns)."""
    gain = np.zeros((4, n_columns))
    for j in range(scheme.dof.size):
        for k in range(4):
            gain[k, j] = scheme.J_inverse[k, scheme.dof[j]] * row_scale(k, 1.0, scheme.hull.L)
    return gain


@njit(**KERNEL, forceinline=True)
def instants_of(n_states: int, scheme: Scheme, gain: np.ndarray) -> Instants:
    """Instants on a straight course, as defaults for those not yet integrated."""
    state = np.zeros((STATE_ROWS, INSTANTS))
    state[0] = scheme.hull.nominal_speed
    inputs, rate = np.zeros((N_INPUTS, INSTANTS)), np.empty((STATE_ROWS, INSTANTS))
    f_x, features = np.zeros((n_states, n_states, INSTANTS)), np.zeros((INSTANTS, gain.shape[1]))
    by_parts = np.zeros((4 if scheme.program.results.size > 0 else 0, INSTANTS, gain.shape[1]))
    return Instants(state=state, inputs=inputs, rate=rate, f_x=f_x, features=features, gain=gain, by_parts=by_parts)
