"""Sentences of the errors of this wing, each checked once."""

from __future__ import annotations

import numpy as np

import pymc_ship as ps
from pymc_ship.ships.design.next_run import _Run, design
from pymc_ship.ships.forecasting.stopping import StoppingTest
from tests.sentences import wording
from tests.ships.design.test_next_run import CIRCLE, well_known
from tests.ships.forecasting.posteriors import joint
from tests.ships.identification.cases import tanker

STEPS = ps.rudder_programme([0, 10], [0, 0.1])


def where_no_draw_arrives(monkeypatch):
    monkeypatch.setattr(_Run, "reached_indices", lambda run, names: [])
    design(well_known(), [CIRCLE], interest=[ps.zigzag(10, 10)])


def of_a_posterior():
    tree = joint(tanker(), 10, np.random.default_rng(2))
    design(ps.Ship.from_posterior(tanker(), tree, draws=10, rng=1), [CIRCLE], interest=[CIRCLE])


test_simulation_errors = wording(
    ps.SimulationError,
    (
        r"in 100 m: the turning circle 35 \w+ takes \d+ m; give more sea room",
        lambda: design(well_known(), [CIRCLE, ps.zigzag(20, 20)], sea_room=100.0),
    ),
    *(
        (
            "one candidate and one target manoeuvre or more that have indices",
            lambda candidates=candidates, interest=interest: design(well_known(), candidates, interest=interest),
        )
        for candidates, interest in [
            ([], [CIRCLE]),
            ([STEPS], [CIRCLE]),
            ([StoppingTest(1.0)], [CIRCLE]),
            ([CIRCLE], []),
            ([CIRCLE], [STEPS]),
        ]
    ),
    ("^n must be a whole number from 1 up, found 0; correct it", lambda: design(well_known(), [CIRCLE], 0)),
    ("that nine tenths of the draws reach, found none of", where_no_draw_arrives),
    ("needs forces that depend on wind", lambda: design(well_known(), [CIRCLE], wind=(10.0, 90.0))),
    ("needs the motion of the runs so far, found a ship without it", of_a_posterior),
    (
        "needs the motion of the runs so far, found a ship without it",
        lambda: design("kvlcc2", [CIRCLE], interest=[CIRCLE]),
    ),
)
