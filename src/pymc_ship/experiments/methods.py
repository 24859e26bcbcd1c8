"""Methods of the user's own in a grid: given as functions, or named by an import path ``module:function``."""

from __future__ import annotations

import hashlib
import inspect
import re
import sys
from collections.abc import Callable, Mapping, Sequence
from importlib import import_module
from pathlib import Path

from pymc_ship.experiments.task import METHODS, Method
from pymc_ship.machine.arguments import short_repr
from pymc_ship.machine.errors import StudyError
from pymc_ship.machine.workers import error_text

_IMPORT_PATH = re.compile(r"[^\W\d]\w*(\.[^\W\d]\w*)*:[^\W\d]\w*")


def import_path(name: str) -> bool:
    """Whether the name of a method is an import path, ``package.module:function``."""
    return _IMPORT_PATH.fullmatch(name) is not None


def own_methods(names: Sequence[str], given: Mapping[str, Method], study: str) -> dict[str, Method]:
    """Methods of the user's own by name: those given, and those that a study names by an import path.

    Parameters
    ----------
    names : sequence of str
        Of all methods of the study.
    given : mapping of str to callable
    study : str
        What the study is called in errors.

    Returns
    -------
    dict of str to callable
        Each takes a noisy record and a vessel and returns a :class:`pymc_ship.Estimate`.

    Raises
    ------
    StudyError
        For an import path that leads to no function, a name that the package has already, and what cannot be called or
        handed to another process.
    """
    found = {
        name: import_function(name, f"{study}: methods") for name in names if import_path(name) and name not in given
    }
    for name, method in {**given, **found}.items():
        if not isinstance(name, str) or not name or name in METHODS:
            raise StudyError(
                f"{study}: a method of your own has a name that the package does not have, found {short_repr(name)}; "
                "rename it."
            )
        if not callable(method):
            raise StudyError(
                f"{study}: the method {name!r} must be a function of a noisy record and a vessel, found "
                f"{short_repr(method)}; give the function."
            )
        check_picklable(method, f"{study}: the method {name!r}")
    return {**given, **found}


def method_record(name: str, own: Method | None) -> str:
    """What a folder of results keeps of a method: its name and, of one of the user's own, a digest of its source."""
    if own is None:
        return name
    return f"{name} (own, {digest(own)})"


def digest(own: Callable) -> str:
    """Of the source of a function alone, not of what it calls."""
    try:
        source = inspect.getsource(own)
    except (OSError, TypeError):  # an object, or a function that was typed in
        source = ""
    return hashlib.sha256(source.encode()).hexdigest()[:12]


def import_function(name: str, place: str) -> Callable:
    """Function of an import path, found from the working folder, too, as ``python -m`` finds it."""
    if (here := str(Path.cwd())) not in sys.path:
        sys.path.append(here)
    module, _, function = name.partition(":")
    try:
        return getattr(import_module(module), function)
    except AttributeError:
        reason, remedy = f"{module} has no {function}", "correct the name"
    except Exception as error:  # whatever the user's module raises
        reason, remedy = error_text(error), "run in the folder it is found from, put that on PYTHONPATH or mend it"
    raise StudyError(f"{place} cannot have {name!r}: {reason}; {remedy}.")


def check_picklable(function: Callable, what: str) -> None:
    """Raise unless a function can be sent to another process."""
    from joblib.externals.loky.backend.reduction import dumps

    try:
        dumps(function)
    except Exception as error:  # whatever the function holds
        raise StudyError(
            f"{what} cannot be handed to the workers: {error_text(error)}; give a function that holds nothing but data."
        ) from None
