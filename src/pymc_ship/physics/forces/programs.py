"""Programs of elementary operations, evaluated by :func:`execute` and differentiated by :func:`sweep`.

Reverse mode of automatic differentiation: Griewank & Walther (2008), doi:10.1137/1.9780898717761.
"""

import math
from typing import Any, NamedTuple

import numpy as np
from numba import njit

KERNEL: dict[str, Any] = {"cache": True, "nogil": True, "error_model": "numpy", "no_cfunc_wrapper": True}
"""Compiler settings of the kernels; without numpy's error model no loop with a division vectorises.

No kernel is called from C: its wrapper would be another copy to compile.
"""

PART: dict[str, Any] = KERNEL | {"_nrt": False}
"""The same for a function that makes no array: counting references to its arguments would double the time of a step."""

ADD, SUBTRACT, MULTIPLY, DIVIDE = 0, 1, 2, 3
ROOT, EXPONENTIAL, SINE, COSINE = 4, 5, 6, 7
ARC_TANGENT, ABSOLUTE, RAMP, STEP = 8, 9, 10, 11
MULTIPLY_ADD = 12
"""Elementary operations; ``RAMP`` is max(x, 0), ``STEP`` 1 where x > 0 and 0 elsewhere, ``MULTIPLY_ADD`` a b + c."""


def segment_kind(operation: int) -> int:
    """Kind of the segment of an operation; sums and products are of one kind, left * right + added."""
    return MULTIPLY_ADD if operation in (ADD, SUBTRACT, MULTIPLY, MULTIPLY_ADD) else operation


class Program(NamedTuple):
    """Operations on the rows of a workspace (n_rows, n_lanes): inputs, parameters, constants, results of operations."""

    operation: np.ndarray  # (n_operations,), as left, right and added: left * right + added for sums and products
    left: np.ndarray
    right: np.ndarray
    added: np.ndarray
    constants: np.ndarray
    results: np.ndarray  # (n_results,); rows of the output
    needed: np.ndarray  # (n_results, n_operations); operations that each result depends on
    n_inputs: int
    n_parameters: int
    n_static: int  # first operations, which depend on parameters and constants only
    segments: np.ndarray  # (n_segments, 3); kind, begin and end of consecutive operations of a :func:`segment_kind`

    @property
    def n_rows(self) -> int:
        """Rows of the workspace."""
        return self.n_inputs + self.n_parameters + self.constants.size + self.operation.size


@njit(**PART | {"fastmath": {"contract", "arcp", "nsz"}}, forceinline=True)
def sin_cos(angle: float) -> tuple[float, float]:
    """Sine and cosine by the kernels of fdlibm after a three-part reduction; error at most 2 ulp."""
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


@njit(**PART | {"fastmath": {"contract", "arcp", "nsz"}}, forceinline=True)
def exponential(x: float) -> float:
    """Exponential by the kernel of Cephes after a two-part reduction; error at most 2 ulp; clipped beyond +-708."""
    x = -708.0 if x < -708.0 else (708.0 if x > 708.0 else x)
    k = np.rint(x * 1.4426950408889634)
    r = (x - k * 6.93145751953125e-1) - k * 1.42860682030941723212e-6
    z = r * r
    p = r * ((1.26177193074810590878e-4 * z + 3.02994407707441961300e-2) * z + 1.0)
    q = ((3.00198505138664455042e-6 * z + 2.52448340349684104192e-3) * z + 2.27265548208155028766e-1) * z + 2.0
    power = np.int64((np.int64(np.int32(k)) + 1023) << 52).view(np.float64)
    return (1.0 + 2.0 * p / (q - p)) * power


@njit(**PART | {"fastmath": {"contract", "arcp"}}, forceinline=True)
def arc_tangent(y: float, x: float) -> float:
    """Angle of the direction (x, y) by the kernel of Cephes; error at most 3 ulp."""
    across, along = abs(y), abs(x)
    small, large = min(across, along), max(across, along)
    steep = small > 0.41421356237309503 * large
    below = small + large if steep else large
    q = (small - large if steep else small) / (below if below > 0.0 else 1.0)
    z = q * q
    p = -1.228866684490136173410e2 + z * (-7.500855792314704667340e1 + z * -1.615753718733365076637e1)
    p = -6.485021904942025371773e1 + z * (p + z * z * z * -8.750608600031904122785e-1)
    s = 4.328810604912902668951e2 + z * (1.650270098316988542046e2 + z * (2.485846490142306297962e1 + z))
    s = 1.945506571482613964425e2 + z * (4.853903996359136964868e2 + z * s)
    angle = q + q * (z * p / s)
    angle = angle + 0.25 * math.pi if steep else angle
    angle = 0.5 * math.pi - angle if across > along else angle
    angle = math.pi - angle if x < 0.0 else angle
    return math.copysign(angle, y)


@njit(**PART)
def set_parameters(program: Program, parameters: np.ndarray, work: np.ndarray) -> None:
    """Write parameters (n_parameters, n_lanes), constants and static operations to a workspace."""
    n_lanes = work.shape[1]
    for j in range(program.n_parameters):
        for lane in range(n_lanes):
            work[program.n_inputs + j, lane] = parameters[j, lane]
    first = program.n_inputs + program.n_parameters
    for k in range(program.constants.size):
        for lane in range(n_lanes):
            work[first + k, lane] = program.constants[k]
    _execute_range(program, work, 0, program.n_static)


@njit(**PART, forceinline=True)
def execute(program: Program, work: np.ndarray) -> None:
    """Evaluate a program on a workspace with inputs, after :func:`set_parameters`."""
    _execute_range(program, work, program.n_static, program.operation.size)


@njit(**PART, forceinline=True)
def _execute_row(kind: int, work: np.ndarray, a: int, b: int, target: int) -> None:  # noqa: C901, one branch for each operation
    n_lanes = work.shape[1]
    if kind == DIVIDE:
        for lane in range(n_lanes):
            work[target, lane] = work[a, lane] / work[b, lane]
    elif kind == ROOT:
        for lane in range(n_lanes):
            work[target, lane] = math.sqrt(work[a, lane])
    elif kind == ABSOLUTE:
        for lane in range(n_lanes):
            work[target, lane] = abs(work[a, lane])
    elif kind == RAMP:
        for lane in range(n_lanes):
            work[target, lane] = max(work[a, lane], 0.0)
    elif kind == STEP:
        for lane in range(n_lanes):
            work[target, lane] = 1.0 if work[a, lane] > 0.0 else 0.0
    elif kind == SINE:
        for lane in range(n_lanes):
            work[target, lane] = sin_cos(work[a, lane])[0]
    elif kind == COSINE:
        for lane in range(n_lanes):
            work[target, lane] = sin_cos(work[a, lane])[1]
    elif kind == EXPONENTIAL:
        for lane in range(n_lanes):
            work[target, lane] = exponential(work[a, lane])
    else:
        for lane in range(n_lanes):
            work[target, lane] = arc_tangent(work[a, lane], work[b, lane])


@njit(**PART, forceinline=True)
def _execute_range(program: Program, work: np.ndarray, begin: int, end: int) -> None:
    segments, left, right, added = program.segments, program.left, program.right, program.added
    n_lanes, first = work.shape[1], work.shape[0] - program.operation.size
    for segment in range(segments.shape[0]):
        kind, start, stop = segments[segment, 0], segments[segment, 1], segments[segment, 2]
        if start < begin or start >= end:
            continue
        if kind == MULTIPLY_ADD and n_lanes == 1:
            for k in range(start, stop):
                work[np.uint32(first + k), 0] = work[left[k], 0] * work[right[k], 0] + work[added[k], 0]
        elif kind == MULTIPLY_ADD:
            for k in range(start, stop):
                a, b, c, target = left[k], right[k], added[k], np.uint32(first + k)
                for lane in range(n_lanes):
                    work[target, lane] = work[a, lane] * work[b, lane] + work[c, lane]
        else:
            for k in range(start, stop):
                _execute_row(kind, work, left[k], right[k], first + k)


@njit(**PART)
def sweep(program: Program, work: np.ndarray, result: int, slope: np.ndarray) -> None:  # noqa: C901, one branch for each operation
    """Derivatives of one result by every row, after :func:`execute`, into ``slope`` (n_rows, n_lanes)."""
    operation, left, right, added = program.operation, program.left, program.right, program.added
    n_lanes, first = work.shape[1], work.shape[0] - operation.size
    slope[:] = 0.0
    slope[program.results[result]] = 1.0
    for k in range(operation.size - 1, -1, -1):
        if not program.needed[result, k]:
            continue
        kind, a, b, target = operation[k], left[k], right[k], first + k
        if kind in (MULTIPLY, MULTIPLY_ADD):
            for lane in range(n_lanes):
                change = slope[target, lane]
                slope[a, lane] += work[b, lane] * change
                slope[b, lane] += work[a, lane] * change
            if kind == MULTIPLY_ADD:
                for lane in range(n_lanes):
                    slope[added[k], lane] += slope[target, lane]
        elif kind in (ADD, SUBTRACT):
            sign = 1.0 if kind == ADD else -1.0
            for lane in range(n_lanes):
                slope[a, lane] += sign * slope[target, lane]
                slope[added[k], lane] += slope[target, lane]
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
