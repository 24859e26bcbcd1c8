"""Programs: elementary operations on rows of a workspace, carried out and differentiated by two kernels.

:func:`run` carries a program out, one lane for each instant or ship; :func:`sweep` goes through it backwards and gives
the derivatives of one result by every state, input and parameter at once (reverse mode of automatic differentiation,
Griewank & Walther 2008, doi:10.1137/1.9780898717761).
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numba import njit

_SETTINGS = {"cache": True, "nogil": True, "error_model": "numpy", "_nrt": False}

ADD = 0
SUBTRACT = 1
MULTIPLY = 2
DIVIDE = 3
ROOT = 4
EXPONENTIAL = 5
SINE = 6
COSINE = 7
ARC_TANGENT = 8
ABSOLUTE = 9
RAMP = 10
STEP = 11
"""Elementary operations; ``RAMP`` is max(x, 0) and ``STEP`` 1 where x > 0 and 0 elsewhere."""


class Program(NamedTuple):
    """Operations on the rows of a workspace of shape (n_rows, n_lanes).

    Rows are the inputs, the parameters, the constants and the results of the operations, in this order. ``operation``,
    ``left``, ``right`` (n_operations,) say what makes each result; the first ``n_static`` depend on parameters and
    constants alone. ``results`` (n_results,) are the rows asked for and ``needed`` (n_results, n_operations) whether
    each of them depends on an operation. ``segments`` (n_segments, 3) are kind, begin and end of operations of
    one kind, one after the other, so that a processor foresees what comes next.
    """

    operation: np.ndarray
    left: np.ndarray
    right: np.ndarray
    constants: np.ndarray
    results: np.ndarray
    needed: np.ndarray
    n_inputs: int
    n_parameters: int
    n_static: int
    segments: np.ndarray

    @property
    def n_rows(self) -> int:
        """Rows of the workspace."""
        return self.n_inputs + self.n_parameters + self.constants.size + self.operation.size


@njit(**_SETTINGS | {"fastmath": {"contract", "arcp", "nsz"}}, forceinline=True)
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


@njit(**_SETTINGS)
def set_parameters(program, parameters, work):
    """Write parameters (n_parameters, n_lanes) and constants to a workspace, and what depends on them alone."""
    n_lanes = work.shape[1]
    for j in range(program.n_parameters):
        for lane in range(n_lanes):
            work[program.n_inputs + j, lane] = parameters[j, lane]
    first = program.n_inputs + program.n_parameters
    for k in range(program.constants.size):
        for lane in range(n_lanes):
            work[first + k, lane] = program.constants[k]
    _carry_out(program, work, 0, program.n_static)


@njit(**_SETTINGS, forceinline=True)
def run(program, work):
    """Carry out a program on a workspace whose inputs are set, after :func:`set_parameters`."""
    _carry_out(program, work, program.n_static, program.operation.size)


@njit(**_SETTINGS, forceinline=True)
def _carry_out(program, work, begin, end):  # noqa: C901, one branch for each operation
    segments, left, right = program.segments, program.left, program.right
    n_lanes, first = work.shape[1], work.shape[0] - program.operation.size
    for segment in range(segments.shape[0]):
        kind, start, stop = segments[segment, 0], segments[segment, 1], segments[segment, 2]
        if start < begin or start >= end:
            continue
        if kind == MULTIPLY:
            for k in range(start, stop):
                a, b, target = left[k], right[k], first + k
                for lane in range(n_lanes):
                    work[target, lane] = work[a, lane] * work[b, lane]
        elif kind == ADD:
            for k in range(start, stop):
                a, b, target = left[k], right[k], first + k
                for lane in range(n_lanes):
                    work[target, lane] = work[a, lane] + work[b, lane]
        elif kind == SUBTRACT:
            for k in range(start, stop):
                a, b, target = left[k], right[k], first + k
                for lane in range(n_lanes):
                    work[target, lane] = work[a, lane] - work[b, lane]
        elif kind == DIVIDE:
            for k in range(start, stop):
                a, b, target = left[k], right[k], first + k
                for lane in range(n_lanes):
                    work[target, lane] = work[a, lane] / work[b, lane]
        elif kind == ROOT:
            for k in range(start, stop):
                a, b, target = left[k], right[k], first + k
                for lane in range(n_lanes):
                    work[target, lane] = math.sqrt(work[a, lane])
        elif kind == ABSOLUTE:
            for k in range(start, stop):
                a, b, target = left[k], right[k], first + k
                for lane in range(n_lanes):
                    work[target, lane] = abs(work[a, lane])
        elif kind == RAMP:
            for k in range(start, stop):
                a, b, target = left[k], right[k], first + k
                for lane in range(n_lanes):
                    work[target, lane] = max(work[a, lane], 0.0)
        elif kind == STEP:
            for k in range(start, stop):
                a, b, target = left[k], right[k], first + k
                for lane in range(n_lanes):
                    work[target, lane] = 1.0 if work[a, lane] > 0.0 else 0.0
        elif kind == SINE:
            for k in range(start, stop):
                a, b, target = left[k], right[k], first + k
                for lane in range(n_lanes):
                    work[target, lane] = sin_cos(work[a, lane])[0]
        elif kind == COSINE:
            for k in range(start, stop):
                a, b, target = left[k], right[k], first + k
                for lane in range(n_lanes):
                    work[target, lane] = sin_cos(work[a, lane])[1]
        elif kind == EXPONENTIAL:
            for k in range(start, stop):
                a, b, target = left[k], right[k], first + k
                for lane in range(n_lanes):
                    work[target, lane] = math.exp(work[a, lane])
        else:
            for k in range(start, stop):
                a, b, target = left[k], right[k], first + k
                for lane in range(n_lanes):
                    work[target, lane] = math.atan2(work[a, lane], work[b, lane])


@njit(**_SETTINGS)
def sweep(program, work, result, slope):  # noqa: C901, one branch for each operation
    """Derivatives of one result by every row, after :func:`run`, written to ``slope`` (n_rows, n_lanes)."""
    operation, left, right, needed = program.operation, program.left, program.right, program.needed
    n_lanes, first = work.shape[1], work.shape[0] - operation.size
    for row in range(slope.shape[0]):
        for lane in range(n_lanes):
            slope[row, lane] = 0.0
    for lane in range(n_lanes):
        slope[program.results[result], lane] = 1.0
    for k in range(operation.size - 1, -1, -1):
        if not needed[result, k]:
            continue
        kind, a, b, target = operation[k], left[k], right[k], first + k
        if kind == MULTIPLY:
            for lane in range(n_lanes):
                change = slope[target, lane]
                slope[a, lane] += work[b, lane] * change
                slope[b, lane] += work[a, lane] * change
        elif kind == ADD:
            for lane in range(n_lanes):
                slope[a, lane] += slope[target, lane]
                slope[b, lane] += slope[target, lane]
        elif kind == SUBTRACT:
            for lane in range(n_lanes):
                slope[a, lane] += slope[target, lane]
                slope[b, lane] -= slope[target, lane]
        elif kind == DIVIDE:
            for lane in range(n_lanes):
                change = slope[target, lane] / work[b, lane]
                slope[a, lane] += change
                slope[b, lane] -= work[target, lane] * change
        elif kind == ROOT:
            for lane in range(n_lanes):
                slope[a, lane] += 0.5 * slope[target, lane] / work[target, lane]
        elif kind == ABSOLUTE:
            for lane in range(n_lanes):
                x = work[a, lane]
                slope[a, lane] += slope[target, lane] * (1.0 if x > 0.0 else (-1.0 if x < 0.0 else 0.0))
        elif kind == RAMP:
            for lane in range(n_lanes):
                slope[a, lane] += slope[target, lane] if work[a, lane] > 0.0 else 0.0
        elif kind == SINE:
            for lane in range(n_lanes):
                slope[a, lane] += slope[target, lane] * sin_cos(work[a, lane])[1]
        elif kind == COSINE:
            for lane in range(n_lanes):
                slope[a, lane] -= slope[target, lane] * sin_cos(work[a, lane])[0]
        elif kind == EXPONENTIAL:
            for lane in range(n_lanes):
                slope[a, lane] += slope[target, lane] * work[target, lane]
        elif kind == ARC_TANGENT:
            for lane in range(n_lanes):
                y, x = work[a, lane], work[b, lane]
                change = slope[target, lane] / (x * x + y * y)
                slope[a, lane] += x * change
                slope[b, lane] -= y * change
