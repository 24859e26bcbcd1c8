"""A ship of parts from its trials to its page, its files and its forecasts."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import pymc_ship as ps
from pymc_ship.inference.trajectory.windows import prepared_windows
from pymc_ship.physics.forces.screw import NOMINAL_REVOLUTIONS
from pymc_ship.physics.vessel.parts import FIXED_SD
from pymc_ship.physics.vessel.term_sets import AHEAD_SET, ANY_SPEED_SET, with_terms
from pymc_ship.physics.vessel.vessel import coefficient_names
from pymc_ship.records.steering.recognition import Steering
from pymc_ship.ships.identification.candidates import (
    _windows_ahead,
    default_term_sets,
    fit_candidates,
    modelled_pieces,
    modelled_windows,
    partial_run_remarks,
    with_recorded_effects,
)
from pymc_ship.ships.identification.figures import held_out_windows
from pymc_ship.ships.identification.model import _prepare
from pymc_ship.ships.identification.page import write_ship_report
from pymc_ship.trial.record import OVER_GROUND
from tests.physics.forces.test_parts import AHEAD, tanker
from tests.sentences import refused

SETTINGS = {"duration": 450, "step": 0.5, "method": "rk4"}
SET = "modular"


def known(vessel):
    """The tanker as its papers describe it, without coefficients."""
    return replace(vessel, forces=dict.fromkeys(vessel.forces, ()), parts=(), parameters=())


@pytest.fixture(scope="module")
def truth():
    """A tanker of parts whose wake differs by side."""
    vessel = tanker((*AHEAD, "wind"))
    changed = {"dC2": 0.1, "gamma_R": 0.5, "Nr": -0.003}
    return replace(vessel, parameters=tuple(replace(c, value=changed.get(c.name, c.value)) for c in vessel.parameters))


@pytest.fixture(scope="module")
def trials(truth):
    rng = np.random.default_rng(4)
    runs = [ps.simulate(truth, ps.zigzag(angle, angle), **SETTINGS) for angle in (10, 20)]
    return [ps.pollute(run, level=0.005, rng=rng) for run in runs]


@pytest.fixture(scope="module")
def identification(truth, trials):
    return ps.identify_ship(trials, known(truth), terms=[SET], draws=40, rng=1)


@pytest.fixture(scope="module")
def ship(identification):
    return identification.ship


def test_the_circle_is_forecast_from_the_zigzags(truth, ship):
    turn = ps.turning_circle(35)
    found = ps.forecast(ship, turn, rng=1)["index_bands"]["tactical_diameter"]
    exact = float(ps.indices(ps.simulate(truth, turn, duration=1200, step=0.5, method="rk4"))["tactical_diameter"])
    lower, median, upper = found.values
    assert lower < exact < upper
    assert abs(median / exact - 1.0) < 0.08


@pytest.mark.usefixtures("undrawn")
def test_the_page_shows_every_free_parameter_with_what_was_known_of_it(identification, trials, truth, tmp_path):
    named = dict(zip(identification.names, trials, strict=True))
    write_ship_report(identification, named, {}, tmp_path, command="", seed=1, given=truth)
    text = (tmp_path / "index.html").read_text(encoding="utf-8")
    assert "Parameters of the parts" in text
    for name in ("gamma_R", "w0", "kappa", "R0", "C_X"):
        assert f"<td>{name}</td>" in text
    assert "<td>n_0</td>" not in text
    assert "Kijima" in text


def test_it_is_saved_and_loaded(ship, tmp_path):
    ps.save_ship(ship, tmp_path)
    loaded = ps.load_ship(tmp_path)
    assert loaded.vessel.parts == ship.vessel.parts
    assert coefficient_names(loaded.vessel) == coefficient_names(ship.vessel)
    forecasts = [ps.forecast(one, ps.turning_circle(35), rng=3) for one in (ship, loaded)]
    medians = [float(tree["index_bands"]["advance"].sel(band="median")) for tree in forecasts]
    assert medians[0] == pytest.approx(medians[1], rel=0.01)


def test_forecasts_take_revolutions_wind_and_current(ship):
    turn = ps.turning_circle(35)
    U = ship.vessel.particulars.nominal_speed
    n = ship.vessel.propeller.n
    plain, fast, windy, carried = (
        ps.forecast(ship, turn, rng=1, **around)
        for around in ({}, {"n": 1.1 * n}, {"wind": (2.0 * U, 0.0)}, {"current": (0.5, 0.0)})
    )
    last = {name: float(tree["bands"]["u"].sel(band="median")[-1]) for name, tree in (("p", plain), ("f", fast))}
    assert last["f"] > 1.03 * last["p"]
    assert not np.allclose(windy["bands"]["x"], plain["bands"]["x"], atol=1.0)
    drift = carried["bands"]["x"].sel(band="median") - plain["bands"]["x"].sel(band="median")
    np.testing.assert_allclose(drift, 0.5 * plain["bands"]["time"], atol=1e-6)


def test_a_ship_that_stops_or_goes_astern_takes_parts_for_any_speed(truth, trials):
    slow = trials[0].assign(u=0.1 * trials[0]["u"])
    astern = trials[0].assign(n=("time", np.full(trials[0].sizes["time"], -1.0)))
    assert default_term_sets(_prepare(trials, known(truth), "hull_database"))[0] == AHEAD_SET
    for record in (slow, astern):
        assert default_term_sets(_prepare([record], known(truth), "hull_database")) == (ANY_SPEED_SET,)


def test_speeds_over_ground_bring_a_current(truth, trials):
    vessel = with_terms(known(truth), SET)
    over = [trial.assign_attrs(speeds=OVER_GROUND) for trial in trials]
    assert "current" in with_recorded_effects(vessel, over).parts
    assert with_recorded_effects(vessel, trials).parts == vessel.parts


def with_n(trial, n):
    return trial.assign(n=("time", np.full(trial.sizes["time"], n)))


def test_nominal_revolutions_are_held_where_those_of_the_records_do_not_vary(truth, trials):
    vessel = with_terms(known(truth), SET)

    def freedom(records):
        return {c.name: c.sd for c in with_recorded_effects(vessel, records).parameters}[NOMINAL_REVOLUTIONS]

    assert freedom(trials) == FIXED_SD
    n = truth.propeller.n
    assert freedom([with_n(trials[0], 0.8 * n), with_n(trials[1], n)]) == 0.1
    assert freedom([with_n(trials[0], 0.96 * n), with_n(trials[1], n)]) == FIXED_SD
    with refused(ps.TrialError, 2):
        freedom([with_n(trials[0], truth.propeller.n), trials[1]])


def test_wrong_nominal_revolutions_are_found_from_measured_ones(truth):
    """Of a vessel file that states a tenth too many; without the freedom it would be too fast."""
    runs = [
        with_n(
            ps.simulate(truth, ps.zigzag(20, 20), n=factor * truth.propeller.n, **SETTINGS), factor * truth.propeller.n
        )
        for factor in (0.8, 1.0, 1.2)
    ]
    rng = np.random.default_rng(6)
    runs = [ps.pollute(run, level=0.005, rng=rng) for run in runs]
    wrong = replace(known(truth), propeller=replace(truth.propeller, n=1.1 * truth.propeller.n))
    ship = ps.identify_ship(runs, wrong, terms=[SET], draws=40, rng=1).ship
    vessel, rows = ship.models[0]
    found = rows[:, coefficient_names(vessel).index(NOMINAL_REVOLUTIONS)]
    assert abs(found.mean() - 1.0 / 1.1) < 4.0 * found.std()
    assert found.std() < 0.05
    n = 1.2 * truth.propeller.n
    right = ps.simulate(truth, ps.turning_circle(20), n=n, **SETTINGS)["u"].values[-1]
    own = ps.forecast(ship, ps.turning_circle(20), rng=1, n=n, duration=450.0)["bands"]["u"]
    assert float(own.sel(band="median")[-1]) == pytest.approx(right, rel=0.03)
    assert (
        ps.simulate(replace(truth, propeller=wrong.propeller), ps.turning_circle(20), n=n, **SETTINGS)["u"].values[-1]
        < 0.95 * right
    )


def test_sets_for_a_ship_ahead_take_the_piece_in_which_it_is(truth, trials):
    """A long time at rest is a part of the record for parts at any speed alone."""
    rest = np.where(trials[0]["time"].values < 200.0, 0.05, 1.0)
    whole = trials[0].assign({name: trials[0][name] * rest for name in ("u", "v", "r")})
    (cut,) = modelled_pieces(whole, known(truth))
    assert modelled_pieces(whole, with_terms(known(truth), ANY_SPEED_SET))[0] is whole
    assert float(cut["time"][0]) == pytest.approx(200.0, abs=10.0)
    overruled = ["jumps", "yaw rate", "speed", "track closure"]
    short, kept = (ps.validated_trial(whole, known(truth), overruled, any_speed=each) for each in (False, True))
    assert short.sizes["time"] < whole.sizes["time"]
    assert kept.sizes["time"] == whole.sizes["time"]


def test_records_that_are_ahead_for_the_most_part_decide_between_both_kinds_of_parts(truth, trials):
    """Sets for any speed are fitted to the rest at the begin, too, and judged where the others are."""
    rest = np.where(trials[0]["time"].values < 50.0, 0.05, 1.0)
    begun = [trial.assign({name: trial[name] * rest for name in ("u", "v", "r")}) for trial in trials]
    training = _prepare(begun, known(truth), "hull_database")
    sets = default_term_sets(training)
    assert (sets[0], sets[-1]) == (AHEAD_SET, ANY_SPEED_SET)
    whole, ahead = (with_terms(known(truth), name) for name in (ANY_SPEED_SET, AHEAD_SET))
    for judged, trial in zip(_windows_ahead(training, whole), training.trials, strict=True):
        (piece,) = modelled_pieces(trial, ahead)
        cut = prepared_windows(piece, ahead)
        assert [window.run.start for window in judged] == [window.run.start for window in cut]
        assert judged[0].run.start > 40.0
    found = ps.identify_ship(begun, known(truth), terms=[SET], draws=8, rng=1)
    told = [remark for remark in found.ship.remarks if "sets for a ship ahead were fitted to the piece from " in remark]
    assert [remark.split(":")[0] for remark in told] == ["Run 1", "Run 2"]


def test_every_piece_ahead_that_is_long_enough_counts(truth, trials):
    """The ship stops between two pieces, and a third is too short; windows lie in both and in no other."""
    time, unit = trials[0]["time"].values, truth.particulars.ship_time
    last = time[-1] - 2.0 * unit
    stopped = ((time > 150.0) & (time < 190.0)) | ((time > last - 40.0) & (time < last))
    broken = trials[0].assign({name: trials[0][name] * np.where(stopped, 0.05, 1.0) for name in ("u", "v", "r")})
    ahead = with_terms(known(truth), AHEAD_SET)
    first, second = modelled_pieces(broken, ahead)
    assert float(first["time"][-1]) == pytest.approx(150.0, abs=10.0)
    assert float(second["time"][0]) == pytest.approx(190.0, abs=10.0)
    assert float(second["time"][-1]) == pytest.approx(last - 40.0, abs=10.0)
    starts = [window.run.start for window in modelled_windows(broken, ahead)]
    assert starts == [window.run.start for piece in (first, second) for window in prepared_windows(piece, ahead)]
    training = _prepare([broken, trials[1]], known(truth), "hull_database")
    assert default_term_sets(training)[0] == AHEAD_SET
    candidate = fit_candidates([AHEAD_SET], training, np.random.default_rng(1))[0][0]
    (remark,) = partial_run_remarks(("broken", "whole"), training, [candidate])
    assert remark.startswith("Run broken: sets for a ship ahead were fitted to the pieces from 0 to ")
    assert " and from " in remark
    assert len(held_out_windows(candidate, [broken, trials[1]], 0)) == len(modelled_windows(training.trials[0], ahead))


def test_revolutions_that_are_given_are_not_those_of_a_facility(ship, truth):
    facilities = {"basin": Steering(2.35, 2.5, 4, approach_speed=6.0)}
    one = replace(ship, index_error={}, facilities=facilities)
    asked = {"rng": 1, "facility": "basin", "duration": 100.0}
    own = ps.forecast(one, ps.turning_circle(20), **asked)
    given = ps.forecast(one, ps.turning_circle(20), n=truth.propeller.n, **asked)
    assert own.attrs["approach_speed"] == 6.0
    assert given.attrs["approach_speed"] == truth.particulars.nominal_speed
