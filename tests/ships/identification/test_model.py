"""A ship identified from simulated trials: weights, draws, held-out manoeuvres, and intervals that cover the truth."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from scipy import stats

import pymc_ship as ps
from pymc_ship.inference.trajectory.windows import WindowFit
from pymc_ship.machine.errors import FitError
from pymc_ship.physics.forces.terms import SYMBOLS
from pymc_ship.physics.vessel.term_sets import OWN, TERM_SETS
from pymc_ship.physics.vessel.vessel import reference_coefficients
from pymc_ship.records.steering.recognition import Steering
from pymc_ship.ships.ensemble.feasibility import is_feasible
from pymc_ship.ships.ensemble.index_error import TYPICAL, extrapolation_growth, index_sd, model_error
from pymc_ship.ships.ensemble.index_table import index_rows
from pymc_ship.ships.forecasting.forecast import pooled_forecast
from pymc_ship.ships.identification import candidates as ship_candidates
from pymc_ship.ships.identification import model as ship_model
from pymc_ship.ships.identification.candidates import LARGEST_INFLATION, Candidate, Training
from pymc_ship.ships.identification.held_out import CrossValidation
from pymc_ship.ships.identification.model import identify_ship
from tests.sentences import refused
from tests.ships.identification.cases import RUNS, TRUE_TERMS, scored_upright, tanker, trial, trials

POORER = "loading"
CIRCLE = ps.turning_circle(35.0)
SEEDS = range(12)


def known():
    """The tanker before it is tried: its steering gear is not what the file says."""
    return replace(tanker(), particulars=replace(tanker().particulars, rudder_delay=0.0, rudder_rate_deg=5.0))


def identified(records, terms=(TRUE_TERMS,), draws=40, seed=0, **settings):
    return identify_ship(records, known(), terms=terms, draws=draws, rng=np.random.default_rng(seed), **settings)


@pytest.fixture(scope="module")
def identification():
    """Three zigzags, the true terms and poorer ones."""
    return identified(trials(0), (POORER, TRUE_TERMS), draws=75, names=("first", "second", "third"))


@pytest.fixture(scope="module")
def lone():
    """One zigzag alone."""
    return identified(trials(0)[:1])


class TestEnsemble:
    def test_the_true_terms_have_the_larger_weight(self, identification):
        assert [candidate.name for candidate in identification.candidates] == [TRUE_TERMS, POORER]
        assert identification.candidates[0].weight > 0.9
        assert sum(candidate.weight for candidate in identification.candidates) == pytest.approx(1.0, rel=1e-12)

    def test_the_draws_are_as_many_as_asked_for_dealt_by_weight(self, identification):
        counts = [len(candidate.draws) for candidate in identification.candidates]
        assert sum(counts) == 75
        for candidate, count in zip(identification.candidates, counts, strict=True):
            assert abs(count - 75 * candidate.weight) < 1.0
        assert [vessel.terms("sway") for vessel, _ in identification.ship.models] == [
            TERM_SETS[candidate.name].lateral for candidate in identification.candidates if len(candidate.draws)
        ]

    def test_they_do_not_run_away(self, identification):
        for vessel, draws in identification.ship.models:
            assert is_feasible(vessel, draws).all()
            assert len(np.unique(draws[:, 0])) == len(draws)

    def test_each_set_was_fitted_to_all_runs_and_to_all_but_one(self, identification):
        for candidate in identification.candidates:
            assert candidate.fit.n_windows == 9
            assert [fit.n_windows for fit in candidate.held_out.fits] == [6, 6, 6]
            assert 1.0 <= candidate.inflation <= LARGEST_INFLATION
            assert 0.0 <= candidate.infeasible_fraction < 0.5

    def test_runs_manoeuvres_and_gear_are_those_of_the_trials(self, identification):
        assert identification.names == ("first", "second", "third")
        assert [manoeuvre.label for manoeuvre in identification.manoeuvres] == [manoeuvre.label for manoeuvre in RUNS]
        assert identification.vessel.particulars.rudder_rate_deg == pytest.approx(2.35, rel=1e-6)
        assert identification.vessel.particulars.rudder_delay == pytest.approx(2.5, abs=0.5)
        assert identification.ship.motion.dims == ("row", "symbol")
        assert identification.ship.motion["symbol"].values.tolist() == list(SYMBOLS)
        assert identification.ship.motion.sizes["row"] == 3 * 132
        assert not identification.ship.remarks


class TestHeldOut:
    BOUND = (("angle", 0.03), ("time", 0.15), ("distance", 0.06))

    def test_every_index_of_every_run_is_forecast_closely(self, identification):
        expected = {(name, index) for name in identification.names for index in scored_upright(RUNS[0])}
        assert {(row["run"], row["index"]) for row in index_rows(identification.held_out_indices)} == expected
        for row in index_rows(identification.held_out_indices):
            assert abs(row["measured"] - row["forecast"]) < dict(self.BOUND)[row["kind"]] * row["scale"], row

    @pytest.mark.parametrize("kind", ["angle", "time", "distance"])
    def test_errors_of_a_kind_are_as_large_as_stated(self, identification, kind):
        """In the mean square, as far as the few errors of a kind tell."""
        rows = [row for row in index_rows(identification.held_out_indices) if row["kind"] == kind]
        found = np.mean([((row["measured"] - row["forecast"]) / row["sd"]) ** 2 for row in rows])
        assert found < 2.0
        assert 0.0 < np.median(identification.ship.index_error[kind]) < 0.1

    def test_the_sd_holds_all_its_parts(self, identification):
        for row in index_rows(identification.held_out_indices):
            assert row["sd"] == pytest.approx(index_sd(row, identification.ship.index_error), rel=1e-12)
            assert row["sd"] > np.hypot(row["parameter_sd"], row["model_sd"])
            assert 0.0 < row["measured_sd"] < row["scale"]


class TestHarderRuns:
    def test_runs_above_the_largest_gap_of_the_yaw_rate_are_harder(self):
        mild, hard = trial(ps.zigzag(10, 10)), trial(ps.zigzag(30, 20))
        assert ship_model._harder_runs([hard, mild, mild], tanker()) == (0,)
        assert ship_model._harder_runs([mild, hard, mild, hard], tanker()) == (1, 3)
        assert ship_model._harder_runs([mild, trial(ps.zigzag(10, 10, side="starboard"))], tanker()) == ()
        assert ship_model._harder_runs([mild], tanker()) == ()

    def test_the_milder_runs_forecast_them(self, identification):
        """The 20/20 lies beyond the 10/10 and the 15/5, and its forecast errs by what the draws explain."""
        rows = list(index_rows(identification.ship.harder_indices))
        assert {row["run"] for row in rows} == {"second"}
        assert {row["index"] for row in rows} == set(scored_upright(RUNS[1]))
        assert all(0.1 < row["beyond"] < 3.0 for row in rows)
        held_out = [row for row in index_rows(identification.held_out_indices) if row["run"] == "second"]
        for one, other in zip(rows, held_out, strict=True):  # the same fit, that without the only harder run
            assert one["forecast"] == pytest.approx(other["forecast"], rel=1e-9)

    def test_their_errors_decide_how_fast_the_error_grows(self, identification):
        """Draws explain the errors of the right terms; forecasts wrong by a quarter are of a fast growth."""
        ship = identification.ship
        rows = list(index_rows(ship.harder_indices))
        wrong = [row | {"forecast": row["forecast"] + 0.25 * row["scale"]} for row in rows]
        np.testing.assert_allclose(ship.extrapolation_growth, extrapolation_growth(rows, ship.index_error), rtol=1e-12)
        assert np.median(ship.extrapolation_growth) < 3.0
        assert np.median(extrapolation_growth(wrong, ship.index_error)) > 10.0

    def test_several_harder_runs_are_left_out_together(self):
        """Two 20/20 zigzags by the fit to the two 10/10 zigzags alone."""
        manoeuvres = [ps.zigzag(angle, angle, side=side) for angle in (10, 20) for side in ("port", "starboard")]
        records = trials(3, manoeuvres)
        both, mild = identified(records), identified(records[:2])
        (candidate,), (alone,) = both.candidates, mild.candidates
        first, second = candidate.milder.fits
        np.testing.assert_array_equal(first.coefficients, second.coefficients)
        spread = np.sqrt(np.diag(alone.fit.covariance)) / alone.inflation
        assert np.abs((first.coefficients - alone.fit.coefficients) / spread).max() < 1.0
        assert both.ship.harder_indices["run"].values.tolist() == ["3", "4"]
        assert mild.ship.harder_indices.sizes["run"] == 0


class TestHeldOutWeights:
    def test_only_sets_that_count_have_a_say_and_their_shares_add_up_to_one(self):
        """Of three sets two are the same, and the third, of no weight to speak of, runs away in every run."""
        true = reference_coefficients(tanker())
        law = 1e-6 * np.diag(true**2), np.zeros((true.size, true.size)), np.diag(1e6 / true**2)
        good, wild = (WindowFit(tanker(), row, *law, {}, 1.0, 1) for row in (true, -100.0 * true))
        gear = {"": Steering(np.nan, np.nan, 0)}
        training = Training([trial(RUNS[0])], [RUNS[0]], gear, tanker(), "order_damped")

        def rows(*sets):
            known = (np.zeros(1), {})
            held = [CrossValidation((fit,), (fit.coefficients,), *known) for _, fit in sets]
            found = [
                replace(TestWeights.candidate([0.0]), weight=weight, fit=fit, held_out=out)
                for (weight, fit), out in zip(sets, held, strict=True)
            ]
            folds = [(one, one.held_out, 0) for one in found]
            return ship_model._forecast_of_run(0, "1", training, folds, {}, np.random.default_rng(2))

        alone, together = rows((1.0, good)), rows((0.5, good), (0.495, good), (0.005, wild))
        assert [row["index"] for row in together] == [row["index"] for row in alone] == scored_upright(RUNS[0])
        for one, other in zip(alone, together, strict=True):
            assert other["forecast"] == pytest.approx(one["forecast"], rel=1e-12)
            assert other["model_sd"] == pytest.approx(0.0, abs=1e-12 * abs(one["forecast"]))


class TestWeights:
    @staticmethod
    def candidate(density):
        held = CrossValidation((), (), np.asarray(density, dtype=float), {})
        return Candidate("", None, None, held, 1.0, np.empty((0, 1)))

    def weights(self, *densities):
        found = ship_model._with_weights([self.candidate(row) for row in densities], {}, np.random.default_rng(5))
        return [candidate.weight for candidate in found]

    def test_equal_densities_weigh_alike(self):
        assert self.weights([1.0, 2.0, 3.0], [1.0, 2.0, 3.0]) == pytest.approx([0.5, 0.5], rel=1e-12)

    def test_a_set_that_ran_away_has_none(self):
        assert self.weights([1.0, 2.0], [1.0, -np.inf]) == pytest.approx([1.0, 0.0], abs=1e-3)

    def test_a_lead_in_every_run_counts_as_often_as_there_are_runs(self):
        """All bootstraps agree: weights are those of the summed densities."""
        first = 1.0 / (1.0 + np.exp(-4 * 0.5))
        assert self.weights([0.5] * 4, [0.0] * 4) == pytest.approx([first, 1.0 - first], rel=1e-9)

    def test_a_lead_in_one_run_alone_is_uncertain(self):
        """Broken twin: without the bootstrap its weight would be 0.98."""
        first, _ = self.weights([4.0, 0.0, 0.0, 0.0], [0.0] * 4)
        assert 0.6 < first < 0.95


class TestDraws:
    @pytest.mark.parametrize(("weights", "dealt"), [((0.66, 0.34), [1, 1]), ((0.9, 0.1), [2, 0])])
    def test_the_rest_of_the_draws_goes_to_the_largest_remainders(self, monkeypatch, weights, dealt):
        monkeypatch.setattr(ship_model, "is_feasible", lambda vessel, rows: np.ones(len(rows), dtype=bool))
        fit = WindowFit(tanker(), np.zeros(1), np.eye(1), np.eye(1), np.eye(1), {}, 1.0, 1)
        found = [replace(TestWeights.candidate([0.0]), fit=fit, weight=weight) for weight in weights]
        drawn = ship_model._draw_feasible(found, 2, np.random.default_rng(1))
        assert [len(candidate.draws) for candidate in drawn] == dealt


class TestOneRun:
    def test_it_works_and_says_what_it_lacks(self, lone):
        assert lone.held_out_indices.sizes["run"] == 0
        for kind, typical in TYPICAL.items():
            assert np.median(lone.ship.index_error[kind]) == pytest.approx(typical, rel=0.02)
        (remark,) = lone.ship.remarks
        assert remark.startswith("No run of a standard manoeuvre was held out: the intervals include the spread")
        assert remark.endswith("the typical model error of other ships instead of that of this ship.")
        assert lone.names == ("1",)
        (candidate,) = lone.candidates
        assert candidate.weight == 1.0
        assert len(candidate.held_out.fits) == candidate.fit.n_windows == 3
        assert len(candidate.draws) == 40

    def test_the_same_seed_gives_the_same_ship_and_another_does_not(self, lone):
        again, other = identified(trials(0)[:1]), identified(trials(0)[:1], seed=1)
        np.testing.assert_array_equal(again.candidates[0].draws, lone.candidates[0].draws)
        assert (other.candidates[0].draws != lone.candidates[0].draws).all()
        np.testing.assert_array_equal(other.candidates[0].fit.coefficients, lone.candidates[0].fit.coefficients)

    def test_its_own_terms_are_a_set(self, lone):
        own = identified(trials(0)[:1], (OWN,))
        np.testing.assert_allclose(own.candidates[0].draws, lone.candidates[0].draws, rtol=1e-9)

    def test_the_prior_is_that_of_the_hull_where_a_draught_is_stated(self, lone):
        """By default; its own values as a sister's keep more near the truth, and a wide prior less."""
        others = [identified(trials(0)[:1], prior=prior) for prior in ("sister_ship", "order_damped")]
        assert [one.ship.prior for one in (*others, lone)] == ["sister_ship", "order_damped", "hull_database"]
        true = reference_coefficients(tanker())
        sister, wide, hull = (
            np.median(np.abs(ship.candidates[0].fit.coefficients / true - 1.0)) for ship in (*others, lone)
        )
        assert sister < 0.1 < hull < 0.25 < wide

    def test_without_a_draught_it_is_wide(self, lone):
        ship = replace(known(), particulars=replace(known().particulars, d=0.0))
        found = identify_ship(trials(0)[:1], ship, terms=(TRUE_TERMS,), draws=2, rng=np.random.default_rng(0))
        assert found.ship.prior == "order_damped"
        stated = [c.name for c in found.candidates[0].vessel.forces["yaw"] if c.sd > 0.0]
        assert stated == ["Ng|r|", "Ngsincos|delta|"]
        assert sum(c.sd > 0.0 for c in lone.candidates[0].vessel.forces["yaw"]) == 8

    def test_what_the_vessel_file_leaves_out_is_remarked(self):
        ship = replace(known(), derived={"inertia.m": "0.019 (2 volume/L^3)"})
        found = identify_ship(trials(0)[:1], ship, terms=(TRUE_TERMS,), draws=2, rng=np.random.default_rng(0))
        assert (
            found.ship.remarks[0]
            == "Estimated, because the vessel file does not state it: inertia.m = 0.019 (2 volume/L^3)."
        )

    def test_a_set_that_runs_away_is_left_out(self, monkeypatch):
        """And one that is not fitted: the wrong terms are said to run away here."""

        def judged(vessel, rows):
            return np.full(len(rows), "vvv" in vessel.terms("sway"))

        monkeypatch.setattr(ship_candidates, "is_feasible", judged)
        monkeypatch.setattr(ship_candidates, "first_failure", lambda vessel, row: "in a turn")
        found = identified(trials(0)[:1], (POORER, TRUE_TERMS))
        assert [candidate.name for candidate in found.candidates] == [TRUE_TERMS]
        assert found.ship.remarks[0] == (
            "The loading terms were left out: the simulation of the fitted ship diverges, in a turn."
        )
        with refused(FitError, "loading"):
            identified(trials(0)[:1], (POORER,))

    def test_a_failed_fit_names_the_run_that_contradicts_the_others(self, monkeypatch):
        """The rudder of the second is mirrored; every fit is said to diverge here."""
        monkeypatch.setattr(ship_candidates, "is_feasible", lambda vessel, rows: np.zeros(len(rows), dtype=bool))
        monkeypatch.setattr(ship_candidates, "first_failure", lambda vessel, row: "in a turn")
        first, second, third = trials(0)
        with refused(FitError, "second", "delta"):
            identified([first, second.assign(delta=-second["delta"]), third], names=("first", "second", "third"))

    @pytest.mark.parametrize(("share", "kept"), [(0.09, False), (0.11, True)])
    def test_a_set_is_left_out_where_fewer_than_one_draw_in_ten_is_sound(self, monkeypatch, share, kept):
        """The estimate is feasible; of the draws about it so many are, and of those of the ensemble all."""
        monkeypatch.setattr(
            ship_candidates, "is_feasible", lambda vessel, rows: np.arange(len(rows)) < share * len(rows)
        )
        monkeypatch.setattr(ship_candidates, "first_failure", lambda vessel, row: "in a turn")
        monkeypatch.setattr(ship_model, "is_feasible", lambda vessel, rows: np.ones(len(rows), dtype=bool))
        if kept:
            assert len(identified(trials(0)[:1]).candidates) == 1
        else:
            with refused(FitError, 90):
                identified(trials(0)[:1])


class TestOtherRuns:
    def test_runs_that_are_no_manoeuvre_are_fitted_but_not_forecast(self):
        time = np.arange(0.0, 600.0, 60.0)
        angles = np.deg2rad([10.0, -5.0, 20.0, 0.0, -15.0, 15.0, -20.0, 5.0, -10.0, 10.0])
        runs = [trial(ps.rudder_programme(time, sign * angles), seed=k) for k, sign in enumerate((1.0, -1.0))]
        found = identified(runs)
        assert found.manoeuvres == (None, None)
        assert found.held_out_indices.sizes["run"] == 0
        (first, second, last) = found.ship.remarks
        assert first.startswith(
            "Run 1: It is not recognised as a zigzag, a turning circle or a pull out: the rudder is "
        )
        assert first.endswith("The fit uses it, but no index is compared.")
        assert second.startswith("Run 2: ")
        assert "No run of a standard manoeuvre was held out" in last
        assert "heading and track of the held-out runs" in last
        expected = model_error([], found.ship.motion_error)["angle"]
        np.testing.assert_allclose(found.ship.index_error["angle"], expected, rtol=1e-12)
        assert not np.allclose(expected, model_error([])["angle"])
        assert found.vessel == known()
        assert len(found.candidates[0].draws) == 40

    @pytest.mark.parametrize(("earlier", "shown"), [(0, False), (1, False), (2, True)])
    def test_motion_of_earlier_runs_judges_a_single_run(self, earlier, shown):
        """Two earlier runs held each other out, one did not."""
        likelihood = SimpleNamespace(log_density=np.zeros(earlier))
        training = Training([trial(RUNS[0])], [RUNS[0]], {}, tanker(), "order_damped")
        training = replace(training, earlier={"set": likelihood} if earlier else {})
        assert ("heading and track" in ship_model._nothing_held_out(training)) == shown

    def test_it_says_what_it_does(self):
        said = []
        identified(trials(0)[:1], progress=said.append)
        assert said[0].startswith("term sets ")
        assert said[0].endswith(": fits to all of 1 runs and to all but one")
        fitted = [sentence for sentence in said if sentence.endswith(" term sets fitted")]
        assert fitted == [f"{k} of {len(fitted)} term sets fitted" for k in range(1, len(fitted) + 1)]
        assert fitted
        assert len(said) == 3 + len(fitted)


@pytest.mark.consistency
class TestCoverage:
    """35 deg turning circles forecast from zigzags of 20 deg and less."""

    FEWEST = int(stats.binom.ppf(0.005, len(SEEDS), 0.9))  # of 12 intervals of 90 %: fewer than 8 once in 200 times

    @pytest.fixture(scope="class")
    @classmethod
    def bands(cls):
        found = []
        for seed in SEEDS:
            ship = identified(trials(seed), draws=100, seed=seed).ship
            settings = {"step": 0.5, "record_interval": 1.0, "method": "rk4", "rng": np.random.default_rng(seed)}
            tree = pooled_forecast(
                ship.models, CIRCLE, duration=700.0, ci_prob=0.9, errors=ship.index_error, **settings
            )
            found.append(tree["index_bands"].to_dataset())
        return found

    @staticmethod
    def covered(bands, name, vessel):
        """Intervals that hold the index of a ship."""
        true = float(ps.indices(trial(CIRCLE, vessel=vessel, duration=700.0))[name])
        return sum(float(band[name].sel(band="lower")) <= true <= float(band[name].sel(band="upper")) for band in bands)

    @pytest.mark.parametrize("name", ["advance", "tactical_diameter"])
    def test_intervals_hold_the_true_ship(self, bands, name):
        assert self.FEWEST == 8
        assert self.covered(bands, name, tanker()) >= self.FEWEST

    @pytest.mark.parametrize("name", ["advance", "tactical_diameter"])
    def test_they_do_not_hold_one_whose_rudder_turns_it_less(self, bands, name):
        """Broken twin: four fifths of the rudder's yaw moment."""
        yaw = [replace(c, value=0.8 * c.value) if c.name == "Ngsincos" else c for c in tanker().forces["yaw"]]
        other = replace(tanker(), forces=tanker().forces | {"yaw": tuple(yaw)})
        assert self.covered(bands, name, other) < self.FEWEST

    def test_they_are_of_use(self, bands):
        """Intervals as wide as anything would hold the truth, too."""
        for band in bands:
            low, high = (float(band["tactical_diameter"].sel(band=b)) for b in ("lower", "upper"))
            assert high - low < 0.3 * 1110.0
