"""Equations of motion in four degrees of freedom, prime: J nu_dot' = hydrodynamic + known forces.

Equation numbers are those of docs/reference/equations.md. A lane of the arrays is one instant of one ship.
"""

import math
from typing import Any, NamedTuple

import numpy as np
from numba import njit

from pymc_ship.physics.forces import programs
from pymc_ship.physics.forces.hull import LOW_SPEED
from pymc_ship.physics.forces.prime_system import rate_scale, relative_speed, righting_arm, righting_moment, row_scale
from pymc_ship.physics.forces.programs import Program, execute, set_parameters, sin_cos
from pymc_ship.physics.forces.propeller import PropellerConstants, loading
from pymc_ship.physics.forces.terms import ROW_LOADING, ROW_SYMBOL, fill_products, plan
from pymc_ship.physics.vessel.parts import part_program
from pymc_ship.physics.vessel.vessel import DOFS, Vessel
from pymc_ship.trial.channels import channel_names

KERNEL: dict[str, Any] = programs.KERNEL | {"fastmath": {"contract", "arcp", "nsz"}}
PART: dict[str, Any] = programs.PART | KERNEL
"""Compiler settings of the kernels of motion, and of a function of theirs that makes no array."""

INLINED = PART | {"inline": "always"}
"""The same for a part that one or two functions call, which is compiled within them only."""

LINKED = PART | {"forceinline": True}
"""The same for a part that many call, compiled once; the kernel that links it tells it the number of lanes."""

STATE = channel_names(lambda channel: channel.part == "motion")
"""Rows of a state array, SI units and rad: u, v, r, p, phi, psi, x, y."""

VELOCITIES = STATE[:4]  # those whose rates are accelerations, one a row of the inertia matrix
_CONSTANTS = ("L", "nominal_speed", "slowest", "m", "x_G", "z_G", "volume", "GM", "BM", *PropellerConstants._fields)

HULL = np.dtype((np.record, [(name, float) for name in _CONSTANTS]))
"""Constants of a vessel: L, U_nom, volume, GM and BM in SI units, m, x_G and z_G prime, those of the propeller.

``slowest`` is the least surge speed over U_nom. GM and BM are 0 without roll. A record keeps every division compiled.
"""


class Scheme(NamedTuple):
    """Constants of a vessel for :func:`state_derivative`, without the coefficients."""

    hull: np.record  # of :data:`HULL`
    left: np.ndarray  # (n_products,); plan of the terms, with ``right``
    right: np.ndarray
    rows: np.ndarray  # (n_coefficients,); workspace row of each coefficient
    dof: np.ndarray  # (n_coefficients,); its degree of freedom
    n_rows: int
    J_inverse: np.ndarray  # (4, 4); inverse inertia matrix
    program: Program  # of the accelerations by parts
    n_part_rows: int


class Work(NamedTuple):
    """Workspaces of terms and parts (n_rows, n_lanes), speed U [m/s] (n_lanes,), prime forces (4, n_lanes)."""

    terms: np.ndarray
    speed: np.ndarray
    force: np.ndarray
    parts: np.ndarray


@njit(**LINKED)
def prime_motion(state: np.ndarray, delta: np.ndarray, scheme: Scheme, work: Work) -> None:
    """Fill the speed and the symbol and loading rows of the terms, Eq. 3 and 14."""
    hull, terms, speed = scheme.hull, work.terms, work.speed
    L, nominal_speed, propeller = hull.L, hull.nominal_speed, propeller_constants(hull)
    for lane in range(state.shape[1]):
        u, v = state[0, lane], state[1, lane]
        U = math.sqrt(u * u + v * v)
        speed[lane] = U
        terms[ROW_SYMBOL, lane] = relative_speed(U, nominal_speed)
        terms[ROW_SYMBOL + 1, lane] = v / U
        terms[ROW_SYMBOL + 2, lane] = state[2, lane] / rate_scale(U, L)
        terms[ROW_SYMBOL + 3, lane] = state[3, lane] / rate_scale(U, L)
    for lane in range(state.shape[1]):
        terms[ROW_SYMBOL + 4, lane] = state[4, lane]
        terms[ROW_SYMBOL + 5, lane] = delta[lane]
    propelled = propeller.J > 0.0
    for lane in range(state.shape[1]):
        g, T, _, _ = loading(terms[ROW_SYMBOL, lane], propeller) if propelled else (0.0, 0.0, 0.0, 0.0)
        terms[ROW_LOADING, lane], terms[ROW_LOADING + 1, lane] = g, T


@njit(**LINKED)
def propeller_constants(hull: np.record) -> PropellerConstants:
    """Constants of the propeller among those of the vessel."""
    return PropellerConstants(hull.J, hull.k_0, hull.k_1, hull.k_2, hull.eta, hull.kappa)


@njit(**LINKED)
def known_forces(state: np.ndarray, scheme: Scheme, work: Work) -> None:
    """Write the prime forces of the rigid body and of its weight, F1, F2, M1, M2, Eq. 5, 7 and 8."""
    hull, terms, speed, force = scheme.hull, work.terms, work.speed, work.force
    m, x_G, z_G = hull.m, hull.x_G, hull.z_G
    L, volume, GM, BM = hull.L, hull.volume, hull.GM, hull.BM
    for lane in range(state.shape[1]):
        v, r, p = terms[ROW_SYMBOL + 1, lane], terms[ROW_SYMBOL + 2, lane], terms[ROW_SYMBOL + 3, lane]
        force[0, lane] = m * (v * r + x_G * r * r - z_G * r * p)
    for lane in range(state.shape[1]):
        centripetal = m * (state[0, lane] / speed[lane]) * terms[ROW_SYMBOL + 2, lane]
        force[1, lane] = -centripetal
        force[2, lane] = -x_G * centripetal
        force[3, lane] = z_G * centripetal
    for lane in range(state.shape[1]):
        sin_phi, cos_phi = sin_cos(state[4, lane])
        GZ = righting_arm(sin_phi, sin_phi / cos_phi, GM, BM)
        force[3, lane] -= righting_moment(GZ, speed[lane], L, volume)


@njit(**LINKED)
def add_hydrodynamic_forces(coefficients: np.ndarray, scheme: Scheme, work: Work) -> None:
    """Add coefficient times term to the force, Eq. 10, four terms of one DOF at a time where there are four."""
    rows, dof, terms, force = scheme.rows, scheme.dof, work.terms, work.force
    n_lanes = force.shape[1]
    k = 0
    while k < rows.size:
        target = dof[k]
        if k + 3 < rows.size and dof[k + 3] == target:
            a, b, c, d = rows[k], rows[k + 1], rows[k + 2], rows[k + 3]
            for lane in range(n_lanes):
                force[target, lane] += (
                    coefficients[k, lane] * terms[a, lane]
                    + coefficients[k + 1, lane] * terms[b, lane]
                    + coefficients[k + 2, lane] * terms[c, lane]
                    + coefficients[k + 3, lane] * terms[d, lane]
                )
            k += 4
        else:
            row = rows[k]
            for lane in range(n_lanes):
                force[target, lane] += coefficients[k, lane] * terms[row, lane]
            k += 1


@njit(**INLINED)
def _rates_of_terms(
    state: np.ndarray, inputs: np.ndarray, coefficients: np.ndarray, scheme: Scheme, work: Work, rate: np.ndarray
) -> None:
    """Write the accelerations by terms and by the known forces, Eq. 4."""
    hull, J_inverse, speed, force = scheme.hull, scheme.J_inverse, work.speed, work.force
    prime_motion(state, inputs[0], scheme, work)
    known_forces(state, scheme, work)
    fill_products(work.terms, scheme.left, scheme.right)
    add_hydrodynamic_forces(coefficients, scheme, work)
    for row in range(4):
        a, b, c, d = J_inverse[row, 0], J_inverse[row, 1], J_inverse[row, 2], J_inverse[row, 3]
        for lane in range(state.shape[1]):
            acceleration = a * force[0, lane] + b * force[1, lane] + c * force[2, lane] + d * force[3, lane]
            rate[row, lane] = acceleration * row_scale(row, speed[lane], hull.L)


@njit(**LINKED)
def run_parts(state: np.ndarray, inputs: np.ndarray, scheme: Scheme, work: Work) -> None:
    """Carry out the program of the parts at states and inputs; its parameters are set."""
    U, turn = scheme.hull.nominal_speed, rate_scale(scheme.hull.nominal_speed, scheme.hull.L)
    for lane in range(state.shape[1]):
        work.parts[0, lane], work.parts[1, lane] = state[0, lane] / U, state[1, lane] / U
        work.parts[2, lane], work.parts[3, lane] = state[2, lane] / turn, state[3, lane] / turn
        work.parts[4, lane], work.parts[5, lane] = state[4, lane], state[5, lane]
    for row in range(inputs.shape[0]):
        for lane in range(state.shape[1]):
            work.parts[6 + row, lane] = inputs[row, lane]
    execute(scheme.program, work.parts)


@njit(**LINKED)
def state_derivative(
    state: np.ndarray, inputs: np.ndarray, coefficients: np.ndarray, scheme: Scheme, work: Work, rate: np.ndarray
) -> None:
    """Time derivative of the states, written to ``rate`` (8, n_lanes); parameters of parts by :func:`set_parts`."""
    speed = work.speed
    if scheme.program.results.size == 0 or scheme.rows.size > 0:
        _rates_of_terms(state, inputs, coefficients, scheme, work, rate)
    else:
        for row in range(4):
            for lane in range(state.shape[1]):
                rate[row, lane] = 0.0
    if scheme.program.results.size > 0:
        run_parts(state, inputs, scheme, work)
        for row in range(4):
            result, scale = scheme.program.results[row], row_scale(row, scheme.hull.nominal_speed, scheme.hull.L)
            for lane in range(state.shape[1]):
                rate[row, lane] += scale * work.parts[result, lane]
    for lane in range(state.shape[1]):
        _, cos_phi = sin_cos(state[4, lane])
        rate[4, lane] = state[3, lane]
        rate[5, lane] = state[2, lane] * cos_phi
        speed[lane] = state[1, lane] * cos_phi
    for lane in range(state.shape[1]):
        sin_psi, cos_psi = sin_cos(state[5, lane])
        rate[6, lane] = state[0, lane] * cos_psi - speed[lane] * sin_psi
        rate[7, lane] = state[0, lane] * sin_psi + speed[lane] * cos_psi


@njit(**PART)
def set_parts(coefficients: np.ndarray, scheme: Scheme, work: Work) -> None:
    """Write the parameters of the parts, which follow those of the terms, to the workspace."""
    if scheme.program.results.size > 0:
        set_parameters(scheme.program, coefficients[scheme.rows.size :], work.parts)


@njit(**KERNEL, forceinline=True)
def workspace(n_lanes: int, scheme: Scheme) -> Work:
    """Workspace of the equations of motion of so many ships; the kernel that inlines it knows their number."""
    terms, parts = np.zeros((scheme.n_rows, n_lanes)), np.zeros((scheme.n_part_rows, n_lanes))
    return Work(terms, np.empty(n_lanes), np.empty((4, n_lanes)), parts)


def scheme(vessel: Vessel) -> Scheme:
    """Scheme of a vessel for :func:`state_derivative`, made once; a force without terms is none."""
    if "scheme" not in vessel.compiled:
        vessel.compiled["scheme"] = _scheme(vessel)
    return vessel.compiled["scheme"]


def _scheme(vessel: Vessel) -> Scheme:
    terms = tuple(c.term for force in vessel.forces.values() for c in force)
    dof = np.concatenate([np.full(len(force), DOFS.index(name)) for name, force in vessel.forces.items()])
    products = plan(terms)
    J_inverse = np.linalg.inv(vessel.inertia_matrix)
    if "roll" not in vessel.dofs:
        J_inverse[3] = 0.0
    program = part_program(vessel)
    return Scheme(
        hull=hull(vessel),
        left=products.left,
        right=products.right,
        rows=products.rows,
        dof=dof.astype(np.int64),
        n_rows=products.n_rows,
        J_inverse=np.ascontiguousarray(J_inverse),
        program=program,
        n_part_rows=program.n_rows,
    )


def hull(vessel: Vessel) -> np.record:
    """Record of :data:`HULL` of a vessel."""
    s = vessel.particulars
    GM, BM = (s.GM, s.BM) if "roll" in vessel.dofs else (0.0, 0.0)
    propeller = PropellerConstants() if vessel.propeller is None else vessel.propeller.constants(s.nominal_speed)
    slowest = -5.0 if LOW_SPEED.name in vessel.parts else 0.01
    values = (s.L, s.nominal_speed, slowest, vessel.m, vessel.x_G, vessel.z_G, s.volume, GM, BM, *propeller)
    return np.array([values], dtype=HULL)[0]
