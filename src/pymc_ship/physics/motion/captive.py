"""Forces on a ship in prescribed motion, without its inertia, over rho/2 L^2 U^2 (moments rho/2 L^3 U^2)."""

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np

from pymc_ship.physics.forces.part import INPUTS, STATES
from pymc_ship.physics.forces.programs import Program, execute, set_parameters, sweep
from pymc_ship.physics.forces.terms import evaluate
from pymc_ship.physics.motion.prime_record import prime_record
from pymc_ship.physics.vessel.parts import force_program
from pymc_ship.physics.vessel.vessel import DOFS, Vessel


class _Evaluation(NamedTuple):
    """Row of the forces, terms (n_points, n_terms) and coefficients by DOF; program, workspace, scale of the parts."""

    terms: list[tuple[int, np.ndarray, slice]]
    program: Program
    work: np.ndarray
    scale: np.ndarray


def captive_test_forces(vessel: Vessel, motion: Mapping[str, np.ndarray], draws: np.ndarray) -> np.ndarray:
    """Captive forces X, Y, N, K of each draw, shape (n_draws, 4, n_points), without wind.

    ``motion`` has u, v [m/s], r [rad/s], delta [rad], p [rad/s] and phi [rad] with roll, each (n_points,), and ``n``
    over the nominal revolutions (1 by default) for parts; ``draws`` (n_draws, n_coefficients) are in vessel order.
    """
    evaluation = _evaluation(vessel, motion)
    forces = np.zeros((len(draws), 4, motion["u"].size))
    for row, terms, own in evaluation.terms:
        forces[:, row] = draws[:, own] @ terms.T
    for k, draw in enumerate(draws if vessel.parts else ()):
        forces[k] += _by_parts(evaluation, draw)
    return forces


def captive_test_derivatives(
    vessel: Vessel, motion: Mapping[str, np.ndarray], coefficients: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Captive forces of one ship (4, n_points), their derivatives by the coefficients (4, n_points, n_coefficients)."""
    evaluation = _evaluation(vessel, motion)
    forces = captive_test_forces(vessel, motion, coefficients[None])[0]
    slopes = np.zeros((*forces.shape, coefficients.size))
    for row, terms, own in evaluation.terms:
        slopes[row][:, own] = terms
    if vessel.parts:
        _by_parts(evaluation, coefficients)
        first, count = evaluation.program.n_inputs, evaluation.program.n_parameters
        slope = np.empty_like(evaluation.work)
        for k in range(evaluation.program.results.size):
            sweep(evaluation.program, evaluation.work, k, slope)
            slopes[k][:, coefficients.size - count :] += (slope[first : first + count] * evaluation.scale).T
    return forces, slopes


def _evaluation(vessel: Vessel, motion: Mapping[str, np.ndarray]) -> _Evaluation:
    primes, speed, _ = prime_record(vessel, {name: values for name, values in motion.items() if name != "n"})
    by_dof, begin = [], 0
    for dof in vessel.dofs:
        if terms := vessel.terms(dof):
            by_dof.append((DOFS.index(dof), evaluate(terms, primes), slice(begin, begin + len(terms))))
        begin += len(terms)
    s, program = vessel.particulars, force_program(vessel)
    work = np.zeros((max(program.n_rows, len(STATES) + len(INPUTS)), speed.size))
    turn = s.nominal_speed / s.L
    for row, (name, unit) in enumerate(zip(STATES, (s.nominal_speed, s.nominal_speed, turn, turn, 1, 1), strict=True)):
        if name in motion:
            work[row] = motion[name] / unit
    work[len(STATES) + INPUTS.index("delta")] = motion["delta"]
    work[len(STATES) + INPUTS.index("n")] = motion.get("n", 1.0)
    return _Evaluation(by_dof, program, work, (s.nominal_speed / speed) ** 2)


def _by_parts(evaluation: _Evaluation, coefficients: np.ndarray) -> np.ndarray:
    """Forces of the parts (4, n_points); fills the workspace."""
    parameters = coefficients[coefficients.size - evaluation.program.n_parameters :]
    set_parameters(evaluation.program, np.tile(parameters[:, None], evaluation.scale.size), evaluation.work)
    execute(evaluation.program, evaluation.work)
    return evaluation.work[evaluation.program.results] * evaluation.scale
