"""A small study and its folder after tasks that are no work; both are read only."""

from __future__ import annotations

import pytest

from tests.experiments.cases import TOML
from tests.experiments.folders import run
from tests.physics.vessel.cases import toml


@pytest.fixture(scope="module")
def study(small, tmp_path_factory):
    """Study of a small ship: two methods, two levels, four seeds."""
    folder = tmp_path_factory.mktemp("study")
    (folder / "small.toml").write_text(toml(small))
    (folder / "study.toml").write_text(TOML)
    return folder / "study.toml"


@pytest.fixture(scope="module")
def plain(study, tmp_path_factory):
    """Folder of the study of trivial tasks, never interrupted."""
    out = tmp_path_factory.mktemp("plain")
    run(study, out)
    return out
