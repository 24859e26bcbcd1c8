"""Formulae of forces in Python: called with :class:`Expression` symbols, their operations become a program.

Derivatives need no code then, and formulae no compilation (:mod:`pymc_ship.physics.forces.programs`).
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np

from pymc_ship.physics.forces import programs as op
from pymc_ship.physics.forces.programs import Program, segment_kind

_VALUES = {
    op.ADD: lambda a, b: a + b,
    op.SUBTRACT: lambda a, b: a - b,
    op.MULTIPLY: lambda a, b: a * b,
    op.DIVIDE: lambda a, b: a / b,
    op.ROOT: lambda a, _: math.sqrt(a),
    op.EXPONENTIAL: lambda a, _: math.exp(a),
    op.SINE: lambda a, _: math.sin(a),
    op.COSINE: lambda a, _: math.cos(a),
    op.ARC_TANGENT: lambda a, b: math.atan2(a, b),
    op.ABSOLUTE: lambda a, _: abs(a),
    op.RAMP: lambda a, _: max(a, 0.0),
    op.STEP: lambda a, _: float(a > 0.0),
}
_COMMUTE = (op.ADD, op.MULTIPLY)


def _unary(operation: int) -> Callable[[Expression], Expression]:
    return lambda x: x.trace.record(operation, x)


def _binary(operation: int) -> Callable[[Expression, Expression | float], Expression]:
    return lambda left, right: left.trace.record(operation, left, right)


def _reflected_binary(operation: int) -> Callable[[Expression, Expression | float], Expression]:
    return lambda right, left: right.trace.record(operation, left, right)


class Expression:
    """A symbolic quantity; arithmetic and the functions of this module are recorded in its trace."""

    __slots__ = ("node", "trace")

    def __init__(self, trace: Trace, node: int) -> None:
        self.trace, self.node = trace, node

    __add__ = __radd__ = _binary(op.ADD)
    __mul__ = __rmul__ = _binary(op.MULTIPLY)
    __sub__, __rsub__ = _binary(op.SUBTRACT), _reflected_binary(op.SUBTRACT)
    __truediv__, __rtruediv__ = _binary(op.DIVIDE), _reflected_binary(op.DIVIDE)
    __abs__ = _unary(op.ABSOLUTE)

    def __neg__(self) -> Expression:
        return self.trace.record(op.SUBTRACT, 0.0, self)

    def __pow__(self, exponent: int) -> Expression:
        product = self
        for _ in range(exponent - 1):
            product = product * self
        return product


root, exp = _unary(op.ROOT), _unary(op.EXPONENTIAL)
sin, cos = _unary(op.SINE), _unary(op.COSINE)
ramp, step = _unary(op.RAMP), _unary(op.STEP)
"""Square root of a positive x, exponential, sine and cosine of x [rad], the larger of x and 0, 1 where x > 0 else 0."""


def arctan2(y: Expression, x: Expression) -> Expression:
    """Angle of the direction (x, y) [rad]."""
    return y.trace.record(op.ARC_TANGENT, y, x)


class Trace:
    """Operations of formulae on symbols: named ``inputs``, which vary in time, and constant ``parameters``."""

    def __init__(self, inputs: Sequence[str], parameters: Sequence[str]) -> None:
        self._known: dict[tuple[Any, ...], int] = {}
        self._nodes: list[tuple[Any, ...]] = []
        self._moves: list[bool] = []
        self.inputs = {name: Expression(self, self._node(("input", name))) for name in inputs}
        self.parameters = {name: Expression(self, self._node(("parameter", name))) for name in parameters}

    def record(self, operation: int, left: Expression | float, right: Expression | float = 0.0) -> Expression:
        """Result of an operation; equal operations are recorded once, constants are folded."""
        a, b = (self._operand(side) for side in (left, right))
        values = [self._nodes[node][1] if self._nodes[node][0] == "constant" else None for node in (a, b)]
        unary = operation in (op.ROOT, op.EXPONENTIAL, op.SINE, op.COSINE, op.ABSOLUTE, op.RAMP, op.STEP)
        if values[0] is not None and (unary or values[1] is not None):
            return self.constant(_VALUES[operation](values[0], values[1]))
        if operation == op.MULTIPLY and 0.0 in values:
            return self.constant(0.0)
        if (operation == op.ADD and values[0] == 0.0) or (operation == op.MULTIPLY and values[0] == 1.0):
            return Expression(self, b)
        neutral = {op.ADD: 0.0, op.SUBTRACT: 0.0, op.MULTIPLY: 1.0, op.DIVIDE: 1.0}
        if values[1] is not None and values[1] == neutral.get(operation):
            return Expression(self, a)
        if operation == op.DIVIDE and self._moves[a] and not self._moves[b]:
            return self.record(op.MULTIPLY, Expression(self, a), self.record(op.DIVIDE, 1.0, Expression(self, b)))
        if operation == op.SUBTRACT and self._nodes[b][0] == op.MULTIPLY:
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
            is_operation = not isinstance(key[0], str)
            self._moves.append(any(self._moves[node] for node in key[1:]) if is_operation else key[0] == "input")
        return self._known[key]

    def program(self, results: Sequence[Expression | float]) -> Program:
        """Program of the operations that the results depend on."""
        outputs = [self._operand(result) for result in results]
        dependencies = [self._dependencies([node]) for node in outputs]
        every = sorted(set().union(*dependencies))
        operations = [node for node in every if not isinstance(self._nodes[node][0], str)]
        lowered = self._multiply_add_form(operations, outputs)
        static = _schedule({node: row for node, row in lowered.items() if not self._moves[node]})
        order = static + _schedule({node: row for node, row in lowered.items() if self._moves[node]})
        operands = {operand for operation in lowered.values() for operand in operation[1:]}
        constants = [node for node in sorted({*operands, *outputs}) if self._nodes[node][0] == "constant"]
        leaves = [expression.node for expression in (*self.inputs.values(), *self.parameters.values())]
        row = {node: k for k, node in enumerate((*leaves, *constants, *order))}
        needed = np.array([[node in nodes for node in order] for nodes in dependencies], dtype=bool)
        kinds = np.array([lowered[node][0] for node in order], dtype=np.int64)
        left, right, added = (
            np.array([row[lowered[node][side]] for node in order], dtype=np.uint32).reshape(-1) for side in (1, 2, 3)
        )
        return Program(
            operation=kinds,
            left=left,
            right=right,
            added=added,
            constants=np.array([self._nodes[node][1] for node in constants], dtype=float),
            results=np.array([row[node] for node in outputs], dtype=np.int64),
            needed=needed.reshape(len(outputs), len(order)),
            n_inputs=len(self.inputs),
            n_parameters=len(self.parameters),
            n_static=len(static),
            segments=_segments(kinds, len(static)),
        )

    def _multiply_add_form(self, nodes: Sequence[int], outputs: Sequence[int]) -> dict[int, tuple[int, int, int, int]]:
        """Operation, left, right and added by node; a product with one use, in a sum, is merged with that sum."""
        zero, one, minus_one = (self.constant(value).node for value in (0.0, 1.0, -1.0))
        uses = Counter([*outputs, *(operand for node in nodes for operand in self._nodes[node][1:])])
        lowered: dict[int, tuple[int, int, int, int]] = {}
        for node in nodes:
            kind, a, b = self._nodes[node]
            if kind == op.ADD:
                lowered[node] = (op.ADD, a, one, b)
                for product, other in ((a, b), (b, a)):
                    mergeable = uses[product] == 1 and self._moves[product] == self._moves[node]
                    if mergeable and lowered.get(product, (None,))[0] == op.MULTIPLY:
                        lowered[node] = (op.MULTIPLY_ADD, *lowered.pop(product)[1:3], other)
                        break
            else:
                lowered[node] = (kind, b, minus_one, a) if kind == op.SUBTRACT else (kind, a, b, zero)
        return lowered

    def _dependencies(self, begin: Sequence[int]) -> set[int]:
        nodes, waiting = set(), list(begin)
        while waiting:
            node = waiting.pop()
            if node not in nodes:
                nodes.add(node)
                waiting += [] if isinstance(self._nodes[node][0], str) else self._nodes[node][1:]
        return nodes


def _schedule(operations: Mapping[int, tuple[int, int, int, int]]) -> list[int]:
    """Topological order of the nodes, with operations of one kind in segments."""
    waiting, order, done = list(operations), [], set()

    def ready(node: int) -> bool:
        return all(operand in done or operand not in operations for operand in operations[node][1:])

    while waiting:
        kinds = [segment_kind(operations[node][0]) for node in waiting if ready(node)]
        kind = max(dict.fromkeys(kinds), key=kinds.count)
        segment = [node for node in waiting if segment_kind(operations[node][0]) == kind and ready(node)]
        order += segment
        done.update(segment)
        waiting = [node for node in waiting if node not in done]
    return order


def _segments(operations: np.ndarray, n_static: int) -> np.ndarray:
    """Kind, begin and end of segments of one kind; a segment ends with the static operations."""
    kinds = [segment_kind(operation) for operation in operations.tolist()]
    cuts = [0, *(k for k in range(1, len(kinds)) if kinds[k] != kinds[k - 1] or k == n_static)]
    ends = [*cuts[1:], len(kinds)]
    rows = [(kinds[begin], begin, end) for begin, end in zip(cuts, ends, strict=True) if end > begin]
    return np.array(rows, dtype=np.int64).reshape(-1, 3)
