"""Sentences of the errors that many public functions share, each checked once."""

from __future__ import annotations

import numpy as np

import pymc_ship as ps
from tests.sentences import wording

RNG = np.random.default_rng(1)
ZIGZAG = ps.zigzag(20, 20)

test_value_errors = wording(
    ValueError,
    *(
        (
            rf"^Random draws need a seed: .*, found {found}; give one such as rng=1\.$",
            lambda zigzag_trial, bad=bad: ps.pollute(zigzag_trial, level=0.01, rng=bad),
        )
        for bad, found in [("1", "'1'"), (1.5, r"1\.5"), (None, "None")]
    ),
)

test_vessel_errors = wording(
    ps.VesselError,
    (r"^A vessel is .*container, kvlcc2.* found 3; give one of these\.$", lambda: ps.simulate(3, ZIGZAG, duration=9)),
    (r"^A vessel is .*found 'titanic'\.$", lambda: ps.simulate("titanic", ZIGZAG, duration=9)),
    (
        "^A forecast takes one joint posterior or posteriors by degree of",
        lambda: ps.Ship.from_posterior("kvlcc2", "posterior.nc", rng=RNG),
    ),
)

test_trial_errors = wording(
    ps.TrialError,
    (
        r"^A trial must be one xarray Dataset over time, found 2 in a list; give one trial at a time\.$",
        lambda zigzag_trial: ps.denoise([zigzag_trial, zigzag_trial]),
    ),
    (
        "^Trials must be a list of Datasets, found <class 'int'>; give a list",
        lambda: ps.trajectory_posterior(3, "kvlcc2", rng=RNG),
    ),
    (
        "found 1 trials and 2 names",
        lambda zigzag_trial: ps.identify_ship(zigzag_trial, "kvlcc2", names=("a", "b"), rng=RNG),
    ),
)

test_simulation_errors = wording(
    ps.SimulationError,
    (
        r"^The manoeuvre is made by .*; give one of these\.$",
        lambda: ps.simulate("kvlcc2", "zigzag", duration=9),
    ),
)

test_inference_errors = wording(
    ps.InferenceError,
    (
        "^The prior of a regression is a Prior such as Conj.*; make one, or choose",
        lambda: ps.exact_posterior(
            ps.RegressionData.from_arrays(np.eye(3), np.arange(3.0), scaling="none"), "conjugate", rng=RNG
        ),
    ),
    (
        "^The prior of a trajectory fit is a CoefficientPrior or one of flat, ",
        lambda zigzag_trial: ps.trajectory_posterior(zigzag_trial, "container", prior=ps.ConjugatePrior(), rng=RNG),
    ),
)
