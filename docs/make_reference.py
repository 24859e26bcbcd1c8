"""Write the pages that come from the code: the public names by district, and every command with its options.

python docs/make_reference.py [FOLDER]
"""

from __future__ import annotations

import argparse
import inspect
import re
import sys
from collections import Counter
from pathlib import Path

import pymc_ship as ps
from pymc_ship.cli.parser import parser

API = """# API

Public names after `import pymc_ship as ps`, by [district](../explanation/architecture.md). Links lead to the source;
`make docs` adds the docstrings.
"""

COMMANDS = """# Commands

`pymc-ship COMMAND --help` prints the same. Wrong input ends with one sentence and exit status 2. Defaults are in
parentheses. [Durations](durations.md) of every command.

## Common words

"""

COMMON = 2
"""Commands from which on a word with the same meaning stands in the table of common words."""


def api() -> str:
    """Page of the public names."""
    public = [getattr(ps, name) for name in ps.__all__ if name != "__version__"]
    districts = dict.fromkeys(map(_district, public))
    text = API
    for district in districts:
        names = [value for value in public if _district(value) == district]
        text += f"\n## {district}\n\n" + "\n".join(map(_public_line, names)) + "\n"
    return text


def _district(value) -> str:
    """District of a public name."""
    return value.__module__.split(".")[1]


def _public_line(value) -> str:
    source = f"../../src/{value.__module__.replace('.', '/')}.py"
    summary = inspect.getdoc(value).partition("\n")[0]
    summary = re.sub(r":\w+:`~?([^`]+)`", lambda role: f"`{role[1].removeprefix('pymc_ship.')}`", summary)
    return f"- [`ps.{value.__name__}`]({source}): {summary.replace('``', '`')}"


def commands() -> str:
    """Page of the commands."""
    choices = next(action.choices for action in parser()._actions if action.dest == "command")
    rows = {name: [(_word(action), _help(action)) for action in _words(command)] for name, command in choices.items()}
    counts = Counter(row for words in rows.values() for row in words)
    common = [row for row, count in counts.items() if count >= COMMON]
    general = [row for row, count in counts.items() if count == len(rows)]
    rows = {name: [row for row in words if row not in general] for name, words in rows.items()}
    pages = [_command(name, command, rows[name], common) for name, command in choices.items()]
    return COMMANDS + _list(common) + "".join(pages)


def _words(command: argparse.ArgumentParser) -> list[argparse.Action]:
    return [action for action in command._actions if action.dest != "help"]


def _command(name: str, command: argparse.ArgumentParser, rows: list, common: list) -> str:
    examples, remarks = _epilog(command.epilog)
    shared = ", ".join(re.sub(r"(--[\w-]+)[^`]*", r"\1", word) for word, text in rows if (word, text) in common)
    own = _list([row for row in rows if row not in common])
    described = "\n".join(filter(None, [f"Common: {shared}.\n" if shared else "", own]))
    return f"\n## {name}\n\n{_sentence(command.description)}\n\n```sh\n{examples}\n```\n\n{remarks}{described}"


def _list(rows: list) -> str:
    words: dict[str, list[str]] = {}
    for word, text in rows:
        words.setdefault(text, []).append(word)
    return "".join(f"- {', '.join(alike)}: {text}\n" for text, alike in words.items())


def _word(action: argparse.Action) -> str:
    name = max(action.option_strings, key=len, default="")
    choices = f"{{{','.join(map(str, action.choices))}}}" if action.choices else action.dest.upper()
    named = " ".join(action.metavar) if isinstance(action.metavar, tuple) else action.metavar
    value = "" if action.nargs == 0 else named or choices
    text = " ".join(filter(None, [name, value, "..." if action.nargs == "+" else ""]))
    return f"`{text}`" + (" (needed)" if action.required and name else "")


def _help(action: argparse.Action) -> str:
    return re.sub(r"[\w./-]*(<\w+>[\w./-]*)+", r"`\g<0>`", action.help % {"default": action.default})


def _epilog(epilog: str) -> tuple[str, str]:
    """Examples as a shell block, and the remarks below them."""
    lines = epilog.strip().splitlines()[1:]
    examples = [line.strip() for line in lines if line.startswith("  ")]
    remarks = [_sentence(line) for line in lines if line and not line.startswith("  ")]
    return "\n".join(examples), "".join(f"{remark}\n\n" for remark in remarks)


def _sentence(text: str) -> str:
    text = text[0].upper() + text[1:]
    return text if text.endswith(".") else f"{text}."


PAGES = {"api.md": api, "commands.md": commands}
"""Pages of the reference that are written here."""


def main(folder: Path) -> None:
    """Write every page."""
    for name, page in PAGES.items():
        (folder / name).write_text(page(), encoding="utf-8")


if __name__ == "__main__":
    main(Path(sys.argv[1]) if len(sys.argv) > 1 else Path(__file__).parent / "reference")
