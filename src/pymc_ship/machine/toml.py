"""TOML files of the user, checked key by key: vessels, formats of trials and studies."""

from __future__ import annotations

import math
import tomllib
from collections.abc import Collection, Iterator, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, NoReturn

from pymc_ship.machine.arguments import check_choice, finite_number, short_repr
from pymc_ship.machine.text import EncodingError, utf8

_LONGEST_KEY = 60


@dataclass(frozen=True)
class Entry:
    """A value of a TOML file and where it stands; every check raises the error of the file, in one sentence.

    Attributes
    ----------
    value : object
    file : str
        What the file is called in errors.
    error : type of ValueError
    key : str
        Keys that lead to the value, with dots between them; empty for the table of the file.
    """

    value: Any
    file: str
    error: type[ValueError]
    key: str = ""

    def at(self, key: str, default: Any = None) -> Entry:
        """Entry of a key of this table, or of a default where the key is missing."""
        return replace(self, value=self.value.get(key, default), key=self._below(key))

    def __iter__(self) -> Iterator[str]:
        return iter(self.value)

    def __contains__(self, key: str) -> bool:
        return key in self.value

    def fail(self, said: str) -> NoReturn:
        """Raise the error of the file: what it is called, the key and what is said of it."""
        raise self.error(f"{self._place} {said}")

    def check_table(self) -> None:
        """Raise unless the value is a table."""
        if not isinstance(self.value, Mapping):
            self.fail(f"must be a table, found {short_repr(self.value)}; correct it.")

    def check_keys(self, known: Collection[str], required: Collection[str] = ()) -> None:
        """Raise unless the value is a table with known keys, and with those that are required."""
        self.check_table()
        for key in self:
            if key not in known:
                raise self.error(f"{self.file}: unknown key {self._below(key)}; known here are {', '.join(known)}.")
        for key in required:
            if key not in self:
                raise self.error(f"{self.file}: {self._below(key)} is missing; add it.")

    def number(self, *, least: float = -math.inf) -> float:
        """Finite number from ``least`` up."""
        return finite_number(self._place, self.value, self.error, least=least)

    def whole(self, *, least: int) -> int:
        """Whole number from ``least`` up."""
        if isinstance(self.value, bool) or not isinstance(self.value, int) or self.value < least:
            self.fail(f"must be a whole number from {least} up, found {short_repr(self.value)}; correct it.")
        return self.value

    def text(self) -> str:
        """Text."""
        if not isinstance(self.value, str):
            self.fail(f"must be a text, found {short_repr(self.value)}; put it in quotes.")
        return self.value

    def choice(self, choices: Collection[str]) -> str:
        """One of some texts."""
        check_choice(self._place, self.value, choices, self.error)
        return self.value

    @property
    def _place(self) -> str:
        return f"{self.file}: {self.key}"

    def _below(self, key: str) -> str:
        key = key if key.isprintable() and 0 < len(key) <= _LONGEST_KEY else short_repr(key)
        return f"{self.key}.{key}" if self.key else key


def toml_table(source: str | Path | Mapping[str, Any], what: str, error: type[ValueError]) -> Entry:
    """A table as it is given, or that of a TOML file; ``what`` it is called, with "file" behind it where it is one."""
    return Entry(source, what, error) if isinstance(source, Mapping) else toml_file(source, f"{what} file", error)


def toml_file(path: str | Path, what: str, error: type[ValueError]) -> Entry:
    """Table of a TOML file; ``error`` with one sentence, begun by ``what`` the file is, where it cannot be read."""
    try:
        return Entry(tomllib.loads(utf8(Path(path).read_bytes())), str(path), error)
    except OSError as reason:
        raise error(f"{what} {path} cannot be read: {reason.strerror}; check the path.") from None
    except EncodingError as reason:
        raise error(f"{what} {path} cannot be read: {reason}.") from None
    except ValueError as reason:
        raise error(f"{what} {path} is not valid TOML: {reason}; mend it.") from None
    except RecursionError:
        raise error(f"{what} {path} is not valid TOML: its tables or lists are nested too deep; mend it.") from None
