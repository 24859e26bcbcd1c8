"""TOML files of the user: vessels, formats of trials and studies."""

from __future__ import annotations

import tomllib
from pathlib import Path


def toml_table(path: str | Path, what: str, error: type[ValueError]) -> dict:
    """Table of a TOML file; ``error`` with one sentence, begun by ``what`` the file is, where it cannot be read."""
    try:
        with Path(path).open("rb") as file:
            return tomllib.load(file)
    except OSError as reason:
        raise error(f"{what} {path} cannot be read: {reason.strerror}; check the path.") from None
    except ValueError as reason:
        raise error(f"{what} {path} is not valid TOML: {reason}; mend it.") from None
