"""A manoeuvre that the package does not know, a kick of the rudder, becomes one of its own by a single registration.

The rudder is put over, and amidships once the heading has changed by so much; a ship that is stable on a straight
course then stops turning. Everything that follows uses the package as it is: simulator, indices, forecast and its page,
recognition, held-out indices, a grid of experiments and the command line.
"""

from __future__ import annotations

import csv
import math
from dataclasses import replace

import numpy as np
import pytest
import xarray as xr

import pymc_ship as ps
from pymc_ship.cli.main import main
from pymc_ship.cli.parser import parser
from pymc_ship.experiments.run import read_study
from pymc_ship.physics.forces.terms import SYMBOLS
from pymc_ship.physics.manoeuvre.criteria import imo_criteria
from pymc_ship.physics.manoeuvre.kinds import SIDES, Index, ManoeuvreKind
from pymc_ship.physics.manoeuvre.registry import KINDS, register_manoeuvre
from pymc_ship.physics.manoeuvre.standard import Manoeuvre, standard_manoeuvre, written_manoeuvre
from pymc_ship.physics.vessel.vessel import reference_coefficients
from pymc_ship.ships.forecasting.page import index_rows, write_forecast_page
from pymc_ship.ships.identification.held_out import forecast_rows
from tests.sentences import refused
from tests.ships.ensemble.cases import ship_of
from tests.ships.forecasting.cases import SETTINGS, forecast, posterior, scattered, trial

DURATION, SHORT = 200.0, 90.0
"""Durations [s]: in the first every ship loses half of its yaw rate, in the second some draws of a forecast do."""


def measure(record, attrs):
    """Yaw rate at the end, and time from the switching heading until half the yaw rate there is lost."""
    begin = record.crossing(math.radians(attrs["heading_deg"]), SIDES[attrs["side"]])
    if not math.isfinite(begin):
        return {}
    rate = np.abs(record.psi_dot)
    slow = np.flatnonzero((record.time > begin) & (rate < 0.5 * np.interp(begin, record.time, rate)))
    indices = {"time_to_midships": begin - record.time[0], "residual_yaw_rate": math.degrees(rate[-1])}
    return indices | ({"time_to_half_rate": record.time[slow[0]] - begin} if slow.size else {})


def recognise(helm):
    """Rudder angle, heading and side of a rudder that goes back amidships and stays there."""
    delta, psi = helm.trial["delta"].values, np.rad2deg(np.unwrap(helm.trial["psi"].values))
    angle = delta[np.argmax(np.abs(delta))]
    if abs(angle) < 0.1 or abs(delta[-1]) > 0.01:
        return None
    back = np.flatnonzero(np.abs(delta) > 0.99 * abs(angle))[-1]
    heading = psi[back] - psi[0]
    return (helm.ordered_angle(np.rad2deg(abs(angle))), round(abs(heading))), "starboard" if heading > 0.0 else "port"


RUDDER_KICK = ManoeuvreKind(
    name="rudder_kick",
    angles=("rudder_deg", "heading_deg"),
    example="20/40",
    option="rudder-kick",
    title="rudder-kick",
    second_execute_factor=0.0,
    indices={
        "time_to_midships": Index("time", scored=True),
        "time_to_half_rate": Index("time", ("psi", "r"), scored=True),
        "residual_yaw_rate": Index("rate", ("psi", "r")),
    },
    measure=measure,
    recognise=recognise,
    reach=30.0,
)


@pytest.fixture(scope="module", autouse=True)
def registered():
    register_manoeuvre(RUDDER_KICK)
    yield
    del KINDS["rudder_kick"]


@pytest.fixture(scope="module")
def rudder_kick():
    return standard_manoeuvre("rudder_kick", 20, 40, side="starboard")


@pytest.fixture(scope="module")
def tree(container, rudder_kick):
    """Forecast in which some ships keep more than half their yaw rate."""
    return forecast(container, rudder_kick, SHORT, scattered(container, spread=0.1))


def simulated(vessel, manoeuvre, duration=DURATION, **settings):
    return ps.simulate(vessel, manoeuvre, duration=duration, **SETTINGS, **settings)


class TestSimulation:
    @pytest.mark.parametrize(("side", "sign"), [("starboard", 1.0), ("port", -1.0)])
    def test_the_rudder_goes_amidships_at_the_heading_and_stays_there(self, container, rudder_kick, side, sign):
        run = simulated(container, replace(rudder_kick, side=side))
        delta, psi = -sign * np.rad2deg(run["delta"].values), sign * np.rad2deg(run["psi"].values)
        assert delta.max() == pytest.approx(20.0, abs=1e-9)
        returned = np.flatnonzero(np.diff(delta) < 0.0)
        assert abs(psi[returned[0]] - 40.0) < 1.0
        assert np.abs(delta[returned[-1] + 1 :]).max() == 0.0
        assert len(delta) - returned[-1] > 100
        assert run.attrs["manoeuvre"] == "rudder_kick"

    def test_the_delay_of_the_gear_counts(self, container, rudder_kick):
        slow = replace(container, particulars=replace(container.particulars, rudder_delay=5.0))
        back = [
            int(np.flatnonzero(np.diff(simulated(one, rudder_kick)["delta"]) > 0.0)[0]) for one in (container, slow)
        ]
        assert 0.5 * (back[1] - back[0]) == pytest.approx(5.0, abs=0.6)


class TestIndices:
    def test_they_are_those_of_the_record(self, container, rudder_kick):
        run = simulated(container, rudder_kick)
        measured = ps.indices(run)
        assert set(measured.data_vars) == set(RUDDER_KICK.indices)
        psi = np.rad2deg(run["psi"].values)
        assert float(np.interp(measured["time_to_midships"], run["time"], psi)) == pytest.approx(40.0, abs=0.01)
        assert float(measured["residual_yaw_rate"]) == pytest.approx(abs(np.rad2deg(float(run["r"][-1]))), rel=0.02)
        assert [measured[name].attrs["units"] for name in RUDDER_KICK.indices] == ["s", "s", "deg/s"]

    def test_a_record_that_ends_before_has_none(self, container, rudder_kick):
        measured = ps.indices(simulated(container, rudder_kick, duration=20.0))
        assert np.isnan([float(value) for value in measured.data_vars.values()]).all()

    def test_no_criterion_of_the_imo_applies(self, container):
        angles = simulated(container, standard_manoeuvre("rudder_kick", 10, 10))
        assert imo_criteria(ps.indices(angles), container) == []

    def test_a_record_is_recognised_and_measured_as_one(self, container, rudder_kick):
        run, record = trial(container, rudder_kick, DURATION)
        (recognised,), _ = ps.recognise([record], container)
        assert recognised.label == rudder_kick.label
        model = [(container, np.tile(reference_coefficients(container), (3, 1)))]
        rows = forecast_rows("own", record, recognised, model, np.ones(1))
        assert [(row["index"], row["kind"]) for row in rows] == [(name, "time") for name in RUDDER_KICK.scored]
        assert rows[0]["measured"] == pytest.approx(float(ps.indices(run)["time_to_midships"]), rel=0.02)

    def test_other_records_are_still_recognised_as_before(self, container):
        manoeuvres = ps.zigzag(20.0, 20.0), ps.turning_circle(35.0)
        records = [simulated(container, one, duration=300.0) for one in manoeuvres]
        assert [one.label for one in ps.recognise(records, container)[0]] == [one.label for one in manoeuvres]


class TestForecast:
    def test_it_has_bands_and_intervals(self, tree):
        assert tree.attrs["label"] == "rudder kick 20/40 starboard"
        assert set(tree["index_bands"].data_vars) == set(RUDDER_KICK.indices)
        reached = np.isfinite(tree["indices"]["time_to_half_rate"].values)
        assert 0.0 < reached.mean() < 1.0
        lower, median, upper = tree["index_bands"]["time_to_half_rate"].values
        assert 0.0 < lower < median < upper

    @pytest.mark.usefixtures("undrawn")
    def test_the_page_shows_it_beside_a_measured_one(self, container, rudder_kick, tree, tmp_path):
        measured = {"rudder kick 20/40 starboard": trial(container, rudder_kick, DURATION)[1]}
        page = write_forecast_page(container, {tree.attrs["label"]: tree}, tmp_path, measured=measured)
        text = page.read_text(encoding="utf-8")
        assert "Rudder kick 20/40 starboard" in text
        assert "No criterion of IMO MSC.137(76) applies to these manoeuvres." in text
        assert "reached by % of the draws" in text
        assert "switching headings" not in text
        stem = "forecast_rudder_kick_20_40_starboard"
        drawn = {path.stem for path in (tmp_path / "figures").iterdir()}
        of_section = {f"{stem}_{name}" for name in ("track", "heading_and_rudder", "motion")}
        assert drawn == {"forecast_forces", "forecast_overview"} | of_section
        with (tmp_path / "tables" / f"{stem}.csv").open() as file:
            rows = {row["index"]: row for row in csv.DictReader(file)}
        assert list(rows) == ["time to midships", "time to half rate", "residual yaw rate"]
        assert float(rows["time to midships"]["error"]) < 10.0
        assert float(rows["time to half rate"]["reached"]) < 1.0

    @pytest.mark.usefixtures("undrawn")
    def test_the_page_copes_where_no_ship_reaches_the_event(self, container, rudder_kick, tmp_path):
        short = forecast(container, rudder_kick, 20.0)
        assert {row["reached"] for row in index_rows(short, container)} == {0.0}
        text = write_forecast_page(container, {"short": short}, tmp_path).read_text(encoding="utf-8")
        assert "nan" not in text.split('id="repeat"')[0].split("<svg")[0]

    def test_that_of_an_identified_ship_lasts_as_long_as_the_manoeuvre_reaches(self, container, rudder_kick):
        rows = scattered(container, draws=4, spread=0.001)
        motion = xr.DataArray(
            np.random.default_rng(1).normal(size=(50, len(SYMBOLS))), {"symbol": list(SYMBOLS)}, ("row", "symbol")
        )
        ship = ship_of((container, rows), motion=motion, index_error={"time": 0.01})
        forecast = ps.forecast(ship, rudder_kick, rng=np.random.default_rng(1))
        unit = container.particulars.ship_time
        assert float(forecast["trajectories"]["time"][-1]) == pytest.approx(30.0 * unit, rel=0.01)
        own = ps.indices(forecast["trajectories"].to_dataset())
        assert (forecast["indices"]["time_to_midships"].values != own["time_to_midships"].values).all()
        np.testing.assert_array_equal(forecast["indices"]["residual_yaw_rate"], own["residual_yaw_rate"])


class TestWords:
    def test_a_label_is_written_and_read(self, rudder_kick):
        assert rudder_kick.label == "rudder kick 20/40 starboard"
        assert written_manoeuvre(rudder_kick.label) == rudder_kick
        assert written_manoeuvre("rudder kick 20") is None

    def test_a_grid_names_it(self, rudder_kick, tmp_path):
        path = tmp_path / "grid.toml"
        path.write_text(GRID.format("rudder kick 20/40 starboard"))
        grid = read_study(path)
        assert grid.manoeuvres == {rudder_kick.label: rudder_kick}
        assert grid.record()["manoeuvres"][rudder_kick.label].startswith(
            "Manoeuvre(kind='rudder_kick', rudder_deg=20.0, "
        )
        path.write_text(GRID.format("rudder kick 20"))
        with pytest.raises(ps.StudyError) as error:
            read_study(path)
        assert "'rudder kick 20/40'" in str(error.value)

    def test_the_command_line_simulates_it(self, tmp_path, capsys):
        out = tmp_path / "trial.csv"
        words = ["simulate", "container", "--rudder-kick", "20/40", "--side", "starboard", "--duration", "200"]
        assert main([*words, "--step", "0.1", "--out", str(out)]) == 0
        shown = capsys.readouterr().out
        assert "time to midships" in shown
        assert "IMO" not in shown
        record = ps.read_trial(out)
        assert float(record["delta"].min()) == pytest.approx(np.deg2rad(-20.0), rel=1e-6)

    @pytest.mark.usefixtures("undrawn")
    @pytest.mark.parametrize(
        "kind", [RUDDER_KICK, replace(RUDDER_KICK, indices={}, recognise=None)], ids=["", "no indices"]
    )
    def test_the_command_line_forecasts_it(self, container, kind, tmp_path, monkeypatch, capsys):
        monkeypatch.setitem(KINDS, "rudder_kick", kind)
        draws = posterior(container, scattered(container))
        draws.attrs["vessel"] = "container"
        ps.write_posterior(draws, tmp_path / "joint.nc")
        words = ["forecast", str(tmp_path / "joint.nc"), "--vessel", "container", "--rudder-kick", "20/40"]
        assert (
            main([*words, "--draws", "8", "--duration", "60", "--side", "port", "--out", str(tmp_path / "page")]) == 0
        )
        shown = capsys.readouterr().out
        assert "rudder kick 20/40 port: 8 draws" in shown
        assert ("time to midships" in shown) == bool(kind.indices)
        assert "the posterior does not store the motion of its training runs.\n" in shown
        tables = sorted(path.name for path in (tmp_path / "page").glob("tables/*.csv"))
        indices = ["forecast_rudder_kick_20_40_port.csv"] if kind.indices else []
        assert tables == [*indices, "forecast_rudder_kick_20_40_port_bands.csv"]
        assert "Rudder kick 20/40 port" in (tmp_path / "page" / "forecast.html").read_text(encoding="utf-8")

    def test_words_that_are_no_angles_are_refused(self, capsys):
        with refused(SystemExit, 2):
            main(["simulate", "container", "--rudder-kick", "20", "--out", "trial.csv"])
        assert "a rudder kick must be RUDDER/HEADING [deg] such as 20/40, found '20'" in capsys.readouterr().err


class TestForgotten:
    """Without its registration the package knows nothing of it."""

    @pytest.fixture(autouse=True)
    def forgotten(self, registered, monkeypatch):
        monkeypatch.delitem(KINDS, "rudder_kick")

    def test_no_manoeuvre_is_made(self):
        with refused(ps.SimulationError, "rudder_kick"):
            Manoeuvre("rudder_kick", 20.0, 40.0)
        assert written_manoeuvre("rudder kick 20/40") is None

    def test_no_option_is_known(self, capsys):
        with refused(SystemExit, 2):
            parser().parse_args(["simulate", "container", "--rudder-kick", "20/40", "--out", "trial.csv"])
        capsys.readouterr()


GRID = """
ships = ["container"]
manoeuvres = ["{}"]
methods = ["weak form"]
seeds = 1
root_seed = 1
[noise]
white = [0.01]
"""
