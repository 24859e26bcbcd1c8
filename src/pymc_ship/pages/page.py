"""The one writer of pages: a template and its content become a page, with figures and tables beside it."""

from __future__ import annotations

import csv
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import partial
from importlib.metadata import version
from pathlib import Path
from typing import Any

from jinja2 import Environment, FileSystemLoader, StrictUndefined
from matplotlib.figure import Figure

from pymc_ship.machine.files import staged_files, writable_folder
from pymc_ship.pages import drawing


@dataclass(frozen=True)
class Page:
    """What stays the same of a page, whatever it shows.

    Attributes
    ----------
    file : str
        Name of the page in its folder.
    template : Path
        Jinja template, which may extend ``_layout.html.j2``, import from ``_page.html.j2`` and use any template beside
        itself.
    own : tuple of str
        Patterns of the files beside the page that are its own, such as ``figures/*.png``. Own files of an earlier page
        are removed where the new page does not write them; all other files stay.
    packages : tuple of str
        Packages whose versions the page states.
    digits : int, optional
        Significant digits of the numbers in the CSV files; None writes numbers in full.
    tables : str
        Folder of the CSV files within the folder of the page.
    """

    file: str
    template: Path
    own: tuple[str, ...] = ()
    packages: tuple[str, ...] = ()
    digits: int | None = None
    tables: str = "tables"


@dataclass(frozen=True)
class Content:
    """What one page shows.

    Attributes
    ----------
    values : mapping of str to object
        By the names that the template uses; a name that is not given is an error, text is escaped. The template finds
        ``figures``, ``versions`` and ``sources`` beside them.
    figures : mapping of str to Figure or str
        By name. A Figure stands in the page as SVG and beside it as PNG. A text, from :func:`drawing.svg` or
        :func:`drawing.html_image`, is an image that stands in the page alone.
    rows : mapping of str to sequence of mapping
        Tables written as CSV, by name; a table without rows is not written.
    files : mapping of str to callable
        Functions that write other files, by the place of the file in the folder; each takes the path to write to.
    sources : sequence of str
        Works that the page rests on.
    """

    values: Mapping[str, object]
    figures: Mapping[str, Figure | str] = field(default_factory=dict)
    rows: Mapping[str, Sequence[Mapping[str, Any]]] = field(default_factory=dict)
    files: Mapping[str, Callable[[Path], object]] = field(default_factory=dict)
    sources: Sequence[str] = ()


def write_page(page: Page, out: str | Path, content: Content) -> Path:
    """Write a page with its figures and tables; an exception leaves the folder as it was.

    Parameters
    ----------
    page : Page
    out : str or Path
        Folder of the page, created where it is missing.
    content : Content

    Returns
    -------
    Path
        The page, ``out/FILE``, which is moved into place last, after ``out/figures/*.png``, ``out/tables/*.csv`` and
        other files.

    Raises
    ------
    OutputError
        When the folder cannot be written.
    """
    out = writable_folder(out)
    text = render_page(page, content)
    with staged_files(out, last=page.file, own=page.own) as folder:
        for name, write in _files(page, content, text).items():
            (folder / name).parent.mkdir(parents=True, exist_ok=True)
            write(folder / name)
    return out / page.file


def render_page(page: Page, content: Content) -> str:
    """Text of a page: a function of its content alone, so that the same content gives the same page."""
    images = {
        name: drawing.svg(figure, name) if isinstance(figure, Figure) else figure
        for name, figure in content.figures.items()
    }
    versions = ", ".join(f"{name} {version(name)}" for name in page.packages)
    environment = Environment(
        loader=FileSystemLoader([page.template.parent, Path(__file__).parent]),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    template = environment.get_template(page.template.name)
    return template.render(content.values, figures=images, versions=versions, sources=content.sources)


def _files(page: Page, content: Content, text: str) -> dict[str, Callable[[Path], object]]:
    """Functions that write every file of a page, by its place in the folder."""
    figures = {
        f"figures/{name}.png": partial(_write_png, figure)
        for name, figure in content.figures.items()
        if isinstance(figure, Figure)
    }
    tables = {
        f"{page.tables}/{name}.csv": partial(write_rows, rows, digits=page.digits)
        for name, rows in content.rows.items()
        if rows
    }
    return figures | tables | dict(content.files) | {page.file: lambda path: path.write_text(text, encoding="utf-8")}


def _write_png(figure: Figure, path: Path) -> None:
    path.write_bytes(drawing.png(figure, drawing.BESIDE_DPI))


def write_rows(rows: Sequence[Mapping[str, Any]], path: Path, *, digits: int | None) -> None:
    """Write rows as CSV, under the keys of all of them."""
    keys = list(dict.fromkeys(key for row in rows for key in row))
    with path.open("w", encoding="utf-8", newline="") as file:
        writer = csv.DictWriter(file, keys, lineterminator="\n")
        writer.writeheader()
        writer.writerows({key: _rounded(value, digits) for key, value in row.items()} for row in rows)


def _rounded(value: object, digits: int | None) -> object:
    return float(f"{value:.{digits}g}") if digits is not None and isinstance(value, float) else value
