"""Forward sensitivities: how the simulated motion changes with every coefficient and with the initial state.

The states obey x' = f(x, delta; theta) with f linear in theta, so S = dx/d(theta, x_0) obeys S' = f_x S + f_theta. The
integrator is applied to both together, which makes S the exact derivative of the simulated record. f itself comes from
:mod:`pymc_ship.motion.equations` and :mod:`pymc_ship.forces.terms`; here are only the derivatives of its parts along a
change of one state. A stretch of the motion comes first, then f_x and f_theta at all its instants, then S along it.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import njit

from pymc_ship.forces.expressions import sin_cos, sweep
from pymc_ship.forces.prime_system import (
    acceleration_scale,
    angular_acceleration_scale,
    rate_scale,
    righting_arm,
    righting_moment,
)
from pymc_ship.forces.propeller import loading
from pymc_ship.forces.terms import ROW_LOADING, ROW_SYMBOL, fill_product_tangents
from pymc_ship.motion.equations import (
    INLINED,
    KERNEL,
    PART,
    add_hydrodynamic_forces,
    part_scale,
    propeller_constants,
    scheme,
    set_parts,
    state_derivative,
    workspace,
)
from pymc_ship.motion.inputs import all_inputs
from pymc_ship.motion.replay import check_replay
from pymc_ship.motion.stepping import (
    N_INPUTS,
    STATE_ROWS,
    Integration,
    add,
    advance,
    copy,
    in_range,
    increase,
    integration,
    lanes_at_rest,
)
from pymc_ship.vessel.reading import VesselLike, as_vessel
from pymc_ship.vessel.vessel import reference_coefficients

INSTANTS = 32
"""Evaluations of the equations of motion that are linearised side by side."""


class Record(NamedTuple):
    """Inputs (4, n_time) of a record, how it is integrated, and ``block``, the samples averaged into one."""

    inputs: np.ndarray
    integration: Integration
    block: int


class Change(NamedTuple):
    """Change of one of the states on which the forces depend: 1 for that state, 0 for the others."""

    u: float
    v: float
    r: float
    p: float
    phi: float


class Instants(NamedTuple):
    """Evaluations of the equations of motion in the order of the integration, and the linearisation at each of them.

    ``state`` and ``rate`` (8, n_instants), ``inputs`` (4, n_instants); ``f_x`` (n_states, n_states, n_instants) are the
    derivatives of the rates by the states, ``features`` (n_instants, n_columns) the products U^2 term of the
    coefficients; ``gain`` (4, n_columns) holds the accelerations by a feature of 1; ``by_parts`` (4, n_instants,
    n_columns) are the derivatives of the accelerations by the parameters of parts, without rows where there are none.
    """

    state: np.ndarray
    inputs: np.ndarray
    rate: np.ndarray
    f_x: np.ndarray
    features: np.ndarray
    gain: np.ndarray
    by_parts: np.ndarray


class Tangents(NamedTuple):
    """Sensitivities ``S`` (n_states, n_columns) and what one step of them needs; ``block`` sums them over a block."""

    S: np.ndarray
    begin: np.ndarray
    inner: np.ndarray
    rate: np.ndarray
    block: np.ndarray


@njit(**PART)
def _symbol_tangents(change, state, scheme, work, tangent):
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
def _known_force_tangents(change, state, scheme, work, tangent):
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
def _terms_jacobian(instants, coefficients, scheme, work, tangent):
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
                scale = acceleration_scale(U, hull.L) if k < 2 else angular_acceleration_scale(U, hull.L)
                stretch = 2.0 * instants.rate[k, lane] * tangent.speed[lane] / U
                instants.f_x[k, i, lane] = scale * acceleration + stretch


@njit(**PART)
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


@njit(**PART)
def _linearise(instants, coefficients, scheme, work, tangent):
    """Fill f_x and, row by row, the products U^2 term of all coefficients at the states and rudder angles."""
    state_derivative(instants.state, instants.inputs, coefficients, scheme, work, instants.rate)
    if scheme.rows.size > 0:
        _linearise_terms(instants, coefficients, scheme, work, tangent)
    else:
        for k in range(4):
            instants.f_x[k] = 0.0
    if scheme.program.results.size > 0:
        _add_parts(instants, scheme, work, tangent)
    _kinematic_jacobian(instants.state, instants.f_x)


@njit(**PART)
def _linearise_terms(instants, coefficients, scheme, work, tangent):
    """Derivatives of the accelerations by terms: f_x, and the features of the coefficients."""
    state, speed = instants.state, work.speed
    for lane in range(state.shape[1]):
        speed[lane] = np.sqrt(state[0, lane] ** 2 + state[1, lane] ** 2)
    for j in range(scheme.rows.size):
        for lane in range(state.shape[1]):
            instants.features[lane, j] = work.terms[scheme.rows[j], lane] * speed[lane] ** 2
    _terms_jacobian(instants, coefficients, scheme, work, tangent)


@njit(**PART)
def _add_parts(instants, scheme, work, tangent):
    """Add the derivatives of the accelerations by parts to f_x, and fill those by their parameters."""
    program, slope, f_x = scheme.program, tangent.parts, instants.f_x
    U, turn = scheme.hull.nominal_speed, rate_scale(scheme.hull.nominal_speed, scheme.hull.L)
    first, n_states = scheme.rows.size, min(f_x.shape[0], 6)
    for k in range(4):
        if not program.needed[k].any():
            continue
        sweep(program, work.parts, k, slope)
        scale = part_scale(scheme, k)
        for i in range(n_states):
            unit = scale / (U if i < 2 else turn if i < 4 else 1.0)
            for lane in range(f_x.shape[2]):
                f_x[k, i, lane] += unit * slope[i, lane]
        for j in range(program.n_parameters):
            row = program.n_inputs + j
            for lane in range(f_x.shape[2]):
                instants.by_parts[k, lane, first + j] = scale * slope[row, lane]


@njit(**INLINED)
def _march(ship, coefficients, scheme, record, steps, instants):
    """Integrate some steps, noting state and rudder at each evaluation; False when the ship diverged."""
    inputs, substeps, stages = record.inputs, record.integration.substeps, record.integration.stages
    instant = 0
    for k in range(steps[0], steps[1]):
        sample, part = k // substeps, k % substeps
        if part == 0 and not in_range(ship.state, scheme.hull, 0):
            return False
        following = min(sample + 1, inputs.shape[1] - 1)
        for row in range(inputs.shape[0]):
            change = (inputs[row, following] - inputs[row, sample]) / substeps
            for stage in range(stages.shape[0]):
                ship.inputs[stage, row, 0] = inputs[row, sample] + (part + stages[stage, 0]) * change
        advance(ship, coefficients, scheme, record.integration)
        for stage in range(stages.shape[0]):
            for row in range(ship.state.shape[0]):
                instants.state[row, instant] = ship.inner[stage, row, 0]
            for row in range(inputs.shape[0]):
                instants.inputs[row, instant] = ship.inputs[stage, row, 0]
            instant += 1
    return True


@njit(**PART)
def _add_samples(instants, record, steps, total):
    """Add the states at the samples to the sums of their blocks, ``total`` (n_states, n_blocks)."""
    substeps, n_stages = record.integration.substeps, record.integration.stages.shape[0]
    for k in range(steps[0], steps[1]):
        if k % substeps == 0:
            for row in range(total.shape[0]):
                total[row, k // substeps // record.block] += instants.state[row, (k - steps[0]) * n_stages]


@njit(**PART)
def _sensitivity_rate(S, instants, instant, rate):
    """S' = f_x S + f_theta at one instant; f_theta is the gain times a row of the features."""
    f_x, n_columns = instants.f_x, S.shape[1]
    for k in range(4):
        a, b, c = f_x[k, 0, instant], f_x[k, 1, instant], f_x[k, 2, instant]
        d, e = f_x[k, 3, instant], f_x[k, 4, instant]
        for j in range(n_columns):
            f = instants.gain[k, j] * instants.features[instant, j]
            rate[k, j] = a * S[0, j] + b * S[1, j] + c * S[2, j] + d * S[3, j] + e * S[4, j] + f
        if instants.by_parts.size > 0:
            for j in range(n_columns):
                rate[k, j] += instants.by_parts[k, instant, j]
            if S.shape[0] > 5:
                turned = f_x[k, 5, instant]
                for j in range(n_columns):
                    rate[k, j] += turned * S[5, j]
    for j in range(n_columns):
        rate[4, j] = S[3, j]
    if S.shape[0] > 5:
        a, b = f_x[5, 2, instant], f_x[5, 4, instant]
        for j in range(n_columns):
            rate[5, j] = a * S[2, j] + b * S[4, j]
    for k in range(6, S.shape[0]):
        a, b, c, d = f_x[k, 0, instant], f_x[k, 1, instant], f_x[k, 4, instant], f_x[k, 5, instant]
        for j in range(n_columns):
            rate[k, j] = a * S[0, j] + b * S[1, j] + c * S[4, j] + d * S[5, j]


@njit(**PART)
def _follow(tangents, record, steps, instants, total):
    """Integrate the sensitivities over the same steps; ``total`` (n_states, n_blocks, n_columns) takes their sums."""
    S, inner, rate = tangents.S, tangents.inner, tangents.rate
    stages, step, substeps = record.integration.stages, record.integration.step, record.integration.substeps
    instant = 0
    for k in range(steps[0], steps[1]):
        if k % substeps == 0:
            sample = k // substeps
            increase(tangents.block, 1.0, S)
            if (sample + 1) % record.block == 0:
                copy(total[:, sample // record.block], tangents.block)
                tangents.block[:] = 0.0
        _sensitivity_rate(S, instants, instant, rate)
        if stages.shape[0] > 1:
            copy(tangents.begin, S)
        increase(S, stages[0, 1] * step, rate)
        for stage in range(1, stages.shape[0]):
            add(inner, tangents.begin, stages[stage, 0] * step, rate)
            _sensitivity_rate(inner, instants, instant + stage, rate)
            increase(S, stages[stage, 1] * step, rate)
        instant += stages.shape[0]


@njit(**KERNEL)
def _forcing_gain(scheme, n_columns):
    """Accelerations at unit speed by the prime force each column stands for, (4, n_columns)."""
    gain = np.zeros((4, n_columns))
    for j in range(scheme.dof.size):
        for k in range(4):
            L = scheme.hull.L
            scale = acceleration_scale(1.0, L) if k < 2 else angular_acceleration_scale(1.0, L)
            gain[k, j] = scheme.J_inverse[k, scheme.dof[j]] * scale
    return gain


@njit(**KERNEL, forceinline=True)
def _instants(n_states, scheme, gain):
    """Instants of a ship that sails straight ahead, which stand for those that no step has reached."""
    state = np.zeros((STATE_ROWS, INSTANTS))
    state[0] = scheme.hull.nominal_speed
    inputs, rate = np.zeros((N_INPUTS, INSTANTS)), np.empty((STATE_ROWS, INSTANTS))
    f_x, features = np.zeros((n_states, n_states, INSTANTS)), np.zeros((INSTANTS, gain.shape[1]))
    by_parts = np.zeros((4 if scheme.program.results.size > 0 else 0, INSTANTS, gain.shape[1]))
    return Instants(state, inputs, rate, f_x, features, gain, by_parts)


@njit(**KERNEL)
def _integrate(coefficients, scheme, initial, record, motion, jacobian):
    """Integrate along a rudder record; write block means of states and sensitivities; False when the ship diverged."""
    n_states, n_blocks, n_columns = jacobian.shape
    n_coefficients, n_stages = coefficients.shape[0], record.integration.stages.shape[0]
    gain = _forcing_gain(scheme, -(-n_columns // 16) * 16)
    ship, S = lanes_at_rest(1, n_stages, scheme), np.zeros((n_states, gain.shape[1]))
    for k in range(n_states):
        ship.state[k, 0], S[k, n_coefficients + k] = initial[k], 1.0
    many = np.empty((n_coefficients, INSTANTS))
    for j in range(n_coefficients):
        many[j] = coefficients[j, 0]
    instants = _instants(n_states, scheme, gain)
    work, tangent = workspace(INSTANTS, scheme), workspace(INSTANTS, scheme)
    set_parts(coefficients, scheme, ship.work)
    set_parts(many, scheme, work)
    tangents = Tangents(S, np.empty(S.shape), np.empty(S.shape), np.empty(S.shape), np.zeros(S.shape))
    motion[:] = 0.0
    n_steps, stride = n_blocks * record.block * record.integration.substeps, INSTANTS // n_stages
    for begin in range(0, n_steps, stride):
        steps = (begin, min(begin + stride, n_steps))
        if not _march(ship, coefficients, scheme, record, steps, instants):
            return False
        _add_samples(instants, record, steps, motion)
        _linearise(instants, many, scheme, work, tangent)
        _follow(tangents, record, steps, instants, jacobian)
    motion /= record.block
    jacobian /= record.block
    return True


def sensitivities(
    vessel: VesselLike,
    inputs: np.ndarray,
    initial_state: np.ndarray,
    coefficients: np.ndarray | None = None,
    *,
    interval: float,
    method: str = "rk4",
    substeps: int = 1,
    block: int = 1,
) -> tuple[np.ndarray, np.ndarray]:
    """Motion along a record of inputs and its exact derivatives by the coefficients and the initial state.

    Parameters
    ----------
    vessel : Vessel, str or Path
    inputs : array_like, shape (n_time,) or (4, n_time)
        Rudder angle at the samples [rad], linear between them; or all inputs, see
        :func:`pymc_ship.motion.inputs.recorded_inputs`.
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
    >>> import pymc_ship as ps
    >>> vessel = ps.load_vessel("kvlcc2")
    >>> trial = ps.simulate(vessel, ps.zigzag(20, 20), duration=300, step=0.5, method="rk4")
    >>> start = [vessel.particulars.nominal_speed, 0, 0, 0, 0]
    >>> motion, jacobian = ps.sensitivities(vessel, trial["delta"].values, start, interval=0.5)
    >>> motion.shape, jacobian.shape
    ((5, 600), (5, 600, 30))
    """
    vessel, initial = as_vessel(vessel), np.array(initial_state, dtype=float)
    inputs = all_inputs(inputs)
    theta = reference_coefficients(vessel) if coefficients is None else np.array(coefficients, dtype=float)
    check_replay(vessel, inputs, initial, theta, interval=interval, method=method, substeps=substeps, block=block)
    record = Record(inputs, integration(method, interval / substeps, substeps), int(block))
    motion = np.empty((initial.size, inputs.shape[1] // block))
    jacobian = np.empty((*motion.shape, theta.size + initial.size))
    if not _integrate(theta[:, None].copy(), scheme(vessel), initial, record, motion, jacobian):
        motion[:], jacobian[:] = np.nan, np.nan
    return motion, jacobian
