"""Candidates: reproducible, labelled once each, and such as can be ordered at sea."""

from __future__ import annotations

import numpy as np

import pymc_ship as ps
from pymc_ship.ships.design.candidates import labelled_trials


def rng(seed=1):
    return np.random.default_rng(seed)


def test_candidates_are_manoeuvres_that_can_be_ordered_at_sea(container):
    candidates = ps.candidate_trials(container, duration=100.0, rng=rng())
    assert candidates == ps.candidate_trials(container, duration=100.0, rng=rng())
    assert candidates != ps.candidate_trials(container, duration=100.0, rng=rng(2))
    assert {one.approach_speed for one in candidates.values()} == {None, 6.35}
    programmes = [one for one in candidates.values() if one.kind == "rudder_programme"]
    spiral = candidates["direct spiral 15/5"]
    assert len(programmes) == 4
    assert spiral == ps.direct_spiral(15, 5, hold=8.0)
    for one in programmes:
        if one == spiral:
            continue
        angles = np.rad2deg(one.delta)
        np.testing.assert_allclose(angles, np.round(angles), atol=1e-9)
        assert np.abs(angles).max() <= 35.0 + 1e-9
        assert one.time[-1] >= 100.0
        ends = np.array(one.time[1::2])
        np.testing.assert_array_equal(ends, np.round(ends))
        assert 8 <= np.diff(ends, prepend=0.0).min() <= np.diff(ends, prepend=0.0).max() <= 30


def test_every_candidate_can_be_run(container):
    for label, one in ps.candidate_trials(container, duration=30.0, rng=rng()).items():
        ship = ps.simulate(container, one, duration=30.0, step=0.1, method="rk4")
        assert not ship["diverged"], label


def test_labels_tell_candidates_apart():
    slow = ps.zigzag(20, 20, approach_speed=6.0)
    runs = [ps.zigzag(20, 20), slow, ps.zigzag(20, 20), ps.turning_circle(35), ps.zigzag(20, 20)]
    labels = ["zigzag 20/20 port", "zigzag 20/20 port from 6 m/s", "zigzag 20/20 port #2", "turning circle 35 port"]
    assert list(labelled_trials(runs)) == [*labels, "zigzag 20/20 port #3"]
    assert labelled_trials({"slow": slow}) == {"slow": slow}


def test_a_ship_that_knows_way_astern_can_be_stopped(container):
    tanker = ps.load_vessel("kvlcc2")
    any_speed = ps.with_terms(tanker, "modular at any speed")
    found = ps.candidate_trials(any_speed, rng=rng())
    assert found["stopping test 1.513 1/s astern"] == ps.StoppingTest(1.513)
    for vessel in (container, ps.with_terms(tanker, "modular")):
        assert not any(label.startswith("stopping") for label in ps.candidate_trials(vessel, rng=rng()))
