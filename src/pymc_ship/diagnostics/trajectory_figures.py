"""Figures of a posterior of whole trajectories."""

from collections.abc import Iterator, Mapping

import matplotlib
import numpy as np
import scipy
import xarray as xr
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from pymc_ship.diagnostics import posterior_statistics as statistics
from pymc_ship.diagnostics import trajectory
from pymc_ship.diagnostics.figures import forest_of
from pymc_ship.diagnostics.posterior_statistics import CONTRACTION_LIMIT, SD_LIMIT
from pymc_ship.inference.identifiability.information import UNKNOWN
from pymc_ship.pages.drawing import BLUE, NOISE, REFERENCE, RUST, STYLE, house_style, subplots
from pymc_ship.trial.channels import CHANNELS

LAGS = 40  # lags of the autocorrelation drawn, in blocks
QUANTILES = 400  # quantiles drawn of the residuals of a channel
_DETERMINATION_COLOURS = {"determined": BLUE, "includes zero": "#8fb7d8", "prior": RUST}


@house_style
def motion_figure(tree: xr.DataTree, run: int) -> Figure:
    """Measured and fitted block means of every channel of a run, residuals below, and the rudder."""
    dataset, constant = trajectory.residuals(tree), tree["constant_data"].dataset
    rows = np.flatnonzero(dataset["run"].values == run)
    one, time = dataset["residual"].isel(row=rows), dataset["time"].values[rows]
    names = [str(name) for name in one["channel"].values if np.isfinite(one.sel(channel=name)).all()]
    shifted = ", sensor offset included" if "sensor_offset" in tree["posterior"] else ""
    fig, pairs, rudder = _motion_panels(len(names))
    for (ax, below), name in zip(pairs, names, strict=True):
        factor = CHANNELS[name].unit.display_factor
        measured = tree["observed_data"].dataset["response"].sel(channel=name)[rows]
        residual = one.sel(channel=name)
        fitted = measured - residual * constant["block_sd"].isel(run_index=run).sel(channel=name)
        ax.plot(time, factor * measured, ".", color=NOISE, ms=2.0, label="measured, block means")
        ax.plot(time, factor * fitted, color=BLUE, label=f"fitted{shifted}")
        ax.set_ylabel(CHANNELS[name].short_axis)
        below.plot(time, residual, ".", color=RUST, ms=1.5)
        below.axhline(0.0, color=REFERENCE, lw=0.7)
        below.set_ylabel("residual [sd]")
    rudder.plot(time, np.rad2deg(constant["motion"].sel(symbol="delta").values[rows]), color=REFERENCE)
    rudder.set_ylabel(CHANNELS["delta"].axis)
    fig.legend(*pairs[0][0].get_legend_handles_labels(), loc="outside upper center", ncols=2, markerscale=3.0)
    return fig


def _motion_panels(n_channels: int) -> tuple[Figure, list[tuple], Axes]:
    """A high panel above a low one for each channel, two in a row, and one for the rudder."""
    count = (n_channels + 2) // 2
    fig, axes = subplots(9.0, 2.5 * count, 2 * count, 2, height_ratios=(2.2, 1.0) * count, sharex=True)
    pairs = [(axes[2 * (k // 2), k % 2], axes[2 * (k // 2) + 1, k % 2]) for k in range(2 * count)]
    for ax in (ax for pair in pairs[n_channels:] for ax in pair):
        ax.remove()
    rudder = fig.add_subplot(axes[0, 0].get_gridspec()[2 * count - 2 :, n_channels % 2], sharex=axes[0, 0])
    for ax in (pairs[n_channels - 1][1], rudder):
        ax.set_xlabel("time [s]")
        ax.tick_params(labelbottom=True)
    return fig, pairs[:n_channels], rudder


def _channel_panels(dataset: xr.Dataset, height: float, label: str) -> tuple[Figure, list[tuple]]:
    """A panel for each channel, three in a row with one label, as (axes, channel)."""
    names = [str(name) for name in dataset["channel"].values]
    count = (len(names) + 2) // 3
    fig, axes = subplots(9.0, height * count, count, min(3, len(names)), sharey=True)
    for ax in axes.flat[len(names) :]:
        ax.set_visible(False)
    for ax in axes[:, 0]:
        ax.set_ylabel(label)
    for ax, name in zip(axes.flat, names, strict=False):
        ax.set_title(CHANNELS[name].short_label)
    return fig, list(zip(axes.flat, names, strict=False))


def _series(dataset: xr.Dataset, name: str) -> Iterator[tuple[int, np.ndarray]]:
    """Run and whitened residuals of a channel, of every run that has it."""
    for run in np.unique(dataset["run"].values):
        values = dataset["white"].sel(channel=name).values[dataset["run"].values == run]
        if np.isfinite(values).all():
            yield int(run), values


@house_style
def autocorrelation_figure(dataset: xr.Dataset) -> Figure:
    """Autocorrelation of the whitened residuals of every channel, a line for each run, with the band of white noise."""
    fig, panels = _channel_panels(dataset, 2.0, "autocorrelation")
    for ax, name in panels:
        for run, values in _series(dataset, name):
            lags = min(LAGS, values.size - 2)
            interval = float(np.diff(dataset["time"].values[dataset["run"].values == run]).mean())
            seconds = interval * np.arange(1, lags + 1)
            band = 1.96 / np.sqrt(values.size)
            ax.fill_between(seconds, -band, band, color=NOISE, alpha=0.35, lw=0, label="white noise, 95 %")
            ax.plot(seconds, statistics.autocorrelation(values, lags), ".-", lw=0.8, ms=3, label=f"run {run + 1}")
        ax.axhline(0.0, color=REFERENCE, lw=0.7)
        ax.set_xlabel("lag [s]")
    handles, labels = panels[0][0].get_legend_handles_labels()
    shown = dict(zip(labels, handles, strict=True))
    fig.legend(shown.values(), shown, loc="outside upper center", ncols=6)
    return fig


@house_style
def quantiles_figure(dataset: xr.Dataset) -> Figure:
    """Quantiles of the whitened residuals of every channel against those of the standard normal."""
    fig, panels = _channel_panels(dataset, 2.4, "residual quantile [sd]")
    for ax, name in panels:
        for run, values in _series(dataset, name):
            points = (np.arange(min(values.size, QUANTILES)) + 0.5) / min(values.size, QUANTILES)
            ax.plot(scipy.stats.norm.ppf(points), np.quantile(values, points), ".", ms=3, label=f"run {run + 1}")
        ax.axline((0.0, 0.0), slope=1.0, color=REFERENCE, ls="--", lw=0.9, label="normal")
        ax.set_xlabel("standard normal quantile")
    fig.legend(*panels[0][0].get_legend_handles_labels(), loc="outside upper center", ncols=6, markerscale=2.0)
    return fig


def forest_figure(tree: xr.DataTree, dof: str, marks: Mapping[str, np.ndarray]) -> Figure:
    """Equal-tailed 50 and 95 % intervals of the coefficients of a DOF about the prior mean, in prior sd.

    Coefficients with a flat prior are divided by their posterior sd. ``marks``: other values by name.
    """
    dataset = trajectory.contraction(tree)
    of_dof = np.flatnonzero(dataset["dof"].values == dof)
    one, draws = dataset.isel(coefficient=of_dof), tree["posterior"].dataset["coefficients"].isel(coefficient=of_dof)
    flat = np.isinf(one["prior_sd"].values)
    unit = np.where(flat, one["sd"].values, one["prior_sd"].values)
    fig, ax, heights = forest_of((draws - one["prior_mean"].values) / unit)
    if not flat.all():
        ax.axvspan(-SD_LIMIT, SD_LIMIT, color=NOISE, alpha=0.25, lw=0, zorder=0, label="prior, 95 %")
    ax.axvline(0.0, color=NOISE, lw=0.8, zorder=0)
    styles = (("|", REFERENCE, 9.0), ("d", RUST, 4.0), ("x", REFERENCE, 4.0))
    for (name, values), (marker, colour, size) in zip(marks.items(), styles, strict=False):
        relative = (np.asarray(values, dtype=float) - one["prior_mean"].values) / unit
        ax.plot(relative, heights, marker, color=colour, ms=size, ls="none", label=name)
    handles, labels = ax.get_legend_handles_labels()
    if labels:
        fig.legend(handles, labels, loc="outside upper center", ncols=4, frameon=False)
    label = "(coefficient − prior mean) / prior sd"
    if flat.any():
        label = "coefficient / posterior sd" if flat.all() else f"{label}; of flat priors coefficient / posterior sd"
    ax.set_xlabel(f"{dof}: {label} (linear between −3 and 3, logarithmic beyond)")
    return fig


def contraction_figure(dataset: xr.Dataset) -> Figure:
    """Contraction of every coefficient, a row of bars for each DOF."""
    dofs = list(dict.fromkeys(dataset["dof"].values))
    most = max(int(np.sum(dataset["dof"].values == dof)) for dof in dofs)
    labels = statistics.determination_labels(dataset)
    with matplotlib.rc_context(STYLE | {"axes.grid": False}):
        fig, axes = subplots(9.0, 2.3 * len(dofs), len(dofs))
        for ax, dof in zip(axes[:, 0], dofs, strict=True):
            of_dof = dataset["dof"].values == dof
            position, height = np.arange(of_dof.sum()), np.maximum(dataset["contraction"].values[of_dof], 0.0)
            for label, colour in _DETERMINATION_COLOURS.items():
                which = labels[of_dof] == label
                ax.bar(position[which], height[which], color=colour, label=label)
            ax.axhline(CONTRACTION_LIMIT, color=REFERENCE, ls="--", lw=0.8)
            ax.set_xticks(position, dataset["coefficient"].values[of_dof], rotation=90, fontsize=7)
            ax.set_xlim(-0.6, most - 0.4)
            ax.set_ylim(0.0, 1.02)
            ax.set_ylabel(f"{dof}: contraction")
        colours = {label: matplotlib.patches.Patch(color=colour) for label, colour in _DETERMINATION_COLOURS.items()}
        fig.legend(colours.values(), colours, loc="outside upper center", ncols=3)
    return fig


@house_style
def directions_figure(dataset: xr.Dataset) -> Figure:
    """Share of the prior variance left along every direction, the least known first."""
    remaining = dataset["remaining_variance"].values
    fig, axes = subplots(8.0, 2.6)
    ax, position = axes[0, 0], np.arange(1, remaining.size + 1)
    for which, colour, label in (
        (remaining > UNKNOWN, RUST, "stays unknown"),
        (remaining <= UNKNOWN, BLUE, "determined by the records"),
    ):
        ax.semilogy(position[which], remaining[which], ".", color=colour, ms=5, label=label)
    ax.axhline(UNKNOWN, color=REFERENCE, ls="--", lw=0.9)
    ax.set(xlabel="direction, the least known first", ylabel="posterior over prior variance")
    ax.legend()
    return fig
