"""Sentences of the errors of this wing, each checked once."""

from __future__ import annotations

import numpy as np
import xarray as xr

import pymc_ship as ps
from pymc_ship.ships.forecasting.extrapolation import extrapolation
from pymc_ship.ships.forecasting.force_curves import force_curves
from pymc_ship.ships.forecasting.page import write_forecast_page
from pymc_ship.ships.forecasting.stopping import stopping
from tests.sentences import wording
from tests.ships.forecasting.test_extrapolation import CENTRE, box, si
from tests.ships.forecasting.test_prior_ships import drawn, rows_of, ships
from tests.ships.forecasting.test_stopping import ANY_SPEED


def flat(vessel, trial):
    return ps.coefficient_prior([trial], vessel, "flat", table={"Yv": (-0.01, 0.001)})


def lacking(vessel):
    return drawn(vessel, rows_of(vessel)).isel(coefficient=slice(1, None))


def going_astern(astern):
    stopping(ps.with_terms(ps.load_vessel("kvlcc2"), ANY_SPEED), astern=astern)


test_prior_errors = wording(
    ps.InferenceError,
    *(
        (message, lambda container, prior=prior: ships(container, prior))
        for prior, message in [
            ("flat", "a tree with the group prior or a mapping of DOFs, found str; make one, for example with"),
            (
                {"sway": "flat"},
                "The prior of sway is a pair of RegressionData and Prior or a tree .*, found str; give the",
            ),
            ({"sway": (ps.ConjugatePrior(), ps.ConjugatePrior())}, "pair of RegressionData and Prior .*, found tuple"),
            ({"sway": xr.DataTree()}, "The tree of sway has no coefficients in a group prior; add the group with"),
            (xr.DataTree(), "The tree has no coefficients in a group prior; add the group with with_predictive"),
        ]
    ),
    (
        r"found 101 of 102 without \(prior flat\); use order_damped or",
        lambda container, zigzag_trial: ships(container, flat(container, zigzag_trial)),
    ),
    (
        "A prior of 'small' has 10 coefficients, found 102; make it with",
        lambda small, container, zigzag_trial: ships(small, ps.coefficient_prior([zigzag_trial], container)),
    ),
)

test_vessel_errors = wording(
    ps.VesselError,
    ("found 'heave'", lambda container: ships(container, {"heave": drawn(container, rows_of(container))})),
    ("The joint prior lacks", lambda container: ships(container, lacking(container))),
)

test_trial_errors = wording(
    ps.TrialError,
    *(
        (message, lambda container, spoilt=spoilt: extrapolation(container, si(container, CENTRE), spoilt(box())))
        for spoilt, message in [
            (lambda motion: motion.rename(row="time"), "has the dims row and symbol"),
            (lambda motion: motion.isel(symbol=slice(5)), "has the dims row and symbol"),
            (lambda motion: motion.isel(row=slice(0)), "has rows, found 0 rows"),
            (lambda motion: motion.where(motion != motion[3, 2]), "is finite"),
        ]
    ),
    (
        "r, delta missing; add them",
        lambda container: extrapolation(container, si(container, CENTRE).drop_vars(["r", "delta"]), box()),
    ),
)

test_simulation_errors = wording(
    ps.SimulationError,
    ("modular at any speed", lambda: stopping(ps.load_vessel("kvlcc2"), astern=1.0)),
    *(("1/min over 60", lambda astern=astern: going_astern(astern)) for astern in (0.0, -1.0, 60.0)),
)

test_value_errors = wording(
    ValueError,
    (
        "draws must be a whole number from 2 up, found 1; correct",
        lambda container, zigzag_trial: ships(container, flat(container, zigzag_trial), draws=1),
    ),
    *(
        (
            "(draws must be a whole number from 2 up|ci_prob must .*), found",
            lambda container, settings=settings: ps.forecast(
                container, ps.zigzag(20, 20), rng=1, duration=10.0, **settings
            ),
        )
        for settings in [{"draws": 1}, {"ci_prob": 0.0}, {"ci_prob": 1.0}, {"ci_prob": np.nan}]
    ),
    ("found none; add one", lambda: force_curves([])),
    (r"have shape \(draws, 102\)", lambda container: force_curves([(container, np.zeros((3, 5)))])),
    (
        "at least one forecast, found none",
        lambda container, tmp_path: write_forecast_page(container, {}, tmp_path, command=""),
    ),
    (
        "belongs to one of the forecasts steps; found 'stops'",
        lambda container, tmp_path: write_forecast_page(
            container, {"steps": None}, tmp_path, measured={"stops": None}, command=""
        ),
    ),
)
