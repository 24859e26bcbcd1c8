"""The examples of the documentation work: Python runs in order on every page, the vessel and the format are read."""

from __future__ import annotations

from importlib.util import find_spec

import matplotlib
import numpy as np
import pytest

import pymc_ship as ps
from pymc_ship.inference.regression.families import FAMILIES
from pymc_ship.physics.forces.modular import PARTS
from pymc_ship.physics.manoeuvre.registry import KINDS
from pymc_ship.trial.channels import CHANNELS
from tests.journeys.markdown import ROOT, Page, pages
from tests.sentences import refused

VESSEL = Page("docs/how_to/write_a_vessel.md")
FORMAT = Page("docs/how_to/read_a_trial_file.md")
PAPER = Page("docs/tutorials/paper_in_python.md")
FORMULAS = "regress_a_table"

QUICK = {
    *(f"docs/how_to/{task}.md" for task in ("read_a_trial_file", "write_a_vessel", "choose_a_prior", FORMULAS)),
    *(f"docs/how_to/{task}.md" for task in ("denoise_a_record", "simulate_what_sensors_read")),
    "docs/how_to/extend.md",
}
"""Pages whose Python takes no more than a few seconds."""

LONG = {
    *(f"docs/how_to/{task}.md" for task in ("pool_several_trials", "fit_trajectories", "design_the_next_run")),
    "docs/tutorials/your_ship.md",
}
"""Pages whose Python an example of a docstring draws at less length."""


def with_python():
    """Every page that has Python, the slow ones marked; that of the paper has a test of its own."""
    parser = pytest.mark.skipif(find_spec("formulae") is None, reason="installed by pymc-ship[formula]")
    return [
        pytest.param(
            page,
            id=page.path,
            marks=[parser] * (FORMULAS in page.path)
            + [pytest.mark.slow] * (page.path not in QUICK)
            + [pytest.mark.consistency] * (page.path in LONG),
        )
        for page in pages()
        if page.blocks("python") and page != PAPER
    ]


@pytest.fixture
def forgotten():
    """What a page adds to the tables of the package is gone after it."""
    tables = KINDS, FAMILIES, CHANNELS, PARTS
    before = [dict(table) for table in tables]
    yield
    for table, entries in zip(tables, before, strict=True):
        table.clear()
        table.update(entries)


@pytest.fixture
def run(forgotten, tmp_path, monkeypatch, capsys):
    """Run the Python of a page in order, in a folder with the files of the repository that pages name."""

    def run(page):
        monkeypatch.chdir(tmp_path)
        for folder in ("docs", "models", "studies"):
            (tmp_path / folder).symlink_to(ROOT / folder)
        matplotlib.use("agg")
        namespace = {}
        for number, block in enumerate(page.blocks("python"), start=1):
            exec(compile(block, f"{page.path}, Python block {number}", "exec"), namespace)
        return namespace, capsys.readouterr().out

    return run


def printed_blocks(page):
    """Text blocks that stand below a block of Python, as what it prints."""
    found = page.text.split("```python\n")[1:]
    return [part.split("```text\n")[1].split("```")[0] for part in found if "```text\n" in part]


@pytest.mark.parametrize("page", with_python())
def test_python_of_a_page_runs_in_order(page, run):
    _, printed = run(page)
    if page.path in QUICK:
        assert all(text in printed for text in printed_blocks(page))


def test_quick_pages_show_what_they_print():
    assert sum(len(printed_blocks(Page(path))) for path in QUICK) >= 2


@pytest.mark.slow
def test_python_of_the_paper_runs_in_order(run, tmp_path):
    namespace, printed = run(PAPER)
    assert "tactical_diameter" in printed
    assert "noise_variance" in printed
    assert "nuts agrees" in printed
    again = ps.read_posterior(tmp_path / "sway.nc")
    assert again.identical(namespace["nuts"])
    assert list(namespace["nuts"]["posterior"].sizes.values())[:2] == [4, 1000]
    assert namespace["tree"]["posterior"]["noise_variance"].size == 4000


# vessel ---------------------------------------------------------------------------------------------------------------


@pytest.fixture
def vessel_file(tmp_path):
    """The vessel of the page as a file."""
    assert len(VESSEL.blocks("toml")) == 1
    path = tmp_path / "my_ship.toml"
    path.write_text(VESSEL.blocks("toml")[0], encoding="utf-8")
    return path


def test_the_vessel_of_the_page_loads(vessel_file):
    vessel = ps.load_vessel(vessel_file)
    assert vessel.name == "my_ship"
    assert vessel.dofs == ("surge", "sway", "yaw")
    assert vessel.particulars.x_G == -0.46
    assert float(vessel.coefficients("sway").sel(coefficient="Ydelta")) == 248.1e-5


def test_the_vessel_of_the_page_turns_the_way_its_rudder_says(vessel_file):
    run = ps.simulate(ps.load_vessel(vessel_file), ps.turning_circle(10.0), duration=60.0)
    assert not run["diverged"]
    assert run["delta"].values[-1] > 0.0
    assert run["psi"].values[-1] < 0.0


def test_a_wrong_key_in_the_vessel_is_named(vessel_file):
    text = vessel_file.read_text(encoding="utf-8")
    vessel_file.write_text(text.replace("rudder_rate_deg", "rudder_rate"), encoding="utf-8")
    with refused(ps.VesselError, "particulars.rudder_rate"):
        ps.load_vessel(vessel_file)


# format ---------------------------------------------------------------------------------------------------------------


def test_the_format_of_the_page_reads_a_trial(tmp_path):
    path = tmp_path / "basin.toml"
    assert len(FORMAT.blocks("toml")) == 1
    path.write_text(FORMAT.blocks("toml")[0], encoding="utf-8")
    header = "time [s];Speed [kn];v;r [deg/s];Gyro [deg];RUD\n"
    (tmp_path / "run.csv").write_text("Basin\n\n" + header + "0;14;0,5;1;359;-10\n1;14;0,5;1;0;-10\n2;14;0,5;1;1;-10\n")
    trial = ps.read_trial(tmp_path / "run.csv", format=path)
    assert float(trial["time"][1]) == pytest.approx(45.714**0.5)
    assert np.diff(np.rad2deg(trial["psi"])) == pytest.approx([1.0, 1.0])
    assert float(np.rad2deg(trial["delta"][0])) == pytest.approx(-10.4)
    assert float(trial["v"][0]) == pytest.approx((0.5 + 3.2 * np.deg2rad(1.0)) * 45.714**0.5)
