"""The small study, run once for the tests of one file; its folder and pages."""

from __future__ import annotations

import functools

import pytest

from pymc_ship.diagnostics import page as diagnostic_report
from pymc_ship.inference.regression import identify as identification
from pymc_ship.records.files.noise import LITERAL_LEVEL
from pymc_ship.replication import page as report
from pymc_ship.replication import study
from tests.replication.cases import LEVEL, SEED, SWEEP, Page, subsections_of


@pytest.fixture(scope="module")
def result(container):
    """A small run: two noise levels, two of the sweep, few evaluations in the tuning."""
    with pytest.MonkeyPatch.context() as patch:
        few = functools.partial(identification.tune_prior, evaluations=6)
        patch.setattr(identification, "tune_prior", few)
        return study.run_study(container, level=LEVEL, levels=(LITERAL_LEVEL,), sweep=SWEEP, seed=SEED)


@pytest.fixture(scope="module")
def folder(result, tmp_path_factory):
    out = tmp_path_factory.mktemp("study")
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(diagnostic_report, "posterior_kind", subsections_of("surge, conjugate"))
        assert report.write_study(result, out) == out / "index.html"
    return out


@pytest.fixture(scope="module")
def text(folder):
    return (folder / "index.html").read_text(encoding="utf-8")


@pytest.fixture(scope="module")
def page(text):
    return Page(text)


@pytest.fixture(scope="module")
def diagnosed(folder):
    return Page((folder / "diagnostics.html").read_text(encoding="utf-8"))
