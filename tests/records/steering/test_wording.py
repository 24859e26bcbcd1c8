"""Sentences of the errors of this wing, each checked once."""

from __future__ import annotations

import pymc_ship as ps
from pymc_ship.machine.errors import TrialError
from pymc_ship.records.steering.recognition import recognise
from tests.sentences import wording
from tests.ships.identification.cases import tanker, trial

test_trial_errors = wording(
    TrialError,
    *(
        (
            f"{channel} missing",
            lambda channel=channel: recognise([trial(ps.zigzag(20, 20)).drop_vars(channel)], tanker()),
        )
        for channel in ["u", "r", "psi", "delta"]
    ),
)
