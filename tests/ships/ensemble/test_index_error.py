"""Model error of indices: few rows by hand, and added to simulated indices."""

from __future__ import annotations

import csv
from pathlib import Path
from types import MappingProxyType

import numpy as np
import pytest
import xarray as xr
from scipy import stats

from pymc_ship.physics.manoeuvre.kinds import SCORED_QUANTITIES
from pymc_ship.physics.manoeuvre.turning_circles import TURNING_CIRCLE
from pymc_ship.physics.manoeuvre.zigzags import ZIGZAG
from pymc_ship.ships.ensemble.draws import robust_sd
from pymc_ship.ships.ensemble.index_error import (
    CALIBRATION_HITS,
    CALIBRATION_TRIALS,
    EXTRAPOLATION_SD,
    LIKELIHOOD_WEIGHT,
    TYPICAL,
    extrapolation_growth,
    growth_at,
    index_sd,
    model_error,
    reliability,
    scaled_error,
    steady_error,
    with_model_error,
)
from pymc_ship.ships.ensemble.motion_error import MOTION_EXTRAPOLATION_SD, SIZES, size_law
from pymc_ship.ships.ensemble.motion_error import TYPICAL as MOTION_TYPICAL
from tests.ships.identification.cases import tanker

N = 20_000
MONTE_CARLO = 4.0 / np.sqrt(2.0 * N)  # relative, of a standard deviation
ERRORS = {"angle": 0.1, "time": 0.02, "distance": 0.05, "roll": 0.08}
UNIT = {"time": 320.0 / 7.974, "distance": 320.0}
RNG = np.random.default_rng


def row(kind, error, parameter_sd=0.0, model_sd=0.0, scale=1.0, measured_sd=0.0):
    return {
        "kind": kind,
        "measured": 5.0 + error,
        "forecast": 5.0,
        "parameter_sd": parameter_sd,
        "model_sd": model_sd,
        "measured_sd": measured_sd,
        "scale": scale,
    }


def test_the_robust_sd_of_normal_draws_is_their_sd_despite_outliers():
    """68 % of a normal law lie within 0.9945 of its standard deviations."""
    draws = 3.0 + 2.0 * stats.norm.ppf((np.arange(1000) + 0.5) / 1000)
    assert robust_sd(draws) == pytest.approx(2.0, rel=0.01)
    assert robust_sd(np.append(draws, [1e9, np.nan, np.nan])) == pytest.approx(2.0, rel=0.02)


def root_mean_square(rows, **law):
    """Of the size, in typical errors, from :func:`size_law`."""
    error, known = np.array([scaled_error(one) for one in rows]).T
    size, log_weight = size_law(
        error, known, np.array([TYPICAL[one["kind"]] for one in rows]), **{"likelihood_weight": LIKELIHOOD_WEIGHT} | law
    )
    return float(np.sqrt(np.exp(log_weight) @ size**2))


def errors_of(size, count, rng, parameter_sd=0.4, model_sd=0.3):
    """Rows of indices whose errors are ``size`` over the scale beyond their draws."""
    scale = rng.uniform(10.0, 30.0, count)
    total = np.sqrt(parameter_sd**2 + model_sd**2 + (size * scale) ** 2)
    pairs = zip(total, scale, strict=True)
    return [row("angle", sd * rng.standard_normal(), parameter_sd, model_sd, width) for sd, width in pairs]


def harder(error, beyond=1.0, **known):
    """Row of an angle of a harder run, with a distance from the milder ones."""
    return row("angle", error, **known) | {"beyond": beyond}


def relative_error(ratio):
    """Error e of a ratio 1 + e, or 1 / (1 - e) of a negative one."""
    return np.maximum(ratio, 1.0) - np.maximum(1.0 / ratio, 1.0)


class TestExtrapolationGrowth:
    ERRORS = MappingProxyType({"angle": np.zeros(SIZES)})

    def test_without_harder_runs_it_is_the_law_of_other_ships(self):
        """Half-Cauchy with median 1."""
        expected = np.tan(0.5 * np.pi * np.array([0.25, 0.5, 0.75, 0.9]))
        growth = extrapolation_growth([], {})
        assert np.quantile(growth, [0.25, 0.5, 0.75, 0.9], method="hazen") == pytest.approx(expected, rel=0.02)

    def test_a_growth_is_estimated_from_errors_and_distances(self):
        """4000 rows at several distances: within four of its own sd. Broken twin: one distance for all."""
        rng = RNG(4)
        distances = rng.uniform(0.2, 3.0, 4000)
        sds = np.hypot(0.001, 8.0 * EXTRAPOLATION_SD * distances)
        rows = [harder(s * rng.standard_normal(), b, parameter_sd=0.001) for s, b in zip(sds, distances, strict=True)]
        growth = extrapolation_growth(rows, self.ERRORS)
        assert growth.mean() == pytest.approx(8.0, abs=4.0 * growth.std())
        assert growth.std() < 0.5
        twin = extrapolation_growth([one | {"beyond": 0.2} for one in rows], self.ERRORS)
        assert twin.mean() > 8.0 + 4.0 * twin.std()

    @pytest.mark.parametrize("known", [{"parameter_sd": 0.1}, {"model_sd": 0.1}, {"measured_sd": 0.1}])
    def test_what_draws_models_and_readings_explain_is_no_growth(self, known):
        rows = [harder(0.1 * z, **known) for z in RNG(6).standard_normal(400)]
        assert np.quantile(extrapolation_growth(rows, self.ERRORS), 0.9) < 10.0
        bare = [harder(one["measured"] - 5.0) for one in rows]
        assert np.median(extrapolation_growth(bare, self.ERRORS)) == pytest.approx(0.1 / EXTRAPOLATION_SD, rel=0.2)

    def test_an_error_that_the_ship_has_within_its_runs_is_no_growth(self):
        rows = [harder(0.1 * z) for z in RNG(7).standard_normal(400)]
        growth = extrapolation_growth(rows, {"angle": np.full(SIZES, 0.1)})
        assert np.quantile(growth, 0.9) < 10.0

    def test_it_is_the_law_by_quadrature(self):
        """Of a quarter of each row's likelihood and the mean over the sizes of the error within the runs."""
        rows = [harder(0.03, 1.0, parameter_sd=0.004), harder(-0.08, 2.5, parameter_sd=0.004)]
        within = np.concatenate([np.full(SIZES // 2, 0.001), np.full(SIZES // 2, 0.05)])
        growth = np.geomspace(1e-4, 1e4, 20001)
        likelihood = np.zeros(growth.size)
        for size in (0.001, 0.05):
            density = 1.0
            for error, beyond in ((0.03, 1.0), (0.08, 2.5)):
                sd = np.sqrt(0.004**2 + size**2 + (EXTRAPOLATION_SD * beyond * growth) ** 2)
                density = density * stats.norm.pdf(error, 0.0, sd) ** 0.25
            likelihood += density
        weight = likelihood * growth * stats.cauchy.pdf(growth)  # of log growth
        cumulative = np.cumsum(weight) / weight.sum()
        for probability in (0.1, 0.5, 0.9):
            expected = np.interp(probability, cumulative, growth)
            made = np.quantile(extrapolation_growth(rows, {"angle": within}), probability, method="hazen")
            assert made == pytest.approx(expected, rel=0.02), probability

    def test_rows_count_for_a_part(self):
        """Four copies of a row narrow the law; each has a quarter of its likelihood."""
        one, four = (extrapolation_growth(n * [harder(0.2)], self.ERRORS) for n in (1, 4))
        sd = [np.std(np.log(growth)) for growth in (one, four)]
        assert sd[1] < 0.8 * sd[0]
        assert np.median(four) > np.median(one) > 1.0

    def test_the_sd_of_an_index_includes_it(self):
        sd = index_sd(harder(0.1, 2.0, parameter_sd=0.01), {}, np.full(1, 5.0))
        assert sd == pytest.approx(np.hypot(0.01, 10.0 * EXTRAPOLATION_SD), rel=1e-12)
        assert index_sd(row("angle", 0.1, parameter_sd=0.01), {}, np.full(1, 5.0)) == pytest.approx(0.01, rel=1e-12)


class TestModelError:
    def test_without_a_held_out_index_it_is_the_law_of_other_ships(self):
        """Half-Cauchy: a quarter of it below tan(pi / 8) of the median, three quarters below tan(3 pi / 8)."""
        for kind, sizes in model_error([]).items():
            assert sizes.size == SIZES
            expected = np.tan(0.5 * np.pi * np.array([0.25, 0.5, 0.75, 0.9]))
            ratios = np.quantile(sizes, [0.25, 0.5, 0.75, 0.9], method="hazen") / TYPICAL[kind]
            assert ratios == pytest.approx(expected, rel=0.02), kind

    def test_its_prior_has_the_size_of_the_error_of_the_motion(self):
        """Motion that errs twenty times as much as typical: the law of other ships twenty times as wide."""
        motion = {name: np.full(SIZES, 20.0 * sd) for name, sd in MOTION_TYPICAL.items()}
        for kind, sizes in model_error([], motion).items():
            middle = slice(SIZES // 10, -SIZES // 10)  # the grid of sizes cuts the tails
            assert sizes[middle] == pytest.approx(20.0 * model_error([])[kind][middle], rel=0.02), kind
        rows = errors_of(10.0 * TYPICAL["angle"], 400, RNG(4), parameter_sd=0.0, model_sd=0.0)
        assert np.median(model_error(rows, motion)["angle"]) == pytest.approx(10.0 * TYPICAL["angle"], rel=0.1)

    def test_errors_of_a_known_size_are_found_again(self):
        """4000 rows with draws, models and a relative error of 5 %: the size within four of its own sd."""
        rows = errors_of(0.05, 4000, RNG(1), parameter_sd=0.8)
        sizes = model_error(rows)["angle"]
        assert sizes.mean() == pytest.approx(0.05, abs=4.0 * sizes.std())
        assert sizes.std() < 0.01
        forgetful = model_error([one | {"parameter_sd": 0.0, "model_sd": 0.0} for one in rows])["angle"]
        assert forgetful.mean() > 0.05 + 4.0 * forgetful.std()

    def test_what_the_draws_explain_is_no_model_error(self):
        """Errors as large as the sd of the draws: less than half of the sizes exceed the median of other ships."""
        rng = RNG(2)
        rows = [row("time", rng.standard_normal(), parameter_sd=1.0, scale=100.0) for _ in range(200)]
        upper = np.quantile(model_error(rows)["time"], 0.95)
        assert upper < 0.01 < np.quantile(model_error([])["time"], 0.95)

    def test_what_the_readings_leave_open_is_no_model_error(self):
        """Measured indices that scatter by the noise of their readings give a small model error.

        The broken twin has no noise of readings, and its model error is as large as the noise.
        """
        rng = RNG(5)
        rows = [row("angle", rng.standard_normal(), scale=1000.0, measured_sd=1.0) for _ in range(200)]
        upper, typical = (np.quantile(model_error(some_rows)["angle"], 0.95) for some_rows in (rows, []))
        assert upper < 0.001 < typical
        twin = model_error([one | {"measured_sd": 0.0} for one in rows])["angle"]
        assert np.median(twin) == pytest.approx(0.001, rel=0.25)

    def test_a_ship_has_one_size_in_all_kinds(self):
        """Overshoots with ten times the typical error raise the error of distances as much."""
        errors = model_error(errors_of(10.0 * TYPICAL["angle"], 400, RNG(3), parameter_sd=0.0, model_sd=0.0))
        for kind in SCORED_QUANTITIES:
            assert errors[kind] / TYPICAL[kind] == pytest.approx(errors["angle"] / TYPICAL["angle"], rel=1e-12)
        assert np.median(errors["distance"]) == pytest.approx(10.0 * TYPICAL["distance"], rel=0.5)

    def test_an_index_counts_for_a_part_as_it_errs_with_the_others_of_its_run(self):
        """Four copies of an index of weight 1/4 give the law of one of weight 1."""
        one = [row("time", 0.5, parameter_sd=0.1, scale=10.0)]
        whole = root_mean_square(one, likelihood_weight=1.0)
        assert root_mean_square(4 * one, likelihood_weight=0.25) == pytest.approx(whole, rel=1e-9)
        assert root_mean_square(4 * one, likelihood_weight=1.0) != pytest.approx(whole, rel=0.1)
        assert LIKELIHOOD_WEIGHT < 1.0

    def test_one_large_error_of_a_single_run_is_not_taken_at_its_word(self):
        """A circle forecast wrongly by 0.3 L from a single zigzag, with draws of sd 0.15 L."""
        lone = [row("distance", 0.3, parameter_sd=0.15)]
        many = [row("distance", sign * 0.3, parameter_sd=0.15) for sign in (1.0, -1.0)] * 40
        assert np.median(model_error(lone)["distance"]) < 0.02
        assert np.median(model_error(many)["distance"]) > 0.2

    def test_an_index_that_is_hardly_known_does_not_wipe_out_the_others(self):
        rows = [row("time", sign * 1.0) for sign in (1.0, -1.0)] * 20
        median_size = np.median(model_error(rows)["time"])
        assert np.median(model_error([*rows, row("time", 0.1, parameter_sd=30.0)])["time"]) > 0.95 * median_size


class TestIndexSd:
    def test_it_holds_draws_models_and_the_error(self):
        errors = {"angle": np.array([0.2])}
        assert index_sd(row("angle", 0.0, 3.0, 4.0, 60.0), errors) == pytest.approx(13.0, rel=1e-12)
        assert index_sd(row("roll", 0.0, 3.0, 4.0, 60.0), errors) == pytest.approx(5.0, rel=1e-12)

    def test_its_interval_of_95_percent_is_that_of_all_sizes_together(self):
        """By simulation; broken twin: the sd of the median size."""
        errors, rng, n = model_error([]), RNG(5), 200_000
        entry = row("distance", 0.0, 0.002, 0.0, 1.0)
        size = np.hypot(0.002, rng.choice(errors["distance"], n))
        drawn = np.abs(size * rng.standard_normal(n))
        reach = stats.norm.ppf(0.975)
        error = 4.0 * np.sqrt(0.05 * 0.95 / n)
        assert np.mean(drawn < reach * index_sd(entry, errors)) == pytest.approx(0.95, abs=error)
        median = {"distance": np.median(errors["distance"])}
        assert np.mean(drawn < reach * index_sd(entry, {k: np.atleast_1d(v) for k, v in median.items()})) < 0.95 - error


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
            if index.quantity in ("speed", "rate", "drift", "diameter"):
                assert after[name].identical(before[name]), name
                continue
            swing = (index.quantity == "angle") * heading_deg + float(before[name][0])
            size = UNIT.get(index.quantity, swing)
            spread = float(after[name].std())
            assert spread == pytest.approx(ERRORS[index.quantity] * size, rel=MONTE_CARLO), name
            assert float(after[name].mean()) == pytest.approx(float(before[name][0]), abs=4.0 * spread / np.sqrt(N))
        assert after.attrs == before.attrs
        assert all(after[name].attrs == before[name].attrs for name in kind.indices)

    def test_a_draw_has_one_size_in_all_kinds(self):
        """One size for all indices of a ship: squares of two indices are correlated, their values are not."""
        errors = {kind: np.repeat([0.01, 0.2], 50) for kind in ERRORS}
        before = ships(ZIGZAG, heading_deg=20.0)
        after = with_model_error(before, errors, tanker(), RNG(2))
        names = ("second_overshoot_angle", "period")
        first, second = (after[name].values - float(before[name][0]) for name in names)
        assert abs(np.corrcoef(first, second)[0, 1]) < 4.0 / np.sqrt(N)
        assert np.corrcoef(first**2, second**2)[0, 1] > 0.1
        fraction = np.mean(np.abs(first) > 4.0 * 0.01 * 124.0)
        assert fraction == pytest.approx(0.5 * 2.0 * stats.norm.sf(0.2), abs=4.0 * 0.5 / np.sqrt(N))

    def test_an_overshoot_measured_without_the_swing_would_be_narrower(self):
        """Broken twin: the heading left out of the attrs."""
        after = with_model_error(ships(ZIGZAG), ERRORS, tanker(), RNG(2))
        assert float(after["first_overshoot_angle"].std()) < 0.9 * ERRORS["angle"] * 123.0

    def test_errors_of_two_indices_are_independent(self):
        after = with_model_error(ships(ZIGZAG, heading_deg=20.0), ERRORS, tanker(), RNG(2))
        likelihood_weight = np.corrcoef(after["first_overshoot_angle"], after["second_overshoot_angle"])[0, 1]
        assert abs(likelihood_weight) < 4.0 / np.sqrt(N)

    def test_without_errors_nothing_changes(self):
        before = ships(ZIGZAG, heading_deg=20.0)
        assert with_model_error(before, {}, tanker(), RNG(2)).identical(before)
        none = with_model_error(before, dict.fromkeys(SCORED_QUANTITIES, 0.0), tanker(), RNG(2))
        assert none.identical(before)

    @pytest.mark.parametrize("errors", [{}, ERRORS])
    def test_beyond_the_motion_of_the_runs_an_error_is_added_for_each_range(self, errors):
        before = ships(TURNING_CIRCLE)
        after = with_model_error(before, errors, tanker(), RNG(2), beyond=20.0)
        for name, kind in (("advance", "distance"), ("time_to_90", "time")):
            wanted = np.hypot(errors.get(kind, 0.0), 20.0 * EXTRAPOLATION_SD) * UNIT[kind]
            assert float(after[name].std()) == pytest.approx(wanted, rel=MONTE_CARLO), name
        assert float(after["steady_speed"].std()) == pytest.approx(
            20.0 * MOTION_EXTRAPOLATION_SD["u"] * 7.974, rel=MONTE_CARLO
        )
        diameter = relative_error(after["steady_turning_diameter"] / before["steady_turning_diameter"])
        speed, rate = (
            7.974 / float(before["steady_speed"][0]),
            np.rad2deg(7.974 / 320.0 / float(before["steady_yaw_rate"][0])),
        )
        wanted = 20.0 * np.hypot(MOTION_EXTRAPOLATION_SD["u"] * speed, MOTION_EXTRAPOLATION_SD["r"] * rate)
        assert float(diameter.std()) == pytest.approx(wanted, rel=MONTE_CARLO)
        roll = float(before["maximum_roll_angle"][0])
        wanted = np.hypot(errors.get("roll", 0.0), 20.0 * EXTRAPOLATION_SD) * roll
        assert float(after["maximum_roll_angle"].std()) == pytest.approx(wanted, rel=MONTE_CARLO)
        within = with_model_error(before, errors, tanker(), RNG(2), beyond=0.0)
        assert float(within["maximum_roll_angle"].std()) == pytest.approx(
            errors.get("roll", 0.0) * roll, rel=MONTE_CARLO
        )
        assert (
            float(within["advance"].std())
            < 0.9 * np.hypot(errors.get("distance", 0.0), 20.0 * EXTRAPOLATION_SD) * UNIT["distance"]
        )

    def test_the_growth_beyond_the_runs_is_a_law(self):
        """Half of the draws with growth 1, half with 7, for every quantity."""
        before, growth = ships(TURNING_CIRCLE), np.array([1.0, 7.0])
        after = with_model_error(before, {}, tanker(), RNG(2), beyond=2.0, growth=growth)
        mean_square = np.sqrt(np.mean(growth**2))
        for name, unit in (
            ("advance", EXTRAPOLATION_SD * 320.0),
            ("steady_speed", MOTION_EXTRAPOLATION_SD["u"] * 7.974),
        ):
            assert float(after[name].std()) == pytest.approx(2.0 * unit * mean_square, rel=2.0 * MONTE_CARLO), name
            share = float(np.mean(np.abs(after[name] - before[name]) > 3.0 * 2.0 * unit))
            assert share == pytest.approx(0.5 * (0.0027 + 0.6682), abs=4.0 * 0.5 / np.sqrt(N)), name

    def test_a_diameter_has_a_mean_however_large_the_growth(self):
        """Its exponential had one of 1e126 of ships with rudder stall."""
        before = ships(TURNING_CIRCLE)
        after = with_model_error(before, {}, tanker(), RNG(2), beyond=20.0, growth=np.array([1.0, 300.0]))
        ratio = after["steady_turning_diameter"] / before["steady_turning_diameter"]
        speed, rate = (float(after[name].std() / before[name][0]) for name in ("steady_speed", "steady_yaw_rate"))
        assert float(np.abs(relative_error(ratio)).max()) < 10.0 * np.hypot(speed, rate)
        assert float(ratio.min()) > 0.0

    def test_steady_values_err_as_the_motion_of_held_out_runs_does_once_it_has_settled(self):
        """Prime errors of u, r and v."""
        errors = steady_error({"u": np.array([0.02]), "v": np.array([0.03]), "r": np.array([0.04]), "x": np.ones(1)})
        assert set(errors) == {"speed", "drift", "rate"}
        before = ships(TURNING_CIRCLE)
        after = with_model_error(before, errors, tanker(), RNG(2))
        unit = 320.0 / 7.974
        wanted = {"steady_speed": 0.02 * 7.974, "steady_yaw_rate": np.rad2deg(0.04 / unit)}
        for name, sd in (wanted | {"steady_drift_angle": np.rad2deg(0.03)}).items():
            assert float(after[name].std()) == pytest.approx(sd, rel=MONTE_CARLO), name
        relative = np.hypot(*(wanted[name] / float(before[name][0]) for name in wanted))
        diameter = relative_error(after["steady_turning_diameter"] / before["steady_turning_diameter"])
        assert float(diameter.std()) == pytest.approx(relative, rel=MONTE_CARLO)
        assert float(diameter.mean()) == pytest.approx(0.0, abs=4.0 * relative / np.sqrt(N))
        assert after["advance"].identical(before["advance"])
        assert steady_error({}) == {}

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


def test_probabilities_beyond_the_runs_have_the_calibration_cap():
    assert reliability(0.0) == {}
    attrs = reliability(0.3)
    assert attrs["calibration_cap"] == pytest.approx((CALIBRATION_HITS + 1) / (CALIBRATION_TRIALS + 2))
    assert 0.95 < attrs["calibration_cap"] < 0.995
    assert (
        f"of {CALIBRATION_TRIALS} statements of 99 % made so for other ships, {CALIBRATION_HITS} were correct"
        in attrs["reliability"]
    )


def test_the_calibration_counts_are_those_of_the_study():
    """The counts are those of the results of studies/ships.toml."""
    path = Path(__file__).parents[3] / "reports" / "ships" / "tables" / "statements.csv"
    with path.open(encoding="utf-8", newline="") as file:
        (row,) = [
            row
            for row in csv.DictReader(file)
            if (row["forecasts"], row["stated"]) == ("beyond the motion of the runs", "0.99")
        ]
    assert int(row["statements"]) == CALIBRATION_TRIALS
    assert round(float(row["share"]) * CALIBRATION_TRIALS) == CALIBRATION_HITS


class TestGrowthAt:
    measured = np.full(SIZES, 0.5)

    @pytest.mark.parametrize(("measured", "beyond"), [(0.0, 3.0), (1.0, 0.0), (1.0, 1.0), (4.0, 3.0)])
    def test_it_is_that_of_the_harder_runs_as_far_as_they_went(self, measured, beyond):
        assert np.array_equal(growth_at(self.measured, measured, beyond), self.measured)

    @pytest.mark.parametrize(("beyond", "part"), [(2.0, 0.5), (10.0, 0.9)])
    def test_past_them_the_growth_of_other_ships_is_added(self, beyond, part):
        """Harder runs without a stall of the rudder do not exclude one further on."""
        added = np.sqrt(growth_at(self.measured, 1.0, beyond) ** 2 - 0.5**2)
        assert np.quantile(added, [0.25, 0.5, 0.9]) == pytest.approx(
            part * np.tan(0.5 * np.pi * np.array([0.25, 0.5, 0.9])), rel=0.05
        )

    def test_it_does_not_depend_on_the_measured_growth(self):
        measured = np.linspace(0.0, 1.0, SIZES)
        added = np.sqrt(growth_at(measured, 1.0, 2.0) ** 2 - measured**2)
        ranks = np.argsort(np.argsort(added))
        assert abs(np.corrcoef(ranks, np.arange(SIZES))[0, 1]) < 0.1
