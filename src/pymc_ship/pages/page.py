"""Pages from a template and their content, with figures and tables."""

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
    """Template and settings of a kind of page."""

    file: str  # name of the page in its folder
    template: Path  # of Jinja; it can use ``_layout.html.j2``, ``_page.html.j2`` and those of its folder
    own: tuple[str, ...] = ()  # patterns of the page's files: those of an earlier page are removed, other files stay
    packages: tuple[str, ...] = ()  # whose versions are on the page
    digits: int | None = None  # significant digits of numbers in CSV files; None for all
    tables: str = "tables"  # folder of the CSV files


@dataclass(frozen=True)
class Content:
    """Content of one page."""

    values: Mapping[str, object]  # of the template, beside ``figures``, ``versions`` and ``sources``; text is escaped
    figures: Mapping[str, Figure | str] = field(default_factory=dict)  # a text is in the page alone
    rows: Mapping[str, Sequence[Mapping[str, Any]]] = field(default_factory=dict)  # of CSV files, by name
    files: Mapping[str, Callable[[Path], object]] = field(default_factory=dict)  # writers, by path
    sources: Sequence[str] = ()  # references


def write_page(page: Page, out: str | Path, content: Content) -> Path:
    """Write a page with its figures and tables into a folder, created where it is missing; path of the page.

    After an exception the folder is unchanged. OutputError if it cannot be written.
    """
    out = writable_folder(out)
    text = render_page(page, content)
    with staged_files(out, last=page.file, own=page.own) as folder:
        for name, write in _files(page, content, text).items():
            (folder / name).parent.mkdir(parents=True, exist_ok=True)
            write(folder / name)
    return out / page.file


def render_page(page: Page, content: Content) -> str:
    """Text of a page, the same for the same content."""
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
    writers: dict[str, Callable[[Path], object]] = {}
    for name, figure in content.figures.items():
        if isinstance(figure, Figure):
            writers[f"figures/{name}.png"] = partial(_write_png, figure)
    for name, rows in content.rows.items():
        if rows:
            writers[f"{page.tables}/{name}.csv"] = partial(write_rows, rows, digits=page.digits)
    return writers | dict(content.files) | {page.file: lambda path: path.write_text(text, encoding="utf-8")}


def _write_png(figure: Figure, path: Path) -> None:
    path.write_bytes(drawing.png(figure, drawing.BESIDE_DPI))


def write_rows(rows: Sequence[Mapping[str, Any]], path: Path, *, digits: int | None) -> None:
    """Write rows as CSV with the keys of all rows."""
    keys = list(dict.fromkeys(key for row in rows for key in row))
    with path.open("w", encoding="utf-8", newline="") as file:
        writer = csv.DictWriter(file, keys, lineterminator="\n")
        writer.writeheader()
        writer.writerows({key: _round(value, digits) for key, value in row.items()} for row in rows)


def _round(value: object, digits: int | None) -> object:
    return float(f"{value:.{digits}g}") if digits is not None and isinstance(value, float) else value
