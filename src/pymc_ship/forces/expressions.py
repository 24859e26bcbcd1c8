"""Formulae of forces, written once in Python and noted as programs.

A formula is traced: symbols go in, :class:`Expression` objects come out, and what was done to them is a list of
elementary operations, a :class:`pymc_ship.forces.programs.Program`. No derivative is written by hand, and a new formula
needs no compilation.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from pymc_ship.forces.programs import (
    ABSOLUTE,
    ADD,
    ARC_TANGENT,
    COSINE,
    DIVIDE,
    EXPONENTIAL,
    MULTIPLY,
    RAMP,
    ROOT,
    SINE,
    STEP,
    SUBTRACT,
    Program,
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
