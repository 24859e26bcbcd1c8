"""Sentences of the errors of this wing, each checked once."""

from __future__ import annotations

import numpy as np
import xarray as xr

import pymc_ship as ps
from tests.inference.captive import test_plausibility as wrong
from tests.inference.captive.test_fit import tanker
from tests.sentences import wording

__all__ = ["tanker"]

test_trial_errors = wording(
    ps.TrialError,
    *(
        (
            sentence.replace("[", r"\["),
            lambda read, header=header, rows=rows, settings=settings: read(*rows, header=header, **settings),
        )
        for header, rows, settings, sentence in [
            ("beta,delta,X'", ("0,0,1e-3",) * 2, {}, "captive tests have the columns speed"),
            ("beta,speed", ("0,8",) * 2, {}, "any of X', Y', N'"),
            ("speed,speed [kn],X'", ("8,15,1e-3",) * 2, {}, "from one column, found 'speed' and"),
            ("speed,X [N]", ("8,1e-3",) * 2, {}, "left out, as forces are prime, found 'N'"),
            ("speed [m],X'", ("8,1e-3",) * 2, {}, "the unit is one of m/s"),
            ("speed,X'", ("8,1e-3", "8,"), {}, "X lacks one; fill it in"),
            ("speed,X'", ("0.7,1e-3",) * 2, {}, "near the ship's nominal 7.97 m/s, found a median of 0.7 m/s"),
            (
                "speed,X'",
                ("15.5,1e-3",) * 2,
                {},
                "found a median of 1.94 times the ship's nominal one, as in knots; write",
            ),
            ("speed,X'", ("1.2,1e-3",) * 2, {}, "as scale.froude in a format file .1: the ship itself"),
            ("speed,X'", ("8,1e-3", "0,2e-3"), {}, "found a speed of 0; leave it out"),
            ("v [m/s],X'", ("8,1e-3",) * 2, {}, "found v, which may be the velocity of sway; write U and beta"),
            ("speed,X'", ("8,1e-3",) * 2, {"format": {"frame": {"heading": "compass"}}}, "has no heading"),
            ("speed,N'", ("8,1e-3",) * 2, {"format": {"frame": {"reference": 3.0}}}, "needs Y'; add it"),
        ]
    ),
)

test_fit_errors = wording(
    ps.TrialError,
    (
        "^Captive tests must be finite, found NaN or infinity in Y; drop such tests",
        lambda tanker: ps.fit_captive(xr.Dataset({"Y": ("test", [np.nan])}), *tanker),
    ),
)

test_implausible_tests = wording(
    ps.TrialError,
    *(
        (sentence, lambda tmp_path, columns=columns: wrong.read(tmp_path, columns()))
        for columns, sentence in wrong.WRONG
    ),
    (
        r'set frame\.forces = "L2"',
        lambda tmp_path: wrong.read(tmp_path, wrong.series(), format={"frame": {"forces": "Ld"}}),
    ),
)
