"""Checks of values and arrays; an error is one sentence: rule, value, remedy."""

import math
from collections.abc import Callable, Iterable
from contextlib import suppress
from pathlib import Path
from reprlib import Repr
from typing import Any

import numpy as np

from pymc_ship.machine.errors import ShipError
from pymc_ship.machine.names import did_you_mean

_SHORT = Repr(maxlevel=3, maxstring=60, maxlong=60, maxother=60)
_LONGEST = 100
_KINDS = {"c": "complex values", "U": "texts", "S": "texts", "M": "dates", "m": "durations"}  # of NumPy
_MISSING = ("NoneType", "NAType", "NaTType", "MaskedConstant")  # of Python, pandas and NumPy


def short_repr(value: object) -> str:
    """``repr`` of a value in one line of at most 100 characters."""
    try:
        text = _SHORT.repr(value)
    except ValueError:
        return "a number of thousands of digits"
    text = " ".join(line.strip() for line in text.splitlines())
    return text if len(text) <= _LONGEST else f"{text[: _LONGEST - 4]} ..."


def check_kind(what: str, value: object, kind: type, remedy: str, error: type[ValueError] = ShipError) -> None:
    """Raise ``error``, with ``what`` as the subject of its sentence, unless a value is of a kind."""
    if not isinstance(value, kind):
        raise error(f"{what} must be a {kind.__name__}, found {short_repr(type(value))}; {remedy}.")


def check_choice(what: str, value: object, choices: Iterable[str], error: type[ValueError] = ShipError) -> None:
    """Raise ``error``, with ``what`` as the subject of its sentence, unless a value is one of the choices."""
    known = tuple(choices)
    if not isinstance(value, str) or value not in known:
        names = ", ".join(choice if choice[:1].isalnum() else repr(choice) for choice in known)
        hint = did_you_mean(value, known)
        raise error(f"{what} is one of {names}; found {short_repr(value)}{hint}; choose one of them.")


def as_path(name: str, path: object, error: type[ValueError] = ShipError) -> Path:
    """Path of a text or a Path; ``error``, which names it, for anything else."""
    if not isinstance(path, str | Path):
        raise error(f"{name} must be a path, a str or a Path, found {short_repr(type(path))}; give one.")
    return Path(path)


def number_or_nan(value: Any) -> float:
    """Value as a float; NaN for a bool, a text and anything else that is no number."""
    if not isinstance(value, bool | str | bytes):
        with suppress(TypeError, ValueError, OverflowError):
            return float(value)
    return math.nan


def finite_number(what: str, value: Any, error: type[ValueError] = ShipError, *, least: float = -math.inf) -> float:
    """Value as a float; ``error`` for a bool, a text, NaN, infinity or a value below ``least``."""
    number = number_or_nan(value)
    if not (math.isfinite(number) and number >= least):
        rule = "a finite number" if least == -math.inf else f"a number from {least:g} up"
        raise error(f"{what} must be {rule}, found {short_repr(value)}; correct it.")
    return number


def check_counts(error: type[ValueError] = ShipError, *, least: int = 1, **counts: Any) -> None:
    """Raise ``error``, which names it, for a count that is no whole number, or below ``least``."""
    for name, value in counts.items():
        if isinstance(value, bool) or not isinstance(value, int | np.integer) or value < least:
            raise error(f"{name} must be a whole number from {least} up, found {short_repr(value)}; correct it.")


def check_flags(error: type[ValueError] = ShipError, **flags: Any) -> None:
    """Raise ``error``, which names it, for a flag that is neither True nor False, such as the text "no"."""
    for name, value in flags.items():
        if not isinstance(value, bool | np.bool_):
            raise error(f"{name} is True or False, found {short_repr(value)}; choose one of them.")


def check_callables(**functions: Callable[..., Any]) -> None:
    """Raise a ShipError, which names it, for an argument that is no function."""
    for name, value in functions.items():
        if not callable(value):
            raise ShipError(f"{name} must be a function, found {short_repr(type(value))}; give one.")


def check_probabilities(**probabilities: Any) -> None:
    """Raise a ShipError, which names it, for a probability that does not lie between 0 and 1."""
    for name, value in probabilities.items():
        if not 0.0 < finite_number(name, value) < 1.0:
            raise ShipError(f"{name} must lie between 0 and 1, found {value}; correct it.")


def real_array(what: str, values: Any, error: type[ValueError] = ShipError) -> np.ndarray:
    """Values as a new array of floats, with their NaN; ``error`` for masked, missing or complex values, texts, dates.

    Every array from outside enters here: NumPy alone takes the fill value of a masked one, 9.97e36 in netCDF4.
    """
    values = values.compute() if hasattr(values, "compute") else values  # of dask, whose conversion drops masks
    _check_unmasked(f"{what} must be real numbers", values, error)
    array = None
    with suppress(TypeError, ValueError):  # of rows of different length
        array = np.asarray(values)
    if array is not None and array.dtype.kind == "O":
        array = _from_objects(what, array, error)
    if array is None or array.dtype.kind not in "biuf":
        kind = "" if array is None else _KINDS.get(array.dtype.kind, "")
        raise error(f"{what} must be real numbers, found {kind or short_repr(values)}; convert them.")
    return np.array(array, dtype=float, order="C")


def probability_array(values: Any, error: type[ValueError] = ShipError) -> np.ndarray:
    """Probabilities from 0 to 1 as a new array, shape (n,), of one number also; ``error`` for any other."""
    probabilities = np.atleast_1d(real_array("Probabilities", values, error))
    wrong = probabilities[~((probabilities >= 0.0) & (probabilities <= 1.0))]
    if wrong.size:
        raise error(f"Probabilities must lie from 0 to 1, found {wrong.flat[0]:g}; correct it.")
    return probabilities


def label_array(what: str, values: Any, error: type[ValueError] = ShipError) -> np.ndarray:
    """Values as a new array of texts; ``error`` for masked or missing ones, of which NumPy makes names."""
    _check_unmasked(f"{what} must be labels", values, error)
    objects = np.array(values, dtype=object)
    missing = sum(map(_is_missing, objects.ravel().tolist()))
    if missing:
        raise error(f"{what} must be labels, found {missing} missing; fill the gaps or leave them out.")
    return objects.astype(str)


def name_list(what: str, names: Any, error: type[ValueError] = ShipError) -> tuple[str, ...]:
    """Names as texts; ``error`` for one text, which is no list of its letters, and for names that do not differ."""
    if isinstance(names, str | bytes) or not isinstance(names, Iterable):
        raise error(f"{what} must be a list of names, found {short_repr(names)}; put one name into a list.")
    found = tuple(map(str, names))
    twice = sorted({name for name in found if found.count(name) > 1})
    if twice:
        raise error(f"{what} must differ, found {', '.join(twice)} more than once; rename or leave out.")
    return found


def _check_unmasked(rule: str, values: Any, error: type[ValueError]) -> None:
    parts = values if isinstance(values, list | tuple) else [values]
    masked = sum(np.count_nonzero(np.ma.getmaskarray(part)) for part in parts if np.ma.is_masked(part))
    if masked:
        raise error(f"{rule}, found {masked} masked; fill the gaps or leave them out.")


def _is_missing(item: Any) -> bool:
    return type(item).__name__ in _MISSING or (isinstance(item, float) and item != item)


def _from_objects(what: str, objects: np.ndarray, error: type[ValueError]) -> np.ndarray:
    """Floats of an array of Python objects, the array itself if they are no numbers; ``error`` for missing ones."""
    items = objects.ravel().tolist()
    missing = sum(type(item).__name__ in _MISSING for item in items)
    if missing:
        raise error(f"{what} must be real numbers, found {missing} missing; fill the gaps or leave them out.")
    if any(isinstance(item, str | bytes) for item in items):
        return objects.astype(str)
    with suppress(TypeError, ValueError, OverflowError):
        return objects.astype(float)
    return objects.astype(complex) if any(isinstance(item, complex) for item in items) else objects
