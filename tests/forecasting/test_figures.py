"""Figures of a forecast beside a measured trial: the numbers that are drawn."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import matplotlib.pyplot as plt
import numpy as np
import pytest
import xarray as xr
from matplotlib.patches import Polygon

import pymc_ship as ps
from pymc_ship.forces.propeller import Propeller
from pymc_ship.forces.terms import SYMBOLS
from pymc_ship.forecasting.figures import heading_and_rudder, manoeuvre_figures, motion, overshoot_peaks
from pymc_ship.forecasting.force_curves import force_curves, force_draws
from pymc_ship.forecasting.track import hull, median_ship, track
from pymc_ship.manoeuvre.measured import aligned, measured_indices
from pymc_ship.pages import drawing
from tests.forecasting.cases import MANOEUVRES, forecast, scattered, trial
from tests.trajectory.cases import without_roll

L, B = 230.66, 32.0


@cache
def case(kind):
    """Vessel, forecast and measured trial of a manoeuvre, the run it was made from first."""
    vessel = ps.load_vessel("container")
    manoeuvre, duration = MANOEUVRES[kind]
    return vessel, forecast(vessel, manoeuvre, duration), *trial(vessel, manoeuvre, duration)


@cache
def drawn(kind, name):
    vessel, tree, _, measured = case(kind)
    return manoeuvre_figures(tree, vessel, measured)[name]


def labelled(ax, label):
    return next(line for line in ax.get_lines() if line.get_label() == label)


def inside(box, frame):
    """Whether a box lies inside a frame, to a pixel."""
    across = frame.x0 - 1.0 <= box.x0 and box.x1 <= frame.x1 + 1.0
    return across and frame.y0 - 1.0 <= box.y0 and box.y1 <= frame.y1 + 1.0


def legend(fig):
    return [text.get_text() for text in fig.legends[0].get_texts()]


class TestAligned:
    @pytest.mark.parametrize("kind", MANOEUVRES)
    def test_a_trial_begins_where_its_forecast_does(self, kind):
        """Another clock, course and place, a heading that jumps by 360 deg, and a minute of approach are undone."""
        _, _, run, measured = case(kind)
        found = aligned(measured, run.attrs["rudder_deg"])
        assert found["time"].values[0] == 0.0
        assert all(float(found[name][0]) == 0.0 for name in ("x", "y"))
        assert abs(float(found["psi"][0])) < 2e-3
        again = found.interp(time=run["time"].values[2:-2])
        for name, bound in {"x": 0.5, "y": 2.0, "psi": 2e-3, "u": 0.02, "delta": 0.01}.items():
            assert np.abs(again[name].values - run[name].values[2:-2]).max() < bound, name

    def test_the_execution_is_found_below_noise_and_small_helm(self):
        time = np.arange(0.0, 60.0, 0.1)
        rng = np.random.default_rng(4)
        delta = np.deg2rad(np.clip(2.3 * (time - 20.0), 0.0, 10.0)) + 0.002 * rng.standard_normal(time.size)
        helm = np.where(time < 15.0, np.deg2rad(1.5) * np.sin(time), 0.0)
        record = xr.Dataset({"delta": ("time", delta + helm)}, {"time": time})
        assert time[-1] - float(aligned(record, 10.0)["time"][-1]) == pytest.approx(20.0, abs=0.3)

    @pytest.mark.parametrize("delta", [np.full(5, -0.6), np.zeros(5)])
    def test_a_rudder_that_never_leaves_its_angle_keeps_the_record_whole(self, delta):
        record = xr.Dataset({"delta": ("time", delta), "psi": ("time", np.arange(5.0))}, {"time": np.arange(3.0, 8.0)})
        found = aligned(record, 35.0)
        np.testing.assert_allclose(found["time"], np.arange(5.0))
        np.testing.assert_allclose(found["psi"], np.arange(5.0))

    def test_missing_channels_stay_missing_and_a_track_needs_a_heading(self):
        measured = case("zigzag")[3]
        assert set(aligned(measured[["r", "delta"]]).data_vars) == {"r", "delta"}
        assert "x" not in aligned(measured.drop_vars("psi"), 20.0)
        assert aligned(measured.drop_vars("delta"))["time"].size == measured["time"].size

    def test_gaps_stay_gaps(self):
        measured = case("zigzag")[3].copy(deep=True)
        measured["psi"][200:210] = np.nan
        assert int(np.isnan(aligned(measured, 20.0)["psi"]).sum()) == 10


class TestMeasuredIndices:
    @pytest.mark.parametrize("kind", MANOEUVRES)
    def test_indices_are_those_of_the_run(self, kind):
        _, tree, run, measured = case(kind)
        found, exact = measured_indices(measured, tree.attrs), ps.indices(run)
        assert set(found) == set(exact.data_vars)
        for name, value in found.items():
            assert value == pytest.approx(float(exact[name]), rel=0.01, abs=0.05, nan_ok=True), name

    @pytest.mark.parametrize("seed", [2, 4])
    def test_a_noisy_yaw_rate_does_not_end_the_overshoot_early(self, seed):
        """Left as it is, this noise takes 6 of the 20 s."""
        run, measured = trial(ps.load_vessel("container"), ps.zigzag(10.0, 10.0), 250.0)
        noise = np.deg2rad(0.05) * np.random.default_rng(seed).standard_normal(measured["time"].size)
        found = measured_indices(measured.assign(r=measured["r"] + noise), run.attrs)
        exact = float(ps.indices(run)["first_overshoot_time"])
        assert found["first_overshoot_time"] == pytest.approx(exact, abs=0.5)

    def test_what_a_channel_is_needed_for_is_left_open(self):
        _, tree, run, measured = case("zigzag")
        found = measured_indices(measured[["psi", "delta"]], tree.attrs)
        known = {name for name, value in found.items() if np.isfinite(value)}
        exact = {name for name, value in ps.indices(run).items() if np.isfinite(value)}
        assert known == exact - {"initial_turning_distance", "maximum_roll_angle"}
        assert found["first_overshoot_angle"] == pytest.approx(
            float(ps.indices(run)["first_overshoot_angle"]), abs=0.05
        )
        assert measured_indices(measured[["u", "delta"]], tree.attrs) == {}

    def test_velocities_are_those_of_the_track_where_none_are_measured(self):
        _, tree, run, measured = case("port")
        found = measured_indices(measured[["x", "y", "psi", "delta"]], tree.attrs)
        for name in ("steady_speed", "tactical_diameter"):
            assert found[name] == pytest.approx(float(ps.indices(run)[name]), rel=0.01), name


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


class TestMedianShip:
    def test_it_is_the_ship_with_the_median_indices(self):
        """Ships of one family: the one in the middle, in whatever order they come."""
        vessel = ps.load_vessel("container")
        factors = np.array([1.04, 0.98, 1.0, 1.02, 0.96])
        tree = forecast(vessel, MANOEUVRES["port"][0], 300.0, np.outer(factors, scattered(vessel, 1, 0.0)[0]))
        advance = tree["indices"]["advance"].values
        assert advance[median_ship(tree)] == np.median(advance)

    def test_model_error_of_the_indices_does_not_matter(self):
        tree = case("port")[1].copy(deep=True)
        chosen = median_ship(tree)
        tree["indices"]["advance"].values[:] = np.linspace(0.0, 1e4, 24)
        assert median_ship(tree) == chosen

    def test_a_ship_that_diverged_is_not_chosen(self):
        tree = case("port")[1].copy(deep=True)
        first = median_ship(tree)
        tree["trajectories"]["diverged"].values[first] = True
        assert median_ship(tree) != first

    def test_manoeuvres_without_indices_go_by_the_track(self):
        vessel = ps.load_vessel("container")
        steps = ps.rudder_programme([0.0, 20.0, 60.0], [0.0, 0.3, -0.3])
        tree = forecast(vessel, steps, 100.0)
        ends = tree["trajectories"]["y"].values[:, -1]
        assert abs(ends[median_ship(tree)] - np.median(ends)) < 0.5 * np.std(ends)


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
        own = tree["indices"].to_dataset().isel(draw=median_ship(tree)) / L
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
            first, interval, beside = text.get_text().split("\n")
            assert (first, interval) == (f"{name} {median} L", f"({lower} to {upper})")
            assert float(beside.split()[1]) == pytest.approx(measured, abs=0.011)
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
        ship = tree["trajectories"].to_dataset().isel(draw=median_ship(tree))
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
        assert legend(fig) == ["forecast ships", "median ship", "90° of heading", "180° of heading"]
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
        assert (upper.get_ylabel(), lower.get_ylabel()) == ("heading ψ [deg]", "rudder δ [deg]")
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
        vessel = without_roll(container)
        fig = motion(forecast(vessel, MANOEUVRES["zigzag"][0], 60.0))
        assert [ax.get_ylabel().split(" [")[0][-1] for ax in fig.axes] == ["u", "v", "r", "δ"]


class TestForceCurves:
    def test_a_curve_is_the_sum_of_the_terms_of_its_quantity(self, container):
        """N' along v' of the container ship is N_v v' + N_vvv v'^3 and the like, all else zero."""
        draws, v = scattered(container, 3), np.array([-0.2, 0.1])
        found = force_draws(container, draws, "yaw", "v", v)
        names = [name for dof in container.dofs for name in container.coefficients(dof)["coefficient"].values]
        expected = 0.0
        for name, values in zip(names, draws.T, strict=True):
            factor = {"N0": 1.0 + 0.0 * v, "Nv": v, "Nvv": v**2, "Nvvv": v**3, "Nv|v|": v * np.abs(v)}.get(name)
            expected = expected + (0.0 if factor is None else np.outer(values, factor))
        assert found.shape == (3, 2)
        np.testing.assert_allclose(found, expected, rtol=1e-12)

    def test_bands_hold_the_share_and_structures_are_pooled(self, container):
        flat = without_roll(container)
        models = [(container, scattered(container, 30)), (flat, 1.5 * scattered(flat, 10))]
        ax = force_curves(models, ci_prob=0.5).axes[4]
        v = ax.get_lines()[0].get_xdata()
        curves = 1e3 * np.concatenate([force_draws(vessel, draws, "sway", "r", v) for vessel, draws in models])
        np.testing.assert_allclose(ax.get_lines()[0].get_ydata(), np.median(curves, axis=0))
        path = ax.collections[0].get_paths()[0].vertices
        lower, upper = np.quantile(curves, [0.25, 0.75], axis=0)
        assert path[:, 1].min() == pytest.approx(lower.min())
        assert path[:, 1].max() == pytest.approx(upper.max())

    def test_the_range_of_the_record_is_shaded_in_the_unit_of_its_axis(self, container):
        values = np.zeros((2, len(SYMBOLS)))
        for symbol, ends in {"v": (-0.1, 0.05), "r": (-0.9, 0.3), "delta": np.deg2rad((-20.0, 10.0))}.items():
            values[:, SYMBOLS.index(symbol)] = ends
        record = xr.DataArray(values, dims=("row", "symbol"), coords={"symbol": list(SYMBOLS)})
        fig = force_curves([(container, scattered(container, 5))], record)
        for ax, ends in zip(fig.axes[:3], ((-0.1, 0.05), (-0.9, 0.3), (-20.0, 10.0)), strict=True):
            (span,) = ax.patches
            assert (span.get_x(), span.get_x() + span.get_width()) == pytest.approx(ends)
        assert fig.axes[1].get_xlim() == pytest.approx((-1.35, 1.35))
        assert fig.axes[2].get_xlim() == pytest.approx((-40.0, 40.0))
        assert "range of the training record" in legend(fig)
        assert not force_curves([(container, scattered(container, 5))]).axes[0].patches

    def test_rudder_forces_behind_a_propeller_are_those_at_the_nominal_speed(self, container):
        propeller = Propeller(D=6.5, n=1.5, wake_fraction=0.3, k_0=0.4, k_1=-0.3, k_2=-0.1, eta=0.8, kappa=0.5)
        terms = {"surge": ("X0", "XT"), "sway": ("Yv", "Ygdelta"), "yaw": ("Nv", "Ngdelta")}
        coefficient = container.forces["sway"][0]
        forces = {dof: tuple(replace(coefficient, name=name) for name in names) for dof, names in terms.items()}
        vessel = replace(container, forces=forces, propeller=propeller)
        found = force_draws(vessel, np.arange(1.0, 7.0)[None], "yaw", "delta", np.array([0.2]))
        assert found[0, 0] == pytest.approx(6.0 * 0.2)
        assert force_draws(vessel, np.arange(1.0, 7.0)[None], "surge", "delta", np.array([0.2]))[0, 0] == 1.0

    def test_what_does_not_fit_is_said(self, container):
        with pytest.raises(ValueError, match="found none; add one"):
            force_curves([])
        with pytest.raises(ValueError, match=r"have shape \(draws, 112\)|have shape \(draws, 102\)"):
            force_curves([(container, np.zeros((3, 5)))])


def test_a_figure_is_the_same_file_twice_and_none_stays_open():
    vessel, tree, _, measured = case("zigzag")
    one, two = (drawing.svg(track(tree, vessel, measured), "track") for _ in range(2))
    assert one == two
    assert plt.get_fignums() == []
