from __future__ import annotations

import numpy as np
import pytest

from pymc_ship.inference.identifiability.bound import cramer_rao_bound, errors_on_bound
from pymc_ship.physics.vessel.vessel import reference_coefficients
from pymc_ship.replication.estimates import trajectory_modes
from pymc_ship.replication.scores import ERROR_LIMITS
from tests.physics.vessel.cases import TERMS

SD = {"u": 0.04, "v": 0.02, "r": 4e-5, "p": 4e-5, "phi": 5e-4}


@pytest.fixture(scope="module")
def bound(clean, noisy, small):
    sd = {name: noisy.attrs[f"noise_sd_{name}"] for name in ("u", "v", "r")}
    return cramer_rao_bound(clean, small, sd, method="euler").values


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
    shares = np.array([100.0 * np.mean(errors < limit, axis=1) for limit in ERROR_LIMITS])
    return shares.mean(axis=1), shares.std(axis=1) / np.sqrt(repeats)


@pytest.mark.parametrize(("wrong", "fits"), [(1.0, True), (0.9, False), (1.1, False)])
def test_expected_shares_are_those_of_normal_errors_of_that_size_and_of_no_other(wrong, fits):
    expected = errors_on_bound(SPREAD)
    shares, error = errors_of(wrong * SPREAD)
    assert (np.abs(shares - [expected[f"under_{limit:g}"] for limit in ERROR_LIMITS]) < 4.0 * error).all() == fits
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
