"""Figures of a grid of experiments: each score against the noise level, one line per method."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from pymc_ship.pages.drawing import REFERENCE, house_style, subplots

COLOURS = ("#7d4fa3", "#c8551b", "#3a8f4d", "#1f6fb2", "#7fb3dd", "#a8892c", "#8c564b", "#6b7680")
"""One for each method, in the order of the study."""

MARKERS = "Dv^osP<>"  # one for each method, too

_LABELS = {
    "median_error": "median |coefficient error| [%]",
    "coverage": "90 % intervals cover [%]",
    "tactical_diameter_error": "tactical diameter error [%]",
}


@house_style
def scores(rows: Sequence[Mapping]) -> Figure:
    """Scores of :func:`.cell_row` for one ship, manoeuvre and kind of noise, with bars of two standard errors."""
    fig, axes = subplots(9.0, 3.6, 1, len(_LABELS))
    for ax, (name, label) in zip(axes[0], _LABELS.items(), strict=True):
        _lines(ax, rows, name)
        ax.set_xlabel("noise level [%]")
        ax.set_ylabel(label)
    axes[0, 1].axhline(90.0, color=REFERENCE, ls="--", lw=0.9)
    axes[0, 1].set_ylim(0.0, 104.0)
    fig.legend(*axes[0, 0].get_legend_handles_labels(), loc="outside upper center", ncols=4)
    return fig


def _lines(ax: Axes, rows: Sequence[Mapping], name: str) -> None:
    """Line of each method over the levels, without infinities and, on a logarithmic axis, zeros."""
    logarithmic, levels = name != "coverage", sorted({row["level"] for row in rows if row["level"] > 0.0})
    drawn = 0
    for k, method in enumerate(dict.fromkeys(row["method"] for row in rows)):
        mine = sorted((row["level"], row[name], row[f"{name}_se"]) for row in rows if row["method"] == method)
        level, value, se = np.array(mine).T
        shown = (level > 0.0) & np.isfinite(value) & ((value > 0.0) | (not logarithmic))
        bars = 2.0 * np.nan_to_num(se[shown])
        drawn += shown.sum()
        lower = np.minimum(bars, 0.9 * value[shown]) if logarithmic else bars
        style: dict[str, Any] = {"color": COLOURS[k % len(COLOURS)], "marker": MARKERS[k % len(MARKERS)], "ms": 4.0}
        style |= {"capsize": 2.0, "elinewidth": 0.8, "label": method}
        ax.errorbar(100.0 * level[shown], value[shown], (lower, bars), **style)
    if not drawn:
        ax.text(0.5, 0.5, "no finite value", ha="center", transform=ax.transAxes)
        ax.set_xticks([])
        return
    ax.set_xscale("log")
    if logarithmic:
        ax.set_yscale("log")
    ax.set_xticks([100.0 * level for level in levels], [f"{100.0 * level:g}" for level in levels])
    ax.set_xticks([], minor=True)
