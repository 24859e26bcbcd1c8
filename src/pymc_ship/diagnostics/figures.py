"""Figures of the diagnostic page."""

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import matplotlib
import numpy as np
import xarray as xr
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import FixedLocator

from pymc_ship.diagnostics import posterior_statistics, regression
from pymc_ship.diagnostics.posterior_statistics import CI_PROB, E_BFMI_LIMIT, ENVELOPE, ESS_LIMIT, autocorrelation
from pymc_ship.pages.drawing import BLUE, NOISE, REFERENCE, RUST, STYLE, house_style, subplots

if TYPE_CHECKING:
    from arviz_stats.utils import ELPDData

ESS_POINTS = 12  # points of the curves of effective sample size
PREDICTIVE_SAMPLES = 50  # predictive data sets drawn over the record
PAIR_DRAWS = 2000  # draws shown in a pair plot
_FOREST_TICKS = np.concatenate([[0.0], *np.outer((-1, 1), (1, 2, 3, 10, 100, 1000, 1e4, 1e5, 1e6))])


def chosen_draws(tree: xr.DataTree, names: Sequence[str]) -> xr.DataTree:
    """Draws of a few quantities as variables: coefficients times 1e5, the noise variance as log10."""
    posterior = tree["posterior"].dataset
    drawn = {}
    for name in names:
        if name == "noise_variance":
            drawn["log10 σ²"] = np.log10(posterior["noise_variance"])
        else:
            drawn[f"{name} · 1e5"] = 1e5 * posterior["coefficients"].sel(coefficient=name, drop=True)
    groups = {"posterior": xr.Dataset(drawn)}
    if "sample_stats" in tree.children:
        groups["sample_stats"] = tree["sample_stats"].dataset
    return xr.DataTree.from_dict(groups)


@house_style
def arviz_figure(plot: str, subject: object, size: tuple[float, float], **settings: Any) -> Figure:
    """Plot of ArviZ in the house style, closed in pyplot; ``size`` in inches."""
    import arviz as az
    import matplotlib.pyplot as plt

    with plt.ioff():
        panels = getattr(az, plot)(subject, backend="matplotlib", figure_kwargs={"figsize": size}, **settings)
        fig = panels.get_viz("figure")
        fig = fig.item() if isinstance(fig, np.ndarray | xr.DataArray) else fig
        fig.set_layout_engine("constrained")
        plt.close(fig)
    return fig


def _label_axes(fig: Figure, x: str, y: str) -> Figure:
    for ax in fig.axes:
        ax.set(xlabel=x, ylabel=y)
    return fig


def _panels(count: int) -> dict:
    return {"col_wrap": 2, "size": (8.0, 2.1 * ((count + 1) // 2))}


def trace(tree: xr.DataTree, names: Sequence[str]) -> Figure:
    """Draws of the chosen quantities in their order, one colour a chain."""
    return arviz_figure("plot_trace", chosen_draws(tree, names), **_panels(len(names)))


def rank(tree: xr.DataTree, names: Sequence[str]) -> Figure:
    """Difference of each chain's fractional ranks from uniform."""
    drawn = chosen_draws(tree, names)
    return arviz_figure("plot_rank", drawn, envelope_prob=ENVELOPE, **_panels(len(names)))


def effective_sample_size(tree: xr.DataTree, names: Sequence[str]) -> Figure:
    """Bulk and tail ESS of the chosen quantities against the number of draws."""
    settings = {"min_ess": ESS_LIMIT, "n_points": ESS_POINTS, **_panels(len(names))}
    return arviz_figure("plot_ess_evolution", chosen_draws(tree, names), **settings)


def energy(tree: xr.DataTree) -> Figure:
    """E-BFMI of each chain; marginal energy and energy transitions."""
    fig = arviz_figure("plot_energy", tree, (8.0, 2.8), threshold=E_BFMI_LIMIT)
    labels = (("E-BFMI", "chain"), ("energy, centred", "density"))
    for ax, (x, y) in zip(fig.axes, labels, strict=False):
        ax.set(xlabel=x, ylabel=y)
    fig.axes[0].set_yticks(range(tree["posterior"].sizes["chain"]))
    return fig


def forest(tree: xr.DataTree, reference: np.ndarray | None, published: Mapping[str, np.ndarray]) -> Figure:
    """Equal-tailed 50 and 95 % intervals of every coefficient with its mean.

    Each coefficient is divided by its reference value (those of zero are left out), without one by its posterior sd.
    """
    draws = tree["posterior"].dataset["coefficients"]
    if reference is None:
        unit, label = draws.std(("chain", "draw"), ddof=1).values, "coefficient / posterior sd"
    else:
        unit, label = np.asarray(reference, dtype=float), "coefficient / reference"
    nonzero = np.flatnonzero(unit != 0.0)
    fig, ax, heights = forest_of(draws.isel(coefficient=nonzero) / unit[nonzero])
    ax.axvline(0.0, color=NOISE, lw=0.8, zorder=0)
    if reference is not None:
        ax.axvline(1.0, color=REFERENCE, ls="--", lw=0.9, label="reference")
        for (family, values), colour, marker in zip(published.items(), (RUST, REFERENCE), "dx", strict=False):
            ratio = np.asarray(values, dtype=float)[nonzero] / unit[nonzero]
            ax.plot(ratio, heights, marker, color=colour, ms=4.5, ls="none", label=f"published, {family}")
        ax.legend(loc="lower center", bbox_to_anchor=(0.5, 1.0), ncols=3, frameon=False)
    ax.set_xlabel(f"{label} (linear between −3 and 3, logarithmic beyond)")
    return fig


def forest_of(draws: xr.DataArray) -> tuple[Figure, Axes, np.ndarray]:
    """Forest of draws, dims (chain, draw, coefficient), its axes, and the height of each coefficient's row.

    Intervals are equal-tailed, 50 and 95 %; the axis is linear between -3 and 3 and logarithmic beyond.
    """
    shown = draws.rename("coefficients")
    relative, size = xr.DataTree.from_dict({"posterior": shown.to_dataset()}), (8.0, 0.9 + 0.24 * shown.shape[-1])
    settings = {"combined": True, "ci_kind": "eti", "ci_probs": (0.5, CI_PROB), "point_estimate": "mean"}
    fig = arviz_figure("plot_forest", relative, size, labels=["coefficient"], **settings)
    ax = max(fig.axes, key=lambda axes: len(axes.collections) + len(axes.lines))
    for names in fig.axes:
        names.set_visible(names is ax or bool(names.texts))
        names.set_xlabel("")
        names.spines["bottom"].set_visible(names is ax)
        names.set_xticks([] if names is not ax else ax.get_xticks())
    heights = _heights(ax, shown.mean(("chain", "draw")).values)
    ax.set_xscale("symlog", linthresh=3.0)
    ax.xaxis.set_major_locator(FixedLocator(_FOREST_TICKS.tolist()))
    ax.xaxis.set_major_formatter("{x:g}")
    return fig, ax, heights


def _heights(ax: Axes, means: np.ndarray) -> np.ndarray:
    """Height of each coefficient's row in a forest, read from the marker of its mean."""
    points = [np.asarray(c.get_offsets(), dtype=float) for c in ax.collections]
    lines = [np.column_stack([line.get_xdata(), line.get_ydata()]) for line in ax.lines]
    drawn = np.vstack([p for p in [*points, *(line for line in lines if len(line) == 1)] if p.size])
    return np.array([drawn[np.argmin(np.abs(drawn[:, 0] - mean)), 1] for mean in means])


def noise_variance(tree: xr.DataTree, rng: np.random.Generator) -> Figure:
    """Prior and posterior of log10 sigma2, the prior from draws inside its central 95 %."""
    posterior = np.log10(tree["posterior"].dataset["noise_variance"])
    prior = np.log10(np.maximum(regression.prior_noise_variance(tree, 20 * posterior.size, rng), 1e-300))
    prior = prior[(prior >= np.quantile(prior, 0.025)) & (prior <= np.quantile(prior, 0.975))][: posterior.size]
    groups = {
        "prior": xr.Dataset({"log10 σ²": (("chain", "draw"), prior[None])}),
        "posterior": xr.Dataset({"log10 σ²": posterior}),
    }
    together = xr.DataTree.from_dict(groups)
    return _label_axes(
        arviz_figure("plot_prior_posterior", together, (8.0, 3.2), kind="kde"),
        "log10 σ² of the prime response",
        "density",
    )


def predictive(tree: xr.DataTree) -> Figure:
    """Density of the response and of predictive data sets."""
    fig = arviz_figure("plot_ppc_dist", tree, (8.0, 3.2), num_samples=PREDICTIVE_SAMPLES, kind="kde")
    return _label_axes(fig, "prime response", "density")


def pair(tree: xr.DataTree, names: Sequence[str]) -> Figure:
    """Draws of the most correlated coefficients against each other."""
    sizes = tree["posterior"].sizes
    thin = max(1, sizes["chain"] * sizes["draw"] // PAIR_DRAWS)
    drawn = chosen_draws(tree, names).isel(draw=slice(None, None, thin))
    fig = arviz_figure("plot_pair", drawn, (8.0, 5.6), marginal=True, marginal_kind="kde")
    for ax in fig.axes:
        ax.locator_params(axis="x", nbins=5)
    return fig


def correlation(tree: xr.DataTree, dofs: Sequence[str] = ()) -> Figure:
    """Heat map of the posterior correlation of the coefficients; those of all ``dofs`` are parted by lines."""
    matrix = posterior_statistics.correlation(tree)
    with matplotlib.rc_context({**STYLE, "axes.grid": False}):
        side = 6.4 if dofs else 2.2 + 0.2 * len(matrix)
        fig, axes = subplots(side + (1.0 if dofs else 0.8), side)
        ax = axes[0, 0]
        image = ax.imshow(matrix.values, cmap="RdBu_r", vmin=-1.0, vmax=1.0)
        if dofs:
            _draw_dof_lines(ax, np.array(dofs))
        else:
            names = matrix["coefficient"].values.tolist()
            ax.set_xticks(range(len(names)), names, rotation=90, fontsize=7)
            ax.set_yticks(range(len(names)), names, fontsize=7)
        fig.colorbar(image, ax=ax, label="posterior correlation", shrink=0.8)
    return fig


def _draw_dof_lines(ax: Axes, dofs: np.ndarray) -> None:
    """Draw lines in a heat map where the degree of freedom of the coefficients changes."""
    edges = np.flatnonzero(dofs[1:] != dofs[:-1]) + 0.5
    middles, names = 0.5 * (np.append(-0.5, edges) + np.append(edges, dofs.size - 0.5)), list(dict.fromkeys(dofs))
    ax.set_xticks(middles, names)
    ax.set_yticks(middles, names)
    ax.tick_params(length=0)
    for edge in edges:
        ax.axhline(edge, color=REFERENCE, lw=0.6)
        ax.axvline(edge, color=REFERENCE, lw=0.6)


@house_style
def pareto_k(loo: "ELPDData") -> Figure:
    """Pareto k of every row with the limit of ArviZ."""
    fig, axes = subplots(8.0, 2.8)
    k = np.ravel(loo.pareto_k.values)
    axes[0, 0].plot(np.arange(k.size), k, ".", color=BLUE, ms=4)
    axes[0, 0].axhline(loo.good_k, color=REFERENCE, ls="--", lw=0.9, label=f"limit {loo.good_k:.2f}")
    axes[0, 0].set(xlabel="row", ylabel="Pareto k")
    axes[0, 0].legend()
    return fig


def loo_pit(pit: xr.Dataset) -> Figure:
    """Leave-one-out probability integral transform, ECDF minus uniform."""
    tree, settings = xr.DataTree.from_dict({"loo_pit": pit}), {"var_names": ["response"], "envelope_prob": ENVELOPE}
    fig = arviz_figure("plot_ecdf_pit", tree, (8.0, 3.2), group="loo_pit", sample_dims=["row"], **settings)
    low, high = fig.axes[0].get_ylim()
    fig.axes[0].set_ylim(low - 0.08 * (high - low), high + 0.08 * (high - low))
    return _label_axes(fig, "LOO-PIT", "ECDF minus uniform")


@house_style
def residuals(values: xr.DataArray, band: float) -> Figure:
    """Residuals over time and their autocorrelation with the band of white noise."""
    lags = min(40, values.size - 2)
    r = autocorrelation(values.values, lags)
    fig, axes = subplots(8.0, 2.9, 1, 2, width_ratios=(1.5, 1.0))
    axes[0, 0].plot(values["time"], 1e5 * values, color=BLUE, lw=0.8)
    axes[0, 0].set(xlabel="time [s]", ylabel="residual · 10⁵ (prime)")
    axes[0, 1].axhspan(-band, band, color=NOISE, alpha=0.5, lw=0, label="white noise, 95 %")
    axes[0, 1].vlines(np.arange(1, lags + 1), 0.0, r, color=RUST, lw=1.4)
    axes[0, 1].axhline(0.0, color=REFERENCE, lw=0.7)
    axes[0, 1].set(xlabel="lag [rows]", ylabel="autocorrelation")
    axes[0, 1].legend(loc="lower center", bbox_to_anchor=(0.5, 1.0))
    return fig


@house_style
def index_bands(rows: Sequence[tuple[str, Mapping[str, Mapping[str, float]]]]) -> Figure:
    """Bands of indices, a panel each: ``lower``, ``median`` and ``upper`` under prior and posterior."""
    colours = {"prior": NOISE, "posterior": BLUE}
    fig, axes = subplots(8.0, 1.7 * ((len(rows) + 1) // 2), (len(rows) + 1) // 2, 2)
    for ax, (label, bands) in zip(axes.flat, rows, strict=False):
        for height, (of, band) in enumerate(reversed([*bands.items()])):
            ax.plot([band["lower"], band["upper"]], [height, height], color=colours[of], lw=5.0)
            ax.plot(band["median"], height, "|", color="black", ms=11.0)
        ax.set_yticks(range(len(bands)), [*reversed([*bands])])
        ax.set_ylim(-0.6, len(bands) - 0.4)
        ax.set_xlabel(label)
    return fig
