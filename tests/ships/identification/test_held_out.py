"""Scores of runs that a model was not fitted to: which runs a fit saw, the density, ships that run away."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import stats

import pymc_ship as ps
from pymc_ship.inference.rows.weak_form import weak_form_start
from pymc_ship.inference.trajectory.prior import wide_prior
from pymc_ship.inference.trajectory.windows import WindowFit, fit_windows, prepared_windows, window_misfit
from pymc_ship.physics.manoeuvre.steering_record import first_execute
from pymc_ship.physics.vessel.term_sets import with_terms
from pymc_ship.physics.vessel.vessel import reference_coefficients
from pymc_ship.records.steering.measured import recorded_settings
from pymc_ship.ships.identification.held_out import (
    SCORED_CHANNELS,
    cross_validate,
    forecast_indices,
    recorded_indices,
    score_folds,
)
from tests.physics.forces.test_parts import AHEAD
from tests.physics.forces.test_parts import tanker as by_parts
from tests.ships.identification.cases import RUNS, TRUE_TERMS, scored_upright, tanker, trial, trials


@pytest.fixture(scope="module")
def records():
    return trials(1)


@pytest.fixture(scope="module")
def runs(records):
    return [prepared_windows(record, tanker()) for record in records]


def stated(coefficients):
    """A fit that says so."""
    size = coefficients.size
    return WindowFit(tanker(), coefficients, np.eye(size), np.zeros((size, size)), np.eye(size), {}, 1.0, 1)


def near(factor):
    return stated(factor * reference_coefficients(tanker()))


class TestFolds:
    def test_each_fit_saw_all_runs_but_its_own(self, runs):
        seen = []

        def spy(windows):
            seen.append(windows)
            return near(1.0)

        found = cross_validate(runs, tanker(), spy)
        assert len(seen) == len(found.fits) == found.log_density.size == len(runs)
        for k, windows in enumerate(seen):
            expected = [window for j, run in enumerate(runs) if j != k for window in run]
            assert len(windows) == len(expected)
            assert all(window is other for window, other in zip(windows, expected, strict=True))
            assert not any(window is own for window in windows for own in runs[k])

    def test_each_run_is_scored_under_the_fit_of_its_place(self, runs):
        """A wrong fit spoils its own run alone, but for the common noise: it is given here by equal errors."""
        fits = iter([near(1.0), near(1.05), near(1.0)])
        found = cross_validate(runs, tanker(), lambda _: next(fits))
        sd = np.array(list(found.rms.values()))
        for k, factor in enumerate((1.0, 1.05, 1.0)):
            assert found.log_density[k] == pytest.approx(straight(runs[k], near(factor), sd), rel=1e-12)
        swapped = straight(runs[1], near(1.0), sd)
        assert abs(found.log_density[1] - swapped) > 0.1


def straight(run, fit, sd):
    """Mean over windows of the mean over blocks of the normal log density, channels summed."""
    densities = []
    for window in run:
        misfit = window_misfit(window, tanker(), fit.coefficients)
        densities.append(stats.norm.logpdf(misfit, scale=sd[:, None]).mean(axis=1).sum())
    return np.mean(densities)


class TestScore:
    def test_it_is_the_normal_density_at_the_rms_of_all_windows(self, runs):
        fits = [near(1.02)] * 3
        found = score_folds(runs, tanker(), fits)
        misfits = [window_misfit(window, tanker(), fits[0].coefficients) for run in runs for window in run]
        rms = np.sqrt(np.mean([np.mean(misfit**2, axis=1) for misfit in misfits], axis=0))
        assert list(found.rms) == ["u", "v", "r"]
        np.testing.assert_allclose(list(found.rms.values()), rms, rtol=1e-12)
        expected = [straight(run, fits[0], rms) for run in runs]
        np.testing.assert_allclose(found.log_density, expected, rtol=1e-12)
        shuffled = [straight(run, fits[0], rms[[0, 2, 1]]) for run in runs]
        assert np.min(np.abs(np.array(shuffled) - expected)) > 1.0

    def test_a_window_that_runs_away_costs_its_run_all_and_the_others_nothing(self, runs):
        good = score_folds(runs[1:], tanker(), [near(1.0)] * 2)
        found = score_folds(runs, tanker(), [near(-100.0), near(1.0), near(1.0)])
        assert found.log_density[0] == -np.inf
        np.testing.assert_allclose(found.log_density[1:], good.log_density, rtol=1e-12)
        assert found.rms == pytest.approx(good.rms, rel=1e-12)

    def test_a_model_that_always_runs_away_has_no_score(self, runs):
        found = score_folds(runs, tanker(), [near(-100.0)] * 3)
        assert (found.log_density == -np.inf).all()
        assert np.isnan(list(found.rms.values())).all()

    def test_a_ship_that_rolls_is_judged_by_the_same_channels_as_one_that_does_not(self, container):
        record = trial(ps.zigzag(20.0, 20.0), vessel=container, duration=150.0, interval=0.25, seed=5)
        windows = prepared_windows(record, container)
        fit = stated(reference_coefficients(container))
        found = score_folds([windows], container, [fit])
        assert list(found.rms) == ["u", "v", "r", "p", "phi"]
        sd = np.array([found.rms[name] for name in SCORED_CHANNELS])
        misfits = [window_misfit(window, container, fit.coefficients)[:3] for window in windows]
        expected = np.mean([stats.norm.logpdf(m, scale=sd[:, None]).mean(axis=1).sum() for m in misfits])
        assert SCORED_CHANNELS == ("u", "v", "r")
        assert found.log_density == pytest.approx([expected], rel=1e-12)

    def test_true_terms_are_preferred_to_wrong_ones(self, records):
        """On every run, and by more than chance: the terms `loading` lack the cubes and the hull's linear forces."""
        densities = {}
        for name in (TRUE_TERMS, "loading"):
            vessel = with_terms(tanker(), name)
            prior = wide_prior(records, vessel)
            start = weak_form_start(records, vessel, prior.mean, prior.scale, method="rk4")
            runs = [prepared_windows(record, vessel) for record in records]

            def fit(windows, vessel=vessel, prior=prior, start=start):
                return fit_windows(windows, vessel, prior, start)

            densities[name] = cross_validate(runs, vessel, fit).log_density
        gain = densities[TRUE_TERMS] - densities["loading"]
        assert (gain > 0.0).all()
        assert gain.sum() > np.log(100.0)


class TestIndices:
    @pytest.mark.parametrize("manoeuvre", [RUNS[1], ps.turning_circle(35.0)])
    def test_those_forecast_are_those_of_simulated_ships(self, manoeuvre):
        true = reference_coefficients(tanker())
        rows = np.array([true, 1.02 * true])
        found = forecast_indices(tanker(), rows, manoeuvre, 600.0)
        ship = ps.indices(trial(manoeuvre))
        assert list(found) == scored_upright(manoeuvre)
        for name, values in found.items():
            assert values.shape == (2,)
            assert values[0] == pytest.approx(float(ship[name]), rel=5e-3), name
            assert values[1] != values[0]

    @pytest.mark.parametrize("manoeuvre", [*RUNS, ps.turning_circle(35.0, side="starboard")])
    def test_those_measured_are_those_of_the_record(self, manoeuvre):
        run = trial(manoeuvre, duration=700.0)
        found, ship = recorded_indices(run, manoeuvre, run.attrs["rudder_delay"]), ps.indices(run)
        for name in scored_upright(manoeuvre):
            assert found[name] == pytest.approx(float(ship[name]), rel=0.03), name

    def test_a_record_that_ends_before_them_has_none(self):
        found = recorded_indices(trial(RUNS[1], duration=120.0), RUNS[1])
        assert np.isfinite(found["initial_turning_time"])
        assert np.isnan([found["second_overshoot_angle"], found["period"]]).all()

    def test_a_record_is_left_as_it_is(self):
        run = trial(RUNS[0]).drop_vars(["phi", "x", "y"])
        before = run.copy(deep=True)
        recorded_indices(run, RUNS[0])
        assert run.identical(before)


def test_a_held_out_manoeuvre_is_forecast_in_the_wind_and_at_the_revolutions_of_its_record():
    """Those from the execution on; the direction counts from the base course."""
    vessel = by_parts((*AHEAD, "wind"))
    run = ps.simulate(vessel, ps.zigzag(20, 20), duration=400, step=0.5, record_interval=1.0)
    size = run.sizes["time"]
    n = np.where(run["time"].values < first_execute(run), 0.1, 1.3)
    around = {"n": n, "wind_speed": np.full(size, 8.0), "wind_direction": np.full(size, np.deg2rad(100.0))}
    turned = run.assign({name: ("time", values) for name, values in around.items()}).assign(psi=run["psi"] + 0.5)
    found = recorded_settings(turned, vessel)
    assert found["n"] == 1.3
    np.testing.assert_allclose(found["wind"], (8.0, 100.0 - np.rad2deg(0.5)), rtol=0.02)
    assert recorded_settings(turned, tanker()) == {}
    assert recorded_settings(run, vessel) == {}
