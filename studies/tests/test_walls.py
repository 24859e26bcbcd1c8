"""The library stands without its studies, and the studies without its tests."""

from __future__ import annotations

import ast
from pathlib import Path

import pytest

STUDIES = Path(__file__).parents[1]
LIBRARY = STUDIES.parent / "src" / "pymc_ship"
FILES = sorted(path for path in STUDIES.rglob("*.py") if "tests" not in path.relative_to(STUDIES).parts)


def imported(path):
    """First names of what a file imports."""
    nodes = list(ast.walk(ast.parse(path.read_text(encoding="utf-8"))))
    names = {alias.name for node in nodes if isinstance(node, ast.Import) for alias in node.names}
    names |= {str(node.module) for node in nodes if isinstance(node, ast.ImportFrom)}
    return {name.split(".")[0] for name in names}


def test_no_room_of_the_library_imports_a_study():
    rooms = sorted(LIBRARY.rglob("*.py"))
    assert len(rooms) > 100
    assert [path for path in rooms if imported(path) & {"studies", "tests"}] == []


@pytest.mark.parametrize("path", FILES, ids=lambda path: str(path.relative_to(STUDIES)))
def test_a_study_needs_no_tests_and_is_short_and_says_what_it_is(path):
    text = path.read_text(encoding="utf-8")
    assert "tests" not in imported(path)
    assert text.count("\n") <= 600
    assert ast.get_docstring(ast.parse(text))


def test_the_check_of_imports_can_fail(tmp_path):
    path = tmp_path / "room.py"
    path.write_text("def f():\n    from studies.population import Population\n    import tests.conftest\n")
    assert imported(path) == {"studies", "tests"}
