"""What a study refuses before any work."""

from __future__ import annotations

import pytest

import pymc_ship as ps
from pymc_ship.machine.errors import OutputError
from pymc_ship.replication import study
from tests.replication.cases import names
from tests.sentences import refused


@pytest.fixture
def no_work(monkeypatch):
    """Any simulation of the study is an error of the test."""

    def fail(*arguments, **settings):
        raise AssertionError("the long work began")

    monkeypatch.setattr(study, "simulate", fail)


@pytest.mark.usefixtures("no_work")
def test_the_study_begins_where_its_input_is_good(tmp_path):
    with refused(AssertionError, "work"):
        ps.study(tmp_path)


@pytest.mark.usefixtures("no_work")
@pytest.mark.parametrize("place", ["taken", "taken/report"])
def test_a_folder_that_cannot_be_written_is_named_before_any_work(tmp_path, place):
    (tmp_path / "taken").write_text("a file")
    with refused(OutputError, "taken"):
        ps.study(tmp_path / place)
    assert names(tmp_path) == ["taken"]
    assert (tmp_path / "taken").read_text() == "a file"


@pytest.mark.usefixtures("no_work")
def test_an_unknown_vessel_is_named_before_any_work(tmp_path):
    with refused(ps.VesselError, "tanker"):
        ps.study(tmp_path / "report", vessel="tanker")
    assert names(tmp_path) == []


@pytest.mark.usefixtures("no_work")
@pytest.mark.parametrize("level", [-0.01, float("nan"), float("inf")])
def test_a_noise_level_that_is_none_is_named_before_any_work(container, level):
    with refused(ValueError, "level", str(level)):
        study.run_study(container, level=level)
