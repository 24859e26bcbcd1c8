from __future__ import annotations

import json
from dataclasses import replace

import arviz as az
import numpy as np
import pytest

from pymc_ship.inference.regression.conjugate import ConjugatePrior
from pymc_ship.inference.regression.semiconjugate import SemiConjugatePrior
from pymc_ship.inference.regression.tree import rng_state
from pymc_ship.inference.rows.data import RegressionData
from pymc_ship.inference.sampling import gibbs as module
from pymc_ship.inference.sampling.gibbs import gibbs, gibbs_posterior
from tests.inference.regression.peers import cholesky_gibbs, largest_z, oracle, simulated, z_limit


def vector_prior(n_terms, seed=9):
    rng = np.random.default_rng(seed)
    return SemiConjugatePrior(
        mean=rng.standard_normal(n_terms), kappa=rng.uniform(0.2, 5.0, n_terms), shape=3.5, scale=0.7
    )


def conjugate_prior(n_terms):
    prior = vector_prior(n_terms)
    return ConjugatePrior(mean=prior.mean, kappa=prior.kappa, shape=prior.shape, scale=prior.scale)


def case():
    return simulated(20, 3, seed=14), vector_prior(3)


def z_of(data, prior, *, against=None, seed=1, draws=10_000):
    drawn = gibbs(data, prior, draws=draws, rng=np.random.default_rng(seed))
    known_data, known_prior = against or (data, prior)
    return largest_z(*drawn, known_prior.exact(known_data))


class TestTarget:
    @pytest.mark.parametrize(("n_rows", "n_terms"), [(20, 3), (3, 7), (5, 5)])
    def test_moments_are_those_of_the_exact_posterior(self, n_rows, n_terms):
        z, comparisons = z_of(simulated(n_rows, n_terms, seed=14), vector_prior(n_terms))
        assert z < z_limit(comparisons)

    @pytest.mark.parametrize(("n_rows", "n_terms"), [(20, 3), (3, 7)])
    @pytest.mark.parametrize("scaling", ["none", "zscore"])
    def test_moments_are_those_of_the_exact_conjugate_posterior(self, n_rows, n_terms, scaling):
        plain = simulated(n_rows, n_terms, seed=14, noise=3.0)
        data = RegressionData.from_arrays(plain.design_matrix, 50.0 * plain.response, scaling=scaling)
        z, comparisons = z_of(data, conjugate_prior(n_terms))
        assert z < z_limit(comparisons)

    def test_the_marginal_shape_in_the_conjugate_full_conditional_fails(self):
        """A + n/2 in place of A + (n + c)/2: a prior with c/2 less shape."""
        data, prior = simulated(20, 3, seed=14), conjugate_prior(3)
        z, comparisons = z_of(data, replace(prior, shape=prior.shape - 1.5), against=(data, prior))
        assert z > z_limit(comparisons)

    def test_ill_conditioned_columns(self):
        known = oracle("ds2")
        z, comparisons = z_of(known.data, SemiConjugatePrior(kappa=100.0, shape=2.0, scale=1.0), draws=5000)
        assert z < z_limit(comparisons)

    def test_scaled_data(self):
        rng = np.random.default_rng(6)
        X = np.column_stack([rng.normal([3.0, -8.0], 1.0, (30, 2)), np.full(30, 2.0)])
        data = RegressionData.from_arrays(X, 1e-4 * (X @ [1.0, 2.0, 3.0] + rng.standard_normal(30)), scaling="zscore")
        z, comparisons = z_of(data, vector_prior(3))
        assert z < z_limit(comparisons)

    @pytest.mark.parametrize(
        "change",
        [
            {"scale": 1.0 / 0.7},
            {"shape": 3.5 + 0.5 * 3},
            {"kappa": 2.0 * vector_prior(3).kappa},
        ],
        ids=["reciprocal scale", "terms counted as rows", "another kappa"],
    )
    def test_another_prior_fails(self, change):
        data, prior = case()
        z, comparisons = z_of(data, replace(prior, **change), against=(data, prior))
        assert z > z_limit(comparisons)

    def test_a_sum_of_squares_short_of_a_row_fails(self, monkeypatch):
        data, prior = case()
        rotate = module.rotate
        monkeypatch.setattr(module, "rotate", lambda data, prior: rotate(data.rows(np.arange(1, 20)), prior))
        z, comparisons = z_of(data, prior)
        assert z > z_limit(comparisons)

    def test_the_plain_sampler_agrees(self):
        """Two samplers of one posterior: means differ by no more than both Monte-Carlo errors allow."""
        data, prior = case()
        ours = gibbs(data, prior, draws=5000, rng=np.random.default_rng(1))
        theirs = cholesky_gibbs(data.design_matrix, data.response, prior, 20_000, np.random.default_rng(2))
        theirs = (theirs[0][1000:].reshape(4, -1, 3), theirs[1][1000:].reshape(4, -1))
        z = []
        for j in range(4):
            x, y = (np.concatenate([b, s[..., None]], axis=-1)[..., j] for b, s in (ours, theirs))
            error = np.hypot(float(az.mcse(x, method="mean")), float(az.mcse(y, method="mean")))
            z.append((x.mean() - y.mean()) / error)
        assert np.abs(z).max() < z_limit(len(z))


class TestChains:
    def test_chains_mix_and_do_not_depend_on_their_starts(self):
        known = oracle("ds2")
        prior = SemiConjugatePrior(kappa=100.0, shape=2.0, scale=1.0)
        tree = gibbs_posterior(known.data, prior, draws=1000, chains=4, rng=np.random.default_rng(3))
        posterior = tree["posterior"].dataset
        assert dict(posterior.sizes) == {"chain": 4, "draw": 1000, "coefficient": 28}
        assert float(az.rhat(posterior)["coefficients"].max()) < 1.01
        assert float(az.rhat(posterior)["noise_variance"]) < 1.01
        assert float(az.ess(posterior)["coefficients"].min()) > 0.75 * 4000
        assert float(az.ess(posterior)["noise_variance"]) > 0.6 * 4000
        assert tree.attrs["method"] == "gibbs"

    def test_starts_spread_beyond_every_mode_of_the_noise_variance(self, monkeypatch):
        starts, sweep = {}, module._sweep

        def watched(rng, start, *rest):
            starts["at"] = start
            sweep(rng, start, *rest)

        monkeypatch.setattr(module, "_sweep", watched)
        data, prior = case()
        gibbs(data, prior, draws=5, chains=3, rng=np.random.default_rng(1))
        exact = prior.exact(data)
        assert starts["at"].shape == (3,)
        assert starts["at"][0] < exact.noise_variance_quantiles([1e-3])[0]
        assert starts["at"][-1] > exact.noise_variance_quantiles([1.0 - 1e-3])[0]

    def test_the_warm_up_is_discarded(self):
        data, prior = case()
        with_warm_up = gibbs(data, prior, draws=5, chains=1, tune=3, rng=np.random.default_rng(1))
        without = gibbs(data, prior, draws=8, chains=1, tune=0, rng=np.random.default_rng(1))
        np.testing.assert_array_equal(with_warm_up[0], without[0][:, 3:])
        np.testing.assert_array_equal(with_warm_up[1], without[1][:, 3:])

    def test_the_recorded_state_repeats_the_draws(self):
        rng = np.random.default_rng(2)
        rng.standard_normal(7)
        state = rng_state(rng)
        one = gibbs_posterior(*case(), draws=10, chains=2, rng=rng)
        assert one.attrs["rng_state"] == state != rng_state(rng)
        again = np.random.default_rng()
        again.bit_generator.state = json.loads(state)
        assert gibbs_posterior(*case(), draws=10, chains=2, rng=again).identical(one)
