"""Short text of a dataclass, for its ``repr``."""

from collections.abc import Mapping, Sequence
from dataclasses import fields, is_dataclass
from textwrap import shorten
from typing import Any

LONGEST = 399  # characters of a ``repr``
_WORD = 40


def field_text(instance: Any) -> str:
    """Class and fields of a dataclass, at most :data:`LONGEST` characters; arrays and lists as their size."""
    values = ", ".join(f"{field.name}={_brief(getattr(instance, field.name))}" for field in fields(instance))
    return shorten(f"{type(instance).__name__}({values})", LONGEST, placeholder=" ...)")


def _brief(value: Any) -> str:
    if isinstance(sizes := getattr(value, "sizes", None), Mapping):
        return f"<{', '.join(f'{size} {name}' for name, size in sizes.items())}>"
    if shape := getattr(value, "shape", ()):
        return f"<{' x '.join(map(str, shape))}>"
    if isinstance(value, (Mapping, Sequence)) and not isinstance(value, str):
        return f"<{len(value)}>"
    if is_dataclass(value):
        return f"<{type(value).__name__}>"
    text = repr(value)
    return text if len(text) <= _WORD else f"{text[: _WORD - 3]}..."
