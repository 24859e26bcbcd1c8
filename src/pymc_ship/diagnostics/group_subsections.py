"""Subsection on the differences between the groups of a hierarchical posterior."""

from itertools import combinations

import numpy as np
import xarray as xr
from matplotlib.figure import Figure

from pymc_ship.diagnostics.posterior_statistics import CI_PROB, ESS_LIMIT, R_HAT_LIMIT, TAILS, has
from pymc_ship.diagnostics.subsections import Subsection
from pymc_ship.inference.regression.tree import SAMPLE
from pymc_ship.pages.drawing import BLUE, NOISE, RUST, house_style, subplots
from pymc_ship.pages.tables import Columns, Table, number, percent, table

_COLOURS = (BLUE, RUST, "#3a8f4d", "#8a5fbf", "#c08a1e", "#4d4d4d")


def group_differences(tree: xr.DataTree) -> xr.Dataset:
    """Differences of every coefficient between two groups of a hierarchical posterior, the first minus the second.

    Dataset with dims (pair, coefficient): ``mean``, ``sd``, ``lower`` and ``upper`` (equal-tailed 95 %), prime values,
    and the flag ``differs``: zero lies outside the interval.
    """
    draws = tree["posterior"].dataset["group_coefficients"]
    pairs = list(combinations(draws["group"].values.tolist(), 2))
    difference = xr.concat([draws.sel(group=a, drop=True) - draws.sel(group=b, drop=True) for a, b in pairs], "pair")
    difference = difference.assign_coords(pair=[f"{a} - {b}" for a, b in pairs])
    low, high = (difference.quantile(tail, SAMPLE).drop_vars("quantile") for tail in TAILS)
    moments = {"mean": difference.mean(SAMPLE), "sd": difference.std(SAMPLE, ddof=1), "lower": low, "upper": high}
    return xr.Dataset(moments).assign(differs=(low > 0.0) | (high < 0.0))


def groups_subsection(tree: xr.DataTree) -> list[Subsection]:
    """Differences between the groups of a hierarchical posterior; empty for other posteriors."""
    if not has(tree, "posterior/group_coefficients"):
        return []
    differences, draws = group_differences(tree), tree["posterior"].dataset["group_coefficients"]
    sentences = [
        f"{name}: {', '.join(differing)} differ{'s' * (len(differing) == 1)}"
        for name in differences["pair"].values.tolist()
        if (differing := differences["coefficient"].values[differences["differs"].sel(pair=name).values].tolist())
    ]
    interval = percent(CI_PROB)
    text = (
        f"Intervals of {interval} of the differences that do not hold zero: {'; '.join(sentences)}. "
        if sentences
        else f"Every interval of {interval} of a difference between groups holds zero. "
    )
    count = differences["differs"].size
    text += (
        f"Of {count} intervals of {interval}, about {count * (1.0 - CI_PROB):.1f} would miss zero by chance if no "
        f"group differed and nothing were pooled; pooling makes that rarer. {_convergence_text(tree)}"
    )
    caption = (
        "Prime values times 1e5: mean ± sd of each group, sd between groups, and differences with their intervals."
    )
    figure = ("groups", _figure(draws), f"Mean and {interval} interval of each group over the sd of their mean.")
    return [Subsection("Groups", text, [(_table(tree, differences), caption)], [figure])]


def _convergence_text(tree: xr.DataTree) -> str:
    import arviz as az

    posterior = tree["posterior"].dataset[["group_coefficients", "group_sd"]]
    r_hat = max(float(values.max()) for values in az.rhat(posterior).data_vars.values())
    ess = min(float(values.min()) for values in az.ess(posterior).data_vars.values())
    holds = r_hat < R_HAT_LIMIT and ess > ESS_LIMIT
    sentences = f"Largest R-hat of groups and their spread {r_hat:.3f}, least bulk ESS {ess:.0f}"
    return f"{sentences}." if holds else f"{sentences}: these exceed the limits of convergence; draw longer chains."


def _table(tree: xr.DataTree, differences: xr.Dataset) -> Table:
    posterior = tree["posterior"].dataset
    groups = posterior["group"].values.tolist()
    mean = 1e5 * posterior["group_coefficients"].mean(SAMPLE)
    sd = 1e5 * posterior["group_coefficients"].std(SAMPLE, ddof=1)
    between = 1e5 * posterior["group_sd"].mean(SAMPLE)
    n, rows = number(3), []
    for name in posterior["coefficient"].values.tolist():
        one = {"coefficient": name, "between": float(between.sel(coefficient=name))}
        for group in groups:
            at = {"group": group, "coefficient": name}
            one[f"of {group}"] = f"{n(float(mean.sel(at)))} ± {n(float(sd.sel(at)))}"
        for pair in differences["pair"].values.tolist():
            difference = differences.sel(pair=pair, coefficient=name)
            low, high = (n(1e5 * float(difference[side])) for side in ("lower", "upper"))
            one[pair] = f"{n(1e5 * float(difference['mean']))} ({low} to {high}){' *' * bool(difference['differs'])}"
        rows.append(one)
    columns: Columns = {"coefficient": ("coefficient", str)} | {f"of {group}": (group, str) for group in groups}
    columns |= {"between": ("sd between groups", n)} | {
        pair: (pair, str) for pair in differences["pair"].values.tolist()
    }
    return table(rows, columns)


@house_style
def _figure(draws: xr.DataArray) -> Figure:
    """Interval of each coefficient in every group, about the mean over groups, in units of its sd."""
    middle = draws.mean("group")
    unit = middle.std(SAMPLE, ddof=1)
    scaled = (draws - middle.mean(SAMPLE)) / unit
    low, high = (scaled.quantile(tail, SAMPLE).drop_vars("quantile") for tail in TAILS)
    names, groups = draws["coefficient"].values.tolist(), draws["group"].values.tolist()
    fig, axes = subplots(8.0, 1.2 + 0.3 * len(names) * max(1.0, 0.35 * len(groups)))
    ax = axes[0, 0]
    for k, group in enumerate(groups):
        height = np.arange(len(names))[::-1] - 0.4 * (k / max(len(groups) - 1, 1) - 0.5)
        at = {"group": group}
        colour = _COLOURS[k % len(_COLOURS)]
        ax.hlines(height, low.sel(at), high.sel(at), color=colour, lw=1.4)
        ax.plot(scaled.sel(at).mean(SAMPLE), height, "o", color=colour, ms=3.5, label=group)
    ax.axvline(0.0, color=NOISE, lw=0.8, zorder=0)
    ax.set_yticks(np.arange(len(names))[::-1], names)
    ax.set_xlabel("(coefficient of the group − mean over groups) / sd of that mean")
    ax.legend(loc="lower center", bbox_to_anchor=(0.5, 1.0), ncols=4, frameon=False)
    return fig
