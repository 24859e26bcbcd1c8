"""Units of columns and response: a posterior under the defaults follows them, or a warning names them."""

import warnings

import numpy as np
import pytest

import pymc_ship as ps
from pymc_ship.inference.regression.families import FAMILIES
from tests.inference.rows.frames import Table
from tests.sentences import refused

FACTORS = [1e-6, 1e-3, 1e3, 1e6]
families = pytest.mark.parametrize("family", FAMILIES)
factors = pytest.mark.parametrize("factor", FACTORS)


def rows(response=1.0, column=1.0, **options):
    """5 + 2 x with noise of 0.1, the response and x in other units."""
    rng = np.random.default_rng(4)
    x = rng.normal(size=80)
    y = response * (5.0 + 2.0 * x + 0.1 * rng.normal(size=80))
    return ps.RegressionData.from_arrays(np.column_stack([np.ones(80), column * x]), y, ["a", "b"], **options)


def chosen(family, data, how):
    return FAMILIES[family]() if how == "default" else ps.maximise_evidence(data, family)[0]


def moments(family, data, how):
    exact = chosen(family, data, how).exact(data)
    return exact.mean, exact.sd, exact.noise_variance_mean


@factors
@pytest.mark.parametrize("how", ["default", "evidence"])
@families
def test_the_posterior_follows_the_unit_of_the_response(family, how, factor):
    mean, sd, variance = moments(family, rows(), how)
    scaled_mean, scaled_sd, scaled_variance = moments(family, rows(response=factor), how)
    np.testing.assert_allclose(scaled_mean / factor, mean, rtol=1e-6)
    np.testing.assert_allclose(scaled_sd / factor, sd, rtol=1e-6)
    assert scaled_variance / factor**2 == pytest.approx(variance, rel=1e-6)


@factors
@families
def test_the_posterior_follows_the_unit_of_a_column(family, factor):
    mean, sd, _ = moments(family, rows(), "default")
    scaled_mean, scaled_sd, _ = moments(family, rows(column=factor), "default")
    np.testing.assert_allclose(scaled_mean * [1.0, factor], mean, rtol=1e-9)
    np.testing.assert_allclose(scaled_sd * [1.0, factor], sd, rtol=1e-9)


@families
def test_a_formula_has_the_same_default(family):
    pytest.importorskip("formulae")
    pd = pytest.importorskip("pandas")
    data = rows(response=1e6)
    table = pd.DataFrame({"x": data.design_matrix[:, 1], "Y": data.response})
    mean = moments(family, ps.RegressionData.from_formula("Y ~ x", table), "default")[0]
    np.testing.assert_allclose(mean, moments(family, data, "default")[0], rtol=1e-9)


@pytest.mark.parametrize("how", ["default", "evidence"])
@pytest.mark.parametrize("unit", [{"response": 1e6}, {"response": 1e-6}, {"column": 1e-6}])
@families
def test_without_scaling_a_posterior_that_does_not_follow_is_warned_of(family, unit, how):
    """The broken twin: the same defaults on columns and response as they are."""
    classical = np.sqrt(np.diag(np.linalg.inv(rows().design_matrix.T @ rows().design_matrix))) * 0.1
    with warnings.catch_warnings(record=True) as warned:
        warnings.simplefilter("always")
        data = rows(**unit, scaling="none")
        scale = np.array([unit.get("response", 1.0), unit.get("response", 1.0) / unit.get("column", 1.0)])
        other_mean, other_sd, _ = moments(family, data, how)
    follows = np.allclose(other_mean / scale, [5.0, 2.0], rtol=0.01) and (other_sd / scale < 10.0 * classical).all()
    assert follows or [one for one in warned if "units" in str(one.message) or "one size" in str(one.message)]


@families
def test_each_fault_of_the_units_is_named(family):
    with pytest.warns() as caught:
        FAMILIES[family]().exact(rows(response=1e-6, scaling="none"))
    assert "a response too small for it (root mean square 5.3e-06 of the response" in str(caught[0].message)
    X = 1e-3 * np.random.default_rng(1).normal(size=(80, 2))
    y = X @ [2000.0, 1000.0]
    found = {"conjugate": "columns too small", "semiconjugate": "a response too large"}[family]
    with pytest.warns() as caught:
        FAMILIES[family]().exact(ps.RegressionData.from_arrays(X, y, scaling="none"))
    assert f"found {found} for it" in str(caught[0].message)


def test_a_prior_in_the_units_of_the_data_is_not_warned_of():
    """A warning is an error in the tests."""
    ps.SemiConjugatePrior(kappa=1e14, scale=1e10).exact(rows(response=1e6, scaling="none"))
    ps.ConjugatePrior(scale=1e-14).exact(rows(response=1e-6, scaling="none"))


# constant but for rounding --------------------------------------------------------------------------------------------


def rounded(level, dtype):
    """A column of one level, with the rounding of its computation."""
    steps = np.random.default_rng(3).integers(-4, 5, 80).astype(dtype)
    return (np.asarray(level, dtype=dtype) * (1 + steps * np.finfo(dtype).eps)).astype(dtype)


@pytest.mark.parametrize("dtype", [np.float64, np.float32])
def test_a_column_that_rounding_varies_is_constant(dtype):
    x = np.random.default_rng(2).normal(size=80).astype(dtype)
    columns = np.column_stack([rounded(0.7, dtype), x])
    assert np.ptp(columns[:, 0]) > 0.0
    data = ps.RegressionData.from_arrays(columns, 1.0 + 2.0 * x)
    assert data.constant == 0
    assert data.column_center[1] != 0.0
    with refused(ps.InferenceError, "x2"):
        ps.RegressionData.from_arrays(np.column_stack([np.ones(80), rounded(0.7, dtype), x]).astype(dtype), x)
    with refused(ps.InferenceError, "response"):
        ps.RegressionData.from_arrays(x[:, None], rounded(0.7, dtype))


def test_seconds_since_1970_vary():
    """Ten minutes in 56 years are 3.5e-7 of the value."""
    seconds = 1.767e9 + np.linspace(0.0, 600.0, 80)
    data = ps.RegressionData.from_arrays(np.column_stack([np.ones(80), seconds]), 2.0 * np.linspace(0.0, 600.0, 80))
    assert data.constant == 0
    assert data.column_scale[1] == pytest.approx(600.0 / np.sqrt(12.0), rel=0.02)


def test_a_rudder_that_rounding_moves_is_refused(container):
    still = ps.simulate(container, ps.rudder_programme([0.0], [0.1]), duration=60.0)
    still["delta"][:] = np.nextafter(0.1, np.where(np.arange(still.sizes["time"]) % 2, 1.0, 0.0))
    with refused(ps.InferenceError, "rudder"):
        ps.regression_data(still, container, "sway", interval=1.0)


# gaps -----------------------------------------------------------------------------------------------------------------


def gap(values, at=7):
    filled = np.array(values, dtype=float)
    filled[at] = 9.96920996838687e36
    return np.ma.masked_greater(filled, 1e30)


def test_masked_missing_and_complex_values_are_refused_at_every_entry():
    data = rows()
    X, y = data.design_matrix, data.response
    exact = ps.ConjugatePrior().exact(data)
    entries = {
        "The response": lambda bad: ps.RegressionData.from_arrays(X, bad(y)),
        "The design matrix": lambda bad: ps.RegressionData.from_arrays(bad(X), y),
        "The time": lambda bad: ps.RegressionData.from_arrays(X, y, time=bad(np.arange(80.0))),
        "New rows": lambda bad: exact.predict(bad(X)),
        "The response ": lambda bad: exact.log_predictive_density(X, bad(y)),
    }
    for what, entry in entries.items():
        for bad, found in ((gap, "masked"), (lambda values: values + 1.0j, "complex")):
            with refused(ps.InferenceError, *what.split(), found):
                entry(bad)


def test_missing_integers_of_pandas_are_named():
    pd = pytest.importorskip("pandas")
    table = pd.DataFrame({"v": pd.array([1, None, 3, 4], dtype="Int64"), "r": [0.1, 0.4, 0.2, 0.9]})
    with refused(ps.InferenceError, "v", 1.0, "missing"):
        ps.RegressionData.from_arrays(table[["v", "r"]], [1.0, 2.0, 3.0, 4.0])
    whole = table.assign(v=pd.array([1, 2, 3, 5], dtype="Int64"))
    assert ps.RegressionData.from_arrays(whole, [1.0, 2.0, 3.0, 4.0]).design_matrix[3, 0] == 5.0


def test_a_stand_in_with_a_missing_value_is_refused():
    with refused(ps.InferenceError, "v", 1.0, "missing"):
        ps.RegressionData.from_arrays(Table(v=[1.0, None, 2.0]), [1.0, 2.0, 3.0])
