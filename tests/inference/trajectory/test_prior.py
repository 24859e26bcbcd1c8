"""Priors of all coefficients at once."""

from __future__ import annotations

import numpy as np
import pytest
import xarray as xr
from scipy import stats

import pymc_ship as ps
from pymc_ship.inference.rows.weak_form import coefficient_scales
from pymc_ship.inference.trajectory.prior import CoefficientPrior, coefficient_dofs
from pymc_ship.inference.trajectory.scale_law import FACTOR_SD, FREEDOM
from pymc_ship.physics.vessel.hull_database import particulars_prior
from pymc_ship.physics.vessel.vessel import coefficient_names, reference_coefficients
from tests.inference.trajectory.cases import record


@pytest.fixture(scope="module")
def trial(container):
    return record(container, ps.zigzag(20.0, 20.0))


@pytest.fixture(scope="module")
def typical(container, trial):
    return coefficient_scales([trial], container)


def tree_of(names, mean, sd, draws=500):
    """Posterior with given moments of its draws."""
    standard = np.random.default_rng(1).standard_normal((4, draws, len(names)))
    standard = (standard - standard.mean(axis=(0, 1))) / standard.std(axis=(0, 1))
    posterior = xr.Dataset(
        {"coefficients": (("chain", "draw", "coefficient"), mean + sd * standard)}, {"coefficient": names}
    )
    return xr.DataTree.from_dict({"posterior": posterior, "observed_data": xr.Dataset()})


def test_names_and_dofs_are_in_the_vessels_order(container):
    names, dofs = coefficient_names(container), coefficient_dofs(container)
    assert len(names) == len(dofs) == reference_coefficients(container).size
    letters = {"surge": "X", "sway": "Y", "yaw": "N", "roll": "K"}
    assert [name[0] for name in names] == [letters[container.dofs[g]] for g in dofs]


class TestKinds:
    def test_the_default_one_is_of_the_particulars_with_factors_by_kind_of_term(self, container, trial):
        prior, known = ps.coefficient_prior([trial], container), particulars_prior(container)
        np.testing.assert_array_equal(prior.mean, known.mean)
        np.testing.assert_array_equal(prior.scale, known.scale)
        names, factors = coefficient_names(container), prior.law.names
        row = {name: dict(zip(factors, prior.law.exponents[k], strict=True)) for k, name in enumerate(names)}

        def used(name):
            return {factor: power for factor, power in row[name].items() if power}

        assert used("Yv|v|") == {"tau sway hull": 1.0}
        assert used("Ydeltadelta") == {"tau sway asymmetric": 1.0, "damping sway": 1.0}
        assert used("Ydelta") == {"tau sway": 1.0}
        assert used("Ydeltadeltadelta") == {"tau sway": 1.0, "damping sway": 2.0}
        assert used("Xv") == {"tau surge asymmetric": 1.0}
        center = dict(zip(factors, prior.law.center, strict=True))
        assert center["tau sway asymmetric"] == pytest.approx(np.log(0.1))
        assert center["tau sway"] == center["damping yaw"] == 0.0
        assert prior.law.is_scaled.all()

    def test_draws_have_its_mean_and_the_quartiles_of_a_mixture_of_students_t(self, container):
        prior, rng = ps.coefficient_prior([], container), np.random.default_rng(1)
        draws = prior.draw(4000, rng)
        z = (draws - prior.mean) / prior.fixed.scale
        size = np.exp(FACTOR_SD * rng.standard_normal((50_000, prior.law.center.size)) @ prior.law.exponents.T)
        expected = np.quantile(np.abs(stats.t.rvs(FREEDOM, size=size.shape, random_state=rng)) * size, 0.5, axis=0)
        fraction = np.mean(np.abs(z) < expected, axis=0)
        assert np.max(np.abs(fraction - 0.5)) < 4.5 * 0.5 / np.sqrt(4000)

    def test_a_sister_ship_has_an_sd_relative_to_each_value_and_of_the_typical_size(self, container, trial, typical):
        prior, reference = ps.coefficient_prior([trial], container, "sister_ship"), reference_coefficients(container)
        np.testing.assert_array_equal(prior.mean, reference)
        np.testing.assert_allclose(prior.scale**2, 0.09 * (reference**2 + 0.0025 * typical**2), rtol=1e-12)
        assert (reference == 0.0).any()
        assert (prior.scale > 0.0).all()
        closer = ps.coefficient_prior([trial], container, "sister_ship", relative_sd=0.1)
        np.testing.assert_allclose(closer.scale, prior.scale / 3.0, rtol=1e-12)

    def test_a_flat_one_has_typical_sizes_as_units_and_no_factors(self, container, trial, typical):
        prior = ps.coefficient_prior([trial], container, "flat")
        assert np.isinf(prior.scale).all()
        assert prior.law is None
        np.testing.assert_array_equal(prior.unit, typical)

    @pytest.mark.parametrize("kind", ["flat", "order_damped", "sister_ship"])
    def test_entries_of_a_table_replace_the_prior(self, container, trial, kind):
        names = coefficient_names(container)
        at, others = names.index("Nr"), np.arange(len(names)) != names.index("Nr")
        plain = ps.coefficient_prior([trial], container, kind)
        prior = ps.coefficient_prior([trial], container, kind, table={"Nr": (-0.002, 1e-4)})
        assert (prior.mean[at], prior.scale[at], prior.unit[at]) == (-0.002, 1e-4, 1e-4)
        assert prior.law is None or not prior.law.is_scaled[at]
        for name in ("mean", "scale", "unit"):
            np.testing.assert_array_equal(getattr(prior, name)[others], getattr(plain, name)[others])

    def test_a_table_does_not_change_the_vessel(self, container, trial):
        before = reference_coefficients(container)
        ps.coefficient_prior([trial], container, "sister_ship", table={"Nr": (7.0, 1.0)})
        np.testing.assert_array_equal(reference_coefficients(container), before)


class TestNormalForStudent:
    @staticmethod
    def settled(measured, sd):
        """Posterior mean and sd of a coefficient with Student's t about 0, scale 1, that was measured, by turns."""
        student_t = CoefficientPrior(np.zeros(1), np.ones(1), np.ones(1), "stated")
        normal = student_t
        for _ in range(60):
            precision = sd**-2.0 + normal.scale**-2.0
            mean, spread = measured / sd**2 / precision, precision**-0.5
            normal = student_t.as_normal_at(mean, spread)
        return float(mean[0]), float(spread[0])

    @staticmethod
    def exact(measured, sd):
        """The same by the trapezium rule."""
        at = np.linspace(measured - 40.0 * sd, measured + 40.0 * sd, 80_001)
        weight = stats.t.pdf(at, FREEDOM) * stats.norm.pdf(at, measured, sd)
        mean = np.sum(weight * at) / weight.sum()
        return mean, np.sqrt(np.sum(weight * (at - mean) ** 2) / weight.sum())

    @pytest.mark.parametrize("measured", [0.0, 1.0, 2.0, 5.0, 20.0])
    def test_a_posterior_is_that_of_students_t_with_as_much_data(self, measured):
        for sd, off, tolerance in ((0.1, 0.001, 0.005), (0.3, 0.01, 0.03), (1.0, 0.1, 0.16)):
            (mean, spread), (true_mean, true_spread) = self.settled(measured, sd), self.exact(measured, sd)
            assert abs(mean - true_mean) < off * true_spread
            assert abs(spread / true_spread - 1.0) < tolerance

    def test_the_normal_prior_dominates_where_students_t_does_not(self):
        mean, spread = self.exact(20.0, 1.0)
        assert abs(20.0 / 2.0 - mean) > 9.0 * spread
        assert abs(self.settled(20.0, 1.0)[0] - mean) < 0.01 * spread

    def test_a_coefficient_without_data_keeps_its_scale(self):
        mean, scale = np.array([0.1, -3.0]), np.array([0.02, 7.0])
        student_t = CoefficientPrior(mean, scale, scale, "stated")
        np.testing.assert_allclose(student_t.as_normal_at(mean, scale).scale, scale, rtol=1e-15)
