"""Vessel files with something wrong in them: numbers, keys, tables, texts, bytes."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np

ROOT = Path(__file__).parents[3]
FILES = ("models/container.toml", "models/kvlcc2.toml", "docs/tutorials/your_ship/my_ship.toml")

_NUMBER = re.compile(r"(?<=[=:] )-?\d[\d.]*(?:e-?\d+)?")
_VALUES = (
    *("nan", "inf", "-inf", "1e308", "-1e308", "5e-324", "1e-200", "0", "-0.0", "1", "-1", "1e30", "true", "false"),
    *('""', '"12"', '"\\n"', "''", "[]", "{}", "[1, 2]", "[[[[[[]]]]]]", "{ value = 1e308 }", "{ value = {} }"),
    *("2026-01-01", "12:00:00", "{ value = 1, source = 3 }", '{ value = 1, note = "x", sd = -1 }', "{ source = 1 }"),
    *("9" * 400, "9" * 5000, "0x" + "f" * 9000, "0b1", "'" + "y" * 3000 + "'", "{ a.b.c.d.e.f.g.h = 1 }"),
    *("[" * 500 + "]" * 500, "[" * 20000 + "]" * 20000, "{ a = " * 3000 + "1" + " }" * 3000),
)
_LINES = (
    *("[particulars]", "[[inertia]]", "[added_mass.Xudot]", "[coefficients]", "[propeller]", "coefficients = 3"),
    *("a = 1", "'' = 1", '"a\\nb" = 1', '"' + "k" * 5000 + '" = 1', "x" + ".x" * 2000 + " = 1", "=", "]", "\\u0000"),
    *('name = "\\u202e"', "name = ''", "title = 1", "sources = 1", "sources = [[]]", "\x00", "\x07", "é = 1"),
    *("[coefficients.roll]\nKv = 1", "[coefficients.sway]\nYv = 1", "[coefficients.heave]\nZw = 1", "d = 0"),
    *('"Y' + "v" * 5000 + '" = 1', '"Yv\\n" = 1', '"Y|v" = 1', "Ygv = 1", "XT = { sd = 1e308, value = 1e308 }"),
)


def mutated(rng: np.random.Generator) -> bytes:
    """A vessel file with one to three things wrong in it."""
    text = (ROOT / str(rng.choice(FILES))).read_text(encoding="utf-8")
    for _ in range(rng.integers(1, 4)):
        text = _TEXTUAL[rng.integers(len(_TEXTUAL))](text, rng)
    content = text.encode("utf-8", errors="surrogatepass")
    return _BINARY[rng.integers(len(_BINARY))](content, rng) if rng.random() < 0.15 else content


def _number(text: str, rng: np.random.Generator) -> str:
    """Another value instead of a number."""
    return _replaced(text, rng, str(_VALUES[rng.integers(len(_VALUES))]))


def _scaled(text: str, rng: np.random.Generator) -> str:
    """A number in another unit, or of another sign."""
    factor = float(rng.choice([-1.0, 0.0, 0.01, 0.1, 0.5, 1.944, 3.6, 10.0, 60.0, 1e3, 1e5, 1e9]))
    return _replaced(text, rng, lambda number: repr(factor * float(number)))


def _replaced(text: str, rng: np.random.Generator, value) -> str:
    numbers = list(_NUMBER.finditer(text))
    if not numbers:
        return text
    match = numbers[rng.integers(len(numbers))]
    return text[: match.start()] + (value if isinstance(value, str) else value(match[0])) + text[match.end() :]


def _line(text: str, rng: np.random.Generator) -> str:
    """A line more."""
    lines = text.splitlines()
    lines.insert(rng.integers(len(lines) + 1), str(_LINES[rng.integers(len(_LINES))]))
    return "\n".join(lines)


def _gone(text: str, rng: np.random.Generator) -> str:
    """A line less."""
    lines = text.splitlines()
    del lines[rng.integers(len(lines)) : rng.integers(len(lines)) + 1]
    return "\n".join(lines)


def _twice(text: str, rng: np.random.Generator) -> str:
    """A line twice."""
    lines = text.splitlines() or [""]
    k = rng.integers(len(lines))
    return "\n".join([*lines[:k], lines[k], *lines[k:]])


def _sign(text: str, rng: np.random.Generator) -> str:
    """A sign less, more or another."""
    k = int(rng.integers(len(text) + 1))
    return text[:k] + str(rng.choice(list("-.=[]{}\"'#\\é\x00 0e|_"))) + text[k + int(rng.integers(2)) :]


def _table(text: str, rng: np.random.Generator) -> str:
    """A table less."""
    tables = re.split(r"^(?=\[)", text, flags=re.MULTILINE)
    del tables[rng.integers(len(tables))]
    return "".join(tables)


_TEXTUAL = (_number, _number, _number, _scaled, _scaled, _scaled, _scaled, _line, _gone, _twice, _sign, _table)
_BINARY = (
    lambda content, rng: content.decode("utf-8", "replace").encode("utf-16"),
    lambda content, rng: content.decode("utf-8", "replace").encode("utf-16-le"),
    lambda content, rng: b"\xef\xbb\xbf" + content.replace(b"\n", b"\r\n"),
    lambda content, rng: rng.bytes(int(rng.integers(2000))),
    lambda content, rng: content[: rng.integers(len(content) + 1)],
    lambda content, rng: content.decode("utf-8", "replace").encode("latin-1", "replace"),
    lambda content, rng: b"",
)
