"""The pages of the documentation: README and everything under ``docs/`` in Markdown, taken apart for the tests."""

from __future__ import annotations

import re
import shlex
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

ROOT = Path(__file__).parents[2]

_PROGRAM = "pymc-ship"
_FENCED = re.compile(r"^```(\w*)\n(.*?)^```$", flags=re.MULTILINE | re.DOTALL)


@dataclass(frozen=True)
class Page:
    """A page by its path from the root of the repository."""

    path: str

    @cached_property
    def text(self) -> str:
        return (ROOT / self.path).read_text(encoding="utf-8")

    @property
    def prose(self) -> str:
        """The text without its blocks."""
        return _FENCED.sub("", self.text)

    @property
    def languages(self) -> list[str]:
        """Language of every block, from the fences that open one."""
        return re.findall(r"^```(.*)$", self.text, flags=re.MULTILINE)[::2]

    def blocks(self, language: str) -> list[str]:
        """Blocks of a language."""
        return [code for found, code in _FENCED.findall(self.text) if found == language]

    @property
    def shell_words(self) -> list[list[str]]:
        """Words of every line of a shell block, without its comment."""
        lines = [shlex.split(line, comments=True) for block in self.blocks("sh") for line in block.splitlines()]
        return [words for words in lines if words]

    @property
    def commands(self) -> list[list[str]]:
        """Words after ``pymc-ship`` of every command, in a block or inline, that is not a request for help."""
        inline = [shlex.split(code) for code in re.findall(rf"`({_PROGRAM} [^`]+)`", self.prose)]
        found = [words for words in [*self.shell_words, *inline] if words[0] == _PROGRAM and "--help" not in words]
        return [words[1:] for words in found]

    @property
    def targets(self) -> set[str]:
        """Targets of make that the page names."""
        in_blocks = {words[1] for words in self.shell_words if words[0] == "make"}
        return in_blocks | set(re.findall(r"`make ([\w-]+)`", self.text))

    @property
    def links(self) -> list[str]:
        """What the links and images of the page lead to."""
        return re.findall(r"\]\(([^)\s]+)\)", self.prose)

    @property
    def anchors(self) -> set[str]:
        """Anchors of the headings, as forges and the generator of the built pages make them."""
        headings = re.findall(r"^#+ (.*)$", self.prose, flags=re.MULTILINE)
        return {re.sub(r"[^\w -]", "", heading.lower()).replace(" ", "-") for heading in headings}

    def aim(self, link: str) -> tuple[Path, str]:
        """File and anchor that a link into the repository leads to."""
        place, _, anchor = link.partition("#")
        return (ROOT / self.path).parent / place if place else ROOT / self.path, anchor


def pages() -> list[Page]:
    """README and every page of the documentation."""
    found = sorted(path.relative_to(ROOT) for path in (ROOT / "docs").rglob("*.md") if "_build" not in path.parts)
    return [Page("README.md"), *(Page(path.as_posix()) for path in found)]
