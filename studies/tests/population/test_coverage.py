"""What the intervals of a population hold: found again where it is known, and not where it is not."""

from __future__ import annotations

from types import MappingProxyType

import numpy as np
import pytest

from pymc_ship.ships.ensemble.index_error import EXTRAPOLATION_SD, LIKELIHOOD_WEIGHT, TYPICAL
from pymc_ship.ships.ensemble.motion_error import TYPICAL as OF_MOTION
from studies.population import coverage
from studies.population.figures import coverage_by_index, motion_by_lead, reliability
from studies.tests.population.ships import columns


def test_coverage_is_that_of_the_draws_and_that_of_narrow_ones_falls_out():
    right, narrow = (coverage.coverage_row(columns(share=share)) for share in (1.0, 2.0))
    assert (right["ships"], right["indices"]) == (200, 4000)
    for level in (95, 50):
        assert abs(right[f"hold_{level}"] - level) < 4.0 * right[f"hold_{level}_se"]
        assert narrow[f"hold_{level}"] < level - 4.0 * narrow[f"hold_{level}_se"]
    assert right["z"] == pytest.approx(1.0, abs=4.0 / np.sqrt(8000))
    assert right["half_width"] == pytest.approx(0.098)
    assert abs(right["pit"] - 0.5) < 4.0 * right["pit_se"]


def test_forecasts_that_err_to_one_side_have_a_mean_share_of_draws_below_that_says_so():
    found = columns()
    row = coverage.coverage_row(found | {"pit": found["pit"] ** 2})
    assert row["pit"] < 0.5 - 4.0 * row["pit_se"]


def test_a_ship_counts_as_one():
    """Twenty equal numbers of a ship say no more than one."""
    rng = np.random.default_rng(1)
    each = rng.random(50) < 0.9
    once = coverage.over_ships(each, np.arange(50))
    often = coverage.over_ships(np.repeat(each, 20), np.repeat(np.arange(50), 20))
    assert often == pytest.approx(once)
    assert np.isnan(coverage.over_ships(np.ones(3), np.zeros(3))[1])


def test_a_forecast_that_does_not_reach_an_index_holds_nothing():
    found = columns(200, ships=20)
    for name in ("pit", "error", "sd", "crps", "half_width"):
        found[name] = np.where(found["ship"] < 10, np.nan, found[name])
    row = coverage.coverage_row(found)
    assert row["hold_95"] < 50.0
    assert np.isfinite([row["z"], row["crps"], row["half_width"]]).all()


def test_statements_hold_as_often_as_they_say_and_those_of_narrow_intervals_do_not():
    right, narrow = (coverage.statements(columns(share=share)) for share in (1.0, 2.0))
    for row in right:
        assert abs(row["share"] - row["stated"]) < 4.0 * row["se"]
        assert row["statements"] == 8000
        assert row["held"] == pytest.approx(8000 * row["share"])
    assert narrow[-1]["share"] < 0.99 - 4.0 * narrow[-1]["se"]


@pytest.mark.parametrize("growth", [0.01, 0.04])
def test_the_growth_is_found_from_the_errors(growth):
    assert coverage.fitted_growth(columns(growth=growth), 0.0) == pytest.approx(growth, rel=0.15)
    counted = columns(growth=growth)
    counted["sd"] = np.hypot(counted["sd"], growth * counted["beyond"])
    assert coverage.fitted_growth(counted, growth) == pytest.approx(growth, rel=0.15)


@pytest.fixture(scope="module")
def once():
    """The law that ships would choose, each held-out index being one of its own."""
    return coverage.fitted_law(*TestLaw().ships())


class TestLaw:
    """Ships whose errors have a known law: half-Cauchy sizes, overshoots of 0.2 % and distances of 0.5 %."""

    TRUE = MappingProxyType({"angle": 0.002, "distance": 0.005})
    NAMES = MappingProxyType({"angle": ("zigzag", "first_overshoot_angle"), "distance": ("turning circle", "advance")})

    def ships(self, copies=1, count=100, seed=8):
        """Columns of forecasts and of held-out indices, these of every third ship and ``copies`` times over."""
        rng, forecasts, held = np.random.default_rng(seed), [], []
        for ship in range(count):
            size = np.tan(0.5 * np.pi * rng.random())
            for kind, typical in self.TRUE.items():
                manoeuvre, index = self.NAMES[kind]
                of_ship = {"ship": ship, "first": ship % 2 == 0}
                for _ in range(3):
                    sd = np.hypot(0.001, typical * size)
                    row = {"manoeuvre": manoeuvre, "index": index, "draws_sd": 0.001, "beyond": 0.0}
                    forecasts.append(of_ship | row | {"error": sd * rng.standard_normal()})
                    held += (
                        (ship % 3 == 0)
                        * copies
                        * [of_ship | {"kind": kind, "known": 1e-6, "error": sd * rng.standard_normal()}]
                    )
        return ({name: np.array([row[name] for row in rows]) for name in rows[0]} for rows in (forecasts, held))

    def test_it_is_found_again(self, once):
        """Within four standard errors of the mean logarithm of 100 half-Cauchy sizes."""
        angle, time, distance, roll, together = once
        error = 4.0 * 0.5 * np.pi / np.sqrt(100)
        assert np.log(angle / 0.002) == pytest.approx(0.0, abs=error)
        assert np.log(distance / 0.005) == pytest.approx(0.0, abs=error)
        assert np.isnan([time, roll]).all()
        assert together > 0.4

    def test_indices_that_say_the_same_count_for_less(self, once):
        assert coverage.fitted_law(*self.ships(copies=4))[-1] < 0.4 * once[-1]

    def test_each_half_has_its_own_beside_the_one_that_is_used(self):
        forecasts, held = self.ships()
        late = ~forecasts["first"]
        forecasts["error"] = np.where(late, 20.0 * forecasts["error"], forecasts["error"])
        rows = {row["of"]: row for row in coverage.law_rows(forecasts, held, moving(ships=100))}
        assert rows["typical error, angle"]["used"] == TYPICAL["angle"]
        assert rows["weight of an index"]["used"] == LIKELIHOOD_WEIGHT
        assert rows["typical error, distance"]["second"] > 3.0 * rows["typical error, distance"]["first"]
        assert rows["typical error of the motion, u"]["used"] == OF_MOTION["u"]
        assert np.isnan(rows["typical error of the motion, r"]["first"])

    def test_no_ship_says_nothing(self):
        none = [{name: values[:0] for name, values in columns.items()} for columns in self.ships(count=1)]
        assert np.isnan(coverage.fitted_law(*none)).all()


def test_distances_are_told_in_words():
    names = coverage.distance_names(np.array([0.0, 0.9, 1.0, 2.9, 3.0, 40.0]))
    assert names.tolist() == [name for name in coverage.DISTANCES for _ in range(2)]


def test_groups_are_told_apart():
    found = columns()
    rows = coverage.by(found, coverage.index_names(found))
    assert [row["group"] for row in rows] == ["turning circle, transfer", "turning circle, advance"]
    assert sum(row["indices"] for row in rows) == 4000


def test_the_ship_that_holds_least_is_the_first():
    found = columns(1000, ships=10)
    found["pit"] = np.where(found["ship"] == 7, 0.99, found["pit"])
    rows = coverage.ship_rows(found)
    assert [row["hold_95"] for row in rows] == sorted(row["hold_95"] for row in rows)
    assert {name: rows[0][name] for name in ("trials", "ship", "hull", "indices", "hold_95")} == {
        "trials": "two",
        "ship": 7,
        "hull": "tanker",
        "indices": 100,
        "hold_95": 0.0,
    }
    assert rows[0]["beyond"] == found["beyond"][found["ship"] == 7].max()
    assert len(rows) == 10


class TestAlternatives:
    """Each is chosen on one half of the ships and shown on the other."""

    def test_none_is_needed_where_the_intervals_are_right(self):
        rows = {row["intervals"]: row for row in coverage.alternative_rows(columns(n=20_000, ships=1000))}
        package, draws, *others = rows.values()
        assert abs(package["hold_95"] - 95.0) < 4.0 * package["hold_95_se"]
        assert draws["hold_95"] < 70.0  # half as wide
        for row in others[1:]:
            assert row["hold_95"] == pytest.approx(package["hold_95"], abs=1.5), row["intervals"]
            assert row["score"] == pytest.approx(package["score"], rel=0.02), row["intervals"]
            assert row["score"] < draws["score"]

    def test_those_that_learn_mend_what_is_too_narrow(self):
        package, *others = coverage.alternative_rows(columns(n=20_000, ships=1000, share=2.0))
        learned = {
            row["intervals"]: row for row in others if "conformal" in row["intervals"] or "t for" in row["intervals"]
        }
        assert len(learned) == 3
        assert package["hold_95"] < 75.0
        for row in learned.values():
            assert abs(row["hold_95"] - 95.0) < 4.0 * row["hold_95_se"] + 0.5
            assert row["score"] < package["score"]

    def test_without_growth_the_interval_is_narrower_beyond(self):
        found = columns(n=2000, growth=EXTRAPOLATION_SD)
        found["sd"] = np.hypot(found["sd"], EXTRAPOLATION_SD * found["beyond"])
        rows = {row["intervals"]: row for row in coverage.alternative_rows(found)}
        assert rows["no growth beyond the runs"]["half_width"] < rows[next(iter(rows))]["half_width"]

    def test_no_half_is_shown_what_was_chosen_on_itself(self):
        """Errors of one half are twice as large: factors of the other half do not mend them."""
        found, wide = columns(n=20_000, ships=1000), columns(n=20_000, ships=1000, share=2.0)
        first = found["first"]
        found |= {name: np.where(first, found[name], wide[name]) for name in ("error", "pit")}
        rows = {row["intervals"]: row for row in coverage.alternative_rows(found)}
        assert rows["conformal: one factor from other ships"]["hold_95"] < 88.0

    def test_one_half_says_nothing(self):
        assert coverage.alternative_rows(columns() | {"first": np.ones(4000, dtype=bool)}) == []


def moving(ships=400, typical=0.002):
    """Columns of instants of u of ships whose sizes have the half-Cauchy law."""
    rng = np.random.default_rng(5)
    ship, lead = np.repeat(np.arange(ships), 4), np.tile([1.0, 5.0, 10.0, 15.0], ships)
    size = np.abs(rng.standard_cauchy(ships))[ship] * typical * np.sqrt(lead / 10.0)
    known = np.full(ship.size, 0.001)
    error = np.hypot(size, known) * rng.standard_normal(ship.size)
    columns = {"ship": ship, "lead": lead, "error": error, "draws_sd": known, "far": np.zeros(ship.size)}
    return columns | {"state": np.full(ship.size, "u"), "first": ship < ships // 2}


def test_the_typical_error_of_the_motion_is_found_again():
    """Within four standard errors of the mean logarithm of 400 half-Cauchy sizes; a ship without an error has none."""
    found = coverage.fitted_motion(moving(), "u")
    assert np.log(found / 0.002) == pytest.approx(0.0, abs=4.0 * 0.5 * np.pi / np.sqrt(400))
    assert coverage.fitted_motion(moving(typical=1e-9), "u") < 1e-4
    assert np.isnan(coverage.fitted_motion(moving(), "psi"))


def instants(share=1.0, n=3000):
    """Columns of instants of two states."""
    found = columns(n, share=share)
    return found | {"state": np.where(np.arange(n) % 2, "u", "r"), "lead": np.where(np.arange(n) % 3, 1.0, 5.0)}


def test_instants_in_bands_are_told_by_state_and_group():
    right, wild = (coverage.motion_rows(instants(share), instants()["lead"]) for share in (1.0, 2.0))
    assert {(row["state"], row["group"]) for row in right} == {("u", 1.0), ("u", 5.0), ("r", 1.0), ("r", 5.0)}
    for row, other in zip(right, wild, strict=True):
        assert abs(row["hold_90"] - 90.0) < 4.0 * row["se"]
        assert row["worst"] <= row["hold_90"]
        assert other["hold_90"] < 90.0 - 4.0 * other["se"]


def test_figures_show_what_the_tables_tell():
    found = columns()
    lines = reliability(found).axes[0].get_lines()
    stated, within = lines[0].get_ydata(), lines[1].get_ydata()
    assert np.abs(within - stated).max() < 0.1
    dots = coverage_by_index(coverage.by(found, coverage.index_names(found))).axes[0]
    assert [label.get_text() for label in dots.get_yticklabels()] == [
        "turning circle, transfer",
        "turning circle, advance",
    ]
    motion = instants()
    assert len(motion_by_lead(coverage.motion_rows(motion, motion["lead"])).axes[0].get_lines()) >= 3
