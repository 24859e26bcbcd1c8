"""Derivatives against their order."""

from __future__ import annotations

import numpy as np
import pytest

from pymc_ship.records.denoising.derivative import derivative
from tests.sentences import refused


def test_euler_difference_gives_back_the_rate_of_an_euler_record():
    rate = np.random.default_rng(5).normal(size=(3, 200))
    values = np.cumsum(np.concatenate([np.zeros((3, 1)), 0.25 * rate], axis=1), axis=1)
    result = derivative(values, 0.25, "euler")
    assert result.shape == values.shape
    assert np.abs(result[:, :-1] - rate).max() < 1e-12
    assert np.array_equal(result[:, -1], result[:, -2])


@pytest.mark.parametrize(("method", "order"), [("euler", 1.0), ("central", 2.0), ("savgol", 4.0)])
def test_order_of_a_derivative(method, order):
    steps = np.array([0.2, 0.1, 0.05])
    errors = []
    for step in steps:
        time = np.arange(0.0, 10.0, step)
        error = derivative(np.sin(time), step, method, window=6.0 * step) - np.cos(time)
        errors.append(np.abs(error[10:-10]).max())
    slope = np.polyfit(np.log(steps), np.log(errors), 1)[0]
    assert slope == pytest.approx(order, abs=0.1)


@pytest.mark.parametrize(("method", "degree"), [("euler", 1), ("central", 2), ("savgol", 3)])
def test_polynomial_is_differentiated_exactly_up_to_the_ends(method, degree):
    time = 0.02 * np.arange(400)
    polynomial = np.polynomial.Polynomial([1.0, -2.0, 0.5, 0.3][: degree + 1])
    result = derivative(np.stack([polynomial(time), -polynomial(time)]), 0.02, method)
    assert np.abs(result - np.array([[1.0], [-1.0]]) * polynomial.deriv()(time)).max() < 1e-8
    beyond = derivative(time ** (degree + 1), 0.02, method)
    assert np.abs(beyond - (degree + 1) * time**degree).max() > 1e-5


def test_savgol_window_is_five_seconds():
    for step, length in ((0.02, 251), (0.1, 51), (1.0, 5), (5.0, 5)):
        with refused(ValueError, length, length - 1):
            derivative(np.zeros(length - 1), step)
        assert (derivative(np.zeros(length), step) == 0.0).all()
