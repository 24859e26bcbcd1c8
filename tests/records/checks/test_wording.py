"""Sentences of the errors of this wing, each checked once."""

from __future__ import annotations

from functools import partial

import numpy as np

import pymc_ship as ps
from tests.records.checks.cases import (
    changed,
    simulated,
    units,
    with_samples,
)
from tests.records.checks.test_plausibility import scaled, trackless
from tests.records.checks.test_revolutions_and_wind import blown
from tests.sentences import wording


def swaying(zigzag, container):
    sway = 120.0 * np.sin(2.0 * np.pi * zigzag["time"].values / 300.0)
    ps.corrected_trial(zigzag, ps.trial_checks(changed(zigzag, y=zigzag["y"].values + sway), container))


def judged_with_wind(reading):
    tanker = ps.load_vessel("kvlcc2")
    circle = ps.simulate(tanker, ps.turning_circle(20), duration=900, step=0.5)
    ps.validated_trial(blown(circle, reading, np.random.default_rng(1)), tanker)


def with_a_flipped_yaw_rate(zigzag):
    ps.corrected_trial(zigzag, ps.trial_checks(units("r", -1.0)(zigzag)))


test_trial_errors = wording(
    ps.TrialError,
    (
        r"cannot be fitted: .*yaw rate: ",
        with_a_flipped_yaw_rate,
    ),
    (r"track closure: .* unexplained", swaying),
    ("20 samples up, found 10", lambda zigzag: ps.trial_checks(zigzag.isel(time=slice(0, 10)))),
    ("must be finite", lambda zigzag: ps.trial_checks(with_samples(zigzag, "v", [7], np.nan))),
    ("uniform", lambda zigzag: ps.trial_checks(zigzag.isel(time=np.r_[0:50, 60:200]))),
    (
        r"Channel v must be that of a ship, found 1e\+15",
        lambda zigzag: ps.trial_checks(with_samples(zigzag, "v", [7], 1e15)),
    ),
    ("needs the channels", lambda zigzag: ps.trial_checks(zigzag.drop_vars(zigzag.data_vars))),
)

test_trial_refused_errors = wording(
    ps.TrialError,
    (
        "makes way ahead",
        lambda container: ps.validated_trial(
            scaled(trackless(simulated(container, ps.zigzag(20.0, 20.0))), u=-0.3, v=0.3), container
        ),
    ),
    *(
        (words, partial(judged_with_wind, reading=reading))
        for reading, words in [
            ("relative", 'of the relative wind, from the bow.*state wind = "relative" in the format'),
            ("relative, from north", "of the relative wind, its direction from north"),
            ("from the bow", "wind_direction counts from the bow"),
        ]
    ),
)
