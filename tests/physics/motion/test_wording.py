"""Sentences of the errors of this wing, each checked once."""

from __future__ import annotations

from functools import partial

import numpy as np

import pymc_ship as ps
from pymc_ship.physics.motion.replay import replay
from pymc_ship.physics.motion.sensitivities import sensitivities
from pymc_ship.physics.vessel.vessel import reference_coefficients
from tests.physics.forces.test_parts import AHEAD, tanker
from tests.physics.motion.test_sensitivities import DELTA, START
from tests.sentences import wording


def settings_that_cannot_be_replayed(container, change):
    settings = {"inputs": np.zeros(9), "initial_state": np.r_[12.7, np.zeros(4)], "interval": 0.1}
    settings |= {"coefficients": reference_coefficients(container)} | change
    replay(container, **settings)


test_simulation_errors = wording(
    ps.SimulationError,
    *(
        (
            "tolerance is a number from 1e-13 to 1, found",
            lambda container, tolerance=tolerance: ps.simulate(
                container, ps.zigzag(20, 20), duration=1.0, method="dop853", tolerance=tolerance
            ),
        )
        for tolerance in [0.0, 1.0, np.nan, 1e-15]
    ),
    *(
        (
            message,
            lambda settings=settings: ps.simulate(tanker(AHEAD), ps.zigzag(10, 10), duration=10, step=0.5, **settings),
        )
        for settings, message in [
            ({"wind": (5.0, 0.0)}, "Wind acts on a ship with the part wind, found 'kvlcc2' without it"),
            ({"n": np.nan}, "Revolutions are a number"),
            ({"n": 90.0}, r"up to 5 times the nominal 1.5.*found 90.0; correct them \(1/min over 60 are 1/s\)"),
            ({"current": (15.0, 0.0)}, "A current is slower than the ship, found 15 m/s at a nominal speed of 7.97"),
            ({"current": (-1.0, 0.0)}, "have a speed from 0 m/s and"),
            ({"initial_state": [1.0, 2.0]}, "An initial state has 8 numbers"),
        ]
    ),
    (
        "Revolutions need a ship of parts",
        lambda: ps.simulate("kvlcc2", ps.zigzag(10, 10), duration=10, step=0.5, n=1.0),
    ),
    *(
        (
            found,
            lambda container, change=change: sensitivities(
                container, **({"inputs": DELTA, "initial_state": START, "interval": 0.5} | change)
            ),
        )
        for change, found in [
            ({"coefficients": np.zeros(101)}, r"102 coefficients.*\(101,\)"),
            ({"initial_state": START[:7]}, r"5, 6 or 8 initial states.*\(7,\)"),
            ({"inputs": DELTA[None]}, r"inputs of shape.*\(1, 100\)"),
            ({"method": "heun"}, "euler, rk4.*'heun'"),
            ({"interval": 0.0}, "positive interval.*0.0"),
            ({"substeps": 0}, "substeps.* 0 and"),
            ({"block": 101}, "record's length.*101"),
            ({"block": 0}, "record's length.* 0;"),
        ]
    ),
    *(
        (message, partial(settings_that_cannot_be_replayed, change=change))
        for change, message in [
            ({"coefficients": np.zeros(101)}, r"needs 102 coefficients.*\(101,\)"),
            ({"initial_state": np.zeros(7)}, r"5, 6 or 8 initial states.*\(7,\)"),
            ({"inputs": np.zeros((2, 9))}, r"inputs of shape \(time,\) or \(4, time\).*\(2, 9\)"),
            ({"method": "heun"}, "euler, rk4.*found 'heun'"),
            ({"interval": np.nan}, "positive interval.*nan"),
            ({"substeps": 0}, "substeps from 1.* 0 and 1;"),
            ({"block": 10}, "to the record's length.* 1 and 10;"),
            ({"coefficients": np.zeros((2, 102))}, "Each draw has its initial state, found 2 and 1; match them"),
        ]
    ),
    *(
        (
            message,
            lambda container, settings=settings: ps.simulate(
                container, ps.zigzag(20, 20), **{"duration": 10.0} | settings
            ),
        )
        for settings, message in [
            ({"method": "rk45"}, "one of euler, rk4, dop853; found 'rk45'"),
            ({"duration": 0.0}, "duration must be a positive number, found 0.0 s"),
            ({"duration": -1.0}, "duration must be a positive number, found -1.0 s"),
            ({"duration": np.nan}, "duration must be a positive number, found nan s"),
            ({"duration": np.inf}, "duration must be a positive number, found inf s"),
            ({"step": 0.0}, "step must be a positive number, found 0.0 s"),
            ({"step": np.nan}, "step must be a positive number, found nan s"),
            ({"duration": 0.01}, "at least one step, found 0.01 s at 0.02 s"),
            ({"record_interval": 0.03}, "multiple of the step, found 0.03 s at 0.02 s"),
            ({"record_interval": 0.0}, "multiple of the step, found 0.0 s"),
            ({"record_interval": -1.0}, "multiple of the step, found -1.0 s"),
            ({"record_interval": np.nan}, "multiple of the step, found nan s"),
            ({"record_interval": np.inf}, "multiple of the step, found inf s"),
            ({"coefficients": np.zeros(102)}, r"shape \(draws, 102\), found \(102,\)"),
            ({"coefficients": np.zeros((3, 101))}, r"shape \(draws, 102\), found \(3, 101\)"),
            ({"coefficients": np.zeros((0, 102))}, r"shape \(draws, 102\), found \(0, 102\)"),
        ]
    ),
)
