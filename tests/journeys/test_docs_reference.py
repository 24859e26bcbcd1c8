"""The reference says what the code says: generated pages, keys of files, checks, wings, and the built pages."""

from __future__ import annotations

import importlib.util
import re
import subprocess
import sys
from dataclasses import fields

import numpy as np
import pytest

import pymc_ship as ps
from pymc_ship.physics.forces.propeller import Propeller
from pymc_ship.physics.vessel.ranges import INERTIA, PARTICULARS, PROPELLER, ROLL_COUPLINGS
from pymc_ship.physics.vessel.vessel import ADDED_MASS, Particulars
from pymc_ship.records.files.format import load_format
from pymc_ship.trial.channels import file_columns
from tests.journeys.markdown import ROOT, Page
from tests.test_structure import DISTRICTS

DOCS = ROOT / "docs"
ARCHITECTURE = Page("docs/explanation/architecture.md")


def module(name):
    """A script of the documentation, as a module."""
    spec = importlib.util.spec_from_file_location(name, DOCS / f"{name}.py")
    found = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(found)
    return found


@pytest.fixture(scope="module")
def script():
    return module("make_reference")


def rows(page, section=None):
    """Cells of the rows of the tables of a page, or of one of its sections, without their heads."""
    text = page.text if section is None else re.split(r"^## ", page.text, flags=re.MULTILINE)[section]
    lines = [line for line in text.splitlines() if line.startswith("| ")]
    cells = [[cell.strip() for cell in line.strip("|").split(" | ")] for line in lines]
    return [row for k, row in enumerate(cells[:-1]) if "---" not in row[0] and "---" not in cells[k + 1][0]] + cells[
        -1:
    ]


def code(text):
    return re.findall(r"`([^`]+)`", text)


# generated pages ------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", ["api.md", "commands.md"])
def test_a_generated_page_is_what_the_code_says(script, name):
    """Else: python docs/make_reference.py."""
    assert (DOCS / "reference" / name).read_text(encoding="utf-8") == script.PAGES[name]()


def test_every_generated_page_is_compared(script):
    assert set(script.PAGES) == {"api.md", "commands.md"}


def test_the_page_of_the_api_names_every_public_name(script):
    named = re.findall(r"^- \[`ps\.(\w+)`\]", script.api(), flags=re.MULTILINE)
    assert sorted(named) == sorted(set(ps.__all__) - {"__version__"})


def test_the_page_of_the_commands_has_every_option(script):
    text = script.commands()
    assert "- `--out OUT` (needed): " in text
    assert "- `--side {port,starboard}`: " in text
    assert "- `TRIAL`, `TRIAL ...`: " in text


# keys of files --------------------------------------------------------------------------------------------------------


def test_the_page_of_the_vessel_file_has_every_key():
    page = Page("docs/reference/vessel_toml.md")
    keys = {key for row in rows(page) for key in code(row[0])}
    assert {field.name for field in fields(Particulars)} <= keys
    assert {field.name for field in fields(Propeller)} <= keys
    assert set(ADDED_MASS) <= set(code(page.text))
    assert {"name", "title", "sources", "particulars", "inertia", "coefficients", "added_mass", "propeller"} <= keys


def test_the_page_of_the_vessel_file_has_every_range():
    shown = [[cell.strip() for cell in cells] for cells in rows(Page("docs/reference/vessel_toml.md"))]

    def words(low, high):
        return "any" if np.isinf(high) else f"{low:.4g} to {high:.4g}"

    for rule in (*PARTICULARS, *INERTIA, *ROLL_COUPLINGS, *PROPELLER):
        row = [rule.what, words(*rule.possible), words(*rule.usual)]
        assert any(rule.key in code(key) and cells == row for key, *cells in shown)


def test_the_page_of_the_format_file_has_every_key():
    page = Page("docs/reference/format_toml.md")
    keys = {key for row in rows(page) for key in code(row[0])}
    with pytest.raises(ps.TrialError) as error:
        load_format({"key": 1})
    known = set(re.search(r"known here are (.*)\.", str(error.value)).group(1).split(", "))
    headings = set(re.findall(r"^## (\w+)$", page.text, flags=re.MULTILINE))
    assert known <= keys | headings
    assert {"velocities", "reference", "heading", "rudder_positive", "froude", "column", "unit"} <= keys
    assert set(file_columns()) <= set(code(page.text))


# checks ---------------------------------------------------------------------------------------------------------------


def test_the_page_of_the_checks_has_every_check_and_its_numbers(container, zigzag_trial):
    page = Page("docs/reference/checks.md")
    trial = zigzag_trial.assign(delta_command=zigzag_trial["delta"])
    checks = ps.trial_checks(trial, container)
    found = {row[0]: code(row[2]) for section in (1, 2, 3, 4, 5, 6) for row in rows(page, section)}
    names = {check.name if "excitation" not in check.name else "excitation surge (sway, yaw, roll)" for check in checks}
    assert set(found) == names
    for check in checks:
        told = found.get(check.name, found["excitation surge (sway, yaw, roll)"])
        told = [name.split(",")[0].removesuffix(" u") for name in told]
        for name, _, _ in check.numbers:
            plain = re.sub(r"^(r|v|phi) over", "r over", name.split(",")[0])
            assert any(plain == text or plain.startswith(f"{text} ") for text in told), (check.name, name)


def test_verdicts_of_the_page_are_those_of_the_checks():
    from pymc_ship.trial.quality_flags import VERDICTS

    assert tuple(row[0] for row in rows(Page("docs/reference/checks.md"), 0)) == VERDICTS


# posterior tree -------------------------------------------------------------------------------------------------------


def table_of_groups(section):
    """Variables with their dims by group, from the table of a section."""
    groups, group = {}, ""
    for name, variables, dims in rows(Page("docs/reference/posterior_tree.md"), section):
        group = code(name)[0] if name else group
        for variable in code(variables):
            groups.setdefault(group, {})[variable] = tuple(dims.split(", "))
    return groups


def test_the_page_of_the_posterior_has_its_groups_and_attrs():
    rng = np.random.default_rng(1)
    data = ps.RegressionData.from_arrays(
        rng.standard_normal((20, 2)), rng.standard_normal(20), coefficients=("a", "b"), scaling="none"
    )
    tree = ps.exact_posterior(data, ps.ConjugatePrior(), draws=8, rng=rng)
    found = {
        name: {str(key): value.dims for key, value in group.data_vars.items()} for name, group in tree.children.items()
    }
    assert table_of_groups(1) == found
    attrs = {name for row in rows(Page("docs/reference/posterior_tree.md"), 2) for name in code(row[0])}
    assert attrs == {*tree.attrs, "held_fixed", "fixed"}


def test_the_page_of_the_posterior_has_the_groups_of_a_trajectory(ship, zigzag):
    rng = np.random.default_rng(1)
    trial = ps.pollute(zigzag, level=0.01, rng=rng)
    tree = ps.trajectory_posterior([trial], ship, draws=200, rng=rng)
    told = table_of_groups(4)
    for name, group in tree.children.items():
        for key, value in group.data_vars.items():
            assert told[name][str(key)] == value.dims
    assert {name for name, group in told.items() for _ in group} == set(tree.children)


# architecture ---------------------------------------------------------------------------------------------------------


def drawn():
    """Districts of the drawing with their wings; a line without wings says what a district is for."""
    lines = [line for line in ARCHITECTURE.blocks("text")[0].splitlines() if line[:1].isalpha() and "/" not in line]
    rows = {line.split()[0]: line.split(maxsplit=1)[1] for line in lines}
    return {name: tuple(text.split(" > ")) if " > " in text else () for name, text in rows.items()}


def test_the_drawing_is_the_table_of_districts_and_wings():
    assert drawn() == DISTRICTS
    assert list(drawn()) == list(DISTRICTS)


def test_the_way_of_a_record_visits_rooms_that_are_there():
    rooms = [code(row[1])[0] for row in rows(ARCHITECTURE, 1)]
    assert len(rooms) == 9
    assert all((ROOT / "src" / "pymc_ship" / room).exists() for room in rooms)


def test_files_that_a_newcomer_touches_are_there():
    """Files are named from the root of the repository, or from the package."""
    table = rows(ARCHITECTURE, 3)
    things = (
        "term",
        "symbol",
        "part",
        "prior",
        "manoeuvre",
        "channel",
        "sensor",
        "check",
        "known mistake",
        "page",
        "command",
        "study",
    )
    assert {row[0] for row in table} == {*(f"a {thing}" for thing in things), "an error law"}
    for row in table:
        names = [name for cell in row[1:] for name in code(cell) if "/" in name]
        assert names
        for name in names:
            assert (ROOT / name).exists() or (ROOT / "src" / "pymc_ship" / name).exists(), name


# the built pages ------------------------------------------------------------------------------------------------------


@pytest.mark.slow
def test_the_pages_are_built_without_a_warning(tmp_path):
    command = [
        sys.executable,
        "-m",
        "sphinx",
        "-q",
        "-W",
        "--keep-going",
        "-b",
        "html",
        str(DOCS),
        str(tmp_path / "html"),
    ]
    done = subprocess.run([*command, "-d", str(tmp_path / "doctrees")], capture_output=True, text=True, check=False)
    assert (done.returncode, done.stderr) == (0, "")
    api = (tmp_path / "html" / "reference" / "api.html").read_text(encoding="utf-8")
    assert 'id="pymc_ship.simulate"' in api
    contents = (tmp_path / "html" / "index.html").read_text(encoding="utf-8")
    assert 'href="tutorials/first_zigzag.html"' in contents
    assert "https://" not in re.sub(r"<a [^>]*>", "", contents)
