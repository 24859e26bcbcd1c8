"""Rows from tables: columns of a DataFrame by name, and the terms of a formula.

pandas is not imported: a table is any object with ``columns`` and ``to_numpy``.
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
"""Stack frames from the user's call to that of formulae, which looks up functions of a formula in the user's scope."""


def is_frame(table: object) -> bool:
    """Whether a table has named columns, as a DataFrame of pandas."""
    return hasattr(table, "columns") and hasattr(table, "to_numpy")


def frame_names(frame: Any) -> tuple[str, ...]:
    """Names of the columns of a table."""
    return tuple(map(str, frame.columns))


def frame_columns(frame: Any, names: Sequence[str], what: str) -> np.ndarray:
    """Columns of a table by name, shape (n_rows, n_names); InferenceError if missing, repeated or not numeric."""
    check_names(frame, names, what)
    available, values = frame_names(frame), frame.to_numpy()
    fault = f"{what} need numbers, found none in the column {{}}; convert it."
    columns = [_numbers(values[:, available.index(name)], fault.format(name)) for name in names]
    return np.column_stack(columns) if columns else np.empty((len(values), 0))


def check_names(frame: Any, names: Sequence[str], what: str) -> None:
    """Raise InferenceError unless a table has each of the named columns once."""
    available = frame_names(frame)
    wrong = [name for name in names if available.count(name) != 1]
    if wrong:
        raise InferenceError(
            f"{what} need the columns {_name_list(names)}, each of them once; found {_name_list(available)}; add or "
            f"rename {_name_list(wrong)}."
        )


def _numbers(values: Any, fault: str) -> np.ndarray:
    try:
        return np.array(values, dtype=float)
    except (TypeError, ValueError):
        raise InferenceError(fault) from None


def _name_list(names: Sequence[str]) -> str:
    return shorten(", ".join(names), 100, placeholder=" ...") or "none"


def check_same_rows(design_matrix: Any, response: Any) -> None:
    """Raise InferenceError if a table and a column of another table differ in their index."""
    index, other = getattr(design_matrix, "index", None), getattr(response, "index", None)
    if index is None or other is None or not hasattr(response, "to_numpy"):
        return
    if not np.array_equal(index, other):
        raise InferenceError("The table and the response must have one index, found two; take both from one table.")


def new_design(new_rows: Any, coefficients: Sequence[str], formula: Formula | None = None) -> np.ndarray:
    """Design matrix, shape (n_new, n_terms), of an array, or of a table of the columns or variables of the formula.

    InferenceError for another shape, missing or repeated columns, values that are not finite.
    """
    if not is_frame(new_rows):
        X = _numbers(new_rows, f"New rows are numbers, found {short_repr(new_rows)}; convert them.")
    elif formula is None:
        X = frame_columns(new_rows, coefficients, "New rows")
    else:
        X = formula.columns(new_rows, coefficients)
    fault = f"shape {X.shape}"
    if X.ndim == 2 and X.shape[1] == len(coefficients):
        bad = [name for name, column in zip(coefficients, X.T, strict=True) if not np.isfinite(column).all()]
        if not bad:
            return X
        fault = f"NaN or infinity in {_name_list(bad)}"
    raise InferenceError(f"New rows are finite, of shape (rows, {len(coefficients)}), found {fault}; check them.")


@dataclass(frozen=True, eq=False)
class Formula:
    """Formula of a regression, with the names of its terms and variables.

    ``terms`` (formulae.matrices.CommonEffectsMatrix) keep the state of transformations such as ``scale(v)``.
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
    """Design matrix, response and formula of a table; InferenceError for a formula that cannot be used."""
    try:
        from formulae import design_matrices
    except ImportError:
        raise InferenceError("Formulas need the package formulae, found none; install pymc-ship[formula].") from None
    if not is_frame(frame):
        raise InferenceError(f"A formula needs a table, found {short_repr(type(frame))}; give a DataFrame.")
    try:
        matrices = design_matrices(formula, frame, na_action="error", env=_FRAMES)
    except Exception as error:  # a formula may call anything
        raise InferenceError(_sentence(formula, "the table", error)) from None
    checks = {
        "no response": matrices.response is None,
        "a response that is no number": matrices.response is not None and matrices.response.kind != "numeric",
        "terms that vary by group": matrices.group is not None,
        "no term": matrices.common is None,
    }
    faults = " and ".join(fault for fault, present in checks.items() if present)
    if faults:
        raise InferenceError(
            "A formula has a response and terms that are the same for all rows, such as 'Y ~ v + r', found "
            f"{faults} in {short_repr(formula)}; change it."
        )
    named = matrices.common.as_dataframe()
    used = set().union(*(term.var_names for term in matrices.common.terms.values()))
    variables = tuple(name for name in frame_names(frame) if name in used)
    text = Formula(formula, frame_names(named), variables, matrices.common)
    return np.asarray(named, dtype=float), np.asarray(matrices.response.design_matrix, dtype=float), text


def _sentence(formula: str, what: str, error: Exception) -> str:
    reason = f"no variable {error}" if isinstance(error, KeyError) else f"{error}".rstrip(".")
    return f"The formula {short_repr(formula)} must hold for {what}, found: {reason}; correct one of them."
