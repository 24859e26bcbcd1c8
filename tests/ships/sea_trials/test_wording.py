"""Sentences of the errors of this wing, each checked once."""

from __future__ import annotations

from dataclasses import replace
from functools import partial

import numpy as np

import pymc_ship as ps
from pymc_ship.ships.sea_trials.conditions import load_conditions
from tests.sentences import wording
from tests.ships.ensemble.cases import ship_of
from tests.ships.sea_trials.cases import run_record, ship, tanker

CIRCLE, ZIGZAG = ps.turning_circle(35), ps.zigzag(10, 10)


def at_full_load(full_load=None, **settings):
    run = {"circle": run_record(CIRCLE, 2400, wind=None)}
    ps.sea_trial(run, tanker(), full_load=full_load or tanker(), rng=1, **settings)


def without_a_manoeuvre():
    run = run_record(ZIGZAG, 200, wind=None)
    ps.sea_trial([run.assign(delta=0.0 * run["delta"])], tanker(), rng=1)


test_trial_errors = wording(
    ps.TrialError,
    *(
        (message, partial(load_conditions, table))
        for table, message in [
            ({"weather": {}}, "unknown key weather"),
            ({"water": {"deep": 1.0}}, "unknown key water.deep"),
            ({"water": {"depth": 0.0}}, "water.depth must be positive, found 0"),
            ({"water": {"depth": -4.0}}, "water.depth must be a number from 0 up, found -4.0"),
            ({"water": {"sea_state": 11}}, "whole number from 0 to 9, found 11"),
            ({"water": {"sea_state": 2.5}}, "whole number from 0 to 9, found 2.5"),
            ({"wind": {"speed": 4.0}}, "wind.from is missing"),
            ({"form": {"date": 4}}, "form.date must be a text"),
            ({"water": 3}, "must be a table"),
        ]
    ),
    (
        "needs a modular term set",
        lambda: at_full_load(
            ship=replace(ship(), members=ship_of((ps.load_vessel("kvlcc2"), np.zeros((2, 29)))).members)
        ),
    ),
    ("give ship", at_full_load),
    (
        "found 200 m and 320 m",
        lambda: at_full_load(replace(tanker(), particulars=replace(tanker().particulars, L=200.0)), ship=ship()),
    ),
    ("No run is of a standard manoeuvre", without_a_manoeuvre),
)

test_simulation_errors = wording(
    ps.SimulationError,
    *(
        ("direct spiral holds each angle", lambda settings=settings: ps.direct_spiral(15.0, **settings))
        for settings in [{"hold": 0.0}, {"hold": 100.0, "step_deg": 4.0}, {"hold": np.inf}]
    ),
)
