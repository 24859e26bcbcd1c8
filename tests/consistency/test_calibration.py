"""Simulation-based calibration, coverage and the joint-distribution test of every path, with twins that must fail."""

from __future__ import annotations

import importlib
from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import binom

from pymc_ship.inference.regression.calibration import exact_draws, rank_p_value, simulation_based_calibration
from pymc_ship.inference.regression.families import FAMILIES
from pymc_ship.inference.rows.data import RegressionData
from pymc_ship.inference.sampling.gibbs import gibbs
from pymc_ship.inference.sampling.regression_model import nuts_posterior
from tests.consistency.coverage import coverage
from tests.consistency.geweke import geweke
from tests.inference.regression.peers import simulated
from tests.sentences import refused

module = importlib.import_module("pymc_ship.inference.sampling.gibbs")
LONG = pytest.mark.consistency
families = pytest.mark.parametrize("family", FAMILIES)


def gibbs_draws(data, prior, draws, rng):
    """Every tenth draw of one chain."""
    coefficients, noise_variance = gibbs(data, prior, draws=10 * draws, chains=1, tune=100, rng=rng)
    return coefficients[0, ::10], noise_variance[0, ::10]


def nuts_draws(data, prior, draws, rng):
    """Every fourth draw of one chain."""
    tree = nuts_posterior(data, prior, draws=4 * draws, chains=1, tune=400, rng=rng)
    posterior = tree["posterior"].dataset.isel(chain=0, draw=slice(None, None, 4))
    return posterior["coefficients"].to_numpy(), posterior["noise_variance"].to_numpy()


SAMPLERS = {"exact": exact_draws, "gibbs": gibbs_draws, "nuts": nuts_draws}


def case(family, shape="tall"):
    """A z-scored design with a constant and offsets (tall), or plain columns, more than rows (wide); proper priors."""
    if shape == "wide":
        data = simulated(4, 6, seed=21)
    else:
        rng = np.random.default_rng(20)
        X = np.column_stack([rng.normal([3.0, -8.0], [1.0, 5.0], (20, 2)), np.full(20, 2.0)])
        response = 30.0 * (X @ [1.0, 2.0, 3.0] + rng.standard_normal(20))
        data = RegressionData.from_arrays(X, response, scaling="zscore")
    rng = np.random.default_rng(22)
    mean, kappa = rng.standard_normal(data.n_terms), rng.uniform(0.5, 2.0, data.n_terms)
    return data, FAMILIES[family](mean=mean, kappa=kappa, shape=5.0, scale=2.0)


def note(compared, what, table):
    compared(what, *(table.attrs[name] for name in ("comparisons", "largest_z", "z_limit")))


def under(sample, **change):
    """A sampler that uses a changed prior: ``change`` maps a hyperparameter to a function of it and of n_terms."""

    def wrong(data, prior, draws, rng):
        changed = {name: rule(getattr(prior, name), data.n_terms) for name, rule in change.items()}
        return sample(data, replace(prior, **changed), draws, rng)

    return wrong


def prior_draws(data, prior, draws, rng):
    """A posterior that has not seen the data."""
    variance = prior.scale / rng.standard_gamma(prior.shape, draws)
    spread = np.sqrt(prior.kappas(data.n_terms) * (variance[:, None] if prior.family == "conjugate" else 1.0))
    scaled = prior.means(data.n_terms) + spread * rng.standard_normal((draws, data.n_terms))
    return data.to_original(scaled), data.response_scale**2 * variance


class TestRanks:
    @families
    @pytest.mark.parametrize(
        ("sampler", "shape", "simulations"),
        [
            ("exact", "tall", 200),
            ("gibbs", "tall", 200),
            pytest.param("exact", "tall", 2000, marks=LONG),
            pytest.param("exact", "wide", 2000, marks=LONG),
            pytest.param("gibbs", "tall", 2000, marks=LONG),
            pytest.param("gibbs", "wide", 2000, marks=LONG),
            pytest.param("nuts", "tall", 150, marks=LONG),
            pytest.param("nuts", "wide", 150, marks=LONG),
        ],
    )
    def test_they_are_uniform(self, compared, sampler, family, shape, simulations):
        rng = np.random.default_rng(31)
        table = simulation_based_calibration(*case(family, shape), SAMPLERS[sampler], simulations=simulations, rng=rng)
        note(compared, f"ranks of {simulations} simulations, {sampler}, {family}, {shape}", table)
        assert table.sizes == {"simulation": simulations, "quantity": case(family, shape)[0].n_terms + 2}
        assert table.attrs["calibrated"]

    @families
    @pytest.mark.parametrize(
        ("twin", "sampler", "shape", "simulations"),
        [
            ("shape", "exact", "tall", 200),
            pytest.param("shape", "gibbs", "tall", 1000, marks=LONG),
            pytest.param("shape", "nuts", "tall", 100, marks=LONG),
            pytest.param("kappa", "exact", "wide", 1000, marks=LONG),
            pytest.param("scale", "exact", "tall", 1000, marks=LONG),
        ],
    )
    def test_those_of_a_wrong_posterior_are_not(self, compared, twin, sampler, shape, family, simulations):
        rule = {"shape": lambda a, c: a + c, "kappa": lambda k, _: k**2, "scale": lambda b, _: 1.0 / b}[twin]
        sample = under(SAMPLERS[sampler], **{twin: rule})
        table = simulation_based_calibration(
            *case(family, shape), sample, simulations=simulations, rng=np.random.default_rng(32)
        )
        note(compared, f"twin: ranks under a wrong {twin}, {sampler}, {family}", table)
        assert not table.attrs["calibrated"]

    @families
    def test_only_the_log_likelihood_tells_the_prior_from_the_posterior(self, compared, family):
        table = simulation_based_calibration(*case(family), prior_draws, simulations=200, rng=np.random.default_rng(33))
        note(compared, f"twin: ranks among prior draws, {family}", table)
        z = table["z"].to_series()
        assert z.drop("log_likelihood").max() < table.attrs["z_limit"] < z["log_likelihood"]


class TestBand:
    def test_p_values_of_uniform_ranks_are_uniform(self):
        rng = np.random.default_rng(34)
        p = np.array([rank_p_value(rng.integers(0, 100, 100), 99) for _ in range(400)])
        for level in (0.05, 0.2, 0.5):
            assert 0.7 * level * p.size < np.sum(p <= level) <= binom.ppf(1.0 - 5e-4, p.size, level)

    def test_one_cut_is_the_two_sided_binomial_tail(self):
        """With one draw a rank is 0 or 1, and the band has one point."""
        assert rank_p_value(np.repeat([0, 1], [3, 17]), 1) == pytest.approx(2.0 * binom.cdf(3, 20, 0.5), rel=1e-9)

    @pytest.mark.parametrize("ranks", [np.zeros(300, dtype=int), np.full(300, 99), np.repeat(np.arange(25, 75), 6)])
    def test_ranks_far_from_uniform_have_none(self, ranks):
        assert rank_p_value(ranks, 99) < 1e-9


class TestCoverage:
    @families
    @pytest.mark.parametrize(
        ("shape", "simulations"),
        [("tall", 200), pytest.param("tall", 1000, marks=LONG), pytest.param("wide", 1000, marks=LONG)],
    )
    def test_intervals_hold_the_truth_as_often_as_they_say(self, compared, family, shape, simulations):
        table = coverage(*case(family, shape), simulations=simulations, rng=np.random.default_rng(35))
        note(compared, f"coverage of {simulations} simulations, {family}, {shape}", table)
        assert table.attrs["comparisons"] == 3 * (case(family, shape)[0].n_terms + 1)
        assert table.attrs["calibrated"]

    @families
    def test_those_of_gibbs_do_too(self, compared, family):
        def quantiles(data, prior, probabilities):
            coefficients, variance = gibbs_draws(data, prior, 999, rng)
            return np.quantile(np.column_stack([coefficients, variance]), probabilities, axis=0)

        rng = np.random.default_rng(36)
        table = coverage(*case(family), quantiles, simulations=200, rng=rng)
        note(compared, f"coverage of 200 simulations, gibbs, {family}", table)
        assert table.attrs["calibrated"]

    @families
    def test_those_of_a_wrong_posterior_do_not(self, compared, family):
        def quantiles(data, prior, probabilities):
            exact = replace(prior, shape=prior.shape + 10.0).exact(data)
            return np.column_stack([exact.quantiles(probabilities), exact.noise_variance_quantiles(probabilities)])

        table = coverage(*case(family), quantiles, simulations=200, rng=np.random.default_rng(37))
        note(compared, f"twin: coverage under a wrong shape, {family}", table)
        assert not table.attrs["calibrated"]


class TestJointDistribution:
    """Geweke's test of the whole of ``gibbs``; only the noise variance it starts from is handed in."""

    @pytest.fixture
    def step(self, monkeypatch):
        sweep, start = module._sweep, np.empty(1)
        monkeypatch.setattr(module, "_sweep", lambda rng, _, *rest: sweep(rng, start, *rest))

        def one(data, prior, noise_variance, rng):
            start[0] = noise_variance
            coefficients, after = gibbs(data, prior, draws=1, chains=1, tune=0, rng=rng)
            return coefficients[0, 0], float(after[0, 0])

        return one

    @staticmethod
    def few_rows(family):
        data, prior = case(family)
        return data.rows(np.arange(6)), prior

    @families
    @pytest.mark.parametrize(("chains", "steps"), [(100, 20), pytest.param(250, 100, marks=LONG)])
    def test_the_sampler_keeps_prior_times_likelihood(self, compared, step, family, chains, steps):
        table = geweke(*self.few_rows(family), step, chains=chains, steps=steps, rng=np.random.default_rng(38))
        note(compared, f"joint distribution, {chains} chains of {steps}, gibbs, {family}", table)
        assert table.attrs["comparisons"] == 9
        assert table.attrs["calibrated"]

    @families
    @pytest.mark.parametrize("twin", ["shape", pytest.param("scale", marks=LONG)])
    def test_a_wrong_conditional_does_not(self, compared, step, family, twin):
        """Half a count for each term too few in the shape, as if g'g were no residuals; and B as the scale."""

        def wrong(data, prior, noise_variance, rng):
            shape, scale = prior.shape - 0.5 * data.n_terms, 1.0 / prior.scale
            changed = {"shape": {"shape": shape}, "scale": {"scale": scale}}[twin]
            return step(data, replace(prior, **changed), noise_variance, rng)

        table = geweke(*self.few_rows(family), wrong, chains=100, steps=25, rng=np.random.default_rng(39))
        note(compared, f"twin: joint distribution under a wrong {twin}, gibbs, {family}", table)
        assert not table.attrs["calibrated"]


class TestErrors:
    def test_counts(self):
        rng = np.random.default_rng(1)
        with refused(ValueError, "simulations", 1, 0):
            simulation_based_calibration(*case("conjugate"), simulations=0, rng=rng)
