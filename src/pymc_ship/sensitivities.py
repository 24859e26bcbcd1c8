"""Forward sensitivities: how the simulated motion changes with every coefficient and with the initial state.

The states obey x' = f(x, delta; theta) with f linear in theta, so S = dx/d(theta, x_0) obeys S' = f_x S + f_theta. The
integrator is applied to both together, which makes S the exact derivative of the simulated record. f itself, the
terms and the known forces come from :mod:`pymc_ship.equations_of_motion` and :mod:`pymc_ship.terms`; here are only
their derivatives: the product rule along the same multiplication plan, then the chain rule of the prime system.
"""

from __future__ import annotations

import numpy as np
from numba import njit

from pymc_ship.equations_of_motion import KERNEL, reference_coefficients, scheme, state_derivative, work_rows
from pymc_ship.prime_system import GRAVITY
from pymc_ship.simulate import METHODS, SimulationError, runge_kutta_stages
from pymc_ship.terms import N_BASE, ROW_ABSOLUTE, ROW_SYMBOL
from pymc_ship.vessel import Vessel

N_FORCING = 5
"""States that act on the forces: u, v, r, p, phi."""


@njit(**KERNEL)
def _term_tangents(work, left, right, tangent):
    """Derivatives of every workspace row by the symbols u_a, v', r', p', phi: product rule along the plan."""
    for symbol in range(N_FORCING):
        tangent[ROW_SYMBOL + symbol, symbol] = 1.0
        tangent[ROW_ABSOLUTE + symbol, symbol] = np.sign(work[ROW_SYMBOL + symbol, 0])
    for k in range(left.size):
        a, b = left[k], right[k]
        value_a, value_b = work[a, 0], work[b, 0]
        for s in range(N_FORCING):
            tangent[N_BASE + k, s] = value_a * tangent[b, s] + value_b * tangent[a, s]


@njit(**KERNEL)
def _force_gradient(coefficients, rows, dof, tangent, gradient):
    """Derivatives of the four hydrodynamic forces by the symbols, (4, 5)."""
    gradient[:] = 0.0
    for k in range(rows.size):
        c, row, target = coefficients[k, 0], rows[k], dof[k]
        for s in range(N_FORCING):
            gradient[target, s] += c * tangent[row, s]


@njit(**KERNEL)
def _add_known_gradient(state, work, hull, U, gradient, cosine):
    """Add the derivatives of the known forces by the symbols and, in ``cosine`` (4,), by u / U."""
    L, m, x_G, z_G, volume, GM, BM = hull[0], hull[2], hull[3], hull[4], hull[5], hull[6], hull[7]
    v, r, p = work[ROW_SYMBOL + 1, 0], work[ROW_SYMBOL + 2, 0], work[ROW_SYMBOL + 3, 0]
    gradient[0, 1] += m * r
    gradient[0, 2] += m * (v + 2.0 * x_G * r - z_G * p)
    gradient[0, 3] -= m * z_G * r
    c = m * state[0, 0] / U
    gradient[1, 2] -= c
    gradient[2, 2] -= x_G * c
    gradient[3, 2] += z_G * c
    cosine[0], cosine[1], cosine[2], cosine[3] = 0.0, -m * r, -m * x_G * r, m * z_G * r
    sine, cos_phi = np.sin(state[4, 0]), np.cos(state[4, 0])
    tan = sine / cos_phi
    lever_slope = (GM + 0.5 * BM * tan * tan) * cos_phi + BM * tan * tan / cos_phi
    gradient[3, 4] -= 2.0 * GRAVITY * volume * lever_slope / (U * U * L * L * L)


@njit(**KERNEL)
def _state_jacobian(state, work, force, hull, J_inverse, gradient, cosine, f_x):
    """Derivatives of the rates of u, v, r, p by u, v, r, p, phi from those of the forces by the symbols."""
    L, nominal_speed = hull[0], hull[1]
    u, v = state[0, 0], state[1, 0]
    U = np.sqrt(u * u + v * v)
    restoring = GRAVITY * hull[5] * (hull[6] + 0.5 * hull[7] * np.tan(state[4, 0]) ** 2) * np.sin(state[4, 0])
    by_speed = np.empty(4)
    for g in range(4):
        along = gradient[g, 0] * nominal_speed / U - gradient[g, 1] * work[ROW_SYMBOL + 1, 0]
        along -= gradient[g, 2] * work[ROW_SYMBOL + 2, 0] + gradient[g, 3] * work[ROW_SYMBOL + 3, 0]
        by_speed[g] = (along - cosine[g] * u / U) / U
    by_speed[3] += 4.0 * restoring / (U * U * U * L * L * L)
    for k in range(4):
        a = U * U / L if k < 2 else U * U / (L * L)
        total, speed, by_u, by_v, by_r, by_p, by_phi = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
        for g in range(4):
            J = J_inverse[k, g]
            total += J * force[g, 0]
            speed += J * by_speed[g]
            by_u += J * cosine[g]
            by_v += J * gradient[g, 1]
            by_r += J * gradient[g, 2]
            by_p += J * gradient[g, 3]
            by_phi += J * gradient[g, 4]
        speed += 2.0 * total / U
        f_x[k, 0] = a * (speed * u + by_u) / U
        f_x[k, 1] = a * (speed * v + by_v) / U
        f_x[k, 2] = a * by_r * L / U
        f_x[k, 3] = a * by_p * L / U
        f_x[k, 4] = a * by_phi


@njit(**KERNEL)
def _kinematic_jacobian(state, f_x):
    """Derivatives of the rates of phi, psi, x, y by the states, as far as ``f_x`` has rows for them."""
    f_x[4, 3] = 1.0
    if f_x.shape[0] < 6:
        return
    sin_phi, cos_phi = np.sin(state[4, 0]), np.cos(state[4, 0])
    f_x[5, 2], f_x[5, 4] = cos_phi, -state[2, 0] * sin_phi
    if f_x.shape[0] < 8:
        return
    sin_psi, cos_psi = np.sin(state[5, 0]), np.cos(state[5, 0])
    u, v = state[0, 0], state[1, 0]
    f_x[6, 0], f_x[6, 1], f_x[6, 4] = cos_psi, -cos_phi * sin_psi, v * sin_phi * sin_psi
    f_x[6, 5] = -u * sin_psi - v * cos_phi * cos_psi
    f_x[7, 0], f_x[7, 1], f_x[7, 4] = sin_psi, cos_phi * cos_psi, -v * sin_phi * cos_psi
    f_x[7, 5] = u * cos_psi - v * cos_phi * sin_psi


@njit(**KERNEL)
def _sensitivity_rate(S, f_x, features, ends, gain, rate):
    """S' = f_x S + f_theta; columns are the coefficients, DOF by DOF, then the initial states."""
    n_columns = S.shape[1]
    for k in range(4):
        a, b, c, d, e = f_x[k, 0], f_x[k, 1], f_x[k, 2], f_x[k, 3], f_x[k, 4]
        for j in range(n_columns):
            rate[k, j] = a * S[0, j] + b * S[1, j] + c * S[2, j] + d * S[3, j] + e * S[4, j]
    for j in range(n_columns):
        rate[4, j] = S[3, j]
    for k in range(5, S.shape[0]):
        rate[k] = 0.0
        for i in range(6):
            if f_x[k, i] != 0.0:
                a = f_x[k, i]
                for j in range(n_columns):
                    rate[k, j] += a * S[i, j]
    begin = 0
    for g in range(ends.size):
        for k in range(4):
            a = gain[k, g]
            if a != 0.0:
                for j in range(begin, ends[g]):
                    rate[k, j] += a * features[j]
        begin = ends[g]


@njit(**KERNEL)
def _linearised_rates(state, delta, S, coefficients, plan, hull, ends, buffers, rate, S_rate):
    """Rates of the states and of their sensitivities at one instant."""
    left, right, rows, dof, J_inverse = plan
    motion, tangent, gradient, cosine, f_x, gain, features = buffers
    work, _, force = motion
    state_derivative(state, delta, coefficients, plan, hull, motion, rate)
    U = np.sqrt(state[0, 0] ** 2 + state[1, 0] ** 2)
    _term_tangents(work, left, right, tangent)
    _force_gradient(coefficients, rows, dof, tangent, gradient)
    _add_known_gradient(state, work, hull, U, gradient, cosine)
    _state_jacobian(state, work, force, hull, J_inverse, gradient, cosine, f_x)
    _kinematic_jacobian(state, f_x)
    for j in range(rows.size):
        features[j] = work[rows[j], 0]
    begin = 0
    for g in range(ends.size):
        for k in range(4):
            a = U * U / hull[0] if k < 2 else U * U / (hull[0] * hull[0])
            gain[k, g] = a * J_inverse[k, dof[begin]]
        begin = ends[g]
    _sensitivity_rate(S, f_x, features, ends, gain, S_rate)


@njit(**KERNEL)
def _axpy(target, base, factor, rate):
    """Write base + factor * rate into the target."""
    for row in range(target.shape[0]):
        for j in range(target.shape[1]):
            target[row, j] = base[row, j] + factor * rate[row, j]


@njit(**KERNEL)
def _advance(state, S, delta, following, coefficients, plan, hull, ends, buffers, stages, inner, step):
    """One step of the states and their sensitivities in place: Euler without stages, else Runge-Kutta."""
    states, sensitivities, angle = inner
    rate, begin, state_inner = states[0], states[1], states[2]
    S_rate, S_begin, S_inner = sensitivities[0], sensitivities[1], sensitivities[2]
    if stages.shape[0] == 0:
        angle[0] = delta
        _linearised_rates(state, angle, S, coefficients, plan, hull, ends, buffers, rate, S_rate)
        _axpy(state, state, step, rate)
        _axpy(S, S, step, S_rate)
        return
    begin[:], S_begin[:], state_inner[:], S_inner[:] = state, S, state, S
    for stage in range(stages.shape[0]):
        angle[0] = delta + stages[stage, 0] * (following - delta)
        if stage > 0:
            _axpy(state_inner, begin, stages[stage, 0] * step, rate)
            _axpy(S_inner, S_begin, stages[stage, 0] * step, S_rate)
        _linearised_rates(state_inner, angle, S_inner, coefficients, plan, hull, ends, buffers, rate, S_rate)
        _axpy(state, state, stages[stage, 1] * step, rate)
        _axpy(S, S, stages[stage, 1] * step, S_rate)


@njit(**KERNEL)
def _integrate(coefficients, plan, hull, ends, n_rows, initial, delta, stages, step, substeps, mean, jacobian):
    """Integrate along a rudder record; write block means of states and sensitivities; False when the ship diverged."""
    n_states, n_blocks, n_columns = jacobian.shape
    n_coefficients = coefficients.shape[0]
    block = delta.size // n_blocks
    state = np.zeros((8, 1))
    state[: initial.size, 0] = initial
    S = np.zeros((n_states, n_columns))
    for k in range(n_states):
        S[k, n_coefficients + k] = 1.0
    motion = (np.empty((n_rows, 1)), np.empty(1), np.empty((4, 1)))
    tangent, gradient, f_x = np.zeros((n_rows, N_FORCING)), np.zeros((4, N_FORCING)), np.zeros((n_states, n_states))
    buffers = (motion, tangent, gradient, np.zeros(4), f_x, np.zeros((4, ends.size)), np.empty(n_coefficients))
    inner = (np.empty((3, 8, 1)), np.empty((3, *S.shape)), np.empty(1))
    mean[:], jacobian[:] = 0.0, 0.0
    for k in range(n_blocks * block):
        ahead = (state[0, 0] > 0.01 * hull[1]) & (abs(state[0, 0]) + abs(state[1, 0]) < 5.0 * hull[1])
        if not (ahead & (abs(state[4, 0]) < 0.5 * np.pi) & (abs(state[2, 0]) + abs(state[3, 0]) < np.inf)):
            return False
        target = k // block
        for row in range(n_states):
            mean[row, target] += state[row, 0] / block
            for j in range(n_columns):
                jacobian[row, target, j] += S[row, j] / block
        following = delta[min(k + 1, delta.size - 1)]
        for part in range(substeps):
            a = delta[k] + (following - delta[k]) * part / substeps
            b = delta[k] + (following - delta[k]) * (part + 1) / substeps
            _advance(state, S, a, b, coefficients, plan, hull, ends, buffers, stages, inner, step / substeps)
    return True


def sensitivities(
    vessel: Vessel,
    delta: np.ndarray,
    initial_state: np.ndarray,
    coefficients: np.ndarray | None = None,
    *,
    interval: float,
    method: str = "rk4",
    substeps: int = 1,
    block: int = 1,
) -> tuple[np.ndarray, np.ndarray]:
    """Motion along a rudder record and its exact derivatives by the coefficients and the initial state.

    Parameters
    ----------
    vessel : Vessel
    delta : array_like, shape (n_time,)
        Rudder angle at the samples [rad], linear between them.
    initial_state : array_like, shape (n_states,)
        The first 5, 6 or 8 of u, v [m/s], r, p [rad/s], phi, psi [rad], x, y [m]; the motion has as many rows.
    coefficients : array_like, shape (n_coefficients,), optional
        DOFs one after the other in the vessel's order; the vessel's reference values by default.
    interval : float
        Sampling interval of the rudder [s].
    method : {"euler", "rk4"}, optional
    substeps : int, optional
        Integration steps for each interval.
    block : int, optional
        Samples averaged into one; samples beyond the last whole block are left out.

    Returns
    -------
    motion : ndarray, shape (n_states, n_blocks)
        Block means of the states, SI units and rad; NaN where the ship left the model's range.
    jacobian : ndarray, shape (n_states, n_blocks, n_coefficients + n_states)
        Derivatives of ``motion``, columns first by the coefficients, then by the initial state.

    Raises
    ------
    SimulationError
        For an unknown method, arrays of the wrong shape, counts below one or a record shorter than a block.
    """
    delta, initial = np.ascontiguousarray(delta, dtype=float), np.array(initial_state, dtype=float)
    theta = reference_coefficients(vessel) if coefficients is None else np.array(coefficients, dtype=float)
    plan = scheme(vessel)
    dof = plan[3]
    if theta.shape != dof.shape or initial.shape not in ((5,), (6,), (8,)) or delta.ndim != 1:
        raise SimulationError(
            f"Sensitivities need {dof.size} coefficients, 5, 6 or 8 initial states and a rudder record, found shapes "
            f"{theta.shape}, {initial.shape} and {delta.shape}; reshape them."
        )
    if method not in METHODS or substeps < 1 or not 1 <= block <= delta.size or not interval > 0.0:
        raise SimulationError(
            f"Sensitivities need a method of {', '.join(METHODS)}, a positive interval, substeps and a block from 1 to "
            f"the record's length, found {method!r}, {interval}, {substeps} and {block}; correct them."
        )
    ends = np.append(np.flatnonzero(np.diff(dof)) + 1, dof.size)
    motion = np.empty((initial.size, delta.size // block))
    jacobian = np.empty((*motion.shape, theta.size + initial.size))
    settings = (plan, vessel.hull, ends, work_rows(vessel), initial, delta, runge_kutta_stages(method))
    if not _integrate(theta[:, None].copy(), *settings, interval, substeps, motion, jacobian):
        motion[:], jacobian[:] = np.nan, np.nan
    return motion, jacobian
