"""Sentences of the errors of this wing, each checked once."""

from __future__ import annotations

import numpy as np

import pymc_ship as ps
from pymc_ship.machine.errors import FitError
from tests.sentences import wording

test_fit_errors = wording(
    FitError,
    *(
        (
            sentence,
            lambda small, zigzag, sd, changes=changes: ps.identifiability(
                **({"runs": zigzag, "vessel": small, "noise_sd": sd} | changes)
            ),
        )
        for changes, sentence in [
            ({"runs": []}, "found 0 runs, 0 noises, 0 states"),
            ({"coefficients": np.ones(3)}, r"coefficients of shape \(3,\)"),
            ({"noise": []}, "found 1 runs, 0 noises"),
            ({"initial_states": [np.zeros(5), np.zeros(5)]}, "2 states"),
            ({"initial_states": [np.zeros(5)]}, "diverged in run 1"),
            *(({"noise": bad}, "Each of noise must be a Noise, found") for bad in (b"a", ["a"], [None], range(1))),
            *(({"initial_states": bad}, "State 1 of initial_states must be real numbers") for bad in ([b"a"], ["a"])),
            *(
                ({"initial_states": bad}, r"State 1 of initial_states must have 5 numbers, found the shape")
                for bad in (b"a", [3.0], [np.zeros(4)])
            ),
        ]
    ),
)
