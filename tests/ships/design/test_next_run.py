"""The next run of an identified ship: exact laws, extrapolation, sea room and summary."""

from __future__ import annotations

import re
from dataclasses import replace
from functools import cache

import numpy as np
import pytest

import pymc_ship as ps
from pymc_ship.cli.texts import design_text
from pymc_ship.physics.manoeuvre.standard import STANDARD
from pymc_ship.physics.vessel.vessel import coefficient_names, reference_coefficients
from pymc_ship.ships.design.next_run import CANDIDATES, _Run, design, remaining_variance
from pymc_ship.ships.design.outlook import manoeuvring_summary, sentence_without_gain
from pymc_ship.ships.ensemble.index_error import model_error
from pymc_ship.ships.ensemble.index_table import index_table
from pymc_ship.ships.ensemble.motion_error import motion_error
from tests.ships.ensemble.cases import motion_of, ship_of
from tests.ships.forecasting.posteriors import joint
from tests.ships.identification.cases import RUNS, tanker, trial
from tests.ships.identification.three_zigzags import model

CIRCLE = ps.turning_circle(35)


def alike(count=20):
    """A tanker whose draws are all the same."""
    return tanker(), np.tile(reference_coefficients(tanker()), (count, 1))


@cache
def zigzags():
    return motion_of(tanker(), map(trial, RUNS))


@cache
def well_known():
    """A tanker whose coefficients are known to half a percent."""
    values = reference_coefficients(tanker())
    rows = values * (1.0 + 0.005 * np.random.default_rng(2).standard_normal((60, values.size)))
    errors = {"angle": np.full(1, 0.001), "distance": np.full(1, 0.002), "time": np.full(1, 0.002)}
    return ship_of((tanker(), rows), motion=zigzags(), index_error=errors)


@pytest.fixture(scope="module")
def ship():
    """One growth of the error beyond the runs, so that 60 draws give its intervals."""
    return replace(well_known(), extrapolation_growth=np.ones(1))


# the linear Bayes estimate --------------------------------------------------------------------------------------------

N = 4000
MIXING = np.random.default_rng(8).standard_normal((6, 9))
NOISE = np.array([0.3, 0.0, 2.0, 1.0])
ENSEMBLE = np.random.default_rng(9).standard_normal((N, 6)) @ MIXING
TARGETS, MEASURED = ENSEMBLE[:, :5], ENSEMBLE[:, 5:]


def exact(noise=NOISE):
    """Remaining variance of the first five columns given the last four, measured with noise: a normal law."""
    whole = MIXING.T @ MIXING
    shared = whole[5:, 5:] + np.diag(noise**2)
    explained = np.sum(whole[:5, 5:] * np.linalg.solve(shared, whole[5:, :5]).T, axis=1)
    return 1.0 - explained / np.diag(whole)[:5]


def test_the_remaining_variance_is_that_of_the_conditional_normal_law():
    """A sample variance has a relative error of sqrt(2 / n), clipping at 95 % takes a few per cent of all columns.

    Broken twin: the noise of the measurement left out.
    """
    tolerance = 0.03 + 5.0 * np.sqrt(2.0 / N)
    np.testing.assert_allclose(remaining_variance(TARGETS, MEASURED, NOISE), exact(), atol=tolerance)
    twin = remaining_variance(TARGETS, MEASURED, 0.0 * NOISE)
    assert (twin < exact() - tolerance).any()


def test_draws_that_reach_no_index_do_not_count():
    targets, measured = TARGETS.copy(), MEASURED.copy()
    targets[::7, 0], measured[::5, 1] = np.nan, np.nan
    whole = (np.arange(N) % 7 > 0) & (np.arange(N) % 5 > 0)
    expected = remaining_variance(TARGETS[whole], MEASURED[whole], NOISE)
    np.testing.assert_allclose(remaining_variance(targets, measured, NOISE), expected, rtol=1e-12)


def test_which_draws_reach_an_index_is_no_measurement():
    """The draws without the index have the largest tenth of the target; the index itself is independent of it."""
    rng = np.random.default_rng(5)
    targets, measured = rng.standard_normal((N, 1)), rng.standard_normal((N, 1))
    measured[targets[:, 0] > np.quantile(targets, 0.9)] = np.nan
    assert remaining_variance(targets, measured, np.ones(1))[0] == pytest.approx(1.0, abs=5.0 / np.sqrt(N))


@pytest.mark.parametrize("noise", [1e-6, 1.0])
def test_a_few_draws_explain_nothing_by_chance(noise):
    """Independent columns, 30 draws: all of the variance remains on average.

    The fraction is clipped at 1, which lowers the mean a little. Broken twin: the fraction without the correction.
    """
    rng, left, plain = np.random.default_rng(3), [], []
    for _ in range(300):
        targets, measured = rng.standard_normal((30, 1)), rng.standard_normal((30, 9))
        left.append(remaining_variance(targets, measured, np.full(9, noise))[0])
        a, s = targets - targets.mean(), measured - measured.mean(axis=0)
        gain = np.linalg.solve(s.T @ s + 30 * noise**2 * np.eye(9), s.T @ a)
        plain.append(1.0 - float(np.sum(a * (s @ gain)) / np.sum(a**2)))
    assert np.mean(left) > 0.9
    assert np.mean(plain) < 0.88


def test_nothing_is_explained_without_columns_by_constants_or_by_few_draws():
    np.testing.assert_array_equal(remaining_variance(TARGETS, np.empty((N, 0)), np.empty(0)), np.ones(5))
    np.testing.assert_allclose(remaining_variance(TARGETS, np.ones((N, 1)), np.zeros(1)), np.ones(5), rtol=1e-3)
    np.testing.assert_array_equal(remaining_variance(TARGETS[:6], ENSEMBLE[:6], np.full(9, 1e-9)), np.ones(5))


# the choice -----------------------------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def plan(ship):
    return design(ship, STANDARD, 2)


def test_after_zigzags_a_circle_reduces_the_intervals_of_circles(ship):
    plan = design(ship, [ps.zigzag(10, 10), CIRCLE], interest=[CIRCLE])
    assert plan["chosen"].item() == CIRCLE.label
    assert list(plan["target"].values) == [
        f"{CIRCLE.label}, {name}" for name in ("advance", "transfer", "tactical diameter")
    ]
    assert set(plan["units"].values) == {"m"}
    first, then = plan["half_width"].values
    assert (then < 0.5 * first).all()
    ratio = float(plan["width_ratio"].sel(step=1, candidate=CIRCLE.label))
    assert ratio == pytest.approx(np.exp(np.mean(np.log(then / first))), rel=1e-12)


def test_each_run_reduces_the_remaining_variance(plan):
    widths = plan["half_width"].values
    assert (widths[1] <= widths[0]).all()
    assert (widths[2] <= 1.1 * widths[1]).all()  # a correction for chance may raise what is known well
    best = plan["width_ratio"].min("candidate").values
    assert best[1] < best[0] < 1.0
    for step, label in zip(plan["step"].values, plan["chosen"].values, strict=True):
        assert float(plan["width_ratio"].sel(step=step, candidate=label)) == best[step - 1]


def test_the_first_half_width_is_that_of_the_forecast(ship, plan):
    """1.96 sd of draws and model error against half the interval of 95 % of a forecast; 60 draws."""
    tree = ps.forecast(ship, CIRCLE, rng=1)
    lower, _, upper = tree["index_bands"]["advance"].values
    half_width = plan["half_width"].sel(stage=0, target=f"{CIRCLE.label}, advance")
    assert float(half_width) == pytest.approx(0.5 * (upper - lower), rel=0.35)


def test_half_widths_include_the_whole_law_of_the_model_error():
    """Equal draws, no held-out run: a half-Cauchy law, whose interval of 95 % is wide.

    Broken twin: 1.96 of its median.
    """
    errors, zigzag = model_error([]), ps.zigzag(10, 10)
    known = {"index_error": errors, "extrapolation_growth": np.zeros(1)}
    one = ship_of(alike(), motion=motion_of(tanker(), [trial(zigzag)]), **known)
    plan = design(one, [zigzag], interest=[zigzag])
    half_width = float(plan["half_width"].sel(stage=0, target="zigzag 10/10 port, initial turning distance"))
    size = 320.0 * errors["distance"]
    draws = np.random.default_rng(6).choice(size, 200_000) * np.random.default_rng(7).standard_normal(200_000)
    assert half_width == pytest.approx(np.quantile(np.abs(draws), 0.95), rel=0.03)
    assert half_width > 3.0 * 1.96 * np.median(size)


def test_half_widths_include_the_whole_law_of_the_growth_beyond_the_runs():
    """Twice the growth is twice the half width; three large growths in twenty widen more than the median says."""
    one, half_width = ship_of(alike(), motion=zigzags(), index_error={}), {}
    for name, growth in {"one": np.ones(1), "twice": np.full(1, 2.0), "law": np.repeat([1.0, 100.0], [17, 3])}.items():
        plan = design(replace(one, extrapolation_growth=growth), [ps.zigzag(10, 10)], interest=[CIRCLE])
        half_width[name] = plan["half_width"].sel(stage=0).values
    np.testing.assert_allclose(half_width["twice"], 2.0 * half_width["one"], rtol=1e-6)
    assert (half_width["law"] > 3.0 * half_width["one"]).all()


def test_errors_beyond_the_runs_end_where_the_next_run_goes():
    """Equal draws: only the model error remains, which grows beyond the motion of the runs.

    Broken twin: a zigzag does not go where the circle goes.
    """
    one = ship_of(alike(), motion=zigzags(), index_error={})
    plan = design(one, [CIRCLE, ps.zigzag(10, 10)], interest=[CIRCLE])
    first, then = plan["half_width"].values
    assert (first > 3.0).all()
    assert (then < 1e-6).all()
    twin = design(one, [ps.zigzag(10, 10)], interest=[CIRCLE])
    np.testing.assert_allclose(twin["half_width"].values[1], first, rtol=0.02)


def test_the_noise_of_a_run_increases_the_remaining_variance(ship):
    """The target is a zigzag, whose angles keep their error; the noise of a circle is in times and distances."""
    interest = [ps.zigzag(20, 20)]
    noisy = replace(ship, index_error=ship.index_error | {kind: np.full(1, 0.1) for kind in ("time", "distance")})
    angles = [f"{interest[0].label}, {name} overshoot angle" for name in ("first", "second")]
    quiet, loud = (design(one, [CIRCLE], interest=interest)["half_width"].sel(target=angles) for one in (ship, noisy))
    np.testing.assert_allclose(quiet.sel(stage=0), loud.sel(stage=0), rtol=1e-9)
    assert (loud.sel(stage=1) > 1.1 * quiet.sel(stage=1)).all()


def test_noisy_sensors_in_held_out_runs_increase_the_remaining_variance(ship):
    """Sensor noise is no error of the ship: it does not change the half widths before the next run."""
    interest = [ps.turning_circle(35, side="port")]
    sides = [("distance", 320.0), ("time", 320.0 / 7.974)]
    known = {"run": "1", "manoeuvre": "", "measured": 1.0}
    rows = [known | {"index": q, "kind": q, "measured_sd": 0.1 * scale, "scale": scale} for q, scale in sides]
    noisy = replace(ship, held_out_indices=index_table(rows))
    quiet, loud = (design(one, [CIRCLE], interest=interest)["half_width"] for one in (ship, noisy))
    np.testing.assert_allclose(quiet.sel(stage=0), loud.sel(stage=0), rtol=1e-9)
    assert (loud.sel(stage=1) > 1.1 * quiet.sel(stage=1)).all()


def test_steady_values_of_unknown_error_are_no_data(ship):
    """The error of a steady yaw rate is that of held-out motion: without any its index is left out."""
    sure = replace(ship, motion_error=dict.fromkeys(("u", "v", "r"), np.array([1e-6])))
    unknown, known = (design(one, [ps.pull_out(20, 90)], interest=[CIRCLE]) for one in (ship, sure))
    assert float(known["width_ratio"][0, 0]) < 0.98 * float(unknown["width_ratio"][0, 0])


def test_a_run_without_reached_indices_adds_only_its_motion(ship, monkeypatch):
    monkeypatch.setattr(_Run, "reached_indices", lambda run, names: names if run.manoeuvre == CIRCLE else [])
    plan = design(ship, [ps.zigzag(10, 10)], interest=[CIRCLE])
    np.testing.assert_allclose(plan["half_width"][1], plan["half_width"][0], rtol=0.02)


# sea room -------------------------------------------------------------------------------------------------------------


def test_the_sea_room_of_a_circle_is_the_width_of_its_track(plan):
    run = trial(CIRCLE, duration=1600.0)
    turned = np.abs(run["psi"].values) < np.deg2rad(540.0)
    track = run["x"].values[turned] + 1j * run["y"].values[turned]
    widest = np.abs(track[:, None] - track).max()
    assert float(plan["sea_room"].sel(candidate=CIRCLE.label)) == pytest.approx(widest, rel=0.05)


def test_a_zigzag_ends_with_its_third_swing(plan):
    run = trial(ps.zigzag(20, 20), duration=1600.0)
    returned = np.flatnonzero(np.diff(np.sign(run["psi"].values)) != 0)
    track = run["x"].values + 1j * run["y"].values
    end = [k for k in returned if run["time"].values[k] > 10.0][2]
    room = float(plan["sea_room"].sel(candidate="zigzag 20/20 port"))
    assert room == pytest.approx(np.abs(track[end] - track[0]), rel=0.05)


def test_a_run_without_sea_room_is_not_chosen(ship, plan):
    room = 0.5 * float(
        plan["sea_room"].sel(candidate="zigzag 20/20 port") + plan["sea_room"].sel(candidate=CIRCLE.label)
    )
    near = design(ship, STANDARD, sea_room=room)
    fits = near["sea_room"].values <= room
    np.testing.assert_array_equal(np.isnan(near["width_ratio"].values[0]), ~fits)
    assert 0 < fits.sum() < fits.size
    assert near["chosen"].item().startswith("turning circle")


# what is refused ------------------------------------------------------------------------------------------------------


def test_wind_drifts_the_candidates_and_not_the_targets():
    from tests.ships.sea_trials.cases import tanker as of_parts

    vessel = of_parts()
    values, k = reference_coefficients(vessel), coefficient_names(vessel).index("Nv")
    rows = np.tile(values, (20, 1))
    rows[:, k] *= np.linspace(0.95, 1.05, 20)
    one = ship_of((vessel, rows), motion=zigzags(), index_error={})
    calm, windy = (design(one, [CIRCLE], interest=[CIRCLE], wind=wind) for wind in (None, (15.0, 0.0)))
    np.testing.assert_array_equal(windy["half_width"].values[0], calm["half_width"].values[0])
    assert abs(float(windy["sea_room"][0]) / float(calm["sea_room"][0]) - 1.0) > 0.02


# ships of a posterior and of a vessel file ----------------------------------------------------------------------------


class TestOfAPosterior:
    """A ship without laws of its errors has the typical ones of other ships."""

    @pytest.fixture(scope="class")
    @classmethod
    def known(cls):
        tree = joint(tanker(), 60, np.random.default_rng(2), spread=0.005, trial=trial(ps.zigzag(10, 10)))
        return ps.Ship.from_posterior(tanker(), tree, draws=60, rng=1)

    def test_after_a_zigzag_a_circle_tells_of_circles(self, known):
        plan = design(known, [ps.zigzag(10, 10), CIRCLE], interest=[CIRCLE])
        assert plan["chosen"].item() == CIRCLE.label
        first, then = plan["half_width"].values
        assert (then < first).all()

    def test_its_errors_are_those_of_other_ships(self, known):
        typical = replace(known, index_error=model_error(()), motion_error=motion_error((), tanker()))
        exact = replace(known, index_error={})
        own, same, less = (design(one, [CIRCLE], interest=[ps.zigzag(10, 10)]) for one in (known, typical, exact))
        np.testing.assert_array_equal(own["half_width"], same["half_width"])
        assert (own["half_width"].sel(stage=0) > less["half_width"].sel(stage=0)).all()


# the summary of an identified ship ------------------------------------------------------------------------------------


def test_the_summary_has_the_tactical_diameter_and_the_recommended_run(ship, plan):
    _, (turns, advice) = manoeuvring_summary(ship, np.random.default_rng(1))
    truth = float(ps.indices(trial(CIRCLE, duration=900.0))["tactical_diameter"])
    median, lower, upper = map(float, re.search(r"(\S+) L \((\S+) to (\S+)\) to port", turns).groups())
    assert lower < truth / tanker().particulars.L < upper
    assert lower < median < upper
    best = plan["chosen"].values[0]
    ratio, room = (float(plan[name].sel(candidate=best).values.flat[0]) for name in ("width_ratio", "sea_room"))
    assert f"Recommended next run: {best}." in advice
    assert f"to {ratio:.2f} of their width" in advice
    assert re.search(r", that of the .* of the .* from ± \S+ to ± \S+ (L|deg)\.", advice)
    assert f"The run takes {room / tanker().particulars.L:.1f} L of sea room." in advice


@pytest.mark.slow
def test_an_identified_ship_has_a_summary():
    _, (turns, advice) = manoeuvring_summary(model().ship, np.random.default_rng(1))
    assert re.fullmatch(r"Tactical diameter of the turning circle of 35 deg: .* to port, .* to starboard\.", turns)
    widest = float(re.search(r"to (\S+) of their width", advice).group(1))
    assert 0.0 < widest < 0.95


def test_a_run_that_gains_less_than_a_twentieth_is_not_recommended(plan):
    ratio = plan["width_ratio"]
    little = plan.assign(width_ratio=ratio - ratio.sel(step=1).min("candidate") + 0.96)
    text = sentence_without_gain(little)
    assert text.startswith(f"No further run is recommended: none of the {plan.sizes['candidate']} candidates")
    assert text.endswith(f"by 5 % or more; the best, {plan['chosen'].values[0]}, leaves 0.96 of their width.")
    assert sentence_without_gain(plan) == ""
    assert text in design_text(little)
    assert "recommended" not in design_text(plan)


def test_the_same_seed_gives_the_same_sentences(ship):
    first, again = (manoeuvring_summary(ship, np.random.default_rng(3))[1] for _ in range(2))
    assert first == again


def test_the_candidates_are_those_of_both_sides():
    assert {one.side for one in CANDIDATES} == {"port", "starboard"}
    assert set(STANDARD) < set(CANDIDATES)
