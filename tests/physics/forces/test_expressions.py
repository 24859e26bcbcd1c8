"""Formulae as programs: values against NumPy, derivatives against differences."""

from __future__ import annotations

import numpy as np
import pytest

from pymc_ship.physics.forces.expressions import Trace, arctan2, cos, exp, ramp, root, sin, step
from pymc_ship.physics.forces.programs import ADD, DIVIDE, MULTIPLY, MULTIPLY_ADD, execute, set_parameters, sweep

INPUTS, PARAMETERS, LANES = ("u", "v"), ("a", "b"), (1, 7)

FORMULAE = {
    "polynomial": (
        lambda u, v, a, b: a * u**2 * v - b * v**3 + 2.0 * u,
        lambda u, v, a, b: a * u**2 * v - b * v**3 + 2 * u,
    ),
    "quotient": (lambda u, v, a, b: (1.0 - a) / u - v / (b * b), lambda u, v, a, b: (1 - a) / u - v / b**2),
    "sums of products": (
        lambda u, v, a, b: (a * u - b * (u * v)) - (v * v - u * v) + (a - u) / b,
        lambda u, v, a, b: a * u - b * u * v - v**2 + u * v + (a - u) / b,
    ),
    "root": (lambda u, v, a, b: a * root(u * u + v * v), lambda u, v, a, b: a * np.hypot(u, v)),
    "waves": (lambda u, v, a, b: sin(a * u) * cos(v - b), lambda u, v, a, b: np.sin(a * u) * np.cos(v - b)),
    "decay": (lambda u, v, a, b: exp(-2.0 * abs(v)) * b, lambda u, v, a, b: np.exp(-2 * abs(v)) * b),
    "angle": (lambda u, v, a, b: arctan2(v, u) * a, lambda u, v, a, b: np.arctan2(v, u) * a),
    "sides": (
        lambda u, v, a, b: ramp(v) * a + step(v) * b - abs(v),
        lambda u, v, a, b: np.maximum(v, 0) * a + (v > 0) * b - abs(v),
    ),
}


def at(seed=0, lanes=7):
    """Inputs and parameters away from the kinks, (4, n_lanes)."""
    rng = np.random.default_rng(seed)
    values = rng.uniform(0.3, 1.5, (4, lanes))
    values[1] *= rng.choice((-1.0, 1.0), lanes)
    return values


def evaluated(program, values):
    """Workspace of a program at inputs and parameters."""
    work = np.zeros((program.n_rows, values.shape[1]))
    set_parameters(program, values[2:], work)
    work[:2] = values[:2]
    execute(program, work)
    return work


@pytest.mark.parametrize("lanes", LANES)
@pytest.mark.parametrize("name", FORMULAE)
def test_a_program_has_the_value_of_its_formula(name, lanes):
    formula, numpy = FORMULAE[name]
    trace, values = Trace(INPUTS, PARAMETERS), at(lanes=lanes)
    program = trace.program([formula(*trace.inputs.values(), *trace.parameters.values())])
    work = evaluated(program, values)
    np.testing.assert_allclose(work[program.results[0]], numpy(*values), rtol=1e-14, atol=1e-15)


def of_lanes(formula, u, v):
    """Values of a formula of two inputs, one lane for each pair."""
    trace = Trace(INPUTS, PARAMETERS)
    program = trace.program([formula(*trace.inputs.values())])
    return evaluated(program, np.array([u, v, np.zeros(len(u)), np.zeros(len(u))]))[program.results[0]]


def test_a_power_of_e_is_good_to_two_ulp_and_stays_finite():
    x = np.concatenate([np.linspace(-707.0, 707.0, 100001), np.linspace(-1e-3, 1e-3, 1001), [0.0, -1e-300]])
    true = np.exp(x)
    assert np.max(np.abs(of_lanes(lambda u, v: exp(u), x, x) - true) / np.spacing(true)) <= 2.0
    beyond = of_lanes(lambda u, v: exp(u), [-1e300, 1e300, -np.inf, np.inf, np.nan], np.zeros(5))
    np.testing.assert_allclose(beyond, np.exp([-708.0, 708.0, -708.0, 708.0, np.nan]), rtol=1e-15)


def test_the_angle_of_a_direction_is_good_to_three_ulp_in_every_quadrant():
    rng = np.random.default_rng(5)
    scale = 10.0 ** rng.uniform(-12, 12, 100000)
    u, v = rng.normal(size=100000), rng.normal(size=100000) * scale
    true = np.arctan2(v, u)
    assert np.max(np.abs(of_lanes(lambda u, v: arctan2(v, u), u, v) - true) / np.spacing(np.abs(true))) <= 3.0
    u, v = (side.ravel() for side in np.meshgrid([-2.0, 0.0, 2.0], [-2.0, -0.0, 0.0, 2.0]))
    np.testing.assert_allclose(of_lanes(lambda u, v: arctan2(v, u), u, v), np.arctan2(v, u), rtol=3e-16)


@pytest.mark.parametrize("name", FORMULAE)
def test_one_sweep_gives_the_derivatives_by_everything(name):
    formula, numpy = FORMULAE[name]
    trace, values, change = Trace(INPUTS, PARAMETERS), at(1), 1e-6
    program = trace.program([formula(*trace.inputs.values(), *trace.parameters.values())])
    work = evaluated(program, values)
    slope = np.empty_like(work)
    sweep(program, work, 0, slope)
    for row in range(4):
        step_ = np.zeros((4, 1))
        step_[row] = change
        difference = (numpy(*(values + step_)) - numpy(*(values - step_))) / (2.0 * change)
        np.testing.assert_allclose(slope[row], difference, rtol=1e-8, atol=1e-8)


def test_every_result_has_its_own_derivatives():
    trace = Trace(INPUTS, PARAMETERS)
    u, v = trace.inputs.values()
    a, _ = trace.parameters.values()
    program = trace.program([a * u, v * v, 3.0])
    work = evaluated(program, at(2))
    slope = np.empty_like(work)
    sweep(program, work, 1, slope)
    np.testing.assert_array_equal(slope[0], 0.0)
    np.testing.assert_allclose(slope[1], 2.0 * work[1])
    assert program.needed.sum(axis=1).tolist() == [1, 1, 0]


def test_equal_operations_are_recorded_once_and_unused_ones_never():
    trace = Trace(INPUTS, PARAMETERS)
    u, v = trace.inputs.values()
    _ = sin(u)
    program = trace.program([u * v + v * u, (u * v) * 1.0 + 0.0])
    assert program.operation.size == 2


def test_numbers_and_parameters_are_worked_out_before_the_motion():
    trace = Trace(INPUTS, PARAMETERS)
    u, _ = trace.inputs.values()
    a, b = trace.parameters.values()
    program = trace.program([u * ((1.0 - a) / (2.0 * 3.0 * b))])
    assert program.n_static == program.operation.size - 1 == 3
    assert 6.0 in program.constants


def test_operations_of_one_kind_stand_together_and_operands_come_first():
    trace = Trace(INPUTS, PARAMETERS)
    u, v = trace.inputs.values()
    program = trace.program([(u + 1.0) * (v + 2.0) + (u + 3.0) * (v + 4.0) + u / v])
    first = program.n_rows - program.operation.size
    for k, operands in enumerate(zip(program.left, program.right, program.added, strict=True)):
        assert max(operands) < first + k
    kinds = [kind for kind, _, _ in program.segments]
    assert len(kinds) < program.operation.size
    covered = [k for _, begin, end in program.segments for k in range(begin, end)]
    assert covered == list(range(program.operation.size))


def moving(program):
    """Operations that are carried out at every instant."""
    return program.operation[program.n_static :].tolist()


def test_a_product_that_one_sum_needs_is_formed_with_it():
    trace = Trace(INPUTS, PARAMETERS)
    u, v = trace.inputs.values()
    a, b = trace.parameters.values()
    assert moving(trace.program([u * v + a])) == [MULTIPLY_ADD]
    assert moving(trace.program([u + a * b])) == [ADD]  # that product is formed once, before the motion
    assert moving(trace.program([v - a * u])) == [MULTIPLY_ADD]
    product = u * v
    assert sorted(moving(trace.program([product + a, product]))) == [ADD, MULTIPLY]


def test_what_a_parameter_divides_is_multiplied_by_its_reciprocal():
    trace = Trace(INPUTS, PARAMETERS)
    u, v = trace.inputs.values()
    a, b = trace.parameters.values()
    assert moving(trace.program([u / a, v / a, u / (a + b)])) == [MULTIPLY] * 3
    assert DIVIDE in moving(trace.program([u / v]))
