"""Corrections for current, wind and loading give the indices in calm at full load."""

from dataclasses import replace

import numpy as np
import pytest
import xarray as xr

import pymc_ship as ps
from pymc_ship.records.steering.current import drift_current
from pymc_ship.ships.sea_trials import corrections
from pymc_ship.ships.sea_trials.conditions import Conditions
from pymc_ship.ships.sea_trials.corrections import mean_wind
from pymc_ship.trial.record import OVER_GROUND
from tests.ships.ensemble.cases import ship_of
from tests.ships.sea_trials.cases import CURRENT, WIND, run_record, ship, tanker

DAY = {"form": {"date": "2026-05-04"}}
FINE = 0.5  # s
CIRCLE, ZIGZAG = ps.turning_circle(35), ps.zigzag(10, 10)


@pytest.fixture(scope="module")
def day():
    """Two turns and two zigzags in wind and current, read by noisy sensors."""
    rng = np.random.default_rng(5)
    runs = {"circle": run_record(CIRCLE, 2400, step=FINE), "zigzag": run_record(ZIGZAG, 1200, step=FINE)}
    sd = {"x": 1.0, "y": 1.0, "psi": 0.002, "r": 2e-4, "u": 0.03, "v": 0.03}
    return {
        name: run.assign({key: run[key] + s * rng.standard_normal(run.sizes["time"]) for key, s in sd.items()})
        for name, run in runs.items()
    }


@pytest.fixture
def few_draws(monkeypatch):
    """Draws of a test that is of no uncertainty."""
    monkeypatch.setattr(corrections, "DRAWS", 10)


def rows_of(result, run):
    return {row["index"]: row for row in result.indices if row["run"] == run}


@pytest.fixture(scope="module")
def calm():
    """Indices in calm, distances in L."""
    calm_indices = {}
    for name, manoeuvre, duration in (("circle", CIRCLE, 2400), ("zigzag", ZIGZAG, 1200)):
        ds = ps.indices(run_record(manoeuvre, duration, wind=None, current=None, step=FINE))
        L = tanker().particulars.L
        calm_indices[name] = {k: float(ds[k]) / (L if ds[k].attrs["units"] == "m" else 1.0) for k in ds}
    return calm_indices


@pytest.fixture(scope="module")
def corrected(day):
    return ps.sea_trial(day, tanker(), ship=ship(), conditions=DAY, rng=1)


@pytest.mark.usefixtures("few_draws")
def test_a_run_that_is_given_twice_is_named():
    run = run_record(ZIGZAG, 600, wind=None, current=None)
    other = run_record(ps.zigzag(10, 10, side="starboard"), 600, wind=None, current=None)
    named = [one for one in ps.sea_trial({"a": run, "b": other, "c": run}, tanker(), rng=1).remarks if "motion" in one]
    assert [one.split(" are ")[0] for one in named] == ["Runs a and c"]


@pytest.mark.parametrize(
    ("run", "index"),
    [
        ("circle", "advance"),
        ("circle", "tactical_diameter"),
        ("circle", "transfer"),
        ("zigzag", "first_overshoot_angle"),
        ("zigzag", "second_overshoot_angle"),
        ("zigzag", "initial_turning_distance"),
    ],
)
def test_corrected_indices_are_those_of_the_ship_in_calm(corrected, calm, run, index):
    """Within three standard uncertainties; the error of the index as measured is larger."""
    row = rows_of(corrected, run)[index]
    error = row["corrected"] - calm[run][index]
    assert abs(error) < 3.0 * row["u_c"] + 0.02 * abs(calm[run][index])
    assert abs(error) < 0.5 * abs(row["raw"] - calm[run][index]) or abs(row["raw"] - calm[run][index]) < row["U"]


@pytest.fixture(scope="module")
def measured(day):
    return ps.sea_trial(day, tanker(), rng=1)


def test_without_a_ship_wind_is_not_corrected_and_the_uncertainty_unknown(measured):
    result = measured
    row = rows_of(result, "circle")["advance"]
    assert row["ratio"] == 1.0
    assert np.isnan(row["U"])
    assert np.isnan(row["u_model"])
    assert row["conformity"] == "met as measured"
    assert "The indices are not corrected for wind: that needs an identified ship." in result.remarks


@pytest.mark.usefixtures("few_draws")
def test_an_index_that_the_model_does_not_reach_has_no_uncertainty(monkeypatch, day):
    monkeypatch.setattr(corrections, "_ratios", lambda *given: {"advance": np.full(5, 1.1)})
    rows = rows_of(ps.sea_trial({"circle": day["circle"]}, tanker(), ship=ship(), rng=1), "circle")
    assert rows["advance"]["ratio"] == 1.1
    assert np.isfinite(rows["advance"]["U"])
    assert rows["transfer"]["ratio"] == 1.0
    assert np.isnan(rows["transfer"]["U"])


@pytest.mark.usefixtures("few_draws")
def test_without_a_turn_angles_have_an_uncertainty_and_distances_none():
    result = ps.sea_trial({"zigzag": run_record(ZIGZAG, 1200, wind=None)}, tanker(), rng=1)
    rows = rows_of(result, "zigzag")
    assert np.isnan(rows["initial_turning_distance"]["U"])
    assert np.isfinite(rows["first_overshoot_angle"]["U"])
    assert any("as no run gives it" in remark for remark in result.remarks)


def test_a_zigzag_of_the_day_takes_the_current_of_the_turn(corrected):
    np.testing.assert_array_equal(corrected.currents["zigzag"].velocity, corrected.currents["circle"].velocity)
    assert corrected.currents["zigzag"].speed == pytest.approx(CURRENT[0], abs=0.05)
    assert rows_of(corrected, "zigzag")["initial_turning_distance"]["corrected_for"] == "drift and wind"


@pytest.mark.usefixtures("few_draws")
def test_drift_in_wind_or_of_an_unknown_day_is_of_its_own_run(day, measured):
    """In the twin of one day without wind the zigzag takes the drift."""
    other_day = ps.sea_trial(day, tanker(), ship=ship(), rng=1)
    in_wind = ps.sea_trial(day, tanker(), conditions=DAY, rng=1)
    for result, reason in ((other_day, "no date states"), (measured, "that of their wind"), (in_wind, "of their wind")):
        assert set(result.currents) == {"circle"}
        assert any(reason in remark and "not subtracted from zigzag" in remark for remark in result.remarks)
        row = rows_of(result, "zigzag")["initial_turning_distance"]
        assert row["without_current"] == row["raw"]
        assert "drift" not in row["corrected_for"]
    assert any("that of current and wind together" in remark for remark in in_wind.remarks)
    calm = {name: run.drop_vars(["wind_speed", "wind_direction"]) for name, run in day.items()}
    assert set(ps.sea_trial(calm, tanker(), conditions=DAY, rng=1).currents) == {"circle", "zigzag"}


@pytest.mark.usefixtures("few_draws")
def test_a_drift_below_its_own_error_is_not_subtracted():
    """In a current of 0.6 m/s the twin is corrected; positions have an error of 8 m."""
    rng = np.random.default_rng(4)
    for current, name in (((0.002, 90.0), "nothing"), ((0.6, 90.0), "drift")):
        run = run_record(CIRCLE, 2400, wind=None, current=current)
        noise = {key: run[key] + 8.0 * rng.standard_normal(run.sizes["time"]) for key in ("x", "y")}
        result = ps.sea_trial({"circle": run.assign(noise)}, tanker(), rng=1)
        row = rows_of(result, "circle")["tactical_diameter"]
        assert row["corrected_for"] == name
        assert (row["corrected"] == row["raw"]) == (name == "nothing")
        assert np.isfinite(row["U"])
        assert any("region of 95 % includes 0" in remark for remark in result.remarks) == (name == "nothing")


def test_another_loading_is_that_of_a_ship_as_far_from_its_formulae(calm):
    """In calm R = T F / B is F: the draws have the same standardised deviations at both draughts."""
    light = replace(tanker(), particulars=replace(tanker().particulars, d=15.0, volume=222000.0), derived={})
    light = ps.with_terms(replace(light, m=0.0136, parameters=(), parts=()), "modular at any speed")
    one = replace(ship(), members=ship_of((light, np.array([[c.value for c in light.parameters]] * 2))).members)
    run = run_record(CIRCLE, 2400, wind=None, current=None, vessel=light)
    result = rows_of(ps.sea_trial({"circle": run}, light, ship=one, full_load=tanker(), rng=1), "circle")
    assert result["tactical_diameter"]["corrected"] == pytest.approx(calm["circle"]["tactical_diameter"], rel=0.01)
    assert abs(result["tactical_diameter"]["raw"] / calm["circle"]["tactical_diameter"] - 1.0) > 0.03


@pytest.mark.usefixtures("few_draws")
def test_the_same_seed_gives_the_same_rows_and_another_does_not(day):
    runs = {"zigzag": day["zigzag"]}
    first, again, other = (ps.sea_trial(runs, tanker(), rng=seed).indices for seed in (1, 1, 2))
    assert repr(first) == repr(again)
    assert repr(first) != repr(other)


def test_the_wind_is_that_of_the_record_or_else_as_noted():
    noted = Conditions(wind=(5.0, 10.0))
    assert mean_wind(run_record(ZIGZAG, 60, wind=None), noted) == (5.0, 10.0)
    speed, come = mean_wind(run_record(ZIGZAG, 60), noted)
    assert (speed, come) == (pytest.approx(WIND[0]), pytest.approx(WIND[1]))
    assert mean_wind(xr.Dataset(), Conditions()) is None


def turned(run, course):
    """The same run on another course, wind and current turned with it."""
    track = (run["x"].values + 1j * run["y"].values) * np.exp(1j * course)
    channels = {"x": track.real, "y": track.imag, "psi": run["psi"].values + course}
    channels["wind_direction"] = run["wind_direction"].values + course
    return run.assign({name: ("time", values) for name, values in channels.items()})


@pytest.mark.usefixtures("few_draws")
def test_the_course_of_a_run_does_not_matter(day):
    course = np.deg2rad(130.0)
    runs = {"circle": day["circle"], "turned": turned(day["circle"], course)}
    result = ps.sea_trial(runs, tanker(), ship=ship(), rng=1)
    plain, other = (rows_of(result, run) for run in runs)
    for name in ("advance", "tactical_diameter", "transfer"):
        assert other[name]["ratio"] == pytest.approx(plain[name]["ratio"], rel=1e-6)
        assert other[name]["corrected"] == pytest.approx(plain[name]["corrected"], rel=2e-3)
    flows = [result.currents[run].velocity @ (1.0, 1j) for run in runs]
    assert flows[1] == pytest.approx(flows[0] * np.exp(1j * course), abs=0.01)


def test_the_current_is_subtracted_from_velocities_over_ground_only():
    run = run_record(ZIGZAG, 200, wind=None)
    velocity = np.array([0.3, -0.2])
    ground = run.assign(
        {name: run[name] + part for name, part in zip("uv", body(velocity, run["psi"].values), strict=True)}
    )
    marked = ground.assign_attrs(speeds=OVER_GROUND)
    for name in "uv":
        np.testing.assert_allclose(corrections.without_current(marked, velocity)[name], run[name], atol=1e-12)
        np.testing.assert_array_equal(corrections.without_current(ground, velocity)[name], ground[name])


def body(velocity, psi):
    flow = (velocity[0] + 1j * velocity[1]) * np.exp(-1j * psi)
    return flow.real, flow.imag


@pytest.mark.usefixtures("few_draws")
def test_the_scatter_of_circles_is_in_the_current_of_other_runs():
    runs = {
        "east": run_record(CIRCLE, 2400, wind=None, current=(0.3, 90.0)),
        "more": run_record(ps.turning_circle(35, side="starboard"), 2400, wind=None, current=(0.5, 90.0)),
        "zigzag": run_record(ZIGZAG, 900, wind=None),
    }
    result = ps.sea_trial(runs, tanker(), conditions=DAY, rng=1).currents
    assert result["zigzag"].velocity[1] == pytest.approx(0.4, abs=0.01)
    assert result["zigzag"].sd[1] == pytest.approx(0.2 / np.sqrt(2.0), abs=0.01)
    assert result["east"].sd[1] < 0.02


def test_the_current_is_that_of_the_day(day):
    assert drift_current(day["circle"]).speed < 2.0 * CURRENT[0]


def turned_frame(run, angle):
    """Record whose heading and position count from another direction."""
    cos, sin = np.cos(angle), np.sin(angle)
    x, y = run["x"].values, run["y"].values
    axes = {"psi": run["psi"].values + angle, "x": cos * x - sin * y, "y": sin * x + cos * y}
    return run.assign({name: ("time", values) for name, values in axes.items()})


@pytest.mark.usefixtures("few_draws")
def test_a_run_whose_log_shows_another_drift_does_not_take_that_of_the_circle():
    """Its axes are turned by 90 deg; the twin, and a run without a log, take it."""
    circle, zigzag = (
        run_record(one, time, wind=None, current=(0.8, 30.0)) for one, time in ((CIRCLE, 2400), (ZIGZAG, 1200))
    )
    runs = {"same": zigzag, "turned": turned_frame(zigzag, 0.5 * np.pi), "no log": zigzag.drop_vars("v")}
    result = ps.sea_trial({"circle": circle, **runs}, tanker(), conditions=DAY, rng=1)
    assert set(result.currents) == {"circle", "same", "no log"}
    (remark,) = [one for one in result.remarks if "log and track" in one]
    assert "0.8 m/s to 30 deg" in remark
    assert "0.8 m/s to 120 deg" in remark
    row = rows_of(result, "turned")["initial_turning_distance"]
    assert (row["corrected"], row["corrected_for"]) == (row["raw"], "nothing")


@pytest.mark.usefixtures("few_draws")
def test_velocities_that_drift_with_the_track_of_a_circle_are_doubted():
    """The circle's u and v are over ground; those through the water of the twin are not doubted."""
    run = run_record(CIRCLE, 2400, wind=None, current=(0.8, 40.0))
    flow = 0.8 * np.exp(1j * (np.deg2rad(40.0) - run["psi"].values))
    ground = run.assign(u=run["u"] + flow.real, v=run["v"] + flow.imag)
    for record, doubted in ((run, False), (ground, True), (ground.assign_attrs(speeds=OVER_GROUND), False)):
        result = ps.sea_trial({"circle": record}, tanker(), rng=1)
        assert any("over ground" in one and "drifts by 0.8 m/s" in one for one in result.remarks) == doubted
        row = rows_of(result, "circle")["steady_turning_diameter"]
        assert (row["corrected_for"] == "drift") == (row["corrected"] != row["raw"])
        assert (row["corrected_for"] == "drift") == (record.attrs.get("speeds") == OVER_GROUND)


@pytest.fixture(scope="module")
def stop():
    """A stopping test on a course of 0, as made by hand: constant deceleration from 7 m/s after 60 s."""
    time = np.arange(0.0, 800.0)
    u = np.clip(7.0 - 0.01 * np.clip(time - 60.0, 0.0, None), -0.05, None)
    n = np.interp(time, [0.0, 60.0, 90.0], [1.5, 1.5, -1.0])
    x = np.concatenate([[0.0], np.cumsum(0.5 * (u[1:] + u[:-1]))])
    channels = {"u": u, "v": 0.0 * u, "r": 0.0 * u, "psi": 0.0 * u, "x": x, "y": 0.0 * u, "n": n, "delta": 0.0 * u}
    return xr.Dataset({name: ("time", values) for name, values in channels.items()}, {"time": time})


def test_the_current_of_the_day_is_subtracted_from_a_stopping_test(stop):
    """0.4 m/s from astern for 700 s; without a date the twin keeps it, and a remark says so."""
    circle = run_record(CIRCLE, 2400, wind=None, current=(0.4, 0.0))
    drifted = stop.assign(x=stop["x"] + 0.4 * stop["time"])
    still = rows_of(ps.sea_trial({"stop": stop}, tanker(), rng=1), "stop")["track_reach"]
    dated = ps.sea_trial({"circle": circle, "stop": drifted}, tanker(), conditions=DAY, rng=1)
    row = rows_of(dated, "stop")["track_reach"]
    assert row["raw"] == pytest.approx(still["raw"] + 0.4 * 700.0 / tanker().particulars.L, rel=2e-3)
    assert row["corrected"] == pytest.approx(still["raw"], rel=2e-3)
    assert row["corrected_for"] == "drift"
    sd = dated.currents["stop"].sd[0] * 700.0 / tanker().particulars.L
    assert row["u_current"] == pytest.approx(sd, rel=0.3)
    undated = ps.sea_trial({"circle": circle, "stop": drifted}, tanker(), rng=1)
    assert rows_of(undated, "stop")["track_reach"]["corrected_for"] == "nothing"
    assert np.isnan(rows_of(undated, "stop")["track_reach"]["u_current"])
    assert any("not subtracted from stop" in one for one in undated.remarks)


@pytest.mark.usefixtures("few_draws")
def test_a_noted_wind_beside_headings_that_begin_at_0_is_told():
    """Not without a wind, and not on another course."""
    run = run_record(CIRCLE, 1500, wind=None)
    run = run.assign(psi=run["psi"] - float(run["psi"][0]))
    noted = {"wind": {"speed": 8.0, "from": 200.0}}
    cases = ((run, noted, True), (run, {}, False), (turned_frame(run, 0.5), noted, False))
    for record, conditions, told in cases:
        remarks = ps.sea_trial({"circle": record}, tanker(), conditions=conditions, rng=1).remarks
        assert any("heading of circle begins at 0" in remark for remark in remarks) == told
