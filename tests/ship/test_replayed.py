"""Replays along a record's inputs and their scores."""

from __future__ import annotations

import numpy as np
import pytest

import pymc_ship as ps
from pymc_ship.ship.replayed import SCORED
from tests.forces.test_parts import AHEAD
from tests.forces.test_parts import tanker as parts_of_tanker

DURATION = 600.0


@pytest.fixture(scope="module")
def tanker():
    return ps.load_vessel("kvlcc2")


@pytest.fixture(scope="module")
def trial(tanker):
    return ps.simulate(tanker, ps.zigzag(20, 20), duration=DURATION, step=0.5, method="rk4")


def test_a_ship_replays_her_own_run(tanker, trial):
    tree = ps.replay(tanker, trial)
    for name in ("u", "v", "r", "psi", "x", "y"):
        size = np.ptp(trial[name].values)
        median = tree["bands"][name].sel(band="median").values
        assert np.abs(median - trial[name].values).max() < 0.02 * size, name
    assert tree.attrs["share_diverged"] == 0.0


def test_a_replay_begins_anywhere_in_the_record(tanker, trial):
    tree = ps.replay(tanker, trial, start=200, duration=100)
    assert tree["trajectories"]["time"].values[[0, -1]].tolist() == [200.0, 300.0]
    assert tree["measured"].sizes["time"] == tree["bands"].sizes["time"]


def test_another_ship_replays_another_motion(tanker, trial):
    other = tanker.with_coefficients({"yaw": 0.7 * tanker.coefficients("yaw").values})
    own, foreign = (ps.score(ship, trial) for ship in (tanker, other))
    assert own.attrs["score"] < 0.03
    assert foreign.attrs["score"] > 10.0 * own.attrs["score"]


def test_a_score_has_every_channel_of_every_run(tanker, trial):
    found = ps.score(tanker, [trial, trial.isel(time=slice(300, None))], names=["a", "b"], length=100, every=50)
    assert found["channel"].values.tolist() == list(SCORED)
    assert found["windows"].values.tolist() == [10, 7]
    np.testing.assert_allclose(found["score"], found["relative"].mean("channel"))
    assert found.attrs["score"] == pytest.approx(float(found["score"].mean()))


def test_a_window_that_runs_away_costs_the_run_its_score(tanker, trial):
    wild = tanker.with_coefficients({"surge": -5.0 * tanker.coefficients("surge").values})
    found = ps.score(wild, trial, length=300)
    assert found["ran_away"].values.tolist() == [1]
    assert np.isnan(found.attrs["score"])


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        ({"start": -5.0}, "begins and ends inside the record, 0 to 599.5 s, found -5 to 599.5 s"),
        ({"duration": 1e4}, "inside the record.*found 0 to 10000 s"),
        ({"draws": 0}, "needs a draw and 0 < ci_prob < 1, found 0 and 0.9"),
        ({"ci_prob": 1.0}, "found 200 and 1.0"),
    ],
)
def test_a_replay_that_cannot_be_is_one_sentence(tanker, trial, settings, message):
    with pytest.raises(ValueError, match=message) as error:
        ps.replay(tanker, trial, **settings)
    assert str(error.value).endswith(".")


@pytest.mark.parametrize("settings", [{"length": -1.0}, {"every": 0.0}, {"length": 1e4}, {"names": ["a", "b"]}])
def test_windows_that_cannot_be_are_one_sentence(tanker, trial, settings):
    with pytest.raises(ps.TrialError, match="A score needs") as error:
        ps.score(tanker, trial, **settings)
    assert str(error.value).endswith(".")


def test_revolutions_that_were_not_measured_are_those_of_the_approach(tanker):
    """A replay that begins in the turn, where the ship is slow: a ship of parts slows down no further."""
    ship = parts_of_tanker(AHEAD)
    circle = ps.simulate(ship, ps.turning_circle(35), duration=DURATION, step=0.5, method="rk4")
    tree = ps.replay(ship, circle, start=400)
    apart = tree["bands"]["u"].sel(band="median") - tree["measured"]["u"]
    assert float(np.abs(apart).max()) < 0.02
