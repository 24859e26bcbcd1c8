from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pytest

import pymc_ship as ps
from pymc_ship.inference.regression.families import FAMILIES
from pymc_ship.inference.regression.prior_table import hold_fixed, informed_prior, restore_fixed, sister_ship_table
from pymc_ship.inference.regression.semiconjugate import SemiConjugatePrior
from pymc_ship.inference.regression.tree import exact_posterior, read_posterior, write_posterior
from pymc_ship.inference.rows.data import RegressionData
from pymc_ship.inference.rows.from_trials import regression_data
from pymc_ship.inference.sampling.gibbs import gibbs_posterior
from pymc_ship.ships.ensemble.draws import coefficient_draws
from tests.inference.regression.plain_algebra import HELD, NAMES, agree, base, plain, ship
from tests.ships.ensemble.cases import posterior_forecast


class TestFixed:
    @pytest.mark.parametrize("family", FAMILIES)
    def test_it_is_the_regression_with_the_known_part_removed(self, family):
        data = ship("none")
        X, y = data.design_matrix, data.response
        known = RegressionData.from_arrays(
            X[:, [0, 1, 2, 4]], y - 0.7 * X[:, 3], ["Y0", "Yv", "Yr", "Ydelta"], scaling="none"
        )
        held, prior = hold_fixed(data, HELD), base(family, 4)
        assert held.coefficients == known.coefficients
        assert held.constant == known.constant
        agree(prior.exact(held), prior.exact(known), rtol=1e-12)

    @pytest.mark.parametrize("scaling", ["none", "zscore"])
    @pytest.mark.parametrize("constant", [True, False])
    @pytest.mark.parametrize("names", [("Yv|v|",), ("Yv", "Ydelta")])
    def test_scaled_rows_lose_the_scaled_part_and_least_squares_stay(self, scaling, constant, names):
        data = ship(scaling, constant)
        values = {name: 0.7 - k for k, name in enumerate(names)}
        held = hold_fixed(data, values)
        free = [name not in values for name in data.coefficients]
        X = data.design_matrix
        fixed = X[:, np.logical_not(free)] @ list(values.values())
        np.testing.assert_allclose(held.scaled_design_matrix, data.scaled_design_matrix[:, free], rtol=1e-15)
        known = np.linalg.lstsq(X[:, free], data.response - fixed, rcond=None)[0]
        np.testing.assert_allclose(held.least_squares, known, rtol=1e-9)
        np.testing.assert_allclose(held.to_original(held.to_scaled(known)), known, rtol=1e-12)

    @pytest.mark.parametrize("family", FAMILIES)
    @pytest.mark.parametrize("scaling", ["none", "zscore"])
    def test_it_is_the_limit_of_a_prior_ever_narrower(self, family, scaling):
        data, free = ship(scaling), [0, 1, 2, 4]
        prior = base(family)
        rest = replace(prior, mean=prior.mean[free], kappa=prior.kappa[free])
        limit = rest.exact(hold_fixed(data, HELD))
        distance = []
        for sd in (1e-3, 1e-4, 1e-7):
            narrow = informed_prior(data, prior, {"Yv|v|": (0.7, sd)}).exact(data)
            distance.append(np.abs((narrow.mean[free] - limit.mean) / limit.sd).max())
        assert distance[0] / distance[1] == pytest.approx(100.0, rel=0.2), "the distance falls with the variance"
        np.testing.assert_allclose(narrow.mean[free], limit.mean, rtol=1e-6)
        np.testing.assert_allclose(narrow.sd[free], limit.sd, rtol=1e-6)
        assert narrow.log_evidence == pytest.approx(limit.log_evidence, abs=1e-6)

    @pytest.mark.parametrize("family", FAMILIES)
    def test_a_fixed_constant_of_centred_columns_keeps_the_prior_of_the_others(self, family):
        whole, prior = ship(), base(family, 4)
        data = hold_fixed(whole, {"Y0": 4.0})
        slope = whole.response.std() / whole.design_matrix[:, 1:].std(axis=0)
        at_mean = prior.scale / (prior.shape - 1.0) if family == "conjugate" else 1.0
        noise = (prior.shape, prior.scale * np.var(whole.response))
        variance = slope**2 * prior.kappa * at_mean
        X = whole.design_matrix[:, 1:]
        known = plain(X, whole.response - 4.0, slope * prior.mean, variance, noise, family)
        assert data.constant == -1
        agree(prior.exact(data), known, rtol=1e-7)

    def test_the_constant_is_found_wherever_it_stands(self):
        turned, names = [1, 2, 0, 3, 4], [NAMES[j] for j in (1, 2, 0, 3, 4)]
        data = RegressionData.from_arrays(ship().design_matrix[:, turned], ship().response, names, scaling="zscore")
        held, known = hold_fixed(data, {"Yr": 2.0}), hold_fixed(ship(), {"Yr": 2.0})
        assert held.coefficients[held.constant] == "Y0"
        np.testing.assert_allclose(held.least_squares[[1, 0, 2, 3]], known.least_squares, rtol=1e-9)

    def test_holding_in_two_steps_is_holding_at_once(self):
        one, two = hold_fixed(ship(), HELD | {"Y0": 1.0}), hold_fixed(hold_fixed(ship(), HELD), {"Y0": 1.0})
        np.testing.assert_allclose(one.scaled_response, two.scaled_response, rtol=1e-12)
        assert one.coefficients == two.coefficients

    def test_nothing_fixed_is_the_same_regression(self):
        held = hold_fixed(ship(), {})
        np.testing.assert_array_equal(held.scaled_design_matrix, ship().scaled_design_matrix)
        np.testing.assert_array_equal(held.scaled_response, ship().scaled_response)


class TestRestored:
    def held_tree(self):
        data = hold_fixed(ship(), HELD)
        return gibbs_posterior(data, base("semiconjugate", 4), draws=5, chains=2, rng=np.random.default_rng(1))

    def test_the_constant_takes_its_place_and_the_draws_stay(self, tmp_path):
        tree = self.held_tree()
        restored = restore_fixed(tree, HELD, NAMES)
        draws = restored["posterior"]["coefficients"]
        assert draws.dims == ("chain", "draw", "coefficient")
        assert tuple(draws["coefficient"].values) == NAMES
        assert (draws.sel(coefficient="Yv|v|") == 0.7).all()
        free = tree["posterior"]["coefficients"]
        assert draws.sel(coefficient=free["coefficient"]).identical(free)
        assert restored["posterior"]["noise_variance"].identical(tree["posterior"]["noise_variance"])
        assert json.loads(restored.attrs["fixed"]) == HELD
        assert "fixed" not in tree.attrs
        assert tree["posterior"].sizes["coefficient"] == 4
        assert set(restored.children) == set(tree.children)
        stored = read_posterior(write_posterior(restored, tmp_path / "restored.nc"))
        np.testing.assert_array_equal(stored["posterior"]["coefficients"], draws)

    def test_by_default_the_fixed_ones_come_last(self):
        restored = restore_fixed(self.held_tree(), HELD)
        assert [*restored["posterior"]["coefficient"].values] == ["Y0", "Yv", "Yr", "Ydelta", "Yv|v|"]

    def test_nothing_fixed_is_the_same_posterior(self):
        tree = self.held_tree()
        assert restore_fixed(tree, {})["posterior"].to_dataset().identical(tree["posterior"].to_dataset())

    def test_a_forecast_takes_fixed_informed_and_free_coefficients(self, container, zigzag_trial):
        whole = regression_data(zigzag_trial, container, "yaw", interval=0.5)
        values = {"Nr": -0.0028, "N0": 0.0, "Nppp": 0.0}
        data = hold_fixed(whole, values)
        names = set(data.coefficients)
        prior = informed_prior(data, SemiConjugatePrior(), sister_ship_table(container, "yaw", names=names))
        drawn = exact_posterior(data, prior, draws=40, rng=np.random.default_rng(1))
        yaw = restore_fixed(drawn, values, whole.coefficients)
        rows = coefficient_draws(container, {"yaw": yaw}, 20, np.random.default_rng(2))
        before = sum(len(container.terms(dof)) for dof in ("surge", "sway"))
        for name, value in values.items():
            assert (rows[:, before + whole.coefficients.index(name)] == value).all()
        turn = ps.turning_circle(20.0)
        tree = posterior_forecast(container, {"yaw": yaw}, turn, draws=20, rng=2, duration=60.0)
        assert tree.attrs["diverged_fraction"] == 0.0
        known = ps.simulate(container, turn, duration=60.0, step=0.02, record_interval=0.5)
        distance = np.abs(tree["bands"]["psi"].sel(band="median") - known["psi"]).max()
        assert distance < 0.05 * np.abs(known["psi"]).max()
