"""Methods of the user's own: given as functions or by an import path, on every kind of worker, and what is refused."""

from __future__ import annotations

import re

import pandas as pd
import pytest

import pymc_ship as ps
from pymc_ship.cli.main import main
from pymc_ship.experiments.run import read_study
from pymc_ship.physics.vessel.vessel import reference_coefficients
from tests.experiments.folders import changed, tables
from tests.sentences import refused

MODULE = """
import numpy as np
import pymc_ship as ps


def doubled(noisy, vessel):
    reference = np.concatenate([vessel.coefficients(dof).values for dof in vessel.dofs])
    return ps.Estimate(2.0 * reference, reference - 1.0, 0.0 * reference + noisy["v"].values[5])


nothing = 3
"""


def shifted(by):
    """Method that finds every coefficient larger by a share, which its intervals hold."""

    def method(noisy, vessel):
        found = (1.0 + by) * reference_coefficients(vessel)
        return ps.Estimate(found, found - 1.0, found + 1.0)

    return method


def only(study, methods='["weak form"]'):
    """The small study with one level, two seeds and the methods in TOML."""
    pairs = (("0.01, 0.05", "0.05"), ("seeds = 4", "seeds = 2"))
    return changed(study, *pairs, ('["weak form", "paper\'s pipeline"]', methods))


def cells(out):
    return pd.read_csv(out / "cells.csv").set_index("method")


@pytest.fixture
def module(tmp_path, monkeypatch):
    """Module of the user's own, which Python finds and other processes too."""
    folder = tmp_path / "modules"
    folder.mkdir()
    (folder / "methods_of_mine.py").write_text(MODULE)
    (folder / "broken_methods.py").write_text("1 / 0")
    monkeypatch.syspath_prepend(folder)
    return folder


def test_a_function_stands_beside_the_methods_of_the_study(study, tmp_path):
    ps.montecarlo(only(study), tmp_path / "out", methods={"mine": shifted(0.07)}, workers=1)
    found = cells(tmp_path / "out")
    assert list(found.index) == ["weak form", "mine"]
    assert found.loc["mine", "median_error"] == pytest.approx(7.0)
    assert found.loc["mine", "coverage"] == 100.0
    assert found.loc["weak form", "median_error"] != found.loc["mine", "median_error"]
    assert "mine" in (tmp_path / "out" / "index.html").read_text()


def test_a_function_and_an_import_path_reach_other_processes(study, tmp_path, module):
    """A closure, which no worker can import, and a function of a module."""
    small = only(study, '["methods_of_mine:doubled"]')
    for workers in (1, 2):
        ps.montecarlo(small, tmp_path / str(workers), methods={"mine": shifted(0.5)}, workers=workers)
    assert tables(tmp_path / "1") == tables(tmp_path / "2")
    found = cells(tmp_path / "2")
    assert found.loc["methods_of_mine:doubled", "median_error"] == pytest.approx(100.0)
    assert found.loc["mine", "median_error"] == pytest.approx(50.0)
    assert set(found["failed"]) == {0}


def test_a_function_reaches_the_workers_of_a_cluster(study, tmp_path):
    distributed = pytest.importorskip("distributed")
    settings = {"n_workers": 1, "threads_per_worker": 1, "processes": True, "dashboard_address": ":0"}
    with distributed.LocalCluster(**settings) as cluster:
        address = cluster.scheduler_address
        ps.montecarlo(only(study), tmp_path / "dask", methods={"mine": shifted(0.5)}, scheduler=address)
    ps.montecarlo(only(study), tmp_path / "here", methods={"mine": shifted(0.5)}, workers=1)
    assert tables(tmp_path / "dask") == tables(tmp_path / "here")


def test_a_study_may_name_a_method_that_is_given(study):
    grid = read_study(only(study, '["mine", "weak form"]'), {"mine": shifted(0.1)})
    assert grid.methods == ("mine", "weak form")


def test_a_method_that_raises_is_a_result(study, tmp_path):
    def fails(noisy, vessel):
        raise ZeroDivisionError("of no use")

    ps.montecarlo(only(study), tmp_path / "out", methods={"mine": fails}, workers=1)
    assert cells(tmp_path / "out").loc["mine", "failed"] == 2


def test_a_method_that_changes_asks_for_another_folder(study, tmp_path):
    def other(noisy, vessel):
        return None

    table, out = only(study), tmp_path / "out"
    ps.montecarlo(table, out, methods={"mine": shifted(0.1)}, workers=1)
    ps.montecarlo(table, out, methods={"mine": shifted(0.1)}, workers=1)
    with refused(ps.StudyError, "mine"):
        ps.montecarlo(table, out, methods={"mine": other}, workers=1)


# refusals -------------------------------------------------------------------------------------------------------------


def test_a_run_in_other_processes_ends_as_well(study, tmp_path):
    """An error that joblib raises in a worker made it wait for ever; there is no page."""
    with refused(ps.StudyError, "mine", "Estimate"):
        ps.montecarlo(only(study), tmp_path / "out", methods={"mine": lambda *_: None}, workers=2)
    assert not (tmp_path / "out" / "index.html").exists()


def test_what_is_no_method_leaves_no_folder(study, tmp_path):
    with refused(ps.StudyError, "mine"):
        ps.montecarlo(only(study), tmp_path / "out", methods={"mine": "shifted"})
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize(
    ("method", "sentence"),
    [
        ("weak", "a method is one of paper's pipeline, .*, module:function; found 'weak'; choose one of them."),
        ("no_module:f", "methods cannot have 'no_module:f': ModuleNotFoundError: .* put that on PYTHONPATH or"),
        ("broken_methods:f", "methods cannot have 'broken_methods:f': ZeroDivisionError: division by zero; run in"),
        ("methods_of_mine:none", "'methods_of_mine:none': methods_of_mine has no none; correct the name."),
        ("methods_of_mine:nothing", "'methods_of_mine:nothing' must be a function of .*, found 3; give the function."),
        ("methods_of_mine:", "choose one of them."),
    ],
)
@pytest.mark.usefixtures("module")
def test_an_import_path_that_leads_nowhere_is_one_sentence(study, tmp_path, capsys, method, sentence):
    assert main(["montecarlo", str(only(study, f'["{method}"]')), "--out", str(tmp_path / "out")]) == 2
    printed = capsys.readouterr()
    assert printed.out == ""
    assert printed.err.count("\n") == 1
    assert re.search(sentence, printed.err)
    assert not (tmp_path / "out").exists()
