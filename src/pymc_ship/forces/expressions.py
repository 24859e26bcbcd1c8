"""Formulae of forces as programs: written once in Python, then evaluated and differentiated by two small kernels.

A formula is traced: symbols go in, :class:`Expression` objects come out, and what was done to them is a list of
elementary operations on rows of a workspace, one lane for each instant or ship. :func:`run` carries the list out;
:func:`sweep` goes through it backwards and gives the derivatives of one result by every state, input and parameter at
once (reverse mode of automatic differentiation, Griewank & Walther 2008, doi:10.1137/1.9780898717761). No derivative is
written by hand, and a new formula needs no compilation.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numba import njit

_SETTINGS = {"cache": True, "nogil": True, "error_model": "numpy", "_nrt": False}

ADD, SUBTRACT, MULTIPLY, DIVIDE, ROOT, EXPONENTIAL, SINE, COSINE, ARC_TANGENT, ABSOLUTE, RAMP, STEP = range(12)
"""Elementary operations; ``RAMP`` is max(x, 0) and ``STEP`` 1 where x > 0 and 0 elsewhere."""

_VALUES = {
    ADD: lambda a, b: a + b,
    SUBTRACT: lambda a, b: a - b,
    MULTIPLY: lambda a, b: a * b,
    DIVIDE: lambda a, b: a / b,
    ROOT: lambda a, _: math.sqrt(a),
    EXPONENTIAL: lambda a, _: math.exp(a),
    SINE: lambda a, _: math.sin(a),
    COSINE: lambda a, _: math.cos(a),
    ARC_TANGENT: lambda a, b: math.atan2(a, b),
    ABSOLUTE: lambda a, _: abs(a),
    RAMP: lambda a, _: max(a, 0.0),
    STEP: lambda a, _: float(a > 0.0),
}
_COMMUTE = (ADD, MULTIPLY)


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


class Expression:
    """A quantity of a formula: what arithmetic and the functions of this module do to it is noted on its tape."""

    __slots__ = ("node", "tape")

    def __init__(self, tape: Tape, node: int) -> None:
        self.tape, self.node = tape, node

    def __add__(self, other):
        return self.tape.noted(ADD, self, other)

    def __sub__(self, other):
        return self.tape.noted(SUBTRACT, self, other)

    def __mul__(self, other):
        return self.tape.noted(MULTIPLY, self, other)

    def __truediv__(self, other):
        return self.tape.noted(DIVIDE, self, other)

    def __rsub__(self, other):
        return self.tape.noted(SUBTRACT, other, self)

    def __rtruediv__(self, other):
        return self.tape.noted(DIVIDE, other, self)

    __radd__, __rmul__ = __add__, __mul__

    def __neg__(self):
        return self.tape.noted(SUBTRACT, 0.0, self)

    def __pow__(self, exponent: int):
        product = self
        for _ in range(exponent - 1):
            product = product * self
        return product

    def __abs__(self):
        return self.tape.noted(ABSOLUTE, self)


def root(x: Expression) -> Expression:
    """Square root; its argument must stay positive."""
    return x.tape.noted(ROOT, x)


def exp(x: Expression) -> Expression:
    """Exponential."""
    return x.tape.noted(EXPONENTIAL, x)


def sin(x: Expression) -> Expression:
    """Sine of an angle [rad]."""
    return x.tape.noted(SINE, x)


def cos(x: Expression) -> Expression:
    """Cosine of an angle [rad]."""
    return x.tape.noted(COSINE, x)


def arctan2(y: Expression, x: Expression) -> Expression:
    """Angle of the direction (x, y) [rad]."""
    return y.tape.noted(ARC_TANGENT, y, x)


def ramp(x: Expression) -> Expression:
    """The larger of x and 0."""
    return x.tape.noted(RAMP, x)


def step(x: Expression) -> Expression:
    """1 where x > 0, 0 elsewhere; its derivative is 0."""
    return x.tape.noted(STEP, x)


class Tape:
    """Operations noted while formulae are evaluated on symbols.

    Parameters
    ----------
    inputs : sequence of str
        Names of the quantities that change from instant to instant.
    parameters : sequence of str
        Names of those that do not.
    """

    def __init__(self, inputs: Sequence[str], parameters: Sequence[str]) -> None:
        self._known: dict[tuple, int] = {}
        self._nodes: list[tuple] = []
        self.inputs = {name: Expression(self, self._node(("input", name))) for name in inputs}
        self.parameters = {name: Expression(self, self._node(("parameter", name))) for name in parameters}

    def noted(self, operation: int, left: Expression | float, right: Expression | float = 0.0) -> Expression:
        """Result of an operation, noted once however often it is asked for."""
        a, b = (self._operand(side) for side in (left, right))
        values = [self._nodes[node][1] if self._nodes[node][0] == "constant" else None for node in (a, b)]
        unary = operation in (ROOT, EXPONENTIAL, SINE, COSINE, ABSOLUTE, RAMP, STEP)
        if values[0] is not None and (unary or values[1] is not None):
            return self.constant(_VALUES[operation](values[0], values[1]))
        if operation == MULTIPLY and 0.0 in values:
            return self.constant(0.0)
        if (operation == ADD and values[0] == 0.0) or (operation == MULTIPLY and values[0] == 1.0):
            return Expression(self, b)
        neutral = {ADD: 0.0, SUBTRACT: 0.0, MULTIPLY: 1.0, DIVIDE: 1.0}
        if values[1] is not None and values[1] == neutral.get(operation):
            return Expression(self, a)
        if operation in _COMMUTE and a > b:
            a, b = b, a
        return Expression(self, self._node((operation, a, a if unary else b)))

    def constant(self, value: float) -> Expression:
        """Expression of a number."""
        return Expression(self, self._node(("constant", float(value))))

    def _operand(self, side: Expression | float) -> int:
        return side.node if isinstance(side, Expression) else self.constant(side).node

    def _node(self, key: tuple) -> int:
        if key not in self._known:
            self._known[key] = len(self._nodes)
            self._nodes.append(key)
        return self._known[key]

    def program(self, results: Sequence[Expression | float]) -> Program:
        """Program of what the results need, and no more."""
        wanted = [self._operand(result) for result in results]
        reached = [self._reached([node]) for node in wanted]
        every = sorted(set().union(*reached))
        is_static: dict[int, bool] = {}
        for node in every:
            kind = self._nodes[node][0]
            is_static[node] = (
                kind != "input"
                if isinstance(kind, str)
                else all(is_static[operand] for operand in self._nodes[node][1:])
            )
        constants = [node for node in every if self._nodes[node][0] == "constant"]
        made = [node for node in every if not isinstance(self._nodes[node][0], str)]
        static = [node for node in made if is_static[node]]
        moving = [node for node in made if not is_static[node]]
        made = self._grouped(static) + self._grouped(moving)
        leaves = [expression.node for expression in (*self.inputs.values(), *self.parameters.values())]
        row = {node: k for k, node in enumerate((*leaves, *constants, *made))}
        needed = np.zeros((len(wanted), len(made)), dtype=bool)
        for result, mine in enumerate(reached):
            needed[result] = [node in mine for node in made]
        operations = np.array([self._nodes[node][0] for node in made], dtype=np.int64)
        left, right = (
            np.array([row[self._nodes[node][side]] for node in made], dtype=np.int64).reshape(-1) for side in (1, 2)
        )
        return Program(
            operation=operations,
            left=left,
            right=right,
            constants=np.array([self._nodes[node][1] for node in constants], dtype=float),
            results=np.array([row[node] for node in wanted], dtype=np.int64),
            needed=needed,
            n_inputs=len(self.inputs),
            n_parameters=len(self.parameters),
            n_static=len(static),
            segments=_segments(operations, len(static)),
        )

    def _grouped(self, nodes: Sequence[int]) -> list[int]:
        """Nodes in an order in which operands come first and operations of one kind stand together."""
        waiting, found = list(nodes), []
        inside, done = set(nodes), set()

        def ready(node: int) -> bool:
            return all(operand in done or operand not in inside for operand in self._nodes[node][1:])

        while waiting:
            kinds = [self._nodes[node][0] for node in waiting if ready(node)]
            kind = max(dict.fromkeys(kinds), key=kinds.count)
            rest = []
            for node in waiting:
                if self._nodes[node][0] == kind and ready(node):
                    found.append(node)
                    done.add(node)
                else:
                    rest.append(node)
            waiting = rest
        return found

    def _reached(self, begin: Sequence[int]) -> set[int]:
        """Nodes that some nodes depend on, themselves included."""
        found, waiting = set(), list(begin)
        while waiting:
            node = waiting.pop()
            if node not in found:
                found.add(node)
                waiting += [] if isinstance(self._nodes[node][0], str) else self._nodes[node][1:]
        return found


def _segments(operations: np.ndarray, n_static: int) -> np.ndarray:
    """Kind, begin and end of stretches of one kind; the static operations end one."""
    cuts = [0, *(k for k in range(1, operations.size) if operations[k] != operations[k - 1] or k == n_static)]
    ends = [*cuts[1:], operations.size]
    rows = [(operations[begin], begin, end) for begin, end in zip(cuts, ends, strict=True) if end > begin]
    return np.array(rows, dtype=np.int64).reshape(-1, 3)


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
