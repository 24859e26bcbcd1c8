"""Forces on a ship that is held at a motion, as a carriage or a rotating arm holds her, by the one evaluator.

They are those of the water and the air alone, prime values over rho/2 L^2 U^2 (moments by L more) of the speed at that
point: the ship's own mass pulls at no balance.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np

from pymc_ship.physics.forces.part import INPUTS, STATES
from pymc_ship.physics.forces.programs import Program, execute, set_parameters, sweep
from pymc_ship.physics.forces.terms import evaluate
from pymc_ship.physics.motion.prime_record import prime_record
from pymc_ship.physics.vessel.parts import force_program
from pymc_ship.physics.vessel.vessel import DOFS, Vessel


class _Held(NamedTuple):
    """Terms (n_points, n_terms) and place of each DOF's coefficients; program, workspace and scale of the parts."""

    terms: dict[str, tuple[np.ndarray, slice]]
    program: Program
    work: np.ndarray
    scale: np.ndarray


def captive_test_forces(vessel: Vessel, motion: Mapping[str, np.ndarray], draws: np.ndarray) -> np.ndarray:
    """Forces on each of several ships.

    Parameters
    ----------
    vessel : Vessel
    motion : mapping of str to ndarray, shape (n_points,)
        u, v [m/s], r [rad/s], delta [rad]; p [rad/s] and phi [rad] where the vessel rolls; ``n`` over the nominal
        revolutions, which are those by default. Terms know the nominal revolutions alone, and there is no wind.
    draws : ndarray, shape (n_draws, n_coefficients)
        In the vessel's order.

    Returns
    -------
    ndarray, shape (n_draws, 4, n_points)
        X, Y, N, K in the order of :data:`pymc_ship.physics.vessel.vessel.DOFS`.
    """
    held = _held(vessel, motion)
    found = np.zeros((len(draws), 4, motion["u"].size))
    for dof, (rows, own) in held.terms.items():
        found[:, DOFS.index(dof)] = draws[:, own] @ rows.T
    for k, draw in enumerate(draws if vessel.parts else ()):
        found[k] += _by_parts(held, draw)
    return found


def captive_test_derivatives(
    vessel: Vessel, motion: Mapping[str, np.ndarray], coefficients: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Forces of one ship (4, n_points), and their derivatives by the coefficients (4, n_points, n_coefficients).

    Parameters as :func:`captive_test_forces`, with ``coefficients`` of shape (n_coefficients,).
    """
    held = _held(vessel, motion)
    forces = captive_test_forces(vessel, motion, coefficients[None])[0]
    slopes = np.zeros((*forces.shape, coefficients.size))
    for dof, (rows, own) in held.terms.items():
        slopes[DOFS.index(dof)][:, own] = rows
    if vessel.parts:
        _by_parts(held, coefficients)
        first, count, slope = held.program.n_inputs, held.program.n_parameters, np.empty_like(held.work)
        for k in range(held.program.results.size):
            sweep(held.program, held.work, k, slope)
            slopes[k][:, coefficients.size - count :] += (slope[first : first + count] * held.scale).T
    return forces, slopes


def _held(vessel: Vessel, motion: Mapping[str, np.ndarray]) -> _Held:
    primes, speed, _ = prime_record(vessel, {name: values for name, values in motion.items() if name != "n"})
    rows, begin = {}, 0
    for dof in vessel.dofs:
        terms = vessel.terms(dof)
        if terms:
            rows[dof] = evaluate(terms, primes), slice(begin, begin + len(terms))
        begin += len(terms)
    s, program = vessel.particulars, force_program(vessel)
    work = np.zeros((max(program.n_rows, len(STATES) + len(INPUTS)), speed.size))
    turn = s.nominal_speed / s.L
    for row, (name, unit) in enumerate(zip(STATES, (s.nominal_speed, s.nominal_speed, turn, turn, 1, 1), strict=True)):
        if name in motion:
            work[row] = motion[name] / unit
    work[len(STATES) + INPUTS.index("delta")] = motion["delta"]
    work[len(STATES) + INPUTS.index("n")] = motion.get("n", 1.0)
    return _Held(rows, program, work, (s.nominal_speed / speed) ** 2)


def _by_parts(held: _Held, coefficients: np.ndarray) -> np.ndarray:
    """Forces of the parts (4, n_points), which the workspace then holds."""
    parameters = coefficients[coefficients.size - held.program.n_parameters :]
    set_parameters(held.program, np.tile(parameters[:, None], held.scale.size), held.work)
    execute(held.program, held.work)
    return held.work[held.program.results] * held.scale
