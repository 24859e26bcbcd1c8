"""Sentences of the errors of this wing, each checked once."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import xarray as xr

import pymc_ship as ps
from pymc_ship.inference.trajectory.prior import GaussianLikelihood
from pymc_ship.inference.trajectory.sequential_likelihood import EarlierLikelihood
from pymc_ship.machine.errors import FitError
from pymc_ship.ships.identification import candidates, model
from pymc_ship.ships.identification.candidates import with_recorded_effects
from tests.physics.forces.test_parts import AHEAD
from tests.physics.forces.test_parts import tanker as parts_of_tanker
from tests.sentences import wording
from tests.ships.ensemble.cases import ship_of
from tests.ships.ensemble.test_files import SAVED
from tests.ships.identification.cases import RUNS, tanker, trials
from tests.ships.identification.test_model import POORER, identified
from tests.ships.identification.test_page import runs, written
from tests.ships.identification.test_roll import KNOWN, WITH
from tests.ships.identification.test_ship_of_parts import SET, known, with_n


@cache
def record():
    return ps.simulate(tanker(), RUNS[1], duration=600.0, step=0.5, method="rk4")


def of_facilities(*names):
    ps.forecast(replace(ship_of(tanker()), facilities=dict.fromkeys(names)), RUNS[0], rng=1, facility="basin C")


def after_earlier_runs(uses_captive_tests=False, **settings):
    before = replace(ps.load_ship(SAVED / "format_3"), uses_captive_tests=uses_captive_tests)
    ps.identify_ship(trials(0)[:1], tanker(), prior=before, rng=1, **settings)


def where_most_draws_run_away(monkeypatch):
    monkeypatch.setattr(candidates, "is_feasible", lambda vessel, rows: np.arange(len(rows)) < 0.09 * len(rows))
    monkeypatch.setattr(candidates, "first_failure", lambda vessel, row: "in a turn")
    identified(trials(0)[:1], (POORER,))


def where_all_draws_run_away(monkeypatch):
    """Those of the trial before them are sound."""
    for room in (candidates, model):
        monkeypatch.setattr(room, "is_feasible", lambda vessel, rows: np.full(len(rows), len(rows) == 51))
    identified(trials(0)[:1])


def with_revolutions_of_one_run():
    vessel, run = parts_of_tanker(AHEAD), record().isel(time=slice(0, 9))
    with_recorded_effects(ps.with_terms(known(vessel), SET), [with_n(run, vessel.propeller.n), run])


test_fit_errors = wording(
    FitError,
    (
        r"^No term set can be fitted to these trials: The loading .* diverges in 90 % of the draws, in a turn\.$",
        where_most_draws_run_away,
    ),
    (
        "feasible draws, found 0 of 2000: the others diverge in a standard manoeuvre; add trials",
        where_all_draws_run_away,
    ),
)

test_trial_errors = wording(
    ps.TrialError,
    *(
        ("A score needs", lambda settings=settings: ps.score(tanker(), record(), **settings))
        for settings in [{"length": -1.0}, {"every": 0.0}, {"length": 1e4}, {"names": ["a", "b"]}]
    ),
    (
        r"A facility is one of basin A, basin B; found 'basin C'; choose one of them\.",
        lambda: of_facilities("basin A", "basin B"),
    ),
    (
        "The trials of this ship have no facility, found facility='basin C'; leave it out",
        lambda: of_facilities(""),
    ),
    ("needs one trial or more and a name for each, found 0 trials and 0 names; correct", lambda: identified([])),
    ("found 1 trials and 2 names", lambda: identified(trials(0)[:1], names=["a", "b"])),
    ("draws must be a whole number from 2 up, found 1", lambda: identified(trials(0)[:1], draws=1)),
    (
        r"^A run .* lasts half a window .* found 80 s; use a longer run\.$",
        lambda: identified([trials(0)[0], trials(0)[1].isel(time=slice(0, 80))]),
    ),
    *(
        (f"{channel} missing; add them", lambda channel=channel: identified([trials(0)[0].drop_vars(channel)]))
        for channel in ["u", "v", "r", "psi", "delta"]
    ),
    ("measured in all 2 runs or in none, found none in run 2; add n there", with_revolutions_of_one_run),
)

test_vessel_errors = wording(
    ps.VesselError,
    (
        r"^A term set is one of .*; found 'quartic' \(did you mean quadratic\?\); choose one of them\.$",
        lambda: identified(trials(0)[:1], ("quartic",)),
    ),
    (
        r"need a propeller of 'kvlcc2', found none; add \[propeller\]\.$",
        lambda: ps.identify_ship(trials(0)[:1], replace(tanker(), propeller=None), terms=(POORER,), rng=0),
    ),
    (
        r"needs the draught d of 'kvlcc2'; add d \[m\] to \[particulars\]\.$",
        lambda: ps.with_terms(replace(KNOWN, particulars=replace(KNOWN.particulars, d=0.0)), WITH),
    ),
)

test_inference_errors = wording(
    ps.InferenceError,
    (r"found 'vague'; choose one of them\.$", lambda: identified(trials(0)[:1], prior="vague")),
    ("found 'loading'; choose one of them", lambda: after_earlier_runs(terms=["loading"])),
    (
        "in the earlier identification, too; leave them out",
        lambda: after_earlier_runs(uses_captive_tests=True, captive=xr.Dataset()),
    ),
    (
        "needs every coefficient of their vessel, found none of nothing",
        lambda: EarlierLikelihood(
            ("nothing",), GaussianLikelihood(np.array([[2.0]]), np.ones(1)), np.zeros(1), np.zeros(1), np.ones(1)
        ).for_vessel(tanker()),
    ),
)

test_simulation_errors = wording(
    ps.SimulationError,
    (
        "A forecast with revolutions needs forces that depend on revolutions, found no such",
        lambda: ps.forecast(replace(ship_of(tanker()), index_error={}), ps.turning_circle(35), rng=1, n=1.0),
    ),
)

test_value_errors = wording(
    ValueError,
    *(
        (message, lambda settings=settings: ps.replay(tanker(), record(), **settings))
        for settings, message in [
            ({"start": -5.0}, "begins and ends inside the record, 0 to 599.5 s, found -5 to 599.5 s"),
            ({"duration": 1e4}, "inside the record.*found 0 to 10000 s"),
            ({"draws": 0}, "draws must be a whole number from 1 up, found 0"),
            ({"ci_prob": 1.0}, "ci_prob must lie between 0 and 1, found 1.0"),
        ]
    ),
    (
        "trials of the identification, a, b, c, in this order; found b, a, c",
        lambda tmp_path: written(tmp_path, trials={name: runs()[name] for name in "bac"}),
    ),
)
