from __future__ import annotations

import importlib
import re
from dataclasses import fields, replace
from functools import partial

import numpy as np
import pytest
from scipy import stats

from pymc_ship.inference.regression.cross_validation import cross_validation
from pymc_ship.inference.regression.families import FAMILIES
from pymc_ship.inference.regression.tune import BoundWarning, maximise_evidence, on_edge, tune_prior
from pymc_ship.inference.rows.data import RegressionData
from tests.inference.regression.peers import oracle, simulated

module = importlib.import_module("pymc_ship.inference.regression.tune")


def scaled(seed=1):
    plain = simulated(60, 4, seed=seed)
    return RegressionData.from_arrays(plain.design_matrix, plain.response, scaling="zscore")


def tuned(family="conjugate", seed=3, evaluations=8, **options):
    return tune_prior(scaled(), family, evaluations=evaluations, rng=np.random.default_rng(seed), **options)


def noise_is_covered(family, seed):
    """Whether the central 90 % of sigma2 hold the truth, in a set whose coefficients come from N(0, 1)."""
    rng = np.random.default_rng([7, seed])
    columns, variance = rng.standard_normal((60, 5)), 10.0 ** rng.uniform(-3.0, 0.0)
    response = columns @ rng.standard_normal(5) + np.sqrt(variance) * rng.standard_normal(60)
    data = RegressionData.from_arrays(columns, response, scaling="none")
    prior, _ = maximise_evidence(data, family)
    low, high = prior.exact(data).noise_variance_quantiles(np.array([0.05, 0.95]))
    return low <= variance <= high


@pytest.fixture(scope="module", params=list(FAMILIES))
def found(request):
    return request.param, tuned(request.param, evaluations=15)


class TestResult:
    def test_scores_are_those_of_cross_validation(self, found):
        family, result = found
        validation = cross_validation(scaled(), 5)
        again = [validation.score(FAMILIES[family](shape=a, scale=b, kappa=k)).mean for a, b, k in result.points]
        assert result.points.shape == (15, 3)
        np.testing.assert_allclose(result.scores, again, atol=1e-9)
        score = validation.score(result.prior)
        assert (result.score, result.score_se) == pytest.approx((score.mean, score.se), abs=1e-12)
        assert result.evaluated_score == pytest.approx(result.scores.max(), abs=1e-9)
        assert result.surrogate_score == validation.score(result.surrogate_prior).mean
        assert result.evidence_score == validation.score(result.evidence_prior).mean

    def test_the_chosen_prior_is_the_better_of_evaluated_and_surrogate(self, found):
        _, result = found
        assert result.score == max(result.evaluated_score, result.surrogate_score)
        assert result.prior in (result.evaluated_prior, result.surrogate_prior)

    def test_every_point_lies_in_the_box(self, found):
        family, result = found
        chosen = [[prior.shape, prior.scale, prior.kappa] for prior in (result.surrogate_prior, result.evidence_prior)]
        shape, scale, kappa = np.vstack([result.points, chosen]).T
        for name, values in (("shape", shape), ("noise_variance", scale / shape), ("kappa", kappa)):
            low, high = FAMILIES[family].box[name]
            assert (values > low * (1.0 - 1e-9)).all()
            assert (values < high * (1.0 + 1e-9)).all()

    def test_the_search_beats_its_space_filling_start(self, found):
        _, result = found
        assert result.scores[5:].max() > result.scores[:5].max()

    @pytest.mark.slow
    def test_the_generator_decides(self):
        one, same, other = tuned(seed=3), tuned(seed=3), tuned(seed=4)
        for field in fields(one):
            assert np.array_equal(getattr(one, field.name), getattr(same, field.name)), field.name
        assert not np.array_equal(one.points, other.points)

    @pytest.mark.slow
    def test_random_folds_score_otherwise(self):
        assert tuned(split="random", folds=4).score != tuned(folds=4).score


class TestSearch:
    bounds = np.log([[0.1, 10.0], [1e-3, 1e3], [1.0, 1e8]])
    best = np.array([1.2, -3.0, 12.0])

    def distance(self, sign):
        """From where the surrogate has its optimum to the known one, in widths of the box."""

        def loss(point):
            return float(sign * np.arcsinh(20.0 * np.sum(((point - self.best) / np.ptp(self.bounds, axis=1)) ** 2)))

        _, losses, optimum = module._search(loss, self.bounds, 30, np.random.default_rng(1))
        return np.abs((optimum - self.best) / np.ptp(self.bounds, axis=1)).max(), losses

    @pytest.mark.slow
    def test_it_finds_a_known_optimum(self):
        distance, losses = self.distance(1.0)
        assert distance < 0.05
        assert losses[12:].min() < 0.2 * losses[:12].min()

    @pytest.mark.slow
    def test_it_leaves_that_point_when_the_sign_is_wrong(self):
        """The broken twin: a score taken for a loss."""
        assert self.distance(-1.0)[0] > 0.4

    @pytest.mark.slow
    @pytest.mark.parametrize("family", FAMILIES)
    def test_forty_evaluations_come_within_a_standard_error_of_the_evidence_maximum(self, family):
        data = oracle("ds2").data
        data = RegressionData.from_arrays(data.design_matrix, data.response, scaling="zscore")
        result = tune_prior(data, family, rng=np.random.default_rng(1))
        assert result.points.shape == (40, 3)
        assert result.score > result.evidence_score - result.score_se
        assert result.scores[12:].max() > result.scores[:12].max()


class TestEvidence:
    @pytest.mark.parametrize("family", FAMILIES)
    def test_no_point_of_the_box_has_more_under_the_hyperprior(self, family):
        data, rng = scaled(), np.random.default_rng(2)
        prior, log_evidence = maximise_evidence(data, family)
        assert log_evidence == prior.exact(data).log_evidence
        low, high = np.log([FAMILIES[family].box[name] for name in ("shape", "noise_variance", "kappa")]).T
        at = np.log([prior.shape, prior.scale / prior.shape, prior.kappa])
        far, near = rng.uniform(low, high, (500, 3)), at + 0.05 * rng.standard_normal((500, 3))
        points = np.exp(np.clip(np.vstack([far, near]), low, high))
        priors = [FAMILIES[family](shape=a, scale=a * v, kappa=k) for a, v, k in points]
        others = [other.exact(data).log_evidence - other.shape for other in priors]
        assert max(others) <= log_evidence - prior.shape + 1e-6
        assert np.mean(np.array(others) < log_evidence - prior.shape - 1e-3) > 0.9

    @pytest.mark.parametrize("family", FAMILIES)
    def test_the_gradient_is_that_of_central_differences(self, family):
        data, step = scaled(), 1e-5

        def posterior(logs):
            shape, noise_variance, kappa = np.exp(logs)
            return FAMILIES[family].from_box(shape=shape, noise_variance=noise_variance, kappa=kappa).exact(data)

        for logs in np.random.default_rng(4).uniform([-1.0, -4.0, -3.0], [3.0, 1.0, 6.0], (20, 3)):
            ends = [[posterior(logs + sign * step * axis).log_evidence for sign in (1, -1)] for axis in np.eye(3)]
            differences = -np.diff(ends)[:, 0] / (2.0 * step)
            np.testing.assert_allclose(posterior(logs).evidence_gradient, differences, rtol=1e-5, atol=1e-4)

    @pytest.mark.consistency
    @pytest.mark.parametrize("family", FAMILIES)
    def test_the_noise_variance_is_covered(self, family, monkeypatch):
        """Intervals of 90 % over 200 simulated sets; without the hyperprior the noise variance is certain and wrong."""
        sets, z = 200, stats.norm.ppf(1.0 - 0.5e-3)
        limit = z * np.sqrt(0.9 * 0.1 / sets)
        assert abs(np.mean([noise_is_covered(family, k) for k in range(sets)]) - 0.9) < limit
        monkeypatch.setattr(FAMILIES[family], "hyperprior_rate", 0.0)
        assert np.mean([noise_is_covered(family, k) for k in range(30)]) < 0.9 - z * np.sqrt(0.9 * 0.1 / 30)

    def test_an_optimum_on_an_edge_is_named(self):
        data, box = scaled(), FAMILIES["conjugate"].box
        prior, _ = maximise_evidence(data)
        assert on_edge(prior) == ()
        with pytest.warns(BoundWarning):
            low, _ = maximise_evidence(data, box=box | {"kappa": (prior.kappa * 2.0, prior.kappa * 4.0)})
        assert on_edge(low, box | {"kappa": (prior.kappa * 2.0, prior.kappa * 4.0)}) == ("kappa",)

    def test_a_record_that_drifts_is_not_scored_with_what_it_holds_out(self):
        """A slow drift and blocks: the scaling of the whole made the score .13 to .43 nat a row too good."""
        rng = np.random.default_rng(0)
        x, drift = rng.normal(size=200), 0.3 * np.cumsum(rng.normal(size=200))
        data = RegressionData.from_arrays(np.column_stack([np.ones(200), x]), x + drift + 0.2 * rng.normal(size=200))
        prior = FAMILIES["conjugate"](kappa=1e-4, shape=2.0, scale=1.0)
        validation = cross_validation(data)
        leaking = replace(
            validation, training=tuple(data.rows(np.isin(data.time, one.time)) for one in validation.training)
        )
        assert leaking.score(prior).mean > validation.score(prior).mean + 0.1

    @pytest.mark.parametrize("search", [maximise_evidence, partial(tune_prior, evaluations=6, rng=1)])
    def test_a_search_that_ends_at_a_bound_warns(self, search):
        """Noise alone: no coefficient differs from zero, and kappa has no lower limit of its own."""
        rng = np.random.default_rng(1)
        data = RegressionData.from_arrays(rng.normal(size=(60, 2)), rng.normal(size=60), dof="sway")
        box = FAMILIES["conjugate"].box | {"kappa": (10.0, 10.001)}
        with pytest.warns(BoundWarning) as caught:
            search(data, "conjugate", box=box)
        assert {"conjugate", "sway", "kappa"} <= set(re.findall(r"\w+", str(caught[0].message)))

    def test_both_families_agree_where_the_noise_variance_is_known(self):
        """At a firm sigma2 the conjugate kappa sigma2 is the semi-conjugate kappa, and the evidence the same."""
        box = {"shape": (1e7, 1.0001e7), "noise_variance": (1e-3, 1.0)}
        data = scaled()
        one, log_one = maximise_evidence(data, "conjugate", box=box | {"kappa": (1e-3, 1e6)})
        other, log_other = maximise_evidence(data, "semiconjugate", box=box | {"kappa": (1e-6, 1e6)})
        assert log_one == pytest.approx(log_other, abs=1e-3)
        assert one.kappa * one.scale / one.shape == pytest.approx(other.kappa, rel=1e-2)
