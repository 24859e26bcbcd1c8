"""Rows from DataFrames and from formulas, and new rows for what was fitted to them."""

from __future__ import annotations

import copy
import pickle
import subprocess
import sys

import numpy as np
import pandas as pd
import pytest
import xarray as xr

import pymc_ship as ps
from pymc_ship.inference.regression.cross_validation import cross_validation
from tests.inference.rows.frames import Table, motion
from tests.sentences import refused

POWER, _bent = 2, [2.0]


def bent(values):
    """A function that depends on a variable of its module."""
    return np.abs(values) ** _bent[0]


FORMULA = "Y ~ v + r + v:r + I(delta**2)"
NAMES = ("Intercept", "v", "r", "v:r", "I(delta ** 2)")


@pytest.fixture
def formulae():
    return pytest.importorskip("formulae", reason="installed by pymc-ship[formula]")


# tables ---------------------------------------------------------------------------------------------------------------


def test_the_columns_of_a_table_name_the_coefficients(frame):
    data = ps.RegressionData.from_arrays(frame[["v", "r"]], frame["Y"], scaling="none")
    assert data.coefficients == ("v", "r")
    np.testing.assert_array_equal(data.design_matrix, frame[["v", "r"]].to_numpy())
    np.testing.assert_array_equal(data.response, frame["Y"].to_numpy())


def test_names_choose_columns_of_a_table(frame):
    data = ps.RegressionData.from_arrays(frame, frame["Y"], ["r", "v"], scaling="zscore")
    assert data.coefficients == ("r", "v")
    np.testing.assert_array_equal(data.design_matrix[:, 0], frame["r"])


def test_pandas_is_not_imported_for_a_table():
    code = (
        "import sys, numpy as np, pymc_ship as ps; from tests.inference.rows.frames import Table, motion; "
        "values = motion(); "
        "y = values.pop('Y'); found = ps.RegressionData.from_arrays(Table(**values), y).coefficients; "
        "import pathlib; room = pathlib.Path(ps.__file__).parent.joinpath('inference', 'rows', 'frames.py'); "
        "text = room.read_text(); "
        "print(found, 'import pandas' in text)"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "('v', 'r', 'delta') False"


@pytest.mark.parametrize(
    ("columns", "names", "sentence"),
    [
        ({"v": [1.0, 2.0]}, ["v", "r"], "The rows need the columns v, r, each of them once; found v; add or rename r."),
        ({"v": ["a", "b"]}, None, "The column v must be real numbers, found texts; convert them."),
        ({"v": [1.0, np.nan]}, None, "Regression data must be finite, found NaN or infinity in v; clean the trial."),
    ],
)
def test_a_table_that_cannot_be_used_is_refused_with_a_sentence(columns, names, sentence):
    with pytest.raises(ps.InferenceError) as found:
        ps.RegressionData.from_arrays(Table(**columns), [1.0, 2.0], names, scaling="none")
    assert str(found.value) == sentence


# formulas -------------------------------------------------------------------------------------------------------------


def test_a_formula_makes_named_columns(formulae, frame):
    data = ps.RegressionData.from_formula(FORMULA, frame, scaling="none")
    values = motion()
    assert data.coefficients == NAMES
    assert data.constant == 0
    np.testing.assert_allclose(data.design_matrix[:, 3], values["v"] * values["r"])
    np.testing.assert_allclose(data.design_matrix[:, 4], values["delta"] ** 2)
    np.testing.assert_allclose(data.least_squares, [1.0, 2.0, -3.0, 4.0, 5.0], atol=0.1)


def test_a_formula_calls_functions_from_where_it_is_written(formulae, frame):
    def bent(values):
        return values * np.abs(values)

    data = ps.RegressionData.from_formula("Y ~ 0 + bent(v)", frame, scaling="none")
    np.testing.assert_array_equal(data.design_matrix[:, 0], bent(frame["v"].to_numpy()))


def test_a_formula_keeps_the_numbers_of_the_fit(formulae, frame):
    """Numbers and arrays of the caller, changed later."""
    fits, knots = {}, [0.0]
    for power in (2.0, 3.0):
        data = ps.RegressionData.from_formula("Y ~ 0 + I(v**power) + bs(r, knots=knots, degree=1)", frame)
        fits[power] = ps.ConjugatePrior().exact(data), data.design_matrix[:5]
    knots[0] = 0.1
    for exact, columns in fits.values():
        np.testing.assert_array_equal(exact.predict(frame.iloc[:5]), exact.predict(columns))


def test_a_function_that_changes_after_the_fit_is_refused(formulae, frame):
    data = ps.RegressionData.from_formula("Y ~ 0 + bent(v)", frame)
    exact, _bent[0] = ps.ConjugatePrior().exact(data), 3.0
    try:
        with refused(ps.InferenceError, "bent(v)"):
            exact.predict(frame.iloc[:5])
    finally:
        _bent[0] = 2.0
    np.testing.assert_array_equal(exact.predict(frame.iloc[:5]), exact.predict(data.design_matrix[:5]))


def test_a_term_of_all_rows_predicts_no_new_row(formulae, frame):
    """A centred column would be centred on the new rows; the formula's own transformations keep theirs."""
    exact = ps.ConjugatePrior().exact(ps.RegressionData.from_formula("Y ~ r + I(v - np.mean(v))", frame))
    with refused(ps.InferenceError, "np.mean(v))"):
        exact.predict(frame.iloc[:5])
    kept = ps.ConjugatePrior().exact(ps.RegressionData.from_formula("Y ~ r + center(v) + poly(delta, 2)", frame))
    assert np.isfinite(kept.predict(frame.iloc[:5])).all()


def classes(v):
    """Thirds of the range of the rows at hand."""
    return np.digitize(v, np.linspace(v.min(), v.max(), 4)[1:-1])


def test_classes_of_all_rows_are_refused_where_a_row_alone_has_others(formulae, frame):
    """The sampled rows together may have the classes of all."""
    ends = frame.iloc[[int(np.argmin(frame["v"])), *range(50), int(np.argmax(frame["v"]))]]
    exact = ps.ConjugatePrior().exact(ps.RegressionData.from_formula("Y ~ classes(v)", ends))
    with refused(ps.InferenceError, "classes(v)"):
        exact.predict(ends.iloc[:5])


@pytest.mark.parametrize("copied", [lambda data: pickle.loads(pickle.dumps(data)), copy.deepcopy, copy.copy])
def test_data_and_posterior_of_a_formula_can_be_copied(formulae, frame, copied):
    formula = "Y ~ scale(v) + np.abs(r) + bent(delta) + I(r**POWER)"
    data = ps.RegressionData.from_formula(formula, frame)
    exact = ps.ConjugatePrior().exact(data)
    np.testing.assert_array_equal(copied(data).design_matrix, data.design_matrix)
    np.testing.assert_array_equal(copied(exact).predict(frame.iloc[:5]), exact.predict(frame.iloc[:5]))


def test_a_function_that_no_file_can_have_is_refused_with_a_sentence(formulae, frame):
    def own(values):
        return values**2

    data = ps.RegressionData.from_formula("Y ~ own(v)", frame)
    assert copy.deepcopy(data).coefficients == data.coefficients
    with refused(ps.InferenceError, "own", "pickle"):
        pickle.dumps(data)


def test_the_remedy_for_an_offset_fixes_its_coefficient(formulae, frame):
    data = ps.hold_fixed(ps.RegressionData.from_formula("Y ~ v + r", frame), {"r": 1.0})
    plain = ps.RegressionData.from_formula("I(Y - r) ~ v", frame)
    np.testing.assert_allclose(data.least_squares, plain.least_squares)


def test_digits_are_categories_where_they_are_said_to_be(formulae, frame):
    texts = frame.assign(gear=["1", "2"] * (len(frame) // 2), side=["port", "2"] * (len(frame) // 2))
    for term, names in {"C(gear)": ["C(gear)[2]"], "side": ["side[port]"]}.items():
        assert list(ps.RegressionData.from_formula(f"Y ~ v + {term}", texts).coefficients)[2:] == names


def test_a_column_that_stands_twice_is_refused_where_it_is_used(formulae, frame):
    pandas = pytest.importorskip("pandas")
    twice = pandas.concat([frame, frame[["r"]]], axis=1)
    with refused(ps.InferenceError, "r", "once"):
        ps.RegressionData.from_formula("Y ~ v + r", twice)
    assert list(ps.RegressionData.from_formula("Y ~ v", twice).coefficients) == ["Intercept", "v"]


def test_a_formula_without_its_parser_is_refused_with_a_sentence(monkeypatch):
    monkeypatch.setitem(sys.modules, "formulae", None)
    with pytest.raises(ps.InferenceError) as found:
        ps.RegressionData.from_formula("Y ~ v", Table(**motion()), scaling="none")
    assert str(found.value) == ("Formulas need the package formulae, found none; install pymc-ship[formula].")


def test_a_quoted_text_is_no_variable_and_a_name_in_backticks_is_one():
    rng = np.random.default_rng(1)
    table = {name: rng.normal(size=12) for name in ("Y", "v", "r", "low", "my v")} | {"g": ["low", "r", "mid"] * 4}
    frame = pd.DataFrame(table)
    for formula, names in (
        (
            "Y ~ v + C(g, Treatment('low'))",
            ["Intercept", "v", "C(g, Treatment('low'))[mid]", "C(g, Treatment('low'))[r]"],
        ),
        ('Y ~ v + I(g == "r")', ["Intercept", "v", 'I(g == "r")']),
        ("Y ~ `my v` + `r`", ["Intercept", "my v", "r"]),
    ):
        assert sorted(ps.RegressionData.from_formula(formula, frame).coefficients) == sorted(names)
    with refused(ps.InferenceError, "low"):
        ps.RegressionData.from_formula("Y ~ v % low", frame)


# new rows -------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("prior", [ps.ConjugatePrior(), ps.SemiConjugatePrior()])
def test_labelled_arrays_are_taken_by_their_labels(prior):
    values, labels = np.random.default_rng(1).normal(size=(9, 2)), {"row": np.arange(9), "coefficient": ["v", "r"]}
    X, y = (
        xr.DataArray(values, labels, ("row", "coefficient")),
        xr.DataArray(values[:, 0] + 1.0, {"row": np.arange(9)}, "row"),
    )
    data = ps.RegressionData.from_arrays(X, y, ["v", "r"])
    exact, tree = prior.exact(data), ps.exact_posterior(data, prior, draws=40, rng=1)
    for rows in (X[:2], X[:2].T, X[:2, ::-1], X[:2].sel(coefficient=["r", "v"]).T):
        np.testing.assert_array_equal(exact.predict(rows), exact.predict(values[:2]))
        xr.testing.assert_identical(ps.predict(tree, rows, rng=1), ps.predict(tree, values[:2], rng=1))
    for call in (
        lambda: ps.RegressionData.from_arrays(X, y[::-1]),
        lambda: exact.log_predictive_density(X, y[::-1]),
        lambda: exact.predict(X.assign_coords(coefficient=["v", "p"])),
    ):
        with refused(ps.InferenceError):
            call()


def test_labelled_columns_have_their_own_names_whatever_their_order():
    values, y = np.random.default_rng(1).normal(size=(9, 3)), np.arange(9.0) ** 2
    X = xr.DataArray(values, {"coefficient": ["a", "b", "q"]}, ("row", "coefficient"))
    for names, rows in ((None, X), (["q", "a", "b"], X), (["q", "a", "b"], X.T), (["b", "q"], X)):
        data = ps.RegressionData.from_arrays(rows, y, names)
        assert data.coefficients == tuple(names or "abq")
        np.testing.assert_array_equal(data.design_matrix, X.sel(coefficient=list(data.coefficients)).values)
    numbered = xr.DataArray(values, {"row": np.arange(9)}, ("row", "column"))
    assert ps.RegressionData.from_arrays(numbered, y, ["0", "1", "2"]).n_rows == 9
    for rows, names, found in (
        (X, ["u", "v", "w"], "q"),
        (X, "abq", "abq"),
        (X.to_dataset("coefficient"), None, "real"),
    ):
        with refused(ps.InferenceError, found):
            ps.RegressionData.from_arrays(rows, y, names)


@pytest.mark.parametrize("prior", [ps.ConjugatePrior(), ps.SemiConjugatePrior()])
def test_predictions_take_new_rows_as_their_users_have_them(frame, prior):
    data = ps.RegressionData.from_arrays(frame[["v", "r"]], frame["Y"], scaling="zscore")
    exact, new = prior.exact(data), frame.iloc[:5]
    plain = exact.predict(new[["v", "r"]].to_numpy())
    for table in (new[["v", "r"]], new[["r", "v"]], new):
        np.testing.assert_array_equal(exact.predict(table), plain)
    assert not np.allclose(exact.predict(new[["r", "v"]].to_numpy())[0], plain[0])


@pytest.mark.parametrize("prior", [ps.ConjugatePrior(), ps.SemiConjugatePrior()])
@pytest.mark.parametrize("scaling", ["none", "zscore"])
def test_a_formula_is_evaluated_for_new_rows(formulae, frame, prior, scaling):
    """What a transformation took from the fitted table holds for the new one."""
    formula = FORMULA + " + scale(delta)"
    data = ps.RegressionData.from_formula(formula, frame, scaling=scaling)
    exact = prior.exact(data)
    for given in (frame.iloc[:5], frame.iloc[:5][["delta", "r", "v"]]):
        found = exact.predict(given)
        np.testing.assert_allclose(found, exact.predict(data.design_matrix[:5]), rtol=1e-12)
    assert np.abs(found[0] - frame["Y"][:5]).max() < 1.0


def test_fixed_coefficients_are_not_left_out_of_new_rows(formulae, frame):
    whole, prior = ps.RegressionData.from_formula(FORMULA, frame, scaling="none"), ps.ConjugatePrior()
    data = ps.hold_fixed(whole, {"r": -3.0})
    tree = ps.exact_posterior(data, prior, draws=40, rng=1)
    for predict in (prior.exact(data).predict, lambda rows: ps.predict(tree, rows, data=data, rng=1)):
        with refused(ps.InferenceError, "r", "restore_fixed"):
            predict(frame.iloc[:5])
    restored = ps.restore_fixed(tree, {"r": -3.0}, whole.coefficients)
    found = ps.predict(restored, frame.iloc[:5], data=whole, rng=1)["mean"]
    assert np.abs(found - frame["Y"][:5]).max() < 1.0


@pytest.mark.parametrize(
    ("change", "sentence"),
    [
        ({"columns": ["v"]}, "New rows need the columns v, r, each of them once; found v; add or rename r."),
        ({"columns": ["V", "R"]}, "New rows need the columns v, r, each of them once; found V, R; add or rename v, r."),
        ({"r": np.nan}, "New rows are finite, of shape (rows, 2), found NaN or infinity in r; check them."),
        ({"r": "fast"}, "The column r must be real numbers, found texts; convert them."),
        ({"array": [[1.0]]}, "New rows are finite, of shape (rows, 2), found shape (1, 1); check them."),
        ({"array": "v.csv"}, "New rows must be real numbers, found texts; convert them."),
    ],
)
def test_new_rows_that_do_not_fit_are_refused_with_a_sentence(change, sentence):
    values = motion()
    y = values.pop("Y")
    data = ps.RegressionData.from_arrays(Table(v=values["v"], r=values["r"]), y, scaling="none")
    columns = {name: [1.0] for name in change.get("columns", ["v", "r"])}
    new = Table(**columns | ({"r": [change["r"]]} if "r" in change else {}))
    tree = ps.exact_posterior(data, ps.ConjugatePrior(), draws=40, rng=1)
    for predict in (ps.ConjugatePrior().exact(data).predict, lambda rows: ps.predict(tree, rows, rng=1)):
        with pytest.raises(ps.InferenceError) as found:
            predict(change.get("array", new))
        assert str(found.value) == sentence


def test_new_rows_that_do_not_fit_a_formula_are_refused_with_a_sentence(formulae, frame):
    exact = ps.ConjugatePrior().exact(ps.RegressionData.from_formula(FORMULA, frame, scaling="none"))
    for new, named in (
        (frame[["v", "r"]], "delta"),
        (frame.assign(v=np.nan), "v:r"),
        (frame.assign(v="fast"), "~"),
    ):
        with refused(ps.InferenceError, named):
            exact.predict(new)


# uneven columns -------------------------------------------------------------------------------------------------------


def uneven(ratio, scaling="none"):
    values = motion()
    table = Table(v=values["v"], r=ratio * values["r"] * np.std(values["v"]) / np.std(values["r"]))
    return ps.RegressionData.from_arrays(table, values["Y"], scaling=scaling)


def test_a_default_prior_of_uneven_columns_is_warned_of():
    data = uneven(1000.0)
    assert "remark    The columns must be of one size" in repr(data)
    for fit in (
        lambda: ps.ConjugatePrior().exact(data),
        lambda: ps.SemiConjugatePrior().exact(data),
        lambda: ps.gibbs_posterior(data, ps.ConjugatePrior(), draws=10, rng=1),
        lambda: ps.pymc_model(data, ps.ConjugatePrior()),
    ):
        with refused(UserWarning, "v", "r"):
            fit()


@pytest.mark.parametrize(
    ("data", "prior"),
    [
        (uneven(1000.0), ps.ConjugatePrior(kappa=1e4)),
        (uneven(1000.0), ps.ConjugatePrior(kappa=[100.0, 1e-4])),
        (uneven(1000.0, "zscore"), ps.ConjugatePrior()),
        (uneven(20.0), ps.ConjugatePrior()),
    ],
)
def test_a_chosen_prior_or_even_columns_are_not_warned_of(data, prior):
    """A warning is an error in the tests."""
    prior.exact(data)


def test_few_rows_of_even_columns_are_not_uneven():
    """In four of five single rows the norms of 28 columns differ by a factor of 30."""
    X = np.random.default_rng(2).standard_normal((200, 28))
    data = ps.RegressionData.from_arrays(X, X[:, 0], scaling="none")
    assert [k for k in range(200) if data.rows(np.array([k])).uneven] == []
    assert [n for n in range(1, 200) if data.rows(np.arange(n)).uneven] == []
    assert uneven(1000.0).rows(np.arange(4)).uneven.startswith("The columns must be of one size")


def test_an_empty_column_is_not_uneven():
    assert ps.RegressionData.from_arrays(np.eye(3)[:, :2] * [1.0, 0.0], np.ones(3), scaling="none").uneven == ""


# numbers and responses of a formula -----------------------------------------------------------------------------------


@pytest.mark.parametrize("kind", ["int8", "uint8", "int16", "int64"])
def test_integers_of_a_table_do_not_overflow(formulae, frame, kind):
    numbers = np.random.default_rng(1).integers(0, 100, len(frame)).astype(kind)
    table = frame.assign(k=numbers, level=(numbers % 3).astype(kind))
    data = ps.RegressionData.from_formula("Y ~ I((k - 100)**11) + k:v + C(level)", table)
    assert {"C(level)[1]", "C(level)[2]"} < {*data.coefficients}
    column = [name.startswith("I(") for name in data.coefficients].index(True)
    np.testing.assert_allclose(data.design_matrix[:, column], (numbers.astype(float) - 100.0) ** 11)
    exact = ps.ConjugatePrior().exact(data)
    np.testing.assert_allclose(exact.predict(table[:9])[0], exact.predict(data.design_matrix[:9])[0], rtol=1e-9)


@pytest.mark.parametrize(
    ("formula", "leaks"), [("center(Y) ~ v", True), ("I(Y - np.mean(Y)) ~ v", True), ("I(2 * Y) ~ center(v)", False)]
)
def test_a_response_of_all_rows_is_not_cross_validated(formulae, frame, formula, leaks):
    data = ps.RegressionData.from_formula(formula, frame)
    if not leaks:
        assert len(cross_validation(data, 3).training) == 3
        return
    with refused(ps.InferenceError, "Y"):
        cross_validation(data, 3)


def test_columns_that_are_not_used_may_be_complex(frame):
    data = ps.RegressionData.from_arrays(frame.assign(c=1j * frame["v"]), frame["Y"], ["v", "r"])
    np.testing.assert_array_equal(data.design_matrix, frame[["v", "r"]])


def test_names_may_be_numbers(frame):
    table = frame[["v", "r"]].set_axis([0, 1], axis=1)
    for names in ([1, 0], ["1", "0"]):
        assert ps.RegressionData.from_arrays(table, frame["Y"], names).coefficients == ("1", "0")
