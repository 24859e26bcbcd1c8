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

from pymc_ship.records.denoising.ebayes import (
    PRIORS,
    RULES,
    ebayes_threshold,
    fit_prior,
    mad,
    posterior_mean,
    posterior_median,
    shrink,
    threshold_from_weight,
)
from pymc_ship.records.denoising.spike_and_slab import SCALE_BOX, condensed, fit_cauchy, fit_laplace
from tests.records.denoising.cases import beta, posterior_weight, weight_from_threshold

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


@pytest.mark.parametrize("key", list(table("truth_beta_laplace")[0])[1:])
def test_beta_laplace_is_true(key):
    sdev = float(re.search(r"s=([\d.]+)", key)[1]) if "s=" in key else 1.0
    scale = float(re.search(r"a=([\d.]+)", key)[1])
    x = column("truth_beta_laplace", "x")
    assert x.max() == 100.0  # R's cap is at x - a > 35
    assert_true(beta(x / sdev, scale * sdev), column("truth_beta_laplace", key))


def test_beta_cauchy_is_true():
    assert_true(beta(column("truth_beta_cauchy", "x")), column("truth_beta_cauchy", "beta"))


@pytest.mark.parametrize("x", [0.0, 1e-200, 1e-9, 1e-5])
def test_beta_cauchy_does_not_cancel_near_zero(x):
    assert beta(x) == pytest.approx(-0.5 + x * x / 8.0, abs=1e-16)  # R: -1


@pytest.mark.parametrize(
    ("function", "key"), [(posterior_median, "postmed"), (posterior_mean, "postmean"), (posterior_weight, "wpost")]
)
def test_laplace_posterior_is_true(function, key):
    x, sdev, weight, scale = (column("truth_post_laplace", name) for name in ("x", "s", "w", "a"))
    truth = column("truth_post_laplace", key)
    unit = 1.0 if function is posterior_weight else sdev
    computed = unit * function(x / sdev, weight, "laplace", scale * sdev)
    assert_true(computed, truth)
    assert np.array_equal(computed == 0.0, truth == 0.0)


@pytest.mark.parametrize(("function", "key"), [(posterior_median, "postmed"), (posterior_mean, "postmean")])
def test_cauchy_posterior_is_true(function, key):
    x, weight, truth = (column("truth_post_cauchy", name) for name in ("x", "w", key))
    computed = function(x, weight, "cauchy")
    assert_true(computed, truth)
    assert np.array_equal(computed == 0.0, truth == 0.0)


def test_weight_of_a_threshold_is_true():
    rows = table("truth_wfromt")
    truth = column("truth_wfromt", "w")
    computed = np.array(
        [weight_from_threshold(float(row["t"]), row["prior"], 0.5 if row["prior"] == "cauchy" else float(row["a"]))
         for row in rows]
    )  # fmt: skip
    normal = truth > 1e-300
    assert np.abs(computed[normal] / truth[normal] - 1.0).max() < TRUTH_TOLERANCE  # relative even for 1e-279
    assert (computed[~normal] < 1e-300).all()


def test_no_threshold_has_weight_1_but_zero():
    assert weight_from_threshold(0.0, "cauchy") == 1.0
    assert weight_from_threshold(40.0, "cauchy") == 0.0  # R: 1


@pytest.mark.parametrize(("threshold", "key"), [("posterior_median", "t_postmed"), ("bayes_factor", "t_bayesfac")])
def test_threshold_of_a_weight_is_true(threshold, key):
    for row in table("truth_tfromw"):
        scale = 0.5 if row["prior"] == "cauchy" else float(row["a"])
        computed = threshold_from_weight(float(row["w"]), row["prior"], scale, threshold)
        assert computed == pytest.approx(float(row[key]), abs=TRUTH_TOLERANCE)


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
    data, _, prior, bound, threshold, rule = case["id"].split(".")
    scale = None if prior == "laplaceNA" else 0.5
    result = ebayes_threshold(
        column(data, "x"),
        prior[:7] if prior.startswith("laplace") else prior,
        scale,
        float(case["sdev_arg"]) if case["sdev_arg"] else None,
        rule,
        universal_bound=bound == "univ",
        threshold="bayes_factor" if threshold == "bf" else "posterior_median",
    )
    joint = scale is None
    weight, sdev = float(case["w"]), float(case["sdev"])
    lag = float(case["loglik_rel"]) - result.log_likelihood
    checks = {
        "weight": abs(result.weight - weight) < (1e-4 if joint else 1e-8 * weight),
        "scale": not case["a"] or abs(result.scale - float(case["a"])) < 1e-4,
        "sdev": abs(result.sdev / sdev - 1.0) < 1e-12,
        "threshold": abs(result.threshold - float(case["threshold_origscale"])) < (1e-3 if joint else 1e-7) * sdev,
        "log likelihood": abs(lag) < (1e-4 if joint else 1e-6),
        "estimate": np.abs(result.estimate - column(data, case["id"])).max() < (1e-3 if joint else 1e-7) * sdev,
    }
    return [name for name, ok in checks.items() if not ok], lag


CASES = table("cases")


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
    assert len(CASES) == 369
    assert sum(bool(fault_of_r(case)) for case in CASES) == 37


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
    bound = weight_from_threshold(np.sqrt(2 * np.log(x.size)), "laplace", scale)
    for other in np.clip(weight * np.array([0.9, 0.999, 1.001, 1.1]), bound, 1.0):
        assert log_likelihood(x, other, scale) <= top + 1e-9


@pytest.mark.parametrize("fit", [fit_laplace, fit_cauchy])
@pytest.mark.parametrize(("n_far", "far"), [(0, 0.0), (2000, 5.0), (20, 40.0), (15000, 1e4)])
def test_condensed_sizes_give_the_fit_of_all(fit, n_far, far):
    x = np.abs(mixture(8, 20000, 0, 0.0, 1.0))
    x[:n_far] += far * np.random.default_rng(9).random(n_far)
    points = condensed(x)
    assert points.shape[1] < x.size / 15
    bound = np.sqrt(2 * np.log(x.size))
    assert fit(points, bound) == pytest.approx(fit(np.array([x, np.ones(x.size)]), bound), rel=1e-9, nan_ok=True)


def test_few_sizes_are_not_condensed():
    x = np.linspace(0.0, 30.0, 500)
    assert condensed(x).tolist() == [x.tolist(), [1.0] * x.size]


@pytest.mark.parametrize("universal_bound", [True, False])
def test_profile_is_flat_at_the_estimated_scale(universal_bound):
    x = mixture(6, 400, 40, 4.0, 1.0)
    _, scale, top = fit_prior(x, "laplace", None, universal_bound=universal_bound)
    step = 1e-3 * scale
    right, left = (fit_prior(x, "laplace", scale + side, universal_bound=universal_bound)[2] for side in (step, -step))
    assert abs(right - left) < 1e-3 * abs(right + left - 2 * top)


def test_universal_threshold_bounds_the_threshold():
    x = np.random.default_rng(7).normal(size=1000) * 0.8
    for prior in PRIORS:
        limit = np.sqrt(2 * np.log(1000))
        assert ebayes_threshold(x, prior).threshold == pytest.approx(limit, abs=1e-10)
        assert ebayes_threshold(x, prior, universal_bound=False).threshold > limit + 0.5


# Invariants


@pytest.mark.parametrize("prior", PRIORS)
@pytest.mark.parametrize("rule", RULES)
@pytest.mark.parametrize("scale", [0.5, None])
def test_scaling_the_data_scales_the_estimate(prior, rule, scale):
    x = mixture(8, 300, 30, 5.0, 1.0).reshape(20, 15)
    for sdev in (1.0, None):
        one = ebayes_threshold(x, prior, scale, sdev, rule)
        other = ebayes_threshold(-1e-3 * x, prior, scale, None if sdev is None else 1e-3, rule)
        assert one.estimate.shape == x.shape
        assert np.allclose(other.estimate, -1e-3 * one.estimate, rtol=1e-8, atol=1e-13)
        assert other.weight == pytest.approx(one.weight, rel=1e-8)
        assert other.threshold == pytest.approx(1e-3 * one.threshold, rel=1e-8)
        assert other.sdev == pytest.approx(1e-3 * one.sdev, rel=1e-14)


@pytest.mark.parametrize("prior", PRIORS)
@pytest.mark.parametrize("weight", [1e-6, 0.01, 0.5, 1.0])
def test_posterior_median_is_a_shrinkage_rule(prior, weight):
    x = np.linspace(0.0, 60.0, 6001)
    limit = threshold_from_weight(weight, prior)
    for sign in (1.0, -1.0):
        estimate = sign * posterior_median(sign * x, weight, prior)
        assert (estimate[x <= limit] == 0.0).all()
        assert (estimate[x > limit + 1e-9] > 0.0).all()
        assert (estimate <= x).all()
        assert (np.diff(estimate) >= -1e-13).all()
        mean = sign * posterior_mean(sign * x, weight, prior)
        assert ((mean >= 0.0) & (mean <= x)).all()
    far = {"laplace": 0.5, "cauchy": 2.0 / 60.0}[prior]
    assert x[-1] - estimate[-1] == pytest.approx(far, rel=1e-3)


@pytest.mark.parametrize("prior", PRIORS)
def test_threshold_and_weight_are_inverse(prior):
    for threshold in (0.01, 0.7, 3.0, 8.0, 20.0):
        weight = float(weight_from_threshold(threshold, prior, 0.3))
        assert threshold_from_weight(weight, prior, 0.3) == pytest.approx(threshold, rel=1e-11)


@pytest.mark.parametrize("prior", PRIORS)
def test_bayes_factor_threshold_halves_the_posterior_weight(prior):
    limit = threshold_from_weight(0.05, prior, 0.3, "bayes_factor")
    assert posterior_weight(limit, 0.05, prior, 0.3) == pytest.approx(0.5, abs=1e-12)


def test_hard_and_soft_rules_keep_and_move_what_is_beyond_the_threshold():
    x = np.array([-4.0, -1.0, 0.0, 2.0, 6.0])
    limit = threshold_from_weight(0.1)
    assert 2.0 < limit < 4.0
    assert shrink(x, 0.1, rule="hard").tolist() == [-4.0, 0.0, 0.0, 0.0, 6.0]
    assert shrink(x, 0.1, rule="soft") == pytest.approx([limit - 4.0, 0.0, 0.0, 0.0, 6.0 - limit])


def test_estimate_adapts_from_sparse_to_dense():
    rng = np.random.default_rng(9)
    for n_signal, share in ((5, 0.15), (50, 0.35), (500, 0.95)):
        mean = np.zeros(1000)
        mean[:n_signal] = 5.0
        loss, hard = 0.0, 0.0
        for _ in range(20):
            x = mean + rng.normal(size=1000)
            loss += np.sum((ebayes_threshold(x, scale=None).estimate - mean) ** 2)
            hard += np.sum((np.where(np.abs(x) > np.sqrt(2 * np.log(1000)), x, 0.0) - mean) ** 2)
        assert loss < hard  # the universal threshold
        assert loss / 20 < share * 1000  # the data themselves lose 1000


# Edges


@pytest.mark.parametrize("prior", PRIORS)
@pytest.mark.parametrize("rule", RULES)
def test_zeros_stay_zero(prior, rule):
    result = ebayes_threshold(np.zeros(50), prior, None, 1.0, rule)
    assert (result.estimate == 0.0).all()
    assert result.threshold == pytest.approx(np.sqrt(2 * np.log(50)), abs=1e-10)


def test_data_without_noise_come_back():
    x = np.array([0.0, 0.0, 0.0, 5.0, 0.0, -1e-3])
    result = ebayes_threshold(x, scale=None, sdev=None)
    assert np.array_equal(result.estimate, x)
    assert (result.sdev, result.threshold, result.weight) == (0.0, 0.0, 1.0)


def test_single_and_huge_observations():
    assert ebayes_threshold([3.0]).weight == 1.0
    result = ebayes_threshold([0.1, 1e200, -1e9, 0.2], scale=None)
    assert result.estimate[1] == pytest.approx(1e200, rel=1e-12)
    assert result.estimate[2] == pytest.approx(-1e9, rel=1e-8)


def test_mad_is_about_zero():
    assert mad([1.0, -3.0, 2.0]) == pytest.approx(1.4826 * 2.0)
