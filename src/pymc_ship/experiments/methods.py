"""User-defined methods of a grid: functions, or import paths ``module:function``."""

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
    """User-defined methods by name: the given ones, and import paths among the ``names`` of a study.

    Each is called with a noisy record and a vessel and returns a :class:`pymc_ship.Estimate`; ``study`` is the name of
    the study in errors. StudyError for an import path of no function, a name of the package's own methods, and objects
    that cannot be called or pickled.
    """
    imported = {
        name: import_function(name, f"{study}: methods") for name in names if import_path(name) and name not in given
    }
    for name, method in {**given, **imported}.items():
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
    return {**given, **imported}


def method_record(name: str, own: Method | None) -> str:
    """Record of a method in a folder of results: its name and, where user-defined, a digest of its source."""
    return name if own is None else f"{name} (own, {digest(own)})"


def digest(own: Callable) -> str:
    """Digest of the source of a function, without the functions that it calls."""
    try:
        source = inspect.getsource(own)
    except (OSError, TypeError):  # an object, or a function that was typed in
        source = ""
    return hashlib.sha256(source.encode()).hexdigest()[:12]


def import_function(name: str, where: str) -> Callable:
    """Function of an import path; the working folder is searched too, as with ``python -m``."""
    if (here := str(Path.cwd())) not in sys.path:
        sys.path.append(here)
    module, _, function = name.partition(":")
    try:
        return getattr(import_module(module), function)
    except AttributeError:
        reason, remedy = f"{module} has no {function}", "correct the name"
    except Exception as error:  # whatever the user's module raises
        reason, remedy = error_text(error), "run in the folder it is found from, put that on PYTHONPATH or mend it"
    raise StudyError(f"{where} cannot have {name!r}: {reason}; {remedy}.")


def check_picklable(function: Callable, what: str) -> None:
    """Raise a StudyError unless a function can be pickled for another process."""
    from joblib.externals.loky.backend.reduction import dumps

    try:
        dumps(function)
    except Exception as error:  # whatever the function holds
        raise StudyError(
            f"{what} cannot be handed to the workers: {error_text(error)}; give a function that holds nothing but data."
        ) from None
