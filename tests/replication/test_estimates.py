"""Every method on one noisy trial in one form, its scores, and the bound with the errors to expect on it."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from pymc_ship.inference.regression.identify import identify
from pymc_ship.machine.errors import FitError
from pymc_ship.physics.vessel.vessel import reference_coefficients
from pymc_ship.replication import estimates
from pymc_ship.replication.estimates import (
    DIFFERENCES,
    Estimate,
    differencing_estimates,
    exact_estimate,
    regression_estimate,
    trajectory_estimate,
    trajectory_modes,
    weak_form_estimate,
)
from pymc_ship.replication.scores import error_summary, relative_error, summary_rows

# scores ---------------------------------------------------------------------------------------------------------------


def normal_estimate(truth, sd, rng, reach=1.0):
    """Estimate with errors of these standard deviations and intervals ``reach`` times as wide as they should be."""
    problem = SimpleNamespace(prior=SimpleNamespace(law=None))
    fit = SimpleNamespace(coefficients=truth + sd * rng.standard_normal(truth.size), sd=reach * sd, problem=problem)
    return trajectory_estimate(fit)


def mean_coverage(vessel, reach, repeats=200):
    """Mean coverage over independent estimates, and the standard error that a right one has."""
    truth, rng = reference_coefficients(vessel), np.random.default_rng(2)
    sd = 0.1 * np.abs(truth) + 1e-6
    found = [normal_estimate(truth, sd, rng, reach).scores(vessel)["coverage"] for _ in range(repeats)]
    return np.mean(found), 100.0 * np.sqrt(0.9 * 0.1 / (repeats * truth.size))


def test_normal_intervals_of_the_right_size_cover_90_percent(small):
    coverage, error = mean_coverage(small, 1.0)
    assert abs(coverage - 90.0) < 4.0 * error


@pytest.mark.parametrize("reach", [0.9, 1.1])
def test_intervals_of_a_wrong_size_are_told_apart(small, reach):
    """The broken twin."""
    coverage, error = mean_coverage(small, reach)
    assert abs(coverage - 90.0) > 4.0 * error


def test_scores_are_the_error_summary_and_the_share_of_references_inside(small):
    reference = reference_coefficients(small)
    estimate = Estimate(1.1 * reference, reference - 1.0, np.where(np.arange(10) < 4, reference, reference - 0.5))
    expected = error_summary(relative_error(1.1 * reference, reference)) | {"coverage": 40.0}
    assert estimate.scores(small) == pytest.approx(expected | {"coverage_half": np.nan}, nan_ok=True)
    halves = replace(estimate, lower_half=reference - 1.0, upper_half=np.where(np.arange(10) < 3, reference, -1.0))
    assert halves.scores(small)["coverage_half"] == pytest.approx(30.0)


def test_a_method_that_failed_has_no_scores(small):
    nothing = np.full(10, np.nan)
    scores = Estimate(nothing, nothing, nothing).scores(small)
    assert scores.pop("coefficients") == 0
    assert np.isnan(list(scores.values())).all()


def test_an_exact_posterior_is_scored_as_in_the_tables_of_the_study(noisy, small):
    exact = identify(noisy, small, families=("conjugate",)).exact
    expected = next(row for row in summary_rows(small, exact) if row["dof"] == "all")
    scores = exact_estimate(exact["conjugate"]).scores(small)
    assert 0.0 <= scores.pop("coverage_half") <= scores["coverage"]
    assert scores == {key: expected[key] for key in scores}


# methods --------------------------------------------------------------------------------------------------------------


def test_euler_differences_return_the_ship_from_a_clean_euler_run(clean, small):
    estimate = regression_estimate(clean, small, derivative="euler", interval=1.0)
    np.testing.assert_allclose(estimate.coefficients, reference_coefficients(small), rtol=1e-6)


def test_the_weak_form_in_euler_steps_is_better_there_than_the_one_of_measured_records(clean, small):
    reference = reference_coefficients(small)
    worst = {
        method: relative_error(weak_form_estimate(clean, small, method=method).coefficients, reference).max()
        for method in ("euler", "rk4")
    }
    assert worst["euler"] < 0.2 * worst["rk4"]


def test_every_differencing_method_is_estimated_its_own_way(noisy, small):
    found = differencing_estimates(noisy, small)
    assert list(found) == list(DIFFERENCES)
    assert len({tuple(estimate.coefficients) for estimate in found.values()}) == len(DIFFERENCES)
    named = {"central difference": ("central", 0.1), "Savitzky-Golay at 1 s": ("savgol", 1.0)}
    for name, (derivative, interval) in named.items():
        again = regression_estimate(noisy, small, derivative=derivative, interval=interval)
        np.testing.assert_array_equal(again.coefficients, found[name].coefficients)


def test_a_fit_that_no_start_finds_is_none_and_the_other_priors_go_on(noisy, small, monkeypatch):
    def only_damped(trials, vessel, prior, **settings):
        if prior == "flat":
            raise FitError("No minimum was found.")
        return prior, settings

    monkeypatch.setattr(estimates, "trajectory_mode", only_damped)
    modes = trajectory_modes(noisy, small, ("flat", "order_damped"), method="euler")
    assert modes == {"flat": None, "order_damped": ("order_damped", {"method": "euler"})}
