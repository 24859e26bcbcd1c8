"""The track of a forecast: outline, median ship, and a measured trial."""

from __future__ import annotations

import numpy as np
import pytest
import xarray as xr
from matplotlib.patches import Polygon

import pymc_ship as ps
from pymc_ship.ships.forecasting.track import hull, track
from tests.ships.forecasting.cases import MANOEUVRES, case, drawn, forecast, labelled, legend

L, B = 230.66, 32.0


def inside(box, frame):
    """Whether a box lies inside a frame, to a pixel."""
    across = frame.x0 - 1.0 <= box.x0 and box.x1 <= frame.x1 + 1.0
    return across and frame.y0 - 1.0 <= box.y0 and box.y1 <= frame.y1 + 1.0


class TestHull:
    def test_it_has_the_length_and_beam_of_the_ship_and_a_bow_that_points_ahead(self, container):
        outline = hull(container, 0.0, 0.0, 0.0)
        assert np.ptp(outline[:, 0]) == pytest.approx(1.0)
        assert np.ptp(outline[:, 1]) == pytest.approx(B / L)
        bow = outline[outline[:, 0].argmax()]
        np.testing.assert_allclose(bow, [0.5, 0.0])
        np.testing.assert_allclose(np.sort(outline[:, 1]), np.sort(-outline[:, 1]), atol=1e-15)

    def test_it_stands_at_its_place_and_heads_to_starboard_when_psi_is_90_deg(self, container):
        outline = hull(container, 2.0 * L, -3.0 * L, 0.5 * np.pi)
        bow = outline[outline[:, 1].argmax()]
        np.testing.assert_allclose(bow, [2.0, -2.5], atol=1e-12)
        assert np.ptp(outline[:, 0]) == pytest.approx(B / L)


class TestTrack:
    def test_the_measured_line_begins_at_the_origin_and_ends_where_the_run_does(self):
        _, _, run, _ = case("zigzag")
        line = labelled(drawn("zigzag", "track").axes[0], "measured").get_xydata()
        np.testing.assert_allclose(line[0], [0.0, 0.0], atol=1e-12)
        last = np.array([run["x"][-1], run["y"][-1]]) / L
        np.testing.assert_allclose(line[-1], last, atol=0.15)

    @pytest.mark.parametrize("side", ["port", "starboard"])
    def test_circles_turn_to_their_side_and_are_marked_at_90_and_180_deg(self, side):
        _, tree, run, _ = case(side)
        ax = drawn(side, "track").axes[0]
        sign = {"starboard": 1.0, "port": -1.0}[side]
        own = tree["indices"].to_dataset().isel(draw=tree.attrs["median_draw"]) / L
        (mark,) = labelled(ax, "90° of heading").get_xydata()
        np.testing.assert_allclose(mark, [sign * float(own["transfer"]), float(own["advance"])], atol=1e-3)
        (mark,) = labelled(ax, "180° of heading").get_xydata()
        assert mark[0] == pytest.approx(sign * float(own["tactical_diameter"]), abs=1e-3)
        squares = [line.get_xydata()[0] for line in ax.get_lines() if line.get_marker() == "s"]
        assert len(squares) == 2
        exact = sign * float(ps.indices(run)["tactical_diameter"]) / L
        assert squares[1][0] == pytest.approx(exact, abs=0.01)

    @pytest.mark.parametrize("side", ["port", "starboard"])
    def test_dimensions_run_from_the_start_to_the_marks_and_give_the_interval(self, side):
        _, tree, run, _ = case(side)
        ax = drawn(side, "track").axes[0]
        texts = {text.get_text().split("\n")[0].rsplit(" ", 2)[0]: text for text in ax.texts if text.get_text()}
        assert set(texts) == {"advance", "transfer", "tactical diameter"}
        for name, text in texts.items():
            key = name.replace(" ", "_")
            lower, median, upper = (f"{float(value) / L:.2f}" for value in tree["index_bands"][key])
            measured = float(ps.indices(run)[key]) / L
            first, interval, measured_line = text.get_text().split("\n")
            assert (first, interval) == (f"{name} {median} L", f"({lower} to {upper})")
            assert float(measured_line.split()[1]) == pytest.approx(measured, abs=0.011)
        arrows = {tuple(np.round(np.subtract(text.xy, text.xyann), 9)) for text in ax.texts if not text.get_text()}
        x, y = labelled(ax, "90° of heading").get_xydata()[0]
        width = labelled(ax, "180° of heading").get_xydata()[0][0]
        for wanted in ((x, 0.0), (0.0, y), (width, 0.0)):
            assert min(np.abs(np.subtract(arrow, wanted)).max() for arrow in arrows) < 1e-8

    @pytest.mark.parametrize("kind", MANOEUVRES)
    def test_everything_drawn_lies_inside_the_axes(self, kind):
        fig = drawn(kind, "track")
        fig.draw_without_rendering()
        ax = fig.axes[0]
        frame, page = ax.get_window_extent(), fig.bbox
        for line in ax.get_lines():
            ends = ax.transData.transform(line.get_xydata())
            assert (ends >= np.array([frame.x0, frame.y0]) - 1.0).all()
            assert (ends <= np.array([frame.x1, frame.y1]) + 1.0).all()
        title = next(child for child in ax.get_children() if getattr(child, "get_text", str)() == ax.get_title("left"))
        for artist in (title, fig.legends[0], ax.xaxis.label, ax.yaxis.label):
            assert inside(artist.get_window_extent(), page)
        written = [text.get_window_extent() for text in ax.texts if text.get_text()]
        assert len(written) == (0 if kind == "zigzag" else 3)
        assert all(inside(box, frame) for box in written)
        assert not any(box.overlaps(title.get_window_extent()) for box in written)

    def test_outlines_stand_on_the_track_at_regular_times_to_scale(self):
        _, tree, _, _ = case("starboard")
        ax = drawn("starboard", "track").axes[0]
        outlines = [patch for patch in ax.patches if isinstance(patch, Polygon)]
        interval = float(ax.get_title(loc="left").split("every ")[1].split(" s")[0])
        ship = tree["trajectories"].to_dataset().isel(draw=tree.attrs["median_draw"])
        turned = np.rad2deg(np.abs(ship["psi"].values))
        n = int(np.sum(turned[ship["time"].values % interval < 1e-9] <= 360.0))
        assert n > 5
        for k, patch in enumerate(outlines[:n]):
            xy = patch.get_xy()[:-1]
            lengths = np.hypot(*(xy[:, None] - xy).transpose(2, 0, 1))
            assert lengths.max() == pytest.approx(1.0, rel=0.01)
            x, y, psi = (float(ship[name].sel(time=k * interval)) for name in ("x", "y", "psi"))
            bow = np.array([y / L + 0.5 * np.sin(psi), x / L + 0.5 * np.cos(psi)])
            assert np.hypot(*(xy - bow).T).min() < 1e-9

    def test_axes_have_one_scale_and_are_in_ship_lengths(self):
        ax = drawn("starboard", "track").axes[0]
        assert ax.get_aspect() == 1.0
        assert (ax.get_xlabel(), ax.get_ylabel()) == ("transfer y/L (to starboard)", "advance x/L")
        zigzag = drawn("zigzag", "track").axes[0]
        assert zigzag.get_aspect() == 1.0
        assert (zigzag.get_xlabel(), zigzag.get_ylabel()) == ("advance x/L", "transfer y/L")
        assert zigzag.yaxis_inverted()
        assert "starboard is down" in zigzag.get_title(loc="left")

    def test_at_most_40_ships_are_drawn_thin_and_the_first_round_of_a_circle_alone(self):
        _, tree, _, _ = case("port")
        ax = drawn("port", "track").axes[0]
        thin = [line for line in ax.get_lines() if line.get_linewidth() == 0.4]
        assert len(thin) == 24
        assert float(np.abs(tree["trajectories"]["psi"]).max()) > np.deg2rad(450.0)
        assert all(line.get_ydata().min() > -4.0 for line in thin)

    def test_a_trial_without_a_track_leaves_the_forecast_alone(self):
        vessel, tree, _, measured = case("port")
        fig = track(tree, vessel, measured.drop_vars("x"))
        assert legend(fig) == ["forecast draws", "median ship", "90° of heading", "180° of heading"]
        assert not any("measured" in text.get_text() for text in fig.axes[0].texts)

    def test_a_turn_that_does_not_reach_180_deg_has_no_diameter(self):
        vessel = ps.load_vessel("container")
        tree = forecast(vessel, MANOEUVRES["port"][0], 150.0)
        ax = track(tree, vessel).axes[0]
        words = [text.get_text().split()[0] for text in ax.texts if text.get_text()]
        assert sorted(words) == ["advance", "transfer"]

    def test_ships_that_all_diverged_are_drawn_as_far_as_they_came(self):
        vessel, tree, _, _ = case("port")
        tree = tree.copy(deep=True)
        ships = tree["trajectories"].to_dataset()
        late = ships["time"] > 60.0
        ships = ships.where(~late, drop=False).assign(diverged=("draw", np.ones(24, dtype=bool)))
        tree["trajectories"] = xr.DataTree(ships.transpose("draw", "time", ...))
        assert track(tree, vessel).axes[0].has_data()
