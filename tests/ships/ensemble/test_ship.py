"""A ship from a posterior, a vessel file and runs; one forecast function serves all three."""

from __future__ import annotations

import numpy as np
import pytest

import pymc_ship as ps
from pymc_ship.physics.vessel.vessel import coefficient_names, reference_coefficients
from pymc_ship.ships.ensemble.index_table import index_table
from tests.sentences import refused
from tests.ships.ensemble.cases import motion_of, ship_of
from tests.ships.forecasting.cases import scattered as draws_of
from tests.ships.forecasting.posteriors import joint, posterior, scattered
from tests.ships.identification.cases import tanker, trial
from tests.ships.identification.three_zigzags import model

ZIGZAG = ps.zigzag(20, 20)


@pytest.fixture(scope="module")
def tree():
    """Joint posterior of the tanker, with the motion of a zigzag and the noise of two sensors."""
    return joint(tanker(), 60, np.random.default_rng(1), trial=trial(ZIGZAG), noise_sd={"u": 0.1, "r": 1e-4})


class TestOfAPosterior:
    def test_it_has_the_draws_the_motion_and_the_noise(self, tree):
        ship = ps.Ship.from_posterior(tanker(), tree, draws=60, rng=1)
        ((vessel, rows),) = ship.models
        assert vessel is ship.vessel is tanker()
        all_rows = tree["posterior"]["coefficients"].stack(sample=("chain", "draw")).transpose("sample", "coefficient")
        np.testing.assert_array_equal(np.sort(rows, axis=0), np.sort(all_rows.values, axis=0))
        np.testing.assert_array_equal(ship.members[0].estimate, rows.mean(axis=0))
        np.testing.assert_allclose(ship.motion.values, motion_of(tanker(), [trial(ZIGZAG)]).values)
        assert ship.noise_sd == {"u": 0.1, "r": 1e-4}

    def test_errors_beyond_the_draws_are_unknown(self, tree):
        ship = ps.Ship.from_posterior(tanker(), tree, rng=1)
        assert ship.index_error is None
        assert ship.motion_error == {}
        assert ship.likelihoods == {}
        assert ship.held_out_indices.sizes["run"] == 0
        assert ship.draws == 300

    def test_posteriors_of_some_degrees_of_freedom_leave_the_others_as_the_vessel_has_them(self):
        yaw = scattered(tanker(), "yaw", 30, np.random.default_rng(2))
        ship = ps.Ship.from_posterior("kvlcc2", {"yaw": yaw}, draws=30, rng=1)
        spread = dict(zip(coefficient_names(ship.vessel), np.ptp(ship.models[0][1], axis=0), strict=True))
        assert {name[0] for name, width in spread.items() if width > 0.0} == {"N"}
        assert ship.motion is None
        assert ship.noise_sd == {}

    def test_the_seed_chooses_the_draws(self, tree):
        one, same, other = (
            ps.Ship.from_posterior(tanker(), tree, draws=20, rng=seed).models[0][1] for seed in (3, 3, 4)
        )
        np.testing.assert_array_equal(one, same)
        assert (one != other).any()

    def test_a_noise_that_is_given_counts_in_place_of_that_of_the_posterior(self, tree):
        assert ps.Ship.from_posterior(tanker(), tree, rng=1, noise_sd={"v": 0.2}).noise_sd == {"v": 0.2}


class TestOfAVessel:
    def test_it_is_one_draw_the_coefficients_of_the_file(self):
        ship = ps.Ship.from_vessel("kvlcc2")
        ((vessel, rows),) = ship.models
        np.testing.assert_array_equal(rows, reference_coefficients(vessel)[None])
        assert (ship.draws, ship.motion, ship.index_error) == (1, None, None)


class TestOneForecastForAll:
    """The same draws of a vessel file, an identification without error and a posterior give the same forecast."""

    @pytest.fixture(scope="class")
    @classmethod
    def forecasts(cls):
        values = reference_coefficients(tanker())
        certain = posterior(coefficient_names(tanker()), np.tile(values, (20, 1)))
        ships = {
            "vessel": "kvlcc2",
            "posterior": ps.Ship.from_posterior(tanker(), certain, draws=20, rng=1),
            "runs": ship_of((tanker(), np.tile(values, (20, 1))), index_error={}),
        }
        return {name: ps.forecast(ship, ZIGZAG, rng=1) for name, ship in ships.items()}

    def test_the_indices_are_those_of_the_simulated_ship(self, forecasts):
        settings = {"step": 0.01 * tanker().particulars.ship_time, "method": "rk4"}
        exact = ps.indices(ps.simulate(tanker(), ZIGZAG, duration=1600, **settings))
        for name, tree in forecasts.items():
            for index in ("first_overshoot_angle", "initial_turning_time"):
                median = float(tree["index_bands"][index].sel(band="median"))
                assert median == pytest.approx(float(exact[index]), rel=2e-3), (name, index)

    def test_the_three_kinds_agree_and_their_trees_are_alike(self, forecasts):
        vessel, *others = forecasts.values()
        assert vessel.attrs["draws"] == 1
        for tree in others:
            assert tree.attrs["draws"] == 20
            assert set(tree.children) == set(vessel.children) == {"trajectories", "bands", "indices", "index_bands"}
            assert set(tree.attrs) == set(vessel.attrs)
            np.testing.assert_allclose(tree["bands"]["psi"], vessel["bands"]["psi"], rtol=1e-9, atol=1e-12)

    def test_one_draw_has_bands_without_width(self, forecasts):
        bands = forecasts["vessel"]["bands"]["u"]
        np.testing.assert_array_equal(bands.sel(band="lower"), bands.sel(band="upper"))

    def test_a_draw_that_runs_away_is_left_out_of_runs_and_counted_of_a_posterior(self):
        """Infeasible draws are left out for an identification only."""
        rows = np.tile(reference_coefficients(tanker()), (10, 1))
        rows[3, coefficient_names(tanker()).index("Ngsincos")] *= 30.0
        known, unknown = (ps.forecast(ship_of((tanker(), rows), index_error=law), ZIGZAG, rng=1) for law in ({}, None))
        assert (known.attrs["draws"], known.attrs["infeasible_fraction"]) == (9, pytest.approx(0.1))
        assert (unknown.attrs["draws"], unknown.attrs["infeasible_fraction"]) == (10, 0.0)


class TestRepr:
    """The repr is one line without arrays."""

    def test_it_names_the_ship_its_models_and_what_is_known_of_its_errors(self, tree):
        assert repr(ps.Ship.from_vessel("kvlcc2")) == "Ship(kvlcc2: 1 model, 1 draws, model error unknown)"
        ship = ps.Ship.from_posterior(tanker(), tree, rng=1)
        assert repr(ship) == "Ship(kvlcc2: 1 model, 300 draws, model error unknown)"

    @pytest.mark.slow
    def test_an_identification_and_its_ship_are_short(self):
        result = model()
        assert repr(result.ship) == "Ship(kvlcc2: 1 model, 40 draws, model error from 3 held-out runs)"
        assert repr(result) == f"ShipIdentification(3 runs, 2 term sets, {result.ship!r})"
        likelihoods = result.ship.likelihoods.values()
        for one in (result, result.ship, *result.ship.members, *result.candidates, *likelihoods):
            assert len(repr(one)) < 400, type(one)


@pytest.mark.slow
def test_an_identification_in_place_of_its_ship_is_refused():
    with refused(ps.VesselError, "identification", "ship"):
        ps.forecast(model(), ps.turning_circle(35.0), rng=1)


def test_members_keep_their_weights_and_the_vessel_is_that_with_most_dofs():
    rolling = ps.load_vessel("container")
    ship = ship_of((tanker(), np.zeros((3, 29))), (rolling, np.zeros((1, len(coefficient_names(rolling))))))
    assert [one.weight for one in ship.members] == [0.75, 0.25]
    assert ship.draws == 4
    assert ship.vessel is rolling
    assert [vessel for vessel, _ in ship.models] == [tanker(), rolling]


ROW = {
    **{"run": "1", "manoeuvre": "zigzag 20/20 port", "index": "first_overshoot_angle", "kind": "angle"},
    **{"measured": 10.0, "forecast": 11.0, "parameter_sd": 0.9, "model_sd": 0.0, "measured_sd": 0.1, "scale": 30.0},
}


class TestGrowthBeyondTheRuns:
    GROWTH = np.full(200, 0.5)

    def ship(self, *distances, **known):
        rows = [ROW | {"run": str(k), "beyond": beyond} for k, beyond in enumerate(distances)]
        known |= {"harder_indices": index_table(rows), "extrapolation_growth": self.GROWTH}
        return ship_of((tanker(), draws_of(tanker(), 40)), **known)

    def test_it_is_measured_as_far_as_the_hardest_run_went(self):
        ship = self.ship(0.5, 1.5)
        np.testing.assert_array_equal(ship.growth_at(1.5), self.GROWTH)
        assert np.median(ship.growth_at(3.0)) > 0.6

    def test_without_harder_runs_it_is_one_law_at_all_distances(self):
        np.testing.assert_array_equal(self.ship().growth_at(9.0), self.GROWTH)

    def test_a_forecast_has_it(self):
        """A turn far beyond a gentle zigzag: harder runs that went as far, or hardly beyond it."""
        known = {"motion": motion_of(tanker(), [trial(ps.zigzag(5, 5))]), "index_error": {}}
        widths = []
        for distances in ((2.0, 100.0), (0.02,)):
            turn = ps.forecast(self.ship(*distances, **known), ps.turning_circle(35), draws=40, rng=1)
            lower, _, upper = turn["index_bands"]["advance"].values
            widths.append(float(upper - lower))
        assert widths[1] > 1.3 * widths[0]


def test_a_ship_without_a_posterior_or_with_that_of_another_vessel_is_refused(container):
    with refused(ps.VesselError, "from_vessel"):
        ps.Ship.from_posterior(container, {}, rng=1)
    tree = scattered(container, "sway", 4, np.random.default_rng(1))
    tree.attrs["vessel"] = "kvlcc2"
    with refused(ps.VesselError, "container", "kvlcc2"):
        ps.Ship.from_posterior(container, {"sway": tree}, rng=1)
