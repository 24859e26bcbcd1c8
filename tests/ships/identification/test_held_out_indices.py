"""Indices of runs held out: those of the model itself, weighed over models, and left out where not reached."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import pymc_ship as ps
from pymc_ship.physics.forces.surroundings import CURRENT_COMPONENTS
from pymc_ship.physics.manoeuvre.steering_record import approach_speed
from pymc_ship.physics.vessel.vessel import coefficient_names, reference_coefficients
from pymc_ship.ships.identification.held_out import (
    forecast_rows,
    index_noise_sd,
    recorded_indices,
    unscored_run_remarks,
)
from pymc_ship.trial.record import OVER_GROUND
from tests.physics.forces.test_parts import AHEAD
from tests.physics.forces.test_parts import tanker as parts
from tests.physics.manoeuvre.cases import steered_by_hand
from tests.ships.identification.cases import ROLL, RUNS, scored_upright, tanker, trial, with_delay
from tests.ships.identification.test_roll import tender

UNIT = {"time": 320.0 / 7.974, "distance": 320.0}
RNG = np.random.default_rng


def over_ground(run, current, course):
    """Record in other axes, which begins on a course [rad], of a ship that drifts with a current [m/s]."""
    heading = np.exp(1j * run["psi"].values)
    speed = run["u"].values + 1j * run["v"].values + current / heading
    track = (run["x"].values + 1j * run["y"].values) * np.exp(1j * course)
    turned = {"u": speed.real, "v": speed.imag, "psi": run["psi"].values + course, "x": track.real, "y": track.imag}
    return run.assign({name: ("time", values) for name, values in turned.items()}).assign_attrs(speeds=OVER_GROUND)


class TestForecastRows:
    @staticmethod
    def model(factor=1.0, spread=0.002):
        """Estimate and draws about it, the yaw moment of the rudder being a multiple of the true one."""
        row = reference_coefficients(tanker())
        row[coefficient_names(tanker()).index("Ngsincos")] *= factor
        rng = RNG(4)
        return tanker(), np.vstack([row, row * (1.0 + spread * rng.standard_normal((30, row.size)))])

    @pytest.mark.parametrize("manoeuvre", [RUNS[0], ps.turning_circle(35.0)])
    def test_a_run_of_the_model_itself_is_forecast_without_error(self, manoeuvre):
        rows = forecast_rows("own", trial(manoeuvre), manoeuvre, [self.model()], np.ones(1))
        assert [entry["index"] for entry in rows] == scored_upright(manoeuvre)
        for entry in rows:
            assert (entry["run"], entry["manoeuvre"]) == ("own", manoeuvre.label)
            assert abs(entry["measured"] - entry["forecast"]) < 0.025 * entry["scale"], entry["index"]
            assert 0.0 < entry["parameter_sd"] < 0.2 * entry["scale"]
            assert entry["model_sd"] == 0.0
            swing = manoeuvre.heading_deg + entry["measured"]
            assert entry["scale"] == pytest.approx(UNIT.get(entry["kind"], swing), rel=1e-12)
        weaker = forecast_rows("own", trial(manoeuvre), manoeuvre, [self.model(0.9)], np.ones(1))
        assert max(abs(entry["measured"] - entry["forecast"]) / entry["scale"] for entry in weaker) > 0.1

    def test_models_are_weighed(self):
        weight, models = np.array([0.8, 0.2]), [self.model(), self.model(0.9)]
        first, second, both = (
            forecast_rows("1", trial(RUNS[0], duration=800.0), RUNS[0], which, share)
            for which, share in ((models[:1], np.ones(1)), (models[1:], np.ones(1)), (models, weight))
        )
        for a, b, c in zip(first, second, both, strict=True):
            assert c["forecast"] == pytest.approx(0.8 * a["forecast"] + 0.2 * b["forecast"], rel=1e-12)
            assert c["model_sd"] == pytest.approx(0.4 * abs(a["forecast"] - b["forecast"]), rel=1e-9)
            within = 0.8 * a["parameter_sd"] ** 2 + 0.2 * b["parameter_sd"] ** 2
            assert c["parameter_sd"] == pytest.approx(np.sqrt(within), rel=1e-12)

    @pytest.mark.parametrize(("manoeuvre", "course"), [(ps.zigzag(10, 10), 0.0), (ps.turning_circle(35), 2.0)])
    def test_a_run_over_ground_is_forecast_in_its_own_current(self, manoeuvre, course):
        """Speeds and track are over ground; the model knows the ship exactly, and the current of the run.

        Broken twin: without the current it approaches at the speed over ground.
        """
        vessel = parts((*AHEAD, "current"))
        values, places = (
            reference_coefficients(vessel),
            [coefficient_names(vessel).index(name) for name in CURRENT_COMPONENTS],
        )
        run = ps.simulate(vessel, manoeuvre, duration=700, step=0.25, method="rk4", current=(0.9, 50.0))
        record = over_ground(run, 0.9 * np.exp(1j * np.deg2rad(50.0)), course)
        approached = replace(manoeuvre, approach_speed=approach_speed(record))
        assert approached.approach_speed > 1.05 * vessel.particulars.nominal_speed
        own = np.tile(values, (4, 1))
        drift = 0.9 / vessel.particulars.nominal_speed * np.exp(1j * (np.deg2rad(50.0) + course))
        own[:, places] = drift.real, drift.imag
        known, blind = (
            forecast_rows("1", record, approached, [(vessel, rows)], np.ones(1))
            for rows in (own, np.tile(values, (4, 1)))
        )
        errors = [[abs(row["forecast"] - row["measured"]) / row["scale"] for row in rows] for rows in (known, blind)]
        assert [row["index"] for row in known] == scored_upright(manoeuvre)
        assert max(errors[0]) < 0.03
        assert max(errors[1]) > 0.1

    def test_roll_is_that_of_the_models_that_have_it(self):
        """Half the weight on a tanker without roll; the run is that of one with roll, or of one that never heels."""
        rolling = tender(0.4)
        run = ps.simulate(rolling, RUNS[0], duration=600, step=0.5, method="rk4")
        own = np.tile(reference_coefficients(rolling), (3, 1))
        models, weight = [self.model(), (rolling, own)], np.array([0.5, 0.5])
        (row,) = (entry for entry in forecast_rows("1", run, RUNS[0], models, weight) if entry["index"] == ROLL)
        (alone,) = (
            entry for entry in forecast_rows("1", run, RUNS[0], models[1:], np.ones(1)) if entry["index"] == ROLL
        )
        assert row == alone
        assert row["kind"] == "roll"
        assert row["scale"] == row["measured"] == pytest.approx(row["forecast"], rel=0.01)
        assert ROLL not in {entry["index"] for entry in forecast_rows("1", run, RUNS[0], models[:1], np.ones(1))}
        upright = run.assign(phi=0.0 * run["phi"])
        assert ROLL not in {entry["index"] for entry in forecast_rows("1", upright, RUNS[0], models, weight)}

    def test_a_few_draws_that_run_away_do_not_count(self):
        vessel, draws = self.model()
        wild = draws.copy()
        wild[5:7, coefficient_names(tanker()).index("Ngsincos")] *= 2.0
        wild[7] *= -100.0
        calm, found = (
            {
                entry["index"]: entry
                for entry in forecast_rows("1", trial(RUNS[0]), RUNS[0], [(vessel, few)], np.ones(1))
            }
            for few in (draws, wild)
        )
        assert calm.keys() == found.keys()
        assert all(found[name]["parameter_sd"] < 2.0 * calm[name]["parameter_sd"] for name in calm)

    def test_overshoots_steered_by_hand_count_from_the_orders(self):
        """Four seconds before the rudder moves, by the delay of the vessel's gear."""
        vessel, manoeuvre = with_delay(4.0), ps.zigzag(20.0, 20.0, side="starboard")
        run, _ = steered_by_hand(vessel, manoeuvre, (23.0, 16.0, 25.0, 18.0))
        (_, draws), (late, early) = self.model(), (recorded_indices(run, manoeuvre, delay) for delay in (0.0, 4.0))
        rows = {entry["index"]: entry for entry in forecast_rows("1", run, manoeuvre, [(vessel, draws)], np.ones(1))}
        name = "first_overshoot_angle"
        assert rows[name]["measured"] == early[name]
        assert early[name] > late[name] + 1.0

    def test_indices_that_were_not_reached_are_left_out(self):
        rows = forecast_rows("1", trial(RUNS[1], duration=120.0), RUNS[1], [self.model()], np.ones(1))
        assert {"initial_turning_time", "initial_turning_distance"} <= {entry["index"] for entry in rows}
        assert not {"second_overshoot_angle", "period"} & {entry["index"] for entry in rows}
        blind = forecast_rows("1", trial(RUNS[0]).drop_vars(["x", "y"]), RUNS[0], [self.model()], np.ones(1))
        assert {entry["kind"] for entry in blind} == {"angle", "time"}


class TestReadings:
    @pytest.mark.parametrize("manoeuvre", [RUNS[0], ps.turning_circle(35.0)])
    def test_the_sd_is_as_large_as_indices_of_one_run_scatter_from_noise_to_noise(self, manoeuvre):
        """Of thirty records of a run, whose sd is known to an eighth: no smaller, and up to twice as large.

        Draws of a spike and slab in single bases scatter more than the mean over bases that is the estimate.
        """
        records = [trial(manoeuvre, seed=seed, level=0.01) for seed in range(30)]
        rows = [recorded_indices(record, manoeuvre) for record in records]
        scatter = {name: np.std([row[name] for row in rows]) for name in rows[0]}
        found = index_noise_sd(records[0], manoeuvre, 0.0, RNG(1))
        for name in scored_upright(manoeuvre):
            assert 0.6 * scatter[name] < found[name] < 2.0 * scatter[name], name
        clean = index_noise_sd(trial(manoeuvre), manoeuvre, 0.0, RNG(1))
        assert all(clean[name] < 0.1 * scatter[name] for name in scored_upright(manoeuvre))

    def test_a_record_that_cannot_be_denoised_has_none(self):
        uneven = trial(RUNS[0], seed=1).isel(time=np.r_[0:300, 301:660])
        assert index_noise_sd(uneven, RUNS[0], 0.0, RNG(1)) == {}


class TestLeftOut:
    def test_a_run_that_is_no_manoeuvre_is_told_with_the_reason(self):
        stairs = trial(ps.rudder_programme([0.0, 150.0, 300.0], np.deg2rad([5.0, 10.0, 20.0])), duration=300.0)
        runs = {"own": trial(RUNS[0]), "stairs": stairs}
        (told,) = unscored_run_remarks(runs, [RUNS[0], None], tanker())
        assert told.startswith(
            "Run stairs: It is not recognised as a zigzag, a turning circle or a pull out: the rudder is "
        )

    def test_roll_that_is_measured_and_not_modelled_is_told(self):
        run = trial(RUNS[0])
        rolling = run.assign(phi=0.01 + run["phi"])
        assert unscored_run_remarks({"own": run}, [RUNS[0]], tanker()) == []
        (told,) = unscored_run_remarks({"own": rolling}, [RUNS[0]], tanker())
        assert told.startswith("The record has roll angle φ, but the vessel file has no coefficients of roll")
        assert unscored_run_remarks({"own": rolling}, [RUNS[0]], ps.load_vessel("container")) == []
