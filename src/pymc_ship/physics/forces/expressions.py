"""Formulae of forces, written once in Python and noted as programs.

A formula is traced: symbols go in, :class:`Expression` objects come out, and what was done to them is a list of
elementary operations, a :class:`pymc_ship.physics.forces.programs.Program`. No derivative is written by hand, and a new
formula needs no compilation.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from pymc_ship.physics.forces.programs import (
    ABSOLUTE,
    ADD,
    ARC_TANGENT,
    COSINE,
    DIVIDE,
    EXPONENTIAL,
    MULTIPLY,
    MULTIPLY_ADD,
    RAMP,
    ROOT,
    SINE,
    STEP,
    SUBTRACT,
    Program,
    segment_kind,
)

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


class Expression:
    """A quantity of a formula: what arithmetic and the functions of this module do to it is noted on its tape."""

    __slots__ = ("node", "trace")

    def __init__(self, trace: Trace, node: int) -> None:
        self.trace, self.node = trace, node

    def __add__(self, other: Expression | float) -> Expression:
        return self.trace.record(ADD, self, other)

    def __sub__(self, other: Expression | float) -> Expression:
        return self.trace.record(SUBTRACT, self, other)

    def __mul__(self, other: Expression | float) -> Expression:
        return self.trace.record(MULTIPLY, self, other)

    def __truediv__(self, other: Expression | float) -> Expression:
        return self.trace.record(DIVIDE, self, other)

    def __rsub__(self, other: Expression | float) -> Expression:
        return self.trace.record(SUBTRACT, other, self)

    def __rtruediv__(self, other: Expression | float) -> Expression:
        return self.trace.record(DIVIDE, other, self)

    __radd__, __rmul__ = __add__, __mul__

    def __neg__(self) -> Expression:
        return self.trace.record(SUBTRACT, 0.0, self)

    def __pow__(self, exponent: int) -> Expression:
        product = self
        for _ in range(exponent - 1):
            product = product * self
        return product

    def __abs__(self) -> Expression:
        return self.trace.record(ABSOLUTE, self)


def root(x: Expression) -> Expression:
    """Square root; its argument must stay positive."""
    return x.trace.record(ROOT, x)


def exp(x: Expression) -> Expression:
    """Exponential."""
    return x.trace.record(EXPONENTIAL, x)


def sin(x: Expression) -> Expression:
    """Sine of an angle [rad]."""
    return x.trace.record(SINE, x)


def cos(x: Expression) -> Expression:
    """Cosine of an angle [rad]."""
    return x.trace.record(COSINE, x)


def arctan2(y: Expression, x: Expression) -> Expression:
    """Angle of the direction (x, y) [rad]."""
    return y.trace.record(ARC_TANGENT, y, x)


def ramp(x: Expression) -> Expression:
    """The larger of x and 0."""
    return x.trace.record(RAMP, x)


def step(x: Expression) -> Expression:
    """1 where x > 0, 0 elsewhere; its derivative is 0."""
    return x.trace.record(STEP, x)


class Trace:
    """Operations noted while formulae are evaluated on symbols.

    Parameters
    ----------
    inputs : sequence of str
        Names of the quantities that change from instant to instant.
    parameters : sequence of str
        Names of those that do not.
    """

    def __init__(self, inputs: Sequence[str], parameters: Sequence[str]) -> None:
        self._known: dict[tuple[Any, ...], int] = {}
        self._nodes: list[tuple[Any, ...]] = []
        self._moves: list[bool] = []
        self.inputs = {name: Expression(self, self._node(("input", name))) for name in inputs}
        self.parameters = {name: Expression(self, self._node(("parameter", name))) for name in parameters}

    def record(self, operation: int, left: Expression | float, right: Expression | float = 0.0) -> Expression:
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
        if operation == DIVIDE and self._moves[a] and not self._moves[b]:
            return self.record(MULTIPLY, Expression(self, a), self.record(DIVIDE, 1.0, Expression(self, b)))
        if operation == SUBTRACT and self._nodes[b][0] == MULTIPLY:
            still, moving = sorted(self._nodes[b][1:], key=self._moves.__getitem__)
            if not self._moves[still]:
                return Expression(self, a) + -Expression(self, still) * Expression(self, moving)
        if operation in _COMMUTE and a > b:
            a, b = b, a
        return Expression(self, self._node((operation, a, a if unary else b)))

    def constant(self, value: float) -> Expression:
        """Expression of a number."""
        return Expression(self, self._node(("constant", float(value))))

    def _operand(self, side: Expression | float) -> int:
        return side.node if isinstance(side, Expression) else self.constant(side).node

    def _node(self, key: tuple[Any, ...]) -> int:
        if key not in self._known:
            self._known[key] = len(self._nodes)
            self._nodes.append(key)
            made = not isinstance(key[0], str)
            self._moves.append(any(self._moves[node] for node in key[1:]) if made else key[0] == "input")
        return self._known[key]

    def program(self, results: Sequence[Expression | float]) -> Program:
        """Program of what the results need, and no more."""
        wanted = [self._operand(result) for result in results]
        reached = [self._reached([node]) for node in wanted]
        every = sorted(set().union(*reached))
        lowered = self._lowered([node for node in every if not isinstance(self._nodes[node][0], str)], wanted)
        static, moving = ([node for node in lowered if self._moves[node] == moves] for moves in (False, True))
        made = _grouped({node: lowered[node] for node in static}) + _grouped({node: lowered[node] for node in moving})
        operands = {operand for operation in lowered.values() for operand in operation[1:]}
        constants = [node for node in sorted({*operands, *wanted}) if self._nodes[node][0] == "constant"]
        leaves = [expression.node for expression in (*self.inputs.values(), *self.parameters.values())]
        row = {node: k for k, node in enumerate((*leaves, *constants, *made))}
        needed = np.zeros((len(wanted), len(made)), dtype=bool)
        for result, mine in enumerate(reached):
            needed[result] = [node in mine for node in made]
        operations = np.array([lowered[node][0] for node in made], dtype=np.int64)
        left, right, added = (
            np.array([row[lowered[node][side]] for node in made], dtype=np.uint32).reshape(-1) for side in (1, 2, 3)
        )
        return Program(
            operation=operations,
            left=left,
            right=right,
            added=added,
            constants=np.array([self._nodes[node][1] for node in constants], dtype=float),
            results=np.array([row[node] for node in wanted], dtype=np.int64),
            needed=needed,
            n_inputs=len(self.inputs),
            n_parameters=len(self.parameters),
            n_static=len(static),
            segments=_segments(operations, len(static)),
        )

    def _lowered(self, nodes: Sequence[int], wanted: Sequence[int]) -> dict[int, tuple[int, int, int, int]]:
        """Operation, left, right and added node of each operation; sums and products are all left * right + added.

        A product that one sum alone needs is formed with that sum.
        """
        zero, one, minus_one = (self.constant(value).node for value in (0.0, 1.0, -1.0))
        uses = Counter([*wanted, *(operand for node in nodes for operand in self._nodes[node][1:])])
        found: dict[int, tuple[int, int, int, int]] = {}
        for node in nodes:
            kind, a, b = self._nodes[node]
            if kind == ADD:
                found[node] = (ADD, a, one, b)
                for product, other in ((a, b), (b, a)):
                    alike = uses[product] == 1 and self._moves[product] == self._moves[node]
                    if alike and found.get(product, (None,))[0] == MULTIPLY:
                        found[node] = (MULTIPLY_ADD, *found.pop(product)[1:3], other)
                        break
            else:
                found[node] = (kind, b, minus_one, a) if kind == SUBTRACT else (kind, a, b, zero)
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


def _grouped(operations: Mapping[int, tuple[int, int, int, int]]) -> list[int]:
    """Nodes in an order in which operands come first and operations of one kind stand together.

    Those that can be formed at the same time come before those that need them, so that no operation waits for the one
    before it.
    """
    waiting, found, done = list(operations), [], set()

    def ready(node: int) -> bool:
        return all(operand in done or operand not in operations for operand in operations[node][1:])

    while waiting:
        kinds = [segment_kind(operations[node][0]) for node in waiting if ready(node)]
        kind = max(dict.fromkeys(kinds), key=kinds.count)
        taken = [node for node in waiting if segment_kind(operations[node][0]) == kind and ready(node)]
        found += taken
        done.update(taken)
        waiting = [node for node in waiting if node not in done]
    return found


def _segments(operations: np.ndarray, n_static: int) -> np.ndarray:
    """Kind, begin and end of stretches of one kind; the static operations end one."""
    kinds = [segment_kind(operation) for operation in operations.tolist()]
    cuts = [0, *(k for k in range(1, len(kinds)) if kinds[k] != kinds[k - 1] or k == n_static)]
    ends = [*cuts[1:], len(kinds)]
    rows = [(kinds[begin], begin, end) for begin, end in zip(cuts, ends, strict=True) if end > begin]
    return np.array(rows, dtype=np.int64).reshape(-1, 3)
