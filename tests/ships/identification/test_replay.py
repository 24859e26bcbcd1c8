"""Replays along a record's inputs and their scores."""

from __future__ import annotations

import numpy as np
import pytest

import pymc_ship as ps
from pymc_ship.physics.motion.equations import STATE
from pymc_ship.physics.motion.stepping import simulation_settings
from pymc_ship.physics.vessel.vessel import coefficient_names, reference_coefficients
from pymc_ship.ships.ensemble.index_error import EXTRAPOLATION_SD
from pymc_ship.ships.ensemble.motion_error import ERROR_STATES
from pymc_ship.ships.ensemble.ship import Member
from pymc_ship.ships.identification.open_loop import reading_noise_sd, replay_noise_sd
from pymc_ship.ships.identification.replay import SCORED
from tests.physics.forces.test_parts import AHEAD
from tests.physics.forces.test_parts import tanker as parts_of_tanker
from tests.sentences import refused
from tests.ships.ensemble.cases import motion_of, ship_of
from tests.ships.forecasting.posteriors import joint

DURATION = 600.0


@pytest.fixture(scope="module")
def tanker():
    return ps.load_vessel("kvlcc2")


@pytest.fixture(scope="module")
def trial(tanker):
    return ps.simulate(tanker, ps.zigzag(20, 20), duration=DURATION, step=0.5, method="rk4")


def test_runs_of_one_name_are_refused_where_names_are_given(tanker, trial):
    calls = (
        lambda: ps.score(tanker, [trial, trial], names=["a", "a"]),
        lambda: ps.score_indices(tanker, [trial, trial], names=["a", "a"], rng=1),
        lambda: ps.identify_ship([trial, trial], tanker, names=["a", "a"], rng=1),
    )
    for call in calls:
        with refused(ps.TrialError, "a"):
            call()


@pytest.mark.parametrize("windows", [{"length": "100"}, {"length": 100.0, "every": np.nan}])
def test_windows_are_numbers(tanker, trial, windows):
    with refused(ps.TrialError, "windows"):
        ps.score(tanker, trial, **windows)


def test_a_ship_replays_its_own_run(tanker, trial):
    tree = ps.replay(tanker, trial)
    for name in ("u", "v", "r", "psi", "x", "y"):
        size = np.ptp(trial[name].values)
        median = tree["bands"][name].sel(band="median").values
        assert np.abs(median - trial[name].values).max() < 0.02 * size, name
    assert tree.attrs["diverged_fraction"] == 0.0


def test_a_replay_begins_anywhere_in_the_record(tanker, trial):
    tree = ps.replay(tanker, trial, start=200, duration=100)
    assert tree["trajectories"]["time"].values[[0, -1]].tolist() == [200.0, 300.0]
    assert tree["measured"].sizes["time"] == tree["bands"].sizes["time"]


def test_another_ship_replays_another_motion(tanker, trial):
    other = tanker.with_coefficients({"yaw": 0.7 * tanker.coefficients("yaw").values})
    own, foreign = (ps.score(ship, trial) for ship in (tanker, other))
    assert own.attrs["score"] < 0.03
    assert foreign.attrs["score"] > 10.0 * own.attrs["score"]


def test_readings_of_the_ship_itself_lie_in_its_bands(tanker, trial):
    """Of noisy readings 90 % lie in bands that are noise alone, but for the error of the smoothed start.

    Another ship, the broken twin, is not excused by it.
    """
    rng = np.random.default_rng(4)
    noisy = ps.pollute(trial, level=0.01, rng=rng)
    noisy = noisy.assign({name: noisy[name] + rng.normal(0.0, 5.0, noisy.sizes["time"]) for name in ("x", "y")})
    found = ps.score(tanker, noisy, length=40, every=10)
    coverage = found["coverage"].sel(channel=["u", "v", "r", "psi", "position"]).mean("run").values
    windows = int(found["windows"].item())
    readings = windows * 80
    # a window has one start, whose error all its readings share
    error = 4.0 * np.sqrt(0.9 * 0.1 * (1.0 / windows + 1.0 / readings))
    np.testing.assert_allclose(coverage, 0.9, atol=error)
    other = tanker.with_coefficients({"yaw": 0.7 * tanker.coefficients("yaw").values})
    assert ps.score(other, noisy, length=40, every=10)["coverage"].sel(channel="r").item() < 0.6


def test_the_noise_of_a_reading_is_that_of_its_channel(trial):
    noisy = ps.pollute(trial, level=0.02, rng=5)
    found, exact = (replay_noise_sd(reading_noise_sd(run), run)[:, 0] for run in (noisy, trial))
    for name in ("u", "v", "r", "psi"):
        sd = float(np.std(noisy[name].values - trial[name].values))
        factor = np.sqrt(2.0) if name == "psi" else 1.0
        assert found[STATE.index(name)] == pytest.approx(factor * sd, rel=0.15)
        assert exact[STATE.index(name)] < 0.02 * sd
    no_x = trial.drop_vars("x")
    assert replay_noise_sd(reading_noise_sd(no_x), no_x)[STATE.index("x"), 0] == 0.0
    gap = noisy.assign(u=noisy["u"].where((noisy["time"] < 100) | (noisy["time"] > 130)))
    assert replay_noise_sd(reading_noise_sd(gap), gap)[STATE.index("u"), 0] == pytest.approx(
        found[STATE.index("u")], rel=0.1
    )


def test_the_noise_of_the_first_heading_turns_the_track(trial):
    """Tracks turned by a heading that is off scatter by the sd stated, across the way made good."""
    rng, sd = np.random.default_rng(6), 0.001
    noisy = trial.assign(psi=trial["psi"] + rng.normal(0.0, sd, trial.sizes["time"]))
    piece = noisy.isel(time=slice(300, None))  # a replay begins anywhere
    found = replay_noise_sd(reading_noise_sd(noisy), piece)
    track = (piece["x"] - piece["x"][0] + 1j * (piece["y"] - piece["y"][0])).values
    turned = track * np.exp(1j * rng.normal(0.0, sd, (4000, 1))) - track
    for name, error in (("x", turned.real), ("y", turned.imag)):
        expected = error.std(axis=0)
        assert found[STATE.index(name)] == pytest.approx(expected, rel=0.15, abs=0.02 * expected.max()), name
    assert found[STATE.index("y"), -1] > 0.1


def test_a_score_has_every_channel_of_every_run(tanker, trial):
    found = ps.score(tanker, [trial, trial.isel(time=slice(300, None))], names=["a", "b"], length=100, every=50)
    assert found["channel"].values.tolist() == list(SCORED)
    assert found["windows"].values.tolist() == [10, 7]
    np.testing.assert_allclose(found["score"], found["relative"].mean("channel"))
    assert found.attrs["score"] == pytest.approx(float(found["score"].mean()))


def test_a_window_that_runs_away_costs_the_run_its_score(tanker, trial):
    wild = tanker.with_coefficients({"surge": -5.0 * tanker.coefficients("surge").values})
    found = ps.score(wild, trial, length=300)
    assert found["diverged"].values.tolist() == [1]
    assert np.isnan(found.attrs["score"])


def test_revolutions_that_were_not_measured_are_those_of_the_approach(tanker):
    """A replay that begins in the turn, where the ship is slow: a ship of parts slows down no further."""
    ship = parts_of_tanker(AHEAD)
    circle = ps.simulate(ship, ps.turning_circle(35), duration=DURATION, step=0.5, method="rk4")
    tree = ps.replay(ship, circle, start=400)
    apart = tree["bands"]["u"].sel(band="median") - tree["measured"]["u"]
    assert float(np.abs(apart).max()) < 0.02


class TestOfAPosterior:
    """Its draws are the ships of a replay, and nothing is added to them beyond the motion of its run either."""

    @pytest.fixture(scope="class")
    @classmethod
    def ship(cls, tanker):
        gentle = ps.simulate(tanker, ps.zigzag(5, 5), duration=DURATION, step=0.5, method="rk4")
        tree = joint(tanker, 40, np.random.default_rng(3), spread=0.02, trial=gentle)
        return ps.Ship.from_posterior(tanker, tree, draws=40, rng=1)

    def test_it_is_replayed_with_bands_of_its_draws(self, ship, trial):
        tree = ps.replay(ship, trial, draws=40)
        assert tree.attrs["draws"] == 40
        assert tree["predictive"].to_dataset().identical(tree["trajectories"].to_dataset())
        lower, median, upper = tree["bands"]["r"].values
        expected = np.quantile(tree["trajectories"]["r"].values, [0.05, 0.5, 0.95], axis=0)
        np.testing.assert_allclose([lower, median, upper], expected, rtol=1e-12)
        assert (upper - lower)[-1] > 0.0

    def test_it_is_scored_as_the_vessel_of_its_draws_is(self, ship, tanker, trial):
        """A cloud about the coefficients that made the record, whose median is near them."""
        found, own = ps.score(ship, trial), ps.score(tanker, trial)
        assert found.attrs["score"] < 0.1
        assert own.attrs["score"] < found.attrs["score"]
        assert (found["coverage"].sel(channel="r") > own["coverage"].sel(channel="r")).all()

    def test_its_indices_err_by_the_spread_of_its_draws_alone(self, ship, trial):
        found = ps.score_indices(ship, ps.pollute(trial, level=0.01, rng=4), rng=1)
        np.testing.assert_allclose(found["sd"], found["parameter_sd"])
        assert (found["parameter_sd"] > 0.0).all()
        assert (found["measured_sd"] == 0.0).all()


def identified_from(tanker, manoeuvre):
    """The tanker as a ship that was identified from one run, with fifty equal draws and hardly an error."""
    run = ps.simulate(tanker, manoeuvre, duration=DURATION, step=0.5, method="rk4")
    rows = np.tile(reference_coefficients(tanker), (50, 1))
    hardly = dict.fromkeys(ERROR_STATES, np.array([1e-9]))
    return ship_of((tanker, rows), motion=motion_of(tanker, [run]), index_error={}, motion_error=hardly)


def test_bands_grow_beyond_the_motion_of_the_runs(tanker):
    circle = ps.simulate(tanker, ps.turning_circle(35), duration=DURATION, step=0.5, method="rk4")
    widths = {}
    for known in (ps.zigzag(10, 10), ps.turning_circle(35)):
        bands = ps.replay(identified_from(tanker, known), circle)["bands"]
        widths[known.kind] = {name: np.ptp(bands[name].values[:, -1]) for name in ("u", "x")}
    assert widths["turning_circle"]["u"] < 1e-6
    assert widths["zigzag"]["u"] > 0.01 * tanker.particulars.nominal_speed
    assert widths["zigzag"]["x"] > 0.01 * tanker.particulars.L


def test_indices_beyond_the_runs_have_the_growth_of_the_error(tanker):
    circle = ps.simulate(tanker, ps.turning_circle(35), duration=DURATION, step=0.5, method="rk4")
    tables = {}
    for known in (ps.zigzag(10, 10), ps.turning_circle(35)):
        tables[known.kind] = ps.score_indices(identified_from(tanker, known), circle, rng=1)
    inside, beyond = tables["turning_circle"], tables["zigzag"]
    assert float(inside["beyond"].max()) == 0.0
    assert (beyond["beyond"] > 1.0).all()
    grown = np.sqrt(beyond["sd"] ** 2 - inside["sd"] ** 2) / (EXTRAPOLATION_SD * beyond["beyond"] * beyond["scale"])
    assert (grown > 1.0).all()  # the 95 % interval of a half-Cauchy growth is wider than that of its median


def test_indices_are_those_of_the_estimate_not_of_the_mean_of_the_draws(tanker):
    """The draws of a posterior that is curved: their mean is no ship of it."""
    truth, zigzag, settings = reference_coefficients(tanker), ps.zigzag(20, 20), simulation_settings(tanker)
    record = ps.simulate(tanker, zigzag, duration=700.0, **settings)
    of_yaw = np.array([name.startswith("N") for name in coefficient_names(tanker)])
    draws = truth * (1.0 + 0.2 * of_yaw * np.abs(np.random.default_rng(1).standard_normal((40, 1))))
    ship = ps.Ship((Member("curved", tanker, draws, truth),))
    compared = ps.score_indices(ship, record, rng=1)
    of_mean = ps.indices(ps.simulate(tanker, zigzag, duration=700.0, coefficients=draws.mean(axis=0)[None], **settings))
    for name in ("first_overshoot_angle", "initial_turning_time"):
        measured, forecast = (compared[key].sel(index=name).item() for key in ("measured", "forecast"))
        assert forecast == pytest.approx(measured, rel=5e-3)
        assert abs(of_mean[name].item() - measured) > 0.02 * measured
