"""Sentences of the errors of this wing, each checked once."""

from __future__ import annotations

import pymc_ship as ps
from pymc_ship.machine.errors import TrialError
from pymc_ship.records.steering.current import drift_current
from pymc_ship.records.steering.recognition import recognise
from tests.sentences import wording
from tests.ships.identification.cases import tanker, trial
from tests.ships.sea_trials.cases import run_record

CIRCLE = ps.turning_circle(35)

test_trial_errors = wording(
    TrialError,
    *(
        (
            f"{channel} missing",
            lambda channel=channel: recognise([trial(ps.zigzag(20, 20)).drop_vars(channel)], tanker()),
        )
        for channel in ["u", "r", "psi", "delta"]
    ),
    ("630 deg at least, found 4", lambda: drift_current(run_record(CIRCLE, 1100, wind=None))),
    ("x, y missing", lambda: drift_current(run_record(CIRCLE, 2400, wind=None).drop_vars(["x", "y"]))),
)
