"""Forward sensitivities: how the simulated motion changes with every coefficient and with the initial state.

The states obey x' = f(x, delta; theta) with f linear in theta, so S = dx/d(theta, x_0) obeys S' = f_x S + f_theta. The
integrator is applied to both together, which makes S the exact derivative of the simulated record. f itself comes from
:mod:`pymc_ship.motion.equations` and :mod:`pymc_ship.forces.terms`; here are only the derivatives of its parts along a
change of one state. The motion does not depend on S: a stretch of it is integrated first, then f_x and f_theta are
evaluated at all its instants side by side, then S follows.
"""

from __future__ import annotations

import numpy as np
from numba import njit

from pymc_ship.forces.prime_system import (
    GRAVITY,
    acceleration_scale,
    angular_acceleration_scale,
    rate_scale,
    righting_moment,
)
from pymc_ship.forces.propeller import loading
from pymc_ship.forces.terms import ROW_LOADING, ROW_SYMBOL, fill_product_tangents
from pymc_ship.motion.equations import (
    INLINED,
    KERNEL,
    add_hydrodynamic_forces,
    propeller_constants,
    scheme,
    sin_cos,
    state_derivative,
    work_rows,
)
from pymc_ship.motion.simulation import check_replay, runge_kutta_stages
from pymc_ship.vessel.vessel import Vessel, reference_coefficients

INSTANTS = 32
"""Evaluations of the equations of motion that are linearised side by side."""


@njit(**KERNEL)
def _symbol_tangents(unit, state, work, speed, hull, speed_tangent, tangent):
    """Derivatives of the speed and of symbol and loading rows along a change ``unit`` of u, v, r, p, phi."""
    L, nominal_speed = hull[0], hull[1]
    du, dv, dr, dp, dphi = unit
    for lane in range(state.shape[1]):
        U = speed[lane]
        dU = (state[0, lane] * du + state[1, lane] * dv) / U
        speed_tangent[lane] = dU
        tangent[ROW_SYMBOL, lane] = nominal_speed * dU / (U * U)
        tangent[ROW_SYMBOL + 1, lane] = (dv - work[ROW_SYMBOL + 1, lane] * dU) / U
        tangent[ROW_SYMBOL + 2, lane] = dr / rate_scale(U, L) - work[ROW_SYMBOL + 2, lane] * dU / U
        tangent[ROW_SYMBOL + 3, lane] = dp / rate_scale(U, L) - work[ROW_SYMBOL + 3, lane] * dU / U
    tangent[ROW_SYMBOL + 4] = dphi
    tangent[ROW_SYMBOL + 5] = 0.0
    propelled, constants = hull[8] > 0.0, propeller_constants(hull)
    for lane in range(state.shape[1]):
        _, _, dg, dT = loading(work[ROW_SYMBOL, lane], constants) if propelled else (0.0, 0.0, 0.0, 0.0)
        tangent[ROW_LOADING, lane] = dg * tangent[ROW_SYMBOL, lane]
        tangent[ROW_LOADING + 1, lane] = dT * tangent[ROW_SYMBOL, lane]


@njit(**KERNEL)
def _known_force_tangents(unit, state, work, speed, hull, speed_tangent, tangent, force_tangent):
    """Derivatives of the known forces along the same change, written to ``force_tangent`` (4, n_lanes)."""
    L, m, x_G, z_G, volume, GM, BM = hull[0], hull[2], hull[3], hull[4], hull[5], hull[6], hull[7]
    for lane in range(state.shape[1]):
        v, r, p = work[ROW_SYMBOL + 1, lane], work[ROW_SYMBOL + 2, lane], work[ROW_SYMBOL + 3, lane]
        dv, dr, dp = tangent[ROW_SYMBOL + 1, lane], tangent[ROW_SYMBOL + 2, lane], tangent[ROW_SYMBOL + 3, lane]
        force_tangent[0, lane] = m * (dv * r + v * dr + 2.0 * x_G * r * dr - z_G * (dr * p + r * dp))
    for lane in range(state.shape[1]):
        U, r, dr = speed[lane], work[ROW_SYMBOL + 2, lane], tangent[ROW_SYMBOL + 2, lane]
        cosine = state[0, lane] / U
        centripetal = m * (cosine * dr + (unit[0] - cosine * speed_tangent[lane]) / U * r)
        force_tangent[1, lane] = -centripetal
        force_tangent[2, lane] = -x_G * centripetal
        force_tangent[3, lane] = z_G * centripetal
    for lane in range(state.shape[1]):
        U = speed[lane]
        sin_phi, cos_phi = sin_cos(state[4, lane])
        tan2 = (sin_phi / cos_phi) ** 2
        arm_slope = (GM + 0.5 * BM * tan2) * cos_phi + BM * tan2 / cos_phi
        moment = righting_moment(sin_phi, sin_phi / cos_phi, U, L, volume, GM, BM)
        by_heel = 2.0 * GRAVITY * volume * arm_slope / (U * U * L * L * L)
        force_tangent[3, lane] -= by_heel * unit[4] - 2.0 * moment * speed_tangent[lane] / U


@njit(**KERNEL)
def _force_jacobian(state, coefficients, plan, hull, buffers, rate, f_x):
    """Derivatives of the rates of u, v, r, p by u, v, r, p, phi: columns of ``f_x`` (n_states, n_states, n_lanes)."""
    left, right, rows, dof, J_inverse = plan
    work, speed, force_tangent, tangent, speed_tangent = buffers
    for i in range(5):
        unit = (1.0 * (i == 0), 1.0 * (i == 1), 1.0 * (i == 2), 1.0 * (i == 3), 1.0 * (i == 4))
        _symbol_tangents(unit, state, work, speed, hull, speed_tangent, tangent)
        _known_force_tangents(unit, state, work, speed, hull, speed_tangent, tangent, force_tangent)
        fill_product_tangents(work, left, right, tangent)
        add_hydrodynamic_forces(coefficients, rows, dof, tangent, force_tangent)
        for k in range(4):
            a, b, c, d = J_inverse[k, 0], J_inverse[k, 1], J_inverse[k, 2], J_inverse[k, 3]
            for lane in range(state.shape[1]):
                U = speed[lane]
                change = a * force_tangent[0, lane] + b * force_tangent[1, lane]
                change += c * force_tangent[2, lane] + d * force_tangent[3, lane]
                scale = acceleration_scale(U, hull[0]) if k < 2 else angular_acceleration_scale(U, hull[0])
                f_x[k, i, lane] = scale * change + 2.0 * rate[k, lane] * speed_tangent[lane] / U


@njit(**KERNEL)
def _kinematic_jacobian(state, f_x):
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


@njit(**KERNEL)
def _linearise(state, delta, coefficients, plan, hull, buffers, rate, f_x, features):
    """Fill f_x and, row by row, the products U^2 term of all coefficients at the instants of ``state`` (8, n_lanes)."""
    rows, work, speed = plan[2], buffers[0], buffers[1]
    state_derivative(state, delta, coefficients, plan, hull, buffers[:3], rate)
    for lane in range(state.shape[1]):
        speed[lane] = np.sqrt(state[0, lane] ** 2 + state[1, lane] ** 2)
    for j in range(rows.size):
        for lane in range(state.shape[1]):
            features[lane, j] = work[rows[j], lane] * speed[lane] ** 2
    _force_jacobian(state, coefficients, plan, hull, buffers, rate, f_x)
    _kinematic_jacobian(state, f_x)


@njit(**KERNEL)
def _in_range(state, nominal_speed):
    """Whether the ship is where the model means something, as in the simulator."""
    ahead = (state[0, 0] > 0.01 * nominal_speed) & (state[0, 0] ** 2 + state[1, 0] ** 2 < 25.0 * nominal_speed**2)
    return ahead & (abs(state[2, 0]) + abs(state[3, 0]) < np.inf) & (abs(state[4, 0]) < 0.5 * np.pi)


@njit(**INLINED)
def _march(state, delta, steps, grid, coefficients, plan, hull, buffers, stages, path, angles, total):
    """Integrate some steps, noting state and rudder at each evaluation; False when the ship diverged.

    ``total`` (n_states, n_blocks) takes the sums of the states at the samples.
    """
    motion, rate, start, inner, angle = buffers
    step, substeps, block = grid
    lane = 0
    for k in range(steps[0], steps[1]):
        sample, part = k // substeps, k % substeps
        if part == 0:
            if not _in_range(state, hull[1]):
                return False
            for row in range(total.shape[0]):
                total[row, sample // block] += state[row, 0]
        change = (delta[min(sample + 1, delta.size - 1)] - delta[sample]) / substeps
        start[:] = state
        for stage in range(stages.shape[0]):
            angle[0] = delta[sample] + (part + stages[stage, 0]) * change
            for row in range(state.shape[0]):
                inner[row, 0] = start[row, 0] + (stages[stage, 0] * step * rate[row, 0] if stage > 0 else 0.0)
                path[row, lane] = inner[row, 0]
            angles[lane] = angle[0]
            lane += 1
            state_derivative(inner, angle, coefficients, plan, hull, motion, rate)
            for row in range(state.shape[0]):
                state[row, 0] += stages[stage, 1] * step * rate[row, 0]
    return True


@njit(**KERNEL)
def _sensitivity_rate(S, f_x, gain, features, lane, rate):
    """S' = f_x S + f_theta at one instant; f_theta is gain (4, n_columns) times a row of ``features``."""
    n_columns = S.shape[1]
    for k in range(4):
        a, b, c, d, e = f_x[k, 0, lane], f_x[k, 1, lane], f_x[k, 2, lane], f_x[k, 3, lane], f_x[k, 4, lane]
        for j in range(n_columns):
            f = gain[k, j] * features[lane, j]
            rate[k, j] = a * S[0, j] + b * S[1, j] + c * S[2, j] + d * S[3, j] + e * S[4, j] + f
    for j in range(n_columns):
        rate[4, j] = S[3, j]
    if S.shape[0] > 5:
        a, b = f_x[5, 2, lane], f_x[5, 4, lane]
        for j in range(n_columns):
            rate[5, j] = a * S[2, j] + b * S[4, j]
    for k in range(6, S.shape[0]):
        a, b, c, d = f_x[k, 0, lane], f_x[k, 1, lane], f_x[k, 4, lane], f_x[k, 5, lane]
        for j in range(n_columns):
            rate[k, j] = a * S[0, j] + b * S[1, j] + c * S[4, j] + d * S[5, j]


@njit(**KERNEL)
def _add(target, base, factor, rate):
    """Write base + factor * rate into the target."""
    for row in range(target.shape[0]):
        for j in range(target.shape[1]):
            target[row, j] = base[row, j] + factor * rate[row, j]


@njit(**KERNEL)
def _increase(target, factor, rate):
    """Add factor * rate to the target; a base that is the target itself would not vectorise."""
    for row in range(target.shape[0]):
        for j in range(target.shape[1]):
            target[row, j] += factor * rate[row, j]


@njit(**KERNEL)
def _follow(S, steps, grid, stages, f_x, gain, features, buffers, total):
    """Integrate the sensitivities over the same steps; ``total`` (n_states, n_blocks, n_columns) takes their sums."""
    rate, start, inner, block_total = buffers
    step, substeps, block = grid
    lane = 0
    for k in range(steps[0], steps[1]):
        if k % substeps == 0:
            sample = k // substeps
            _increase(block_total, 1.0, S)
            if (sample + 1) % block == 0:
                total[:, sample // block] = block_total[:, : total.shape[2]]
                block_total[:] = 0.0
        _sensitivity_rate(S, f_x, gain, features, lane, rate)
        if stages.shape[0] > 1:
            start[:] = S
        _increase(S, stages[0, 1] * step, rate)
        for stage in range(1, stages.shape[0]):
            _add(inner, start, stages[stage, 0] * step, rate)
            _sensitivity_rate(inner, f_x, gain, features, lane + stage, rate)
            _increase(S, stages[stage, 1] * step, rate)
        lane += stages.shape[0]


@njit(**KERNEL)
def _forcing_gain(plan, L, n_columns):
    """Accelerations at unit speed by the prime force each column stands for, (4, n_columns)."""
    dof, J_inverse = plan[3], plan[4]
    gain = np.zeros((4, n_columns))
    for j in range(dof.size):
        for k in range(4):
            scale = acceleration_scale(1.0, L) if k < 2 else angular_acceleration_scale(1.0, L)
            gain[k, j] = J_inverse[k, dof[j]] * scale
    return gain


@njit(**KERNEL)
def _integrate(coefficients, plan, hull, n_rows, initial, delta, stages, interval, substeps, motion, jacobian):
    """Integrate along a rudder record; write block means of states and sensitivities; False when the ship diverged."""
    n_states, n_blocks, n_columns = jacobian.shape
    n_coefficients = coefficients.shape[0]
    grid = (interval / substeps, substeps, delta.size // n_blocks)
    gain = _forcing_gain(plan, hull[0], -(-n_columns // 16) * 16)
    state, S = np.zeros((8, 1)), np.zeros((n_states, gain.shape[1]))
    for k in range(n_states):
        state[k, 0], S[k, n_coefficients + k] = initial[k], 1.0
    lanes = np.empty((n_coefficients, INSTANTS))
    for j in range(n_coefficients):
        lanes[j] = coefficients[j, 0]
    path, angles, rates = np.zeros((8, INSTANTS)), np.zeros(INSTANTS), np.empty((8, INSTANTS))
    path[0] = hull[1]
    f_x, features = np.zeros((n_states, n_states, INSTANTS)), np.zeros((INSTANTS, gain.shape[1]))
    one = (np.empty((n_rows, 1)), np.empty(1), np.empty((4, 1)))
    one = (one, np.empty((8, 1)), np.empty((8, 1)), np.empty((8, 1)), np.empty(1))
    many = (np.empty((n_rows, INSTANTS)), np.empty(INSTANTS), np.empty((4, INSTANTS)))
    many = (*many, np.zeros((n_rows, INSTANTS)), np.empty(INSTANTS))
    S_buffers = (np.empty(S.shape), np.empty(S.shape), np.empty(S.shape), np.zeros(S.shape))
    motion[:] = 0.0
    n_steps, stride = n_blocks * grid[2] * substeps, INSTANTS // stages.shape[0]
    for begin in range(0, n_steps, stride):
        steps = (begin, min(begin + stride, n_steps))
        if not _march(state, delta, steps, grid, coefficients, plan, hull, one, stages, path, angles, motion):
            return False
        _linearise(path, angles, lanes, plan, hull, many, rates, f_x, features)
        _follow(S, steps, grid, stages, f_x, gain, features, S_buffers, jacobian)
    motion /= grid[2]
    jacobian /= grid[2]
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

    Examples
    --------
    Derivatives of 5 states at 600 instants by 25 coefficients and the 5 initial states:

    >>> import pymc_ship as ps
    >>> vessel = ps.load_vessel("kvlcc2")
    >>> trial = ps.simulate(vessel, ps.zigzag(20, 20), duration=300, step=0.5, method="rk4")
    >>> start = [vessel.particulars.nominal_speed, 0, 0, 0, 0]
    >>> motion, jacobian = ps.sensitivities(vessel, trial["delta"].values, start, interval=0.5)
    >>> motion.shape, jacobian.shape
    ((5, 600), (5, 600, 30))
    """
    delta, initial = np.ascontiguousarray(delta, dtype=float), np.array(initial_state, dtype=float)
    theta = reference_coefficients(vessel) if coefficients is None else np.array(coefficients, dtype=float)
    check_replay(vessel, delta, initial, theta, interval, method, substeps, block)
    motion = np.empty((initial.size, delta.size // block))
    jacobian = np.empty((*motion.shape, theta.size + initial.size))
    stages = runge_kutta_stages(method) if method == "rk4" else np.array([[0.0, 1.0]])
    settings = (scheme(vessel), vessel.hull, work_rows(vessel), initial, delta, stages)
    if not _integrate(theta[:, None].copy(), *settings, interval, substeps, motion, jacobian):
        motion[:], jacobian[:] = np.nan, np.nan
    return motion, jacobian
