"""Every method on one noisy trial in one form, its scores, and the bound with the errors to expect on it."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

import pymc_ship as ps
from pymc_ship.frontier import estimates
from pymc_ship.frontier.bound import cramer_rao_bound, errors_on_bound
from pymc_ship.frontier.estimates import (
    DIFFERENCES,
    Estimate,
    differencing_estimates,
    exact_estimate,
    regression_estimate,
    trajectory_estimate,
    trajectory_modes,
    weak_form_estimate,
)
from pymc_ship.frontier.scores import SHARES, error_summary, relative_error, summary_rows
from pymc_ship.regression.identify import identify
from pymc_ship.trajectory.fit import TrajectoryError
from pymc_ship.vessel.vessel import reference_coefficients
from tests.vessel.cases import TERMS

LEVEL = 0.01
SD = {"u": 0.04, "v": 0.02, "r": 4e-5, "p": 4e-5, "phi": 5e-4}


@pytest.fixture(scope="module")
def clean(small):
    return ps.simulate(small, ps.zigzag(20.0, 20.0), duration=200.0, step=0.1)


@pytest.fixture(scope="module")
def noisy(clean):
    return ps.pollute(clean, level=LEVEL, rng=np.random.default_rng(1))


@pytest.fixture(scope="module")
def bound(clean, noisy, small):
    sd = {name: noisy.attrs[f"noise_sd_{name}"] for name in ("u", "v", "r")}
    return cramer_rao_bound(clean, small, sd, method="euler").values


# scores ---------------------------------------------------------------------------------------------------------------


def normal_estimate(truth, sd, rng, reach=1.0):
    """Estimate with errors of these standard deviations and intervals ``reach`` times as wide as they should be."""
    fit = SimpleNamespace(coefficients=truth + sd * rng.standard_normal(truth.size), sd=reach * sd)
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
    assert estimate.scores(small) == pytest.approx(expected)


def test_a_method_that_failed_has_no_scores(small):
    nothing = np.full(10, np.nan)
    scores = Estimate(nothing, nothing, nothing).scores(small)
    assert scores.pop("coefficients") == 0
    assert np.isnan(list(scores.values())).all()


def test_an_exact_posterior_is_scored_as_in_the_tables_of_the_study(noisy, small):
    exact = identify(noisy, small, families=("conjugate",)).exact
    expected = next(row for row in summary_rows(small, exact) if row["dof"] == "all")
    scores = exact_estimate(exact["conjugate"]).scores(small)
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
            raise TrajectoryError("No minimum was found.")
        return prior, settings

    monkeypatch.setattr(estimates, "trajectory_mode", only_damped)
    modes = trajectory_modes(noisy, small, ("flat", "order_damped"), method="euler")
    assert modes == {"flat": None, "order_damped": ("order_damped", {"method": "euler"})}


# bound ----------------------------------------------------------------------------------------------------------------


def test_a_fit_without_prior_has_the_bound_as_its_standard_deviation(noisy, small, bound):
    """Within the error of a linearisation at the mode in place of the truth."""
    fit = trajectory_modes(noisy, small, ("flat",), method="euler")["flat"].choice.fit
    np.testing.assert_allclose(fit.sd, bound, rtol=0.25)
    assert np.sqrt(np.mean(((fit.coefficients - reference_coefficients(small)) / bound) ** 2)) < 3.0


def test_the_bound_is_proportional_to_the_noise_and_falls_with_every_run(clean, small):
    sd = {name: SD[name] for name in ("u", "v", "r")}
    one = cramer_rao_bound(clean, small, sd, method="euler").values
    double = cramer_rao_bound(clean, small, {name: 2.0 * value for name, value in sd.items()}, method="euler")
    np.testing.assert_allclose(double, 2.0 * one, rtol=1e-9)
    np.testing.assert_allclose(cramer_rao_bound([clean, clean], small, [sd, sd], method="euler"), one / np.sqrt(2.0))


def test_the_bound_is_named_by_coefficient(clean, small):
    found = cramer_rao_bound(clean, small, SD, method="euler")
    assert found["coefficient"].values.tolist() == [name for names in TERMS.values() for name in names]


SPREAD = np.geomspace(0.5, 300.0, 40)


def errors_of(sd, repeats=4000):
    """Mean summary of the errors [%] of independent normal estimates, and its standard error."""
    rng = np.random.default_rng(4)
    errors = np.abs(sd * rng.standard_normal((repeats, sd.size)))
    shares = np.array([100.0 * np.mean(errors < limit, axis=1) for limit in SHARES])
    return shares.mean(axis=1), shares.std(axis=1) / np.sqrt(repeats)


@pytest.mark.parametrize(("wrong", "fits"), [(1.0, True), (0.9, False), (1.1, False)])
def test_expected_shares_are_those_of_normal_errors_of_that_size_and_of_no_other(wrong, fits):
    expected = errors_on_bound(SPREAD)
    shares, error = errors_of(wrong * SPREAD)
    assert (np.abs(shares - [expected[f"under_{limit:g}"] for limit in SHARES]) < 4.0 * error).all() == fits
    assert expected["coefficients"] == SPREAD.size


def test_half_of_the_errors_stay_under_the_expected_median():
    rng, median = np.random.default_rng(5), errors_on_bound(SPREAD)["median"]
    inside = np.abs(SPREAD * rng.standard_normal((4000, SPREAD.size))) < median
    error = np.sqrt(np.mean(inside.mean(axis=0) * (1.0 - inside.mean(axis=0))) / inside.size)
    assert abs(inside.mean() - 0.5) < 4.0 * error


def test_equal_bounds_have_the_median_of_one_normal_error():
    assert errors_on_bound(np.full(7, 10.0))["median"] == pytest.approx(6.744897501960817)


def test_zeros_of_the_reference_do_not_count_and_what_is_unknown_is_far_off():
    known = np.array([1.0, 2.0, 3.0])
    assert errors_on_bound(np.append(known, np.nan)) == errors_on_bound(known)
    assert errors_on_bound(np.append(known, np.inf))["median"] > errors_on_bound(known)["median"]
    assert errors_on_bound(np.array([1.0, np.inf, np.inf]))["median"] == np.inf
    assert errors_on_bound(np.full(2, np.inf)) == pytest.approx(
        {"coefficients": 2, "median": np.inf, "under_5": 0.0, "under_20": 0.0, "under_50": 0.0}
    )
