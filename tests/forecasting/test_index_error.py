"""Model error of indices: by hand on a few rows, and put back onto simulated ships."""

from __future__ import annotations

import csv
from pathlib import Path

import numpy as np
import pytest
import xarray as xr
from scipy import stats

from pymc_ship.forecasting.index_error import (
    BEYOND,
    HELD,
    MADE,
    index_sd,
    model_error,
    reliability,
    robust_sd,
    steady_error,
    with_model_error,
)
from pymc_ship.forecasting.motion_error import GROWTH
from pymc_ship.manoeuvre.kinds import ERRING
from pymc_ship.manoeuvre.turning_circles import TURNING_CIRCLE
from pymc_ship.manoeuvre.zigzags import ZIGZAG
from tests.ship.cases import tanker

N = 20_000
MONTE_CARLO = 4.0 / np.sqrt(2.0 * N)  # relative, of a standard deviation
ERRORS = {"angle": 0.1, "time": 0.02, "distance": 0.05}
UNIT = {"time": 320.0 / 7.974, "distance": 320.0}
RNG = np.random.default_rng


def row(kind, error, parameter_sd=0.0, model_sd=0.0, scale=1.0):
    return {
        "kind": kind,
        "measured": 5.0 + error,
        "forecast": 5.0,
        "parameter_sd": parameter_sd,
        "model_sd": model_sd,
        "scale": scale,
    }


def test_the_spread_of_normal_draws_is_their_sd_whatever_a_few_of_them_do():
    """68 % of a normal law lie within 0.9945 of its standard deviations."""
    draws = 3.0 + 2.0 * stats.norm.ppf((np.arange(1000) + 0.5) / 1000)
    assert robust_sd(draws) == pytest.approx(2.0, rel=0.01)
    assert robust_sd(np.append(draws, [1e9, np.nan, np.nan])) == pytest.approx(2.0, rel=0.02)


class TestModelError:
    def test_it_is_what_the_draws_and_models_leave_in_units_of_the_scale(self):
        """The sd t at which (6^2 / 10^2) / (0.13 + t^2) and (1 / 5^2) / t^2 are 1 on average."""
        rows = [row("angle", 6.0, 3.0, 2.0, 10.0), row("angle", -1.0, scale=5.0)]
        square = np.array([0.36, 0.04])
        found = model_error(rows)["angle"]
        assert np.mean(square / (np.array([0.13, 0.0]) + found**2)) == pytest.approx(1.0, rel=1e-9)

    def test_equal_variances_leave_the_mean_square_less_the_variance(self):
        rows = [row("time", size, parameter_sd=1.0) for size in (1.0, 2.0, 3.0)]
        assert model_error(rows)["time"] == pytest.approx(np.sqrt(14.0 / 3.0 - 1.0), rel=1e-9)
        assert model_error([row("time", 1.0, parameter_sd=1.5)])["time"] == 0.0

    def test_an_index_that_is_hardly_known_does_not_wipe_out_the_others(self):
        rows = [row("time", 1.0), row("time", -1.0), row("time", 0.1, parameter_sd=30.0)]
        assert model_error(rows)["time"] > 0.7

    def test_kinds_are_pooled_apart(self):
        rows = [row("angle", 0.1), row("time", 0.2), row("distance", 0.3)]
        assert model_error(rows) == pytest.approx({"angle": 0.1, "time": 0.2, "distance": 0.3}, rel=1e-9)

    def test_where_a_kind_was_not_held_out_that_before_it_counts(self):
        assert model_error([row("angle", 0.1)]) == pytest.approx(dict.fromkeys(ERRING, 0.1), rel=1e-9)
        found = model_error([row("angle", 0.1), row("distance", 0.3)])
        assert found == pytest.approx({"angle": 0.1, "time": 0.1, "distance": 0.3}, rel=1e-9)
        found = model_error([row("distance", 0.3)])
        assert found == pytest.approx(dict.fromkeys(ERRING, 0.3), rel=1e-9)
        found = model_error([row("time", 0.2), row("distance", 0.3)])
        assert found == pytest.approx({"angle": 0.2, "time": 0.2, "distance": 0.3}, rel=1e-9)

    def test_the_kind_before_it_counts_and_not_the_largest(self):
        found = model_error([row("angle", 0.3), row("time", 0.1)])
        assert found == pytest.approx({"angle": 0.3, "time": 0.1, "distance": 0.1}, rel=1e-9)

    def test_nothing_held_out_has_none(self):
        assert model_error([]) == {}

    def test_the_sd_of_a_forecast_holds_all_three(self):
        errors = {"angle": 0.2}
        assert index_sd(row("angle", 0.0, 3.0, 4.0, 60.0), errors) == pytest.approx(13.0, rel=1e-12)

    def test_errors_of_a_known_size_are_found_again(self):
        """1000 rows with draws, models and a relative error of 5 %: the estimate within four standard errors."""
        rng, n = RNG(1), 1000
        scale = rng.uniform(10.0, 30.0, n)
        total = np.sqrt(0.4**2 + 0.3**2 + (0.05 * scale) ** 2)
        rows = [
            row("angle", size * rng.standard_normal(), 0.4, 0.3, width)
            for size, width in zip(total, scale, strict=True)
        ]
        square = (total / scale) ** 2
        error = np.sqrt(2.0 * np.sum(square**2)) / n
        assert model_error(rows)["angle"] ** 2 == pytest.approx(0.05**2, abs=4.0 * error)
        forgetful = [entry | {"parameter_sd": 0.0, "model_sd": 0.0} for entry in rows]
        assert model_error(forgetful)["angle"] ** 2 > 0.05**2 + 4.0 * error


def ships(kind, **attrs):
    """Indices of ships that are all alike: the first at 103, the second at 104 and so on, far from 0."""
    values = {name: ("draw", np.full(N, 103.0 + k), {"units": "of its own"}) for k, name in enumerate(kind.indices)}
    return xr.Dataset(values, {"draw": np.arange(N)}, {"manoeuvre": kind.name, **attrs})


class TestWithModelError:
    @pytest.mark.parametrize(("kind", "heading_deg"), [(ZIGZAG, 20.0), (TURNING_CIRCLE, 0.0)])
    def test_the_spread_is_that_stated(self, kind, heading_deg):
        before = ships(kind, heading_deg=heading_deg)
        after = with_model_error(before, ERRORS, tanker(), RNG(2))
        for name, index in kind.indices.items():
            if index.quantity in ("speed", "rate") or name in ("maximum_roll_angle", "steady_drift_angle"):
                assert after[name].identical(before[name]), name
                continue
            size = UNIT.get(index.quantity, heading_deg + float(before[name][0]))
            spread = float(after[name].std())
            assert spread == pytest.approx(ERRORS[index.quantity] * size, rel=MONTE_CARLO), name
            assert float(after[name].mean()) == pytest.approx(float(before[name][0]), abs=4.0 * spread / np.sqrt(N))
        assert after.attrs == before.attrs
        assert all(after[name].attrs == before[name].attrs for name in kind.indices)

    def test_an_overshoot_measured_without_the_swing_would_be_narrower(self):
        """Broken twin: the heading left out of the attrs."""
        after = with_model_error(ships(ZIGZAG), ERRORS, tanker(), RNG(2))
        assert float(after["first_overshoot_angle"].std()) < 0.9 * ERRORS["angle"] * 123.0

    def test_errors_of_two_indices_are_independent(self):
        after = with_model_error(ships(ZIGZAG, heading_deg=20.0), ERRORS, tanker(), RNG(2))
        together = np.corrcoef(after["first_overshoot_angle"], after["second_overshoot_angle"])[0, 1]
        assert abs(together) < 4.0 / np.sqrt(N)

    def test_without_errors_nothing_changes(self):
        before = ships(ZIGZAG, heading_deg=20.0)
        assert with_model_error(before, {}, tanker(), RNG(2)).identical(before)
        none = with_model_error(before, dict.fromkeys(ERRING, 0.0), tanker(), RNG(2))
        assert none.identical(before)

    @pytest.mark.parametrize("errors", [{}, ERRORS])
    def test_beyond_the_motion_of_the_runs_an_error_is_added_for_each_range(self, errors):
        before = ships(TURNING_CIRCLE)
        after = with_model_error(before, errors, tanker(), RNG(2), beyond=3.0)
        for name, kind in (("advance", "distance"), ("time_to_90", "time")):
            wanted = np.hypot(errors.get(kind, 0.0), 3.0 * BEYOND) * UNIT[kind]
            assert float(after[name].std()) == pytest.approx(wanted, rel=MONTE_CARLO), name
        assert float(after["steady_speed"].std()) == pytest.approx(3.0 * GROWTH["u"] * 7.974, rel=MONTE_CARLO)
        roll = float(before["maximum_roll_angle"][0])
        assert float(after["maximum_roll_angle"].std()) == pytest.approx(3.0 * BEYOND * roll, rel=MONTE_CARLO)
        within = with_model_error(before, errors, tanker(), RNG(2), beyond=0.0)
        assert within["maximum_roll_angle"].identical(before["maximum_roll_angle"])
        assert (
            float(within["advance"].std())
            < 0.9 * np.hypot(errors.get("distance", 0.0), 3.0 * BEYOND) * UNIT["distance"]
        )

    def test_steady_values_err_as_the_motion_of_held_out_runs_does_at_the_longest_lead(self):
        """Prime errors of u, r and v; broken twin: those at the first lead, which are narrower."""
        leads = {name: ("lead", [0.1 * size, size]) for name, size in (("u", 0.02), ("v", 0.03), ("r", 0.04))}
        errors = steady_error(xr.Dataset(leads, {"lead": [0.0, 20.0]}))
        before = ships(TURNING_CIRCLE)
        after = with_model_error(before, errors, tanker(), RNG(2))
        unit = 320.0 / 7.974
        wanted = {"steady_speed": 0.02 * 7.974, "steady_yaw_rate": np.rad2deg(0.04 / unit)}
        for name, sd in (wanted | {"steady_drift_angle": np.rad2deg(0.03)}).items():
            assert float(after[name].std()) == pytest.approx(sd, rel=MONTE_CARLO), name
        assert after["advance"].identical(before["advance"])
        assert steady_error(xr.Dataset(coords={"lead": []})) == {}

    def test_a_ship_that_did_not_reach_the_event_stays_nan(self):
        before = ships(TURNING_CIRCLE)
        before["advance"][0] = np.nan
        after = with_model_error(before, ERRORS, tanker(), RNG(2))
        assert np.isnan(after["advance"].values).tolist() == [True, *[False] * (N - 1)]

    def test_no_index_that_cannot_be_negative_is(self):
        """Quantiles inside the range are those of the normal law, so that an interval covers as often as before."""
        before = ships(ZIGZAG, heading_deg=20.0) - 102.0
        before.attrs = {"manoeuvre": "zigzag", "heading_deg": 20.0}
        after = with_model_error(before, ERRORS, tanker(), RNG(2))
        size = ERRORS["angle"] * 21.0
        lower, middle, upper = np.quantile(after["first_overshoot_angle"], [0.025, 0.5, 0.975])
        assert lower == 0.0
        assert middle == pytest.approx(1.0, abs=4.0 * 1.25 * size / np.sqrt(N))
        assert upper == pytest.approx(1.0 + 1.96 * size, rel=0.03)
        assert all(float(after[name].min()) >= 0.0 for name in ZIGZAG.indices)

    def test_a_transfer_may_be_to_the_other_side(self):
        before = ships(TURNING_CIRCLE) - 102.0
        after = with_model_error(before.assign_attrs(manoeuvre="turning_circle"), ERRORS, tanker(), RNG(2))
        assert float(after["transfer"].min()) < 0.0 <= float(after["advance"].min())


def test_no_probability_is_stated_beyond_the_runs_that_others_did_not_bear_out():
    assert reliability(0.0) == {}
    found = reliability(0.3)
    assert found["surest"] == pytest.approx((HELD + 1) / (MADE + 2))
    assert 0.95 < found["surest"] < 0.995
    assert f"of {MADE} statements of 99 % that were made so on foreign ships, {HELD} held" in found["reliability"]


def test_the_tables_of_the_population_bear_the_bound_out():
    """The counts are those of the kept results of studies/ships.toml."""
    path = Path(__file__).parents[2] / "reports" / "ships" / "tables" / "statements.csv"
    with path.open(encoding="utf-8", newline="") as file:
        (row,) = [
            row
            for row in csv.DictReader(file)
            if (row["forecasts"], row["stated"]) == ("beyond the motion of the runs", "0.99")
        ]
    assert int(row["statements"]) == MADE
    assert round(float(row["share"]) * MADE) == HELD
