"""Sentences of the errors of this wing, each checked once."""

from __future__ import annotations

from functools import partial

import numpy as np

import pymc_ship as ps
from pymc_ship.inference.trajectory.fit import fit_trajectory
from pymc_ship.inference.trajectory.noise import (
    fit_with_noise,
)
from pymc_ship.inference.trajectory.runs import trajectory_run
from pymc_ship.inference.trajectory.windows import (
    fit_windows,
    prepared_windows,
    thin_record,
)
from pymc_ship.machine.errors import FitError
from pymc_ship.physics.vessel.vessel import reference_coefficients
from tests.inference.trajectory.cases import (
    problem_of,
    record,
    rough,
    truth,
)
from tests.inference.trajectory.test_fit import SD_GIVEN
from tests.sentences import wording
from tests.ships.identification.cases import RUNS, tanker, trial, wide_prior


def fitted(trials, ship, **settings):
    return ps.trajectory_posterior(trials, ship, rng=np.random.default_rng(1), **settings)


def with_chains(ship, zigzag, draws, chains):
    fitted(zigzag, ship, draws=draws, chains=chains)


def with_noise(ship, zigzag, sign=1.0, **settings):
    problem = problem_of(ship, [rough(zigzag, 0)])
    fit_with_noise(problem.runs, ship, problem.prior, sign * truth(ship, [zigzag])[:53], **settings)


def without_prior(ship):
    clean = record(ship, ps.zigzag(20.0, 20.0), duration=20.0, interval=1.0)
    settings = {"channels": ["u", "r"], "noise_sd": SD_GIVEN}
    fit_trajectory(problem_of(ship, [clean], "flat", **settings), truth(ship, [clean]))


def without_noise(ship, zigzag):
    trajectory_run(zigzag.assign(v=0.0 * zigzag["v"]), ship)


def windows_that_run_away():
    windows, start = prepared_windows(trial(RUNS[0]), tanker()), -100.0 * reference_coefficients(tanker())
    fit_windows(windows, tanker(), wide_prior(start), start)


test_fit_errors = wording(
    FitError,
    ("determine every coefficient, found undetermined combinations; give them a prior", without_prior),
    (
        r"leaves the model's range at the start of the fit; add a run",
        lambda ship, zigzag: fit_trajectory(problem_of(ship, [rough(zigzag, 0)]), -truth(ship, [zigzag])),
    ),
    (
        "auto, white, ar1, student_t; found 'pink'; choose one of them",
        lambda ship, zigzag: with_noise(ship, zigzag, noise="pink"),
    ),
    ("found 'pink'; choose one of them", lambda ship, zigzag: fitted(zigzag, ship, noise="pink")),
    ("at least one trial, found none; give one", lambda ship: fitted([], ship)),
    ("leaves the model's range at the start of the fit", lambda ship, zigzag: with_noise(ship, zigzag, sign=-1.0)),
    ("leaves the model's range at the start of the fit", windows_that_run_away),
)

test_value_errors = wording(
    ValueError,
    *(
        (sentence, partial(with_chains, draws=draws, chains=chains))
        for draws, chains, sentence in [
            (30, 4, "found 30 draws for 4 chains; give a multiple"),
            (24, 4, "draws must be a whole number from 25 up, found 24"),
            (4, 0, "chains must be a whole number from 1 up, found 0"),
        ]
    ),
)

test_trial_errors = wording(
    ps.TrialError,
    ("found w with rk4", lambda ship, zigzag: fitted(zigzag, ship, channels=["u", "psi", "w"])),
    (
        "channel u needs a positive standard deviation, found -1",
        lambda ship, zigzag: fitted(zigzag, ship, noise_sd={"u": -1.0}),
    ),
    ("v missing", lambda ship, zigzag: fitted(zigzag.drop_vars("v"), ship, channels=["u", "v"])),
    *(
        (message, lambda ship, zigzag, settings=settings: trajectory_run(zigzag, ship, **settings))
        for settings, message in [
            ({"channels": ["u", "w"]}, "found w with rk4"),
            ({"channels": ["u", "u"]}, "The channels must differ, found u more than once"),
            ({"channels": []}, "found no channel with rk4"),
            ({"method": "heun"}, "with heun; correct them"),
            ({"noise_sd": {"delta": 0.1}}, "found delta with rk4"),
            ({"noise_sd": {"u": 0.0}}, "channel u needs a positive standard deviation, found 0"),
            ({"noise_sd": {"u": np.nan}}, "channel u needs a positive standard deviation, found nan"),
        ]
    ),
    (r"channel v needs .* found 0; give it in noise_sd", without_noise),
    ("psi missing", lambda ship, zigzag: trajectory_run(zigzag.drop_vars("psi"), ship, channels=["u", "psi"])),
    (
        r"40 samples or more at 0\.1 s, found 39; use a longer record",
        lambda ship, zigzag: trajectory_run(zigzag.isel(time=slice(0, 39)), ship),
    ),
    (
        "delta must be finite, found 1200 bad values",
        lambda ship, zigzag: trajectory_run(zigzag.assign(delta=np.nan * zigzag["delta"]), ship),
    ),
    (
        r"^A run to identify a ship from lasts half a window of 5 L/U = 201 s at",
        lambda: thin_record(trial(RUNS[0], duration=90.0), tanker()),
    ),
)

test_errors_of_priors = wording(
    ps.InferenceError,
    ("found 'vague'", lambda ship, zigzag: fitted(zigzag, ship, prior="vague")),
    *(
        (found, lambda ship, zigzag, settings=settings: ps.coefficient_prior([zigzag], ship, **settings))
        for settings, found in [
            ({"kind": "horseshoe"}, "found 'horseshoe' and 0.3"),
            ({"relative_sd": np.inf}, "'order_damped' and inf"),
            ({"table": {"Yw": (0.0, 1.0)}}, "found Yw: 0.0, 1.0; correct it"),
            ({"table": {"Yv": (0.0, 0.0)}}, "found Yv: 0.0, 0.0; correct it"),
            ({"table": {"Yv": (np.nan, 1.0)}}, "found Yv: nan, 1.0; correct it"),
        ]
    ),
)
