"""Data sets of the frontier: runs designed after the zigzag, and their bound."""

from __future__ import annotations

import numpy as np

from studies.frontier.data_sets import SLOW_SPEED, Cell, data_set

DURATION = 60.0


def test_designed_runs_come_after_the_zigzag(nine):
    data = data_set(nine, Cell("two", (), n_designed=2), 0.01, 0, root=1, duration=20.0)
    assert [trial.sizes["time"] for trial in data.trials] == [1000] * 3
    assert float(data.clean[1]["u"][0]) == SLOW_SPEED
    other = data_set(nine, Cell("two", (), n_designed=2), 0.01, 1, root=1, duration=20.0)
    assert not data.clean[1].equals(other.clean[1])
    assert data.clean[2].equals(other.clean[2])


def test_the_bound_falls_with_the_noise_and_with_runs(nine):
    cells = [Cell(name, ("bound",), n_designed=n) for name, n in (("one", 0), ("two", 1))]
    one, quiet = (data_set(nine, cells[0], level, 0, root=1, duration=DURATION).bound for level in (0.01, 0.001))
    more = data_set(nine, cells[1], 0.01, 0, root=1, duration=DURATION).bound
    np.testing.assert_allclose(one, 10.0 * quiet, rtol=1e-6)
    assert np.all(more < one)
