"""Rows from tables: columns of a DataFrame by their names, and the terms of a formula.

pandas is not imported: a table is anything with ``columns`` and ``to_numpy``. Formulas are read by formulae, the parser
of Bambi, which is imported where one is given.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from textwrap import shorten
from typing import Any

import numpy as np

from pymc_ship.machine.arguments import short_repr
from pymc_ship.machine.errors import InferenceError

_FRAMES = 2
"""Calls between the user's and that of formulae, which looks up a formula's functions where the user calls."""


def is_frame(table: object) -> bool:
    """Whether a table has named columns, as a DataFrame of pandas."""
    return hasattr(table, "columns") and hasattr(table, "to_numpy")


def frame_names(frame: Any) -> tuple[str, ...]:
    """Names of the columns of a table."""
    return tuple(map(str, frame.columns))


def frame_columns(frame: Any, names: Sequence[str], what: str) -> np.ndarray:
    """Columns of a table by name, in the order of the names, shape (n_rows, n_names).

    Raises
    ------
    InferenceError
        For columns that are missing, there twice, or no numbers; ``what`` is the begin of the sentence.
    """
    check_names(frame, names, what)
    given, values = frame_names(frame), frame.to_numpy()
    columns = [_numbers(values[:, given.index(name)], name, what) for name in names]
    return np.column_stack(columns) if columns else np.empty((len(values), 0))


def check_names(frame: Any, names: Sequence[str], what: str) -> None:
    """Raise a InferenceError unless a table has each of the named columns once."""
    given = frame_names(frame)
    wrong = [name for name in names if given.count(name) != 1]
    if wrong:
        raise InferenceError(
            f"{what} need the columns {_listed(names)}, each of them once; found {_listed(given)}; add or rename "
            f"{_listed(wrong)}."
        )


def _numbers(values: np.ndarray, name: str, what: str) -> np.ndarray:
    try:
        return np.array(values, dtype=float)
    except (TypeError, ValueError):
        raise InferenceError(f"{what} need numbers, found none in the column {name}; convert it.") from None


def _listed(names: Sequence[str]) -> str:
    return shorten(", ".join(names), 100, placeholder=" ...") or "none"


def check_same_rows(design_matrix: Any, response: Any) -> None:
    """Raise a InferenceError where a table and a column of another table do not have the same index."""
    index, other = getattr(design_matrix, "index", None), getattr(response, "index", None)
    if index is None or other is None or not hasattr(response, "to_numpy"):
        return
    if not np.array_equal(index, other):
        raise InferenceError(
            "The table and the response must have the same index, found two that differ; take both from one table."
        )


def new_design(new_rows: Any, coefficients: Sequence[str], formula: Formula | None = None) -> np.ndarray:
    """Design matrix of new rows, shape (n_new, n_terms).

    Parameters
    ----------
    new_rows : array_like, shape (n_new, n_terms), or DataFrame
        Terms in the order of the coefficients; or a table with these columns in any order, or with the variables of
        the formula. Columns that are not needed are left aside.
    coefficients : sequence of str
    formula : Formula, optional
        What made the rows that were fitted.

    Raises
    ------
    InferenceError
        For another shape, columns that are missing or there twice, values that are no finite numbers.
    """
    if not is_frame(new_rows):
        X = _floats(new_rows)
    elif formula is None:
        X = frame_columns(new_rows, coefficients, "New rows")
    else:
        X = formula.columns(new_rows, coefficients)
    found = f"shape {X.shape}"
    if X.ndim == 2 and X.shape[1] == len(coefficients):
        bad = [name for name, column in zip(coefficients, X.T, strict=True) if not np.isfinite(column).all()]
        if not bad:
            return X
        found = f"NaN or infinity in {_listed(bad)}"
    raise InferenceError(f"New rows are finite, of shape (rows, {len(coefficients)}), found {found}; check them.")


def _floats(values: Any) -> np.ndarray:
    try:
        return np.asarray(values, dtype=float)
    except (TypeError, ValueError):
        raise InferenceError(
            f"New rows are numbers, an array or a DataFrame, found {short_repr(values)}; convert them."
        ) from None


@dataclass(frozen=True, eq=False)
class Formula:
    """Formula of a regression, which can be evaluated for new rows.

    Attributes
    ----------
    text : str
    names : tuple of str
        Terms, in the order of the columns.
    variables : tuple of str
        Columns of a table that the terms are made from.
    terms : formulae.matrices.CommonEffectsMatrix
        Holds what transformations such as ``scale(v)`` took from the fitted table.
    """

    text: str
    names: tuple[str, ...]
    variables: tuple[str, ...]
    terms: Any

    def columns(self, frame: Any, coefficients: Sequence[str]) -> np.ndarray:
        """Terms of the given names for a table of the variables, shape (n_new, n_names)."""
        check_names(frame, self.variables, "New rows")
        try:
            design = np.asarray(self.terms.evaluate_new_data(frame).design_matrix, dtype=float)
        except Exception as error:  # a formula may call anything
            raise InferenceError(_sentence(self.text, "the new rows", error)) from None
        return design[:, [self.names.index(name) for name in coefficients]]


def formula_rows(formula: str, frame: Any) -> tuple[np.ndarray, np.ndarray, Formula]:
    """Design matrix, response and the formula itself, read from a table.

    Raises
    ------
    InferenceError
        Where formulae is not installed, for what it cannot read, a response that is missing or no number, terms that
        vary by group, and no term.
    """
    try:
        from formulae import design_matrices
    except ImportError:
        raise InferenceError(
            "Formulas need the package formulae, which is not installed; install pymc-ship[formula]."
        ) from None
    if not is_frame(frame):
        raise InferenceError(f"A formula needs a table, found {short_repr(type(frame))}; give a DataFrame.")
    try:
        read = design_matrices(formula, frame, na_action="error", env=_FRAMES)
    except Exception as error:  # a formula may call anything
        raise InferenceError(_sentence(formula, "the table", error)) from None
    faults = {
        "no response": read.response is None,
        "a response that is no number": read.response is not None and read.response.kind != "numeric",
        "terms that vary by group": read.group is not None,
        "no term": read.common is None,
    }
    if any(faults.values()):
        found = " and ".join(fault for fault, there in faults.items() if there)
        raise InferenceError(
            f"A formula has a response and terms that are the same for all rows, such as 'Y ~ v + r', found {found} in "
            f"{short_repr(formula)}; change it."
        )
    named = read.common.as_dataframe()
    used = set().union(*(term.var_names for term in read.common.terms.values()))
    variables = tuple(name for name in frame_names(frame) if name in used)
    text = Formula(formula, frame_names(named), variables, read.common)
    return np.asarray(named, dtype=float), np.asarray(read.response.design_matrix, dtype=float), text


def _sentence(formula: str, what: str, error: Exception) -> str:
    reason = f"no variable {error}" if isinstance(error, KeyError) else f"{error}".rstrip(".")
    return f"The formula {short_repr(formula)} must hold for {what}, found: {reason}; correct one of them."
