"""Page of a score: what it says, draws and tables."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import pymc_ship as ps
from pymc_ship.physics.vessel.vessel import reference_coefficients
from pymc_ship.ships.ensemble.index_table import index_rows, index_table
from pymc_ship.ships.forecasting.forecast import recorded_forecast
from pymc_ship.ships.forecasting.page import measured_doubts
from pymc_ship.ships.identification.replay import channel_rows, index_errors
from pymc_ship.ships.identification.score_page import _missed, errors_by_channel, windows_of, write_score_page
from tests.physics.forces.test_parts import AHEAD
from tests.physics.forces.test_parts import tanker as by_parts
from tests.replication.cases import Page
from tests.ships.ensemble.cases import ship_of

SETTINGS = {"duration": 600, "step": 0.5, "method": "rk4"}


def altered(name, factor):
    """The tanker with another value of a coefficient."""
    vessel = ps.load_vessel("kvlcc2")
    values = {dof: vessel.coefficients(dof).values.copy() for dof in vessel.dofs}
    for dof, row in values.items():
        names = list(vessel.coefficients(dof)["coefficient"].values)
        if name in names:
            row[names.index(name)] *= factor
    return vessel.with_coefficients(values)


@pytest.fixture(scope="module")
def records():
    vessel = ps.load_vessel("kvlcc2")
    hand = ps.simulate(vessel, ps.zigzag(20, 20), **SETTINGS)
    return {"zigzag": hand, "random": hand.isel(time=slice(400, 900))}


@pytest.fixture(scope="module")
def scored(records):
    ship = altered("Ngsincos", 0.9)
    found = ps.score(ship, list(records.values()), names=list(records), length=150)
    return ship, found, ps.score_indices(ship, list(records.values()), names=list(records), rng=2020)


def test_missed_indices_head_the_page():
    rows = [{"run": "z", "index": name, "inside": inside} for name, inside in (("a", "no"), ("b", "yes"), ("c", ""))]
    assert _missed(rows) == "1 of 2 measured indices lie outside the intervals of 95 %: a of z."
    assert _missed(rows[1:]) == ""


def test_indices_of_recorded_manoeuvres_stand_beside_the_forecasts(scored):
    """Less moment of the rudder: it begins to turn later and is checked later."""
    _, _, table = scored
    assert table["run"].values.tolist() == ["zigzag"]
    later = (table["forecast"] - table["measured"]).sel(run="zigzag")
    assert later.sel(index="first_overshoot_angle") > 0.1
    assert later.sel(index="initial_turning_time") > 1.0
    assert (table["sd"] == 0.0).all()


def test_an_identified_ship_has_intervals_of_indices(records):
    vessel = ps.load_vessel("kvlcc2")
    row = reference_coefficients(vessel)
    draws = row * (1.0 + 0.01 * np.random.default_rng(1).standard_normal((30, row.size)))
    ship = ship_of((vessel, draws), index_error={"angle": np.array([0.05])})
    tables = (ps.score_indices(one, [records["zigzag"]], rng=2020) for one in (ship, replace(ship, index_error={})))
    found, plain = (list(index_rows(table)) for table in tables)
    (wide,), (narrow,) = ([row for row in rows if row["index"] == "first_overshoot_angle"] for rows in (found, plain))
    assert wide["sd"] > narrow["sd"] > 0.0
    assert wide["sd"] == pytest.approx(np.hypot(narrow["sd"], 0.05 * wide["scale"]))
    off = wide | {"run": "2", "measured": wide["forecast"] + 2.0 * wide["sd"]}
    assert [shown["inside"] for shown in index_errors(index_table([wide, off]))] == ["yes", "no"]


def test_the_intervals_of_a_score_are_those_of_the_forecast(records):
    """A skew law: its quantiles lie elsewhere than the sd on both sides of the estimate."""
    vessel = ps.load_vessel("kvlcc2")
    row = reference_coefficients(vessel)
    draws = row * (1.0 + 0.05 * np.random.default_rng(1).exponential(size=(60, 1)) * (row < 0.0))
    ship = ship_of((vessel, draws), index_error={"angle": np.array([0.02])})
    table = ps.score_indices(ship, [records["zigzag"]], rng=2020)
    (manoeuvre,), _ = ps.recognise([records["zigzag"]], vessel)
    bands = ps.forecast(ship, manoeuvre, rng=2020)["index_bands"]
    errors = {line["index"]: line for line in index_errors(table)}
    for name in table["index"].values:
        lower, _, upper = bands[name].values
        assert (table["lower"].sel(index=name).item(), table["upper"].sel(index=name).item()) == (lower, upper), name
        measured = table["measured"].sel(index=name).item()
        assert errors[name.replace("_", " ")]["inside"] == ("yes" if lower <= measured <= upper else "no")


def test_a_forecast_of_a_record_has_its_wind():
    """Term sets without forces of wind are simulated without it."""
    windy, still = by_parts((*AHEAD, "wind")), by_parts(AHEAD)
    run = ps.simulate(windy, ps.turning_circle(35), duration=900, step=0.5, wind=(12.0, 60.0))
    size = run.sizes["time"]
    blown = {"wind_speed": np.full(size, 12.0), "wind_direction": np.full(size, np.deg2rad(60.0))}
    trial = run.assign({name: ("time", values) for name, values in blown.items()})
    manoeuvre = ps.turning_circle(35, approach_speed=float(run["u"][0]))
    ships = [
        ship_of(*((one, np.tile(reference_coefficients(one), (2, 1))) for one in of))
        for of in ((windy,), (windy, still))
    ]
    one, two = (recorded_forecast(ship, manoeuvre, trial, rng=np.random.default_rng(1)) for ship in ships)
    found, calm = (tree["indices"]["tactical_diameter"].values for tree in (one, two))
    assert found == pytest.approx(float(ps.indices(run)["tactical_diameter"]), rel=2e-3)
    assert calm[:2] == pytest.approx(found)
    assert abs(calm[2] / found[0] - 1.0) > 0.01
    assert one.attrs["wind_speed"] == two.attrs["wind_speed"] == pytest.approx(12.0)
    assert measured_doubts({"a": trial}, {"a": one}) == []
    assert "12 m/s from 60 deg" in one.attrs["steering"]
    assert "1 of 2 term sets have no forces of wind." in two.attrs["steering"]


def test_a_forecast_of_a_record_has_its_revolutions():
    """Those of a record at less than the usual ones; term sets without a propeller are simulated without."""
    parts, terms = by_parts(AHEAD), ps.load_vessel("kvlcc2")
    slow = 0.8 * parts.propeller.n
    run = ps.simulate(parts, ps.turning_circle(35), duration=900, step=0.5, n=slow)
    trial = run.assign(n=("time", np.full(run.sizes["time"], slow)))
    manoeuvre = ps.turning_circle(35, approach_speed=float(run["u"][0]))
    of_parts, of_terms = ((one, np.tile(reference_coefficients(one), (2, 1))) for one in (parts, terms))
    settings = {"rng": np.random.default_rng(1), "duration": 900}
    one, two, none = (
        recorded_forecast(ship_of(*of), manoeuvre, trial, **settings)
        for of in ((of_parts,), (of_parts, of_terms), (of_terms,))
    )
    true = ps.indices(run)["time_to_180"]
    assert one["indices"]["time_to_180"].values == pytest.approx(float(true), rel=2e-3)
    assert not any(row["surroundings"] for row in ps.imo_probabilities(one, parts))
    nominal = ps.forecast(ship_of(of_parts), manoeuvre, **settings)["indices"]["time_to_180"].values
    assert nominal.max() < 0.99 * float(true)
    stated = f"The forecast has the median revolutions of the record, {60.0 * slow:.3g} 1/min."
    assert stated in one.attrs["steering"]
    assert f"{stated} 1 of 2 term sets have no revolutions." in two.attrs["steering"]
    assert "revolutions of the record" not in none.attrs["steering"]


def test_the_page_has_every_table_and_figure(scored, records, tmp_path):
    ship, found, rows = scored
    page = write_score_page(ship, records, found, rows, tmp_path, draws=1, command="pymc-ship score")
    text = page.read_text(encoding="utf-8")
    assert "kvlcc2: score on 2 records" in text
    assert f"Score {found.attrs['score']:.3g}: " in text
    assert "One ship has no bands" in text
    assert "interval of 95 %" not in text
    assert "first overshoot angle" in text
    assert {path.name for path in tmp_path.glob("*/*")} == {
        *("score_channels.png", "score_windows.png"),
        *("score_channels.csv", "score_runs.csv", "score_indices.csv"),
    }
    assert Page(text)


def test_the_figures_draw_the_errors_and_the_windows(scored, records):
    ship, found, _ = scored
    left, right = errors_by_channel(found).axes
    dots = [line for line in left.lines if line.get_marker() == "o"]
    assert [line.get_ydata().tolist() for line in dots] == found["relative"].values.tolist()
    assert right.lines[-1].get_ydata()[0] == 90.0
    fig = windows_of(ship, records, 150.0, 150.0, 1, ci_prob=0.9)
    assert [ax.get_title() for ax in fig.axes[:2]] == ["zigzag", "random"]
    measured, ship_line = fig.axes[0].lines[0], fig.axes[0].lines[1]
    assert measured.get_ydata()[0] == pytest.approx(ship_line.get_ydata()[0], rel=1e-3)
    assert len([line for line in fig.axes[0].lines if line.get_marker() == "o"]) == 3


def test_a_ship_that_diverges_has_no_score(records, tmp_path):
    ship = altered("Nr", -20.0)
    found = ps.score(ship, records["zigzag"], names=["zigzag"], length=150)
    assert np.isnan(found.attrs["score"])
    assert any(np.isnan(row["rmse"]) for row in channel_rows(found))
    page = write_score_page(ship, {"zigzag": records["zigzag"]}, found, index_table(()), tmp_path, draws=1, command="x")
    text = page.read_text(encoding="utf-8")
    assert "No score: the simulation diverges in a window of a run." in text
    assert "No record is a standard manoeuvre." in text
