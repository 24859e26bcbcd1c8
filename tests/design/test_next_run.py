"""Which run to sail next of an identified ship: exact laws, the edge of what is known, sea room, and what is kept."""

from __future__ import annotations

import re
from types import SimpleNamespace

import numpy as np
import pytest
import xarray as xr

import pymc_ship as ps
from pymc_ship.design.next_run import CANDIDATES, left_after, next_runs, outlook
from pymc_ship.forces.terms import SYMBOLS
from pymc_ship.manoeuvre.standard import STANDARD
from pymc_ship.motion.prime_record import motion_record, prime_record
from pymc_ship.vessel.vessel import coefficient_names, reference_coefficients
from tests.ship.cases import RUNS, tanker, trial

CIRCLE = ps.turning_circle(35)
NO_LEADS = xr.Dataset(coords={"lead": []})


def motion_of(manoeuvres):
    """Prime motion of exact runs, as that of trials."""
    rows = [prime_record(tanker(), motion_record(trial(one), tanker()))[0] for one in manoeuvres]
    values = np.vstack([np.column_stack([row[symbol] for symbol in SYMBOLS]) for row in rows])
    return xr.DataArray(values, {"symbol": list(SYMBOLS)}, ("row", "symbol"))


def ship_of(rows, motion, errors=None):
    return SimpleNamespace(models=[(tanker(), rows)], motion=motion, model_error=errors or {}, motion_error=NO_LEADS)


@pytest.fixture(scope="module")
def zigzags():
    return motion_of(RUNS)


@pytest.fixture(scope="module")
def ship(zigzags):
    """A tanker whose coefficients are known to half a percent."""
    values = reference_coefficients(tanker())
    rows = values * (1.0 + 0.005 * np.random.default_rng(2).standard_normal((60, values.size)))
    return ship_of(
        rows, zigzags, {"angle": np.full(1, 0.001), "distance": np.full(1, 0.002), "time": np.full(1, 0.002)}
    )


# the linear Bayes estimate --------------------------------------------------------------------------------------------

N = 4000
MIXING = np.random.default_rng(8).standard_normal((6, 9))
NOISE = np.array([0.3, 0.0, 2.0, 1.0])
ENSEMBLE = np.random.default_rng(9).standard_normal((N, 6)) @ MIXING
ASKED, SEEN = ENSEMBLE[:, :5], ENSEMBLE[:, 5:]


def exact(noise=NOISE):
    """Variance of the first five columns of the normal law of the ensemble, given the last four with noise."""
    whole = MIXING.T @ MIXING
    shared = whole[5:, 5:] + np.diag(noise**2)
    return np.diag(whole[:5, :5] - whole[:5, 5:] @ np.linalg.solve(shared, whole[5:, :5]))


def test_what_is_left_is_the_variance_of_the_conditional_normal_law():
    """A sample variance has a relative error of sqrt(2 / n); broken twin: the noise of the measurement left out."""
    tolerance = 5.0 * np.sqrt(2.0 / N)
    np.testing.assert_allclose(left_after(ASKED, SEEN, NOISE), exact(), rtol=tolerance)
    twin = left_after(ASKED, SEEN, 0.0 * NOISE)
    assert (twin < (1.0 - tolerance) * exact()).any()


def test_draws_that_reach_no_index_do_not_count():
    asked, seen = ASKED.copy(), SEEN.copy()
    asked[::7, 0], seen[::5, 1] = np.nan, np.nan
    whole = (np.arange(N) % 7 > 0) & (np.arange(N) % 5 > 0)
    np.testing.assert_allclose(left_after(asked, seen, NOISE), left_after(ASKED[whole], SEEN[whole], NOISE), rtol=1e-12)


def test_a_few_draws_explain_nothing_by_chance():
    """Columns that have nothing to do with each other, 30 draws and 9 of them: all of the variance is left on average.

    Broken twin: without the correction a third of it were explained.
    """
    rng, left = np.random.default_rng(3), []
    for _ in range(300):
        asked, seen = rng.standard_normal((30, 1)), rng.standard_normal((30, 9))
        left.append(left_after(asked, seen, np.full(9, 1e-6))[0])
    error = np.std(left) / np.sqrt(300)
    assert np.mean(left) == pytest.approx(0.95, abs=0.05 + 4.0 * error)
    assert np.mean(left) * (29 - 9) / 29 < 0.75


def test_nothing_seen_or_a_column_that_is_the_same_for_all_tells_nothing():
    whole = ASKED.var(axis=0, ddof=1)
    np.testing.assert_allclose(left_after(ASKED, np.empty((N, 0)), np.empty(0)), whole, rtol=1e-12)
    np.testing.assert_allclose(left_after(ASKED, np.ones((N, 1)), np.zeros(1)), whole, rtol=1e-3)


# the choice -----------------------------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def plan(ship):
    return next_runs(ship, STANDARD, 2)


def test_after_zigzags_a_circle_tells_of_circles(ship):
    plan = next_runs(ship, [ps.zigzag(10, 10), CIRCLE], interest=[CIRCLE])
    assert plan["chosen"].item() == CIRCLE.label
    assert list(plan["target"].values) == [
        f"{CIRCLE.label}, {name}" for name in ("advance", "transfer", "tactical diameter")
    ]
    assert set(plan["units"].values) == {"m"}
    first, then = plan["half_width"].values
    assert (then < 0.5 * first).all()
    ratio = float(plan["width_ratio"].sel(step=1, candidate=CIRCLE.label))
    assert ratio == pytest.approx(np.exp(np.mean(np.log(then / first))), rel=1e-12)


def test_each_run_that_is_added_leaves_less(plan):
    widths = plan["half_width"].values
    assert (widths[1] <= widths[0]).all()
    chance = np.sqrt((60 - 1 - 9) / (60 - 1 - 17))  # by which the correction for it may raise what is known
    assert (widths[2] <= 1.02 * chance * widths[1]).all()
    best = plan["width_ratio"].min("candidate").values
    assert best[1] < best[0] < 1.0
    for step, label in zip(plan["step"].values, plan["chosen"].values, strict=True):
        assert float(plan["width_ratio"].sel(step=step, candidate=label)) == best[step - 1]


def test_the_first_half_width_is_that_of_the_forecast(ship, plan):
    """1.96 sd of draws and model error beside half the interval of 95 % of a forecast; 60 draws."""
    tree = ps.forecast_ship(ps.IdentifiedShip(ship.models, ship.motion, ship.model_error, NO_LEADS, ()), CIRCLE, rng=1)
    lower, _, upper = tree["index_bands"]["advance"].values
    found = plan["half_width"].sel(stage=0, target=f"{CIRCLE.label}, advance")
    assert float(found) == pytest.approx(0.5 * (upper - lower), rel=0.35)


def test_errors_beyond_the_runs_end_where_the_next_run_goes(zigzags):
    """Ships that are all alike: what is left is the model error, which grows beyond the motion of the runs.

    Broken twin: a zigzag does not go where the circle goes.
    """
    rows = np.tile(reference_coefficients(tanker()), (20, 1))
    plan = next_runs(ship_of(rows, zigzags), [CIRCLE, ps.zigzag(10, 10)], interest=[CIRCLE])
    first, then = plan["half_width"].values
    assert (first > 3.0).all()
    assert (then < 1e-6).all()
    twin = next_runs(ship_of(rows, zigzags), [ps.zigzag(10, 10)], interest=[CIRCLE])
    np.testing.assert_allclose(twin["half_width"].values[1], first, rtol=0.02)


def test_noise_of_the_indices_leaves_more(ship):
    noisy = SimpleNamespace(**vars(ship))
    noisy.model_error = {kind: 20.0 * sizes for kind, sizes in ship.model_error.items()}
    quiet, loud = (next_runs(one, [CIRCLE], interest=[ps.zigzag(20, 20)]) for one in (ship, noisy))
    assert float(loud["width_ratio"][0, 0]) > 1.1 * float(quiet["width_ratio"][0, 0])


def test_the_same_ship_gives_the_same_plan(ship, plan):
    xr.testing.assert_identical(next_runs(ship, STANDARD, 2), plan)


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
    near = next_runs(ship, STANDARD, sea_room=room)
    fits = near["sea_room"].values <= room
    np.testing.assert_array_equal(np.isnan(near["width_ratio"].values[0]), ~fits)
    assert 0 < fits.sum() < fits.size
    assert near["chosen"].item().startswith("turning circle")


def test_no_sea_room_at_all_is_said(ship):
    with pytest.raises(ps.TrialDesignError, match=r"in 100 m: the turning circle 35 \w+ takes \d+ m; give more"):
        next_runs(ship, [CIRCLE, ps.zigzag(20, 20)], sea_room=100.0)


# what is refused ------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(("candidates", "n"), [([], 1), ([ps.rudder_programme([0, 10], [0, 0.1])], 1), ([CIRCLE], 0)])
def test_what_cannot_be_chosen_from_is_refused(ship, candidates, n):
    with pytest.raises(ps.TrialDesignError, match="one candidate or more that have indices"):
        next_runs(ship, candidates, n)


def test_wind_asks_for_forces_that_know_it(ship):
    with pytest.raises(ps.SimulationError, match="knows wind"):
        next_runs(ship, [CIRCLE], wind=(10.0, 90.0))


def test_wind_drifts_the_candidates_and_not_what_is_asked(zigzags):
    from tests.sea_trials.cases import tanker as of_parts

    vessel = of_parts()
    values, k = reference_coefficients(vessel), coefficient_names(vessel).index("Nv")
    rows = np.tile(values, (20, 1))
    rows[:, k] *= np.linspace(0.95, 1.05, 20)
    one = SimpleNamespace(models=[(vessel, rows)], motion=zigzags, model_error={}, motion_error=NO_LEADS)
    calm, windy = (next_runs(one, [CIRCLE], interest=[CIRCLE], wind=wind) for wind in (None, (15.0, 0.0)))
    np.testing.assert_array_equal(windy["half_width"].values[0], calm["half_width"].values[0])
    assert abs(float(windy["sea_room"][0]) / float(calm["sea_room"][0]) - 1.0) > 0.02


# the outlook of an identified ship ------------------------------------------------------------------------------------


def test_the_outlook_says_what_the_circle_is_and_which_run_tells_most(ship, plan):
    turns, advice = outlook(ship, np.random.default_rng(1))
    truth = float(ps.indices(trial(CIRCLE, duration=900.0))["tactical_diameter"])
    median, lower, upper = map(float, re.search(r"(\S+) L \((\S+) to (\S+)\) to port", turns).groups())
    assert lower < truth / tanker().particulars.L < upper
    assert lower < median < upper
    best = plan["chosen"].values[0]
    ratio, room = (float(plan[name].sel(candidate=best).values.flat[0]) for name in ("width_ratio", "sea_room"))
    assert f"As the next run the {best} would tell most" in advice
    assert f"would be {ratio:.2f} times as wide" in advice
    assert f"It takes {room / tanker().particulars.L:.1f} L of sea room." in advice


def test_the_same_seed_gives_the_same_sentences(ship):
    first, again = (outlook(ship, np.random.default_rng(3)) for _ in range(2))
    assert first == again


def test_the_candidates_are_those_of_both_sides():
    assert {one.side for one in CANDIDATES} == {"port", "starboard"}
    assert set(STANDARD) < set(CANDIDATES)
