"""A noisy trial of a small ship and what the commands made of it, with a fixed prior in place of the search."""

from __future__ import annotations

import numpy as np
import pytest

import pymc_ship as ps
from pymc_ship.inference.regression import identify as identification
from pymc_ship.inference.regression.families import FAMILIES
from pymc_ship.inference.regression.tune import tune_prior
from tests.journeys.cases import run
from tests.physics.vessel.cases import toml


@pytest.fixture(scope="module")
def quick_evidence():
    """Put a fixed prior in the place of the search for the evidence maximum, which has its own tests."""
    with pytest.MonkeyPatch.context() as patch:
        fixed = {"kappa": 1e4, "shape": 100.0, "scale": 0.01}
        patch.setattr(identification, "maximise_evidence", lambda rows, family: (FAMILIES[family](**fixed), 0.0))
        yield


@pytest.fixture(scope="module")
def tuned(made, small):
    """What a short search finds for the yaw."""
    data = ps.regression_data(ps.denoise(ps.read_trial(made / "trial.csv")), small, "yaw", interval=1.0)
    return tune_prior(data, "conjugate", evaluations=6, folds=3, rng=np.random.default_rng(1))


@pytest.fixture(scope="module")
def made(quick_evidence, small, tmp_path_factory):
    """Folder with small.toml, the noisy trial.csv of that vessel and what `regress` made of it."""
    folder = tmp_path_factory.mktemp("made")
    (folder / "small.toml").write_text(toml(small))
    vessel, trial = folder / "small.toml", folder / "trial.csv"
    run("simulate", vessel, "--zigzag", "20/20", "--duration", 150, "--step", 0.1, "--noise", 0.001, "--out", trial)
    words = ("--vessel", vessel, "--family", "conjugate", "--draws", 200)
    run("regress", trial, *words, "--out", folder / "identified")
    return folder
