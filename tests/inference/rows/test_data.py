from __future__ import annotations

import copy
import pickle
import warnings
from dataclasses import replace

import numpy as np
import pytest

import pymc_ship as ps
from tests.sentences import refused

DOFS = ("surge", "sway", "yaw", "roll")
N_TERMS = {"surge": 18, "sway": 28, "yaw": 28, "roll": 28}


def least_squares(data):
    """Coefficients of the original columns from the scaled ones, by numpy alone."""
    scaled = np.linalg.lstsq(data.scaled_design_matrix, data.scaled_response, rcond=None)[0]
    return data.to_original(scaled)


def median_error(data, vessel):
    """Median over the coefficients that are not zero [%]."""
    reference = vessel.coefficients(data.dof).values
    known = reference != 0.0
    return 100.0 * np.median(np.abs(least_squares(data)[known] / reference[known] - 1.0))


class TestGate:
    """A clean trial and exact differences give back the coefficients that made it: simulator and regression agree."""

    @pytest.mark.parametrize("interval", [1.0, None])
    @pytest.mark.parametrize("dof", DOFS)
    def test_least_squares_returns_the_reference_coefficients(self, container, zigzag_trial, dof, interval):
        data = ps.regression_data(zigzag_trial, container, dof, interval=interval, derivative="euler")
        found, reference = least_squares(data), container.coefficients(dof).values
        zero = reference == 0.0
        np.testing.assert_allclose(found[~zero], reference[~zero], rtol=1e-6)
        np.testing.assert_allclose(found[zero], 0.0, atol=1e-9)
        assert data.coefficients == tuple(container.coefficients(dof)["coefficient"].values)

    def test_all_102_coefficients_are_tried(self, container):
        assert {dof: container.coefficients(dof).size for dof in container.dofs} == N_TERMS

    @pytest.mark.parametrize("dof", DOFS)
    def test_least_squares_of_the_data_is_that_of_numpy(self, container, zigzag_trial, dof):
        data = ps.regression_data(zigzag_trial, container, dof, interval=1.0)
        np.testing.assert_allclose(data.least_squares, least_squares(data), rtol=1e-7, atol=1e-12)

    @pytest.mark.parametrize("dof", DOFS)
    def test_the_response_is_the_design_times_the_reference(self, container, zigzag_trial, dof):
        data = ps.regression_data(zigzag_trial, container, dof, interval=1.0)
        force = data.design_matrix @ container.coefficients(dof).values
        np.testing.assert_allclose(data.response, force, rtol=0.0, atol=1e-10 * np.abs(force).max())

    def test_another_ship_on_the_same_trial_is_rejected(self, container, zigzag_trial):
        """The broken twin: with another mass the same trial gives other coefficients."""
        heavier = replace(container, m=1.01 * container.m)
        data = ps.regression_data(zigzag_trial, heavier, "sway", interval=1.0)
        reference = container.coefficients("sway").values
        assert np.abs(least_squares(data)[0] / reference[0] - 1.0) > 1e-4

    @pytest.mark.parametrize(
        ("derivative", "medians"), [("euler", (38.0, 197.0, 130.0, 34.0)), ("central", (10.0, 13.0, 7.0, 8.0))]
    )
    def test_sampling_at_1_hz_costs_what_was_measured_beforehand(self, container, zigzag_trial, derivative, medians):
        """METHOD.md, section 9: discretisation bias alone, with differences over one second."""
        coarse = zigzag_trial.isel(time=slice(None, None, 50))
        found = [
            median_error(ps.regression_data(coarse, container, dof, derivative=derivative), container) for dof in DOFS
        ]
        np.testing.assert_allclose(found, medians, atol=0.5)


class TestRows:
    def test_rows_at_1_hz(self, container, zigzag_trial):
        data = ps.regression_data(zigzag_trial, container, "yaw", interval=1.0)
        assert data.design_matrix.shape == (400, 28)
        np.testing.assert_allclose(data.time, np.arange(400.0), atol=1e-9)
        assert (data.dof, data.vessel, data.derivative) == ("yaw", "container", "euler")

    @pytest.mark.parametrize(
        ("derivative", "first", "last"), [("euler", 0.0, 399.96), ("central", 0.02, 399.96), ("savgol", 0.0, 399.98)]
    )
    def test_only_samples_with_an_acceleration_become_rows(self, container, zigzag_trial, derivative, first, last):
        data = ps.regression_data(zigzag_trial, container, "surge", derivative=derivative)
        np.testing.assert_allclose([data.time[0], data.time[-1]], [first, last])
        assert data.n_rows == round((last - first) / 0.02) + 1

    def test_rows_are_the_same_from_a_denser_record(self, container, zigzag_trial):
        every = ps.regression_data(zigzag_trial, container, "roll")
        second = ps.regression_data(zigzag_trial, container, "roll", interval=1.0)
        np.testing.assert_array_equal(every.design_matrix[::50], second.design_matrix)
        np.testing.assert_array_equal(every.response[::50], second.response)

    def test_columns_and_response_have_unit_mean_square(self, container, zigzag_trial):
        for dof in DOFS:
            data = ps.regression_data(zigzag_trial, container, dof, interval=1.0)
            np.testing.assert_allclose(np.mean(data.scaled_design_matrix**2, axis=0), 1.0, rtol=1e-12)
            assert np.mean(data.scaled_response**2) == pytest.approx(1.0, rel=1e-12)
            assert data.constant == (-1 if dof == "surge" else container.terms(dof).index("0"))

    def test_the_reference_values_are_not_used(self, container, zigzag_trial):
        other = container.with_coefficients({dof: np.zeros(n) for dof, n in N_TERMS.items()})
        for dof in DOFS:
            mine, theirs = (ps.regression_data(zigzag_trial, v, dof, interval=1.0) for v in (container, other))
            np.testing.assert_array_equal(mine.design_matrix, theirs.design_matrix)
            np.testing.assert_array_equal(mine.response, theirs.response)

    def test_a_vessel_without_roll_needs_no_roll_in_the_trial(self, container):
        forces = {dof: tuple(c for c in container.forces[dof] if "p" not in c.term) for dof in ("surge", "sway", "yaw")}
        vessel = replace(container, forces=forces)
        trial = ps.simulate(vessel, ps.zigzag(20.0, 20.0), duration=300.0).drop_vars(["p", "phi"])
        for dof in ("surge", "sway", "yaw"):
            data = ps.regression_data(trial, vessel, dof, interval=1.0)
            reference = vessel.coefficients(dof).values
            np.testing.assert_allclose(least_squares(data), reference, rtol=1e-6, atol=1e-9)


def pickled(data):
    return pickle.loads(pickle.dumps(data))


@pytest.mark.parametrize("again", [copy.deepcopy, pickled])
def test_a_copy_is_the_data_and_another_object(again):
    X, y = np.random.default_rng(1).normal(size=(9, 2)), np.arange(9.0)
    data = ps.RegressionData.from_arrays(X, y)
    expected = ps.ConjugatePrior().exact(data)
    found = ps.ConjugatePrior().exact(again(data))
    np.testing.assert_array_equal(found.mean, expected.mean)
    assert (data != again(data), data == data, len({data, again(data)})) == (True, True, 2)
    assert (expected == found, expected == expected) == (False, True)


@pytest.mark.parametrize(
    "index", [3, [1000], [-10], [[0, 1], [2, 3]], np.ones(3, dtype=bool), np.ones((9, 1), dtype=bool)]
)
def test_rows_are_those_of_the_data(index):
    X, y = np.random.default_rng(1).normal(size=(9, 2)), np.arange(9.0)
    data = ps.RegressionData.from_arrays(X, y)
    with refused(ps.InferenceError, 8, 9):
        data.rows(index)
    assert data.rows([-1, 0]).response.tolist() == [8.0, 0.0]


@pytest.mark.parametrize("name", ["design_matrix", "response", "column_center", "column_scale", "time", "run"])
def test_arrays_are_read_only(name):
    """Decompositions are kept; the caller's arrays stay as they are."""
    X, y = np.random.default_rng(1).normal(size=(9, 2)), np.arange(9.0)
    data = ps.RegressionData.from_arrays(X, y)
    assert data.projection is data.projection
    for one in (data, data.rows(np.arange(4)), replace(data, response=y), copy.deepcopy(data), pickled(data)):
        assert not getattr(one, name).flags.writeable
    assert X.flags.writeable
    assert y.flags.writeable


def test_rows_that_all_stand_twice_are_told():
    """Their standard deviations are too small by the root of two; a constant response, or a few equal rows, are not."""
    X, y = np.random.default_rng(1).normal(size=(9, 2)), np.arange(9.0)
    twice = ps.RegressionData.from_arrays(np.tile(X, (2, 1)), np.tile(y, 2))
    thrice = ps.RegressionData.from_arrays(np.repeat(X, 3, axis=0), np.repeat(y, 3))
    for fit, data in ((ps.ConjugatePrior().exact, twice), (ps.maximise_evidence, thrice)):
        with warnings.catch_warnings(record=True) as caught:
            warnings.simplefilter("always")
            fit(data)
        assert data.repeated in [str(one.message) for one in caught]
        assert data.repeated
    few = ps.RegressionData.from_arrays(np.vstack([X, X[:1]]), np.append(y, y[0]))
    rest = ps.RegressionData.from_arrays(X, np.zeros(9), scaling="none")
    assert (few.repeated, rest.repeated) == ("", "")
    assert twice.repeated in repr(twice)


@pytest.mark.parametrize(
    ("column", "named"),
    [
        (lambda X: X[:, 0], "x1, x3,"),
        (lambda X: -3.0 * X[:, 1], "x2, x3,"),
        (lambda X: X[:, 0] + X[:, 1], "x1, x2, x3,"),
    ],
    ids=["equal", "multiple", "sum"],
)
def test_dependent_columns_are_told(column, named):
    """The posterior is the prior along their difference; nearly equal columns, and few rows, are not told."""
    X, y = np.random.default_rng(1).normal(size=(9, 2)), np.arange(9.0)
    other = column(X)
    data = ps.RegressionData.from_arrays(np.column_stack([X, other]), y)
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        ps.ConjugatePrior().exact(data)
    assert [str(one.message) for one in caught] == [data.dependent]
    assert f"among {named}" in data.dependent
    assert data.dependent in repr(data)
    other = other + 1e-6 * y
    assert ps.RegressionData.from_arrays(np.column_stack([X, other]), y).dependent == ""
    assert data.rows(np.arange(2)).dependent == ""


def test_two_pairs_of_equal_columns_are_told_apart():
    X = np.random.default_rng(1).normal(size=(9, 2))
    data = ps.RegressionData.from_arrays(np.column_stack([X, X]), np.arange(9.0))
    assert "among x1, x3; and among x2, x4, along" in data.dependent


@pytest.mark.parametrize("label", [{"weights": np.ones(9)}, {"dof": 3}, {"fixed": {"x1": 1.0}}])
def test_labels_of_rows_are_known_texts(label):
    X, y = np.random.default_rng(1).normal(size=(9, 2)), np.arange(9.0)
    with refused(ps.InferenceError, *label):
        ps.RegressionData.from_arrays(X, y, **label)
