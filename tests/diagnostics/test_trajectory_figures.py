"""The figures of a posterior of whole trajectories: what they show, in which units, under which labels."""

import numpy as np
import pytest

from pymc_ship.diagnostics import figures, trajectory_figures
from pymc_ship.diagnostics import trajectory as trajectory_diagnostics
from pymc_ship.diagnostics.posterior_statistics import autocorrelation
from tests.diagnostics.cases import changed, hull, short_posterior

pytestmark = pytest.mark.filterwarnings("error")


def drawn(fig):
    """The figure, laid out and drawn to nowhere."""
    fig.draw_without_rendering()
    return fig


def legend(fig):
    return [text.get_text() for text in fig.legends[0].get_texts()]


def test_every_channel_is_drawn_in_its_unit_with_residuals_and_the_rudder():
    tree = short_posterior(noise="ar1")
    fig = drawn(trajectory_figures.motion_figure(tree, 1))
    labels = [ax.get_ylabel() for ax in fig.axes]
    assert labels == ["u [m/s]", "v [m/s]", *["residual [sd]"] * 2, "r [deg/s]", "residual [sd]", "rudder δ [deg]"]
    rows = tree["constant_data"]["run"].values == 1
    measured, fitted = (line.get_ydata() for line in fig.axes[4].lines)
    np.testing.assert_allclose(measured, np.rad2deg(tree["observed_data"]["response"].values[rows, 2]))
    offset = tree["posterior"]["sensor_offset"].values[..., 1, 2].mean()
    np.testing.assert_allclose(fitted, np.rad2deg(tree["constant_data"]["fitted"].values[rows, 2] + offset))
    assert fig.axes[-1].lines[0].get_ydata().max() == pytest.approx(35.0, abs=0.1)
    assert [ax.get_xlabel() for ax in fig.axes[-2:]] == ["time [s]"] * 2
    assert legend(fig) == ["measured, block means", "fitted, sensor offset included"]


def test_a_channel_that_a_run_lacks_is_left_out():
    tree = changed(short_posterior(), "observed_data/response", lambda v: v[:, 1].fill(np.nan))
    fig = drawn(trajectory_figures.motion_figure(tree, 0))
    labels = [ax.get_ylabel() for ax in fig.axes]
    assert legend(fig)[1] == "fitted"
    assert labels == ["u [m/s]", "r [deg/s]", *["residual [sd]"] * 2, "rudder δ [deg]"]


def test_the_autocorrelation_of_every_run_over_seconds():
    found = trajectory_diagnostics.residuals(short_posterior())
    fig = drawn(trajectory_figures.autocorrelation_figure(found))
    assert [ax.get_title() for ax in fig.axes] == ["u", "v", "r"]
    assert fig.axes[0].get_xlabel() == "lag [s]"
    assert legend(fig) == ["white noise, 95 %", "run 1", "run 2"]
    line = fig.axes[1].lines[1]
    values = found["white"].sel(channel="v").values[found["run"].values == 1]
    np.testing.assert_allclose(line.get_ydata(), autocorrelation(values, 40))
    np.testing.assert_allclose(line.get_xdata()[:2], [0.5, 1.0])


def test_quantiles_of_normal_residuals_lie_on_the_line_and_heavy_ones_do_not():
    def heavy(response):
        response[::10, 0] *= 1.01

    far = []
    for tree in (short_posterior(), changed(short_posterior(), "observed_data/response", heavy)):
        fig = drawn(trajectory_figures.quantiles_figure(trajectory_diagnostics.residuals(tree)))
        x, y = fig.axes[0].lines[0].get_data()
        far.append(np.abs(x - y).max())
    assert far[0] < 0.7 < 2.0 < far[1]
    assert fig.axes[0].get_ylabel() == "residual quantile [sd]"
    assert legend(fig) == ["run 1", "run 2", "normal"]


def test_the_forest_stands_in_prior_standard_deviations():
    tree, reference = short_posterior(), hull().coefficients("yaw").values
    fig = drawn(trajectory_figures.forest_figure(tree, "yaw", {"reference": reference, "publ. x": np.full(20, np.nan)}))
    ax = fig.axes[-1]
    assert ax.get_xlabel().startswith("yaw: (coefficient − prior mean) / prior sd (linear")
    assert legend(fig) == ["prior, 95 %", "reference", "publ. x"]
    marks = next(line for line in ax.lines if line.get_label() == "reference")
    found = trajectory_diagnostics.contraction(tree)
    yaw = found.isel(coefficient=found["dof"].values == "yaw")
    np.testing.assert_allclose(marks.get_xdata(), (reference - yaw["prior_mean"]) / yaw["prior_sd"])
    assert [text.get_text() for text in fig.axes[0].texts] == yaw["coefficient"].values.tolist()
    assert (np.diff(marks.get_ydata()) < 0.0).all()


def test_the_forest_of_flat_priors_stands_in_posterior_standard_deviations():
    flat = drawn(trajectory_figures.forest_figure(short_posterior("flat"), "surge", {"reference": np.ones(13)}))
    assert flat.axes[-1].get_xlabel().startswith("surge: coefficient / posterior sd (")
    assert legend(flat) == ["reference"]
    bare = drawn(trajectory_figures.forest_figure(short_posterior("flat"), "surge", {}))
    assert bare.legends == []
    mixed = changed(short_posterior(), "constant_data/prior_sd", lambda v: v.__setitem__(0, np.inf))
    label = drawn(trajectory_figures.forest_figure(mixed, "surge", {})).axes[-1].get_xlabel()
    assert "/ prior sd; of flat priors coefficient / posterior sd" in label


def test_a_bar_for_every_contraction_in_the_colour_of_its_judgement():
    found = trajectory_diagnostics.contraction(short_posterior())
    fig = drawn(trajectory_figures.contraction_figure(found))
    assert [ax.get_ylabel() for ax in fig.axes] == [f"{dof}: contraction" for dof in ("surge", "sway", "yaw")]
    assert sum(len(ax.patches) for ax in fig.axes) == 53
    assert legend(fig) == ["determined", "includes zero", "prior"]
    heights = {round(patch.get_height(), 9) for ax in fig.axes for patch in ax.patches}
    assert heights == {round(max(value, 0.0), 9) for value in found["contraction"].values}
    assert next(text.get_text() for text in fig.axes[2].get_xticklabels()) == "Nv"


def test_directions_are_drawn_as_shares_with_the_unknown_apart():
    found = trajectory_diagnostics.directions(short_posterior())
    ax = drawn(trajectory_figures.directions_figure(found)).axes[0]
    unknown, told = (line.get_ydata() for line in ax.lines[:2])
    assert (unknown.size, told.size) == (found.attrs["n_unknown"], 53 - found.attrs["n_unknown"])
    assert unknown.min() > 0.5 >= told.max()
    assert (ax.get_yscale(), ax.get_ylabel()) == ("log", "posterior over prior variance")


def test_the_correlation_is_parted_by_degree_of_freedom():
    tree = short_posterior()
    fig = drawn(figures.correlation(tree, trajectory_diagnostics.dofs(tree)))
    ax = fig.axes[0]
    assert [text.get_text() for text in ax.get_xticklabels()] == ["surge", "sway", "yaw"]
    sizes = [len(hull().terms(dof)) for dof in hull().dofs]
    edges = sorted({line.get_ydata()[0] for line in ax.lines if np.ptp(line.get_ydata()) == 0.0})
    assert edges == [sizes[0] - 0.5, sizes[0] + sizes[1] - 0.5]
    assert ax.images[0].get_array().shape == (53, 53)
