from __future__ import annotations

import json
from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from pymc_ship.inference.regression.conjugate import ConjugatePrior
from pymc_ship.inference.regression.families import FAMILIES
from pymc_ship.inference.regression.prior_table import hold_fixed, informed_prior, order_damped_prior, sister_ship_table
from pymc_ship.inference.regression.semiconjugate import SemiConjugatePrior
from pymc_ship.inference.regression.tree import read_posterior, write_posterior
from pymc_ship.inference.rows.from_trials import regression_data
from pymc_ship.inference.sampling.gibbs import gibbs, gibbs_posterior
from pymc_ship.inference.sampling.regression_model import nuts_posterior
from pymc_ship.machine.errors import InferenceError
from tests.inference.regression.peers import largest_z, z_limit
from tests.inference.regression.plain_algebra import HELD, NAMES, agree, base, plain, ship, summary
from tests.sentences import refused

TABLE = {"Yr": (2.5, 0.4), "Yv": (-1.0, 0.05)}


def prior_moments(data, prior):
    """Mean and covariance of the original coefficients a priori, from the model's definition."""
    offset, T = data.transformation
    noise = prior.scale / (prior.shape - 1.0) if prior.family == "conjugate" else 1.0
    return offset + T @ prior.means(data.n_terms), (T * prior.kappas(data.n_terms) * noise) @ T.T


@cache
def practice(family):
    """z-scored, centred data with one coefficient fixed, two from a table and two left to the base prior.

    Returns data and prior of the package, and the posterior of the same question put in plain linear algebra: rows
    centred by hand, the level at the centre of the rows in place of the constant.
    """
    whole = ship()
    data = hold_fixed(whole, HELD)
    prior = informed_prior(data, base(family, 4), TABLE)
    X, y = whole.design_matrix[:, [1, 2, 4]], whole.response
    level, unit = y.mean(), y.std()
    first, rest = base(family, 4), 3
    at_mean = first.scale / (first.shape - 1.0) if family == "conjugate" else 1.0
    design = np.column_stack([np.ones(len(y)), X - X.mean(axis=0)])
    slope = unit / X[:, 2].std()
    mean = np.array([unit * first.mean[0], -1.0, 2.5, slope * first.mean[rest]])
    variance = np.array([unit**2 * first.kappa[0] * at_mean, 0.05**2, 0.4**2, slope**2 * first.kappa[rest] * at_mean])
    reduced = y - level - 0.7 * (whole.design_matrix[:, 3] - whole.design_matrix[:, 3].mean())
    noise = (first.shape, first.scale * unit**2)
    known = plain(design, reduced, mean, variance, noise, family)
    back = np.eye(4)
    back[0, 1:] = -X.mean(axis=0)
    offset = np.array([level - 0.7 * whole.design_matrix[:, 3].mean(), 0.0, 0.0, 0.0])
    spread = (known.noise_variance_mean, known.noise_variance_sd)
    return data, prior, summary(known.mean, known.covariance, *spread, offset, back)


@pytest.mark.parametrize("family", FAMILIES)
class TestInformed:
    @pytest.mark.parametrize("scaling", ["none", "zscore"])
    @pytest.mark.parametrize("constant", [True, False])
    def test_marginals_are_those_of_the_table_or_of_the_base_prior(self, family, scaling, constant):
        data = ship(scaling, constant)
        before, after = base(family, data.n_terms), informed_prior(data, base(family, data.n_terms), TABLE)
        mean, covariance = prior_moments(data, after)
        for name, (center, sd) in TABLE.items():
            j = data.coefficients.index(name)
            assert mean[j] == pytest.approx(center, rel=1e-13)
            assert np.sqrt(covariance[j, j]) == pytest.approx(sd, rel=1e-13)
        others = [j for j, name in enumerate(data.coefficients) if name not in TABLE]
        assert (after.mean[others] == before.mean[others]).all()
        assert (after.kappa[others] == before.kappa[others]).all()
        assert (after.shape, after.scale, type(after)) == (before.shape, before.scale, type(before))

    def test_draws_of_the_prior_have_the_moments_of_the_table(self, family):
        data, n_draws = ship(), 200_000
        prior = informed_prior(data, base(family), TABLE)
        rng = np.random.default_rng(3)
        noise = prior.scale / rng.standard_gamma(prior.shape, n_draws) if family == "conjugate" else np.ones(n_draws)
        scaled = prior.mean + np.sqrt(noise[:, None] * prior.kappa) * rng.standard_normal((n_draws, 5))
        draws = data.to_original(scaled)
        for name, (center, sd) in TABLE.items():
            x = (draws[:, data.coefficients.index(name)] - center) / sd
            assert abs(x.mean()) < z_limit(4) * x.std() / np.sqrt(n_draws)
            assert abs(np.mean(x**2) - 1.0) < z_limit(4) * np.std(x**2) / np.sqrt(n_draws)

    def test_the_posterior_is_that_of_plain_algebra_on_unscaled_rows(self, family):
        """All coefficients in the table, no constant: the scaling must drop out but for the noise prior's unit."""
        data = ship("zscore", False)
        table = {"Yv": (-1.0, 0.05), "Yr": (2.5, 0.4), "Yv|v|": (0.5, 0.1), "Ydelta": (0.0, 20.0)}
        prior = informed_prior(data, FAMILIES[family](shape=4.0, scale=0.6), table)
        mean, sd = np.array(list(table.values())).T
        noise = (4.0, 0.6 * np.mean(data.response**2))
        agree(prior.exact(data), plain(data.design_matrix, data.response, mean, sd**2, noise, family))

    def test_a_constant_has_a_prior_of_its_own_where_columns_are_not_centred(self, family):
        data = ship("none")
        prior = informed_prior(data, base(family), {"Y0": (4.0, 0.3)})
        mean, covariance = prior_moments(data, prior)
        assert (mean[0], np.sqrt(covariance[0, 0])) == pytest.approx((4.0, 0.3))

    def test_a_constant_left_alone_has_a_prior_of_its_own(self, family):
        """Its scaled response is centred, its columns are not."""
        data = hold_fixed(ship(), dict.fromkeys(NAMES[1:], 0.1))
        mean, covariance = prior_moments(data, informed_prior(data, base(family, 1), {"Y0": (4.0, 0.3)}))
        assert data.response_center != 0.0
        assert (mean[0], np.sqrt(covariance[0, 0])) == pytest.approx((4.0, 0.3))

    def test_a_conjugate_table_is_sharpened_by_quiet_data(self, family):
        """The sd given the noise variance of the data is that of the table times the root of its ratio to the mean."""
        data = ship()
        prior = informed_prior(data, base(family), TABLE)
        sigma2 = prior.exact(data).noise_variance_mean / data.response_scale**2
        given = np.sqrt(prior.kappa[1] * (sigma2 if family == "conjugate" else 1.0)) * data.transformation[1][1, 1]
        ratio = sigma2 / (prior.scale / (prior.shape - 1.0))
        assert given == pytest.approx(0.05 * (np.sqrt(ratio) if family == "conjugate" else 1.0))

    def test_an_empty_table_changes_nothing(self, family):
        assert informed_prior(ship(), base(family), {}) == base(family)


def test_a_conjugate_table_needs_a_mean_of_the_noise_variance():
    with refused(InferenceError, "shape", 1.0):
        informed_prior(ship(), ConjugatePrior(shape=1.0), TABLE)
    assert informed_prior(ship(), SemiConjugatePrior(shape=1.0), TABLE).shape == 1.0


@pytest.mark.parametrize("family", FAMILIES)
class TestPaths:
    """Fixed, informed and base coefficients together, on scaled and centred data, in every path."""

    def test_exact(self, family):
        data, prior, known = practice(family)
        agree(prior.exact(data), known)

    def test_the_base_prior_is_rejected(self, family):
        data, _, known = practice(family)
        twin = base(family, 4).exact(data)
        assert np.abs((twin.mean - known.mean) / known.sd).max() > 1.0

    def test_gibbs(self, family):
        data, prior, known = practice(family)
        z, comparisons = largest_z(*gibbs(data, prior, draws=10_000, rng=np.random.default_rng(1)), known)
        assert z < z_limit(comparisons)

    @pytest.mark.consistency
    @pytest.mark.parametrize("sampler", ["nutpie", "pymc"])
    def test_nuts(self, family, sampler):
        data, prior, known = practice(family)
        tree = nuts_posterior(data, prior, draws=500, rng=np.random.default_rng(2), sampler=sampler)
        assert not tree["sample_stats"]["diverging"].any()
        posterior = tree["posterior"]
        z, comparisons = largest_z(posterior["coefficients"].values, posterior["noise_variance"].values, known)
        assert z < z_limit(comparisons)


class TestDamped:
    @pytest.mark.parametrize("family", FAMILIES)
    def test_the_scale_falls_with_the_order(self, family):
        prior = order_damped_prior(ship(), replace(base(family), kappa=8.0), damping=0.5)
        np.testing.assert_allclose(prior.kappa, [8.0, 8.0, 8.0, 2.0, 8.0])
        assert prior == replace(base(family), kappa=[8.0, 8.0, 8.0, 2.0, 8.0])

    def test_the_terms_of_a_vessel(self, container, zigzag_trial):
        data = regression_data(zigzag_trial, container, "yaw", interval=1.0)
        prior = order_damped_prior(data, ConjugatePrior(kappa=100.0))
        kappa = dict(zip(data.coefficients, prior.kappa, strict=True))
        expected = {"N0": 1.0, "N0u": 1.0, "Nr": 1.0, "Nv|r|": 0.09, "Nvrr": 0.0081, "Npu|pu|": 0.3**6}
        for name, factor in expected.items():
            assert kappa[name] == pytest.approx(100.0 * factor)
        assert prior.exact(data).log_evidence != ConjugatePrior(kappa=100.0).exact(data).log_evidence

    def test_no_damping_keeps_the_prior(self):
        assert order_damped_prior(ship(), base("conjugate"), damping=1.0) == base("conjugate")

    def test_a_table_over_a_damped_prior_is_met(self):
        prior = informed_prior(ship(), order_damped_prior(ship(), SemiConjugatePrior()), {"Yv|v|": (0.5, 0.1)})
        mean, covariance = prior_moments(ship(), prior)
        assert (mean[3], np.sqrt(covariance[3, 3])) == pytest.approx((0.5, 0.1))


class TestSisterShip:
    def test_mean_and_sd(self, container):
        table = sister_ship_table(container, "yaw", relative_sd=0.2, floor=3e-4)
        assert list(table) == container.coefficients("yaw")["coefficient"].values.tolist()
        assert table["Nr"] == pytest.approx((-2.9e-3, np.hypot(0.2 * 2.9e-3, 3e-4)))
        assert table["Nr|r|"] == (0.0, 3e-4)

    def test_the_floor_by_default_is_that_of_the_middle_coefficient(self, container):
        middle = np.median(np.abs(container.coefficients("yaw").values))
        assert sister_ship_table(container, "yaw")["Nr|r|"] == pytest.approx((0.0, 0.3 * middle))

    def test_only_the_names_asked_for(self, container):
        assert list(sister_ship_table(container, "yaw", names=["Nr", "Nv"])) == ["Nv", "Nr"]


class TestPriorValues:
    """Priors as values: equality, hash and what they refuse."""

    @pytest.mark.parametrize("family", FAMILIES)
    def test_vectors_survive_the_attrs_of_a_posterior(self, family, tmp_path):
        prior = informed_prior(ship(), base(family), TABLE)
        tree = gibbs_posterior(ship(), prior, draws=8, rng=np.random.default_rng(1))
        stored = json.loads(read_posterior(write_posterior(tree, tmp_path / "posterior.nc")).attrs["prior"])
        assert FAMILIES[stored.pop("family")](**stored) == prior

    def test_equality_is_that_of_family_and_hyperparameters(self):
        prior = ConjugatePrior(mean=[0.0, 1.0], kappa=2.0)
        assert prior == ConjugatePrior(mean=np.array([0.0, 1.0]), kappa=2)
        assert hash(prior) == hash(ConjugatePrior(mean=(0, 1), kappa=2.0))
        assert prior != replace(prior, mean=[0.0, 1.5])
        assert prior != replace(prior, mean=[0.0, 1.0, 2.0])
        assert prior != SemiConjugatePrior(mean=[0.0, 1.0], kappa=2.0)
        assert ConjugatePrior(mean=0.0) != ConjugatePrior(mean=[0.0])
        assert prior != "conjugate"

    def test_a_prior_does_not_change_with_the_vector_it_was_made_from(self):
        kappa = np.array([1.0, 2.0])
        prior = ConjugatePrior(kappa=kappa)
        kappa[0] = 5.0
        assert prior == ConjugatePrior(kappa=[1.0, 2.0])
        with refused(ValueError, "read-only"):
            prior.kappa[0] = 5.0
