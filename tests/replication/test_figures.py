"""Every figure: labels, units, legends, the same file twice, nothing from outside, no figure left open."""

from __future__ import annotations

import base64
import struct
from functools import cache
from types import SimpleNamespace
from xml.etree import ElementTree

import matplotlib.pyplot as plt
import numpy as np
import pytest
import xarray as xr

import pymc_ship as ps
from pymc_ship.inference.regression.families import FAMILIES
from pymc_ship.pages import drawing
from pymc_ship.replication import figures
from tests.ships.ensemble.cases import posterior_forecast

pytestmark = pytest.mark.slow

PNG = b"\x89PNG\r\n\x1a\n"


@cache
def ship():
    return ps.load_vessel("container")


def plain_trees(names=("surge", "sway"), n_terms=3):
    """Independent draws of a small regression for each name."""
    rng = np.random.default_rng(6)
    X = rng.normal(size=(40, n_terms))
    data = ps.RegressionData.from_arrays(X, X.sum(axis=1) + rng.normal(size=40), scaling="none")
    prior = ps.ConjugatePrior(kappa=10.0)
    return {name: ps.exact_posterior(data, prior, draws=400, rng=rng) for name in names}


def denoising():
    clean = ps.simulate(ship(), ps.zigzag(20.0, 20.0), duration=40.0, step=0.2)
    noisy = ps.pollute(clean, level=0.05, rng=np.random.default_rng(1))
    return figures.denoising(clean, noisy, 0.5 * (clean + noisy), (10.0, 20.0))


def noise_variance():
    X = np.random.default_rng(2).normal(size=(40, 3))
    data = ps.RegressionData.from_arrays(X, X @ np.ones(3) + np.sin(np.arange(40.0)), scaling="none")
    return figures.noise_variance({name: prior().exact(data) for name, prior in FAMILIES.items()}, "surge")


def sample_paths():
    trees = plain_trees()
    return figures.sample_paths({"x1": (trees["surge"], 1.0), "x3": (trees["sway"], -1.0)})


@cache
def forecast_inputs(kind):
    """Reference run and a forecast of both families from draws a percent around the reference."""
    manoeuvre = {"zigzag": ps.zigzag(20.0, 20.0), "turning_circle": ps.turning_circle(35.0)}[kind]
    reference = ps.simulate(ship(), manoeuvre, duration=60.0, record_interval=0.5)
    rng = np.random.default_rng(3)
    posteriors = {}
    for dof in ship().dofs:
        values = ship().coefficients(dof)
        noise = xr.DataArray(1.0 + 0.01 * rng.normal(size=(4, 10, values.size)), dims=("chain", "draw", "coefficient"))
        posteriors[dof] = xr.DataTree.from_dict({"posterior": xr.Dataset({"coefficients": noise * values})})
    settings = {"draws": 6, "duration": 60.0}
    return reference, {f: posterior_forecast(ship(), posteriors, manoeuvre, rng=rng, **settings) for f in FAMILIES}


def forecast_zigzag():
    return figures.forecast_channels(*forecast_inputs("zigzag"))


def forecast_turning_circle():
    return figures.forecast_channels(*forecast_inputs("turning_circle"))


def errors_by_level(bound=1e-4):
    levels = np.array([1e-5, 1e-3, 1e-1])
    return figures.errors_by_level(levels, {"surge": 1e3 * levels, "all": 2e3 * levels}, 2.0, bound)


METHODS = {
    "Cramer-Rao bound": 1.0,
    "trajectory fit, flat prior": 1.1,
    "trajectory fit, order-damped prior": 0.7,
    "weak form": 3.0,
    "best differencing": 4.0,
    "paper's pipeline": 6.0,
}


def errors_by_method(published=True):
    levels = np.array([1e-3, 1e-2, 1e-1])
    errors = {name: 1e3 * factor * levels for name, factor in METHODS.items()}
    errors["weak form"][1] = np.nan
    return figures.errors_by_method(levels, errors, {"conjugate": 2.0, "semi-conjugate": 3.7} if published else {}, 0.4)


def tuning():
    scores = np.array([1.0, -3.0, 4.0, 3.9, 4.5])
    tuned = {
        dof: SimpleNamespace(scores=scores + shift, evidence_score=4.2) for dof, shift in (("yaw", 0), ("roll", 1))
    }
    return figures.tuning(tuned)


def ranks():
    trees = plain_trees()
    return figures.arviz_panels("plot_rank", trees, {"surge": "x1", "sway": "x2"}, envelope_prob=0.99)


def traces():
    return figures.arviz_panels("plot_trace", plain_trees(), {"surge": "x1", "sway": "x2"})


OWN = {
    "denoising": denoising,
    "noise_variance": noise_variance,
    "sample_paths": sample_paths,
    "forecast_zigzag": forecast_zigzag,
    "forecast_turning_circle": forecast_turning_circle,
    "errors_by_level": errors_by_level,
    "errors_by_method": errors_by_method,
    "tuning": tuning,
}
LARGE = ("denoising", "noise_variance", "sample_paths", "forecast_zigzag", "forecast_turning_circle")
IN_SVG = [pytest.param(name, marks=pytest.mark.slow if name in LARGE else ()) for name in OWN]
EVERY = OWN | {"ranks": ranks, "traces": traces}
LEGENDS = {
    "denoising": {"polluted", "clean", "denoised"},
    "noise_variance": {"prior", "posterior"},
    "sample_paths": {"posterior mean", "reference"},
    "errors_by_level": {"surge", "all", "published, median of all", "published errors at level 1.0e-04"},
    "errors_by_method": {*METHODS, "published, conjugate", "published, semi-conjugate"},
    "tuning": {"yaw", "roll", "evidence maximum"},
}
BANDS = {"reference", *(f"{family}: {part}" for family in FAMILIES for part in ("band", "median"))}
LEGENDS |= {"forecast_zigzag": BANDS, "forecast_turning_circle": BANDS}


@cache
def drawn(name):
    return EVERY[name]()


@cache
def drawn_svg(name):
    return drawing.svg(drawn(name), name)


def missing_labels(fig):
    """Axes with data and without a label, where no neighbour has it: x below, y to the left of columns that share x."""
    lacking = []
    for k, ax in enumerate(fig.axes):
        column = ax.get_shared_x_axes().get_siblings(ax)
        rows = ax.get_subplotspec().rowspan
        row = [ax] if len(column) == 1 else [other for other in fig.axes if other.get_subplotspec().rowspan == rows]
        if ax.has_data() and not any(other.get_xlabel() for other in column):
            lacking.append((k, "x"))
        if ax.has_data() and not any(other.get_ylabel() for other in row):
            lacking.append((k, "y"))
    return lacking


def legend_texts(fig):
    legends = [*fig.legends, *(ax.get_legend() for ax in fig.axes if ax.get_legend())]
    return [{text.get_text() for text in legend.get_texts()} for legend in legends]


def references(text):
    """Values of every attribute of an SVG that can fetch something, and of its url(...)."""
    root = ElementTree.fromstring(text)
    pairs = [(key.rpartition("}")[2], value) for element in root.iter() for key, value in element.attrib.items()]
    linked = [value for key, value in pairs if key in ("href", "src")]
    return linked + [value.partition("url(")[2] for _, value in pairs if "url(" in value]


@pytest.mark.parametrize("name", OWN)
def test_axes_with_data_are_labelled(name):
    fig = drawn(name)
    assert sum(ax.has_data() for ax in fig.axes) == {
        "denoising": 10,
        "noise_variance": 2,
        "sample_paths": 2,
        "forecast_zigzag": 8,
        "forecast_turning_circle": 8,
        "errors_by_level": 1,
        "errors_by_method": 1,
        "tuning": 1,
    }.get(name)
    assert missing_labels(fig) == []


def test_a_missing_label_is_seen():
    fig = denoising()
    fig.axes[-1].set_xlabel("")
    fig.axes[2].set_ylabel("")
    assert set(missing_labels(fig)) == {*((k, "x") for k in (1, 3, 5, 7, 9)), (2, "y"), (3, "y")}


@pytest.mark.parametrize("name", ["denoising", "forecast_zigzag", "forecast_turning_circle"])
def test_physical_axes_carry_their_unit(name):
    fig = drawn(name)
    labels = [label for ax in fig.axes for label in (ax.get_xlabel(), ax.get_ylabel()) if label]
    assert all(label.endswith("]") and " [" in label for label in labels)
    assert {"time [s]", "u [m/s]", "v [m/s]", "r [deg/s]", "p [deg/s]", "roll angle φ [deg]"} <= set(labels)


def test_angles_are_drawn_in_the_unit_of_their_label():
    """The rudder of a 20/20 zigzag reaches 20 on an axis in degrees."""
    ax = next(ax for ax in drawn("forecast_zigzag").axes if ax.get_ylabel() == "rudder δ [deg]")
    values = np.concatenate([line.get_ydata() for line in ax.get_lines()])
    assert np.abs(values).max() == pytest.approx(20.0)


@pytest.mark.parametrize(("known", "words"), [(0.25, ", 25 % of the instants extrapolated"), (float("nan"), "")])
def test_a_forecast_states_its_shares_below_its_bands(known, words):
    reference, forecasts = forecast_inputs("zigzag")
    forecasts = {family: tree.copy() for family, tree in forecasts.items()}
    for tree, diverged in zip(forecasts.values(), (0.0, 0.5), strict=True):
        tree.attrs |= {"extrapolated_fraction": known, "diverged_fraction": diverged}
    conjugate, semiconjugate = figures.forecast_channels(reference, forecasts).get_supxlabel().splitlines()
    assert conjugate == f"conjugate: 6 draws, 0 % diverged{words}"
    assert semiconjugate == f"semiconjugate: 6 draws, 50 % diverged{words}"


def test_the_circle_of_a_reference_that_runs_away_is_drawn_until_then():
    reference, forecasts = forecast_inputs("turning_circle")
    stayed = reference.isel(time=slice(None, 60))
    gone = reference.where(reference["time"] < reference["time"][60])
    whole, cut = (figures.forecast_channels(run, forecasts).axes[-1].get_xlim() for run in (stayed, gone))
    assert cut == pytest.approx(whole, rel=1e-12)


def test_errors_and_gains_carry_their_unit():
    for name in ("errors_by_level", "errors_by_method"):
        assert drawn(name).axes[0].get_ylabel() == "median |error| [%]"
    assert drawn("tuning").axes[0].get_ylabel() == "gain [nats per row]"


@pytest.mark.parametrize("name", OWN)
def test_a_legend_names_every_line(name):
    texts = legend_texts(drawn(name))
    assert len(texts) == (2 if name == "noise_variance" else 1)
    assert all(found == LEGENDS[name] for found in texts)


def test_the_legend_leaves_out_a_level_that_is_unknown():
    (texts,) = legend_texts(errors_by_level(bound=float("nan")))
    assert texts == {"surge", "all", "published, median of all"}


def test_methods_have_a_line_each_on_two_log_axes_and_the_bound_is_dashed():
    ax = drawn("errors_by_method").axes[0]
    assert (ax.get_xscale(), ax.get_yscale()) == ("log", "log")
    lines = {line.get_label(): line for line in ax.get_lines()}
    assert [name for name in METHODS if lines[name].get_linestyle() == "--"] == ["Cramer-Rao bound"]
    assert len({lines[name].get_color() for name in METHODS}) == len(METHODS)
    np.testing.assert_allclose(lines["paper's pipeline"].get_ydata(), [6.0, 60.0, 600.0])
    assert lines["published, conjugate"].get_xydata().tolist() == [[0.4, 2.0]]


def test_nothing_published_leaves_the_methods():
    (texts,) = legend_texts(errors_by_method(published=False))
    assert texts == set(METHODS)


def test_tuning_shows_the_best_score_so_far_above_the_evidence():
    yaw, roll, zero = drawn("tuning").axes[0].get_lines()
    np.testing.assert_allclose(yaw.get_ydata(), np.array([1.0, 1.0, 4.0, 4.0, 4.5]) - 4.2)
    np.testing.assert_allclose(roll.get_ydata() - yaw.get_ydata(), 1.0)
    np.testing.assert_array_equal(yaw.get_xdata(), np.arange(1, 6))
    assert set(zero.get_ydata()) == {0.0}


def test_sample_paths_are_prime_values_times_1e5_with_a_line_a_chain():
    tree = plain_trees()["surge"]
    draws = tree["posterior"]["coefficients"].sel(coefficient="x1")
    ax = drawn("sample_paths").axes[0]
    *chains, mean, reference = ax.get_lines()
    assert len(chains) == draws.sizes["chain"]
    np.testing.assert_allclose([line.get_ydata() for line in chains], 1e5 * draws)
    assert mean.get_ydata() == pytest.approx(2 * [1e5 * float(draws.mean())])
    assert reference.get_ydata() == pytest.approx(2 * [1e5])


def test_densities_of_the_noise_variance_hold_their_probability():
    """Area under the posterior density of log sigma2 inside the limits shown."""
    for ax in drawn("noise_variance").axes:
        _, posterior = ax.get_lines()
        values, density = posterior.get_data()
        shown = (values >= ax.get_xlim()[0]) & (values <= ax.get_xlim()[1])
        assert np.trapezoid(density[shown], np.log(values[shown])) == pytest.approx(1.0, abs=1e-3)


def test_the_enlarged_column_shows_its_part_only():
    left, right = drawn("denoising").axes[:2]
    time = right.get_lines()[0].get_xdata()
    assert (time.min(), time.max()) == (10.0, 20.0)
    assert left.get_lines()[0].get_xdata().max() == pytest.approx(39.0, abs=1.1)


@pytest.mark.parametrize("axes_of", ["ranks", "traces"])
def test_arviz_panels_show_one_coefficient_of_each_tree(axes_of):
    fig = drawn(axes_of)
    titles = " ".join(ax.get_title() for ax in fig.axes)
    assert titles.count("x1") == titles.count("x2") == 1
    assert "1e5" in titles
    assert sum(ax.has_data() for ax in fig.axes) == 2


@pytest.mark.parametrize("name", IN_SVG)
def test_the_same_figure_is_the_same_svg(name):
    """Drawn anew, and saved twice."""
    assert drawn_svg(name).startswith("<svg")
    anew = drawing.svg(OWN[name](), name) == drawn_svg(name)
    twice = drawing.svg(drawn(name), name) == drawn_svg(name)
    assert (anew, twice) == (True, True)


def test_another_figure_is_another_svg():
    same = drawn_svg("errors_by_level") == drawing.svg(errors_by_level(bound=2e-4), "errors_by_level")
    assert not same


@pytest.mark.parametrize("name", IN_SVG)
def test_an_svg_fetches_nothing_and_runs_nothing(name):
    text = drawn_svg(name)
    assert "<script" not in text
    assert all(value.startswith("#") for value in references(text))
    assert references(text)


def test_what_an_svg_fetches_is_seen():
    text = (
        '<svg xmlns="http://www.w3.org/2000/svg"><image href="https://a.b/c.png"/><g style="fill: url(d.svg)"/></svg>'
    )
    assert references(text) == ["https://a.b/c.png", "d.svg)"]


@pytest.mark.parametrize("name", ["tuning", "ranks"])
def test_a_png_has_the_size_of_its_figure_a_palette_and_is_the_same_twice(name):
    data = drawing.png(EVERY[name](), dpi=60)
    assert data.startswith(PNG)
    width, height = struct.unpack(">II", data[16:24])
    assert (width, height) == tuple(int(60 * side) for side in drawn(name).get_size_inches())
    assert data[25] == 3  # color type of a palette
    same = data == drawing.png(EVERY[name](), dpi=60)
    assert same


def test_an_embedded_figure_carries_its_png_and_its_words():
    text = drawing.html_image(tuning(), "gain by evaluation")
    before, after = text.split("base64,")
    assert before == '<img alt="gain by evaluation" src="data:image/png;'
    assert base64.b64decode(after.removesuffix('">'), validate=True) == drawing.png(tuning(), drawing.EMBEDDED_DPI)


@pytest.mark.parametrize("name", EVERY)
def test_no_figure_is_left_open_and_no_setting_is_left_changed(name):
    before = dict(plt.rcParams)
    EVERY[name]()
    assert plt.get_fignums() == []
    assert dict(plt.rcParams) == before
