"""Forward sensitivities S = dx/d(theta, x_0) of the simulated motion x' = f(x, delta; theta): S' = f_x S + f_theta."""

from typing import NamedTuple

import numpy as np
from numba import njit

from pymc_ship.physics.motion.equations import KERNEL, LINKED, PART, Scheme, scheme, set_parts, workspace
from pymc_ship.physics.motion.inputs import completed_inputs
from pymc_ship.physics.motion.linearisation import INSTANTS, Instants, forcing_gain, instants_of, linearise
from pymc_ship.physics.motion.replay import check_replay
from pymc_ship.physics.motion.stepping import (
    Lanes,
    Record,
    add,
    advance,
    copy,
    in_range,
    increase,
    integration,
    lanes_at_rest,
)
from pymc_ship.physics.vessel.reading import VesselLike, as_vessel
from pymc_ship.physics.vessel.vessel import reference_coefficients


class Tangents(NamedTuple):
    """Sensitivities ``S`` (n_states, n_columns), work arrays of one step, and the sum over a ``block``."""

    S: np.ndarray
    begin: np.ndarray
    inner: np.ndarray
    rate: np.ndarray
    block: np.ndarray


@njit(**LINKED)
def _march(
    ship: Lanes, coefficients: np.ndarray, scheme: Scheme, record: Record, steps: tuple[int, int], instants: Instants
) -> bool:
    """Integrate some steps and record state and inputs at each evaluation; False if the ship diverges."""
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
def _add_samples(instants: Instants, record: Record, steps: tuple[int, int], total: np.ndarray) -> None:
    """Add the states at the samples to the sums of their blocks, ``total`` (n_states, n_blocks)."""
    substeps, n_stages = record.integration.substeps, record.integration.stages.shape[0]
    for k in range(steps[0], steps[1]):
        if k % substeps == 0:
            for row in range(total.shape[0]):
                total[row, k // substeps // record.block] += instants.state[row, (k - steps[0]) * n_stages]


@njit(**PART)
def _sensitivity_rate(S: np.ndarray, instants: Instants, instant: int, rate: np.ndarray) -> None:
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
                by_heading = f_x[k, 5, instant]
                for j in range(n_columns):
                    rate[k, j] += by_heading * S[5, j]
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
def _follow(tangents: Tangents, record: Record, steps: tuple[int, int], instants: Instants, total: np.ndarray) -> None:
    """Integrate the sensitivities over the same steps; ``total`` (n_states, n_blocks, n_columns) takes their sums."""
    S, inner, rate = tangents.S, tangents.inner, tangents.rate
    stages, step, substeps = record.integration.stages, record.integration.step, record.integration.substeps
    for k in range(steps[0], steps[1]):
        instant = (k - steps[0]) * stages.shape[0]
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


@njit(**KERNEL)
def _integrate(
    theta: np.ndarray, scheme: Scheme, initial: np.ndarray, record: Record, motion: np.ndarray, jacobian: np.ndarray
) -> bool:
    """Integrate along a record; write block means of states and sensitivities; False if the ship diverges."""
    n_states, n_blocks, n_columns = jacobian.shape
    n_coefficients, n_stages = theta.shape[0], record.integration.stages.shape[0]
    gain = forcing_gain(scheme, -(-n_columns // 16) * 16)
    ship, S = lanes_at_rest(1, n_stages, scheme), np.zeros((n_states, gain.shape[1]))
    for k in range(n_states):
        ship.state[k, 0], S[k, n_coefficients + k] = initial[k], 1.0
    many = np.empty((n_coefficients, INSTANTS))
    for j in range(n_coefficients):
        many[j] = theta[j, 0]
    instants = instants_of(n_states, scheme, gain)
    work, tangent = workspace(INSTANTS, scheme), workspace(INSTANTS, scheme)
    set_parts(theta, scheme, ship.work)
    set_parts(many, scheme, work)
    tangents = Tangents(S, np.empty(S.shape), np.empty(S.shape), np.empty(S.shape), np.zeros(S.shape))
    motion[:] = 0.0
    n_steps, stride = n_blocks * record.block * record.integration.substeps, INSTANTS // n_stages
    for begin in range(0, n_steps, stride):
        steps = (begin, min(begin + stride, n_steps))
        if not _march(ship, theta, scheme, record, steps, instants):
            return False
        _add_samples(instants, record, steps, motion)
        linearise(instants, many, scheme, work, tangent)
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

    Parameters and errors as of :func:`pymc_ship.physics.motion.replay.replay`, for one ship; ``coefficients`` are by
    default the vessel's reference values. Returns block means of the states (n_states, n_blocks), SI units and rad, NaN
    if the ship diverges, and their derivatives (n_states, n_blocks, n_coefficients + n_states), initial state last.
    """
    vessel, initial, inputs = as_vessel(vessel), np.array(initial_state, dtype=float), completed_inputs(inputs)
    theta = reference_coefficients(vessel) if coefficients is None else np.array(coefficients, dtype=float)
    check_replay(vessel, (theta, initial, inputs), interval, method, substeps, block)
    record = Record(inputs, integration(method, interval / substeps, substeps), int(block))
    motion = np.empty((initial.size, inputs.shape[1] // block))
    jacobian = np.empty((*motion.shape, theta.size + initial.size))
    if not _integrate(theta[:, None].copy(), scheme(vessel), initial, record, motion, jacobian):
        motion[:], jacobian[:] = np.nan, np.nan
    return motion, jacobian
