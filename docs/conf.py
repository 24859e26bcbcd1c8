"""Settings of Sphinx: the Markdown pages as they stand, with contents and docstrings put in while they are read.

The pages are plain Markdown, so that they read well where nothing is built. Two of them get more when they are: the
contents become the navigation, and each line of the API becomes the docstring it is the head of.
"""

from __future__ import annotations

import logging
import re

import pymc_ship as ps

for library in ("pytensor", "arviz"):
    logging.getLogger(library).setLevel(logging.WARNING)  # a colour scheme of the theme turns their remarks on

project = "pymc_ship"
release = ps.__version__
extensions = ["myst_parser", "sphinx.ext.autodoc", "sphinx.ext.napoleon"]
myst_enable_extensions = ["dollarmath"]
exclude_patterns = ["_build"]
myst_heading_anchors = 3
suppress_warnings = ["ref.python"]  # dims of an attribute, such as run, are no references
autodoc_member_order = "bysource"
autodoc_typehints = "none"
napoleon_use_param = False
napoleon_use_rtype = False
html_theme = "furo"
html_title = project
html_show_copyright = False

_LINKED = re.compile(r"^- \[[^\]]*\]\(([^)#]+)\.md\)", flags=re.MULTILINE)
_PUBLIC = re.compile(r"^- \[`ps\.(\w+)`\]\(.*$", flags=re.MULTILINE)
_OUTSIDE = re.compile(r"\]\((\.\./\.\./[^)]+\.md)\)")


def with_navigation(text: str) -> str:
    """Page whose linked pages are its navigation, a caption for each section."""
    navigation = ""
    for section in text.split("\n## ")[1:]:
        pages = "\n".join(_LINKED.findall(section))
        caption = section.partition("\n")[0]
        navigation += f"\n```{{toctree}}\n:hidden:\n:caption: {caption}\n\n{pages}\n```\n"
    return text + navigation


def with_docstrings(text: str) -> str:
    """Page whose public names are followed by their docstrings."""
    return _PUBLIC.sub(lambda line: f"```{{eval-rst}}\n{_directive(line[1])}\n```", text)


def _directive(name: str) -> str:
    value = getattr(ps, name)
    if not isinstance(value, type):
        return f".. autofunction:: pymc_ship.{name}"
    if issubclass(value, Exception):
        return f".. autoexception:: pymc_ship.{name}"
    return f".. autoclass:: pymc_ship.{name}\n   :members:"


def _completed(_, page: str, source: list[str]) -> None:
    complete = {"index": with_navigation, "reference/api": with_docstrings}
    text = _OUTSIDE.sub(r"](path:\1)", source[0])  # Markdown that is no page of these: a file
    source[0] = complete.get(page, str)(text)


def setup(app) -> None:
    """Complete each page that has something to complete when Sphinx reads it."""
    app.connect("source-read", _completed)
