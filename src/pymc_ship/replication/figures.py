"""Figures of the study: trials, posteriors and forecasts."""

from collections.abc import Mapping
from typing import Any

import numpy as np
import xarray as xr
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import LogLocator, NullFormatter

from pymc_ship.diagnostics.figures import arviz_figure
from pymc_ship.inference.regression.families import prior_family
from pymc_ship.inference.regression.tune import TunedPrior
from pymc_ship.pages.drawing import DOF_COLOURS, METHOD_COLOURS, NOISE, REFERENCE, RUST, house_style, subplots
from pymc_ship.physics.manoeuvre.registry import kind_named
from pymc_ship.physics.motion.equations import STATE
from pymc_ship.ships.forecasting.forecast import draws_text
from pymc_ship.trial.channels import CHANNELS, default_channels


def _in_display_unit(name: str, values: np.ndarray) -> np.ndarray:
    return CHANNELS[name].unit.display_factor * values


@house_style
def denoising(clean: xr.Dataset, noisy: xr.Dataset, smooth: xr.Dataset, zoom: tuple[float, float]) -> Figure:
    """Fig. 2: clean, polluted and denoised channels, the whole record and a part enlarged."""
    names = [name for name in default_channels() if name in smooth]
    fig, axes = subplots(8.0, 1.55 * len(names), len(names), 2, width_ratios=(1.7, 1.0), sharex="col")
    views: tuple[slice | np.ndarray, ...] = (
        slice(None, None, 10),
        np.flatnonzero((clean["time"] >= zoom[0]) & (clean["time"] <= zoom[1])),
    )
    for row, name in zip(axes, names, strict=True):
        for ax, view in zip(row, views, strict=True):
            time = clean["time"].values[view]
            ax.plot(time, _in_display_unit(name, noisy[name].values[view]), color=NOISE, lw=0.6, label="polluted")
            ax.plot(time, _in_display_unit(name, clean[name].values[view]), color=REFERENCE, lw=1.6, label="clean")
            ax.plot(time, _in_display_unit(name, smooth[name].values[view]), color=RUST, label="denoised")
        row[0].set_ylabel(CHANNELS[name].short_axis)
    for ax, title in zip(axes[0], ("whole record", "enlarged"), strict=True):
        ax.set_title(title)
    for ax in axes[-1]:
        ax.set_xlabel("time [s]")
    fig.legend(*axes[0, 0].get_legend_handles_labels(), loc="outside upper center", ncols=3)
    return fig


@house_style
def noise_variance(exact: Mapping[str, Any], dof: str) -> Figure:
    """Fig. 3: prior and posterior density of sigma2 of one DOF for each family, on a log axis."""
    fig, axes = subplots(8.0, 2.9, 1, len(exact))
    for ax, (family, posterior) in zip(axes[0], exact.items(), strict=True):
        low, high = posterior.noise_variance_quantiles([1e-6, 1.0 - 1e-6])
        values = np.geomspace(low / 30.0, high * 30.0, 20000)
        prior = values * posterior.prior_noise_variance_density(values)
        visible = values[(prior > 0.01 * prior.max()) | ((values > low) & (values < high))]
        for density, label, style in (
            (posterior.prior_noise_variance_density, "prior", "--"),
            (posterior.noise_variance_density, "posterior", "-"),
        ):
            ax.plot(values, values * density(values), style, color=prior_family(family).colour, label=label)
        if visible[-1] > 10.0 * visible[0]:
            ax.set_xscale("log")
            ax.xaxis.set_major_locator(LogLocator(subs=(1.0, 3.0)))
            ax.xaxis.set_minor_formatter(NullFormatter())
        else:
            ax.locator_params(axis="x", nbins=5)
        ax.set_xlim(visible[0] / 1.02, visible[-1] * 1.02)
        ax.set(xlabel="σ² of the prime response", ylabel="density of log σ²")
        ax.set_title(f"{dof}, {family}")
        ax.legend()
    return fig


@house_style
def sample_paths(paths: Mapping[str, tuple[xr.DataTree, float]]) -> Figure:
    """Fig. 4: path of a coefficient through the draws of every chain, with its mean and reference."""
    fig, axes = subplots(8.0, 2.9, 1, len(paths))
    for ax, (name, (tree, reference)) in zip(axes[0], paths.items(), strict=True):
        draws = tree["posterior"].dataset["coefficients"].sel(coefficient=name)
        for chain in draws["chain"].values:
            ax.plot(draws["draw"], 1e5 * draws.sel(chain=chain), lw=0.4, alpha=0.7)
        ax.axhline(1e5 * float(draws.mean()), color=RUST, label="posterior mean")
        ax.axhline(1e5 * reference, color=REFERENCE, ls="--", label="reference")
        ax.set(xlabel="draw", ylabel=f"{name}' · 10⁵")
    fig.legend(*axes[0, 0].get_legend_handles_labels(), loc="outside upper center", ncols=2)
    return fig


@house_style
def forecast_channels(reference: xr.Dataset, forecasts: Mapping[str, xr.DataTree]) -> Figure:
    """Fig. 5 and 6: motion of the reference ship against medians and bands of each forecast."""
    turning = kind_named(reference.attrs["manoeuvre"]).circles
    fig, axes = subplots(8.0, 7.4, 4, 2)
    shown = set.intersection(*(set(map(str, tree["bands"].data_vars)) for tree in forecasts.values()))
    panels = [name for name in (*STATE[:6], "delta") if name in shown]
    for ax, name in zip(axes.flat, panels, strict=False):
        for family, tree in forecasts.items():
            _band(ax, tree["bands"].to_dataset(), name, prior_family(family).colour, family)
        ax.plot(
            reference["time"], _in_display_unit(name, reference[name].values), "--", color=REFERENCE, label="reference"
        )
        ax.set_ylabel(CHANNELS[name].short_axis)
        ax.set_xlabel("time [s]")
    _track(axes.flat[-1], reference, forecasts, equal=turning)
    handles, labels = axes.flat[0].get_legend_handles_labels()
    fig.legend(handles, labels, loc="outside upper center", ncols=3)
    fig.supxlabel("\n".join(f"{family}: {draws_text(tree)}" for family, tree in forecasts.items()), fontsize=9.0)
    return fig


def _band(ax: Axes, bands: xr.Dataset, name: str, colour: str, family: str) -> None:
    lower, median, upper = (
        _in_display_unit(name, bands[name].sel(band=band).values) for band in ("lower", "median", "upper")
    )
    ax.fill_between(bands["time"], lower, upper, color=colour, alpha=0.22, lw=0, label=f"{family}: band")
    ax.plot(bands["time"], median, color=colour, label=f"{family}: median")


def _track(ax: Axes, reference: xr.Dataset, forecasts: Mapping[str, xr.DataTree], *, equal: bool) -> None:
    for family, tree in forecasts.items():
        ships = tree["trajectories"].to_dataset()
        for draw in range(min(40, ships.sizes["draw"])):
            ax.plot(ships["y"][draw], ships["x"][draw], color=prior_family(family).colour, lw=0.4, alpha=0.25)
    ax.plot(reference["y"], reference["x"], "--", color=REFERENCE)
    ax.set(xlabel="y, to starboard [m]", ylabel="x, ahead [m]")
    if equal:
        ax.set_aspect("equal")
        low, high = float(reference["y"].min()), float(reference["y"].max())  # of a ship that runs away: until then
        ax.set_xlim(low - 0.15 * (high - low), high + 0.15 * (high - low))


@house_style
def errors_by_level(levels: np.ndarray, errors: Mapping[str, np.ndarray], published: float, bound: float) -> Figure:
    """Median coefficient error of each DOF against the noise level, with the published median and its level."""
    fig, axes = subplots(8.0, 3.4)
    ax = axes[0, 0]
    for dof, values in errors.items():
        ax.loglog(levels, values, "o-", ms=3.5, color=DOF_COLOURS.get(dof, REFERENCE), label=dof)
    ax.axhline(published, color=REFERENCE, ls="--", lw=0.9, label="published, median of all")
    if np.isfinite(bound):
        ax.axvline(bound, color=REFERENCE, ls=":", lw=0.9, label=f"published errors at level {bound:.1e}")
    ax.set(xlabel="noise level (standard deviation of ξ)", ylabel="median |error| [%]")
    ax.legend(ncols=2)
    return fig


@house_style
def errors_by_method(
    levels: np.ndarray, errors: Mapping[str, np.ndarray], published: Mapping[str, float], printed_level: float
) -> Figure:
    """Median coefficient error of each method against the noise level, with published medians by family."""
    fig, axes = subplots(8.0, 4.2)
    ax = axes[0, 0]
    styles = [{"color": REFERENCE, "ls": "--"}, *({"color": colour, "marker": "o"} for colour in METHOD_COLOURS)]
    for (method, values), style in zip(errors.items(), styles, strict=False):
        ax.loglog(levels, values, ms=3.5, label=method, **style)
    for (family, median), marker in zip(published.items(), "*P", strict=False):
        ax.plot(printed_level, median, marker, ls="", ms=8, color=REFERENCE, label=f"published, {family}")
    ax.set(xlabel="noise level (standard deviation of ξ)", ylabel="median |error| [%]")
    fig.legend(*ax.get_legend_handles_labels(), loc="outside upper center", ncols=3)
    return fig


@house_style
def tuning(tuned: Mapping[str, TunedPrior]) -> Figure:
    """Best cross-validated score so far minus that of the evidence maximum, against the evaluation, for each DOF."""
    fig, axes = subplots(8.0, 2.9)
    ax = axes[0, 0]
    for dof, result in tuned.items():
        best = np.maximum.accumulate(result.scores) - result.evidence_score
        ax.plot(np.arange(1, best.size + 1), best, ".-", ms=3, color=DOF_COLOURS.get(dof, REFERENCE), label=dof)
    ax.axhline(0.0, color=REFERENCE, ls="--", lw=0.9, label="evidence maximum")
    ax.set_yscale("symlog", linthresh=1e-3)
    ax.set(xlabel="evaluation", ylabel="gain [nats per row]")
    ax.legend(ncols=5, fontsize=8)
    return fig


def arviz_panels(
    plot: str, trees: Mapping[str, xr.DataTree], coefficients: Mapping[str, str], **settings: Any
) -> Figure:
    """One panel for one coefficient of each tree, drawn by ArviZ."""
    draws = {
        f"{coefficients[dof]} · 1e5": 1e5
        * tree["posterior"].dataset["coefficients"].sel(coefficient=coefficients[dof], drop=True)
        for dof, tree in trees.items()
    }
    together = xr.DataTree.from_dict({"posterior": xr.Dataset(draws)})
    return arviz_figure(plot, together, (8.0, 4.2), col_wrap=2, **settings)
