from dataclasses import replace
from functools import cache
from types import SimpleNamespace

import numpy as np
import pytest
import xarray as xr
from scipy import stats

from pymc_ship.diagnostics.agreement import Comparison, agreement
from pymc_ship.diagnostics.posterior_statistics import convergence_diagnostics
from pymc_ship.inference.regression.calibration import LEVEL
from pymc_ship.inference.regression.conjugate import ConjugatePrior
from pymc_ship.inference.regression.tree import draws_tree, exact_posterior
from pymc_ship.inference.rows.data import RegressionData

N_COMPARISONS = 5 * 4
"""Mean, standard deviation and three quantiles of three coefficients and the noise variance."""


@cache
def regression():
    rng = np.random.default_rng(4)
    X = rng.normal(size=(30, 3))
    return RegressionData.from_arrays(
        X, X @ np.array([1.0, 2.0, 0.0]) + rng.normal(size=30), ["a", "b", "c"], scaling="none"
    )


PRIOR = ConjugatePrior(kappa=4.0, shape=5.0, scale=8.0)


def right(seed=1, draws=8000):
    return exact_posterior(regression(), PRIOR, draws=draws, rng=np.random.default_rng(seed))


def tree_of(coefficients, noise_variance, **groups):
    options = {"method": "gibbs", "rng_state": "", "groups": groups}
    return draws_tree(regression(), PRIOR, coefficients, noise_variance, **options)


def changed(name, change):
    """Right draws of which one variable was changed."""
    posterior = right()["posterior"].dataset
    draws = {key: posterior[key].values.copy() for key in ("coefficients", "noise_variance")}
    draws[name] = change(draws[name])
    return tree_of(**draws)


def wrong_prior(**changes):
    prior = ConjugatePrior(**{"kappa": 4.0, "shape": 5.0, "scale": 8.0} | changes)
    return exact_posterior(regression(), prior, draws=8000, rng=np.random.default_rng(1))


def half_shifted(coefficients):
    """One chain that sits elsewhere, with the pooled mean kept."""
    shift = np.array([1.0, -1.0, 0.0, 0.0])[:, None, None] * coefficients.std((0, 1))
    return coefficients + shift


def sticky(coefficients):
    """Every draw kept 100 times: a chain that hardly moves."""
    return np.repeat(coefficients[:, ::100], 100, axis=1)


def heavier_tails(coefficients):
    """Mean and standard deviation kept, quantiles not: two values in place of a t distribution."""
    mean, sd = coefficients.mean((0, 1)), coefficients.std((0, 1))
    return mean + sd * np.sign(coefficients - mean)


def test_right_draws_agree():
    table = agreement(PRIOR.exact(regression()), {"first": right(1), "second": right(2)})
    assert table.attrs["comparisons"] == 2 * N_COMPARISONS
    assert table.attrs["z_limit"] == pytest.approx(stats.norm.isf(0.5 * LEVEL / (2 * N_COMPARISONS)))
    assert table["agrees"].all()
    assert table["divergences"].isnull().all()
    assert "first agrees" in table.attrs["verdict"]


@pytest.mark.parametrize(
    "wrong",
    [
        lambda: wrong_prior(scale=1.0 / 8.0),
        lambda: wrong_prior(kappa=16.0),
        lambda: wrong_prior(shape=8.0),
        lambda: changed("coefficients", lambda b: b[..., ::-1]),
        lambda: changed("coefficients", lambda b: b + 0.1 * b.std((0, 1))),
        lambda: changed("coefficients", lambda b: b.mean((0, 1)) + 1.1 * (b - b.mean((0, 1)))),
        lambda: changed("coefficients", heavier_tails),
        lambda: changed("noise_variance", np.sqrt),
    ],
    ids=["reciprocal scale", "kappa squared", "shape", "order", "shifted", "wide", "tails", "sd for variance"],
)
def test_wrong_draws_exceed_the_limit(wrong):
    table = agreement(PRIOR.exact(regression()), {"right": right(), "wrong": wrong()})
    assert table["agrees"].values.tolist() == [True, False]
    assert table["largest_z"].sel({"method": "wrong"}) > table.attrs["z_limit"]
    assert "wrong DISAGREES" in table.attrs["verdict"]


@pytest.mark.parametrize("change", [half_shifted, sticky])
def test_chains_that_do_not_mix_are_flagged(change):
    table = agreement(PRIOR.exact(regression()), {"chain": changed("coefficients", change)})
    assert table["r_hat"].max() > 1.01
    assert not table["agrees"].any()


def test_a_stuck_chain_is_flagged():
    stuck = changed("coefficients", lambda b: np.broadcast_to([1.0, 2.0, 0.0], b.shape))
    table = agreement(PRIOR.exact(regression()), {"stuck": stuck})
    assert not table["agrees"].any()


def test_divergences_are_counted_and_flagged():
    posterior = right()["posterior"].dataset
    draws = posterior["coefficients"].values, posterior["noise_variance"].values
    diverging = np.zeros(draws[1].shape, dtype=bool)
    diverging[0, :3] = True
    clean, broken = (
        tree_of(*draws, sample_stats=xr.Dataset({"diverging": (("chain", "draw"), flags)}))
        for flags in (~diverging & False, diverging)
    )
    table = agreement(PRIOR.exact(regression()), {"clean": clean, "broken": broken})
    assert table["divergences"].values.tolist() == [0.0, 3.0]
    assert table["agrees"].values.tolist() == [True, False]


def test_z_scores_of_right_draws_are_standard_normal():
    exact = PRIOR.exact(regression())
    table = agreement(exact, {f"run {seed}": right(seed, draws=2000) for seed in range(40)})
    assert table["agrees"].all()
    for name in ("z_mean", "z_sd", "z_quantile"):
        runs = table[name].mean([dim for dim in table[name].dims if dim != "method"])
        assert abs(stats.ttest_1samp(runs, 0.0).statistic) < stats.t.isf(0.5 * LEVEL / 3, 39)
        assert 0.8 < table[name].std() < 1.2


def test_table_holds_estimates_and_their_errors():
    table = agreement(PRIOR.exact(regression()), {"exact": right()})
    b = right()["posterior"]["coefficients"].sel(coefficient="b").values
    row = table.sel({"method": "exact"}, drop=True)
    of_b = {name: value.item() for name, value in row.sel(quantity="b").data_vars.items() if value.ndim == 0}
    assert table["quantity"].values.tolist() == ["a", "b", "c", "noise_variance"]
    assert of_b["mean"] == pytest.approx(b.mean(), rel=1e-12)
    assert of_b["sd"] == pytest.approx(b.std(ddof=1), rel=1e-12)
    # independent draws: sd / sqrt(n), and for the standard deviation sd sqrt((kurtosis - 1) / 4 n)
    assert of_b["mcse_mean"] == pytest.approx(b.std() / np.sqrt(b.size), rel=0.1)
    kurtosis = stats.kurtosis(b.ravel(), fisher=False)
    assert of_b["mcse_sd"] == pytest.approx(b.std() * np.sqrt((kurtosis - 1.0) / (4.0 * b.size)), rel=0.1)
    assert of_b["z_mean"] == pytest.approx((of_b["mean"] - of_b["exact_mean"]) / of_b["mcse_mean"])
    assert of_b["z_sd"] == pytest.approx((of_b["sd"] - of_b["exact_sd"]) / of_b["mcse_sd"])
    assert of_b["ess_bulk"] == pytest.approx(b.size, rel=0.15)
    of_noise = row.sel(quantity="noise_variance")
    noise = right()["posterior"]["noise_variance"].values
    below = (noise[..., None] < of_noise["exact_quantile"].values).mean((0, 1))
    assert np.array_equal(of_noise["ecdf"], below)
    assert below == pytest.approx([0.05, 0.5, 0.95], abs=0.02)


def test_exact_posterior_without_quantiles_is_compared_by_moments():
    full = PRIOR.exact(regression())
    names = ("mean", "sd", "noise_variance_mean", "noise_variance_sd")
    table = agreement(SimpleNamespace(**{name: getattr(full, name) for name in names}), {"exact": right()})
    assert "z_quantile" not in table
    assert table.attrs["comparisons"] == 2 * 4
    assert table["agrees"].all()


def test_table_survives_netcdf(tmp_path):
    table = agreement(PRIOR.exact(regression()), {"exact": right()})
    table.to_netcdf(tmp_path / "agreement.nc")
    with xr.open_dataset(tmp_path / "agreement.nc") as read:
        xr.testing.assert_equal(read.load(), table)
        assert read.attrs["verdict"] == table.attrs["verdict"]


def test_a_single_chain_is_compared_and_does_not_agree():
    """Its R-hat is not known."""
    single = changed("coefficients", lambda b: b)
    draws = [single["posterior"][name].values for name in ("coefficients", "noise_variance")]
    table = agreement(PRIOR.exact(regression()), {"one": tree_of(*(values[:1] for values in draws))})
    assert np.isfinite(table["largest_z"]).all()
    assert not table["agrees"].any()


def test_a_single_chain_is_judged_without_r_hat():
    """It needs two chains: nothing is said against the draws of one."""
    exact = PRIOR.exact(regression())
    draws = {
        "one": exact_posterior(regression(), PRIOR, draws=4000, chains=1, rng=1),
        "shifted": exact_posterior(regression(), replace(PRIOR, kappa=0.1), draws=4000, chains=1, rng=1),
        "two": exact_posterior(regression(), PRIOR, draws=4000, chains=2, rng=1),
    }
    table = agreement(exact, draws)
    assert table["agrees"].values.tolist() == [False, False, True]
    first, second, third, _ = table.attrs["verdict"].split("; ")
    assert first.startswith("one is not judged")
    assert second.startswith("shifted DISAGREES")
    assert ["two chains" in text for text in (first, second, third)] == [True, True, False]
    (row, *_) = convergence_diagnostics(draws["one"])
    assert (row["where"], row["passes"]) == ("it needs two chains", False)
    assert [text[:8] for text in Comparison("x", draws, table).disagreements] == ["shifted "]
