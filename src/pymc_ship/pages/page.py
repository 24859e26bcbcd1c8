"""A page from its template."""

from __future__ import annotations

from jinja2 import Environment, PackageLoader, StrictUndefined, select_autoescape

_ENVIRONMENT = Environment(
    loader=PackageLoader("pymc_ship", package_path=""),
    autoescape=select_autoescape(default=True),
    undefined=StrictUndefined,
    trim_blocks=True,
    lstrip_blocks=True,
)


def rendered(template: str, **content: object) -> str:
    """Page of a template with its content, which is escaped; a name that is not given is an error."""
    return _ENVIRONMENT.get_template(template).render(**content)
