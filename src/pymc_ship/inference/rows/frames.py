"""Rows from tables: columns of a DataFrame by name, and the terms of a formula.

pandas is not imported: a table is any object with ``columns`` and ``to_numpy``.
"""

from __future__ import annotations

import copy
import pickle
import re
from collections.abc import Callable, Iterable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field, replace
from functools import partial
from importlib import import_module
from logging import WARNING, getLogger
from logging.handlers import BufferingHandler
from textwrap import shorten
from types import ModuleType
from typing import Any

import numpy as np

from pymc_ship.machine.arguments import real_array, short_repr
from pymc_ship.machine.errors import InferenceError

_FRAMES = 2
"""Stack frames from the user's call to that of formulae, which looks up functions of a formula in the user's scope."""

_SAMPLE_ROWS = 8  # fitted rows, at most, whose terms are computed again before a prediction

_NAMES = re.compile(r"(?<![\w.])[^\W\d]\w*(?![\w.(]|\s*=)")
"""Names in a formula without its quoted texts that are no functions, modules or keywords."""

_QUOTED = re.compile(r"'[^']*'|\"[^\"]*\"|`([^`]*)`")
"""Texts in a formula, such as levels; what stands in backticks is a name."""


def is_frame(table: object) -> bool:
    """Whether a table has named columns, as a DataFrame of pandas."""
    return hasattr(table, "columns") and hasattr(table, "to_numpy")


def frame_names(frame: Any) -> tuple[str, ...]:
    """Names of the columns of a table."""
    return tuple(map(str, frame.columns))


def column_names(table: Any) -> tuple[str, ...] | None:
    """Names of the columns of a table, or of an array of xarray with labels that are texts; None for others."""
    if is_frame(table):
        return frame_names(table)
    dims = _labelled_dims(table)
    index = table.indexes.get(dims[-1]) if dims else None
    return None if index is None or index.dtype.kind in "iuf" else tuple(map(str, index))


def _labelled_dims(array: Any) -> tuple[str, ...]:
    """Dims of an array of xarray; none of anything else, such as a Dataset, whose dims are no tuple."""
    dims = getattr(array, "dims", ())
    return dims if isinstance(dims, tuple) and hasattr(array, "indexes") else ()


def frame_columns(frame: Any, names: Sequence[str], what: str) -> np.ndarray:
    """Columns of a table by name, shape (n_rows, n_names); InferenceError if missing, repeated or not numeric."""
    check_names(frame, names, what)
    available, values = frame_names(frame), frame.to_numpy()
    if values.dtype.kind == "c":  # of one column makes all complex
        values = frame.to_numpy(dtype=object)
    columns = [real_array(f"The column {name}", values[:, available.index(name)], InferenceError) for name in names]
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


def _name_list(names: Sequence[str]) -> str:
    return shorten(", ".join(names), 100, placeholder=" ...") or "none"


def row_labels(values: Any) -> Any:
    """Index of the rows of a table or a Series of pandas, or of a labelled array of xarray; None for others."""
    if not hasattr(values, "to_numpy"):
        return None
    return values.indexes.get(values.dims[0]) if getattr(values, "dims", ()) else getattr(values, "index", None)


def check_same_rows(design_matrix: Any, column: Any, what: str) -> None:
    """Raise InferenceError if a table or labelled array and a column of another one differ in their index."""
    index, other = row_labels(design_matrix), row_labels(column)
    if index is not None and other is not None and not index.equals(other):
        raise InferenceError(f"The table and the {what} must have one index, found two; take both from one table.")


def new_design(new_rows: Any, coefficients: Sequence[str], formula: Formula | None = None) -> np.ndarray:
    """Design matrix, shape (n_new, n_terms), of an array, or of a table of the columns or variables of the formula.

    InferenceError for another shape, missing or repeated columns, values that are not finite, fixed coefficients.
    """
    if not is_frame(new_rows):
        X = real_array("New rows", by_label(new_rows, coefficients, "New rows"), InferenceError)
    elif formula is None:
        X = frame_columns(new_rows, coefficients, "New rows")
    else:
        fixed = [name for name in formula.names if name not in coefficients]
        if fixed:
            raise InferenceError(
                f"New rows of a formula need all of its coefficients, found {_name_list(fixed)} held fixed; predict by "
                "the posterior of restore_fixed with the whole data, or give an array of the free columns and add the "
                "fixed part."
            )
        X = formula.columns(new_rows, coefficients)
    fault = f"shape {X.shape}"
    if X.ndim == 2 and X.shape[1] == len(coefficients):
        bad = [name for name, column in zip(coefficients, X.T, strict=True) if not np.isfinite(column).all()]
        if not bad:
            return X
        fault = f"NaN or infinity in {_name_list(bad)}"
    raise InferenceError(f"New rows are finite, of shape (rows, {len(coefficients)}), found {fault}; check them.")


def by_label(rows: Any, names: Sequence[str], what: str) -> Any:
    """Array of xarray with the columns of these labels, in this order; InferenceError for labels of other columns."""
    for dim in (dim for dim in reversed(_labelled_dims(rows)) if dim in rows.indexes):
        labels = list(map(str, rows.indexes[dim]))
        chosen = len(labels) == len(names) or rows.indexes[dim].dtype.kind not in "iuf"  # numbers may be those of rows
        if chosen and all(labels.count(name) == 1 for name in names):
            return rows.isel({dim: [labels.index(name) for name in names]}).transpose(..., dim)
    found = column_names(rows)
    if found is not None:
        raise InferenceError(f"{what} need the columns {_name_list(names)}, found {_name_list(found)}; rename them.")
    return rows


@dataclass(frozen=True, eq=False)
class Formula:
    """Formula of a regression, with the names of its terms and variables."""

    text: str
    names: tuple[str, ...]
    variables: tuple[str, ...]
    terms: Any  # CommonEffectsMatrix of formulae, with the state of transformations such as ``scale(v)``
    scope: _Scope  # the user's variables and functions
    sample: tuple[Any, np.ndarray]  # table of some fitted rows, with their terms
    floats: Mapping[str, str] = field(default_factory=dict)  # types by name of integer variables
    pools_response: bool = False  # whether the response of a row depends on other rows

    def columns(self, frame: Any, coefficients: Sequence[str]) -> np.ndarray:
        """Terms of the given names for a table of the variables, shape (n_new, n_names)."""
        check_names(frame, self.variables, "New rows")
        rows, fitted = self.sample
        limit = 1e-9 * np.abs(fitted).max(axis=0)
        different = np.abs(self._evaluate(rows) - fitted).max(axis=0) > limit
        for k, row in enumerate(fitted):
            with suppress(InferenceError):  # of a function that needs more rows
                different |= np.abs(self._evaluate(rows.iloc[[k]])[0] - row) > limit
        if different.any():
            raise InferenceError(
                f"Fitted rows must keep their terms, also without the other rows, found other values of "
                f"{_name_list(np.array(self.names)[different])} in {short_repr(self.text)}; restore the variables of "
                "its functions, or use functions of one row and center(), scale() or poly()."
            )
        return self._evaluate(frame)[:, [self.names.index(name) for name in coefficients]]

    def _evaluate(self, frame: Any) -> np.ndarray:
        try:
            design = self.terms.evaluate_new_data(_converted(frame, self.floats)).design_matrix
        except Exception as error:  # a formula may call anything
            raise InferenceError(_sentence(self.text, "the new rows", error)) from None
        return real_array("The terms of the formula", design, InferenceError)

    def __deepcopy__(self, memo: dict) -> Formula:
        return self

    def __getstate__(self) -> dict[str, Any]:
        local = [name for name, value in self.scope.items() if not _is_picklable(value)]
        if local:
            raise InferenceError(
                f"A formula is written to a file with its variables and functions, found {_name_list(local)}, which "
                "pickle cannot write; define functions by def in a module."
            )
        return self.__dict__


class _Scope(dict):
    """Variables and functions that a formula takes from where it is written, by name, as they are at the fit."""

    outer: Any = None  # Environment of formulae, where missing names are looked up

    def __missing__(self, name: str) -> Any:
        if self.outer is None:
            raise KeyError(name)
        value = self.outer.namespace[name]
        with suppress(Exception):  # a module, for example, cannot be copied
            value = copy.deepcopy(value)
        self[name] = value
        return value

    def __reduce__(self) -> tuple:
        return _restored_scope, ({k: _Module(v.__name__) if _is_module(v) else v for k, v in self.items()},)


class _Module(str):
    """Name of a module of a scope in a file."""


def _restored_scope(names: dict[str, Any]) -> _Scope:
    return _Scope({k: import_module(v) if isinstance(v, _Module) else v for k, v in names.items()})


def _is_module(value: Any) -> bool:
    return isinstance(value, ModuleType)


def _is_picklable(value: Any) -> bool:
    with suppress(Exception):
        return _is_module(value) or bool(pickle.dumps(value))
    return False


def formula_rows(formula: str, frame: Any) -> tuple[np.ndarray, np.ndarray, Formula]:
    """Design matrix, response and formula of a table; InferenceError for a formula that cannot be used."""
    try:
        from formulae import design_matrices
        from formulae.environment import Environment
    except ImportError:
        raise InferenceError("Formulas need the package formulae, found none; install pymc-ship[formula].") from None
    if not is_frame(frame):
        raise InferenceError(f"A formula needs a table, found {short_repr(type(frame))}; give a DataFrame.")
    used = [name for name in dict.fromkeys(_written_names(str(formula))) if name in frame_names(frame)]
    check_names(frame, used, f"The rows of {short_repr(formula)}")
    scope, log, messages = _Scope(), getLogger("formulae"), BufferingHandler(1000)  # formulae logs what it leaves out
    messages.setLevel(WARNING)
    scope.outer = Environment.capture(_FRAMES)
    log.addHandler(messages)
    try:
        make = partial(design_matrices, na_action="error", env=Environment([scope]))
        matrices = make(formula, frame)
        if floats := _floats(frame, matrices):
            matrices = make(formula, frame := _converted(frame, floats))
        unread = _unread(formula)
    except Exception as error:  # a formula may call anything
        raise InferenceError(_sentence(formula, "the table", error)) from None
    finally:
        scope.outer = None
        log.removeHandler(messages)
    remarks = [" ".join(message.getMessage().split()) for message in messages.buffer]
    remarks += [f"a term ends before {short_repr(unread)}"] if unread else []
    if remarks:
        raise InferenceError(_sentence(formula, "the table", " ".join(remarks)))
    _check_terms(formula, frame, matrices)
    terms, named = matrices.common, matrices.common.as_dataframe()
    terms.data = terms.env = None
    variables = tuple(name for name in frame_names(frame) if name in _variables(terms.terms.values()))
    columns = real_array("The terms of the formula", named.to_numpy(), InferenceError)
    few = np.unique(np.linspace(0, len(columns) - 1, min(_SAMPLE_ROWS, (len(columns) + 1) // 2)).round().astype(int))
    sample = frame[list(variables)].iloc[few].copy(), columns[few]
    response = matrices.response.design_matrix
    pools = _pools_response(partial(make, formula.partition("~")[0] + "~ 1"), frame.iloc[few], response[few])
    parsed = Formula(formula, frame_names(named), variables, terms, scope, sample)
    return columns, response, replace(parsed, floats=floats, pools_response=pools)


def _floats(frame: Any, matrices: Any) -> dict[str, str]:
    """Types of integer variables in which products do not overflow; categories stay integers."""
    terms = [] if matrices.common is None else list(matrices.common.terms.values())
    terms += [] if matrices.response is None else [matrices.response.term.term]
    parts = [part for term in terms for part in getattr(term, "components", ())]
    categories = set().union(*(part.var_names for part in parts if part.kind == "categoric"))
    names = [name for name in frame.columns if name in _variables(terms)]
    integers = [name for name in names if getattr(frame[name].dtype, "kind", "O") in "iu"]
    return {name: "int64" if name in categories else "float64" for name in integers}


def _converted(frame: Any, types: Mapping[str, str]) -> Any:
    integers = {name: kind for name, kind in types.items() if getattr(frame[name].dtype, "kind", "O") in "iu"}
    return frame.astype(integers) if integers else frame


def _pools_response(make: Callable[[Any], Any], rows: Any, response: np.ndarray) -> bool:
    """Whether the response of some rows is another one without the others."""
    with suppress(Exception):  # of a function that needs more rows
        alone = make(rows).response.design_matrix
        return bool(np.abs(alone - response).max() > 1e-9 * np.abs(response).max())
    return True


def _unread(formula: str) -> str:
    """End of a formula that formulae leaves out without a word, such as that of ``Y ~ v == 2``."""
    from formulae.parser import Parser
    from formulae.scanner import Scanner

    parser = Parser(Scanner(formula).scan())
    parser.parse()
    return " ".join(token.lexeme for token in parser.tokens[parser.current :]).strip()


def _written_names(formula: str) -> list[str]:
    return [*_NAMES.findall(_QUOTED.sub(" ", formula)), *filter(None, _QUOTED.findall(formula))]


def _variables(terms: Iterable[Any]) -> set[str]:
    return set().union(*(term.var_names for term in terms))


def _check_terms(formula: str, frame: Any, matrices: Any) -> None:
    response, terms = matrices.response, [] if matrices.common is None else list(matrices.common.terms.values())
    offsets = [part.name for term in terms for part in getattr(term, "components", ()) if part.kind == "offset"]
    if offsets:
        raise InferenceError(
            f"A formula has only terms whose coefficients are estimated, found {_name_list(offsets)}; write the "
            "variable without offset() and fix its coefficient at 1 by hold_fixed."
        )
    bare = [part.name for term in terms for part in getattr(term, "components", ()) if part.kind == "categoric"]
    if texts := [name for name in bare if name in frame_names(frame) and _are_numbers(frame[name])]:
        raise InferenceError(
            f"Texts are categories in a formula, found numbers stored as text in {_name_list(texts)}; convert them by "
            f"pandas.to_numeric, or write C({texts[0]})."
        )
    used = _variables([*terms, *([] if response is None else [response.term.term])])
    idle = [name for name in frame_names(frame) if name in _written_names(formula) and name not in used]
    faults = {
        "no response": response is None,
        "a response that is no number": response is not None and response.kind != "numeric",
        "the response among the terms": response is not None and response.name in [term.name for term in terms],
        "masked values": any(isinstance(term.data, np.ma.MaskedArray) for term in terms),
        "terms that vary by group": matrices.group is not None,
        "no term": not terms,
        f"{_name_list(idle)} in no term": matrices.group is None and bool(idle),
    }
    present = " and ".join(fault for fault, applies in faults.items() if applies)
    if present:
        raise InferenceError(
            "A formula has a response and terms that are the same for all rows, such as 'Y ~ v + r', found "
            f"{present} in {short_repr(formula)}; change it."
        )


def _are_numbers(texts: Iterable[Any]) -> bool:
    try:
        return [float(text) for text in texts if isinstance(text, str)] != []
    except ValueError:
        return False


def _sentence(formula: str, what: str, error: Exception | str) -> str:
    reason = f"no variable {error}" if isinstance(error, KeyError) else f"{error}".rstrip(".")
    if "unrecognized type" in reason:
        reason = "a column of Python objects, neither numbers nor texts"
    if isinstance(error, KeyError) and re.search(rf"\b{re.escape(str(error.args[0]))}\.\w", formula):
        reason = f"a method of {error}, in place of a function"
    return f"The formula {short_repr(formula)} must hold for {what}, found: {reason}; correct one of them."
