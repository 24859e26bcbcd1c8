"""Empirical-Bayes thresholding against 20-digit values, against R, against brute force, and its invariants."""

from __future__ import annotations

import csv
import gzip
import re
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from scipy.special import log_ndtr

from pymc_ship.records.denoising.ebayes import PRIORS, RULES, fit_prior, mad, shrink
from pymc_ship.records.denoising.spike_and_slab import SCALE_BOX, threshold_value

DATA = Path(__file__).parents[2] / "data" / "ebayes"
TRUTH_TOLERANCE = 1e-10  # relative above 1, absolute below


@cache
def table(name: str) -> list[dict[str, str]]:
    """Rows of a data file below its line of provenance."""
    with gzip.open(DATA / f"{name}.csv.gz", "rt") as file:
        assert file.readline().startswith("# ")
        return list(csv.DictReader(file))


def column(name: str, key: str) -> np.ndarray:
    return np.array([float(row[key]) for row in table(name)])


def assert_true(computed: np.ndarray, truth: np.ndarray) -> None:
    """Within 1e-10, relative where the truth exceeds 1; the same infinities."""
    assert np.array_equal(np.isinf(computed), np.isinf(truth))
    finite = np.isfinite(truth)
    error = np.abs(computed[finite] - truth[finite]) / np.maximum(1.0, np.abs(truth[finite]))
    assert error.max() < TRUTH_TOLERANCE


# Against 20 digits


SCALE = {"laplace": 0.5, "cauchy": np.nan}  # the scale of the quasi-Cauchy density is NaN


@pytest.mark.parametrize(("rule", "key"), [("median", "postmed"), ("mean", "postmean")])
def test_laplace_posterior_is_true(rule, key):
    x, sdev, weight, scale = (column("truth_post_laplace", name) for name in ("x", "s", "w", "a"))
    truth = column("truth_post_laplace", key)
    computed = sdev * shrink(x / sdev, weight, scale * sdev, rule)
    assert_true(computed, truth)
    assert np.array_equal(computed == 0.0, truth == 0.0)


@pytest.mark.parametrize(("rule", "key"), [("median", "postmed"), ("mean", "postmean")])
def test_cauchy_posterior_is_true(rule, key):
    x, weight, truth = (column("truth_post_cauchy", name) for name in ("x", "w", key))
    computed = shrink(x, weight, np.nan, rule)
    assert_true(computed, truth)
    assert np.array_equal(computed == 0.0, truth == 0.0)


def test_threshold_of_a_weight_is_true():
    for row in table("truth_tfromw"):
        computed = threshold_value(float(row["w"]), np.nan if row["prior"] == "cauchy" else float(row["a"]))
        assert computed == pytest.approx(float(row["t_postmed"]), abs=TRUTH_TOLERANCE)


# Against R

FAULTS_OF_R = {
    r"null_64\.mad\.laplaceNA\.free\.": "weight 0 has an infinite threshold; R gives the end of its bisection, 25 + a",
    r"zeros_64\.(one|mad)\.cauchy\.": "beta.cauchy cancels for |x| < 1e-3, as most x here are",
    r"sparse_1024\.(one|mad)\.cauchy\..*mean": "postmean.cauchy cancels for |x| < 1e-2",
    r"(allsignal|scaled)_1024\.one\.cauchy\..*pm": "weight 1 has threshold 0, R 7e-6; R's median beyond 20 is x - 2/x",
    r"huge40_256\.": "beta.laplace is capped for x - a > 35: the log likelihood of x = 38.7 is 300 too low",
}


def fault_of_r(case: dict[str, str]) -> str:
    return next((why for pattern, why in FAULTS_OF_R.items() if re.match(pattern, case["id"])), "")


def departures_from_r(case: dict[str, str]) -> tuple[list[str], float]:
    """Quantities that differ from R's by more than the oracle's tolerances, and by how much R's fit is likelier."""
    name, _, prior, _, _, rule = case["id"].split(".")
    data, scale = column(name, "x"), None if prior == "laplaceNA" else 0.5
    noise = float(case["sdev_arg"]) if case["sdev_arg"] else mad(data)
    fitted, a, top = fit_prior(data / noise, prior[:7] if prior.startswith("laplace") else prior, scale)
    joint = scale is None
    weight, sdev = float(case["w"]), float(case["sdev"])
    lag = float(case["loglik_rel"]) - top
    limit = noise * threshold_value(fitted, a) - float(case["threshold_origscale"])
    departure = noise * shrink(data / noise, fitted, a, rule) - column(name, case["id"])
    checks = {
        "weight": abs(fitted - weight) < (1e-4 if joint else 1e-8 * weight),
        "scale": not case["a"] or abs(a - float(case["a"])) < 1e-4,
        "sdev": abs(noise / sdev - 1.0) < 1e-12,
        "threshold": abs(limit) < (1e-3 if joint else 1e-7) * sdev,
        "log likelihood": abs(lag) < (1e-4 if joint else 1e-6),
        "estimate": np.abs(departure).max() < (1e-3 if joint else 1e-7) * sdev,
    }
    return [name for name, ok in checks.items() if not ok], lag


CASES = [case for case in table("cases") if case["id"].split(".")[3:5] == ["univ", "pm"]]


@pytest.mark.parametrize("case", [case for case in CASES if not fault_of_r(case)], ids=lambda case: case["id"])
def test_agrees_with_r(case):
    departures, lag = departures_from_r(case)
    assert departures == []
    assert lag < 1e-6


@pytest.mark.parametrize("case", [case for case in CASES if fault_of_r(case)], ids=lambda case: case["id"])
def test_departs_from_r_where_r_is_wrong(case):
    departures, lag = departures_from_r(case)
    assert departures != []
    assert lag < 1e-6


def test_cases_of_r_are_complete():
    assert len(CASES) == 212
    assert sum(bool(fault_of_r(case)) for case in CASES) == 26


# The fit


def log_likelihood(x: np.ndarray, weight: float, scale: float) -> float:
    """Marginal log likelihood less that of weight 0, from normal tails alone."""
    size = np.abs(x)
    slab = np.log(scale / 2) + scale**2 / 2 + np.logaddexp(
        -scale * size + log_ndtr(size - scale), scale * size + log_ndtr(-size - scale)
    )  # fmt: skip
    null = -0.5 * size**2 - 0.5 * np.log(2 * np.pi)
    return float(np.sum(np.logaddexp(np.log1p(-weight) + null, np.log(weight) + slab) - null))


def mixture(seed: int, n: int, n_far: int, far: float, sdev: float) -> np.ndarray:
    """Normal noise of a given standard deviation with some values far away."""
    x = sdev * np.random.default_rng(seed).normal(size=n)
    x[:n_far] = far
    return x


@pytest.mark.parametrize(
    ("x", "peaks"),
    [
        (mixture(1, 2000, 1, 40.0, 1.15), 2),  # the peak at the larger scale is higher
        (mixture(2, 2000, 1, 40.0, 1.15), 2),  # the peak at the smaller scale is higher
        (mixture(3, 256, 12, 40.0, 1.0), 1),  # values beyond R's cap
        (mixture(4, 500, 50, 3.0, 1.0), 1),
        (mixture(5, 300, 0, 0.0, 1.0), 1),
    ],
)
def test_joint_fit_is_the_global_maximum(x, peaks):
    grid = np.geomspace(*SCALE_BOX, 60)
    tops = np.array([fit_prior(x, "laplace", scale)[2] for scale in grid])
    rises = np.concatenate([[True], np.diff(tops) > 0.0, [False]])
    assert np.count_nonzero(rises[:-1] & ~rises[1:]) == peaks
    weight, scale, top = fit_prior(x, "laplace", None)
    assert top == pytest.approx(log_likelihood(x, weight, scale), rel=1e-10)
    assert top > tops.max() - 1e-9
    limit = np.sqrt(2 * np.log(x.size))
    for other in weight * np.array([0.9, 0.999, 1.001, 1.1]):
        if other <= 1.0 and threshold_value(other, scale) <= limit:
            assert log_likelihood(x, other, scale) <= top + 1e-9


def test_profile_is_flat_at_the_estimated_scale():
    x = mixture(6, 400, 40, 4.0, 1.0)
    _, scale, top = fit_prior(x, "laplace", None)
    step = 1e-3 * scale
    right, left = (fit_prior(x, "laplace", scale + side)[2] for side in (step, -step))
    assert abs(right - left) < 1e-3 * abs(right + left - 2 * top)


@pytest.mark.parametrize("prior", PRIORS)
def test_universal_threshold_bounds_the_threshold(prior):
    weight, scale, _ = fit_prior(0.8 * np.random.default_rng(7).normal(size=1000), prior, 0.5)
    assert threshold_value(weight, scale) == pytest.approx(np.sqrt(2 * np.log(1000)), abs=1e-10)


# Invariants


@pytest.mark.parametrize("prior", PRIORS)
@pytest.mark.parametrize("rule", RULES)
@pytest.mark.parametrize("scale", [0.5, None])
def test_the_other_sign_of_the_data_is_the_other_sign_of_the_estimate(prior, rule, scale):
    x = mixture(8, 300, 30, 5.0, 1.0).reshape(20, 15)
    fits = [fit_prior(data, prior, scale)[:2] for data in (x, -x)]
    estimates = [shrink(data, *fitted, rule) for data, fitted in zip((x, -x), fits, strict=True)]
    assert np.array_equal(fits[0], fits[1], equal_nan=True)
    assert estimates[0].shape == x.shape
    assert np.array_equal(estimates[0], -estimates[1])


@pytest.mark.parametrize("prior", PRIORS)
@pytest.mark.parametrize("weight", [1e-6, 0.01, 0.5, 1.0])
def test_posterior_median_is_a_shrinkage_rule(prior, weight):
    x = np.linspace(0.0, 60.0, 6001)
    scale = SCALE[prior]
    limit = threshold_value(weight, scale)
    for sign in (1.0, -1.0):
        estimate = sign * shrink(sign * x, weight, scale, "median")
        assert (estimate[x <= limit] == 0.0).all()
        assert (estimate[x > limit + 1e-9] > 0.0).all()
        assert (estimate <= x).all()
        assert (np.diff(estimate) >= -1e-13).all()
        mean = sign * shrink(sign * x, weight, scale, "mean")
        assert ((mean >= 0.0) & (mean <= x)).all()
    far = {"laplace": 0.5, "cauchy": 2.0 / 60.0}[prior]
    assert x[-1] - estimate[-1] == pytest.approx(far, rel=1e-3)


def test_hard_and_soft_rules_keep_and_move_what_is_beyond_the_threshold():
    x = np.array([-4.0, -1.0, 0.0, 2.0, 6.0])
    limit = threshold_value(0.1, 0.5)
    assert 2.0 < limit < 4.0
    assert shrink(x, 0.1, 0.5, "hard").tolist() == [-4.0, 0.0, 0.0, 0.0, 6.0]
    assert shrink(x, 0.1, 0.5, "soft") == pytest.approx([limit - 4.0, 0.0, 0.0, 0.0, 6.0 - limit])


def test_estimate_adapts_from_sparse_to_dense():
    rng = np.random.default_rng(9)
    for n_signal, share in ((5, 0.15), (50, 0.35), (500, 0.95)):
        mean = np.zeros(1000)
        mean[:n_signal] = 5.0
        loss, hard = 0.0, 0.0
        for _ in range(20):
            x = mean + rng.normal(size=1000)
            loss += np.sum((shrink(x, *fit_prior(x, "laplace", None)[:2], "median") - mean) ** 2)
            hard += np.sum((np.where(np.abs(x) > np.sqrt(2 * np.log(1000)), x, 0.0) - mean) ** 2)
        assert loss < hard  # the universal threshold
        assert loss / 20 < share * 1000  # the data themselves lose 1000


# Edges


@pytest.mark.parametrize("prior", PRIORS)
@pytest.mark.parametrize("rule", RULES)
def test_zeros_stay_zero(prior, rule):
    weight, scale, _ = fit_prior(np.zeros(50), prior, None)
    assert (shrink(np.zeros(50), weight, scale, rule) == 0.0).all()
    assert threshold_value(weight, scale) == pytest.approx(np.sqrt(2 * np.log(50)), abs=1e-10)


def test_single_and_huge_observations():
    assert fit_prior(np.array([3.0]), "laplace", 0.5)[0] == 1.0
    x = np.array([0.1, 1e200, -1e9, 0.2])
    estimate = shrink(x, *fit_prior(x, "laplace", None)[:2], "median")
    assert estimate[1] == pytest.approx(1e200, rel=1e-12)
    assert estimate[2] == pytest.approx(-1e9, rel=1e-8)


def test_mad_is_about_zero():
    assert mad([1.0, -3.0, 2.0]) == pytest.approx(1.4826 * 2.0)
