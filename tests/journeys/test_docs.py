"""What every page of the documentation shows is so: blocks, commands, targets of make and links."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from pymc_ship.cli.parser import parser
from tests.journeys.markdown import ROOT, Page, pages
from tests.test_structure import HOSTS

PAGES = pages()
README = PAGES[0]
LANGUAGES = {"python", "sh", "toml", "text"}
FILED = ("docs/", "studies/", "models/")
"""Folders of the repository: a command that names a file in one of them finds it."""

INSTALL = "python3 -m pip install --constraint constraints.txt ."
COMMANDS = next(action.choices for action in parser()._actions if action.dest == "command")

every_page = pytest.mark.parametrize("page", PAGES, ids=lambda page: page.path)


def faults_of_links(page):
    """Links that lead nowhere: to no file, or to no heading of a page."""
    faults = []
    for link in page.links:
        if link.startswith("https://"):
            continue
        path, anchor = page.aim(link)
        if not path.is_file() or (anchor and anchor not in Page(str(path)).anchors):
            faults.append(link)
    return faults


def test_the_documentation_has_pages_of_every_kind():
    folders = {Path(page.path).parent.name for page in PAGES}
    assert folders == {"", "docs", "tutorials", "how_to", "reference", "explanation", "case_studies"}
    assert len(PAGES) >= 25


def test_the_readme_fits_on_a_screen_or_two():
    assert 100 <= README.text.count("\n") <= 150


@every_page
def test_every_block_has_a_language_that_is_tested(page):
    assert set(page.languages) <= LANGUAGES
    assert len(page.languages) == sum(len(page.blocks(language)) for language in LANGUAGES)


def test_there_are_blocks_of_every_language():
    counts = {language: sum(len(page.blocks(language)) for page in PAGES) for language in LANGUAGES}
    assert counts["python"] >= 2
    assert counts["toml"] >= 2
    assert min(counts.values()) > 0


# commands -------------------------------------------------------------------------------------------------------------


@every_page
def test_commands_parse(page):
    """A command alone, without the words it needs, is named in the text."""
    for words in page.commands:
        assert words[0] in COMMANDS
        assert len(words) == 1 or parser().parse_args(words).command == words[0]


@every_page
def test_commands_of_blocks_are_complete(page):
    for words in page.shell_words:
        assert words[0] != "pymc-ship" or parser().parse_args(words[1:]).command == words[1]


@every_page
def test_commands_name_files_that_are_there(page):
    files = [word for words in page.commands for word in words if word.startswith(FILED)]
    assert [name for name in files if not list(ROOT.glob(name))] == []


@pytest.mark.parametrize("path", ["docs/tutorials/first_zigzag.md", "docs/tutorials/your_ship.md"])
def test_commands_of_a_tutorial_are_found(path):
    words = {words[0] for words in Page(path).commands}
    assert words >= ({"identify"} if "your_ship" in path else {"simulate", "fit", "regress"}) | {"check", "forecast"}


def test_commands_of_the_documentation_are_found():
    found = {words[0] for page in PAGES for words in page.commands}
    assert found >= {"simulate", "identify", "regress", "forecast", "study"}


def test_a_command_that_does_not_parse_is_seen(capsys):
    with pytest.raises(SystemExit):
        parser().parse_args(["regress", "trial.csv", "--vesel", "container", "--out", "identified"])
    assert "pymc-ship regress --help" in capsys.readouterr().err


def test_commands_of_the_parser_are_named():
    named = re.search(r"worked examples of (.*?)\.", README.text, flags=re.DOTALL).group(1)
    assert set(re.findall(r"`([\w-]+)`", named)) == set(COMMANDS)


def test_targets_of_make_exist():
    targets = re.findall(r"^(\w[\w-]*):", (ROOT / "Makefile").read_text(encoding="utf-8"), flags=re.MULTILINE)
    assert {"study", "test", "test-fast", "bench"} <= README.targets
    assert set().union(*(page.targets for page in PAGES)) <= set(targets)


def test_shell_blocks_hold_nothing_else():
    lines = [words for page in PAGES for words in page.shell_words]
    assert {words[0] for words in lines} == {"make", "pymc-ship", "python3"}
    assert [" ".join(words) for words in lines if words[0] == "python3"] == [INSTALL]
    assert (ROOT / "constraints.txt").is_file()


# links ----------------------------------------------------------------------------------------------------------------


@every_page
def test_links_into_the_repository_lead_to_something(page):
    assert faults_of_links(page) == []


def test_links_into_the_repository_are_found():
    assert {"models/first_model.py", "docs/index.md", "docs/tutorials/your_ship.md"} <= set(README.links)
    assert "../../models/container.toml" in Page("docs/how_to/write_a_vessel.md").links


def test_the_check_of_links_can_fail(tmp_path):
    path = tmp_path / "page.md"
    path.write_text("# A page\n\n[a](nowhere.md) [b](page.md#a-page) [c](#elsewhere) ![d](nothing.png)\n")
    assert faults_of_links(Page(str(path))) == ["nowhere.md", "#elsewhere", "nothing.png"]


@every_page
def test_links_out_of_the_repository_are_dois(page):
    assert all(url.startswith("doi.org/") for url in re.findall(r"https?://([^)\s]+)", page.text))
    assert [host for host in HOSTS if host in page.text] == []


def test_the_contents_list_every_page():
    listed = {(ROOT / "docs" / link).resolve() for link in Page("docs/index.md").links if link.endswith(".md")}
    assert listed == {ROOT / page.path for page in PAGES[1:]} - {ROOT / "docs" / "index.md"}


# scripts --------------------------------------------------------------------------------------------------------------


def private_imports(text):
    """Imports from inside the package in Python of the documentation, which uses the public door ``ps.`` alone."""
    return re.findall(r"^ *(?:from pymc_ship\.?\S* import .*|import pymc_ship\.\S+.*)$", text, flags=re.MULTILINE)


def python_of_the_documentation():
    """Python blocks of every page, and scripts beside the pages, by path; the builder of the pages is none."""
    scripts = [path for path in sorted((ROOT / "docs").rglob("*.py")) if path.parent.name != "docs"]
    texts = {str(path.relative_to(ROOT)): path.read_text(encoding="utf-8") for path in scripts}
    return texts | {page.path: "\n".join(page.blocks("python")) for page in PAGES}


@pytest.mark.parametrize("path", python_of_the_documentation())
def test_python_of_the_documentation_uses_public_names_alone(path):
    assert private_imports(python_of_the_documentation()[path]) == []


def test_the_check_of_public_names_can_fail():
    text = "import pymc_ship as ps\nfrom pymc_ship.trial import units\nimport pymc_ship.machine\n"
    assert private_imports(text) == ["from pymc_ship.trial import units", "import pymc_ship.machine"]
