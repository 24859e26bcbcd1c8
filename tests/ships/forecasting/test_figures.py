"""Figures of a forecast with a measured trial: the numbers that are drawn."""

from __future__ import annotations

import matplotlib.pyplot as plt
import numpy as np
import pytest
import xarray as xr

import pymc_ship as ps
from pymc_ship.pages import drawing
from pymc_ship.ships.forecasting.figures import heading_and_rudder, motion, overshoot_peaks, overview
from pymc_ship.ships.forecasting.track import track
from tests.inference.trajectory.cases import unmodelled_roll_text
from tests.ships.forecasting.cases import MANOEUVRES, case, drawn, forecast, labelled, legend


class TestOverview:
    def test_circles_are_in_ship_lengths_with_the_measured_one(self):
        vessel, tree, run, measured = case("starboard")
        plan = overview({"a": tree}, vessel, {"a": measured}).axes[0]
        L, first_round = vessel.particulars.L, np.abs(run["psi"].values) <= 2.0 * np.pi
        x, y = run["x"].values[first_round] / L, run["y"].values[first_round] / L
        found = labelled(plan, "measured").get_xydata()
        assert found[:, 1].max() == pytest.approx(x.max(), abs=0.05)
        assert found[:, 0].max() == pytest.approx(y.max(), abs=0.05)
        median = labelled(plan, tree.attrs["label"]).get_xydata()
        ship = tree["trajectories"].dataset.isel(draw=tree.attrs["median_draw"])
        assert median[:, 0].max() == pytest.approx(float(ship["y"].max()) / L, abs=0.02)
        assert "[L]" in plan.get_xlabel()

    def test_a_panel_for_circles_and_one_for_other_manoeuvres(self):
        vessel, circle, *_ = case("starboard")
        _, swings, run, measured = case("zigzag")
        plan, heading = overview({"circle": circle, "zigzag": swings}, vessel, {"zigzag": measured}).axes
        assert (plan.get_title(), heading.get_title()) == ("Turning circles", "Headings: median, 95 % band")
        found = labelled(heading, "measured")
        exact = np.rad2deg(np.interp(found.get_xdata(), run["time"], run["psi"]))
        np.testing.assert_allclose(found.get_ydata()[1:], exact[1:], atol=0.6)
        band = swings["bands"]["psi"].sel(band="median")
        np.testing.assert_allclose(labelled(heading, swings.attrs["label"]).get_ydata(), np.rad2deg(band), atol=1e-9)
        assert len(overview({"zigzag": swings}, vessel).axes) == 1

    def test_colours_are_sides_and_lines_are_angles(self):
        vessel, starboard, *_ = case("starboard")
        port, mild = case("port")[1], case("port")[1].copy()
        mild.attrs |= {"label": "turning circle 20 port"}
        plan = overview(dict(enumerate((starboard, port, mild))), vessel).axes[0]
        lines = [labelled(plan, tree.attrs["label"]) for tree in (starboard, port, mild)]
        assert [line.get_color() for line in lines] == [drawing.BLUE, drawing.RUST, drawing.RUST]
        assert [line.get_linestyle() for line in lines] == ["-", "-", "--"]


class TestHeadingAndRudder:
    def test_lines_are_in_degrees_against_time_from_the_execution(self):
        _, tree, run, _ = case("zigzag")
        ax = drawn("zigzag", "heading_and_rudder").axes[0]
        median = labelled(ax, "heading: median")
        np.testing.assert_allclose(median.get_ydata(), np.rad2deg(tree["bands"]["psi"].sel(band="median")), atol=1e-9)
        measured = [line for line in ax.get_lines() if line.get_label() == "measured"]
        for line, name in zip(measured, ("psi", "delta"), strict=True):
            exact = np.rad2deg(np.interp(line.get_xdata(), run["time"], run[name]))
            np.testing.assert_allclose(line.get_ydata()[1:], exact[1:], atol=0.6)
        assert "[deg]" in ax.get_ylabel()
        assert ax.get_xlabel().endswith("[s]")

    def test_switching_headings_and_overshoots_are_marked(self):
        _, tree, run, _ = case("zigzag")
        ax = drawn("zigzag", "heading_and_rudder").axes[0]
        levels = {line.get_ydata()[0] for line in ax.get_lines() if line.get_linestyle() == "--"}
        assert levels == {20.0, -20.0}
        bands, sign = tree["index_bands"].to_dataset(), 1.0
        for container, name in zip(ax.containers, ("first", "second", "third"), strict=False):
            point, _, (bars,) = container
            lower, median, upper = (20.0 + float(value) for value in bands[f"{name}_overshoot_angle"])
            assert point.get_ydata()[0] == pytest.approx(sign * median)
            ends = np.sort(bars.get_segments()[0][:, 1])
            np.testing.assert_allclose(ends, np.sort([sign * lower, sign * upper]))
            sign = -sign
        assert len(ax.containers) >= 2
        exact = ps.indices(run)
        peaks = labelled(ax, "measured peak").get_xydata()
        assert peaks[0, 1] == pytest.approx(20.0 + float(exact["first_overshoot_angle"]), abs=0.05)
        assert peaks[1, 1] == pytest.approx(-20.0 - float(exact["second_overshoot_angle"]), abs=0.05)
        when = float(exact["initial_turning_time"] + exact["first_overshoot_time"])
        assert peaks[0, 0] == pytest.approx(when, abs=1.0)

    def test_a_peak_at_the_end_of_the_record_does_not_count(self):
        time = np.arange(0.0, 254.0, 0.5)
        ship = xr.Dataset({"psi": ("time", np.deg2rad(-28.0 * np.sin(2.0 * np.pi * time / 200.0)))}, {"time": time})
        whole = overshoot_peaks(ship, 20.0, "port")
        np.testing.assert_allclose(whole, [(50.0, -28.0), (150.0, 28.0)], atol=1e-6)
        assert len(overshoot_peaks(ship.sel(time=slice(0.0, 154.0)), 20.0, "port")) == 1
        assert overshoot_peaks(ship, 30.0, "port") == []

    def test_a_circle_has_a_panel_for_each(self):
        upper, lower = drawn("port", "heading_and_rudder").axes
        assert (upper.get_ylabel(), lower.get_ylabel()) == (
            "heading ψ [deg]\npositive to starboard",
            "rudder δ [deg]\npositive to port",
        )
        assert lower.get_lines()[0].get_ydata().max() == pytest.approx(35.0)

    def test_a_missing_heading_leaves_the_forecast(self):
        _, tree, _, measured = case("zigzag")
        fig = heading_and_rudder(tree, measured[["delta", "u"]])
        assert "measured peak" not in legend(fig)
        assert sum(line.get_label() == "measured" for line in fig.axes[0].get_lines()) == 1
        assert "measured" not in legend(heading_and_rudder(tree))


class TestMotion:
    def test_a_panel_for_every_channel_in_its_unit(self):
        labels = [ax.get_ylabel() for ax in drawn("zigzag", "motion").axes]
        assert [label.rsplit(" ", 2)[1:] for label in labels] == [
            ["u", "[m/s]"],
            ["v", "[m/s]"],
            ["r", "[deg/s]"],
            ["p", "[deg/s]"],
            ["φ", "[deg]"],
            ["δ", "[deg]"],
        ]

    def test_band_median_and_measured_are_those_of_the_channel(self):
        _, tree, run, _ = case("zigzag")
        ax = drawn("zigzag", "motion").axes[2]
        bands = np.rad2deg(tree["bands"]["r"])
        np.testing.assert_allclose(labelled(ax, "median").get_ydata(), bands.sel(band="median"))
        box = ax.collections[0].get_datalim(ax.transData)
        assert (box.y0, box.y1) == pytest.approx((float(bands.min()), float(bands.max())))
        line = labelled(ax, "measured")
        exact = np.rad2deg(np.interp(line.get_xdata(), run["time"], run["r"]))
        np.testing.assert_allclose(line.get_ydata(), exact, atol=0.01)
        assert legend(drawn("zigzag", "motion")) == ["95 % band", "median", "measured"]

    def test_channels_that_were_not_measured_have_the_forecast_alone(self):
        _, tree, _, measured = case("zigzag")
        u, v, *_ = motion(tree, measured[["v", "delta"]]).axes
        assert len(u.get_lines()) == 1
        assert len(v.get_lines()) == 2

    def test_a_ship_without_roll_has_no_panels_of_it(self, container):
        vessel = unmodelled_roll_text(container)
        fig = motion(forecast(vessel, MANOEUVRES["zigzag"][0], 60.0))
        assert [ax.get_ylabel().split(" [")[0][-1] for ax in fig.axes] == ["u", "v", "r", "δ"]


def test_a_figure_is_the_same_file_twice_and_none_stays_open():
    vessel, tree, _, measured = case("zigzag")
    one, two = (drawing.svg(track(tree, vessel, measured), "track") for _ in range(2))
    assert one == two
    assert plt.get_fignums() == []
