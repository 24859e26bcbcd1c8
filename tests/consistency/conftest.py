"""What the consistency tests share: when they run, the table they print, and the study's own data."""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from pathlib import Path
from types import SimpleNamespace

import pytest

import pymc_ship as ps
from pymc_ship.machine.seeds import generator
from pymc_ship.replication.study import INTERVAL

FOLDER = Path(__file__).parent
TABLE = pytest.StashKey[list]()


def selected(config):
    """Whether the long tests were asked for: by their marker, or by the path of this folder or one of its files."""
    paths = (Path(argument.split("::")[0]).resolve() for argument in config.args)
    return "consistency" in config.option.markexpr or any(path == FOLDER or FOLDER in path.parents for path in paths)


@pytest.hookimpl(tryfirst=True)
def pytest_collection_modifyitems(config, items):
    inside = {path for path in {item.path for item in items} if FOLDER in path.parents}
    for item in items:
        if item.path in inside:
            item.add_marker("slow")  # none of them belongs in `make test-fast`
    if not selected(config):
        long = {item for item in items if item.get_closest_marker("consistency")}
        items[:] = [item for item in items if item not in long]
        config.hook.pytest_deselected(items=list(long))


def pytest_terminal_summary(terminalreporter, config):
    rows = config.stash.get(TABLE, [])
    if not (rows and selected(config)):
        return
    width = max(len(row[0]) for row in rows)
    terminalreporter.section("what was compared")
    terminalreporter.write_line(f"{'':{width}}  comparisons  largest z  limit")
    for what, comparisons, largest, limit in rows:
        verdict = "" if largest <= limit else "  beyond the limit"
        terminalreporter.write_line(f"{what:{width}}  {comparisons:11d}  {largest:9.2f}  {limit:5.2f}{verdict}")
    right = [row for row in rows if not row[0].startswith("twin")]
    if right:
        what, _, largest, limit = max(right, key=lambda row: row[2] / row[3])
        terminalreporter.write_line(f"closest to its limit: {what} ({largest:.2f} of {limit:.2f})")


@pytest.fixture
def compared(request):
    """Note a comparison for the table: what, comparisons, largest |z| and its limit. A broken twin begins "twin"."""
    rows = request.config.stash.setdefault(TABLE, [])

    def note(what, comparisons, largest, limit):
        rows.append((what, int(comparisons), float(largest), float(limit)))

    return note


@pytest.fixture(scope="session")
def study(container, zigzag_trial):
    """``study(dof, family, prior)``: data, prior and exact posterior at noise level 0.01.

    The prior of greatest evidence has a shape below 1, so that the rows alone tell sigma2. The ``moderate`` prior, with
    shape 5 and the same mode of sigma2, weighs as much as ten rows, and an error in its part of a conditional shows.
    """
    smooth = ps.denoise(ps.pollute(zigzag_trial, level=0.01, rng=generator(2020, "noise", 0.01)))

    @cache
    def prepared(dof, family, prior):
        data = ps.regression_data(smooth, container, dof, interval=INTERVAL)
        chosen, _ = ps.maximise_evidence(data, family)
        if prior == "moderate":
            chosen = replace(chosen, shape=5.0, scale=6.0 * chosen.scale / (chosen.shape + 1.0))
        return SimpleNamespace(data=data, prior=chosen, exact=chosen.exact(data))

    return prepared
