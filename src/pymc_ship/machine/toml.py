"""TOML files of vessels, trial formats and studies, checked key by key."""

import math
import tomllib
from collections.abc import Collection, Iterator, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, NoReturn

from pymc_ship.machine.arguments import as_path, check_choice, finite_number, short_repr
from pymc_ship.machine.names import did_you_mean
from pymc_ship.machine.text import TextError, file_text

_LONGEST_KEY = 60


@dataclass(frozen=True)
class Entry:
    """A value of a TOML file; every check raises its error in one sentence."""

    value: Any
    file: str  # its name
    error: type[ValueError]
    key: str = ""  # dotted; empty for the whole file

    def at(self, key: str, default: Any = None) -> "Entry":
        """Entry of a key of this table, or of the default if the key is missing."""
        return replace(self, value=self.value.get(key, default), key=self._full_key(key))

    def __iter__(self) -> Iterator[str]:
        return iter(self.value)

    def __contains__(self, key: str) -> bool:
        return key in self.value

    def fail(self, text: str) -> NoReturn:
        """Raise the error of the file: file name, key and a text such as "must be ..."."""
        raise self.error(f"{self._subject} {text}")

    def check_table(self) -> None:
        """Raise unless the value is a table."""
        if not isinstance(self.value, Mapping):
            self.fail(f"must be a table, found {short_repr(self.value)}; correct it.")

    def check_keys(self, known: Collection[str], required: Collection[str] = ()) -> None:
        """Raise unless the value is a table with known keys only and all required keys."""
        self.check_table()
        for key in self:
            if key not in known:
                names = f"{', '.join(known)}{did_you_mean(key, known)}"
                raise self.error(f"{self.file}: unknown key {self._full_key(key)}; known here are {names}.")
        for key in required:
            if key not in self:
                raise self.error(f"{self.file}: {self._full_key(key)} is missing; add it.")

    def number(self, *, least: float = -math.inf) -> float:
        """The value, which must be a finite number from ``least`` up."""
        return finite_number(self._subject, self.value, self.error, least=least)

    def whole(self, *, least: int) -> int:
        """The value, which must be a whole number from ``least`` up."""
        if isinstance(self.value, bool) or not isinstance(self.value, int) or self.value < least:
            self.fail(f"must be a whole number from {least} up, found {short_repr(self.value)}; correct it.")
        return self.value

    def text(self) -> str:
        """The value, which must be a text."""
        if not isinstance(self.value, str):
            self.fail(f"must be a text, found {short_repr(self.value)}; put it in quotes.")
        return self.value

    def choice(self, choices: Collection[str]) -> str:
        """The value, which must be one of the choices."""
        check_choice(self._subject, self.value, choices, self.error)
        return self.value

    @property
    def _subject(self) -> str:
        return f"{self.file}: {self.key}"

    def _full_key(self, key: str) -> str:
        key = key if key.isprintable() and 0 < len(key) <= _LONGEST_KEY else short_repr(key)
        return f"{self.key}.{key}" if self.key else key


def toml_table(source: str | Path | Mapping[str, Any], what: str, error: type[ValueError]) -> Entry:
    """Entry of a mapping or of a TOML file; ``what`` names it in errors."""
    if isinstance(source, Mapping):
        return Entry(source, what, error)
    return toml_file(as_path(f"{what} file", source, error), f"{what} file", error)


def toml_file(path: str | Path, what: str, error: type[ValueError]) -> Entry:
    """Entry of a TOML file; raises ``error`` with ``what`` as its subject if the file cannot be read."""
    try:
        return Entry(tomllib.loads(file_text(path)), str(path), error)
    except TextError as reason:
        raise error(f"{what} {path} cannot be read: {reason}.") from None
    except ValueError as reason:
        raise error(f"{what} {path} is not valid TOML: {reason}; mend it.") from None
    except RecursionError:
        raise error(f"{what} {path} is not valid TOML: its tables or lists are nested too deep; mend it.") from None
