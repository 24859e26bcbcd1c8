"""Checks of single values; an error is one sentence: rule, value, remedy."""

from __future__ import annotations

import math
from collections.abc import Iterable
from contextlib import suppress
from reprlib import Repr
from typing import Any

_SHORT = Repr(maxlevel=3, maxstring=60, maxlong=60, maxother=60)
_LONGEST = 100


def short_repr(value: object) -> str:
    """``repr`` of a value, at most 100 characters."""
    try:
        text = _SHORT.repr(value)
    except ValueError:
        return "a number of thousands of digits"
    return text if len(text) <= _LONGEST else f"{text[: _LONGEST - 4]} ..."


def check_choice(what: str, value: object, choices: Iterable[str], error: type[ValueError] = ValueError) -> None:
    """Raise ``error``, with ``what`` as the subject of its sentence, unless a value is one of the choices."""
    known = tuple(choices)
    if value not in known:
        names = ", ".join(choice if choice[:1].isalnum() else repr(choice) for choice in known)
        raise error(f"{what} is one of {names}; found {short_repr(value)}; choose one of them.")


def finite_number(what: str, value: Any, error: type[ValueError] = ValueError, *, least: float = -math.inf) -> float:
    """Value as a float; ``error`` for a bool, a text, NaN, infinity or a value below ``least``."""
    number = math.nan
    if not isinstance(value, bool | str | bytes):
        with suppress(TypeError, ValueError, OverflowError):
            number = float(value)
    if not (math.isfinite(number) and number >= least):
        rule = "a finite number" if least == -math.inf else f"a number from {least:g} up"
        raise error(f"{what} must be {rule}, found {short_repr(value)}; correct it.")
    return number
